"""The second ring: effects that only PyBullet can make, by settings of its own; their laws differ from the catalogue's.

`kin` names the effects of the catalogue that describe the same cause by another law; where there are none, the right
answer is `unknown`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.physics import Effect, Site, quantity
from physid.simulators.native import Settings


@final
@dataclass(frozen=True)
class EngineDamping(Effect):
    """dv/dt = -d v and dw/dt = -d w as PyBullet damps (with several bodies -d v (1 + |v|)): by mass, not by force.

    Attributes:
        damping: d [1/s].
    """

    name: ClassVar[str] = "engine_damping"
    site: ClassVar[Site] = "dynamics"
    kin: ClassVar[tuple[str, ...]] = ("viscous_drag", "quadratic_drag")
    damping: Tensor = quantity("1/s", low=0.0, high=0.9, typical=0.1)

    def settings(self) -> Settings:
        """Damp all bodies."""
        return Settings(bodies={"linearDamping": float(self.damping), "angularDamping": float(self.damping)})


@final
@dataclass(frozen=True)
class EngineRolling(Effect):
    """tau = -r N w / |w| across the normal where a body touches, as PyBullet rolls.

    Attributes:
        radius: r [m].
    """

    name: ClassVar[str] = "engine_rolling"
    site: ClassVar[Site] = "contact"
    kin: ClassVar[tuple[str, ...]] = ()
    radius: Tensor = quantity("m", low=0.0, high=0.2, typical=0.02)

    def settings(self) -> Settings:
        """Let all bodies resist rolling."""
        return Settings(bodies={"rollingFriction": float(self.radius)})


@final
@dataclass(frozen=True)
class EngineSpinning(Effect):
    """tau = -r N sign(w_n) n where a body touches, as PyBullet spins.

    Attributes:
        radius: r [m].
    """

    name: ClassVar[str] = "engine_spinning"
    site: ClassVar[Site] = "contact"
    kin: ClassVar[tuple[str, ...]] = ("torsional_friction",)
    radius: Tensor = quantity("m", low=0.0, high=0.2, typical=0.02)

    def settings(self) -> Settings:
        """Let all bodies resist spinning."""
        return Settings(bodies={"spinningFriction": float(self.radius)})


@final
@dataclass(frozen=True)
class EngineBodyAnisotropy(Effect):
    """mu_y = (1 - a) mu along the body's second axis, by PyBullet's anisotropicFriction, which is no ellipse.

    Attributes:
        loss: a [-].
    """

    name: ClassVar[str] = "engine_body_anisotropy"
    site: ClassVar[Site] = "contact"
    kin: ClassVar[tuple[str, ...]] = ("body_anisotropic_friction",)
    loss: Tensor = quantity("-", low=0.0, high=0.9, typical=0.3)

    def settings(self) -> Settings:
        """Give all bodies a grain."""
        return Settings(bodies={"anisotropicFriction": [1.0, 1.0 - float(self.loss), 1.0]})


@final
@dataclass(frozen=True)
class EngineGroundAnisotropy(Effect):
    """mu_y = (1 - a) mu along the ground's second axis, by PyBullet's anisotropicFriction, which is no ellipse.

    Attributes:
        loss: a [-].
    """

    name: ClassVar[str] = "engine_ground_anisotropy"
    site: ClassVar[Site] = "contact"
    kin: ClassVar[tuple[str, ...]] = ("anisotropic_friction",)
    loss: Tensor = quantity("-", low=0.0, high=0.9, typical=0.3)

    def settings(self) -> Settings:
        """Give the ground a grain."""
        return Settings(ground={"anisotropicFriction": [1.0, 1.0 - float(self.loss), 1.0]})


@final
@dataclass(frozen=True)
class EngineFrictionBox(Effect):
    """|f_1| <= mu N and |f_2| <= mu N instead of f_1^2 + f_2^2 <= (mu N)^2, wherever `box` is above 0.

    Attributes:
        box: A switch [-].
    """

    name: ClassVar[str] = "engine_friction_box"
    site: ClassVar[Site] = "contact"
    kin: ClassVar[tuple[str, ...]] = ("anisotropic_friction",)
    box: Tensor = quantity("-", low=0.0, high=1.0, typical=1.0)

    def settings(self) -> Settings:
        """Switch the cone off."""
        return Settings(world={"enableConeFriction": int(float(self.box) == 0)})


@final
@dataclass(frozen=True)
class EngineBounceThreshold(Effect):
    """e = 0 for impacts slower than v.

    Attributes:
        speed: v [m/s].
    """

    name: ClassVar[str] = "engine_bounce_threshold"
    site: ClassVar[Site] = "contact"
    kin: ClassVar[tuple[str, ...]] = ("ground_restitution",)
    speed: Tensor = quantity("m/s", low=0.0, high=4.0, typical=0.8)

    def settings(self) -> Settings:
        """Swallow slow bounces."""
        return Settings(world={"restitutionVelocityThreshold": float(self.speed)})


@final
@dataclass(frozen=True)
class EngineSoftness(Effect):
    """F = k d + c dd/dt for a depth d of contact with the ground, k = 1 / a and c = 50 N s/m; rigid at a = 0.

    Attributes:
        compliance: a [m/N].
    """

    name: ClassVar[str] = "engine_softness"
    site: ClassVar[Site] = "contact"
    kin: ClassVar[tuple[str, ...]] = ("contact_compliance",)
    compliance: Tensor = quantity("m/N", low=0.0, high=2e-3, typical=2e-4)

    def settings(self) -> Settings:
        """Make the ground soft."""
        if float(self.compliance) == 0:
            return Settings()
        spring = {"contactStiffness": 1 / float(self.compliance), "contactDamping": 50.0}
        return Settings(ground=spring, world={"useSplitImpulse": 0})


@final
@dataclass(frozen=True)
class EnginePushOut(Effect):
    """v_n = p d / h after a step that found bodies a depth d inside each other: overlaps come back as a bounce.

    Attributes:
        part: p [-].
    """

    name: ClassVar[str] = "engine_push_out"
    site: ClassVar[Site] = "contact"
    kin: ClassVar[tuple[str, ...]] = ("ground_restitution", "contact_compliance")
    part: Tensor = quantity("-", low=0.0, high=0.9, typical=0.3)

    def settings(self) -> Settings:
        """Take overlaps back by a velocity."""
        if float(self.part) == 0:
            return Settings()
        return Settings(world={"useSplitImpulse": 0, "contactERP": float(self.part), "erp": float(self.part)})


NATIVE: tuple[type[Effect], ...] = (
    EngineDamping,
    EngineRolling,
    EngineSpinning,
    EngineBodyAnisotropy,
    EngineGroundAnisotropy,
    EngineFrictionBox,
    EngineBounceThreshold,
    EngineSoftness,
    EnginePushOut,
)
