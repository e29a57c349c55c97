"""Boxes in free flight under a constant force: experiments that are linear, so that least squares are known exactly."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.effects import find
from physid.estimation.least_squares.experiment import Experiment, lay_out
from physid.estimation.least_squares.settings import LeastSquaresSettings
from physid.estimation.prediction import NominalModel, Predictor, Segmentation, Timeline, Variants
from physid.physics.rotations import exponential, multiply
from physid.scenes import find_setup

TOSS = replace(find_setup("toss").scene, time_step=1 / 60)
MASS, G = TOSS.bodies[0].mass, 9.81
NOISE = (2e-3, 1e-3)  # [rad, m]
FORCE = (0.8, -0.3)  # [N] along x and y


@dataclass(frozen=True)
class Flights:
    """An experiment, and the point that its poses were made at.

    Attributes:
        experiment: What was seen.
        true: Initial states and effects without noise.
        start: The same initial states without effects.
    """

    experiment: Experiment
    true: Variants
    start: Variants


def flights(
    *,
    trajectories: int = 4,
    frames: int = 24,
    cuts: int = 2,
    kinds: tuple[str, ...] = ("constant_force",),
    sizes: tuple[float, ...] = FORCE,
    noise: tuple[float, float] = NOISE,
    fitted: Tensor | None = None,
    seed: int = 0,
    settings: LeastSquaresSettings | None = None,
    unknown: tuple[str, ...] = (),
    push: tuple[float, ...] = (),
) -> Flights:
    """Fly boxes high above the ground, predicted by the layer itself, and add white noise.

    Those of each trajectory may be pushed upwards by a force of its own.
    """
    generator = torch.Generator().manual_seed(seed)
    scene = replace(TOSS, unknown=unknown)
    model, wrench = NominalModel(scene), torch.zeros(trajectories, frames, 1, 6, dtype=torch.float64)
    if push:
        wrench[..., 0, 5] = torch.tensor(push, dtype=torch.float64)[:, None]
    segments = Segmentation.equal(trajectories, frames, frames // cuts)
    timeline = Timeline.regular(wrench, scene.time_step)
    predictor = Predictor(model, timeline, segments, [find(kind) for kind in kinds])
    count = len(segments)
    pose, twist = torch.zeros(1, count, 1, 7, dtype=torch.float64), torch.zeros(1, count, 1, 6, dtype=torch.float64)
    pose[..., :3] = torch.randn(1, count, 1, 3, generator=generator, dtype=torch.float64)
    pose[..., 2] += 50.0
    pose[..., 3:] = exponential(torch.randn(1, count, 1, 3, generator=generator, dtype=torch.float64))
    twist[..., 3:] = torch.randn(1, count, 1, 3, generator=generator, dtype=torch.float64)
    start = Variants.of_states(pose, twist, model.guess[None], predictor.null[None])
    true = start.replace(effects=torch.tensor([sizes], dtype=torch.float64))
    seen = predictor.predict(true).pose[0]
    white = torch.randn(*seen.shape[:-1], 6, generator=generator, dtype=torch.float64)
    spread = torch.tensor([noise[0]] * 3 + [noise[1]] * 3, dtype=torch.float64)
    off = white * spread
    seen = torch.cat([seen[..., :3] + off[..., 3:], multiply(exponential(off[..., :3]), seen[..., 3:])], -1)
    scale = (1 / torch.tensor([NOISE[0]] * 3 + [NOISE[1]] * 3, dtype=torch.float64)).expand_as(off).clone()
    every = torch.ones(trajectories, dtype=torch.bool) if fitted is None else fitted
    experiment, _ = lay_out(predictor, seen, scale, every, 0.0, settings or LeastSquaresSettings())
    return Flights(experiment, true, start)
