"""The score test of many effects at once, and what chance gives it in null simulations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.diagnosis.reference.null_simulations import NullSimulations
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing.hypothesis import Hypothesis
from physid.diagnosis.testing.null_tails import Tail
from physid.diagnosis.testing.score_test import Conditional, Group, condition, gains, groups_of, signals, steady_gains
from physid.estimation.least_squares import Experiment, Fit, Normal, prior


@dataclass(frozen=True)
class NullDistribution:
    """What effects gain in Z null simulations.

    Attributes:
        tail: How far the gain of each effect reaches there, shape (G,).
        steady_tail: The same of steady gains.
        best: The largest deviation of a gain in each set (Westfall and Young 1993), shape (Z,).
        steady: The same of steady gains.
    """

    tail: Tail
    steady_tail: Tail
    best: Tensor
    steady: Tensor


@dataclass(frozen=True)
class Gain:
    """What one group of columns would gain.

    Attributes:
        names: The effect (or several).
        gain: Explained squared residual, in units of the noise.
        steady: What is left of it without the impact that says most for it.
        change: Linear estimate of the parameters, shape (k,).
        signal: Steady gain that each parameter makes at its typical size, alone and without noise, shape (k,).
    """

    names: tuple[str, ...]
    gain: float
    steady: float
    change: Tensor
    signal: Tensor


@dataclass(frozen=True)
class ScoreTest:
    """What each group of columns would gain beside the nuisances.

    Attributes:
        experiment: The experiment.
        fit: A fit of it, linearised with the columns of all groups.
        groups: Columns of the effects.
        count: How many of the shared columns are unknown parameters, engine and effects; they come first.
        nuisance: Which columns are solved for.
        ridge: Prior precision of these.
        settings: What is visible, what fits badly, and what chance then does.
    """

    experiment: Experiment
    fit: Fit
    groups: list[Group]
    count: int
    nuisance: Tensor
    ridge: Tensor
    settings: Settings

    @property
    def impacts(self) -> Tensor:
        """Segments with impacts that determine shared parameters, shape (K,)."""
        segments = self.experiment.predictor.segments
        return segments.contact & self.experiment.fitted[segments.trajectory]

    def observed(self) -> tuple[Conditional, list[Gain]]:
        """Return the normal equations after the nuisances, and what each group would gain."""
        own = self.fit.linear.by_segment()
        given = self._given(own)
        impacts = own.select(torch.arange(self.count)).of(self.impacts)
        impacts = replace(impacts, vector=impacts.vector[..., None])
        found = []
        for group in self.groups:
            gain, change = gains(given, group, self.settings.score_test)
            steady = float(steady_gains(given, group, impacts, self.settings.score_test))
            signal = signals(given, group, impacts, self.settings.score_test)
            found.append(Gain(group.names, float(gain), steady, change[0], signal))
        return given, found

    def respond(self, null_data: NullSimulations) -> Normal:
        """Return the normal equations of null simulations by segment.

        Hits that fit badly count there as little as such impacts of the recording: by their misfit.
        """
        segments = self.experiment.predictor.segments
        response = self.fit.linear.respond_by_segment(null_data.residual, self.experiment.scale)
        away = response.square / self.experiment.counted()[:, None]
        share = torch.where(
            segments.contact[:, None], (self.settings.null_distribution.bad / away).clamp_max(1), torch.ones_like(away)
        )
        return replace(response, vector=share[:, None] * response.vector, square=share * response.square)

    def chance(self, response: Normal) -> NullDistribution:
        """Return what chance gives, by the normal equations of null simulations by segment."""
        given, test = self._given(response), self.settings.score_test
        each = torch.stack([gains(given, group, test)[0] for group in self.groups])
        impacts = response.select(torch.arange(self.count)).of(self.impacts)
        steady = torch.stack([steady_gains(given, group, impacts, test) for group in self.groups])
        tail, steady_tail = Tail.of(each), Tail.of(steady)
        return NullDistribution(
            tail, steady_tail, tail.deviation(each.T).amax(1), steady_tail.deviation(steady.T).amax(1)
        )

    def cleaned(self, null_data: NullSimulations, response: Normal) -> Tensor:
        """Return the residuals of null simulations after the nuisances are fitted to each set."""
        normal = response.per(self.experiment.predictor.segments).select(self.nuisance).of(self.experiment.fitted)
        change = torch.linalg.solve(normal.matrix.sum(0) + torch.diag(self.ridge), normal.vector.sum(0))
        return null_data.residual - torch.einsum("pz,prtnk->zrtnk", change, self.fit.jacobian.shared[self.nuisance])

    def _given(self, own: Normal) -> Conditional:
        """Solve for the nuisances in normal equations by segment."""
        by_trajectory = own.per(self.experiment.predictor.segments).select(torch.arange(self.count))
        return condition(by_trajectory.of(self.experiment.fitted), self.nuisance, self.ridge)


def score_test_of(hypothesis: Hypothesis, wrenches: Tensor | None = None) -> ScoreTest:
    """Return the score test of all effects that a hypothesis lacks, beside what it has.

    Args:
        hypothesis: What is fitted.
        wrenches: Residual wrenches, whose columns follow those of the effects in the linearised fit.
    """
    experiment = hypothesis.experiment
    terms = experiment.predictor.terms
    fit = experiment.linearise(hypothesis.fit.point, torch.arange(len(terms)), wrenches)
    offset = fit.point.nominal.shape[1] + 1
    groups = [
        group for group in groups_of(terms, offset, fit.point.effects[0]) if group.names[0] not in hypothesis.names
    ]
    nuisance = torch.cat([torch.arange(offset), offset + hypothesis.columns])
    ridge = prior(experiment, hypothesis.columns)
    return ScoreTest(experiment, fit, groups, offset + len(terms), nuisance, ridge, hypothesis.settings)
