"""Effects of contact: friction, restitution and give where bodies touch."""

from __future__ import annotations

from physid.effects.contact.adhesion import Adhesion
from physid.effects.contact.anisotropic_friction import AnisotropicFriction
from physid.effects.contact.body_anisotropic_friction import BodyAnisotropicFriction
from physid.effects.contact.contact_compliance import ContactCompliance
from physid.effects.contact.friction_drift import FrictionDrift
from physid.effects.contact.friction_gradient import FrictionGradient
from physid.effects.contact.ground_restitution import GroundRestitution
from physid.effects.contact.load_dependent_friction import LoadDependentFriction
from physid.effects.contact.object_friction import ObjectFriction
from physid.effects.contact.object_restitution import ObjectRestitution
from physid.effects.contact.stribeck_friction import StribeckFriction
from physid.effects.contact.torsional_friction import TorsionalFriction
from physid.physics import Effect

EFFECTS: tuple[type[Effect], ...] = (
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
)
