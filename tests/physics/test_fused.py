from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
import torch
from torch import Tensor

from physid.effects import CATALOGUE
from physid.effects.dynamics.viscous_drag import ViscousDrag
from physid.physics import Effect, Parameters, PhysicsLayer, Plane, Rollout, SolverError, State, World
from physid.physics.contact import ContactRule, Penetrating, Speculative, Split
from physid.physics.contact_problem.lcp import SolverSettings
from physid.physics.fused.records import Shape
from physid.scenes import SETUPS, Setup

STATE = 1e-9
GRADIENT = 1e-7
TUMBLING = 1e-6  # bodies that hit the ground with a corner amplify the solver's own rounding

ACTING = [effect for effect in CATALOGUE if effect.act is not Effect.act]


@dataclasses.dataclass(frozen=True)
class Case:
    """A batch of a scene: world, tensors that take a gradient, by name."""

    world: World
    tensors: dict[str, Tensor]

    def roll(self, layer: PhysicsLayer, lengths: Tensor | None = None) -> Rollout:
        """Predict the batch with a layer."""
        state = State(self.tensors["pose"], self.tensors["twist"])
        return layer.rollout(state, self.tensors["wrench"], self.parameters, lengths)

    @property
    def parameters(self) -> Parameters:
        """Sizes, masses, friction, restitution."""
        return Parameters.of_boxes(*(self.tensors[name] for name in ("size", "mass", "friction", "restitution")))


def draw(setup: Setup, batch: int, steps: int, protocol: str = "rich", seed: int = 0) -> Case:
    scene, generator = setup.scene, np.random.default_rng(seed)
    varied = torch.Generator().manual_seed(seed)
    drawn = [setup.draw(scene, protocol, generator, steps) for _ in range(batch)]
    tensors = {
        name: torch.from_numpy(np.stack([getattr(one, name) for one in drawn])) for name in ("pose", "twist", "wrench")
    }
    for name in ("size", "mass", "friction", "restitution"):
        value = torch.tensor([[getattr(body, name) for body in scene.bodies]], dtype=torch.float64)
        tensors[name] = value.expand(batch, *value.shape[1:])
        tensors[name] = tensors[name] * (1 + 0.2 * torch.rand(batch, *[1] * (value.ndim - 1), generator=varied))
    ground = Plane(scene.ground.normal, scene.ground.offset)
    return Case(World(time_step=scene.time_step, gravity=scene.gravity, ground=ground), tensors)


def outcome(case: Case, backend: str, effects: tuple[Effect, ...] = ()) -> dict[str, Tensor]:
    """Return states, impulses of patches, and gradients of a random loss by everything, effects too."""
    tensors = {name: value.clone().requires_grad_() for name, value in case.tensors.items()}
    effects = tuple(e.replace(**{k: v.clone().requires_grad_() for k, v in e.values().items()}) for e in effects)
    rollout = Case(case.world, tensors).roll(PhysicsLayer(case.world, effects, backend=backend))  # type: ignore[arg-type]
    # Of corners at the same height, either may come first: only the sum over a patch is defined.
    impulse = rollout.impulse.unflatten(2, (-1, 4)).sum(3)
    generator = torch.Generator().manual_seed(1)
    parts = {"pose": rollout.pose, "twist": rollout.twist, "impulse": impulse}
    loss = sum((torch.randn(x.shape, generator=generator, dtype=x.dtype) * x).sum() for x in parts.values())
    wanted = tensors | {f"{e.name}.{name}": value for e in effects for name, value in e.values().items()}
    slopes = torch.autograd.grad(loss, list(wanted.values()), allow_unused=True)
    gradients = {f"by {name}": slope for name, slope in zip(wanted, slopes, strict=True) if slope is not None}
    return {name: value.detach() for name, value in (parts | gradients).items()}


