"""How frames are read: which poses there are, by what encoder and refinement, and where motions start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from physid.networks import Encoder, PlanarChart, PoseChart, SpatialChart
from physid.scenes import Scene
from physid.training.vision.drawing.decoder import camera_of
from physid.training.vision.initial_state import Start
from physid.training.vision.pose_refinement import PoseRefinement

ChartName = Literal["planar", "hovering", "spatial"]
EncoderFactory = Callable[[PoseChart, int, int], Encoder]
"""Builds an encoder for a chart, and images of so many rows and columns."""


def chart_of(scene: Scene, name: ChartName) -> PoseChart:
    """Build the chart of a scene: which poses an encoder can express.

    Args:
        scene: Gives camera, ground and bodies.
        name: planar for bodies that lie flat on the ground, hovering for bodies parallel to it at any height, spatial
            for all poses.

    Raises:
        ValueError: If the scene has no camera, or it does not look down on the ground.
    """
    camera = camera_of(scene)
    if name == "spatial":
        return SpatialChart(camera, len(scene.bodies))
    thickness = scene.sizes[:, 2].tolist()
    return PlanarChart(camera, scene.ground.normal, scene.ground.offset, thickness, hovering=name == "hovering")


@dataclass(frozen=True)
class Vision:
    """How frames are read.

    Attributes:
        chart: Which poses the encoder can express: planar, hovering or spatial (see `chart_of`).
        start: How the initial state follows from the encoded poses.
        pose_refinement: How encoded poses are made better by the decoder where no gradient is needed.
        weights: Checkpoint of another run with the same kind of encoder, which a fit begins with; None for new weights.
        physics_device: Where trajectories are rolled out; the fastest implementation runs on a CPU.
    """

    chart: ChartName = "planar"
    start: Start = Start()
    pose_refinement: PoseRefinement = PoseRefinement()
    weights: str | None = None
    physics_device: str = "cpu"
