"""Reference simulators against closed forms, at stamps that do not lie on their steps."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from torch import Tensor

from physid.diagnosis.reference.replay import Reference, references_of, replay
from physid.diagnosis.settings.reference import ReplaySettings
from physid.effects import from_values
from physid.estimation.prediction.nominal_model import NominalModel
from physid.estimation.prediction.segments import Segmentation
from physid.estimation.prediction.timeline import Timeline
from physid.estimation.prediction.variants import Variants
from physid.physics import Effect
from physid.scenes import Excitation, Integration, Scene, find_setup
from physid.simulators import find_simulator

TOSS = find_setup("toss").scene
STEP = 1e-3
FINE_ENOUGH = 2e-5  # [m] a fiftieth of what a millisecond is at 1 m/s
FORCED_ENOUGH = 1e-4  # [m] a twentieth of what positions that run ahead by half a step of a millisecond were off there
SPEED = 2.0
SLID_ENOUGH = 2e-4  # [m] a tenth of what a millisecond is at that speed
REFERENCES = [Reference("pybullet", STEP, staggered=True), Reference("mujoco", 2 * STEP)]


def replayed(reference: Reference, height: float, velocity: tuple[float, float, float], time: Tensor) -> Tensor:
    """Return the positions of a box by a reference, at uneven times (T,); shape (T, 3)."""
    frames = len(time)
    timeline = Timeline.regular(torch.zeros(1, frames, 1, 6, dtype=torch.float64), 1 / 60)
    grid = dataclasses.replace(timeline.grid, steps=time[None].diff(dim=1))
    model = NominalModel(TOSS)
    pose = torch.tensor([0.0, 0.0, height, 0, 0, 0, 1], dtype=torch.float64).expand(1, 1, 1, 7)
    twist = torch.tensor([0.0, 0, 0, *velocity], dtype=torch.float64).expand(1, 1, 1, 6)
    nothing = torch.zeros(1, 0, dtype=torch.float64)
    point = Variants(pose, twist, model.guess[None], nothing, torch.zeros(1, 1, dtype=torch.float64))
    segments = Segmentation.equal(1, frames, frames)
    seen = replay(model, Timeline(time[None], grid), segments, point, ReplaySettings(), reference=reference)
    return seen[0, :, 0, :3]


def flown(reference: Reference) -> tuple[Tensor, Tensor]:
    """Return the heights of a box in flight by a reference and by g t^2 / 2, at uneven times."""
    time = torch.tensor([0.0, 0.0163, 0.0341, 0.0498, 0.0671, 0.08333], dtype=torch.float64)
    height = replayed(reference, 3.0, (0.0, 0.0, SPEED), time)[:, 2]
    return height, 3 + SPEED * time - 9.81 * time**2 / 2


@pytest.mark.parametrize("reference", REFERENCES)
def test_a_reference_flies_a_parabola_at_any_stamps(reference: Reference) -> None:
    pytest.importorskip(reference.name)
    height, parabola = flown(reference)
    assert (height - parabola).abs().max() < FINE_ENOUGH


def test_positions_of_semi_implicit_steps_run_ahead_by_half_a_step_unless_they_start_half_a_step_earlier() -> None:
    height, parabola = flown(Reference("pybullet", STEP))
    ahead = -9.81 * 0.08333 * STEP / 2
    assert float((height - parabola)[-1]) == pytest.approx(ahead, rel=0.05)


@pytest.mark.parametrize("reference", REFERENCES)
@pytest.mark.parametrize("first", [0, 4])
def test_forces_that_change_move_a_box_as_their_double_integral(reference: Reference, first: int) -> None:
    """A velocity of half a step earlier takes the forces of half a step earlier, or positions run ahead by h dv / 2."""
    pytest.importorskip(reference.name)
    frames, rate, mass = 24, 60, TOSS.bodies[0].mass
    force = 24 * torch.randn(frames, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    wrench = torch.zeros(1, frames, 1, 6, dtype=torch.float64)
    wrench[0, :, 0, 3] = force
    timeline = Timeline.regular(wrench, 1 / rate)
    model, size = NominalModel(TOSS), frames - first
    segments = Segmentation(1, frames, *(torch.tensor([k]) for k in (0, first, size)), *2 * [torch.zeros(1).bool()])
    pose = torch.tensor([0.0, 0.0, 20.0, 0, 0, 0, 1], dtype=torch.float64).expand(1, 1, 1, 7)
    twist = torch.tensor([0.0, 0, 0, SPEED, 0, 0], dtype=torch.float64).expand(1, 1, 1, 6)
    nothing = torch.zeros(1, 0, dtype=torch.float64)
    point = Variants(pose, twist, model.guess[None], nothing, torch.zeros(1, 1, dtype=torch.float64))
    seen = replay(model, timeline, segments, point, ReplaySettings(), reference=reference)[0, first:, 0, 0]
    gained = torch.cat([torch.zeros(1).double(), (force[first:-1] / mass / rate).cumsum(0)])
    speed = SPEED + gained
    way = torch.cat([torch.zeros(1).double(), ((speed[:-1] + speed[1:]) / 2 / rate).cumsum(0)])
    assert float(gained.abs().max()) > 0.5
    assert (seen - way).abs().max() < FORCED_ENOUGH


@pytest.mark.parametrize("reference", REFERENCES)
def test_a_box_that_was_dropped_rests_on_the_ground(reference: Reference) -> None:
    """What semi-implicit positions run ahead by in the fall ends with it."""
    pytest.importorskip(reference.name)
    half = TOSS.bodies[0].size[2] / 2
    time = torch.linspace(0, 1.5, 46, dtype=torch.float64) + 0.002 * torch.tensor([0.0, 1.0]).repeat(23)
    height = replayed(reference, half + 0.4, (0.0, 0.0, 0.0), time)[:, 2]
    assert (height[-3:] - half).abs().max() < FINE_ENOUGH
    assert float(height.min()) > half - SPEED * STEP


@pytest.mark.parametrize("reference", REFERENCES)
def test_a_box_slides_to_a_stop_by_coulombs_law(reference: Reference) -> None:
    pytest.importorskip(reference.name)
    friction, half = TOSS.bodies[0].friction, TOSS.bodies[0].size[2] / 2
    stops = SPEED / (friction * 9.81)
    time = torch.tensor([0.0, 0.11, 0.23, 0.5, 0.8, 1.4], dtype=torch.float64) * stops
    place = replayed(reference, half, (SPEED, 0.0, 0.0), time)[:, 0]
    moving = time.clamp_max(stops)
    slid = SPEED * moving - friction * 9.81 * moving**2 / 2
    assert (place - slid).abs().max() < SLID_ENOUGH


def test_recordings_of_a_known_simulator_are_replayed_with_its_own_steps() -> None:
    known = dataclasses.replace(TOSS, integration=Integration("semi_implicit_euler", 1 / 480))
    assert references_of(known, ReplaySettings()) == (Reference("pybullet", 1 / 480),)


def test_no_reference_of_an_unknown_maker_has_long_steps() -> None:
    slow = dataclasses.replace(TOSS, integration=None, time_step=1 / 30)
    assert all(each.step <= 1 / 480 for each in references_of(slow, ReplaySettings()))
    collide = dataclasses.replace(find_setup("collide").scene, integration=None)
    assert "pybullet" not in {each.name for each in references_of(collide, ReplaySettings())}


def test_no_reference_has_a_law_of_its_own_for_an_effect_at_work_unless_there_is_none_else() -> None:
    soft = [from_values("contact_compliance", {"compliance": 1e-4})]
    unknown = dataclasses.replace(TOSS, integration=None)

    def names(scene: Scene, effects: list[Effect]) -> list[str]:
        return [each.name for each in references_of(scene, ReplaySettings(), effects)]

    assert names(unknown, []) == ["pybullet", "mujoco"]
    assert names(unknown, soft) == ["mujoco"]
    known = dataclasses.replace(TOSS, integration=Integration("semi_implicit_euler", 1 / 480))
    assert names(known, soft) == ["pybullet"], "it made the recordings"


@pytest.mark.parametrize("high", [0.0, 0.015])
def test_pybullet_leaves_the_line_of_a_push_where_the_centre_of_mass_is_above_that_of_the_box(high: float) -> None:
    """A block at an angle, pushed along x at its centre: MuJoCo keeps to the line, and so it alone is asked."""
    scene = dataclasses.replace(find_setup("push").scene, camera=None)
    off = [from_values("com_offset", {"x": 0.0, "y": 0.0, "z": high})] if high else []
    wrench = np.zeros((100, 1, 6))
    wrench[..., 3] = 4.0
    pose = np.array([[0.0, 0.0, scene.bodies[0].size[2] / 2, 0.0, 0.0, np.sin(0.35), np.cos(0.35)]])
    pushed = Excitation(pose, np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]]), wrench)
    aside = {
        name: float(np.abs(find_simulator(name).simulate(scene, [pushed], off)[0].pose[-1, 0, 1]))
        for name in ("pybullet", "mujoco")
    }
    assert aside["mujoco"] < 2e-4
    assert (aside["pybullet"] > 3e-3) is bool(high)
    names = [each.name for each in references_of(scene, ReplaySettings(), off)]
    assert names == (["mujoco"] if high else ["pybullet", "mujoco"])
