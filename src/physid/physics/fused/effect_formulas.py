"""What effects do to one step of one world, recorded from their torch formulas."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physid.compiler.section import Layout, Record, Section
from physid.compiler.traced import Traced, TracingError, elements, loads
from physid.physics.effect import Effect, StepInputs, widths_of
from physid.physics.fused.formulas.layouts import (
    BODY,
    CONSTANTS,
    EFFECTS,
    GIVEN,
    GIVEN_SHARED,
    OF_BODY,
    OF_WORLD,
    SHARED,
)
from physid.physics.fused.records import Shape
from physid.physics.schemes.motion import acting
from physid.physics.shapes.shape import Shape as BodyShape
from physid.physics.state import State

SIZES = EFFECTS.widths["sizes"]
"""Parameters of effects that a kernel has room for."""


def section_of(effects: Sequence[Effect], shapes: tuple[BodyShape, ...], shape: Shape) -> Section:
    """Return the section that makes the inputs of a step from what is given and the state; it raises `TracingError`."""
    bodies = range(shape.bodies)
    layouts = {f"given{k}": GIVEN for k in bodies} | {f"body{k}": BODY for k in bodies}
    layouts |= {"given_shared": GIVEN_SHARED, "shared": SHARED, "effects": EFFECTS, "constants": CONSTANTS}

    def formula(*records: Record) -> None:
        _act(effects, shapes, shape, dict(zip(layouts, records, strict=True)))

    return Section("effects", formula, layouts)


@torch.inference_mode(False)  # there torch does not say of which operations others, such as pad, consist
def _act(effects: Sequence[Effect], shapes: tuple[BodyShape, ...], shape: Shape, records: dict[str, Record]) -> None:
    """Record what effects do to one step of one world."""
    graph = records["effects"].graph

    def read(record: str, layout: Layout, field: str, width: int) -> Traced:
        return loads(graph, record, layout.offsets[field], (width,) if width > 1 else ())

    def of_bodies(record: str, layout: Layout, field: str, width: int) -> Tensor:
        return torch.stack([read(f"{record}{k}", layout, field, width) for k in range(shape.bodies)])[None]

    start = "start_" if shape.midpoint else ""
    pose, twist = (of_bodies("body", BODY, f"{start}{name}", width) for name, width in (("pose", 7), ("twist", 6)))
    state: State = State(pose, twist)
    half = read("constants", CONSTANTS, "step", 1)[None] / 2
    state = acting(state, half if shape.midpoint else None)
    given: dict[str, Tensor] = {name: of_bodies("given", GIVEN, name, width) for name, width in OF_BODY.items()}
    given |= {name: read("given_shared", GIVEN_SHARED, name, width) for name, width in widths_of("ground").items()}
    given |= {name: read("given_shared", GIVEN_SHARED, name, width)[None] for name, width in widths_of("world").items()}
    given |= {"wrench": of_bodies("given", GIVEN, "wrench", 6)}
    given |= {"time": read("effects", EFFECTS, "clock", 1)[None]}
    inputs, slot = StepInputs(**given, shapes=shapes), EFFECTS.offsets["sizes"]
    for effect in effects:
        names = list(effect.values())
        sizes = {name: loads(graph, "effects", slot + k, (1,)) for k, name in enumerate(names)}
        slot += len(names)
        if slot > EFFECTS.offsets["sizes"] + SIZES:
            raise TracingError(f"there is room for {SIZES} parameters of effects")
        inputs = effect.replace(**sizes).act(state, inputs)
    for name, width in (OF_BODY | {"wrench": 6}).items():
        values = elements(getattr(inputs, name), graph, (1, shape.bodies, *((width,) if width > 1 else ())))
        for k in range(shape.bodies):
            records[f"body{k}"][name] = values[k * width : (k + 1) * width]
    for name, width in OF_WORLD.items():
        value = getattr(inputs, name)
        records["shared"][name] = elements(value.reshape(-1), graph, (width,))
