"""From what was read to what is concluded: fit, search and verdict, with one source of randomness."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from physid.diagnosis.conclusion.conclusion import Conclusion, draw_conclusion
from physid.diagnosis.inputs import Inputs
from physid.diagnosis.progress import Progress, silent
from physid.diagnosis.reference.fit_findings import findings_of_fit
from physid.diagnosis.reference.nominal_fit_cache import fit_or_resume
from physid.diagnosis.selection.attribution import attribute
from physid.diagnosis.selection.given_parameters import findings_of_given
from physid.diagnosis.settings.settings import Settings


def analyse(inputs: Inputs, folder: Path, seed: int, settings: Settings, say: Progress = silent) -> Conclusion:
    """Fit the nominal model, search for what it lacks, and judge what was found.

    Args:
        inputs: What was recorded, what is believed, and what may be missing.
        folder: Keeps the nominal fit, from which an interrupted analysis goes on.
        seed: Of the null simulations and of the bootstrap.
        settings: Every number that decides.
        say: Called with what is being done.

    Raises:
        ValueError: If the nominal model cannot be simulated where the recordings go.
    """
    generator = torch.Generator().manual_seed(seed)
    nominal_fit = fit_or_resume(folder, inputs, generator, settings, say)
    found = attribute(nominal_fit, generator, say)
    conclusion = draw_conclusion(nominal_fit, found, generator)
    findings = (*inputs.findings, *findings_of_fit(nominal_fit))
    if conclusion.diagnosis.verdict != "none":
        findings = (*findings, *findings_of_given(inputs, nominal_fit, seed, say))
    return replace(conclusion, diagnosis=replace(conclusion.diagnosis, findings=findings))
