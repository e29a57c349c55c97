"""The nominal model: its parameters by name, the rules that follow from the scene, and first guesses of unknowns."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from estimation.flights import flights
from physid.effects import find, from_values
from physid.estimation.least_squares.first_guess import FirstGuess
from physid.estimation.prediction import NominalModel, Prediction, Predictor, Variants
from physid.estimation.prediction.effect_parameters import EffectParameter
from physid.physics import SolverError, State, World
from physid.physics.contact import Speculative, Split
from physid.physics.schemes.integration import Midpoint, SemiImplicit
from physid.physics.shapes.table import BOX
from physid.scenes import find_setup
from physid.scenes.scene import Integration

COLLIDE = find_setup("collide").scene
DRAG = from_values("viscous_drag", {"coefficient": 0.2})
WIND = from_values("constant_force", {"x": 0.5, "y": -0.25})


def test_unknowns_are_those_of_bodies_then_those_of_effects_and_their_first_guesses_are_what_is_given() -> None:
    scene = replace(COLLIDE, unknown=("block.mass", "other.mass", "block.friction"))
    names = ("constant_force.y", "viscous_drag.coefficient")
    model = NominalModel(scene, (DRAG, WIND), sizes=names)
    assert model.unknown == (*scene.unknown, *names)
    expected = [scene.value(name) for name in scene.unknown] + [-0.25, 0.2]
    assert model.to_values(model.guess).tolist() == pytest.approx(expected)
    point = model.to_coordinates(torch.tensor([[1.5, 2.5, 0.3, 0.7, 0.4], [1.0, 3.0, 0.2, -0.7, 0.1]]).double())
    sizes = model.sizes_at(point)
    assert {name: value.tolist() for name, value in sizes.items()} == {
        names[0]: pytest.approx([0.7, -0.7]),
        names[1]: pytest.approx([0.4, 0.1]),
    }
    drag, wind = model.effects_at(point)
    assert drag.values()["coefficient"].tolist() == pytest.approx([0.4, 0.1])
    assert wind.values()["y"].tolist() == pytest.approx([0.7, -0.7])
    assert torch.as_tensor(wind.values()["x"]).unique().tolist() == [0.5], "what is known stays"
    there = model.scene_at(point[1])
    assert [there.value(name) for name in scene.unknown] == pytest.approx([1.0, 3.0, 0.2])
    step = 1e-6
    slope = (model.to_values(point + step) - model.to_values(point - step)) / (2 * step)
    assert torch.allclose(model.slopes(point), slope, rtol=1e-7)


def test_each_row_of_a_batch_has_its_own_parameters_and_inertia_follows_the_mass_of_its_body() -> None:
    """Both blocks are of one material: they share what is said of its friction, and neither mass nor size."""
    scene = replace(COLLIDE, unknown=("other.mass", "block.friction"))
    model = NominalModel(scene)
    found = model.parameters(model.to_coordinates(torch.tensor([[0.7, 0.3], [3.0, 0.1]]).double()))
    first, second = scene.bodies
    assert found.mass.tolist() == [pytest.approx([first.mass, 0.7]), pytest.approx([first.mass, 3.0])]
    assert found.friction.tolist() == [pytest.approx([0.3, 0.3]), pytest.approx([0.1, 0.1])]
    assert found.restitution.tolist() == [[first.restitution, second.restitution]] * 2
    assert torch.allclose(found.inertia, BOX.inertia(found.mass, torch.tensor(scene.sizes).double()))
    assert torch.equal(found.size.expand(2, -1, -1), torch.tensor(scene.sizes).double().expand(2, -1, -1))
    state = State(torch.zeros(2, 2, 7).double(), torch.ones(2, 2, 6).double())
    inputs = model.inputs(state, model.guess[None])
    assert not bool(inputs.wrench.any())
    assert torch.equal(inputs.mass.expand(2, -1), torch.tensor([[body.mass for body in scene.bodies]] * 2).double())


def test_rules_are_those_of_the_simulator_that_is_known_and_else_those_of_nobody() -> None:
    free = replace(COLLIDE, integration=None, gravity=(0.0, 1.0, -9.0), time_step=0.02)
    known = replace(free, integration=Integration("semi_implicit_euler", 1 / 240))
    world = NominalModel(free).world
    assert (world.time_step, world.substeps, world.gravity) == (0.02, 1, (0.0, 1.0, -9.0))
    assert world.ground is not None
    assert tuple(world.ground.normal) == tuple(free.ground.normal)
    assert (type(world.contact), type(world.integration)) == (Speculative, Midpoint)
    bullet = NominalModel(known).world
    assert (type(bullet.contact), type(bullet.integration)) == (Split, SemiImplicit)
    given = Speculative()
    assert NominalModel(known, contact=given).world.contact is given
    own = World(0.5)
    assert NominalModel(known, rules=own).world is own


def test_a_parameter_of_an_effect_is_called_by_both_names() -> None:
    one = EffectParameter(find("force_lag"), "time_constant")
    assert one.label == "force_lag.time_constant"
    assert one.quantity.unit == "s"


@pytest.mark.parametrize(("step", "frames"), [(1 / 240, 30), (1 / 100, 12), (1 / 30, 10)])
def test_short_segments_last_for_a_time_and_hold_some_frames_at_least(step: float, frames: int) -> None:
    assert FirstGuess().length(step) == frames


class Fragile(Predictor):
    """Cannot simulate a mass of more than twice the true one."""

    def predict(self, variants: Variants) -> Prediction:
        if bool((variants.nominal[:, 0] > self.model.guess[0] + 0.7).any()):
            raise SolverError("no solution")
        return super().predict(variants)


@pytest.mark.parametrize("factor", [1.0, 0.25, 2.0, 4.0])
@pytest.mark.parametrize("fragile", [False, True])
def test_a_first_guess_that_is_off_by_a_factor_that_is_tried_is_mended_by_that_factor(
    factor: float, fragile: bool
) -> None:
    """Only trajectories that count are inspected; an unknown that changes nothing keeps its guess."""
    made = flights(
        unknown=("block.mass", "block.friction"), sizes=(3.0, -2.0), noise=(0.0, 0.0),
        fitted=torch.tensor([True, True, False, True]),
    )  # fmt: skip
    pose = made.experiment.pose.clone()
    pose[2, :, 0, 0] -= torch.linspace(0, 9, pose.shape[1]).double() ** 2
    experiment = made.experiment.with_known_states().replace(pose=pose)
    old = experiment.predictor
    begun = made.true.replace(nominal=made.true.nominal - torch.tensor([[factor, 1.0]]).double().log())
    if fragile:
        predictor = Fragile(old.model, old.timeline, old.segments, old.candidates)
        experiment = experiment.replace(predictor=predictor)
    fit = FirstGuess(steps=1).fit(experiment, begun)
    assert torch.allclose(fit.point.nominal, made.true.nominal, atol=1e-6)
    assert torch.equal(fit.point.effects, made.true.effects)


@pytest.mark.parametrize("which", [[0], [1], [2], [0, 2], [1, 0], []])
def test_a_model_with_some_of_its_unknowns_knows_the_values_of_the_others(which: list[int]) -> None:
    scene = replace(COLLIDE, unknown=("block.mass", "block.friction"))
    model = NominalModel(scene, (DRAG, WIND), sizes=("viscous_drag.coefficient",))
    values = torch.tensor([1.7, 0.4, 0.9]).double()
    point = model.to_coordinates(values)
    some = model.with_unknown(which, point)
    assert set(some.unknown) == {model.unknown[k] for k in which}
    assert some.scene.unknown == tuple(model.unknown[k] for k in which if k < 2)
    assert some.to_values(some.guess).tolist() == pytest.approx(
        [dict(zip(model.unknown, values.tolist(), strict=True))[name] for name in some.unknown]
    )
    assert [some.scene.value(name) for name in scene.unknown] == pytest.approx([1.7, 0.4])
    drag, wind = some.effects_at(some.guess[None])
    assert float(drag.values()["coefficient"]) == pytest.approx(0.9)
    assert float(wind.values()["y"]) == -0.25
