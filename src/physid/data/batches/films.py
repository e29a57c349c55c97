"""Decoded video in memory, for training on an accelerator that would otherwise wait for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import torch
from torch import Tensor

from physid.data import RecordingSet
from physid.data.batches.dataset import Item


@final
class Films:
    """Decoded frames of some trajectories, on the device where they were last asked for.

    At 128 x 128 pixels a frame takes 49 kB: 1000 trajectories of 60 frames 3 GB.

    Args:
        recordings: The set.
        trajectories: Which of its trajectories, by index.
        every: Only every so many frames are kept.

    Raises:
        ValueError: If a file is damaged, or frames, masks or the background are missing.
    """

    def __init__(self, recordings: RecordingSet, trajectories: Sequence[int], every: int = 1) -> None:
        self._every = every
        self._row = torch.full((len(recordings),), -1)
        self._row[list(trajectories)] = torch.arange(len(trajectories))
        self._arrays: Item = {}
        for row, trajectory in enumerate(trajectories):
            kept = list(range(0, recordings.read(trajectory).length, every))
            frames, mask, background = map(torch.from_numpy, recordings.film(trajectory, kept))
            self._put(row, len(trajectories), {"frames": frames, "mask": mask, "background": background})

    def _put(self, row: int, count: int, arrays: Item) -> None:
        """Keep the arrays of a trajectory; a shorter film leaves the end of its row empty."""
        for name, value in arrays.items():
            kept = self._arrays.get(name)
            if kept is None or (name == "frames" and len(value) > kept.shape[1]):
                longer = value.new_zeros(count, *value.shape)
                if kept is not None:
                    longer[:, : kept.shape[1]] = kept
                self._arrays[name] = kept = longer
            if name == "frames":
                kept[row, : len(value)] = value
            else:
                kept[row] = value

    def add_to(self, batch: Item) -> Item:
        """Add the frames that a batch shows, first frames, masks and backgrounds, on the batch's device.

        Args:
            batch: With `index` (B,), `start` (B,) and `shown` (B, f); together they name frames that are kept.
        """
        device = batch["index"].device
        self._row = self._row.to(device)
        self._arrays = {name: value.to(device) for name, value in self._arrays.items()}
        row, frame = self._row[batch["index"]], batch["start"][:, None] + batch["shown"]
        frames: Tensor = self._arrays["frames"]
        shown = frames[row[:, None], frame // self._every]
        still = {name: self._arrays[name][row] for name in ("mask", "background")}
        return batch | still | {"frames": shown, "first": frames[row, 0]}
