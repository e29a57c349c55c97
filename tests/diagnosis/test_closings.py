"""Gaps that close on each split, in what shows them: positions, rotations, or each in one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from diagnosis.flown import hypothesis, nominal_fit_of, random
from diagnosis.test_flights_concluded import ROLES, searched
from estimation.flights import Flights, flights
from physid.diagnosis.conclusion.closings import Closings, compare, describe_gap, describe_shrink
from physid.diagnosis.conclusion.conclusion import draw_conclusion
from physid.diagnosis.conclusion.gap import POSITION, ROTATION, Closing, Interval
from physid.diagnosis.document.document import Errors, Share
from physid.diagnosis.selection.materiality import Tolerance
from physid.diagnosis.selection.search import InAllSegments
from physid.diagnosis.testing import find_lack_of_fit
from physid.estimation.measurement import Noise

NOISE = Noise(rotation=3e-3, position=1e-3)
ALLOWED = Tolerance(2e-4, 5e-4)


def closes(before: float, after: float, share: float, low: float | None = None) -> Closing:
    return Closing(before, after, Interval(share, low, None if low is None else 1.0), 1e-3, 90)


PLACES = {"same": closes(4e-3, 2e-3, 0.6, 0.5), "transfer": closes(5e-3, 3e-3, 0.4)}
TURNS = {"same": closes(0.04, 0.01, 0.9), "transfer": closes(0.05, 0.02, 0.8, 0.7)}


@pytest.mark.parametrize("same", [POSITION, ROTATION])
@pytest.mark.parametrize("transfer", [POSITION, ROTATION])
def test_errors_of_rotations_are_given_where_they_show_the_gap_and_shares_are_theirs(same: int, transfer: int) -> None:
    kinds: Any = {"same": same, "transfer": transfer}
    closings = Closings(PLACES, TURNS, kinds)  # type: ignore[arg-type]
    gap = describe_gap(closings, ALLOWED, NOISE, None)
    assert (gap.unit, gap.floor, gap.tolerance.position, gap.tolerance.rotation) == ("m", NOISE.floor, 2e-4, 5e-4)
    assert (gap.same, gap.transfer) == (Errors(4e-3, 2e-3), Errors(5e-3, 3e-3))
    if same == transfer == POSITION:
        assert gap.rotations is None
    else:
        assert gap.rotations is not None
        assert gap.rotations.floor == NOISE.rotation_floor
        assert gap.rotations.same == (Errors(0.04, 0.01) if same == ROTATION else None)
        assert gap.rotations.transfer == (Errors(0.05, 0.02) if transfer == ROTATION else None)
    shares = describe_shrink(closings, {"same": {"tether": 0.5}})
    assert shares.same == (Share(0.9, None, None) if same == ROTATION else Share(0.6, 0.5, 1.0))
    assert shares.transfer == (Share(0.8, 0.7, 1.0) if transfer == ROTATION else Share(0.4, None, None))
    assert shares.parts == {"same": {"tether": 0.5}}
    unclosed = closings.unclosed()
    said = describe_gap(unclosed, ALLOWED, NOISE, None)
    assert (said.same, said.transfer, said.rotations) == (Errors(4e-3, None), Errors(5e-3, None), None)
    nothing = describe_shrink(unclosed, {})
    assert (nothing.same, nothing.transfer) == (None, None)


def test_without_a_transfer_set_there_is_no_error_and_no_share_of_it() -> None:
    kinds: Any = {"same": POSITION, "transfer": POSITION}
    alone: Any = ({"same": PLACES["same"], "transfer": None}, {"same": TURNS["same"], "transfer": None})
    for closings in (Closings(*alone, kinds), Closings(*alone, kinds).unclosed()):
        assert describe_gap(closings, ALLOWED, NOISE, None).transfer is None
        assert describe_shrink(closings, {}).transfer is None


def test_a_gap_that_positions_show_in_flights_is_compared_in_positions_unless_it_is_said_otherwise() -> None:
    made = flights(kinds=("constant_force",), sizes=(0.8, -0.3), trajectories=len(ROLES), cuts=1)
    fit = nominal_fit_of(made, ROLES)
    known = Flights(fit.experiment, made.true, made.start)
    nominal, best = hypothesis(known), hypothesis(known, ("constant_force",))
    found = compare(fit, nominal, best, random())
    assert found.kinds == {"same": POSITION, "transfer": POSITION}
    assert found.seen == found.positions
    again = compare(fit, nominal, best, random(), {"same": ROTATION, "transfer": POSITION})
    assert again.positions == found.positions, "by the same draws"
    assert again.seen == {"same": found.rotations["same"], "transfer": found.positions["transfer"]}
    shift = found.positions["same"], found.rotations["same"]
    assert shift[0] is not None
    assert shift[1] is not None
    assert shift[0].after is not None
    assert shift[0].after < 0.6 * shift[0].before
    assert shift[1].after == pytest.approx(shift[1].before, rel=1e-3), "a force turns nothing"


@pytest.mark.slow
def test_what_calm_segments_found_is_said_of_all_frames_with_the_sizes_fitted_there() -> None:
    nominal_fit, found = searched()
    assert found.best is not None
    whole = replace(found.best)
    here, all_frames = (
        draw_conclusion(nominal_fit, each, random())
        for each in (found, replace(found, everywhere=InAllSegments(found.nominal, [whole])))
    )
    drawn = all_frames.diagnosis.shrink
    assert replace(here.diagnosis, shrink=drawn) == all_frames.diagnosis, "but for the draws of the intervals"
    assert drawn.parts == here.diagnosis.shrink.parts
    assert (here.judgement.shown, all_frames.judgement.shown) == (found.best, whole)
    other = InAllSegments(found.nominal, [])
    nobody = draw_conclusion(nominal_fit, replace(found, everywhere=other), random())
    assert (nobody.diagnosis.effects, nobody.judgement.chosen) == ((), None)


@pytest.mark.slow
@pytest.mark.slow
def test_where_a_drag_is_left_beside_a_wind_the_wind_is_a_part_and_what_is_left_is_described() -> None:
    nominal_fit, found = searched((0.0, 0.8, -0.3, 0.12))
    made = found.nominal.experiment
    known = Flights(made, found.nominal.fit.point, found.nominal.fit.point)
    wind = hypothesis(known, ("constant_force",))
    left = find_lack_of_fit(nominal_fit, wind, random())
    partly = replace(found, best=wind, left=left, group=[wind], tried=[wind])
    said = draw_conclusion(nominal_fit, partly, random()).diagnosis
    assert (said.verdict, said.blamed) == ("partial", ("constant_force",))
    assert said.residual
    assert all(law.kind in ("force", "shift", "torque") for law in said.residual)
    assert said.where.phase == {"free_fall": 1.0}
