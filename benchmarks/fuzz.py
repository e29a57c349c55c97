"""Feed damaged and hostile input to every reader: no traceback, no hang, memory in proportion to the input.

    python benchmarks/fuzz.py                              2000 inputs for each target
    python benchmarks/fuzz.py --count 20000 --seed 1 --targets configuration,forces

Each input is a valid one that was changed at random: bytes, words, keys and values. What is refused must be refused
with a ValueError or an OSError whose message is short; nothing may take longer than a few seconds, or more than 1 GiB
beyond what Python and its libraries hold. Faults are printed, one of each kind, and kept with --keep.
"""

from __future__ import annotations

import argparse
import atexit
import contextlib
import io
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
CONFIGS = ROOT / "configs"
LONGEST = 5.0
"""[s] for one input; the slowest of the valid ones takes less than a tenth."""
ROOM = 2**30
"""[bytes] of memory for one input."""
LONGEST_MESSAGE, MOST_LINES = 20_000, 3
"""[letters]; the command line cuts its lines to some hundred."""
NASTY = (
    *(None, True, -1, 0, 1, 10**9, 2**63, 1e308, -0.0, float("nan"), float("inf"), "", " ", "x" * 5000, "../../etc"),
    *("${", "${a", "${oc.env:HOME}", "???", "1e400", "\u2028", "\x00", "null", "os.system", "torch.load", "<script>"),
    *([], {}, [[]], {"": None}, {"class_path": "os.system"}, {"class_path": 3}, {"init_args": 3}, [None] * 50, {1: 2}),
)
TOKENS = (b"[", b"{", b"&a ", b"*a", b"<<: ", b"!!python/object:os.system ", b"${", b"\n", b"\x00", b"\xff", b"9" * 400)


class Hang(BaseException):
    """An input that took too long."""


@dataclass(frozen=True)
class Target:
    """A reader.

    Attributes:
        name: What it is called.
        feed: Draws an input, writes it into an empty folder where that is needed, and reads it.
    """

    name: str
    feed: Callable[[random.Random, Path], object]


def change_bytes(content: bytes, draw: random.Random) -> bytes:
    """Flip, cut, repeat, and insert what parsers care about."""
    changed = bytearray(content)
    for _ in range(draw.choice((1, 1, 2, 5, 20))):
        at = draw.randrange(len(changed) + 1)
        match draw.randrange(6):
            case 0:
                changed[at : at + 1] = bytes([draw.randrange(256)])
            case 1:
                del changed[at : at + draw.randrange(1, 30)]
            case 2:
                changed[at:at] = draw.choice(TOKENS) * draw.choice((1, 1, 3, 2000))
            case 3:
                changed = changed[:at]
            case 4:
                start = draw.randrange(len(changed) + 1)
                changed[at:at] = changed[start : start + draw.randrange(1, 200)]
            case _:
                changed[at : at + 4] = draw.randbytes(4)
    return bytes(changed)


def change_values(value: Any, draw: random.Random) -> Any:
    """Replace, remove, rename or add something somewhere in nested mappings and lists."""
    if isinstance(value, dict) and value and draw.random() < 0.8:
        key = draw.choice(list(value))
        match draw.randrange(8):
            case 0:
                return {name: each for name, each in value.items() if name != key}
            case 1:
                return {(f"{name}x" if name == key else name): each for name, each in value.items()}
            case 2:
                return {**value, draw.choice(("x", "split", "", "class_path", 3)): draw.choice(NASTY)}
            case _:
                return {**value, key: change_values(value[key], draw)}
    if isinstance(value, list) and value and draw.random() < 0.7:
        at = draw.randrange(len(value))
        return [*value[:at], change_values(value[at], draw), *value[at + 1 :]]
    return draw.choice(NASTY)


def changed_yaml(text: str, draw: random.Random) -> bytes:
    """Change the values of a YAML text, or its bytes."""
    if draw.random() < 0.4:
        return change_bytes(text.encode(), draw)
    values = yaml.safe_load(text)
    for _ in range(draw.choice((1, 1, 2, 4))):
        values = change_values(values, draw)
    return yaml.safe_dump(values, sort_keys=False, allow_unicode=True).encode()


@cache
def texts(folder: str) -> list[str]:
    """Return the shipped configurations of a folder."""
    return [path.read_text() for path in sorted((CONFIGS / folder).glob("*.yaml"))]


