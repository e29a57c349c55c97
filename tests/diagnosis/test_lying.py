"""Bodies that lie on the ground lie there with the sizes that effects give them, in the model and in references."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from diagnosis.sets import recorded
from physid.data import RecordingSet
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import load_observations
from physid.diagnosis.reference.nominal_fit import fit_nominal_model
from physid.diagnosis.reference.replay import references_of, replay
from physid.diagnosis.settings.reference import ReplaySettings
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing.hypothesis import begin_hypothesis, conclude, finish_hypothesis
from physid.effects import find
from physid.estimation.least_squares.jacobian import Directions, differentiate
from physid.estimation.prediction import NominalModel, Predictor, Segmentation, Timeline, Variants
from physid.scenes import find_setup
from physid.scenes.lying import lay_down

SCENE = find_setup("push").scene
FRAMES = 12
CHANGE = 0.05
STILL = 2e-5  # [m] twice as deep as contacts at rest are
SIZE = find("object_size")


def predictor(*, lying: bool = True, model: NominalModel | None = None) -> Predictor:
    """Return one of a block and a second one that start where nothing pushes them."""
    timeline = Timeline.regular(torch.zeros(2, FRAMES, 1, 6, dtype=torch.float64), 1 / 60)
    segments = replace(Segmentation.equal(2, FRAMES, FRAMES), lying=torch.tensor([[lying], [False]]))
    return Predictor(model or NominalModel(SCENE), timeline, segments, (SIZE,))


def variants(one: Predictor, *changes: float) -> Variants:
    """Return the first block laid on the ground as measured, the second held above it; a variant for each change."""
    pose = torch.tensor([[0.0, 0.0, 0.1, 0, 0, 0, 1], [1.0, 0.0, 3.0, 0, 0, 0, 1]], dtype=torch.float64)[:, None]
    pose[0] = lay_down(pose[0], SCENE).pose
    twist = torch.zeros(1, 2, 1, 6, dtype=torch.float64)
    effects = torch.tensor([changes], dtype=torch.float64).T
    many = Variants.of_states(pose[None], twist, one.model.guess[None], one.null[None]).repeat(len(changes))
    return many.replace(effects=effects)


def heights(pose: Tensor) -> Tensor:
    """Return how high the block lies above where its measured size would let it lie."""
    return pose[..., 0, :, 0, 2] - SCENE.sizes[0, 2] / 2


def test_a_larger_body_lies_higher_from_the_first_frame_on_and_one_in_the_air_is_where_it_was_seen() -> None:
    one = predictor()
    many = variants(one, 0.0, CHANGE, -CHANGE)
    predicted = one.predict(many)
    higher = torch.tensor([0.0, CHANGE, -CHANGE], dtype=torch.float64)[:, None] * SCENE.sizes[0, 2] / 2
    assert (heights(predicted.state) - higher).abs().max() < STILL
    assert torch.equal(predicted.state[:, 1, 0, 0, :3], many.pose[:, 1, 0, :3])
    assert torch.equal(one.begun(many).pose, predicted.state[:, :, 0])


def test_an_effect_that_the_model_knows_raises_as_well() -> None:
    known = SIZE(change=torch.tensor([CHANGE], dtype=torch.float64))
    one = predictor(model=NominalModel(SCENE, effects=(known,)))
    first = one.predict(variants(one, 0.0)).state
    assert (heights(first) - CHANGE * SCENE.sizes[0, 2] / 2).abs().max() < STILL


def test_a_body_that_is_not_said_to_lie_starts_where_it_is() -> None:
    one = predictor(lying=False)
    many = variants(one, 0.0, CHANGE)
    assert torch.equal(one.begun(many).pose, many.pose)
    assert one.of_lying(None).begun(many) is many


def test_the_height_follows_the_size_in_a_derivative() -> None:
    one = predictor()
    normal = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    free = Directions.of(normal, torch.tensor([[True], [False]]))
    slope = differentiate(one, variants(one, 0.0), free, torch.tensor([0])).shared[-1]
    assert slope[0, :, 0, 5] == pytest.approx(SCENE.sizes[0, 2] / 2, rel=0.01)
    assert slope[1, 0].abs().max() == 0


@pytest.mark.parametrize("reference", references_of(SCENE, ReplaySettings()), ids=lambda one: one.name)
def test_references_start_from_the_same_states(reference: object) -> None:
    one = predictor()
    point = variants(one, CHANGE)
    working = SIZE(change=torch.tensor([CHANGE], dtype=torch.float64))
    seen = replay(
        one.model,
        one.timeline,
        one.segments,
        point,
        ReplaySettings(),
        (working,),
        reference=reference,  # type: ignore[arg-type]
    )
    assert torch.allclose(seen[:, 0], one.begun(point).pose[0], rtol=0, atol=1e-15)
    assert (heights(seen) - CHANGE * SCENE.sizes[0, 2] / 2).abs().max() < STILL
    assert (seen[1] - one.predict(point).state[0, 1])[..., :3].abs().max() < STILL


def test_bodies_that_lie_keep_their_heights_where_a_rival_saw_them_higher() -> None:
    tilted = torch.tensor([0.6, 0.0, 0.8], dtype=torch.float64)
    free = Directions.of(tilted, torch.tensor([[True], [False]]))
    here = torch.tensor([[[0.1, 0.2, 0.3, 0, 0, 0, 1]], [[0.1, 0.2, 0.3, 0, 0, 0, 1]]], dtype=torch.float64)
    there = here + torch.tensor([0.3, 0.1, 0.5, 0, 0, 0, 0], dtype=torch.float64)
    kept = free.with_heights_of(here, there)
    assert torch.equal(kept[1], there[1])
    assert kept[0, 0, :3] @ tilted == pytest.approx(here[0, 0, :3] @ tilted)
    along = torch.tensor([[0.8, 0.0, -0.6], [0.0, 1.0, 0.0]], dtype=torch.float64)
    assert along @ kept[0, 0, :3] == pytest.approx(along @ there[0, 0, :3])
    assert torch.equal(kept[0, 0, 3:], there[0, 0, 3:])


@pytest.mark.parametrize("simulator", ["pybullet", "mujoco"])
@pytest.mark.slow
def test_the_size_of_a_body_that_slides_is_found_and_leaves_nothing(tmp_path: Path, simulator: str) -> None:
    """A camera that stands higher explained more than the size itself did, while blocks started in the ground."""
    pytest.importorskip(simulator)
    folder = recorded(
        tmp_path / "set", {"object_size": {"change": CHANGE}}, simulator=simulator, trajectories=3, split={"fit": 1}
    )
    observations, settings = load_observations(RecordingSet(folder)), Settings()
    generator, kinds = torch.Generator().manual_seed(0), (SIZE, find("camera_offset"))
    model = read_nominal_model(observations.scene, None)
    nominal = fit_nominal_model(observations, model, kinds, generator)
    start = nominal.experiment.linearise(nominal.fit.point, torch.arange(4))
    size, camera = (
        finish_hypothesis(begin_hypothesis(nominal.experiment, start, (kind.name,), settings)) for kind in kinds
    )
    before = conclude(nominal.experiment, nominal.fit, (), settings)
    assert nominal.experiment.predictor.segments.lying is not None
    assert size.values["object_size.change"] == pytest.approx(CHANGE, rel=0.02)
    assert float((before.held_out - size.held_out).sum()) > 0.99 * float((before.held_out - camera.held_out).sum())
