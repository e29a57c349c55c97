"""From observations to the fitted nominal model: noise, windows, first states, unknown parameters, numerics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.diagnosis.inputs.events import find_events
from physid.diagnosis.inputs.motion_phases import phases_of
from physid.diagnosis.inputs.observations import Observations
from physid.diagnosis.reference.discrepancy import Say, between, settle
from physid.diagnosis.reference.null_simulations import floors
from physid.estimation.least_squares.experiment import Experiment, Fit
from physid.estimation.least_squares.initial_states import guess_starts
from physid.estimation.least_squares.jacobian import Directions
from physid.estimation.least_squares.levenberg_marquardt import gauss_newton
from physid.estimation.least_squares.line_search import try_losses
from physid.estimation.least_squares.multi_start import search
from physid.estimation.measurement.sensor_noise import Noise, estimate_noise, frame_weights, wild_poses
from physid.estimation.measurement.tracking_error import ReaderError
from physid.estimation.prediction.nominal_model import NominalModel
from physid.estimation.prediction.rollout import Prediction, Predictor, Variants
from physid.estimation.prediction.segments import HITS, Windows
from physid.physics.effect import Effect

FIRST_NOISE = Noise(rotation=5e-3, position=2e-3)
FACTORS = (1.0, 0.5, 0.25, 2.0, 4.0)  # first guesses of unknown parameters that are tried, times the one given
LOST = 1.5  # times the usual misfit of busy windows, from which on one does not follow the other engine
FIRST = 30  # frames of the windows of the first fit
CUTS = 3  # most times that trajectories are cut into windows around events
NONE = torch.zeros(0, dtype=torch.int64)


@dataclass(frozen=True)
class Prepared:
    """The fitted nominal model.

    Attributes:
        observations: What was recorded.
        experiment: Model, data and weights.
        fit: The fit.
        noise: White noise of the poses.
        phases: Codes of what each body is doing, shape (R, T, N).
        events: Frames at which small errors grow fast, shape (R, T).
    """

    observations: Observations
    experiment: Experiment
    fit: Fit
    noise: Noise
    phases: Tensor
    events: Tensor

    @property
    def present(self) -> Tensor:
        """Frames that exist and are not wild, shape (R, T, N)."""
        return tame(self.observations)


def tame(observations: Observations) -> Tensor:
    """Return which frames exist and are not wild, shape (R, T, N)."""
    present: Tensor = observations.present * ~wild_poses(observations.pose, observations.present)
    return present


def prepare(
    observations: Observations,
    model: NominalModel,
    candidates: Sequence[type[Effect]],
    generator: torch.Generator,
    say: Say = lambda _: None,
) -> Prepared:
    """Fit the nominal model: unknown parameters by the fitted trajectories, first states by all.

    Args:
        observations: What was recorded.
        model: What is believed.
        candidates: Effects that may be added later; all null here.
        generator: Source of randomness.
        say: Told what is being done.

    Returns:
        The fit, with the noise that its residuals show.
    """
    trajectories, frames = observations.pose.shape[:2]
    present = tame(observations)
    say("fitting the nominal model to short windows")
    short = Windows.equal(trajectories, frames, min(FIRST, frames))
    predictor = Predictor(model, observations.wrench, short, candidates)
    experiment, point = begin(predictor, observations, present, FIRST_NOISE)
    point = _scan(experiment, point)
    first = gauss_newton(experiment, point, NONE, steps=5)
    noise = estimate_noise(first.residual, present, observations.error)
    say("fitting the nominal model")
    experiment, fit, events = _fit_windows(observations, model, candidates, present, noise, first)
    experiment, fit, noise = _follow(experiment, fit, present, noise.error, say)
    say("measuring where the numerics disturb")
    extra = (1 + floors(experiment, fit, generator)).rsqrt()
    windows = experiment.predictor.windows
    experiment = experiment.replace(scale=experiment.scale * windows.spread(extra)[..., None, None])
    experiment, fit = settle(experiment, fit, NONE, (), say)
    phases = phases_of(fit.jacobian.base, observations.wrench, model.scene)
    return Prepared(observations, experiment, fit, noise, phases, events)


def _fit_windows(
    observations: Observations,
    model: NominalModel,
    candidates: Sequence[type[Effect]],
    present: Tensor,
    noise: Noise,
    fit: Fit,
) -> tuple[Experiment, Fit, Tensor]:
    """Fit windows cut around events, which a fit to short windows shows; cut again if the new fit shows others.

    Bodies that pass each other closely may hit each other in a fit to a long window that is a little off: no step leads
    back from there, but short windows around the hit find their way.

    Returns:
        The experiment, the fit and the events that its windows are cut around, shape (R, T).
    """

    def events_of(fit: Fit) -> Tensor:
        phases = phases_of(fit.jacobian.base, observations.wrench, model.scene)
        return find_events(phases, observations.pose, present, noise, model.scene)

    events = events_of(fit)
    for _ in range(CUTS):
        windows = Windows.around(events, HITS)
        predictor = Predictor(model, observations.wrench, windows, candidates)
        experiment, point = begin(predictor, observations, present, noise, fit.point.nominal, fit.jacobian.base)
        fit = gauss_newton(experiment, point, NONE)
        fit = gauss_newton(experiment, search(experiment, fit), NONE)
        missed = events_of(fit) & ~windows.spread(windows.busy)
        if not bool(missed.any()):
            break
        events = events | missed
    return experiment, fit, events


def _follow(
    experiment: Experiment, alone: Fit, present: Tensor, error: ReaderError | None, say: Say
) -> tuple[Experiment, Fit, Noise]:
    """Follow the other engine from a fit without it, and give up the busy windows in which that does not succeed.

    After a hit the state depends on tiny differences before it, so that in some windows no first state makes the other
    engine go where the recording went. They return to their fit without it, and `floors` tells how little they count.
    """
    windows = experiment.predictor.windows
    noise, experiment = _weighed(experiment, alone, present, error)
    own = _own_weight(windows, experiment.misfit(alone.point), windows.busy)
    fit = experiment.linearise(alone.point.replace(engine=torch.ones_like(alone.point.engine)), NONE)
    followed, fit = settle(experiment.replace(scale=experiment.scale * own), fit, NONE, (), say)
    misfit = experiment.replace(engine=followed.engine).misfit(fit.point)
    lost = windows.busy & (misfit > LOST * _usual(windows, misfit))
    point = between(alone.point, fit.point, (~lost).double())
    engine = torch.where(windows.spread(lost)[..., None, None], torch.zeros((), dtype=torch.float64), followed.engine)
    experiment = experiment.replace(follow=~lost, engine=engine)
    fit = experiment.linearise(point, NONE)
    noise, experiment = _weighed(experiment, fit, present, error)
    own = _own_weight(windows, experiment.misfit(fit.point), lost)
    experiment = experiment.replace(scale=experiment.scale * own)
    return experiment, experiment.linearise(point, NONE), noise


def _own_weight(windows: Windows, misfit: Tensor, doubtful: Tensor) -> Tensor:
    """Let doubtful windows (K,) count as if their noise were as large as their misfit; shape (R, T, 1, 1)."""
    own = torch.where(doubtful, _usual(windows, misfit) / misfit.clamp_min(1e-9), torch.ones_like(misfit))
    return windows.spread(own.clamp_max(1).sqrt())[..., None, None]


def _usual(windows: Windows, misfit: Tensor) -> Tensor:
    """Return the median misfit of busy windows, at least 1: what an effect does to all of them is usual."""
    busy = misfit[windows.busy]
    return busy.median().clamp_min(1) if len(busy) else torch.ones((), dtype=misfit.dtype)


def _weighed(experiment: Experiment, fit: Fit, present: Tensor, error: ReaderError | None) -> tuple[Noise, Experiment]:
    """Estimate the noise from the residuals of a fit, and weigh its frames."""
    noise = estimate_noise(fit.residual, present, error)
    weight = frame_weights(fit.residual, present, noise)
    return noise, experiment.replace(scale=weight[..., None].sqrt() / noise.spread())


def begin(
    predictor: Predictor,
    observations: Observations,
    present: Tensor,
    noise: Noise,
    nominal: Tensor | None = None,
    before: Prediction | None = None,
) -> tuple[Experiment, Variants]:
    """Return the experiment and a first point, with the best guess of each window's first state.

    Where a prediction `before` is known, say of shorter windows, its states are guesses as well: the speed that some
    noisy frames suggest may let bodies hit each other that have passed, and no step leads back from there.
    """
    model, windows = predictor.model, predictor.windows
    starts = guess_starts(observations.pose, present, windows, model.scene)
    if before is not None:
        pose, twist = (value[:, windows.trajectory, windows.start] for value in (before.state, before.twist))
        starts = replace(starts, pose=torch.cat([starts.pose, pose]), twist=torch.cat([starts.twist, twist]))
    normal = torch.tensor(model.scene.ground.normal, dtype=torch.float64)
    experiment = Experiment(
        predictor,
        observations.pose,
        present[..., None].sqrt() / noise.spread(),
        observations.fitted,
        Directions.of(normal, starts.resting),
        torch.zeros(*observations.pose.shape[:-1], 6, dtype=torch.float64),
        torch.ones(len(windows), dtype=torch.bool),
    )
    one = Variants(
        starts.pose[:1],
        starts.twist[:1],
        model.guess[None] if nominal is None else nominal,
        predictor.null[None],
        torch.zeros(1, 1, dtype=torch.float64),
    )
    many = one.repeat(len(starts.pose)).replace(pose=starts.pose, twist=starts.twist)
    best = try_losses(experiment, many).argmin(0)
    pick = torch.arange(len(best))
    return experiment, one.replace(pose=starts.pose[best, pick][None], twist=starts.twist[best, pick][None])


def _scan(experiment: Experiment, point: Variants) -> Variants:
    """Try multiples of the first guesses, one unknown parameter after the other; a bad guess may leave no slope."""
    model = experiment.predictor.model
    counts = experiment.fitted[experiment.predictor.windows.trajectory]
    for column in range(len(model.unknown)):
        many = point.repeat(len(FACTORS))
        values = model.to_values(many.nominal)
        values[:, column] *= torch.tensor(FACTORS, dtype=torch.float64)
        many = many.replace(nominal=model.to_coordinates(values))
        losses = try_losses(experiment, many)[:, counts].clamp_max(1e12).sum(1)
        best = int(losses.argmin())
        point = many[best : best + 1]
    return point
