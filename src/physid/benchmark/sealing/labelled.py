"""What is written down of a set that is drawn: the truth about it."""

from __future__ import annotations

from typing import Any

from physid.benchmark.labels import Label, Part
from physid.benchmark.sealing.acting import acting_phases
from physid.benchmark.sealing.hidden import Hidden
from physid.benchmark.sealing.severity import severity
from physid.data.generation.settings import GenerateConfig
from physid.physics import Effect

Invention = tuple[GenerateConfig, tuple[Effect, ...], Label]
"""A configuration without effects, the effects, and the label."""


def label_of(config: GenerateConfig, hidden: Hidden, parts: tuple[Part, ...], effects: tuple[Effect, ...]) -> Label:
    """Write down the truth about a set."""
    moving: dict[str, Any] = {}
    if effects:
        seen_only = set(hidden.sites) == {"perception"}
        moving["phases"] = () if seen_only else tuple(acting_phases(config, effects))
        moving["severity"] = parts[0].severity if len(parts) == 1 else severity(config, effects)
    return Label(
        role=hidden.role,
        scene=config.scene,
        protocol=config.protocol,
        film=config.video,
        effects=parts,
        right=tuple(tuple(names) for names in hidden.right(config.scene)),
        noise=config.noise.position,
        simulator=config.simulator,
        frame_rate=1 / config.true_scene().time_step,
        uneven=bool(config.jitter or config.missing),
        parameters=config.true_parameters(),
        **moving,
    )
