"""Effects of dynamics: forces, gravity and inertia that the nominal model lacks."""

from __future__ import annotations

from physid.effects.dynamics.com_offset import ComOffset
from physid.effects.dynamics.constant_force import ConstantForce
from physid.effects.dynamics.gravity_error import GravityError
from physid.effects.dynamics.ground_tilt import GroundTilt
from physid.effects.dynamics.inertia_scale import InertiaScale
from physid.effects.dynamics.mass_drift import MassDrift
from physid.effects.dynamics.quadratic_drag import QuadraticDrag
from physid.effects.dynamics.tether import Tether
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.physics import Effect

EFFECTS: tuple[type[Effect], ...] = (
    ViscousDrag,
    QuadraticDrag,
    ConstantForce,
    GroundTilt,
    GravityError,
    Tether,
    ComOffset,
    InertiaScale,
    MassDrift,
)
