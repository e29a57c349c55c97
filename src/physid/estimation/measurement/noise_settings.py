"""What decides about the noise of poses."""

from __future__ import annotations

from physid.estimation.measurement.tracking_error import SURE
from physid.setting import Section, setting


class NoiseSettings(Section):
    """The noise of observed poses, and which of them count."""

    least: tuple[float, float] = setting(
        (1e-3, 1e-4), "rad, m", "least noise: below, engines differ by more, say in how a pushed block turns"
    )
    unseen: tuple[float, float] = setting((1e-2, 1e-3), "rad, m", "noise that is assumed where too little is seen")
    still: float = setting(
        1e-2, "share", "of the noise of the other axes below which an axis did not move, and says nothing", gt=0
    )
    jump: tuple[float, float] = setting(
        (0.1, 0.015), "rad, m", "least deviation of a pose from its neighbours that no motion explains"
    )
    usual: float = setting(10.0, "standard deviations", "from the neighbours, that are usual", gt=0)
    soft: float = setting(3.0, "standard deviations", "from the neighbours, beyond which a frame counts less", gt=0)
    wild: float = setting(6.0, "standard deviations", "beyond which it does not count at all", gt=0)
    alike: float = setting(
        0.45,
        "-",
        "correlation of neighbouring frames above which noise is not white",
        "decision 85",
        ge=0,
        le=1,
    )
    alike_for: float = setting(
        0.12, "s", "for which noise may be alike; what is alike for longer is what the model lacks", "decision 85", gt=0
    )
    idle: float = setting(
        0.1, "standard deviations", "by which a coordinate may move among frames that show what noise is", gt=0
    )
    windows: float = setting(20.0, "windows", "for each frame of a span, that show what noise is at that span", gt=0)
    straight: float = setting(
        0.01,
        "-",
        "of the largest tenth of deviations, below which poses lie on a line: half of them do if interpolated",
        ge=0,
    )
    force_share: float = setting(
        0.05, "-", "of recorded forces that is noise at most; what changes by more from row to row is commanded",
        "decision 89", ge=0,
    )  # fmt: skip
    line_parts: int = setting(
        10, "rows", "most that are parts of one line of forces, and then some for ends that are missed",
        "decision 98", ge=2,
    )  # fmt: skip
    line_equal: float = setting(
        0.01, "share", "of a second difference of forces below which a third one is none, though stamps are rounded",
        "decision 98", gt=0, lt=1,
    )  # fmt: skip
    force_white: float = setting(
        2.0, "-", "times as much noise of forces may means of twice as many rows show; more is a steady change",
        "decision 89", ge=1,
    )  # fmt: skip
    sure: float = setting(
        SURE,
        "-",
        "deviation of the logarithm of the size of errors that are alike in neighbouring frames",
        ge=0,
    )


DEFAULT = NoiseSettings()
