from __future__ import annotations

from collections.abc import Callable
from itertools import count

import pytest
import torch
from tests.physics.test_fused_compiler import ROUNDING, draw, run
from tests.physics.worlds import boxes, forces, repeat, state
from torch import Tensor

from physid.compiler.section import Layout, Record, Section
from physid.compiler.traced import Traced, TracingError, elements, loads
from physid.effects import CATALOGUE
from physid.effects.dynamics.quadratic_drag import QuadraticDrag
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.effects.loading import own_effects
from physid.estimation.prediction import AtStep
from physid.physics import Effect, PhysicsLayer, World
from physid.physics.fused import effects as compiled

OUTSIDE = "src/physid/benchmark/sealing/outside.py"
FORMULAS: dict[str, Callable[[Tensor], Tensor]] = {
    "powers": lambda x: torch.stack([x[0] ** 3, (x[1] ** 2 + 1) ** -1.5, (x[2].abs() + 1) ** 0.5, 2.0 ** x[3]]),
    "functions": lambda x: torch.stack([x[0].exp(), (x[1] ** 2 + 0.1).log(), x[2].sin(), x[3].cos(), x[4].tanh()]),
    "roots": lambda x: (x.square() + 1).rsqrt() + (x.square() + 2).sqrt().reciprocal(),
    "bounds": lambda x: torch.cat([x.clamp(-0.3, 0.4), x.clamp_min(0), x.clamp_max(0.1), x.maximum(-x)]),
    "choices": lambda x: torch.where((x > 0.2) & ~(x >= 1) | (x == 0), x * 2, torch.where(x.isfinite(), x**2, 1.0)),
    "truth as numbers": lambda x: x * (x > 0) + (x < 0.5).to(x) + x.sign(),
    "norms": lambda x: torch.stack([x[:3].norm(), torch.linalg.vector_norm(x[3:], dim=0), x.mean(), x.sum()]),
    "no length": lambda x: (x - x).norm() + x,
    "products": lambda x: x[:4].reshape(2, 2) @ x[2:6].reshape(2, 2) @ x[:2] + x[:3] @ x[3:],
    "crosses": lambda x: torch.linalg.cross(x[:3].expand(2, 3), torch.stack([x[3:], x[:3] + 1])).flatten(),
    "shapes": lambda x: torch.nn.functional.pad(x.reshape(2, 3).mT[None], (1, 2)).flatten()[x.numel() :] + 0 * x[0],
    "parts": lambda x: torch.cat([x.unbind()[1][None], x[::2], x[-1:].squeeze(0)[None], x.new_full((2,), 3.0) * x[:2]]),
    "constants of the derivative": lambda x: x * x.detach() + x.detach().abs() + torch.where((x > 0).detach(), x, 0.0),
    "writing": lambda x: _written(x),
    "constants": lambda x: x * torch.tensor([1.0, 0.0, 2.0, 3.0, 4.0, -5.0], dtype=x.dtype) - torch.ones_like(x),
}  # fmt: skip
_NAMES = count()


def _written(x: Tensor) -> Tensor:
    push = torch.zeros_like(x).reshape(2, 3)
    push[..., 0] = x[:2]
    push[1, 1] += 2 * x[3]
    kept = push.clone()
    push[0] *= x[:3]
    push[:, 2].fill_(5.0)
    return torch.cat([push.flatten(), kept.flatten()])


@pytest.mark.parametrize("name", FORMULAS)
def test_a_formula_of_torch_is_recorded_with_its_derivative(name: str) -> None:
    formula, x = FORMULAS[name], draw(6)
    given = x.mT.clone().requires_grad_()
    wanted = torch.stack([formula(each) for each in given])

    def on_records(inputs: Record, outcome: Record) -> None:
        traced = formula(loads(inputs.graph, "inputs", 0, (6,)))
        outcome["y"] = elements(traced, inputs.graph, tuple(traced.shape))

    section = Section(
        f"recorded_{next(_NAMES)}", on_records, {"inputs": Layout(x=6), "outcome": Layout(y=len(wanted[0]))}
    )
    result, bar = torch.zeros_like(wanted.mT).contiguous(), torch.zeros_like(x)
    run(section, {"inputs": x, "outcome": result})
    torch.testing.assert_close(result, wanted.detach().mT, rtol=10 * ROUNDING, atol=10 * ROUNDING)
    run(
        section,
        {"inputs": x, "outcome": result, "inputs_bar": bar, "outcome_bar": torch.ones_like(result)},
        adjoint=True,
    )
    wanted.sum().backward()
    torch.testing.assert_close(bar, given.grad.mT, rtol=100 * ROUNDING, atol=100 * ROUNDING)


