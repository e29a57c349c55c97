"""What each heuristic of a diagnosis is worth: switched off through the settings, one at a time, on the same sets.

    python benchmarks/ablation.py --work /tmp/ablation --workers 2 --minutes 14
    python benchmarks/ablation.py --work /tmp/ablation --table

Three small banks, sealed as `physid benchmark diagnosis seal` does: of PyBullet, whose steps are known, of MuJoCo, and
of closed forms, with hidden effects of medium severity and up. Each set is diagnosed with all heuristics, then without
each of them; a run that is stopped goes on where it was. Sets that have not seen every variant do not count. *Acted*:
in how many sets any figure of the diagnosis differs in any digit.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import torch

from physid.benchmark.bank import Size
from physid.benchmark.labels import Label, open_labels
from physid.benchmark.plan import Plan
from physid.benchmark.scoring.intervals import wilson
from physid.benchmark.scoring.judging import MEDIUM, Judged, judge
from physid.benchmark.sealing.seal import seal
from physid.data import RecordingSet
from physid.diagnosis.conclusion.conclusion import draw_conclusion
from physid.diagnosis.document.document import Diagnosis
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.inputs.observations import PROBE, load_observations
from physid.diagnosis.inputs.observations import TRANSFER as TRANSFERRED
from physid.diagnosis.inputs.requirements import require_usable
from physid.diagnosis.progress import Stage
from physid.diagnosis.reference.nominal_fit import NominalFit, fit_nominal_model
from physid.diagnosis.reference.nominal_fit_cache import DECIDING
from physid.diagnosis.selection.attribution import attribute
from physid.diagnosis.selection.search import Attribution
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing.hypothesis import Hypothesis
from physid.effects import CATALOGUE

SIZE = Size(6, trajectories=8, steps=80)
PLANS = {
    "pybullet": Plan("score", 40418, SIZE, least=MEDIUM),
    "mujoco": Plan("score", 90732, SIZE, ("mujoco",), least=MEDIUM),
    "closed_form": Plan("score", 55291, SIZE, ("closed_form",), least=MEDIUM),
}
"""Of seeds that no other bank has. PyBullet records every step of its own; the others 30 to 240 frames a second, some
with jitter and lost frames, and recording.yaml does not say who made them."""

WITHOUT: Mapping[str, Mapping[str, Any]] = {
    "all heuristics": {},
    "contact-free segments first": {"contact_free.first": False},
    "frames a late camera took from before": {"contact_free.late": 0},
    "several effects": {"candidates.most_effects": 1},
    "more than two effects": {"candidates.most_effects": 2},
    "effects exchanged": {"candidates.exchanged": False},
    "further effects at impacts": {"attribution.at_impacts": 0},
    "starts from finite sizes": {"attribution.multi_start": 0},
    "curved steps": {"hypothesis.curved": []},
    "new initial states of hypotheses": {"hypothesis.new_states": False},
    "new initial states of the nominal fit": {"nominal_fit.new_states": False},
    "multiples of first guesses": {"first_guess.factors": [1.0]},
    "cutting again around new events": {"nominal_fit.cuts": 1},
    "jolts as events": {"events.jolt": 1e6},
    "weights of frames (Huber)": {"nominal_fit.robust": False},
    "weights of contact segments": {"nominal_fit.own_weights": False},
    "steps chosen by halving": {"nominal_fit.step_choices": 0},
    "following the simulator": {"discrepancy.follows": False},
    "bound on the difference of two engines": {"least_squares.prior.engine": 1e6},
    "candidates refitted with the simulator": {"comparison.most_refitted": 0},
    "floors of the numerics": {"null_simulations.floor_replays": 0},
    "bad impacts apart": {"null_distribution.bad": 1e8},
    "steady gain": {"score_test.steady": False},
    "margin": {"lack_of_fit.margin": 1},
    "evident gaps": {"evidence.evident": 1e8},
    "laws that differ by a hair": {"evidence.closed": 0},
    "numerics between rivals": {"evidence.same": 0},
    "equivalent signatures": {"equivalence.alike": 2},
    "probes": {"roles.probes_from": 1000},
    "scatter of replays": {"parametric_bootstrap.replays": 0},
    "tolerance": {"materiality.share_of_noise": 1e-6, "materiality.share_of_size": 1e-9},
    "hollow effects dropped": {"verdict.reconsidered": False},
    "veto of the transfer protocol": {"verdict.carries": -1e8},
}
"""Heuristics, and the settings that switch each of them off."""
COMMON = {"next_experiment.drawn": 1}  # what to record next changes no verdict, and takes time
FOREIGN = {"steps chosen by halving"}
KNOWN = {"following the simulator"}
"""Act only where recording.yaml does not say, or says, how recordings were integrated."""
TRANSFER = {"probes", "veto of the transfer protocol"}
"""Act only where there is another protocol."""
CONTACT = {
    "contact-free segments first", "frames a late camera took from before", "further effects at impacts",
    "bad impacts apart", "steady gain", "weights of contact segments", "scatter of replays",
}  # fmt: skip
"""Act only where something is hit."""
FITTED = {
    "several effects", "more than two effects", "effects exchanged", "further effects at impacts",
    "starts from finite sizes",
    "curved steps", "new initial states of hypotheses",
    "candidates refitted with the simulator", "laws that differ by a hair", "numerics between rivals",
    "equivalent signatures", "scatter of replays", "hollow effects dropped",
}  # fmt: skip
"""Act only where candidates are fitted, which takes a gap that is significant."""
CONCLUDING = ("posterior", "residual_law", "gap", "materiality", "verdict", "localisation", "next_experiment")
"""Sections of the settings that only the conclusion reads."""


def all_sets(work: Path, workers: int) -> Iterator[tuple[str, Path, Label]]:
    """Seal all banks, and list their sets in turn, with their labels; films are left out."""
    banks = {name: seal(work / name, plan, workers, quiet=True) for name, plan in PLANS.items()}
    labels = {name: open_labels(bank) for name, bank in banks.items()}
    for sets in zip(*(bank.sets for bank in banks.values()), strict=True):
        for (name, bank), one in zip(banks.items(), sets, strict=True):
            if not labels[name][one].film:
                yield f"{name}/{one}", bank.recordings(one), labels[name][one]


class Pipeline:
    """Diagnoses one set again and again; what a change of settings leaves as it was is done once.

    Args:
        folder: The recording set.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.fits: dict[str, tuple[NominalFit, torch.Tensor, float]] = {}
        self.searches: dict[str, tuple[Attribution, torch.Tensor, float]] = {}
        self.stages: set[Stage] = set()

    def run(self, settings: Settings) -> tuple[Diagnosis, float]:
        """Return the diagnosis, and how long a processor works on it [s]."""
        generator = torch.Generator().manual_seed(0)
        key = repr([getattr(settings, name) for name in ("roles", *DECIDING)])
        if key not in self.fits:
            begun = time.process_time()
            observations = load_observations(RecordingSet(self.folder), None, None, settings.roles)
            model = read_nominal_model(observations.scene, None)
            require_usable(observations, settings.requirements, settings.noise)
            made = fit_nominal_model(observations, model, CATALOGUE, generator, self.say, settings)
            self.fits[key] = made, generator.get_state(), time.process_time() - begun
        made, state, spent = self.fits[key]
        nominal_fit = replace(made, settings=settings)
        rest = repr([section for name, section in settings if name not in CONCLUDING])
        if rest not in self.searches:
            generator.set_state(state)
            begun = time.process_time()
            found = attribute(nominal_fit, generator, self.say)
            self.searches[rest] = found, generator.get_state(), time.process_time() - begun
        found, state, searched = self.searches[rest]
        generator.set_state(state)
        begun = time.process_time()
        said = draw_conclusion(nominal_fit, _with(found, settings), generator).diagnosis
        return said, spent + searched + time.process_time() - begun

    def say(self, stage: Stage, what: str = "") -> None:
        """Keep which stages there were."""
        self.stages.add(stage)

    def idle(self, known: bool) -> set[str]:
        """Return the heuristics that cannot act on this set, once all of them have been at work."""
        made = next(iter(self.fits.values()))[0]
        off = set(FOREIGN if known else KNOWN)
        off |= TRANSFER if not {TRANSFERRED, PROBE} & {*made.observations.roles} else set()
        off |= CONTACT if not bool(made.events.any()) else set()
        return off | (FITTED if Stage.FITTING not in self.stages else set())


