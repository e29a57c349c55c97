"""The physical parameters of the bodies: what identification estimates."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from physid.physics.shapes.box import Box
from physid.physics.shapes.shape import Shape
from physid.physics.state import check_shape


@dataclass(frozen=True)
class Parameters:
    """Physical parameters of N bodies; the batch axis is B, or 1 where all worlds share them.

    Attributes:
        size: Extents along the axes of the body, of a box its edge lengths [m], shape (B or 1, N, 3).
        mass: Masses [kg], shape (B or 1, N).
        inertia: Principal moments in the body frame [kg m^2], shape (B or 1, N, 3).
        friction: Coulomb coefficients [-], shape (B or 1, N). A pair has the product; the ground's is 1.
        restitution: Newton coefficients [-], shape (B or 1, N). A pair has the product; the ground's is 1.
        sizes: Values of parameters of effects that replace those which the effects at work have, by name
            ("viscous_drag.coefficient"), in their units, shape (B or 1,).

    Raises:
        ValueError: If a shape is off, a value is not finite, or a sign is impossible.
    """

    size: Tensor
    mass: Tensor
    inertia: Tensor
    friction: Tensor
    restitution: Tensor
    sizes: Mapping[str, Tensor] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_shape("size", self.size, (None, None, 3))
        bodies = self.size.shape[1]
        check_shape("mass", self.mass, (None, bodies))
        check_shape("inertia", self.inertia, (None, bodies, 3))
        check_shape("friction", self.friction, (None, bodies))
        check_shape("restitution", self.restitution, (None, bodies))
        for name in ("size", "mass", "inertia"):
            self._require(name, getattr(self, name) > 0, "positive")
        for name in ("friction", "restitution"):
            self._require(name, getattr(self, name) >= 0, "zero or positive")
        for name, value in self.sizes.items():
            check_shape(name, value, (None,))

    def _require(self, name: str, holds: Tensor, wanted: str) -> None:
        if not holds.all():
            worst = float(getattr(self, name).min())
            raise ValueError(f"{name} must be {wanted}, got {worst:.6g}")

    @classmethod
    def of_boxes(
        cls,
        size: Tensor,
        mass: Tensor,
        friction: Tensor,
        restitution: Tensor | None = None,
        inertia: Tensor | None = None,
    ) -> Parameters:
        """Build parameters of boxes; `inertia` defaults to that of a uniform box, `restitution` to 0."""
        return cls(
            size=size,
            mass=mass,
            inertia=Box().inertia(mass, size) if inertia is None else inertia,
            friction=friction,
            restitution=torch.zeros_like(friction) if restitution is None else restitution,
        )

    @classmethod
    def of_shapes(
        cls,
        shapes: Sequence[Shape],
        size: Tensor,
        mass: Tensor,
        friction: Tensor,
        restitution: Tensor | None = None,
    ) -> Parameters:
        """Build parameters of uniform bodies of some shapes, those of `World.shapes`; `restitution` defaults to 0."""
        moments = [shape.inertia(mass[:, n], size[:, n]) for n, shape in enumerate(shapes)]
        return cls.of_boxes(size, mass, friction, restitution, torch.stack(moments, 1))

    def map(self, change: Callable[[str, Tensor], Tensor]) -> Parameters:
        """Return the same with every tensor changed, given its name."""
        own = {one.name: change(one.name, getattr(self, one.name)) for one in dataclasses.fields(self)[:-1]}
        return Parameters(**own, sizes={name: change(name, value) for name, value in self.sizes.items()})

    def replace(self, **changes: Tensor | Mapping[str, Tensor]) -> Parameters:
        """Return a copy with some fields changed (the inertia does not follow the mass by itself)."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]
