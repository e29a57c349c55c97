"""Loops, branches and addresses around the sections, written as LLVM code."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from physid.compiler.emit import ALIGNMENT, DECLARATIONS, LANES, TRUTH, VECTOR, constant

MOVES = f"""
{DECLARATIONS}

define internal void @load_rows(ptr %to, ptr %from, i64 %width, i64 %stride, i64 %first, i64 %rows) {{
  %last = sub i64 %rows, 1
  br label %lanes
lanes:
  %lane = phi i64 [0, %0], [%lane.next, %lanes.end]
  %wanted = add i64 %first, %lane
  %there = icmp slt i64 %wanted, %rows
  %row = select i1 %there, i64 %wanted, i64 %last
  %start = mul i64 %row, %stride
  br label %slots
slots:
  %slot = phi i64 [0, %lanes], [%slot.next, %slots]
  %source = add i64 %start, %slot
  %p = getelementptr double, ptr %from, i64 %source
  %x = load double, ptr %p
  %group = mul i64 %slot, {LANES}
  %target = add i64 %group, %lane
  %q = getelementptr double, ptr %to, i64 %target
  store double %x, ptr %q
  %slot.next = add i64 %slot, 1
  %more = icmp slt i64 %slot.next, %width
  br i1 %more, label %slots, label %lanes.end
lanes.end:
  %lane.next = add i64 %lane, 1
  %again = icmp slt i64 %lane.next, {LANES}
  br i1 %again, label %lanes, label %done
done:
  ret void
}}

define internal void @store_rows(ptr %to, ptr %from, i64 %width, i64 %stride, i64 %first, i64 %rows) {{
  br label %lanes
lanes:
  %lane = phi i64 [0, %0], [%lane.next, %lanes.end]
  %row = add i64 %first, %lane
  %there = icmp slt i64 %row, %rows
  %start = mul i64 %row, %stride
  br i1 %there, label %slots, label %done
slots:
  %slot = phi i64 [0, %lanes], [%slot.next, %slots]
  %target = add i64 %start, %slot
  %q = getelementptr double, ptr %to, i64 %target
  %group = mul i64 %slot, {LANES}
  %source = add i64 %group, %lane
  %p = getelementptr double, ptr %from, i64 %source
  %x = load double, ptr %p
  store double %x, ptr %q
  %slot.next = add i64 %slot, 1
  %more = icmp slt i64 %slot.next, %width
  br i1 %more, label %slots, label %lanes.end
lanes.end:
  %lane.next = add i64 %lane, 1
  %again = icmp slt i64 %lane.next, {LANES}
  br i1 %again, label %lanes, label %done
done:
  ret void
}}
"""


def _slot_by_slot(name: str, arguments: str, lines: str) -> str:
    """Return a function that treats slot by slot what stands at %q, and at %p where it has a source."""
    source = "  %p = getelementptr double, ptr %from, i64 %place\n" if "%from" in arguments else ""
    return f"""
