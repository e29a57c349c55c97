"""The report of a diagnosis: one HTML page for a person that needs nothing from outside."""

from __future__ import annotations

from pathlib import Path

from physid.data.files import write_text
from physid.diagnosis.document.document import DOFS, FILE, PHASES, SPLITS, Diagnosis, Split
from physid.diagnosis.document.sentences import (
    SPLIT_NAMES,
    caveat,
    cell_share,
    closed,
    decided,
    doubt,
    explained,
    explains,
    how_far_sentence,
    kind_of,
    law_name,
    near_floor,
    no_share,
    residual_sentences,
    undetectable,
    verdict_sentence,
    where_sentence,
)
from physid.diagnosis.report.contents import Curve, ReportData, TimeMap
from physid.diagnosis.report.drawings import LINES, closing, error_curves, error_levels, residual_law, sizes, time_map
from physid.diagnosis.settings.conclusion import GapSettings, PosteriorSettings
from physid.pages.numbers import capital, figure, join, p_value, percent, words
from physid.pages.templates import data_uri
from physid.pages.templates import render as render_page

__all__ = ["Curve", "ReportData", "TimeMap", "render", "write_report"]

REPORT = "report.html"
CONFIDENCE = 0.9  # of the intervals of files that do not say it
MOST_BYTES = 16_000_000  # of one film; a page beyond this does not open well on a phone
MOST_LISTED = 2  # further members of a group that the answers name
MOST_RANKED = 10
NEAR_SITE = 0.5  # share of the first site's share from which on another one stands beside it
CAUSES = {
    "none": "no effect",
    "other": "another effect of the catalogue",
    "unknown": "an effect that is in no catalogue",
}


def write_report(folder: Path, diagnosis: Diagnosis, data: ReportData) -> Path:
    """Write the report of a diagnosis.

    Args:
        folder: Output folder of the diagnosis; made if it is not there.
        diagnosis: The document.
        data: What is drawn beside it.

    Returns:
        The page, report.html in the folder.

    Raises:
        ValueError: If a film is too large to be carried by a page.
    """
    path = folder / REPORT
    write_text(path, render(diagnosis, data))
    return path


def render(said: Diagnosis, data: ReportData) -> str:
    """Return the page as one HTML document."""
    curves, cells = error_curves(data.curves, said), said.where.cells
    overlay = data.overlay
    names = [name for name in LINES if any(name in curve.lines for curve in data.curves)]
    shares = [
        (SPLIT_NAMES[split], *(closed(said, split) or ("", no_share(said, split))))
        for split in SPLITS
        if (error := said.errors(split)) and error.after is not None
    ]
    return render_page(
        "report.html",
        title=f"Diagnosis of {data.title}" if data.title else "Diagnosis",
        said=said,
        data=data,
        file=FILE,
        kind=kind_of(said),
        level=percent(decided(said, "hypothesis", "confidence", CONFIDENCE)),
        sentence=verdict_sentence(said),
        splits={name: split for split, name in SPLIT_NAMES.items()},
        caveat=caveat(said),
        doubt=doubt(said),
        answers=_answers(said),
        cuts=[(SPLIT_NAMES[split], cut) for split in SPLITS if (cut := _cut(said, data, split))],
        maps={
            body: {(cell.phase, cell.dof): cell.evidence for cell in cells if cell.body == body}
            for body in dict.fromkeys(cell.body for cell in cells)
        },
        phases=[phase for phase in PHASES if any(cell.phase == phase for cell in cells)],
        dofs=[dof for dof in DOFS if any(cell.dof == dof for cell in cells)],
        most=max([*(cell.evidence for cell in cells), 1e-12]),
        strongest=cell_share(said, max(cells, key=lambda cell: cell.evidence)) if cells else "",
        # Evidence of nothing would fill the map with colours all the same.
        time_map=None if said.verdict == "none" else time_map(data.time_map),
        effects=[(effect, data.formulas.get(effect.name), sizes(effect.parameters)) for effect in said.effects],
        others=[name for name in said.group if name not in said.blamed],
        ranked=[(each, explained(said, each.score)) for each in said.ranking[:MOST_RANKED]],
        best=max([*(each.score for each in said.ranking), 1e-12]),
        causes=_causes(said),
        ranking_note=_ranking_note(said, data),
        curves=curves,
        lines=[(name, LINES[name]) for name in names],
        levels=error_levels(said, data),
        shares=shares,
        closing=closing(said),
        missing=[
            (capital(law_name(law)), sentence, residual_law(law))
            for law, sentence in zip(said.residual, residual_sentences(said.residual), strict=True)
        ],
        beyond=any((share := said.share(split)) and share.value > 1 for split in SPLITS),
        hidden=undetectable(said),
        probability=percent(said.settings["power"]["probability"]) if "power" in said.settings else "",
        with_effect=any(value.with_effect for value in said.parameters.values()),
        overlay_film=_film(overlay.film) if overlay and overlay.film else None,
        stills=[(data_uri("image/webp", one.picture), one.caption) for one in overlay.stills] if overlay else [],
    )


