"""Settings of the tests of a hypothesis."""

from __future__ import annotations

from physid.diagnosis.settings.origins import IMPACTS
from physid.setting import Section, setting

TAILS = "decision 0013, opened bank 1414"


class ScoreTestSettings(Section):
    """What a candidate would gain."""

    visible: float = setting(
        1.0, "standard deviations", "that the largest sizes must make in a direction that is tested", gt=0
    )
    steady: bool = setting(True, "", "whether gains count without the impact that says most for them", IMPACTS)


class LackOfFitSettings(Section):
    """What a hypothesis leaves unexplained."""

    margin: float = setting(1.25, "-", "factor by which a gain must exceed those in null simulations", IMPACTS, ge=1)
    quantile: float = setting(0.99, "share", "of null simulations that a significant gain exceeds", IMPACTS, gt=0, lt=1)
    cell_draws: int = setting(10, "simulations", "every so many null simulations serve for the cells", ge=1)


class ResidualWrenchSettings(Section):
    """A residual wrench that is free to be anything."""

    piece_time: float = setting(0.16, "s", "length of one piece", gt=0)
    force: float = setting(1.0, "N", "unit of a residual force", gt=0)
    torque: float = setting(0.1, "N m", "unit of a residual torque", gt=0)
    spread: float = setting(100.0, "units", "prior standard deviation", gt=0)
    seldom: float = setting(0.01, "share", "of the frames; a phase that makes up less has no cell", ge=0, lt=1)


class HypothesisSettings(Section):
    """How effects are fitted."""

    confidence: float = setting(0.9, "-", "probability of the intervals that are reported", "by definition", gt=0, lt=1)
    strides: tuple[float, ...] = setting((1.0, 0.5, 0.25, 0.1), "-", "parts of the linear step that are tried first")
    kept: float = setting(
        0.5, "share", "of what a line promises that a step must keep; else initial states follow along a curve", TAILS
    )
    curved: tuple[float, ...] = setting((1.0, 0.5), "-", "parts of the step tried along that curve; [] for none", TAILS)
    curved_steps: int = setting(3, "steps", "Gauss-Newton steps of unknown parameters there", TAILS, ge=1)
    finite_sizes: tuple[float, ...] = setting(
        (1.0, 3.0), "typical sizes", "from which a fit may begin", "decision 0011, calibration bank 607"
    )
    first_steps: int = setting(3, "steps", "most Gauss-Newton steps of a hypothesis that is begun", "decision 74", ge=1)
    last_steps: int = setting(16, "steps", "most of one that is fitted to the end", ge=1)
    new_states: bool = setting(True, "", "whether initial states are guessed anew where an effect is known")
    new_states_steps: int = setting(8, "steps", "most Gauss-Newton steps from them", ge=1)


class EquivalenceSettings(Section):
    """Effects that recordings cannot tell apart."""

    alike: float = setting(0.98, "squared cosine", "of two signatures from which on they are one; 2 for never", gt=0)
    contact_free: float = setting(
        0.5, "share", "of a signature that must lie in contact-free segments to be judged there", ge=0, le=1
    )


class ResidualLawSettings(Section):
    """What a better model would have to add, where the catalogue does not explain the gap."""

    most: int = setting(2, "laws", "most that are described; 0 for none", ge=0)
    explains: float = setting(
        0.1, "share", "of what is left that each must explain, in trajectories it was not fitted to", ge=0, le=1
    )
    knots: int = setting(5, "knots", "of the function of a variable that is a law's size", ge=2)
    most_knots: int = setting(120, "knots", "of a function of time; longer trajectories have them further apart", ge=2)
    time: float = setting(0.08, "s", "between knots of a function of time; a force has at most one to a piece", gt=0)
