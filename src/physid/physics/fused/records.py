"""How many bodies a kernel is for, and where its records lie in memory."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

from physid.compiler.emit import LANES
from physid.compiler.section import Layout
from physid.physics.fused.formulas.layouts import (
    BLOCK,
    BODY,
    CONSTANTS,
    CONTACT,
    EFFECTS,
    GIVEN,
    GIVEN_SHARED,
    IMPULSE,
    LANE,
    MOTION,
    OUTCOME,
    PATCH,
    SHARED,
)  # fmt: skip

STATE = 13
SOLVED = 42  # z, w, modes of a patch
CHOSEN = 2  # compliance, touches of a lane


@dataclass(frozen=True)
class Shape:
    """What a kernel is compiled for.

    Attributes:
        bodies: N.
        ground: Whether there is a ground.
        split: Whether overlaps are removed without velocity, by a second problem.
        midpoint: Whether poses move with the mean velocity.
    """

    bodies: int
    ground: bool
    split: bool = False
    midpoint: bool = False

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Bodies that may touch."""
        return list(combinations(range(self.bodies), 2))

    @property
    def grounds(self) -> int:
        """Number of patches between a body and the ground."""
        return self.bodies if self.ground else 0

    @property
    def patches(self) -> int:
        """Number of all patches."""
        return self.grounds + len(self.pairs)

    def beside(self, body: int) -> list[int]:
        """Numbers of the patches between a body and others."""
        return [self.grounds + k for k, pair in enumerate(self.pairs) if body in pair]

    @property
    def touching(self) -> list[tuple[int, list[int]]]:
        """Every patch with its bodies; of a pair, the second body comes first."""
        grounds = [(n, [n]) for n in range(self.grounds)]
        return grounds + [(self.grounds + k, [b, a]) for k, (a, b) in enumerate(self.pairs)]

    @property
    def problems(self) -> list[str]:
        """Suffixes of the records of each contact problem in a step."""
        return ["", "_lifted"] if self.split else [""]

    @property
    def tape(self) -> int:
        """Slots that the derivative needs of one step."""
        solution = 6 * self.bodies + SOLVED * self.patches + CHOSEN
        return STATE * self.bodies + solution * len(self.problems)

    @property
    def memory(self) -> int:
        """Slots from which the next step starts: the solution, what its contacts are, and whether there is one."""
        return (6 * self.bodies + (SOLVED + 4) * self.patches + 1) * len(self.problems)

    @cached_property
    def records(self) -> dict[str, tuple[int, Layout]]:
        """Where each record begins in the workspace, in slots."""
        n, p = self.bodies, self.patches
        layouts = {"constants": CONSTANTS, "outcome": OUTCOME, "shared": SHARED, "shared_bar": SHARED}
        layouts |= {"given_shared": GIVEN_SHARED, "given_shared_bar": GIVEN_SHARED}
        layouts |= {"effects": EFFECTS, "effects_bar": EFFECTS}
        for k in range(n):
            layouts |= {f"motion{k}": MOTION, f"given{k}": GIVEN, f"given{k}_bar": GIVEN}
        for suffix in self.problems:
            layouts[f"lane{suffix}"] = LANE
            for k in range(n):
                layouts |= {f"body{k}{suffix}": BODY, f"body{k}{suffix}_bar": BODY}
            for k in range(max(p, n)):  # a pair without ground still names the patches of its bodies
                layouts |= {f"patch{k}{suffix}": PATCH, f"patch{k}{suffix}_bar": PATCH, f"contact{k}{suffix}": CONTACT}
        pressed = ("pressed", "pressed_bar") if self.midpoint else ()
        for name in ("impulse", "impulse_bar", *pressed):
            layouts |= {f"{name}{k}": IMPULSE for k in range(p)}
        layouts |= {f"block{i}{j}": BLOCK for i in range(n) for j in range(n)}
        places, slots = {}, 0
        for name, layout in layouts.items():
            places[name] = (slots, layout)
            slots += layout.slots
        places["end"] = (slots, Layout())
        return places

    @property
    def workspace(self) -> int:
        """Number of doubles of the workspace of one thread."""
        return self.records["end"][0] * LANES
