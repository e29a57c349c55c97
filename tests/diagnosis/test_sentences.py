"""A diagnosis in words."""

from __future__ import annotations

from dataclasses import replace

import pytest

from diagnosis.documents import diagnosis, said
from physid.diagnosis.document.document import SPLITS, VERDICTS, Estimate, Share, Shrink, check_diagnosis
from physid.diagnosis.document.rounding import rounded
from physid.diagnosis.document.sentences import (
    MOST_LINES,
    caveat,
    closed,
    effect_lines,
    estimate,
    explained,
    how_far_sentence,
    kind_of,
    percent,
    quantity,
    residual_sentences,
    summary_lines,
    verdict_sentence,
)
from physid.diagnosis.report.contents import ReportData
from physid.diagnosis.report.page import render

SENTENCES = {
    "none": "The model explains these recordings within 0.539 mm beyond the noise.",
    "named": "Viscous drag causes the gap between model and recordings.",
    "group": "The gap is caused by one of viscous drag or quadratic drag; these recordings cannot tell which.",
    "partial": "Viscous drag causes part of the gap; something is left that no candidate explains.",
    "unknown": "There is a gap between model and recordings, and no candidate explains it.",
}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_a_verdict_is_one_plain_sentence(verdict: str) -> None:
    assert verdict_sentence(said(verdict)) == SENTENCES[verdict]


def test_a_model_that_leaves_far_more_than_the_noise_does_not_explain_although_nothing_is_blamed() -> None:
    """References that differ from the model as much as the recordings do leave nothing to say of a cause."""
    document = diagnosis("none")
    floor = document["gap"]["floor"]
    document["gap"]["same"]["before"] = 1.3 * floor  # chance
    chance = check_diagnosis(document)
    left = quantity(chance.gap.beyond_noise(chance.gap.same), "m")
    assert verdict_sentence(chance) == f"The model explains these recordings within {left} beyond the noise."
    document["gap"]["same"]["before"] = 0.0621
    found = verdict_sentence(check_diagnosis(document))
    assert found.startswith("The model leaves 62.1 mm beyond the noise, but reference simulators")
    assert any("62.1 mm" in line for line in summary_lines(check_diagnosis(document)))
    assert [kind_of(one) for one in (said("none"), check_diagnosis(document), said("named"))] == ["good", "warn", ""]


@pytest.mark.parametrize("verdict", VERDICTS)
def test_without_a_transfer_set_nothing_is_called_a_cause(verdict: str) -> None:
    document = diagnosis(verdict, transfer=False)
    assert "cause" not in verdict_sentence(check_diagnosis(document))
    if document["effects"]:
        assert caveat(check_diagnosis(document)) == "Predictive only, cause not certified: there is no transfer set."
        assert any("cause not certified" in line for line in summary_lines(check_diagnosis(document)))


def test_a_certified_cause_needs_no_warning_but_the_absence_of_a_gap_does() -> None:
    assert not caveat(said("named"))
    assert caveat(said("none")) == (
        "1 of 2 effects would have been found at their typical size; these recordings could not show tether."
    )


def test_two_effects_are_named_together_and_told_from_their_group() -> None:
    document = diagnosis("group")
    document["effects"].append({"name": "ground_tilt", "site": "dynamics", "parameters": {}})
    document["group"].append("ground_tilt")
    expected = "Viscous drag and ground tilt cause the gap; these recordings cannot tell them from quadratic drag."
    assert verdict_sentence(check_diagnosis(document)) == expected
    document["ranking"].append({"effects": ["ground_tilt", "quadratic_drag"], "score": 402.0, "p_value": 0.005})
    assert verdict_sentence(check_diagnosis(document)) == expected.replace("them", "viscous drag")


def test_each_of_several_effects_has_a_size_in_the_summary_before_any_has_two() -> None:
    def size(value: float, reach: float) -> dict[str, object]:
        return {"value": value, "low": value - reach, "high": value + reach, "unit": "m"}

    document = diagnosis()
    document["effects"][0]["parameters"] = {"x": size(1.0, 0.01), "y": size(1.0, 0.02)}
    for name, reach in (("camera_offset", 0.1), ("com_offset", 0.2)):
        parameters = {"x": size(1.0, reach), "z": size(0.5, reach)}
        document["effects"].append({"name": name, "site": "dynamics", "parameters": parameters})
    document["group"] = [one["name"] for one in document["effects"]]
    lines = effect_lines(check_diagnosis(document))
    wanted = ["viscous_drag.x", "camera_offset.x", "com_offset.x", "viscous_drag.y", "camera_offset.z", "com_offset.z"]
    assert [line.split(" = ")[0] for line in lines] == wanted
    summary = summary_lines(check_diagnosis(document))
    assert sum(" = " in line for line in summary) == 3
    assert any("and 3 parameters more" in line for line in summary)


@pytest.mark.parametrize("transfer", [True, False])
@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_summary_has_at_most_ten_lines_and_answers_three_questions(verdict: str, transfer: bool) -> None:
    document = diagnosis(verdict, transfer=transfer)
    sizes = {f"p{k}": {"value": 1.0, "low": 0.5, "high": 2.0, "unit": "N"} for k in range(9)}
    if document["effects"]:
        document["effects"][0]["parameters"] = sizes
    document["parameters"] = {f"block.p{k}": {"nominal": 1.0, "with_effect": None} for k in range(9)}
    document["next_experiment"] = "let it coast"
    lines = summary_lines(check_diagnosis(document))
    assert len(lines) <= MOST_LINES
    assert all("\n" not in line for line in lines)
    labels = [line.split("  ")[0].strip() for line in lines]
    assert {"Verdict", "Where", "Which", "How far", "Next"} <= set(labels)


