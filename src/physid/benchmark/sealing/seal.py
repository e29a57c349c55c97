"""Make a bank: recording sets with hidden effects, and the labels sealed apart."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from physid.benchmark.bank import FILE, SEALED, SETS, Bank, Recorder, read_bank, write_bank
from physid.benchmark.labels import Label, write_labels
from physid.benchmark.plan import Plan, tasks
from physid.benchmark.sealing.recorded_set import make
from physid.data.files import read_json, write_text
from physid.progress.bar import progress_bar
from physid.record import checksum
from physid.strict import shown

EPOCH = 1_700_000_000  # every file gets this date


def seal(folder: Path, plan: Plan, workers: int = 1, *, quiet: bool = False) -> Bank:
    """Make a bank, or go on with one that was interrupted.

    Args:
        folder: Where it shall lie.
        plan: What to make.
        workers: Processes; the recordings do not depend on it.
        quiet: Whether to hide the progress bar.

    Returns:
        The bank.

    Raises:
        ValueError: If the folder holds another bank.
    """
    import joblib

    _keep_apart(folder, plan)
    if (folder / FILE).is_file():
        return _sealed_before(folder, plan)
    jobs = (joblib.delayed(make)(folder.absolute(), plan, task) for task in tasks(plan))
    parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered", batch_size=1)
    labels = dict(progress_bar(parallel(jobs), quiet=quiet, total=plan.size.sets, desc="sealing", smoothing=0))
    mark = seal_all(folder, labels)
    sums = {name: checksum(folder / SETS / name) for name in sorted(labels)}
    recorded = {name: Recorder(one.simulator, one.frame_rate) for name, one in sorted(labels.items())}
    bank = Bank(folder, plan.purpose, sums, mark, recorded)
    write_bank(bank)
    return bank


def _sealed_before(folder: Path, plan: Plan) -> Bank:
    """Return a bank that is sealed: a fresh salt would change what was published, and a spent one is spent for good."""
    bank = read_bank(folder)
    if bank.purpose != plan.purpose:
        raise ValueError(
            f"{folder}: expected a bank for {plan.purpose}, found one for {bank.purpose}; a bank whose labels have "
            "served for calibration cannot be scored; seal another one in a new folder"
        )
    return bank


def seal_all(folder: Path, labels: Mapping[str, Label]) -> str:
    """Give all recordings one date, and seal the labels with a fresh salt; returns the seal."""
    for path in sorted((folder / SETS).rglob("*"), reverse=True):
        os.utime(path, (EPOCH, EPOCH))
    return write_labels(folder, labels, secrets.token_hex(32))


def _keep_apart(folder: Path, plan: Plan) -> None:
    """Refuse to mix two banks in one folder."""
    path = folder / SEALED / "plan.json"
    values = json.loads(json.dumps(asdict(plan)))
    plain = json.loads(json.dumps(asdict(Plan(plan.purpose, plan.seed, plan.size))))  # a bank that says no more
    if path.is_file():
        found = read_json(path, "what a bank is made from")
        if not isinstance(found, dict):
            raise ValueError(
                f"{path}: expected a mapping, found {shown(found)}; choose another folder, or delete this one"
            )
        if plain | found != values:
            raise ValueError(
                f"{folder} holds a bank of another seed, size, purpose, simulator or role; choose another folder, or "
                "delete this one first"
            )
    write_text(path, json.dumps(values) + "\n")
