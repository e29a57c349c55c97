"""What stands on the ground, how it is pushed, and which parameters are unknown."""

from physid.scenes.catalogue import SETUPS, find_setup
from physid.scenes.parameters import bodies_of, with_parameters
from physid.scenes.scene import Body, Ground, Integration, Scene
from physid.scenes.setup import Excitation, Setup

__all__ = [
    "SETUPS",
    "Body",
    "Excitation",
    "Ground",
    "Integration",
    "Scene",
    "Setup",
    "bodies_of",
    "find_setup",
    "with_parameters",
]
