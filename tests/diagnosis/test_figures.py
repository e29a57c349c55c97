"""Figures of a diagnosis: their digits, their places in a flat table, and what is left beyond the noise."""

from __future__ import annotations

import copy
import math

import pytest

from diagnosis.documents import LAWS, diagnosis
from physid.diagnosis.document.document import check_diagnosis
from physid.diagnosis.document.errors import Allowed, Errors, Gap
from physid.diagnosis.document.evidence import hypothesis
from physid.diagnosis.document.flat_figures import figures_of
from physid.diagnosis.document.residual_law import ResidualLaw
from physid.diagnosis.document.rounding import rounded


def test_numbers_have_five_digits_and_settings_all_of_theirs() -> None:
    document = diagnosis()
    document["confidence"] = 0.97123456
    document["gap"]["floor"] = 0.00123456789
    document["shrink"]["parts"]["same"]["viscous_drag"] = 123456.789
    document["settings"] = {"lack_of_fit": {"margin": 1.23456789}}
    said = rounded(check_diagnosis(document))
    assert (said.confidence, said.gap.floor) == (0.97123, 0.0012346)
    assert said.shrink.parts["same"] == {"viscous_drag": 123460.0}
    assert said.settings == {"lack_of_fit": {"margin": 1.23456789}}
    assert said.effects[0].parameters["coefficient"].value == 0.21
    assert said.ranking == check_diagnosis(document).ranking
    assert rounded(said) == said


@pytest.mark.parametrize(
    ("at", "written"),
    [
        ((-7e-16, 0.51234567, 1.0), (0.0, 0.51235, 1.0)),
        ((-7e-16, 0.51234567, 2.0), (0.0, 0.5123, 2.0)),
        ((0.12345678, 1234.56789), (0.1, 1234.6)),
        ((0.0,), (0.0,)),
        ((-0.0123456, 0.00123456), (-0.012346, 0.001235)),
    ],
)
def test_places_of_a_law_have_the_digits_of_its_range(at: tuple[float, ...], written: tuple[float, ...]) -> None:
    document, law = diagnosis("unknown"), copy.deepcopy(LAWS[0])
    document["residual"] = [law | {"at": list(at)} | dict.fromkeys(("size", "low", "high"), [0.123456789] * len(at))]
    (said,) = rounded(check_diagnosis(document)).residual
    assert said.at == written
    assert [math.copysign(1, value) for value in said.at if not value] == [1] * said.at.count(0.0)
    assert said.size == (0.12346,) * len(at)


def test_a_law_without_as_many_ends_as_places_is_refused() -> None:
    known = LAWS[0] | {name: tuple(LAWS[0][name]) for name in ("at", "size", "low", "high")}
    assert ResidualLaw(**known).at == (0.1, 0.5, 1.0)
    for name in ("at", "size", "low", "high"):
        with pytest.raises(ValueError, match="as many values in each"):
            ResidualLaw(**known | {name: known[name][:2]})


def test_every_figure_stands_at_its_place_and_what_is_missing_nowhere() -> None:
    document = diagnosis("group", transfer=False)
    found = figures_of(check_diagnosis(document))
    assert found["verdict"] == "group"
    assert found["group"] == "viscous_drag, quadratic_drag"
    assert found["site/dynamics"] == 0.96
    assert found["confidence"] == 0.97
    assert found["effects/viscous_drag/coefficient/value"] == 0.21
    assert found["effects/viscous_drag/coefficient/unit"] == "N s/m"
    assert found["gap/same/before"] == 0.021
    assert found["gap/tolerance/rotation"] == 0.002
    assert found["shrink/parts/same/viscous_drag"] == 0.99
    assert found["parameters/block.mass/with_effect/low"] == 0.995
    assert not [name for name in found if name.startswith(("gap/transfer", "shrink/transfer", "ranking", "where"))]
    nothing = figures_of(check_diagnosis(diagnosis("none")))
    assert "group" not in nothing
    assert not [name for name in nothing if name.startswith("effects")]


@pytest.mark.parametrize(("before", "beyond"), [(5e-3, 3e-3), (4e-3, 0.0), (3e-3, 0.0)])
def test_beyond_the_noise_is_what_is_left_of_the_mean_square(before: float, beyond: float) -> None:
    errors = Errors(before, None)
    gap = Gap("m", 4e-3, Allowed(1e-4, 1e-3), errors, None)
    assert gap.beyond_noise(errors) == pytest.approx(beyond)
    assert gap.beyond_noise(None) == 0.0


def test_a_hypothesis_is_called_by_its_effects_in_their_order() -> None:
    assert hypothesis(("tether", "adhesion")) == hypothesis(("adhesion", "tether")) == "adhesion + tether"
    assert hypothesis(("tether",)) == "tether"
