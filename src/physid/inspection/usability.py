"""What recordings must be to conclude anything from them: `check` says it, `fit` and `diagnose` refuse others."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from physid.data import Recording
from physid.data.importers.units import UNITS
from physid.data.observations.trajectories import Trajectories
from physid.estimation.measurement import NoiseSettings, outlier_poses
from physid.inspection.finding import Finding
from physid.scenes import Scene
from physid.scenes.scene import GRAVITY
from physid.setting import Section, setting


class RequirementSettings(Section):
    """What recordings must be to be usable."""

    least_fitted: int = setting(3, "trajectories", "fewer leave no scatter from which an interval could come", ge=2)
    least_frames: int = setting(12, "frames", "of the longest trajectory", ge=3)
    still_rotation: float = setting(0.02, "rad", "turn below which nothing moves", ge=0)
    still_position: float = setting(0.005, "m", "way below which nothing moves", ge=0)
    fastest: float = setting(100.0, "m/s", "median speed beyond which it is the unit that is wrong", gt=0)
    quickest: float = setting(2e4, "Hz", "beyond which it is the unit of the stamps that is wrong", gt=0)
    farthest: float = setting(100.0, "largest edges", "median height beyond which it is the unit that is wrong", gt=0)
    slowest: float = setting(1.0, "s", "between frames, beyond which it is the unit that is wrong", gt=0)
    gravity: float = setting(0.02, "share", "by which gravity may be off that of the Earth in another unit", gt=0)
    most_outliers: float = setting(0.1, "share", "of stray poses that no robust fit survives", ge=0, le=1)
    rough: float = setting(0.2, "share", "of the whole motion by which poses may leave the middle of neighbours", gt=0)
    first_frames: int = setting(10, "frames", "at the beginning, in which a body lies still that is pushed later", ge=1)
    set_off: float = setting(0.02, "m", "way of a body from rest that takes a force", gt=0)
    level: float = setting(1e-3, "rad", "slope of the ground below which nothing slides by itself", gt=0)
    lying: float = setting(0.75, "largest edges", "height of a centre below which a body lies on the ground", gt=0)


DEFAULT, NOISE = RequirementSettings(), NoiseSettings()


@dataclass(frozen=True)
class Motion:
    """What bodies were seen to do, R trajectories of T frames.

    Attributes:
        scene: The scene.
        pose: Shape (R, T, N, 7); where a body was not seen, one of another frame.
        seen: Where a body was seen, shape (R, T, N).
        time: Times of the frames [s], shape (R, T).
        forced: Whether any force acts in a trajectory, shape (R,).
        indices: Number of each trajectory in its set.
    """

    scene: Scene
    pose: Tensor
    seen: Tensor
    time: Tensor
    forced: Tensor
    indices: tuple[int, ...]

    @classmethod
    def of(cls, scene: Scene, trajectories: Trajectories) -> Motion:
        """Take what was seen from trajectories of a set."""
        forced = (trajectories.grid.wrench != 0).flatten(1).any(1)
        return cls(scene, trajectories.pose, trajectories.seen, trajectories.time, forced, trajectories.index)

    @property
    def normal(self) -> Tensor:
        """Normal of the ground, shape (3,)."""
        return torch.tensor(self.scene.ground.normal, dtype=torch.float64)

    @property
    def height(self) -> Tensor:
        """Height of the centres over the ground [m], shape (R, T, N)."""
        return self.pose[..., :3] @ self.normal - self.scene.ground.offset

    @property
    def way(self) -> Tensor:
        """Way from the first pose [m], shape (R, T, N, 3)."""
        return self.pose[..., :3] - self.pose[:, :1, :, :3]


def require_usable(
    where: object,
    motion: Motion,
    settings: RequirementSettings = DEFAULT,
    noise: NoiseSettings = NOISE,
    *,
    least: tuple[float, float] | None = None,
) -> list[Finding]:
    """Refuse recordings from which nothing can be concluded.

    Args:
        where: Which set it is, as the message names it.
        motion: What was recorded.
        settings: What is required.
        noise: What an outlier is.
        least: Turn [rad] and way [m] below which nothing moves; None for what the settings say.

    Returns:
        What some trajectories alone have: remarks.

    Raises:
        ValueError: If units are evidently wrong, nothing moves, poses jump about, or forces are missing; the message
            says what was expected, what was found, and the remedy.
    """
    found = mistakes_in(motion, settings, noise, least)
    wrong = next((one for one in found if one.wrong), None)
    if wrong is not None:
        raise ValueError(f"{where}: {wrong.what}; {wrong.mend}")
    return found


def shows_motion(recording: Recording) -> bool:
    """Return whether every body was seen in more than one frame: of films, initial poses may be all that is known."""
    return recording.pose is not None and bool((recording.seen.sum(0) > 1).all())


def mistakes_in(
    motion: Motion,
    settings: RequirementSettings = DEFAULT,
    noise: NoiseSettings = NOISE,
    least: tuple[float, float] | None = None,
) -> list[Finding]:
    """Return what makes recordings useless, see `require_usable`; what some trajectories alone have is a remark."""
    rules: tuple[Callable[[], Finding | None], ...] = (
        lambda: _gravity(motion, settings),
        lambda: _time(motion, settings),
        lambda: _units(motion, settings),
        lambda: _copies(motion),
        lambda: _rest(motion, least or (settings.still_rotation, settings.still_position)),
        lambda: _jumps(motion, settings, noise),
        lambda: _missing_forces(motion, settings),
    )
    return [found for rule in rules if (found := rule()) is not None]


def too_few(trajectories: int, frames: int, settings: RequirementSettings = DEFAULT) -> Finding | None:
    """Fewer trajectories, or shorter ones, than intervals can be taken from.

    Args:
        trajectories: How many are fitted to.
        frames: Of the longest.
        settings: The least.
    """
    if trajectories >= settings.least_fitted and frames >= settings.least_frames:
        return None
    return Finding(
        f"expected at least {settings.least_fitted} trajectories to fit to, of {settings.least_frames} frames or more, "
        f"found {trajectories} of {frames} frames",
        "record more (24 trajectories of a second each are plenty); a log of many motions is cut by a column that "
        "numbers them: import with trajectory=COLUMN",
    )


def _gravity(motion: Motion, settings: RequirementSettings) -> Finding | None:
    """Gravity that is evidently not in m/s^2."""
    size, earth = math.hypot(*motion.scene.gravity), math.hypot(*GRAVITY)
    units = {f"{unit}/s^2": metres for unit, metres in UNITS["position"].items() if metres < 1} | {"g": earth}
    for unit, metres in units.items():
        if abs(size * metres / earth - 1) < settings.gravity:
            right = ", ".join(f"{value * metres:.4g}" for value in motion.scene.gravity)
            return Finding(
                f"gravity: expected m/s^2, found {size:g}, which is that of the Earth in {unit}",
                f"write gravity: [{right}] in recording.yaml",
            )
    return None


def _time(motion: Motion, settings: RequirementSettings) -> Finding | None:
    """Times that are evidently not in seconds."""
    step = motion.scene.time_step
    if step <= settings.slowest:
        return None
    return Finding(
        f"time_step: expected seconds between frames, found {step:g}: times seem to be in milliseconds",
        "import with units.time=ms, or divide time_step and the stamps by 1000",
    )


def _copies(motion: Motion) -> Finding | None:
    """Trajectories that hold the poses of another one to the last digit, which no second recording does."""
    first: dict[bytes, int] = {}
    copies = []
    for index, pose in zip(motion.indices, motion.pose, strict=True):
        if bool((pose != pose[:1]).any()):
            original = first.setdefault(pose.numpy().tobytes(), index)
            copies += [(index, original)] if original != index else []
    if not copies:
        return None
    return Finding(
        f"trajectory {copies[0][0]}: expected a recording of its own, found the poses of trajectory {copies[0][1]} to "
        f"the last digit ({len(copies)} of {len(motion.pose)} trajectories are copies)",
        "leave the copies out (trajectories of a transfer set are counted on from the first set): they make intervals "
        "too narrow, and what is held out is what was fitted",
    )


def _units(motion: Motion, settings: RequirementSettings) -> Finding | None:
    """Lengths that are evidently not in metres."""
    position, seen = motion.pose[..., :3], motion.seen.bool()
    both = seen[:, 1:] & seen[:, :-1]
    if not both.any():
        return None
    height = float(motion.height[seen].abs().median())
    speed = float((position[:, 1:] - position[:, :-1]).norm(dim=-1)[both].median()) / motion.scene.time_step
    largest = float(motion.scene.sizes.max())
    if height <= settings.farthest * largest and speed <= settings.fastest:
        return None
    if height <= settings.farthest * largest and 1 / motion.scene.time_step > settings.quickest:
        return Finding(
            f"expected stamps in seconds, found {1 / motion.scene.time_step:.4g} frames per second of bodies that move "
            f"at {speed:.4g} m/s: stamps seem to be in another unit",
            "import with units.time of the log (s, ms, us, ns), or with rate",
        )
    return Finding(
        f"expected poses in metres, found bodies of {largest:g} m at {height:.4g} m from the ground, moving at "
        f"{speed:.4g} m/s: positions seem to be in millimetres",
        "import with units.position=mm, or divide positions by 1000",
    )


def _rest(motion: Motion, least: tuple[float, float]) -> Finding | None:
    """Trajectories in which nothing moves; wrong if they are all."""
    pose = motion.pose
    turn = 2 * torch.acos((pose[..., 3:] * pose[:, :1, :, 3:]).sum(-1).abs().clamp_max(1)).amax((1, 2))
    way = motion.way.norm(dim=-1).amax((1, 2))
    still = ((turn < least[0]) & (way < least[1])).nonzero()[:, 0].tolist()
    if not still:
        return None
    return Finding(
        f"expected moving bodies, found none that goes further than {1000 * float(way[still].max()):.1f} mm in "
        f"{len(still)} of {len(pose)} trajectories (the first is {motion.indices[still[0]]})",
        "nothing can be learned from rest: push harder than friction holds, start with a velocity, or leave these out",
        wrong=len(still) == len(pose),
    )


def _jumps(motion: Motion, settings: RequirementSettings, noise: NoiseSettings) -> Finding | None:
    """Poses that jump about; a few do no harm, since fits leave them out."""
    position, seen = motion.pose[..., :3], motion.seen.bool()
    inside = seen[:, 1:-1] & seen[:, :-2] & seen[:, 2:]
    if not inside.any():
        return None
    stray = outlier_poses(motion.pose, motion.seen, motion.time, noise)
    bent = (position[:, 1:-1] - (position[:, :-2] + position[:, 2:]) / 2).norm(dim=-1)
    shown = torch.where(seen[..., None], position, 0.0)
    spread = (
        (position - shown.sum(1, keepdim=True) / seen.sum(1)[:, None, :, None].clamp_min(1)).norm(dim=-1)[seen].median()
    )
    rough, share = float(bent[inside].median()), float(stray[seen].double().mean())
    if share <= settings.most_outliers and rough <= max(settings.rough * float(spread), settings.still_position):
        return None
    return Finding(
        f"expected poses of a motion, found jumps: {100 * share:.0f} % leave their neighbours further than any motion "
        f"could, half of all by {1000 * rough:.1f} mm or more",
        "check the tracker and the order of the frames",
    )


def _missing_forces(motion: Motion, settings: RequirementSettings) -> Finding | None:
    """Bodies on level ground that set off by themselves; wrong if no trajectory of the set has a force."""
    scene, normal = motion.scene, motion.normal
    gravity = torch.tensor(scene.gravity, dtype=torch.float64)
    level = float(torch.linalg.cross(gravity, normal).norm()) < settings.level * float(gravity.norm())
    if not level or len(scene.bodies) > 1:
        return None
    flat = motion.way - (motion.way @ normal)[..., None] * normal
    lying = motion.height[:, 0].amax(-1) < settings.lying * float(scene.sizes.max())
    still = motion.way[:, : settings.first_frames].norm(dim=-1).amax((1, 2)) < settings.still_position  # nor falling
    moved = flat.norm(dim=-1).amax((1, 2)) > settings.set_off
    off = (lying & still & moved & ~motion.forced).nonzero()[:, 0].tolist()
    if not off:
        return None
    return Finding(
        f"trajectory {motion.indices[off[0]]}: expected the commanded forces, found none, yet a body sets off from "
        "rest on level ground",
        "import them (force=[...]), or add the dataset `wrench`",
        wrong=not bool(motion.forced.any()),
    )