def _config(folder: str, draw: random.Random, place: Path) -> Path:
    for name in ("base.yaml", "push.yaml"):
        if (CONFIGS / folder / name).is_file():
            shutil.copy(CONFIGS / folder / name, place / name)
    path = place / "changed.yaml"
    path.write_bytes(changed_yaml(draw.choice(texts(folder)), draw))
    return path


def feed_generate(draw: random.Random, place: Path) -> object:
    """Compose a configuration of `physid generate`."""
    from physid.configuration import compose
    from physid.data.generation.settings import GenerateConfig

    return GenerateConfig.from_mapping(compose([_config("generate", draw, place)], reads=GenerateConfig).values)


def feed_fit(draw: random.Random, place: Path) -> object:
    """Compose and check a configuration of `physid fit`."""
    from physid.configuration import compose
    from physid.schema.check import check_fit

    overrides = [f"{draw.choice(('model.values', 'trainer', 'data.x', 'a.b'))}={draw.choice(NASTY)}"]
    configuration = compose([_config("sysid", draw, place)], overrides[: draw.randrange(2)])
    check_fit(configuration)
    return configuration.to_yaml()


def feed_model(draw: random.Random, place: Path) -> object:
    """Read a nominal model from a configuration's content."""
    from physid.diagnosis.inputs.model_source import read_nominal_model
    from physid.scenes.catalogue import find_setup

    model = {
        "class_path": "physid.training.learners.sysid.SysID",
        "init_args": {
            "learn": ["block.friction"],
            "values": {"block.mass": 1.0},
            "engine": {"substeps": 2, "effects": {"viscous_drag": {"coefficient": 0.1}}},
        },
    }
    return read_nominal_model(find_setup("push").scene, {"model": change_values(model, draw)})


def feed_dashboard(draw: random.Random, place: Path) -> object:
    """Write the page about a damaged run."""
    from physid.dashboard.page import write_dashboard

    files = {
        "metrics.json": b'{"params/block.mass/estimate": 1.0, "params/block.mass/true": 1.1, "test/error": 0.1}',
        "metrics.csv": b"epoch,step,train/loss\n0,1,0.5\n1,2,0.25\n",
        "config.yaml": texts("sysid")[0].encode(),
        "record.json": b'{"started": "2026", "earlier": [], "packages": {"torch": "2"}}',
        "results.json": b'[{"cell": "a", "metric": "b", "value": 1, "unit": "", "paper": null, "target": 2}]',
        "diagnosis.json": b'{"verdict": "none", "effects": [], "group": [], "confidence": 0.9, "ranking": []}',
        "report.html": b"<!doctype html><p>x",
    }
    for name, content in files.items():
        if name == "metrics.json" or draw.random() < 0.6:
            (place / name).write_bytes(change_bytes(content, draw) if draw.random() < 0.7 else content)
    return write_dashboard(place, place / "page.html")


def feed_forces(draw: random.Random, place: Path) -> object:
    """Read planned forces."""
    import numpy as np

    from physid.data.forces import read_forces
    from physid.scenes.catalogue import find_setup

    array = io.BytesIO()
    np.save(array, np.zeros((5, 1, 6)))
    csv = b"block.force_x,block.torque_z\n1.0,2.0\n3.0,4.0\n"
    path = place / draw.choice(("forces.csv", "forces.npy", "forces.npy", "forces.txt"))
    path.write_bytes(change_bytes(csv if path.suffix == ".csv" else array.getvalue(), draw))
    return read_forces(path, find_setup("push").scene)


def feed_checkpoint(draw: random.Random, place: Path) -> object:
    """Read a checkpoint."""
    from physid.data.files import read_tensors

    (place / "last.ckpt").write_bytes(change_bytes(_checkpoint(), draw))
    return read_tensors(place / "last.ckpt", ("state_dict", "epoch"))


@cache
def _checkpoint() -> bytes:
    import torch

    buffer = io.BytesIO()
    torch.save({"state_dict": {"a": torch.arange(9.0)}, "epoch": 1, "callbacks": {"x": [1, None, "y"]}}, buffer)
    return buffer.getvalue()


def feed_history(draw: random.Random, place: Path) -> object:
    """Read the history of a run that is resumed."""
    from physid.training.runs.loggers import read_rows

    (place / "metrics.csv").write_bytes(change_bytes(b"epoch,step,loss\r\n0,1,0.5\r\n1,2,0.2\r\n", draw))
    return read_rows(place / "metrics.csv")


def feed_bank(draw: random.Random, place: Path) -> object:
    """Read the description of a bank."""
    from physid.benchmark.bank import FILE, read_bank

    text = "format: physid-bank\nversion: 1\npurpose: score\nseal: abc\nsets: {set_000: def, set_001: abc}\n"
    (place / FILE).write_bytes(changed_yaml(text, draw))
    return read_bank(place)


