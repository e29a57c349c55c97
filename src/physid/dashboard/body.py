"""One run: what was found, how it went there, what it predicts, and how to repeat it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from itertools import groupby
from typing import Any

from markupsafe import Markup

from physid.dashboard.summary import Run, far, grade, judged, keeps, met, numbers, short, text_of, texts
from physid.diagnosis.document.sentences import caveat, effect_lines, estimate, explained, kind_of, where_sentence
from physid.diagnosis.report.drawings import closing
from physid.estimation.measurement.unexplained import left_beyond_noise
from physid.pages.figures import Series, line_chart
from physid.pages.numbers import NOTHING, figure, in_unit, named, quantity
from physid.pages.templates import render

GROUPS = (("loss", "Losses"), ("error", "Errors"), ("schedule", "Schedules"), ("other", "Other curves"))
OBSERVED = {"identified": "good", "combination": "warn"}
MOST_RANKED = 8


def with_body(run: Run) -> dict[str, Any]:
    """Return a run with what the table says of it, and its part of the page."""
    said, score = run["diagnosis"], run["score"] or {}
    shown: dict[str, Any] = dict(run)
    shown["parameters"] = [_parameter(each) for each in run["parameters"]]
    shown["texts"] = texts(run)
    shown["judged"] = judged(run)
    shown["left"] = left_beyond_noise(run["figures"])
    shown["short"] = short(said) if said else ""
    shown["far"] = far(said) if said else []
    shown["caveat"] = caveat(said) if said else ""
    shown["where"] = where_sentence(said) if said else ""
    body = render(
        "run.html",
        run=shown,
        kind_of=kind_of,
        observed=OBSERVED,
        lines=effect_lines(said) if said and said.effects else [],
        ranked=[(each, explained(said, each.score)) for each in said.ranking[:MOST_RANKED]] if said else [],
        best=max([1e-12, *(each.score for each in said.ranking)]) if said else 1.0,
        closing=closing(said) if said else "",
        parameters=_refitted(said) if said else [],
        scored=[(each, _scored(each)) for each in score.get("figures", ())],
        groups=[(name, list(rows)) for name, rows in groupby(map(_result, run["cells"]), lambda row: row["cell"])],
        curves=_curves(run),
        figures=[(name, named(name, value)) for name, value in sorted(run["figures"].items())],
    )
    text_of(shown), numbers(shown)  # what the table needs must be there as well
    return shown | {"body": Markup(body)}  # a template has made it, with every text escaped  # nosec B704


def _parameter(each: Mapping[str, Any]) -> dict[str, Any]:
    """Return a parameter with its history as a drawing."""
    chart: Markup | str = ""
    if len(each["x"]) > 1:
        known = each["low"] is not None and each["high"] is not None
        chart = line_chart(
            [Series("estimate", "after", each["x"], each["y"])],
            f"{each['name']} over the fit",
            each["axis"],
            show=in_unit(each["unit"]),
            band=(each["low"], each["high"]) if known else None,
            truths=[] if each["true"] is None else [each["true"]],
            logarithmic=False,
        )
    return {**each, "chart": chart, "grade": "" if each["error"] is None else grade(each["error"])}


def _refitted(said: Any) -> list[tuple[str, ...]]:
    """Return the lines of the table of refitted parameters."""
    return [
        (name, quantity(one.nominal, "kg" if name.endswith(".mass") else "", 4), _estimated(one.with_effect))
        for name, one in said.parameters.items()
    ]


def _estimated(value: Any) -> str:
    return NOTHING if value is None else estimate(value)


def _scored(each: Mapping[str, Any]) -> str:
    """Say whether a figure of a bank is as wanted, good, or missed; nothing where nothing is asked."""
    if keeps(each["value"], each["wanted"]):
        return "as wanted"
    return {True: "good", False: "missed", None: ""}[keeps(each["value"], each["good"])]


def _result(cell: Mapping[str, Any]) -> dict[str, Any]:
    """Return a line of the table of a reproduction: value, paper and target with the unit."""

    def text(value: object) -> str:
        if isinstance(value, int | float):
            return quantity(value, cell.get("unit"))
        return NOTHING if value is None else str(value)

    spread = f" ± {figure(cell['spread'], 2)}" if cell.get("spread") else ""
    shown = (text(cell["value"]) + spread, text(cell.get("paper")), text(cell.get("target")))
    return {"cell": cell["cell"], "metric": cell["metric"], "texts": shown, "met": met(cell)}


def _curves(run: Run) -> list[tuple[str, list[tuple[str, Markup]]]]:
    """Draw the curves of a run by group."""
    drawn = []
    for group, title in GROUPS:
        curves = [each for each in run["curves"] if each["group"] == group and len(each["x"]) > 1]
        lines = [(each["name"], _curve(each)) for each in curves]
        drawn += [(title, lines)] * bool(lines)
    return drawn


def _curve(each: Mapping[str, Any]) -> Markup:
    series = Series(each["name"], "s0", each["x"], each["y"])
    return line_chart([series], each["name"], each["axis"], show=partial(named, each["name"]))
