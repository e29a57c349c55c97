"""The reference simulator: the experiment replayed by PyBullet, from the same states and with the same parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import torch
from torch import Tensor

from physid.estimation.prediction.nominal_model import NominalModel
from physid.estimation.prediction.rollout import Variants, restarts
from physid.estimation.prediction.segments import Segmentation
from physid.estimation.prediction.step_effects import AtStep, has
from physid.physics.effect import Effect
from physid.scenes.catalogue import with_parameters
from physid.scenes.setup import Excitation


def replay(
    model: NominalModel,
    wrench: Tensor,
    segments: Segmentation,
    point: Variants,
    effects: Sequence[Effect] = (),
    chosen: Tensor | None = None,
) -> Tensor:
    """Simulate segments in PyBullet.

    Args:
        model: The nominal model.
        wrench: Commanded wrenches, shape (R, T, N, 6).
        segments: How trajectories are cut.
        point: Initial states and unknown parameters, a single variant.
        effects: Effects beside those of the nominal model.
        chosen: Which segments, shape (K,); None for all.

    Returns:
        Poses that the camera would report, shape (R, T, N, 7); zeros outside the chosen segments.
    """
    from physid.simulators.bullet.world import simulate_all

    working = (*model.effects, *effects)
    values = dict(zip(model.unknown, model.to_values(point.nominal[0]).tolist(), strict=True))
    scene = dataclasses.replace(with_parameters(model.scene, values), camera=None)
    for effect in working:
        wrench = effect.actuate(wrench, scene.time_step)
    steps = [AtStep(effect) for effect in working if has(type(effect), "act")]
    seen = torch.zeros(*wrench.shape[:-1], 7, dtype=wrench.dtype)
    wanted = list(range(len(segments))) if chosen is None else chosen.nonzero()[:, 0].tolist()
    places = [
        tuple(int(value[segment]) for value in (segments.trajectory, segments.start, segments.size))
        for segment in wanted
    ]
    initial = [
        Excitation(
            point.pose[0, segment].numpy(), point.twist[0, segment].numpy(), wrench[row, first : first + size].numpy()
        )
        for segment, (row, first, size) in zip(wanted, places, strict=True)
    ]
    clocks = [first * scene.time_step for _, first, _ in places]
    motions = simulate_all(scene, initial, steps, model.substeps, clocks)
    for (row, first, size), motion in zip(places, motions, strict=True):
        pose = torch.from_numpy(motion.pose)
        for effect in working:
            pose = effect.observe(pose[None], scene.time_step)[0] if restarts(effect) else pose
        seen[row, first : first + size] = pose
    for effect in working:
        seen = seen if restarts(effect) else effect.observe(seen, scene.time_step)
    return seen
