"""Tensors at whose values Python may not look: it would see one step of one world where there are many."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from torch import Tensor


class ReadError(Exception):
    """Python looked at a value: by float(), bool(), an if, item() or the like."""


class Unread(Tensor):
    """A tensor that raises a `ReadError` where Python looks at its values, and so does what is computed from it."""

    @classmethod
    def __torch_function__(
        cls,
        func: Callable[..., Any],
        types: Sequence[type],
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        """Refuse what turns values into Python's, and compute all else as usual."""
        if getattr(func, "__name__", "") in _READS:
            raise ReadError(func.__name__)
        return super().__torch_function__(func, types, args, dict(kwargs or {}))  # type: ignore[no-untyped-call]


_READS = frozenset(
    {
        "item", "tolist", "numpy", "equal", "allclose", "is_nonzero",
        "__bool__", "__float__", "__int__", "__index__", "__complex__", "__array__", "__contains__",
    }
)  # fmt: skip


def unread(value: Tensor) -> Tensor:
    """Return the same tensor as one that Python may not look at."""
    return value.as_subclass(Unread)


def plain(value: Tensor) -> Tensor:
    """Return the same tensor as one like any other."""
    return value.as_subclass(Tensor) if isinstance(value, Unread) else value
