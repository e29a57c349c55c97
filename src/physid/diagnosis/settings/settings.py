"""All settings of a diagnosis in one object: changed by section.name=value, listed as a table, written as a mapping."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import yaml
from pydantic import ValidationError

from physid.diagnosis.settings import conclusion, inputs, reference, selection, testing
from physid.estimation.least_squares import FirstGuess, LeastSquaresSettings, StepChoice
from physid.estimation.measurement import NoiseSettings
from physid.estimation.segmented_fit import (
    EventSettings,
    OddSettings,
    PhaseSettings,
    RoundSettings,
    SegmentedFitSettings,
    UnexplainedSettings,
)
from physid.inspection.usability import RequirementSettings
from physid.setting import Section
from physid.strict import nearest, quoted, shown

CLOSE = 0.6
"""Likeness of a key to the one that is suggested, see `difflib`."""


@dataclass(frozen=True)
class Row:
    """A setting as the table shows it.

    Attributes:
        key: As it is given on the command line.
        value: The same.
        unit: "-" for a pure number, "" for a switch.
        meaning: What it decides.
        calibrated: The decision record or the bank that it came from.
    """

    key: str
    value: str
    unit: str
    meaning: str
    calibrated: str


class Settings(Section):
    """Every number that decides in a diagnosis, by module; those of `estimation` and `inspection` stand there.

    It is passed from `diagnose` down and carried by `NominalFit`, `Hypothesis` and `LackOfFit`; nothing else decides.
    """

    roles: inputs.RoleSettings = inputs.RoleSettings()
    requirements: RequirementSettings = RequirementSettings()
    phases: PhaseSettings = PhaseSettings()
    events: EventSettings = EventSettings()
    noise: NoiseSettings = NoiseSettings()
    least_squares: LeastSquaresSettings = LeastSquaresSettings()
    first_guess: FirstGuess = FirstGuess()
    nominal_fit: RoundSettings = RoundSettings()
    odd: OddSettings = OddSettings()
    unexplained: UnexplainedSettings = UnexplainedSettings()
    segments: reference.SegmentSettings = reference.SegmentSettings()
    steps: StepChoice = StepChoice(shortest=5e-4)
    discrepancy: reference.DiscrepancySettings = reference.DiscrepancySettings()
    null_simulations: reference.NullSimulationSettings = reference.NullSimulationSettings()
    replay: reference.ReplaySettings = reference.ReplaySettings()
    null_distribution: reference.NullDistributionSettings = reference.NullDistributionSettings()
    score_test: testing.ScoreTestSettings = testing.ScoreTestSettings()
    lack_of_fit: testing.LackOfFitSettings = testing.LackOfFitSettings()
    residual_wrench: testing.ResidualWrenchSettings = testing.ResidualWrenchSettings()
    residual_law: testing.ResidualLawSettings = testing.ResidualLawSettings()
    hypothesis: testing.HypothesisSettings = testing.HypothesisSettings()
    equivalence: testing.EquivalenceSettings = testing.EquivalenceSettings()
    contact_free: selection.ContactFreeSettings = selection.ContactFreeSettings()
    candidates: selection.CandidateSettings = selection.CandidateSettings()
    comparison: selection.ComparisonSettings = selection.ComparisonSettings()
    attribution: selection.AttributionSettings = selection.AttributionSettings()
    evidence: selection.EvidenceSettings = selection.EvidenceSettings()
    posterior: conclusion.PosteriorSettings = conclusion.PosteriorSettings()
    parametric_bootstrap: conclusion.BootstrapSettings = conclusion.BootstrapSettings()
    gap: conclusion.GapSettings = conclusion.GapSettings()
    materiality: conclusion.MaterialitySettings = conclusion.MaterialitySettings()
    power: conclusion.PowerSettings = conclusion.PowerSettings()
    verdict: conclusion.VerdictSettings = conclusion.VerdictSettings()
    localisation: conclusion.SiteSettings = conclusion.SiteSettings()
    next_experiment: conclusion.NextExperimentSettings = conclusion.NextExperimentSettings()

    @property
    def segmented_fit(self) -> SegmentedFitSettings:
        """What decides in the fit to segments around events."""
        return SegmentedFitSettings(
            noise=self.noise,
            least_squares=self.least_squares,
            first_guess=self.first_guess,
            phases=self.phases,
            events=self.events,
            rounds=self.nominal_fit,
            odd=self.odd,
            unexplained=self.unexplained,
            impacts=self.segments.impacts,
            steps=self.steps,
        )

    def changed(self, changes: Mapping[str, Any]) -> Settings:
        """Return the settings with some of them changed.

        Args:
            changes: New values by their keys, say {"lack_of_fit.margin": 1.5}; parts of a setting have keys of their
                own, say segments.impacts.lead.

        Raises:
            ValueError: If a key is unknown, or a value is not what the setting takes; the message names the nearest
                key, or what was expected.
        """
        content = self.model_dump()
        known = dict(_leaves(content))
        for key, value in changes.items():
            if key not in known:
                raise ValueError(f"settings: unknown key {quoted(key)}{nearest(key, _near(key, known))}")
            *sections, last = key.split(".")
            node = content
            for section in sections:
                node = node[section]
            node[last] = value
        try:
            return Settings.model_validate(content)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(str(each) for each in first["loc"])
            wanted = first["msg"].lower().replace("input should be", "expected")
            meaning = next((f" ({row.meaning})" for row in self.table() if row.key == place), "")
            raise ValueError(f"settings: {place}: {wanted}, got {shown(first['input'])}{meaning}") from None

    def to_mapping(self) -> dict[str, Any]:
        """Return the values as nested mappings of numbers, switches and lists, as diagnosis.json holds them."""
        return self.model_dump(mode="json")

    def table(self) -> list[Row]:
        """List all settings with their units, meanings and origins."""
        return list(_rows(self))

    def listing(self) -> str:
        """Return the table as text: a line for each setting, its meaning in the next."""
        lines = []
        for row in self.table():
            value = f"{row.value} {row.unit}" if row.unit not in ("", "-") else row.value
            lines += [f"{row.key}={value}", f"    {row.meaning} ({row.calibrated})"]
        return "\n".join(lines)


def parse_changes(words: Iterable[str]) -> dict[str, Any]:
    """Read `key=value` words, whose values are YAML; a leading `settings.` may stand before a key.

    Raises:
        ValueError: If a word has no value, or it is no YAML.
    """
    changes: dict[str, Any] = {}
    for word in words:
        key, equals, text = word.partition("=")
        if not equals or not text:
            raise ValueError(f"settings: expected key=value, got {shown(word)}")
        try:
            changes[key.removeprefix("settings.")] = yaml.safe_load(text)
        except yaml.YAMLError:
            raise ValueError(f"settings: {key}: expected a value in YAML, got {shown(text)}") from None
    return changes


def _leaves(node: Mapping[str, Any], place: str = "") -> Iterator[tuple[str, Any]]:
    """List what is no mapping by its key."""
    for name, value in node.items():
        key = f"{place}.{name}" if place else name
        if isinstance(value, Mapping):
            yield from _leaves(value, key)
        else:
            yield key, value


def _near(key: str, known: Iterable[str]) -> list[str]:
    """Return the keys among which a mistyped one is looked for: with a right section or a right name, those alone."""
    section, _, name = key.rpartition(".")
    same = [one for one in known if section and one.startswith(f"{section}.")]
    alike = [one for one in known if one.rpartition(".")[2] == name]
    close = get_close_matches(key, known, n=1, cutoff=CLOSE)
    return same or alike or close or list(dict.fromkeys(f"{one.partition('.')[0]}.*" for one in known))


def _rows(node: Section, place: str = "") -> Iterator[Row]:
    """List the settings of a section and of those in it."""
    for name, field in type(node).model_fields.items():
        key, value, more = f"{place}{name}", getattr(node, name), field.json_schema_extra
        if isinstance(value, Section):
            yield from _rows(value, f"{key}.")
        else:
            assert isinstance(more, dict), key
            yield Row(key, _written(value), str(more["unit"]), str(field.description), str(more["calibrated"]))


def _written(value: Any) -> str:
    """Return a value as it is given on the command line."""
    if value is None:
        return "null"
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return str(value).lower()
    return f"[{', '.join(map(_written, value))}]" if isinstance(value, tuple | list) else f"{value:g}"
