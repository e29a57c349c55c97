"""What is missing as effects: a file that a diagnosis takes, and from which a user writes a formula."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from textwrap import fill, indent

from torch import Tensor

from physid.diagnosis.document.residual_law import ResidualLaw
from physid.diagnosis.document.residual_sentences import law_phrase
from physid.pages.numbers import capital
from physid.strict import one_line

DIGITS, FINE, WIDTH = 6, 12, 110
HEAD = '''"""What a diagnosis says is missing, as effects: measured tables, to be replaced by formulas of your own.

    physid diagnose RECORDINGS --effects {place} --out runs/diagnosis/tried

fits how much of each is at work, and says whether it explains the gap; a --transfer set shows whether it holds in other
motions, too. docs/adding_an_effect.md says how effects are written, and used. Copy this file before you change it: the
next diagnosis into this folder replaces it.
"""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.effects.motion import across, course, course_from_body, from_origin, piecewise, unit
from physid.effects.touch import touching
from physid.physics import Effect, Site, State, StepInputs, quantity

GROUND = torch.tensor({ground}, dtype=torch.float64)
"""Axes of the ground as rows; the last is its normal."""
STILL = {still}
"""[m/s] A slower body moves in no direction."""
'''
CLASS = '''

@final
@dataclass(frozen=True)
class {name}(Effect):
    """{formula}, f piecewise linear.

{said}

    Attributes:
        scale: s, 1 for what was measured.
    """

    name: ClassVar[str] = "{word}"
    site: ClassVar[Site] = "{site}"
    at: ClassVar[tuple[float, ...]] = {at}  # {variable}
    size: ClassVar[tuple[float, ...]] = {size}  # [{unit}]
    scale: Tensor = quantity("-", low=0.0, high=3.0, typical=1.0)
'''
ACT = '''
    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add it."""
        ground = GROUND.to(state.position.device)
        size = self.scale[:, None] * piecewise({value}, self.at, self.size){where}
        return inputs.add_{kind}(size[..., None] * {way})
'''
OBSERVE = '''
    def observe(self, pose: Tensor, time: Tensor) -> Tensor:
        """Shift it."""
        place, ground = pose[..., :3], GROUND.to(pose.device)
        size = self.scale[:, None, None] * piecewise({value}, self.at, self.size)
        return torch.cat([place + size[..., None] * {way}, pose[..., 3:]], -1)
'''
AXES = {"along x": "ground[0]", "along y": "ground[1]", "along z": "ground[2]"}
WAYS = AXES | {
    "along the velocity": "unit(state.velocity, STILL)",
    "across the velocity": "across(state.velocity, ground[2], STILL)",
    "along the command": "unit(inputs.wrench[..., 3:])",
    "across the command": "across(inputs.wrench[..., 3:], ground[2])",
    "about the vertical": "ground[2]",
    "along the spin": "unit(state.angular_velocity)",
}
MOVES = "((state.velocity @ ground[:2].T).norm(dim=-1) > STILL)"
VALUES = {
    None: "0 * state.position[..., 0]",
    "x": "state.position @ ground[0]",
    "y": "state.position @ ground[1]",
    "height": "state.position @ ground[2]",
    "speed": "state.velocity.norm(dim=-1)",
    "course": "course(state.velocity, ground)",
    "course seen from the body": "course_from_body(state.quaternion, state.velocity, ground)",
    "commanded force": "inputs.wrench[..., 3:].norm(dim=-1)",
    "spin": "state.angular_velocity.norm(dim=-1)",
    "time": "inputs.time[:, None] + 0 * state.position[..., 0]",
}
SHIFTS = AXES | {"away from the origin": "from_origin(place, ground[2])"}
PLACES = {
    None: "0 * place[..., 0]",
    "x": "place @ ground[0]",
    "y": "place @ ground[1]",
    "height": "place @ ground[2]",
    "time": "time[..., None] + 0 * place[..., 0]",
}
REGIONS = {
    "everywhere": "",
    "in contact": " * touching(state, inputs)",
    "in flight": " * (1 - touching(state, inputs))",
}


def effect_file(laws: Sequence[ResidualLaw], ground: Tensor, still: float, place: str) -> str | None:
    """Write residual laws as a Python file with an effect for each.

    Args:
        laws: What is missing.
        ground: Axes of the ground as rows, shape (3, 3).
        still: Speed below which a velocity has no direction [m/s].
        place: Where the file will stand, for the command that it shows.

    Returns:
        The text; None where no law can be written so: a shift of the picture that depends on velocities.
    """
    classes = list(_classes(laws))
    if not classes:
        return None
    rows = [[round(each, FINE) for each in row] for row in ground.tolist()]
    head = HEAD.format(place=_in_docstring(shlex.quote(place)), ground=rows, still=still)
    return head + "".join(text for _, text in classes)


def _classes(laws: Sequence[ResidualLaw]) -> Iterator[tuple[str, str]]:
    """Yield the name and the text of the effect of each law."""
    kinds = list[str]()
    for law in laws:
        shifts = law.kind == "shift"
        ways, values = (SHIFTS, PLACES) if shifts else (WAYS, VALUES)
        if law.direction not in ways or law.variable not in values:
            continue
        kinds.append(law.kind)
        many = kinds.count(law.kind)
        number = str(many) if many > 1 else ""
        letter = {"force": "F", "torque": "T", "shift": "d"}[law.kind]
        depends = f"f({law.variable})" if law.variable else "f"
        region = "" if law.region == "everywhere" else f" {law.region}"
        where = REGIONS[law.region] + (
            f" * {MOVES}" if not shifts and (law.variable or "").startswith("course") else ""
        )
        head = CLASS.format(
            name=f"Missing{law.kind.capitalize()}{number}",
            formula=f"{letter} = s {depends} {law.direction}{region}",
            said=indent(fill(f"{_in_docstring(capital(law_phrase(law)))}.", WIDTH, break_long_words=False), "    "),
            word=f"missing_{law.kind}{'_' * bool(number)}{number}",
            site=_site(law),
            at=_listed(law.at),
            variable=one_line(f"{law.variable} [{law.variable_unit}]" if law.variable else "of nothing"),
            size=_listed(law.size),
            unit=one_line(law.unit),
        )
        hook = (OBSERVE if shifts else ACT).format(
            value=values[law.variable], way=ways[law.direction], where=where, kind=law.kind
        )
        yield f"Missing{law.kind.capitalize()}{number}", head + hook


def _in_docstring(text: str) -> str:
    """Return a text as a docstring can hold it: in one line, and nothing in it ends the docstring."""
    return one_line(text).replace("\\", "\\\\").replace('"', '\\"')


def _site(law: ResidualLaw) -> str:
    """Return where what acts so is made."""
    if law.kind == "shift":
        return "perception"
    if law.direction.endswith("the command") or law.variable == "commanded force":
        return "actuation"
    return "contact" if law.region == "in contact" else "dynamics"


def _listed(values: Sequence[float]) -> str:
    """Write numbers as a tuple."""
    return repr(tuple(float(f"{each:.{DIGITS}g}") for each in values))
