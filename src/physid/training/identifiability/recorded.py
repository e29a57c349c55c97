"""Which parameters given recordings identify."""

from __future__ import annotations

import json
import logging
import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, final

import lightning as L
import torch

from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.files import write_text
from physid.inspection.finding import Finding, trust_sentence
from physid.training.callbacks.identifiability_warning import Judging
from physid.training.identifiability.plot import draw
from physid.training.learners.sysid import SysID
from physid.training.parameters import Identifiability, percent

EPOCHS = 4
"""Sensitivities hold near the parameters at which they are computed; a few epochs lead near those of the recordings."""


@final
@dataclass(frozen=True)
class RecordedIdentifiability:
    """What was judged, and what was found.

    Attributes:
        recordings: The recording set.
        result: The verdicts.
        values: The parameters near which they hold.
        count: Trajectories.
        findings: What looks like a mistake in them, or is odd.
    """

    recordings: Path
    result: Identifiability
    values: dict[str, float]
    count: int
    findings: tuple[Finding, ...] = ()

    def table(self) -> str:
        """Return recordings and verdicts as text."""
        near = ", ".join(f"{name} {value:.3g}" for name, value in self.values.items())
        lines = [
            f"{self.recordings}: {self.count} trajectories, near {near}",
            "expected: one standard deviation, with the noise that the poses show; "
            f"{percent(self.result.accept)} is enough",
            "",
            self.result.table(),
        ]
        if (doubt := trust_sentence(self.findings)) is not None:
            lines += ["", doubt]
        return "\n".join(lines)

    def write(self, folder: Path) -> None:
        """Write identifiability.json and identifiability.png."""
        plain: dict[str, Any] = {"recordings": str(self.recordings), "values": self.values, "examined": self.count}
        plain["findings"] = [asdict(one) for one in self.findings]
        write_text(folder / "identifiability.json", json.dumps(plain | self.result.to_mapping(), indent=2) + "\n")
        draw(self.result, self.recordings.resolve().name, folder / "identifiability.png")


def analyse_recordings(recordings: Path, learn: Sequence[str] | None = None) -> RecordedIdentifiability:
    """Judge which parameters recordings tell, with the noise that their poses show.

    Args:
        recordings: A recording set with poses.
        learn: Parameters; None for those that its scene calls unknown.

    Returns:
        The verdicts.
    """
    module, data = SysID(learn=learn), RecordingsDataModule(recordings, shuffle=False)
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as place:
        warnings.simplefilter("ignore")  # Lightning's advice on loaders, loggers and accelerators
        keep = _Keep()
        L.Trainer(
            max_epochs=EPOCHS, accelerator="cpu", logger=False, callbacks=[keep], default_root_dir=place,
            enable_checkpointing=False, enable_progress_bar=False, enable_model_summary=False,
        ).fit(module, datamodule=data)  # fmt: skip
    assert keep.result is not None
    count, findings = len(data.trajectories("fit")), module.findings or ()
    return RecordedIdentifiability(recordings, keep.result, module.physical.estimates(), count, findings)


@final
class _Keep(L.Callback):
    """Judge after the last epoch, and keep it."""

    result: Identifiability | None = None

    @torch.no_grad()
    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        judge: Judging = pl_module  # type: ignore[assignment]
        self.result = judge.identifiability(None)