def _with(found: Attribution, settings: Settings) -> Attribution:
    """Return what was found, with other settings for the conclusion; a hypothesis stays one and the same."""
    new: dict[int, Hypothesis] = {}

    def of(one: Hypothesis) -> Hypothesis:
        return new.setdefault(id(one), replace(one, settings=settings))

    whole = found.refit_all_segments
    return replace(
        found,
        nominal=of(found.nominal),
        tried=[of(one) for one in found.tried],
        best=found.best and of(found.best),
        group=[of(one) for one in found.group],
        refit_all_segments=whole and (of(whole[0]), whole[1] and of(whole[1])),
    )


def ablate(work: Path, place: str, folder: Path, label: Label, deadline: float) -> None:
    """Diagnose a set in all variants that are missing, as far as the time goes; results are files."""
    pipeline = Pipeline(folder)
    results = work / "results" / place
    if len(list(results.glob("*.json"))) == len(WITHOUT) or time.time() > deadline:
        return
    whole = _row(pipeline, place, label, "all heuristics")
    idle = pipeline.idle(place.startswith("pybullet"))
    for number, variant in enumerate(WITHOUT):
        result = results / f"{number:02d}.json"
        if result.is_file() or time.time() > deadline:
            continue
        row = whole if variant in idle or not number else _row(pipeline, place, label, variant)
        row = row | {"variant": variant, "acted": row["said"] != whole["said"]}
        results.mkdir(parents=True, exist_ok=True)
        result.with_suffix(".part").write_text(json.dumps(row))
        result.with_suffix(".part").rename(result)


