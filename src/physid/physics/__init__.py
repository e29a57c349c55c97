"""Differentiable rigid bodies in contact: the PhysicsLayer and what goes in and out of it."""

from physid.physics.effect import Effect as Effect
from physid.physics.effect import Quantity as Quantity
from physid.physics.effect import Site as Site
from physid.physics.effect import StepInputs as StepInputs
from physid.physics.effect import quantity as quantity
from physid.physics.effect import widths_of as widths_of
from physid.physics.effect import with_sizes as with_sizes
from physid.physics.layer import PhysicsLayer as PhysicsLayer
from physid.physics.layer import Rollout as Rollout
from physid.physics.layer import SolverError as SolverError
from physid.physics.parameters import Parameters as Parameters
from physid.physics.state import State as State
from physid.physics.state import check_shape as check_shape
from physid.physics.world import Plane as Plane
from physid.physics.world import World as World
