"""Effects as a step sees them, where wrenches and poses of whole trajectories have been changed before."""

from __future__ import annotations

import dataclasses
from functools import cache

import torch
from torch import Tensor

from physid.physics import Effect, State, StepInputs


@dataclasses.dataclass(frozen=True)
class AtStep(Effect):
    """What an effect does at the step, and nothing else of it."""

    effect: Effect

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Act as the effect does."""
        return self.effect.act(state, inputs)

    def values(self) -> dict[str, Tensor]:
        """Return the parameters of the effect."""
        return self.effect.values()

    def replace(self, **changes: Tensor) -> AtStep:
        """Return a copy with some parameters of the effect changed."""
        return AtStep(self.effect.replace(**changes))


def only_steps(effect: Effect) -> Effect:
    """Return an effect without what it does to whole trajectories."""
    return AtStep(effect) if has(type(effect), "actuate") or has(type(effect), "observe") else effect


def has(kind: type[Effect], hook: str) -> bool:
    """Return whether an effect does something at a hook: elapse, actuate, act or observe."""
    return getattr(kind, hook) is not getattr(Effect, hook)


@cache
def acts_late(kind: type[Effect]) -> bool:
    """Return whether an effect moves changes of a force in time: by what was commanded before, or by a camera's clock.

    Then forces change within the steps that were laid between changes of the command.
    """
    if has(kind, "elapse"):
        return True
    if not has(kind, "actuate"):
        return False
    effect, time = typical(kind), torch.arange(2, dtype=torch.float64)[None]
    wrench = torch.ones(1, 2, 1, 6, dtype=torch.float64)
    other = wrench.clone()
    other[:, 0] = -other[:, 0]
    return bool((effect.actuate(wrench, time)[:, 1:] != effect.actuate(other, time)[:, 1:]).any())


def with_values(kind: type[Effect], values: Tensor) -> Effect:
    """Return an effect with parameters (B, q)."""
    return kind(**{name: values[:, k] for k, name in enumerate(kind.quantities())})


def typical(kind: type[Effect]) -> Effect:
    """Return an effect of a size that is typical in practice."""
    return with_values(kind, torch.tensor([[one.typical for one in kind.quantities().values()]], dtype=torch.float64))
