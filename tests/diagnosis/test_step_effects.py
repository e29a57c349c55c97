"""Effects that act at a step and on whole trajectories: the step takes the one, and leaves the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

import pytest
import torch
from tests.physics.test_fused import draw
from torch import Tensor

from physid.effects import CATALOGUE
from physid.effects.contact.friction_drift import FrictionDrift
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.estimation.prediction.step_effects import acts_late, only_steps
from physid.physics import Effect, PhysicsLayer, Rollout, Site, State, StepInputs, quantity
from physid.scenes import find_setup

SIZES = torch.linspace(0.1, 0.4, 4, dtype=torch.float64)


@final
@dataclass(frozen=True)
class PushedDrag(Effect):
    """A drag that also changes what was commanded."""

    name: ClassVar[str] = "pushed_drag"
    site: ClassVar[Site] = "dynamics"
    coefficient: Tensor = quantity("N s/m", low=0.0, high=5.0, typical=0.3)

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        """Push."""
        return wrench + 1.0

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Slow down."""
        return ViscousDrag(self.coefficient).act(state, inputs)


@final
@dataclass(frozen=True)
class SeenDrift(Effect):
    """A drift of the friction that also moves what the camera sees."""

    name: ClassVar[str] = "seen_drift"
    site: ClassVar[Site] = "contact"
    rate: Tensor = quantity("1/s", low=-0.5, high=3.0, typical=0.3)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Change the friction."""
        return FrictionDrift(self.rate).act(state, inputs)

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Shift what is seen."""
        return pose + 1.0


@final
@dataclass(frozen=True)
class LateAlong(Effect):
    """Forces along x that are held for a step more."""

    name: ClassVar[str] = "late_along"
    site: ClassVar[Site] = "actuation"
    share: Tensor = quantity("-", low=0.0, high=1.0, typical=0.5)

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        """Mix each force with the one before."""
        late, share = wrench.clone(), self.share[:, None, None]
        late[:, 1:, :, 3] = (1 - share) * wrench[:, 1:, :, 3] + share * wrench[:, :-1, :, 3]
        return late


def rolled(effect: Effect) -> Rollout:
    case = draw(find_setup("push"), len(SIZES), 12)
    with torch.no_grad():
        return case.roll(PhysicsLayer(case.world, [effect]))


@pytest.mark.parametrize(
    ("mixed", "alone"),
    [(PushedDrag(SIZES), ViscousDrag(SIZES)), (SeenDrift(SIZES), FrictionDrift(SIZES))],
    ids=["asks for the state", "asks for the time"],
)
def test_a_step_takes_what_acts_at_it_with_the_values_of_each_world(mixed: Effect, alone: Effect) -> None:
    effect = only_steps(mixed)
    assert torch.equal(rolled(effect).pose, rolled(alone).pose)
    pose = torch.zeros(len(SIZES), 3, 1, 7, dtype=torch.float64)
    assert torch.equal(effect.observe(pose, torch.arange(3)[None]), pose)


def test_an_effect_that_only_acts_at_steps_stays_itself() -> None:
    drag = ViscousDrag(SIZES)
    assert only_steps(drag) is drag


def test_what_remembers_commands_or_reads_another_clock_acts_late() -> None:
    """Such effects alone need short steps: all others change forces where the command does."""
    late = {kind.name for kind in CATALOGUE if acts_late(kind)}
    assert late == {"force_delay", "force_lag", "observation_latency", "clock_rate"}
    assert not acts_late(PushedDrag)
    assert acts_late(LateAlong), "though only in one direction"
