"""What benchmarks/fuzz.py feeds: a target for each reader, and how a valid input is changed at random."""

from __future__ import annotations

import atexit
import contextlib
import io
import json
import random
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[2]
CONFIGS = ROOT / "configs"
NASTY = (
    *(None, True, -1, 0, 1, 10**9, 2**63, 1e308, -0.0, float("nan"), float("inf"), "", " ", "x" * 5000, "../../etc"),
    *("${", "${a", "${oc.env:HOME}", "???", "1e400", "\u2028", "\x00", "null", "os.system", "torch.load", "<script>"),
    *([], {}, [[]], {"": None}, {"class_path": "os.system"}, {"class_path": 3}, {"init_args": 3}, [None] * 50, {1: 2}),
)
TOKENS = (b"[", b"{", b"&a ", b"*a", b"<<: ", b"!!python/object:os.system ", b"${", b"\n", b"\x00", b"\xff", b"9" * 400)


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
    from physid.scenes import find_setup

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
    from physid.scenes import find_setup

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
    from physid.data import RecordingSet
    from physid.data.importers.convert import import_logs
    from physid.data.importers.guessing import guess_mapping

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
    from physid.data import RecordingSet

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


PINHOLE = "width: 64\nheight: 48\nposition: [0.1, -0.6, 0.7]\ntarget: [0, 0, 0]\nup: [0, 0, 1]\nfov_y: 40.0\n"
OPENCV = (
    "%YAML:1.0\n---\nimage_width: 64\nimage_height: 48\n"
    "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
    "   data: [60, 0, 31.5, 0, 60, 23.5, 0, 0, 1]\ndistortion_coefficients: [0.1, 0, 0, 0, 0]\n"
    "rvec: [2.3, 0.1, -0.05]\ntvec: [0.0, 0.1, 0.9]\n"
)
ROS = (
    "image_width: 64\nimage_height: 48\ncamera_name: narrow\ndistortion_model: plumb_bob\n"
    "camera_matrix: {rows: 3, cols: 3, data: [60, 0, 31.5, 0, 60, 23.5, 0, 0, 1]}\n"
    "points: [[31, 23, 0, 0], [40, 23, 0.1, 0], [31, 30, 0, -0.1], [40, 31, 0.1, -0.1]]\n"
)


def feed_camera(draw: random.Random, place: Path) -> object:
    """Read a camera file: physid's own, OpenCV's or ROS's."""
    from physid.data.importers.video.cameras import read_camera

    text = draw.choice((PINHOLE, OPENCV, ROS))
    plain = text.partition("---\n")[2] or text
    changed = change_bytes(text.encode(), draw) if draw.random() < 0.5 else changed_yaml(_untagged(plain), draw)
    (place / "camera.yaml").write_bytes(changed)
    lens = read_camera(place / "camera.yaml")
    return lens.pinhole()


def _untagged(text: str) -> str:
    return text.replace("!!opencv-matrix", "")


def changed_json(content: object, draw: random.Random) -> bytes:
    """Change the values of a JSON text, or its bytes."""
    if draw.random() < 0.4:
        return change_bytes(json.dumps(content, indent=1).encode(), draw)
    for _ in range(draw.choice((1, 1, 2, 4))):
        content = change_values(content, draw)
    return json.dumps(content, default=str).encode()


def feed_diagnosis(draw: random.Random, place: Path) -> object:
    """Read diagnosis.json."""
    from physid.diagnosis.document.document import read_diagnosis

    (place / "diagnosis.json").write_bytes(changed_json(_diagnosis(), draw))
    return read_diagnosis(place / "diagnosis.json")


@cache
def _diagnosis() -> dict[str, Any]:
    sys.path.insert(0, str(ROOT / "tests"))
    from diagnosis.documents import NAMED

    return dict(NAMED)


def feed_record(draw: random.Random, place: Path) -> object:
    """Read record.json of a run."""
    from physid.record import RECORD, Record
    from physid.typed_files import read_json_as

    (place / RECORD).write_bytes(changed_json(_record(), draw))
    return read_json_as(Record, place / RECORD)


@cache
def _record() -> dict[str, Any]:
    from physid.record import describe

    return dict(describe({}).to_mapping())


EFFECT = """\
from dataclasses import dataclass
from typing import ClassVar, final
from torch import Tensor
from physid.physics import Effect, Site, StepInputs, quantity
from physid.physics import State

@final
@dataclass(frozen=True)
class Brake(Effect):
    \'\'\'F = -c v, a brake.

    Attributes:
        coefficient: c [N s/m].
    \'\'\'

    name: ClassVar[str] = "brake"
    site: ClassVar[Site] = "dynamics"
    coefficient: Tensor = quantity("N s/m", low=0.0, high=20.0, typical=1.0)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        \'\'\'Add the braking force.\'\'\'
        return inputs.add_force(-self.coefficient[:, None, None] * state.velocity)
"""
WRONG = (
    ("return inputs", "return 3 or inputs"), ("ClassVar[str]", "str"), ('"dynamics"', '"engine"'), ("@final", "1 / 0"),
    ("typical=1.0", "typical=99.0"), ("low=0.0", "low=5.0"), ("N s/m", ""), ("F = -c v, a brake.", "A brake."),
    ("Brake(Effect)", "Brake"), ('"brake"', '"viscous_drag"'), ("quantity(", "float("), ("frozen=True", ""),
    ("self.coefficient[:, None, None]", "self.coefficient"), ("state.velocity", "state.speed"), ('"brake"', "7"),
    ("class Brake", "class Break"), ("-self", "float('nan') * self"), ("def act", "def actuate"),
)  # fmt: skip


def feed_effect(draw: random.Random, place: Path) -> object:
    """Load an effect from a file; the file is code, so only its words are changed, from a list, or it is cut."""
    from physid.effects.loading import own_effects

    text = EFFECT
    for old, new in draw.sample(WRONG, draw.choice((0, 1, 1, 1, 2, 3))):
        text = text.replace(old, new)
    if draw.random() < 0.2:
        text = text[: draw.randrange(len(text))]
    (place / "own.py").write_text(text)
    named = draw.choice(
        ("own.py:Brake", "own.py:Brake", "own.py:Brake", "own.py", ":Brake", "own.py:Effect", "x.py:Brake")
    )
    return own_effects([named])


def feed_scene(draw: random.Random, place: Path) -> object:
    """Read a scene of one's own."""
    from physid.scenes import find_setup

    body = "{name: brick, size: [0.24, 0.115, 0.071], mass: 1.9, friction: 0.45}"
    text = f"scene: brick\nlike: push\ntime_step: 0.01\ngravity: [0, 0, -9.81]\nbodies: [{body}]\n"
    (place / "brick.yaml").write_bytes(changed_yaml(text, draw))
    return find_setup(str(place / "brick.yaml"))


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
    Target("camera", feed_camera),
    Target("diagnosis", feed_diagnosis),
    Target("record", feed_record),
    Target("effect", feed_effect),
    Target("scene", feed_scene),
)
