"""Settings of the conclusion: verdict, probabilities, gap, materiality, and the next experiment."""

from __future__ import annotations

from physid.estimation.measurement.misfit import SHARE_OF_NOISE, SHARE_OF_SIZE
from physid.setting import Section, setting


class PosteriorSettings(Section):
    """How probable each cause is; the coefficients are in physid/diagnosis/posterior/coefficients.yaml."""

    mass: float = setting(0.9, "-", "probability of the fewest causes that a report lists", gt=0, lt=1)
    listed: int = setting(8, "hypotheses", "first ones of the ranking that have a probability of their own", ge=1)


class BootstrapSettings(Section):
    """How far estimates scatter where impacts amplify."""

    replays: int = setting(6, "replays", "of the reference simulator; 0 adds nothing to intervals", ge=0)


class GapSettings(Section):
    """How far the gap closes."""

    least: float = setting(1e-3, "floors", "excess that the shrink of a drawn set is divided by at least", gt=0)
    bootstraps: int = setting(1000, "draws", "of trajectories, for the interval of a shrink", ge=10)
    fewest: int = setting(3, "trajectories", "from which on a shrink has an interval", ge=1)
    interval: tuple[float, float] = setting((0.05, 0.95), "-", "quantiles of that interval", "by definition")
    most_closed: float = setting(
        1.5, "share", "beyond which an interval of a shrink says that the floor is too near to be subtracted", ge=1
    )
    no_gap: float = setting(
        1.02, "floors", "error below which there is no gap to close", "as in docs/benchmark.md", gt=1
    )


class MaterialitySettings(Section):
    """What a model may leave before anything is blamed for it."""

    tolerance: float | None = setting(
        None,
        "m",
        "that positions may leave the model; null for what follows from noise and sizes; with 0 all would leave it",
        gt=0,
    )
    share_of_noise: float = setting(
        SHARE_OF_NOISE, "share", "of the error that a perfect model leaves of noisy poses", gt=0
    )
    share_of_size: float = setting(
        SHARE_OF_SIZE, "share", "of the largest edge: faces that are not flat, edges that are not sharp", gt=0
    )
    regained: float = setting(
        0.5,
        "share",
        "of the segments with an event that the nominal model does not explain: if effects explain more, all count",
        "decision 91",
        ge=0,
        le=1,
    )
    fewest: int = setting(3, "segments", "that effects must explain of these at least", "decision 91", ge=1)


class PowerSettings(Section):
    """What could have been found."""

    probability: float = setting(
        0.95,
        "-",
        "with which an effect of the reported size would have been found",
        "by definition",
        gt=0,
        lt=1,
    )


class VerdictSettings(Section):
    """When a verdict is partial, and when another protocol contradicts it."""

    partly: float = setting(0.4, "share", "of the gap that may be left for `partial`; with more: `unknown`", ge=0, le=1)
    carries: float = setting(
        0.5, "share", "of the gap on the transfer protocol that the interval of its shrink must reach; -1e9 for none"
    )
    nearly: float = setting(1.05, "floors", "error after, that contradicts nothing", ge=1)
    chance: float = setting(
        0.02,
        "probability",
        "with which the error of the true model is larger than what contradicts nothing; 1 for `nearly` alone",
        "by definition",
        gt=0,
        le=1,
    )
    reconsidered: bool = setting(True, "", "whether effects whose sizes may all be zero are dropped without a gap")
    most_cells: int = setting(12, "cells", "of the map that are written", ge=0)
    most_ranks: int = setting(20, "hypotheses", "of the ranking that are written", ge=1)
    freed: float = setting(
        0.3, "-", "first guess of a friction or restitution that is given as 0, where another value is tried", gt=0
    )


class SiteSettings(Section):
    """How sites are weighed, and phases are divided."""

    named: float = setting(0.01, "share", "of the best gain that divides a weight by e, where effects are named", gt=0)
    unnamed: float = setting(
        0.1, "share", "the same between the best residual laws of sites, where none is named", gt=0
    )
    least: float = setting(2.0, "squared residuals", "that divide a weight by e at least", gt=0)
    rounding: float = setting(1e-6, "squared residuals", "gain of a cell that is nothing but rounding", ge=0)
    work: float = setting(1e-12, "J", "that effects do in all, or less, is the engine's rounding and none", ge=0)
    share: float = setting(1e-4, "share", "of a phase below which it is left out", ge=0, lt=1)


class NextExperimentSettings(Section):
    """Which experiment would tell a group apart."""

    drawn: int = setting(12, "trajectories", "of each protocol that are tried", ge=1)
    steps: int = setting(300, "frames", "of a trajectory without impacts, at most", ge=2)
    steps_with_impacts: int = setting(60, "frames", "of one with impacts: only its beginning can be foretold", ge=2)
    longest: float = setting(3.0, "s", "that a trajectory without impacts lasts, at any frame rate", gt=0)
    longest_with_impacts: float = setting(1.0, "s", "that one with impacts lasts", gt=0)
    record: int = setting(24, "trajectories", "that are asked for", ge=1)
    apart: float = setting(8.0, "standard deviations", "over all of them, by which predictions must differ", gt=0)
    more: float = setting(2.0, "-", "times as far as over as many like those that are there", ge=1)
    imitation_steps: int = setting(8, "steps", "most Gauss-Newton steps of a hypothesis that imitates another", ge=1)
