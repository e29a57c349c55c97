"""Which experiment would tell apart what these recordings cannot."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
import yaml
from torch import Tensor

from physid.diagnosis.attribute import Attribution
from physid.diagnosis.hypothesis import Hypothesis
from physid.diagnosis.nominal import NominalModel
from physid.diagnosis.prediction import Predictor, Variants, difference
from physid.diagnosis.prepare import Prepared
from physid.diagnosis.windows import Windows
from physid.physics.layer import SolverError
from physid.scenes.catalogue import SETUPS, with_parameters
from physid.scenes.setup import Setup

SEEDS, EACH = 6, 4  # force profiles of each protocol that are tried, trajectories of each
STEPS, SHORT_STEPS = 300, 60  # frames; in scenes with hits only the beginning can be foretold
HITS = ("collide", "toss")
ENOUGH = 1.0  # standard deviations of the sensor, root mean square, by which predictions must differ to be told apart
RECORD = 24  # trajectories that are asked for

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
    (frozenset({"force_delay", "force_lag", "observation_latency"}), "record coasting, and steps of the command"),
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


def next_experiment(prepared: Prepared, found: Attribution) -> NextExperiment | None:
    """Find the force profile under which the members of a group differ most; None where there is no group.

    Every protocol of the scene is drawn with several seeds; the best hypothesis and its nearest rival predict each
    with their own parameters. The profile with the largest difference wins.
    """
    rivals = [one for one in found.group if one is not found.best]
    if found.best is None or not (rivals or found.alike):
        return None
    names = {name for one in found.group for name in one.names} | set(found.alike)
    advice = next((text for members, text in REMEDIES if len(members & names) > 1), "")
    model = found.best.experiment.predictor.model
    setup = next((one for one in SETUPS if one.scene.name == model.scene.name), None)
    best = None if setup is None or not rivals else _best_profile(setup, model, found.best, rivals[0], prepared)
    if best is None or best[0] < ENOUGH:
        sentence = "no force profile of this scene tells them apart" if setup else "other pushes may tell them apart"
        return NextExperiment(f"{sentence}; {advice}" if advice else sentence)
    apart, protocol, seed, steps = best
    pair = " and ".join(" + ".join(one.names).replace("_", " ") for one in (found.best, rivals[0]))
    sentence = (
        f"record {RECORD} trajectories of protocol {protocol} (next_experiment.yaml): {pair} then differ by "
        f"{apart:.1f} standard deviations of the sensor" + (f"; or {advice}" if advice else "")
    )
    config = {"scene": model.scene.name, "protocol": protocol, "seed": seed, "trajectories": RECORD, "steps": steps}
    return NextExperiment(sentence, yaml.safe_dump(config | {"video": False}, sort_keys=False))


def _best_profile(
    setup: Setup, model: NominalModel, one: Hypothesis, other: Hypothesis, prepared: Prepared
) -> tuple[float, str, int, int] | None:
    """Return how far two hypotheses lie apart, the protocol, the seed and the frames of the best force profile."""
    tried = []
    steps = SHORT_STEPS if setup.scene.name in HITS else STEPS
    values = dict(zip(model.unknown, model.to_values(one.fit.point.nominal[0]).tolist(), strict=True))
    scene = with_parameters(model.scene, values)
    for protocol in setup.protocols:
        for seed in range(SEEDS):
            generator = np.random.default_rng(seed)
            drawn = [setup.draw(scene, protocol, generator, steps) for _ in range(EACH)]
            wrench, pose, twist = (
                torch.from_numpy(np.stack([getattr(each, name) for each in drawn]))
                for name in ("wrench", "pose", "twist")
            )
            predictor = Predictor(
                replace(model, scene=scene),
                wrench,
                Windows.equal(EACH, steps, steps),
                one.experiment.predictor.candidates,
            )
            try:
                tried.append((_apart(predictor, pose, twist, one, other, prepared), protocol, seed, steps))
            except SolverError:
                continue
    return max(tried, default=None)


def _apart(
    predictor: Predictor, pose: Tensor, twist: Tensor, one: Hypothesis, other: Hypothesis, prepared: Prepared
) -> float:
    """Return the root mean square difference of two predictions in units of the noise."""
    points = (one.fit.point, other.fit.point)
    variants = Variants(
        pose[None].repeat(2, 1, 1, 1),
        twist[None].repeat(2, 1, 1, 1),
        torch.cat([point.nominal for point in points]),
        torch.cat([point.effects for point in points]),
        torch.zeros(2, 1, dtype=torch.float64),
    )
    seen = predictor.predict(variants).pose
    return float((difference(seen[0], seen[1]) / prepared.noise.spread()).square().mean().sqrt())
