"""Effects in predictions: as candidates, as unknowns of the model, and beside a clock of the camera."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physid.effects import find, from_values
from physid.estimation.prediction import NominalModel, Predictor, Segmentation, Timeline, Variants
from physid.scenes import find_setup


@pytest.mark.parametrize(
    ("name", "sizes"), [("constant_force", (0.5, -1.0)), ("camera_offset", (0.1, 0.2, -0.3)), ("force_gain", (0.5,))]
)
def test_an_effect_moves_predictions_alike_as_a_candidate_and_as_an_unknown_of_the_model(
    name: str, sizes: tuple[float, ...]
) -> None:
    kind, frames = find(name), 8
    names = tuple(f"{name}.{each}" for each in kind.quantities())
    wrench = torch.zeros(2, frames, 1, 6).double()
    wrench[0, :, 0, 3], wrench[1, :, 0, 4] = 5.0, -2.0
    timeline, segments = Timeline.regular(wrench, 1 / 60), Segmentation.equal(2, frames, 4)
    scene = replace(find_setup("toss").scene, time_step=1 / 60)
    zero = from_values(name, dict.fromkeys(kind.quantities(), 0.0))
    inside = Predictor(NominalModel(scene, (zero,), sizes=names), timeline, segments)
    beside = Predictor(NominalModel(scene), timeline, segments, [kind])
    pose, twist = torch.zeros(2, 4, 1, 7).double(), torch.zeros(2, 4, 1, 6).double()
    pose[..., 2], pose[..., 6], twist[0, :, 0, 3] = 9.0, 1.0, torch.arange(4.0).double()
    many = torch.tensor([sizes, [0.3 * size for size in sizes]]).double()
    none = torch.zeros(2, 0).double()
    one = inside.predict(Variants.of_states(pose, twist, inside.model.to_coordinates(many), none))
    other = beside.predict(Variants.of_states(pose, twist, none, many))
    assert torch.allclose(one.pose, other.pose, atol=1e-12)
    assert torch.allclose(one.twist, other.twist, atol=1e-12)
    still = beside.predict(Variants.of_states(pose, twist, none, 0 * many))
    assert float((one.pose - still.pose).abs().max()) > 1e-4


def test_a_clock_that_runs_off_by_nothing_leaves_a_late_force_as_it_is() -> None:
    wrench = torch.zeros(2, 10, 1, 6).double()
    wrench[0, 4:, 0, 3], wrench[1, 2:, 0, 4] = 5.0, -2.0
    timeline, segments = Timeline.regular(wrench, 1 / 60), Segmentation.equal(2, 10, 5)
    scene = replace(find_setup("toss").scene, time_step=1 / 60)
    predictor = Predictor(NominalModel(scene), timeline, segments, [find("clock_rate"), find("force_delay")])
    pose, twist = torch.zeros(3, 4, 1, 7).double(), torch.zeros(3, 4, 1, 6).double()
    pose[..., 2], pose[..., 6] = 9.0, 1.0
    effects = torch.tensor([[0.0, 0.02], [1e-12, 0.02], [1e-12, 0.0]]).double()
    none = torch.zeros(3, 0).double()
    found = predictor.predict(Variants.of_states(pose, twist, none, effects)).pose
    alone = predictor.predict(Variants.of_states(pose[:1], twist[:1], none[:1], effects[:1])).pose
    assert torch.allclose(found[1], alone[0], atol=1e-8)
    assert torch.allclose(found[0], alone[0], atol=1e-8)
    assert float((found[2] - found[1]).abs().max()) > 1e-4
