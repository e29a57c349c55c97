import math

import pytest
import torch

from physid.networks import Encoding
from physid.scenes import find_setup
from physid.training.learners.optimisation import DEFAULT_OPTIMIZER, build_optimizers
from physid.training.learners.supervised import SupervisedID
from physid.training.vision.drawing.synthetic_images import SMOOTH, SyntheticImages, encoding_losses, place_errors
from physid.training.vision.model import VideoModel
from physid.training.vision.reading import chart_of

BACKGROUND = torch.full((4, 3, 128, 128), 0.7)
SIZE = 0.25  # [m]
STEPS, IMAGES = 40, 4


def model_of(scene: str) -> VideoModel:
    """Return a model whose bodies have faces of random colours."""
    torch.manual_seed(0)
    model = SupervisedID(["block.friction"]).attach(find_setup(scene).scene).model
    colours = torch.rand(1, model.chart.bodies, 6, 3, 4, 4)
    patches = torch.nn.functional.interpolate(colours.flatten(0, 2), size=32)
    model.decoder.patches = patches.view(model.decoder.patches.shape)
    return model


def test_the_second_half_of_the_images_has_hard_edges() -> None:
    model = model_of("push")
    pose = SyntheticImages(frames=1).draw_poses(model, 4).expand(-1, 2, -1, -1)
    soft, hard = SyntheticImages(frames=2).draw_images(model, pose, BACKGROUND).unbind(1)
    assert torch.equal(soft, SyntheticImages(frames=1).draw_images(model, pose[:, :1], BACKGROUND)[:, 0])
    changed = (soft != hard).any(1).flatten(1).sum(-1)
    assert (changed > 0).all()
    assert (changed < 200).all()  # pixels: the outline of a block, and edges between its faces


def test_neighbours_are_drawn_side_by_side_and_within_view() -> None:
    model = model_of("collide")
    numbers = model.chart.to_numbers(SyntheticImages(frames=64, near=1.0).draw_poses(model, 4))
    assert numbers[..., :2].abs().max() <= 1 + 1e-5
    distance = (numbers[:, :, 0, :2] - numbers[:, :, 1, :2]).norm(dim=-1)
    assert distance.max() < 0.4


@pytest.mark.slow
def test_some_hundreds_of_images_teach_where_a_body_is() -> None:
    model, synthetic_images = model_of("push"), SyntheticImages(frames=IMAGES)
    optimizer = build_optimizers(DEFAULT_OPTIMIZER, model, 0.0)[0]
    losses = []
    for _ in range(STEPS):
        values = synthetic_images.losses(model, BACKGROUND, SIZE**2)
        loss = torch.stack(list(values.values())).mean(1).sum()
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        losses.append({name: float(value.detach().mean()) for name, value in values.items()})
    first, last = (
        {name: sum(one[name] for one in part) / 10 for name in part[0]} for part in (losses[:10], losses[-10:])
    )
    assert last["imagined_position"] < 0.3 * first["imagined_position"]
    assert last["imagined_features"] < 0.8 * first["imagined_features"]


def test_the_best_answer_is_the_mean_of_places_and_the_median_of_heights() -> None:
    scene = find_setup("slide").scene
    hovering, lying = chart_of(scene, "hovering"), chart_of(find_setup("push").scene, "planar")
    up = torch.tensor(scene.ground.normal)
    across = torch.linalg.cross(up, torch.tensor([0.0, 1.0, 0.0]))
    axes, known = torch.stack([up, across / across.norm()]), torch.tensor([0.0, 0.0, 0.0, 0.05, 0.15])
    answers = torch.linspace(0.0, 0.15, 301)
    error = (answers[:, None] - known)[..., None] * axes[:, None, None, :]
    height, place = answers[place_errors(hovering, error).mean(-1).argmin(1)].tolist()
    assert height < SMOOTH
    assert place == pytest.approx(float(known.mean()), abs=0.001)
    torch.testing.assert_close(place_errors(lying, error), error.square().sum(-1))


@pytest.mark.parametrize("wrong", [0.0, 0.4, math.pi])
def test_features_count_by_how_wrong_headings_are(wrong: float) -> None:
    model = model_of("collide")
    pose = SyntheticImages(frames=8).draw_poses(model, 4)
    numbers = model.chart.to_numbers(pose)
    said = numbers.clone()
    turned = torch.atan2(numbers[..., 3], numbers[..., 2]) + wrong
    said[..., 2], said[..., 3] = turned.cos(), turned.sin()
    early, late = torch.rand(4, 8, 256), torch.rand(4, 8, 128)
    encoding = Encoding(pose, said.requires_grad_(True), torch.zeros(4, 8), early, late)
    losses = encoding_losses(model, encoding, pose, SIZE**2)
    error = 2 - 2 * math.cos(wrong)  # |e^(i (a + wrong)) - e^(i a)|^2
    expected = min(error, 1.0) * SIZE**2 * model.supervision(model.chart, encoding, numbers)
    assert torch.allclose(losses["features"], expected, atol=1e-5)
    (slope,) = torch.autograd.grad(losses["features"].sum(), said, allow_unused=True)
    assert slope is None  # the weight is no goal: the heading's own loss is


@pytest.mark.parametrize("wrong", [{"frames": -1}, {"extent": 1.1}, {"near": math.inf}])
def test_what_cannot_be_drawn_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="synthetic_images needs"):
        SyntheticImages(**wrong)  # type: ignore[arg-type]
