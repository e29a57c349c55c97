"""Which experiment would tell apart what these recordings cannot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import yaml

from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.search import Attribution
from physid.diagnosis.testing import Hypothesis
from physid.estimation.least_squares import Experiment, gauss_newton
from physid.estimation.prediction import Predictor, Segmentation, Timeline, Variants
from physid.estimation.segmented_fit import Observed, begin
from physid.physics import SolverError
from physid.scenes import SETUPS, Excitation, Setup

# What splits those that no force profile of a scene can: docs/diagnosis.md.
REMEDIES: tuple[tuple[frozenset[str], str], ...] = (
    (frozenset({"force_gain", "mass_drift"}), "weigh the body, or push a second one of known mass"),
    (
        frozenset({"force_dead_zone", "adhesion", "gravity_error", "load_dependent_friction"}),
        "reverse the pushes, let the body coast, or tilt the ground",
    ),
    (frozenset({"ground_tilt", "constant_force"}), "use a second body of another mass, or let one fall freely"),
    (
        frozenset({"viscous_drag", "quadratic_drag"}),
        "let the body coast from speeds that differ by a factor of 3 or more",
    ),
    (
        frozenset({"force_delay", "force_lag", "observation_latency", "observation_lag"}),
        "record coasting, and steps of the command",
    ),
    (frozenset({"viscous_drag", "quadratic_drag", "friction_drift"}), "start with a velocity, early and late"),
    (frozenset({"camera_yaw", "force_misalignment"}), "film an edge of the table whose direction is known"),
    (
        frozenset({"length_scale", "gravity_error", "clock_rate", "object_size", "camera_offset"}),
        "measure the body with a ruler, and film it at rest",
    ),
    (frozenset({"anisotropic_friction", "friction_gradient"}), "slide along three headings from one place"),
    (frozenset({"force_offset", "com_offset"}), "let the body spin in free fall"),
    (
        frozenset({"ground_restitution", "contact_compliance"}),
        "drop the body from several heights, at a high frame rate",
    ),
)


@dataclass(frozen=True)
class NextExperiment:
    """What to do next.

    Attributes:
        sentence: For a person.
        config: Text of a configuration of `physid generate` with the force profile; None where none would help.
    """

    sentence: str
    config: str | None = None


def next_experiment(nominal_fit: NominalFit, found: Attribution) -> NextExperiment | None:
    """Find the force profile under which the members of a group differ most; None where there is no group.

    The best hypothesis and its nearest rival predict trajectories of every protocol of the scene. What counts is what
    is left of the difference once initial states, unknown parameters and the size of the best effect have been fitted
    to the rival. The protocol with the largest rest wins, if it tells more than more of the same would.
    """
    rivals = [one for one in found.group if one is not found.best]
    if found.best is None or not (rivals or found.alike):
        return None
    names = {name for one in found.group for name in one.names} | set(found.alike)
    settings = nominal_fit.settings.next_experiment
    advice = next((text for members, text in REMEDIES if len(members & names) > 1), "")
    model = found.best.experiment.predictor.model
    setup = next((one for one in SETUPS if one.scene.name == model.scene.name), None)
    best = None if setup is None or not rivals else _best_protocol(setup, found.best, rivals[0], nominal_fit)
    now = _now(found.best, rivals[0]) if rivals else 0.0
    if setup is None or best is None or best[0] < max(settings.apart, settings.more * now):
        sentence = "no force profile of this scene tells them apart" if setup else "other pushes may tell them apart"
        return NextExperiment(f"{sentence}; {advice}" if advice else sentence)
    apart, protocol, steps = best
    pair = " and ".join(" + ".join(one.names).replace("_", " ") for one in (found.best, rivals[0]))
    sentence = (
        f"record {settings.record} trajectories of protocol {protocol} (next_experiment.yaml): {pair} then differ by "
        f"{apart:.0f} standard deviations of the sensor in all, where as many like these differ by {now:.1f}"
        + (f"; or {advice}" if advice else "")
    )
    config = {
        "scene": model.scene.name,
        "protocol": protocol,
        "frame_rate": float(f"{1 / model.scene.time_step:.6g}"),
        "seed": 0,
        "trajectories": settings.record,
        "steps": steps,
    }
    more = {"unknown": setup.unknown_of(model.scene), "video": False}
    return NextExperiment(sentence, yaml.safe_dump(config | more, sort_keys=False))


def _best_protocol(
    setup: Setup, one: Hypothesis, other: Hypothesis, nominal_fit: NominalFit
) -> tuple[float, str, int] | None:
    """Return how far two hypotheses lie apart under the protocol where that is most, the protocol, and the frames."""
    tried, model = [], one.experiment.predictor.model
    settings = nominal_fit.settings.next_experiment
    steps, longest = settings.steps, settings.longest
    if setup.impacts:
        steps, longest = settings.steps_with_impacts, settings.longest_with_impacts
    steps = max(2, min(steps, round(longest / model.scene.time_step)))
    scene = model.scene_at(one.fit.point.nominal[0])
    turned = bool(nominal_fit.observations.timeline.grid.wrench[..., :3].any())
    for protocol in setup.protocols:
        generator = np.random.default_rng(0)
        drawn = [setup.draw(scene, protocol, generator, steps) for _ in range(settings.drawn)]
        if not turned and any(each.wrench[..., :3].any() for each in drawn):
            continue  # who pushed at the centre of mass is not asked for torques
        try:
            tried.append((_planned(drawn, one, other, nominal_fit), protocol, steps))
        except SolverError:
            continue
    return max(tried, default=None)


def _planned(drawn: Sequence[Excitation], one: Hypothesis, other: Hypothesis, nominal_fit: NominalFit) -> float:
    """Return by how much two hypotheses can be told apart (see `_told`) by an experiment that has not been made."""
    known, scene = one.experiment.predictor, nominal_fit.observations.scene
    wrench, pose, twist = (
        torch.from_numpy(np.stack([getattr(each, name) for each in drawn])) for name in ("wrench", "pose", "twist")
    )
    rows, steps = wrench.shape[:2]
    timeline = Timeline.regular(wrench, scene.time_step)
    predictor = Predictor(known.model, timeline, Segmentation.equal(rows, steps, steps), known.candidates)
    rival = other.fit.point.replace(pose=pose[None], twist=twist[None])
    present = torch.ones(wrench.shape[:3], dtype=torch.float64)
    seen = predictor.predict(rival).pose[0]
    observed = Observed(seen, present, timeline, torch.ones(rows, dtype=torch.bool))
    settings, nominal = nominal_fit.settings.least_squares, one.fit.point.nominal
    experiment, guess = begin(predictor, observed, nominal_fit.noise, settings, nominal)
    same = guess.replace(pose=rival.pose, twist=rival.twist)
    points = [each.replace(effects=one.fit.point.effects) for each in (guess, same)]
    return _told(one, experiment, points)


def _told(one: Hypothesis, experiment: Experiment, points: Sequence[Variants]) -> float:
    """Return the standard deviations that are left when a hypothesis imitates what is seen, over all that is asked for.

    Args:
        one: The hypothesis.
        experiment: What is seen.
        points: Where imitations begin; each trajectory keeps the better one.
    """
    settings = one.settings.next_experiment
    left = torch.stack(
        [gauss_newton(experiment, point, one.columns, settings.imitation_steps).normal().square for point in points]
    )
    usual = left.amin(0)[experiment.fitted].median()  # one in which every imitation gets stuck decides nothing
    return float((settings.record * usual).sqrt())


def _now(one: Hypothesis, other: Hypothesis) -> float:
    """Return by how much two hypotheses can be told apart by as many recordings like those that are there."""
    seen = one.experiment.predictor.predict(other.fit.point).pose[0]
    experiment = one.experiment.replace(pose=seen, engine=torch.zeros_like(one.experiment.engine))
    return _told(one, experiment, [one.fit.point])
