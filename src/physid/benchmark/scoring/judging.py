"""One verdict against the truth."""

from __future__ import annotations

from dataclasses import dataclass

from physid.benchmark.labels import Label
from physid.benchmark.verdicts import Spent
from physid.diagnosis.document.document import SITES, Diagnosis, Split

MOST_MEMBERS = 8  # a group of more members says nothing: it counts as wrong
WEAK, MEDIUM, STRONG = 0.1, 0.3, 1.0  # [standard deviations of the noise] severities from which on a set is called so
NO_GAP = 1.02  # gaps below this multiple of the noise are not asked to close
BINS = ("faint", "weak", "medium", "strong")
BODY_FIXED = ("com_offset", "force_offset")  # their direction is that of the body: its films tell but half the heading


@dataclass(frozen=True)
class Judged:
    """What became of one set.

    Attributes:
        name: The set.
        label: Its truth.
        verdict: none, named, group, partial, unknown, or failed.
        named: Effects that were blamed.
        group: Effects that the diagnosis could not tell apart.
        confidence: How sure it was.
        exact: Whether precisely the right effects were blamed (or `none`, or `unknown`, where that is right).
        grouped: Whether the right effects are in the group (or the same).
        site: Whether the strongest site is right; None where there is no effect or nothing was flagged.
        phase: Whether the strongest cell lies in a phase in which the effect acts; None likewise.
        covered: For each interval of a parameter, whether the truth is inside: those of effects, and all others.
        same: Part of the gap that closed on the same protocol, relative to the true effect; None where undefined.
        transfer: The same on the transfer protocol.
        seconds: How long the diagnosis took.
        cpu_seconds: How long a processor worked on it.
    """

    name: str
    label: Label
    verdict: str
    named: tuple[str, ...] = ()
    group: tuple[str, ...] = ()
    confidence: float = 0.0
    exact: bool = False
    grouped: bool = False
    site: bool | None = None
    phase: bool | None = None
    covered: tuple[tuple[bool, ...], tuple[bool, ...]] = ((), ())
    same: float | None = None
    transfer: float | None = None
    seconds: float | None = None
    cpu_seconds: float | None = None

    @property
    def flagged(self) -> bool:
        """Whether a gap was seen."""
        return self.verdict not in ("none", "failed")

    @property
    def parts(self) -> int:
        """How many of the hidden effects are among those that were blamed, or in their group."""
        return len({part.name for part in self.label.effects} & {*self.named, *self.group})

    @property
    def least(self) -> float:
        """The severity of the weakest effect in the set; 0 without effects."""
        return min((part.severity for part in self.label.effects), default=0.0)

    @property
    def astray(self) -> bool:
        """Whether a cause is blamed that is not there; what cannot be told from the one that is there is not astray."""
        there = {part.name for part in self.label.effects}.union(*self.label.right)
        alike = self.grouped and len(self.named) <= len(self.label.effects)
        return bool(set(self.named) - there) and not alike

    @property
    def answer(self) -> str:
        """What was said, in one word, for the table of confusions."""
        return " + ".join(sorted(self.named)) if self.named else self.verdict


def bin_of(severity: float) -> str:
    """Return the name of a severity."""
    return BINS[sum(severity >= limit for limit in (WEAK, MEDIUM, STRONG))]


def judge(name: str, document: Diagnosis, label: Label, spent: Spent | None = None) -> Judged:
    """Compare a verdict with the truth.

    Args:
        name: The set.
        document: What was said.
        label: The truth.
        spent: What the diagnosis took.
    """
    verdict = document.verdict
    named = document.blamed
    group = tuple(dict.fromkeys((*named, *document.group)))
    if label.right:
        exact = any(sorted(right) == sorted(named) for right in label.right)
        enough = [right for right in label.right if set(right) <= set(group) and len(named) >= len(right)]
        grouped = exact or (bool(enough) and len(group) <= MOST_MEMBERS)
    else:
        exact = grouped = verdict == ("unknown" if label.effects else "none")
    flagged = verdict != "none"
    return Judged(
        name,
        label,
        verdict,
        named,
        group,
        document.confidence,
        exact,
        grouped,
        _site(document, label) if flagged and label.effects else None,
        _phase(document, label) if flagged and label.phases else None,
        (_effect_coverage(document, label), _parameter_coverage(document, label)),
        _closed(document, label, "same"),
        _closed(document, label, "transfer"),
        seconds=None if spent is None else spent.seconds,
        cpu_seconds=None if spent is None else spent.cpu_seconds,
    )


def _site(document: Diagnosis, label: Label) -> bool:
    shares = document.where.site
    if not any(shares.values()):
        return False  # a gap of which nothing is said is not where the effect is
    return max(SITES, key=lambda site: shares[site]) in {part.site for part in label.effects}


def _phase(document: Diagnosis, label: Label) -> bool:
    """Return whether the phase with the largest share is one in which the effects act."""
    shares = document.where.phase
    return bool(shares) and max(shares, key=lambda phase: shares[phase]) in label.phases


def _effect_coverage(document: Diagnosis, label: Label) -> tuple[bool, ...]:
    """Tell for each parameter of the rightly named effects whether its interval holds the truth."""
    true = {part.name: part.parameters for part in label.effects}
    if sorted(true) != sorted(effect.name for effect in document.effects):
        return ()
    return tuple(
        estimate.low <= true[effect.name][key] <= estimate.high
        for effect in document.effects
        if not (label.film and effect.name in BODY_FIXED)
        for key, estimate in effect.parameters.items()
        if key in true[effect.name]  # an effect of the same name that has other parameters says nothing of the truth
    )


def _parameter_coverage(document: Diagnosis, label: Label) -> tuple[bool, ...]:
    """Tell the same for the parameters of the scene, where the right effects were added."""
    if sorted(part.name for part in label.effects) != sorted(effect.name for effect in document.effects):
        return ()
    found = {name: value.with_effect for name, value in document.parameters.items()}
    return tuple(
        one.low <= label.parameters[name] <= one.high
        for name, one in found.items()
        if one is not None and name in label.parameters
    )


def _closed(document: Diagnosis, label: Label, split: Split) -> float | None:
    """Return (before - after) / (before - floor): the true effect, at its true size, leaves but the sensor's noise."""
    error, floor = document.errors(split), (2 if label.film else 3) ** 0.5 * label.noise  # no film tells the height
    if error is None or not label.effects or error.before < NO_GAP * floor:
        return None
    after = error.before if error.after is None else error.after
    return float((error.before - after) / (error.before - floor))
