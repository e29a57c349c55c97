"""A fit that was stored is the fit, as long as nothing changes that it depends on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from diagnosis.flown import QUICK, nominal_fit_of, random
from estimation.flights import FORCE, Flights, flights
from physid.data.files import read_tensors
from physid.diagnosis.analysis import analyse
from physid.diagnosis.inputs import Inputs
from physid.diagnosis.progress import Stage
from physid.diagnosis.reference import nominal_fit_cache as cache
from physid.diagnosis.reference.fit_findings import findings_of_fit
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.reference.stored_fit import from_tensors, to_tensors
from physid.diagnosis.settings.settings import Settings
from physid.effects import find, from_values
from physid.estimation.least_squares import ChosenSteps
from physid.estimation.measurement import CorrelatedNoise, Correlation, Noise, TrackingError
from physid.estimation.prediction import NominalModel, Predictor
from physid.inspection.finding import Finding
from physid.inspection.rules.fitted import correlated_noise
from physid.physics import SolverError

ROLES = ("fit",) * 4 + ("same",) * 2
KINDS = ("constant_force", "viscous_drag")
SIZES = (*FORCE, 0.0)


def made(**changes: Any) -> Flights:
    return flights(**{"kinds": KINDS, "sizes": SIZES, "trajectories": len(ROLES), "frames": 16} | changes)


def inputs_of(fit: NominalFit) -> Inputs:
    predictor = fit.experiment.predictor
    return Inputs(fit.observations, predictor.model, predictor.candidates)


def correlated() -> CorrelatedNoise:
    parts = (Correlation(((0.4, 0.0, 1), (0.6, 3.0, 2))), Correlation(((1.0, 2.0, 1),)))
    return CorrelatedNoise((2e-3, 1e-3), parts, 16, QUICK.noise.sure)


def tracked(fit: NominalFit) -> TrackingError:
    track = 1e-3 * torch.randn((*fit.experiment.pose.shape[:3], 6), generator=random(), dtype=torch.float64)
    return TrackingError(track, torch.zeros_like(track), 0.1)


@pytest.mark.parametrize("kind", ["white", "correlated", "tracked"])
@pytest.mark.parametrize("late", [False, True])
def test_a_fit_that_is_put_together_again_is_the_same(kind: str, late: bool) -> None:
    fit = nominal_fit_of(made(), ROLES)
    if late:
        predictor = fit.experiment.predictor
        known = (predictor.model, predictor.timeline, predictor.segments, predictor.candidates)
        predictor = Predictor(*known, late=predictor.timeline.refined(3))
        fit = replace(fit, experiment=fit.experiment.replace(predictor=predictor))
    inputs = inputs_of(fit)
    error: CorrelatedNoise | TrackingError | None = None
    if kind == "correlated":
        error = correlated()
    if kind == "tracked":
        seen = tracked(fit)
        inputs = replace(inputs, observations=replace(fit.observations, error=seen))
        error = replace(seen, factors=(1.5, 2.5), sure=QUICK.noise.sure)
    if late:
        grid = fit.observations.timeline.refined(2)
        fit = replace(fit, steps=ChosenSteps(grid, 2.0, 2, (1e-4, 1e-5), 0.1, 0.2, torch.full((6, 15), 2)))
    fit = replace(
        fit,
        observations=inputs.observations,
        noise=Noise(3e-3, 2e-3, error, QUICK.noise.least),
        events=torch.rand(fit.events.shape, generator=random()) > 0.5,
        settings=fit.settings.changed({"replay.simulators": ("mujoco",)}),
    )
    found = from_tensors(to_tensors(fit), inputs, QUICK)
    assert found.settings == fit.settings
    assert found.noise.spread().tolist() == pytest.approx(fit.noise.spread().tolist())
    if not isinstance(error, TrackingError):
        assert found.noise == fit.noise
    else:
        assert isinstance(found.noise.error, TrackingError)
        assert (found.noise.error.factors, found.noise.error.sure) == (error.factors, error.sure)
    assert (found.steps is None) is (fit.steps is None)
    if found.steps is not None and fit.steps is not None:
        assert torch.equal(found.steps.timeline.grid.steps, fit.steps.timeline.grid.steps)
        assert torch.equal(found.steps.timeline.time, fit.steps.timeline.time)
        assert torch.equal(found.steps.parts, fit.steps.parts)
        for name in ("mean", "largest", "error", "bias", "left"):
            assert getattr(found.steps, name) == getattr(fit.steps, name)
    assert torch.equal(found.phases, fit.phases)
    assert torch.equal(found.events, fit.events)
    for name in ("scale", "pose", "engine", "follow", "fitted"):
        assert torch.equal(getattr(found.experiment, name), getattr(fit.experiment, name)), name
    one, other = found.experiment.predictor, fit.experiment.predictor
    assert torch.equal(one.segments.start, other.segments.start)
    assert torch.equal(one.segments.trajectory, other.segments.trajectory)
    assert (one.late is None) is (other.late is None)
    if one.late is not None and other.late is not None:
        assert torch.equal(one.late.grid.steps, other.late.grid.steps)
    assert torch.equal(one.timeline.grid.frame_step, other.timeline.grid.frame_step)
    assert [kind.name for kind in one.candidates] == [kind.name for kind in other.candidates]
    assert torch.allclose(found.fit.residual, fit.fit.residual, atol=1e-12)
    assert torch.allclose(found.fit.loss, fit.fit.loss)


class Counted:
    """Stands for the fit, and counts how often it is asked for."""

    def __init__(self, fit: NominalFit) -> None:
        self.fit, self.asked = fit, 0

    def __call__(self, _observations: Any, _model: Any, _candidates: Any, generator: torch.Generator, *_: Any) -> Any:
        self.asked += 1
        torch.rand(5, generator=generator)
        return self.fit


def changes_of(inputs: Inputs) -> dict[str, tuple[Inputs, Settings, int]]:
    """Return what a fit depends on, each changed alone: inputs, settings and the seed."""
    seen, model = inputs.observations, inputs.model
    bumped, unseen, wrench = seen.pose.clone(), seen.present.clone(), seen.timeline.grid.wrench.clone()
    bumped[1, 2, 0, 0] += 1e-6
    unseen[0, 1] = 0.0
    wrench[2, 3, 0, 4] = 1e-6
    timeline = replace(seen.timeline, grid=replace(seen.timeline.grid, wrench=wrench))
    drag = (from_values("viscous_drag", {"coefficient": 0.1}),)
    of_observations = {
        "pose": {"pose": bumped},
        "seen": {"present": unseen},
        "forces": {"timeline": timeline},
        "steps": {"timeline": seen.timeline.refined(2)},
        "roles": {"roles": ("fit",) * 5 + ("same",)},
    }
    return {
        **{
            name: (replace(inputs, observations=replace(seen, **one)), QUICK, 0)
            for name, one in of_observations.items()
        },
        "effects": (replace(inputs, model=replace(model, effects=drag)), QUICK, 0),
        "substeps": (replace(inputs, model=replace(model, substeps=2)), QUICK, 0),
        "candidates": (replace(inputs, candidates=[find("constant_force")]), QUICK, 0),
        "seed": (inputs, QUICK, 1),
        "noise": (inputs, QUICK.changed({"noise.wild": 7.0}), 0),
        "replay": (inputs, QUICK.changed({"replay.far": 2.0}), 0),
        "first guess": (inputs, QUICK.changed({"first_guess.steps": 1}), 0),
    }


def test_what_an_interrupted_run_left_is_taken_until_something_changes_that_it_depends_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit = nominal_fit_of(made(), ROLES)
    inputs, counted = inputs_of(fit), Counted(fit)
    monkeypatch.setattr(cache, "fit_nominal_model", counted)

    def run(inputs: Inputs = inputs, settings: Settings = QUICK, seed: int = 0) -> torch.Generator:
        generator = random(seed)
        cache.fit_or_resume(tmp_path, inputs, generator, settings)
        return generator

    after = run()
    assert counted.asked == 1
    again = run()
    assert counted.asked == 1
    assert torch.equal(again.get_state(), after.get_state()), "randomness goes on as if nothing had been interrupted"
    run(settings=QUICK.changed({"verdict.partly": 0.3, "gap.bootstraps": 50}))
    assert counted.asked == 1, "what is concluded later plays no part"
    kept = (tmp_path / cache.FILE).read_bytes()
    for number, (name, (other, settings, seed)) in enumerate(changes_of(inputs).items(), 2):
        (tmp_path / cache.FILE).write_bytes(kept)
        run(other, settings, seed)
        assert counted.asked == number, name
    (tmp_path / cache.FILE).write_bytes(kept[: len(kept) // 2])
    run()
    assert counted.asked == number + 1, "a damaged file is there only to save time"
    assert read_tensors(tmp_path / cache.FILE, ("key",))["key"] == cache._key(inputs, random(), QUICK)
    cache.clear_cache(tmp_path)
    assert not (tmp_path / cache.FILE).exists()
    cache.clear_cache(tmp_path)


def test_a_model_that_cannot_be_simulated_is_refused_and_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unsolved(*_: Any) -> NominalFit:
        raise SolverError("contact problems were not solved")

    monkeypatch.setattr(cache, "fit_nominal_model", unsolved)
    inputs = inputs_of(nominal_fit_of(made(), ROLES))
    with pytest.raises(ValueError, match="cannot go where the recordings go: contact problems were not solved"):
        cache.fit_or_resume(tmp_path, inputs, random(), QUICK)
    assert not (tmp_path / cache.FILE).exists()


@pytest.mark.slow
def test_an_analysis_goes_on_from_its_fit_to_the_same_diagnosis(tmp_path: Path) -> None:
    fit = nominal_fit_of(made(frames=24, cuts=1), ROLES)
    odd = Finding("note", "clocks", "the clock of the camera is odd")
    inputs = replace(inputs_of(fit), findings=(odd,), model=NominalModel(fit.observations.scene))
    said = list[Stage]()

    def tell(stage: Stage, _what: str = "") -> None:
        said.append(stage)

    first = analyse(inputs, tmp_path, 3, QUICK, tell)
    assert Stage.FITTING_NOMINAL in said
    said.clear()
    again = analyse(inputs, tmp_path, 3, QUICK, tell)
    assert Stage.FITTING_NOMINAL not in said
    assert again.diagnosis == first.diagnosis
    assert (first.diagnosis.verdict, first.diagnosis.blamed) == ("named", ("constant_force",))
    assert first.diagnosis.findings == (odd,)


def test_noise_that_is_alike_is_remarked_and_white_noise_is_not() -> None:
    fit = nominal_fit_of(made(), ROLES)
    assert findings_of_fit(fit) == ()
    (one,) = findings_of_fit(replace(fit, noise=Noise(2e-3, 1e-3, correlated(), QUICK.noise.least)))
    assert one == correlated_noise(correlated())


def test_noise_of_one_force_alone_is_remarked(monkeypatch: pytest.MonkeyPatch) -> None:
    density = torch.zeros(1, 6).double()
    density[0, 4] = 1e-3
    monkeypatch.setattr("physid.diagnosis.reference.fit_findings.force_noise", lambda *_: density)
    (one,) = findings_of_fit(nominal_fit_of(made(), ROLES))
    assert one.what.startswith("the recorded forces are noisy")
