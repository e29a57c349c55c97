"""A trainer that keeps and prints nothing, and ends a fit where it has converged."""

from __future__ import annotations

from pathlib import Path

import lightning as L

from physid.training.callbacks.converged import Converged


def trainer_in(folder: Path, epochs: int = 30) -> L.Trainer:
    """Return it; what its callbacks write goes into the folder."""
    return L.Trainer(
        max_epochs=epochs, accelerator="cpu", default_root_dir=folder, enable_checkpointing=False, logger=False,
        enable_progress_bar=False, enable_model_summary=False, callbacks=[Converged()],
    )  # fmt: skip
