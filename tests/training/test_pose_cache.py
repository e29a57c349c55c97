"""Frames are read once while the encoder stands still, and a checkpoint knows what was read."""

from __future__ import annotations

from typing import Any, cast

import torch
from torch import Tensor

from physid.training.vision.initial_state import Start
from physid.training.vision.model import VideoModel
from physid.training.vision.pose_cache import PoseCache


class Reader:
    """Reads the colour of the first pixel as the first coordinate, and counts what it reads."""

    def __init__(self) -> None:
        self.images, self.start = 0, Start()

    def read(self, image: Tensor, background: Tensor) -> tuple[Tensor, Tensor]:
        assert len(image) == len(background)
        self.images += image.shape[0] * image.shape[1]
        pose = torch.zeros(*image.shape[:2], 1, 7)
        pose[..., 0, 0] = 255 * image[:, :, 0, 0, 0]
        return pose, pose


def batch_of(index: list[int], shown: list[list[int]], length: int = 9) -> dict[str, Any]:
    """Show frames whose colour is ten times the trajectory plus the frame."""
    frames = torch.tensor([[10 * i + f for f in row] for i, row in zip(index, shown, strict=True)], dtype=torch.uint8)
    colours = frames[..., None, None, None].expand(*frames.shape, 2, 2, 3)
    background = torch.zeros(len(index), 2, 2, 3, dtype=torch.uint8)
    number = torch.tensor(index)
    return {"index": number, "start": 0 * number, "shown": torch.tensor(shown), "frames": colours} | {
        "background": background,
        "length": torch.full_like(number, length),
    }


def test_each_frame_is_read_once_and_found_again_in_any_order() -> None:
    reader, memory = Reader(), PoseCache()
    model = cast(VideoModel, reader)
    first = memory(model, batch_of([3, 1], [[0, 2], [0, 5]]))
    assert first[..., 0, 0].tolist() == [[30, 32], [10, 15]]
    assert reader.images == 4
    again = memory(model, batch_of([1, 3], [[5, 0], [0, 4]]))
    assert again[..., 0, 0].tolist() == [[15, 10], [30, 34]]
    assert reader.images == 5
    other = PoseCache()
    other.load_state_dict(memory.state_dict())
    other(model, batch_of([3], [[0, 4]]))
    assert reader.images == 5


def test_frames_beyond_the_end_are_not_read_but_for_those_that_give_the_initial_state() -> None:
    reader, memory = Reader(), PoseCache()
    model = cast(VideoModel, reader)
    found = memory(model, batch_of([3], [[4, 0, 7]], length=4))
    assert found[0, :, 0, 0].tolist() == [30, 30, 30]
    assert reader.images == 1
    assert memory(model, batch_of([3], [[4, 0, 7]], length=5))[0, :, 0, 0].tolist() == [34, 30, 30]
    reader.start = Start(at_rest=False, spacing=2)
    assert memory(model, batch_of([3], [[0, 2, 4, 6]], length=1))[0, :, 0, 0].tolist() == [30, 32, 34, 30]
    assert reader.images == 3
