"""Effects in machine code: their torch formulas recorded once, and called by the kernels before each step."""

from __future__ import annotations

import dataclasses
import hashlib
import logging
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import torch
from torch import Tensor

from physid.compiler.emit import DECLARATIONS, LANES
from physid.compiler.machine import address
from physid.compiler.section import Section
from physid.compiler.traced import TracingError
from physid.physics.case import Case
from physid.physics.effect import Effect
from physid.physics.fused.effect_formulas import SIZES, section_of
from physid.physics.fused.records import Shape


@dataclass(frozen=True)
class CompiledEffects:
    """The effects of a rollout as two functions of the workspace of a kernel.

    Attributes:
        section: From what is given, and the state, to the inputs of a step.
        shape: What the kernels are compiled for.
    """

    section: Section
    shape: Shape

    @cached_property
    def forward(self) -> int:
        """Where the function begins that works out the inputs of a step."""
        return self._load("effects", self.section.forward(), tuple(self.section.layouts))

    @cached_property
    def adjoint(self) -> int:
        """Where the function begins that adds its reverse derivative."""
        records = tuple(self.section.layouts)
        bars = tuple(name if name == "constants" else f"{name}_bar" for name in records)
        return self._load("effects_adjoint", self.section.adjoint(), records + bars)

    def _load(self, function: str, text: str, records: Sequence[str]) -> int:
        """Compile a function that calls one of records with their places in the workspace."""
        lines = [DECLARATIONS, text, "define void @NAME(ptr %workspace) {"]
        for k, record in enumerate(records):
            lines.append(f"  %r{k} = getelementptr double, ptr %workspace, i64 {self.shape.records[record][0] * LANES}")
        lines.append(f"  call void @{function}({', '.join(f'ptr %r{k}' for k in range(len(records)))})")
        code = "\n".join([*lines, "  ret void", "}", ""])
        name = f"{function}_{hashlib.sha256(code.encode()).hexdigest()[:16]}"
        return address(name, lambda: code.replace("@NAME", f"@{name}"))


class Acting(NamedTuple):
    """Effects on the steps of a rollout.

    Attributes:
        code: Their formulas.
        clock: Time at which forces are taken in each step of the engine [s], shape (B or 1, T substeps).
        sizes: Their parameters (see `sizes_of`), shape (B or 1, SIZES).
    """

    code: CompiledEffects
    clock: Tensor
    sizes: Tensor


def compile_effects(case: Case, shape: Shape) -> CompiledEffects | None:
    """Compile what the effects of a case do to steps; None if one does what cannot be compiled.

    A formula that looks at a value, by `if`, float() or the like, is one of many formulas and is not compiled; nor is
    one that calls a function of torch without a rule (see `physid.compiler.traced`).
    """
    try:
        key = shape, case.world.shapes, tuple(_identity(effect) for effect in case.effects)
    except TracingError as error:
        _say(case, error)
        return None
    if key not in _KNOWN:
        _KNOWN[key] = _compile(case, shape)
    return _KNOWN[key]


_KNOWN: dict[Hashable, CompiledEffects | None] = {}


def sizes_of(effects: Sequence[Effect]) -> Tensor:
    """Return the parameters of effects as a kernel reads them, shape (B or 1, SIZES)."""
    values = [value for effect in effects for value in effect.values().values()]
    worlds = max(len(value) for value in values)
    row = torch.stack([value.expand(worlds) for value in values], 1)
    return torch.nn.functional.pad(row, (0, SIZES - row.shape[1])).contiguous()


def _compile(case: Case, shape: Shape) -> CompiledEffects | None:
    compiled = CompiledEffects(section_of(case.effects, case.world.shapes, shape), shape)
    try:
        _ = compiled.forward
    except (TracingError, RuntimeError, NotImplementedError, TypeError, ValueError, IndexError) as error:
        # Whatever torch says of tensors without numbers: in torch itself the formula runs, or shows what is wrong.
        _say(case, error)
        return None
    return compiled


def _say(case: Case, error: Exception) -> None:
    """Warn, once for each reason, that effects run in torch."""
    _say_once(", ".join(effect.name for effect in case.effects), str(error).split("\n", 1)[0])


@lru_cache
def _say_once(names: str, reason: str) -> None:
    logging.getLogger(__name__).warning(
        "what %s does is worked out by torch in every step, which is slower, for it cannot be compiled: %s",
        names,
        reason,
    )


def _identity(effect: Effect) -> Hashable:
    """Return what an effect's formula is given by, beside its parameters.

    Raises:
        TracingError: If that cannot be determined.
    """
    own: list[Any] = []
    for field in dataclasses.fields(effect):
        if "quantity" not in field.metadata:
            value = getattr(effect, field.name)
            own.append(_identity(value) if isinstance(value, Effect) else value)
            if isinstance(value, Tensor) or not isinstance(value, Hashable):
                raise TracingError(f"{effect.name}.{field.name} is none of its parameters, and has no hash")
    return type(effect), type(effect).act, tuple(own)
