"""The configuration of a nominal model: what is not understood is refused, not passed over."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml

from physid.cli import main
from physid.commands.configured import read_model
from physid.data.files import write_tensors
from physid.diagnosis.inputs.model_source import CHECKPOINT, CONFIG, COORDINATES, read_nominal_model
from physid.estimation.prediction.coordinates import Coordinates
from physid.scenes import SETUPS

MODEL: dict[str, Any] = {
    "seed_everything": 0,
    "model": {
        "class_path": "physid.training.learners.sysid.SysID",
        "learn": ["block.friction"],
        "values": {"block.mass": 1.0},
        "engine": {"substeps": 1, "effects": {"viscous_drag": {"coefficient": 0.1}}},
        "optimizer": {"class_path": "physid.training.parameters.gauss_newton.GaussNewton"},
    },
    "data": {
        "class_path": "physid.data.batches.datamodule.RecordingsDataModule",
        "folder": "data/push",
        "shuffle": False,
    },
    "trainer": {"accelerator": "cpu", "max_epochs": 12},
}


def places(values: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the path to every key."""
    if isinstance(values, dict):
        for name, value in values.items():
            yield (*path, name)
            yield from places(value, (*path, name))


def renamed(path: tuple[str, ...]) -> dict[str, Any]:
    """Return the configuration with one key misspelt."""
    changed = copy.deepcopy(MODEL)
    node = changed
    for name in path[:-1]:
        node = node[name]
    node[path[-1] + "x"] = node.pop(path[-1])
    return changed


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Diagnose, which shall end with a mistake of the user; returns the message."""
    assert main(words) == 2
    error = capsys.readouterr().err.strip()
    assert len(error.splitlines()) == 1
    return error


def test_a_run_and_its_checkpoint_give_what_was_fitted(tmp_path: Path) -> None:
    scene = SETUPS[0].scene
    names = ("block.mass", "block.friction")
    fitted = Coordinates.of(names).to_coordinates(torch.tensor([1.3, 0.2], dtype=torch.float64))
    write_tensors(tmp_path / CHECKPOINT, {"state_dict": {COORDINATES: fitted}})
    (tmp_path / CONFIG).write_text(yaml.safe_dump({"model": {"learn": list(names), "values": {"block.mass": 9.0}}}))
    for source in (tmp_path, tmp_path / CHECKPOINT):
        model = read_nominal_model(scene, source)
        assert model.scene.unknown == names
        body = model.scene.bodies[0]
        assert (body.mass, body.friction) == pytest.approx((1.3, 0.2))
    (tmp_path / CONFIG).write_text(yaml.safe_dump({"model": {"learn": ["block.mass"]}}))
    with pytest.raises(ValueError, match="expected 1 fitted parameters"):
        read_nominal_model(scene, tmp_path)


def test_what_a_run_has_fitted_keeps_its_name_whatever_the_recordings_call_unknown(tmp_path: Path) -> None:
    scene = dataclasses.replace(SETUPS[0].scene, unknown=("block.mass",))
    fitted = Coordinates.of(["block.friction"]).to_coordinates(torch.tensor([0.2], dtype=torch.float64))
    write_tensors(tmp_path / CHECKPOINT, {"state_dict": {COORDINATES: fitted}, "learned": ["block.friction"]})
    (tmp_path / CONFIG).write_text(yaml.safe_dump({"model": {"learn": None}}))
    model = read_nominal_model(scene, tmp_path)
    assert (model.scene.bodies[0].mass, model.scene.bodies[0].friction) == pytest.approx((scene.bodies[0].mass, 0.2))
    assert {*model.scene.unknown} == {"block.mass", "block.friction"}
    (tmp_path / CONFIG).write_text(yaml.safe_dump({"model": {"learn": ["block.mass"]}}))
    with pytest.raises(ValueError, match=r"expected 1 fitted parameters \(block.mass\), found 'block.friction'"):
        read_nominal_model(scene, tmp_path)


@pytest.mark.parametrize("path", list(places(MODEL)), ids=".".join)
def test_a_misspelt_key_anywhere_is_refused(
    path: tuple[str, ...], recordings: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "model.yaml"
    file.write_text(yaml.safe_dump(renamed(path)))
    words = ["diagnose", str(recordings("push")), f"--model={file}", f"--out={tmp_path / 'out'}", "--quiet"]
    assert path[-1] in refused(words, capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("values", 3),
        ("values", {"block.mass": "heavy"}),
        ("values", {"block.mass": [1]}),
        ("learn", "block.mass"),
        ("learn", [3]),
        ("engine", 3),
        ("engine", {"substeps": 0}),
        ("engine", {"substeps": 1.5}),
        ("engine", {"effects": ["viscous_drag"]}),
        ("engine", {"effects": {"viscous_drag": 3}}),
        ("engine", {"effects": {"viscous_drag": {"coefficient": "x"}}}),
    ],
)
def test_a_value_of_another_kind_is_refused(
    key: str, value: object, recordings: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "model.yaml"
    file.write_text(yaml.safe_dump({**MODEL, "model": {**MODEL["model"], key: value}}))
    words = ["diagnose", str(recordings("push")), f"--model={file}", f"--out={tmp_path / 'out'}", "--quiet"]
    assert key in refused(words, capsys)
    assert not (tmp_path / "out").exists()


def test_a_logger_of_the_trainer_is_not_passed_over(
    recordings: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "model.yaml"
    file.write_text(yaml.safe_dump({**MODEL, "trainer": {"logger": True}}))
    words = ["diagnose", str(recordings("push")), f"--model={file}", f"--out={tmp_path / 'out'}", "--quiet"]
    assert "trainer.logger cannot be chosen" in refused(words, capsys)


def test_a_model_need_name_no_recordings(
    recordings: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, state = tmp_path / "model.yaml", torch.get_rng_state()
    data = {"class_path": MODEL["data"]["class_path"]}
    file.write_text(yaml.safe_dump({**MODEL, "data": data}))
    assert read_model(file, "")["data"] == data
    assert torch.equal(torch.get_rng_state(), state), "nothing is drawn"


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("model", "segment", "long"),
        ("model", "loss", 7),
        ("model", "twist", "x"),
        ("trainer", "max_epochs", "five"),
        ("data", "limit", "x"),
    ],
)
def test_values_that_do_not_count_are_checked_too(
    section: str, key: str, value: object, recordings: Callable[[str], Path], tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    file = tmp_path / "model.yaml"
    file.write_text(yaml.safe_dump({**MODEL, section: {**MODEL.get(section, {}), key: value}}))
    words = ["diagnose", str(recordings("push")), f"--model={file}", f"--out={tmp_path / 'out'}", "--quiet"]
    assert key in refused(words, capsys)
    assert not (tmp_path / "out").exists()
