"""Where bodies are that do not fall: something must carry them, and in these recordings it is the ground."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.rotations import turned
from physid.inspection.evidence import FLOAT, Evidence
from physid.inspection.finding import Finding
from physid.inspection.kinematics import lowest_corner
from physid.inspection.origin import SIGNED
from physid.inspection.rules.falls import AXIS, ENOUGH, FALL
from physid.scenes import Ground, Scene

Array = NDArray[np.float64]
DEEP = 0.05  # share of the smallest edge that a body may sink in
CARRIED = 0.5  # share of gravity: a body that accelerates along it by less does not fall
AWAY = 0.5  # share of the moments without a fall, in which bodies touch no ground, from which on it is a mistake
LEVEL = 0.3  # share of the median height of lowest corners that bodies which move along keep to ...
ROUGH = 4.0  # ... or standard deviations of the noise ...
MOSTLY = 0.8  # ... in so many of the moments
THERE = 0.8  # share of these moments in which they must touch it with other axes, or another order, to name these


@dataclass(frozen=True)
class Carried:
    """Moments at which bodies do not fall, so that something carries them.

    Attributes:
        scene: The scene.
        pose: Of the bodies that do not fall, shape (n, 7).
        body: Which they are, shape (n,).
        moment: Number of the moment of each, shape (n,).
        near: How far the lowest corner of a body may seem from the ground that it touches [m].
    """

    scene: Scene
    pose: Array
    body: NDArray[np.int64]
    moment: NDArray[np.int64]
    near: float

    @classmethod
    def of(cls, seen: Evidence) -> Carried | None:
        """Choose them; None where there are few, or noise looks like half a fall."""
        k, g = seen.kinematics, float(np.linalg.norm(seen.weight))
        if not g or seen.acceleration_noise > 0.5 * CARRIED * g:
            return None
        pull = (k.acceleration - k.force / seen.masses[:, None]) @ seen.weight / g
        chosen = np.flatnonzero(seen.smooth & (pull < CARRIED * g))
        if len(chosen) < ENOUGH:
            return None
        poses = [np.zeros(0) if one.pose is None else one.pose for one in seen.recordings]
        pose = np.array([poses[k.trajectory[one]][k.frame[one], k.body[one]] for one in chosen])
        _, moment = np.unique(np.stack([k.trajectory, k.frame])[:, chosen], axis=1, return_inverse=True)
        return cls(seen.scene, pose, k.body[chosen], np.asarray(moment).reshape(-1), seen.near)

    def height(self, pose: Array, normal: Sequence[float]) -> Array:
        """Return the height of what is lowest at each moment [m]: of bodies in a pile, one lies on the ground."""
        ground = Ground(normal=(normal[0], normal[1], normal[2]), offset=self.scene.ground.offset)
        scene, lowest = replace(self.scene, ground=ground), np.full(int(self.moment.max()) + 1, np.inf)
        for one in np.unique(self.body):
            here = self.body == one
            np.minimum.at(lowest, self.moment[here], lowest_corner(pose[here], scene, int(one)))
        return lowest

    def touching(self, pose: Array, normal: Sequence[float]) -> float:
        """Return the share of the moments at which a body touches the ground."""
        return float(np.mean(np.abs(self.height(pose, normal)) < self.near))

    def away(self) -> str | None:
        """Say how often bodies touch no ground; None where that is no more than usual."""
        height = self.height(self.pose, self.scene.ground.normal)
        share = float(np.mean(np.abs(height) >= self.near))
        return None if share < AWAY else (
            f"bodies do not fall, yet in {100 * share:.0f} % of these moments they touch no ground (lowest corner "
            f"{1000 * height.min():.3g} to {1000 * height.max():.3g} mm over it)"
        )  # fmt: skip


def carried(seen: Evidence) -> Finding | None:
    """Bodies that neither fall nor touch the ground, and would with other axes, or quaternions in another order."""
    here = Carried.of(seen)
    what = None if here is None else here.away()
    if here is None or what is None:
        return None
    normal = tuple(map(float, seen.scene.ground.normal))
    found = [(here.touching(here.pose, vector), False, name) for name, vector in _ups(normal).items()]
    for name, change in _orders(seen).items():
        found.append((here.touching(_reordered(seen, here.pose, change), normal), True, name))
    share, order, name = max(found, key=lambda one: one[0])
    if share < THERE:
        return None
    if order:
        return Finding(f"{what}; with {name} they would in {100 * share:.0f} %", f"import with {name}")
    word, axes = seen.origin.up(name)
    return Finding(f"{what}: up seems to be {word}", f"import with the axes of the log (axes={axes})")


def adrift(seen: Evidence) -> Finding | None:
    """Bodies that neither fall nor touch the ground, at heights that change, or far from it."""
    here = Carried.of(seen)
    what = None if here is None else here.away()
    if here is None or what is None:
        return None
    low, middle, high = np.quantile(here.height(here.pose, seen.scene.ground.normal), [0.1, 0.5, 0.9])
    edge = float(seen.scene.sizes.min())
    if high - low >= edge:
        return Finding(what, "check axes, the order of quaternions, ground and size; does a hand carry it?")
    if abs(middle) < edge:
        return None  # always the same: `heights` speaks of the ground, the size and the point that is tracked
    offset = seen.scene.ground.offset + middle
    return Finding(
        f"{what}: what carries them seems to be {1000 * abs(middle):.3g} mm {'higher' if middle > 0 else 'lower'}",
        f"import with ground.offset={offset:.4g}, the height of the table in the log's frame [m]",
    )


def _ups(normal: tuple[float, ...]) -> dict[str, tuple[float, ...]]:
    """Return the other axes that may be up, by name; none where the ground is tilted."""
    return {name: vector for name, vector in SIGNED.items() if vector != normal} if max(map(abs, normal)) == 1 else {}


def _orders(seen: Evidence) -> dict[str, Callable[[Array], Array]]:
    """Return what else the quaternions may be than the import took them for, and what makes them right."""
    if seen.origin.order == "wxyz":
        name, other = "order: xyzw (w stands last)", [3, 0, 1, 2]
    else:
        name, other = "order: wxyz (w stands first)", [1, 2, 3, 0]
    inverse = np.array([-1.0, -1.0, -1.0, 1.0])
    return {
        name: lambda q: q[..., other],
        f"the inverse rotations, {seen.origin.inverse()} (these are world to body)": lambda q: q * inverse,
        f"{name.split()[1]} of the inverse rotations": lambda q: q[..., other] * inverse,
    }


def _reordered(seen: Evidence, pose: Array, change: Callable[[Array], Array]) -> Array:
    """Return poses whose quaternions were written in another order, in the log's own axes."""
    log = change(turned(pose[:, 3:], seen.origin.axes.T))
    return np.concatenate([pose[:, :3], turned(log, seen.origin.axes)], 1)


