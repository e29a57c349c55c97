"""Which effect: the ranking, sizes with intervals, the group, and the parameters before and after."""

from __future__ import annotations

from collections.abc import Sequence

from physid.diagnosis.document.document import Diagnosis, Estimate, Ranked, Refitted
from physid.diagnosis.document.sentences import capital, figure, join, percent, resolved, unit_of, words
from physid.diagnosis.report.contents import ReportData
from physid.diagnosis.report.elements import Markup, badge, card, element

MOST_RANKED = 10


def ranking(diagnosis: Diagnosis, pictures: ReportData) -> Markup | None:
    """Draw the candidates, best first, each with its score as a bar and its p-value."""
    candidates = diagnosis.ranking[:MOST_RANKED]
    if not candidates:
        return None
    blamed = [effect.name for effect in diagnosis.effects]
    line = pictures.threshold
    most = max([*(each.score for each in candidates), line or 0.0, 1e-12])
    rows = [_candidate(each, blamed, diagnosis.group, most, line) for each in candidates]
    notes = []
    if line is not None:
        notes.append(f"The line marks the score {figure(line)} that null simulations seldom exceed.")
    if pictures.replicates:
        notes.append(f"p-values come from {pictures.replicates} null simulations, for the best of all candidates.")
    left = len(diagnosis.ranking) - len(candidates)
    notes += [f"{left} more candidates are in diagnosis.json."] * (left > 0)
    return card("Ranking of the candidates", element("div", rows, class_="ranking"), note=" ".join(notes), wide=True)


def _candidate(
    candidate: Ranked, blamed: Sequence[str], group: Sequence[str], most: float, line: float | None
) -> Markup:
    names = candidate.effects
    chosen = bool(blamed) and set(names) == set(blamed)
    label: list[str] = [" + ".join(words(name) for name in names)]
    if chosen:
        label += [" ", badge("verdict")]
    elif set(names) <= set(blamed):
        label += [" ", badge("part of the verdict")]
    elif set(names) <= set(group):
        label += [" ", badge("not told apart", "warn")]
    share = 100 * min(max(candidate.score / most, 0.0), 1.0)
    bar = [element("i", class_=None if set(names) <= set(blamed) else "muted", style=f"width: {max(share, 0.5):.1f}%")]
    if line is not None:
        bar.append(element("b", style=f"left: {100 * line / most:.1f}%"))
    return element(
        "div",
        element("span", label, class_="label"),
        element("span", bar, class_="bar", title=f"score {figure(candidate.score, 4)}"),
        element("span", figure(candidate.score), class_="number soft"),
        element("span", f"p {figure(candidate.p_value, 2)}", class_="number"),
    )


def effects(diagnosis: Diagnosis, pictures: ReportData) -> list[Markup | None]:
    """Draw a card for each blamed effect: what it says, how large it is."""
    level = percent(pictures.interval)
    cards = []
    for effect in diagnosis.effects:
        formula = pictures.formulas.get(effect.name)
        sizes = [_size(name, value) for name, value in effect.parameters.items()]
        note = f"Value and {level} interval; 0 is no effect." if sizes else ""
        cards.append(
            card(
                "",
                element("h3", capital(words(effect.name)), " ", badge(effect.site, "plain")),
                element("p", formula, class_="formula") if formula else None,
                *sizes,
                note=note,
            )
        )
    return cards


def _size(name: str, value: Estimate) -> Markup:
    """Draw a value and its interval on an axis that holds 0."""
    low, high = min(float(value.low), 0.0), max(float(value.high), 0.0)
    room = 0.06 * ((high - low) or 1.0)
    low, high = low - room, high + room

    def place(at: float) -> float:
        return 100 * (at - low) / (high - low)

    left, right = place(value.low), place(value.high)
    middle, least, most = resolved(value)
    marks = [
        element("b", style=f"left: {place(0.0):.1f}%"),
        element("u", style=f"left: {left:.1f}%; width: {max(right - left, 0.8):.1f}%"),
        element("i", class_="dot after", style=f"left: {place(value.value):.1f}%"),
    ]
    return element(
        "div",
        element("p", words(name), class_="small soft"),
        element("p", element("span", middle, unit_of(value), class_="big"), class_="number"),
        element("p", f"{least} to {most}{unit_of(value)}", class_="small soft number"),
        element("div", marks, class_="track"),
        class_="size",
    )


def group(diagnosis: Diagnosis) -> Markup | None:
    """List the effects that these recordings cannot tell from those blamed."""
    blamed = [effect.name for effect in diagnosis.effects]
    others = [name for name in diagnosis.group if name not in blamed]
    if not others:
        return None
    text = f"These recordings cannot tell {join(map(words, blamed), 'and')} from {join(map(words, others), 'or')}."
    chips = [badge(words(name), "" if name in blamed else "warn") for name in diagnosis.group]
    return card("Cannot be told apart", element("p", text), element("div", chips, class_="chips"))


def parameters(diagnosis: Diagnosis, pictures: ReportData) -> Markup | None:
    """Tabulate the unknown parameters of the nominal model, refitted without and with the effect."""
    if not diagnosis.parameters:
        return None
    known = diagnosis.parameters
    with_effect = any(value.with_effect for value in known.values())
    head = ["Parameter", "Nominal model", *["With the effect"] * with_effect]
    titles = [element("th", text, scope="col", class_="right" if index else None) for index, text in enumerate(head)]
    rows = [
        element("tr", element("th", name, scope="row"), _parameter(value, with_effect)) for name, value in known.items()
    ]
    note = (
        f"Below a value its {percent(pictures.interval)} interval and how far the effect moves it: the bias without it."
    )
    return card(
        "Parameters, refitted",
        element("table", element("thead", element("tr", titles)), element("tbody", rows)),
        note=note if with_effect else "",
        wide=True,
    )


def _parameter(value: Refitted, with_effect: bool) -> list[Markup]:
    """Fill the cells of one parameter."""
    after = value.with_effect
    unit = unit_of(after) if after else ""
    cells = [element("td", figure(value.nominal, 4), unit, class_="right number")]
    if not with_effect:
        return cells
    if not after:
        return [*cells, element("td", "-", class_="right")]
    middle, low, high = resolved(after)
    moved = f", {100 * (after.value / value.nominal - 1):+.1f} %" if value.nominal else ""
    small = element("span", f"{low} to {high}{moved}", class_="small soft")
    return [*cells, element("td", f"{middle}{unit}", element("br"), small, class_="right number")]
