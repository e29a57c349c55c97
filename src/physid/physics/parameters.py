"""The physical parameters of the bodies: what identification estimates."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

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

    Raises:
        ValueError: If a shape is off, a value is not finite, or a sign is impossible.
    """

    size: Tensor
    mass: Tensor
    inertia: Tensor
    friction: Tensor
    restitution: Tensor

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

    def replace(self, **changes: Tensor) -> Parameters:
        """Return a copy with some fields changed (the inertia does not follow the mass by itself)."""
        return dataclasses.replace(self, **changes)
