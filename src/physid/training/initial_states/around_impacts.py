"""First values and initial states where impacts amplify every error: fitted to segments that are cut around them."""

from __future__ import annotations

import contextlib
import copy
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.estimation.least_squares import NONE, StepChoice, choose, gauss_newton
from physid.estimation.prediction import Predictor, Segmentation, Timeline, Variants
from physid.estimation.segmented_fit import (
    Observed,
    RoundSettings,
    SegmentedFit,
    SegmentedFitSettings,
    fit_around_events,
    fit_short_segments,
    fit_with_chosen_steps,
    own_weights,
    tumbles,
    usual_misfit,
    weighed,
)
from physid.physics import SolverError
from physid.training.initial_states.cutting import Cutting, OutlierFrames
from physid.training.initial_states.explaining import Explaining, States
from physid.training.initial_states.fitted import FITTING, MOST
from physid.training.parameters import Pieces

AROUND_IMPACTS = SegmentedFitSettings(rounds=RoundSettings(step_choices=1), steps=StepChoice(shortest=5e-4))
"""As in a diagnosis, but that steps are chosen once: the run that follows chooses them again."""
WEIGHED = 2
"""How often segments are weighed by what they leave, and fitted again."""


@dataclass(frozen=True)
class FirstFit:
    """What a fit to segments finds for the run that follows.

    Attributes:
        outliers: Frames that stand alone; None where there are none.
        states: Initial states of the pieces, or of whole trajectories; None where there are no impacts, or where the
            physics has no solution.
        pieces: The pieces; None where trajectories stay whole.
        tumbling: In how many trajectories a body touches the ground with an edge or a corner.
        unexplained: How many with an impact are not explained as a whole.
    """

    outliers: OutlierFrames | None = None
    states: States | None = None
    pieces: Pieces | None = None
    tumbling: int = 0
    unexplained: int = 0

    def described(self, frames: int) -> list[str]:
        """Say what is left out, of so many frames, and what is cut, in sentences for the user."""
        said = [] if self.outliers is None else [self.outliers.described(frames)]
        if self.pieces is not None:
            said.append(
                f"{self.pieces.described()}: bodies touch the ground with an edge or a corner in {self.tumbling}, no "
                f"initial states explain the whole of {self.unexplained}"
            )
        return said


@torch.no_grad()
def fit_around_impacts(
    coarse: Explaining, whole: Explaining, settings: SegmentedFitSettings, *, chooses: bool
) -> FirstFit:
    """Fit parameters and initial states to segments around impacts, and say whether trajectories have to be cut there.

    Which frames stand alone (see `fit_short_segments`) is decided again by what the last fit leaves.

    Trajectories stay whole where in most of them no body touches the ground with an edge or a corner, and initial
    states explain the whole up to noise: what is known of a parameter grows with the time that an error has to show.
    Parameters are those that segments say, and where these do not explain it, fitted to the whole: the second bounce
    shows a restitution that segments around single ones know too little of. Else all are cut around their impacts, and
    segments that no state explains count as little as their misfit says. A whole toss that tumbles may be explained as
    well, but in one of many narrow valleys.

    Args:
        coarse: Whole trajectories with the longest steps, model and loss; the parameters are moved.
        whole: The same trajectories, with the steps that the run begins with.
        settings: What decides.
        chooses: Whether steps of the engine are chosen.
    """
    outliers = None
    with contextlib.suppress(SolverError):
        recorded, predictor = _recorded(coarse)
        found = fit_short_segments(recorded, predictor, settings)
        outliers = _outliers(coarse, recorded, found.observed.present)
        found = fit_around_events(found, settings)
        if bool(found.experiment.predictor.segments.contact.any()):
            for _ in range(settings.rounds.step_choices if chooses else 0):
                found = fit_with_chosen_steps(found, settings)
            found, weight = _by_own_weights(found, recorded.present, settings)
            outliers = _outliers(coarse, recorded, found.experiment.scale.amax(-1))
            physical = whole.physical
            physical.coordinates.copy_(found.fit.point.nominal[0])
            physical.confine()
            counted = Cutting(None, outliers).of(whole.trajectories)
            return _cut(replace(whole, trajectories=counted), found, weight, settings, outliers)
    return FirstFit(outliers)


