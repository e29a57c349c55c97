"""What looks like a mistake of a clock: forces that come at or last another time, frames that were never logged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physid.data.observations.stamps import unlike_lengths
from physid.inspection.evidence import LEAST_SMOOTH, STILL, Evidence
from physid.inspection.finding import Finding
from physid.inspection.kinematics import shifted_forces
from physid.inspection.rules.falls import ENOUGH

Array = NDArray[np.float64]
LONGEST, LAG = 0.35, 20  # [s], [frames] that a clock may be off, whichever is longer
FINE = 8  # shifts for each length of a window
MOST = 64  # trajectories that are inspected: with these the shift is known far better than it matters
LEAST = 0.015  # [s] of a shift; `delay` says what exact clocks show
SURE = 6.0  # standard deviations of a shift, as a jackknife over a dozen trajectories knows them
FEW = 4  # trajectories that a standard deviation takes; of fewer a shift has to
BETTER = 0.05  # gain this much correlation, and be as long as
FRAMES = 2.0
AGAINST = -0.3  # correlation below which the sign of the forces may be wrong, unless a shift explains more
FOLLOWS = 0.4  # correlation of accelerations with shifted forces below which they follow no force, whatever the shift
NOMINAL = 1e-6  # share of a time step by which stamps stray that were computed from a rate
NEAR = 0.25  # of the time between two rows of forces: a shift so near to half of it may be that these are held
OFF = 3e-3  # [s] that a shift may be off by however many trajectories agree: 40 ms were read as 37 and as 43
BESIDE = 2  # steps on each side that a step is compared with
UNLIKE = 0.3  # share of their mean by which these may differ: no impact, and no force that switches, lies among them
ASTRAY = 0.35  # of the mean, by which a step may be off a whole number of it
LOUD = 8.0  # deviations of the noise that a step is longer than, so that noise is a fifth of it
LEAST_PLACES = 3  # such places, from which on it is no accident


def delay(seen: Evidence) -> Finding | None:
    """Forces that act before or after their accelerations: two clocks with an offset.

    Where a body slides, a - g = f(t - lag) / m - c v / |v| - d v along the ground. Without the last two parts, friction
    and drag, which turn round later than the force does, look like a shift. So what follows the velocity and its
    direction is taken out of both sides (partial correlation, Yule 1907), and windows are left out in which a body
    rests, where friction cancels the force. Both sides are smoothed alike: forces are integrated twice, and the same
    parabolas go through them as through the positions. The shift is that of the largest correlation, its standard
    deviation that of a jackknife over trajectories (Quenouille 1956).

    Calibrated on 208 sets with exact clocks: two sealed banks (160 sets of MuJoCo, PyBullet and closed forms at 30 to
    240 frames per second, most with hidden effects) and 48 generated ones at 30, 60 and 240. Accelerations follow the
    forces in 180; shifts of more than `SURE` deviations are at most 0.006 s there (PyBullet's step alone makes 0.002
    s), and those beyond `LEAST` at most 3.8 deviations. Forces of the 48 that come 0.023 s late or early are found in
    95 of 96 cases, at 0.018 s in 89 (`benchmarks/check.py`).
    """
    if np.count_nonzero(~seen.unforced) < ENOUGH:
        return None
    step = seen.kinematics_window * seen.scene.time_step / FINE
    count = int(np.ceil(max(LONGEST, LAG * seen.scene.time_step) / step))
    shifts: Array = step * np.arange(-count, count + 1, dtype=np.float64)
    moments = _moments(seen, shifts)
    if not len(moments):
        return None
    match = _partial_correlation(moments.sum(0))
    best, now = int(match.argmax()), float(match[count])
    most = float(match[best])
    reversed_explains_more = now < AGAINST and most < BETTER - now
    if reversed_explains_more or most < FOLLOWS or best in (0, 2 * count):
        return None
    late_by = _peak(shifts, match)
    without = [_peak(shifts, _partial_correlation(moments.sum(0) - one)) for one in moments]
    deviation = float(np.sqrt((len(without) - 1) * np.var(without)))
    clear = most > now + BETTER and abs(late_by) > FRAMES * seen.scene.time_step
    if abs(late_by) < LEAST or not (clear if len(without) < FEW else abs(late_by) > SURE * deviation):
        return None
    known = f" (+- {np.hypot(deviation, OFF):.1g})" if len(without) >= FEW else ""
    mend = f"import with forces.offset={round(seen.origin.offset + late_by, 3):g}, if nothing in the plant delays them"
    if late_by > 0:
        mend += ", and no filter of the poses, as one does that looks back (then learn observation_lag.time_constant)"
    held = seen.force_step or seen.scene.time_step
    if seen.origin.held and abs(late_by + held / 2) < NEAR * held:
        mend = (
            f"forces are held from row to row, {held:.2g} s; forces.between=linear if they change steadily; else {mend}"
        )
    return Finding(
        f"accelerations come {round(abs(late_by), 3):g} s{known} {'after' if late_by > 0 else 'before'} the forces "
        f"(correlation {most:.2f}, without a shift {now:.2f}): the two clocks seem to differ",
        mend,
    )


def _moments(seen: Evidence, shifts: Array) -> Array:
    """Return second moments of force, acceleration, direction and velocity along the ground, in windows that slide.

    Args:
        seen: The recordings.
        shifts: Of the forces [s], shape (S,).

    Returns:
        Sums over the windows of each trajectory that slides, shape (R, S, 4, 4).
    """
    k, normal = seen.kinematics, np.array(seen.scene.ground.normal)
    along, found = np.eye(3) - np.outer(normal, normal), list[Array]()
    chosen = np.unique(k.trajectory)
    for trajectory in chosen[np.unique(np.linspace(0, len(chosen) - 1, MOST).astype(int))]:
        total = np.zeros((len(shifts), 4, 4))
        for body in np.unique(k.body):
            here = (k.trajectory == trajectory) & (k.body == body)
            speed, pull = k.velocity[here] @ along, (k.acceleration[here] - seen.weight) @ along
            size = np.linalg.norm(speed, axis=1, keepdims=True)
            sliding = _all_over(size[:, 0] > max(STILL, seen.slowest), seen.kinematics_window)
            recording, window = seen.recordings[int(trajectory)], seen.kinematics_window
            if not sliding.any() or recording.wrench is None:
                continue
            push = shifted_forces(recording, seen.scene, int(body), window, shifts)[:, sliding] @ along
            rest = [pull[sliding], (speed / np.maximum(size, STILL))[sliding], speed[sliding]]
            parts = np.stack([push, *(np.broadcast_to(one, push.shape) for one in rest)], 1)
            total += np.einsum("sand,sbnd->sab", parts, parts)
        found += [total] * bool(total[:, 1, 1].any())
    return np.array(found)


def _all_over(true: NDArray[np.bool_], window: int) -> NDArray[np.bool_]:
    """Return where all windows that overlap by half or more are true."""
    padded = np.pad(true, window // 2, constant_values=True)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, window // 2 * 2 + 1).all(1))


def beside(moments: Array) -> tuple[Array, Array]:
    """Regress the second of several variables on the first, the others taken out of both (Yule 1907).

    Args:
        moments: Second moments of K variables, shape (n, K, K).

    Returns:
        Slopes and partial correlations, shape (n,) each; 0 where there are none.
    """
    shared = moments[:, :2, 2:]
    kept = moments[:, :2, :2] - shared @ np.linalg.pinv(moments[:, 2:, 2:]) @ shared.transpose(0, 2, 1)
    size, both = np.sqrt(np.maximum(kept[:, 0, 0] * kept[:, 1, 1], 0.0)), kept[:, 0, 1]
    none = np.zeros(len(kept))
    slope = np.divide(both, kept[:, 0, 0], out=none.copy(), where=kept[:, 0, 0] > 0)
    return slope, np.divide(both, size, out=none.copy(), where=size > 0)


def _partial_correlation(moments: Array) -> Array:
    """Return the partial correlations alone (see `beside`)."""
    return beside(moments)[1]


def _peak(shifts: Array, match: Array) -> float:
    """Return where a parabola through the largest correlation and its neighbours is highest [s]."""
    best = min(max(int(match.argmax()), 1), len(match) - 2)
    before, most, after = match[best - 1 : best + 2]
    bend = before - 2 * most + after
    return float(shifts[best] + (0.5 * (before - after) / bend * (shifts[1] - shifts[0]) if bend < 0 else 0.0))


def lengths(seen: Evidence) -> Finding | None:
    """Poses without stamps of a clock that last much longer, or shorter, than their forces, in every trajectory."""
    step, found = seen.scene.time_step, list[str | None]()
    for one in seen.recordings:
        stamps = one.stamps(step)
        # Stamps without any jitter are those of a nominal rate, as of films.
        if one.wrench_time is None or len(stamps) < 2 or np.ptp(np.diff(stamps)) > NOMINAL * step:
            return None
        found.append(unlike_lengths(float(np.ptp(stamps)) + step, float(np.ptp(one.wrench_time)), 1 / step))
    if found[0] is None or None in found:
        return None
    return Finding(found[0], "import with this rate", wrong=False)


def dropped(seen: Evidence) -> Finding | None:
    """Steps that are twice, three times ... as long as those before and after, which are alike.

    Without stamps a frame that was not logged is taken for time that did not pass: velocities seem to jump there and
    back. Calibrated by `benchmarks/check.py`: of its sets, at 30 to 240 frames per second, none is said to lack frames.
    """
    found = list[tuple[int, int, int]]()
    for index, _, frame, place in seen.tracks():
        if seen.recordings[seen.indices.index(index)].time is not None:
            continue
        at, times = _missing(frame, place[:, :3], LEAST_SMOOTH + LOUD * seen.noise.position)
        found += [(index, int(frame[k]), int(n)) for k, n in zip(at, times, strict=True)]
    if len(found) < LEAST_PLACES:
        return None
    index, frame_before, times_as_far = found[0]
    return Finding(
        f"{len(found)} times a body goes several times as far from one frame to the next as before and after (first "
        f"after frame {frame_before} of trajectory {index}: {times_as_far} times), and there are no stamps: frames "
        "seem to be missing",
        "import the stamps of the frames (time=COLUMN), or give each missing frame an empty row",
    )


def _missing(frame: NDArray[np.int64], place: Array, least: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return after which rows of a track frames are missing, and how many steps each such step stands for.

    Args:
        frame: Numbers of the frames, shape (T,).
        place: Positions [m], shape (T, 3).
        least: Least length of a step that counts [m].
    """
    width = 2 * BESIDE + 1
    if len(place) <= width:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    steps = np.lib.stride_tricks.sliding_window_view(np.diff(place, axis=0), width, axis=0)  # (T - width, 3, width)
    middle, others = steps[..., BESIDE], np.delete(steps, BESIDE, axis=-1)
    usual = others.mean(-1)
    size = np.linalg.norm(usual, axis=1)
    alike = np.linalg.norm(others - usual[..., None], axis=1).max(1) < UNLIKE * size
    times = np.round((middle * usual).sum(1) / np.maximum(size, least) ** 2)
    whole = np.linalg.norm(middle - times[:, None] * usual, axis=1) < ASTRAY * size
    following = frame[width:] - frame[:-width] == width
    at = np.flatnonzero(alike & whole & following & (size > least) & (times > 1))
    return at + BESIDE, times[at].astype(np.int64)
