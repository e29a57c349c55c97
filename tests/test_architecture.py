"""The rules of docs/architecture.md, read off the source."""

from __future__ import annotations

import ast
import re
import runpy
import sys
from functools import cache
from pathlib import Path

import pytest

SOURCE = Path(__file__).parent.parent / "src" / "physid"
MOST_LINES = 300
MOST_LINES_OF_A_FUNCTION = 80

RANKS = {
    "class_paths": 1,
    "one_writer": 1,
    "progress": 1,
    "strict": 0,
    "typed_files": 1,
    "setting": 1,
    "yaml_files": 0,
    "compiler": 0,
    "pages": 1,
    "physics": 1,
    "effects": 2,
    "scenes": 2,
    "networks": 2,
    "simulators": 3,
    "data": 4,
    "estimation": 5,
    "inspection": 6,
    "training": 7,
    "diagnosis": 7,
    "benchmark": 8,
    "dashboard": 8,
    "reproduce": 8,
    "commands": 8,
    "schema": 8,
}
ROOMS = {
    "estimation": ("measurement", "prediction", "least_squares", "segmented_fit"),
    "training": (
        "parameters",
        "initial_states",
        "training_module.py",
        "vision",
        "refinement",
        "callbacks",
        "learners",
        "runs",
        "identifiability",
        "tracking",
    ),
    "diagnosis": (
        "settings",
        "document",
        "progress.py",
        "inputs",
        "reference",
        "testing",
        "residual_law",
        "selection",
        "posterior",
        "conclusion",
        "analysis.py",
        "report",
        "fitted_model.py",
        "results.py",
        "diagnose.py",
    ),
}
MOST_MODULES = 12
"""In a folder."""
MOST_IMPORTS = 8
"""Modules of physid that a module imports. `LISTS` are those of which each import is an entry."""
LISTS = {
    "commands/__init__.py",
    "diagnosis/settings/settings.py",
    "effects/contact/__init__.py",
    "effects/perception/__init__.py",
    "effects/dynamics/__init__.py",
    "diagnosis/testing/__init__.py",
    "estimation/least_squares/__init__.py",
    "physics/fused/sections.py",
    "training/parameters/__init__.py",
    "training/vision/__init__.py",
}
TOP = 8  # modules beside the packages: the command line and what it needs
HOMES = {
    "pybullet": ("simulators/bullet/",),
    "mujoco": ("simulators/mujoco/",),
    "cv2": ("data/importers/video/",),
    "rosbags": ("data/importers/tables/bags.py",),
    "pyarrow": ("data/importers/tables/episodes.py",),
    "h5py": ("data/",),
    "lightning": ("data/batches/datamodule.py", "training/"),
    "wandb": ("training/",),
    "jsonargparse": ("cli.py", "training/runs/"),
    "omegaconf": ("configuration.py",),
    "llvmlite": ("compiler/", "physics/"),
}
TRUTH = "physid.data.truth"
TRUTH_READERS = ("data/generation/generate.py", "training/callbacks/", "benchmark/scoring/")
FORBIDDEN_NAMES = {"utils", "util", "helpers", "helper", "common", "manager", "misc"}

FILES = sorted(SOURCE.rglob("*.py"))
NAMES = [path.relative_to(SOURCE).as_posix() for path in FILES]


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """Return all nodes of a file's syntax tree."""
    return tuple(ast.walk(ast.parse(path.read_text())))


@cache
def imports(path: Path) -> set[str]:
    """Return every module that a file imports, wherever in the file."""
    found: set[str] = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def rank(name: str) -> int:
    """Return the rank of a file by its path below physid."""
    return RANKS.get(name.split("/")[0].removesuffix(".py"), TOP)


def imported_files(path: Path) -> set[str]:
    """Return the packages and modules of physid that a file imports, as paths below physid."""
    return {each.removeprefix("physid.").replace(".", "/") for each in imports(path) if each.startswith("physid.")}


def test_every_package_has_a_rank() -> None:
    packages = {path.name for path in SOURCE.iterdir() if path.is_dir() and list(path.glob("*.py"))}
    assert packages <= RANKS.keys()


