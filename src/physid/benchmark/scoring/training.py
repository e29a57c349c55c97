"""Train the probabilities of causes: the table of evidence and truth, a fit, and how good it is on sets left out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy import optimize

from physid.benchmark.scoring.intervals import calibration_error
from physid.data.files import write_text
from physid.diagnosis.document.evidence import NONE, UNKNOWN, Evidence
from physid.diagnosis.posterior.posterior import FILE, Coefficients, Posterior, causes, confidence, features, softmax
from physid.typed_files import CLOSED, read_yaml_as

Array = NDArray[np.float64]
TABLE = FILE.with_name("training.yaml")
OFFSETS, SLOPES, REST = 0.2, 1.0, 0.03
"""Ridge of the coefficients, weak for how often a kind of cause is true and strong for what changes it, and the
probability that is spread over all causes: those with the best log score on sets of banks 7301 and 8801 left out."""
SLOPED = ("gap", "bend", "poses")
HEADER = ("probabilities", "sets", "mean %", "right %", "calibration error %", "log score, verdict", "log score, cause")
LEAST = 1e-3  # a probability of zero would cost infinitely much
Said = tuple[float, bool, float | None]
"""The probability of an answer, whether it was right, and the probability of what is true (None where unknown)."""


@dataclass(frozen=True)
class Case:
    """One recording set of the training table.

    Attributes:
        name: Name of its bank, and its own.
        simulator: Who recorded it.
        frame_rate: Frames per second [Hz].
        scene: Its scene.
        truth: Causes that are right answers.
        evidence: What the diagnosis found.
        bic: The largest weight that plain BIC gives to a cause, and those that it gives to the right ones together.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    name: str
    simulator: str
    frame_rate: float
    scene: str
    truth: tuple[str, ...]
    evidence: Evidence
    bic: tuple[float, float]

    @property
    def right(self) -> bool:
        """Whether the verdict allows a right answer."""
        return bool(set(self.truth) & set(self.evidence.said))


@dataclass(frozen=True)
class _Table:
    """The content of training.yaml."""

    __pydantic_config__: ClassVar[Any] = CLOSED
    cases: tuple[Case, ...]


def train(cases: Sequence[Case]) -> Posterior:
    """Fit the coefficients: the largest mean log probability of what is true, less a ridge; without cases all are 0."""
    if not cases:
        return Posterior(Coefficients(*[0.0] * len(fields(Coefficients))), REST, 0)
    column, used, true = _stacked(cases)
    spread = REST * true.sum(1, keepdims=True) / used.sum(1, keepdims=True)
    ridge = np.array([SLOPES if one.name in SLOPED else OFFSETS for one in fields(Coefficients)])

    def loss(weights: Array) -> tuple[float, Array]:
        found = softmax(np.where(used, column @ weights, -np.inf))
        share = (found * true).sum(1, keepdims=True)
        right = (1 - REST) * share + spread
        slope = np.einsum("kmf,km->f", column, (1 - REST) * found * (share - true) / right)
        return float(-np.log(right).sum() + (ridge * weights**2).sum() / 2), slope + ridge * weights

    weights = optimize.minimize(loss, np.zeros(len(ridge)), jac=True, method="L-BFGS-B").x
    return Posterior(Coefficients(*(float(f"{value:.4g}") for value in weights)), REST, len(cases))


def _stacked(cases: Sequence[Case]) -> tuple[Array, NDArray[np.bool_], Array]:
    """Return the features of all causes of all cases, which of them there are, and which are true."""
    each = [features(case.evidence) for case in cases]
    most = max(map(len, each))
    column = np.stack([np.pad(one, ((0, most - len(one)), (0, 0))) for one in each])
    names = [causes(case.evidence) for case in cases]
    used, true = np.zeros((2, len(cases), most))
    for row, (listed, case) in enumerate(zip(names, cases, strict=True)):
        used[row, : len(listed)] = 1
        true[row, : len(listed)] = [name in case.truth for name in listed]
    return column, used > 0, true


