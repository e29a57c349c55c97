"""What comes from outside is converted or refused; what cannot be differentiated again says so."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch
from torch import Tensor

from physics.worlds import boxes, forces, repeat, state
from physid.effects import laws
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.physics import Effect, Parameters, PhysicsLayer, State, StepInputs, World, quantity
from physid.physics.guards.unread import ReadError, plain, unread
from physid.physics.schemes.integration import Integration, Midpoint, SemiImplicit

BACKENDS = ("reference", "fused")
SCHEMES = (SemiImplicit(), Midpoint())


def layer(backend: str, integration: Integration = SemiImplicit(), effects: tuple[Effect, ...] = ()) -> PhysicsLayer:  # noqa: B008
    return PhysicsLayer(World(integration=integration), effects, backend=backend)  # type: ignore[arg-type]


@pytest.mark.parametrize("integration", SCHEMES)
@pytest.mark.parametrize("backend", BACKENDS)
def test_wrenches_and_parameters_of_any_floating_type_are_those_of_the_poses(
    backend: str, integration: Integration
) -> None:
    push, known = forces(6, [[4.0, 0.5, 0]]), boxes(mass=0.75, friction=0.25, size=0.25)
    expected = layer(backend, integration).rollout(state([[0, 0, 0.125]]), push, known).pose
    for dtype in (torch.float32, torch.float16, torch.bfloat16):
        # All of these numbers are exact in each type but the inertia, which therefore is left alone.
        names = ("size", "mass", "friction", "restitution")
        low = known.replace(**{name: getattr(known, name).to(dtype) for name in names})
        wrench = push.to(dtype).requires_grad_()
        found = layer(backend, integration).rollout(state([[0, 0, 0.125]]), wrench, low)
        torch.testing.assert_close(found.pose, expected, rtol=0, atol=1e-15)
        (slope,) = torch.autograd.grad(found.pose[:, -1].sum(), wrench)
        assert slope.dtype == dtype
        assert float(slope.abs().max()) > 0


def test_types_that_mean_nothing_here_are_refused_by_name() -> None:
    start, push, known = state([[0, 0, 0.1]]), forces(3, [[1.0, 0, 0]]), boxes()
    with pytest.raises(ValueError, match=r"wrenches must be of a floating type, got torch.int64; convert it"):
        layer("auto").rollout(start, push.long(), known)
    with pytest.raises(ValueError, match=r"wrenches must be of a floating type, got torch.complex128"):
        layer("auto").rollout(start, push.to(torch.complex128), known)
    with pytest.raises(ValueError, match=r"parameters.mass must be of a floating type, got torch.int64"):
        layer("auto").rollout(start, push, known.replace(mass=torch.ones(1, 1, dtype=torch.int64)))
    half = State(start.pose.half(), start.twist.half())
    with pytest.raises(ValueError, match=r"pose must be of torch.float32 or torch.float64, got torch.float16"):
        layer("auto").rollout(half, push, known)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_rollout_checks_the_states_that_it_starts_from(backend: str) -> None:
    start, push = state([[0, 0, 0.1]]), forces(3, [[1.0, 0, 0]])
    for column, value, message in (
        (0, math.nan, "pose must be finite, got 1 of 7 values that are not"),
        (6, 0.5, "pose must hold unit quaternions"),
    ):
        pose = start.pose.clone()
        pose[0, 0, column] = value
        with pytest.raises(ValueError, match=message):
            layer(backend).rollout(State(pose, start.twist), push, boxes())
    with pytest.raises(ValueError, match="twist must be finite"):
        layer(backend).rollout(State(start.pose, start.twist + math.inf), push, boxes())


def test_a_state_of_the_wrong_shape_is_refused_where_it_is_made() -> None:
    with pytest.raises(ValueError, match=r"twist must have shape \(2, 1, 6\), got \(1, 1, 6\)"):
        State(torch.zeros(2, 1, 7), torch.zeros(1, 1, 6))
    with pytest.raises(ValueError, match=r"pose must have shape \(2, 1, 7\), got \(2, 1, 6\)"):
        State(torch.zeros(2, 1, 6), torch.zeros(2, 1, 6))
    with pytest.raises(ValueError, match="twist must be on cpu as the poses are, got meta"):
        State(torch.zeros(2, 1, 7), torch.zeros(2, 1, 6, device="meta"))


@pytest.mark.parametrize("integration", SCHEMES)
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_second_derivative_is_refused_and_a_first_with_a_graph_is_right(
    backend: str, integration: Integration
) -> None:
    force = forces(5, [[5.0, 0, 0]]).requires_grad_()
    known = boxes()
    mass = known.mass.clone().requires_grad_()
    ends = layer(backend, integration).rollout(state([[0, 0, 0.1]]), force, known.replace(mass=mass)).pose[0, -1, 0, 0]
    once = torch.autograd.grad(ends, (force, mass), retain_graph=True)
    again = torch.autograd.grad(ends, (force, mass), create_graph=True)
    for one, other in zip(once, again, strict=True):
        torch.testing.assert_close(one, other.detach(), rtol=0, atol=0)
    with pytest.raises(RuntimeError, match="the physics has first derivatives only"):
        torch.autograd.grad(again[1].sum(), mass)


@dataclasses.dataclass(frozen=True)
class Peek(Effect):
    """m' = m (1 + a) after half a second: a formula whose Python looks at the clock."""

    name = "peek"
    site = "dynamics"
    share: Tensor = quantity("-", low=-0.5, high=2.0, typical=0.5)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        if float(inputs.time[0]) < 0.01:
            return inputs
        return inputs.replace(mass=inputs.mass * (1 + self.share[:, None]))