def test_a_module_imports_its_own_package_or_lower_ranks_only() -> None:
    for name, other in [(one, other) for one in NAMES for other in imported_files(SOURCE / one)]:
        own, package = name.split("/")[0].removesuffix(".py"), other.split("/")[0]
        known = package in RANKS or (SOURCE / f"{package}.py").exists()
        allowed = package == own or rank(other) < rank(name) or (rank(name) == TOP and rank(other) == TOP)
        assert allowed or not known, f"{name} (rank {rank(name)}) imports {other} (rank {rank(other)})"


@pytest.mark.parametrize("package", ROOMS)
def test_rooms_of_a_package_import_earlier_rooms_only(package: str) -> None:
    order = ROOMS[package]
    for name in [name for name in NAMES if name.startswith(f"{package}/") and name != f"{package}/__init__.py"]:
        own = order.index(name.split("/")[1])
        for other in imported_files(SOURCE / name):
            parts = other.split("/")
            if parts[0] == package and len(parts) > 1 and parts[1] in order:
                assert order.index(parts[1]) <= own, f"{name} imports {other}"


def test_no_folder_holds_too_many_modules() -> None:
    for folder in {path.parent for path in FILES}:
        modules = [path for path in folder.glob("*.py") if path.name not in ("__init__.py", "__main__.py")]
        assert len(modules) <= MOST_MODULES, f"{folder.name} holds {len(modules)} modules"


def imported_modules(path: Path) -> set[str]:
    """Return the modules of physid that a file imports, a name imported from a module counting as that module."""
    found: set[str] = set()
    for node in nodes(path):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "physid":
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            files = {name: SOURCE.parent.joinpath(*name.split(".")) for name in names}
            found |= {
                name if place.with_suffix(".py").exists() or (place / "__init__.py").exists() else node.module
                for name, place in files.items()
            }
    return found


def test_a_module_imports_few_others() -> None:
    counts = {name: len(imported_modules(SOURCE / name)) for name in NAMES if name not in LISTS}
    assert not {name: count for name, count in counts.items() if count > MOST_IMPORTS}


def test_the_picture_of_the_architecture_is_that_of_the_present_source() -> None:
    pictures = SOURCE.parent.parent / "docs" / "pictures"
    picture = (pictures / "architecture.svg").read_text()
    assert runpy.run_path(str(pictures / "architecture.py"))["draw"]() == picture, "make architecture"
    for package in {path.name for path in SOURCE.iterdir() if (path / "__init__.py").exists()} - {"commands", "schema"}:
        assert f">{package}<" in picture


def test_the_compiler_knows_no_physics() -> None:
    for name in [name for name in NAMES if name.startswith("compiler/")]:
        assert not [other for other in imported_files(SOURCE / name) if not other.startswith("compiler")], name


def test_third_parties_stay_at_home() -> None:
    for name, module in [(one, module) for one in NAMES for module in imports(SOURCE / one)]:
        homes = HOMES.get(module.split(".")[0])
        assert homes is None or name.startswith(homes), f"{name} imports {module}, whose home is {', '.join(homes)}"


def test_simulators_are_reached_by_their_protocol_only() -> None:
    """Who simulates is a name in a configuration; no other package knows the packages behind the protocol."""
    behind = tuple(f"physid.simulators.{name}" for name in ("bullet", "mujoco", "closed_form"))
    for path in FILES:
        if not path.is_relative_to(SOURCE / "simulators"):
            named = [module for module in imports(path) if module.startswith(behind)]
            assert not named, f"{path.relative_to(SOURCE)} imports {', '.join(named)}; ask physid.simulators.protocol"


def test_the_physics_needs_torch_and_its_compiler_only() -> None:
    allowed = {"physid", "torch", "numpy", "llvmlite", *sys.stdlib_module_names}
    for path in FILES:
        if path.is_relative_to(SOURCE / "physics") or path.is_relative_to(SOURCE / "compiler"):
            strangers = {module.split(".")[0] for module in imports(path)} - allowed
            assert not strangers, f"{path.name} imports {', '.join(strangers)}"


