"""What a planned experiment can tell, before any recording: `physid identifiability`."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
import torch

from physid.data.files import write_text
from physid.physics import PhysicsLayer, State
from physid.scenes import Excitation
from physid.training.identifiability.experiment import IdentifiabilityConfig
from physid.training.identifiability.plot import draw
from physid.training.initial_states import slopes, without_initial_states
from physid.training.learners.engine import Engine
from physid.training.parameters import Identifiability, PhysicalParameters, Trajectories, percent

__all__ = ["IdentifiabilityConfig", "IdentifiabilityResult", "analyse", "predict"]


@final
@dataclass(frozen=True)
class IdentifiabilityResult:
    """What was judged, and what was found.

    Attributes:
        config: The experiment.
        result: The verdicts.
        count: Trajectories, or segments.
        bent: How many of them were left out (see `usable_slopes`).
    """

    config: IdentifiabilityConfig
    result: Identifiability
    count: int
    bent: int

    def table(self) -> str:
        """Return experiment and verdicts as text."""
        config = self.config
        low, high = config.constant_force or (0.0, 0.0)
        held = f", constant force {low:g}{f' to {high:g}' if low != high else ''} N" if config.constant_force else ""
        cut = "" if config.segment is None else f", in segments of {config.segment} steps"
        noise = f"{1e3 * config.noise.position:g} mm and {1e3 * config.noise.rotation:g} mrad"
        length = f"{config.trajectories} trajectories of {config.steps} frames{cut}, initial states {config.start}"
        lines = [
            f"{config.scene}, protocol {config.protocol}{held}: {length}",
            f"expected: one standard deviation, with {noise} of noise on each pose; {percent(config.accept)} is enough",
            "",
            self.result.table(),
        ]
        if self.bent:
            lines.append(f"left out: {self.bent} of {self.count}, too sensitive to rely on; shorter segments help")
        return "\n".join(lines)

    def to_mapping(self) -> dict[str, Any]:
        """Return the content of identifiability.json."""
        plain = dataclasses.asdict(self.config)
        return {"config": plain, "examined": self.count, "left_out": self.bent, **self.result.to_mapping()}

    def write(self, folder: Path) -> None:
        """Write identifiability.json and identifiability.png."""
        write_text(folder / "identifiability.json", json.dumps(self.to_mapping(), indent=2) + "\n")
        draw(self.result, f"{self.config.scene}, protocol {self.config.protocol}", folder / "identifiability.png")


def analyse(config: IdentifiabilityConfig, engine: Engine | None = None) -> IdentifiabilityResult:
    """Judge which parameters an experiment would tell, by the sensitivity of the predicted trajectories.

    Args:
        config: The experiment.
        engine: Rules of the physics; None for the layer's own.

    Returns:
        The verdicts.
    """
    engine = engine or Engine()
    physical = config.build_parameters(engine.known_effects())
    layer = engine.layer(config.build_scene(), physical.effects)
    planned = predict(layer, physical, config.draw()).segments(config.segment)
    (answer, keep), spread = slopes(layer, physical, planned), config.noise.spread()
    if config.start == "estimated":
        answer = without_initial_states(layer, physical, planned, answer, spread)
    result = Identifiability.of(physical.names, answer[:, keep], planned.real[keep], spread, config.accept)
    return IdentifiabilityResult(config, result, len(planned), int((~keep).sum()))


@torch.no_grad()
def predict(layer: PhysicsLayer, parameters: PhysicalParameters, excitations: Sequence[Excitation]) -> Trajectories:
    """Predict the trajectories of several excitations, all of T rows.

    Args:
        layer: The physics.
        parameters: The physical parameters.
        excitations: Starts and forces.

    Returns:
        Trajectories of T frames, as the layer sees them.
    """
    pose, twist, wrench = (
        torch.from_numpy(np.stack([getattr(one, name) for one in excitations])) for name in ("pose", "twist", "wrench")
    )
    rollout = layer.rollout(State(pose, twist), wrench[:, :-1], parameters())
    count, frames = rollout.pose.shape[:2]
    return Trajectories(rollout.pose, rollout.twist, wrench, torch.full((count,), frames), torch.arange(count))
