"""Which of the two engines runs: the torch reference, or the compiled one."""

from __future__ import annotations

import logging
from functools import lru_cache
from importlib import import_module
from itertools import combinations_with_replacement
from typing import Literal, get_args

import torch
from torch import Tensor

from physid.physics import reference
from physid.physics.case import Case, Outcome
from physid.physics.contact import Penetrating, Speculative, Split
from physid.physics.contact_problem.friction import Cone
from physid.physics.shapes.box import Box
from physid.physics.world import World

Backend = Literal["auto", "reference", "fused"]

COMPILED_ON_GROUND = (Box,)
COMPILED_PAIRS = ((Box, Box),)
"""Shapes whose contacts with the ground, and pairs of shapes whose contacts, are compiled."""


def check_backend(backend: str) -> None:
    """Raise a ValueError unless `backend` is a name that is known.

    Raises:
        ValueError: If it is not.
    """
    if backend not in get_args(Backend):
        raise ValueError(f"backend must be one of {', '.join(get_args(Backend))}, got {backend!r}")


def roll(case: Case, backend: Backend, check: reference.Check, every: int | None) -> Outcome:
    """Roll worlds out by the engine that a backend stands for.

    Args:
        case: The worlds.
        backend: As `PhysicsLayer` takes it.
        check: Told of worlds that failed; raises the error.
        every: Frames between stored states of the reference; None stores all.

    Raises:
        ValueError: If the backend is "fused" and cannot run.
    """
    if not use_fused(backend, case.world, case.state.pose):
        return reference.roll(case, check, every)
    from physid.physics.fused.compiled import roll_compiled
    from physid.physics.fused.stepping import Stepper

    outcome = roll_compiled(case)
    if outcome is None:
        return reference.roll(case, check, every, Stepper(case.world, case.solver))
    pose, _, _, residual, _ = outcome
    failed = ~(residual <= case.solver.residual(pose.dtype) / case.solver.tau(pose.dtype))
    failed[:, -1] |= ~reference.finite(pose[:, -1])  # any earlier one would have failed the step after it
    if bool(failed.any()):
        t = int(failed.any(0).nonzero()[0])
        check(failed[:, t] | ~reference.finite(pose[:, t + 1]), residual[:, t], t)
    return outcome


def use_fused(backend: Backend, world: World, like: Tensor) -> bool:
    """Decide whether the compiled implementation runs for tensors like some.

    With "auto" the reference runs where the compiled implementation cannot, and says so once.

    Raises:
        ValueError: If `backend` is "fused" and it cannot run.
    """
    if backend == "reference":
        return False
    obstacle = _obstacle(world, like)
    if obstacle is None:
        return True
    if backend == "fused":
        raise ValueError(
            f'backend="fused" cannot be used: {obstacle}; use backend="auto" to fall back to the reference'
        )
    _say_once(obstacle)
    return False


def _obstacle(world: World, like: Tensor) -> str | None:
    if like.device.type != "cpu":
        return f"tensors are on {like.device.type}, not on cpu"
    if like.dtype != torch.float64:
        return f"tensors are {like.dtype}, not torch.float64"
    if not isinstance(world.friction, Cone):
        return f"friction is a {type(world.friction).__name__}, not a Cone"
    if not isinstance(world.contact, Speculative | Penetrating | Split):
        return f"the contact rule is {type(world.contact).__name__}"
    if world.joints:
        return "the world has joints"
    return _uncompiled_shapes(world) or _missing_compiler()


def _uncompiled_shapes(world: World) -> str | None:
    shapes = sorted({type(shape) for shape in world.shapes}, key=lambda shape: shape.__name__)
    for shape in shapes if world.ground is not None else ():
        if shape not in COMPILED_ON_GROUND:
            return f"contacts of a {shape.__name__} with the ground are not compiled"
    for pair in combinations_with_replacement(shapes, 2) if len(world.shapes) > 1 else ():
        if pair not in COMPILED_PAIRS and pair[::-1] not in COMPILED_PAIRS:
            return f"contacts of {pair[0].__name__} and {pair[1].__name__} are not compiled"
    return None


@lru_cache
def _missing_compiler() -> str | None:
    try:
        import_module("llvmlite.binding")
    except (ImportError, OSError) as error:
        return f"llvmlite cannot be imported ({error})"
    return None


@lru_cache
def _say_once(obstacle: str) -> None:
    logging.getLogger(__name__).warning(
        "the reference implementation of the physics runs, which is slower: %s", obstacle
    )
