"""Every command and every block of Python in README and docs runs, from top to bottom, with a tiny budget."""

from __future__ import annotations

import ast
import dataclasses
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from PIL import Image
from tests.conftest import write_tosses
from tests.dashboard.folders import write_fit

from physid import __version__
from physid.cli import main
from physid.configuration import compose

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
# What keeps a command short; it stands behind what the page says, so it wins. A new command needs a line here.
TINY = {
    "generate": ["trajectories=10", "steps=16", "video=false", "--workers=1", "--quiet"],
    "calibrate": [],
    "import": [],
    "check": [],
    "show": [],
    "track": ["--quiet"],
    "fit": ["trainer.max_epochs=1", "data.limit=2", "trainer.accelerator=cpu"],
    "validate": [],
    "test": [],
    "predict": [],
    "sample": [],
    "identifiability": ["trajectories=2", "steps=20"],
    "diagnose": ["--quiet"],
    "benchmark": ["--sets=2", "--trajectories=6", "--steps=60", "--workers=1", "--quiet"],
    "effects": [],
    "reproduce": ["--profile=quick", "--cell=sysid/push_friction", "--workers=1"],
    "dashboard": [],
    "completion": [],
    "configs": [],
}
# Programs that a page may name without a test running them here; others test some of them.
OTHERS = [
    "apt-get",
    "cd",
    "dask",
    "docker",
    "docker/check.sh",
    "docker/reproduce.sh",
    "docker/wheels.sh",
    "export",
    "git",
]
OTHERS += ["pip", "sbatch", "sleep", "srun", "torchrun", "wandb"]
TUTORIALS = ("tutorial_csv.md", "tutorial_mp4.md")  # tests/test_tutorials.py runs them as they stand
RUN = [page for page in PAGES if page.parent.name != "decisions" and page.name not in TUTORIALS]
# Commands of decision records are those of the code of their day: they are history, and are not run.
LONG = ("--quick",)  # left out, since it would win over what keeps a command short
# Several processes: tests/test_workers.py and tests/test_processes.py run these.
SPREAD = ("--backend", "--scheduler", "trainer.strategy=")
# tests/training/test_paper_method.py, tests/data/test_import_bags.py and test_import_episodes.py run these.
ELSEWHERE = ("configs/paper_method/", "run.mcap", "lerobot")
ONLINE = ("--wandb",)  # tests/dashboard/test_workspace.py builds what this publishes


@dataclass(frozen=True)
class Block:
    """A block of a page.

    Attributes:
        line: Where it begins, from 1.
        kind: python, shell or text.
        code: What it holds.
    """

    line: int
    kind: str
    code: str


def blocks(page: Path) -> Iterator[Block]:
    """Yield the fenced and indented blocks of a page from top to bottom."""
    lines, index = page.read_text().splitlines(), 0
    while index < len(lines):
        start = index
        fence = re.match(r"^```(\w*)$", lines[index])
        after_gap = start == 0 or not lines[start - 1].strip()
        if fence:
            index = next(row for row in range(start + 1, len(lines)) if lines[row] == "```") + 1
            code, kind = "\n".join(lines[start + 1 : index - 1]), fence.group(1)
            yield Block(start + 1, kind if kind == "python" else kind_of(code), code)
        elif lines[index].startswith("    ") and after_gap and not in_list(lines, start):
            while index < len(lines) and (lines[index].startswith("    ") or not lines[index].strip()):
                index += 1
            code = "\n".join(line[4:] for line in lines[start:index]).strip("\n")
            yield Block(start + 1, kind_of(code), code)
        else:
            index += 1


def in_list(lines: list[str], index: int) -> bool:
    """Return whether an indented line goes on with an item of a list."""
    before = next((line for line in reversed(lines[:index]) if line.strip() and not line.startswith(" ")), "")
    return bool(re.match(r"^([*+-]|\d+\.) ", before))


def kind_of(code: str) -> str:
    """Tell Python from shell from anything else."""
    first = [words[0] for line in code.splitlines() if (words := shell_words(line))]
    if first and all(program(word) in {"physid", "make", "python", *OTHERS} or "=" in word for word in first):
        return "shell"
    try:
        tree = ast.parse(code)
    except SyntaxError:
        return "text"
    return "python" if any(isinstance(node, ast.Import | ast.ImportFrom) for node in ast.walk(tree)) else "text"


def shell_words(line: str) -> list[str]:
    """Return the words of a command without its comment."""
    try:
        return shlex.split(line, comments=True)
    except ValueError:
        return []


def program(word: str) -> str:
    """Return the program that a first word means."""
    return word.removeprefix(".venv/bin/")


def commands(code: str) -> Iterator[list[str]]:
    """Yield the commands of a shell block; a backslash joins lines, a variable before a program is left out."""
    for line in code.replace("\\\n", " ").splitlines():
        words = shell_words(line)
        while words and re.fullmatch(r"[A-Z_]+=\S*", words[0]):
            words = words[1:]
        if words:
            yield [program(words[0]), *words[1:]]


