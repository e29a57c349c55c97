"""Differentiable rigid bodies in contact: the PhysicsLayer and what goes in and out of it."""

from physid.physics.effect import Effect, Quantity, Site, StepInputs, quantity, widths_of, with_sizes
from physid.physics.layer import PhysicsLayer, Rollout, SolverError
from physid.physics.parameters import Parameters
from physid.physics.state import State, check_shape
from physid.physics.world import Plane, World

__all__ = [
    "Effect",
    "Parameters",
    "PhysicsLayer",
    "Plane",
    "Quantity",
    "Rollout",
    "Site",
    "SolverError",
    "State",
    "StepInputs",
    "World",
    "check_shape",
    "quantity",
    "widths_of",
    "with_sizes",
]
