"""Predictions of several bodies: the impulses that carry them, and variants that do not touch each other."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from physid.effects import find, from_values
from physid.estimation.prediction import NominalModel, Prediction, Predictor, Segmentation, Timeline, Variants
from physid.physics.contact import PATCH
from physid.scenes import find_setup

SCENE = replace(find_setup("collide").scene, unknown=())
FRAMES, G = 24, 9.81
MASS = [body.mass for body in SCENE.bodies]
HALF = [body.size[2] / 2 for body in SCENE.bodies]


def predicted(places: list[list[float]], push: float) -> Prediction:
    """Predict two blocks that are at rest at places at first, each trajectory cut in two; a force pushes the second."""
    wrench = torch.zeros(1, FRAMES, 2, 6).double()
    wrench[..., 1, 5] = push
    segments = Segmentation.equal(1, FRAMES, FRAMES // 2)
    predictor = Predictor(NominalModel(SCENE), Timeline.regular(wrench, SCENE.time_step), segments)
    pose = torch.zeros(1, len(segments), 2, 7).double()
    pose[..., :3], pose[..., 6] = torch.tensor(places).double(), 1.0
    none = torch.zeros(1, 0).double()
    return predictor.predict(
        Variants.of_states(pose, torch.zeros_like(pose[..., :6]), predictor.model.guess[None], none)
    )


def carried(found: Prediction) -> Tensor:
    """Return the normal impulses per step of ground and first, ground and second, first and second body [N s]."""
    pairs = found.impulse[0].unflatten(-1, (-1, PATCH)).sum(-1)
    assert pairs.shape[-1] == 3
    assert not bool(pairs[:, [FRAMES // 2 - 1, FRAMES - 1]].any()), "no step follows the last frame of a segment"
    return pairs[:, FRAMES // 2 - 4 : FRAMES // 2 - 1].mean((0, 1))


@pytest.mark.parametrize("push", [0.0, -3.0, 2.0])
def test_the_ground_carries_what_stands_on_it_and_the_lower_block_the_upper_one(push: float) -> None:
    weight = [mass * G * SCENE.time_step for mass in MASS]
    added = -push * SCENE.time_step
    beside = carried(predicted([[0.0, 0.0, HALF[0]], [1.0, 0.0, HALF[1]]], push))
    assert beside.tolist() == pytest.approx([weight[0], weight[1] + added, 0.0], rel=1e-3, abs=1e-7)
    stacked = carried(predicted([[0.0, 0.0, HALF[0]], [0.0, 0.0, 2 * HALF[0] + HALF[1]]], push))
    assert stacked.tolist() == pytest.approx([sum(weight) + added, 0.0, weight[1] + added], rel=1e-3, abs=1e-7)


def test_bodies_and_trajectories_keep_their_places_among_variants_with_values_of_their_own() -> None:
    """Wind and a gain of forces are unknown: each variant has its own, alike in all trajectories and segments."""
    known = (from_values("constant_force", {"x": 0.0}), from_values("force_gain", {"gain": 0.0}))
    model = NominalModel(SCENE, known, sizes=("constant_force.x", "force_gain.gain"))
    rows, cut, time = 3, FRAMES // 2, SCENE.time_step * torch.arange(FRAMES // 2).double()
    wrench = torch.zeros(rows, FRAMES, 2, 6).double()
    wrench[..., 1, 4] = torch.tensor([1.0, 2.0, -3.0])[:, None]
    predictor = Predictor(model, Timeline.regular(wrench, SCENE.time_step), Segmentation.equal(rows, FRAMES, cut))
    pose = torch.zeros(1, 2 * rows, 2, 7).double()
    pose[..., 2], pose[..., 1, 0], pose[..., 6] = 9.0, 2.0, 1.0
    sizes = torch.tensor([[0.5, 0.0], [-1.0, 0.3], [0.0, -0.2], [2.0, 0.1]]).double()
    none = torch.zeros(len(sizes), 0).double()
    many = Variants.of_states(pose, torch.zeros_like(pose[..., :6]), model.guess[None], none[:1]).repeat(len(sizes))
    found = predictor.predict(many.replace(nominal=model.to_coordinates(sizes)))
    mass, half = torch.tensor(MASS).double(), (time**2 / 2).repeat(2)
    along = sizes[:, None, None, :1] / mass * half[:, None] + torch.tensor([0.0, 2.0]).double()
    assert torch.allclose(found.pose[..., 0], along.expand(-1, rows, -1, -1), atol=1e-9)
    aside = (1 + sizes[:, 1])[:, None, None] * wrench[..., 1, 4] / mass[1] * half
    assert torch.allclose(found.pose[..., 1, 1], aside, atol=1e-9)
    assert not bool(found.pose[..., 0, 1].any()), "the first body is not pushed"
    assert torch.allclose(found.twist[..., 5], (-G * time.repeat(2))[:, None].expand_as(found.twist[..., 5]))


@pytest.mark.parametrize("most", [1, 10**6])
def test_a_camera_with_a_candidate_of_its_own_reports_what_is_of_it_alone(most: int) -> None:
    """Of three variants two look aside, by as much as each says; the other candidate is at work in the third."""
    kinds = [find("camera_offset"), find("constant_force")]
    rows, timeline = 2, Timeline.regular(torch.zeros(2, FRAMES, 2, 6).double(), SCENE.time_step)
    predictor = Predictor(NominalModel(SCENE), timeline, Segmentation.equal(rows, FRAMES, FRAMES), kinds, most)
    pose = torch.zeros(1, rows, 2, 7).double()
    pose[..., 2], pose[..., 1, 0], pose[..., 6] = 9.0, 2.0, 1.0
    still = torch.zeros_like(pose[..., :6])
    many = Variants.of_states(pose, still, predictor.model.guess[None], predictor.null[None]).repeat(3)
    many.effects[0, 0], many.effects[2, 1], many.effects[1, 3] = 0.2, -0.1, 1.5
    found = predictor.predict(many)
    away = (found.pose - found.state)[..., :3]
    assert torch.allclose(away[0, ..., 0], torch.full_like(away[0, ..., 0], 0.2))
    assert torch.allclose(away[2, ..., 1], torch.full_like(away[2, ..., 1], -0.1))
    assert not bool(away[1].any())
    assert float(found.state[1, 0, -1, 0, 0]) > 0.0 == float(found.state[0, 0, -1, 0, 0])
