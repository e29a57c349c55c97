"""The table (Shape, Shape) -> contacts, as the shapes themselves fill it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import torch
from torch import Tensor

from physid.physics.contact import Patch
from physid.physics.shapes.box import Box
from physid.physics.shapes.shape import Finder, Placed, Shape

BOX = Box()


def shape_of(shapes: Sequence[Shape], body: int) -> Shape:
    """Return the shape of a body; where none are named, all are boxes."""
    return shapes[body] if shapes else BOX


def reach(shapes: Sequence[Shape], quaternion: Tensor, size: Tensor, normal: Tensor) -> Tensor:
    """Return how far bodies reach from their centres along a unit normal [m], shape (..., N).

    Args:
        shapes: Those of the bodies; none where all are boxes.
        quaternion: Attitudes, shape (..., N, 4).
        size: Extents [m], shape (..., N, 3).
        normal: Shape (3,).
    """
    if not shapes:
        return BOX.reach(quaternion, size, normal)
    each = [shape.reach(quaternion[..., n, :], size[..., n, :], normal) for n, shape in enumerate(shapes)]
    return torch.stack(torch.broadcast_tensors(*each), -1)


def contacts_of(first: Shape, second: Shape) -> Finder:
    """Return what finds the contacts of two bodies: what the first, or else the second, knows of the other.

    Raises:
        ValueError: If neither knows of the other.
    """
    if (found := first.meets(second)) is not None:
        return found
    if (swapped := second.meets(first)) is not None:
        return lambda one, other: swapped(other, one)
    names = type(first).__name__, type(second).__name__
    raise ValueError(f"no contacts are known between {names[0]} and {names[1]}: let `meets` of one of them find them")


def find_patches(
    shapes: Sequence[Shape], pose: Tensor, size: Tensor, ground: tuple[Tensor, Tensor] | None
) -> list[Patch]:
    """List the possible contacts: every body on the ground, then every pair of bodies.

    Args:
        shapes: Those of the bodies; none where all are boxes.
        pose: Shape (B, N, 7).
        size: Extents [m], shape (B, N, 3).
        ground: Normal (3,) and offset () [m], or None.
    """
    bodies = range(pose.shape[1])

    def placed(n: int) -> Placed:
        return Placed(n, pose[:, n], size[:, n])

    patches = [] if ground is None else [shape_of(shapes, n).on_plane(placed(n), *ground) for n in bodies]
    for a, b in combinations(bodies, 2):
        patches.append(contacts_of(shape_of(shapes, a), shape_of(shapes, b))(placed(a), placed(b)))
    return patches
