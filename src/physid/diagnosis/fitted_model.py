"""The nominal model with what was found, as a configuration that `physid fit` takes, and what is missing as effects."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from physid.data.files import write_text
from physid.diagnosis.conclusion.conclusion import Conclusion
from physid.diagnosis.document.effect_file import effect_file
from physid.effects import CATALOGUE
from physid.strict import one_line

DIGITS = 6


def save_model(path: Path, conclusion: Conclusion) -> None:
    """Write a configuration of `physid fit`: parameters start from their new estimates, the effects are at work.

    An effect of a user's own file is named like those of the catalogue; a comment says that the file has to be allowed.

    Args:
        path: The file, NAME.yaml.
        conclusion: What was found; without effects the nominal model is written, refitted.
    """
    diagnosis, chosen = conclusion.diagnosis, conclusion.judgement.chosen
    nominal_fit = conclusion.judgement.nominal_fit
    model = nominal_fit.experiment.predictor.model
    known = {kind.name for kind in CATALOGUE}
    effects = {effect.name: _values(effect.values()) for effect in model.effects}
    effects |= {
        one.name: _values({name: value.value for name, value in one.parameters.items()}) for one in diagnosis.effects
    }
    values = {
        name: _rounded(one.nominal if one.with_effect is None else one.with_effect.value)
        for name, one in diagnosis.parameters.items()
    }
    content: dict[str, Any] = {
        "seed_everything": 0,
        "model": {
            "class_path": "physid.training.learners.sysid.SysID",
            "learn": list(model.unknown),
            "values": values,
            "engine": {"substeps": model.substeps, "effects": effects},
            "optimizer": {"class_path": "physid.training.parameters.gauss_newton.GaussNewton"},
        },
        "data": {
            "class_path": "physid.data.batches.datamodule.RecordingsDataModule",
            "folder": str(nominal_fit.observations.folder),
            "shuffle": False,
        },
        "trainer": {"accelerator": "cpu", "max_epochs": 12},
    }
    found = f"with {' and '.join(chosen.names)}" if chosen else "as it was believed: nothing was found"
    head = f"# The nominal model {found}. physid fit --config {one_line(shlex.quote(path.name))}\n"
    own = [name for name in effects if name not in known]
    head += "".join(f"# {name} is an effect of your own: add --allow and its file.\n" for name in own)
    write_text(path, head + yaml.safe_dump(content, sort_keys=False, width=120))


def missing_effects(place: Path, conclusion: Conclusion) -> str | None:
    """Return a file with what is missing as effects (see `effect_file`); None where nothing is, or none can be.

    Args:
        place: Where it will stand.
        conclusion: What was found.
    """
    fit = conclusion.judgement.nominal_fit
    ground, still = fit.experiment.directions.frame, fit.settings.phases.still_speed
    return effect_file(conclusion.diagnosis.residual, ground, still, str(place))


def _values(values: Mapping[str, Any]) -> dict[str, float]:
    return {name: _rounded(float(value)) for name, value in values.items()}


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
