"""What a model predicts, as a recording set of its own."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, final

import lightning as L
import numpy as np

from physid.data import Recording, write_scene, write_sums, write_trajectory
from physid.data.files import write_text
from physid.data.format import FOLDER
from physid.estimation.prediction.coordinates import logged_name
from physid.strict import one_line
from physid.training.parameters import PhysicalParameters, Trajectories

PARAMETERS = "parameters.json"


@final
class Predictions(L.Callback):
    """Write what `predict_step` returns, `Trajectories`, as a recording set into the trainer's folder.

    recording.yaml holds the scene with the identified parameters, each file the poses, twists and wrenches of one
    predicted trajectory under the number that it has in the set it was predicted from; parameters.json the parameters
    with their intervals.

    Attributes:
        written: How many trajectories were written.
        total: How many the set holds from which they were predicted.
        guessed: First guesses that were taken, by name: of parameters that the recordings do not know, and the model
            has not learned.
    """

    def __init__(self) -> None:
        self.written = self.total = 0
        self.guessed: dict[str, float] = {}
        self._intervals: dict[str, dict[str, float]] = {}

    def guesses(self) -> list[str]:
        """Say which first guesses were taken, one line each."""
        return [
            f"{one_line(name)} = {value:.6g} is a first guess: neither the run has learned it, nor is it known"
            for name, value in self.guessed.items()
        ]

    def on_load_checkpoint(self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]) -> None:
        """Take the intervals from the figures that the fit has left in its checkpoint."""
        for key, value in checkpoint["callbacks"].get("RunState", {}).get("figures", {}).items():
            name, word = logged_name(key) or ("", "")
            if word in ("low", "high") and math.isfinite(value):
                self._intervals.setdefault(name, {})[word] = value

    def on_predict_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Write the scene and the parameters."""
        folder, recordings = Path(trainer.default_root_dir), trainer.datamodule.recordings  # type: ignore[attr-defined]
        physical, self.total = PhysicalParameters.of(pl_module), len(recordings)
        found = physical.estimates()
        known = {*physical.names, *(getattr(pl_module, "values", None) or {})}
        scene = physical.estimated_scene()
        self.guessed = {name: scene.value(name) for name in recordings.scene.unknown if name not in known}
        scene = dataclasses.replace(scene, unknown=tuple(self.guessed), camera=None)
        write_scene(folder, dataclasses.replace(scene, source=f"predicted by physid from {recordings.folder.name}"))
        parameters = {name: {"estimate": value} | self._intervals.get(name, {}) for name, value in found.items()}
        write_text(folder / PARAMETERS, json.dumps(parameters, indent=2) + "\n")

    def on_predict_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,
        outputs: Any,
        batch: Mapping[str, Any],
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Write the trajectories of a batch."""
        if not isinstance(outputs, Trajectories):
            raise TypeError(f"predict_step of {type(pl_module).__name__} must return Trajectories, got {type(outputs)}")
        folder, recordings = Path(trainer.default_root_dir), trainer.datamodule.recordings  # type: ignore[attr-defined]
        for row, index in enumerate(outputs.index.tolist()):
            arrays = {
                name: getattr(outputs, name)[row, : int(outputs.length[row])].cpu().numpy()
                for name in ("pose", "twist", "wrench")
            }
            arrays |= _clocks(outputs, row)
            split, protocol = recordings.labels(index)
            known = Recording(**arrays, split=split, protocol=protocol)
            write_trajectory(folder / FOLDER / recordings.paths[index].name, known)
        self.written += len(outputs)

    def on_predict_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Write the checksums."""
        write_sums(Path(trainer.default_root_dir))


def _clocks(predicted: Trajectories, row: int) -> dict[str, Any]:
    """Return stamps and forces of a trajectory that is no even log: with clocks of their own, as they were recorded."""
    if predicted.seen is None or predicted.grid is None or predicted.time is None:
        return {}
    grid, count = predicted.grid, int(predicted.grid.count[row])
    wrench, begin = grid.wrench[row, :count].cpu().numpy(), grid.times[row, :count].cpu().numpy()
    changed = np.append(True, (wrench[1:] != wrench[:-1]).any((1, 2)))
    time = predicted.time[row, : int(predicted.length[row])].cpu().numpy()
    return {"time": time, "wrench": wrench[changed], "wrench_time": begin[changed]}
