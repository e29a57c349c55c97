"""Tensors that record what torch computes with them: a formula written in torch becomes a graph of scalars."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physid.compiler import graph as scalars
from physid.compiler.graph import Graph, Value

Values = NDArray[Any]


class TracingError(Exception):
    """A formula does what cannot be recorded: it looks at a value, or calls a function without a rule here."""


class Traced(Tensor):
    """A tensor whose elements are recorded operations (see `physid.compiler.graph`) instead of numbers.

    Torch's functions work on it as on any tensor of float64, or of bool where the elements are truth values. What looks
    at a value (`if`, float(), item()) and what has no rule raises a `TracingError`.
    """

    elements: Values

    @staticmethod
    def __new__(cls: type[Self], values: Values) -> Self:
        """Wrap elements."""
        kind = torch.bool if _is_mask(values.flat[0]) else torch.float64
        traced: Self = Tensor._make_wrapper_subclass(cls, values.shape, dtype=kind)
        traced.elements = values
        return traced

    @classmethod
    def __torch_dispatch__(  # type: ignore[override]
        cls, func: Any, types: Sequence[type], args: Sequence[Any] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        """Record a function of torch."""
        name = func.overloadpacket.__name__
        in_place = name.endswith("_") and not name.endswith("__")
        rule = _RULES.get(name.removesuffix("_") if in_place else name)
        if rule is None:
            raise TracingError(f"torch's {name} cannot be compiled")
        graph = next(value.elements.flat[0].graph for value in _flat(args) if isinstance(value, Traced))
        result = rule(*(_values(graph, value) for value in args), **(kwargs or {}))
        if in_place:
            _write(args[0].elements, result)
            return args[0]
        return [cls(one) for one in result] if isinstance(result, list) else cls(result)


def loads(graph: Graph, record: str, first: int, shape: tuple[int, ...]) -> Traced:
    """Return a tensor of some shape whose elements are the slots of a record from one on."""
    slots = [graph.load(record, first + k) for k in range(math.prod(shape))]
    return Traced(_array(slots).reshape(shape))


def elements(value: Tensor, graph: Graph, shape: tuple[int, ...]) -> list[Value]:
    """Return the elements of a tensor, one of numbers too, broadcast to a shape."""
    return list(np.broadcast_to(_values(graph, value), shape).flat)


def _flat(value: Any) -> list[Any]:
    return [each for part in value for each in _flat(part)] if isinstance(value, list | tuple) else [value]


def _array(values: Sequence[Value]) -> Values:
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array


def _values(graph: Graph, value: Any) -> Any:
    """Return the elements of a tensor, and those of tensors in a list; anything else as it is."""
    if isinstance(value, Traced):
        return value.elements
    if isinstance(value, Tensor):
        numbers = [graph.constant(float(number)) for number in value.detach().flatten().tolist()]
        return _array(numbers).reshape(tuple(value.shape))
    return [_values(graph, each) for each in value] if isinstance(value, list | tuple) else value


def _is_mask(value: Value) -> bool:
    name = value.operation.name
    return name in scalars.MASKS or (name == "where" and _is_mask(Value(value.graph, value.operation.arguments[1])))


def _number(value: Any) -> Any:
    """Return a truth value as 1 or 0, and a number as it is."""
    return scalars.where(value, 1.0, 0.0) if isinstance(value, Value) and _is_mask(value) else value


def _each(function: Callable[..., Any]) -> Callable[..., Any]:
    """Apply a function to every element of arguments that are broadcast, all of them as numbers."""

    def apply(*arguments: Any) -> Any:
        def one(*each: Any) -> Any:
            return function(*map(_number, each))

        return np.asarray(np.frompyfunc(one, len(arguments), 1)(*arguments), dtype=object)

    return apply


def _multiply(a: Any, b: Any) -> Any:
    both = isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and _is_mask(a.flat[0]) and _is_mask(b.flat[0])
    return _and(a, b) if both else _each(lambda x, y: x * y)(a, b)


def _masks(function: Callable[..., Any]) -> Callable[..., Any]:
    """Apply a function to every element of arguments that are broadcast, all of them truth values."""
    return lambda *arguments: np.asarray(np.frompyfunc(function, len(arguments), 1)(*arguments), dtype=object)


_and = _masks(lambda a, b: a & b)


def _add(a: Any, b: Any, alpha: float = 1) -> Any:
    return _each(lambda x, y: x + alpha * y)(a, b)


def _divide(a: Any, b: Any, rounding_mode: str | None = None) -> Any:
    if rounding_mode is not None:
        raise TracingError("a division that rounds cannot be compiled")
    return _each(lambda x, y: x / y)(a, b)


def _power(base: Any, exponent: Any) -> Any:
    if isinstance(exponent, int | float):
        return _each(lambda x: _to_the(x, exponent))(base)
    if isinstance(base, int | float) and base > 0:
        return _each(lambda y: scalars.exponential(y * math.log(base)))(exponent)
    raise TracingError("a power with a tensor as exponent cannot be compiled")


def _to_the(x: Value, exponent: float) -> Value:
    if exponent == int(exponent) and 0 <= exponent <= 16:
        product = x.like(1.0)
        for _ in range(int(exponent)):
            product = product * x
        return product
    if exponent < 0:
        return 1.0 / _to_the(x, -exponent)
    if exponent == 0.5:
        return scalars.root(x)
    return scalars.exponential(exponent * scalars.logarithm(x))


def _clamp(a: Any, low: Any = None, high: Any = None, **named: Any) -> Any:
    low, high = named.get("min", low), named.get("max", high)
    a = a if low is None else _each(scalars.most)(a, low)
    return a if high is None else _each(scalars.least)(a, high)


def _where(mask: Any, yes: Any, no: Any) -> Any:
    def choose(each: Value, a: Any, b: Any) -> Value:
        pure = all(isinstance(x, Value) and _is_mask(x) for x in (a, b))
        return scalars.where(each, a, b) if pure else scalars.where(each, _number(a), _number(b))

    return np.asarray(np.frompyfunc(choose, 3, 1)(mask, yes, no), dtype=object)


def _axes(a: Values, dim: Any) -> tuple[int, ...]:
    if dim is None or dim == []:
        return tuple(range(a.ndim))
    return tuple(dim) if isinstance(dim, list | tuple) else (dim,)


def _sum(a: Values, dim: Any = None, keepdim: bool = False, dtype: Any = None) -> Any:
    return np.asarray(np.sum(_each(lambda x: x)(a), axis=_axes(a, dim), keepdims=keepdim), dtype=object)


def _mean(a: Values, dim: Any = None, keepdim: bool = False, dtype: Any = None) -> Any:
    count = math.prod(a.shape[axis] for axis in _axes(a, dim))
    return _each(lambda x: x / count)(_sum(a, dim, keepdim))


def _norm(a: Values, order: Any = 2, dim: Any = None, keepdim: bool = False, dtype: Any = None) -> Any:
    if order not in (2, None):
        raise TracingError(f"a norm of order {order} cannot be compiled")

    def length(square: Value) -> Value:
        some = square > 0.0  # at 0 its derivative is 0, as torch has it
        return scalars.where(some, scalars.root(scalars.where(some, square, 1.0)), 0.0)

    return _each(length)(_sum(a * a, dim, keepdim))


def _slice(a: Values, dim: int = 0, start: int | None = None, end: int | None = None, step: int = 1) -> Values:
    index: list[slice] = [slice(None)] * a.ndim
    index[dim] = slice(start, None if end is None else min(end, a.shape[dim]), step)
    return a[tuple(index)]


def _expand(a: Values, size: Sequence[int], implicit: bool = False) -> Values:
    new = len(size) - a.ndim
    return np.broadcast_to(a, [a.shape[k - new] if n == -1 else n for k, n in enumerate(size)])


def _select(a: Values, dim: int, index: int) -> Values:
    index %= a.shape[dim]
    return np.squeeze(_slice(a, dim, index, index + 1), dim)


def _view(a: Values, *shape: Any) -> Values:
    view = np.reshape(a, *shape)
    if not np.shares_memory(view, a):
        view.flags.writeable = False  # what is written into it would be lost
    return view


def _write(target: Values, values: Any) -> None:
    if not target.flags.writeable:
        raise TracingError("what is written into a view cannot be compiled")
    target[...] = values


def _squeeze(a: Values, dim: Any = None) -> Values:
    return np.squeeze(a, tuple(axis for axis in _axes(a, dim) if a.shape[axis] == 1))


def _pad(a: Values, pad: Sequence[int], value: float = 0.0) -> Values:
    pairs = [(pad[2 * k], pad[2 * k + 1]) for k in range(len(pad) // 2)]
    if any(n < 0 for pair in pairs for n in pair):
        raise TracingError("a padding below zero cannot be compiled")
    return np.pad(a, [(0, 0)] * (a.ndim - len(pairs)) + pairs[::-1], constant_values=a.flat[0].like(value))


def _cross(a: Values, b: Values, dim: int = -1) -> Any:
    (a, b) = (np.moveaxis(each, dim, -1) for each in np.broadcast_arrays(a, b))
    x, y = ([each[..., k] for k in range(3)] for each in (a, b))
    parts = [x[(k + 1) % 3] * y[(k + 2) % 3] - x[(k + 2) % 3] * y[(k + 1) % 3] for k in range(3)]
    return np.moveaxis(np.stack(parts, -1), -1, dim)


def _full(a: Values, shape: Sequence[int], value: float) -> Values:
    return np.full(tuple(shape), a.flat[0].like(value), dtype=object)


def _copy(a: Values, dtype: Any = None, **_: Any) -> Any:
    if dtype not in (None, torch.float64, torch.bool):
        raise TracingError(f"{dtype} cannot be compiled, float64 can")
    return _each(lambda x: x)(a) if dtype is torch.float64 else a


_RULES: dict[str, Callable[..., Any]] = {
    "add": _add, "sub": lambda a, b, alpha=1: _add(a, b, -alpha), "rsub": lambda a, b, alpha=1: _add(b, a, -alpha),
    "mul": _multiply, "div": _divide, "neg": _each(lambda x: -x), "reciprocal": _each(lambda x: 1.0 / x),
    "pow": _power, "square": _each(lambda x: x * x), "abs": _each(scalars.size),
    "sqrt": _each(scalars.root), "rsqrt": _each(lambda x: 1.0 / scalars.root(x)),
    "exp": _each(scalars.exponential), "log": _each(scalars.logarithm),
    "sin": _each(scalars.sine), "cos": _each(scalars.cosine),
    "tanh": _each(lambda x: 1.0 - 2.0 / (scalars.exponential(2.0 * x) + 1.0)),
    "sign": _each(lambda x: scalars.where(x > 0.0, 1.0, scalars.where(x < 0.0, -1.0, 0.0))),
    "clamp": _clamp, "clamp_min": _clamp, "clamp_max": lambda a, high: _clamp(a, None, high),
    "minimum": _each(scalars.least), "maximum": _each(scalars.most), "where": _where,
    "lt": _each(lambda a, b: a < b), "le": _each(lambda a, b: a <= b),
    "gt": _each(lambda a, b: a > b), "ge": _each(lambda a, b: a >= b),
    "eq": _each(lambda a, b: a.equals(b)), "ne": _each(lambda a, b: ~a.equals(b)),
    "logical_and": _and, "logical_or": _masks(lambda a, b: a | b), "logical_not": _masks(lambda a: ~a),
    "bitwise_and": _and, "bitwise_or": _masks(lambda a, b: a | b), "bitwise_not": _masks(lambda a: ~a),
    "sum": _sum, "mean": _mean, "linalg_vector_norm": _norm, "norm": _norm, "linalg_cross": _cross,
    "mm": np.matmul, "bmm": np.matmul, "mv": np.matmul, "dot": lambda a, b: np.asarray(np.dot(a, b), dtype=object),
    "cat": lambda parts, dim=0: np.concatenate(parts, dim), "stack": lambda parts, dim=0: np.stack(parts, dim),
    "select": _select, "slice": _slice,
    "unbind": lambda a, dim=0: [_select(a, dim, k) for k in range(a.shape[dim])],
    "unsqueeze": np.expand_dims, "squeeze": _squeeze, "expand": _expand, "constant_pad_nd": _pad,
    "view": _view, "_unsafe_view": _view, "reshape": _view,
    "copy": lambda a, values, non_blocking=False: values, "fill": lambda a, value: a.flat[0].like(value),
    "permute": np.transpose, "transpose": np.swapaxes, "t": np.transpose,
    "zeros_like": lambda a, **_: _full(a, a.shape, 0.0), "ones_like": lambda a, **_: _full(a, a.shape, 1.0),
    "full_like": lambda a, value, **_: _full(a, a.shape, value),
    "new_zeros": lambda a, shape, **_: _full(a, shape, 0.0), "new_ones": lambda a, shape, **_: _full(a, shape, 1.0),
    "new_full": lambda a, shape, value, **_: _full(a, shape, value),
    "clone": lambda a, **_: a.copy(), "alias": lambda a: a, "lift_fresh": lambda a: a,
    "detach": _masks(lambda x: x if _is_mask(x) else scalars.stop(x)),
    "_to_copy": _copy,
}  # fmt: skip
"""What torch's functions do to elements; those that stand for none of their arguments' elements are not among them."""