def given(page: str, recordings: Callable[[str], Path]) -> dict[str, Any]:
    """Return the names that the text of a page gives its Python."""
    if page == "docs/physics.md":
        pose = torch.tensor([[[0.0, 0, 0.1, 0, 0, 0, 1]]], dtype=torch.float64, requires_grad=True)
        sizes = torch.full((1, 1, 3), 0.2, dtype=torch.float64)
        one = torch.ones(1, 1, dtype=torch.float64)
        wrenches = torch.zeros(1, 5, 1, 6, dtype=torch.float64)
        return {"pose": pose, "wrenches": wrenches, "size": sizes, "mass": one, "friction": 0.2 * one}
    if page == "docs/networks.md":
        from physid.scenes import find_setup

        scene = find_setup("push").scene
        assert scene.camera is not None
        shape = (2, scene.camera.height, scene.camera.width, 3)
        frames = torch.randint(0, 255, shape, dtype=torch.uint8, generator=torch.Generator().manual_seed(0))
        size = torch.tensor([body.size for body in scene.bodies])
        mask = torch.zeros(2, 1, *shape[1:3], dtype=torch.bool)
        mask[:, :, 60:70, 60:70] = True
        pose = torch.tensor([0.0, 0, 0.1, 0, 0, 0, 1]).expand(2, 1, 7)
        names = {"dataclasses": dataclasses, "torch": torch, "scene": scene, "frames": frames, "background": frames[:1]}
        return {**names, "first": frames, "masks": mask, "first_pose": pose, "size": size}
    return {}


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return an empty folder, from which Python can import, and restore the default type."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    torch.set_default_dtype(torch.float32)


def run(words: list[str], recordings: Callable[[str], Path]) -> int:
    """Run a command of physid as a page shows it, with a tiny budget; returns its status, 0 where it is left out."""
    if any(word.startswith(SPREAD + ONLINE + ELSEWHERE) for word in words):
        return 0
    words = [word for word in words if word not in LONG]
    assert words[0] in TINY, f"`physid {words[0]}` is new: say in TINY what keeps it short"
    if "FOLDER" in words:
        words = [str(write_tosses(Path("tosses").absolute())) if word == "FOLDER" else word for word in words]
    if words[0] == "import" and "logs" in {Path(word).parts[0] for word in words} and not Path("logs").exists():
        subprocess.run([sys.executable, str(ROOT / "examples" / "write_logs.py"), "logs"], check=True)
    files = [words[index + 1] for index, word in enumerate(words) if word == "--config"]
    if words[0] == "fit" and files:
        wanted = Path(compose(files).values["data"]["init_args"]["folder"])
        if not wanted.exists():
            shutil.copytree(recordings(wanted.name), wanted)
    asked = words[0] in ("diagnose", "fit", "identifiability") and not words[1].startswith("-")
    if asked and not Path(words[1]).exists():
        shutil.copytree(recordings("push_rich"), words[1])
    if words[0] == "dashboard" and not Path(words[1]).exists():
        write_fit(Path(words[1]) / "push_friction", estimate=0.1201, seconds=3.0)
    filmed = [] if "video=true" not in words else ["video=false"]  # a page that says so wants its films
    tiny = [word for word in TINY[words[0]] if word not in filmed]
    if words[0] == "identifiability" and asked:  # recordings take no keys: these are of a planned experiment
        tiny = []
    return main([*words, *tiny])


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [page for page in RUN if any(block.kind != "text" for block in blocks(page))],
    ids=lambda page: page.relative_to(ROOT).as_posix(),
)
def test_what_a_page_shows_runs_from_top_to_bottom(page: Path, place: Path, recordings: Callable[[str], Path]) -> None:
    name = page.relative_to(ROOT).as_posix()
    names = given(name, recordings)
    for block in blocks(page):
        written = re.match(r"# (\w+\.(?:yaml|py))\b", block.code)
        if written:  # a file that the page writes
            Path(written.group(1)).write_text(block.code)
        if block.kind == "python":
            module = type(sys)("page")
            names.setdefault("__name__", "page")
            sys.modules["page"] = module  # dataclasses look their module up
            exec(compile(block.code, f"{name}:{block.line}", "exec"), names)
        elif block.kind == "shell" and not written:
            for words in commands(block.code):
                if words[0] == "physid" and words[1] != "COMMAND":
                    assert run(words[1:], recordings) == 0, f"{name}: {shlex.join(words)}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_other_programs_that_a_page_names_are_known_and_their_files_exist(page: Path) -> None:
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for block in blocks(page):
        if block.kind == "text":
            assert not re.search(r"^(\.venv/bin/)?physid ", block.code, re.MULTILINE), (
                f"{page.name}:{block.line} is not run"
            )
        for words in commands(block.code) if block.kind == "shell" else ():
            if words[0] == "make":
                assert {word for word in words[1:] if "=" not in word} <= set(targets), words
            elif words[0] == "python" and words[1].endswith(".py"):
                assert (ROOT / words[1]).is_file(), words
            else:
                assert words[0] in {"physid", "python", *OTHERS}, words


def test_what_is_cited_is_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == __version__
    assert citation["references"][0]["doi"].startswith("10.")


@pytest.mark.slow
def test_the_picture_of_the_readme_can_be_drawn(tmp_path: Path) -> None:
    script = ROOT / "docs" / "pictures" / "overview.py"
    words = [sys.executable, str(script), f"--out={tmp_path / 'drawn.png'}", "--trajectories=10"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with Image.open(tmp_path / "drawn.png") as drawn, Image.open(script.with_suffix(".png")) as shown:
        assert drawn.size == shown.size
