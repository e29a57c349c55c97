"""Steps of the engine chosen by halving them, on the user's own recordings, until what halving changes is small."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.estimation.least_squares.experiment import Experiment, Fit
from physid.estimation.measurement.poses import difference
from physid.estimation.prediction.rollout import Prediction
from physid.estimation.prediction.timeline import Timeline


@dataclass(frozen=True)
class StepChoice:
    """When steps are short enough.

    Attributes:
        defect: What halving the steps between two frames may change of the poses that follow within `reach`, in
            standard deviations of the sensor [-]. A tenth of them is lost in the noise of a single frame.
        reach: How long a wrong velocity moves a body before a segment ends or the next impact comes [s].
        bias: What halving all steps may change of an estimate, in standard errors [-]; where it is more, steps are
            chosen anew with a quarter of `defect`.
        most: Most parts of a step between two frames.
        rounds: Most times that `defect` is lowered.
    """

    defect: float = 0.1
    reach: float = 0.1
    bias: float = 0.25
    most: int = 32
    rounds: int = 3


@dataclass(frozen=True)
class ChosenSteps:
    """Steps that were chosen.

    Attributes:
        timeline: The frames with these steps.
        mean: Steps from frame to frame, on average [-].
        largest: The most of them [-].
        error: What halving all of them still changes of the poses, root of the mean square over frames, rotation [rad]
            and position [m].
        bias: The largest change of an unknown parameter that this makes, in standard errors [-].
    """

    timeline: Timeline
    mean: float
    largest: int
    error: tuple[float, float]
    bias: float


def choose_steps(experiment: Experiment, fit: Fit, base: Timeline, choice: StepChoice | None = None) -> ChosenSteps:
    """Cut steps near events into parts until what cutting them once more changes is small beside the noise.

    A rollout with steps and one with half of them are compared. Where positions or velocities part between two frames
    by more than `defect`, there the steps are halved, and all is compared again: stops, reversals and impacts get short
    steps, steady motion keeps one from frame to frame.

    Args:
        experiment: What is explained; frames that it does not count do not decide.
        fit: Where steps are judged.
        base: The frames with the longest steps that there may be.
        choice: When steps are short enough.
    """
    choice = choice or StepChoice()
    parts = torch.ones_like(base.grid.count[:, None].expand(base.grid.steps.shape))
    defect = choice.defect
    for _ in range(choice.rounds):
        parts = _cut(experiment, fit, base, parts, defect, choice)
        chosen = _judged(experiment, fit, base, parts)
        if chosen.bias <= choice.bias:
            break
        defect = defect / 4
    return chosen


def _cut(experiment: Experiment, fit: Fit, base: Timeline, parts: Tensor, defect: float, choice: StepChoice) -> Tensor:
    """Return into how many parts (R, S) the steps are cut, so that halving them changes little."""
    noise = _noise(experiment)
    while True:
        coarse, fine = _halved(experiment, fit, base, parts)
        apart = difference(coarse.pose[0], fine.pose[0]), coarse.twist[0] - fine.twist[0]
        within = (experiment.predictor.segments.position[:, 1:] > 0)[..., None, None]
        length = base.time.diff(dim=1)[..., None, None]
        speed = apart[1].diff(dim=1) * choice.reach
        place = apart[0].diff(dim=1) - apart[1][:, :-1] * length
        wrong = torch.where(within, (place.abs() + speed.abs()) / noise, 0.0).amax((2, 3)) > defect
        wrong = torch.cat([wrong, torch.zeros_like(wrong[:, :1])], 1)
        again = wrong.gather(1, base.owner) & (parts < choice.most)
        if not bool(again.any()):
            return parts
        parts = torch.where(again, 2 * parts, parts)


def _halved(experiment: Experiment, fit: Fit, base: Timeline, parts: Tensor) -> tuple[Prediction, Prediction]:
    """Predict with steps cut into parts, and into twice as many."""
    predictor = experiment.predictor
    coarse, fine = (predictor.at_times(base.refined(factor * parts)).predict(fit.point) for factor in (1, 2))
    return coarse, fine


def _judged(experiment: Experiment, fit: Fit, base: Timeline, parts: Tensor) -> ChosenSteps:
    """Say what halving all steps changes of poses and estimates."""
    coarse, fine = _halved(experiment, fit, base, parts)
    apart = difference(coarse.pose[0], fine.pose[0])
    counted = (experiment.scale > 0).double()
    rotation, position = ((apart * counted).unflatten(-1, (2, 3)).square().sum((0, 1, 2, 4)) / 3).unbind()
    count = counted[..., 0].sum().clamp_min(1)
    unknown = torch.arange(fit.point.nominal.shape[1])
    bias = 0.0
    if len(unknown):
        normal = fit.linear.respond(apart[None], experiment.scale).of(experiment.fitted).select(unknown)
        matrix, vector = normal.matrix.sum(0), normal.vector.sum(0)[:, 0]
        floor = 1e-12 * matrix.diagonal().amax().clamp_min(1e-30)
        inverse = torch.linalg.inv(matrix + floor * torch.eye(len(unknown), dtype=matrix.dtype))
        bias = float(((inverse @ vector).abs() / inverse.diagonal().sqrt()).max())
    real = base.grid.real
    per_frame = parts[real].double()
    return ChosenSteps(
        base.refined(parts),
        float(per_frame.mean()),
        int(per_frame.max()),
        (float((rotation / count).sqrt()), float((position / count).sqrt())),
        bias,
    )


def _noise(experiment: Experiment) -> Tensor:
    """Return the standard deviations of the sensor (6,), of the frames that count most."""
    scale = experiment.scale.amax((0, 1, 2))
    return torch.where(scale > 0, 1 / scale.clamp_min(1e-30), torch.inf)
