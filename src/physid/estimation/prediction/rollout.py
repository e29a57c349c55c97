"""Predictions of many variants of one experiment at once: other states, parameters, effects, forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from physid.estimation.prediction.candidates import Candidates
from physid.estimation.prediction.nominal_model import NominalModel
from physid.estimation.prediction.segments import Batch, Segmentation, at_once
from physid.estimation.prediction.timeline import Steps, Timeline
from physid.estimation.prediction.variants import Prediction, Variants
from physid.physics import Effect, PhysicsLayer, Rollout, State
from physid.physics.contact import PATCH
from physid.scenes.lying import raise_lying


class Predictor:
    """Simulates an experiment (its commanded wrenches) under variants of the model.

    Args:
        model: The nominal model.
        timeline: When poses were recorded, and the steps and commanded wrenches in between.
        segments: How the trajectories are cut.
        candidates: Effects whose parameters are the columns Q of `Variants.effects`, in this order.
        most: World-steps that are simulated in one go, which bounds the memory.
        elsewhere: States of frames that are in no segment, shape (R, T, N, 7); None if there are none.
        late: The timeline where effects act late, with shorter steps; None for the same.

    Attributes:
        simulated: How many variants were simulated, in a list of one number that is shared with what `over` returns.
    """

    def __init__(
        self,
        model: NominalModel,
        timeline: Timeline,
        segments: Segmentation,
        candidates: Sequence[type[Effect]] = (),
        most: int = 400_000,
        elsewhere: Tensor | None = None,
        late: Timeline | None = None,
    ) -> None:
        self.model = model
        self.late = late
        self.timeline = timeline
        self.segments = segments
        self._candidates = Candidates(candidates)
        self.candidates, self.terms, self.null = self._candidates.kinds, self._candidates.terms, self._candidates.null
        self._most, self._elsewhere, self.simulated = most, elsewhere, [0]

    @classmethod
    def of_whole(cls, model: NominalModel, timeline: Timeline, length: Tensor) -> Predictor:
        """Return one of whole trajectories, of which so many frames (R,) are real."""
        return cls(model, timeline, Segmentation.whole(length, timeline.time.shape[1]))

    def with_model(self, model: NominalModel) -> Predictor:
        """Return the same with another model."""
        return Predictor(model, self.timeline, self.segments, self.candidates, self._most, self._elsewhere, self.late)

    def over(self, segments: Segmentation, elsewhere: Tensor | None = None) -> Predictor:
        """Return the same with other segments, and states (R, T, N, 7) of the frames that are in none of them.

        A camera that is late reports what was before a segment.
        """
        predictor = Predictor(self.model, self.timeline, segments, self.candidates, self._most, elsewhere, self.late)
        predictor.simulated = self.simulated
        return predictor

    def of_lying(self, lying: Tensor | None) -> Predictor:
        """Return the same where some bodies (K, N) lie on the ground as segments begin; None for none."""
        return self.over(replace(self.segments, lying=lying), self._elsewhere)

    def at_times(self, timeline: Timeline, late: Timeline | None = None) -> Predictor:
        """Return the same with other times, or other steps between the same frames, and where effects act late."""
        return Predictor(self.model, timeline, self.segments, self.candidates, self._most, self._elsewhere, late)

    def for_effects(self, columns: Tensor) -> Predictor:
        """Return the same with the steps that effects need, of which some parameters (indices) are at work."""
        late = self._candidates.act_late(columns)
        return self if self.late is None or not late else self.at_times(self.late)

    def predict(self, variants: Variants) -> Prediction:
        """Simulate all variants.

        Raises:
            SolverError: If a contact problem cannot be solved.
        """
        self.simulated[0] += len(variants)
        per = sum(self.timeline.cost(batch) for batch in self.segments.batches)
        chunk = max(1, self._most // per)
        parts = [self._predict(variants[start : start + chunk]) for start in range(0, len(variants), chunk)]
        if len(parts) == 1:
            return parts[0]
        return Prediction(*(torch.cat([getattr(part, name) for part in parts]) for name in Prediction.__annotations__))

    def observe(self, state: Tensor, variants: Variants) -> Tensor:
        """Return what the camera reports of poses (C, R, T, N, 7) under the effects of C variants.

        Poses are those at the times at which a candidate's camera takes them, whatever its clock says.
        """
        time, (count, trajectories) = self.timeline.time, state.shape[:2]
        every = time.repeat(count, 1)
        seen = state.flatten(0, 1)
        for effect in self._known(variants, trajectories):
            seen = self.segments.observe(effect, seen, every)
        poses: Tensor = seen.unflatten(0, state.shape[:2])
        for effect, rows in self._candidates.observing(variants.effects, trajectories):
            own = self.segments.observe(effect, poses.flatten(0, 1)[rows], every[rows], rows)
            poses = poses.flatten(0, 1).index_copy(0, rows, own).unflatten(0, state.shape[:2])
        return poses

    def begun(self, variants: Variants) -> Variants:
        """Return variants with the poses from which they are simulated, see `raise_lying`."""
        lying, (count, segments) = self.segments.lying, variants.pose.shape[:2]
        if lying is None or self.model.world.ground is None:
            return variants
        state = State(*(value.transpose(0, 1).flatten(0, 1) for value in (variants.pose, variants.twist)))
        measured = self.model.inputs(state, variants.nominal.repeat(segments, 1))
        pose = raise_lying(state, lying.repeat_interleave(count, 0), measured, self._steps(variants, segments))
        if pose is state.pose:
            return variants
        return variants.replace(pose=pose.unflatten(0, (segments, count)).transpose(0, 1))

    @torch.no_grad()
    def _predict(self, variants: Variants) -> Prediction:
        variants = self.begun(variants)
        edges = self._edges(variants)
        wrench = self._acting(variants, edges)
        (count, trajectories), frames, bodies = wrench.shape[:2], self.timeline.frames, wrench.shape[3]
        contacts = PATCH * (bodies * (bodies + 1) // 2)
        blank = wrench.new_zeros(trajectories, frames, bodies, 7) if self._elsewhere is None else self._elsewhere
        state = blank.repeat(count, 1, 1, 1, 1)
        twist = wrench.new_zeros(count, trajectories, frames, bodies, 6)
        impulse = wrench.new_zeros(count, trajectories, frames, contacts)

        @torch.no_grad()
        def simulate(batch: Batch) -> None:
            steps = self.timeline.cut(batch)
            rollout = self._roll(variants, batch, steps, steps.wrench(wrench), edges)
            held = steps.between_frames(rollout.impulse[..., 0])
            parts = (steps.at_frames(rollout.pose), state), (steps.at_frames(rollout.twist), twist), (held, impulse)
            for value, into in parts:
                batch.put(value.transpose(0, 1), into)

        at_once(simulate, self.segments.batches)
        return Prediction(self.observe(state, variants), state, twist, impulse)

    def _roll(self, variants: Variants, batch: Batch, steps: Steps, wrench: Tensor, edges: Tensor | None) -> Rollout:
        """Simulate the segments of a batch under wrenches (C, k, S, N, 6); the rollout's batch is (k, C).

        Worlds are solved eight at a time, and take as long as the worst of them: variants of one segment are in contact
        at the same time.
        """
        world, count = self.model.world, len(variants)
        layer = PhysicsLayer(world, self._steps(variants, len(batch.segments)))
        pose, twist = (
            value[:, batch.segments].transpose(0, 1).flatten(0, 1) for value in (variants.pose, variants.twist)
        )
        parameters = self.model.parameters(variants.nominal.repeat(len(batch.segments), 1))
        if edges is None:
            length, start = steps.length.repeat_interleave(count, 0), steps.start.repeat_interleave(count)
        else:
            length = steps.wrench(edges.diff(dim=2)[..., None, None])[..., 0, 0].transpose(0, 1).flatten(0, 1)
            start = edges[:, steps.trajectory, steps.index[:, 0]].mT.flatten()
        even = bool((length == world.time_step).all())
        return layer.rollout(
            State(pose, twist),
            wrench.transpose(0, 1).flatten(0, 1),
            parameters,
            steps.count.repeat_interleave(count),
            None if even else length,
            start,
        )

    def _edges(self, variants: Variants) -> Tensor | None:
        """Return when the steps begin and end where a candidate's camera has a clock of its own, (C, R, S + 1)."""
        edges, count = self.timeline.edges, len(variants)
        at_work = self._candidates.at_work(variants.effects, "elapse", len(edges))
        if not at_work:
            return None
        every = edges.repeat(count, 1)
        for effect, rows in at_work:
            every = every.index_copy(0, rows, effect.elapse(every[rows]))
        return every.view(count, *edges.shape)

    def _acting(self, variants: Variants, edges: Tensor | None) -> Tensor:
        """Return the wrenches at work in each step (C, R, S, N, 6), which begin and end at edges (C, R, S + 1)."""
        time, (count, trajectories) = self.timeline.step_time, (len(variants), len(self.timeline.time))
        if edges is None:
            wrench, every = self.timeline.grid.wrench.repeat(count, 1, 1, 1), time.repeat(count, 1)
        else:
            wrench, every = self.timeline.wrench_between(edges).flatten(0, 1), edges[..., :-1].flatten(0, 1)
        for effect in self._known(variants, trajectories):
            wrench = effect.actuate(wrench, every)
        for effect, rows in self._candidates.at_work(variants.effects, "actuate", trajectories):
            wrench = wrench.index_copy(0, rows, effect.actuate(wrench[rows], every[rows]))
        wrench = wrench.unflatten(0, (count, trajectories))
        acting: Tensor = wrench if variants.force is None else wrench + self.timeline.on_steps(variants.force)
        return acting

    def _steps(self, variants: Variants, segments: int) -> list[Effect]:
        """Return the effects that act at the step, with a value for each of k segments and variants (k, C)."""
        known = self.model.effects_at(variants.nominal.repeat(segments, 1))
        return self._candidates.at_steps(known, variants.effects, segments)

    def _known(self, variants: Variants, copies: int) -> tuple[Effect, ...]:
        """Return the effects of the model, with a value for each variant and trajectory (C, R)."""
        return self.model.effects_at(variants.nominal.repeat_interleave(copies, 0))
