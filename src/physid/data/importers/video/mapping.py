"""What a film means: the keys of a log's mapping that are no columns of poses, and those of the camera."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from physid.data.importers.convert import FRICTION_NOTE
from physid.data.importers.mapping import OF_BODY, OF_SET, LogMap
from physid.data.importers.video.cameras import POINTS_OFF, read_camera
from physid.data.importers.video.lens import Lens
from physid.scenes import Scene
from physid.strict import RATES, nearest, number, quoted

OF_FILM = ("camera", "background", "rate")
OF_POSES = ("time", "time_step", "header", "trajectory", "lost", "axes", "position", "quaternion", "euler", "matrix",
            "rotation_vector", "orientation", "order", "euler_order", "visible", "clock",
            "tracked_point")  # fmt: skip


@final
@dataclass(frozen=True)
class FilmMap:
    """What films mean.

    Attributes:
        log: What there is beside poses: bodies, forces, ground, what is unknown.
        lens: The camera.
        rate: Frames per second, where the films do not say them right; else None.
        background: Image of the empty scene; None for the median of the films.
    """

    log: LogMap
    lens: Lens
    rate: float | None
    background: Path | None

    @classmethod
    def from_mapping(cls, values: dict[str, Any]) -> FilmMap:
        """Build it from plain values.

        Raises:
            FileNotFoundError: If the camera file is missing.
            ValueError: If a key is unknown or missing, or a value is off.
        """
        allowed = [name for name in (*OF_SET, *OF_BODY) if name not in OF_POSES]
        known = dict(values)
        for name in known:
            if name not in (*allowed, *OF_FILM):
                raise ValueError(f"mapping: unknown key {quoted(name)}{nearest(name, (*allowed, *OF_FILM))}")
        if known.get("camera") is None:
            raise ValueError("mapping: missing camera: a camera file; physid calibrate makes one (docs/films.md)")
        camera = Path(str(known.pop("camera")))
        lens, rate, given = read_camera(camera), known.pop("rate", None), known.pop("background", None)
        poses = {"position": [0, 0, 0], "orientation": "none"}
        bodies = {"bodies": [{**one, **poses} for one in known["bodies"]]} if known.get("bodies") else poses
        rate = None if rate is None else number(rate, "rate", low=RATES[0], high=RATES[1])
        log = LogMap.from_mapping({**known, **bodies, "rate": 1.0})
        if log.forces.file is None and any(each.force or each.torque for each in log.bodies):
            raise ValueError(
                "mapping: missing forces.file, the log with the columns of force and torque, say "
                "forces.file={stem}_forces.csv and forces.time=t: a film has no columns"
            )
        if log.forces.axes == "body":
            raise ValueError("mapping: expected forces.axes=world, for a film shows attitudes once it is tracked")
        above = float(np.array(log.ground.normal) @ lens.position) - log.ground.offset
        if above <= 0:
            raise ValueError(
                f"{camera}: expected a camera above the ground, found one {-above:.3g} m below it, which sees no body "
                "on it; z points up, and rvec and tvec lead from the world to the camera"
            )
        return cls(log, lens, rate, None if given is None else Path(str(given)))

    @property
    def notes(self) -> list[str]:
        """What is taken for granted, a line each."""
        notes = [f"{name}: {FRICTION_NOTE}" for name in self.log.unsaid]
        if self.lens.points_error is not None and self.lens.points_error > POINTS_OFF:
            notes.append(
                f"camera: its points of the ground are up to {self.lens.points_error:.1f} px off where a camera would "
                f"see them ({POINTS_OFF:g} px is much); check pixels and metres of each, every pose is off with them"
            )
        return notes

    def scene(self, step: float, source: str) -> Scene:
        """Return the scene of films with so much time between frames [s]."""
        log, bodies = self.log, tuple(each.body for each in self.log.bodies)
        return Scene(
            log.scene, step, log.ground, bodies, log.unknown, self.lens.pinhole(), log.gravity, log.source or source
        )
