"""The paper's loss and its curvature, against independent formulas."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from physid.estimation.measurement.poses import pose_difference
from physid.training.parameters.metrics import PositionError, RotationError
from physid.training.parameters.pose_loss import PoseLoss

CLOSE = 1e-10
REAL = torch.tensor([[True] * 5, [True, True, True, False, False]])


def poses(seed: int) -> Tensor:
    generator = np.random.default_rng(seed)
    turn = Rotation.random(20, generator).as_quat().reshape(2, 5, 2, 4)
    return torch.from_numpy(np.concatenate([generator.normal(size=(2, 5, 2, 3)), turn], -1))


def test_the_loss_is_the_sum_over_bodies_of_the_mean_over_real_frames() -> None:
    predicted, recorded = poses(0), poses(1)
    parts = PoseLoss()(pose_difference(predicted, recorded), REAL)
    for each in range(2):
        frames = int(REAL[each].sum())
        turn = Rotation.from_quat(recorded[each].reshape(-1, 4 + 3)[:, 3:]).inv() * Rotation.from_quat(
            predicted[each].reshape(-1, 7)[:, 3:]
        )
        angle = turn.magnitude().reshape(5, 2)[:frames]
        shift = (predicted - recorded)[each, :frames, :, :3].square().sum().item()
        assert parts["rotation"][each].item() == pytest.approx((angle**2).sum() / frames)
        assert parts["position"][each].item() == pytest.approx(shift / frames)


@pytest.mark.parametrize("robust", [None, 0.5])
def test_the_weights_give_the_curvature_of_the_loss_with_linearised_residuals(robust: float | None) -> None:
    loss = PoseLoss(rotation_weight=0.3, robust=robust)
    slope = torch.randn(2, 2, 5, 2, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(0))

    def squared(weights: Tensor, move: Tensor) -> Tensor:
        residual = torch.einsum("pbtni,p->btni", slope, move)
        return (weights * loss_without_scale(residual)).sum()

    def loss_without_scale(residual: Tensor) -> Tensor:
        square = residual.square().sum(2)
        return square[..., 3:].sum(-1) + 0.3 * square[..., :3].sum(-1)

    here = pose_difference(poses(0), poses(1))
    weights = REAL / REAL.sum(1, keepdim=True) / 2
    if robust is not None:
        weights = weights / (1 + loss_without_scale(here) / robust**2)
    expected = torch.autograd.functional.hessian(lambda move: squared(weights, move), torch.zeros(2).double())
    scaled = slope * loss.weights(here, REAL).sqrt()
    found = 2 * torch.einsum("pbtni,qbtni->pq", scaled, scaled) / len(REAL)
    assert torch.allclose(found, expected, atol=CLOSE)


def test_errors_add_up_and_are_divided_once() -> None:
    predicted, recorded = poses(0), poses(1)
    size = torch.tensor([0.5, 2.0]).double()
    for whole, parts in [(PositionError(size), PositionError(size)), (RotationError(), RotationError())]:
        whole.update(predicted, recorded, REAL)
        for each in range(2):
            parts.update(predicted[each : each + 1], recorded[each : each + 1], REAL[each : each + 1])
        assert float(whole.compute()) == pytest.approx(float(parts.compute()))
        assert float(whole.deviation()) == pytest.approx(float(parts.deviation()))


def test_the_position_error_is_a_share_of_the_mean_edge() -> None:
    metric = PositionError(torch.tensor([0.5, 2.0]).double())
    recorded = poses(0)
    moved = recorded.clone()
    moved[..., 0] += 0.1
    metric.update(moved, recorded, REAL)
    assert float(metric.compute()) == pytest.approx((0.1 / 0.5 + 0.1 / 2.0) / 2)
    assert float(metric.deviation()) == pytest.approx(np.std([0.2, 0.05, 0.2, 0.05], ddof=1))
