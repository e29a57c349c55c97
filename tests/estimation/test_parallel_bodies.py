"""Bodies that lie parallel: their headings are one, within noise, and they do not spin."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from physid.estimation.least_squares.initial_states import InitialStates, guess_initial_states
from physid.estimation.least_squares.jacobian import Directions
from physid.estimation.prediction import Segmentation
from physid.physics.rotations import angle_between, exponential, multiply
from physid.scenes import find_setup
from physid.scenes.lying import face_heading, ground_axes

NOISE = 2e-3
FRAMES = 60
STEP = 1 / 60
SCENE = replace(find_setup("collide").scene, time_step=STEP)
UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
HEIGHTS = [body.size[2] / 2 for body in SCENE.bodies]


def watched(headings: Tensor, noise: float = NOISE, seed: int = 0) -> InitialStates:
    """Guess the states of two blocks that lie there with the headings (R, T, 2)."""
    rows, frames, _ = headings.shape
    generator = torch.Generator().manual_seed(seed)
    pose = torch.zeros(rows, frames, 2, 7, dtype=torch.float64)
    pose[..., 2], pose[..., 1, 0] = torch.tensor(HEIGHTS).double(), 0.5
    turn = noise * torch.randn(rows, frames, 2, 3, generator=generator, dtype=torch.float64)
    pose[..., 3:] = multiply(exponential(turn), exponential(headings[..., None] * UP))
    time = (STEP * torch.arange(frames).double()).expand(rows, -1)
    there, segments = torch.ones(rows, frames, 2).double(), Segmentation.equal(rows, frames, frames)
    return guess_initial_states(pose, there, time, segments, SCENE, noise)


def constant(first: float, second: float, rows: int = 1) -> Tensor:
    return torch.tensor([first, second], dtype=torch.float64).expand(rows, FRAMES, 2)


@pytest.mark.parametrize("quarters", [-3, 0, 1, 2])
@pytest.mark.parametrize("heading", [0.0, 0.7, math.pi / 4, 3.0])
def test_blocks_are_parallel_whichever_of_their_upright_faces_look_at_each_other(heading: float, quarters: int) -> None:
    found = watched(constant(heading, heading + quarters * math.pi / 2, rows=100))
    assert float(found.parallel.all(1).double().mean()) >= 0.99


@pytest.mark.parametrize(
    ("apart", "spins"), [(5e-3, (0.0, 0.0)), (-5e-3, (0.0, 0.0)), (0.0, (0.02, 0.02)), (0.0, (0.0, -0.02))]
)
def test_blocks_that_lean_on_no_common_direction_or_turn_by_more_than_noise_tells_are_free(
    apart: float, spins: tuple[float, float]
) -> None:
    time = STEP * torch.arange(FRAMES).double()[:, None]
    headings = constant(0.3, 0.3 + apart, rows=100) + time * torch.tensor(spins).double()
    assert not bool(watched(headings).parallel.any())


def test_a_turn_after_an_impact_is_seen_although_they_were_parallel_before() -> None:
    time = STEP * torch.arange(FRAMES).double()
    headings = constant(0.3, 0.3, rows=100).clone()
    headings[..., 1] += 0.05 * (time - time[FRAMES // 2]).clamp_min(0)
    assert not bool(watched(headings).parallel.any())


def test_a_block_that_leans_is_not_held_although_its_heading_is_parallel() -> None:
    resting = torch.tensor([[True, False], [True, True], [False, True]])
    parallel = torch.ones_like(resting)
    held = Directions.of(UP, resting, None, parallel).parallel
    assert held.all(1).tolist() == [False, True, False]
    assert not held[0].any()


def test_one_block_alone_is_parallel_to_nothing() -> None:
    found = watched(constant(0.3, 1.0))
    assert not bool(found.parallel.any())
    resting = torch.ones(1, 1, dtype=torch.bool)
    assert not Directions.of(UP, resting, None, torch.zeros(1, 1, dtype=torch.bool)).parallel.any()
    assert Directions.of(UP, resting).free[0, 0, [2, 8]].all()


def test_parallel_bodies_turn_together_stay_parallel_and_get_no_spin() -> None:
    found = watched(constant(0.3, 0.3 + math.pi / 2))
    directions = Directions.of(UP, found.resting, found.level, found.parallel)
    assert directions.used == [(0, 2), (0, 3), (0, 4), (0, 9), (0, 10), (1, 3), (1, 4), (1, 9), (1, 10)]
    pose, twist = directions.level(found.pose, found.twist)
    tangents = ground_axes(UP)[:2]
    first, second = face_heading(pose[..., 3:], tangents).unbind(-1)
    assert torch.allclose(first, second, atol=1e-12)
    assert torch.equal(first, face_heading(found.pose[..., 3:], tangents)[..., 0])
    assert not bool(twist[..., :3].any())
    change = torch.zeros(len(pose), 1, len(directions.used), dtype=torch.float64)
    change[..., 0] = 0.1
    moved, still = directions.move(pose, twist, change)
    turned = angle_between(moved[..., 3:], pose[..., 3:])
    assert torch.allclose(turned, torch.full_like(turned, 0.1), atol=1e-9)
    assert torch.equal(still, twist)


def test_the_face_that_looks_along_a_direction_is_the_same_after_quarters_of_a_turn_about_any_axis() -> None:
    tangents = ground_axes(UP)[:2]
    heading = exponential(0.2 * UP)
    for axis in torch.eye(3).double():
        for quarters in range(4):
            other = multiply(heading, exponential(quarters * math.pi / 2 * axis))
            assert float(face_heading(other, tangents)) == pytest.approx(0.2, abs=1e-12)
