"""Parameters that are given and may be wrong: whether another value of one of them explains the recordings."""

from __future__ import annotations

from dataclasses import replace

import torch

from physid.diagnosis.inputs import Inputs
from physid.diagnosis.progress import Progress, Stage
from physid.diagnosis.reference.nominal_fit import NominalFit, fit_nominal_model
from physid.diagnosis.selection.materiality import leaves_no_positions, tolerance_of
from physid.inspection.finding import Finding, warn_of
from physid.inspection.rules.fitted import given_parameter
from physid.physics import SolverError
from physid.scenes import Scene, given_in, with_parameters


def findings_of_given(inputs: Inputs, nominal_fit: NominalFit, seed: int, say: Progress) -> tuple[Finding, ...]:
    """Return which given parameters may be wrong (see `given_that_explain`); warn of them."""
    others = given_that_explain(inputs, nominal_fit, seed, say)
    scene, within = inputs.model.scene, tolerance_of(nominal_fit).position
    found = [given_parameter(name, scene.value(name), value, within) for name, value in others.items()]
    warn_of(found, inputs.observations.folder)
    return tuple(found)


def given_that_explain(inputs: Inputs, nominal_fit: NominalFit, seed: int, say: Progress) -> dict[str, float]:
    """Return the given parameters, another value of which leaves no gap of positions, and explains impacts.

    Effects of the catalogue stand for them otherwise: a friction that is given twice too large is half the gravity.
    Each is fitted beside the unknown ones, if it can show at all: a restitution where there are impacts, a mass where
    forces act on the body.

    Args:
        inputs: What the diagnosis starts from.
        nominal_fit: The nominal model as it is given.
        seed: Of the null simulations that measure numerics.
        say: Called with the parameter that is being fitted.
    """
    if leaves_no_positions(nominal_fit):
        return {}
    found, freed = {}, nominal_fit.settings.verdict.freed
    for name in showing(inputs.model.scene, nominal_fit):
        say(Stage.FREEING, name)
        scene = inputs.model.scene
        begun = scene if scene.value(name) > 0 else with_parameters(scene, {name: freed})
        model = replace(inputs.model, scene=replace(begun, unknown=(*scene.unknown, name)))
        generator = torch.Generator().manual_seed(seed)
        try:
            one = fit_nominal_model(inputs.observations, model, (), generator, settings=nominal_fit.settings)
        except SolverError:
            continue
        if leaves_no_positions(one):
            values = model.to_values(one.fit.point.nominal[0]).tolist()
            found[name] = values[model.unknown.index(name)]
    return found


def showing(scene: Scene, nominal_fit: NominalFit) -> tuple[str, ...]:
    """Return the given parameters that may show (see `given_that_explain`)."""
    pushed = (nominal_fit.observations.timeline.grid.wrench != 0).any(0).any(0).any(-1).tolist()
    struck = bool(nominal_fit.experiment.predictor.segments.struck.any())

    def shows(name: str) -> bool:
        body, field = scene.locate(name)
        return {"mass": pushed[body] or len(scene.bodies) > 1, "friction": True, "restitution": struck}[field]

    return tuple(name for name in given_in(scene) if shows(name))
