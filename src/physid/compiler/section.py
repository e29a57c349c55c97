"""Named records in memory, and sections of code between them: formulas with their reverse derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from physid.compiler.adjoint import pull_back
from physid.compiler.emit import function
from physid.compiler.graph import Graph, Value


class Layout:
    """Fields of a record, one after the other; a slot holds one number of each of a group of worlds.

    Args:
        constant: Fields that count as constants of every derivative.
        widths: Slots of each field.
    """

    def __init__(self, constant: Sequence[str] = (), **widths: int) -> None:
        self.widths = widths
        self.offsets: dict[str, int] = {}
        self.slots = 0
        for name, width in widths.items():
            self.offsets[name] = self.slots
            self.slots += width
        self.constant = frozenset(self.offsets[name] + k for name in constant for k in range(widths[name]))


class Record:
    """A record as a formula sees it: it reads fields, and writes fields when it is done."""

    def __init__(self, graph: Graph, name: str, layout: Layout) -> None:
        self.graph, self.name, self.layout = graph, name, layout
        self.written: dict[int, Value] = {}

    def __getitem__(self, field: str) -> list[Value]:
        first, width = self.layout.offsets[field], self.layout.widths[field]
        return [self.graph.load(self.name, first + k) for k in range(width)]

    def __setitem__(self, field: str, values: Sequence[Value | float]) -> None:
        first, width = self.layout.offsets[field], self.layout.widths[field]
        if len(values) != width:
            raise ValueError(f"{self.name}.{field} has {width} slots, got {len(values)} values")
        for k, value in enumerate(values):
            self.written[first + k] = value if isinstance(value, Value) else self.graph.constant(value)

    def one(self, field: str) -> Value:
        """Return a field of a single slot."""
        (value,) = self[field]
        return value

    def part(self, field: str, index: int, parts: int = 4) -> list[Value]:
        """Return one of so many equal parts of a field."""
        values = self[field]
        width = len(values) // parts
        return values[index * width : (index + 1) * width]


Formula = Callable[..., None]


@dataclass(frozen=True)
class Section:
    """A formula between records.

    Attributes:
        name: Name of the function in the machine code.
        formula: Called with one `Record` per layout.
        layouts: Layouts of the records, by the names of the pointers.
    """

    name: str
    formula: Formula
    layouts: Mapping[str, Layout]

    def forward(self) -> str:
        """Return code that reads, computes and writes: a function of one pointer per record."""
        graph, records = self._trace()
        stores = [(r.name, slot, value.index) for r in records for slot, value in r.written.items()]
        return function(self.name, list(self.layouts), graph, stores)

    def adjoint(self) -> str:
        """Return code that adds the reverse derivative: a function of one pointer per record and one per its adjoint.

        It reads the derivative of the outcome by what the formula writes from the adjoint records, and adds the
        derivative by what the formula reads to them.
        """
        graph, records = self._trace()
        seeds: dict[int, Value] = {}
        for record in records:
            for slot, value in record.written.items():
                seed = graph.load(f"{record.name}_bar", slot)
                seeds[value.index] = seeds[value.index] + seed if value.index in seeds else seed
        stores = []
        for index, derivative in pull_back(graph, seeds).items():
            record_name, slot = graph.operations[index].record, graph.operations[index].slot
            if slot not in self.layouts[record_name].constant:
                bar = graph.load(f"{record_name}_bar", slot) + derivative
                stores.append((f"{record_name}_bar", slot, bar.index))
        names = list(self.layouts)
        return function(f"{self.name}_adjoint", names + [f"{name}_bar" for name in names], graph, stores)

    def _trace(self) -> tuple[Graph, list[Record]]:
        graph = Graph()
        records = [Record(graph, name, layout) for name, layout in self.layouts.items()]
        self.formula(*records)
        return graph, records
