"""Reference simulators: the experiment replayed by other engines, from the same states and with the same parameters."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from physid.diagnosis.settings.reference import ReplaySettings
from physid.effects.resampling import at_times
from physid.estimation.prediction import AtStep, NominalModel, Segmentation, Timeline, Variants, has
from physid.physics import Effect, State
from physid.scenes import Excitation, Scene
from physid.scenes.lying import raise_lying
from physid.simulators import find_simulator


@dataclass(frozen=True)
class Reference:
    """A simulator that knows nothing of the PhysicsLayer.

    Attributes:
        name: Of the simulator, see `physid.simulators.protocol`.
        step: Its steps [s].
        staggered: Whether its velocities stand for the middle of a step, as those of a semi-implicit step x+ = x + h v+
            do: it then starts with that of half a step earlier, forces act as much earlier, and it is of second order
            but for impacts.
    """

    name: str
    step: float
    staggered: bool = False


def references_of(scene: Scene, settings: ReplaySettings, effects: Sequence[Effect] = ()) -> tuple[Reference, ...]:
    """Return the simulators that recordings of a scene are compared with.

    Where recording.yaml says how a simulator integrated, it is that simulator with those steps: then nothing differs
    from the recordings but what is wrong with the model. Of all others nothing is known, and PyBullet and MuJoCo with
    fine steps stand for what good simulators make of the same scene. Where bodies collide with each other it is MuJoCo
    alone: PyBullet's contact between two boxes is centimetres off the closed form, however fine its steps
    (docs/simulators.md). One that imitates an effect by a law of its own says nothing of those that are at work.
    """
    if scene.integration is not None:
        return (Reference("pybullet", scene.integration.step),)
    fine = {"pybullet": settings.pybullet_step, "mujoco": settings.mujoco_step}
    there = [name for name in settings.simulators if find_spec(name) is not None] or list(settings.simulators)
    if len(scene.bodies) > 1 and "mujoco" in there:
        there = ["mujoco"]
    names = {effect.name for effect in effects}
    there = [name for name in there if not names & find_simulator(name).own_laws] or there
    steps = {name: scene.time_step / math.ceil(scene.time_step / fine[name] - 1e-9) for name in there}
    return tuple(Reference(name, step, staggered=name == "pybullet") for name, step in steps.items())


def replay(
    model: NominalModel,
    timeline: Timeline,
    segments: Segmentation,
    point: Variants,
    settings: ReplaySettings,
    effects: Sequence[Effect] = (),
    chosen: Tensor | None = None,
    reference: Reference | None = None,
) -> Tensor:
    """Simulate segments in a reference simulator.

    Args:
        model: The nominal model.
        timeline: When poses were recorded, and the commanded wrenches in between.
        segments: How trajectories are cut.
        point: Initial states and unknown parameters, a single variant.
        settings: Which references, and what their impacts are.
        effects: Effects beside those of the nominal model.
        chosen: Which segments, shape (K,); None for all.
        reference: The simulator; None for the first of `references_of`.

    Returns:
        Poses that the camera would report, shape (R, T, N, 7); zeros outside the chosen segments.
    """
    known = model.effects_at(point.nominal)
    working = (*known, *effects)
    reference = reference or references_of(model.scene, settings, working)[0]
    scene = dataclasses.replace(model.scene_at(point.nominal[0]), camera=None, time_step=reference.step)
    wrench, begin = timeline.grid.wrench, timeline.step_time
    for effect in working:
        wrench = effect.actuate(wrench, begin)
    taken = timeline.time  # by the camera, whatever its clock says
    for effect in effects:
        taken = effect.elapse(taken)
    impulse = pad((wrench * timeline.grid.steps[..., None, None]).cumsum(1), (0, 0, 0, 0, 1, 0))
    steps = [AtStep(effect) for effect in working if has(type(effect), "act")]
    state = State(point.pose[0], point.twist[0])
    start = state.pose
    if segments.lying is not None:
        start = raise_lying(state, segments.lying, model.inputs(state, point.nominal), steps)
    seen = wrench.new_zeros(*timeline.time.shape, wrench.shape[2], 7)
    wanted = list(range(len(segments))) if chosen is None else chosen.nonzero()[:, 0].tolist()
    initial, places = [], []
    for segment in wanted:
        row, first, size = (int(each[segment]) for each in (segments.trajectory, segments.start, segments.size))
        stamps = taken[row, first : first + size]
        fine = stamps[0] + reference.step * torch.arange(_steps(stamps, reference.step) + 1)
        edges = _edges(fine, reference)
        force = _interpolated(impulse[row], timeline.grid.times[row], edges).diff(dim=0) / edges.diff()[:, None, None]
        held = torch.cat([force, torch.zeros_like(force[:1])]).numpy()
        initial.append(Excitation(start[segment].numpy(), state.twist[segment].numpy(), held))
        places.append((row, first, size, stamps, fine))
    clocks = [float(stamps[0]) for *_, stamps, _ in places]
    if reference.staggered:
        initial = _half_a_step_earlier(reference, scene, initial, steps, clocks, settings)
    motions = find_simulator(reference.name).simulate(scene, initial, steps, 1, clocks)
    for (row, first, size, stamps, fine), motion in zip(places, motions, strict=True):
        pose = torch.from_numpy(motion.pose)
        pose = at_times(pose[None], fine[None], stamps[None])[0] if len(fine) > 1 else pose
        seen[row, first : first + size] = pose
    for effect in (*known, *(effect for effect in effects if not has(type(effect), "elapse"))):
        seen = segments.observe(effect, seen, timeline.time)
    return seen


def _edges(fine: Tensor, reference: Reference) -> Tensor:
    """Return between which times forces act in the steps of a reference (W,), those of its velocities.

    Velocities that stand for the middles of steps take what acts from one middle to the next. That before the first
    moment is as what comes after it, up to the first middle.
    """
    return torch.cat([fine[:1], fine[1:] - reference.step / 2]) if reference.staggered else fine


def _steps(stamps: Tensor, step: float) -> int:
    """Return how many steps of the reference reach the last stamp."""
    return math.ceil(float(stamps[-1] - stamps[0]) / step - 1e-6)


def _interpolated(values: Tensor, time: Tensor, wanted: Tensor) -> Tensor:
    """Interpolate values (S, ...) at increasing times (S,) linearly at others (W,), constant beyond the ends."""
    right = torch.searchsorted(time, wanted).clamp(1, len(time) - 1)
    length = time[right] - time[right - 1]
    share = ((wanted - time[right - 1]) / length.clamp_min(torch.finfo(length.dtype).tiny)).clamp(0, 1)
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    return torch.lerp(values[right - 1], values[right], share)


def _half_a_step_earlier(
    reference: Reference,
    scene: Scene,
    initial: Sequence[Excitation],
    effects: Sequence[Effect],
    clocks: Sequence[float],
    settings: ReplaySettings,
) -> list[Excitation]:
    """Give initial states the velocities of half a step earlier, v - h a / 2 with the first step's acceleration a.

    With x+ = x + h v+ a constant acceleration gives x0 + v0 t + a t (t + h) / 2 from a velocity v0, which runs ahead of
    the truth by h a t / 2: the velocities are those of the middles of steps (leapfrog). Where a body hits something in
    the first step, a is gravity.
    """
    first = [dataclasses.replace(one, wrench=one.wrench[:2]) for one in initial]
    free = np.array([0.0, 0.0, 0.0, *scene.gravity]) * reference.step
    earlier = []
    for one, motion in zip(
        initial, find_simulator(reference.name).simulate(scene, first, effects, 1, clocks), strict=True
    ):
        change = motion.twist[1] - motion.twist[0] if len(motion.twist) > 1 else np.zeros_like(one.twist)
        hit = np.linalg.norm(change[:, 3:], axis=1) > settings.jump * settings.gravity * reference.step
        earlier.append(dataclasses.replace(one, twist=one.twist - np.where(hit[:, None], free, change) / 2))
    return earlier
