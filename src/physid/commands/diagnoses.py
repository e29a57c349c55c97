"""The command that says what a nominal model lacks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from physid.diagnosis import Diagnosis


def diagnose(
    recordings: Path,
    *,
    out: Path | None = None,
    from_video: bool = False,
    encoder: Path | None = None,
    model: Path | None = None,
    transfer: Path | None = None,
    effects: str = "",
    allow: str = "",
    set: list[str] | None = None,
    limit: int | None = None,
    save_model: Path | None = None,
    tolerance: float | None = None,
    seed: int = 0,
    wandb: Literal["offline", "online"] | None = None,
    quiet: bool = False,
) -> None:
    """Find where a model leaves recordings, which effect causes it, and how far the gap closes.

    Fits the nominal model, looks for a gap beyond what null simulations show, and tries all effects of the catalogue.
    The verdict is none, named, group (these recordings cannot tell which), partial or unknown. It lands in OUT as
    report.html for a person and as diagnosis.json for a machine; docs/diagnosis.md says how to read it.

    Examples:
      physid diagnose data/mine --out runs/diagnosis
      physid diagnose data/mine --transfer data/mine_rich
      physid diagnose data/mine --effects my_effects.py
      physid diagnose data/films --from-video
      physid diagnose data/mine lack_of_fit.margin=1.5
      physid diagnose --settings

    Args:
        recordings: Folder of the recording set.
        out: Folder of the results; runs/diagnosis/NAME by default.
        from_video: Read the poses from the films first, into OUT/read (see `physid track`); recorded poses beyond the
            first are ignored. Recordings without poses are always read.
        encoder: Run of a fit from video whose encoder finds the bodies in the first frames; for --from-video.
        model: The nominal model: a configuration, run or checkpoint of `physid fit`; recording.yaml by default.
        transfer: A second set, the same bodies moved in another way; it certifies a cause.
        effects: Effects of your own as FILE.py, or FILE.py:CLASS for one of them, several separated by commas. Such a
            file is code, and is run.
        allow: Packages and files of your own whose classes and effects the model's configuration may name; their code
            is run.
        set: One more key=value of the settings; may be repeated, and the word --set be left out. `physid diagnose
            --settings` lists every number that decides, with its unit and where it was calibrated.
        limit: Use the first LIMIT trajectories of each set only.
        save_model: Where to write the model with what was found, as a configuration of `physid fit`.
        tolerance: How far positions may leave the model, beyond what noise accounts for, before anything is blamed
            [m]; by default 0.15 of the noise, at least 0.0002 of the largest edge.
        seed: Seed of the null simulations.
        wandb: Log figures, ranking, report and film as a run of wandb, into OUT/wandb or to the server.
        quiet: Hide the progress bar.
    """
    from physid.commands.configured import read_model
    from physid.commands.films import open_with_poses
    from physid.commands.terminal.screen import resumable, say, stage_bar
    from physid.diagnosis import MISSING, REPORT, Settings, parse_changes, summary_lines
    from physid.diagnosis.diagnose import diagnose as run
    from physid.effects.loading import own_effects
    from physid.record import describe, write_record

    changes = parse_changes(set or []) | ({} if tolerance is None else {"materiality.tolerance": tolerance})
    settings = Settings().changed(changes)
    folder = out or Path("runs/diagnosis") / recordings.resolve().name
    _check_own(effects.split(","), allow.split(","), folder / MISSING)
    given = {"read": recordings} | ({} if transfer is None else {"read_transfer": transfer})
    sets = open_with_poses(given, folder, from_video=from_video, encoder=encoder, limit=limit, quiet=quiet)
    own = own_effects([place for place in effects.split(",") if place])
    record = describe({"recordings": str(recordings), "transfer": str(transfer or "")})
    with resumable(), stage_bar(quiet) as stage:
        options: dict[str, Any] = {"transfer": sets.get("read_transfer"), "limit": limit, "seed": seed}
        options |= {"model": model and read_model(model, allow), "effects": own, "settings": settings}
        found = run(sets["read"], folder, save=save_model, say=stage, **options)
    write_record(folder, record)
    if wandb:
        _log(folder, wandb, {"recordings": str(recordings), "transfer": str(transfer or ""), "seed": seed}, found)
    say(*summary_lines(found), *(folder / one for one in (MISSING, REPORT) if (folder / one).is_file()))


def _check_own(effects: list[str], allowed: list[str], replaced: Path) -> None:
    """Refuse to allow what is no package and no file, and to run effects of the file that a diagnosis replaces."""
    from physid.effects.loading import file_of, packages_in

    packages_in([each for each in allowed if each])
    for file in filter(None, map(file_of, [*effects, *allowed])):
        if Path(file).resolve() == replaced.resolve():
            raise ValueError(f"{file}: this diagnosis would replace it; name another folder for its results: --out")


def _log(folder: Path, wandb: str, config: Mapping[str, Any], found: Diagnosis) -> None:
    """Set a diagnosis to wandb."""
    from physid.diagnosis import FILM, REPORT, figures_of
    from physid.training.runs.loggers import log_result

    ranking = [(" + ".join(row.effects), row.score, row.p_value) for row in found.ranking]
    tables = {"ranking": (("effects", "score", "p_value"), ranking)}
    log_result(folder, wandb, config, figures_of(found), tables, [folder / REPORT, folder / FILM])