def test_the_truth_is_read_by_generation_by_scoring_and_by_callbacks_only() -> None:
    for name in {*NAMES} - {"data/truth.py", *(name for name in NAMES if name.startswith(TRUTH_READERS))}:
        reading = [module for module in imports(SOURCE / name) if module.startswith(TRUTH)]
        assert not reading, f"{name} imports {reading[0]}"
        behind_its_back = rank(name) >= RANKS["training"] and "truth.yaml" in (SOURCE / name).read_text()
        assert not behind_its_back, f"{name} names the truth file"


def reached(name: str) -> set[str]:
    """Return every file of the project that a file imports, directly or through others, itself included."""
    found, open_ends = {name}, [name]
    while open_ends:
        more = neighbours(open_ends.pop()) - found
        found |= more
        open_ends += more
    return found


@cache
def neighbours(name: str) -> frozenset[str]:
    """Return every file of the project that a file imports itself."""
    paths = [path for each in imported_files(SOURCE / name) for path in (f"{each}.py", f"{each}/__init__.py")]
    return frozenset(path for path in paths if (SOURCE / path).is_file())


def test_a_diagnosis_reaches_neither_the_benchmark_nor_the_reader_of_the_truth() -> None:
    for name in [name for name in NAMES if name.startswith("diagnosis/")]:
        assert not [other for other in reached(name) if other.startswith("benchmark/")], name
        assert "data/truth.py" not in reached(name), name


def test_what_diagnoses_a_bank_does_not_reach_its_labels() -> None:
    assert "benchmark/labels.py" in reached("benchmark/scoring/scoring.py")
    assert not {"benchmark/labels.py", "benchmark/sealing/seal.py", "data/truth.py"} & reached("benchmark/verdicts.py")


def test_files_and_functions_are_short() -> None:
    for name in NAMES:
        assert (SOURCE / name).read_text().count("\n") <= MOST_LINES, name
        for node in nodes(SOURCE / name):
            if isinstance(node, ast.FunctionDef):
                assert node.end_lineno is not None
                lines = node.end_lineno - node.lineno + 1
                assert lines <= MOST_LINES_OF_A_FUNCTION, f"{name}: {node.name} has {lines} lines"


def test_a_name_says_what_a_module_is_about() -> None:
    for name in NAMES:
        assert not FORBIDDEN_NAMES & set(name.removesuffix(".py").split("/")), name


def test_every_effect_has_its_own_file_and_stands_in_the_catalogue() -> None:
    from physid.effects import CATALOGUE

    written: dict[str, str] = {}
    for path in (SOURCE / "effects").rglob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and any(ast.unparse(base) == "Effect" for base in node.bases):
                assert path.stem not in written.values(), f"{path.name} holds two effects"
                written[node.name] = path.stem
    listed = {effect.__name__: effect.name for effect in CATALOGUE}
    assert all(effect.__module__.split(".")[-2] == effect.site for effect in CATALOGUE)
    assert listed == written
    assert len(CATALOGUE) == len(listed)


TASKS = {"VideoID"}
"""Abstract tasks, whose children are nothing but their losses."""


def test_inheritance_within_the_project_is_of_depth_one_below_a_task() -> None:
    bases: dict[str, list[str]] = {}
    for path in FILES:
        for node in nodes(path):
            if isinstance(node, ast.ClassDef):
                bases[node.name] = [ast.unparse(base).split("[")[0].split(".")[-1] for base in node.bases]
    for name, parents in bases.items():
        grand = [
            base for parent in parents if parent in bases.keys() - TASKS for base in bases[parent] if base in bases
        ]
        assert not grand, f"{name} inherits from {parents[0]}, which inherits from {grand[0]}"


def test_json_of_others_is_read_in_one_way() -> None:
    """Python's own reader recurses into what is nested, and says neither which file nor what was expected."""
    readers = {"data/files.py", "typed_files.py", "dashboard/run.py", "data/importers/guessing/lines.py"}
    found = {name for name in NAMES if re.search(r"json\.loads?\((?!json\.dumps)", (SOURCE / name).read_text())}
    assert found <= readers, f"{found - readers}: read_json or read_json_as reads a file"
