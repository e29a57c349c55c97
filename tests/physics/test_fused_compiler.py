from __future__ import annotations

import ctypes
from collections.abc import Callable
from itertools import count

import pytest
import torch
from torch import Tensor

from physid.compiler.control import MOVES, Code
from physid.compiler.emit import LANES
from physid.compiler.graph import Value, least, most, root, size, total, where
from physid.compiler.machine import load
from physid.compiler.section import Layout, Record, Section
from physid.physics.fused.formulas import algebra
from physid.physics.rotations import exponential, multiply, to_matrix

ROUNDING = 1e-14

_NUMBERS = count()


def run(section: Section, records: dict[str, Tensor], adjoint: bool = False) -> None:
    """Compile a section and call it on records of shape (slots, LANES), aligned to 64 bytes."""
    name = f"test_{next(_NUMBERS)}"
    code = Code(name, tuple(records))
    function = f"{section.name}_adjoint" if adjoint else section.name
    code.call(function, *(code.argument(record, "ptr") for record in records))
    text = "\n".join([MOVES, section.adjoint() if adjoint else section.forward(), code.text()])
    addresses = (ctypes.c_int64 * len(records))(*(record.data_ptr() for record in records.values()))
    load(name, lambda: text)(ctypes.addressof(addresses), 0, 0, 0)


@pytest.fixture(autouse=True)
def _no_cache(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ANN001
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def evaluate(formula: Callable[[list[Value]], list[Value]], x: Tensor, wanted: int) -> tuple[Tensor, Tensor]:
    """Return formula(x) of shape (wanted, LANES), and the derivative of a weighted sum of it by x (slots, LANES)."""

    def on_records(given: Record, result: Record) -> None:
        result["y"] = formula(given["x"])

    section = Section("formula", on_records, {"given": Layout(x=len(x)), "result": Layout(y=wanted)})
    result, bar = torch.zeros(wanted, LANES, dtype=torch.float64), torch.zeros_like(x)
    run(section, {"given": x, "result": result})
    weights = 1 + torch.arange(wanted, dtype=torch.float64)[:, None].expand(wanted, LANES).contiguous()
    run(section, {"given": x, "result": result, "given_bar": bar, "result_bar": weights}, adjoint=True)
    return result, bar


def draw(slots: int, seed: int = 0) -> Tensor:
    return torch.randn(slots, LANES, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def assert_like_torch(
    formula: Callable[[list[Value]], list[Value]], expected: Callable[[Tensor], Tensor], x: Tensor
) -> None:
    """Compare a formula, and its derivative, with the same in torch (slots last there)."""
    given = x.mT.clone().requires_grad_()
    wanted = expected(given)
    result, bar = evaluate(formula, x, wanted.shape[1])
    torch.testing.assert_close(result, wanted.detach().mT, rtol=ROUNDING, atol=ROUNDING)
    (wanted * (1 + torch.arange(wanted.shape[1]))).sum().backward()
    torch.testing.assert_close(bar, given.grad.mT, rtol=10 * ROUNDING, atol=10 * ROUNDING)


def test_arithmetic_and_its_derivative_are_those_of_torch() -> None:
    def formula(x: list[Value]) -> list[Value]:
        a, b, c = x
        return [
            a * b - c / (1.0 + b * b),
            root(a * a + 2.0),
            -(a - 3.0) * 0.5,
            total([a, b, c, a * c]),
            1.0 / (2.0 + a * a),
        ]

    def expected(x: Tensor) -> Tensor:
        a, b, c = x.unbind(1)
        sums = [a * b - c / (1 + b * b), (a * a + 2).sqrt(), -(a - 3) * 0.5, a + b + c + a * c, 1 / (2 + a * a)]
        return torch.stack(sums, 1)

    assert_like_torch(formula, expected, draw(3))


def test_choices_and_their_derivative_are_those_of_torch() -> None:
    def formula(x: list[Value]) -> list[Value]:
        a, b, c = x
        mask = ((a < b) & ~(c > 0.0)) | (a >= 1.0)
        return [where(mask, a * c, b), least(a, b), most(c, 0.0), size(a)]

    def expected(x: Tensor) -> Tensor:
        a, b, c = x.unbind(1)
        mask = ((a < b) & ~(c > 0)) | (a >= 1)
        return torch.stack([torch.where(mask, a * c, b), torch.minimum(a, b), c.clamp_min(0), a.abs()], 1)

    assert_like_torch(formula, expected, draw(3, seed=1))


@pytest.mark.parametrize("turn", [0.0, 1e-9, 1e-2, 0.5, 3.0, 12.0])
def test_rotations_are_those_of_the_reference(turn: float) -> None:
    assert_like_torch(algebra.exponential, exponential, turn * draw(3))


def test_products_and_matrices_of_rotations_are_those_of_the_reference() -> None:
    def formula(x: list[Value]) -> list[Value]:
        rows = algebra.to_matrix(x[:4])
        return [*algebra.multiply(x[:4], x[4:]), *(value for row in rows for value in row)]

    def expected(x: Tensor) -> Tensor:
        return torch.cat([multiply(x[:, :4], x[:, 4:]), to_matrix(x[:, :4]).flatten(1)], 1)

    assert_like_torch(formula, expected, draw(8))


def test_the_decay_is_an_exponential() -> None:
    assert_like_torch(lambda x: [algebra.decay(x[0])], lambda x: torch.exp(-x), 20 * draw(1).abs())


def test_equal_operations_are_recorded_once_and_constants_are_folded() -> None:
    def on_records(given: Record, result: Record) -> None:
        a, b = given["x"]
        result["y"] = [(a + b) * (b + a) + 0.0 * a + (a - a.like(0.0)) * 1.0]

    text = Section("formula", on_records, {"given": Layout(x=2), "result": Layout(y=1)}).forward()
    assert text.count("fadd") == 2
    assert text.count("fmul") == 1


def test_a_field_of_the_wrong_width_is_named() -> None:
    def on_records(given: Record) -> None:
        given["x"] = [0.0]

    with pytest.raises(ValueError, match=r"given.x has 2 slots, got 1 values"):
        Section("formula", on_records, {"given": Layout(x=2)}).forward()