def assert_equal(case: Case, effects: tuple[Effect, ...] = (), gradient: float = GRADIENT) -> None:
    reference, fused = outcome(case, "reference", effects), outcome(case, "fused", effects)
    assert reference.keys() == fused.keys()
    for name, expected in reference.items():
        tolerance = gradient if name.startswith("by ") else STATE
        scale = max(float(expected.abs().max()), 1e-6)
        torch.testing.assert_close(
            fused[name], expected, rtol=0, atol=tolerance * scale, msg=lambda m, n=name: f"{n}: {m}"
        )


@pytest.mark.parametrize("protocol", [pytest.param("paper", marks=pytest.mark.slow), "rich"])
@pytest.mark.parametrize("setup", SETUPS, ids=lambda setup: setup.scene.name)
def test_states_and_gradients_are_those_of_the_reference_in_every_scene(setup: Setup, protocol: str) -> None:
    assert_equal(draw(setup, 9, 16, protocol))


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS, ids=lambda setup: setup.scene.name)
def test_states_and_gradients_stay_those_of_the_reference(setup: Setup) -> None:
    assert_equal(draw(setup, 8, 120, seed=1), gradient=TUMBLING if setup.scene.name == "toss" else GRADIENT)


@pytest.mark.parametrize(
    "rule",
    [
        pytest.param(Speculative(correction=0.1), marks=pytest.mark.slow),
        pytest.param(Penetrating(), marks=pytest.mark.slow),
        Split(),
    ],
)
@pytest.mark.parametrize(
    "setup", [pytest.param(SETUPS[0], marks=pytest.mark.slow), SETUPS[2]], ids=lambda setup: setup.scene.name
)
def test_every_contact_rule_is_that_of_the_reference(setup: Setup, rule: ContactRule) -> None:
    case = draw(setup, 3, 6)
    assert_equal(dataclasses.replace(case, world=dataclasses.replace(case.world, contact=rule, substeps=2)))


@pytest.mark.parametrize("rule", [Speculative(), pytest.param(Split(), marks=pytest.mark.slow)])
def test_a_bouncing_toss_is_that_of_the_reference(rule: ContactRule) -> None:
    case = draw(SETUPS[3], 6, 40)
    case.tensors["pose"][:, :, 2] = 0.2
    assert_equal(dataclasses.replace(case, world=dataclasses.replace(case.world, contact=rule, gyroscopic=False)))


@pytest.mark.parametrize("bodies", [2, 3])
@pytest.mark.parametrize("ground", [None, Plane((0.1, 0.0, 1.0), -0.02)])
def test_any_number_of_bodies_with_or_without_ground_is_that_of_the_reference(
    bodies: int, ground: Plane | None
) -> None:
    generator = torch.Generator().manual_seed(bodies)
    pose = torch.zeros(3, bodies, 7, dtype=torch.float64)
    pose[..., 0] = 0.22 * torch.arange(bodies) + 0.01 * torch.rand(3, bodies, generator=generator)
    pose[..., 1:3] = 0.05 * torch.rand(3, bodies, 2, generator=generator)
    pose[..., 3:] = torch.nn.functional.normalize(
        torch.tensor([0.0, 0, 0, 1]) + 0.1 * torch.randn(3, bodies, 4, generator=generator), dim=-1
    )
    twist = torch.randn(3, bodies, 6, generator=generator, dtype=torch.float64)
    twist[..., 3] = 1.0 - torch.arange(bodies)
    ones = torch.ones(3, bodies, dtype=torch.float64)
    tensors = {
        "pose": pose,
        "twist": twist,
        "wrench": torch.zeros(3, 4, bodies, 6, dtype=torch.float64),
        "size": 0.2 * ones[..., None].expand(3, bodies, 3) * torch.tensor([1.0, 1.1, 0.9]),
        "mass": ones,
        "friction": 0.4 * ones,
        "restitution": 0.6 * ones,
    }
    assert_equal(Case(World(ground=ground), tensors))


