"""Drawing how large hidden effects are: so large that they show as much as is wanted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from physid.benchmark.labels import Part
from physid.benchmark.sealing.hidden import Hidden, Role, build, scaled
from physid.benchmark.sealing.severity import severity
from physid.data.generation.draw import draw
from physid.data.generation.settings import GenerateConfig
from physid.physics import Effect
from physid.simulators import find_simulator

SEVERITIES: Mapping[Role, tuple[float, float]] = {
    "catalogue": (0.01, 6.0),
    "native": (0.05, 8.0),
    "outside": (0.2, 8.0),
    "alias": (0.3, 8.0),
    "pair": (0.4, 6.0),
    "triple": (0.4, 6.0),
}
NEAR = 1.5  # factor within which a severity is met
FAINT = 1e-4  # severity below which an effect does not show at all
LEAST, MOST = 3e-3, 15.0  # multiples of the typical size that are tried


def draw_sizes(
    config: GenerateConfig, hidden: Hidden, generator: np.random.Generator, least: float
) -> tuple[Part, ...] | None:
    """Find a size for each effect at which it shows as much as is drawn; None where one cannot."""
    parts = []
    for kind in hidden.kinds:
        low, high = SEVERITIES[hidden.role]
        target = float(np.exp(generator.uniform(*np.log((max(low, NEAR * least), high)))))
        found = _size(config, kind, _direction(kind, generator), target)
        if found is None:
            return None
        parts.append(Part(kind.name, kind.site, *found))
    return tuple(parts)


def _direction(kind: type[Effect], generator: np.random.Generator) -> dict[str, float]:
    """Draw the proportions of an effect's parameters, of length 1; negative ones only where the range has them."""
    quantities = kind.quantities()
    draw = generator.normal(size=len(quantities))
    draw /= np.linalg.norm(draw)
    return {key: float(x if q.low < q.null else abs(x)) for (key, q), x in zip(quantities.items(), draw, strict=True)}


def _size(
    config: GenerateConfig, kind: type[Effect], direction: Mapping[str, float], target: float
) -> tuple[dict[str, float], float] | None:
    """Find the size at which an effect has a severity, within a factor; None where it cannot."""
    size, before = 1.0, None
    for _ in range(5):
        values = scaled(kind, direction, size)
        if values == before:  # at the ends of the ranges, and still not there
            return None
        before = values
        try:
            _check_makeable(config, (build(kind, values),))
            shown = severity(config, (build(kind, values),))
        except ValueError:  # the bodies leave the view, or the simulator cannot do it
            return None
        if target / NEAR <= shown <= target * NEAR:
            return values, shown
        if shown < FAINT:
            return None
        size = min(max(size * target / shown, LEAST), MOST)
    return None


def _check_makeable(config: GenerateConfig, effects: tuple[Effect, ...]) -> None:
    """Let a simulator that knows few motions try one; the others are tried by `severity`.

    Raises:
        ValueError: If it does not know this one.
    """
    if not find_simulator(config.simulator).from_any_state:
        draw(config, 0, config.protocol, effects)
