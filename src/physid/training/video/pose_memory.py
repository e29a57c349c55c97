"""Poses that were read from frames while the encoder stands still: each frame is read once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

import torch
from torch import Tensor, nn

from physid.networks.encoder import as_image
from physid.training.video.model import VideoModel


@final
class PoseMemory(nn.Module):
    """Reads frames, and keeps what it has read; part of a checkpoint, so that resuming is exact."""

    def __init__(self) -> None:
        super().__init__()
        self._known: dict[tuple[int, int], Tensor] = {}

    def forward(self, model: VideoModel, batch: Mapping[str, Any]) -> Tensor:
        """Return the polished poses (B, f, N, 7) of the frames that a batch of the data module shows."""
        frames = (batch["start"][:, None] + batch["shown"]).tolist()
        keys = [[(index, frame) for frame in row] for index, row in zip(batch["index"].tolist(), frames, strict=True)]
        missing = [(b, f) for b, row in enumerate(keys) for f, key in enumerate(row) if key not in self._known]
        if missing:
            row, place = torch.tensor(missing).unbind(1)
            image, background = as_image(batch["frames"][row, place]), as_image(batch["background"][row])
            _, pose = model.read(image[:, None], background)
            self._known |= {keys[b][f]: one.cpu() for (b, f), one in zip(missing, pose[:, 0], strict=True)}
        return torch.stack([torch.stack([self._known[key] for key in row]) for row in keys]).to(batch["frames"].device)

    def get_extra_state(self) -> dict[str, Any]:
        """Return trajectory and frame of what was read, shape (K, 2), and the poses, shape (K, N, 7)."""
        poses = list(self._known.values())
        return {"frame": torch.tensor(list(self._known)), "pose": torch.stack(poses) if poses else torch.empty(0)}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Take up what was read."""
        known = zip(state["frame"].tolist(), state["pose"], strict=True)
        self._known = {(index, frame): pose for (index, frame), pose in known}
