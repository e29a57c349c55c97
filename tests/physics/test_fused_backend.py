from __future__ import annotations

import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from physid.compiler import machine
from physid.compiler.control import Code
from physid.compiler.emit import LANES
from physid.physics import Parameters, PhysicsLayer, State, World
from physid.physics.contact_problem.friction import Pyramid
from physid.physics.fused import backend

ROOT = Path(__file__).parents[2]
WITH_THE_OTHER_WIDTH = """
import sys
from unittest import mock
import llvmlite.binding as llvm
import pytest
features = dict(llvm.get_host_cpu_features())
features["avx512f"] = not features.get("avx512f", False)
with mock.patch.object(llvm, "get_host_cpu_features", lambda: features):
    from physid.compiler.emit import LANES
print(f"{LANES} at once")
sys.exit(pytest.main(sys.argv[1:]))
"""


def roll(layer: PhysicsLayer, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    pose = torch.tensor([[[0.0, 0, 0.1, 0, 0, 0, 1]]], dtype=dtype)
    one = torch.ones(1, 1, dtype=dtype)
    parameters = Parameters.of_boxes(0.2 * one[..., None].expand(1, 1, 3), one, 0.3 * one)
    return layer.rollout(State.at_rest(pose), torch.zeros(1, 2, 1, 6, dtype=dtype), parameters).pose


def test_a_backend_that_does_not_exist_is_named() -> None:
    with pytest.raises(ValueError, match="backend must be one of auto, reference, fused, got 'gpu'"):
        PhysicsLayer(World(), backend="gpu")  # type: ignore[arg-type]


def test_the_compiled_backend_says_why_it_cannot_run() -> None:
    with pytest.raises(ValueError, match="Pyramid, not a Cone"):
        roll(PhysicsLayer(World(friction=Pyramid()), backend="fused"))
    with pytest.raises(ValueError, match=r"torch.float32, not torch.float64"):
        roll(PhysicsLayer(World(), backend="fused"), torch.float32)


def test_auto_falls_back_with_one_line(caplog: pytest.LogCaptureFixture) -> None:
    backend._say_once.cache_clear()
    with caplog.at_level(logging.INFO):
        for _ in range(2):
            roll(PhysicsLayer(World(friction=Pyramid())))
    assert [record.getMessage() for record in caplog.records] == [
        "the reference implementation of the physics runs, which is slower: friction is a Pyramid, not a Cone"
    ]


def test_auto_falls_back_where_the_compiler_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    backend._missing_compiler.cache_clear()

    def missing(name: str) -> None:
        raise ImportError(f"no module named {name}")

    monkeypatch.setattr(backend, "import_module", missing)
    expected = roll(PhysicsLayer(World(), backend="reference"))
    assert torch.equal(roll(PhysicsLayer(World())), expected)
    backend._missing_compiler.cache_clear()


def test_machine_code_is_kept_and_a_place_that_cannot_be_written_does_no_harm(tmp_path, monkeypatch) -> None:  # noqa: ANN001
    code = "define void @idle(ptr %a, i64 %b, i64 %c, ptr %d) {\n  ret void\n}\n"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    machine.load("idle", lambda: code)(0, 0, 0, 0)
    (kept,) = (tmp_path / "physid").iterdir()
    assert kept.name.startswith("idle-")

    def fail() -> str:
        raise AssertionError("compiled again")

    machine.load("idle", fail)(0, 0, 0, 0)
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    machine.load("idle", lambda: code)(0, 0, 0, 0)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", "here")
    monkeypatch.setattr(os.path, "expanduser", str)  # of a user without a home
    machine.load("idle", lambda: code)(0, 0, 0, 0)
    assert {each.name for each in tmp_path.iterdir()} == {"physid", "file"}, "nothing is left where one happens to be"


@pytest.mark.slow
def test_as_many_worlds_at_once_as_another_processor_would_compute_give_the_same(tmp_path: Path) -> None:
    test = "tests/physics/test_fused.py::test_states_and_gradients_are_those_of_the_reference_in_every_scene"
    answer = subprocess.run(
        [sys.executable, "-c", WITH_THE_OTHER_WIDTH, "-p", "no:cacheprovider", f"{test}[push-rich]"],
        cwd=ROOT, env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert answer.returncode == 0, answer.stdout
    assert f"{LANES} at once" not in answer.stdout
    assert "1 passed" in answer.stdout


DAMAGE = {
    "empty": lambda kept: b"",
    "short": lambda kept: kept[: len(kept) // 2],
    "only a digest": lambda kept: kept[:32],
    "without a digest": lambda kept: kept[32:],
    "a flipped bit": lambda kept: kept[:-100] + bytes([kept[-100] ^ 1]) + kept[-99:],
    "zeros": lambda kept: bytes(len(kept)),
    "something else": lambda kept: b"not machine code" * 1000,
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_damaged_machine_code_is_compiled_again_and_never_executed(
    damage: Callable[[bytes], bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compiled = []
    text = Code("answer", ()).text()
    monkeypatch.setattr(machine, "_compile", lambda code, whole=machine._compile: compiled.append(1) or whole(code))
    machine.load("answer", lambda: text)
    (place,) = (tmp_path / "physid").iterdir()
    whole = place.read_bytes()
    machine.load("answer", lambda: text)
    assert len(compiled) == 1
    place.write_bytes(damage(whole))
    machine.load("answer", lambda: text)
    assert len(compiled) == 2
    assert place.read_bytes() == whole


def test_machine_code_depends_on_the_sources_that_it_is_made_from_and_on_no_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    read: list[Path] = []
    monkeypatch.setattr(Path, "read_bytes", lambda path: read.append(path) or b"")
    machine._fingerprint.cache_clear()
    try:
        machine._fingerprint()
    finally:
        machine._fingerprint.cache_clear()
    package = Path(machine.__file__).parents[1]
    assert {path.relative_to(package).parts[0] for path in read} == {"compiler", "physics"}
    assert package / "physics" / "fused" / "kernel.py" in read
