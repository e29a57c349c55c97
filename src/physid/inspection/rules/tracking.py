"""What looks like a mistake of the tracker: jumps, frames that repeat, poses that it held, wild turns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physid.data.observations.remarks import NAMED, TURN
from physid.inspection.evidence import LEAST_SMOOTH, Evidence
from physid.inspection.finding import Finding

Array = NDArray[np.float64]
JUMP = 10.0  # times the distance of its neighbours
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


def unseen(seen: Evidence) -> Finding | None:
    """Bodies that are often out of sight."""
    share = 1 - float(np.concatenate([one.seen.ravel() for one in seen.recordings]).mean())
    if share < UNSEEN:
        return None
    return Finding(
        f"bodies are out of sight in {100 * share:.0f} % of the frames", "look at lighting and markers", wrong=False
    )


def covered(seen: Evidence) -> Finding | None:
    """Frames of films in which something hid the bodies, or their light changed, when poses were read from them."""
    hidden = [one for one in seen.origin.hidden if one.trajectory in seen.indices]
    if not hidden:
        return None
    most, more = max(hidden, key=lambda one: one.share), len(hidden) - 1
    return Finding(
        f"{most}, and poses there are unsure{f' (and in {more} more trajectories)' if more else ''}",
        "cut these films there, or film again",
        wrong=False,
    )
