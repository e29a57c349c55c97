"""What a run writes to its checkpoints and reads back: it stays data, and reaches no other folder."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any, final

import lightning as L
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.plugins.io.wrapper import _WrappingCheckpointIO

from physid.data.files import read_tensors

PATHS = ("best_model_path", "kth_best_model_path", "last_model_path")
"""Files that the state of a ModelCheckpoint names; it removes them once it has better ones."""
SCORED = "best_k_models"
ENDING = ".ckpt"
ELSEWHERE = ("://", "::")
"""What a path has in it that names another kind of storage."""


@final
class LastCheckpoint(ModelCheckpoint):
    """Write checkpoints/last.ckpt after every epoch, beside whatever a configuration writes.

    It always writes the same file, so that a resumed run needs nothing that an earlier one knew.

    Args:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path.parent, path.stem, save_on_train_epoch_end=True, enable_version_counter=False)

    def state_dict(self) -> dict[str, Any]:
        """Return nothing."""
        return {}


class OwnFiles(_WrappingCheckpointIO):
    """Read checkpoints as data, and remove none but those of the run, or those that this process has written.

    Lightning removes, with all that is in it, what the state of a ModelCheckpoint names, and that state is read from
    the checkpoint, which may come from a stranger.

    Args:
        trainer: Whose checkpoints it reads and writes, by the means that it had before.
    """

    def __init__(self, trainer: L.Trainer) -> None:
        super().__init__(trainer.strategy.checkpoint_io)
        self._trainer = trainer
        self._written: set[str] = set()

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, *args: Any, **options: Any) -> None:
        """Write one, and remember that."""
        self._written.add(os.path.abspath(path))
        super().save_checkpoint(checkpoint, path, *args, **options)

    def load_checkpoint(self, path: str | Path, *args: Any, **options: Any) -> dict[str, Any]:
        """Read one; what a ModelCheckpoint had written counts as files in the folder that it has now.

        Raises:
            OSError: If there is none.
            ValueError: If it is damaged, or holds something else.
        """
        checkpoint = read_tensors(Path(path))
        states = checkpoint.get("callbacks")
        if not isinstance(states, dict):
            return checkpoint
        for callback in self._trainer.checkpoint_callbacks:
            if isinstance(callback, ModelCheckpoint) and isinstance(state := states.get(callback.state_key), dict):
                states[callback.state_key] = _in_folder(state, str(callback.dirpath))
        return checkpoint

    def remove_checkpoint(self, path: str | Path) -> None:
        """Remove one; what is no plain file of the run stays, unless this process has written it."""
        place, run = Path(path), Path(self._trainer.default_root_dir)
        plain = place.suffix == ENDING and place.is_file() and not place.is_symlink()
        if os.path.abspath(path) in self._written or (plain and place.resolve().is_relative_to(run.resolve())):
            super().remove_checkpoint(path)

    def teardown(self) -> None:
        """Let the means end, too: it may write in the background."""
        if self.checkpoint_io is not None:
            self.checkpoint_io.teardown()


def _in_folder(state: Mapping[str, Any], folder: str) -> dict[str, Any]:
    """Return the state of a ModelCheckpoint with the files that it names in a folder; without them if one was not.

    Args:
        state: The state; a run that has been moved names another folder.
        folder: Where the callback writes now.
    """
    before, scored = state.get("dirpath"), state.get(SCORED)
    rest = {key: value for key, value in state.items() if key not in (*PATHS, SCORED, "dirpath")}
    try:
        paths = {key: _moved(state.get(key, ""), before, folder) for key in PATHS}
        scores = {_moved(key, before, folder): value for key, value in scored.items()} if scored else {}
    except (TypeError, ValueError, AttributeError):
        paths, scores = dict.fromkeys(PATHS, ""), {}
    return {**rest, **paths, SCORED: scores}


def _moved(path: str, before: Any, folder: str) -> str:
    """Return a path of one folder as that of another one; nothing for nothing.

    Raises:
        TypeError: If one of them is no text.
        ValueError: If it does not lie in the folder.
    """
    if not path:
        return ""
    within = PurePath(path).relative_to(before)
    if ".." in within.parts or any(mark in str(within) for mark in ELSEWHERE):
        raise ValueError(path)
    return os.path.join(folder, within)
