"""What only one simulator can do: its own settings, as an effect asks for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable


@dataclass(frozen=True)
class Settings:
    """Settings of PyBullet that differ from the textbook's.

    Attributes:
        bodies: For every body, as `pybullet.changeDynamics` takes them.
        ground: For the ground, likewise.
        world: For the world, as `pybullet.setPhysicsEngineParameter` takes them.
    """

    bodies: Mapping[str, Any] = field(default_factory=dict)
    ground: Mapping[str, Any] = field(default_factory=dict)
    world: Mapping[str, Any] = field(default_factory=dict)


@runtime_checkable
class Native(Protocol):
    """An effect whose law is PyBullet's own; the PhysicsLayer does not have it."""

    def settings(self) -> Settings:
        """Return the settings that make the effect; at its null value they change nothing."""
        ...
