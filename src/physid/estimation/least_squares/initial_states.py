"""First guesses of the states in which segments start, from the observed poses alone."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physid.estimation.least_squares.settings import GuessSettings
from physid.estimation.prediction.segments import Segmentation
from physid.physics.rotations import conjugate, exponential, logarithm, multiply
from physid.physics.shapes.table import reach
from physid.scenes import Scene
from physid.scenes.lying import face_heading, ground_axes, lay_down, quarter, turn_flat

DEFAULT = GuessSettings()


@dataclass(frozen=True)
class InitialStates:
    """Guessed states at the first frames of segments.

    Attributes:
        pose: Guesses, shape (G, K, N, 7).
        twist: Shape (G, K, N, 6).
        resting: Bodies that lie flat on the ground and stay there at first, shape (K, N).
        level: Bodies with a face parallel to the ground in all frames, as far as noise tells, shape (K, N).
        parallel: Bodies with a face parallel to one of the first body, and the first itself, none of which turns about
            the ground's normal in any frame, within noise, shape (K, N).
    """

    pose: Tensor
    twist: Tensor
    resting: Tensor
    level: Tensor
    parallel: Tensor


def guess_initial_states(
    pose: Tensor,
    seen: Tensor,
    time: Tensor,
    segments: Segmentation,
    scene: Scene,
    lean: float = 0.0,
    settings: GuessSettings = DEFAULT,
) -> InitialStates:
    """Guess initial states from the first frames of each segment.

    A body that lies on the ground is put exactly there, without tumbling: then only its motion in the ground's plane
    is free. The last guess lets it be at rest, for the way back to rest from a wrong initial velocity has no slope.
    Other bodies are taken to fall freely for a while; the shorter the while, the less an impact disturbs.

    Args:
        pose: Observed poses, shape (R, T, N, 7).
        seen: Weights of the frames, 0 for those to ignore, shape (R, T, N).
        time: Times of the frames [s], shape (R, T).
        segments: How trajectories are cut.
        scene: Sizes, ground, time step.
        lean: Noise of each component of a rotation [rad], to judge by what is level.
        settings: Which frames, and when a body lies on the ground.
    """
    bodies, guesses = pose.shape[2], len(settings.spans) + 1
    initial = InitialStates(
        pose.new_zeros(guesses, len(segments), bodies, 7),
        pose.new_zeros(guesses, len(segments), bodies, 6),
        *(torch.zeros(len(segments), bodies, dtype=torch.bool) for _ in range(3)),
    )
    for batch in segments.batches:
        cut, weight = batch.cut(pose[None])[0], batch.cut(seen[None], fill=0.0)[0]
        clock = batch.cut(time[None])[0]
        clock = clock - clock[:, :1]
        guessed = _guess(cut, weight, clock, scene, settings)
        for name in ("pose", "twist"):
            getattr(initial, name)[:, batch.segments] = getattr(guessed, name)
        initial.resting[batch.segments] = guessed.resting
        initial.level[batch.segments] = _is_level(cut, weight, scene, settings.level * lean)
        initial.parallel[batch.segments] = _is_parallel(cut, weight, clock, scene, lean, settings)
    initial.resting[_sinks(pose, seen, scene, settings)[segments.trajectory, segments.start]] = False
    return initial


def _is_level(cut: Tensor, weight: Tensor, scene: Scene, lean: float) -> Tensor:
    """Return which bodies never lean further than by a noise, from poses (K, L, N, 7) and weights (K, L, N).

    A lean of two components has a mean square of 2 sigma^2.
    """
    _, angle = turn_flat(cut[..., 3:], cut.new_tensor(scene.ground.normal))
    mean = (weight * angle**2).sum(1) / weight.sum(1).clamp_min(1)
    return mean <= 2 * lean**2


def _is_parallel(
    cut: Tensor, weight: Tensor, time: Tensor, scene: Scene, lean: float, settings: GuessSettings
) -> Tensor:
    """Return which bodies keep their headings, parallel to the first one, within a noise; see `InitialStates`.

    The difference of two headings has a variance of 2 sigma^2.
    """
    heading = face_heading(cut[..., 3:], ground_axes(cut.new_tensor(scene.ground.normal))[:2])
    turned, apart = quarter(heading - heading[:, :1]), quarter(heading - heading[..., :1])
    turned = turned - (weight * turned).sum(1, keepdim=True) / weight.sum(1, keepdim=True).clamp_min(1)
    most = (settings.turned * lean) ** 2
    keeps = _smooth_square(turned, weight, time) <= most
    alike = _smooth_square(apart, weight * weight[..., :1], time) <= 2 * most
    parallel = keeps & keeps[:, :1] & alike
    parallel[:, 0] = parallel[:, 1:].any(1)
    return parallel


def _smooth_square(value: Tensor, weight: Tensor, time: Tensor) -> Tensor:
    """Sum the squares of the parabola through values (K, L, N) over the frames, shape (K, N).

    Of pure noise it is sigma^2 times a chi-square of at most three degrees of freedom, however many frames there are.
    """
    a, b, c = (part[:, None, :, 0] for part in _polynomial(value[..., None], weight, time, 2))
    clock = time[..., None]
    return (weight * (a + b * clock + c * clock**2).square()).sum(1)


def _sinks(pose: Tensor, seen: Tensor, scene: Scene, settings: GuessSettings) -> Tensor:
    """Return which bodies get nearer to the ground soon after each frame: they did not lie on it, shape (R, T, N)."""
    normal, size = pose.new_tensor(scene.ground.normal), pose.new_tensor(scene.sizes)
    half = reach((), pose[..., 3:], size, normal)
    bottom = pose[..., :3] @ normal - half
    median = settings.median
    frames = max(median, round(settings.soon / scene.time_step))
    last = torch.full_like(bottom[:, :1], torch.inf).expand(-1, frames + median - 2, -1)
    known = torch.cat([torch.where(seen > 0, bottom, torch.inf), last], 1)
    smooth = known.unfold(1, median, 1).median(-1).values
    lowest = smooth.unfold(1, frames, 1).amin(-1)
    return smooth[:, : bottom.shape[1]] - lowest > settings.sinks * 2 * half


def _guess(cut: Tensor, weight: Tensor, time: Tensor, scene: Scene, settings: GuessSettings) -> InitialStates:
    """Guess initial states from poses (K, L, N, 7), weights (K, L, N) and times (K, L) of the frames of segments."""
    length = cut.shape[1]
    anchor = cut[:, :1, :, 3:]
    turn = logarithm(multiply(cut[..., 3:], conjugate(anchor.expand_as(cut[..., 3:]))))
    motion = torch.cat([turn, cut[..., :3]], -1)
    frames = [min(max(settings.fewest, round(span / scene.time_step)), length) for span in settings.spans]
    gravity = torch.tensor(scene.gravity, dtype=cut.dtype)
    dropped = torch.cat([torch.zeros(3, dtype=cut.dtype), gravity / 2]) * time[..., None, None] ** 2
    still, resting = _lying(motion[:, : frames[0]], weight, time, anchor, scene, settings)
    poses, twists = [], []
    for count in frames:
        value, slope, _ = _polynomial((motion - dropped)[:, :count], weight, time, 1)
        (pose, twist), _ = _lying(motion[:, :count], weight, time, anchor, scene, settings)
        poses.append(torch.where(resting[..., None], pose, _compose(value, anchor)))
        twists.append(torch.where(resting[..., None], twist, slope))
    poses.append(torch.where(resting[..., None], still[0], poses[-1]))
    twists.append(torch.where(resting[..., None], 0 * still[1], twists[-1]))
    return InitialStates(torch.stack(poses), torch.stack(twists), resting, resting, resting)


def _lying(
    motion: Tensor, weight: Tensor, time: Tensor, anchor: Tensor, scene: Scene, settings: GuessSettings
) -> tuple[tuple[Tensor, Tensor], Tensor]:
    """Return the states that bodies have if they lie on the ground, and whether they do."""
    normal = torch.tensor(scene.ground.normal, dtype=motion.dtype)
    value, slope, bend = _polynomial(motion, weight, time, 2)
    pose, lean, gap, height = lay_down(_compose(value, anchor), scene)
    last = time[:, motion.shape[1] - 1, None]
    fall = abs(float(torch.tensor(scene.gravity, dtype=motion.dtype) @ normal)) * last**2 / 2
    speed, spin = slope[..., 3:] @ normal, slope[..., :3] @ normal
    sunk = (speed * last + (bend[..., 3:] @ normal) * last**2).abs()
    resting = (lean < settings.flat) & (gap.abs() < settings.near * height) & (sunk < settings.steady * fall)
    twist = torch.cat([spin[..., None] * normal, slope[..., 3:] - speed[..., None] * normal], -1)
    return (pose, twist), resting


def _compose(value: Tensor, anchor: Tensor) -> Tensor:
    """Return poses from rotation vectors relative to attitudes (K, 1, N, 4), and positions; value is (K, N, 6)."""
    return torch.cat([value[..., 3:], multiply(exponential(value[..., :3]), anchor[:, 0])], -1)


def _polynomial(value: Tensor, weight: Tensor, time: Tensor, degree: int) -> tuple[Tensor, Tensor, Tensor]:
    """Fit a + b t + c t^2 to (K, L, N, 6) with weights and times that go on; returns a, b, c, each (K, N, 6)."""
    count = value.shape[1]
    last = time[:, count - 1].clamp_min(1e-9)
    basis = torch.stack([(time[:, :count] / last[:, None]) ** k for k in range(degree + 1)], -1)
    weight, last = weight[:, :count], last[:, None, None]
    gram = torch.einsum("wtn,wti,wtj->wnij", weight, basis, basis) + 1e-9 * torch.eye(degree + 1, dtype=value.dtype)
    solved = torch.linalg.solve(gram, torch.einsum("wtn,wti,wtnk->wnik", weight, basis, value))
    bend = solved[..., 2, :] / last**2 if degree == 2 else torch.zeros_like(solved[..., 0, :])
    return solved[..., 0, :], solved[..., 1, :] / last, bend