define internal void @{name}({arguments}, i64 %slots) {{
  br label %next
next:
  %slot = phi i64 [0, %0], [%slot.next, %next]
  %place = mul i64 %slot, {LANES}
{source}  %q = getelementptr double, ptr %to, i64 %place
{lines}
  %slot.next = add i64 %slot, 1
  %more = icmp slt i64 %slot.next, %slots
  br i1 %more, label %next, label %done
done:
  ret void
}}
"""


_LOAD = f"  %x = load {VECTOR}, ptr %p, align {ALIGNMENT}\n"
MOVES += _slot_by_slot("copy", "ptr %to, ptr %from", f"{_LOAD}  store {VECTOR} %x, ptr %q, align {ALIGNMENT}")
MOVES += _slot_by_slot(
    "add_to",
    "ptr %to, ptr %from",
    f"{_LOAD}  %y = load {VECTOR}, ptr %q, align {ALIGNMENT}\n  %z = fadd {VECTOR} %x, %y\n"
    f"  store {VECTOR} %z, ptr %q, align {ALIGNMENT}",
)
MOVES += _slot_by_slot("zero", "ptr %to", f"  store {VECTOR} {constant(0.0)}, ptr %q, align {ALIGNMENT}")


class Code:
    """The body of a function `void (ptr arguments, i64 first, i64 last, ptr workspace)`, written line by line."""

    def __init__(self, name: str, arguments: tuple[str, ...]) -> None:
        self.lines = [f"define void @{name}(ptr %arguments, i64 %first, i64 %last, ptr %workspace) {{", "start:"]
        self._block, self._count, self._arguments = "start", 0, arguments

    def _fresh(self) -> str:
        self._count += 1
        return f"%t{self._count}"

    def _label(self, label: str) -> None:
        self.lines.append(f"{label}:")
        self._block = label

    def emit(self, instruction: str) -> str:
        """Write an instruction and return the name of its result."""
        name = self._fresh()
        self.lines.append(f"  {name} = {instruction}")
        return name

    def argument(self, name: str, kind: str = "i64") -> str:
        """Read an argument: a pointer or a number."""
        place = self.emit(f"getelementptr i64, ptr %arguments, i64 {self._arguments.index(name)}")
        return self.emit(f"load {kind}, ptr {place}")

    def add(self, a: str | int, b: str | int) -> str:
        """Add numbers."""
        return self.emit(f"add i64 {a}, {b}")

    def multiply(self, a: str | int, b: str | int) -> str:
        """Multiply numbers."""
        return self.emit(f"mul i64 {a}, {b}")

    def at(self, base: str, doubles: str | int) -> str:
        """Return the address so many doubles further."""
        return self.emit(f"getelementptr double, ptr {base}, i64 {doubles}")

    def call(self, function: str, *arguments: str) -> None:
        """Call a function; arguments that are not addresses come as "i64 ..."."""
        typed = [argument if " " in argument else f"ptr {argument}" for argument in arguments]
        self.lines.append(f"  call void @{function}({', '.join(typed)})")

    def any(self, flag: str) -> str:
        """Return whether a flag (1 or 0) in memory is set in any lane."""
        value = self.emit(f"load {VECTOR}, ptr {flag}, align {ALIGNMENT}")
        mask = self.emit(f"fcmp ogt {VECTOR} {value}, {constant(0.5)}")
        bits = self.emit(f"bitcast {TRUTH} {mask} to i{LANES}")
        return self.emit(f"icmp ne i{LANES} {bits}, 0")

    def positive(self, number: str) -> str:
        """Return whether a number is above 0."""
        return self.emit(f"icmp sgt i64 {number}, 0")

    @contextmanager
    def loop(self, start: str | int, end: str | int) -> Iterator[str]:
        """Repeat with a counter from `start` below `end`."""
        self._count += 1
        k, before = self._count, self._block
        self.lines.append(f"  br label %head{k}")
        self._label(f"head{k}")
        self.lines.append(f"  %i{k} = phi i64 [{start}, %{before}], [%n{k}, %latch{k}]")
        self.lines.append(f"  %c{k} = icmp slt i64 %i{k}, {end}")
        self.lines.append(f"  br i1 %c{k}, label %body{k}, label %end{k}")
        self._label(f"body{k}")
        yield f"%i{k}"
        self.lines.append(f"  br label %latch{k}")
        self._label(f"latch{k}")
        self.lines.append(f"  %n{k} = add i64 %i{k}, 1")
        self.lines.append(f"  br label %head{k}")
        self._label(f"end{k}")

    @contextmanager
    def when(self, condition: str) -> Iterator[None]:
        """Do it only if a condition holds."""
        self._count += 1
        k = self._count
        self.lines.append(f"  br i1 {condition}, label %then{k}, label %after{k}")
        self._label(f"then{k}")
        yield
        self.lines.append(f"  br label %after{k}")
        self._label(f"after{k}")

    @contextmanager
    def repeat(self) -> Iterator[str]:
        """Repeat until `leave`; yields what to leave."""
        self._count += 1
        k = self._count
        self.lines.append(f"  br label %again{k}")
        self._label(f"again{k}")
        yield f"left{k}"
        self.lines.append(f"  br label %again{k}")
        self._label(f"left{k}")

    def leave(self, what: str, condition: str) -> None:
        """Leave a `repeat` if a condition does not hold."""
        self._count += 1
        k = self._count
        self.lines.append(f"  br i1 {condition}, label %stay{k}, label %{what}")
        self._label(f"stay{k}")

    def text(self) -> str:
        """Return the function."""
        return "\n".join([*self.lines, "  ret void", "}", ""])
