"""Poses that were read from frames while the encoder stands still: each frame is read once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

import torch
from torch import Tensor, nn

from physid.networks import as_image
from physid.training.vision.model import VideoModel


@final
class PoseCache(nn.Module):
    """Reads frames, and keeps what it has read; part of a checkpoint, so that resuming is exact."""

    def __init__(self) -> None:
        super().__init__()
        self._known: dict[tuple[int, int], Tensor] = {}

    def forward(self, model: VideoModel, batch: Mapping[str, Any]) -> Tensor:
        """Return the refined poses (B, f, N, 7) of the frames that a batch of the data module shows.

        Frames beyond the length of the batch, say of a part that is rolled out (see `Horizon`), are not read unless the
        initial state needs them; in their place stands the pose of the trajectory's first frame.
        """
        first = model.start.places(batch["shown"])
        needed = (batch["shown"] < batch["length"][:, None]).scatter(1, first, True)
        frames = (batch["start"][:, None] + batch["shown"]).tolist()
        keys = [[(index, frame) for frame in row] for index, row in zip(batch["index"].tolist(), frames, strict=True)]
        missing = [(b, f) for b, f in needed.nonzero().tolist() if keys[b][f] not in self._known]
        if missing:
            row, place = torch.tensor(missing).unbind(1)
            image, background = as_image(batch["frames"][row, place]), as_image(batch["background"][row])
            _, pose = model.read(image[:, None], background)
            self._known |= {keys[b][f]: one.cpu() for (b, f), one in zip(missing, pose[:, 0], strict=True)}
        others = [self._known[row[place]] for row, place in zip(keys, first[:, 0].tolist(), strict=True)]
        known = [[self._known.get(key, other) for key in row] for row, other in zip(keys, others, strict=True)]
        return torch.stack([torch.stack(row) for row in known]).to(batch["frames"].device)

    def get_extra_state(self) -> dict[str, Any]:
        """Return trajectory and frame of what was read, shape (K, 2), and the poses, shape (K, N, 7)."""
        poses = list(self._known.values())
        return {"frame": torch.tensor(list(self._known)), "pose": torch.stack(poses) if poses else torch.empty(0)}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Take up what was read."""
        known = zip(state["frame"].tolist(), state["pose"], strict=True)
        self._known = {(index, frame): pose for (index, frame), pose in known}
