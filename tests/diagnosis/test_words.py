"""Words for what was found: each condition of a sentence from both sides."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import pytest

from diagnosis.documents import LAWS, diagnosis, said
from physid.diagnosis.document.document import (
    Cell,
    Detectable,
    Diagnosis,
    Errors,
    Estimate,
    Impacts,
    Minor,
    Refitted,
    Share,
    Shrink,
    check_diagnosis,
)
from physid.diagnosis.document.residual_law import ResidualLaw
from physid.diagnosis.document.residual_sentences import law_name, law_phrase, residual_sentences
from physid.diagnosis.document.sentences import (
    before_and_after,
    caveat,
    cell_share,
    closed,
    decided,
    effect_lines,
    explained,
    how_far_sentence,
    power_sentence,
    summary_lines,
    undetectable,
    verdict_sentence,
    where_sentence,
)

FORCE = ResidualLaw(**{key: tuple(value) if isinstance(value, list) else value for key, value in LAWS[0].items()})
SHIFT = ResidualLaw(**{key: tuple(value) if isinstance(value, list) else value for key, value in LAWS[1].items()})


def law(*size: float, reach: float = 0.01, **changes: Any) -> ResidualLaw:
    """Return a force with these sizes at speeds of 0, 1, 2 ... m/s."""
    low, high = (tuple(one + side * reach for one in size) for side in (-1, 1))
    given = {"at": tuple(map(float, range(len(size)))), "size": size, "low": low, "high": high}
    return replace(FORCE, **(given | changes))


def test_laws_are_said_one_after_the_other_each_with_what_they_explain_together() -> None:
    first, second = residual_sentences([FORCE, SHIFT])
    assert first == (
        "What is missing acts like a force across the velocity (to its left) that grows with the speed, "
        "0.410 (0.370 to 0.450) N at 1 m/s; it explains 83 % of what is left in trajectories that it was not fitted to."
    )
    assert second == "A shift of the picture along x that changes with the time, by 0.7 mm beside it: 95 % together."
    assert (law_name(FORCE), law_name(SHIFT)) == ("a force across the velocity", "a shift of the picture along x")
    assert residual_sentences([]) == []


@pytest.mark.parametrize(
    ("size", "word"),
    [
        ((1.0, 1.2, 1.51), "grows"),
        ((1.0, 1.2, 1.49), "changes"),
        ((1.51, 1.2, 1.0), "falls"),
        ((1.49, 1.2, 1.0), "changes"),
        ((1.0, 3.0, 2.0), "changes"),
        ((0.0, 1.0, 2.0), "grows"),
        ((-1.0, 1.0, 2.0), "changes"),
        ((2.0, 1.0, -1.0), "changes"),
        ((1.0, -1.0, 1.0, 1.0), "changes"),
        ((1.0, -1.0, 1.0, -1.0), "swings"),
        ((1.0, 0.0, -1.0, 0.0, 1.0, -1.0), "swings"),
        ((-1.0, -1.2, -1.51), "grows"),
    ],
)
def test_a_size_grows_falls_swings_or_changes(size: tuple[float, ...], word: str) -> None:
    assert f" that {word} with the speed, " in law_phrase(law(*size))


def test_a_size_is_given_where_it_is_surely_largest_and_its_sign_by_the_side() -> None:
    unsure = law(1.0, 3.0, low=(0.9, 0.1), high=(1.1, 5.9))
    assert "1.00 (0.90 to 1.10) N at 0 m/s" in law_phrase(unsure)
    right = law_phrase(law(-1.0, -2.0))
    assert (
        right
        == "a force across the velocity (to its right) that grows with the speed, 2.000 (1.990 to 2.010) N at 1 m/s"
    )
    assert law_phrase(law(-2.0, direction="along the velocity", variable=None)) == (
        "a force against the velocity, 2.000 (1.990 to 2.010) N"
    )
    assert law_phrase(law(2.0, direction="along the velocity", variable=None)).startswith(
        "a force along the velocity, 2"
    )
    assert law_phrase(law(-2.0, direction="along x", variable=None)) == "a force along x, -2.000 (-2.010 to -1.990) N"
    for turned in ("along the command", "along the spin"):
        assert turned.replace("along", "against") in law_phrase(law(-2.0, direction=turned, variable=None))


def test_what_has_no_sure_size_says_so_and_where_it_acts_and_on_what_it_depends() -> None:
    nothing = law(0.005, reach=0.01, variable=None, region="in contact")
    assert law_phrase(nothing) == "a force across the velocity in contact, of no sure size"
    assert law_phrase(law(0.005, 0.002)) == "a force across the velocity that changes with the speed, of no sure size"
    for edge in ((0.0, 0.2), (-0.2, 0.0)):
        assert "no sure size" in law_phrase(law(0.1, low=edge[:1], high=edge[1:], variable=None))
    assert "in flight, 2" in law_phrase(law(2.0, variable=None, region="in flight"))
    assert "at x = 1 m" in law_phrase(law(1.0, 2.0, variable="x", variable_unit="m"))
    assert "at height = 1 m" in law_phrase(law(1.0, 2.0, variable="height", variable_unit="m"))
    assert " at 0.33 m/s" in law_phrase(law(1.0, 2.0, at=(0.0, 1 / 3)))
    assert "with x," in law_phrase(law(1.0, 2.0, variable="x", variable_unit="m"))


def with_changes(verdict: str = "named", **changes: Any) -> Diagnosis:
    return replace(said(verdict), **changes)


def test_one_effect_accounts_for_a_gap_and_several_do_unless_a_transfer_set_certifies_them() -> None:
    two = diagnosis("partial", transfer=False)
    two["effects"].append({"name": "tether", "site": "dynamics", "parameters": {}})
    two["group"].append("tether")
    assert verdict_sentence(check_diagnosis(two)).startswith("Viscous drag and tether account for part of the gap;")
    two["verdict"] = "named"
    assert (
        verdict_sentence(check_diagnosis(two))
        == "Viscous drag and tether account for the gap between model and recordings."
    )
    one = check_diagnosis(diagnosis("partial", transfer=False))
    assert verdict_sentence(one).startswith("Viscous drag accounts for part of the gap;")
    assert verdict_sentence(check_diagnosis(diagnosis("named", transfer=False))) == (
        "Viscous drag accounts for the gap between model and recordings."
    )
    assert "is accounted for by one of" in verdict_sentence(check_diagnosis(diagnosis("group", transfer=False)))
    certified = copy.deepcopy(two)
    certified["gap"]["transfer"], certified["verdict"] = diagnosis()["gap"]["transfer"], "partial"
    assert "tether cause part of the gap" in verdict_sentence(check_diagnosis(certified))


def test_what_is_minor_is_said_first_then_what_could_not_be_found_then_what_is_not_certified() -> None:
    minor = (Minor(("tether",), 0.01, 0.25), Minor(("a_b", "c"), 0.01, 0.5))
    assert caveat(with_changes("none", minor=minor)) == (
        "Significant but minor, below the tolerance: tether (closes 25 % of the gap) "
        "and a b + c (closes 50 % of the gap)."
    )
    beside = with_changes("named", minor=minor[:1])
    beside = replace(beside, gap=replace(beside.gap, transfer=None), shrink=replace(beside.shrink, transfer=None))
    assert caveat(beside) == (
        "Significant but minor, below the tolerance: tether (closes 25 % of the gap). "
        "Predictive only, cause not certified: there is no transfer set."
    )
    assert caveat(with_changes("unknown")) == ""
    assert caveat(with_changes("none")) == power_sentence(said("none"))


def detectable(*shares: float | None) -> tuple[Detectable, ...]:
    return tuple(Detectable(f"e{k}", "x", None if one is None else 2 * one, 2.0, "N") for k, one in enumerate(shares))


def test_an_effect_that_shows_at_its_typical_size_by_one_parameter_is_detectable() -> None:
    both = (*detectable(1.0, 1.01, None), Detectable("e2", "y", 1.0, 2.0, "N"), Detectable("e3", "x", 1.0, 0.0, "N"))
    assert undetectable(with_changes("none", detectable=both)) == ["e1", "e3"]
    assert power_sentence(with_changes("none", detectable=detectable(0.5, 1.0))) == (
        "Each of 2 effects would have been found at its typical size."
    )
    assert power_sentence(with_changes("none", detectable=())) == ""
    for count, end in ((6, "e5 or e6."), (7, "e6 or 1 more."), (8, "e6 or 2 more.")):
        text = power_sentence(with_changes("none", detectable=detectable(0.5, *[None] * count)))
        assert text.startswith(f"1 of {count + 1} effects would have been found")
        assert text.endswith(end)


def where(**changes: Any) -> str:
    one = with_changes(**{key: changes.pop(key) for key in list(changes) if key == "excess"})
    return where_sentence(replace(one, where=replace(one.where, **changes)))


def test_sites_that_stand_out_are_said_and_phases_in_which_effects_are_at_work() -> None:
    sites = {"perception": 0.005, "actuation": 0.0, "dynamics": 0.991, "contact": 0.004}
    assert where(site=sites) == "dynamics 99.1 %, perception 0.5 %; at work in coast 90 %, slide fast 10 %"
    sites = {"perception": 0.0049, "actuation": 0.0, "dynamics": 0.9911, "contact": 0.004}
    assert where(site=sites, phase={"coast": 0.901, "impact": 0.05, "rest": 0.049}) == (
        "dynamics 99.1 %; at work in coast 90 %, impact 5 %"
    )
    none = dict.fromkeys(sites, 0.0)
    first, second = where(site=none, phase={}, excess=500.0).split("; ")[1:]
    assert first == "strongest in coast, block x (explains 25 % of the gap)"
    assert second == "slide fast, block rz (explains < 0.1 % of the gap)"
    assert where(site=none, phase={}, cells=()) == "no site stands out"
    cells = tuple(Cell("coast", "block", "x", float(k)) for k in (1, 3, 2))
    assert where(site=none, phase={}, cells=cells) == "no site stands out; strongest in coast, block x; coast, block x"
    assert where_sentence(said("unknown")).endswith("; strongest in coast, block x; slide fast, block rz")
    hit = replace(said("unknown"), gap=replace(said("unknown").gap, impacts=Impacts(7, 9, 0.0026, 0.01)))
    reported = (
        "; at impacts (7 of 9 segments with one are not explained); elsewhere strongest in coast, block x; slide fast"
    )
    assert reported in where_sentence(hit)


def test_a_cell_explains_the_square_of_its_evidence_and_no_more_than_all() -> None:
    cell = Cell("coast", "block", "x", 4.0)
    assert cell_share(with_changes(excess=64.0), cell) == "25 %"
    assert cell_share(with_changes(excess=8.0), cell) == "100 %"
    assert cell_share(with_changes(excess=None), cell) == ""
    assert explained(with_changes(excess=None), 12.34) == "12.3"
    assert explained(with_changes(excess=1000.0), -3.0) == "0 %"
    assert explained(with_changes(excess=1000.0), 250.0) == "25 %"


def test_shares_are_written_as_their_intervals_allow() -> None:
    def words(*share: float | None) -> tuple[str, str] | None:
        return closed(with_changes(shrink=Shrink(Share(*share), None)), "same")

    assert words(1.2, 1.1, 1.501) == ("100 %", "at least 100 %")
    assert words(1.2, 1.1, 1.5) == ("120 %", "110 % to 150 %")
    assert words(0.5, 0.4, 1.6) == ("50 %", "at least 40 %")
    assert words(0.5015, 0.501, 0.502) == ("50 %", "50.1 % to 50.2 %")
    assert words(0.5, None, 0.6) == words(0.5, 0.4, None) == ("50 %", "too few trajectories for an interval")
    assert closed(with_changes(shrink=Shrink(None, None)), "same") is None
    assert decided(with_changes(settings={"a": {"b": 2}}), "a", "b", 1.0) == 2.0
    assert decided(with_changes(settings={}), "a", "b", 1.0) == 1.0


def test_errors_are_given_before_and_after_and_divided_among_several_effects() -> None:
    assert before_and_after(Errors(0.02, None), "m") == "20 mm"
    assert before_and_after(Errors(0.02, 0.001), "m") == "20 mm -> 1 mm"
    assert how_far_sentence(said("none"), "same") == "same protocol: 1.5 mm (floor 1.4 mm)"
    alone = how_far_sentence(said(), "same")
    assert alone == "same protocol: 21 mm -> 1.6 mm (floor 1.4 mm), 99 % closed (97 % to 100 %)"
    shrink = said().shrink
    parts = {"same": {"viscous_drag": 0.6, "tether": 0.39}}
    divided = how_far_sentence(with_changes(shrink=replace(shrink, parts=parts)), "same")
    assert divided == f"{alone}: viscous drag 60 % and tether 39 %"


def test_a_gap_that_shows_in_parts_of_the_motion_alone_is_called_so_and_not_one_that_is_not_closed() -> None:
    document = said("unknown", transfer=False)
    assert how_far_sentence(document, "same") == "same protocol: 21 mm (floor 1.4 mm)"
    near = replace(document, gap=replace(document.gap, same=Errors(0.0014, None)))
    assert how_far_sentence(near, "same").endswith("1.4 mm (floor 1.4 mm), near the floor: parts of a motion show it")
    hit = replace(near, gap=replace(near.gap, impacts=Impacts(7, 9, 0.0026, 0.01)))
    assert how_far_sentence(hit, "same").endswith("near the floor: impacts show it, 2.6 mm there")
    assert caveat(hit) == ""
    tried = replace(hit, gap=replace(hit.gap, impacts=Impacts(7, 9, 0.0026, 0.01, 2)))
    assert caveat(tried) == (
        "The model alone does not explain 7 of 9 segments with an impact or a jolt; with what is named, 2 are left."
    )
    none = replace(near, verdict="none")
    assert how_far_sentence(none, "same").endswith("1.4 mm (floor 1.4 mm)")


def test_the_summary_shows_the_refitted_parameters_of_two_bodies_and_says_how_many_more_there_are() -> None:
    one = Refitted(1.0, None)
    for count, end in ((3, "c 1"), (6, "c 1, d 1, e 1, f 1"), (8, "c 1, d 1, e 1, f 1, and 2 more")):
        document = with_changes(parameters=dict.fromkeys("abcdefgh"[:count], one))
        (line,) = [each for each in summary_lines(document) if each.startswith("Refitted")]
        assert line == "Refitted  a 1, b 1, " + end
    assert not any("Refitted" in each for each in summary_lines(with_changes(parameters={})))
    ranked = summary_lines(said("unknown"))
    assert any("none; best candidate viscous_drag, p 0.005" in each for each in ranked)
    assert any(
        each == "Which     no candidate stands out" for each in summary_lines(with_changes("unknown", ranking=()))
    )


def test_an_effect_without_parameters_is_named_and_a_size_without_width_is_known_best() -> None:
    document = diagnosis()
    document["effects"][0]["parameters"] = {}
    assert effect_lines(check_diagnosis(document)) == ["viscous_drag"]
    effect = replace(
        said().effects[0], parameters={"a": Estimate(1.0, 0.0, 2.0, "N"), "b": Estimate(1e-9, 1e-9, 1e-9, "N")}
    )
    assert [line.split(" = ")[0] for line in effect_lines(with_changes(effects=(effect,)))] == [
        "viscous_drag.b",
        "viscous_drag.a",
    ]
