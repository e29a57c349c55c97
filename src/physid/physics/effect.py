"""The one extension point of the physics: an effect that the nominal model lacks."""

from __future__ import annotations

import dataclasses
from abc import ABC
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, ClassVar, Literal, Self, get_type_hints

import torch
from torch import Tensor
from torch.nn.functional import pad

from physid.physics.shapes.shape import Shape
from physid.physics.state import State

Site = Literal["actuation", "dynamics", "contact", "perception"]


ENDLESS = 1e3  # typical sizes: no effect is larger


@dataclass(frozen=True)
class Quantity:
    """What a parameter of an effect is: unit, null value, range and a size that is typical in practice."""

    unit: str
    low: float
    high: float
    typical: float
    null: float = 0.0

    @property
    def largest(self) -> float:
        """The largest distance from the null value that the range admits; of one without end so many typical ones."""
        most = ENDLESS * abs(self.typical - self.null)
        return max(min(end, most) for end in (self.high - self.null, self.null - self.low))


def quantity(unit: str, low: float, high: float, typical: float, null: float = 0.0) -> Tensor:
    """Declare a parameter of an effect; its default is the null value, at which the effect is the identity.

    A parameter is a tensor of shape (1,) or (B,), so that a batch can hold a different size of the effect in each
    world.
    """
    described = Quantity(unit, low, high, typical, null)
    field: Tensor = dataclasses.field(
        default_factory=lambda: torch.tensor([null], dtype=torch.float64), metadata={"quantity": described}
    )
    return field


@dataclass(frozen=True)
class Declared:
    """What an input of a step is; nominal inputs and the layout of the compiled engine follow from it.

    Attributes:
        of: What has one of its own: each `body` of each world, each `world`, the `ground` that all worlds share, or the
            `instant`, which every step has anew.
        width: Numbers of each.
        nominal: Its value without effects, where neither parameters nor world have one of that name.
    """

    of: Literal["body", "world", "ground", "instant"]
    width: int = 1
    nominal: float = 0.0


