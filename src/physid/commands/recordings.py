"""The commands that make recordings, and list what they may hide."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from physid.commands.terminal.screen import resumable

if TYPE_CHECKING:
    from physid.configuration import Configuration


def generate(
    configuration: Configuration,
    *,
    out: Path | None = None,
    workers: int = -1,
    backend: Literal["loky", "dask"] = "loky",
    scheduler: str | None = None,
    quiet: bool = False,
) -> None:
    """Make recordings of a scene with a simulator: PyBullet, MuJoCo or closed forms.

    The configuration says which scene, how it is excited, how many trajectories, with video or not. The recordings land
    in data/NAME, where NAME is that of the configuration file. An interrupted run resumes where it stopped, and the
    result does not depend on the number of workers.

    Examples:
      physid generate --config configs/generate/push.yaml
      physid generate --config configs/generate/push.yaml --out data/small trajectories=20 steps=60 video=false

    Args:
        configuration: What to make.
        out: Folder of the recording set; data/NAME by default.
        workers: Processes; -1 for one on each core.
        backend: loky for processes of this machine, dask for a cluster (docs/scaling.md).
        scheduler: Address of Dask's scheduler, tcp://HOST:8786.
        quiet: Hide the progress bar.
    """
    from physid.data.generation.generate import generate as run
    from physid.data.generation.settings import GenerateConfig
    from physid.one_writer import one_writer
    from physid.workers import running_on

    config = GenerateConfig.from_mapping(configuration.values)
    folder = out or Path("data") / configuration.name
    with resumable(), one_writer(folder), running_on(backend, scheduler) as whole_path:
        done = run(config, whole_path(folder), workers, quiet=quiet)
    print(f"{done.folder}: {done.written} trajectories written, {done.kept} kept, {done.redrawn} draws left the view")


def effects(*, site: Literal["actuation", "dynamics", "contact", "perception"] | None = None) -> None:
    """List the effects that a model may lack: formula, parameters, units, ranges.

    They can be switched on in `physid generate` (effects.viscous_drag.coefficient=0.3), added to a model, and are the
    candidates of `physid diagnose`. At its null value an effect does nothing.

    Examples:
      physid effects --site contact

    Args:
        site: Only the effects of one site.
    """
    from physid.effects import CATALOGUE
    from physid.effects.table import rows_of

    for kind in CATALOGUE:
        if site in (None, kind.site):
            rows = rows_of(kind)
            print(f"{kind.name} ({kind.site})\n  {rows[0].formula}")
            for row in rows:
                print(f"    {row.parameter} [{row.unit}]  {row.range}, typically {row.typical}; null {row.null}")
