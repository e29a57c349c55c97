"""Settings of the search: which candidates are fitted, compared, and kept."""

from __future__ import annotations

from physid.diagnosis.settings.origins import FLIGHTS, IMPACTS
from physid.setting import Section, setting


class ContactFreeSettings(Section):
    """The search in contact-free segments."""

    first: bool = setting(True, "", "whether contact-free segments are searched first, and alone", FLIGHTS)
    late: float = setting(
        0.05, "s", "first frames of a segment in which a late camera shows what was before it", FLIGHTS, ge=0
    )


class CandidateSettings(Section):
    """Which hypotheses are worth fitting."""

    most_singles: int = setting(20, "effects", "most that are fitted alone", "decision 74", ge=1)
    most_effects: int = setting(3, "effects", "most that are blamed together", "decision 66", ge=1)
    most_combinations: int = setting(5, "hypotheses", "of one effect more, most that are fitted at a time", ge=1)
    exchanged: bool = setting(
        True,
        "",
        "whether each effect of the best combination is exchanged for what explains most in its place",
        "decision 66",
    )


class ComparisonSettings(Section):
    """How candidates are compared."""

    behind: float = setting(
        0.5, "share", "of the gap, beyond the best, that a hypothesis may leave after a few steps", ge=0
    )
    most_refitted: int = setting(4, "hypotheses", "most that are fitted with the reference simulator; 0 for none", ge=0)
    near: float = setting(0.2, "share", "of the gap, beyond the best, that these leave at most", ge=0)


class AttributionSettings(Section):
    """When more is tried."""

    further: float = setting(0.01, "share", "of the gap from which on one effect more is looked for", ge=0)
    multi_start: int = setting(
        6, "effects", "fitted again from finite sizes where the best leaves a gap; 0 for none", FLIGHTS, ge=0
    )
    at_impacts: int = setting(
        3, "effects", "tried beside one that contact-free segments showed; 0 for none", IMPACTS, ge=0
    )


class EvidenceSettings(Section):
    """Which evidence is enough."""

    alpha: float = setting(0.02, "-", "how often null simulations are called suspicious", IMPACTS, gt=0, lt=1)
    clear: float = setting(2.5, "standard errors", "by which a prediction must be worse to be told apart", gt=0)
    least: float = setting(12.0, "squared residuals", "by which a prediction must be better at least", gt=0)
    same: float = setting(
        0.003, "share", "of what the best explains that the numerics may decide between two hypotheses", ge=0
    )
    evident: float = setting(
        1.5,
        "noise variances",
        "mean squared residual of the median trajectory that no model reaches which lacks nothing; 1e9 for none",
        "decision 74",
        gt=0,
    )
    closed: float = setting(0.02, "share", "of the gap that may be left without a second look", FLIGHTS, ge=0)
    closed_by_more: float = setting(
        0.25, "share", "of that, for each further effect that is blamed", "decision 66", ge=0, le=1
    )
    further_explains: float = setting(0.5, "share", "of what effects leave that one more must explain", FLIGHTS, ge=0)
