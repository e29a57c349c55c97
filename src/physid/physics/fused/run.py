"""Kernels called on groups of worlds, in as many threads as torch uses where that is worth their waking."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from threading import local
from typing import Literal

import torch
from torch import Tensor

from physid.compiler.emit import ALIGNMENT, LANES
from physid.compiler.machine import Kernel, load
from physid.physics.fused.kernel import write_backward, write_forward
from physid.physics.fused.records import Shape
from physid.physics.fused.writer import ARGUMENTS

BEGIN, END = ARGUMENTS.index("begin"), ARGUMENTS.index("end")
Direction = Literal["forward", "backward"]
WORTH = 30  # steps of a group of worlds for each thread: for fewer, to wake it takes longer than it saves
PARTS = 8  # for each thread: some worlds take several times as long as others, and no thread shall wait for them


class _Own(local):
    """What belongs to one thread."""

    def __init__(self) -> None:
        self.workspaces: dict[Shape, Tensor] = {}


_OWN = _Own()


def run(
    direction: Direction, shape: Shape, worlds: int, numbers: Mapping[str, int], arrays: Mapping[str, Tensor]
) -> None:
    """Call a kernel on all worlds (see `bind`)."""
    bind(direction, shape, worlds, numbers, arrays, numbers["frames"])(0)


def bind(
    direction: Direction,
    shape: Shape,
    worlds: int,
    numbers: Mapping[str, int],
    arrays: Mapping[str, Tensor],
    frames: int,
) -> Callable[[int], None]:
    """Return what calls a kernel on all worlds and so many frames, from any frame on.

    Args:
        direction: Which.
        shape: What it is compiled for.
        worlds: B.
        numbers: Arguments that are numbers (see `ARGUMENTS`); those not named are 0.
        arrays: Arguments that are arrays, read or written; the caller keeps them alive.
        frames: Frames of a call.
    """
    kernel = _kernel(direction, shape)
    values = dict(numbers) | {name: array.data_ptr() for name, array in arrays.items()}
    arguments = (ctypes.c_int64 * len(ARGUMENTS))(*(values.get(name, 0) for name in ARGUMENTS))
    groups = (worlds + LANES - 1) // LANES
    steps = groups * frames * numbers["substeps"]
    threads = max(min(torch.get_num_threads(), groups, steps // WORTH), 1)
    parts = min(PARTS * threads, groups) if threads > 1 else 1
    bounds = [groups * k // parts for k in range(parts + 1)]

    def work(left: Iterator[int]) -> None:
        for k in left:
            kernel(ctypes.addressof(arguments), bounds[k], bounds[k + 1], _workspace(shape))

    def call(begin: int) -> None:
        arguments[BEGIN], arguments[END] = begin, begin + frames
        left = iter(range(parts))  # shared: whoever is free takes the next part
        others = [_pool(threads).submit(work, left) for _ in range(1, threads)]
        work(left)
        for other in others:
            if not other.cancel():
                other.result()

    return call


@lru_cache
def _kernel(direction: Direction, shape: Shape) -> Kernel:
    traits = [direction, str(shape.bodies)] + ["ground"] * shape.ground + ["split"] * shape.split
    traits += ["midpoint"] * shape.midpoint
    name, write = "_".join(traits), write_forward if direction == "forward" else write_backward
    return load(name, lambda: write(shape, name))


@lru_cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads - 1)


def _workspace(shape: Shape) -> int:
    """Return the address of a workspace that belongs to this thread alone."""
    kept = _OWN.workspaces
    if shape not in kept:
        kept[shape] = torch.zeros(shape.workspace + ALIGNMENT // 8, dtype=torch.float64)
    address = kept[shape].data_ptr()
    return -(-address // ALIGNMENT) * ALIGNMENT
