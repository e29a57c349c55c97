"""Recorded formulas as LLVM code that computes them for LANES worlds at once."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import llvmlite.binding as llvm

from physid.compiler.graph import MASKS, Graph

LANES = 8 if llvm.get_host_cpu_features().get("avx512f", False) else 4
"""Worlds that are computed at once: one register of AVX-512, one of AVX2, or two of SSE and NEON.

With eight in two registers of AVX2 each, of which there are half as many, a rollout takes 1.5 to 1.9 times as long
(docs/performance.md).
"""

ALIGNMENT = 8 * LANES
"""Of a vector [bytes]."""

VECTOR = f"<{LANES} x double>"
TRUTH = f"<{LANES} x i1>"

_ARITHMETIC = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
_COMPARISON = {"<": "olt", "<=": "ole", "==": "oeq"}
_INTRINSIC = {"root": "sqrt", "exp": "exp", "log": "log", "sin": "sin", "cos": "cos"}

DECLARATIONS = "\n".join(f"declare {VECTOR} @llvm.{name}.v{LANES}f64({VECTOR})" for name in sorted(_INTRINSIC.values()))
"""Of the functions that a module with formulas may call."""


def function(name: str, records: Sequence[str], graph: Graph, stores: Sequence[tuple[str, int, int]]) -> str:
    """Write a function of one pointer per record that computes and stores what `stores` (record, slot, index) names.

    Products and sums may be contracted; nothing else may be rearranged, so that results do not depend on the machine
    by more than rounding.
    """
    lines = [f"define internal void @{name}({', '.join(f'ptr %{record}' for record in records)}) {{"]
    needed = _needed(graph, [index for _, _, index in stores])
    for index, operation in enumerate(graph.operations):
        if needed[index] and operation.name != "const":
            lines += _instruction(graph, index)
    for k, (record, slot, index) in enumerate(stores):
        lines.append(f"  %s{k} = getelementptr double, ptr %{record}, i64 {slot * LANES}")
        lines.append(f"  store {VECTOR} {_operand(graph, index)}, ptr %s{k}, align {ALIGNMENT}")
    return "\n".join([*lines, "  ret void", "}", ""])


def constant(number: float) -> str:
    """Write a number as LLVM does, in all lanes."""
    bits = struct.unpack("<Q", struct.pack("<d", number))[0]
    return "<" + ", ".join([f"double 0x{bits:016X}"] * LANES) + ">"


def _needed(graph: Graph, roots: Sequence[int]) -> list[bool]:
    needed = [False] * len(graph.operations)
    for root in roots:
        needed[root] = True
    for index in range(len(needed) - 1, -1, -1):
        if needed[index]:
            for argument in graph.operations[index].arguments:
                needed[argument] = True
    return needed


def _operand(graph: Graph, index: int) -> str:
    number = graph.number(index)
    return f"%v{index}" if number is None else constant(number)


def _instruction(graph: Graph, index: int) -> list[str]:
    operation = graph.operations[index]
    name, out = operation.name, f"  %v{index} = "
    if name == "load":
        address = f"  %p{index} = getelementptr double, ptr %{operation.record}, i64 {operation.slot * LANES}"
        return [address, f"{out}load {VECTOR}, ptr %p{index}, align {ALIGNMENT}"]
    values = [_operand(graph, argument) for argument in operation.arguments]
    if name in _ARITHMETIC:
        return [f"{out}{_ARITHMETIC[name]} contract {VECTOR} {values[0]}, {values[1]}"]
    if name in _COMPARISON:
        return [f"{out}fcmp {_COMPARISON[name]} {VECTOR} {values[0]}, {values[1]}"]
    if name in _INTRINSIC:
        return [f"{out}call {VECTOR} @llvm.{_INTRINSIC[name]}.v{LANES}f64({VECTOR} {values[0]})"]
    match name:
        case "neg":
            return [f"{out}fneg {VECTOR} {values[0]}"]
        case "and" | "or":
            return [f"{out}{name} {TRUTH} {values[0]}, {values[1]}"]
        case "not":
            return [f"{out}xor {TRUTH} {values[0]}, <{', '.join(['i1 true'] * LANES)}>"]
        case "where":
            kind = TRUTH if graph.operations[operation.arguments[1]].name in MASKS else VECTOR
            return [f"{out}select {TRUTH} {values[0]}, {kind} {values[1]}, {kind} {values[2]}"]
        case "stop":
            return [f"{out}fadd {VECTOR} {values[0]}, {constant(-0.0)}"]
    raise ValueError(f"no instruction for {name}")