@pytest.mark.slow
@pytest.mark.parametrize("effect", ACTING, ids=lambda effect: effect.name)
@pytest.mark.parametrize("substeps", [1, 2])
def test_effects_act_as_on_the_reference(effect: type[Effect], substeps: int) -> None:
    case = draw(SETUPS[2 if "object" in effect.name else 0], 3, 4)
    typical = {name: quantity.typical for name, quantity in effect.quantities().items()}
    values = {
        name: size * torch.tensor([0.5, 1.0, 1.5], dtype=torch.float64)[: 1 if substeps == 1 else 3]
        for name, size in typical.items()
    }
    world = dataclasses.replace(case.world, substeps=substeps)
    assert_equal(dataclasses.replace(case, world=world), (effect(**values),))


@pytest.mark.parametrize("effect", ACTING, ids=lambda effect: effect.name)
@pytest.mark.parametrize("substeps", [1, 2])
def test_a_rollout_under_effects_is_the_same_whether_gradients_are_wanted_or_not(
    effect: type[Effect], substeps: int
) -> None:
    case = draw(SETUPS[2 if "object" in effect.name else 0], 9, 6)
    values = {name: torch.tensor([size.typical]).double() for name, size in effect.quantities().items()}
    layer = PhysicsLayer(dataclasses.replace(case.world, substeps=substeps), [effect(**values)], backend="fused")
    wanted = case.roll(layer)
    with torch.no_grad():
        without = case.roll(layer)
    for name in ("pose", "twist", "impulse"):
        one, other = getattr(without, name), getattr(wanted, name)
        torch.testing.assert_close(one, other, rtol=0, atol=STATE * float(other.abs().max()))
    assert torch.equal(without.status.newton_steps, wanted.status.newton_steps)


def test_a_failure_under_an_effect_is_the_same_error_whether_gradients_are_wanted_or_not() -> None:
    case = draw(SETUPS[0], 9, 40)
    settings = SolverSettings(max_steps=5)
    layer = PhysicsLayer(case.world, [ViscousDrag(torch.tensor([0.5]).double())], settings, backend="fused")
    messages = []
    for gradients in (True, False):
        with torch.set_grad_enabled(gradients), pytest.raises(SolverError, match="not solved at step 0") as error:
            case.roll(layer)
        messages.append(str(error.value))
    assert messages[0] == messages[1]


def test_the_same_failure_is_the_same_error() -> None:
    case = draw(SETUPS[0], 9, 5)
    settings = SolverSettings(max_steps=5)
    messages = []
    for backend in ("reference", "fused"):
        layer = PhysicsLayer(case.world, solver=settings, backend=backend)  # type: ignore[arg-type]
        with pytest.raises(SolverError) as error:
            case.roll(layer)
        messages.append(re.sub(r"residual \S+", "residual", str(error.value)))
    assert messages[0].startswith("9 of 9 contact problems were not solved at step 0: worst residual")
    assert messages[0] == messages[1]


def test_threads_do_not_change_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("physid.physics.fused.run.WORTH", 1)
    case, threads = draw(SETUPS[2], 20, 30), torch.get_num_threads()
    results = []
    try:
        for count in (1, 2, 3):
            torch.set_num_threads(count)
            results.append(outcome(case, "fused"))
    finally:
        torch.set_num_threads(threads)
    for name, expected in results[0].items():
        assert all(torch.equal(other[name], expected) for other in results[1:])


def test_a_batch_is_solved_as_its_members_alone() -> None:
    case = draw(SETUPS[2], 10, 40)
    together = outcome(case, "fused")
    for k in (0, 9):
        alone = outcome(Case(case.world, {name: value[k : k + 1] for name, value in case.tensors.items()}), "fused")
        torch.testing.assert_close(alone["pose"][0], together["pose"][k], rtol=0, atol=STATE)


def test_a_derivative_of_900_trajectories_of_two_boxes_fits_in_a_gigabyte() -> None:
    groups, steps, doubles = -(-900 // 8), 300, Shape(2, ground=True).tape * 8
    outputs = 900 * steps * (2 * 13 + 36 + 12) * 2
    assert 8 * (groups * steps * doubles + outputs) < 1e9
