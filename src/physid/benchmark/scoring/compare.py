"""Baselines beside the diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from physid.benchmark.bank import Bank
from physid.benchmark.films import seen_poses
from physid.benchmark.labels import Label
from physid.benchmark.scoring.baselines import METHODS, Answer, answers
from physid.benchmark.scoring.figures import Figure, middle, share
from physid.benchmark.scoring.judging import MEDIUM, STRONG, Judged
from physid.data import RecordingSet
from physid.diagnosis.document.document import FILE, read_diagnosis

HEADER = ("method", "false alarms %", "flagged %", "exact %", "unknown %", "closed, same", "closed, transfer")


def beside_baselines(bank: Bank, judged: Sequence[Judged], labels: Mapping[str, Label]) -> list[tuple[str, ...]]:
    """Ask the baselines about every set that was diagnosed, and return `baseline_figures`."""
    said = {}
    for one in judged:
        if one.verdict != "failed":
            document = read_diagnosis(bank.verdict(one.name) / FILE)
            seen = RecordingSet(seen_poses(bank.recordings(one.name), bank.verdict(one.name)))
            said[one.name] = answers(seen, document, labels[one.name].noise)
    return baseline_figures([one for one in judged if one.name in said], said)


def baseline_figures(judged: Sequence[Judged], said: Mapping[str, Mapping[str, Answer]]) -> list[tuple[str, ...]]:
    """Return a table: for the diagnosis and each baseline the shares of `HEADER`, with their 95 % intervals.

    Args:
        judged: All sets.
        said: For each set what each baseline says.
    """
    rows: list[tuple[str, ...]] = [HEADER]
    ours = {one.name: Answer(one.flagged, " + ".join(one.named) or None, one.same, one.transfer) for one in judged}
    answers = {"physid diagnose": ours} | {
        method: {name: each[method] for name, each in said.items()} for method in METHODS
    }
    for method, answer in answers.items():
        rows.append((method, *(_cell(figure) for figure in _row(judged, answer))))
    return rows


def _row(judged: Sequence[Judged], answer: Mapping[str, Answer]) -> list[Figure]:
    free = [one for one in judged if one.label.role == "free"]
    shown = [one for one in judged if one.label.role != "free" and one.label.severity >= MEDIUM]
    plain = [one for one in shown if one.label.right and one.label.role in ("catalogue", "native")]
    alone = [one for one in shown if not one.label.right and one.label.severity >= STRONG]
    names = [any(answer[one.name].named == " + ".join(right) for right in one.label.right) for one in plain]
    # A method that cannot say "unknown" is right there only if it flags a gap and names nothing.
    unnamed = [answer[one.name].flagged and answer[one.name].named is None for one in alone]
    closed = [answer[one.name] for one in shown if one.label.right]
    return [
        share("", [answer[one.name].flagged for one in free]),
        share("", [answer[one.name].flagged for one in shown]),
        share("", names),
        share("", unnamed),
        middle("", [each.same for each in closed if each.same is not None], "-"),
        middle("", [each.transfer for each in closed if each.transfer is not None], "-"),
    ]


def _cell(figure: Figure) -> str:
    if figure.value is None or figure.low is None or figure.high is None:
        return ""
    return f"{figure.value:.3g} ({figure.low:.3g} to {figure.high:.3g})"