def _row(pipeline: Pipeline, place: str, label: Label, variant: str) -> dict[str, Any]:
    """Diagnose a set in one variant, and judge the verdict."""
    try:
        found, seconds = pipeline.run(Settings().changed({**COMMON, **WITHOUT[variant]}))
    except (ValueError, RuntimeError) as error:
        one, said, seconds = Judged(place, label, "failed"), {"error": str(error)}, float("nan")
    else:
        one, said = judge(place, found, label), found.to_mapping()
        said.pop("settings")
    return {
        "place": place, "hidden": bool(label.effects), "nameable": bool(label.right), "verdict": one.verdict,
        "named": sorted(one.named), "group": sorted(one.group), "exact": one.exact, "grouped": one.grouped,
        "seconds": seconds, "said": json.loads(json.dumps(said)),
    }  # fmt: skip


def share(rows: list[bool]) -> str:
    """Write a share with its Wilson interval."""
    low, high = wilson(sum(rows), len(rows))
    return f"{sum(rows)}/{len(rows)} ({100 * low:.0f}-{100 * high:.0f})" if rows else "-"


def table(work: Path) -> str:
    """Lay out, for each variant, the sets that have seen all of them."""
    folders = sorted({path.parent for path in (work / "results").glob("*/*/00.json")})
    whole = [folder for folder in folders if len(list(folder.glob("[0-9][0-9].json"))) == len(WITHOUT)]
    lines = ["| without | acted | verdicts changed | group | exact | false alarms | unknown | time |"]
    lines.append("|---|---|---|---|---|---|---|---|")
    full = [json.loads((folder / "00.json").read_text()) for folder in whole]
    for number, variant in enumerate(WITHOUT):
        rows = [json.loads((folder / f"{number:02d}.json").read_text()) for folder in whole]
        changed = [_answer(one) != _answer(other) for one, other in zip(rows, full, strict=True)]
        nameable = [one for one in rows if one["nameable"]]
        free = [one for one in rows if not one["hidden"]]
        outside = [one for one in rows if one["hidden"] and not one["nameable"]]
        ratio = np.nanmedian([one["seconds"] / other["seconds"] for one, other in zip(rows, full, strict=True)])
        cells = [
            variant, str(sum(one["acted"] for one in rows)), str(sum(changed)),
            share([one["grouped"] for one in nameable]), share([one["exact"] for one in nameable]),
            share([one["verdict"] != "none" for one in free]), share([one["exact"] for one in outside]), f"{ratio:.2f}",
        ]  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([f"{len(whole)} sets", "", *lines])


def _answer(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["verdict"], row["named"], row["group"]


def main() -> None:
    """Run what is missing, then print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--work", type=Path, required=True, help="folder of sets and results")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=60.0, help="no diagnosis begins after so many")
    parser.add_argument("--table", action="store_true", help="print the table of what is there, and run nothing")
    options = parser.parse_args()
    if not options.table:
        deadline = time.time() + 60 * options.minutes
        sets = list(all_sets(options.work, options.workers))
        jobs = (joblib.delayed(ablate)(options.work, *each, deadline) for each in sets)
        joblib.Parallel(n_jobs=options.workers, batch_size=1)(jobs)
    print(table(options.work))


if __name__ == "__main__":
    main()