def feed_words(draw: random.Random, place: Path) -> object:
    """Give a command line to physid; commands that would work for long are asked for their configuration only."""
    from physid.cli import main
    from physid.commands import COMMANDS

    command = draw.choice(COMMANDS)
    words = [command.name, *(["--print-config"] if command.configurable else [])]
    for _ in range(draw.randrange(5)):
        option = draw.choice([*command.options, "config", "help", "x", "", "allow", *command.options])
        value = str(draw.choice((*NASTY, "configs", "3", "all", "none")))[:300]
        spelt = (f"--{option}={value}", f"--{option}", value, f"{option}={value}", f"model.{option}={value}")
        words.append(draw.choice(spelt).replace("\x00", ""))
    if command.name in ("reproduce", "benchmark") and not {"--help", "-h"} & set(words):
        words.append("--no-such-option-ends-it")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
        code = main(words)
    if code:
        raise ValueError(said.getvalue().strip())
    return code


LOG = "t,x,y,z,qx,qy,qz,qw,fx,fy,fz\n" + "".join(f"{k / 60},{0.01 * k},0,0.025,0,0,0,1,{k},0,-1\n" for k in range(8))
MAPPING: dict[str, Any] = {
    "time": "t",
    "position": ["x", "y", "z"],
    "quaternion": ["qx", "qy", "qz", "qw"],
    "force": ["fx", "fy", "fz"],
    "units": {"position": "m", "time": "s"},
    "size": [0.1, 0.1, 0.05],
    "mass": 0.4,
    "friction": 0.3,
}


def feed_log(draw: random.Random, place: Path) -> object:
    """Convert a log, guess its mapping, and read the set that came of it."""
    from physid.data.format import RecordingSet
    from physid.data.importers.convert import import_logs
    from physid.data.importers.guess import guess_mapping

    log = place / draw.choice(("log.csv", "log.csv", "log.npz"))
    log.write_bytes(change_bytes(LOG.encode() if log.suffix == ".csv" else _arrays(), draw))
    if draw.random() < 0.3:
        return guess_mapping(log)
    import_logs([log], MAPPING, place / "out")
    return RecordingSet(place / "out").read(0)


@cache
def _arrays() -> bytes:
    import numpy as np

    table = np.loadtxt(LOG.splitlines()[1:], delimiter=",")
    buffer = io.BytesIO()
    np.savez(buffer, **dict(zip(LOG.splitlines()[0].split(","), table.T, strict=True)))
    return buffer.getvalue()


def feed_mapping(draw: random.Random, place: Path) -> object:
    """Read a mapping file, and convert a sound log by it."""
    from physid.data.importers.convert import import_logs
    from physid.data.importers.mapping_files import read_mapping

    (place / "log.csv").write_text(LOG)
    (place / "map.yaml").write_bytes(changed_yaml(yaml.safe_dump(MAPPING, sort_keys=False), draw))
    words = [f"{draw.choice(list(MAPPING))}={draw.choice(NASTY)}"][: draw.randrange(2)]
    return import_logs([place / "log.csv"], read_mapping(place / "map.yaml", words), place / "out")


def feed_recordings(draw: random.Random, place: Path) -> object:
    """Read a recording set, its description or an HDF5 file changed."""
    from physid.data.format import RecordingSet

    shutil.copytree(_set(), place / "set")
    files = [path for path in sorted((place / "set").rglob("*")) if path.is_file()]
    path = draw.choice(files)
    content = path.read_bytes()
    path.write_bytes(changed_yaml(content.decode(), draw) if path.suffix == ".yaml" else change_bytes(content, draw))
    opened = RecordingSet(place / "set")
    return [opened.read(number) for number in range(len(opened))]


