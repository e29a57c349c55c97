"""Which of the two implementations runs: the torch reference, or the compiled one."""

from __future__ import annotations

import logging
from functools import lru_cache
from importlib import import_module
from itertools import combinations_with_replacement
from typing import Literal, get_args

import torch
from torch import Tensor

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


def use_fused(backend: Backend, world: World, reference: Tensor) -> bool:
    """Decide whether the compiled implementation runs for tensors like `reference`.

    With "auto" the reference runs where the compiled implementation cannot, and says so once.

    Raises:
        ValueError: If `backend` is "fused" and it cannot run.
    """
    if backend == "reference":
        return False
    obstacle = _obstacle(world, reference)
    if obstacle is None:
        return True
    if backend == "fused":
        raise ValueError(
            f'backend="fused" cannot be used: {obstacle}; use backend="auto" to fall back to the reference'
        )
    _say_once(obstacle)
    return False


def _obstacle(world: World, reference: Tensor) -> str | None:
    if reference.device.type != "cpu":
        return f"tensors are on {reference.device.type}, not on cpu"
    if reference.dtype != torch.float64:
        return f"tensors are {reference.dtype}, not torch.float64"
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
