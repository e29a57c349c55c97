"""What looks like a mistake of the tracker or of its clock: jumps, frames that repeat, wild turns, late forces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physid.data.observations.remarks import NAMED, TURN
from physid.data.observations.stamps import unlike_lengths
from physid.inspection.evidence import LEAST_SMOOTH, STILL, Evidence
from physid.inspection.finding import Finding
from physid.inspection.rules.falls import ENOUGH

Array = NDArray[np.float64]
JUMP = 10.0  # times the distance of its neighbours
LAG, BETTER = 20, 0.05  # frames that a clock may be off, gain in correlation that says so
AGAINST = -0.3  # correlation below which the sign of the forces may be wrong, unless a shift explains more
FOLLOWS = 0.4  # correlation of accelerations with shifted forces below which they follow no force, whatever the shift
NOMINAL = 1e-6  # share of a time step by which stamps stray that were computed from a rate
SHARE = 0.1  # of frames, from which on it is no accident
HELD = 5  # frames with one and the same pose, to the last digit, from which on the tracker may have held it
CATCH_UP = 3.0  # times the step after it by which a body moves on from a pose that was held while it went on
UNSEEN = 0.3  # share of frames without a body


def turns(seen: Evidence) -> Finding | None:
    """Bodies that turn far between frames all the time; a rate that is too low now and then is a remark."""
    turning = seen.kinematics.turning
    if not len(turning) or np.mean(turning > TURN) <= SHARE:
        return None
    window = int(turning.argmax())
    return Finding(
        f"in {int((turning > TURN).sum())} of {len(turning)} frames bodies turn by more than {TURN:g} rad until the "
        f"next ({seen.place(window)}: {turning[window]:.2g} rad): are angles in degrees read as radians?",
        "import with the unit of the log; or record faster",
        wrong=True,
    )


def repeats(seen: Evidence) -> Finding | None:
    """Frames that repeat the one before while the body moves: the tracker is slower than the log."""
    same = total = 0
    for _, _, _, place in seen.tracks():
        equal = (place[1:] == place[:-1]).all(1)
        moving = np.linalg.norm(place[2:, :3] - place[:-2, :3], axis=1) > 1e-6
        same += int(np.count_nonzero(equal[:-1] & moving))
        total += int(moving.sum())
    if not total or same < SHARE * total:
        return None
    return Finding(
        f"{same} of {total} frames of a motion repeat the pose before them: the log is faster than the tracker",
        "log poses when they come, or leave cells empty where there is no new one",
    )


def held(seen: Evidence) -> Finding | None:
    """Poses that stay the same for some frames and then catch up: the tracker lost the body and held its last pose.

    A body that lies still sets off with steps that are alike; one that went on unseen makes up for all of them in one.
    """
    found = list[tuple[int, int, int]]()
    for index, _, frame, place in seen.tracks():
        same = np.concatenate([[False], (place[1:] == place[:-1]).all(1), [False]])
        starts, ends = np.flatnonzero(~same[:-1] & same[1:]), np.flatnonzero(same[:-1] & ~same[1:])
        step = np.linalg.norm(np.diff(place[:, :3], axis=0), axis=1)
        for start, end in zip(starts, ends, strict=True):
            if end - start + 1 < HELD or end + 2 >= len(place) or same[end + 2]:
                continue  # too short, or held again at once: the log is faster than the tracker (`repeats`)
            if step[end] > CATCH_UP * step[end + 1] + LEAST_SMOOTH + JUMP * seen.noise.position:
                found.append((index, int(frame[start]), int(frame[end])))
    if not found:
        return None
    named = ", ".join(f"trajectory {index}, frames {first} to {last}" for index, first, last in found[:NAMED])
    more = f" and {len(found) - NAMED} more" if len(found) > NAMED else ""
    return Finding(
        f"the pose stays the same and then catches up in one step: {named}{more}: the tracker seems to hold its last "
        "pose while it has lost the body",
        "empty these cells, so that the body counts as not seen, or tell the tracker to write nothing then",
    )


def jumps(seen: Evidence) -> Finding | None:
    """Poses far from both neighbours, which a fit leaves out; many are refused (see `usability`)."""
    found = []
    for index, _, frame, pose in seen.tracks():
        place = pose[:, :3]
        if len(place) < 3:
            continue
        step = np.linalg.norm(np.diff(place, axis=0), axis=1)
        around = np.linalg.norm(place[2:] - place[:-2], axis=1)
        wild = np.minimum(step[:-1], step[1:]) > JUMP * (around + seen.noise.position) + LEAST_SMOOTH
        found += [(index, int(frame[at + 1])) for at in np.flatnonzero(wild)]
    if not found:
        return None
    return Finding(
        f"{len(found)} poses lie {JUMP:g} times as far from both neighbours as these from each other (the first "
        f"in trajectory {found[0][0]}, frame {found[0][1]})",
        "empty these cells, or tell the tracker to drop what it lost",
        wrong=False,
    )


def delay(seen: Evidence) -> Finding | None:
    """Forces that act before or after their accelerations: two clocks with an offset.

    Where a body slides, a = f(t - lag) / m - c v / |v|: without the second part, dry friction, which turns round later
    than the force does, looks like a shift. So what follows the direction of the motion is taken out of both (partial
    correlation, Yule 1907), and frames without motion, in which friction cancels the force, are left out.
    """
    k = seen.kinematics
    normal = np.array(seen.scene.ground.normal)
    along = np.eye(3) - np.outer(normal, normal)
    if np.count_nonzero(~seen.unforced) < ENOUGH:
        return None
    moments = np.zeros((2 * LAG + 1, 3, 3))
    for trajectory in np.unique(k.trajectory):
        for body in np.unique(k.body):
            here = (k.trajectory == trajectory) & (k.body == body)
            if np.count_nonzero(here) < 3 * LAG:
                continue
            push, pull, speed = k.force[here] @ along, k.acceleration[here] @ along, k.velocity[here] @ along
            way = speed / np.maximum(np.linalg.norm(speed, axis=1, keepdims=True), STILL)
            push, moving = push - push.mean(0), ~seen.still[here]
            for index, lag in enumerate(range(-LAG, LAG + 1)):
                early, late = slice(max(0, -lag), len(push) - max(0, lag)), slice(max(0, lag), len(push) + min(0, lag))
                pairs = np.stack([push[early], pull[late], way[late]])[:, moving[late]]
                moments[index] += np.einsum("ant,bnt->ab", pairs, pairs)
    match = _partial_correlation(moments)
    best = int(match.argmax()) - LAG
    reversed_explains_more = match[LAG] < AGAINST and match[best + LAG] < BETTER - match[LAG]
    if reversed_explains_more or match[best + LAG] < FOLLOWS:
        return None
    if abs(best) < 2 or match[best + LAG] < match[LAG] + BETTER:
        return None
    late_by = best * seen.scene.time_step
    return Finding(
        f"accelerations come {abs(late_by):.3g} s {'after' if late_by > 0 else 'before'} the forces (correlation "
        f"{match[best + LAG]:.2f}, without a shift {match[LAG]:.2f}): the two clocks seem to differ",
        f"import with forces.offset={late_by:.3g}, if nothing in the plant delays them",
    )


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


def _partial_correlation(moments: Array) -> Array:
    """Correlate the first two of three variables, the third taken out, by their second moments (n, 3, 3); 0 if none."""
    kept = moments[:, :2, :2] - (
        moments[:, :2, 2:] * moments[:, 2:, :2] / np.maximum(moments[:, 2:, 2:], np.finfo(float).tiny)
    )
    size = np.sqrt(np.maximum(kept[:, 0, 0] * kept[:, 1, 1], 0.0))
    return np.asarray(np.divide(kept[:, 0, 1], size, out=np.zeros(len(kept)), where=size > 0))


def unseen(seen: Evidence) -> Finding | None:
    """Bodies that are often out of sight."""
    share = 1 - float(np.concatenate([one.seen.ravel() for one in seen.recordings]).mean())
    if share < UNSEEN:
        return None
    return Finding(
        f"bodies are out of sight in {100 * share:.0f} % of the frames", "look at lighting and markers", wrong=False
    )
