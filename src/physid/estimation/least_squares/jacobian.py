"""Derivatives of predicted poses by batched differences: one rollout for all columns at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.estimation.least_squares.settings import DifferenceSettings
from physid.estimation.measurement.poses import pose_difference
from physid.estimation.prediction.rollout import Predictor
from physid.estimation.prediction.segments import Segmentation
from physid.estimation.prediction.variants import Prediction, Variants
from physid.physics.rotations import exponential, multiply
from physid.scenes.lying import face_heading, ground_axes, quarter, turn_flat

DEFAULT = DifferenceSettings()
SHIFTS = 6  # turns and shifts come before spins and speeds
SLOPES = (1e-3, 2.5e-4)  # two of them, far apart: where trajectories bend in between, a slope says nothing ...
BEND = 0.1  # ... that is where a trajectory's derivative changes by more than this share
FAINT = 1e-5  # [m, rad] derivatives below this say nothing, whether they change or not


@dataclass(frozen=True)
class Directions:
    """Which changes of the initial states are free.

    Shifts of the first body along the ground take the other bodies with them. Nothing else then changes but the place
    where all of it happens, so that this difference is exact, however an impact bends all others: the place of a
    camera along the ground cannot be distinguished from initial states.

    Attributes:
        frame: Ground axes (tangent, tangent, normal) as rows, shape (3, 3).
        free: Of each body: turn, shift, spin, speed along the three axes; shape (K, N, 12).
        parallel: Bodies that turn about the ground's normal with the first one, and do not spin, shape (K, N).
    """

    frame: Tensor
    free: Tensor
    parallel: Tensor

    @classmethod
    def of(
        cls, normal: Tensor, resting: Tensor, level: Tensor | None = None, parallel: Tensor | None = None
    ) -> Directions:
        """Leave resting bodies their motion in the ground's plane, level ones that along its normal too, others all.

        A face that lands flat hits with all its corners at once, and one that leans by however little with one of them
        first, after which it tumbles: no slope leads from there to the flat landing that was seen.

        Args:
            normal: Of the ground, shape (3,).
            resting: Bodies that lie on the ground, shape (K, N).
            level: Bodies with a face parallel to the ground, shape (K, N); None for none.
            parallel: Bodies with faces parallel to those of the first one, shape (K, N); None for none.
        """
        planar = torch.tensor([0, 0, 1, 1, 1, 0] * 2, dtype=torch.bool)
        upright = torch.tensor([0, 0, 1, 1, 1, 1] * 2, dtype=torch.bool)
        others = torch.ones_like(planar).expand(*resting.shape, 12)
        if level is not None:
            others = torch.where(level[..., None], upright, others)
        free = torch.where(resting[..., None], planar, others)
        held = torch.zeros_like(resting) if parallel is None else parallel & ~free[..., 0] & ~free[:, :1, 0]
        held[:, 0] &= held[:, 1:].any(1)
        free[..., 8] &= ~held
        free[:, 1:, 2] &= ~held[:, 1:]
        return cls(ground_axes(normal), free, held)

    def without_speed(self) -> Directions:
        """Leave poses free, as they are, and no velocity: bodies are known to be at rest."""
        return Directions(self.frame, self.free & (torch.arange(12) < SHIFTS), self.parallel)

    def only(self, chosen: Tensor) -> Directions:
        """Return those of some of the segments (indices)."""
        return Directions(self.frame, self.free[chosen], self.parallel[chosen])

    @property
    def planar(self) -> Tensor:
        """Bodies that move in the ground's plane alone, for they lie on it, shape (K, N)."""
        return self.free[..., 3] & ~self.free[..., 5]

    @property
    def lying(self) -> Tensor:
        """Segments in which some body lies on the ground, shape (K,)."""
        return self.planar.any(1)

    def level(self, pose: Tensor, twist: Tensor) -> tuple[Tensor, Tensor]:
        """Turn bodies that may not lean until a face is parallel to the ground, and take their tumbling off.

        Those that are parallel to the first are turned so far about the normal that they are, without a spin.

        Args:
            pose: Shape (..., K, N, 7).
            twist: Shape (..., K, N, 6).

        Returns:
            New poses and twists.
        """
        held = (self.free[..., 3] & ~self.free[..., 0])[..., None]
        flat, _ = turn_flat(pose[..., 3:], self.frame[2])
        heading = face_heading(flat, self.frame[:2])
        back = torch.where(self.parallel, quarter(heading[..., :1] - heading), 0.0)
        flat = torch.where(self.parallel[..., None], multiply(exponential(back[..., None] * self.frame[2]), flat), flat)
        spin = torch.where(self.parallel, 0.0, twist[..., :3] @ self.frame[2])
        about = spin[..., None] * self.frame[2]
        return (
            torch.cat([pose[..., :3], torch.where(held, flat, pose[..., 3:])], -1),
            torch.cat([torch.where(held, about, twist[..., :3]), twist[..., 3:]], -1),
        )

    def with_heights_of(self, like: Tensor, pose: Tensor) -> Tensor:
        """Return poses (..., K, N, 7), those of bodies that lie on the ground at the heights of others."""
        off = ((like - pose)[..., :3] @ self.frame[2])[..., None] * self.frame[2]
        return torch.cat([pose[..., :3] + torch.where(self.planar[..., None], off, 0.0), pose[..., 3:]], -1)

    @property
    def used(self) -> list[tuple[int, int]]:
        """Pairs (body, direction) that are free in some segment: the columns of a state Jacobian."""
        some = self.free.any(0)
        return [(int(body), int(k)) for body, k in some.nonzero()]

    def move(self, pose: Tensor, twist: Tensor, change: Tensor) -> tuple[Tensor, Tensor]:
        """Move states along columns.

        Args:
            pose: Shape (..., K, N, 7).
            twist: Shape (..., K, N, 6).
            change: Amount along each column, shape (..., K, D); what is not free does not move. Shifts along the ground
                are those of the first body, and of the others relative to it.

        Returns:
            New poses and twists.
        """
        full = torch.zeros(*change.shape[:-1], *self.free.shape[1:], dtype=change.dtype)
        for column, (body, k) in enumerate(self.used):
            full[..., body, k] = change[..., column] * self.free[:, body, k]
        full[..., 1:, 3:5] += full[..., :1, 3:5] * self.free[:, 1:, 3:5]  # shifts along the ground
        full[..., 1:, 2] += full[..., :1, 2] * self.parallel[:, 1:]
        world = full.unflatten(-1, (4, 3)) @ self.frame
        turn, shift, spin, speed = world.unbind(-2)
        quaternion = multiply(exponential(turn), pose[..., 3:].expand(*turn.shape[:-1], 4))
        quaternion = quaternion / quaternion.norm(dim=-1, keepdim=True)
        return torch.cat([pose[..., :3] + shift, quaternion], -1), twist + torch.cat([spin, speed], -1)

    def steps(self, settings: DifferenceSettings) -> Tensor:
        """Return the step of the difference for each column, shape (D,)."""
        sizes = (settings.turn, settings.shift, settings.spin, settings.speed)
        return torch.tensor([sizes[k // 3] for _, k in self.used], dtype=torch.float64)


@dataclass(frozen=True)
class Jacobian:
    """A prediction and how it changes.

    Attributes:
        base: The prediction itself.
        state: Change of poses by the initial states, shape (D, R, T, N, 6).
        shared: Change by unknown parameters, parameters of effects, then forces; shape (P, R, T, N, 6).
        held: Where the change by an initial state is that by a velocity of a body at rest that friction holds, shape
            (D, R, T): v |v| / (2 mu g), of which the slope at rest is zero.
    """

    base: Prediction
    state: Tensor
    shared: Tensor
    held: Tensor


def differentiate(
    predictor: Predictor,
    point: Variants,
    directions: Directions,
    effects: Tensor,
    forces: Tensor | None = None,
    settings: DifferenceSettings = DEFAULT,
) -> Jacobian:
    """Take forward differences of the predicted poses.

    Args:
        predictor: The experiment.
        point: Where, a single variant.
        directions: Free changes of the initial states.
        effects: Which parameters of effects are columns (indices into the predictor's terms), shape (E,).
        forces: Wrenches whose amplitudes are further columns, shape (F, R, T, N, 6) [N m, N].
        settings: Steps of the differences.

    Returns:
        The prediction and its Jacobian; shared columns are ordered unknown parameters, effects, forces.
    """
    d, p, e = len(directions.used), point.nominal.shape[1], len(effects)
    f = 0 if forces is None else len(forces)
    many = point.repeat(1 + d + p + e)
    steps, nominal = directions.steps(settings), settings.nominal
    change = torch.zeros(d, len(directions.free), d, dtype=torch.float64)
    change[torch.arange(d), :, torch.arange(d)] = steps[:, None]
    many.pose[1 : 1 + d], many.twist[1 : 1 + d] = directions.move(point.pose, point.twist, change)
    columns, inward = torch.arange(p), nominal * _inward(predictor, point.nominal[0], nominal)
    many.nominal[1 + d + columns, columns] += inward
    sizes = _effect_steps(predictor, point.effects[0], settings.effect)[effects]
    many.effects[1 + d + p + torch.arange(e), effects] += sizes
    predicted = predictor.predict(many)
    base = Prediction(*(getattr(predicted, name)[:1] for name in Prediction.__annotations__))
    scale = torch.cat([steps, inward, sizes])
    slope = pose_difference(predicted.pose[1:], base.pose) / scale[:, None, None, None, None]
    held = _held_by_friction(predictor, point, directions, predicted.twist[: 1 + d], settings)
    shared = slope[d:]
    if forces is not None and f:
        pushed = predictor.predict(point.repeat(f).replace(force=settings.force * forces))
        shared = torch.cat([shared, pose_difference(pushed.pose, base.pose) / settings.force])
    return Jacobian(base, slope[:d], shared, held)


def _held_by_friction(
    predictor: Predictor, point: Variants, directions: Directions, twist: Tensor, settings: DifferenceSettings
) -> Tensor:
    """Return where a column is the velocity of a body at rest that friction holds, shape (D, R, T).

    A velocity v that friction stops moves it by v |v| / (2 mu g), of which the slope at v = 0 is zero. The difference
    of a small v is not, and a step along it leads anywhere.

    Args:
        predictor: The experiment.
        point: Where.
        directions: Free changes of the initial states.
        twist: Of the point and of what each change of an initial state leads to, shape (1 + D, R, T, N, 6).
        settings: What counts as standing.
    """
    rests = directions.planar & ~point.twist[0].any(-1)
    after = stands_after(predictor.segments, twist, settings.still)
    held = [
        predictor.segments.spread(rests[:, body] & after[0, :, body] & after[1 + column, :, body] & (k >= SHIFTS))
        for column, (body, k) in enumerate(directions.used)
    ]
    return torch.stack(held) if held else torch.zeros(0, *twist.shape[1:3], dtype=torch.bool)


def stands_after(segments: Segmentation, twist: Tensor, still: float) -> Tensor:
    """Return which bodies stand in the second frame of a segment.

    Args:
        segments: How trajectories are cut.
        twist: Shape (C, R, T, N, 6).
        still: Velocity below which a body stands [m/s, rad/s].

    Returns:
        Shape (C, K, N); none in a segment of one frame.
    """
    second = (segments.start + 1).clamp_max(segments.frames - 1)
    speed = twist[:, segments.trajectory, second].abs().amax(-1)
    return (speed < still) & (segments.size > 1)[:, None]


def _inward(predictor: Predictor, present: Tensor, step: float) -> Tensor:
    """Return the directions in which unknown parameters are moved, away from a largest value, shape (P,)."""
    return torch.where(present + step <= predictor.model.coordinates.ends[1], 1.0, -1.0).double()


def usable_slopes(predictor: Predictor, point: Variants, directions: Directions, seen: Tensor) -> tuple[Tensor, Tensor]:
    """Differentiate by the unknown parameters with two step sizes, and find segments where they disagree.

    A derivative that holds for tiny changes alone promises more than any fit can find: after a collision or a bounce a
    tiny change of a parameter may decide what comes next.

    Args:
        predictor: The experiment.
        point: Where, a single variant.
        directions: Of the initial states; they stay where they are.
        seen: Frames that count, shape (R, T).

    Returns:
        Changes by the unknown parameters (P, R, T, N, 6), and which segments can be relied on (K,).
    """
    fixed, none = replace(directions, free=torch.zeros_like(directions.free)), torch.zeros(0, dtype=torch.int64)
    settings = (DifferenceSettings(nominal=step) for step in SLOPES)
    coarse, fine = (differentiate(predictor, point, fixed, none, None, one).shared for one in settings)

    def size(value: Tensor) -> Tensor:
        square = (value.square().sum((3, 4)) * seen).sum(0, keepdim=True)
        return predictor.segments.sum_frames(square)[0].sqrt()

    change = size(coarse - fine)
    return fine, (change <= BEND * size(fine)) | (change <= FAINT)


def _effect_steps(predictor: Predictor, present: Tensor, share: float) -> Tensor:
    """Return the steps of the parameters of effects: towards the typical value, and away from a limit; shape (Q,)."""
    sizes = []
    for value, term in zip(present.tolist(), predictor.terms, strict=True):
        known = term.quantity
        step = share * (known.typical - known.null)
        sizes.append(step if known.low <= value + step <= known.high else -step)
    return torch.tensor(sizes, dtype=torch.float64)
