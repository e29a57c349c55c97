"""Many variants at once: each is predicted as it is alone, at its own times, and no more at once than memory allows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from estimation.flights import G, flights
from physid.effects import find, from_values
from physid.estimation.prediction import NominalModel, Predictor, Segmentation, Timeline, Variants
from physid.physics import PhysicsLayer, Rollout, State
from physid.scenes import find_setup
from physid.scenes.lying import lay_down

STEP, FRAMES = 1 / 60, 16
PUSH = replace(find_setup("push").scene, time_step=STEP, unknown=("block.friction",))
KINDS = ("clock_rate", "force_delay", "camera_offset", "viscous_drag", "friction_drift", "object_size")


def lying(rows: int = 2, gravity: tuple[float, float, float] = (0.0, 0.0, -G), **changes: Any) -> Predictor:
    """Return a predictor of blocks, two segments to each trajectory, that forces of all signs push to and fro."""
    generator = torch.Generator().manual_seed(1)
    wrench = torch.zeros(rows, FRAMES, 1, 6).double()
    wrench[..., 3:5] = 9 * torch.randn(rows, FRAMES, 1, 2, generator=generator).double()
    timeline = Timeline.regular(wrench, STEP)
    timeline = replace(timeline, time=timeline.time + torch.arange(rows)[:, None])  # each on a clock of its own
    segments = Segmentation.equal(rows, FRAMES, FRAMES // 2)
    lies = (torch.arange(2 * rows) % 3 > 0)[:, None]
    kinds = [find(kind) for kind in changes.pop("kinds", KINDS)]
    return Predictor(
        NominalModel(replace(PUSH, gravity=gravity)), timeline, replace(segments, lying=lies), kinds, **changes
    )


def variants(predictor: Predictor, count: int) -> Variants:
    """Return variants that differ in all that they may differ in."""
    generator = torch.Generator().manual_seed(2)
    segments = len(predictor.segments)
    pose, twist = torch.zeros(1, segments, 1, 7).double(), torch.zeros(1, segments, 1, 6).double()
    pose[..., 0, 0], pose[..., 6] = torch.arange(segments).double(), 1.0
    pose[0] = lay_down(pose[0], predictor.model.scene).pose
    many = Variants.of_states(pose, twist, predictor.model.guess[None], predictor.null[None]).repeat(count)

    def drawn(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator).double()

    many.twist[..., 3:5] = 0.5 * drawn(count, segments, 1, 2)
    many.pose[..., :2] += 0.1 * drawn(count, segments, 1, 2)
    many.nominal[:] += 0.3 * drawn(count, 1)
    typical = torch.tensor([term.quantity.typical for term in predictor.terms]).double()
    on = torch.rand(many.effects.shape, generator=generator) < 0.6
    many.effects[:] = torch.where(on, typical * torch.rand(many.effects.shape, generator=generator), many.effects)
    force = torch.zeros(count, predictor.segments.trajectories, FRAMES, 1, 6).double()
    force[..., 3] = drawn(count, predictor.segments.trajectories, FRAMES, 1)
    return many.replace(force=force)


def test_each_variant_is_predicted_as_it_is_alone_whatever_is_at_work_in_the_others() -> None:
    predictor = lying()
    many = variants(predictor, 5)
    found = predictor.predict(many)
    for k in range(5):
        alone = predictor.predict(many[k : k + 1])
        for name in vars(found):
            assert torch.allclose(getattr(found, name)[k], getattr(alone, name)[0], rtol=1e-6, atol=1e-8), name
    spread = found.pose[..., :2].std(0)
    assert float(spread.min()) > 1e-3, "they do differ"


def test_bodies_begin_as_high_as_their_size_lets_them_lie_and_where_none_changes_a_size_as_they_are_given() -> None:
    predictor = lying(kinds=("object_size", "viscous_drag"))
    many = variants(predictor, 3)
    many.effects[:] = torch.tensor([[0.04, 0.0], [0.0, 0.2], [-0.02, 0.1]]).double()
    begun = predictor.begun(many)
    lies = predictor.segments.lying
    assert lies is not None
    higher = (begun.pose - many.pose)[..., 0, :]
    expected = many.effects[:, :1] * PUSH.bodies[0].size[2] / 2 * lies[:, 0]
    assert torch.allclose(higher[..., 2], expected, atol=1e-12)
    assert not bool(higher[..., [0, 1, 3, 4, 5, 6]].any())
    assert predictor.begun(many.replace(effects=torch.zeros(3, 2).double())).pose is many.pose
    assert predictor.of_lying(None).begun(many) is many


def test_effects_that_know_the_time_see_the_same_one_through_a_clock_that_is_off_by_nothing() -> None:
    """Friction drifts with the time since the recording began, wherever a segment begins."""
    predictor = lying(kinds=("clock_rate", "friction_drift"))
    many = variants(predictor, 4)
    many.effects[:] = torch.tensor([[0.0, 0.4], [1e-13, 0.4], [0.0, 0.0], [1e-13, 0.0]]).double()
    many = many[:1].replace(force=None).repeat(4).replace(effects=many.effects)  # type: ignore[arg-type]
    found = predictor.predict(many)
    assert torch.allclose(found.pose[1], found.pose[0], atol=1e-8)
    assert torch.allclose(found.pose[3], found.pose[2], atol=1e-8)
    assert float((found.pose[2] - found.pose[0]).abs().max()) > 1e-3


@pytest.mark.parametrize("candidate", [True, False])
def test_a_late_camera_sees_what_moves_evenly_where_it_was_before(candidate: bool) -> None:
    """As an unknown of the model, with a lateness of its own in each variant; initial states are what is there then.

    Of a candidate they are what such a camera sees in the first frame, so that what moves evenly shows no lateness.
    """
    scene = replace(find_setup("toss").scene, time_step=STEP, gravity=(0.0, 0.0, 0.0))
    known = () if candidate else (from_values("observation_latency", {"latency": 0.0}),)
    model = NominalModel(scene, known, sizes=() if candidate else ("observation_latency.latency",))
    timeline = Timeline.regular(torch.zeros(2, FRAMES, 1, 6).double(), STEP)
    timeline = replace(timeline, time=timeline.time + torch.tensor([[3.0], [7.0]]))
    kinds = [find("observation_latency")] if candidate else []
    predictor = Predictor.of_whole(model, timeline, torch.tensor([FRAMES, FRAMES]))
    predictor = Predictor(model, timeline, predictor.segments, kinds)
    late = torch.tensor([[0.03], [0.0], [0.01]]).double()
    pose, twist = torch.zeros(1, 2, 1, 7).double(), torch.zeros(1, 2, 1, 6).double()
    pose[..., 2], pose[..., 6], twist[..., 3] = 9.0, 1.0, torch.tensor([[0.4], [-2.0]])
    many = Variants.of_states(pose, twist, model.guess[None], predictor.null[None]).repeat(3)
    many = many.replace(effects=late) if candidate else many.replace(nominal=model.to_coordinates(late))
    found = predictor.predict(many).pose[..., 0, 0]
    since = timeline.time - timeline.time[:, :1]
    expected = torch.tensor([[0.4], [-2.0]]).double() * (since - (not candidate) * late[:, None])
    assert torch.allclose(found[..., 3:], expected[..., 3:], atol=1e-9)


def test_steps_of_several_lengths_lead_as_far_as_their_times_say() -> None:
    """Of some steps three are made, of others one that is as long as usual."""
    made = flights(trajectories=2)
    old, point = made.experiment.predictor, made.true
    parts = torch.where(torch.arange(23) % 3 == 0, 3, 1).expand(2, -1)
    found = old.at_times(old.timeline.refined(parts)).predict(point)
    expected = old.predict(point)
    assert torch.allclose(found.pose[..., :3], expected.pose[..., :3], atol=1e-9)
    assert torch.allclose(found.twist[..., 3:], expected.twist[..., 3:], atol=1e-9)


@pytest.mark.parametrize("most", [1, 16, 32, 48, 80, 10**6])
def test_no_more_world_steps_than_memory_allows_are_simulated_at_once_and_none_is_lost(
    most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, sizes = flights(trajectories=1, frames=16, cuts=1), []

    usual = PhysicsLayer.rollout

    def watched(self: PhysicsLayer, state: State, wrench: Tensor, *words: Any) -> Rollout:
        sizes.append(wrench.shape[0] * wrench.shape[1])
        return usual(self, state, wrench, *words)

    old = made.experiment.predictor
    predictor = Predictor(old.model, old.timeline, old.segments, old.candidates, most)
    many = made.true.repeat(5)
    many.effects[:, 0] = torch.linspace(-1, 1, 5).double()
    expected = old.predict(many)
    monkeypatch.setattr(PhysicsLayer, "rollout", watched)
    found = predictor.predict(many)
    worlds = max(1, min(5, most // 15))
    assert max(sizes) == 15 * worlds
    assert len(sizes) == -(-5 // worlds)
    for name in vars(expected):
        assert torch.allclose(getattr(found, name), getattr(expected, name), atol=1e-12), name


def test_whole_trajectories_of_their_own_lengths_are_predicted_as_far_as_they_go() -> None:
    made = flights(trajectories=2, cuts=1, sizes=(0.0, 0.0))
    old = made.experiment.predictor
    one = Predictor.of_whole(old.model, old.timeline, torch.tensor([24, 9]))
    assert (one.segments.size.tolist(), one.segments.frames) == ([24, 9], 24)
    point = made.true.replace(effects=torch.zeros(1, 0).double())
    found, expected = one.predict(point), old.predict(made.start)
    assert torch.allclose(found.pose[0, 0], expected.pose[0, 0], atol=1e-12)
    assert torch.allclose(found.pose[0, 1, :9], expected.pose[0, 1, :9], atol=1e-12)
    assert not bool(found.pose[0, 1, 9:].any())
