"""Time stamps: how often they come, whether that is what recording.yaml says, and whether two clocks are one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physid.data.recording import Recording

Array = NDArray[np.float64]
RATE_TOLERANCE = 0.02
"""Share of the period by which a rate may be off: clocks of cameras are within 0.1 to 1 % (29.97 for 30), and rates in
use are further apart (24 and 25: 4 %)."""
DEVIATIONS = 3.0  # standard errors of a period that are granted beside that
LEAST = 6  # stamps from which on a beat is looked for
FEW, FEW_FACTOR = 16, 3.0  # of fewer stamps that jitter a dropped frame moves the period, so that only a factor tells
SHORT, LOOSE = 60, 0.14  # stamps, share of the period: shorter ones that jitter more have no clear beat
WINDOW, CHANGE, CHANGE_DEVIATIONS = 25, 0.05, 6.0  # [intervals], share of a period, deviations of a window's median
SEARCH, SEARCHED, FINENESS = 0.25, 200, 4  # share of a period, stamps, points per width of a peak
NANO = 1e-9
MOST_MISSING = 10.0
"""Times as many frames as there are that may be missing in between: motion over longer gaps is that of no recording."""
UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}
UNLIKE = 1.5  # times as long: a log of forces that merely begins early and ends late is rarely so much longer


@dataclass(frozen=True)
class Rhythm:
    """How stamps follow each other.

    Attributes:
        period: Time between frames where none is missing [s].
        deviation: Standard error of the period [s].
        jitter: Standard deviation of the stamps from an even grid [s].
        missing: Frames of the grid without a stamp.
        change: First frame from which on the rate is another one; None where it stays. All else holds up to there.
        later: The period from there on [s].
    """

    period: float
    deviation: float
    jitter: float
    missing: int
    change: int | None = None
    later: float = np.nan


def rhythm_of(time: Array) -> Rhythm:
    """Find the period of stamps that jitter and of which some are missing.

    The period is the one at which the stamps beat most in time, |sum exp(2 pi i t / p)|, near the median of their
    distances; then stamps are numbered by it, and a straight line through them gives period and jitter. Where stamps
    are few and jitter much, the median itself is all that can be said.

    Args:
        time: Increasing stamps [s], shape (T,), at least 2.

    Raises:
        ValueError: If many more frames are missing than there are.
    """
    change, later = change_in(np.diff(time))
    _require_no_long_gap(time if change is None else time[change:], change or 0)
    time = time if change is None else time[: change + 1]
    _require_no_long_gap(time)
    steps = np.diff(time)
    typical = float(np.median(steps))
    if len(time) < LEAST:
        return Rhythm(typical, typical / len(time), 0.0, 0, change, later)
    first = time[:SEARCHED] - time[0]
    points = int(2 * SEARCH * FINENESS * first[-1] / typical) + 2
    rates = np.linspace(1 - SEARCH, 1 + SEARCH, points) / typical
    beat = np.abs(np.exp(2j * np.pi * rates[:, None] * first).sum(1))
    period = 1 / float(rates[beat.argmax()])
    start = 0.0
    for _ in range(3):  # numbered, then fitted, until neither changes the other
        number = np.round((first - start) / period)
        slope = np.polynomial.polynomial.polyfit(number, first, 1)
        start, period = float(slope[0]), float(slope[1])
    off = first - start - period * number
    jitter = float(off.std())
    spread = float(np.sqrt(np.square(number - number.mean()).sum()))
    if len(time) < SHORT and jitter > LOOSE * period:
        return Rhythm(typical, float(1.25 * steps.std() / np.sqrt(len(steps))), jitter, 0, change, later)
    holes = np.maximum(np.round(steps / period) - 1, 0).sum()
    return Rhythm(period, jitter / spread, jitter, int(holes), change, later)


def _require_no_long_gap(time: Array, first: int = 0) -> None:
    """Refuse stamps between which many more frames are missing than there are: what follows costs time for each.

    Frames that come in bursts have no such gap: none is longer than all of them would last together.

    Args:
        time: Stamps [s], of one rate.
        first: Number of the first of them.
    """
    steps = np.diff(time)
    whole = len(time) * np.median(steps) if len(steps) > 1 else np.inf
    if time[-1] - time[0] > MOST_MISSING * whole and steps.max() > whole:
        frame = first + int(steps.argmax())
        raise ValueError(
            f"time: expected frames about {np.median(steps):.3g} s apart, found none for {steps.max():.4g} s after "
            f"frame {frame}; cut the recording there into two trajectories, or correct the stamps"
        )


def change_in(steps: Array) -> tuple[int | None, float]:
    """Return from which step on the rate is another one, and its period; None where it stays."""
    if len(steps) < 2 * WINDOW:
        return None, np.nan
    windows = np.lib.stride_tricks.sliding_window_view(steps, WINDOW)
    medians = np.median(windows, 1)
    usual = medians[0]
    scatter = 1.25 * np.abs(windows - medians[:, None]).mean(1) * 1.25 / np.sqrt(WINDOW)  # of a median, see CHANGE
    other = np.abs(medians - usual) > CHANGE * usual + CHANGE_DEVIATIONS * np.maximum(scatter, scatter[0])
    if not other.any():
        return None, np.nan
    start = int(other.argmax())
    period = float(medians[min(start + WINDOW, len(medians) - 1)])
    nearer = np.abs(steps[start : start + WINDOW] - period) < np.abs(steps[start : start + WINDOW] - usual)
    return start + int(nearer.argmax()), period


def check_clocks(recording: Recording, time_step: float) -> None:
    """Check that stamps come as often as recording.yaml says, and that those of poses and forces are of one clock.

    Jitter and missing frames are data, and pass.

    Args:
        recording: One trajectory.
        time_step: Time between frames that recording.yaml states [s].

    Raises:
        ValueError: If they contradict each other; the message names both rates and the remedy.
    """
    if recording.time is not None and len(recording.time) > 1:
        _check_rate(recording.time, time_step)
    if recording.wrench_time is None:
        return
    poses, forces = recording.stamps(time_step), recording.wrench_time
    held = max(time_step, float(np.median(np.diff(forces))) if len(forces) > 1 else np.inf)
    if forces[0] > poses[-1] or forces[-1] + held < poses[0]:
        raise ValueError(
            f"wrench_time: expected forces on the clock of the poses, {poses[0]:.9g} to {poses[-1]:.9g} s, found them "
            f"from {forces[0]:.9g} to {forces[-1]:.9g} s: the two never overlap; shift one clock by the offset between "
            "them (import adds forces.offset=SECONDS to the stamps of the forces), and check that both are in seconds"
        )


def _check_rate(time: Array, time_step: float) -> None:
    """Refuse stamps of another rate."""
    steps = np.diff(time)
    if np.abs(steps - time_step).max() <= RATE_TOLERANCE * time_step:
        return
    rhythm = rhythm_of(time)
    ratio = rhythm.period / time_step
    if len(time) < FEW and steps.std() > RATE_TOLERANCE * rhythm.period:
        fits = 1 / FEW_FACTOR < ratio < FEW_FACTOR
    else:
        fits = abs(ratio - 1) <= RATE_TOLERANCE + DEVIATIONS * rhythm.deviation / time_step
    if not fits:
        raise ValueError(
            f"time: expected about {1 / time_step:.6g} frames per second (time_step: {time_step:.6g}), found "
            f"{1 / rhythm.period:.6g} ({rhythm.period:.6g} s apart); {_remedy(rhythm.period, time_step)}"
        )


def _remedy(period: float, time_step: float) -> str:
    """Say how a contradiction between stamps and time step is mended."""
    ratio = period / time_step
    for factor, unit in UNITS.items():
        if abs(ratio / factor - 1) < SEARCH:
            return f"these are {unit}: divide the stamps by {factor:g}"
    if abs(period - 1) < NANO:
        return "these count frames: leave `time` out, or multiply it by time_step"
    return f"if the stamps are right, write time_step: {period:.6g} into recording.yaml"


def unlike_lengths(poses: float, forces: float, rate: float) -> str | None:
    """Say that poses without stamps last much longer, or shorter, than the forces beside them; None where they do not.

    Args:
        poses: How long they last at their rate [s].
        forces: How long these last by their stamps [s].
        rate: Frames per second.
    """
    if not poses or not forces or max(poses / forces, forces / poses) < UNLIKE:
        return None
    return (
        f"{poses:.3g} s of frames at {rate:.4g} per second, but {forces:.3g} s of forces; if both were recorded "
        f"together, the true rate is {rate * poses / forces:.4g}: rate=FRAMES_PER_SECOND"
    )
