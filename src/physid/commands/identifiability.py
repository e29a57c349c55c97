"""The command that says what recordings identify."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physid.configuration import Configuration


def identifiability(
    configuration: Configuration | None,
    recordings: Path | None = None,
    *,
    learn: str = "",
    out: Path | None = None,
) -> None:
    """Report which parameters an experiment identifies, before anything is recorded, or what recordings identify.

    From the sensitivity of trajectories to mass, friction and restitution: is each identified, only in a combination
    with others (which), or not at all; and which standard deviation is to be expected with a given sensor noise, for
    recordings that which their poses show. The figures land in runs/identifiability/NAME as identifiability.json and
    identifiability.png.

    Examples:
      physid identifiability data/mine
      physid identifiability data/mine --learn block.mass,block.friction
      physid identifiability --config configs/identifiability/push.yaml
      physid identifiability --config configs/identifiability/push.yaml trajectories=100 noise.position=0.002
      physid identifiability --config configs/identifiability/push.yaml constant_force=5.5

    Args:
        configuration: Scene, excitation, parameters and noise of a planned experiment.
        recordings: Folder of a recording set, to judge that instead.
        learn: Parameters of these, separated by commas; what recording.yaml calls unknown by default.
        out: Folder of the result; runs/identifiability/NAME by default.
    """
    from physid.configuration import ConfigurationError
    from physid.training.identifiability.planned_experiment import IdentifiabilityConfig, IdentifiabilityResult, analyse
    from physid.training.identifiability.recorded import RecordedIdentifiability, analyse_recordings

    found: IdentifiabilityResult | RecordedIdentifiability
    if recordings is not None:
        found, name = analyse_recordings(recordings, learn.split(",") if learn else None), recordings.resolve().name
    elif learn or configuration is None:
        raise ConfigurationError(
            "identifiability: expected recordings beside --learn; of a plan, say learn=[block.mass]"
        )
    else:
        found, name = analyse(IdentifiabilityConfig.from_mapping(configuration.values)), configuration.name
    folder = out or Path("runs/identifiability") / name
    found.write(folder)
    print(f"{found.table()}\n{folder}")
