"""What a fit shows of its recordings is said at its end, kept with the run, and said by a diagnosis as well."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from physid.cli import main
from physid.data import RecordingSet
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig, Noise
from physid.diagnosis.inputs import read_inputs
from physid.diagnosis.reference.fit_findings import findings_of_fit
from physid.diagnosis.reference.nominal_fit import fit_nominal_model
from physid.diagnosis.settings.settings import Settings
from physid.estimation.measurement import moved
from physid.estimation.segmented_fit import UnexplainedEvents
from physid.inspection.finding import Finding, Findings
from physid.inspection.rules.fitted import unexplained_impacts
from physid.scenes import find_setup

UNKNOWN = ("block.mass", "block.friction")
ODD, MASS, OTHER = 3, 2.0, 1.4
SIZES = np.array([3e-3] * 3 + [5e-4] * 3)  # rad, m


def pushed(folder: Path, mass: float = MASS, noise: float = 1.0) -> Path:
    """Record a block of closed form that is pushed straight, by a camera of 60 frames a second."""
    own = Noise(position=5e-4 * noise, rotation=3e-3 * noise)
    config = GenerateConfig(
        "push", simulator="closed_form", protocol="straight", frame_rate=60.0, trajectories=6, steps=75, seed=4,
        video=False, unknown=UNKNOWN, true_values={"block.mass": mass, "block.friction": 0.2}, noise=own,
    )  # fmt: skip
    generate(config, folder, quiet=True)
    return folder


def averaged(folder: Path, count: int = 5) -> Path:
    """Add running means of white noise to poses that have none; velocities are not recorded."""
    random = np.random.default_rng(0)
    for path in sorted((folder / "trajectories").glob("*.h5")):
        with h5py.File(path, "r+") as file:
            poses = torch.from_numpy(file["pose"][...]).double()
            white = random.standard_normal((len(poses) + count - 1, 1, 6)) / count**0.5
            change = SIZES * np.lib.stride_tricks.sliding_window_view(white, count, 0).sum(-1)
            file["pose"][...] = moved(poses, torch.from_numpy(change)).numpy()
            del file["twist"]
    (folder / "SHA256SUMS").unlink()
    return folder


def mixed(folder: Path, noise: float = 1.0) -> Path:
    """Return a set one of whose trajectories is of a lighter block under the same forces."""
    pushed(folder, noise=noise)
    light = pushed(folder.parent / "light", OTHER, noise)
    name = f"trajectories/{ODD:06d}.h5"
    with h5py.File(folder / name, "r+") as file, h5py.File(light / name) as other:
        assert np.array_equal(file["wrench"][...], other["wrench"][...])
        file["pose"][...] = other["pose"][...]
    (folder / "SHA256SUMS").unlink()
    return folder


def of_diagnosis(folder: Path) -> tuple[Finding, ...]:
    settings = Settings()
    inputs = read_inputs(RecordingSet(folder), None, None, [], None, settings)
    generator = torch.Generator().manual_seed(0)
    return findings_of_fit(
        fit_nominal_model(inputs.observations, inputs.model, inputs.candidates, generator, settings=settings)
    )


def of_fit(folder: Path) -> tuple[Finding, ...]:
    assert main(["fit", str(folder), "--run-dir", str(folder.parent / "run")]) == 0
    kept = Findings.read(folder.parent / "run")
    assert kept is not None
    return kept.findings


@pytest.mark.slow
def test_a_fit_and_a_diagnosis_name_the_trajectory_of_another_block(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = mixed(tmp_path / "set")
    with caplog.at_level(logging.WARNING, logger="physid"):
        found = of_fit(folder)
    said = f"trajectory {ODD} alone has another block.mass about 1.4 (the others: 2)"
    assert [one.what for one in found if one.wrong] == [said]
    assert said in caplog.text
    assert "1 thing looks wrong" in capsys.readouterr().out
    assert [one.what for one in of_diagnosis(folder)] == [said]


@pytest.mark.slow
def test_behind_a_filter_it_is_named_as_well(tmp_path: Path) -> None:
    folder = mixed(tmp_path / "set", noise=0.0)
    (folder / "SHA256SUMS").touch()
    for found in (of_fit(averaged(folder)), of_diagnosis(folder)):
        (wrong,) = [one.what for one in found if one.wrong]
        assert wrong.startswith(f"trajectory {ODD} alone has another block.mass about 1.4 (the others: ")


@pytest.mark.slow
def test_a_fit_and_a_diagnosis_say_that_noise_is_alike_in_neighbouring_frames(tmp_path: Path) -> None:
    folder = averaged(pushed(tmp_path / "set", noise=0.0))
    for found in (of_fit(folder), of_diagnosis(folder)):
        assert [one.wrong for one in found] == [False]
        assert "noise of neighbouring frames is alike" in found[0].what
    assert '"fit/position_explained": 1.0' in (tmp_path / "run" / "metrics.json").read_text()


@pytest.mark.slow
def test_of_white_noise_and_one_block_nothing_is_said(tmp_path: Path) -> None:
    folder = pushed(tmp_path / "set")
    assert of_fit(folder) == of_diagnosis(folder) == ()


def bounced(folder: Path, given: float) -> Path:
    """Record a block that bounces with a restitution of 0.3 in another simulator, and say what it is given as."""
    config = GenerateConfig(
        "toss", simulator="mujoco", frame_rate=100.0, trajectories=8, steps=100, seed=3, video=False,
        unknown=("block.friction",), noise=Noise(position=3e-4, rotation=2e-3),
    )  # fmt: skip
    generate(config, folder, quiet=True)
    path = folder / "recording.yaml"
    path.write_text(path.read_text().replace("restitution: 0.3", f"restitution: {given}"))
    (folder / "SHA256SUMS").unlink()
    return folder


@pytest.mark.slow
def test_a_restitution_that_is_given_and_wrong_is_named_by_a_fit_and_a_diagnosis(tmp_path: Path) -> None:
    folder = bounced(tmp_path / "set", 0.0)
    for found in (of_fit(folder), of_diagnosis(folder)):
        (one,) = found
        assert one.what.startswith("many impacts are not explained: in ")
        assert one.mend.startswith("unless somebody measured what is given (block.restitution 0)")


@pytest.mark.slow
def test_of_the_right_restitution_nothing_is_said(tmp_path: Path) -> None:
    folder = bounced(tmp_path / "set", 0.3)
    assert of_fit(folder) == of_diagnosis(folder) == ()


def test_impacts_that_are_not_explained_are_said_with_the_restitution_that_is_given() -> None:
    scene, left = find_setup("toss").scene, UnexplainedEvents(7, 9, 2.34e-3, 0.01)
    said = unexplained_impacts(left, replace(scene, unknown=("block.friction",)))
    assert said.what == (
        "many impacts are not explained: in 7 of 9 segments with an impact or a jolt the model leaves 2.3 mm "
        "and 0.57 deg beyond noise (medians), which counts little in a fit"
    )
    assert said.mend.startswith("unless somebody measured what is given (block.restitution 0.3), learn it")
    learned = unexplained_impacts(left, replace(scene, unknown=("block.restitution",)))
    assert (learned.what, learned.wrong) == (said.what, False)
    assert learned.mend.startswith("contact is softer than the model's")


def test_a_restitution_that_bodies_of_one_material_share_is_said_once_or_known_to_be_learned() -> None:
    scene, left = find_setup("collide").scene, UnexplainedEvents(7, 9, 2.34e-3, 0.01)
    assert "restitution" not in unexplained_impacts(left, replace(scene, unknown=("other.restitution",))).mend[:40]
    assert unexplained_impacts(left, replace(scene, unknown=())).mend.partition(")")[0].count(".restitution") == 1
