"""What is odd about a trajectory and no contradiction: one sentence each, which `inspection` says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physid.data.observations.stamps import change_in, rhythm_of
from physid.data.recording import Recording
from physid.scenes.rotations import conjugate, multiply, to_vector

Array = NDArray[np.float64]
TURN = 1.0  # [rad] between two frames; from pi on nobody knows the sense of a rotation
NEXT = 1.5  # time steps to the next frame: what lies behind a longer gap says nothing about the rate
NAMED = 5  # frames that a remark names


def pace_of(recording: Recording, time_step: float, sizes: Array) -> Array:
    """Return how far bodies get from each frame to the next, of what a frame rate can follow, shape (T - 1, N).

    1 is a turn by 1 rad or a way of the smallest edge: what is hit in between, and from which side, cannot be told. 0
    where a body was not seen, frames are missing, or the frame repeats the pose before it: what follows then is no
    matter of the rate.

    Args:
        recording: One trajectory, with poses.
        time_step: Nominal time between frames [s].
        sizes: Full edges of the bodies [m], shape (N, 3).
    """
    if recording.pose is None:
        return np.zeros((0, len(sizes)))
    before, after = recording.pose[:-1], recording.pose[1:]
    turn = np.linalg.norm(to_vector(multiply(after[..., 3:], conjugate(before[..., 3:]))), axis=-1)
    way = np.linalg.norm(after[..., :3] - before[..., :3], axis=-1)
    pace = np.maximum(turn / TURN, way / sizes.min(-1))
    near = np.diff(recording.stamps(time_step)) <= NEXT * time_step
    held = np.concatenate([np.zeros((1, pace.shape[1]), bool), (before[1:] == before[:-1]).all(-1)])[: len(pace)]
    return np.where(near[:, None] & ~held & np.isfinite(pace), pace, 0.0)


@dataclass(frozen=True)
class Remark:
    """What is odd about the clocks of a trajectory.

    Attributes:
        kind: What sort of thing, in a few words; remarks of one kind are said together.
        text: One sentence.
        size: How large it is; of several the largest is said.
    """

    kind: str
    text: str
    size: float = 0.0


def remarks_on(recording: Recording, time_step: float, sizes: Array) -> tuple[Remark, ...]:
    """Return what is odd about the clocks of a trajectory, and no contradiction.

    Args:
        recording: One trajectory, which `check_clocks` lets pass.
        time_step: Nominal time between frames [s].
        sizes: Full edges of the bodies [m], shape (N, 3).
    """
    remarks = []
    pace = pace_of(recording, time_step, sizes).max(1, initial=0.0)
    if len(fast := np.flatnonzero(pace > 1)):
        named = ", ".join(map(str, fast[:NAMED])) + (f" and {len(fast) - NAMED} more" if len(fast) > NAMED else "")
        text = (
            f"pose: the frame rate is too low for the motion: from frame {named} bodies turn by more than {TURN:g} rad "
            f"or go further than their smallest edge until the next; what they hit in between cannot be told; record "
            f"{float(pace.max()) / time_step:.3g} frames per second, or leave these frames out"
        )
        remarks.append(Remark("rate", text, float(pace.max())))
    time = recording.time
    if time is not None and change_in(np.diff(time))[0] is not None:
        rhythm = rhythm_of(time)
        text = (
            f"time: the rate changes from {1 / rhythm.period:.4g} to {1 / rhythm.later:.4g} frames per second in frame "
            f"{rhythm.change}; poses are compared at their stamps, but check that these are true, or cut it there"
        )
        remarks.append(Remark("change of the rate", text, abs(float(np.log(rhythm.later / rhythm.period)))))
    if recording.wrench is not None and recording.wrench_time is not None:
        poses, forces = recording.stamps(time_step), recording.wrench_time
        held = max(time_step, float(np.median(np.diff(forces))) if len(forces) > 1 else np.inf)
        late, early = float(forces[0] - poses[0]), float(poses[-1] - forces[-1])
        if late > time_step and recording.wrench[0].any():
            text = f"wrench_time: forces begin {late:.3g} s after the poses; until then none is assumed"
            remarks.append(Remark("late forces", text, late))
        if early > 2 * held and recording.wrench[-1].any():
            text = f"wrench_time: forces end {early:.3g} s before the poses; the last is held until then"
            remarks.append(Remark("early end of the forces", text, early))
    return tuple(remarks)
