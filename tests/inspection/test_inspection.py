"""Sound recordings pass; each mistake of who recorded or imported is found, and its mend is named."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from tests.data.sets import write_set
from tests.diagnosis.sets import recorded as generated
from tests.diagnosis.sets import rewritten

from physid.cli import main
from physid.data import Recording, RecordingSet
from physid.data.importers.rotations import axes_of
from physid.data.reading import Reading, checksum_of_files, write_reading
from physid.inspection.kinematics import kinematics_of, noise_of, shifted_forces
from physid.inspection.origin import Origin
from physid.inspection.report import inspect
from physid.inspection.rules.falls import _clock as clock_of_falls
from physid.scenes import Ground, Scene, find_setup
from physid.simulators.bullet.world import simulate

FRAMES, PROTOCOLS, SOME = {"toss": 360}, {"toss": "paper", "slide": "paper"}, 6
NOISE = 2e-4  # [m], and twice as many [rad]


@cache
def recorded(name: str) -> tuple[Scene, tuple[Recording, ...]]:
    """Simulate a few motions of a scene, and add the noise of a tracker."""
    setup = find_setup(name)
    scene = dataclasses.replace(setup.scene, camera=None)
    found = []
    for index in range(SOME):
        generator = np.random.default_rng(index)
        excitation = setup.draw(scene, PROTOCOLS.get(name, "rich"), generator, FRAMES.get(name, 200))
        pose = simulate(scene, excitation).pose
        turn = Rotation.from_rotvec(2 * NOISE * generator.normal(size=(pose[..., 0].size, 3)))
        noisy = (turn * Rotation.from_quat(pose[..., 3:].reshape(-1, 4))).as_quat().reshape(*pose.shape[:2], 4)
        place = pose[..., :3] + NOISE * generator.normal(size=(*pose.shape[:2], 3))
        found.append(Recording(pose=np.concatenate([place, noisy], -1), wrench=excitation.wrench))
    return scene, tuple(found)


def said(folder: Path, scene: Scene, recordings: list[Recording]) -> list[str]:
    """Return what looks wrong in a set, each with its mend."""
    report = inspect(RecordingSet(write_set(folder, recordings, scene)))
    return [f"{one.what} -> {one.mend}" for one in report.findings if one.wrong]


@pytest.mark.parametrize("name", ["push", "slide", "collide", "toss"])
def test_sound_recordings_pass(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    scene, recordings = recorded(name)
    assert said(tmp_path, scene, list(recordings)) == []
    assert main(["check", str(tmp_path)]) == 0
    assert "240 frames per second" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "unknown", "hidden"),
    [
        ("push", ("block.mass", "block.friction"), ""),
        ("toss", ("block.friction", "block.restitution"), ""),
        ("push", ("block.friction", "block.restitution"), "block falls and lands in 0 frames"),
        ("toss", ("block.mass",), "block is pushed in 0 frames"),
    ],
)
def test_what_an_unknown_parameter_shows_in_has_to_happen(
    tmp_path: Path, name: str, unknown: tuple[str, ...], hidden: str, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, recordings = recorded(name)
    found = said(tmp_path, dataclasses.replace(scene, unknown=unknown), list(recordings))
    assert [hidden in one for one in found] == ([True] if hidden else [])
    assert main(["check", str(tmp_path)]) == int(bool(hidden))
    assert "physid identifiability" in capsys.readouterr().out


def test_a_block_that_never_slides_says_nothing_of_its_friction(tmp_path: Path) -> None:
    scene, recordings = recorded("toss")
    short = [
        dataclasses.replace(
            one,
            pose=None if one.pose is None else one.pose[:25],
            wrench=None if one.wrench is None else one.wrench[:25],
        )
        for one in recordings
    ]
    found = said(tmp_path, dataclasses.replace(scene, unknown=("block.friction",)), short)
    assert any("block slides in 0 frames" in one for one in found)


Change = Callable[[Scene, Recording], tuple[Scene, Recording]]


def posed(change: Callable[[np.ndarray], np.ndarray]) -> Change:  # type: ignore[type-arg]
    """Change the poses."""
    return lambda scene, one: (scene, dataclasses.replace(one, pose=change(one.pose.copy())))  # type: ignore[union-attr]


def forced(change: Callable[[np.ndarray], np.ndarray]) -> Change:  # type: ignore[type-arg]
    """Change the forces."""
    return lambda scene, one: (scene, dataclasses.replace(one, wrench=change(one.wrench.copy())))  # type: ignore[union-attr]


def millimetres(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    pose[..., :3] *= 1000
    return pose


def w_first(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    return np.concatenate([pose[..., :3], pose[..., [6, 3, 4, 5]]], -1)


def inverse(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    pose[..., 3:6] *= -1
    return pose


def y_up(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    change = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    turn = (change * Rotation.from_quat(pose[..., 3:].reshape(-1, 4))).as_quat().reshape(*pose.shape[:2], 4)
    return np.concatenate([pose[..., [0]], pose[..., [2]], -pose[..., [1]], turn], -1)


def spikes(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    pose[::7, :, 0] += 0.3
    return pose


def halved(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    return pose[np.arange(len(pose)) // 4 * 4]


def carried(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    """Lift it by half a metre, and slowly, as a hand does."""
    pose[..., 2] += 0.25 * (1 - np.cos(np.arange(len(pose)) / 100))[:, None]
    return pose


def held(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    pose[60:90] = pose[60]
    return pose


def upside_down(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    """Turn the world about x by half a turn: a log whose y points down, or z."""
    turn = (Rotation.from_quat([1, 0, 0, 0]) * Rotation.from_quat(pose[..., 3:].reshape(-1, 4))).as_quat()
    return np.concatenate([pose[..., :3] * [1, -1, -1], turn.reshape(*pose.shape[:2], 4)], -1)


def in_grams(scene: Scene, one: Recording) -> tuple[Scene, Recording]:
    return scene.with_bodies([dataclasses.replace(scene.bodies[0], mass=1000 * scene.bodies[0].mass)]), one


def sunk(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    pose[..., 2] += 0.1
    return pose


def on_a_table(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    pose[..., 2] += 0.742
    return pose


def mirrored(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    """Reflect y: rotations, which are axial, turn the other way about x and z."""
    return pose * [1, -1, 1, -1, 1, -1, 1]


def turning(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    vector = np.rad2deg(Rotation.from_quat(pose[:, 0, 3:]).as_rotvec())
    return np.concatenate([pose[..., :3], Rotation.from_rotvec(vector).as_quat()[:, None]], -1)


def _sized(scene: Scene, factor: float) -> Scene:
    first = scene.bodies[0]
    return scene.with_bodies([dataclasses.replace(first, size=tuple(factor * edge for edge in first.size))])


MISTAKES: list[tuple[str, str, Change, str]] = [
    ("toss", "millimetres", posed(millimetres), "seem to be in millimetres -> import with units.position=mm"),
    ("push", "millimetres", posed(millimetres), "seem to be in millimetres -> import with units.position=mm"),
    ("toss", "inches", posed(lambda pose: pose * ([39.37] * 3 + [1] * 4)), "seem to be in inches"),
    ("toss", "centimetres", posed(lambda pose: pose * ([100] * 3 + [1] * 4)), "seem to be in centimetres"),
    ("toss", "feet", posed(lambda pose: pose * ([3.281] * 3 + [1] * 4)), "seem to be in feet"),
    ("push", "a hand that carries", posed(carried), "they touch no ground (lowest corner"),
    ("toss", "w first", posed(w_first), "order: wxyz"),
    ("toss", "inverse rotations", posed(inverse), "inverse rotations"),
    ("toss", "y up", posed(y_up), "up seems to be y -> import with the axes of the log (axes=y-up)"),
    ("push", "y up", posed(y_up), "up seems to be y -> import with the axes of the log (axes=y-up)"),
    (
        "toss",
        "gravity downside up",
        lambda scene, one: (dataclasses.replace(scene, gravity=(0, 0, 9.81)), one),
        "fall along",
    ),
    (
        "push",
        "gravity downside up",
        lambda scene, one: (dataclasses.replace(scene, gravity=(0, 0, 9.81)), one),
        "points away from the ground, whose normal is (0.00, 0.00, 1.00): nothing could lie on it -> correct the sign",
    ),
    ("push", "left-handed poses", posed(mirrored), "left-handed frame -> import with the axes of the log"),
    (
        "push",
        "forces of a left-handed frame",
        forced(lambda force: force * [1, 1, 1, 1, -1, 1]),
        "force=[fx, -fy, fz] if only these are mirrored",
    ),
    ("push", "x and y swapped", posed(lambda pose: pose[..., [1, 0, *range(2, 7)]]), "force=[fy, fx, fz]"),
    ("push", "x and z swapped", posed(lambda pose: pose[..., [2, 1, 0, *range(3, 7)]]), "axes=x-up"),
    (
        "toss",
        "frames per second",
        lambda scene, one: (dataclasses.replace(scene, time_step=scene.time_step / 4), one),
        "the frame rate seems to be 4 times the true one -> import with the rate at which it was recorded (rate): 0.25",
    ),
    (
        "push",
        "forces in the axes of the body",
        lambda scene, one: (
            scene,
            dataclasses.replace(
                one,
                wrench=np.concatenate(
                    [
                        Rotation.from_quat(one.pose[: len(one.wrench), 0, 3:]).inv().apply(one.wrench[:, 0, part])
                        for part in (slice(0, 3), slice(3, 6))
                    ],
                    1,
                )[:, None],
            ),
        ),
        "turned with the body they would",
    ),
    ("push", "pounds of force", forced(lambda force: force / 4.44822), "in lbf -> import with units.force=lbf"),
    (
        "push",
        "x and y swapped, a mirror",
        posed(lambda pose: pose[..., [1, 0, *range(2, 7)]]),
        "that mirrors them: if the positions are what was exchanged, turn these",
    ),
    (
        "push",
        "a filter that looks back",
        forced(lambda force: np.roll(force, -12, 0)),
        "no filter of the poses, as one does that looks back",
    ),
    (
        "push",
        "half edges for edges",
        lambda scene, one: (_sized(scene, 0.5), one),
        "mm above the ground -> check ground.offset, size",
    ),
    ("toss", "edges twice as long", lambda scene, one: (_sized(scene, 2.0), one), "below the ground -> check"),
    ("push", "reaction", forced(lambda force: -force), "point against the forces"),
    (
        "push",
        "forces in other axes",
        forced(lambda force: force[..., [0, 1, 2, 4, 3, 5]]),
        "import forces as force=[fy, fx, fz]",
    ),
    (
        "push",
        "millinewtons",
        forced(lambda force: force * 1000),
        "in mN -> import with units.force=mN",
    ),
    (
        "push",
        "late forces",
        forced(lambda force: np.roll(force, -12, 0)),
        "the two clocks seem to differ -> import with forces.offset=0.0",
    ),
    (
        "push",
        "no forces",
        lambda scene, one: (scene, dataclasses.replace(one, wrench=None)),
        "energy comes from nowhere",
    ),
    ("push", "spikes", posed(spikes), "expected poses of a motion, found jumps: 14 % leave"),
    ("push", "a slow tracker", posed(halved), "the log is faster than the tracker"),
    ("push", "held poses", posed(held), "frames 60 to 89"),
    ("push", "z down", posed(upside_down), "up seems to be -z -> import with the axes of the log (axes=z-down)"),
    ("push", "w first", posed(w_first), "order: wxyz (w stands first)"),
    ("push", "grams", in_grams, "more than any matter does: its mass seems to be in grams -> import with units.mass=g"),
    ("push", "another ground", posed(sunk), "mm above the ground -> check ground.offset"),
    ("push", "a table", posed(on_a_table), "seems to be 742 mm higher -> import with ground.offset=0.74"),
    (
        "push",
        "nothing moves",
        posed(lambda pose: np.repeat(pose[:1], len(pose), 0)),
        "found none that goes further than 0.0 mm in 6 of 6 trajectories (the first is 0)",
    ),
    ("toss", "degrees", posed(turning), "angles in degrees read as radians"),
    (
        "push",
        "sizes in millimetres",
        lambda scene, one: (scene.with_bodies([dataclasses.replace(scene.bodies[0], size=(300, 250, 200))]), one),
        "sizes seem to be in millimetres",
    ),
    (
        "push",
        "sizes in centimetres",
        lambda scene, one: (scene.with_bodies([dataclasses.replace(scene.bodies[0], size=(30, 25, 20))]), one),
        "sizes seem to be in centimetres",
    ),
]


@pytest.mark.parametrize(
    ("name", "change", "message"), [(a, c, d) for a, _, c, d in MISTAKES], ids=[f"{a}: {b}" for a, b, _, _ in MISTAKES]
)
def test_a_mistake_is_found_with_its_mend(tmp_path: Path, name: str, change: Change, message: str) -> None:
    scene, recordings = recorded(name)
    changed = [change(scene, one) for one in recordings]
    found = said(tmp_path, changed[0][0], [one for _, one in changed])
    assert any(message in one for one in found), found


def test_on_a_table_above_the_ground_nothing_else_is_said_to_be_wrong(tmp_path: Path) -> None:
    scene, recordings = recorded("push")
    change = posed(on_a_table)
    (only,) = said(tmp_path, scene, [change(scene, one)[1] for one in recordings])
    assert "touch no ground" in only


@pytest.mark.slow
@pytest.mark.parametrize(("sign", "offset"), [(1, [-0.2]), (-1, [])])
def test_forces_so_late_that_they_point_against_accelerations_are_late_and_not_of_another_sign(
    tmp_path: Path, sign: int, offset: list[float]
) -> None:
    words = {"simulator": "mujoco", "frame_rate": 60.0, "trajectories": 8, "steps": 90}

    def late(_: int, one: Recording) -> Recording:
        assert one.wrench is not None
        return dataclasses.replace(one, wrench=np.roll(one.wrench, 12, 0) if sign > 0 else -one.wrench)

    spoilt = rewritten(generated(tmp_path / "set", **words), tmp_path / "late", late)
    found = [one.mend for one in inspect(RecordingSet(spoilt)).findings]
    assert offsets(found) == pytest.approx(offset, abs=4e-3)
    assert sum("other sign" in one for one in found) == (sign < 0)


def test_a_clock_that_was_shifted_already_is_to_be_shifted_by_both_in_sets_of_films_too(tmp_path: Path) -> None:
    scene, several = recorded("push")
    late = [dataclasses.replace(one, wrench=np.roll(one.wrench, -12, 0)) for one in several]
    (plain,) = offsets(said(tmp_path / "plain", scene, late))
    shifted, read = (write_set(tmp_path / name, late, scene) for name in ("shifted", "read"))
    (shifted / "import.yaml").write_text("forces: {offset: -3.2}\n")
    write_reading(read, Reading(str(shifted), "", "planar", 0.0, 0.0, "", seen=checksum_of_files(shifted)))
    for folder in (shifted, read):
        report = inspect(RecordingSet(folder))
        assert offsets([one.mend for one in report.findings]) == [pytest.approx(plain - 3.2, abs=2e-3)]


@pytest.mark.parametrize("stamped", [False, True])
@pytest.mark.parametrize("name", ["push", "slide", "collide", "toss"])
def test_frames_that_were_never_logged_are_noticed_where_no_stamps_tell_of_them(
    name: str, stamped: bool, tmp_path: Path
) -> None:
    scene, several = recorded(name)
    kept = []
    for index, one in enumerate(several):
        keep = np.random.default_rng(index).random(one.length) > 0.05
        assert one.pose is not None
        assert one.wrench is not None
        time = scene.time_step * np.flatnonzero(keep) if stamped else None
        kept.append(dataclasses.replace(one, pose=one.pose[keep], wrench=one.wrench[keep], time=time))
    found = [one for one in said(tmp_path / "set", scene, kept) if "frames seem to be missing" in one]
    assert len(found) == (not stamped)
    assert all("give each missing frame an empty row" in one for one in found)


def offsets(mends: list[str]) -> list[float]:
    """Return the offsets of the clock of the forces that mends name [s]."""
    return [float(one) for mend in mends for one in re.findall(r"forces.offset=(-?[0-9.]+),", mend)]


@pytest.mark.slow
@pytest.mark.parametrize("rate", [60.0, 30.0])
def test_a_clock_is_off_by_as_much_as_check_says_though_forces_change_slowly(tmp_path: Path, rate: float) -> None:
    words = {"simulator": "mujoco", "frame_rate": rate, "trajectories": 10, "steps": int(1.5 * rate)}
    exact = generated(tmp_path / "set", **words)
    for late in (0.0, 0.023, -0.023):

        def shifted(_: int, one: Recording, late: float = late) -> Recording:
            return dataclasses.replace(one, wrench_time=one.wrench_stamps(1 / rate) + late)

        spoilt = rewritten(exact, tmp_path / f"late {late}", shifted)
        found = offsets([one.mend for one in inspect(RecordingSet(spoilt)).findings])
        assert found == pytest.approx([-late] * bool(late), abs=2e-3)


@pytest.mark.parametrize("shift", [0.0, 0.02, -0.05])
def test_forces_are_smoothed_as_the_accelerations_that_they_cause(shift: float) -> None:
    """Held forces move a free body along pieces of parabolas; stamps of poses are uneven, and forces have their own."""
    generator = np.random.default_rng(0)
    scene = dataclasses.replace(find_setup("push").scene, gravity=(0.0, 0.0, 0.0))
    mass, start = scene.bodies[0].mass, np.sort(generator.uniform(0, 1, 40))
    force = generator.normal(size=(40, 3))
    time = np.arange(90) / 60 + generator.uniform(-0.002, 0.002, 90)
    since = np.maximum(time[:, None] - start - shift, 0)
    change = np.diff(force, axis=0, prepend=0.0)
    pose = np.zeros((90, 1, 7))
    pose[:, 0, :3], pose[..., 6] = 0.5 * since**2 @ change / mass, 1.0
    wrench = np.concatenate([np.zeros((40, 1, 3)), force[:, None]], -1)
    one = Recording(pose=pose, wrench=wrench, time=time, wrench_time=start)
    scene = dataclasses.replace(scene, time_step=1 / 60)
    expected = mass * kinematics_of([one], scene, 7).acceleration
    (found,) = shifted_forces(one, scene, 0, 7, np.array([shift]))
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("tare", [0.0, 0.3, 1.0])
def test_a_constant_vertical_force_is_a_remark_and_the_weight_is_named(tmp_path: Path, tare: float) -> None:
    scene, recordings = recorded("push")
    extra = np.append(np.zeros(3), tare * scene.bodies[0].mass * np.array(scene.gravity))
    folder = write_set(tmp_path, [forced(lambda force: force + extra)(scene, one)[1] for one in recordings], scene)
    report = inspect(RecordingSet(folder))
    named = [one.what for one in report.findings if "tared" in one.what]
    assert report.sound
    assert len(named) == (tare > 0)
    assert all(("as much as the body weighs" in one) == (tare == 1) for one in named)


def test_one_run_of_another_unit_is_named_by_its_number(tmp_path: Path) -> None:
    scene, recordings = recorded("push")
    mixed = [posed(lambda p: p * ([1e-3] * 3 + [1] * 4))(scene, one)[1] if n == 3 else one
             for n, one in enumerate(recordings)]  # fmt: skip
    found = said(tmp_path, scene, mixed)
    assert len([one for one in found if "in 1 of 6 trajectories (the first is 3)" in one and "metres" in one]) == 1


@pytest.mark.slow
@pytest.mark.parametrize("newtons", [1.0, 1e3])
@pytest.mark.parametrize(("scale", "unit"), [(1e2, "centimetres"), (1e3, "millimetres"), (39.37, "inches")])
def test_positions_in_another_unit_are_named_whatever_that_of_the_forces_is(
    tmp_path: Path, scale: float, unit: str, newtons: float
) -> None:
    scene, recordings = recorded("push")
    scaled = [posed(lambda p: p * ([scale] * 3 + [1] * 4))(scene, one)[1] for one in recordings]
    found = said(tmp_path, scene, [forced(lambda force: newtons * force)(scene, one)[1] for one in scaled])
    assert any(f"positions seem to be in {unit} -> import with the unit of the log" in one for one in found), found
    assert any("units.force=mN" in one for one in found) == (newtons > 1), "what else is wrong is said of metres"
    assert not any("slides in 0 frames" in one for one in found)


@pytest.mark.parametrize("over", [9.9, 38.37, 99.0])
def test_a_small_block_on_a_table_is_in_metres_though_it_would_touch_the_ground_in_another_unit(
    tmp_path: Path, over: float
) -> None:
    """A table is as high as hundred blocks half are: that alone says nothing of the unit."""
    scene, recordings = recorded("push")
    height = over * scene.bodies[0].size[2] / 2
    raised = [posed(lambda pose: pose + np.eye(7)[2] * height)(scene, one)[1] for one in recordings]
    found = said(tmp_path, scene, raised)
    assert not any("positions seem to be" in one for one in found)


def test_heights_that_are_noise_about_the_origin_are_of_no_unit(tmp_path: Path) -> None:
    scene, recordings = recorded("push")
    height = scene.bodies[0].size[2] / 2
    origin = dataclasses.replace(scene, ground=Ground(offset=-height))
    about = [1e-4, 1e-4, 1e-7, 1e-4, 1e-1 * NOISE, 1e-4]
    moved = list[Recording]()
    for one, offset in zip(recordings, about, strict=True):
        assert one.pose is not None
        pose = one.pose.copy()
        pose[..., 2] += offset - np.median(pose[..., 2])
        moved.append(dataclasses.replace(one, pose=pose))
    assert not said(tmp_path, origin, moved)


@pytest.mark.parametrize("every", [2, 4, 10])
def test_a_log_that_is_faster_than_the_tracker_is_no_lost_body(tmp_path: Path, every: int) -> None:
    scene, recordings = recorded("push")
    slow = [posed(lambda pose: pose[np.arange(len(pose)) // every * every])(scene, one)[1] for one in recordings]
    found = said(tmp_path, scene, slow)
    assert [one for one in found if "the log is faster than the tracker" in one]
    assert not [one for one in found if "catches up" in one]


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 1.5, 2.0, 3.0])
def test_pushes_as_strong_as_gravity_are_no_falls(tmp_path: Path, factor: float) -> None:
    """Positions alone have x for z, so that no other axis makes the bodies touch; clocks set how fast they get."""
    scene, recordings = recorded("push")
    clock = dataclasses.replace(scene, time_step=scene.time_step / factor)
    swapped = posed(lambda pose: pose[..., [2, 1, 0, *range(3, 7)]])
    found = said(tmp_path, clock, [swapped(scene, one)[1] for one in recordings])
    assert [one for one in found if "axes=x-up" in one], found


def test_forces_that_follow_nothing_name_no_offset_of_the_clocks(tmp_path: Path) -> None:
    scene, recordings = recorded("push")
    others = [dataclasses.replace(one, wrench=recordings[n - 1].wrench) for n, one in enumerate(recordings)]
    assert not [one for one in said(tmp_path, scene, others) if "forces.offset" in one]


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.25, 0.5, 2.0, 4.0])
def test_a_film_at_another_rate_beside_forces_with_stamps_is_no_left_handed_frame_and_no_offset(
    tmp_path: Path, factor: float
) -> None:
    """Accelerations follow the forces of other moments; axes and offsets that seem to fit are accidents."""
    scene, recordings = recorded("push")
    clock, step = dataclasses.replace(scene, time_step=scene.time_step / factor), scene.time_step
    stamped = [dataclasses.replace(one, wrench_time=step * np.arange(len(one.seen))) for one in recordings]
    found = said(tmp_path, clock, stamped)
    assert not [one for one in found if "left-handed" in one or "forces.offset" in one or "force=[" in one], found


@pytest.mark.parametrize(("factor", "noted"), [(0.5, True), (0.8, False), (1.0, False), (1.2, False), (2.0, True)])
def test_poses_without_stamps_that_are_much_longer_than_their_forces_are_a_remark(
    tmp_path: Path, factor: float, noted: bool
) -> None:
    scene, recordings = recorded("push")
    clock, step = dataclasses.replace(scene, time_step=scene.time_step / factor), scene.time_step
    stamped = [dataclasses.replace(one, wrench_time=step * np.arange(len(one.seen))) for one in recordings]
    report = inspect(RecordingSet(write_set(tmp_path, stamped, clock)))
    named = [one for one in report.findings if "the true rate is 24" in one.what]
    assert len(named) == noted
    assert not any(one.wrong for one in named)


def test_a_body_that_lies_still_to_the_last_digit_and_is_pushed_then_was_not_held(tmp_path: Path) -> None:
    scene, recordings = recorded("push")
    rests = []
    for one in recordings:
        assert one.pose is not None
        rests.append(dataclasses.replace(one, pose=np.concatenate([np.repeat(one.pose[:1], 50, 0), one.pose[:-50]])))
    assert not [one for one in said(tmp_path, scene, rests) if "catches up" in one]


@pytest.mark.parametrize("factor", [0.5, 0.9, 1.2, 2.0])
def test_a_wrong_rate_of_pushed_bodies_of_known_mass_is_named_with_the_one_that_fits(
    tmp_path: Path, factor: float
) -> None:
    """Forces stand in the rows of the poses; a clock that is off by less than a factor of 1.4 is not accused."""
    scene, recordings = recorded("push")
    clock = dataclasses.replace(scene, time_step=scene.time_step / factor)
    found = [one for one in said(tmp_path, clock, list(recordings)) if "frame rate" in one]
    assert len(found) == (factor in (0.5, 2.0))
    for one in found:
        named = re.search(r"rate=([\d.]+) would fit", one)
        assert named is not None
        assert float(named[1]) == pytest.approx(240, rel=0.02)


@pytest.mark.parametrize("known", [True, False])
def test_a_mass_that_is_a_first_guess_says_nothing_of_the_clock(tmp_path: Path, known: bool) -> None:
    scene, recordings = recorded("push")
    heavy = scene.with_bodies([dataclasses.replace(scene.bodies[0], mass=3 * scene.bodies[0].mass)])
    heavy = dataclasses.replace(heavy, unknown=() if known else (f"{heavy.bodies[0].name}.mass",))
    assert bool([one for one in said(tmp_path, heavy, list(recordings)) if "frame rate" in one]) == known


@pytest.mark.slow
@pytest.mark.parametrize("right", ["y-up", "y-down", "x-up", "z-down"])
@pytest.mark.parametrize("taken", ["z-up", "y-up", "x-up", "y-down", "z-down"])
def test_the_axes_of_a_log_are_named_whatever_axes_it_was_imported_with(tmp_path: Path, right: str, taken: str) -> None:
    """The forces at which blocks move as fast as they would fall are no falls."""
    scene, recordings = recorded("push")
    turn = axes_of(taken) @ axes_of(right).T
    change = Rotation.from_matrix(turn)
    turned = []
    for one in recordings:
        assert one.pose is not None
        assert one.wrench is not None
        way = (change * Rotation.from_quat(one.pose[..., 3:].reshape(-1, 4))).as_quat().reshape(*one.pose.shape[:2], 4)
        pose, wrench = np.concatenate([one.pose[..., :3] @ turn.T, way], -1), one.wrench.reshape(-1, 3) @ turn.T
        turned.append(dataclasses.replace(one, pose=pose, wrench=wrench.reshape(one.wrench.shape)))
    (tmp_path / "import.yaml").write_text(f"axes: {taken}\nforce: [Fa, Fb, Fc]\n")
    found = said(tmp_path, scene, turned)
    if right == taken:
        assert not found
    else:
        assert len([one for one in found if one.endswith(f"import with the axes of the log (axes={right})")]) == 1, (
            found
        )


@pytest.mark.parametrize(
    "said_of", ["order: wxyz", "quaternion: [a_w, a_x, a_y, a_z]", "bodies: [{quaternion: [qw, qx, qy, qz]}]"]
)
def test_quaternions_with_w_last_that_were_read_with_w_first_are_named(tmp_path: Path, said_of: str) -> None:
    scene, recordings = recorded("push")
    last = posed(lambda pose: pose[..., [0, 1, 2, 4, 5, 6, 3]])
    (tmp_path / "import.yaml").write_text(f"{said_of}\n")
    found = said(tmp_path, scene, [last(scene, one)[1] for one in recordings])
    assert [one for one in found if "order: xyzw (w stands last)" in one], found


def test_columns_of_forces_that_are_exchanged_are_named_as_the_log_has_them(tmp_path: Path) -> None:
    """The log has y up, and its columns Fz and Fx were listed the wrong way round."""
    scene, recordings = recorded("push")
    axes = axes_of("y-up")
    exchange = axes @ np.eye(3)[[2, 1, 0]] @ axes.T
    wrong = forced(lambda force: np.concatenate([force[..., :3], force[..., 3:] @ exchange.T], -1))
    for mapping, mended in (
        ("force: [Fz, -Fy, Fx]", "force=[Fx, -Fy, Fz]"),
        ("bodies: [{force: [Fz, -Fy, Fx]}]", "force=[Fx, -Fy, Fz]"),
        ("force: hand/wrench", "force=[hand/wrench/z, hand/wrench/y, hand/wrench/x]"),
        ("force: [pushed]", "force=['pushed[2]', 'pushed[1]', 'pushed[0]']"),
    ):
        (tmp_path / "import.yaml").write_text(f"axes: y-up\n{mapping}\n")
        found = said(tmp_path, scene, [wrong(scene, one)[1] for one in recordings])
        assert [one for one in found if f"import forces as {mended}, in the axes of the poses" in one], found


def test_a_set_with_a_mistake_exits_with_1_and_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, recordings = recorded("push")
    write_set(tmp_path, [forced(lambda force: -force)(scene, one)[1] for one in recordings], scene)
    assert main(["check", str(tmp_path)]) == 1
    told = capsys.readouterr()
    assert "wrong?" in told.out
    assert "mend" in told.out
    assert "1 thing to mend" in told.err


def test_a_damaged_trajectory_is_named_beside_the_sound_ones(tmp_path: Path) -> None:
    scene, recordings = recorded("push")
    folder = write_set(tmp_path, list(recordings), scene)
    (folder / "trajectories" / "000002.h5").write_bytes(b"nothing")
    found = inspect(RecordingSet(folder)).findings
    assert len(found) == 2, "it cannot be read, and does not fit its checksum"
    assert found[1].what.startswith("000002.h5: missing, or not as written")
    assert "000002.h5: expected an HDF5 file" in found[0].what


def test_a_tilted_ground_is_no_mistake(tmp_path: Path) -> None:
    scene, recordings = recorded("slide")
    assert scene.ground != Ground()
    assert not said(tmp_path, scene, list(recordings))


@pytest.mark.parametrize("late", [0, 3])
def test_friction_at_a_camera_s_rate_is_no_late_clock_and_a_late_clock_is_found(tmp_path: Path, late: int) -> None:
    """Dry friction turns round after the force has: at 30 frames a second that is no reason to suspect the clock."""
    scene, rate, fine, friction = recorded("push")[0], 30, 3000, 0.21
    body = scene.bodies[0]
    assert body.mass > 0
    found = []
    for index in range(SOME):
        generator = np.random.default_rng(index)
        size = 2 * friction * 9.81 * generator.uniform(0.3, 1.0, 12)
        direction = np.array([[1, 0.3], [-1, 0.2], [-0.4, -1], [0.8, 0.7]])[np.arange(12) // 2 % 4]
        push = np.repeat(size[:, None] * direction, fine // 4, 0)
        place, speed, path = np.zeros(2), np.zeros(2), []
        for acceleration in push:
            path.append(place)
            free = speed + acceleration / fine
            speed = free * max(0.0, 1 - friction * 9.81 / fine / max(float(np.hypot(*free)), 1e-12))
            place = place + speed / fine
        pose = np.zeros((90, 1, 7))
        pose[:, 0, :2], pose[:, 0, 2], pose[:, 0, 6] = path[:: fine // rate], body.size[2] / 2, 1.0
        wrench = np.zeros((90, 1, 6))
        wrench[:, 0, 3:5] = body.mass * push[:: fine // rate]
        found.append(Recording(pose=pose, wrench=np.roll(wrench, -late, 0)))
    clocks = [one for one in said(tmp_path, dataclasses.replace(scene, time_step=1 / rate), found) if "clocks" in one]
    assert len(clocks) == bool(late)
    assert offsets(clocks) == pytest.approx([late / rate] * bool(late), abs=1 / (3 * rate))


def test_the_noise_is_told_whatever_frames_are_lost_or_wild(tmp_path: Path) -> None:
    scene, recordings = recorded("push")
    disturbed, short = list[Recording](), list[Recording]()
    for number, one in enumerate(recordings):
        assert one.pose is not None
        assert one.wrench is not None
        pose = one.pose.copy()
        pose[np.random.default_rng(number).random(len(pose)) < 0.05] = np.nan
        pose[20::30, :, 0] += 0.3
        disturbed.append(dataclasses.replace(one, pose=pose))
        short.append(dataclasses.replace(one, pose=one.pose[:3], wrench=one.wrench[:3]))
    noise = noise_of(disturbed, scene.time_step)
    assert noise.position == pytest.approx(NOISE, rel=0.05)
    assert noise.rotation == pytest.approx(2 * NOISE, rel=0.05)
    assert "too little to tell" in inspect(RecordingSet(write_set(tmp_path, short, scene))).text()


def _weighing(scene: Scene, factor: float, *unknown: str) -> Scene:
    (body,) = scene.bodies
    return dataclasses.replace(scene, bodies=(dataclasses.replace(body, mass=factor * body.mass),), unknown=unknown)


@pytest.mark.parametrize(("factor", "pushed"), [(0.15, True), (1.0, True), (6.0, True), (1.0, False)])
def test_energy_comes_from_nowhere_where_no_mass_or_the_given_one_does_not_explain_it(
    tmp_path: Path, factor: float, pushed: bool
) -> None:
    scene, recordings = recorded("push")
    made = [one if pushed else dataclasses.replace(one, wrench=None) for one in recordings]
    for unknown, nowhere in (("block.mass", not pushed), ("block.friction", not pushed or factor != 1)):
        report = inspect(RecordingSet(write_set(tmp_path / unknown, made, _weighing(scene, factor, unknown))))
        assert any("energy comes from nowhere" in one.what for one in report.findings) is nowhere


def test_the_energy_of_several_bodies_is_theirs_together(tmp_path: Path) -> None:
    scene, recordings = recorded("collide")
    report = inspect(RecordingSet(write_set(tmp_path, list(recordings), scene)))
    said = next(what for name, what in report.facts if name == "energy")
    first, last, most = (float(one) for one in re.findall(r"([\d.e+-]+) J", said))
    assert most >= max(first, last)


def moving(pose: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    """Move a block along at 3 m/s beside all else, so that it never lies still."""
    pose[..., 0] += 3.0 * np.arange(len(pose))[:, None] / 240
    return pose


@pytest.mark.parametrize(("change", "does"), [(posed(lambda pose: pose), "lie still"), (posed(moving), "move along")])
@pytest.mark.parametrize(("off", "where"), [(-0.012, "below"), (0.012, "above")])
def test_a_block_that_is_off_the_ground_is_no_block_that_does_not_slide(
    tmp_path: Path, off: float, where: str, change: Change, does: str
) -> None:
    scene, recordings = recorded("push")
    scene = dataclasses.replace(scene, unknown=("block.friction",), ground=Ground(offset=-off))
    found = said(tmp_path, scene, [change(scene, one)[1] for one in recordings])
    said_so = [
        float(at[1]) for one in found if (at := re.match(rf"bodies {does} .* ([\d.]+) mm {where} the ground", one))
    ]
    assert said_so == [pytest.approx(12, abs=0.5)], found
    assert not any("slides in 0 frames" in one for one in found)


@pytest.mark.parametrize("factor", [1e-3, 1.0])
def test_forces_too_small_to_show_a_mass_are_said_to_be_so(tmp_path: Path, factor: float) -> None:
    scene, recordings = recorded("push")
    scene = dataclasses.replace(scene, unknown=("block.mass",))
    _, weak = zip(*(forced(lambda wrench: wrench * factor)(scene, one) for one in recordings), strict=True)
    found = said(tmp_path, scene, list(weak))
    assert any("too small to show block.mass -> check units.force" in one for one in found) == (factor < 1)


def test_the_unit_of_forces_is_that_of_the_log_and_not_of_what_was_imported(tmp_path: Path) -> None:
    """Newtons that were imported as kN are a thousand times too large: the log is in N, not in mN."""
    scene, recordings = recorded("push")
    _, large = zip(*(forced(lambda wrench: wrench * 1e3)(scene, one) for one in recordings), strict=True)
    folder = write_set(tmp_path, list(large), scene)
    assert any("seem to be in mN" in one.what for one in inspect(RecordingSet(folder)).findings)
    (folder / "import.yaml").write_text("units: {force: kN}\n")
    found = [f"{one.what} -> {one.mend}" for one in inspect(RecordingSet(folder)).findings if one.wrong]
    assert any("seem to be in N -> import with units.force=N" in one for one in found), found


def test_stamps_in_another_unit_are_not_positions_in_millimetres(tmp_path: Path) -> None:
    scene, recordings = recorded("toss")
    found = said(tmp_path, dataclasses.replace(scene, time_step=scene.time_step / 1e3), list(recordings))
    assert any("stamps seem to be in another unit -> import with units.time" in one for one in found), found
    assert not any("millimetres" in one for one in found)


@pytest.mark.parametrize(
    ("share", "mend"),
    [(0.0993, "10 times too small, as centimetres read as millimetres"), (0.0394, "25.4 times too small, as inches"),
     (0.25, "the frame rate seems to be 0.5 times the true one"), (1.0, "")],
)  # fmt: skip
def test_straight_falls_that_a_unit_explains_are_of_that_unit_before_another_rate(share: float, mend: str) -> None:
    generator, gravity = np.random.default_rng(0), np.array([0.0, 0.0, -9.81])
    acceleration = share * gravity * (1 + 0.02 * generator.standard_normal((100, 1)))
    found = clock_of_falls(acceleration, gravity, 20)
    assert mend in (found.what if found else "")
    assert bool(found) is bool(mend)


def twisted(seed: int) -> Recording:
    """Turn a block of 1 kg on a table by torques about the vertical, J w' = t - c w / |w|, at 120 frames per second."""
    generator = np.random.default_rng(seed)
    time, inner = np.arange(240) / 120, 20
    fine = np.arange(240 * inner) / (120 * inner)
    torque = 0.05 * np.sin(2 * np.pi * fine * generator.uniform(0.6, 1.2) + generator.uniform(0, 6))
    inertia, friction, spin, angle, angles = (0.16**2 + 0.12**2) / 12, 0.015, 0.0, generator.uniform(-3, 3), []
    for one in torque:
        moved = spin + (one / inertia) / (120 * inner)
        spin = np.sign(moved) * max(abs(moved) - friction / inertia / (120 * inner), 0.0)
        angle += spin / (120 * inner)
        angles.append(angle)
    turn = Rotation.from_rotvec(np.array(angles)[::inner, None] * [0, 0, 1])
    turn = Rotation.from_rotvec(1e-3 * generator.normal(size=(240, 3))) * turn
    place = np.array([0, 0, 0.04]) + 2e-4 * generator.normal(size=(240, 3))
    wrench = np.zeros((240, 1, 6))
    wrench[:, 0, 2] = torque.reshape(240, inner).mean(1)
    pose = np.concatenate([place, turn.as_quat()], 1)[:, None]
    return Recording(pose=pose, wrench=wrench, time=time)


