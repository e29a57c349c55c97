"""The command that checks a diagnosis on recordings whose truth it cannot see."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from physid.commands.terminal.screen import resumable

if TYPE_CHECKING:
    from physid.benchmark.bank import Purpose
    from physid.benchmark.plan import Plan


def benchmark(
    subject: Literal["diagnosis"],
    step: Literal["all", "seal", "diagnose", "score", "calibrate"] = "all",
    *,
    out: Path | None = None,
    bank: Path | None = None,
    sets: int = 150,
    trajectories: int = 24,
    steps: int = 300,
    seed: int = 0,
    quick: bool = False,
    simulator: str = "pybullet",
    roles: str = "all",
    least_severity: float = 0.0,
    calibration: bool = False,
    workers: int = -1,
    backend: Literal["loky", "dask"] = "loky",
    scheduler: str | None = None,
    again: bool = False,
    so_far: bool = False,
    join: str = "",
    spent: bool = False,
    quiet: bool = False,
) -> None:
    """Check the diagnosis on recordings with hidden effects.

    `seal` makes recording sets with hidden effects and publishes the salted hash of their labels; `diagnose` sees the
    recordings only; `score` opens the labels once every set has its verdict. Without a step, all three; each goes on
    where it stopped. `calibrate` trains the probabilities of causes on calibration banks, whose seeds are never scored.

    Examples:
      physid benchmark diagnosis --quick
      physid benchmark diagnosis seal --out banks/1 --seed 1
      physid benchmark diagnosis diagnose --bank banks/1
      physid benchmark diagnosis score --bank banks/1
      physid benchmark diagnosis --simulator mujoco --roles free,catalogue --out banks/2
      physid benchmark diagnosis calibrate --bank banks/3,banks/4 --join shipped --out calibration

    Args:
        subject: What to check.
        step: all, seal, diagnose, score or calibrate.
        out: What is written: the bank by seal, results by score (BANK/score), a model by calibrate (BANK/calibration).
        bank: The bank; runs/benchmark/diagnosis by default. For calibrate several, with commas between them.
        sets: Recording sets in a new bank.
        trajectories: Trajectories of each set.
        steps: Frames of each trajectory.
        seed: Seed of a new bank.
        quick: A tenth: 15 sets of 12 trajectories of 120 frames.
        simulator: Who makes the sets of a new bank: pybullet, mujoco, closed_form, several with commas between them, or
            all. Others than pybullet: 30 to 240 frames per second, jittered stamps and lost frames in every third set.
        roles: Roles in a new bank; all, or of free, catalogue, native, outside, alias, pair, triple, commas between.
        least_severity: How much each hidden effect shows at least, in standard deviations of the noise.
        calibration: Make a calibration bank.
        workers: Processes; -1 for one on each core.
        backend: loky for processes of this machine, dask for a cluster (docs/scaling.md).
        scheduler: Address of Dask's scheduler, tcp://HOST:8786.
        again: Diagnose again what failed before.
        so_far: With score, or calibrate --spent: of the sets that have a verdict already; later ones are not sealed.
        join: With calibrate: a training.yaml whose sets count too; shipped for the one that ships with physid.
        spent: With calibrate: take banks to score by too; from then on no score on them is a withheld one.
        quiet: Hide the progress bars.
    """
    from physid.benchmark.bank import QUICK, Size
    from physid.benchmark.plan import Plan, roles_of, simulators_of
    from physid.workers import running_on

    _check_step(step, so_far, join, spent, out, again)
    place = (out if step in ("all", "seal") else None) or bank or Path(f"runs/benchmark/{subject}")
    size = QUICK if quick else Size(sets, trajectories, steps)
    with resumable(), _writing(place, step), running_on(backend, scheduler) as whole_path:
        if step in ("all", "seal"):
            purpose: Purpose = "calibration" if calibration else "score"
            plan = Plan(purpose, seed, size, simulators_of(simulator), roles_of(roles), least_severity)
            _seal(whole_path(place), plan, workers, quiet)
        if step in ("all", "diagnose"):
            _diagnose(whole_path(place), workers, again, quiet)
    if step in ("all", "score"):
        _score(place, out if step == "score" else None, so_far)
    if step == "calibrate":
        _calibrate([Path(each) for each in str(place).split(",")], join, spent, so_far, out)


def _check_step(step: str, so_far: bool, join: str, spent: bool, out: Path | None, again: bool) -> None:
    """Refuse what belongs to another step."""
    if step == "diagnose" and out is not None:
        raise ValueError(f"--out belongs to seal, score and calibrate; the bank to diagnose is named by --bank {out}")
    if again and step not in ("all", "diagnose"):
        raise ValueError(f"--again belongs to diagnose, got it with {step}")
    if so_far and step != "score" and not (step == "calibrate" and spent):
        raise ValueError(
            f"--so-far belongs to score and to calibrate --spent, got it with {step}: "
            "it would open the labels before their time"
        )
    if join and step != "calibrate":
        raise ValueError(f"--join belongs to calibrate, got it with {step}")
    if spent and step != "calibrate":
        raise ValueError(f"--spent belongs to calibrate, got it with {step}")


def _writing(place: Path, step: str) -> AbstractContextManager[None]:
    """Let no second process write into a bank, if this step does; a bank that is not there is not made by looking."""
    from physid.one_writer import one_writer

    return one_writer(place) if step in ("all", "seal") or (step == "diagnose" and place.is_dir()) else nullcontext()


def _seal(place: Path, plan: Plan, workers: int, quiet: bool) -> None:
    from physid.benchmark.sealing.seal import seal

    bank = seal(place, plan, workers, quiet=quiet)
    print(f"{place}: {len(bank.sets)} sets; SHA-256 of the sealed labels {bank.seal}")


def _diagnose(place: Path, workers: int, again: bool, quiet: bool) -> None:
    from physid.benchmark.bank import read_bank
    from physid.benchmark.verdicts import diagnose_bank

    done, failed = diagnose_bank(read_bank(place), workers, again=again, quiet=quiet)
    print(f"{place}: {done} diagnosed now, {failed} of them failed")


def _score(place: Path, out: Path | None, so_far: bool) -> None:
    from physid.benchmark.bank import read_bank
    from physid.benchmark.scoring import report, score
    from physid.one_writer import refuse_links

    target = out or place / "score"
    refuse_links(out or place)
    print(f"{report(score(read_bank(place), target, so_far=so_far))}\n\n{target / 'results.html'}")


def _calibrate(folders: list[Path], join: str, spent: bool, so_far: bool, out: Path | None) -> None:
    from physid.benchmark.bank import read_bank
    from physid.benchmark.scoring import calibrate, columns, earlier_table, spend
    from physid.one_writer import refuse_links

    target = out or folders[0] / "calibration"
    refuse_links(out or folders[0])
    known = earlier_table(join) if join else []
    banks = [read_bank(each) for each in folders]
    banks = spend(banks, so_far) if spent else banks
    print(f"{columns(calibrate(banks, target, known))}\n\n{target}")
