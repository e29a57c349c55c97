"""A diagnosis in words: one plain sentence, the three answers, at most ten lines for the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence

from physid.diagnosis.document.document import Cell, Diagnosis, Errors, Estimate, Split
from physid.diagnosis.document.residual_sentences import impacts_sentence
from physid.diagnosis.document.residual_sentences import law_name as law_name
from physid.diagnosis.document.residual_sentences import residual_sentences as residual_sentences
from physid.diagnosis.settings.conclusion import GapSettings
from physid.inspection.finding import trust_sentence
from physid.pages.numbers import capital, figure, interval, join, p_value, percent, quantity, words

MOST_LINES = 10
MOST_PARAMETERS, MOST_REFITTED = 3, 6  # of effects, and of bodies, that the terminal shows
MOST_CELLS = 2
LEAST_PHASE = 0.05  # share of a phase that is said
MOST_HIDDEN = 6
SPLIT_NAMES: dict[Split, str] = {"same": "same protocol", "transfer": "transfer protocol"}
LABEL_WIDTH = 9


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """Say the verdict of a document in one plain sentence.

    A cause is called a cause only where a transfer set has certified it.
    """
    named = capital(join((words(effect.name) for effect in diagnosis.effects), "and"))
    several = len(diagnosis.effects) > 1
    certified = diagnosis.gap.transfer is not None
    cause, part = ("causes", "causes part of") if certified else ("accounts for", "accounts for part of")
    if several:
        cause, part = ("cause", "cause part of") if certified else ("account for", "account for part of")
    if diagnosis.verdict == "group" and several:
        others = [name for name in diagnosis.group if name not in diagnosis.blamed]
        rivals = join(map(words, others), "or")
        replaced = {_replaced(diagnosis, other) for other in others}
        one = replaced.pop() if len(replaced) == 1 else None
        return f"{named} {cause} the gap; these recordings cannot tell {words(one) if one else 'them'} from {rivals}."
    if diagnosis.verdict == "group":
        group = join((words(name) for name in diagnosis.group), "or")
        verb = "is caused" if certified else "is accounted for"
        return f"The gap {verb} by one of {group}; these recordings cannot tell which."
    return {
        "none": _none(diagnosis),
        "named": f"{named} {cause} the gap between model and recordings.",
        "partial": f"{named} {part} the gap; something is left that no candidate explains.",
        "unknown": "There is a gap between model and recordings, and no candidate explains it.",
    }[diagnosis.verdict]


def _none(diagnosis: Diagnosis) -> str:
    """Say that nothing is blamed: since little is left, or since simulations without any effect leave as much."""
    if explains(diagnosis):
        within = max(diagnosis.gap.tolerance.position, _left(diagnosis))
        return f"The model explains these recordings within {quantity(within, 'm')} beyond the noise."
    return (
        f"The model leaves {quantity(_left(diagnosis), 'm')} beyond the noise, but reference simulators without any "
        "effect leave as much: these recordings cannot show why."
    )


def explains(diagnosis: Diagnosis) -> bool:
    """Return whether the nominal model leaves held-out positions by no more than the tolerance, or than the noise.

    Errors of a few trajectories scatter about the floor; what exceeds it by less than itself may be chance.
    """
    return _left(diagnosis) <= max(diagnosis.gap.tolerance.position, diagnosis.gap.floor)


def _left(diagnosis: Diagnosis) -> float:
    """Return by how much the nominal model leaves positions beyond the noise [m], on the worse of the protocols."""
    return max(diagnosis.gap.beyond_noise(each) for each in (diagnosis.gap.same, diagnosis.gap.transfer))


def kind_of(diagnosis: Diagnosis) -> str:
    """Return how pages show the verdict: good, warn, bad, or neither; a gap that nothing is said of is a warning."""
    known = {"none": "good" if explains(diagnosis) else "warn", "group": "warn", "partial": "warn", "unknown": "bad"}
    return known.get(diagnosis.verdict, "")


def _replaced(diagnosis: Diagnosis, rival: str) -> str | None:
    """Return the blamed effect in whose place a rival predicts best; None where no ranked hypothesis shows one."""
    for row in diagnosis.ranking:
        away = {*diagnosis.blamed} - {*row.effects}
        if {*row.effects} - {*diagnosis.blamed} == {rival} and len(away) == 1:
            return away.pop()
    return None


def caveat(diagnosis: Diagnosis) -> str:
    """Say what the verdict does not mean; empty where there is nothing to warn of."""
    said = [impacts_sentence(diagnosis.gap.impacts)]
    if diagnosis.minor:
        named = [
            f"{' + '.join(words(name) for name in one.effects)} (closes {percent(one.closes)} of the gap)"
            for one in diagnosis.minor
        ]
        said.append(f"Significant but minor, below the tolerance: {join(named, 'and')}.")
    elif diagnosis.verdict == "none":
        said.append(power_sentence(diagnosis))
    if diagnosis.effects and diagnosis.gap.transfer is None:
        said.append("Predictive only, cause not certified: there is no transfer set.")
    return " ".join(filter(None, said))


def doubt(diagnosis: Diagnosis) -> str:
    """Say that something in the recordings looks like a mistake; empty where nothing does."""
    return trust_sentence(diagnosis.findings) or ""


def power_sentence(diagnosis: Diagnosis) -> str:
    """Say which effects would have been found, so that `none` is not read as more than it says."""
    hidden = undetectable(diagnosis)
    count = len({one.effect for one in diagnosis.detectable})
    if not hidden:
        return f"Each of {count} effects would have been found at its typical size." if count else ""
    shown = [words(name) for name in hidden[:MOST_HIDDEN]]
    shown += [f"{len(hidden) - len(shown)} more"] * (len(hidden) > len(shown))
    return (
        f"{count - len(hidden)} of {count} effects would have been found at their typical size; these recordings could "
        f"not show {join(shown, 'or')}."
    )


def undetectable(diagnosis: Diagnosis) -> list[str]:
    """List the effects that may be of their typical size and would not have been found."""
    least: dict[str, float] = {}
    for one in diagnosis.detectable:
        share = math.inf if one.size is None or one.typical == 0 else one.size / one.typical
        least[one.effect] = min(share, least.get(one.effect, math.inf))
    return [name for name, share in least.items() if share > 1]


def where_sentence(diagnosis: Diagnosis) -> str:
    """Say which site the evidence points to, and when blamed effects are at work or in which cells it is strongest."""
    shares = sorted(diagnosis.where.site.items(), key=lambda item: -item[1])
    site = ", ".join(f"{name} {percent(share)}" for name, share in shares[:2] if share >= 0.005)
    site = site or "no site stands out"
    if diagnosis.blamed and diagnosis.where.phase:
        acting = [(name, share) for name, share in diagnosis.where.phase.items() if share >= LEAST_PHASE]
        return f"{site}; at work in " + ", ".join(f"{words(name)} {percent(share)}" for name, share in acting)
    cells = sorted(diagnosis.where.cells, key=lambda cell: -cell.evidence)[:MOST_CELLS]
    alone = [f" (explains {share} of the gap)" if (share := cell_share(diagnosis, cell)) else "" for cell in cells]
    places = [f"{words(cell.phase)}, {cell.body} {cell.dof}" for cell in cells]
    strongest = "; ".join(f"{place}{share}" for place, share in zip(places, alone, strict=True))
    hit = diagnosis.gap.impacts
    first = "" if hit is None else f"at impacts ({hit.unexplained} of {hit.among} segments with one are not explained)"
    parts = [site, first, f"{'elsewhere ' * bool(hit)}strongest in {strongest}" if strongest else ""]
    return "; ".join(part for part in parts if part)


def effect_lines(diagnosis: Diagnosis) -> list[str]:
    """Give the size of each parameter of the blamed effects, with its interval.

    What is known best comes first: of each effect, then of what is left.
    """
    sizes = [
        (effect.name, f"{effect.name}.{name} = {estimate(value)}", value.value / max(value.high - value.low, 1e-12))
        for effect in diagnosis.effects
        for name, value in effect.parameters.items()
    ]
    known = [(name, line) for name, line, _ in sorted(sizes, key=lambda size: -abs(size[2]))]
    first = dict(reversed(known)).values()
    lines = [line for _, line in known]
    ordered = [*(line for line in lines if line in first), *(line for line in lines if line not in first)]
    return ordered or [effect.name for effect in diagnosis.effects]


def how_far_sentence(diagnosis: Diagnosis, split: Split) -> str:
    """Give the error before and after on one split, its floor, and the share of the gap that was closed.

    Of rotations where these show the gap more clearly; positions follow.
    """
    part, shown, errors = closed(diagnosis, split), diagnosis.shown(split), diagnosis.errors(split)
    assert shown is not None
    assert errors is not None
    error, floor, unit = shown
    text = f"{SPLIT_NAMES[split]}: {before_and_after(error, unit)} (floor {quantity(floor, unit)})"
    beside = "" if error is errors else f"; positions {before_and_after(errors, diagnosis.gap.unit)}"
    if part is not None:
        parts = diagnosis.shrink.parts.get(split, {})
        divided = join((f"{words(name)} {percent(each)}" for name, each in parts.items()), "and")
        return f"{text}, {' closed ('.join(part)})" + (f": {divided}" if len(parts) > 1 else "") + beside
    silent = error.after is None and not (diagnosis.verdict == "unknown" and near_floor(diagnosis, split))
    return (text if silent else f"{text}, {no_share(diagnosis, split)}") + beside


def no_share(diagnosis: Diagnosis, split: Split) -> str:
    """Say why no share of the gap is known: errors are near the floor of the noise, or near what numerics leave."""
    if near_floor(diagnosis, split):
        left = diagnosis.gap.impacts
        seen = "parts of a motion show it" if left is None else f"impacts show it, {quantity(left.position, 'm')} there"
        return "too near to the floor for a share" if diagnosis.blamed else f"near the floor: {seen}"
    return "no share is known: in these trajectories numerics alone may leave as much"


def near_floor(diagnosis: Diagnosis, split: Split) -> bool:
    """Return whether errors over whole trajectories are near what noise alone leaves."""
    error, floor, _ = diagnosis.shown(split) or (None, 0.0, "")
    return error is None or error.before <= decided(diagnosis, "gap", "no_gap", GapSettings().no_gap) * floor


def before_and_after(error: Errors, unit: str) -> str:
    """Give an error before and, where effects were added, after."""
    return quantity(error.before, unit) + ("" if error.after is None else f" -> {quantity(error.after, unit)}")


def decided(said: Diagnosis, section: str, name: str, default: float) -> float:
    """Return a setting that decided; the default where an older file does not say."""
    return float(said.settings.get(section, {}).get(name, default))


def closed(said: Diagnosis, split: Split) -> tuple[str, str] | None:
    """Say which share of the gap is closed on a split, and its interval; no more than all where the floor is not sure.

    None where no share is known.
    """
    share = said.share(split)
    if share is None:
        return None
    if share.low is None or share.high is None:
        return percent(share.value), "too few trajectories for an interval"
    if share.high > decided(said, "gap", "most_closed", GapSettings().most_closed):
        return percent(min(share.value, 1.0)), f"at least {percent(min(share.low, 1.0))}"
    low, high = percent(share.low), percent(share.high)
    if low == high:
        low, high = f"{100 * share.low:.1f} %", f"{100 * share.high:.1f} %"
    return percent(share.value), f"{low} to {high}"


def summary_lines(diagnosis: Diagnosis) -> list[str]:
    """Sum up a diagnosis for the terminal.

    That takes ten lines at most, and one more for each further effect, residual law, or mistake in the recordings.
    """
    sure = f"(confidence {percent(diagnosis.confidence)})"
    lines = _labelled("Verdict", [f"{diagnosis.verdict}: {verdict_sentence(diagnosis)} {sure}"])
    doubts = [doubt(diagnosis), *(one.what for one in diagnosis.findings if one.wrong)] if doubt(diagnosis) else []
    lines += _labelled("Beware", doubts)
    lines += _labelled("Where", [where_sentence(diagnosis)])
    lines += _labelled("Which", _which(diagnosis))
    lines += _labelled("Missing", residual_sentences(diagnosis.residual))
    splits = [split for split in SPLIT_NAMES if diagnosis.errors(split) is not None]
    lines += _labelled("How far", [how_far_sentence(diagnosis, split) for split in splits])
    lines += _labelled("Note", [caveat(diagnosis)] if caveat(diagnosis) else [])
    lines += _labelled("Refitted", _refitted(diagnosis))
    lines += _labelled("Next", [diagnosis.next_experiment] if diagnosis.next_experiment else [])
    return lines[: MOST_LINES + max(0, len(diagnosis.effects) - 1) + len(diagnosis.residual) + len(doubts)]


def _which(diagnosis: Diagnosis) -> list[str]:
    """Give the sizes of the effects; without any, the best candidate and its p-value."""
    sizes = effect_lines(diagnosis)
    if sizes:
        most = max(MOST_PARAMETERS, len(diagnosis.effects) + 1)
        shown = sizes[: most - 1] if len(sizes) > most else sizes
        return [*shown, *[f"and {len(sizes) - len(shown)} parameters more"] * (len(shown) < len(sizes))]
    if not diagnosis.ranking:
        return ["no candidate stands out"]
    best = diagnosis.ranking[0]
    return [f"none; best candidate {' + '.join(best.effects)}, p {p_value(best.p_value, diagnosis.null_simulations)}"]


def _refitted(diagnosis: Diagnosis) -> list[str]:
    """Give the unknown parameters without and with the effect, in one line."""
    known = list(diagnosis.parameters.items())
    texts = [
        f"{name} {figure(value.nominal)}" + ("" if value.with_effect is None else f" -> {estimate(value.with_effect)}")
        for name, value in known[:MOST_REFITTED]
    ]
    more = [f"and {len(known) - MOST_REFITTED} more"] * (len(known) > MOST_REFITTED)
    return [", ".join([*texts, *more])] if texts else []


def _labelled(label: str, lines: Sequence[str]) -> list[str]:
    """Put a label before the first line and room before the others."""
    return [f"{label if index == 0 else '':<{LABEL_WIDTH}} {line}" for index, line in enumerate(lines)]


def estimate(value: Estimate) -> str:
    """Write a value with its interval and unit."""
    return interval(value.value, value.low, value.high, value.unit)


def explained(said: Diagnosis, score: float) -> str:
    """Say which part of the gap a candidate explains; its score where the size of the gap is not known.

    The gap is at least what the best candidate explains, which a line at the nominal model may not see as large.
    """
    largest = max([said.excess or 0.0, *(one.score for one in said.ranking)])
    return percent(max(score, 0.0) / largest) if said.excess else figure(score)


def cell_share(said: Diagnosis, cell: Cell) -> str:
    """Say which part of the gap a cell of the map explains alone; empty where the gap's size is not known."""
    return percent(min(cell.evidence**2 / said.excess, 1.0)) if said.excess else ""
