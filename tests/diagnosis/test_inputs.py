"""What a diagnosis takes in, and its references: models, events, jolts and replays on both sides of each condition."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from estimation.flights import FORCE, MASS, G, flights
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.reference.replay import Reference, references_of, replay
from physid.diagnosis.settings.reference import ReplaySettings
from physid.diagnosis.testing.score_test import Group, condition, joined
from physid.effects import from_values
from physid.estimation.least_squares import Normal
from physid.estimation.measurement import Noise
from physid.estimation.prediction import NominalModel, Segmentation, Timeline, Variants
from physid.estimation.segmented_fit import EventSettings
from physid.estimation.segmented_fit.events import find_events, find_jolts, smooth_path
from physid.estimation.segmented_fit.motion_phases import PHASES
from physid.physics.rotations import exponential
from physid.scenes import find_setup

PUSH, TOSS = find_setup("push").scene, find_setup("toss").scene
FALLS = PHASES.index("free_fall")
FINE = Reference("pybullet", 1e-3, staggered=True)


def test_a_model_that_is_not_said_is_the_scene_and_one_that_is_has_its_values_and_unknowns() -> None:
    assert read_nominal_model(PUSH, None) == NominalModel(PUSH)
    engine = {"substeps": 2, "effects": {"viscous_drag": {"coefficient": 0.1}}}
    learned = ["block.friction", "constant_force.x"]
    given: dict[str, Any] = {"learn": learned, "values": {"block.mass": 2.0, "constant_force.x": 0.7}, "engine": engine}
    model = read_nominal_model(PUSH, {"model": given})
    assert (model.scene.unknown, model.sizes, model.substeps) == (("block.friction",), ("constant_force.x",), 2)
    assert (model.scene.bodies[0].mass, model.scene.bodies[0].friction) == (2.0, PUSH.bodies[0].friction)
    assert {one.name: {k: float(v) for k, v in one.values().items()} for one in model.effects} == {
        "viscous_drag": {"coefficient": 0.1},
        "constant_force": {"x": 0.7, "y": 0.0},
    }
    known = replace(PUSH, unknown=("block.mass",))
    assert read_nominal_model(known, {}).scene.unknown == ("block.mass",)
    assert read_nominal_model(known, {"model": {"learn": []}}).scene.unknown == ()
    nested = {"model": {"class_path": "physid.X", "init_args": {"learn": ("block.mass",), "engine": {"init_args": {
        "substeps": 3}}}}}  # fmt: skip
    assert (read_nominal_model(PUSH, nested).unknown, read_nominal_model(PUSH, nested).substeps) == (("block.mass",), 3)


@pytest.mark.parametrize(
    ("model", "said"),
    [
        ({"learn": ["block.mass", 3]}, "model.learn: expected parameters"),
        ({"learn": {"block.mass": 1}}, "model.learn: expected parameters"),
        ({"learn": "block.mass"}, "model.learn: expected parameters"),
        ({"values": [1]}, "model.values: expected a mapping"),
        ({"engine": {"substeps": 0}}, "model.engine.substeps"),
        ({"engine": {"effects": 3}}, "model.engine.effects: expected a mapping"),
        ({"values": {"block.mass": True}}, "model.values.block.mass"),
        ({"learn": ["viscous_drag.speed"]}, "unknown parameter"),
    ],
)
def test_a_model_of_another_kind_is_refused_by_its_key(model: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        read_nominal_model(PUSH, {"model": model})


@pytest.mark.parametrize("bodies", [1, 2])
def test_an_event_of_one_body_is_one_of_the_frame_and_edges_touch_from_a_lean_on(bodies: int) -> None:
    settings, noise = EventSettings(), Noise(1e-3, 1e-3)
    pose = torch.zeros(2, 30, bodies, 7).double()
    pose[..., 6] = 1.0
    time, smooth = (torch.arange(30).double() / 60).expand(2, -1), torch.zeros(2, 30, bodies, 6).double()
    phases = torch.full((2, 30, bodies), PHASES.index("coast"))

    def found(attitude: Tensor, phase: str) -> list[list[int]]:
        one, kinds = pose.clone(), phases.clone()
        one[1, :, -1, 3:], kinds[1, :, -1] = attitude, FALLS
        kinds[1, 7, -1] = PHASES.index(phase)
        events = find_events(kinds, one, torch.ones(2, 30, bodies), time, smooth, noise, PUSH, settings)
        return events.nonzero().tolist()

    flat, lean = (exponential(torch.tensor([0.0, factor * settings.tilted, 0.0]).double()) for factor in (0.9, 1.1))
    side = exponential(torch.tensor([torch.pi / 2, 0.0, 0.0]).double())
    for attitude, phase in ((flat, "coast"), (side, "coast"), (lean, "free_fall")):
        assert found(attitude, phase) == []
    for attitude, phase in ((lean, "coast"), (flat, "impact"), (flat, "contact_between_objects")):
        assert found(attitude, phase) == [[1, 7]], phase


def test_a_jolt_needs_frames_enough_on_both_sides_and_turns_jolt_as_well_as_speeds() -> None:
    settings, noise = EventSettings(reach=0.05), Noise(1e-9, 1e-9)
    time = (torch.arange(20).double() / 60)[None]
    late = (torch.arange(20).double() - 9.5).clamp_min(0) / 60
    for kind, least in ((0, settings.jolt_spin), (3, settings.jolt_speed)):
        for factor, jolted in ((0.95, False), (1.1, True)):
            path = torch.zeros(1, 20, 1, 6).double()
            path[0, :, 0, kind + 1] = factor * least * late
            pose = torch.cat([path[..., 3:], exponential(path[..., :3])], -1)
            arguments = (torch.ones(1, 20, 1), time, 0 * path, noise, 1 / 60, settings)
            found = find_jolts(pose, *arguments)[0, :, 0]
            assert found.nonzero()[:, 0].tolist() == ([10] if jolted else [])
            assert not find_jolts(pose, arguments[0], time, path, *arguments[3:]).any(), (
                "what the model moves is taken off"
            )
            short = find_jolts(pose[:, 7:12], arguments[0][:, 7:12], time[:, 7:12], 0 * path[:, 7:12], *arguments[3:])
            assert not short.any(), "three frames on either side are more than five"
            six = find_jolts(pose[:, 7:13], arguments[0][:, 7:13], time[:, 7:13], 0 * path[:, 7:13], *arguments[3:])
            assert six[0, :, 0].nonzero()[:, 0].tolist() == ([3] if jolted else [])


def test_a_smooth_path_is_the_second_integral_of_accelerations_that_are_known() -> None:
    time = torch.tensor([[0.0, 0.1, 0.3, 0.6, 1.0]]).double()
    twist = torch.zeros(1, 5, 1, 6).double()
    twist[0, :, 0, 3] = 2.0 * time[0]
    phases = torch.full((1, 5, 1), FALLS)
    whole = Segmentation.equal(1, 5, 5)
    path = smooth_path(twist, phases, time, whole)
    assert path[0, :, 0, 3].tolist() == pytest.approx(time[0].square().tolist())
    assert not path[..., [0, 1, 2, 4, 5]].any()
    hit, jumped = phases.clone(), twist.clone()
    hit[0, 0], jumped[0, 1:, 0, 3] = PHASES.index("impact"), twist[0, 1:, 0, 3] + 9.0
    assert torch.allclose(smooth_path(jumped, hit, time, whole), path), "the first step goes on as the second"
    hit[0, 0], hit[0, 3], jumped = FALLS, PHASES.index("contact_between_objects"), twist.clone()
    jumped[0, 4, 0, 3] = -9.0
    assert torch.allclose(smooth_path(jumped, hit, time, whole), path), "the last as the one before"


def flown(
    names: dict[str, dict[str, float]], reference: Reference = FINE, chosen: Tensor | None = None
) -> tuple[Any, Tensor]:
    """Replay flights of two segments each under effects; returns them and the poses."""
    made = flights(trajectories=2, sizes=(0.0, 0.0))
    predictor = made.experiment.predictor
    effects = [from_values(name, values) for name, values in names.items()]
    seen = replay(
        predictor.model,
        predictor.timeline,
        predictor.segments,
        made.start,
        ReplaySettings(),
        effects,
        chosen,
        reference,
    )
    return made, seen


@pytest.mark.parametrize("reference", [FINE, Reference("mujoco", 2e-3)])
def test_replays_fly_each_chosen_segment_from_its_own_state_under_the_effects_that_are_given(
    reference: Reference,
) -> None:
    pytest.importorskip(reference.name)
    chosen = torch.tensor([False, True, True, False])
    made, seen = flown(
        {"constant_force": {"x": FORCE[0], "y": FORCE[1]}, "camera_offset": {"z": 0.25}}, reference, chosen
    )
    since = torch.arange(12).double()[:, None] / 60
    pull = torch.tensor([*FORCE, -G * MASS]).double() / MASS
    for row, first, segment in ((0, 12, 1), (1, 0, 2)):
        state = made.start.pose[0, segment, 0, :3], made.start.twist[0, segment, 0, 3:]
        expected = state[0] + state[1] * since + pull * since**2 / 2 + torch.tensor([0, 0, 0.25])
        assert torch.allclose(seen[row, first : first + 12, 0, :3], expected, atol=3e-4)
    assert not seen[0, :12, 0, :2].any()
    assert not seen[1, 12:, 0, :2].any()


@pytest.mark.parametrize("change", [0.1, -0.1])
def test_a_camera_whose_clock_runs_fast_takes_a_replay_at_its_own_times(change: float) -> None:
    made, seen = flown({"clock_rate": {"change": change}})
    predictor = made.experiment.predictor
    taken = from_values("clock_rate", {"change": change}).elapse(predictor.timeline.time)
    since = (taken - taken.gather(1, predictor.segments.spread(predictor.segments.start)))[..., None]
    owner = predictor.segments.spread(torch.arange(4))
    place, speed = made.start.pose[0, owner, 0, :3], made.start.twist[0, owner, 0, 3:]
    expected = place + speed * since - torch.tensor([0, 0, G]).double() * since**2 / 2
    assert torch.allclose(seen[..., 0, :3], expected, atol=3e-4)


def test_commands_push_in_a_replay_when_they_are_given() -> None:
    wrench = torch.zeros(1, 13, 1, 6).double()
    force = 6.0 * torch.randn(13, generator=torch.Generator().manual_seed(0)).double()
    wrench[0, :, 0, 3] = force
    speed = torch.cat([torch.zeros(1).double(), force[:-1].cumsum(0) / 60 / MASS])
    way = torch.cat([torch.zeros(1).double(), ((speed[1:] + speed[:-1]) / 2 / 60).cumsum(0)])
    timeline = Timeline.regular(wrench, 1 / 60)
    model, segments = NominalModel(replace(TOSS, time_step=1 / 60)), Segmentation.equal(1, 13, 13)
    pose, twist = torch.zeros(1, 1, 1, 7).double(), torch.zeros(1, 1, 1, 6).double()
    pose[..., 2], pose[..., 6] = 9.0, 1.0
    point = Variants.of_states(pose, twist, model.guess[None], torch.zeros(1, 0).double())
    for gain in (0.0, 0.5):
        effects = [from_values("force_gain", {"gain": gain})]
        # A change of the force by dF within a step h moves positions by dF h t / (2 m) all the same.
        tiny = Reference("pybullet", 1e-4, staggered=True)
        seen = replay(model, timeline, segments, point, ReplaySettings(), effects, None, tiny)
        assert torch.allclose(seen[0, :, 0, 0], (1 + gain) * way, atol=2e-4)


def test_references_are_those_that_are_there_with_steps_that_divide_a_frame() -> None:
    settings, scene = ReplaySettings(pybullet_step=1e-3, mujoco_step=2e-3), replace(TOSS, integration=None)
    found = references_of(scene, settings)
    assert found[0].name == "pybullet"
    assert [one.staggered for one in found] == [one.name == "pybullet" for one in found]
    for one in found:
        longest = {"pybullet": 1e-3, "mujoco": 2e-3}[one.name]
        count = scene.time_step / one.step
        assert count == pytest.approx(round(count))
        assert one.step <= longest < scene.time_step / (round(count) - 1)
    exact = references_of(replace(scene, time_step=4e-3), settings)
    assert exact[0].step == pytest.approx(1e-3)


@pytest.mark.parametrize("height", [0.0, 1.0])
def test_what_hits_in_its_first_step_is_not_thrown_by_that_hit(height: float) -> None:
    """Half a step earlier it fell at the speed that it has, but for gravity: a bounce is no acceleration."""
    scene = replace(TOSS, time_step=1 / 60, bodies=(replace(TOSS.bodies[0], restitution=0.0),))
    frames, speed = 4, -2.0
    timeline, segments = (
        Timeline.regular(torch.zeros(1, frames, 1, 6).double(), 1 / 60),
        Segmentation.equal(1, frames, frames),
    )
    model = NominalModel(scene)
    pose, twist = torch.zeros(1, 1, 1, 7).double(), torch.zeros(1, 1, 1, 6).double()
    half = scene.bodies[0].size[2] / 2
    pose[..., 2], pose[..., 6], twist[..., 5] = half + height, 1.0, speed
    point = Variants.of_states(pose, twist, model.guess[None], torch.zeros(1, 0).double())
    step = Reference("pybullet", 1 / 240, staggered=True)
    found = replay(model, timeline, segments, point, ReplaySettings(), (), None, step)[0, :, 0, 2]
    time = timeline.time[0]
    flight = half + height + speed * time - G * time**2 / 2
    expected = flight if height else torch.full_like(time, half)
    assert torch.allclose(found, expected, atol=3e-3)


def test_a_nuisance_is_held_by_its_prior_as_a_ridge_would() -> None:
    generator = torch.Generator().manual_seed(0)
    columns, data = torch.randn(30, 3, generator=generator).double(), torch.randn(30, generator=generator).double()
    ridge = torch.tensor([5.0, 40.0]).double()
    normal = Normal((columns.T @ columns)[None], (columns.T @ data)[None], data.square().sum()[None])
    given = condition(normal, torch.tensor([0, 1]), ridge)
    rows = torch.cat([columns[:, :2], torch.diag(ridge.sqrt())])

    def held(value: Tensor) -> Tensor:
        return torch.linalg.lstsq(rows, torch.cat([value, torch.zeros(2).double()])[:, None]).solution[:, 0]

    own = columns[:, 2]
    assert torch.allclose(given.absorbed[:, 2], held(own))
    assert torch.allclose(given.solved[:, 0], held(data))
    assert float(given.matrix[2, 2]) == pytest.approx(float(own @ (own - columns[:, :2] @ held(own))))
    assert float(given.vector[2, 0]) == pytest.approx(float(own @ (data - columns[:, :2] @ held(data))))


def test_groups_are_joined_in_their_order_and_without_ranges_anything_is_admitted() -> None:
    one, two = (
        Group((name,), torch.tensor([k]), *(torch.tensor([k + size]).double() for size in (0.1, 0.2, -3.0, 4.0)))
        for k, name in enumerate("ab")
    )
    both = joined([two, one])
    assert both.names == ("b", "a")
    expected = {
        "columns": [1, 0],
        "typical": [1.1, 0.1],
        "largest": [1.2, 0.2],
        "low": [-2.0, -3.0],
        "high": [5.0, 4.0],
    }
    for name, values in expected.items():
        assert getattr(both, name).tolist() == pytest.approx(values), name
    assert (both.unbounded().low.tolist(), both.unbounded().high.tolist()) == ([-np.inf] * 2, [np.inf] * 2)
    assert both.unbounded().typical is both.typical
