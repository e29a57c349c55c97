"""What the fitted nominal model shows of recordings: trajectories of another body, noise of poses and of forces."""

from __future__ import annotations

from physid.diagnosis.inputs.observations import TRANSFER
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.estimation.measurement import CorrelatedNoise, force_noise
from physid.estimation.segmented_fit import odd_trajectories
from physid.inspection.finding import Finding, warn_of
from physid.inspection.rules.fitted import correlated_noise, noisy_forces, odd_trajectory, unexplained_impacts


def findings_of_fit(nominal_fit: NominalFit) -> tuple[Finding, ...]:
    """Return what looks wrong with trajectories once the model is fitted, and remarks on the noise; warn of it."""
    experiment, observations = nominal_fit.experiment, nominal_fit.observations
    among, error = ~observations.having(TRANSFER), nominal_fit.noise.error
    odd = odd_trajectories(experiment, nominal_fit.fit, among, nominal_fit.settings.odd)
    found = [odd_trajectory(observations.indices[one.row], one.names, one.own, one.others) for one in odd]
    if (left := nominal_fit.unexplained_events) is not None:
        found.append(unexplained_impacts(left, experiment.predictor.model.scene))
    found += [correlated_noise(error)] if isinstance(error, CorrelatedNoise) else []
    if bool((density := force_noise(observations.timeline.grid, nominal_fit.settings.noise)).any()):
        found.append(noisy_forces(density, [body.mass for body in observations.scene.bodies]))
    warn_of(found, observations.folder)
    return tuple(found)
