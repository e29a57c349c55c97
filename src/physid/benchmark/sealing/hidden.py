"""What is hidden in a recording set, and which answers are right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from typing import Literal, get_args

import torch

from physid.benchmark.sealing.native import NATIVE
from physid.benchmark.sealing.outside import OUTSIDE
from physid.effects import CATALOGUE, find
from physid.physics import Effect
from physid.scenes import SETUPS
from physid.simulators import find_simulator
from physid.simulators.native import Native

Role = Literal["free", "catalogue", "native", "outside", "alias", "pair", "triple"]
ROLES: tuple[Role, ...] = get_args(Role)
SHARES: Mapping[Role, float] = {
    "free": 10, "catalogue": 18, "native": 7, "outside": 7, "alias": 4, "pair": 4, "triple": 2,
}  # fmt: skip
"""How the sets of a bank are dealt out."""
TOGETHER: Mapping[Role, int] = {"pair": 2, "triple": 3}
"""How many effects are hidden together, each of another site."""


@dataclass(frozen=True)
class Confusion:
    """Effects that one scene and protocol can hardly tell apart, so that only the group is asked for.

    Attributes:
        effects: The effects.
        scene: The scene.
        protocols: The protocols.
        reason: Why.
    """

    effects: tuple[str, ...]
    scene: str
    protocols: tuple[str, ...]
    reason: str


BOTH = ("paper", "rich")
MOVED = ("rich", "off_centre")
DRAWN = ("paper", "rich", "off_centre")
"""Protocols that are drawn, where a scene has them, of simulators that know every motion."""
STRAIGHT = ("straight",)
HEIGHT = "a body that never turns, and touches the ground alone: only its height shows either"
CONFUSIONS: tuple[Confusion, ...] = (
    Confusion(("constant_force", "ground_tilt"), "push", DRAWN, "one mass on a plane: wind or tilt"),
    Confusion(("camera_yaw", "force_misalignment"), "push", DRAWN, "no fixed edge in view"),
    Confusion(("force_offset", "com_offset"), "push", MOVED, "no free fall"),
    Confusion(("viscous_drag", "quadratic_drag", "friction_drift"), "push", ("paper",), "speed grows with time"),
    Confusion(
        ("force_delay", "force_lag", "observation_latency", "observation_lag"),
        "push",
        MOVED,
        "few steps of the command",
    ),
    Confusion(("length_scale", "gravity_error", "clock_rate"), "toss", ("paper",), "free flight fills most frames"),
    Confusion(("ground_restitution", "contact_compliance"), "toss", BOTH, "one height of fall"),
    *(Confusion(("camera_offset", "object_size"), scene, STRAIGHT, HEIGHT) for scene in ("push", "slide", "toss")),
    Confusion(("force_delay", "observation_latency"), "push", STRAIGHT, "the same motion, later"),
)
"""From the confusions that were known before the diagnosis was written, and, since bank 106821, those of straight
motions, under which nothing at all distinguishes the effects."""

ABSORBED: Mapping[str, tuple[str, ...]] = {"toss": ("ground_restitution",)}
"""By scene: effects of the catalogue that are a change of an unknown parameter, and no right answer there."""


@dataclass(frozen=True)
class Hidden:
    """What the nominal model lacks in one set.

    Attributes:
        role: What the set is for.
        kinds: The effects, in the order in which they act; none for an effect-free set.
    """

    role: Role
    kinds: tuple[type[Effect], ...] = ()

    def right(self, scene: str) -> list[list[str]]:
        """Return the sets of names each of which is a right answer; none where that is `none` or `unknown`."""
        if self.role == "native":
            kin = getattr(self.kinds[0], "kin")  # noqa: B009
            return [[name] for name in kin if name not in ABSORBED.get(scene, ())]
        return [] if self.role in ("free", "outside") else [[kind.name for kind in self.kinds]]

    @property
    def sites(self) -> list[str]:
        """The sites of the effects."""
        return [kind.site for kind in self.kinds]


def cells(simulator: str) -> list[tuple[str, str]]:
    """List scenes and protocols of the sets that a simulator makes."""
    protocols = DRAWN if find_simulator(simulator).from_any_state else ("straight",)
    return [(setup.scene.name, each) for setup in SETUPS for each in protocols if each in setup.protocols]


@cache
def candidates(role: Role, scene: str, protocol: str, simulator: str = "pybullet") -> tuple[Hidden, ...]:
    """List what may be hidden in sets of one role, scene and protocol that a simulator makes."""
    if role == "free":
        return (Hidden("free"),)
    if role == "alias":
        fitting = (one for one in CONFUSIONS if one.scene == scene and protocol in one.protocols)
        kinds = (find(name) for one in fitting for name in one.effects)
        return tuple(Hidden("alias", (kind,)) for kind in kinds if _makes(simulator, kind))
    near = {name for one in CONFUSIONS if one.scene == scene and protocol in one.protocols for name in one.effects}
    clear = [kind for kind in CATALOGUE if kind.name not in near and _makes(simulator, kind)]
    if role in TOGETHER and find_simulator(simulator).from_any_state:
        return tuple(
            Hidden(role, kinds)
            for kinds in combinations(clear, TOGETHER[role])
            if len({kind.site for kind in kinds}) == len(kinds)
            and not any(confused(one.name, two.name) for one, two in combinations(kinds, 2))
        )
    single: Mapping[Role, Sequence[type[Effect]]] = {"catalogue": clear, "native": NATIVE, "outside": OUTSIDE}
    return tuple(Hidden(role, (kind,)) for kind in single.get(role, ()) if _makes(simulator, kind))


def _makes(simulator: str, kind: type[Effect]) -> bool:
    """Return whether a simulator can make an effect: settings of PyBullet are its own, closed forms know drag alone."""
    if issubclass(kind, Native):
        return simulator == "pybullet"
    return find_simulator(simulator).from_any_state or kind.act is Effect.act or kind.name == "viscous_drag"


def confused(one: str, two: str) -> bool:
    """Return whether two effects can be taken for each other somewhere."""
    return any({one, two} <= set(each.effects) for each in CONFUSIONS)


def build(kind: type[Effect], values: Mapping[str, float]) -> Effect:
    """Build an effect of any ring from numbers."""
    return kind(**{key: torch.tensor([value], dtype=torch.float64) for key, value in values.items()})


def scaled(kind: type[Effect], direction: Mapping[str, float], size: float) -> dict[str, float]:
    """Return parameters `size` times their typical values along a direction, cut at their ranges.

    Args:
        kind: The effect.
        direction: One number for each parameter, +-1 where there is but one.
        size: Multiple of the typical values.
    """
    quantities = kind.quantities()
    wanted = {key: q.null + size * direction[key] * (q.typical - q.null) for key, q in quantities.items()}
    return {key: min(max(value, quantities[key].low), quantities[key].high) for key, value in wanted.items()}