@dataclasses.dataclass(frozen=True)
class Switch(Peek):
    """m' = m (1 + a) after half a second: the same as a tensor."""

    name = "switch"

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        late = inputs.time[:, None] > 0.01
        return inputs.replace(mass=inputs.mass * (1 + torch.where(late, self.share[:, None], 0.0)))


@pytest.mark.parametrize("integration", SCHEMES)
@pytest.mark.parametrize("gradients", [True, False])
def test_an_effect_that_looks_at_the_clock_does_the_same_in_both_backends(
    gradients: bool, integration: Integration
) -> None:
    share = torch.tensor([0.5], dtype=torch.float64)
    ends = []
    for effect in (Peek(share), Switch(share)):
        for backend in BACKENDS:
            with torch.set_grad_enabled(gradients):
                start, push = repeat(state([[0, 0, 0.1]]), 2), forces(8, [[6.0, 0, 0]]).expand(2, -1, -1, -1)
                ends.append(layer(backend, integration, (effect,)).rollout(start, push, boxes()).pose[:, -1])
    for end in ends[1:]:
        torch.testing.assert_close(end, ends[0], rtol=0, atol=1e-9)
    with torch.no_grad():
        free = layer("fused", integration).rollout(start, push, boxes()).pose[:, -1]
    assert float((free - ends[0]).abs().max()) > 1e-5


def test_the_laws_refuse_an_effect_that_looks_at_the_clock() -> None:
    with pytest.raises(ValueError, match=r"peek.act must compute with inputs.time as a tensor .* \(__float__\)"):
        laws.time_stays_a_tensor(Peek)
    laws.time_stays_a_tensor(Switch)
    laws.time_stays_a_tensor(ViscousDrag)


def test_an_unread_tensor_computes_and_does_not_tell() -> None:
    value = unread(torch.tensor([1.0, 2.0], requires_grad=True))
    doubled = torch.where(value > 1.5, 2 * value, value)
    torch.testing.assert_close(plain(doubled), torch.tensor([1.0, 4.0]))
    for look in (float, bool, int, lambda x: x.item(), lambda x: x.tolist(), lambda x: [1, 2][x > 0]):
        with pytest.raises(ReadError):
            look(doubled[0])
    (slope,) = torch.autograd.grad(plain(doubled).sum(), value)
    torch.testing.assert_close(plain(slope), torch.tensor([1.0, 2.0]))


def test_parameters_keep_their_gradient_across_types() -> None:
    mass = torch.ones(1, 1, dtype=torch.float32, requires_grad=True)
    known = boxes()
    given = Parameters(known.size.float(), mass, known.inertia, known.friction.float(), known.restitution)
    rollout = layer("fused").rollout(state([[0, 0, 0.1]]), forces(5, [[5.0, 0, 0]]), given)
    assert float(torch.autograd.grad(rollout.pose[0, -1, 0, 0], mass)[0]) < 0
