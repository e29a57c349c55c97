"""The gap divided among effects: laws of the division, and the picture that opens the report."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from tests.diagnosis.documents import diagnosis

from physid.diagnosis.conclusion import decomposition
from physid.diagnosis.conclusion.closings import closings_of
from physid.diagnosis.conclusion.decomposition import shapley
from physid.diagnosis.conclusion.gap import POSITION, ROTATION, Closing, Interval
from physid.diagnosis.document.document import Split, check_diagnosis
from physid.diagnosis.document.sentences import how_far_sentence
from physid.diagnosis.report.contents import ReportData
from physid.diagnosis.report.page import render
from physid.diagnosis.settings.settings import Settings


@pytest.mark.parametrize(
    ("one", "other", "both", "parts"),
    [
        (0.6, 0.4, 1.0, (0.6, 0.4)),  # they close different parts
        (0.8, 0.8, 0.8, (0.4, 0.4)),  # either does what both do
        (0.0, 0.0, 1.0, (0.5, 0.5)),  # neither does anything alone
        (0.9, -0.1, 0.9, (0.95, -0.05)),  # one alone makes it worse
    ],
)
def test_what_both_close_is_divided_by_the_mean_over_both_orders(
    one: float, other: float, both: float, parts: tuple[float, float]
) -> None:
    found = shapley({frozenset("a"): one, frozenset("b"): other, frozenset("ab"): both}, ("a", "b"))
    assert found == pytest.approx(dict(zip("ab", parts, strict=True)))
    assert sum(found.values()) == pytest.approx(both)


def test_what_three_close_is_divided_by_the_mean_over_all_orders() -> None:
    """The value of many by the laws of Shapley: parts add up, a dummy has none, those that do alike share alike."""
    values = {frozenset(some): 0.0 for some in ("a", "b", "c")} | {frozenset("ab"): 0.8, frozenset("abc"): 0.9}
    values |= {frozenset("ac"): 0.1, frozenset("bc"): 0.1}
    found = shapley(values, "abc")
    assert sum(found.values()) == pytest.approx(0.9)
    assert found["a"] == pytest.approx(found["b"])
    assert found["c"] == pytest.approx((0.9 - 0.8) / 3 + 0.1 / 6 + 0.1 / 6)
    dummy = {some: (0.5 if "a" in some else 0.0) + (0.3 if "b" in some else 0.0) for some in values}
    assert shapley(dummy, "abc") == pytest.approx({"a": 0.5, "b": 0.3, "c": 0.0})


def test_the_report_opens_with_the_gap_cut_into_causes_and_rest() -> None:
    document = diagnosis("partial")
    document["shrink"]["same"] = {"value": 0.8, "low": 0.7, "high": 0.9}
    document["shrink"]["parts"] = {"same": {"viscous_drag": 0.5, "tether": 0.3}, "transfer": {"viscous_drag": 1.04}}
    said = check_diagnosis(document)
    page = render(said, ReportData())
    cut = page[page.index("What the gap consists of") : page.index('class="grid answers"')]
    for expected in ("viscous drag <b>50 %", "tether <b>30 %", "not explained <b>20 %", "viscous drag <b>104 %"):
        assert expected in cut
    assert cut.count("not explained") == 2, "in the bar and its legend; nothing is left on the transfer protocol"
    assert cut.count("More than 100 %: the error ends below the floor") == 1
    document["shrink"]["parts"] = {"same": {"viscous_drag": 0.5, "tether": 0.3}, "transfer": {"viscous_drag": 1.004}}
    assert "More than 100 %" not in render(check_diagnosis(document), ReportData())
    assert how_far_sentence(said, "same").endswith("closed (70 % to 90 %): viscous drag 50 % and tether 30 %")


def test_an_unknown_cause_is_cut_by_a_free_force_and_no_gap_is_not_cut() -> None:
    said = replace(check_diagnosis(diagnosis("unknown")), residual=())
    page = render(said, ReportData(residual_wrench={"same": 0.0112}))
    assert "a free force and torque <b>50 %" in page
    assert "What the gap consists of" not in render(said, ReportData())
    assert "What the gap consists of" not in render(check_diagnosis(diagnosis("none")), ReportData())


@pytest.mark.parametrize("names", [("a",), ("a", "b")])
def test_parts_add_up_to_what_closes_on_each_split(names: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Alone a closes 70 % and b 50 %, on the transfer protocol 20 and 90 %."""

    def closings(same: float, transfer: float) -> dict[Split, Closing | None]:
        return {
            "same": Closing(2.0, 1.0, Interval(same, None, None), 0.5, 9000),
            "transfer": Closing(2.0, 1.0, Interval(transfer, None, None), 0.5, 9000),
        }

    kinds: dict[Split, int] = {"same": POSITION, "transfer": ROTATION}
    alone = {"a": closings(0.7, 0.2), "b": closings(0.5, 0.9)}
    singles = [SimpleNamespace(names=(name,)) for name in names]
    found: Any = SimpleNamespace(
        best=SimpleNamespace(names=names),
        tried=singles,
        contact_free=False,
        whole_nominal=None,
        nominal=SimpleNamespace(experiment=None),
    )

    def of_kind(_fit: Any, _nominal: Any, one: Any, _random: Any, kind: int) -> dict[Split, Closing | None]:
        return {split: each if kinds[split] == kind else None for split, each in alone[one.names[0]].items()}

    monkeypatch.setattr(decomposition, "closings_of", of_kind)
    nominal_fit: Any = SimpleNamespace(settings=None)
    parts = decomposition.decompose(nominal_fit, found, closings(0.96, 0.94), kinds, torch.Generator())
    assert {split: sum(each.values()) for split, each in parts.items()} == pytest.approx(
        {"same": 0.96, "transfer": 0.94}
    )
    if len(names) > 1:
        assert parts["same"] == pytest.approx({"a": 0.58, "b": 0.38})
        assert parts["transfer"] == pytest.approx({"a": 0.12, "b": 0.82})
    no_gap: Any = {"same": Closing(1.0, 1.0, None, 1.0, 9000), "transfer": None}
    assert not decomposition.decompose(nominal_fit, found, no_gap, kinds, torch.Generator())


