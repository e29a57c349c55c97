"""What a fitted hypothesis leaves unexplained, against data for which nothing is missing."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from physid.diagnosis.reference.null_simulations import p_value
from physid.diagnosis.settings.testing import LackOfFitSettings
from physid.diagnosis.testing.null_distribution import Gain
from physid.diagnosis.testing.null_tails import Tail, together
from physid.diagnosis.testing.residual_wrench import Cell
from physid.diagnosis.testing.score_test import Conditional, Group
from physid.estimation.least_squares import Fit


@dataclass(frozen=True)
class Row(Gain):
    """What one more effect would gain, beside chance.

    Attributes:
        tail: How far its gain reaches in null simulations.
        steady_tail: The same of its steady gain.
        p_value: How often any effect deviates as far in null simulations.
    """

    tail: Tail
    steady_tail: Tail
    p_value: float

    def deviation(self, margin: float = 1.0) -> float:
        """Return how rare the steady gain, divided by a margin, is by chance, in standard deviations.

        Hits let some effects gain much by chance, and others nothing.
        """
        return float(self.steady_tail.deviation(self.steady / margin))


@dataclass(frozen=True)
class LackOfFit:
    """What a hypothesis leaves unexplained.

    Attributes:
        fit: The hypothesis' fit, linearised with all candidates and residual wrenches.
        cells: What the residual wrenches are.
        rows: What each effect that it lacks would gain, best first.
        null_best: The largest deviation of a gain in each null simulation (Westfall and Young 1993), shape (Z,).
        null_steady: The same of steady gains.
        free: What a free residual wrench explains, by segment, shape (K,).
        null_free: The same for null simulations, shape (K, Z).
        conditional: Normal equations of all effects after the nuisances.
        groups: Columns of the effects.
        counted: Segments of the fitted trajectories that a free residual wrench may speak about, shape (K,).
        sound: The same of all trajectories, shape (K,).
        cell_gain: What a residual wrench in each cell alone explains, by segment, beyond the mean of null simulations;
            in the order of `cells`, shape (F, K).
        settings: By which margin chance must be exceeded.
    """

    fit: Fit
    cells: list[Cell]
    rows: list[Row]
    null_best: Tensor
    null_steady: Tensor
    free: Tensor
    null_free: Tensor
    conditional: Conditional
    groups: list[Group]
    counted: Tensor
    sound: Tensor
    cell_gain: Tensor
    settings: LackOfFitSettings

    @property
    def left(self) -> float:
        """What a free residual wrench explains in the fitted trajectories."""
        return float(self.free[self.counted].sum())

    @property
    def frames(self) -> float:
        """How many frames of the fitted trajectories a free residual wrench may speak about, at least 1."""
        return float(self.fit.linear.segments.size[self.counted].sum()) or 1.0

    @property
    def excess(self) -> float:
        """The same beyond what it explains in null simulations."""
        return self._excess(self.counted)

    @property
    def missing(self) -> float:
        """How much squared residual is unexplained beyond chance, as far as one effect or a free wrench shows it."""
        return max([0.0, self.excess, *(row.gain for row in self.significant)])

    @property
    def p_value(self) -> float:
        """How often null simulations look at least as suspicious: by one effect, or by a free residual wrench."""
        return min(1.0, 2 * min(self.p_best, self.p_free))

    @property
    def p_best(self) -> float:
        """How often null simulations gain as much by any one effect.

        Null simulations come from one reference simulator, and reality is a third: what is found must exceed them by a
        margin.
        """
        return (
            p_value(max(row.deviation(self.settings.margin) for row in self.rows), self.null_steady)
            if self.rows
            else 1.0
        )

    @property
    def p_free(self) -> float:
        """How often null simulations leave as much to a free residual wrench, with the same margin.

        In the fitted trajectories, or in all of them, whichever is more often: a gap is there as well where nothing was
        fitted.
        """
        return max(self._p_free(self.counted), self._p_free(self.sound))

    def _p_free(self, segments: Tensor) -> float:
        null = self.null_free[segments].sum(0)
        return p_value(float(null.mean()) + self._excess(segments) / self.settings.margin, null)

    def _excess(self, segments: Tensor) -> float:
        return float(self.free[segments].sum() - self.null_free[segments].sum(0).mean())

    @property
    def limit(self) -> float:
        """The deviation that the gain of some effect reaches in one of a hundred null simulations."""
        return float(self.null_best.quantile(self.settings.quantile))

    @property
    def significant(self) -> list[Row]:
        """The effects that gain more, steadily, than one in a hundred null simulations, best first."""
        limit = float(self.null_steady.quantile(self.settings.quantile))
        return [row for row in self.rows if row.deviation() >= limit]

    def reach(self, names: tuple[str, ...]) -> float:
        """Return what effects gain together in one of a hundred null simulations."""
        return float(self._tail(names).gain(self.limit))

    def chance(self, names: tuple[str, ...], gain: float) -> float:
        """Return how often null simulations give any effect as much as these gain together."""
        return p_value(float(self._tail(names).deviation(max(gain, 0.0))), self.null_best)

    def _tail(self, names: tuple[str, ...]) -> Tail:
        return together([row.tail for row in self.rows if row.names[0] in names])
