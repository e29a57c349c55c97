"""From what the search found to the verdict and the content of diagnosis.json."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from physid.diagnosis.conclusion.description import describe
from physid.diagnosis.conclusion.judgement import Judgement, judgement_of
from physid.diagnosis.conclusion.next_experiment import NextExperiment, next_experiment
from physid.diagnosis.document.document import Diagnosis
from physid.diagnosis.document.rounding import rounded
from physid.diagnosis.posterior.evidence import with_probabilities
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.search import Attribution


@dataclass(frozen=True)
class Conclusion:
    """A diagnosis, and what is behind it.

    Attributes:
        diagnosis: What is said.
        judgement: The verdict with the fits and the hypotheses that it rests on.
        further: The experiment that would tell the members of a group apart; None where there is no group.
    """

    diagnosis: Diagnosis
    judgement: Judgement
    further: NextExperiment | None = None


def draw_conclusion(nominal_fit: NominalFit, found: Attribution, generator: torch.Generator) -> Conclusion:
    """Judge what the search found: the verdict, the sizes with their intervals, and how far the gap closes.

    Args:
        nominal_fit: The recordings and the fitted nominal model.
        found: What the search found.
        generator: Randomness of the bootstrap.
    """
    judged = judgement_of(nominal_fit, found, generator)
    further = None if judged.chosen is None else next_experiment(nominal_fit, found)
    said = describe(judged, further.sentence if further else None, generator)
    said = with_probabilities(said, nominal_fit.observations, nominal_fit.settings)
    return Conclusion(rounded(said), judged, further)
