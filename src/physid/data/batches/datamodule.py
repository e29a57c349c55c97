"""Recordings for Lightning's Trainer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

import torch
from lightning.pytorch import LightningDataModule
from torch.utils.data import DataLoader

from physid.data import RecordingSet
from physid.data.batches.dataset import Item, Segments, Video, collate
from physid.data.batches.films import Films
from physid.data.batches.video import check_video
from physid.data.forces import read_forces
from physid.scenes import Scene
from physid.strict import LARGEST, whole


class RecordingsDataModule(LightningDataModule):
    """Serves whole trajectories or segments of a recording set; see `Segments` for what a batch holds.

    Args:
        folder: The recording set.
        batch_size: Segments per batch; None for all of a split in one batch.
        segment: Frames of a segment; None for whole trajectories.
        stride: Frames between the starts of segments; None for segments that share only their end frames.
        test_segment: Frames of a segment when testing; None for whole trajectories, which are always predicted whole.
        video: "none", "all", or which frames of each segment to decode, say [0, 1, 2]. When testing and predicting,
            all are decoded instead.
        draw: So many more frames, drawn from each segment anew in every epoch.
        every: Only every so many frames count as "all", or are drawn.
        preload: Whether to decode these frames once and keep them in memory, on the accelerator if there is one.
        fit: Splits to fit on. Trajectories without a split count as train.
        validate: Splits to validate on; those that the set lacks are left out.
        test: Splits to test on.
        limit: At most so many trajectories of each use.
        shuffle: Whether to shuffle what is fitted on.
        workers: Processes that load.
        forces: File with planned forces (see `read_forces`) to predict under: batches then carry `future`, the wrenches
            (B, n + 1, N, 6) from the first frame on, beside the recorded ones.

    Raises:
        FileNotFoundError: If there is no such set, or no such file.
        ValueError: If the set breaks the format, lacks a split to fit or test on, or lacks video that is asked for.
    """

    MAY_CHANGE: ClassVar[frozenset[str]] = frozenset({"folder", "test_segment", "preload", "test", "workers", "forces"})
    """Arguments that may be others in a run that goes on; of the folder what is in it must be the same."""

    def __init__(
        self,
        folder: Path | str,
        batch_size: int | None = None,
        segment: int | None = None,
        stride: int | None = None,
        test_segment: int | None = None,
        video: Video = "none",
        draw: int = 0,
        every: int = 1,
        preload: bool = False,
        fit: Sequence[str] = ("train", "fit"),
        validate: Sequence[str] = ("val", "select"),
        test: Sequence[str] = ("test", "report_same", "report_transfer"),
        limit: int | None = None,
        shuffle: bool = True,
        workers: int = 0,
        forces: Path | str | None = None,
    ) -> None:
        super().__init__()
        # Checkpoints hold plain values only, so that they load safely; these may be a Path.
        self.save_hyperparameters(ignore=("folder", "forces"))
        self.recordings = RecordingSet(folder)
        self._batch_size = batch_size
        self._segment, self._stride, self._test_segment = segment, stride, test_segment
        self._video: Video = video
        self._draw, self._every, self._preload = draw, every, preload
        self._films: Films | None = None
        if preload and not isinstance(video, str) and any(one % every for one in video):
            raise ValueError(f"video must name multiples of every ({every}) if frames are preloaded, got {list(video)}")
        for name, value in (("limit", limit), ("batch_size", batch_size)):
            if value is not None and value < 1:
                raise ValueError(f"data.{name} must be at least 1, or null for all, got {value}")
        whole(workers, "data.workers", low=0, high=LARGEST["workers"])
        for name, splits in (("fit", fit), ("validate", validate), ("test", test)):
            if not isinstance(splits, Sequence) or isinstance(splits, str):
                raise ValueError(f"data.{name} must be a list of splits, such as [train], got {splits!r}")
        self._splits = {"fit": tuple(fit), "validate": tuple(validate), "test": tuple(test)}
        self._limit, self._shuffle, self._workers = limit, shuffle, workers
        self._future = None if forces is None else torch.from_numpy(read_forces(forces, self.scene))

    @property
    def scene(self) -> Scene:
        """The scene as far as it is known; unknown parameters hold a first guess."""
        return self.recordings.scene

    def trajectories(self, use: str) -> list[int]:
        """Return the trajectories for "fit", "validate", "test" or "predict" (all).

        Raises:
            ValueError: If there are none to fit or test on.
        """
        if use == "predict":
            return list(range(len(self.recordings)))[: self._limit]
        wanted = self._splits[use]
        found = [index for index, split in enumerate(self.recordings.splits()) if (split or "train") in wanted]
        if not found and use != "validate":
            self.recordings.indices(wanted)
        return found[: self._limit]

    def segments(self, use: str) -> Segments:
        """Return the segments for "fit", "validate", "test" or "predict"."""
        fitting = use in ("fit", "validate")
        length = self._test_segment if use == "test" else None
        length, stride = (self._segment, self._stride) if fitting else (length, None)
        video, draw = (self._video, self._draw) if fitting or self._video == "none" else ("all", 0)
        unposed = use == "predict" and video == "all"
        return Segments(
            self.recordings, self.trajectories(use), length, stride, video, draw, self._every,
            decode=not self._preload, unposed=unposed, moving=use != "predict",
        )  # fmt: skip

    def setup(self, stage: str) -> None:
        """Check the video of what a stage uses, before any training."""
        if self._video != "none":
            uses = ("fit", "validate") if stage == "fit" else (stage,)
            used = [one for use in uses for one in self.trajectories(use)]
            check_video(self.recordings, used)
            if self._preload:
                self._films = Films(self.recordings, used, self._every)

    def on_after_batch_transfer(self, batch: Item, dataloader_idx: int) -> Item:
        """Add the video that is kept in memory, and the planned forces where they are predicted under."""
        if self._future is not None and self.trainer is not None and self.trainer.predicting:
            future = self._future.to(batch["wrench"].device)
            batch = {**batch, "future": future.expand(len(batch["wrench"]), *future.shape)}
        return batch if self._films is None else self._films.add_to(batch)

    def train_dataloader(self) -> DataLoader[Item]:
        """Load what is fitted on."""
        return self._loader("fit", shuffle=self._shuffle)

    def val_dataloader(self) -> DataLoader[Item] | list[DataLoader[Item]]:
        """Load what is validated on; nothing where the set has no such split."""
        return self._loader("validate") if self.trajectories("validate") else []

    def test_dataloader(self) -> DataLoader[Item]:
        """Load what is tested on."""
        return self._loader("test")

    def predict_dataloader(self) -> DataLoader[Item]:
        """Load all trajectories."""
        return self._loader("predict")

    def _loader(self, use: str, shuffle: bool = False) -> DataLoader[Item]:
        """Return the loader of one use."""
        segments = self.segments(use)
        return _Loader(
            segments,
            batch_size=min(self._batch_size or len(segments), max(len(segments), 1)),  # torch counts up to 2^63
            shuffle=shuffle,
            num_workers=self._workers,
            persistent_workers=self._workers > 0,
            collate_fn=_collate_by_value if self._workers else collate,
        )


class _Loader(DataLoader[Item]):
    """Loads batches of tensors, whatever they are handed over as."""

    def __iter__(self) -> Iterator[Item]:  # type: ignore[override]
        """Go through all batches."""
        for batch in super().__iter__():
            yield {name: torch.as_tensor(value) for name, value in batch.items()}


def _collate_by_value(items: Sequence[Item]) -> dict[str, Any]:
    """Collate to arrays, which are handed over through a pipe.

    Tensors would be through a file in shared memory. Where that is full (64 MB in a container) or files may not grow,
    torch's thread that hands over says so and ends, and who waits for the batch waits for ever.
    """
    return {name: value.numpy() for name, value in collate(items).items()}
