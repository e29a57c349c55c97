"""Images to poses and back: encoder, velocity from poses, renderer, blur."""

from physid.networks.blur import BlurSchedule, GaussianBlur
from physid.networks.camera import PinholeCamera
from physid.networks.chart import PlanarChart, PoseChart, SpatialChart
from physid.networks.encoder import Encoder, Encoding, PoseEncoder, VariationalPoseEncoder, as_image

__all__ = [
    "BlurSchedule",
    "Encoder",
    "Encoding",
    "GaussianBlur",
    "PinholeCamera",
    "PlanarChart",
    "PoseChart",
    "PoseEncoder",
    "SpatialChart",
    "VariationalPoseEncoder",
    "as_image",
]
