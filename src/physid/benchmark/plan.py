"""What a bank is made from, and which sets it has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np

from physid.benchmark.bank import Purpose, Size
from physid.benchmark.films import is_film
from physid.benchmark.sealing.hidden import ROLES, SHARES, Role, candidates, cells
from physid.data import assign_splits
from physid.simulators import SIMULATORS, find_simulator
from physid.strict import nearest, number, quoted

FAMILIES: Mapping[Purpose, int] = {"score": 1, "calibration": 2}
OWN = ("pybullet",)  # who makes a bank unless others are asked for: the simulator whose scheme the model shares
RATES = (30.0, 60.0, 120.0, 240.0)  # [Hz]
UNEVEN, JITTER, MISSING = 3, 0.2, 0.1
"""One set in so many has stamps that wander by up to this share of the time between frames, and this share of the
frames missing."""


@dataclass(frozen=True)
class Plan:
    """What a bank is made from; sealed with the labels.

    Attributes:
        purpose: score or calibration; their seeds never meet.
        seed: The bank's seed.
        size: How large it is.
        simulators: Who makes the sets, dealt evenly. PyBullet alone records every step of its own; with others frame
            rates differ, and some sets have jittered stamps and lost frames.
        roles: What sets are for; all roles by default.
        least: Smallest severity of a hidden effect [standard deviations of the noise].
    """

    purpose: Purpose
    seed: int
    size: Size
    simulators: tuple[str, ...] = OWN
    roles: tuple[Role, ...] = ROLES
    least: float = 0.0

    def __post_init__(self) -> None:
        for name in self.simulators:
            find_simulator(name)
        for role in self.roles:
            if role not in ROLES:
                raise ValueError(f"roles: unknown role {quoted(role)}{nearest(role, ROLES)}")
        if not self.simulators or not self.roles:
            raise ValueError("a bank needs at least one simulator and one role")
        number(self.least, "least severity", low=0.0)

    def generator(self, *place: int) -> np.random.Generator:
        """Return the source of randomness for one place of the bank."""
        return np.random.default_rng([FAMILIES[self.purpose], self.seed, *place])


@dataclass(frozen=True)
class Recorded:
    """How a set is recorded.

    Attributes:
        simulator: Who makes its motions.
        frame_rate: Frames per second [Hz]; None for the scene's own.
        jitter: Largest share of the time between frames by which a stamp is off its place [-].
        missing: Share of the frames that are lost [-].
    """

    simulator: str = OWN[0]
    frame_rate: float | None = None
    jitter: float = 0.0
    missing: float = 0.0


@dataclass(frozen=True)
class Task:
    """One set of the bank.

    Attributes:
        name: Its name, which says nothing.
        role: What it is for.
        turn: The how many-th of its role it is.
        film: Whether it has films instead of poses.
        recorded: How it is recorded.
    """

    name: str
    role: Role
    turn: int
    film: bool = False
    recorded: Recorded = Recorded()


def tasks(plan: Plan) -> list[Task]:
    """Deal the sets of a bank out to roles, in an order that says nothing.

    A role that a simulator has nothing for goes to the catalogue. Films are of the own simulator.
    """
    turns = dict.fromkeys(ROLES, 0)
    dealt = []
    names = plan.generator(0).permutation(plan.size.sets)
    shares = {str(role): share for role, share in SHARES.items() if role in plan.roles}
    recorded = _recorded(plan)
    for place, role in zip(names, assign_splits(plan.size.sets, shares), strict=True):
        how = recorded[place]
        known = cast(Role, role)
        if not any(candidates(known, *cell, how.simulator) for cell in cells(how.simulator)):
            known = "catalogue"
        film = is_film(turns[known]) and how == Recorded()
        dealt.append(Task(f"{place:03d}", known, turns[known], film, how))
        turns[known] += 1
    return sorted(dealt, key=lambda task: task.name)


def _recorded(plan: Plan) -> list[Recorded]:
    """Deal simulators, frame rates and uneven stamps out to the sets of a bank, evenly and in independent orders."""
    count = plan.size.sets
    if plan.simulators == OWN:
        return [Recorded()] * count
    orders = [plan.generator(4, kind).permutation(count) for kind in range(3)]
    made = []
    for who, rate, uneven in zip(*orders, strict=True):
        wanders = uneven % UNEVEN == 0
        simulator = plan.simulators[who % len(plan.simulators)]
        made.append(
            Recorded(simulator, RATES[rate % len(RATES)], JITTER if wanders else 0.0, MISSING if wanders else 0.0)
        )
    return made


def simulators_of(text: str) -> tuple[str, ...]:
    """Read simulators from names with commas between them, or `all`."""
    return tuple(one.name for one in SIMULATORS) if text == "all" else tuple(_names(text))


def roles_of(text: str) -> tuple[Role, ...]:
    """Read roles from names with commas between them; all for `all`, and where there is none."""
    return ROLES if text.strip() in ("", "all") else cast(tuple[Role, ...], tuple(_names(text)))


def _names(text: str) -> list[str]:
    """Split names at commas."""
    return [name.strip() for name in text.split(",") if name.strip()]
