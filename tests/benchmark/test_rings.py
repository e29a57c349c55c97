"""The effects of the benchmark's own rings: they vanish at their null value, and show otherwise."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from physid.benchmark.sealing.hidden import CONFUSIONS, Hidden, Role, candidates
from physid.benchmark.sealing.native import NATIVE
from physid.benchmark.sealing.outside import OUTSIDE
from physid.effects import CATALOGUE, find
from physid.effects.laws import batch_equals_loop, null_is_identity
from physid.physics import Effect
from physid.scenes import SETUPS, find_setup
from physid.simulators import find_simulator, observed
from physid.simulators.bullet.world import simulate
from physid.simulators.native import Native

STEPS = 160  # by then a toss has bounced
EXACT = 1e-9  # [m]
VISIBLE = 1e-5  # [m] or [-]
TIED = 1e-6  # [m], to which MuJoCo solves


@cache
def plain(scene: str) -> NDArray[np.float64]:
    """Return those of a trajectory without effects."""
    return seen(scene, ())


def seen(scene: str, effects: tuple[Effect, ...]) -> NDArray[np.float64]:
    """Return the observed poses of a short trajectory of the rich protocol."""
    setup = find_setup(scene)
    excitation = setup.draw(setup.scene, "rich", np.random.default_rng(4), STEPS)
    pose = simulate(setup.scene, excitation, effects).pose
    return observed(pose, effects, setup.scene.time_step * np.arange(len(pose)))


def typical(kind: type[Effect]) -> Effect:
    """Return the effect at twice its typical size, or the end of its range."""
    sizes = {key: min(2 * q.typical, q.high) for key, q in kind.quantities().items()}
    return kind().replace(**{key: getattr(kind(), key) + size for key, size in sizes.items()})


@pytest.mark.parametrize("kind", [*NATIVE, *OUTSIDE], ids=lambda kind: kind.name)
@pytest.mark.slow
def test_an_effect_of_the_rings_vanishes_at_null_and_shows_in_some_scene(kind: type[Effect]) -> None:
    shown = 0.0
    for scene in (setup.scene.name for setup in SETUPS):
        assert np.abs(plain(scene) - seen(scene, (kind(),))).max() < EXACT, scene
        shown = max(shown, float(np.abs(seen(scene, (typical(kind),)) - plain(scene)).max()))
        assert np.array_equal(seen(scene, ()), plain(scene)), "PyBullet kept a setting for the next world"
    assert shown > VISIBLE


@pytest.mark.parametrize("kind", OUTSIDE, ids=lambda kind: kind.name)
def test_an_effect_outside_the_catalogue_obeys_the_laws_of_effects(kind: type[Effect]) -> None:
    null_is_identity(kind)
    batch_equals_loop(kind)


def test_the_rings_share_no_name_and_kin_stands_in_the_catalogue() -> None:
    known = {kind.name for kind in CATALOGUE}
    names = [kind.name for kind in (*NATIVE, *OUTSIDE)]
    assert len({*names, *known}) == len(names) + len(known)
    for kind in NATIVE:
        assert isinstance(kind(), Native)
        assert set(getattr(kind, "kin")) <= known  # noqa: B009


@pytest.mark.parametrize(("role", "count"), [("pair", 2), ("triple", 3)])
def test_effects_together_are_of_different_sites_and_identified_apart_by_their_scene(role: Role, count: int) -> None:
    near = {name for one in CONFUSIONS if one.scene == "push" and "rich" in one.protocols for name in one.effects}
    hidden = candidates(role, "push", "rich")
    named = {kind.name for one in hidden for kind in one.kinds}
    assert all(len({*one.sites}) == len(one.kinds) == count for one in hidden)
    assert near
    assert named
    assert not near & named


def test_what_an_unknown_parameter_absorbs_is_no_right_answer() -> None:
    threshold = Hidden("native", (find_native("engine_bounce_threshold"),))
    assert threshold.right("toss") == []
    assert threshold.right("slide") == [["ground_restitution"]]
    assert Hidden("native", (find_native("engine_push_out"),)).right("toss") == [["contact_compliance"]]


def find_native(name: str) -> type[Effect]:
    """Return an effect of the engine's own."""
    return next(kind for kind in NATIVE if kind.name == name)


@pytest.mark.parametrize(("scene", "alike"), [("push", True), ("slide", True), ("toss", True), ("collide", False)])
def test_in_a_straight_motion_a_larger_body_is_one_that_is_seen_higher_unless_bodies_meet(
    scene: str, alike: bool
) -> None:
    """By MuJoCo; so no diagnosis can be asked which of the two it is."""
    setup, change, mujoco = find_setup(scene), 0.08, find_simulator("mujoco")
    excitation = setup.draw(setup.scene, "straight", np.random.default_rng(4), 120)
    normal, heights = np.array(setup.scene.ground.normal), np.array([body.size[2] for body in setup.scene.bodies])
    higher = change * heights[:, None] / 2 * normal
    pose = excitation.pose.copy()
    pose[:, :3] += higher
    effect = find("object_size")(change=torch.tensor([change], dtype=torch.float64))
    (larger,) = mujoco.simulate(setup.scene, [replace(excitation, pose=pose)], [effect])
    (usual,) = mujoco.simulate(setup.scene, [excitation])
    off = np.abs(larger.pose[..., :3] - usual.pose[..., :3] - higher).max()
    assert (off < TIED) == alike
    known = {kind.name for hidden in candidates("catalogue", scene, "straight", "closed_form") for kind in hidden.kinds}
    assert ("camera_offset" in known) != alike
