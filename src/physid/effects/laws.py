"""What every effect must obey; tested over the catalogue, and checked when a user's own effect is loaded."""

from __future__ import annotations

import dataclasses
import math
import re
from typing import get_args

import torch
from torch import Tensor

from physid.effects.probe import draw_probe
from physid.physics import Effect, Site, widths_of
from physid.physics.guards.unread import ReadError, unread

HOOKS = ("actuate", "act", "observe")
TOLERANCE = 1e-12


def check(effect: type[Effect]) -> None:
    """Check all laws of this module.

    Raises:
        ValueError: If one does not hold; the message names the effect, what was expected and what came.
    """
    declares_itself(effect)
    null_is_identity(effect)
    derivative_at_null_shows(effect)
    batch_equals_loop(effect)
    time_stays_a_tensor(effect)


def declares_itself(effect: type[Effect]) -> None:
    """Check that name, site, formula and parameters are declared, and that at least one hook is there."""
    label = effect.__name__
    own = effect.__dict__.get("__dataclass_params__")
    _require(
        own is not None and own.frozen, f"{label} must be a frozen dataclass: put @dataclass(frozen=True) above it"
    )
    name, site = getattr(effect, "name", None), getattr(effect, "site", None)
    named = isinstance(name, str) and re.fullmatch("[a-z][a-z0-9_]*", name)
    _require(named, f'{label}.name must be a word such as "viscous_drag", got {name!r}')
    _require(site in get_args(Site), f"{label}.site must be one of {', '.join(get_args(Site))}, got {site!r}")
    _require("=" in (effect.__doc__ or "").partition("\n")[0], f"the docstring of {label} must begin with its formula")
    hooks = [hook for hook in HOOKS if getattr(effect, hook) is not getattr(Effect, hook)]
    _require(hooks, f"{label} must override one of {', '.join(HOOKS)}")
    fields = dataclasses.fields(effect)
    bare = [field.name for field in fields if "quantity" not in field.metadata]
    wanted = f"{label} must declare each parameter by quantity(unit, low, high, typical)"
    _require(fields and not bare, f"{wanted}, got {', '.join(bare) or 'no parameter'}")
    for key, q in effect.quantities().items():
        _require(q.unit, f'{label}.{key} must have a unit ("-" for none)')
        inside = all(math.isfinite(x) and q.low <= x <= q.high for x in (q.null, q.typical)) and q.null != q.typical
        _require(inside, f"{label}.{key} must have a null and a typical value, apart and in its range, got {q}")


def null_is_identity(effect: type[Effect]) -> None:
    """Check that no hook changes a single bit at the null values."""
    probe = draw_probe()
    before, after = probe.untouched(), probe.show(effect())
    changed = [name for name in before if not torch.equal(before[name], after[name])]
    _require(not changed, f"{effect.name} must change nothing at its null values, but it changes {', '.join(changed)}")


def derivative_at_null_shows(effect: type[Effect]) -> None:
    """Check that the derivative by each parameter at the null values is finite, and not zero everywhere."""
    probe = draw_probe()
    for key in effect.quantities():
        value = getattr(effect(), key).requires_grad_()
        shown = probe.show(effect().replace(**{key: value}))
        slopes = [_slope(output, value) for output in shown.values()]
        total = torch.cat([slope.flatten() for slope in slopes]).abs()
        label = f"{effect.name}.{key}"
        _require(total.isfinite().all(), f"{label} must have a finite derivative at its null value")
        _require(
            total.max() > 0, f"{label} must have a derivative other than zero at its null value: a fit starts there"
        )


def batch_equals_loop(effect: type[Effect]) -> None:
    """Check that each world of a batch sees its own parameters, and that shape (1,) serves all worlds."""
    probe = draw_probe()
    count = len(probe.wrench)
    sizes = torch.linspace(0.3, 1.0, count, dtype=torch.float64)
    values = {key: q.null + sizes * (q.typical - q.null) for key, q in effect.quantities().items()}
    together = probe.show(effect(**values))
    for i in range(count):
        single = {key: value[i : i + 1] for key, value in values.items()}
        _compare(effect, together, probe.only(i).show(effect(**single)), i)
        _compare(effect, probe.show(effect(**single)), probe.only(i).show(effect(**single)), i)


def time_stays_a_tensor(effect: type[Effect]) -> None:
    """Check that Python does not look at the time, which is another one in each world and step of a rollout."""
    probe = draw_probe()
    typical = {key: torch.tensor([q.typical], dtype=torch.float64) for key, q in effect.quantities().items()}
    inputs = probe.inputs.replace(time=unread(probe.inputs.time))
    for size in (effect(), effect(**typical)):
        try:
            size.act(probe.state, inputs)
        except ReadError as error:
            raise ValueError(
                f"{effect.name}.act must compute with inputs.time as a tensor of shape (B,), one for each world and "
                f"step, but Python looks at its value ({error}); use torch.where or clamp instead of if and float()"
            ) from error


def _compare(effect: type[Effect], batch: dict[str, Tensor], single: dict[str, Tensor], sample: int) -> None:
    for name, value in single.items():
        mine = batch[name] if name in widths_of("ground") else batch[name][sample : sample + 1]
        same = mine.shape == value.shape and torch.allclose(mine, value, TOLERANCE, TOLERANCE)
        _require(same, f"{effect.name} must treat each world of a batch by itself, but {name} differs")


def _slope(output: Tensor, value: Tensor) -> Tensor:
    """Return the derivatives of some random sums of `output` by `value`."""
    if not output.requires_grad:
        return torch.zeros_like(value)
    weight = torch.rand(output.shape, generator=torch.Generator().manual_seed(1), dtype=output.dtype)
    return torch.autograd.grad((weight * output).sum(), value, retain_graph=True)[0]


def _require(holds: object, message: str) -> None:
    if not holds:
        raise ValueError(message)