@pytest.mark.parametrize(
    "look",
    [float, bool, lambda x: x.item(), lambda x: 1 if x > 0 else 0, lambda x: x.erfinv(), lambda x: x.expand(2).add_(1)],
)
def test_what_cannot_be_recorded_is_refused(look: Callable[[Tensor], object]) -> None:
    def on_records(inputs: Record) -> None:
        look(loads(inputs.graph, "inputs", 0, ()))

    with pytest.raises((TracingError, RuntimeError, NotImplementedError)):
        Section("refused", on_records, {"inputs": Layout(x=1)}).forward()


def rolled(effect: Effect, backend: str = "fused", frames: int = 4) -> Tensor:
    layer = PhysicsLayer(World(time_step=0.02), [effect], backend=backend)  # type: ignore[arg-type]
    start = state([[0, 0, 0.1]], [[0.7, 0.2, 0]], [[0, 0, 2.0]])
    return layer.rollout(repeat(start, 2), forces(frames, [[2.0, 0, 0]]).expand(2, -1, -1, -1), boxes()).pose


@pytest.mark.parametrize("inference", [False, True], ids=["fitted", "predicted"])
@pytest.mark.parametrize("kind", [kind for kind in CATALOGUE if kind.act is not Effect.act], ids=lambda kind: kind.name)
def test_every_effect_of_the_catalogue_is_compiled(kind: type[Effect], inference: bool) -> None:
    compiled._KNOWN.clear()
    effect = kind(**{name: torch.tensor([one.typical]).double() for name, one in kind.quantities().items()})
    with torch.inference_mode(inference):
        rolled(effect)
    assert [one is not None for one in compiled._KNOWN.values()] == [True]


def test_an_effect_of_ones_own_that_takes_sines_is_compiled_and_agrees() -> None:
    (kind,) = own_effects([f"{OUTSIDE}:Washboard"])
    compiled._KNOWN.clear()
    effect = kind(depth=torch.tensor([0.4, -0.3], dtype=torch.float64))
    torch.testing.assert_close(rolled(effect), rolled(effect, "reference"), rtol=0, atol=1e-9)
    assert None not in compiled._KNOWN.values()


def test_wrapped_effects_are_told_apart() -> None:
    one = torch.tensor([2.0], dtype=torch.float64)
    ends = [rolled(AtStep(kind(one))) for kind in (ViscousDrag, QuadraticDrag)]
    assert float((ends[0] - ends[1]).abs().max()) > 1e-4
    torch.testing.assert_close(ends[1], rolled(QuadraticDrag(one), "reference"), rtol=0, atol=1e-9)


def test_more_parameters_than_a_kernel_has_room_for_are_worked_out_in_torch() -> None:
    drags = [ViscousDrag(torch.tensor([0.01], dtype=torch.float64))] * 33
    layers = [PhysicsLayer(World(), drags, backend=backend) for backend in ("fused", "reference")]
    ends = [
        layer.rollout(state([[0, 0, 0.1]], [[1.0, 0, 0]]), forces(3, [[0.0, 0, 0]]), boxes()).pose for layer in layers
    ]
    torch.testing.assert_close(*ends, rtol=0, atol=1e-9)


def test_traced_tensors_have_the_type_of_what_they_stand_for() -> None:
    def on_records(inputs: Record) -> None:
        x = loads(inputs.graph, "inputs", 0, (2,))
        assert isinstance(x + 1, Traced)
        assert (x.dtype, (x > 0).dtype) == (torch.float64, torch.bool)

    Section("typed", on_records, {"inputs": Layout(x=2)}).forward()