def _outliers(coarse: Explaining, recorded: Observed, counts: Tensor) -> OutlierFrames | None:
    """Return the frames in which a pose was recorded that counts nothing (R, T, N)."""
    outlier = ((recorded.present > 0) & (counts == 0)).any(-1)
    return OutlierFrames.among(coarse.trajectories, outlier) if bool(outlier.any()) else None


def _recorded(explaining: Explaining) -> tuple[Observed, Predictor]:
    """Return trajectories as the fit to segments takes them, and the model with its present parameters."""
    cut = explaining.trajectories.stepped(explaining.layer.world.time_step).to("cpu")
    assert cut.time is not None and cut.grid is not None
    timeline, rows = Timeline(cut.time, cut.grid), len(cut)
    present = cut.real[..., None].expand(-1, -1, cut.pose.shape[2]).to(cut.pose)
    physical = copy.deepcopy(explaining.physical).cpu()
    whole = Segmentation.equal(rows, timeline.frames, timeline.frames)
    predictor = Predictor(physical.model(explaining.layer), timeline, whole)
    return Observed(cut.pose, present, timeline, torch.ones(rows, dtype=torch.bool)), predictor


def _by_own_weights(
    found: SegmentedFit, recorded: Tensor, settings: SegmentedFitSettings
) -> tuple[SegmentedFit, Tensor]:
    """Fit again with segments that count as little as they are explained; also return their weights (K,).

    Which of the frames that were recorded (R, T, N) stand alone is decided anew.
    """
    noise, experiment = weighed(
        found.experiment, found.fit, recorded, None, settings.noise, robust=settings.rounds.robust
    )
    segments, fit = experiment.predictor.segments, found.fit
    doubtful = torch.full_like(segments.contact, settings.rounds.own_weights)
    weight = torch.ones(len(segments), dtype=torch.float64)
    for _ in range(WEIGHED):
        misfit = experiment.misfit(fit.point)
        weight = own_weights(misfit, usual_misfit(segments, misfit), doubtful)
        counted = experiment.replace(scale=experiment.scale * segments.spread(weight.sqrt())[..., None, None])
        fit = gauss_newton(counted, counted.linearise(fit.point, NONE), NONE)
    return replace(found, experiment=experiment, fit=fit, noise=noise), weight


def _cut(
    whole: Explaining,
    found: SegmentedFit,
    weight: Tensor,
    settings: SegmentedFitSettings,
    outliers: OutlierFrames | None,
) -> FirstFit:
    """Cut trajectories into segments of weights (K,), unless in most of them no body tumbles and all is explained.

    States are tried that the segments begin with, and those that the poses suggest. What a trajectory without an impact
    leaves is no reason to cut.
    """
    segments, point = found.experiment.predictor.segments, found.fit.point
    first = (segments.start == 0).nonzero()[:, 0]  # one of each trajectory, in their order
    states = point.pose[0, first], point.twist[0, first]
    experiment, guess = whole.begin()
    held = experiment.with_known_parameters().replace(settings=FITTING)
    begun = Variants.join((guess, whole.begin(states=states)[1]))
    fit = gauss_newton(held, choose(held, begun), NONE, MOST)
    struck = torch.zeros(len(first), dtype=torch.bool)
    struck[segments.trajectory[segments.contact]] = True
    tumbling, unexplained = tumbles(found, settings), struck & ~held.explained(fit.loss)
    most = held.settings.multi_start.most
    if float((tumbling | unexplained).double().mean()) > most >= float(tumbling.double().mean()):
        together = experiment.replace(settings=FITTING)
        fit = gauss_newton(together, together.linearise(fit.point, NONE), NONE, MOST)
        unexplained = struck & ~together.explained(fit.loss)
    if float((tumbling | unexplained).double().mean()) <= most:
        whole.physical.coordinates.copy_(fit.point.nominal[0])
        whole.physical.confine()
        return FirstFit(outliers, (fit.point.pose[0], fit.point.twist[0]))
    cut = (segments.size > 1).nonzero()[:, 0]
    index = whole.trajectories.index.cpu()[segments.trajectory[cut]]
    pieces = Pieces(index, segments.start[cut], segments.size[cut], weight[cut], segments.struck[cut])
    states = point.pose[0, cut], point.twist[0, cut]
    return FirstFit(outliers, states, pieces, int(tumbling.sum()), int(unexplained.sum()))
