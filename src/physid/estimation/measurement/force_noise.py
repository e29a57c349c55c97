"""How noisy recorded forces are, and what that does to the motion of a body: a random walk of its velocity."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from physid.data.observations.step_grid import StepGrid
from physid.estimation.measurement.deviation import deviation
from physid.estimation.measurement.noise_settings import DEFAULT, NoiseSettings

BLOCKS = (2, 4)  # rows whose means are compared with those of their neighbours; noise is that of the longer ones
KINDS = (slice(0, 3), slice(3, 6))  # torque, force
CUBIC = (-1.0, 3.0, -3.0, 1.0)  # a third difference: of a smooth force next to nothing


def force_noise(grid: StepGrid, settings: NoiseSettings = DEFAULT) -> Tensor:
    """Estimate the spectral density q of white noise in recorded forces, shape (N, 6) [(N m)^2 s, N^2 s].

    Rows with a standard deviation s, each held for a time h, change a momentum in a time t by sqrt(q t), q = s^2 h.
    Means of a few rows are compared by third differences (Rice 1984), once with few and once with twice as many: white
    noise has the same q by both, a force that changes steadily far more by the longer ones. Commands have none: what
    changes by more than a small share of the forces themselves from row to row is commanded.

    Args:
        grid: Steps, and what was recorded to act in them; a row goes on until something changes.
        settings: The largest share, and by how much both estimates may differ.

    Returns:
        q; zero where rows are few, smooth or commanded.
    """
    bodies = grid.wrench.shape[2]
    density, found = torch.zeros(bodies, 6, dtype=torch.float64), list[Tensor]()
    rows = [_rows(grid, trajectory, settings) for trajectory in range(len(grid.count))]
    held = torch.cat([length for _, length in rows]).median()
    for size in BLOCKS:
        bent = torch.cat([_bent(values, size) for values, _ in rows])
        if len(bent) < settings.windows:
            return density
        found.append(size * held * deviation_of_each(bent).square())
    real = grid.wrench[grid.real]
    for kind in KINDS:
        short, long = (one[:, kind].amax() for one in found)
        usual = real[..., kind].square().sum(-1).mean().sqrt()
        if long <= settings.force_white * short and (long / held).sqrt() <= settings.force_share * usual:
            density[:, kind] = found[1][:, kind]
    return density


def with_force_noise(grid: StepGrid, density: Tensor, generator: torch.Generator) -> StepGrid:
    """Return the steps with other forces, as recorded ones with such noise leave them open: q over each step's length.

    Args:
        grid: Steps.
        density: q, shape (N, 6), see `force_noise`.
        generator: Source of randomness, of which nothing is taken where there is no noise.
    """
    if not bool(density.any()):
        return grid
    drawn = torch.randn(grid.wrench.shape, generator=generator, dtype=torch.float64)
    return replace(grid, wrench=grid.wrench + drawn * (density / grid.steps[..., None, None]).sqrt())


def deviation_of_each(values: Tensor) -> Tensor:
    """Return the standard deviation of each column of absolute values (n, N, 6), shape (N, 6); zero for zeros."""
    columns = values.flatten(1).T
    found = torch.stack([deviation(one) if bool(one.median() > 0) else one.new_zeros(()) for one in columns])
    return found.reshape(values.shape[1:])


def _rows(grid: StepGrid, trajectory: int, settings: NoiseSettings) -> tuple[Tensor, Tensor]:
    """Return the rows (K, N, 6) of a trajectory, and how long each is held [s], (K,)."""
    count = int(grid.count[trajectory])
    wrench, steps = grid.wrench[trajectory, :count], grid.steps[trajectory, :count]
    begins = torch.ones(count, dtype=torch.bool)
    begins[1:] = (wrench[1:] != wrench[:-1]).flatten(1).any(1)
    held = torch.zeros(int(begins.sum()), dtype=steps.dtype).index_add_(0, begins.cumsum(0) - 1, steps)
    return _whole_lines(wrench[begins], held, settings)


def _whole_lines(rows: Tensor, held: Tensor, settings: NoiseSettings) -> tuple[Tensor, Tensor]:
    """Return the means of lines (J, N, 6) that rows (K, N, 6) are parts of, and how long each lasts, (J,).

    Forces that go along lines from one sample of a sensor to the next are held in equal parts of each line. Between
    parts of one line they change by the same, and from the last part of one to the first of the next by the mean of
    what they change by in both, so that there the third difference of four parts is zero, and the second is not.
    Where few rows end so, they are no parts of lines, and returned as they are.
    """
    if len(rows) < len(CUBIC):
        return rows, held
    second, third = (rows.diff(n=order, dim=0).abs().flatten(1).amax(1) for order in (2, 3))
    rounding = math.sqrt(torch.finfo(rows.dtype).eps) * rows.abs().amax()
    ends = (third <= settings.line_equal * second[:-1]) & (second[:-1] > rounding)
    if int(ends.sum()) * settings.line_parts < len(rows):
        return rows, held
    begins = torch.nn.functional.pad(ends, (2, 1)).long().cumsum(0)
    length = torch.zeros(int(begins[-1]) + 1, dtype=held.dtype).index_add_(0, begins, held)
    total = torch.zeros(len(length), *rows.shape[1:], dtype=rows.dtype).index_add_(
        0, begins, rows * held[:, None, None]
    )
    return total / length[:, None, None], length


def _bent(rows: Tensor, size: int) -> Tensor:
    """Return |third differences| of the means of so many rows, in units of one mean's deviation, shape (n, N, 6)."""
    blocks = rows[: len(rows) // size * size].unflatten(0, (-1, size)).mean(1) if len(rows) >= size else rows[:0]
    if len(blocks) < len(CUBIC):
        return blocks[:0]
    weights = torch.tensor(CUBIC, dtype=rows.dtype)
    bent: Tensor = (blocks.unfold(0, len(CUBIC), 1) @ (weights / weights.norm())).abs()
    return bent
