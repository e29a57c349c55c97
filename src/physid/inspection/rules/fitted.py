"""What a fit shows that no rule can see before: trajectories of another body, and noise that is not white."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from torch import Tensor

from physid.estimation.measurement import CorrelatedNoise
from physid.estimation.segmented_fit import UnexplainedEvents
from physid.inspection.finding import Finding
from physid.scenes import Scene, given_in


def odd_trajectory(index: int, names: Sequence[str], own: Sequence[float], others: Sequence[float]) -> Finding:
    """Name a trajectory that has parameters of its own.

    Args:
        index: Its number in the set.
        names: Of the parameters.
        own: What it says of them, roughly: it is one trajectory.
        others: What the others say.
    """
    rows = zip(names, own, others, strict=True)
    values = [f"{name} about {value:.2g} (the others: {other:.3g})" for name, value, other in rows]
    return Finding(
        f"trajectory {index} alone has another {' and another '.join(values)}",
        "was it another body, another ground, or are its forces in another unit? leave it out, or correct it: without "
        "it the model explains all others",
    )


def unexplained_impacts(left: UnexplainedEvents, scene: Scene) -> Finding:
    """Say that the model does not explain impacts, and which of its contact is given, not fitted.

    Args:
        left: What it leaves there.
        scene: The bodies, and what is unknown of them.
    """
    names = [name for name in given_in(scene) if name.endswith(".restitution")]
    values = " and ".join(f"{name} {scene.value(name):g}" for name in names)
    given = f"unless somebody measured what is given ({values}), learn it (unknown in recording.yaml); else "
    return Finding(
        f"many impacts are not explained: in {left.unexplained} of {left.among} segments with an impact or a jolt the "
        f"model leaves {1e3 * left.position:.2g} mm and {math.degrees(left.rotation):.2g} deg beyond noise (medians), "
        "which counts little in a fit",
        f"{given * bool(names)}contact is softer than the model's, sizes are others, or the tracker errs there; "
        "friction and restitution may be off by more than their intervals say",
        wrong=False,
    )


def given_parameter(name: str, given: float, value: float, within: float) -> Finding:
    """Say that another value of a given parameter explains the positions.

    Args:
        name: Of the parameter.
        given: Its value.
        value: The other one.
        within: How far the model leaves positions then, at most, beyond noise [m].
    """
    return Finding(
        f"with {name} {value:.3g} instead of the {given:.3g} that is given, the model leaves positions by "
        f"{1e3 * within:.2g} mm at most beyond noise",
        "learn it (unknown in recording.yaml, or model.learn) unless it was measured: an effect that is named may only "
        "stand for it",
        wrong=False,
    )


def correlated_noise(noise: CorrelatedNoise) -> Finding:
    """Say how alike the noise of neighbouring frames is, and that what smooths poses smooths the motion."""
    alike = max(float(each.between(np.ones(()))) for each in noise.correlations)
    return Finding(
        f"the noise of neighbouring frames is alike (correlation {alike:.2f}), and counts as such",
        "a filter or an interpolation of the poses does this, and smooths the motion, too: record poses as they are "
        "measured, if you can",
        wrong=False,
    )


def noisy_forces(density: Tensor, masses: Sequence[float]) -> Finding:
    """Say how far the noise of recorded forces moves bodies in a second: sqrt(q t^3 / 3) / m, a walk of the velocity.

    Args:
        density: q, shape (N, 6), see `force_noise`.
        masses: Of the bodies [kg].
    """
    moved = max((float(one) / 3) ** 0.5 / mass for one, mass in zip(density[:, 3:].amax(1), masses, strict=True))
    return Finding(
        f"the recorded forces are noisy, which moves a body by {1e3 * moved:.2g} mm in a second, and count as such",
        "forces that are known, or a sensor that adds less, show smaller effects",
        wrong=False,
    )
