"""Let a resumed run go on exactly: the state of the random generators, and the time spent so far."""

from __future__ import annotations

import hashlib
import random
import time
from dataclasses import dataclass, field
from typing import Any, ClassVar

import lightning as L
import numpy as np
import torch

from physid.data import RecordingSet
from physid.data.format import DESCRIPTION, list_sums
from physid.estimation.measurement.unexplained import STEPS_TAKEN
from physid.typed_files import check_as
from physid.yaml_files import read_text

LARGEST_HASHED = 2**30
"""[bytes] of recordings that are read once more to know them again: a second or two."""
WORDS = 624
"""Numbers that the state of a Mersenne twister holds."""


@dataclass(frozen=True)
class Kept:
    """What a checkpoint holds of it in plain values.

    Attributes:
        seconds: See `RunState`.
        figures: See `RunState`.
        over: The key of the run, if it had stopped by itself.
        recordings: A digest of what was fitted to; empty if nobody can say.
        row: What was to be logged at the end of the epoch.
        numpy: Kind, numbers, position, and a number drawn ahead of its turn.
        python: Version, numbers, and a number drawn ahead of its turn.
    """

    __pydantic_config__: ClassVar[Any] = {"strict": True}

    seconds: float
    numpy: tuple[str, list[int], int, int, float]
    python: tuple[int, list[int], float | None]
    figures: dict[str, float] = field(default_factory=dict)
    over: str = ""
    recordings: str = ""
    row: dict[str, float] = field(default_factory=dict)


class RunState(L.Callback):
    """Keep in every checkpoint what Lightning leaves out of it.

    Lightning restores weights, optimizers and counters, but the random generators start anew from the seed, so a
    resumed run would shuffle its second half as it had shuffled its first.

    Args:
        key: Says what is run: a run that had stopped by itself is over, unless it is resumed as another one.

    Attributes:
        key: A digest of it.
        seconds: Time spent in training, over all sessions of the run [s].
        figures: The last value of every figure that was logged up to the checkpoint. A later session need not log all
            of them again: learning from video has phases with figures of their own.
    """

    def __init__(self, key: str = "") -> None:
        self.key = hashlib.sha256(key.encode()).hexdigest()
        self._over = self._recordings = ""
        self.seconds = 0.0
        self.figures: dict[str, float] = {}
        self._started = time.perf_counter()
        self._random: dict[str, Any] | None = None

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the generators and the time spent."""
        kind, keys, position, has_gauss, gauss = np.random.get_state(legacy=True)  # noqa: NPY002 - the global one is meant
        version, words, next_gauss = random.getstate()
        return {
            "seconds": self._elapsed(),
            "torch": torch.get_rng_state(),
            "cuda": torch.cuda.get_rng_state_all() if torch.cuda.is_available() else [],
            "numpy": [str(kind), np.asarray(keys).tolist(), int(position), int(has_gauss), float(gauss)],
            "python": [version, list(words), next_gauss],
            "recordings": self._recordings,
        }

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Remember the state; it is set once everything else has been built.

        Raises:
            ValueError: If it is none.
            RuntimeError: If the state of torch's generator is none.
            TypeError: The same.
        """
        kept = kept_of(state_dict)
        _require_states(state_dict, kept)
        self.seconds, self.figures, self._over = kept.seconds, dict(state_dict.get("figures", {})), kept.over
        self._recordings = kept.recordings
        self._random = state_dict

    def on_save_checkpoint(self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]) -> None:
        """Keep the figures."""
        self.figures |= {name: float(value) for name, value in trainer.callback_metrics.items()}
        own = checkpoint["callbacks"][self.state_key]
        own["figures"] = self.figures
        own["over"] = self.key if trainer.should_stop else ""
        # The checkpoint is written before the loggers are told of its epoch: killed between, a run would lose the row.
        row = {name: float(value) for name, value in trainer._logger_connector.metrics["log"].items()}
        step = trainer.fit_loop.epoch_loop._batches_that_stepped - 1
        own["row"] = row and {"epoch": trainer.current_epoch, **row, "step": step}

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """End at once if the run had stopped by itself: nothing is left but to write its figures again."""
        if self._over == self.key:
            trainer.should_stop = True

    def on_fit_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Set the generators to where the checkpoint left them, before the loader draws its first batch.

        Raises:
            ValueError: If the run that goes on was fitted to other recordings.
        """
        self._started = time.perf_counter()
        recordings = getattr(trainer.datamodule, "recordings", None)  # type: ignore[attr-defined]
        if isinstance(recordings, RecordingSet):
            now = _digest(recordings)
            if self._recordings not in ("", now):
                raise ValueError(
                    f"{recordings.folder}: expected the recordings that the run was fitted to until now, found others, "
                    "or other files of them; put these back to go on with --resume, or fit anew with another --run-dir"
                )
            self._recordings = now
        if self._random is None:
            return
        torch.set_rng_state(self._random["torch"].cpu())
        if len(self._random["cuda"]) == torch.cuda.device_count():
            torch.cuda.set_rng_state_all(self._random["cuda"])
        kind, keys, *rest = self._random["numpy"]
        np.random.set_state((kind, np.array(keys, dtype=np.uint32), *rest))  # noqa: NPY002 - the global one is meant
        version, words, next_gauss = self._random["python"]
        random.setstate((version, tuple(words), next_gauss))
        self._random = None

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Add the time of this session."""
        self.seconds, self._started = self._elapsed(), time.perf_counter()

    def note_steps(self, taken: int) -> None:
        """Note among the figures whether nothing was fitted: a Trainer that may take no step calls no hook."""
        self.figures.pop(STEPS_TAKEN, None)
        if not taken:
            self.figures[STEPS_TAKEN] = 0.0

    def _elapsed(self) -> float:
        return self.seconds + time.perf_counter() - self._started


def kept_of(state: object) -> Kept:
    """Return what a checkpoint holds of a run in plain values.

    Raises:
        ValueError: If it is something else.
    """
    plain = {key: state[key] for key in Kept.__dataclass_fields__ if key in state} if isinstance(state, dict) else state
    return check_as(Kept, plain, "RunState")


def _digest(recordings: RecordingSet) -> str:
    """Return a digest of what a recording set holds; of very large ones, of its description, and names and sizes."""
    folder, sizes = recordings.folder, [(path.name, path.stat().st_size) for path in recordings.paths]
    if sum(size for _, size in sizes) <= LARGEST_HASHED:
        content = list_sums(folder)
    else:
        content = repr((read_text(folder / DESCRIPTION), sizes))
    return hashlib.sha256(content.encode()).hexdigest()


def _require_states(state: dict[str, Any], kept: Kept) -> None:
    """Give the states to generators that nobody else uses.

    Raises:
        ValueError: If one is none; of torch's, RuntimeError and TypeError as well.
    """
    torch.Generator().set_state(state["torch"])
    if not all(isinstance(each, torch.Tensor) and each.dtype == torch.uint8 for each in state["cuda"]):
        raise ValueError("RunState.cuda: expected states of generators, found others")
    kind, words, position, has_gauss, gauss = kept.numpy
    if len(words) != WORDS or not 0 <= position <= WORDS:  # NumPy would read beyond them
        raise ValueError(f"RunState.numpy: expected {WORDS} numbers and a position among them, found others")
    np.random.RandomState().set_state((kind, np.array(words, dtype=np.uint32), position, has_gauss, gauss))
    version, numbers, ahead = kept.python
    random.Random().setstate((version, tuple(numbers), ahead))  # nosec B311 - nothing secret is drawn
