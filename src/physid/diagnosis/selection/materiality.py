"""Whether a gap matters: significant is not the same as material."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.settings.conclusion import MaterialitySettings
from physid.diagnosis.testing import Hypothesis, LackOfFit, conclude
from physid.estimation.measurement import Noise
from physid.estimation.segmented_fit import misfit_of_segments, squares_of_segments
from physid.scenes import Scene


@dataclass(frozen=True)
class Tolerance:
    """How far a model may leave recordings, beyond what noise accounts for, before anything is blamed for it.

    Attributes:
        position: Root mean square over frames [m].
        rotation: The same of the rotation vector [rad].
    """

    position: float
    rotation: float

    @classmethod
    def of(cls, noise: Noise, scene: Scene, settings: MaterialitySettings) -> Tolerance:
        """Return the tolerance of positions that a user gives, or one that follows from noise and sizes.

        A rotation may be off by what moves the end of the largest edge by as much. What is blamed has to be significant
        as well, so that the share of the noise need not be: it keeps what only thousands of frames show from being
        blamed.

        Args:
            noise: Of the poses.
            scene: The sizes.
            settings: A tolerance, or shares of noise and sizes.
        """
        size, position = float(scene.sizes.max()), settings.tolerance
        by_size = settings.share_of_size * size
        if position is not None:
            return cls(position, 2 * position / size)
        by_noise = (settings.share_of_noise * noise.floor, settings.share_of_noise * noise.rotation_floor)
        return cls(max(by_noise[0], by_size), max(by_noise[1], 2 * by_size / size))

    def exceeded(self, one: Excess) -> bool:
        """Return whether a gap is material."""
        return one.position > self.position or one.rotation > self.rotation


@dataclass(frozen=True)
class Excess:
    """By how much a model leaves recordings beyond the floor, sqrt(error^2 - floor^2).

    Attributes:
        position: Root mean square over frames [m].
        rotation: The same of the rotation vector [rad].
    """

    position: float
    rotation: float


def tolerance_of(nominal_fit: NominalFit) -> Tolerance:
    """Return the tolerance of a diagnosis."""
    return Tolerance.of(nominal_fit.noise, nominal_fit.observations.scene, nominal_fit.settings.materiality)


def excess_left(nominal_fit: NominalFit, one: Hypothesis) -> Excess:
    """Return the excess of a hypothesis over trajectories that nothing was fitted to, on the worse of the protocols."""
    return excess_of(one, nominal_fit.noise, nominal_fit.observations.reported)


def is_material(nominal_fit: NominalFit, one: Hypothesis, lack: LackOfFit | None) -> bool:
    """Return whether a hypothesis leaves more than the tolerance, or a better model would move positions by more.

    Args:
        nominal_fit: The recordings.
        one: The hypothesis; of some segments alone if it was fitted to these.
        lack: What it leaves unexplained; None where that is not known.
    """
    allowed = tolerance_of(nominal_fit)
    missing = 0.0 if lack is None else unexplained_size(lack, nominal_fit.noise)
    return allowed.exceeded(excess_left(nominal_fit, one)) or missing > allowed.position


def fails_at_impacts(nominal_fit: NominalFit) -> bool:
    """Return whether the model leaves more than the tolerance at many impacts (see `unexplained_events`)."""
    left = nominal_fit.unexplained_events
    return left is not None and tolerance_of(nominal_fit).exceeded(Excess(left.position, left.rotation))


def leaves_no_positions(nominal_fit: NominalFit) -> bool:
    """Return whether the nominal model leaves positions within the tolerance, and explains impacts."""
    nominal = conclude(nominal_fit.experiment, nominal_fit.fit, (), nominal_fit.settings)
    within = excess_left(nominal_fit, nominal).position <= tolerance_of(nominal_fit).position
    return within and not fails_at_impacts(nominal_fit)


def excess_of(hypothesis: Hypothesis, noise: Noise, parts: Iterable[Tensor]) -> Excess:
    """Compute the largest excess over parts of the recordings, masks of trajectories (R,); zero where there are none.

    Frames count by their robust weights, and initial states are fitted to each segment.
    """
    values = [_excess(hypothesis, noise, rows) for rows in parts if bool(rows.any())]
    return Excess(*(max([0.0, *(getattr(one, name) for one in values)]) for name in ("position", "rotation")))


def _excess(hypothesis: Hypothesis, noise: Noise, rows: Tensor) -> Excess:
    floors = {3: noise.floor, 0: noise.rotation_floor}
    found = {}
    for first, floor in floors.items():
        scale = hypothesis.experiment.scale[rows][..., first]
        weight = (scale / scale.amax().clamp_min(1e-30)) ** 2
        square = hypothesis.fit.residual[rows][..., first : first + 3].square().sum(-1)
        # Frames whose numerics disturb more have a larger variance, and a weight that is smaller by the same factor.
        total, count = weight.sum().clamp_min(1e-30), (weight > 0).sum()
        mean = float(((square * weight).sum() - floor**2 * count) / total)
        found[first] = max(mean, 0.0) ** 0.5
    return Excess(position=found[3], rotation=found[0])


def unexplained_size(lack: LackOfFit, noise: Noise) -> float:
    """Return how far a better model would move predicted positions [m], sigma sqrt(squared residual missing / frames).

    What one effect, or a free residual wrench, explains beyond chance in the fitted trajectories is the squared
    distance between two predictions in units of the noise. The noise itself is not in it, as it is in the errors of a
    few held-out trajectories: these may lie below their floor where a whole set shows a gap.
    """
    return noise.position * math.sqrt(lack.missing / lack.frames)


def share_closed(before: Excess, after: Excess) -> float:
    """Return which share of the excess of positions, as mean squares, is closed; of rotations where these have none."""
    name = "position" if before.position > 0 else "rotation"
    old, new = torch.tensor([getattr(before, name), getattr(after, name)]).square().tolist()
    return 0.0 if old == 0 else max(0.0, 1 - new / old)


def regained(
    nominal_fit: NominalFit, nominal: Hypothesis, best: Hypothesis | None
) -> tuple[Hypothesis, Hypothesis | None]:
    """Return both hypotheses with whole frames where effects explain impacts that the nominal model does not.

    A segment with an impact that no initial state explains counts little, and so does what is wrong there. If effects
    explain most of those that the nominal model leaves unexplained, they are what it lacks: these segments count like
    others then. If they explain but some, states may have been found by chance, and nothing changes; nor where a
    simulator is known, whose impacts differ from the model's without any effect.

    Args:
        nominal_fit: The recordings, their noise, and what is unexplained, of how many.
        nominal: The model without effects.
        best: With effects; None where none were found.
    """
    if best is None or nominal_fit.observations.scene.integration is not None:
        return nominal, best
    limits, left = nominal_fit.settings.materiality, unexplained_impacts(nominal_fit, nominal)
    closed = left & ~unexplained_impacts(nominal_fit, best)
    if int(closed.sum()) <= max(limits.regained * int(left.sum()), limits.fewest - 1):
        return nominal, best
    return _counted(nominal_fit, nominal, closed), _counted(nominal_fit, best, closed)


def unexplained_impacts(nominal_fit: NominalFit, one: Hypothesis) -> Tensor:
    """Return the segments with an impact that a hypothesis does not explain, but for their worst frame, shape (K,)."""
    segments = one.experiment.predictor.segments
    square = squares_of_segments(segments, one.fit.residual, nominal_fit.present)
    return segments.struck & (misfit_of_segments(square, nominal_fit.noise) > nominal_fit.settings.unexplained.misfit)


def _counted(nominal_fit: NominalFit, one: Hypothesis, chosen: Tensor) -> Hypothesis:
    """Return a hypothesis in which all frames of some segments (K,) count that are present."""
    experiment = one.experiment
    whole = nominal_fit.present[..., None] / nominal_fit.noise.spread()
    inside = experiment.predictor.segments.spread(chosen)[..., None, None]
    scale = torch.where(inside, whole.to(experiment.scale), experiment.scale)
    return replace(one, experiment=experiment.replace(scale=scale))
