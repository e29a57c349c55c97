"""What a step misses of a reversal of friction, how short steps may become, and what the shortest leave."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from physics.worlds import boxes, forces, state
from physid.data.observations.step_grid import StepGrid
from physid.estimation.least_squares.discretisation import (
    Judgement,
    StepChoice,
    choose_steps,
    halve_steps,
    judge_steps,
    parts_for_late_forces,
)
from physid.estimation.least_squares.normal_equations import Linearised, Part
from physid.estimation.measurement.poses import pose_difference
from physid.estimation.prediction.nominal_model import NominalModel
from physid.estimation.prediction.segments import Segmentation
from physid.estimation.prediction.timeline import Timeline
from physid.physics import PhysicsLayer, State, World
from physid.physics.schemes.integration import Midpoint, SemiImplicit
from physid.scenes import find_setup

G, FRICTION, FORCE, MASS = 9.81, 0.2, -4.0, 1.0
FRAME, FRAMES, COUNT = 1 / 30, 10, 200
GOLDEN = (5**0.5 - 1) / 2


def speeds() -> Tensor:
    """Return speeds of blocks that turn around at times spread evenly over two frames, at no regular times [m/s]."""
    share = (GOLDEN * torch.arange(COUNT, dtype=torch.float64)) % 1.0
    return 0.6 + 2 * FRAME * (FRICTION * G - FORCE / MASS) * share


def true_places(time: Tensor) -> Tensor:
    """Return where blocks that a force stops and sends back are at some times (T,), closed form; shape (B, T)."""
    before, after = FORCE / MASS - FRICTION * G, FORCE / MASS + FRICTION * G
    speed = speeds()[:, None]
    turn = -speed / before
    early, late = time.minimum(turn), (time - turn).clamp_min(0)
    return speed * early + 0.5 * before * early**2 + 0.5 * after * late**2


def judgement(noise: float, *, alone: bool = False, made: float | None = None) -> Judgement:
    """Return what steps of these blocks are judged by; the one estimate is the mean shift along the line.

    Below another block, of 1e-5 of its mass, friction does not turn within a step: reversals are of first order. Those
    that a simulator made in known steps are followed by its scheme.
    """
    steps = torch.full((COUNT, FRAMES - 1), FRAME, dtype=torch.float64)
    frames = torch.arange(FRAMES).expand(COUNT, -1)
    push = forces(FRAMES - 1, [[FORCE, 0, 0], [0, 0, 0]][: 1 if alone else 2]).expand(COUNT, -1, -1, -1)
    grid = StepGrid(steps, push, frames, torch.full((COUNT,), FRAMES - 1))
    one = state([[0, 0, 0.1], [0, 0, 0.3]][: 1 if alone else 2])
    twist = torch.zeros(COUNT, one.pose.shape[1], 6, dtype=torch.float64)
    twist[:, 0, 3] = speeds()
    begin = State(one.pose.expand(COUNT, -1, -1), twist)
    layer = PhysicsLayer(World(integration=Midpoint() if made is None else SemiImplicit(made)))

    def predict(timeline: Timeline) -> tuple[Tensor, Tensor]:
        cut = timeline.grid
        masses = boxes(mass=[MASS, 1e-5 * MASS][: one.pose.shape[1]], friction=FRICTION)
        rollout = layer.rollout(begin, cut.wrench, masses, steps=cut.steps)
        chosen = cut.frame_step[..., None, None]
        return tuple(
            values[:, :, :1].gather(1, chosen.expand(-1, -1, 1, values.shape[-1]))
            for values in (rollout.pose, rollout.twist)
        )  # type: ignore[return-value]

    def respond(apart: Tensor) -> Tensor:
        return apart[:, -1, 0, 3].mean()[None] / noise

    every = torch.ones(COUNT, FRAMES - 1, dtype=torch.bool)
    counted = torch.ones(COUNT, FRAMES, 1, dtype=torch.bool)
    spread = torch.tensor([10 * noise] * 3 + [noise] * 3, dtype=torch.float64)
    time = FRAME * frames.double()
    return Judgement(Timeline(time, grid), predict, respond, spread, every, counted, made)


def mean_error(judged: Judgement, parts: int) -> float:
    """Return by how much uniform steps put the blocks too far at the end, on average [m]."""
    pose, _ = judged.predict(judged.base.refined(parts))
    return float((pose[:, -1, 0, 0] - true_places(judged.base.time[0])[:, -1]).mean())


def test_a_reversal_is_missed_in_proportion_to_the_step_and_extrapolation_finds_it() -> None:
    judged = judgement(1e-3)
    errors = {parts: mean_error(judged, parts) for parts in (8, 16, 32)}
    assert errors[8] / errors[16] == pytest.approx(2, rel=0.1)
    assert errors[16] / errors[32] == pytest.approx(2, rel=0.1)
    assert abs(2 * errors[32] - errors[16]) < 0.1 * errors[32]


def test_a_block_alone_turns_around_with_an_error_of_second_order() -> None:
    judged = judgement(1e-3, alone=True)
    errors = {parts: abs(mean_error(judged, parts)) for parts in (1, 2, 4)}
    assert errors[1] < 1e-3
    assert errors[1] / errors[2] > 3
    assert errors[2] / errors[4] > 3
    assert abs(mean_error(judgement(1e-3), 4)) > 15 * errors[4]


@pytest.mark.parametrize("count", [40, 7])
def test_steps_of_a_simulator_are_taken_where_blocks_turn_around_and_longer_ones_elsewhere(count: int) -> None:
    noise = 1e-5
    judged = judgement(noise, alone=True, made=FRAME / count)
    chosen = halve_steps(judged)
    assert int(chosen.parts.max()) == count  # no shorter ones, whatever the number
    assert chosen.mean < count / 3
    assert chosen.left == 0  # those of the simulator are exact
    pose, twist = judged.predict(chosen.timeline)
    exact_pose, exact_twist = judged.predict(judged.base.refined(count))
    assert float((pose - exact_pose)[..., 0].abs().max()) < noise
    assert float((chosen.parts == count).any(1).double().mean()) > 0.7  # some turn around near the end of a step
    # Where nothing turns around, nothing is missed.
    torch.testing.assert_close(twist[:, 1], exact_twist[:, 1], rtol=0, atol=1e-5)


@pytest.mark.parametrize(("bodies", "shortest"), [(1, 2.5e-4), (2, 1e-3)])
@pytest.mark.parametrize("rate", [30, 60, 100, 148, 240])
def test_the_shortest_step_is_a_length_whatever_the_frame_rate(rate: int, bodies: int, shortest: float) -> None:
    grid = judgement(1e-3).base.grid
    grid = dataclasses.replace(grid, steps=torch.full_like(grid.steps, 1 / rate))
    choice = StepChoice()
    length = float((grid.steps / choice.most(grid, bodies)).max())
    assert choice.shortest_among(bodies) == shortest
    assert shortest / math.sqrt(2) <= length <= shortest * math.sqrt(2)
    assert int(StepChoice(shortest=1.0).most(grid, bodies).max()) == 1


@pytest.mark.slow
def test_what_the_shortest_steps_leave_is_what_the_closed_form_says() -> None:
    noise = 1e-4
    judged = judgement(noise)
    choice = StepChoice(shortest=1e-3)
    chosen = halve_steps(judged, choice)
    pose, _ = judged.predict(chosen.timeline)
    true = float((pose[:, -1, 0, 0] - true_places(judged.base.time[0])[:, -1]).mean()) / noise
    assert true > 0.3, "the case must miss something"
    assert chosen.left == pytest.approx(true, rel=0.3, abs=0.1)
    assert chosen.bias < choice.bias
    shorter = halve_steps(judged, StepChoice())
    assert shorter.left < 0.4 * chosen.left


@pytest.mark.parametrize("parts", [1, 4])
def test_where_the_error_falls_with_the_step_half_of_it_is_left_to_the_halves(parts: int) -> None:
    judged, noise = judgement(1e-3), 1e-3
    chosen = judge_steps(judged, torch.full((COUNT, FRAMES - 1), parts), StepChoice(finest=False))
    halved = abs(mean_error(judged, parts) - mean_error(judged, 2 * parts)) / noise
    assert halved > 0.1, "the case must miss something"
    assert chosen.bias == pytest.approx(halved)
    assert chosen.left == pytest.approx(halved), "the halves miss as much again"


@pytest.mark.slow
def test_steps_are_cut_in_halves_as_often_as_they_may_be_and_not_beyond_the_end_of_a_shorter_trajectory() -> None:
    judged, choice, end = judgement(2e-4), StepChoice(finest=False, shortest=FRAME / 8), 5
    asked: set[int] = set()

    def predict(timeline: Timeline) -> tuple[Tensor, Tensor]:
        asked.update((FRAME / timeline.grid.steps[timeline.grid.real]).round().long().unique().tolist())
        return judged.predict(timeline)

    grid = judged.base.grid
    count = torch.where(torch.arange(COUNT) < COUNT // 2, FRAMES - 1, end)
    shorter = dataclasses.replace(grid, count=count, frame_step=grid.frame_step.minimum(count[:, None]))
    base = Timeline(judged.base.time, shorter)
    chosen = halve_steps(dataclasses.replace(judged, base=base, predict=predict), choice)
    assert asked == {1, 2, 4, 8, 16}
    assert int(chosen.parts[:, :end].max()) == 8
    assert bool((chosen.parts[COUNT // 2 :, end:] == 1).all())


@pytest.mark.parametrize("count", [0, 1, 5])
def test_what_halving_changes_of_poses_is_a_mean_of_those_that_count(count: int) -> None:
    judged = judgement(1e-3)
    counted = torch.zeros_like(judged.counted)
    counted[:count, -1] = True
    steps = torch.ones(COUNT, FRAMES - 1, dtype=torch.int64)
    chosen = judge_steps(dataclasses.replace(judged, counted=counted), steps, StepChoice(finest=False))
    once, twice = (judged.predict(judged.base.refined(each))[0] for each in (steps, 2 * steps))
    apart = (once - twice)[:count, -1, 0, :3]
    assert chosen.error[1] == pytest.approx(float((apart.square().sum() / max(3 * count, 1)).sqrt()))
    assert (chosen.error[1] > 0) is bool(count)


def test_steps_count_by_the_standard_errors_by_which_they_move_what_is_fitted() -> None:
    """Steps of length h put poses off by h times some numbers; halving them moves two parameters as a fit to that."""
    noise, step, frames = 1e-3, 1 / 60, 12
    generator = torch.Generator().manual_seed(0)
    off, *slopes = torch.randn(3, frames, generator=generator, dtype=torch.float64)
    segments = Segmentation.equal(1, frames, frames)
    (batch,) = segments.batches
    state, shared = torch.zeros(1, 1, frames, 1, 6, dtype=torch.float64), torch.zeros(2, 1, frames, 1, 6).double()
    state[..., 5], shared[:, 0, :, 0, 3] = 1.0, torch.stack(slopes)
    columns, free = batch.columns(shared / noise), batch.columns(state)
    part = Part(batch, torch.zeros(1, 6 * frames).double(), free, columns, torch.linalg.cholesky(free.mT @ free))

    def at_times(timeline: Timeline) -> Any:
        pose, twist = (torch.zeros(1, 1, frames, 1, size, dtype=torch.float64) for size in (7, 6))
        pose[..., 0], pose[..., 6] = (float(timeline.grid.steps.max()) * off)[:, None], 1.0
        return SimpleNamespace(predict=lambda _: SimpleNamespace(pose=pose, twist=twist))

    predictor = SimpleNamespace(at_times=at_times, segments=segments, model=SimpleNamespace(made_in=None))
    scale, fitted = torch.full((1, frames, 1, 6), 1 / noise, dtype=torch.float64), torch.ones(1, dtype=torch.bool)
    experiment: Any = SimpleNamespace(predictor=predictor, scale=scale, fitted=fitted)
    fit: Any = SimpleNamespace(point=SimpleNamespace(nominal=torch.zeros(1, 2)), linear=Linearised(segments, (part,)))
    base = Timeline.regular(forces(frames, [[0, 0, 0]]), step)
    chosen = choose_steps(experiment, fit, base, StepChoice(finest=False, defect=1e9, bias=1e9))
    design = torch.stack(slopes, 1) / noise
    moved = torch.linalg.lstsq(design, step / 2 * off[:, None] / noise).solution[:, 0]
    errors = torch.linalg.inv(design.T @ design).diagonal().sqrt()
    assert chosen.bias == pytest.approx(float((moved / errors).abs().max()))
    assert chosen.bias > 0.1, "the case must move something"


@pytest.mark.parametrize("force", [0.5, 6.0, 40.0])
@pytest.mark.parametrize("defect", [0.03, 0.1])
def test_steps_after_a_change_of_the_force_are_as_long_as_forces_allow_that_come_a_tenth_of_a_second_late(
    force: float, defect: float
) -> None:
    step, noise, change, count = 1 / 60, 1e-3, 10, 30
    choice, scene = StepChoice(defect=defect), find_setup("push").scene
    (block,) = scene.bodies
    wrench = torch.zeros(1, count + 1, 1, 6, dtype=torch.float64)
    wrench[:, change:, 0, 3] = force
    base = Timeline.regular(wrench, step)
    scale = torch.full((1, count + 1, 1, 6), 1 / noise, dtype=torch.float64)
    experiment: Any = SimpleNamespace(predictor=SimpleNamespace(model=NominalModel(scene)), scale=scale)

    def off(parts: int) -> float:  # F h^2 / (8 m), and that of a block which sets off within a step
        held, part = min(force / block.mass, block.friction * G), step / parts
        return (force / block.mass * part**2 / 8 + held * part / 4 * choice.reach) / noise

    least = next(2**power for power in range(20) if off(2**power) <= defect)
    late = torch.arange(count, dtype=torch.float64) - change
    inside = (late >= 0) & (late * step <= choice.late + 1e-9)
    expected = torch.where(inside, min(least, int(choice.most(base.grid, 1).max())), 1)
    assert least > 1, "the case must ask for something"
    rest = torch.zeros(1, count + 1, 1, 6, dtype=torch.float64)
    assert parts_for_late_forces(experiment, base, choice, rest, scene).tolist() == [expected.tolist()]
    for none in (choice.model_copy(update={"late": 0.0}), choice.model_copy(update={"defect": 1e9})):
        assert bool((parts_for_late_forces(experiment, base, none, rest, scene) == 1).all())
    steady = Timeline.regular(torch.full_like(wrench, force), step)
    assert bool((parts_for_late_forces(experiment, steady, choice, rest, scene) == 1).all())

    def moved(parts: int) -> float:  # of a body that does not set off, because it slides all the time
        return force / block.mass * (step / parts) ** 2 / 8 / noise

    sliding = rest.clone()
    sliding[..., 3] = 1.0
    enough = min(
        next(2**power for power in range(20) if moved(2**power) <= defect), int(choice.most(base.grid, 1).max())
    )
    found = parts_for_late_forces(experiment, base, choice, sliding, scene)
    assert found.tolist() == [torch.where(inside, enough, 1).tolist()]
    for moment in (change - 3, change + 3):
        still, back = sliding.clone(), sliding.clone()
        still[:, moment, :, 3], back[:, moment:, :, 3] = 0.0, -1.0
        for twist in (still, back):
            assert parts_for_late_forces(experiment, base, choice, twist, scene).tolist() == [expected.tolist()]
    far = sliding.clone()
    far[:, -1, :, 3] = 0.0
    assert torch.equal(parts_for_late_forces(experiment, base, choice, far, scene), found), (
        "it rests long after the change"
    )


@pytest.mark.slow
def test_steps_are_short_only_where_blocks_turn_around() -> None:
    judged = judgement(5e-5)
    chosen = halve_steps(judged, StepChoice())
    turn = speeds() / (FRICTION * G - FORCE / MASS)
    own = (turn / FRAME).floor().long()[:, None]
    frames = torch.arange(FRAMES - 1)
    assert bool((chosen.parts[(frames - own).abs() > 1] == 1).all())
    assert float(chosen.parts.gather(1, own).double().median()) >= 32
    assert chosen.mean < 0.3 * chosen.largest
    again = judge_steps(judged, chosen.parts, StepChoice())
    assert again.bias == chosen.bias
    coarse, fine = (judged.predict(judged.base.refined(parts))[0] for parts in (1, 64))
    assert float(pose_difference(coarse, fine).abs().max()) > 1e-3
