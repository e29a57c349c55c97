"""The noise of recorded forces: found where a sensor made it, and nowhere else."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch

from physid.data.importers.reading_logs import along_lines
from physid.data.observations.step_grid import StepGrid
from physid.estimation.measurement import force_noise, with_force_noise
from physid.inspection.rules.fitted import noisy_forces
from physid.scenes.setups.forces import pieces, redrawn

RATE, ROWS, SET = 500, 1000, 6  # rows a second, rows, trajectories


def grid_of(force: np.ndarray, rate: float = RATE, parts: int = 1) -> StepGrid:
    """Return steps of one body under forces (R, S, 3), each row cut into parts."""
    wrench = np.concatenate([np.zeros_like(force), force], -1)[:, :, None].repeat(parts, 1)
    rows, steps = wrench.shape[:2]
    frames = torch.arange(0, steps + 1, 10).expand(rows, -1)
    lengths = torch.full((rows, steps), 1 / rate / parts, dtype=torch.float64)
    return StepGrid(lengths, torch.from_numpy(wrench), frames, torch.full((rows,), steps))


def commanded(seed: int = 0) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return np.stack([pieces(generator, np.eye(3)[:2], ROWS) for _ in range(SET)])


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("lines", [False, True])
@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_the_noise_of_a_sensor_is_found_whether_rows_are_held_or_go_along_lines(
    noise: float, lines: bool, parts: int
) -> None:
    force = commanded() + noise * np.random.default_rng(1).standard_normal((SET, ROWS, 3))
    if lines:
        time = np.arange(ROWS) / RATE
        force = np.stack([along_lines(time, each[:, None].repeat(2, -1), 1 / 60)[1][:, 0, :3] for each in force])
    found = force_noise(grid_of(force, parts=parts))
    assert not found[0, :3].any(), "no torque acts"
    assert found[0, 3:].tolist() == pytest.approx([noise**2 / RATE] * 3, rel=0.35)


@pytest.mark.parametrize("digits", [12, 5])
@pytest.mark.parametrize("rate", [60, 100, 200, 250, 400, 1000])
def test_the_noise_along_lines_is_found_at_any_rate_of_the_sensor(rate: int, digits: int) -> None:
    force = commanded() + 0.02 * np.random.default_rng(1).standard_normal((SET, ROWS, 3))
    time, frame = (np.arange(ROWS) / rate).round(digits), 1 / 60
    stamps, _ = along_lines(time, force[0][:, None].repeat(2, -1), frame)
    lines = np.stack([along_lines(time, each[:, None].repeat(2, -1), frame)[1][:, 0, :3] for each in force])
    grid = grid_of(lines[:, :-1], 1 / float(np.diff(stamps).mean()))
    grid = dataclasses.replace(grid, steps=torch.from_numpy(np.diff(stamps)).expand(SET, -1).contiguous())
    assert force_noise(grid)[0, 3:].tolist() == pytest.approx([0.02**2 / rate] * 3, rel=0.35)


def test_commands_have_no_noise_however_often_or_steadily_they_change() -> None:
    time, generator = np.arange(ROWS) / RATE, np.random.default_rng(2)
    swings = np.stack([np.stack([math.pi * np.sin(k * time + k), np.cos(5 * time), 0 * time], -1) for k in range(3, 9)])
    anew = np.stack([redrawn(generator, np.array([1.0, 0.0, 0.0]), ROWS) for _ in range(SET)])
    rounded = commanded() + swings.round(3)
    lines = np.stack([along_lines(time, each[:, None].repeat(2, -1), 1 / 60)[1][:, 0, :3] for each in commanded()])
    for force in (commanded(), swings, anew, rounded, 0 * anew, lines):
        for rate in (60, RATE):
            assert float(force_noise(grid_of(force, rate)).max()) <= 1e-6 / rate, "but for what rounding does"


def test_few_rows_say_nothing() -> None:
    force = commanded()[:1, :60] + 0.02 * np.random.default_rng(1).standard_normal((1, 60, 3))
    assert not force_noise(grid_of(force)).any()


@pytest.mark.parametrize("parts", [1, 4])
def test_drawn_noise_changes_a_momentum_by_a_random_walk_however_long_steps_are(parts: int) -> None:
    """After t its variance is q t."""
    grid, density = grid_of(np.zeros((400, 250, 3)), parts=parts), torch.zeros(1, 6).double()
    density[0, 3:] = torch.tensor([1e-6, 4e-6, 0.0])
    drawn = with_force_noise(grid, density, torch.Generator().manual_seed(0))
    momentum = (drawn.wrench * drawn.steps[..., None, None]).sum(1)[:, 0]
    seconds = 250 / RATE
    assert momentum[:, 3:].var(0).tolist() == pytest.approx([1e-6 * seconds, 4e-6 * seconds, 0.0], rel=0.2)
    assert not momentum[:, :3].any()


def test_without_noise_nothing_is_drawn() -> None:
    generator = torch.Generator().manual_seed(0)
    before, grid = generator.get_state(), grid_of(commanded())
    assert with_force_noise(grid, torch.zeros(1, 6).double(), generator) is grid
    assert torch.equal(generator.get_state(), before)


def test_how_far_noisy_forces_move_a_body_is_that_of_a_walk_of_its_velocity() -> None:
    density = torch.zeros(2, 6).double()
    density[0, 3], density[1, 4] = 3e-6, 3e-6
    assert "by 2 mm in a second" in noisy_forces(density, [1.0, 0.5]).what
    generator, steps = torch.Generator().manual_seed(0), 400
    grid = with_force_noise(grid_of(np.zeros((2000, steps, 3)), rate=steps), density[1:], generator)
    velocity = (grid.wrench * grid.steps[..., None, None]).cumsum(1)[:, :, 0, 4] / 0.5
    assert float((velocity * grid.steps).sum(1).std()) == pytest.approx(2e-3, rel=0.05)