def write_training(out: Path, cases: Sequence[Case]) -> list[Case]:
    """Write training.yaml, one case a line, and what is trained on it, coefficients.yaml.

    Returns:
        The cases with the digits that the table has.
    """
    lines = [
        yaml.safe_dump(_digits(asdict(case)), default_flow_style=True, sort_keys=False, width=10**6) for case in cases
    ]
    write_text(out / TABLE.name, "cases:\n" + "".join(f"- {line}" for line in lines))
    written = read_table(out / TABLE.name)
    write_text(out / FILE.name, yaml.safe_dump(asdict(train(written)), sort_keys=False))
    return written


def read_table(path: Path = TABLE) -> list[Case]:
    """Read a training table; without a path the one that ships."""
    return list(read_yaml_as(_Table, path).cases)


def _digits(value: Any) -> Any:
    """Return plain values with four digits."""
    if isinstance(value, dict):
        return {name: _digits(each) for name, each in value.items()}
    if isinstance(value, tuple):
        return [_digits(each) for each in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def quality(cases: Sequence[Case]) -> list[tuple[str, ...]]:
    """Return a table of `HEADER`: the model, each set left out once; counts of verdicts; plain BIC; parts of the sets.

    The log score of a verdict is -log p if it is right, else -log(1 - p), that of the cause -log of the probability of
    what is true; both in the mean over sets [nats], least is best.
    """
    ours = leave_one_out(cases)
    counted = _counted(cases)
    weights: list[Said] = [(best, true == best, true) for best, true in (case.bic for case in cases)]
    rows = [HEADER, _row("this model, each set left out", ours), _row("shares of right verdicts of a kind", counted)]
    rows.append(_row("weights of plain BIC", weights))
    parts: tuple[Callable[[Case], str], ...] = (
        lambda case: case.simulator,
        lambda case: f"{case.frame_rate:.0f} Hz",
        lambda case: case.scene,
        lambda case: _kind(case),
    )
    for part in parts:
        for name in sorted({part(case) for case in cases}, key=lambda name: (len(name), name)):
            rows.append(_row(f"  {name}", [one for one, case in zip(ours, cases, strict=True) if part(case) == name]))
    return rows


def leave_one_out(cases: Sequence[Case]) -> list[Said]:
    """Return what the model says of each case when it is trained on the others."""
    said: list[Said] = []
    for k, case in enumerate(cases):
        found = train([*cases[:k], *cases[k + 1 :]]).probabilities(case.evidence)
        said.append((confidence(case.evidence, found), case.right, sum(found[name] for name in case.truth)))
    return said


def _counted(cases: Sequence[Case]) -> list[Said]:
    """Return the share of right verdicts among the others of its kind, (right + 1) / (all + 2) (Laplace 1774)."""
    said: list[Said] = []
    for case in cases:
        same = [other.right for other in cases if other is not case and _kind(other) == _kind(case)]
        said.append(((sum(same) + 1) / (len(same) + 2), case.right, None))
    return said


def _kind(case: Case) -> str:
    said = case.evidence.said
    return said[0] if said in ((NONE,), (UNKNOWN,)) else "a cause"


def _row(name: str, said: Iterable[Said]) -> tuple[str, ...]:
    answer, right, true = zip(*said, strict=True)
    sure, hit = np.clip(np.array(answer), LEAST, 1 - LEAST), np.array(right, float)
    verdict = -np.log(np.where(hit > 0, sure, 1 - sure)).mean()
    cause = "" if None in true else f"{-np.log(np.maximum(np.array(true, float), LEAST)).mean():.3f}"
    shares = (f"{100 * value:.1f}" for value in (sure.mean(), hit.mean(), calibration_error(sure, hit)))
    return (name, str(len(sure)), *shares, f"{verdict:.3f}", cause)