def lying(seen: Evidence) -> Finding | None:
    """Bodies that slide along gravity: another axis is up."""
    if not seen.weight.any():
        return None
    gravity = seen.weight / np.linalg.norm(seen.weight)
    place = np.concatenate([one.pose[..., :3][one.seen] for one in seen.recordings if one.pose is not None])
    spread = place.std(0)
    along = float(np.abs(spread @ np.abs(gravity)))
    least = int(spread.argmin())
    edge = float(seen.scene.sizes.min())
    falling = _falling(seen)
    tilted = abs(float(gravity @ np.array(seen.scene.ground.normal))) < 0.999
    if tilted or abs(gravity[least]) > 0.5 or falling > 0.02 or along < edge or spread[least] > 0.1 * along:
        return None
    word, axes = seen.origin.up("xyz"[least])
    return Finding(
        f"bodies move {along:.3g} m (standard deviation) along gravity without ever falling, and only "
        f"{spread[least]:.2g} m along {'xyz'[least]}: up seems to be {word}",
        f"import with the axes of the log (axes={axes})",
    )


def _falling(seen: Evidence) -> float:
    """Return the share of windows that fall freely: no force acts, and what falls does so in one direction."""
    k, g = seen.kinematics, float(np.linalg.norm(seen.weight))
    size = np.linalg.norm(k.acceleration, axis=1)
    free = seen.smooth & seen.unforced & (np.abs(size / g - 1) < 2 * FALL)
    if not free.any() or np.linalg.norm(k.acceleration[free].mean(0)) < AXIS * size[free].mean():
        return 0.0
    return float(np.mean(free))


def orders(seen: Evidence) -> Finding | None:
    """Orientations that sink bodies into the ground, where another order of the quaternion does not."""
    edge = float(seen.scene.sizes.min())

    def depth(change: Callable[[Array], Array]) -> float:
        worst = [
            np.maximum(-lowest_corner(_reordered(seen, pose, change), seen.scene, body), 0)
            for _, body, _, pose in seen.tracks()
        ]
        return float(np.quantile(np.concatenate(worst), 0.9))

    now = depth(lambda q: q)
    if now < DEEP * edge + 3 * seen.noise.position:
        return None
    found = {name: depth(change) for name, change in _orders(seen).items()}
    best = min(found, key=lambda name: found[name])
    if found[best] < 0.2 * now:
        return Finding(
            f"bodies sink {1000 * now:.3g} mm into the ground; with {best} it would be {1000 * found[best]:.2g} mm",
            f"import with {best}",
        )
    return None


def heights(seen: Evidence) -> Finding | None:
    """Bodies that lie still, or move along, above or below the ground."""
    k = seen.kinematics
    edge = float(seen.scene.sizes.min())
    near = np.abs(k.height) < edge
    lying, doing = k.height[seen.still & near], "lie still"
    if len(lying) < ENOUGH:
        lying, doing = _moving_along(seen, near), "move along"
    if len(lying) < ENOUGH:
        return None
    height = float(np.median(lying))
    if abs(height) < FLOAT * edge + seen.noise.position:
        return None
    where = f"{1000 * abs(height):.3g} mm {'above' if height > 0 else 'below'} the ground"
    return Finding(
        f"bodies {doing} with their lowest corner {where}",
        "check ground.offset, size, and whether the tracked point is the centre (tracked_point)",
        wrong=abs(height) > 5 * FLOAT * edge or not seen.touching.any(),
    )


def _moving_along(seen: Evidence, near: NDArray[np.bool_]) -> Array:
    """Return heights of the lowest corners [m] where bodies keep them in nearly all windows; none where they do not."""
    heights = seen.kinematics.height
    if not len(heights):
        return heights
    middle = np.median(heights)
    level = near & (np.abs(heights - middle) < max(LEVEL * abs(middle), ROUGH * seen.noise.position))
    return heights[level] if level.mean() > MOSTLY else heights[:0]