def torqued(factor: float) -> Change:
    """Give torques in another unit."""
    return forced(lambda wrench: wrench * [factor, factor, factor, 1, 1, 1])


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False], ids=["a known mass", "a first guess"])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (torqued(1.0), None),
        (posed(inverse), "bodies turn against the torques (correlation -0.9"),
        (torqued(-1.0), "or with the other sign of the torque"),
        (torqued(1e3), "torques seem to be in N mm -> import with units.torque=N mm"),
        (torqued(1e-3), "torques seem to be in kN m -> import with units.torque=kN m"),
        (torqued(2.0), None),
    ],
    ids=["sound", "inverse rotations", "the other sign", "N mm", "kN m", "another size"],
)
def test_torques_that_a_block_on_a_table_does_not_follow_are_named(
    tmp_path: Path, change: Change, message: str | None, known: bool
) -> None:
    scene = dataclasses.replace(find_setup("push").scene, camera=None, time_step=1 / 120)
    body = dataclasses.replace(scene.bodies[0], size=(0.16, 0.12, 0.08), mass=1.0)
    scene = dataclasses.replace(scene.with_bodies([body]), unknown=() if known else ("block.mass",))
    found = said(tmp_path, scene, [change(scene, twisted(seed))[1] for seed in range(6)])
    spoken = [one for one in found if "torque" in one]
    assert not spoken if message is None else any(message in one for one in spoken), found
    beside = [change(scene, one)[1] if seed == 3 else one for seed, one in enumerate(map(twisted, range(6)))]
    spoken = [one for one in said(tmp_path / "one", scene, beside) if "torque" in one]
    assert [one.startswith("in trajectory 3 alone ") for one in spoken] == [True] * (message is not None), spoken


