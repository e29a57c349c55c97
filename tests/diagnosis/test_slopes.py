"""Slopes of predictions against the closed form of a block that slides under a constant force."""

from __future__ import annotations

import pytest
import torch

from physid.effects import find, from_values
from physid.estimation.least_squares.jacobian import Directions, differentiate
from physid.estimation.least_squares.normal_equations import linearise
from physid.estimation.prediction.nominal_model import NominalModel
from physid.estimation.prediction.rollout import Predictor
from physid.estimation.prediction.segments import Segmentation
from physid.estimation.prediction.timeline import Timeline
from physid.estimation.prediction.variants import Variants
from physid.scenes import find_setup

SCENE, FRAMES, SPEED, G = find_setup("push").scene, 30, 1.0, 9.81
WIND = find("constant_force").quantities()["x"]


@pytest.mark.parametrize("force", [1.0, WIND.high, WIND.low])
def test_slopes_are_those_of_a_slide_also_where_a_parameter_is_as_large_as_it_can_be(force: float) -> None:
    """Of x = v t + (F / m - mu g) t^2 / 2, less a drag at its null that slows it by c / m of its way's integral."""
    (block,) = SCENE.bodies
    speed = SPEED if force > 0 else -SPEED
    timeline = Timeline.regular(torch.zeros(1, FRAMES, 1, 6, dtype=torch.float64), SCENE.time_step)
    model = NominalModel(SCENE, (from_values("constant_force", {"x": force}),), sizes=("constant_force.x",))
    segments = Segmentation.equal(1, FRAMES, FRAMES)
    predictor = Predictor(model, timeline, segments, [find("viscous_drag")])
    pose, twist = torch.zeros(1, 1, 1, 7, dtype=torch.float64), torch.zeros(1, 1, 1, 6, dtype=torch.float64)
    pose[..., 2], pose[..., 6], twist[..., 3] = block.size[2] / 2, 1.0, speed
    point = Variants.of_states(pose, twist, model.guess[None], predictor.null[None])
    lies = torch.ones(1, 1, dtype=torch.bool)
    directions = Directions.of(torch.tensor(SCENE.ground.normal, dtype=torch.float64), lies, lies)
    push = torch.zeros(1, 1, FRAMES, 1, 6, dtype=torch.float64)
    push[..., 3] = 1.0
    slopes = differentiate(predictor, point, directions, torch.tensor([0]), push)
    time = timeline.time[0]
    pulled = time**2 / (2 * block.mass)
    rate = force / block.mass - torch.tensor(speed).sign() * block.friction * G
    dragged = -(speed * time**2 / 2 + rate * time**3 / 6) / block.mass
    known = ((WIND.typical * pulled, 1e-5), (dragged, 5e-3), (pulled, 1e-5))  # a drag is held for a step
    for slope, (expected, within) in zip(slopes.shared, known, strict=True):
        assert torch.allclose(slope[0, :, 0, 3], expected, rtol=within, atol=1e-8)
        assert float(slope[0, :, 0, :3].abs().max()) < 1e-6, "it does not turn"
    along = [slope[0, :, 0, 3] for slope in slopes.state if float(slope[0, -1, 0, 3]) > 1e-3]
    assert torch.allclose(along[0], torch.ones_like(time), atol=1e-6)
    assert torch.allclose(along[1], time, atol=1e-6)


def test_no_collision_tells_where_along_the_ground_a_camera_stands() -> None:
    """All that happens is the same elsewhere on the ground; above it, it is not."""
    scene, frames = find_setup("collide").scene, 90
    predictor = Predictor(
        NominalModel(scene),
        Timeline.regular(torch.zeros(1, frames, 2, 6, dtype=torch.float64), scene.time_step),
        Segmentation.equal(1, frames, frames),
        [find("camera_offset")],
    )
    pose, twist = torch.zeros(1, 1, 2, 7, dtype=torch.float64), torch.zeros(1, 1, 2, 6, dtype=torch.float64)
    pose[..., 2] = torch.tensor([body.size[2] / 2 for body in scene.bodies], dtype=torch.float64)
    pose[..., 6] = 1.0
    turned = torch.tensor(0.15, dtype=torch.float64)  # half of the angle: a corner is hit, off the middle
    pose[..., 1, 5], pose[..., 1, 6] = turned.sin(), turned.cos()
    pose[..., 1, 0], pose[..., 1, 1] = sum(body.size[0] for body in scene.bodies) / 2 + 0.08, 0.1
    twist[..., 0, 3] = 2.0
    point = Variants.of_states(pose, twist, torch.zeros(1, 0, dtype=torch.float64), predictor.null[None])
    lies = torch.ones(1, 2, dtype=torch.bool)
    directions = Directions.of(torch.tensor(scene.ground.normal, dtype=torch.float64), lies)
    jacobian = differentiate(predictor, point, directions, torch.arange(len(predictor.terms)))
    assert float(jacobian.base.twist[0, 0, -1, 1, :3].abs().max()) > 0.1, "the second block is to turn"
    scale = torch.full((1, frames, 2, 6), 1e4, dtype=torch.float64)
    linear = linearise(torch.zeros_like(scale), scale, jacobian, directions, predictor.segments)
    seen = (jacobian.shared * scale).square().sum((1, 2, 3, 4))
    left = linear.normal().matrix.sum(0).diagonal() / seen
    names = [term.name for term in predictor.terms]
    assert float(left[[names.index("x"), names.index("y")]].max()) < 1e-8, "no more than the prior of initial states"
    assert float(left[names.index("z")]) > 0.5, "blocks that lie on the ground do not follow"
