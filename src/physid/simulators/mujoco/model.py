"""A scene in MuJoCo's language: free boxes above a plane that can be moved, every pair of them a contact pair."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import mujoco
import numpy as np
from numpy.typing import NDArray

from physid.scenes import Body, Scene

Array = NDArray[np.float64]
GROUND = "ground"  # name of the plane; the boxes are called box0, box1, ...
STIFFEST = "0.9999 0.9999 0.001 0.5 2"  # solimp: MuJoCo's largest impedance, whatever the overlap
# Dense, for the sparse solver of MuJoCo 4.0.0 is wrong (corrected in 4.0.1). Tangential rows harder than normal,
# so that a body at rest does not creep. Without islands, whose solver would not see that the softness was changed, and
# without the silent fresh start of a motion that has left the finite numbers.
OPTIONS = 'integrator="RK4" cone="elliptic" jacobian="dense" tolerance="1e-12" iterations="50" impratio="100"'
FLAGS = '<flag island="disable" autoreset="disable"/>'


def build_model(scene: Scene, centres: Array) -> tuple[mujoco.MjModel, dict[tuple[int, int], int]]:
    """Build the MuJoCo model of a scene.

    Args:
        scene: What stands on the ground.
        centres: Offsets of the centres of mass from the geometric centres, body frame [m], shape (N, 3).

    Returns:
        The model, and the number of the contact pair of two bodies i < j of the scene; i = -1 is the ground.
    """
    count = len(scene.bodies)
    names = [f"box{index}" for index in range(count)]
    pairs = [(-1, index) for index in range(count)] + list(combinations(range(count), 2))
    contacts = "".join(
        f'<pair geom1="{GROUND if first < 0 else names[first]}" geom2="{names[second]}" condim="3" '
        f'solimp="{STIFFEST}"/>'
        for first, second in pairs
    )
    boxes = "".join(_box(*each) for each in zip(names, scene.bodies, centres, strict=True))
    # The plane belongs to a mocap body, which can be moved between steps.
    text = (
        f'<mujoco><option gravity="{_text(scene.gravity)}" {OPTIONS}>{FLAGS}</option><worldbody>'
        f'<body mocap="true"><geom name="{GROUND}" type="plane" size="0 0 1"/></body>{boxes}'
        f"</worldbody><contact>{contacts}</contact></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(text)
    # Set here, for the compiler refuses moments that no body of positive density has.
    model.body_inertia[2:] = [body.moments() for body in scene.bodies]
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model, {pair: number for number, pair in enumerate(pairs)}


def _box(name: str, body: Body, centre: Array) -> str:
    """Describe a free box whose centre of mass is off its middle by `centre` (3,) [m]."""
    return (
        f'<body><freejoint/><inertial pos="{_text(centre)}" mass="{body.mass!r}" diaginertia="1 1 1"/>'
        f'<geom name="{name}" type="box" size="{_text(0.5 * np.array(body.size))}"/></body>'
    )


def _text(values: Sequence[float] | Array) -> str:
    """Write numbers with all their digits."""
    return " ".join(repr(float(value)) for value in values)