def test_each_part_of_the_recordings_closes_by_its_own_errors_and_without_effects_nothing_closes() -> None:
    """Two trajectories of each part, 20 mm off and 10 mm with an effect, on the transfer protocol 8 and 8 mm."""
    scale = torch.full((4, 5, 1, 6), 1e3, dtype=torch.float64)

    def off(same: float, transfer: float) -> Any:
        residual = torch.zeros_like(scale)
        residual[:2, ..., 4], residual[2:, ..., 4] = same, transfer
        return SimpleNamespace(experiment=SimpleNamespace(scale=scale), fit=SimpleNamespace(residual=residual))

    transferred = torch.tensor([False, False, True, True])
    nominal_fit: Any = SimpleNamespace(
        observations=SimpleNamespace(reported=(~transferred, transferred)),
        noise=SimpleNamespace(floor=4e-3),
        settings=Settings(),
    )
    nominal, effect = off(0.02, 0.008), off(0.01, 0.008)
    closed = closings_of(nominal_fit, nominal, effect, torch.Generator())
    unclosed = closings_of(nominal_fit, nominal, None, torch.Generator())
    for found, after, shares in ((closed, 0.01, (10 / 16, 0.0)), (unclosed, 0.02, (0.0, 0.0))):
        same, transfer = found["same"], found["transfer"]
        assert same is not None
        assert transfer is not None
        assert (same.before, same.after) == pytest.approx((0.02, after))
        assert (transfer.before, transfer.after) == pytest.approx((0.008, 0.008))
        assert [one.shrink and one.shrink.value for one in (same, transfer)] == pytest.approx(shares)
        assert (same.values, transfer.values) == (30, 30)
