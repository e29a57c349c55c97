"""Effects worked out before the rollout, where they do not depend on the state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn, cast

from physid.physics.case import Case
from physid.physics.effect import Effect, StepInputs
from physid.physics.guards.unread import ReadError, plain, unread
from physid.physics.state import State


class _Unknown:
    """Stands for a state that is not known yet."""

    def __getattr__(self, name: str) -> NoReturn:
        raise ReadError(name)


def inputs_ahead(case: Case) -> StepInputs | None:
    """Let effects act on all steps of a rollout at once.

    Returns:
        Inputs whose batch axis holds the T * substeps steps of each world, one world after the other; None if an effect
        asks for the state, or its Python looks at the time.
    """
    try:
        _act(case.effects, case.inputs)  # a single step shows it as a rule, and costs little
        return _act(*_of_all_steps(case))
    except ReadError:
        return None


def _act(effects: Sequence[Effect], inputs: StepInputs) -> StepInputs:
    inputs = inputs.replace(time=unread(inputs.time))
    for effect in effects:
        inputs = effect.act(cast(State, _Unknown()), inputs)
    return inputs.replace(**{name: plain(value) for name, value in inputs.tensors().items()})


def _of_all_steps(case: Case) -> tuple[list[Effect], StepInputs]:
    """Return effects and inputs with a value for every step of each world, one world after the other."""
    batch, substeps = len(case.wrenches), case.world.substeps
    count = case.frames * substeps
    now = _repeated(case.inputs, count)
    now = now.replace(
        time=now.time + case.grid.time.expand(batch, -1).flatten(),
        wrench=case.wrenches.repeat_interleave(substeps, 1).flatten(0, 1),
    )
    whole = [
        effect.replace(
            **{
                name: value if value.shape[0] == 1 else value.repeat_interleave(count, 0)
                for name, value in effect.values().items()
            }
        )
        for effect in case.effects
    ]
    return whole, now


def _repeated(inputs: StepInputs, count: int) -> StepInputs:
    """Repeat the inputs of every world so many times, but for the ground, which all worlds share."""
    own = inputs.tensors(but=("ground",))
    return inputs.replace(**{name: value.repeat_interleave(count, 0) for name, value in own.items()})
