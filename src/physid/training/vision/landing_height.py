"""Initial heights of bodies that hover, from when they land: a single image hardly shows how far away a body is."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor

from physid.estimation.measurement import pose_difference
from physid.networks import PlanarChart
from physid.physics import Parameters, PhysicsLayer, State
from physid.training.parameters import PoseLoss, Trajectories

PASSES = 4
DIFFERENCE = 2e-3
"""Of a height [m], for its derivative."""
LONGEST = 0.05
"""Longest step of a height [m]."""
FAINT = 1e-12
"""Squares of derivatives that count as none, say of a height below the ground."""


@final
@dataclass(frozen=True)
class LandingHeight:
    """Trajectories whose initial heights are fitted to their motion, each to its own.

    A body that starts higher, at the same place in the image, lands later and stays behind. Heights are unknowns of
    each trajectory beside the parameters of all of them, so that the parameters only answer for what no height
    explains: J - S (S^T W S)^-1 S^T W J, with S the derivatives by the heights (variable projection, Golub & Pereyra
    1973).

    Attributes:
        trajectories: With origins at the fitted heights, and goals as far away as predicted.
        slopes: S, derivatives of the residuals by the height of each of N bodies, shape (N, B, T, N, 6).
        rays: Unit vectors from the camera to the goals, shape (B, T, N, 3).
    """

    trajectories: Trajectories
    slopes: Tensor
    rays: Tensor

    def reduce(self, answer: Tensor, loss: PoseLoss, real: Tensor) -> Tensor:
        """Take out of the derivatives J (P, B, T, N, 6) what other heights would do as well; the same shape."""
        scale = _scale(loss, real, answer)
        slopes = (scale * self.slopes).flatten(2).permute(1, 2, 0)
        wanted = (scale * _across(answer, self.rays)).flatten(2).permute(1, 2, 0)
        rest = wanted - slopes @ _solve(slopes, wanted)
        return rest.permute(2, 0, 1).reshape(answer.shape) / scale.clamp_min(FAINT)


@torch.no_grad()
def land(
    layer: PhysicsLayer,
    parameters: Parameters,
    chart: PlanarChart,
    eye: Sequence[float],
    loss: PoseLoss,
    trajectories: Trajectories,
    real: Tensor,
) -> LandingHeight:
    """Fit the initial heights of trajectories by some Gauss-Newton steps, along the rays from the camera.

    Args:
        layer: The physics, on the device of the trajectories.
        parameters: Its parameters.
        chart: Gives the ground that bodies hover over.
        eye: Where the camera is [m].
        loss: What errors of predicted poses cost.
        trajectories: Initial states, wrenches, and the poses that should come out, read from images: their depth does
            not count.
        real: Which frames count, shape (B, T).
    """
    camera = trajectories.pose.new_tensor(eye)
    normal = chart.normal.to(camera)
    goal, start = trajectories.pose, trajectories.start
    rays = torch.nn.functional.normalize(goal[..., :3] - camera, dim=-1)
    upwards = start.pose[..., :3] - camera
    upwards = upwards / (upwards @ normal)[..., None]
    height = goal.new_zeros(goal.shape[0], goal.shape[2])
    floor = -chart.to_numbers(start.pose)[..., 4] * chart.down.to(camera).norm(dim=-1)

    def first(height: Tensor) -> State:
        return State(
            torch.cat([start.pose[..., :3] + height[..., None] * upwards, start.pose[..., 3:]], -1), start.twist
        )

    def predict(height: Tensor) -> Tensor:
        return layer.rollout(first(height), trajectories.wrench[:, :-1], parameters).pose

    def answer(height: Tensor) -> Tensor:
        moves = DIFFERENCE * torch.eye(goal.shape[2]).to(goal)
        sides = [torch.stack([predict(height + side * move) for move in moves]) for side in (1, -1)]
        return _across(pose_difference(*sides) / (2 * DIFFERENCE), rays)

    scale = _scale(loss, real, goal)
    for _ in range(PASSES):
        residual = _across(pose_difference(predict(height), goal), rays)
        slopes = (scale * answer(height)).flatten(2).permute(1, 2, 0)
        step = -_solve(slopes, (scale * residual).flatten(1)[..., None])[..., 0]
        height = torch.maximum(height + step.clamp(-LONGEST, LONGEST), floor)
    predicted, slopes = predict(height), answer(height)
    away = ((predicted[..., :3] - goal[..., :3]) * rays).sum(-1, keepdim=True)
    goal = torch.cat([goal[..., :3] + away * rays, goal[..., 3:]], -1)
    origin = torch.cat([first(height).pose, start.twist], -1)
    return LandingHeight(dataclasses.replace(trajectories, pose=goal, origin=origin), slopes, rays)


def _across(value: Tensor, rays: Tensor) -> Tensor:
    """Take out of residuals, or of their derivatives (..., 6), the part along the rays (B, T, N, 3)."""
    along = (value[..., 3:] * rays).sum(-1, keepdim=True)
    return torch.cat([value[..., :3], value[..., 3:] - along * rays], -1)


def _scale(loss: PoseLoss, real: Tensor, like: Tensor) -> Tensor:
    """Return the roots of the weights of the residuals, shape (B, T, 1, 6)."""
    parts = like.new_tensor([loss.rotation_weight**0.5] * 3 + [1.0] * 3)
    return real.to(like)[..., None, None] * parts


def _solve(slopes: Tensor, wanted: Tensor) -> Tensor:
    """Solve the normal equations of (B, M, K) x = (B, M, P); x is 0 where nothing answers."""
    square = slopes.mT @ slopes
    empty = square.diagonal(dim1=-2, dim2=-1) < FAINT
    x: Tensor = torch.linalg.solve(square + torch.diag_embed(empty.to(square)), slopes.mT @ wanted)
    return torch.where(empty[..., None], 0.0, x)
