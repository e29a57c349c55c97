"""The one place that imports OpenCV, which is an extra."""

from __future__ import annotations

try:
    import cv2
except ImportError:
    raise ValueError(
        "films and camera calibration need OpenCV, which is not installed: pip install 'physid[camera]'"
    ) from None

__all__ = ["cv2"]
