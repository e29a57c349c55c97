"""Steps of the engine chosen by halving them, on the user's own recordings, until what halving changes is small."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from physid.data.observations.step_grid import StepGrid
from physid.estimation.least_squares.experiment import Experiment, Fit
from physid.estimation.measurement.poses import pose_difference
from physid.estimation.prediction.timeline import Timeline
from physid.scenes import Scene
from physid.setting import Section, setting


class StepChoice(Section):
    """When steps of the engine are short enough.

    A tenth of the sensor's deviation is lost in the noise of a single frame. Where halving all steps changes an
    estimate by more than `bias`, steps are chosen anew with a quarter of `defect`. `shortest` is a length, for what
    a step misses of a reversal of friction grows with its length, whatever the frame rate. Bodies that meet touch for
    about `contact`: shorter steps would distinguish which corner of two faces is first. The motion of rigid bodies
    depends on that, the motion of real ones does not, and the loss of a fit has an edge there. To compare with the
    finest steps takes longer, and sees an event that steps and their halves happen to miss by the same.
    """

    defect: float = setting(
        0.1, "standard deviations", "of the sensor that halving the steps between two frames may change", gt=0
    )
    reach: float = setting(0.1, "s", "that a wrong velocity moves a body before the next impact comes", gt=0)
    bias: float = setting(0.25, "standard errors", "that halving all steps may change of an estimate", gt=0)
    late: float = setting(
        0.1, "s", "by which forces may act late in a diagnosis: steps are short enough for changes within them", ge=0
    )
    shortest: float = setting(2.5e-4, "s", "about the length of the shortest part of a step", gt=0)
    contact: float = setting(1e-3, "s", "the same in a world of several bodies, if it is longer", gt=0)
    rounds: int = setting(3, "times", "most that the defect is lowered", ge=1)
    finest: bool = setting(True, "", "whether steps are compared with the finest instead of with their halves")

    def shortest_among(self, bodies: int) -> float:
        """Return about how long the shortest part of a step is in a world of so many bodies [s]."""
        return self.shortest if bodies == 1 else max(self.shortest, self.contact)

    def most(self, grid: StepGrid, bodies: int, made: float | None = None) -> Tensor:
        """Return the most parts of each step, shape (R, S).

        The steps of a simulator that made the recordings [s], where these are known: no shorter ones are nearer to
        them. Else the power of two that makes steps about as long as the shortest.
        """
        if made is not None:
            return grid.parts_of(made)
        power = (grid.steps / self.shortest_among(bodies)).log2().round().clamp_min(0)
        return (2**power).long()


@dataclass(frozen=True)
class ChosenSteps:
    """Steps that were chosen.

    Attributes:
        timeline: The frames with these steps.
        mean: Steps from frame to frame, on average [-].
        largest: The most of them [-].
        error: What halving all of them, or the finest, still change of the poses, root of the mean square over frames,
            rotation [rad] and position [m].
        bias: The largest change of an unknown parameter that this makes, in standard errors [-].
        left: The largest change that even shorter steps would make on top, extrapolated, in standard errors [-].
        parts: Into how many parts each of the longest steps is cut, shape (R, S).
    """

    timeline: Timeline
    mean: float
    largest: int
    error: tuple[float, float]
    bias: float
    left: float
    parts: Tensor


@dataclass(frozen=True)
class Judgement:
    """What steps are judged by: predictions of R segments or trajectories of T frames, and what follows from them.

    Attributes:
        base: The frames with the longest steps that there may be.
        predict: Returns poses (R, T, N, 7) and twists (R, T, N, 6) with other steps.
        respond: Returns how a change of the poses (R, T, N, 6), rotation vectors and shifts, changes the estimates, in
            standard errors (P,).
        noise: Standard deviations of the sensor, rotation [rad] and position [m], shape (6,).
        followed: Whether a frame is predicted from the one before, shape (R, T - 1).
        counted: Poses that count, shape (R, T, N).
        made: Length of the steps of the simulator that made the recordings [s]; None where nobody says.
    """

    base: Timeline
    predict: Callable[[Timeline], tuple[Tensor, Tensor]]
    respond: Callable[[Tensor], Tensor]
    noise: Tensor
    followed: Tensor
    counted: Tensor
    made: float | None = None

    def most(self, choice: StepChoice) -> Tensor:
        """Return the most parts of each step, shape (R, S)."""
        return choice.most(self.base.grid, self.counted.shape[2], self.made)


def choose_steps(
    experiment: Experiment, fit: Fit, base: Timeline, choice: StepChoice | None = None, first: Tensor | None = None
) -> ChosenSteps:
    """Choose the steps of an experiment (see `halve_steps`).

    Args:
        experiment: What is explained; frames that it does not count do not decide.
        fit: Where steps are judged.
        base: The frames with the longest steps that there may be.
        choice: When steps are short enough.
        first: Into how many parts steps are cut at least, shape (R, S); 1 by default.
    """
    unknown = torch.arange(fit.point.nominal.shape[1])

    def predict(timeline: Timeline) -> tuple[Tensor, Tensor]:
        predicted = experiment.predictor.at_times(timeline).predict(fit.point)
        return predicted.pose[0], predicted.twist[0]

    def respond(apart: Tensor) -> Tensor:
        normal = fit.linear.respond(apart[None], experiment.scale).of(experiment.fitted).select(unknown)
        matrix, vector = normal.matrix.sum(0), normal.vector.sum(0)[:, 0]
        floor = 1e-12 * matrix.diagonal().amax().clamp_min(1e-30)
        inverse = torch.linalg.inv(matrix + floor * torch.eye(len(unknown), dtype=matrix.dtype))
        shift: Tensor = (inverse @ vector) / inverse.diagonal().sqrt()
        return shift

    def none(_: Tensor) -> Tensor:
        return torch.zeros(0, dtype=torch.float64)

    followed = experiment.predictor.segments.position[:, 1:] > 0
    counted = (experiment.scale > 0).any(-1)
    made = experiment.predictor.model.made_in
    judgement = Judgement(base, predict, respond if len(unknown) else none, _noise(experiment), followed, counted, made)
    return halve_steps(judgement, choice, first)


def halve_steps(judgement: Judgement, choice: StepChoice | None = None, first: Tensor | None = None) -> ChosenSteps:
    """Cut steps near events into parts until what cutting them once more changes is small beside the noise.

    A rollout with steps and one with half of them are compared. Where positions or velocities part between two frames
    by more than `defect`, there the steps are halved, and all is compared again: stops, reversals and impacts get short
    steps, steady motion keeps one from frame to frame.

    Args:
        judgement: What steps are judged by.
        choice: When steps are short enough.
        first: Into how many parts steps are cut at least, shape (R, S); 1 by default.
    """
    choice, grid = choice or StepChoice(), judgement.base.grid
    parts = torch.ones_like(grid.count[:, None].expand(grid.steps.shape)) if first is None else first
    defect = choice.defect
    for _ in range(choice.rounds):
        parts = _cut(judgement, parts, defect, choice)
        chosen = judge_steps(judgement, parts, choice)
        if chosen.bias <= choice.bias:
            break
        defect = defect / 4
    return chosen


def parts_for_late_forces(
    experiment: Experiment, base: Timeline, choice: StepChoice, twist: Tensor, scene: Scene
) -> Tensor:
    """Cut steps so short that forces which act late may change within one, shape (R, S).

    An engine holds the mean wrench for a whole step of length h. A change by F at any other moment of it moves a body
    by at most F h^2 / (8 m) less or more at the end, and gives it the same velocity; turns likewise, with the least
    moment of inertia. A body at rest is another case: it sets off when the force overcomes friction, not its mean, and
    then has a velocity that is off by mu g h / 4 on average over the moments of a change by F = 2 mu m g, always to the
    same side. Both together shall be no more than `defect`, the velocity after `reach`, wherever a wrench has changed
    within the time `late` before; the second only where the body comes to rest or turns back within `late`.

    Args:
        experiment: What is explained.
        base: The frames with the longest steps that there may be.
        choice: When steps are short enough.
        twist: Predicted at the frames, shape (R, T, N, 6).
        scene: With the masses and frictions that it was predicted with.
    """
    noise, bodies, gravity = _noise(experiment), scene.bodies, math.hypot(*scene.gravity)
    mass = torch.tensor([body.mass for body in bodies], dtype=torch.float64)
    moment = torch.tensor([min(body.moments()) for body in bodies], dtype=torch.float64)
    held = gravity * torch.tensor([body.friction for body in bodies], dtype=torch.float64)
    grid, most = base.grid, choice.most(base.grid, len(bodies))
    if choice.late == 0 or grid.steps.shape[1] < 2:
        return torch.ones_like(most)
    change = grid.wrench.diff(dim=1).unflatten(-1, (2, 3)).norm(dim=-1) / torch.stack([moment, mass], -1)
    sets_off = torch.minimum(change[..., 1], held) / noise[3:].amax()
    jump = (change / noise.unflatten(0, (2, 3)).amax(-1)).amax((2, 3))
    window = max(1, int(choice.late / float(grid.steps[grid.real].median()))) + 1
    rests = _rests(twist[..., 3:], held * base.time.diff(dim=1).median(), base)

    def lasting(value: Tensor) -> Tensor:
        before = torch.nn.functional.pad(value, (window, 0))[:, None]
        return torch.nn.functional.max_pool1d(before, window, 1)[:, 0]

    def near(value: Tensor) -> Tensor:
        around = torch.nn.functional.pad(value.mT, (window, window))
        return torch.nn.functional.max_pool1d(around, 2 * window + 1, 1).mT

    # Of the whole step, in standard deviations of the sensor; of parts x of it the first goes as x^2, the second as x.
    moved = 0.5 * lasting(jump) * (0.5 * grid.steps).square()
    faster = lasting((sets_off * near(rests)[:, 1:]).amax(2)) * grid.steps * choice.reach / 4
    share = 2 * choice.defect / (faster + (faster.square() + 4 * moved * choice.defect).sqrt())
    power = share.reciprocal().clamp_min(1).log2().ceil().long()
    return torch.minimum(2**power, most)


def _cut(judgement: Judgement, parts: Tensor, defect: float, choice: StepChoice) -> Tensor:
    """Return into how many parts (R, S) the steps are cut, so that halving them changes little."""
    base, most = judgement.base, judgement.most(choice)
    length = base.time.diff(dim=1)[..., None, None]
    reference = judgement.predict(base.refined(most)) if choice.finest else None
    while True:
        pose, twist = judgement.predict(base.refined(parts))
        fine_pose, fine_twist = reference or judgement.predict(base.refined((2 * parts).minimum(most)))
        place, speed = pose_difference(pose, fine_pose), twist - fine_twist
        gained = speed.diff(dim=1) * choice.reach
        moved = place.diff(dim=1) - speed[:, :-1] * length
        within = judgement.followed[..., None, None]
        wrong = torch.where(within, (moved.abs() + gained.abs()) / judgement.noise, 0.0).amax((2, 3)) > defect
        wrong = torch.cat([wrong, torch.zeros_like(wrong[:, :1])], 1)
        again = wrong.gather(1, base.owner) & (parts < most)
        if not bool(again.any()):
            return parts
        parts = torch.where(again, (2 * parts).minimum(most), parts)


def judge_steps(judgement: Judgement, parts: Tensor, choice: StepChoice) -> ChosenSteps:
    """Say what halving all steps, cut into parts (R, S), or the finest steps change of poses and estimates.

    What those leave is extrapolated (Richardson 1911): where friction turns around within a step, poses are off in
    proportion to its length, so that steps of twice the length are off by as much more as the fine ones are at all.
    Those of the simulator that made the recordings leave nothing.
    """
    known = judgement.made is not None
    fine = judgement.most(choice) if choice.finest or known else 2 * parts
    pose, fine_pose, double_pose = (
        judgement.predict(judgement.base.refined(each))[0] for each in (parts, fine, (fine // 2).clamp_min(1))
    )
    apart = pose_difference(pose, fine_pose)
    counted = judgement.counted[..., None].double()
    rotation, position = ((apart * counted).unflatten(-1, (2, 3)).square().sum((0, 1, 2, 4)) / 3).unbind()
    count = counted.sum().clamp_min(1)
    shift, beyond = judgement.respond(apart), judgement.respond(pose_difference(double_pose, fine_pose))
    per_frame = parts[judgement.base.grid.real].double()
    return ChosenSteps(
        judgement.base.refined(parts),
        float(per_frame.mean()),
        int(per_frame.max()),
        (float((rotation / count).sqrt()), float((position / count).sqrt())),
        float(shift.abs().max()) if len(shift) else 0.0,
        float(beyond.abs().max()) if len(beyond) and not known else 0.0,
        parts,
    )


def _rests(velocity: Tensor, slow: Tensor, base: Timeline) -> Tensor:
    """Return 1 in steps (R, S, N) that begin or end slower than twice `slow` (N,) [m/s], or turn back; 0 elsewhere.

    Args:
        velocity: At the frames, shape (R, T, N, 3).
        slow: What friction takes away from frame to frame.
        base: Frames and steps.
    """
    still = velocity.norm(dim=-1) <= 2 * slow
    back = (velocity[:, 1:] * velocity[:, :-1]).sum(-1) <= 0
    found = torch.cat([back | still[:, 1:] | still[:, :-1], still[:, -1:]], 1).double()
    return found.gather(1, base.owner[..., None].expand(-1, -1, found.shape[2]))


def _noise(experiment: Experiment) -> Tensor:
    """Return the standard deviations of the sensor (6,), of the frames that count most."""
    scale = experiment.scale.amax((0, 1, 2))
    return torch.where(scale > 0, 1 / scale.clamp_min(1e-30), torch.inf)
