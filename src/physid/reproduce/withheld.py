"""A recording set whose effect is withheld, diagnosed and scored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, final

from physid.reproduce.cells import PERCENT, Cell, Recordings
from physid.reproduce.results import Result

if TYPE_CHECKING:
    from physid.diagnosis.document.document import Diagnosis

CONFIG = Path("diagnose", "withheld_drag.yaml")
NONE_WRONG, SIZE_TOLERANCE, LEFT = 0.5, 10.0, 10.0


@final
@dataclass(frozen=True)
class Withheld(Cell):
    """A `physid diagnose` of recordings with a drag that nobody told it about.

    Attributes:
        name: diagnosis/withheld; the recordings are those of configs/diagnose/withheld_drag.yaml.
        minutes: See `Cell`.
    """

    name: str = "diagnosis/withheld"
    recordings: Recordings | None = None
    minutes: float = 1.0

    def run(self, configs: Path, data: Path, folder: Path) -> list[Result]:
        """Generate, diagnose and compare with what was hidden (see `Cell.run`)."""
        from physid.configuration import compose
        from physid.data import RecordingSet
        from physid.data.generation.generate import generate
        from physid.data.generation.settings import GenerateConfig
        from physid.diagnosis.diagnose import diagnose

        hidden = GenerateConfig.from_mapping(compose([str(configs / CONFIG)], reads=GenerateConfig).values)
        generate(hidden, folder / "recordings", 1, quiet=True)
        return self.results(diagnose(RecordingSet(folder / "recordings"), folder), hidden.effects)

    def results(self, found: Diagnosis, hidden: Mapping[str, Mapping[str, float]]) -> list[Result]:
        """Score a diagnosis against the effects that were hidden."""
        blamed = {each.name: each.parameters for each in found.effects}
        wrong = len(set(blamed) ^ set(hidden))
        scored = [Result(self.name, "effects missed or wrongly named", wrong, "", target=NONE_WRONG)]
        for name, values in hidden.items():
            for key, true in values.items():
                estimate = blamed.get(name, {}).get(key)
                value = None if estimate is None else estimate.value
                error = None if value is None else PERCENT * abs(value / true - 1)
                scored.append(Result(self.name, f"{name}.{key}, true value", true, ""))
                scored.append(Result(self.name, f"{name}.{key}, estimate", value, ""))
                scored.append(Result(self.name, f"{name}.{key}, error", error, "%", target=SIZE_TOLERANCE))
        for split, share in (("same", found.shrink.same), ("transfer", found.shrink.transfer)):
            left = None if share is None else PERCENT * max(0.0, 1 - share.value)
            scored.append(Result(self.name, f"gap left, {split} protocol", left, "%", target=LEFT))
        return scored