def _answers(said: Diagnosis) -> list[tuple[str, str, str]]:
    """Give the three answers in a few words each."""
    blamed = [words(name) for name in said.blamed]
    others = len(said.group) - len(blamed) if blamed else 0
    nobody = "No effect" if _nothing_left(said) else "Not shown" if said.verdict == "none" else "No known effect"
    which, more = capital(join(blamed, "and")) or nobody, ""
    if others and len(blamed) == 1 and others <= MOST_LISTED:
        which, more = capital(join(map(words, said.group), "or")), "these recordings cannot tell which"
    elif others:
        more = f"cannot be told from {others} other{'s' * (others > 1)}"
    split: Split = "transfer" if said.gap.transfer else "same"
    return [
        ("Where", _site(said), where_sentence(said)),
        ("Which", which, more or _best(said)),
        ("How far", _far(said, split), how_far_sentence(said, split)),
    ]


def _cut(said: Diagnosis, data: ReportData, split: Split) -> list[tuple[str, float, str]]:
    """Cut the gap on a split into what each effect closes and the rest: name, share, and style; empty without a gap.

    Where no effect is blamed, residual laws, or else a free residual wrench, stand for what a better model could close.
    """
    error, floor, _ = said.shown(split) or (None, 0.0, "")
    no_gap = decided(said, "gap", "no_gap", GapSettings().no_gap)
    closed_by = [(words(name), share) for name, share in said.shrink.parts.get(split, {}).items()]
    wrench = data.residual_wrench.get(split)
    if said.verdict == "unknown" and error is not None and error.before > no_gap * floor:
        before = [0.0, *(law.explains for law in said.residual)]
        laws = said.residual if split == SPLITS[0] else ()  # judged in all trajectories at once
        closed_by = [(law_name(law), law.explains - old) for law, old in zip(laws, before, strict=False)]
        if not said.residual and wrench is not None:
            closed_by = [("a free force and torque", (error.before - wrench) / (error.before - floor))]
    if not closed_by:
        return []
    parts = [(name, share, f"part-{place}") for place, (name, share) in enumerate(closed_by)]
    rest = 1 - sum(share for _, share in closed_by)
    return [*parts, ("not explained", rest, "rest")] if rest > 0 else parts


def _causes(said: Diagnosis) -> list[tuple[str, float, bool]]:
    """List the fewest causes that make up a probability: name, probability, whether the verdict allows it."""
    mass = decided(said, "posterior", "mass", PosteriorSettings().mass)
    listed: list[tuple[str, float, bool]] = []
    for name, probability in said.causes.items():
        if sum(each for _, each, _ in listed) < mass:
            allowed = said.evidence is not None and name in said.evidence.said
            listed.append((CAUSES.get(name) or words(name), probability, allowed))
    return listed


def _site(said: Diagnosis) -> str:
    """Name the site with the largest share, and those that come near it: all of several effects, or one of a group."""
    shares = sorted(said.where.site.items(), key=lambda item: -item[1])
    near = [site for site, share in shares if share > NEAR_SITE * shares[0][1]]
    if near:
        return capital(join(near, "and" if len(said.blamed) > 1 else "or"))
    return "Nowhere" if _nothing_left(said) else "No site"


def _nothing_left(said: Diagnosis) -> bool:
    """Return whether nothing is blamed, and no gap is left to wonder about."""
    return said.verdict == "none" and explains(said)


def _far(said: Diagnosis, split: Split) -> str:
    """Say in two words how far the gap closes."""
    share, error = closed(said, split), said.errors(split)
    if share is not None:
        return f"{share[0]} closed"
    if _nothing_left(said):
        return "Nothing to close"
    near = near_floor(said, split)
    if error is not None and (error.after is not None or near):
        return "Near the floor" if near else "No share known"
    return "Not closed"


def _best(said: Diagnosis) -> str:
    """Say how the effects stand out from what chance brings."""
    if not said.ranking:
        return "no candidate stands out"
    best = said.ranking[0]
    name = "stands out with" if said.effects else f"best candidate: {' + '.join(map(words, best.effects))},"
    return f"{name} p {_with_sign(p_value(best.p_value, said.null_simulations))}"


def _with_sign(text: str) -> str:
    return text if text.startswith("<") else f"= {text}"


def _ranking_note(said: Diagnosis, data: ReportData) -> str:
    """Say what the bars and the p-values are of."""
    notes = []
    if said.excess:
        notes.append("Parts of the gap that a candidate alone explains; candidates overlap.")
    if said.verdict == "unknown":
        notes.append(
            "None predicts trajectories that it was not fitted to so well that it could be blamed: what is missing may "
            "look like one of them here."
        )
    if data.threshold is not None and said.excess:
        most = explained(said, data.threshold).removeprefix("< ")
        notes.append(f"In null simulations, which have no effect, a candidate seldom explains more than {most}.")
    elif data.threshold is not None:
        notes.append(f"In null simulations a candidate seldom exceeds the score {figure(data.threshold)}.")
    if said.null_simulations or data.replicates:
        count = said.null_simulations or data.replicates
        made = f" ({', '.join(said.references)})" if said.references else ""
        notes.append(f"p-values come from {count} null simulations{made}, for the best of all candidates.")
    left = len(said.ranking) - MOST_RANKED
    return " ".join([*notes, *[f"{left} more candidates are in {FILE}."] * (left > 0)])


def _film(film: Path) -> str:
    content = film.read_bytes()
    if len(content) > MOST_BYTES:
        size = f"{len(content) / 1e6:.0f} MB"
        raise ValueError(f"{film}: expected a film of at most 16 MB, found {size}; make it shorter or smaller")
    return data_uri("video/mp4", content)
