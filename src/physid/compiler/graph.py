"""Formulas as graphs: write a formula once in scalars, get machine code of its value and of its derivative.

A formula is ordinary Python on `Value`s. Running it once records its operations, without numbers; `emit` turns the
record into instructions for several worlds at once, `adjoint` extends it by its reverse derivative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

COMPARISONS = frozenset({"<", "<=", "=="})
MASKS = COMPARISONS | {"and", "or", "not"}
"""Operations whose result is a truth value."""


class Operation(NamedTuple):
    """A recorded operation: "const" with a number, "load" with a place, or a name with arguments."""

    name: str
    arguments: tuple[int, ...] = ()  # indices of earlier operations
    number: float = 0.0
    record: str = ""
    slot: int = 0


class Graph:
    """Operations in the order in which they were first met; equal operations are recorded once."""

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self._index: dict[Operation, int] = {}

    def value(self, operation: Operation) -> Value:
        """Record an operation."""
        index = self._index.get(operation)
        if index is None:
            index = self._index[operation] = len(self.operations)
            self.operations.append(operation)
        return Value(self, index)

    def constant(self, number: float) -> Value:
        """Record a number."""
        return self.value(Operation("const", number=float(number)))

    def load(self, record: str, slot: int) -> Value:
        """Record the reading of a slot of a record."""
        return self.value(Operation("load", record=record, slot=slot))

    def of(self, name: str, *arguments: Value) -> Value:
        """Record an operation on values."""
        return self.value(Operation(name, tuple(argument.index for argument in arguments)))

    def number(self, index: int) -> float | None:
        """Return the number that an operation is, or None if it is not constant."""
        operation = self.operations[index]
        return operation.number if operation.name == "const" else None


@dataclass(frozen=True, eq=False)
class Value:
    """The result of a recorded operation: a number or a truth value per world."""

    graph: Graph
    index: int

    @property
    def operation(self) -> Operation:
        """What was recorded."""
        return self.graph.operations[self.index]

    @property
    def number(self) -> float | None:
        """The number, if it is constant."""
        return self.graph.number(self.index)

    def like(self, other: Value | float) -> Value:
        """Return a number as a value of the same graph."""
        return other if isinstance(other, Value) else self.graph.constant(other)

    def _sorted(self, name: str, other: Value) -> Value:
        first, second = sorted((self, other), key=lambda value: value.index)
        return self.graph.of(name, first, second)

    def __add__(self, other: Value | float) -> Value:
        other = self.like(other)
        a, b = self.number, other.number
        if a is not None and b is not None:
            return self.graph.constant(a + b)
        if a == 0:
            return other
        if b == 0:
            return self
        if other.operation.name == "neg":
            return self - -other
        if self.operation.name == "neg":
            return other - -self
        return self._sorted("+", other)

    def __sub__(self, other: Value | float) -> Value:
        other = self.like(other)
        a, b = self.number, other.number
        if a is not None and b is not None:
            return self.graph.constant(a - b)
        if a == 0:
            return -other
        if b == 0:
            return self
        if other.operation.name == "neg":
            return self + -other
        return self.graph.of("-", self, other)

    def __mul__(self, other: Value | float) -> Value:
        other = self.like(other)
        for one, two in ((self, other), (other, self)):
            number = one.number
            if number is not None and two.number is not None:
                return self.graph.constant(number * two.number)
            if number == 0:
                return one
            if number == 1:
                return two
            if number == -1:
                return -two
            if one.operation.name == "neg":
                return -(-one * two)
        return self._sorted("*", other)

    def __truediv__(self, other: Value | float) -> Value:
        other = self.like(other)
        if other.number is not None:
            return self * (1 / other.number)
        return self if self.number == 0 else self.graph.of("/", self, other)

    def __neg__(self) -> Value:
        if self.number is not None:
            return self.graph.constant(-self.number)
        if self.operation.name == "neg":
            return Value(self.graph, self.operation.arguments[0])
        return self.graph.of("neg", self)

    def __radd__(self, other: float) -> Value:
        return self + other

    def __rsub__(self, other: float) -> Value:
        return self.like(other) - self

    def __rmul__(self, other: float) -> Value:
        return self * other

    def __rtruediv__(self, other: float) -> Value:
        return self.like(other) / self

    def __lt__(self, other: Value | float) -> Value:
        return self.graph.of("<", self, self.like(other))

    def __gt__(self, other: Value | float) -> Value:
        return self.graph.of("<", self.like(other), self)

    def __le__(self, other: Value | float) -> Value:
        return self.graph.of("<=", self, self.like(other))

    def __ge__(self, other: Value | float) -> Value:
        return self.graph.of("<=", self.like(other), self)

    def equals(self, other: Value | float) -> Value:
        """Compare (the operator == stays what Python needs it to be)."""
        return self.graph.of("==", self, self.like(other))

    def __and__(self, other: Value) -> Value:
        return self._sorted("and", other)

    def __or__(self, other: Value) -> Value:
        return self._sorted("or", other)

    def __invert__(self) -> Value:
        return self.graph.of("not", self)


def where(mask: Value, yes: Value | float, no: Value | float) -> Value:
    """Choose by a truth value."""
    yes, no = mask.like(yes), mask.like(no)
    return yes if yes.index == no.index else mask.graph.of("where", mask, yes, no)


def root(value: Value) -> Value:
    """Compute the square root."""
    return value.graph.of("root", value)


def exponential(value: Value) -> Value:
    """Compute e to a power."""
    return value.graph.of("exp", value)


def logarithm(value: Value) -> Value:
    """Compute the natural logarithm."""
    return value.graph.of("log", value)


def sine(value: Value) -> Value:
    """Compute the sine."""
    return value.graph.of("sin", value)


def cosine(value: Value) -> Value:
    """Compute the cosine."""
    return value.graph.of("cos", value)


def stop(value: Value) -> Value:
    """Return the value as a constant of the derivative."""
    return value.graph.of("stop", value)


def least(one: Value, other: Value | float) -> Value:
    """Return the smaller of two; its derivative goes to the first where both are equal."""
    return where(one <= other, one, other)


def most(one: Value, other: Value | float) -> Value:
    """Return the larger of two; its derivative goes to the first where both are equal."""
    return where(one >= other, one, other)


def size(value: Value) -> Value:
    """Return the absolute value."""
    return where(value < 0.0, -value, value)


def total(values: Sequence[Value]) -> Value:
    """Add up in pairs, so that the sum is not one long chain."""
    if len(values) == 1:
        return values[0]
    half = (len(values) + 1) // 2
    return total(values[:half]) + total(values[half:])
