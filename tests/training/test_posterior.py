"""What a fit knows of its parameters is kept, and drawn from."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from physid.cli import main
from physid.estimation.prediction.coordinates import Coordinates, Unknown
from physid.training.parameters.posterior import Posterior, read_posterior

POINT = torch.tensor([0.3, -2.0, 1.2], dtype=torch.float64)
ROOT = torch.tensor([[0.05, 0.0, 0.0], [-0.04, 0.01, 0.0], [0.0, 0.02, 0.03]], dtype=torch.float64)
KNOWN = Posterior(Coordinates.of(("block.mass", "block.friction", "com_offset.x")), POINT, ROOT @ ROOT.T, 12)
MANY = 40_000


def test_a_posterior_is_read_as_it_was_written(tmp_path: Path) -> None:
    spread = KNOWN.covariance.clone()
    spread[0, 0] = torch.inf
    for one in (KNOWN, dataclasses.replace(KNOWN, covariance=spread)):
        one.write(tmp_path)
        again = read_posterior(tmp_path)
        assert (again.space, again.trajectories) == (one.space, one.trajectories)
        assert torch.equal(again.point, one.point)
        assert torch.equal(again.covariance, one.covariance)


def test_a_size_of_an_effect_that_is_not_known_here_is_drawn_as_it_was_fitted(tmp_path: Path) -> None:
    own = Unknown("magnetic_brake.coefficient", "N s/m", "linear", 0.0, 20.0, 2.0, 0.5)
    spread = torch.eye(1, dtype=torch.float64) * 1e-6
    Posterior(Coordinates((own,)), torch.tensor([1.5], dtype=torch.float64), spread, 12).write(tmp_path)
    again = read_posterior(tmp_path)
    assert again.space.unknowns == (own,)
    assert float(again.sample(100).mean()) == pytest.approx(0.5 + 2.0 * 1.5, rel=1e-3)


def test_draws_have_the_mean_and_the_covariance_of_the_coordinates() -> None:
    drawn = KNOWN.space.to_coordinates(KNOWN.sample(MANY))
    assert torch.allclose(drawn.mean(0), POINT, atol=4 * 0.05 / MANY**0.5)
    assert torch.allclose(drawn.T.cov(), KNOWN.covariance, atol=0.03 * float(KNOWN.covariance.max()))
    pair = float(drawn.T.corrcoef()[0, 1])
    assert pair == pytest.approx(KNOWN.correlations()["block.mass", "block.friction"], abs=0.01)


def test_no_draw_lies_beyond_a_physical_range_and_none_piles_up_at_its_end() -> None:
    space = Coordinates.of(("viscous_drag.coefficient",))
    at_the_end = Posterior(space, torch.zeros(1).double(), torch.ones(1, 1).double(), 12)
    drawn = at_the_end.sample(1000)
    assert float(drawn.min()) > 0.0
    assert float(drawn.mean()) == pytest.approx(0.3 * (2 / np.pi) ** 0.5, rel=0.1)  # of half a normal distribution


def test_a_parameter_that_is_not_identified_is_not_drawn() -> None:
    spread = KNOWN.covariance.clone()
    spread[1, 1] = torch.inf
    with pytest.raises(ValueError, match=r"block\.friction: the recordings of this run do not identify it"):
        dataclasses.replace(KNOWN, covariance=spread).sample(3)


def test_samples_are_the_same_numbers_in_every_format_and_for_a_seed(tmp_path: Path) -> None:
    KNOWN.write(tmp_path)
    for name in ("one.csv", "one.npz", "one.yaml"):
        assert main(["sample", str(tmp_path), "--count", "5", "--seed", "3", "--out", str(tmp_path / name)]) == 0
    expected = KNOWN.sample(5, 3).numpy()
    with (tmp_path / "one.csv").open() as file:
        rows = list(csv.DictReader(file))
    arrays = np.load(tmp_path / "one.npz")
    worlds = yaml.safe_load((tmp_path / "one.yaml").read_text())
    for column, name in enumerate(KNOWN.names):
        assert [float(row[name]) for row in rows] == expected[:, column].tolist()
        assert arrays[name].tolist() == expected[:, column].tolist()
        assert [world[name] for world in worlds] == expected[:, column].tolist()
    assert not np.array_equal(KNOWN.sample(5, 4).numpy(), expected)


@pytest.mark.parametrize("stands", [lambda part, mine: part.symlink_to(mine), lambda part, _: os.mkfifo(part)])
def test_samples_are_written_through_no_link_and_wait_for_no_pipe(
    tmp_path: Path, stands: Callable[[Path, Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine").write_text("precious")
    run, other = tmp_path / "run", tmp_path / "other"
    for folder in (run, other):
        folder.mkdir()
        stands(folder / "samples.csv.part", tmp_path / "mine")
    KNOWN.write(run)
    assert main(["sample", str(run)]) == 2
    assert "samples.csv.part: expected nothing but files and folders" in capsys.readouterr().err
    assert main(["sample", str(run), "--out", str(other / "samples.csv")]) == 0
    assert (tmp_path / "mine").read_text() == "precious"
    assert [path.name for path in other.iterdir()] == ["samples.csv"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--count", "0"], "--count must be a whole number of at least 1, got 0"),
        (["--out", "samples.txt"], "--out must end in .csv, .npz, .yaml"),
        ([], "that has come to its end"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sample", str(tmp_path), *words]) != 0
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_what_is_not_known_replaces_the_figures_of_an_earlier_epoch() -> None:
    names, point = ("block.friction", "block.mass"), torch.tensor([-1.6, 0.4], dtype=torch.float64)
    covariance = torch.tensor([[1e-2, 1e-3], [1e-3, 1e-2]], dtype=torch.float64)
    blind = covariance.clone()
    blind[1, 1] = torch.inf
    known, unknown = (Posterior(Coordinates.of(names), point, one, 20).logged() for one in (covariance, blind))
    assert known.keys() == unknown.keys()
    assert all(value.isfinite() for value in known.values())
    lost = {name for name, value in unknown.items() if not value.isfinite()}
    assert lost == {"params/block.mass/low", "params/block.mass/high", "correlation/block.friction/block.mass"}


def test_a_name_that_would_act_on_a_terminal_is_refused(tmp_path: Path) -> None:
    KNOWN.write(tmp_path)
    path = tmp_path / "posterior.json"
    path.write_text(path.read_text().replace('"block.mass"', r'"block\u001b[2J.mass"'))
    with pytest.raises(ValueError, match=r"parameters\[\d\]: name must hold characters that are seen, got 'block\\x1b"):
        read_posterior(tmp_path)


def spoilt(tmp_path: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """Write a posterior as a fit does, and change its content."""
    KNOWN.write(tmp_path)
    path = tmp_path / "posterior.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return path


def parameter(**changes: object) -> Callable[[dict[str, Any]], object]:
    return lambda content: content["parameters"][0].update(changes)


def entries(*places: tuple[int, int, float]) -> Callable[[dict[str, Any]], object]:
    def change(content: dict[str, Any]) -> None:
        for row, column, value in places:
            content["covariance"][row][column] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content.update(parameters=[], covariance=[]), "parameters: expected at least one"),
        (lambda content: content.update(trajectories=0), "trajectories must be a whole number of at least 1"),
        (parameter(name="file"), 'name: expected one such as block.friction, got "file"'),
        (parameter(name="../../x"), 'name: expected one such as block.friction, got "../../x"'),
        (parameter(name="/etc/x.y"), "name: expected one such as block.friction"),
        (parameter(name="block.friction"), 'parameters: "block.friction" is there twice'),
        (parameter(estimate=99.0), "block.mass: expected the estimate that its coordinate 0.3 stands for, 1.34986"),
        (parameter(low=2.0, high=1.0), "block.mass: expected a scale other than 0 and a range"),
        (parameter(scale=0.0, kind="linear"), "block.mass: expected a scale other than 0"),
        (entries((0, 0, -1.0)), "covariance: expected variances of at least 0"),
        (entries((0, 1, 5.0)), "covariance: expected variances of at least 0 in a symmetric matrix"),
        (entries((0, 1, 5.0), (1, 0, 5.0)), "covariance: expected one that a distribution can have"),
        (lambda content: content["covariance"].pop(), "covariance: expected 3 rows of 3 values"),
    ],
)
def test_what_no_fit_can_know_is_refused(
    change: Callable[[dict[str, Any]], object], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = spoilt(tmp_path, change)
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: ") as caught:
        read_posterior(tmp_path)
    assert message in str(caught.value)
    assert main(["sample", str(tmp_path), "--out", str(tmp_path / "worlds.npz")]) == 2
    assert not (tmp_path / "worlds.npz").exists()


@pytest.mark.parametrize("text", ["[" * 100_000, "{", "[1]", ""])
def test_a_posterior_that_is_none_is_one_line(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "posterior.json").write_text(text)
    assert main(["sample", str(tmp_path)]) == 2
    assert "posterior.json: expected" in capsys.readouterr().err


def test_a_covariance_whose_correlations_are_one_up_to_rounding_is_kept(tmp_path: Path) -> None:
    """Parameters that are known only together have correlations of one; rounding takes these beyond it."""
    spread = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    dataclasses.replace(KNOWN, covariance=spread[:, None] * spread * (1 + 1e-9 * (1 - torch.eye(3)))).write(tmp_path)
    assert read_posterior(tmp_path).names == KNOWN.names


@pytest.mark.parametrize("kind", ["csv", "npz", "yaml"])
def test_samples_replace_earlier_ones_and_nothing_else(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    KNOWN.write(tmp_path)
    out = tmp_path / f"worlds.{kind}"
    words = ["sample", str(tmp_path), "--out", str(out), "--count"]
    assert main([*words, "2"]) == 0
    assert main([*words, "3"]) == 0
    again = out.read_bytes()
    other = tmp_path / "other"
    other.mkdir()
    space = Coordinates.of(("block.mass",))
    Posterior(space, torch.zeros(1).double(), 0.01 * torch.eye(1).double(), 5).write(other)
    capsys.readouterr()
    for text in (None, b"", b"scene: push\n", b"t,x\n0,1\n", b"\xff\xfe", b"PK\x03\x04"):
        if text is not None:
            out.write_bytes(text)
        before = out.read_bytes()
        assert main(["sample", str(other), "--out", str(out)]) == 2
        assert "earlier sets of the same parameters, found something else; delete it" in capsys.readouterr().err
        assert out.read_bytes() == before
    out.write_bytes(again)
    assert main([*words, "1"]) == 0
