"""The compiled formulas on numbers: each operation done by torch, so that none of them has to be compiled."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch
from torch import Tensor

from physid.compiler.graph import Graph, Operation, Value
from physid.compiler.section import Layout, Record, Section
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.fused.formulas.layouts import CONSTANTS
from physid.physics.fused.packing import constants_of, shape_of
from physid.physics.world import World

Fields = dict[str, Tensor]
"""A record of a batch: its fields by name, shape (B, width) each."""

OPERATIONS: dict[str, Callable[..., Tensor]] = {
    "+": torch.add,
    "-": torch.sub,
    "*": torch.mul,
    "/": torch.div,
    "neg": torch.neg,
    "root": torch.sqrt,
    "<": torch.lt,
    "<=": torch.le,
    "==": torch.eq,
    "and": torch.logical_and,
    "or": torch.logical_or,
    "not": torch.logical_not,
    "where": torch.where,
    "stop": torch.Tensor.detach,
}


def numbers(graph: Graph, read: Callable[[Operation], Tensor]) -> list[Tensor]:
    """Return what each operation of a graph gives, where `read` knows what lies in memory."""
    found: list[Tensor] = []
    for operation in graph.operations:
        if operation.name == "const":
            found.append(torch.tensor(operation.number, dtype=torch.float64))
        elif operation.name == "load":
            found.append(read(operation))
        else:
            found.append(OPERATIONS[operation.name](*(found[k] for k in operation.arguments)))
    return found


def evaluate(formula: Callable[[list[Value]], list[Value]], x: Tensor) -> Tensor:
    """Return what a formula makes of numbers x (B, n)."""
    graph = Graph()
    wanted = formula([graph.load("x", k) for k in range(x.shape[1])])
    found = numbers(graph, lambda operation: x[:, operation.slot])
    return torch.stack([found[value.index].expand(len(x)) for value in wanted], 1)


def run(formula: Callable[..., None], layouts: Mapping[str, Layout], given: Mapping[str, Fields]) -> dict[str, Fields]:
    """Return the records after a formula between them, in the order of the layouts; a field that is not given is 0."""
    graph = Graph()
    records = [Record(graph, name, layout) for name, layout in layouts.items()]
    formula(*records)
    batch = max(len(value) for fields in given.values() for value in fields.values())
    zero = torch.zeros(batch, dtype=torch.float64)

    def place(layout: Layout, slot: int) -> tuple[str, int]:
        field = next(name for name, first in layout.offsets.items() if first <= slot < first + layout.widths[name])
        return field, slot - layout.offsets[field]

    def read(operation: Operation) -> Tensor:
        field, column = place(layouts[operation.record], operation.slot)
        value = given.get(operation.record, {}).get(field)
        return zero if value is None else value[:, column].expand(batch)

    found = numbers(graph, read)
    after: dict[str, Fields] = {name: dict(given.get(name, {})) for name in layouts}
    for record in records:
        for slot, value in record.written.items():
            field, column = place(record.layout, slot)
            width = record.layout.widths[field]
            old = after[record.name].get(field, zero[:, None].expand(batch, width))
            columns = list(old.expand(batch, width).unbind(1))
            columns[column] = found[value.index].expand(batch)
            after[record.name][field] = torch.stack(columns, 1)
    return after


class Records:
    """The records of a batch of worlds, between which sections of the compiled engine are run one after the other."""

    def __init__(self, **records: Fields) -> None:
        self.of: dict[str, Fields] = records

    def call(self, section: Section, *names: str) -> None:
        """Run a section on some of the records."""
        given = {own: self.of.get(name, {}) for own, name in zip(section.layouts, names, strict=True)}
        after = run(section.formula, section.layouts, given)
        for own, name in zip(section.layouts, names, strict=True):
            self.of[name] = after[own]


def constants(world: World, bodies: int = 1, settings: SolverSettings | None = None) -> Fields:
    """Return what every step of a world takes, with a batch axis of length 1."""
    row = constants_of(world, settings or SolverSettings(), shape_of(world, bodies))[:, 0]
    widths = CONSTANTS.widths
    parts = row.split(list(widths.values()))
    return {name: part[None] for name, part in zip(widths, parts, strict=True)}
