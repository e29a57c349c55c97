"""What simpler methods would have said: from the ranking of a diagnosis, or from the recordings alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physid.benchmark.scoring.accelerations import Samples, samples
from physid.benchmark.scoring.judging import NO_GAP
from physid.data import RecordingSet
from physid.diagnosis.document.document import Diagnosis
from physid.effects import CATALOGUE
from physid.scenes import Scene

Array = NDArray[np.float64]
NATS = 5.0  # gain of the logarithm of the likelihood that an uncalibrated search takes for a discovery
THRESHOLD = 0.1  # part of the residual acceleration below which sparse regression drops a term
ROUNDS = 10
RIDGES = (1e-3, 1e-2, 1e-1, 1.0, 10.0)
FITTED = ("fit", "select")
SPLITS = {"fit": ("fit",), "select": ("select",), "same": ("report_same",), "transfer": ("report_transfer",)}
METHODS = ("plain BIC", "uncalibrated likelihood", "sparse regression", "free residual")


@dataclass(frozen=True)
class Answer:
    """What a baseline says of a set.

    Attributes:
        flagged: Whether something is missing.
        named: The effect, if it names any.
        same: Part of the residual acceleration that it explains on held-out trajectories, if it predicts.
        transfer: The same on the transfer protocol.
    """

    flagged: bool
    named: str | None = None
    same: float | None = None
    transfer: float | None = None


def answers(recordings: RecordingSet, document: Diagnosis, noise: float) -> dict[str, Answer]:
    """Ask all baselines about a set.

    Args:
        recordings: The set.
        document: Its diagnosis, for the gains in its ranking.
        noise: Standard deviation of the noise of a position [m], to tell what could be explained at all.
    """
    fitted = [recordings.read(index) for index in recordings.indices(FITTED)]
    numbers = sum(6 * one.length * len(recordings.scene.bodies) for one in fitted)
    data = {name: samples(recordings, splits) for name, splits in SPLITS.items()}
    moves = len(data["fit"].time) > 0  # where bodies hardly move there is no acceleration to explain
    return {
        "plain BIC": bic(document, numbers),
        "uncalibrated likelihood": likelihood(document),
        "sparse regression": sparse_regression(recordings.scene, data["fit"]) if moves else Answer(False),
        "free residual": free_residual(recordings.scene, data, noise) if moves else Answer(False),
    }


def bic(document: Diagnosis, numbers: int) -> Answer:
    """Take the effect with the largest gain - k ln n, if above 0 (Schwarz 1978), for n white residuals."""
    return _best(document, lambda gain, k: gain - k * math.log(numbers))


def bic_weights(document: Diagnosis, numbers: int) -> dict[str, float]:
    """Return exp(-BIC / 2) of no effect and of each single effect of the ranking, with sum 1 (Raftery 1995)."""
    size = {kind.name: len(kind.quantities()) for kind in CATALOGUE}
    single = {row.effects[0]: row.score for row in document.ranking if len(row.effects) == 1 and row.effects[0] in size}
    half = {name: (gain - size[name] * math.log(numbers)) / 2 for name, gain in single.items()} | {"none": 0.0}
    best = max(half.values())
    raised = {name: math.exp(value - best) for name, value in half.items()}
    return {name: value / sum(raised.values()) for name, value in raised.items()}


def likelihood(document: Diagnosis) -> Answer:
    """Take the effect that gains most, if by more than 5 nats."""
    return _best(document, lambda gain, _: gain / 2 - NATS)


def _best(document: Diagnosis, worth: Any) -> Answer:
    size = {kind.name: len(kind.quantities()) for kind in CATALOGUE}
    rows = [row for row in document.ranking if len(row.effects) == 1 and row.effects[0] in size]
    if not rows:
        return Answer(False)
    best = max(rows, key=lambda row: worth(row.score, size[row.effects[0]]))
    name = best.effects[0]
    return Answer(True, name) if worth(best.score, size[name]) > 0 else Answer(False)


def sparse_regression(scene: Scene, data: Samples) -> Answer:
    """Name the strongest term that survives sequentially thresholded least squares (Brunton, Proctor, Kutz 2016).

    The residual acceleration after mass and friction were fitted is regressed on a library of terms that stand for
    effects; terms that contribute less than a tenth of it are dropped, and the rest is fitted again.
    """
    residual, nominal = _residual(scene, data)
    library = {name: _project(_stack(term), nominal) for name, term in _library(scene, data).items()}
    columns = np.stack(list(library.values()), 1)
    names = [name.partition(":")[0] for name in library]
    spread = float(residual.std())
    kept = np.linalg.norm(columns, axis=0) > 1e-9
    weights = np.zeros(len(names))
    for _ in range(ROUNDS):
        weights[:] = 0
        if not kept.any():
            return Answer(False)
        weights[kept] = np.linalg.lstsq(columns[:, kept], residual, rcond=None)[0]
        small = np.abs(weights) * columns.std(0) < THRESHOLD * spread
        if not (kept & small).any():
            break
        kept &= ~small
    strength: dict[str, float] = {}
    for name, value in zip(names, np.abs(weights) * columns.std(0) * kept, strict=True):
        strength[name] = math.hypot(strength.get(name, 0.0), float(value))
    return Answer(True, max(strength, key=lambda name: strength[name])) if kept.any() else Answer(False)


def free_residual(scene: Scene, data: Mapping[str, Samples], noise: float) -> Answer:
    """Fit the residual acceleration by free functions of force, velocity, position and time (see `_basis`).

    The ridge is the one that predicts the trajectories to select by best.

    Args:
        scene: The scene.
        data: Samples to fit, to select, and of the two protocols to report on.
        noise: Standard deviation of the noise of a position [m].
    """
    parameters = np.linalg.lstsq(_nominal(scene, data["fit"]), _known(scene, data["fit"]), rcond=None)[0]
    left = {
        name: (_known(scene, each) - _nominal(scene, each) @ parameters).reshape(2, -1).T for name, each in data.items()
    }
    basis = {name: _basis(each) for name, each in data.items()}
    scale = np.linalg.norm(basis["fit"], axis=0) / len(basis["fit"]) ** 0.5 + 1e-9
    x = basis["fit"] / scale
    tried = [
        np.linalg.solve(x.T @ x + ridge * len(x) * np.eye(x.shape[1]), x.T @ left["fit"]) / scale[:, None]
        for ridge in RIDGES
    ]
    weights = min(tried, key=lambda each: _rms(left["select"] - basis["select"] @ each))
    closed = {}
    for split in ("same", "transfer"):
        before, floor = _rms(left[split]), noise * data[split].spread
        explained = before - _rms(left[split] - basis[split] @ weights)
        closed[split] = explained / (before - floor) if before > NO_GAP * floor else None
    return Answer((closed["same"] or 0) > THRESHOLD, None, closed["same"], closed["transfer"])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _residual(scene: Scene, data: Samples) -> tuple[Array, Array]:
    """Return what the fitted nominal model leaves (2 n,), and its columns."""
    columns = _nominal(scene, data)
    return _project(_known(scene, data), columns), columns


def _known(scene: Scene, data: Samples) -> Array:
    """Return accelerations without what is known of them, x before y, shape (2 n,)."""
    push = 0.0 if f"{scene.bodies[0].name}.mass" in scene.unknown else data.force / scene.bodies[0].mass
    return _stack(data.acceleration - push)


def _nominal(scene: Scene, data: Samples) -> Array:
    """Return the accelerations of a unit of each unknown parameter, shape (2 n, P)."""
    terms = [-data.load[:, None] * _heading(data)]
    if f"{scene.bodies[0].name}.mass" in scene.unknown:
        terms.append(data.force)
    return np.stack([_stack(term) for term in terms], 1)


def _library(scene: Scene, data: Samples) -> dict[str, Array]:
    """Return the accelerations of a unit of each effect that has a closed form here; several parts of one by number."""
    heading, speed = _heading(data), np.linalg.norm(data.velocity, axis=1, keepdims=True)
    rub, time, force = -data.load[:, None] * heading, data.time[:, None], data.force
    size = np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
    angle = np.arctan2(heading[:, 1:], heading[:, :1])
    one = np.ones_like(time)
    return {
        "force_gain": force,
        "force_dead_zone": -force / size,
        "force_saturation": -force * (size / 10) ** 4,
        "force_delay": -data.change,
        "force_misalignment": force @ np.array([[0.0, 1.0], [-1.0, 0.0]]),
        "viscous_drag": -data.velocity,
        "quadratic_drag": -speed * data.velocity,
        "constant_force:1": one * np.array([1.0, 0.0]),
        "constant_force:2": one * np.array([0.0, 1.0]),
        "tether": -data.position,
        "mass_drift": -time * force,
        "stribeck_friction": rub * np.exp(-((speed / 0.2) ** 2)),
        "anisotropic_friction:1": rub * np.cos(2 * angle),
        "anisotropic_friction:2": rub * np.sin(2 * angle),
        "friction_gradient:1": rub * data.position[:, :1],
        "friction_gradient:2": rub * data.position[:, 1:],
        "friction_drift": rub * time,
        "gravity_error": data.gravity,
    }


def _basis(data: Samples) -> Array:
    """Return 1, the direction of friction, force, velocity, position, time, and f |f| and v |v|, shape (n, F)."""
    odd = [each * np.linalg.norm(each, axis=1, keepdims=True) for each in (data.force, data.velocity)]
    rub, one = data.load[:, None] * _heading(data), np.ones((len(data.time), 1))
    return np.concatenate([one, rub, data.force, data.velocity, data.position, data.time[:, None], *odd], 1)


def _heading(data: Samples) -> Array:
    return np.asarray(data.velocity / np.linalg.norm(data.velocity, axis=1, keepdims=True))


def _stack(values: Array) -> Array:
    """Put all x before all y, shape (2 n,)."""
    return values.T.ravel()


def _project(values: Array, columns: Array) -> Array:
    """Return what is left of values after a least squares fit by columns."""
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])
