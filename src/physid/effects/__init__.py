"""The catalogue of effects that a nominal model may lack."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from difflib import get_close_matches

import torch

from physid.effects.adhesion import Adhesion
from physid.effects.anisotropic_friction import AnisotropicFriction
from physid.effects.body_anisotropic_friction import BodyAnisotropicFriction
from physid.effects.camera_offset import CameraOffset
from physid.effects.camera_yaw import CameraYaw
from physid.effects.clock_rate import ClockRate
from physid.effects.com_offset import ComOffset
from physid.effects.constant_force import ConstantForce
from physid.effects.contact_compliance import ContactCompliance
from physid.effects.force_dead_zone import ForceDeadZone
from physid.effects.force_delay import ForceDelay
from physid.effects.force_gain import ForceGain
from physid.effects.force_lag import ForceLag
from physid.effects.force_misalignment import ForceMisalignment
from physid.effects.force_offset import ForceOffset
from physid.effects.force_saturation import ForceSaturation
from physid.effects.friction_drift import FrictionDrift
from physid.effects.friction_gradient import FrictionGradient
from physid.effects.gravity_error import GravityError
from physid.effects.ground_restitution import GroundRestitution
from physid.effects.ground_tilt import GroundTilt
from physid.effects.inertia_scale import InertiaScale
from physid.effects.length_scale import LengthScale
from physid.effects.lens_distortion import LensDistortion
from physid.effects.load_dependent_friction import LoadDependentFriction
from physid.effects.mass_drift import MassDrift
from physid.effects.object_friction import ObjectFriction
from physid.effects.object_restitution import ObjectRestitution
from physid.effects.object_size import ObjectSize
from physid.effects.observation_latency import ObservationLatency
from physid.effects.quadratic_drag import QuadraticDrag
from physid.effects.stribeck_friction import StribeckFriction
from physid.effects.table import Row, rows_of
from physid.effects.tether import Tether
from physid.effects.torsional_friction import TorsionalFriction
from physid.effects.viscous_drag import ViscousDrag
from physid.physics.effect import Effect, Quantity

CATALOGUE: tuple[type[Effect], ...] = (
    ForceGain,
    ForceDeadZone,
    ForceSaturation,
    ForceDelay,
    ForceLag,
    ForceMisalignment,
    ForceOffset,
    ViscousDrag,
    QuadraticDrag,
    ConstantForce,
    GroundTilt,
    GravityError,
    Tether,
    ComOffset,
    InertiaScale,
    MassDrift,
    StribeckFriction,
    AnisotropicFriction,
    BodyAnisotropicFriction,
    FrictionGradient,
    FrictionDrift,
    TorsionalFriction,
    LoadDependentFriction,
    Adhesion,
    GroundRestitution,
    ObjectRestitution,
    ObjectFriction,
    ContactCompliance,
    LengthScale,
    CameraYaw,
    CameraOffset,
    ObservationLatency,
    ClockRate,
    LensDistortion,
    ObjectSize,
)
"""Every effect that ships with physid, by site: actuation, dynamics, contact, perception."""

__all__ = ["CATALOGUE", "Row", "describe", "find", "from_values"]


def find(name: str, among: Sequence[type[Effect]] = CATALOGUE) -> type[Effect]:
    """Find an effect by its name.

    Raises:
        ValueError: If there is none; the message names the nearest.
    """
    known = {effect.name: effect for effect in among}
    if name not in known:
        raise ValueError(f'unknown effect "{name}"{_nearest(name, list(known))}; `physid effects` lists all')
    return known[name]


def from_values(name: str, values: Mapping[str, float], among: Sequence[type[Effect]] = CATALOGUE) -> Effect:
    """Build an effect from numbers; parameters that are left out keep their null value.

    Args:
        name: Name of the effect.
        values: Parameters by name, in the units of the catalogue.
        among: Effects to look in.

    Raises:
        ValueError: If the effect or a parameter does not exist, or a value is not a number within its range.
    """
    effect = find(name, among)
    quantities = effect.quantities()
    for key, value in values.items():
        if key not in quantities:
            raise ValueError(f'effect {name} has no parameter "{key}"{_nearest(key, list(quantities))}')
        _check(f"{name}.{key}", value, quantities[key])
    return effect(**{key: torch.tensor([float(value)], dtype=torch.float64) for key, value in values.items()})


def describe(among: Sequence[type[Effect]] = CATALOGUE) -> list[Row]:
    """Describe effects as the rows of a table, one for each parameter."""
    return [row for effect in among for row in rows_of(effect)]


def _check(name: str, value: float, quantity: Quantity) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} must be a finite number [{quantity.unit}], got {value!r}")
    if not quantity.low <= value <= quantity.high:
        raise ValueError(
            f"{name} must lie between {quantity.low:g} and {quantity.high:g} [{quantity.unit}], got {value:g}; "
            "check its unit"
        )


def _nearest(word: str, known: list[str]) -> str:
    close = get_close_matches(word, known, n=1)
    return f'; did you mean "{close[0]}"?' if close else f"; known: {', '.join(known)}"
