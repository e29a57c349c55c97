"""Bodies that lie on the ground, identified from poses, and raised by what effects make them higher."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from physid.effects import from_values
from physid.physics import State
from physid.scenes import SETUPS, Body, Ground, Scene
from physid.scenes.lying import raise_lying, touch_ground
from physid.scenes.setup import LYING, REST_DEPTH, Setup
from physid.scenes.setups.placing import on_ground
from physid.simulators.inputs import nominal_inputs

TILTED = Ground((0.6, 0.0, 0.8), 0.3)
BODIES = (Body("one", (0.3, 0.25, 0.2), mass=2.0, friction=0.12), Body("two", (0.1, 0.2, 0.4), mass=1.0, friction=0.2))
SCENE = Scene("test", 1 / 240, TILTED, BODIES)
NORMAL = torch.tensor(TILTED.normal, dtype=torch.float64)
BOTH = torch.tensor([[True, True]])


def laid_out(above: float = 0.0) -> State:
    """Return both bodies on the tilted ground at different headings, the second one so far above it."""
    pose = np.stack([on_ground(TILTED, 0.8 * k, 0.1, 0.3 + k, body.size[2]) for k, body in enumerate(BODIES)])
    pose[1, :3] += above * np.array(TILTED.normal)
    return State.at_rest(torch.from_numpy(pose)[None])


def raised(state: State, lying: Tensor, **effects: dict[str, float]) -> Tensor:
    """Return the poses of the bodies under effects of the catalogue."""
    return raise_lying(state, lying, nominal_inputs(SCENE), [from_values(*each) for each in effects.items()])


@pytest.mark.parametrize("change", [0.05, -0.1])
def test_a_body_that_lies_is_raised_along_the_normal_by_half_of_what_it_is_larger_and_another_one_is_not(
    change: float,
) -> None:
    state = laid_out()
    moved = raised(state, BOTH, object_size={"change": change}) - state.pose
    for number, body in enumerate(BODIES):
        expected = change * body.size[2] / 2 * NORMAL
        assert moved[0, number, :3].tolist() == pytest.approx(expected.tolist(), abs=1e-15)
    assert not moved[..., 3:].any()
    first = raised(state, torch.tensor([[True, False]]), object_size={"change": change})
    assert torch.equal(first[0, 1], state.pose[0, 1])
    assert torch.equal(first[0, 0], state.pose[0, 0] + moved[0, 0])


def test_a_body_lies_as_deep_with_another_size_as_with_the_measured_one() -> None:
    change, state = 0.08, laid_out()
    moved = State.at_rest(raised(state, BOTH, object_size={"change": change}))
    measured = nominal_inputs(SCENE)
    larger = measured.replace(size=measured.size * (1 + change))
    assert touch_ground(state, measured).all()
    assert touch_ground(moved, larger).all()
    assert not touch_ground(moved, measured).any()


def test_no_pose_is_touched_where_no_effect_changes_a_size() -> None:
    state = laid_out()
    assert raised(state, BOTH) is state.pose
    assert raised(state, BOTH, force_gain={"gain": 0.1}, viscous_drag={"coefficient": 0.5}) is state.pose
    assert torch.equal(raised(state, BOTH, object_size={"change": 0.0}), state.pose)


@pytest.mark.parametrize(("above", "lies"), [(-2.0, True), (0.0, True), (0.9, True), (1.1, False)])
def test_a_body_lies_where_its_lowest_point_is_at_the_ground(above: float, lies: bool) -> None:
    state = laid_out(REST_DEPTH + above * LYING)
    assert touch_ground(state, nominal_inputs(SCENE)).tolist() == [[True, lies]]


def test_a_body_on_an_edge_touches_the_ground_with_its_lowest_point() -> None:
    size = torch.tensor(BODIES[0].size, dtype=torch.float64)
    low = 0.5 * (size[0] + size[2]) * 0.5**0.5
    turned = [0.0, np.sin(np.pi / 8), 0.0, np.cos(np.pi / 8)]
    flat = Scene("test", 1 / 240, Ground(), BODIES[:1])
    pose = torch.tensor([[[0.0, 0.0, float(low), *turned]]], dtype=torch.float64)
    assert touch_ground(State.at_rest(pose), nominal_inputs(flat)).all()


@pytest.mark.parametrize("setup", SETUPS, ids=lambda setup: setup.scene.name)
def test_drawn_bodies_lie_on_the_ground_or_fly(setup: Setup) -> None:
    for protocol in setup.protocols:
        drawn = setup.draw(setup.scene, protocol, np.random.default_rng(0), 20)
        state = State.checked(torch.from_numpy(drawn.pose)[None], torch.from_numpy(drawn.twist)[None])
        falls = setup.leaves_ground or (setup.scene.name, protocol) == ("slide", "paper")
        assert touch_ground(state, nominal_inputs(setup.scene)).tolist() == [[not falls] * len(setup.scene.bodies)]
