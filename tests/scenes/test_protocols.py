"""How trajectories start and are pushed."""

import dataclasses

import numpy as np
import pytest

from physid.data.generation.settings import GenerateConfig
from physid.scenes import SETUPS, Excitation, find_setup
from physid.scenes.camera import corners
from physid.scenes.setup import REST_DEPTH
from physid.strict import nearest

STEPS, DRAWS = 300, 40
EVERY = [(setup.scene.name, protocol) for setup in SETUPS for protocol in setup.protocols]
TOLERANCE = 1e-9


def draws(name: str, protocol: str, count: int = DRAWS) -> list[Excitation]:
    setup = find_setup(name)
    return [setup.draw(setup.scene, protocol, np.random.default_rng(seed), STEPS) for seed in range(count)]


def gaps(name: str, excitation: Excitation) -> np.ndarray:
    scene = find_setup(name).scene
    return np.asarray((corners(excitation.pose, scene.sizes) @ scene.ground.normal - scene.ground.offset).min(-1))


@pytest.mark.parametrize(("name", "protocol"), EVERY)
def test_the_same_seed_draws_the_same_trajectory(name: str, protocol: str) -> None:
    first, again = draws(name, protocol, 2), draws(name, protocol, 2)
    assert np.array_equal(first[0].wrench, again[0].wrench)
    assert np.array_equal(first[1].pose, again[1].pose)
    assert not np.array_equal(first[0].pose, first[1].pose)


@pytest.mark.parametrize(("name", "protocol"), EVERY)
def test_every_body_starts_on_or_above_the_ground_inside_the_view(name: str, protocol: str) -> None:
    scene = find_setup(name).scene
    assert scene.camera is not None
    for excitation in draws(name, protocol):
        assert (gaps(name, excitation) > -REST_DEPTH - TOLERANCE).all()
        assert scene.camera.sees(excitation.pose, scene.sizes).all()


@pytest.mark.parametrize("name", ["push", "collide"])
def test_the_paper_pushes_from_rest_along_one_axis_with_1_to_10_newton_redrawn_at_each_step(name: str) -> None:
    axes = set()
    for excitation in draws(name, "paper"):
        force = excitation.wrench[:, 0, 3:]
        axis = int(np.abs(force[0]).argmax())
        assert not excitation.twist.any()
        assert not np.delete(force, axis, axis=1).any()
        assert len(np.unique(np.sign(force[:, axis]))) == 1
        assert np.abs(force[:, axis]).min() >= 1.0
        assert np.abs(force[:, axis]).max() <= 10.0
        assert len(np.unique(force[:, axis])) == STEPS
        axes.add((axis, np.sign(force[0, axis])))
    assert len(axes) == 4


def test_in_the_paper_nothing_but_gravity_acts_on_the_slide_and_the_toss() -> None:
    for name in ("slide", "toss"):
        assert not any(excitation.wrench.any() for excitation in draws(name, "paper"))


def test_the_slide_begins_with_a_free_fall_that_ends_in_contact_at_a_frame() -> None:
    scene = find_setup("slide").scene
    fall = 9.81 * scene.time_step**2 * scene.ground.normal[2]
    for excitation in draws("slide", "paper"):
        gap = gaps("slide", excitation)[0]
        way = [gap - 0.5 * fall * step * (step + 1) for step in range(60)]
        assert 0.01 < gap < 0.15
        assert min(np.abs(np.add(way, REST_DEPTH))) < TOLERANCE


def test_the_second_block_stands_ahead_of_the_first_and_apart_from_it() -> None:
    for excitation in draws("collide", "paper"):
        ahead = excitation.wrench[0, 0, 3:] / np.linalg.norm(excitation.wrench[0, 0, 3:])
        box = corners(excitation.pose, find_setup("collide").scene.sizes) @ ahead
        assert box[1].min() > box[0].max() + 0.02


def test_the_rich_protocol_coasts_reverses_and_pushes_obliquely() -> None:
    forces = np.stack([excitation.wrench[:, 0, 3:] for excitation in draws("push", "rich")])
    coasting = ~forces.any(-1)
    turned = (forces[:, 1:] * forces[:, :-1]).sum(-1) < 0
    oblique = np.abs(forces[..., :2]).min(-1) > 1.0
    assert 0.1 < coasting.mean() < 0.5
    assert turned.any()
    assert oblique.mean() > 0.3
    assert np.linalg.norm(forces, axis=-1).max() <= 10.0 + TOLERANCE
    assert any(excitation.twist.any() for excitation in draws("push", "rich"))


def test_an_unknown_protocol_is_answered_with_the_nearest() -> None:
    setup = find_setup("push")
    with pytest.raises(ValueError, match='no protocol "papr"; did you mean "paper"'):
        setup.draw(setup.scene, "papr", np.random.default_rng(0), STEPS)
    assert nearest("nothing alike", ["a", "b"]) == "; known are a, b"


def test_what_is_unknown_of_a_cube_is_what_generation_calls_that_of_the_block() -> None:
    setup = find_setup("toss")
    cube = dataclasses.replace(setup.scene.bodies[0], name="cube")
    mine = dataclasses.replace(setup.scene, bodies=(cube,), unknown=("cube.friction", "cube.restitution"))
    unknown = setup.unknown_of(mine)
    assert unknown == ["block.friction", "block.restitution"]
    GenerateConfig("toss", unknown=unknown)
    with pytest.raises(ValueError, match=r'unknown parameter "cube\.friction"'):
        GenerateConfig("toss", unknown=list(mine.unknown)).true_parameters()
