"""Coulomb friction as complementarity: the circular cone, and the paper's pyramid as its polygon.

Both laws describe one contact by unknowns z and slacks w in a product of cones, affine in the relative velocity u,

    w = G u + H z + d,    z in K,  w in K,  z o w = 0,    impulse = P z,

with the unknowns (lambda_c, gamma, ...) of eq. (3) of the paper. The normal row is w_0 = u_n + c + compliance *
lambda_c, the bound on friction w_1 = mu lambda_c - (size of the friction impulse) + slack_compliance * gamma. What
follows differs:

* `Pyramid`: one row per direction d, w_d = d . u_t + gamma >= 0 against lambda_d >= 0, as in the paper;
* `Cone`: its limit of infinitely many directions, one second-order cone (beta, lambda_t) against (gamma, u_t), which
  says |lambda_t| <= beta and u_t = -gamma lambda_t / beta (Howell et al. 2022, Dojo, sec. IV).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.physics.guards.made_once import made_once

SLACK_COMPLIANCE = 1e-9
"""Keeps gamma bounded where there is no friction to bound it; it acts as a viscous friction of that size [-]."""

NORMAL, SLIP = 0, 1


class FrictionLaw(ABC):
    """How tangential impulses are bounded by normal ones.

    Attributes:
        size: Number of unknowns per contact.
        linear: How many of them, from the first, are paired as numbers; the rest forms one second-order cone of size 3.
    """

    size: int
    linear: int

    @abstractmethod
    def matrices(self, reference: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return G (m, 3), H without friction and compliance (m, m), and P (3, m), typed as `reference`."""

    @abstractmethod
    def start(self, velocity: Tensor, offset: Tensor, friction: Tensor) -> tuple[Tensor, Tensor]:
        """Return a strictly interior pair (z, w), shapes (B, C, m).

        Args:
            velocity: Relative velocities (normal, tangential) without contact, shape (B, C, 3), in units of g h.
            offset: c of eq. (3), shape (B, C).
            friction: Coefficients, shape (B, C).
        """


def _start_normal(velocity: Tensor, offset: Tensor, friction: Tensor) -> tuple[Tensor, ...]:
    separation = velocity[..., 0] + offset
    impulse = 1 + (-separation).clamp_min(0)
    slack = 1 + separation.abs()
    slip = 1 + 1.5 * velocity[..., 1:].norm(dim=-1)
    bound = 0.5 * friction * impulse + 0.1
    return impulse, slack, slip, bound


@final
@dataclass(frozen=True)
class Cone(FrictionLaw):
    """Isotropic friction, |lambda_t| <= mu lambda_c; z = (lambda_c, gamma, beta, lambda_t)."""

    size = 5
    linear = 2

    def matrices(self, reference: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return G, H and P (see `FrictionLaw.matrices`)."""
        return _cone_matrices(reference.dtype, reference.device)

    def start(self, velocity: Tensor, offset: Tensor, friction: Tensor) -> tuple[Tensor, Tensor]:
        """Start with friction that opposes the free slip, half as large as it may be (see `FrictionLaw.start`)."""
        impulse, slack, slip, bound = _start_normal(velocity, offset, friction)
        tangential = velocity[..., 1:]
        z = torch.stack([impulse, slip, bound], -1)
        w = torch.stack([slack, bound, slip], -1)
        return torch.cat([z, -(bound / slip)[..., None] * tangential], -1), torch.cat([w, tangential], -1)


@made_once
def _cone_matrices(dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor, Tensor]:
    g = torch.zeros(5, 3, dtype=dtype, device=device)
    g[NORMAL, 0] = g[3, 1] = g[4, 2] = 1
    h = torch.zeros(5, 5, dtype=dtype, device=device)
    h[SLIP, 2], h[SLIP, SLIP], h[2, SLIP] = -1, SLACK_COMPLIANCE, 1
    p = torch.zeros(3, 5, dtype=dtype, device=device)
    p[0, NORMAL] = p[1, 3] = p[2, 4] = 1
    return g, h, p


@final
@dataclass(frozen=True)
class Pyramid(FrictionLaw):
    """The paper's friction pyramid; z = (lambda_c, gamma, lambda_1 ... lambda_D).

    The impulses fill a regular polygon with its corners at mu lambda_c: with 4 directions a diamond, which loses
    1 - cos(pi / D) = 29 % of the friction midway between two of them.

    Attributes:
        directions: D, at least 4 and even.
    """

    directions: int = 4

    def __post_init__(self) -> None:
        if self.directions < 4 or self.directions % 2:
            raise ValueError(f"directions must be an even number of at least 4, got {self.directions}")

    @property
    def size(self) -> int:  # type: ignore[override]
        """Number of unknowns per contact, D + 2."""
        return self.directions + 2

    @property
    def linear(self) -> int:  # type: ignore[override]
        """All of them are paired as numbers."""
        return self.size

    def matrices(self, reference: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return G, H and P (see `FrictionLaw.matrices`)."""
        return _pyramid_matrices(self.directions, reference.dtype, reference.device)

    def start(self, velocity: Tensor, offset: Tensor, friction: Tensor) -> tuple[Tensor, Tensor]:
        """Start with every direction on one hyperbola lambda_d w_d (see `FrictionLaw.start`)."""
        impulse, slack, slip, bound = _start_normal(velocity, offset, friction)
        along = velocity @ self.matrices(velocity)[0][2:].T + slip[..., None]
        share = (bound * slip / self.directions)[..., None] / along
        z = torch.cat([impulse[..., None], slip[..., None], share], -1)
        return z, torch.cat([slack[..., None], bound[..., None], along], -1)


@made_once
def _pyramid_matrices(directions: int, dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor, Tensor]:
    angles = torch.arange(directions, dtype=dtype, device=device) * (2 * math.pi / directions)
    around = torch.stack([angles.cos(), angles.sin()], -1)
    size = directions + 2
    g = torch.zeros(size, 3, dtype=dtype, device=device)
    g[NORMAL, 0] = 1
    g[2:, 1:] = around
    h = torch.zeros(size, size, dtype=dtype, device=device)
    h[SLIP, 2:], h[SLIP, SLIP], h[2:, SLIP] = -1, SLACK_COMPLIANCE, 1
    p = torch.zeros(3, size, dtype=dtype, device=device)
    p[0, NORMAL] = 1
    p[1:, 2:] = around.T
    return g, h, p
