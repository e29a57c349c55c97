"""What a bank is made from, and which sets it has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np

from physid.benchmark.bank import Purpose, Size
from physid.benchmark.films import is_film
from physid.benchmark.sealing.hidden import ROLES, SHARES, Role
from physid.data.batches.splits import assign_splits

FAMILIES: Mapping[Purpose, int] = {"score": 1, "calibration": 2}


@dataclass(frozen=True)
class Plan:
    """What a bank is made from; sealed with the labels.

    Attributes:
        purpose: score or calibration; their seeds never meet.
        seed: The bank's seed.
        size: How large it is.
    """

    purpose: Purpose
    seed: int
    size: Size

    def generator(self, *place: int) -> np.random.Generator:
        """Return the source of randomness for one place of the bank."""
        return np.random.default_rng([FAMILIES[self.purpose], self.seed, *place])


@dataclass(frozen=True)
class Task:
    """One set of the bank.

    Attributes:
        name: Its name, which says nothing.
        role: What it is for.
        turn: The how many-th of its role it is.
        film: Whether it has films instead of poses.
    """

    name: str
    role: Role
    turn: int
    film: bool = False


def tasks(plan: Plan) -> list[Task]:
    """Deal the sets of a bank out to roles, in an order that says nothing."""
    turns = dict.fromkeys(ROLES, 0)
    dealt = []
    names = plan.generator(0).permutation(plan.size.sets)
    shares = {str(role): share for role, share in SHARES.items()}
    for number, role in zip(names, assign_splits(plan.size.sets, shares), strict=True):
        known = cast(Role, role)
        dealt.append(Task(f"{number:03d}", known, turns[known], is_film(turns[known])))
        turns[known] += 1
    return sorted(dealt, key=lambda task: task.name)
