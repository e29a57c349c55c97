"""What a sensor adds: the noise of recorded poses, and the error of poses that were tracked in films."""

from physid.estimation.measurement.correlated_noise import CorrelatedNoise, correlated_noise
from physid.estimation.measurement.correlation import Correlation
from physid.estimation.measurement.force_noise import force_noise, with_force_noise
from physid.estimation.measurement.noise_settings import NoiseSettings
from physid.estimation.measurement.outliers import frame_weights, outlier_poses
from physid.estimation.measurement.poses import moved, pose_difference
from physid.estimation.measurement.sensor_noise import UNSEEN, Noise, estimate_noise, noise_of_poses
from physid.estimation.measurement.tracking_error import TrackingError

__all__ = [
    "UNSEEN",
    "CorrelatedNoise",
    "Correlation",
    "Noise",
    "NoiseSettings",
    "TrackingError",
    "correlated_noise",
    "estimate_noise",
    "force_noise",
    "frame_weights",
    "moved",
    "noise_of_poses",
    "outlier_poses",
    "pose_difference",
    "with_force_noise",
]
