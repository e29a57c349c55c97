"""Reverse derivatives of recorded formulas."""

from __future__ import annotations

from collections.abc import Mapping

from physid.compiler.graph import Graph, Operation, Value, cosine, sine, where


def pull_back(graph: Graph, seeds: Mapping[int, Value]) -> dict[int, Value]:
    """Extend a graph by the derivative of what it computes.

    Args:
        graph: Operations recorded so far.
        seeds: The derivative of the outcome by some of them, by index.

    Returns:
        The derivative of the outcome by every slot loaded that it depends on, by index. What a `stop` returns counts
        as constant, and so does every comparison.
    """
    bars: dict[int, Value] = dict(seeds)
    for index in range(max(seeds, default=-1), -1, -1):
        operation = graph.operations[index]
        if index not in bars or operation.name in ("load", "const", "stop"):
            continue
        terms = _terms(graph, index, operation, bars[index])
        for argument, term in zip(operation.arguments, terms, strict=True):
            if term is not None and term.number != 0 and graph.number(argument) is None:
                bars[argument] = bars[argument] + term if argument in bars else term
    return {index: bar for index, bar in bars.items() if graph.operations[index].name == "load"}


def slopes(outcome: Value) -> dict[tuple[str, int], Value]:
    """Return the derivative of a number by every slot (record, slot) that it depends on."""
    graph = outcome.graph
    by_index = pull_back(graph, {outcome.index: graph.constant(1.0)})
    return {(graph.operations[i].record, graph.operations[i].slot): bar for i, bar in by_index.items()}


def _terms(graph: Graph, index: int, operation: Operation, bar: Value) -> list[Value | None]:
    """Return bar times the partial derivatives of one operation by its arguments."""
    values = [Value(graph, argument) for argument in operation.arguments]
    match operation.name:
        case "+":
            return [bar, bar]
        case "-":
            return [bar, -bar]
        case "*":
            return [bar * values[1], bar * values[0]]
        case "/":
            share = bar / values[1]
            return [share, -(share * Value(graph, index))]
        case "neg":
            return [-bar]
        case "root":
            return [0.5 * bar / Value(graph, index)]
        case "exp":
            return [bar * Value(graph, index)]
        case "log":
            return [bar / values[0]]
        case "sin":
            return [bar * cosine(values[0])]
        case "cos":
            return [-(bar * sine(values[0]))]
        case "where":
            return [None, where(values[0], bar, 0.0), where(values[0], 0.0, bar)]
    raise ValueError(f"no derivative of {operation.name}")
