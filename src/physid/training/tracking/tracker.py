"""Poses read from films without training: bodies are followed from frame to frame by drawing them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
import torch
from torch import Tensor

from physid.data.reading import HiddenFrames
from physid.networks import PlanarChart, PoseChart, as_image
from physid.physics.rotations import to_matrix
from physid.scenes import Scene
from physid.training.tracking.films import Drawn, Footage
from physid.training.tracking.sight import hidden_frames, require_sight, unlike
from physid.training.vision import (
    MODELS,
    Calibration,
    CastShadow,
    ChartName,
    Decoder,
    PoseRefinement,
    VideoModel,
    chart_of,
)

FOLLOWING = PoseRefinement(steps=12, wider=1.0)
"""From the place where the last two frames put a body; most images are done after two steps, but where a force sets in
or a body stops, two leave up to a pixel, behind the motion, which looks like a late clock and like a wrong model."""
SETTLING = PoseRefinement(steps=8)
"""In first frames, whose poses may be a little off."""
BLOCK = 32
"""Frames of each film that are in memory at once."""
CALIBRATED = 256
"""First frames, at most, that the scale is measured in."""

UPRIGHT, LYING = 0.02, 0.01
"""[rad] and share of the height by which a body may be off that counts as upright, and as lying on the ground."""


@final
@dataclass(frozen=True)
class Reader:
    """Reads poses from films by following the bodies.

    Bodies are expected to go on as in the last two frames; from there their poses are fitted to the frame, by drawing
    them (see `PoseRefinement`).

    Attributes:
        name: Of the chart.
        chart: Which poses there are.
        decoder: Draws them.
        calibration: Takes out a scale that all poses share.
    """

    name: ChartName
    chart: PoseChart
    decoder: Decoder
    calibration: Calibration

    @classmethod
    def of_model(cls, model: VideoModel) -> Reader:
        """Take the look of the bodies, and the scale, from a trained model."""
        chart = model.chart
        if isinstance(chart, PlanarChart):
            return cls("hovering" if chart.hovering else "planar", chart, model.decoder, model.calibration)
        return cls("spatial", chart, model.decoder, model.calibration)

    @classmethod
    def of_first_frames(
        cls, scene: Scene, chart: ChartName, footage: Footage, pose: Tensor, shadow: CastShadow | None = None
    ) -> Reader:
        """Learn the look of the bodies, and the scale, from first frames whose poses are known.

        Args:
            scene: Gives camera and sizes.
            chart: Which poses there are.
            footage: The films.
            pose: Initial poses of its trajectories, shape (R, N, 7).
            shadow: What the bodies cast in these films.

        Raises:
            ValueError: If a mask does not lie where the pose says.
        """
        pose = pose[:CALIBRATED]
        first = [footage.first(index) for index in range(len(pose))]
        frame, mask, background = (torch.from_numpy(np.stack(each)) for each in zip(*first, strict=True))
        image = as_image(frame)
        reader = cls(chart, chart_of(scene, chart), Decoder(scene), Calibration())
        reader.decoder.cut(image[:MODELS], mask[:MODELS], pose[:MODELS])
        reader.decoder.shadow = shadow
        like = pose[:, None].to(reader.decoder.patches)
        found = SETTLING(reader.chart, reader.decoder, like, image[:, None], as_image(background))
        reader.calibration.measure(reader.decoder.renderer.camera, found[:, 0], pose)
        return reader

    @torch.no_grad()
    def read(
        self,
        footage: Footage,
        indices: Sequence[int],
        lengths: Sequence[int],
        first: Tensor,
        say: Callable[[int], object] = lambda _: None,
        doubt: Callable[[HiddenFrames], object] = lambda _: None,
    ) -> list[Tensor]:
        """Read the poses of some trajectories, side by side.

        Args:
            footage: The films.
            indices: Trajectories.
            lengths: Their frames.
            first: About where the bodies are in the first frames, shape (B, N, 7).
            say: Called with how many frames more were read.
            doubt: Called with frames in which something hides the bodies.

        Returns:
            Poses (T, N, 7) of each, float64.

        Raises:
            ValueError: If a body is lost; the message names trajectory and frame.
        """
        background = as_image(torch.from_numpy(np.stack([footage.first(index)[2] for index in indices])))
        numbers = [self.chart.to_numbers(first.to(background))] * 2
        length, poses, shares = torch.tensor(lengths), [], []
        for frame in range(max(lengths)):
            if frame % BLOCK == 0:
                block = self._block(footage, indices, lengths, frame)
            image = as_image(block[:, frame % BLOCK])
            pose_refinement = FOLLOWING if frame else SETTLING
            guess = self.chart.to_pose(2 * numbers[-1] - numbers[-2])
            pose = pose_refinement(self.chart, self.decoder, guess[:, None], image[:, None], background)[:, 0]
            shares.append(unlike(self.decoder(pose[:, None], background)[:, 0], image, background))
            require_sight(shares[-1], frame, indices, frame < length)
            numbers = [numbers[-1], self.chart.to_numbers(pose)] if frame else [self.chart.to_numbers(pose)] * 2
            poses.append(pose)
            say(int((frame < length).sum()))
        if not isinstance(footage, Drawn):  # nothing hides drawn bodies
            for index, share, count in zip(indices, torch.stack(shares, 1), lengths, strict=True):
                if (hidden := hidden_frames(share[:count], index)) is not None:
                    doubt(hidden)
        read = self.calibration(self.chart, self.decoder.renderer.camera, torch.stack(poses, 1)).double()
        read = torch.cat([read[..., :3], torch.nn.functional.normalize(read[..., 3:], dim=-1)], -1)
        return [one[:count] for one, count in zip(read, lengths, strict=True)]

    @staticmethod
    def _block(footage: Footage, indices: Sequence[int], lengths: Sequence[int], start: int) -> Tensor:
        """Return some frames of all films, (B, n, H, W, 3); a film that is over stands still."""
        blocks = []
        for index, length in zip(indices, lengths, strict=True):
            shown = footage.frames(index, min(start, length - 1), min(start + BLOCK, length))
            blocks.append(np.concatenate([shown, np.repeat(shown[-1:], BLOCK - len(shown), 0)]))
        return torch.from_numpy(np.stack(blocks))


def chart_for(scene: Scene, pose: Tensor) -> ChartName:
    """Judge by initial poses (R, N, 7) which poses there are: of bodies that lie, stand upright, or are free."""
    normal = pose.new_tensor(scene.ground.normal)
    tilt = torch.linalg.cross(to_matrix(pose[..., 3:])[..., 2], normal.expand_as(pose[..., :3])).norm(dim=-1)
    half = pose.new_tensor(scene.sizes[:, 2]) / 2
    above = (pose[..., :3] @ normal - scene.ground.offset - half).abs() / half
    if float(tilt.max()) > UPRIGHT:
        return "spatial"
    return "planar" if float(above.max()) < LYING else "hovering"
