"""Configurations are there wherever physid is: by name, by their path in the repository, as copies, in the wheel."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from physid.cli import main
from physid.configuration import ConfigurationError, compose
from physid.shipped import names, summary

ROOT = Path(__file__).parent.parent


def test_every_configuration_of_the_repository_is_shipped_and_says_what_it_is_for() -> None:
    files = sorted((ROOT / "configs").rglob("*.yaml"))
    assert [f"{ROOT / 'configs' / name}.yaml" for name in names()] == list(map(str, files))
    assert all(len(summary(name)) > 20 for name in names())


@pytest.mark.parametrize("spelling", ["sysid/push_mass", "sysid/push_mass.yaml", "configs/sysid/push_mass.yaml"])
def test_a_name_and_the_path_in_the_repository_mean_the_same_in_any_folder(
    spelling: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    found, wanted = compose([spelling]), compose([ROOT / "configs" / "sysid" / "push_mass.yaml"])
    assert (found.name, found.values) == (wanted.name, wanted.values)


def test_a_file_that_is_there_wins_over_the_shipped_one_and_may_build_on_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sysid").mkdir()
    (tmp_path / "sysid" / "push_mass.yaml").write_text("base: sysid/base\ntrainer: {max_epochs: 3}\n")
    values = compose(["sysid/push_mass"]).values
    assert values["trainer"]["max_epochs"] == 3
    assert values["model"]["class_path"].endswith("SysID")


def test_a_copy_brings_what_it_builds_on_and_leaves_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["configs", "sysid/collide_mass", "--out", "mine"]) == 0
    copied = sorted(path.relative_to(tmp_path / "mine").as_posix() for path in (tmp_path / "mine").rglob("*.yaml"))
    assert copied == ["sysid/base.yaml", "sysid/collide_both.yaml", "sysid/collide_mass.yaml"]
    (tmp_path / "mine" / "sysid" / "collide_mass.yaml").write_text("base: collide_both.yaml\nname: changed\n")
    assert main(["configs", "sysid", "--out", "mine"]) == 0
    assert "collide_mass.yaml is there already, and is left" in capsys.readouterr().out
    assert compose(["mine/sysid/collide_mass.yaml"]).name == "changed"


def test_all_are_listed_and_one_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["configs"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in names())
    assert main(["configs", "sysid/push_mass"]) == 0
    assert capsys.readouterr().out == (ROOT / "configs" / "sysid" / "push_mass.yaml").read_text()


def test_a_mistyped_name_brings_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ConfigurationError, match='did you mean "sysid/push_mass"'):
        compose(["sysid/push_mas"])
    assert main(["configs", "sysid/push_mas"]) == 2
    assert 'did you mean "sysid/push_mass"?' in capsys.readouterr().err


def test_a_wheel_holds_every_configuration(tmp_path: Path) -> None:
    pytest.importorskip("setuptools")
    code = f"import setuptools.build_meta as build; print(build.build_wheel({str(tmp_path)!r}))"
    copy = tmp_path / "source"
    copy.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    for name in ("configs", "src"):
        shutil.copytree(ROOT / name, copy / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    subprocess.run([sys.executable, "-c", code], cwd=copy, check=True, capture_output=True)
    held = zipfile.ZipFile(next(tmp_path.glob("*.whl"))).namelist()
    assert {f"physid/configs/{name}.yaml" for name in names()} <= set(held)
