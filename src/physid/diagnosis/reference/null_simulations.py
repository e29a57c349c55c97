"""Null simulations: recordings as the reference simulator makes them if the fitted nominal model is true."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from physid.diagnosis.reference.replay import Reference, references_of, replay
from physid.diagnosis.settings.settings import Settings
from physid.estimation.least_squares import Experiment, Fit, Part, prior, try_losses
from physid.estimation.measurement import Noise, force_noise, with_force_noise
from physid.estimation.prediction import Variants
from physid.physics import Effect


@dataclass(frozen=True)
class NullSimulations:
    """Residuals that null simulations would leave.

    Attributes:
        residual: Observed minus predicted, shape (Z, R, T, N, 6).
    """

    residual: Tensor


def draw_null_simulations(
    experiment: Experiment,
    fit: Fit,
    noise: Noise,
    effects: tuple[Effect, ...],
    settings: Settings,
    generator: torch.Generator,
) -> NullSimulations:
    """Make data as they would be if the fit were the truth.

    The recorded forces are replayed in the references, one after the other, from states and parameters as uncertain as
    the fit, and noise is added.

    Args:
        experiment: The experiment.
        fit: The model that is taken to be true.
        noise: White noise of the poses.
        effects: Effects of that model, beside the nominal ones.
        settings: How many replays R of reference simulators, and draws D of the noise for each.
        generator: Source of randomness.

    Returns:
        Z = R D data sets.
    """
    model = experiment.predictor.model
    working = (*model.effects_at(fit.point.nominal), *effects)
    residuals, references = [], references_of(model.scene, settings.replay, working)
    for run in range(settings.null_simulations.replays):
        clean = noiseless(experiment, fit, effects, settings, generator, references[run % len(references)])
        residuals.append(clean + noise.draw(settings.null_simulations.draws, clean, generator))
    return NullSimulations(torch.cat(residuals))


def noiseless(
    experiment: Experiment,
    fit: Fit,
    effects: tuple[Effect, ...],
    settings: Settings,
    generator: torch.Generator,
    reference: Reference | None = None,
) -> Tensor:
    """Return the residuals of one replay, without noise of the poses, shape (R, T, N, 6); see `draw_null_simulations`.

    Forces are disturbed as much as recorded ones are noisy (`force_noise`): what a sensor adds moves no body.
    """
    predictor = experiment.predictor
    point, timeline = jitter(experiment, fit, settings, generator), predictor.timeline
    grid = with_force_noise(timeline.grid, force_noise(timeline.grid, settings.noise), generator)
    real = replay(
        predictor.model,
        dataclasses.replace(timeline, grid=grid),
        predictor.segments,
        point,
        settings.replay,
        effects,
        reference=reference,
    )
    return experiment.replace(pose=real).residual(fit.jacobian.base.pose, fit.point)[0]


def floors(experiment: Experiment, fit: Fit, settings: Settings, generator: torch.Generator) -> Tensor:
    """Compute how much the numerics disturb each segment: squared residuals per frame that replays leave.

    Where small differences grow (impacts, a body that just stops), two runs of one engine from states that the data
    cannot tell apart differ by more than the noise.

    Returns:
        Mean square in units of the noise, after initial states and unknown parameters are fitted again; shape (K,).
    """
    replays = settings.null_simulations.floor_replays
    if not replays:
        return torch.zeros_like(fit.loss)
    unknown = torch.arange(fit.point.nominal.shape[1] + 1)
    model = experiment.predictor.model
    references = references_of(model.scene, settings.replay, model.effects_at(fit.point.nominal))
    runs = (references[run % len(references)] for run in range(replays))
    clean = torch.stack([noiseless(experiment, fit, (), settings, generator, reference) for reference in runs])
    respond = fit.linear.respond(clean, experiment.scale).select(unknown).of(experiment.fitted)
    matrix = respond.matrix.sum(0) + torch.diag(prior(experiment, torch.zeros(0, dtype=torch.int64)))
    change = torch.linalg.solve(matrix, respond.vector.sum(0))
    return left_by_states(
        experiment, fit, clean - torch.einsum("pz,prtnk->zrtnk", change, fit.jacobian.shared[unknown])
    )


def left_by_states(experiment: Experiment, fit: Fit, residuals: Tensor) -> Tensor:
    """Compute what initial states, fitted anew, leave of residuals.

    Args:
        experiment: The experiment.
        fit: A fit near which the model is linear in initial states.
        residuals: Shape (Z, R, T, N, 6).

    Returns:
        Mean square in units of the noise of each segment, averaged over Z; shape (K,).
    """

    def left(part: Part) -> Tensor:
        data = part.batch.columns(residuals * experiment.scale)
        return part.profiled(data).square().sum(1).mean(-1)

    return fit.linear.gather(left) / experiment.counted()


def jitter(experiment: Experiment, fit: Fit, settings: Settings, generator: torch.Generator) -> Variants:
    """Draw initial states and unknown parameters around a fit, as far as the data leave them open."""
    unknown = fit.point.nominal.shape[1]
    normal = fit.normal().of(experiment.fitted)
    ridge = prior(experiment, torch.zeros(0, dtype=torch.int64))[:unknown]
    matrix = normal.matrix.sum(0)[:unknown, :unknown] + torch.diag(ridge)
    draw = torch.randn(unknown, 1, generator=generator, dtype=torch.float64)
    shift = torch.linalg.solve_triangular(torch.linalg.cholesky(matrix).mT, draw, upper=True)[:, 0]
    shared = torch.zeros(fit.linear.parts[0].shared.shape[-1], dtype=torch.float64)
    shared[:unknown] = shift
    states = []
    # A initial velocity that friction stops at once leaves no trace; then what the first frames show bounds the draw.
    sure = torch.diag(1 / _first_frames(experiment, settings) ** 2)
    for part in fit.linear.parts:
        free = torch.randn(*part.factor.shape[:2], 1, generator=generator, dtype=torch.float64)
        factor = torch.linalg.cholesky(part.factor @ part.factor.mT + sure)
        follow = torch.cholesky_solve(part.state.mT @ (part.shared @ shared)[..., None], factor)
        states.append((torch.linalg.solve_triangular(factor.mT, free, upper=True) - follow)[..., 0])
    order = torch.cat([part.batch.segments for part in fit.linear.parts]).argsort()
    drawn = fit.point.replace(nominal=fit.point.nominal + shift)
    return _believable(experiment, fit, drawn, torch.cat(states)[order], settings)


def _believable(experiment: Experiment, fit: Fit, drawn: Variants, change: Tensor, settings: Settings) -> Variants:
    """Move initial states by a draw (K, D), shortened in contact-free segments as long as the data contradict it.

    A body that starts near rest takes small velocities in its stride or slips for long; a line knows nothing of that.
    """
    contact_free, limits = ~experiment.predictor.segments.contact, settings.null_simulations
    free = change.shape[1]
    most = fit.loss + free + limits.sure * (2 * free) ** 0.5
    for _ in range(limits.halvings):
        pose, twist = experiment.directions.move(fit.point.pose, fit.point.twist, change[None])
        moved = drawn.replace(pose=pose, twist=twist)
        wrong = contact_free & (try_losses(experiment, moved)[0] > most)
        if not bool(wrong.any()):
            break
        change = torch.where(wrong[:, None], change / 2, change)
    return moved


def p_value(observed: float, null: Tensor) -> float:
    """Return (1 + #{null >= observed}) / (1 + #null), which is never 0."""
    return (1 + int((null >= observed).sum())) / (1 + len(null))


def _first_frames(experiment: Experiment, settings: Settings) -> Tensor:
    """Return the standard deviations of initial states that a line through the first frames would leave, shape (D,)."""
    step = experiment.predictor.model.scene.time_step
    count = max(float(settings.null_simulations.first_frames), experiment.settings.guess.spans[0] / step)
    still = [1 / float(experiment.scale[..., k : k + 3].amax()) for k in (0, 3)]
    slope = (12 / count**3) ** 0.5 / step
    kinds = [k // 3 for _, k in experiment.directions.used]
    return torch.tensor([still[kind % 2] * (1.0 if kind < 2 else slope) for kind in kinds], dtype=torch.float64)