@pytest.mark.parametrize("known", [True, False], ids=["a known mass", "a first guess"])
@pytest.mark.parametrize(
    ("factor", "message"),
    [
        (1.0, None),
        (
            1 / 9.80665,
            "beside the force as in the others: forces seem to be in kgf -> correct these, or leave them out",
        ),
        (1e3, "forces seem to be in mN"),
        (4.448, "beside the force as in the others: these forces, or this body, are others"),
        (-1.0, "bodies accelerate against the forces: they have the other sign"),
        (0.5, None),
    ],
    ids=["sound", "kgf", "mN", "pounds for newtons", "the other sign", "another mass"],
)
def test_one_trajectory_whose_forces_are_in_another_unit_is_named(
    tmp_path: Path, factor: float, message: str | None, known: bool
) -> None:
    scene, recordings = recorded("push")
    scene = dataclasses.replace(scene, unknown=() if known else ("block.mass",))
    changed = [
        forced(lambda force: factor * force)(scene, one)[1] if k == 2 else one for k, one in enumerate(recordings)
    ]
    found = [one for one in said(tmp_path, scene, changed) if "alone" in one]
    assert not found if message is None else len(found) == 1 and message in found[0], found
    assert all(one.startswith("in trajectory 2 alone ") for one in found)


def test_of_two_trajectories_with_different_mistakes_one_kind_is_named(tmp_path: Path) -> None:
    scene = dataclasses.replace(find_setup("push").scene, camera=None, time_step=1 / 120)
    scene = scene.with_bodies([dataclasses.replace(scene.bodies[0], size=(0.16, 0.12, 0.08), mass=1.0)])
    for factors, named in (({2: -1.0, 5: 1e3}, "in trajectory 2 alone bodies turn against"), ({2: 0.1, 5: 1e3}, "2")):
        changed = [torqued(factors.get(seed, 1.0))(scene, twisted(seed))[1] for seed in range(10)]
        (found,) = [one for one in said(tmp_path / named[:8].strip(), scene, changed) if "torque" in one]
        assert found.startswith(named if len(named) > 1 else "in trajectory 2 alone inertia times"), found