@dataclass(frozen=True)
class StepInputs:
    """All that a step of the engine takes beside the state; the only thing that an effect may change.

    A new input is one line here, and the formula of the step that reads it (twice: `step` and `fused.formulas`).

    Attributes:
        time: Time since the first frame [s], or since the start of the clock that a rollout was given; shape (B,).
        wrench: Torque [N m] and force [N] at the centre of the box, world frame, shape (B, N, 6).
        gravity: Acceleration of gravity on each body [m/s^2], world frame, shape (B, N, 3).
        size: Extents along the axes of each body, of a box its edge lengths [m], shape (B, N, 3).
        mass: Masses [kg], shape (B, N).
        inertia: Principal moments [kg m^2], body frame, shape (B, N, 3).
        friction: Coulomb coefficient of each body [-], shape (B, N).
        restitution: Newton coefficient of each body [-], shape (B, N).
        ground_normal: Unit normal of the ground, shape (3,).
        ground_offset: The ground holds the points p with normal . p = offset [m], shape ().
        ground_friction: Factor on the friction of each body with the ground [-], shape (B, N).
        ground_restitution: Added to the restitution of each body with the ground [-], shape (B, N); the sum is cut
            at 0.
        body_friction: Factor on the friction between bodies [-], shape (B,).
        body_restitution: Added to the restitution between bodies [-], shape (B,); the sum is cut at 0.
        centre_of_mass: Offset of the centre of mass from the centre of the box, body frame [m], shape (B, N, 3).
        compliance: Static deflection per force of the contacts of each body with the ground [m/N], shape (B, N).
        shapes: Those of the bodies; none where all are boxes. The same in all worlds, and no effect changes them.
    """

    time: Annotated[Tensor, Declared("instant")]
    wrench: Annotated[Tensor, Declared("instant", 6)]
    gravity: Annotated[Tensor, Declared("body", 3)]
    size: Annotated[Tensor, Declared("body", 3)]
    mass: Annotated[Tensor, Declared("body")]
    inertia: Annotated[Tensor, Declared("body", 3)]
    friction: Annotated[Tensor, Declared("body")]
    restitution: Annotated[Tensor, Declared("body")]
    ground_normal: Annotated[Tensor, Declared("ground", 3)]
    ground_offset: Annotated[Tensor, Declared("ground")]
    ground_friction: Annotated[Tensor, Declared("body", nominal=1.0)]
    ground_restitution: Annotated[Tensor, Declared("body")]
    body_friction: Annotated[Tensor, Declared("world", nominal=1.0)]
    body_restitution: Annotated[Tensor, Declared("world")]
    centre_of_mass: Annotated[Tensor, Declared("body", 3)]
    compliance: Annotated[Tensor, Declared("body")]
    shapes: tuple[Shape, ...] = ()

    def add_force(self, force: Tensor) -> StepInputs:
        """Add forces at the centres [N], shape (B, N, 3), world frame."""
        return self.replace(wrench=self.wrench + pad(force, (3, 0)))

    def add_torque(self, torque: Tensor) -> StepInputs:
        """Add torques [N m], shape (B, N, 3), world frame."""
        return self.replace(wrench=self.wrench + pad(torque, (0, 3)))

    def tensors(self, but: Collection[str] = ()) -> dict[str, Tensor]:
        """Return the inputs that are tensors, by name, without those of some kinds (see `Declared.of`)."""
        return {name: getattr(self, name) for name, one in _declarations().items() if one.of not in but}

    def replace(self, **changes: Tensor) -> StepInputs:
        """Return a copy with some tensors changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]

    @classmethod
    def nominal(cls, like: Tensor, given: Mapping[str, Tensor], shapes: tuple[Shape, ...] = ()) -> StepInputs:
        """Build the inputs of a step without any effect.

        Args:
            like: Poses of the worlds, shape (B, N, 7), whose batch, dtype and device the inputs have.
            given: Values of inputs, of their shapes or with batch axes of length 1; what is not among them is nominal.
            shapes: Those of the bodies; none where all are boxes.
        """
        axes = {"body": like.shape[:2], "world": like.shape[:1], "instant": like.shape[:1], "ground": ()}
        values = {}
        for name, declared in _declarations().items():
            value = given.get(name)
            if value is None:
                wide = (declared.width,) if declared.width > 1 else ()
                value = like.new_full((*axes[declared.of], *wide), declared.nominal)
            elif declared.of != "ground":
                value = value.to(like).expand(like.shape[0], *value.shape[1:])
            values[name] = value
        return cls(**values, shapes=shapes)


@cache
def _declarations() -> dict[str, Declared]:
    hints = get_type_hints(StepInputs, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items() if hasattr(hint, "__metadata__")}


def widths_of(*kinds: str) -> dict[str, int]:
    """Return the widths of all inputs of some kinds (see `Declared.of`), by name."""
    return {name: one.width for name, one in _declarations().items() if one.of in kinds}


@dataclass(frozen=True)
class Effect(ABC):
    """One unmodelled effect: a formula used by PyBullet, by the PhysicsLayer and by the diagnosis alike.

    A subclass is a frozen dataclass that names itself, its site and its parameters (see `quantity`), and
    overrides the one hook of its site. At the null values every hook returns its input unchanged. Formulas are
    differentiable, and broadcast parameters of shape (1,) or (B,) over the batch.
    """

    name: ClassVar[str]
    site: ClassVar[Site]

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        """Turn the commanded wrenches (B, T, N, 6) of a trajectory into those that act.

        Row k is held from time[:, k] to time[:, k + 1] [s]; `time` has the shape (1 or B, T).
        """
        return wrench

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Change what enters one step of the engine (dynamics and contact effects)."""
        return inputs

    def elapse(self, time: Tensor) -> Tensor:
        """Return when poses that a camera stamps with times (B, T) [s], those of the first frame first, were taken.

        An effect with this hook reports what `observe` makes of it, poses at those times; who simulates needs not
        interpolate, and steps to them.
        """
        return time

    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Turn the true poses (B, T, N, 7) at some times (1 or B, T) [s] into those that the camera reports."""
        return pose

    @classmethod
    def quantities(cls) -> dict[str, Quantity]:
        """Describe the parameters of the effect, by name."""
        return {field.name: field.metadata["quantity"] for field in dataclasses.fields(cls)}

    def values(self) -> dict[str, Tensor]:
        """Return the parameters by name, each of shape (1,) or (B,)."""
        return {name: getattr(self, name) for name in self.quantities()}

    def replace(self, **changes: Tensor) -> Self:
        """Return a copy with some parameters changed."""
        return dataclasses.replace(self, **changes)

    def to(self, reference: Tensor) -> Self:
        """Return a copy whose parameters have the type and device of `reference`."""
        return self.replace(**{name: value.to(reference) for name, value in self.values().items()})


def with_sizes(effects: Sequence[Effect], sizes: Mapping[str, Tensor]) -> tuple[Effect, ...]:
    """Return effects of which some parameters have other values.

    Args:
        effects: Effects of different names.
        sizes: Values of shape (1,) or (B,) by EFFECT.PARAMETER ("viscous_drag.coefficient").

    Raises:
        ValueError: If none of the effects has such a parameter.
    """
    if not sizes:
        return tuple(effects)
    known = {effect.name: effect.values() for effect in effects}
    for label, value in sizes.items():
        name, _, parameter = label.partition(".")
        if name not in known:
            raise ValueError(f"{label}: expected an effect that is at work, found {', '.join(known) or 'none'}")
        known[name] = {each: other.to(value) for each, other in known[name].items()} | {parameter: value}
    changed = {label.partition(".")[0] for label in sizes}
    return tuple(_alike(effect, known[effect.name]) if effect.name in changed else effect for effect in effects)


def _alike(effect: Effect, values: Mapping[str, Tensor]) -> Effect:
    """Return an effect with other values, all of one shape."""
    return effect.replace(**dict(zip(values, torch.broadcast_tensors(*values.values()), strict=True)))
