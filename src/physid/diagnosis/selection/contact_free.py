"""Where nothing is hit: motion that the model can follow decides alone what it can decide."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from physid.diagnosis.inputs.requirements import LEAST_FITTED
from physid.diagnosis.reference.discrepancy import Say, settle
from physid.diagnosis.reference.nominal_fit import NONE, Prepared, begin
from physid.diagnosis.reference.null_simulations import floors
from physid.diagnosis.testing.hypothesis import Hypothesis, conclude
from physid.estimation.least_squares.levenberg_marquardt import gauss_newton
from physid.estimation.least_squares.multi_start import try_again
from physid.estimation.measurement.sensor_noise import frame_weights
from physid.estimation.prediction.segments import CALM, Windows

LATE = 0.05  # [s] first frames of a window in which a late camera would still show what was before it


def calm(prepared: Prepared, generator: torch.Generator, say: Say = lambda _: None) -> Prepared | None:
    """Return the same recordings with calm windows alone, and the nominal model fitted to these.

    After a hit the state depends on tiny differences before it: such windows outweigh, by chance and by far, what an
    effect does to a flight. What shows in calm windows is therefore looked for there first.

    Args:
        prepared: The fitted nominal model.
        generator: Randomness of replays that tell where the numerics disturb.
        say: Told what is being done.

    Returns:
        None where no window is busy, or fewer fitted trajectories have calm windows than a diagnosis needs.
    """
    observations, noise, base = prepared.observations, prepared.noise, prepared.fit.jacobian.base
    windows = Windows.around(prepared.events, CALM)
    chosen = (~windows.busy).nonzero()[:, 0]
    fitted = observations.fitted[windows.trajectory[chosen].unique()]
    if len(chosen) == len(windows) or int(fitted.sum()) < LEAST_FITTED:
        return None
    say("fitting the nominal model where nothing is hit")
    predictor = prepared.experiment.predictor.over(windows.only(chosen), base.state[0])
    quiet, point = begin(predictor, observations, prepared.present, noise, prepared.fit.point.nominal, base)
    fit = gauss_newton(quiet, point.replace(engine=prepared.fit.point.engine), NONE)
    weight = frame_weights(fit.residual, prepared.present, noise)
    weight = weight * _own_frames(predictor.windows, observations.scene.time_step)[..., None]
    quiet = quiet.replace(scale=weight[..., None].sqrt() / noise.spread())
    fit = quiet.linearise(fit.point, NONE)
    extra = predictor.windows.spread((1 + floors(quiet, fit, generator)).rsqrt())
    quiet, fit = settle(quiet.replace(scale=quiet.scale * extra[..., None, None]), fit, NONE, (), say)
    return replace(prepared, experiment=quiet, fit=fit)


def everywhere(prepared: Prepared, best: Hypothesis) -> Hypothesis:
    """Fit unknown parameters and first states to all windows, with the effects that calm windows found.

    Args:
        prepared: The nominal model, fitted to all windows.
        best: The hypothesis, fitted to the calm ones.

    Returns:
        The hypothesis without free parameters of effects: its shared columns are the unknown parameters.
    """
    experiment, point = prepared.experiment, prepared.fit.point.replace(effects=best.fit.point.effects)
    fit = gauss_newton(experiment, try_again(experiment, point), NONE)
    experiment, fit = settle(experiment, fit, NONE, best.names)
    return replace(conclude(experiment, fit, ()), names=best.names)


def _own_frames(windows: Windows, time_step: float) -> Tensor:
    """Tell which frames (R, T) are of windows, but for first ones that a late camera would take from before them."""
    late = torch.where(windows.start > 0, (windows.size // 2).clamp_max(round(LATE / time_step)), 0)
    inside = windows.spread(torch.ones(len(windows), dtype=torch.bool))
    return inside & (windows.position >= windows.spread(late))
