"""Between frames and poses: encoder, decoder, pose refinement, calibration, synthetic images, predicted video."""

from physid.training.vision.calibration import Calibration
from physid.training.vision.cast_shadow import CastShadow, ground_points
from physid.training.vision.decoder import MODELS, Decoder, camera_of
from physid.training.vision.landing_height import LandingHeight, land
from physid.training.vision.model import ChartName, EncoderFactory, VideoModel, Vision, at_frames, chart_of, over_time
from physid.training.vision.pose_cache import PoseCache
from physid.training.vision.pose_refinement import PoseRefinement
from physid.training.vision.predicted_video import Pixels, compare, foresee, write_film, write_rows
from physid.training.vision.scores import VideoScores
from physid.training.vision.synthetic_images import SyntheticImages, encoding_losses

__all__ = [
    "MODELS",
    "Calibration",
    "CastShadow",
    "ChartName",
    "Decoder",
    "EncoderFactory",
    "LandingHeight",
    "Pixels",
    "PoseCache",
    "PoseRefinement",
    "SyntheticImages",
    "VideoModel",
    "VideoScores",
    "Vision",
    "at_frames",
    "camera_of",
    "chart_of",
    "compare",
    "encoding_losses",
    "foresee",
    "ground_points",
    "land",
    "over_time",
    "write_film",
    "write_rows",
]
