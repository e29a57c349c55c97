"""The score of a diagnosis whose effect was withheld."""

from __future__ import annotations

from diagnosis.documents import diagnosis, said
from physid.diagnosis.document.document import Diagnosis, check_diagnosis
from physid.reproduce.withheld import Withheld

HIDDEN = {"viscous_drag": {"coefficient": 0.2}}


def scores(found: Diagnosis) -> dict[str, float | None]:
    return {result.metric: result.value for result in Withheld().results(found, HIDDEN)}


def test_a_right_diagnosis_meets_every_target() -> None:
    results = Withheld().results(said(), HIDDEN)
    assert not [result.metric for result in results if result.misses]
    assert abs((scores(said())["viscous_drag.coefficient, error"] or 0) - 5) < 1e-6


def test_a_diagnosis_that_names_nothing_misses() -> None:
    found = scores(said("unknown"))
    assert found["effects missed or wrongly named"] == 1
    assert found["viscous_drag.coefficient, estimate"] is None


def test_a_wrong_name_counts_twice() -> None:
    wrong = diagnosis()
    wrong["effects"][0]["name"] = "quadratic_drag"
    wrong["group"] = ["quadratic_drag"]
    assert scores(check_diagnosis(wrong))["effects missed or wrongly named"] == 2
