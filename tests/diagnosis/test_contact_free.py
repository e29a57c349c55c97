"""Flights decide alone what they can decide: impacts neither hide an effect that shows in flight nor bend its size."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from diagnosis.sets import recorded
from physid.data import RecordingSet
from physid.diagnosis.diagnose import diagnose
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import load_observations
from physid.diagnosis.reference.nominal_fit import NominalFit, fit_nominal_model
from physid.diagnosis.selection import all_frames, attribution
from physid.diagnosis.selection.contact_free import contact_free, refit_all_segments
from physid.diagnosis.selection.search import Attribution
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing.hypothesis import begin_hypothesis, columns_of
from physid.effects import CATALOGUE
from physid.estimation.prediction.segments import Segmentation
from physid.physics import SolverError

DRAG, TOLERANCE = 0.6, 0.1
TOSS: Mapping[str, Any] = {
    "scene": "toss",
    "steps": 120,
    "unknown": ("block.friction", "block.restitution"),
    "protocol_of_split": {},
}


def nominal_fit(folder: Path) -> NominalFit:
    observations = load_observations(RecordingSet(folder), None, None)
    model = read_nominal_model(observations.scene, None)
    return fit_nominal_model(observations, model, list(CATALOGUE), torch.Generator().manual_seed(0))


@pytest.fixture(scope="module")
def tossed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calm") / "tossed"
    return recorded(folder, {"viscous_drag": {"coefficient": DRAG}}, **TOSS)


@pytest.fixture(scope="module")
def whole(tossed: Path) -> NominalFit:
    return nominal_fit(tossed)


@pytest.mark.slow
def test_contact_free_segments_count_alone_without_frames_that_a_late_camera_takes_from_before(
    whole: NominalFit,
) -> None:
    part = contact_free(whole, torch.Generator().manual_seed(0))
    assert part is not None
    segments, kept = (
        Segmentation.around(whole.events, whole.settings.segments.contact_free),
        part.experiment.predictor.segments,
    )
    assert bool(segments.contact.any())
    assert len(kept) == int((~segments.contact).sum())
    counts = (part.experiment.scale > 0).any(-1).any(-1)
    assert not bool(counts[segments.spread(segments.contact)].any())
    late = round(whole.settings.contact_free.late / whole.observations.scene.time_step)
    for row, start, size in zip(kept.trajectory.tolist(), kept.start.tolist(), kept.size.tolist(), strict=True):
        first = min(late, size // 2) if start else 0
        assert not bool(counts[row, start : start + first].any())
        assert bool(counts[row, start + first : start + size].all())


@pytest.mark.slow
def test_what_is_not_known_of_an_effect_is_not_known_of_the_parameters_either(whole: NominalFit) -> None:
    """In all frames they are fitted together: the covariance of one holds that of the other."""
    part = contact_free(whole, torch.Generator().manual_seed(0))
    assert part is not None
    columns = columns_of(part.experiment.predictor, ("viscous_drag",))
    start = part.experiment.linearise(part.fit.point, columns)
    calm = begin_hypothesis(part.experiment, start, ("viscous_drag",), whole.settings)
    everywhere = refit_all_segments(whole, calm)
    unknown = len(whole.experiment.predictor.model.unknown)
    assert everywhere.covariance().shape == (unknown + 2, unknown + 2)  # beside the engine and the drag
    assert everywhere.values["viscous_drag.coefficient"] == pytest.approx(DRAG, rel=TOLERANCE)


@pytest.mark.slow
def test_where_no_impact_is_there_is_no_such_part(tmp_path: Path) -> None:
    assert contact_free(nominal_fit(recorded(tmp_path / "pushed")), torch.Generator()) is None


@pytest.mark.slow
def test_a_drag_that_shows_in_flight_is_named_with_its_size_although_blocks_bounce(
    tossed: Path, tmp_path: Path
) -> None:
    found = diagnose(RecordingSet(tossed), tmp_path)
    assert found.verdict in ("named", "group")
    assert found.effects[0].name == "viscous_drag"
    assert found.effects[0].parameters["coefficient"].value == pytest.approx(DRAG, rel=TOLERANCE)
    # Flights say nothing of restitution: it comes from all frames, and not as anything between 0 and 1.
    known = found.parameters["block.restitution"].with_effect
    assert known.high - known.low < 0.5 * known.value


def test_what_cannot_be_simulated_in_all_frames_stays_as_contact_free_segments_say(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*_: object) -> None:
        raise SolverError("no solution")

    monkeypatch.setattr(all_frames, "refit_all_segments", fails)
    monkeypatch.setattr(attribution, "contact_free", lambda *_: "calm windows")
    best = cast(Any, "best")
    named = Attribution(*[cast(Any, name) for name in ("nominal", "stage", "tried")], best, cast(Any, "left"), [best])
    monkeypatch.setattr(attribution, "search_catalogue", lambda *_: named)
    monkeypatch.setattr(attribution, "is_material", lambda *_: True)
    monkeypatch.setattr(attribution, "leaves_nothing", lambda _: True)
    assert attribution.attribute(cast(Any, SimpleNamespace(settings=Settings())), torch.Generator()) is named
    assert not named.contact_free


@pytest.mark.slow
def test_what_flights_show_and_what_bodies_on_the_ground_show_are_found_together(tmp_path: Path) -> None:
    height = 0.003
    hidden = {"viscous_drag": {"coefficient": DRAG}, "camera_offset": {"z": height}}
    found = diagnose(RecordingSet(recorded(tmp_path / "tossed", hidden, **TOSS)), tmp_path / "out")
    sizes = {effect.name: effect.parameters for effect in found.effects}
    assert set(sizes) == set(hidden)
    assert sizes["viscous_drag"]["coefficient"].value == pytest.approx(DRAG, rel=0.15)
    assert sizes["camera_offset"]["z"].value == pytest.approx(height, rel=0.1)