@pytest.mark.parametrize("known", [True, False], ids=["given", "of a box"])
def test_torques_are_judged_by_the_inertia_that_is_given(tmp_path: Path, known: bool) -> None:
    scene = dataclasses.replace(find_setup("push").scene, camera=None, time_step=1 / 120)
    moments = tuple(np.array([0.08**2 + 0.12**2, 0.08**2 + 0.16**2, 0.12**2 + 0.16**2]) / 12)
    body = dataclasses.replace(scene.bodies[0], size=(0.5, 0.4, 0.08), mass=1.0, inertia=moments if known else None)
    scene = dataclasses.replace(scene.with_bodies([body]), unknown=())
    found = [one for one in said(tmp_path, scene, list(map(twisted, range(6)))) if "torque" in one]
    assert bool(found) is not known, found


def test_columns_of_inverse_rotations_are_named_as_the_log_has_them() -> None:
    assert Origin(order="wxyz", quaternion=("q0", "-q1", "q2", "q3")).inverse() == "quaternion=[q0, q1, -q2, -q3]"
    assert Origin().inverse() == "quaternion=[-qx, -qy, -qz, qw]"
    array = Origin(order="wxyz", quaternion=tuple(f"q[{k}]" for k in range(4))).inverse()
    assert yaml.safe_load(array.removeprefix("quaternion=")) == ["q[0]", "-q[1]", "-q[2]", "-q[3]"]
    assert "q" not in Origin(mapped=True).inverse(), "a mapping of angles has no columns of a quaternion"
