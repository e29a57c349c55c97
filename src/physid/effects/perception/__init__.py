"""Effects of perception: between true poses and those that the camera reports."""

from __future__ import annotations

from physid.effects.perception.camera_offset import CameraOffset
from physid.effects.perception.camera_yaw import CameraYaw
from physid.effects.perception.clock_rate import ClockRate
from physid.effects.perception.length_scale import LengthScale
from physid.effects.perception.lens_distortion import LensDistortion
from physid.effects.perception.object_size import ObjectSize
from physid.effects.perception.observation_lag import ObservationLag
from physid.effects.perception.observation_latency import ObservationLatency
from physid.effects.perception.observation_smoothing import ObservationSmoothing
from physid.physics import Effect

EFFECTS: tuple[type[Effect], ...] = (
    LengthScale,
    CameraYaw,
    CameraOffset,
    ObservationLatency,
    ObservationLag,
    ObservationSmoothing,
    ClockRate,
    LensDistortion,
    ObjectSize,
)
