"""What is explained, and a point at which it has been linearised."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physid.estimation.least_squares.initial_states import InitialStates, guess_initial_states
from physid.estimation.least_squares.jacobian import Directions, Jacobian, differentiate
from physid.estimation.least_squares.normal_equations import Linearised, Normal, linearise
from physid.estimation.least_squares.settings import LeastSquaresSettings
from physid.estimation.measurement.poses import pose_difference
from physid.estimation.prediction.rollout import Predictor
from physid.estimation.prediction.variants import Prediction, Variants

DEFAULT = LeastSquaresSettings()


@dataclass(frozen=True)
class Experiment:
    """Observed trajectories and the model that shall explain them.

    Attributes:
        predictor: The model under the commanded wrenches.
        pose: Observed poses, shape (R, T, N, 7).
        scale: One over the standard deviation of the noise times the root of the weight, shape (R, T, N, 6).
        fitted: Trajectories that determine shared parameters (the others only have their initial states fitted), (R,).
        directions: Free changes of initial states.
        engine: How far the reference simulator leaves this one, a shared column (see `PriorSettings`), (R, T, N, 6).
        follow: Segments in which the reference simulator is followed, shape (K,); where small errors grow fast it
            cannot be.
        settings: What decides in its fits.
        common: What one standard deviation of an error that all trajectories share does to the observed poses, say of
            a scale that is not known exactly, (R, T, N, 6); None where there is none.
    """

    predictor: Predictor
    pose: Tensor
    scale: Tensor
    fitted: Tensor
    directions: Directions
    engine: Tensor
    follow: Tensor
    settings: LeastSquaresSettings = DEFAULT
    common: Tensor | None = None

    def residual(self, predicted: Tensor, point: Variants) -> Tensor:
        """Return observed minus predicted poses, as rotation vectors and positions; (C, R, T, N, 6)."""
        return pose_difference(self.pose, predicted) - point.engine[:, :, None, None, None] * self.engine

    def losses(self, point: Variants) -> Tensor:
        """Return the squared residual of each variant and segment, in units of the noise; (C, K)."""
        return self.losses_of(self.predictor.predict(point), point)

    def losses_of(self, predicted: Prediction, point: Variants) -> Tensor:
        """Return the losses of what has been predicted."""
        square = (self.residual(predicted.pose, point) * self.scale).square().sum((3, 4))
        return self.predictor.segments.sum_frames(square)

    def counted(self) -> Tensor:
        """Return how many values of each segment count, at least 1, shape (K,)."""
        return self.predictor.segments.sum_frames((self.scale > 0).sum((2, 3))[None].double())[0].clamp_min(1)

    def explained(self, loss: Tensor) -> Tensor:
        """Return which segments are explained up to noise, from their losses (K,)."""
        return loss < self.settings.multi_start.doubtful * self.counted()

    def misfit(self, point: Variants) -> Tensor:
        """Return the mean squared residual of each segment, in units of the noise, shape (K,)."""
        return self.losses(point)[0] / self.counted()

    def linearise(self, point: Variants, effects: Tensor, forces: Tensor | None = None) -> Fit:
        """Linearise at a point; see `differentiate` for the columns.

        A velocity that friction holds has its slope, zero, in segments that are explained; in others the body may have
        moved after all, and the difference that leads from rest is better than none.
        """
        jacobian = differentiate(self.predictor, point, self.directions, effects, forces, self.settings.differences)
        unknown = point.nominal.shape[1]
        columns = [jacobian.shared[:unknown], self.engine[None], jacobian.shared[unknown:]]
        held = jacobian.held & self.predictor.segments.spread(self.explained(self.losses_of(jacobian.base, point)[0]))
        state = jacobian.state * ~held[..., None, None]
        return self._fit(point, effects, replace(jacobian, state=state, shared=torch.cat(columns)))

    def at(self, point: Variants, near: Fit) -> Fit:
        """Return the residuals at a point with the Jacobian of a fit nearby, which costs one prediction.

        At the point of that fit it costs none: `near` has the same predictor, whatever else of the experiment changed.
        """
        jacobian, unknown = near.jacobian, point.nominal.shape[1]
        columns = jacobian.shared.clone()
        columns[unknown] = self.engine
        base = jacobian.base if point is near.point else self.predictor.predict(point)
        return self._fit(point, near.effects, replace(jacobian, base=base, shared=columns))

    def moved(self, point: Variants, near: Fit, base: Prediction | None) -> Fit:
        """Do as `at`, with a fit of this very experiment and what the model predicts at the point, if that is known."""
        base = self.predictor.predict(point) if base is None else base
        residual = self.residual(base.pose, point)[0]
        linear = near.linear.observing(residual, self.scale)
        return Fit.of(point, near.effects, replace(near.jacobian, base=base), residual, linear)

    def _fit(self, point: Variants, effects: Tensor, jacobian: Jacobian) -> Fit:
        residual = self.residual(jacobian.base.pose, point)[0]
        segments, prior = self.predictor.segments, self.settings.prior
        linear = linearise(residual, self.scale, jacobian, self.directions, segments, prior)
        return Fit.of(point, effects, jacobian, residual, linear)

    def only(self, chosen: Tensor, elsewhere: Tensor) -> Experiment:
        """Return the experiment with some of the segments (indices, in order); states elsewhere are (R, T, N, 7)."""
        directions = self.directions.only(chosen)
        predictor = self.predictor.over(self.predictor.segments.only(chosen), elsewhere)
        return replace(self, predictor=predictor, directions=directions, follow=self.follow[chosen])

    def for_effects(self, columns: Tensor) -> Experiment:
        """Return the experiment with the steps that effects need, of which some parameters (indices) are at work."""
        predictor = self.predictor.for_effects(columns)
        return self if predictor is self.predictor else replace(self, predictor=predictor)

    def with_known_states(self) -> Experiment:
        """Return the experiment in which initial states stay as they are, whatever the sizes of bodies."""
        directions = replace(self.directions, free=torch.zeros_like(self.directions.free))
        return replace(self, directions=directions, predictor=self.predictor.of_lying(None))

    def with_known_parameters(self) -> Experiment:
        """Return the experiment in which no trajectory has a say in the shared parameters, which stay as they are."""
        return replace(self, fitted=torch.zeros_like(self.fitted))

    def replace(self, **changes: object) -> Experiment:
        """Return a copy with some fields changed."""
        return replace(self, **changes)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Fit:
    """A point and the experiment linearised there.

    Attributes:
        point: Initial states, unknown parameters, effects.
        effects: Indices of the effects' parameters that are columns.
        jacobian: Prediction and its changes.
        residual: Observed minus predicted, shape (R, T, N, 6).
        linear: The same in units of the noise, by segment.
        loss: Squared residual of each segment, shape (K,).
    """

    point: Variants
    effects: Tensor
    jacobian: Jacobian
    residual: Tensor
    linear: Linearised
    loss: Tensor

    @classmethod
    def of(cls, point: Variants, effects: Tensor, jacobian: Jacobian, residual: Tensor, linear: Linearised) -> Fit:
        """Return a fit with the losses of its residuals."""
        loss = linear.gather(lambda part: part.residual.square().sum(1))
        return cls(point, effects, jacobian, residual, linear, loss)

    def normal(self) -> Normal:
        """Return the normal equations of the shared columns."""
        return self.linear.normal()


def lay_out(
    predictor: Predictor,
    pose: Tensor,
    scale: Tensor,
    fitted: Tensor,
    lean: float,
    settings: LeastSquaresSettings = DEFAULT,
) -> tuple[Experiment, InitialStates]:
    """Return the experiment, with guesses of the initial states; nothing is simulated.

    Args:
        predictor: The model.
        pose: Observed poses, shape (R, T, N, 7).
        scale: One over the standard deviation of the noise times the root of the weight, shape (R, T, N, 6).
        fitted: Trajectories that determine shared parameters, (R,).
        lean: Noise of each component of a rotation [rad]; bodies that lean no further stay level.
        settings: What decides in the fits.
    """
    scene, segments = predictor.model.scene, predictor.segments
    initial = guess_initial_states(
        pose, seen_frames(scale), predictor.timeline.time, segments, scene, lean, settings.guess
    )
    normal = torch.tensor(scene.ground.normal, dtype=torch.float64)
    directions = Directions.of(normal, initial.resting, initial.level, initial.parallel)
    predictor = predictor.of_lying(initial.resting)
    engine, follow = torch.zeros_like(pose[..., :6]), torch.ones(len(segments), dtype=torch.bool)
    return Experiment(predictor, pose, scale, fitted, directions, engine, follow, settings), initial


def seen_frames(scale: Tensor) -> Tensor:
    """Return the weights (R, T, N) of frames in a guess, 0 for those to ignore."""
    return (scale[..., 0] > 0).double()
