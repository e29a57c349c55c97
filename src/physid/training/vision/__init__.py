"""Between frames and poses: encoder, decoder, pose refinement, calibration, synthetic images, predicted video."""

from physid.training.vision.calibration import Calibration
from physid.training.vision.drawing.cast_shadow import CastShadow, ground_points
from physid.training.vision.drawing.comparison import left_undrawn, mismatch
from physid.training.vision.drawing.decoder import Decoder, camera_of
from physid.training.vision.drawing.predicted_video import Pixels, compare, foresee, write_film, write_rows
from physid.training.vision.drawing.synthetic_images import SyntheticImages, encoding_losses
from physid.training.vision.first_look import MODELS, learn_look, look_at
from physid.training.vision.landing_height import LandingHeight, land
from physid.training.vision.model import VideoModel
from physid.training.vision.pose_cache import PoseCache
from physid.training.vision.pose_refinement import PoseRefinement
from physid.training.vision.prediction import predict, predict_trajectories
from physid.training.vision.reading import ChartName, EncoderFactory, Vision, chart_of
from physid.training.vision.scores import VideoScores
from physid.training.vision.shown_frames import at_frames, over_time

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
    "learn_look",
    "left_undrawn",
    "look_at",
    "mismatch",
    "over_time",
    "predict",
    "predict_trajectories",
    "write_film",
    "write_rows",
]
