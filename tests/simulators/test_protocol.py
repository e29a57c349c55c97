"""Every simulator is asked in the same way."""

import dataclasses

import numpy as np
import pytest

from physid.effects import from_values
from physid.scenes import Excitation, find_setup
from physid.simulators import SIMULATORS, Simulator, find_simulator

NAMES = [simulator.name for simulator in SIMULATORS]
ROUNDING = 1e-12
APART = 1e-3  # [m] between references after a quarter of a second


def test_an_unknown_simulator_is_named_with_the_nearest() -> None:
    with pytest.raises(ValueError, match='unknown simulator "mujocco"; did you mean "mujoco"'):
        find_simulator("mujocco")


@pytest.mark.parametrize("simulator", SIMULATORS, ids=NAMES)
def test_its_default_steps_are_at_most_as_long_as_it_says(simulator: Simulator) -> None:
    assert simulator.substeps_for(1 / 240) <= simulator.substeps_for(1 / 60) <= simulator.substeps_for(1.0)
    assert simulator.substeps_for(1e-9) == 1


@pytest.mark.parametrize("simulator", SIMULATORS, ids=NAMES)
def test_references_agree_on_a_pushed_block(simulator: Simulator) -> None:
    setup = find_setup("push")
    drawn = setup.draw(setup.scene, "paper", np.random.default_rng(1), 60)
    (motion,) = simulator.simulate(setup.scene, [drawn], substeps=16)
    (other,) = find_simulator("mujoco").simulate(setup.scene, [drawn])
    assert motion.pose.shape == (60, 1, 7)
    assert motion.twist.shape == (60, 1, 6)
    assert np.abs(motion.pose - other.pose).max() < APART


@pytest.mark.parametrize("name", ["pybullet", "mujoco"])
@pytest.mark.parametrize("change", [0.1, -0.1])
@pytest.mark.parametrize("scene", ["push", "slide", "collide", "toss"])
def test_bodies_start_where_they_are_told_however_large_effects_make_them(name: str, change: float, scene: str) -> None:
    setup = find_setup(scene)
    drawn = [setup.draw(setup.scene, "paper", np.random.default_rng(seed), 3) for seed in range(3)]
    size = from_values("object_size", {"change": change})
    for told, motion in zip(drawn, find_simulator(name).simulate(setup.scene, drawn, [size]), strict=True):
        assert np.abs(motion.pose[0, :, :3] - told.pose[:, :3]).max() < ROUNDING
        assert np.abs((motion.pose[0, :, 3:] * told.pose[:, 3:]).sum(-1)) == pytest.approx(1.0, abs=ROUNDING)
        assert np.abs(motion.twist[0] - told.twist).max() < ROUNDING


@pytest.mark.parametrize("name", ["pybullet", "mujoco"])
def test_a_block_bounces_off_a_ground_that_yields_with_its_restitution_or_a_simulator_says_otherwise(name: str) -> None:
    simulator, restitution = find_simulator(name), 0.3
    toss = find_setup("toss").scene
    scene = toss.with_bodies([dataclasses.replace(body, restitution=restitution) for body in toss.bodies])
    pose = np.array([[0, 0, scene.bodies[0].size[2] / 2 + 0.05, 0, 0, 0, 1.0]])
    drawn = Excitation(pose, np.zeros((1, 6)), np.zeros((60, 1, 6)))
    soft = from_values("contact_compliance", {"compliance": 1e-4})
    (motion,) = simulator.simulate(scene, [drawn], [soft], 20)
    speed = motion.twist[:, 0, 5]
    frame = 9.81 * scene.time_step  # a bounce is seen up to a frame later
    alike = -frame < speed.max() - restitution * (2 * 9.81 * 0.05) ** 0.5 < 1e-3
    assert bool(alike) == ("contact_compliance" not in simulator.own_laws)


def test_only_a_simulator_that_shares_its_scheme_with_the_model_says_so() -> None:
    assert find_simulator("pybullet").integration(0.25) == {"scheme": "semi_implicit_euler", "step": 0.25}
    assert find_simulator("mujoco").integration(0.25) is None