@cache
def _set() -> Path:
    from physid.data.importers.convert import import_logs

    folder = Path(tempfile.mkdtemp(prefix="physid_fuzz_"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    (folder / "log.csv").write_text(LOG)
    import_logs([folder / "log.csv"], MAPPING, folder / "set")
    return folder / "set"


def feed_classes(draw: random.Random, place: Path) -> object:
    """Check a configuration of `physid fit` with a logger and classes of its own."""
    from physid.configuration import compose
    from physid.schema.check import check_fit

    classes = ("os.system", "physid.cli.main", "lightning.pytorch.loggers.CSVLogger", "torch.load", "subprocess.Popen")
    named = {"class_path": draw.choice(classes), "init_args": draw.choice(({}, {"args": "true"}, 3, None, []))}
    values = yaml.safe_load((CONFIGS / "sysid" / "push_friction.yaml").read_text())
    place_of = draw.choice(("trainer.logger", "model", "data", "trainer.callbacks", "trainer.strategy", "optimizer"))
    room, _, key = place_of.partition(".")
    if key:
        values.setdefault(room, {})[key] = draw.choice((named, [named]))
    else:
        values[room] = named
    path = place / "changed.yaml"
    path.write_bytes(yaml.safe_dump(change_values(values, draw) if draw.random() < 0.5 else values).encode())
    for name in ("base.yaml", "push.yaml"):
        if (CONFIGS / "sysid" / name).is_file():
            shutil.copy(CONFIGS / "sysid" / name, place / name)
    configuration = compose([path])
    check_fit(configuration)
    return configuration


TARGETS = (
    Target("generation", feed_generate),
    Target("configuration", feed_fit),
    Target("model", feed_model),
    Target("dashboard", feed_dashboard),
    Target("forces", feed_forces),
    Target("checkpoint", feed_checkpoint),
    Target("history", feed_history),
    Target("bank", feed_bank),
    Target("words", feed_words),
    Target("log", feed_log),
    Target("mapping", feed_mapping),
    Target("recordings", feed_recordings),
    Target("classes", feed_classes),
)


def attempt(target: Target, draw: random.Random, place: Path) -> tuple[bool, str | None]:
    """Feed one input; tells whether it was accepted, and what is wrong, if anything is."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    before = os.getcwd()
    os.chdir(place)
    try:
        target.feed(draw, place)
    except (ValueError, OSError) as error:
        message = str(error)
        lines = message.count("\n") + 1
        if len(message) > LONGEST_MESSAGE or lines > MOST_LINES or not message:
            return False, f"{type(error).__name__} of {len(message)} letters in {lines} lines: {message[:100]!r}"
        return False, None
    except Hang:
        return False, f"took more than {LONGEST:g} s"
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if "physid" in frame.filename] or frames
        return False, f"{type(error).__name__}: {str(error)[:150]!r} at {Path(own[-1].filename).name}:{own[-1].lineno}"
    finally:
        os.chdir(before)
    return True, None


def import_all() -> None:
    """Import what the targets need, which takes longer and more memory than an input may."""
    import physid.dashboard.page
    import physid.diagnosis.diagnose
    import physid.simulators.bullet.world
    import physid.training.learners.sysid
    import physid.training.runs.run  # noqa: F401
    from physid.configuration import compose
    from physid.schema.check import check_fit

    check_fit(compose([CONFIGS / "sysid" / "push_friction.yaml"]))


def _stop(number: int, frame: FrameType | None) -> None:
    raise Hang


def main() -> None:
    """Print a row for each target: inputs, how many were accepted, how many went wrong, the slowest."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000, help="inputs for each target")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--targets", default="", help="only these, separated by commas")
    parser.add_argument("--keep", type=Path, help="where to keep the inputs that went wrong")
    chosen = parser.parse_args()
    wanted = [each for each in chosen.targets.split(",") if each]
    signal.signal(signal.SIGALRM, _stop)
    wrong = 0
    print(f"{'target':<14} {'inputs':>7} {'accepted':>8} {'wrong':>6} {'slowest':>8}")
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "input"
        import_all()
        for target in [each for each in TARGETS if not wanted or each.name in wanted]:
            for number in range(10):
                attempt(target, random.Random(number), place)
            held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (held + ROOM, resource.RLIM_INFINITY))
            accepted, slowest, found = 0, 0.0, dict[str, int]()
            for number in range(chosen.count):
                start = time.perf_counter()
                signal.setitimer(signal.ITIMER_REAL, LONGEST)
                taken, fault = attempt(target, random.Random(f"{chosen.seed} {target.name} {number}"), place)
                signal.setitimer(signal.ITIMER_REAL, 0)
                slowest, accepted = max(slowest, time.perf_counter() - start), accepted + taken
                kind = None if fault is None else fault.partition(" at ")[2] or fault[:20]
                if kind is not None and kind not in found:
                    found[kind] = number
                    wrong += 1
                    print(f"    {target.name} {number}: {fault}", flush=True)
                    if chosen.keep:
                        shutil.copytree(place, chosen.keep / f"{target.name}_{number}", dirs_exist_ok=True)
            resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
            print(f"{target.name:<14} {chosen.count:>7} {accepted:>8} {len(found):>6} {slowest:>7.2f}s", flush=True)
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
