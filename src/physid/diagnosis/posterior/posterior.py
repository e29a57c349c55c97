"""How probable each cause is: a conditional logit over causes (McFadden 1974), trained on calibration banks."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge, Lt
from numpy.typing import NDArray

from physid.diagnosis.document.evidence import NONE, OTHER, UNKNOWN, Evidence
from physid.typed_files import CLOSED, read_yaml_as

Array = NDArray[np.float64]
FILE = Path(__file__).parent / "coefficients.yaml"


@dataclass(frozen=True)
class Coefficients:
    """Coefficients of the utility u of a cause; its probability grows with exp(u).

    Attributes:
        none: Of no effect; the same for each of the next ones. Single effects that are listed have 0.
        unknown: Of an effect that the catalogue lacks.
        other: Of an effect, or of several, that are not listed.
        several: Of a hypothesis of more than one effect.
        says_none: More, if that is the verdict; the same for each of the next ones.
        says_unknown: If the verdict is `unknown`.
        says_effect: For the hypotheses of the group, if the verdict blames something.
        behind: Of `Evidence.behind`, for all hypotheses.
        gap: Of log(1 + gap), for what the verdict says; of the negative of it for `none`, whatever the verdict says.
        bend: Of log(1 + bend), for what the verdict says.
        poses: Of the decimal logarithm of thousands of poses, for what the verdict says.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    none: float
    unknown: float
    other: float
    several: float
    says_none: float
    says_unknown: float
    says_effect: float
    behind: float
    gap: float
    bend: float
    poses: float

    def vector(self) -> Array:
        """Return them in the order of the columns of `features`."""
        return np.array([*asdict(self).values()])


@dataclass(frozen=True)
class Posterior:
    """The trained model: the content of coefficients.yaml.

    Attributes:
        coefficients: Of the utilities.
        rest: Probability that is spread over all causes alike.
        sets: Recording sets that it was trained on.
    """

    __pydantic_config__: ClassVar[Any] = CLOSED
    coefficients: Coefficients
    rest: Annotated[float, Ge(0), Lt(1)]
    sets: int

    def probabilities(self, evidence: Evidence) -> dict[str, float]:
        """Return the probability of each cause, the most probable first.

        p = (1 - e) exp(u) / sum exp(u) + e / m, with m causes and e the rest: however clear the evidence is, something
        that it does not show may be the cause.
        """
        found = softmax(features(evidence) @ self.coefficients.vector())
        values = ((1 - self.rest) * found + self.rest / len(found)).tolist()
        return dict(sorted(zip(causes(evidence), values, strict=True), key=lambda one: -one[1]))


def confidence(evidence: Evidence, probabilities: dict[str, float]) -> float:
    """Return the probability of what the verdict says: that of one of its causes."""
    return min(1.0, sum(probabilities[name] for name in evidence.said))


def causes(evidence: Evidence) -> list[str]:
    """List the causes that have a probability, in the order of the rows of `features`."""
    return [NONE, UNKNOWN, OTHER, *evidence.behind]


def features(evidence: Evidence) -> Array:
    """Return what the utility of each cause is linear in, see `Coefficients`; shape (causes, coefficients)."""
    names = causes(evidence)
    said = np.array([name in evidence.said for name in names], float)
    says_none, says_unknown = (float(evidence.said == (kind,)) for kind in (NONE, UNKNOWN))
    away = np.array([evidence.behind.get(name, 0.0) for name in names])
    free = np.array([name == NONE for name in names], float)
    size = (said * (1 - free) - free) * math.log1p(evidence.gap)
    columns = [
        *(np.array([name == kind for name in names], float) for kind in (NONE, UNKNOWN, OTHER)),
        np.array([" + " in name for name in names], float),
        said * says_none,
        said * says_unknown,
        said * (1 - says_none - says_unknown),
        away,
        size,
        said * math.log1p(evidence.bend),
        said * (math.log10(evidence.poses) - 3),
    ]
    return np.stack(columns, 1)


def softmax(utility: Array) -> Array:
    """Return exp(u) / sum exp(u) over the last axis, shape (..., m)."""
    raised = np.exp(utility - utility.max(-1, keepdims=True))
    return np.asarray(raised / raised.sum(-1, keepdims=True))


@cache
def shipped() -> Posterior:
    """Return the model that ships with physid."""
    return read_yaml_as(Posterior, FILE)
