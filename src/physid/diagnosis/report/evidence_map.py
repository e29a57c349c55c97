"""Pictures of where the gap lies: site, phase x body x degree of freedom, and time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from physid.diagnosis.document.document import DOFS, PHASES, SITES, Cell, Diagnosis
from physid.diagnosis.document.sentences import capital, figure, percent, words
from physid.diagnosis.report.contents import TimeMap
from physid.diagnosis.report.elements import Markup, card, element
from physid.physics.effect import Site

DARK = 0.55  # share of the largest evidence from which on the ink is light
WIDE = 6  # a map with more columns takes the whole width


def site_bar(shares: Mapping[Site, float]) -> Markup | None:
    """Draw the shares of the four sites as one bar with a legend."""
    if not sum(shares.values()):
        return None
    parts = [
        element(
            "i", class_=f"site-{site}", style=f"flex-grow: {shares[site]:.4f}", title=f"{site} {percent(shares[site])}"
        )
        for site in SITES
        if shares[site] > 0
    ]
    legend = [
        element("span", element("i", class_=f"site-{site}"), site, " ", element("b", percent(shares[site])))
        for site in sorted(SITES, key=lambda site: -shares[site])
    ]
    return card(
        "Site", element("div", parts, class_="stack"), element("div", legend, class_="legend squares"), wide=True
    )


def evidence_map(cells: Sequence[Cell]) -> Markup | None:
    """Draw the evidence as one grid per body, phases down and degrees of freedom across."""
    if not cells:
        return None
    most = max(max(cell.evidence for cell in cells), 1e-12)
    bodies = list(dict.fromkeys(cell.body for cell in cells))
    phases = [phase for phase in PHASES if any(cell.phase == phase for cell in cells)]
    dofs = [dof for dof in DOFS if any(cell.dof == dof for cell in cells)]
    grids = []
    for body in bodies:
        mine = [cell for cell in cells if cell.body == body]
        known: dict[tuple[str, str], float] = {(cell.phase, cell.dof): cell.evidence for cell in mine}
        grids.append(element("figure", element("figcaption", body), _grid(phases, dofs, known, most)))
    return card(
        "Phase, body and degree of freedom",
        element("div", grids, class_="maps"),
        _scale(most),
        note="Evidence of each cell for a residual wrench that acts there only. "
        "x, y, z are forces along the axes of the ground, rx, ry, rz torques about them; an empty cell was not tested.",
        wide=len(bodies) * len(dofs) > WIDE,
    )


def _grid(phases: Sequence[str], dofs: Sequence[str], known: Mapping[tuple[str, str], float], most: float) -> Markup:
    head = element("tr", element("td"), [element("th", dof, scope="col") for dof in dofs])
    rows = [
        element(
            "tr",
            element("th", words(phase), scope="row"),
            [_cell(known.get((phase, dof)), most, f"{words(phase)}, {dof}") for dof in dofs],
        )
        for phase in phases
    ]
    return element("table", element("thead", head), element("tbody", rows), class_="heat")


def _cell(evidence: float | None, most: float, place: str) -> Markup:
    if evidence is None:
        return element("td", class_="untested", title=f"{place}: not tested")
    share = min(max(evidence / most, 0.0), 1.0)
    kind = " ".join(["strongest"] * (share == 1.0) + ["full"] * (share > DARK))
    return element(
        "td",
        figure(evidence, 2),
        class_=kind or None,
        style=f"--heat: {100 * share:.0f}%",
        title=f"{place}: {figure(evidence)}",
    )


def _scale(most: float) -> Markup:
    """Explain the colours."""
    return element("div", "0", element("i", class_="ramp"), figure(most), class_="scale small soft")


def time_map(picture: TimeMap | None) -> Markup | None:
    """Draw the evidence over time, one row for each body and degree of freedom."""
    if picture is None:
        return None
    most = max(float(picture.evidence.max()), 1e-12)
    widths = " ".join(f"{end - start:.6g}fr" for start, end in zip(picture.edges[:-1], picture.edges[1:], strict=True))
    rows: list[Markup] = []
    for (body, dof), values in zip(picture.rows, picture.evidence, strict=True):
        cells = [
            element(
                "i",
                style=f"--heat: {100 * min(max(float(value) / most, 0.0), 1.0):.0f}%",
                title=f"{body} {dof}, {start:.2f} to {end:.2f} s: {figure(float(value))}",
            )
            for value, start, end in zip(values, picture.edges[:-1], picture.edges[1:], strict=True)
        ]
        rows += [
            element("span", f"{body} {dof}", class_="small"),
            element("div", cells, class_="strip", style=f"grid-template-columns: {widths}"),
        ]
    ends = [element("span", f"{figure(float(edge))} s") for edge in (picture.edges[0], picture.edges[-1])]
    axis = [element("span"), element("div", ends, class_="ends small soft")]
    note = "Evidence of each piece of time; the darkest piece has " + figure(most) + "."
    return card("Time", element("div", rows, axis, class_="times"), note=note)


def site_name(diagnosis: Diagnosis) -> str:
    """Name the site with the largest share."""
    shares = diagnosis.where.site
    best = max(SITES, key=lambda site: float(shares[site]))
    if shares[best] > 0:
        return capital(best)
    return "Nowhere" if diagnosis.verdict == "none" else "No site"