def test_the_summary_gives_sizes_errors_and_shares_with_their_units() -> None:
    text = "\n".join(summary_lines(said()))
    assert "viscous_drag.coefficient = 0.210 (0.190 to 0.230) N s/m" in text
    assert "transfer protocol: 18 mm -> 1.9 mm (floor 1.4 mm), 97 % closed (93 % to 99 %)" in text
    assert "block.mass 1.11 -> 1.002 (0.995 to 1.009) kg" in text


def test_sizes_that_are_not_shown_are_counted_and_none_is_not_a_number() -> None:
    assert not any("parameters more" in line for line in summary_lines(said()))
    document = diagnosis()
    one = document["effects"][0]["parameters"]["coefficient"]
    document["effects"][0]["parameters"] = dict.fromkeys("abcde", one)
    assert sum("and 3 parameters more" in line for line in summary_lines(check_diagnosis(document))) == 1


def test_where_rotations_show_the_gap_their_errors_come_first_and_shares_are_theirs() -> None:
    document = diagnosis()
    document["gap"]["rotations"] = {"floor": 0.005, "same": {"before": 0.076, "after": 0.0077}, "transfer": None}
    found = check_diagnosis(document)
    lines = {split: how_far_sentence(found, split) for split in SPLITS}
    assert lines["same"].startswith("same protocol: 0.076 rad -> 0.0077 rad (floor 0.005 rad), 99 % closed")
    assert lines["same"].endswith("; positions 21 mm -> 1.6 mm")
    assert lines["transfer"] == how_far_sentence(said(), "transfer")


def test_of_several_sizes_the_one_that_is_known_best_comes_first() -> None:
    document = diagnosis()
    document["effects"][0]["parameters"] = {
        "x": {"value": 0.1, "low": -0.2, "high": 0.4, "unit": "mm"},
        "y": {"value": 1.2, "low": 0.2, "high": 1.4, "unit": "mm"},
        "z": {"value": -0.65, "low": -0.75, "high": -0.54, "unit": "mm"},
        "mass": {"value": 1.0, "low": 0.9, "high": 1.1, "unit": "kg"},
    }
    lines = effect_lines(check_diagnosis(document))
    assert [line.split(" = ")[0] for line in lines] == [f"viscous_drag.{name}" for name in ("mass", "z", "y", "x")]


@pytest.mark.parametrize(("floors", "near"), [(1.0, True), (1.019, True), (1.021, False), (3.0, False), (30.0, False)])
def test_a_gap_without_a_share_is_near_to_its_floor_only_where_it_is(floors: float, near: bool) -> None:
    document = diagnosis()
    document["shrink"]["same"] = None
    document["gap"]["same"] = {"before": floors * document["gap"]["floor"], "after": 0.001}
    known = check_diagnosis(document)
    (line,) = (line for line in summary_lines(known) if "same protocol" in line)
    for text in (line, render(known, ReportData())):
        assert ("too near to the floor" in text) == near
        assert ("numerics alone may leave as much" in text) == (not near)


@pytest.mark.parametrize(("first", "said"), [(6.8e-16, "at 0 m/s"), (0.012, "at 0.012 m/s")])
def test_a_place_of_a_residual_law_that_is_nothing_but_rounding_is_zero(first: float, said: str) -> None:
    document = diagnosis("unknown")
    document["residual"][0] |= {"at": [first, 0.5, 1.0], "size": [0.6, 0.2, 0.1], "low": [0.5, 0.1, 0.0]}
    document["residual"][0]["high"] = [0.7, 0.3, 0.2]
    known = rounded(check_diagnosis(document))
    assert said in residual_sentences(known.residual)[0]
    assert known.residual[0].at[1:] == (0.5, 1.0)


@pytest.mark.parametrize(
    ("share", "text"),
    [(0, "0 %"), (0.0004, "< 0.1 %"), (0.004, "0.4 %"), (0.97, "97 %"), (0.9996, "> 99.9 %"), (1, "100 %")],
)
def test_a_share_is_never_rounded_to_certainty(share: float, text: str) -> None:
    assert percent(share) == text


@pytest.mark.parametrize(
    ("value", "text"), [(0.0014, "1.4 mm"), (0.25, "0.25 m"), (3.2e-5, "32 µm"), (0.0, "0 m"), (12.0, "12 m")]
)
def test_a_length_takes_the_prefix_that_suits_it(value: float, text: str) -> None:
    assert quantity(value, "m") == text


def test_an_interval_without_width_or_unit_is_written_as_it_is() -> None:
    assert estimate(Estimate(0.25, 0.25, 0.25, "-")) == "0.25 (0.25 to 0.25)"


def test_too_few_trajectories_have_no_interval_in_words_either() -> None:
    whole = said("named")

    def words(*share: float | None, **settings: object) -> tuple[str, str] | None:
        return closed(replace(whole, shrink=Shrink(Share(*share), None), settings={"gap": settings}), "same")

    assert words(0.98, None, None) == ("98 %", "too few trajectories for an interval")
    assert words(0.98, 0.9, 1.1) == ("98 %", "90 % to 110 %")
    assert words(0.98, 0.9, 1.6) == ("98 %", "at least 90 %")
    assert words(0.98, 0.9, 1.6, most_closed=2.0) == ("98 %", "90 % to 160 %")


def test_no_candidate_explains_more_than_the_best_and_each_its_own_part() -> None:
    document = replace(said("named"), excess=10.0)
    scores = [one.score for one in document.ranking]
    assert max(scores) > 10, "a line at the nominal model saw less than the best explains"
    shares = [explained(document, score) for score in scores]
    assert shares[0] == "100 %"
    assert len({*shares}) == len({*scores})
    large = replace(document, excess=4 * max(scores))
    assert explained(large, max(scores)) == "25 %"
