"""Severity and phases, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from physid.benchmark.sealing.acting import acting_phases
from physid.benchmark.sealing.severity import severity
from physid.data.generation.settings import GenerateConfig, Noise
from physid.effects import from_values
from physid.physics import Effect

EXACT, LINEAR = 1e-6, 0.05
FAINT = 0.1  # below it nothing shows
SOLVER = 2e-3  # two bodies: the last digits of the solver of the cone, over a millimetre


def config(scene: str = "push", protocol: str = "rich", **changes: object) -> GenerateConfig:
    """Return a small recording set."""
    plain = {"trajectories": 6, "steps": 121, "video": False, "split": {"fit": 1}, "noise": Noise(1e-3, 1e-3)}
    return GenerateConfig(scene=scene, protocol=protocol, **plain | changes)  # type: ignore[arg-type]


def effect(name: str, **values: float) -> Effect:
    """Return an effect of the catalogue."""
    return from_values(name, values)


@pytest.mark.parametrize("scene", ["push", "slide", "collide", "toss"])
def test_without_effects_nothing_shows(scene: str) -> None:
    assert severity(config(scene), ()) < (SOLVER if scene == "collide" else EXACT)


def test_a_wind_in_flight_shows_as_its_parabola() -> None:
    """x = F t^2 / 2m; an offset and a trend leave T^2 / sqrt(180) of t^2 (Legendre), in one of six coordinates."""
    set_up = config("toss", steps=41)
    force, mass, length = 2.0, 1.0, 40 / 240
    expected = force / (2 * mass) * length**2 / 180**0.5 / 1e-3 / 6**0.5
    assert severity(set_up, [effect("constant_force", x=force)]) == pytest.approx(expected, rel=LINEAR)


def test_severity_grows_with_the_effect_and_shrinks_with_the_noise() -> None:
    drag = [effect("viscous_drag", coefficient=c) for c in (0.1, 0.2)]
    one, two = (severity(config(), [each]) for each in drag)
    assert two == pytest.approx(2 * one, rel=LINEAR)
    assert severity(config(noise=Noise(2e-3, 2e-3)), drag[:1]) == pytest.approx(one / 2, rel=LINEAR)


@pytest.mark.slow
def test_what_unknown_parameters_absorb_does_not_show() -> None:
    """Gravity scales the friction of a block that is pushed on a plane, and so does its coefficient."""
    gravity = [effect("gravity_error", change=0.02)]
    assert severity(config(unknown=("block.friction",)), gravity) < 0.02 * severity(config(), gravity)


@pytest.mark.parametrize("change", [-0.008, -0.1])
@pytest.mark.slow
def test_what_an_unknown_restitution_absorbs_does_not_show_in_a_toss(change: float) -> None:
    """With one body and the ground e' = e + k is another e, at any size; without an unknown e it shows."""
    bounce = [effect("ground_restitution", change=change)]
    known = {"true_values": {"block.restitution": 0.4}}
    absorbed = severity(config("toss", unknown=("block.friction", "block.restitution"), **known), bounce)
    assert absorbed < 0.01 * severity(config("toss", **known), bounce)


@pytest.mark.slow
def test_one_impact_in_another_step_makes_no_severity() -> None:
    """A force weaker by a few millinewtons moves a block by less than the noise until it hits the ground."""
    weak = [effect("force_gain", gain=-1e-4)]
    assert severity(config("toss", trajectories=4, steps=240), weak) < 0.1


def test_a_constant_offset_of_the_camera_along_the_plane_does_not_show() -> None:
    assert severity(config(), [effect("camera_offset", x=0.1)]) < EXACT
    assert severity(config(), [effect("camera_offset", z=0.005)]) == pytest.approx(5 / 6**0.5, rel=LINEAR)


@pytest.mark.parametrize(
    ("scene", "hidden", "phase"),
    [
        ("toss", effect("constant_force", x=2.0), "free_fall"),
        ("toss", effect("ground_restitution", change=0.3), "impact"),
        ("push", effect("force_delay", delay=0.02), "force_switch"),
        ("collide", effect("object_restitution", change=0.4), "contact_between_objects"),
    ],
    ids=lambda case: case if isinstance(case, str) else type(case).__name__,
)
@pytest.mark.slow
def test_an_effect_acts_in_its_phase(scene: str, hidden: Effect, phase: str) -> None:
    assert acting_phases(config(scene, steps=200), [hidden])[0] == phase


def test_an_effect_that_is_only_seen_changes_no_motion() -> None:
    assert acting_phases(config(), [effect("camera_yaw", angle=0.3)]) == []


@pytest.mark.slow
def test_drag_acts_where_the_body_is_fast_and_in_a_trajectory_that_coasts_while_nothing_pushes() -> None:
    assert acting_phases(config(steps=200), [effect("viscous_drag", coefficient=1.0)])[0] == "slide_fast"
    assert "coast" in acting_phases(config(steps=200, trajectories=1), [effect("viscous_drag", coefficient=1.0)])
    assert not np.isnan(severity(config(), [effect("viscous_drag", coefficient=1.0)]))


@pytest.mark.slow
def test_a_turned_camera_shows_where_forces_are_commanded_and_not_in_a_toss() -> None:
    """Physics knows no direction about the vertical: a toss that is seen turned is another toss, at any angle."""
    yaw = [effect("camera_yaw", angle=0.1)]
    toss, push = (severity(config(scene, "paper", noise=Noise(4e-4, 2e-3)), yaw) for scene in ("toss", "push"))
    assert toss < 0.05
    assert push > 1


@pytest.mark.parametrize("latency", [0.0015, 0.02])
@pytest.mark.slow
def test_a_late_camera_does_not_show_where_no_force_acts(latency: float) -> None:
    """A motion without commands that is shown later is the same motion, impacts included, and starts elsewhere."""
    set_up = config("toss", "straight", unknown=("block.friction", "block.restitution"), noise=Noise(5e-4, 2e-3))
    assert severity(set_up, [effect("observation_latency", latency=latency)]) < FAINT


def test_a_late_camera_shows_where_forces_switch() -> None:
    set_up = config("push", unknown=("block.friction",))
    assert severity(set_up, [effect("observation_latency", latency=0.02)]) > 10 * FAINT
