"""Whole diagnoses of small sets: what is hidden is found, what is not hidden is not."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from diagnosis.sets import FRICTION, Vortex, recorded, recorded_with, rewritten, with_wild_poses
from physid.cli import main
from physid.data import RecordingSet
from physid.diagnosis.diagnose import diagnose
from physid.diagnosis.document.document import FILE, read_diagnosis
from physid.diagnosis.document.sentences import MOST_LINES, caveat, summary_lines
from physid.diagnosis.progress import Stage
from physid.diagnosis.reference import nominal_fit_cache as resume
from physid.diagnosis.results import NEXT
from physid.effects import CATALOGUE

DRAG = 0.8
WIDER = 3.0  # a 90 % interval misses now and then; three times as wide it does not
CLOSED = 0.8
FRICTION_TOLERANCE = 0.03


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("diagnosis")


@pytest.fixture(scope="module")
def dragged(folder: Path) -> Path:
    return recorded(folder / "dragged", {"viscous_drag": {"coefficient": DRAG}})


@pytest.fixture(scope="module")
def drag(folder: Path, dragged: Path) -> Mapping[str, Any]:
    return diagnose(RecordingSet(dragged), folder / "drag", save=folder / "model.yaml")


@pytest.fixture(scope="module")
def free(folder: Path) -> Path:
    return recorded(folder / "free")


def names(found: Mapping[str, Any]) -> list[str]:
    return list(found.blamed)


def test_a_hidden_drag_is_named_with_its_size(drag: Mapping[str, Any]) -> None:
    assert (drag.verdict, names(drag)) == ("named", ["viscous_drag"])
    size = drag.effects[0].parameters["coefficient"]
    assert abs(size.value - DRAG) < WIDER * (size.high - size.low) / 2
    assert size.unit == "N s/m"


def test_the_drag_lies_in_the_dynamics_and_closes_the_gap_on_both_protocols(drag: Mapping[str, Any]) -> None:
    assert max(drag.where.site, key=drag.where.site.get) == "dynamics"
    assert {cell.dof for cell in drag.where.cells[:3]} <= {"x", "y"}
    for split in ("same", "transfer"):
        assert drag.errors(split).after < drag.errors(split).before
    assert drag.shrink.same.value > CLOSED


def test_friction_is_right_once_the_drag_is_known(drag: Mapping[str, Any]) -> None:
    with_effect = drag.parameters["block.friction"].with_effect
    assert with_effect.value == pytest.approx(FRICTION, rel=FRICTION_TOLERANCE)
    assert abs(with_effect.value - FRICTION) < abs(drag.parameters["block.friction"].nominal - FRICTION)


def test_what_is_written_is_what_is_returned(folder: Path, drag: Mapping[str, Any]) -> None:
    assert read_diagnosis(folder / "drag" / FILE) == drag
    assert "Viscous drag" in (folder / "drag" / "report.html").read_text()
    assert len(summary_lines(drag)) <= MOST_LINES


@pytest.mark.slow
def test_the_saved_model_is_what_fit_takes_and_predicts_better(
    folder: Path, drag: Mapping[str, Any], dragged: Path
) -> None:
    figures = {}
    for name, without in (("with", []), ("without", ["model.engine.effects=null"])):
        run = folder / f"fit_{name}"
        words = ["fit", "--config", str(folder / "model.yaml"), "--run-dir", str(run), "trainer.max_epochs=6"]
        assert main([*words, *without]) == 0
        figures[name] = json.loads((run / "metrics.json").read_text())
    errors = {name: abs(each["params/block.friction/estimate"] - FRICTION) for name, each in figures.items()}
    assert errors["with"] < errors["without"]


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_hidden(folder: Path, free: Path) -> None:
    found = diagnose(RecordingSet(free), folder / "none")
    assert (found.verdict, found.effects, found.group) == ("none", (), ())
    assert found.parameters["block.friction"].nominal == pytest.approx(FRICTION, rel=FRICTION_TOLERANCE)


@pytest.mark.slow
def test_outliers_decide_nothing(folder: Path, free: Path, dragged: Path) -> None:
    random = np.random.default_rng(0)
    for source, verdict in ((free, "none"), (dragged, "named")):
        wild = rewritten(source, folder / f"wild_{verdict}", lambda _, one: with_wild_poses(one, random))
        found = diagnose(RecordingSet(wild), folder / f"of_wild_{verdict}")
        assert found.verdict == verdict
        assert names(found) == (["viscous_drag"] if verdict == "named" else [])


@pytest.mark.slow
def test_noise_free_recordings_without_an_effect_show_none(folder: Path) -> None:
    plain = recorded(folder / "plain", protocol="paper", protocol_of_split={}, noise={}, split={"train": 4, "test": 1})
    assert diagnose(RecordingSet(plain), folder / "of_plain").verdict == "none"


@pytest.mark.slow
def test_an_effect_outside_the_catalogue_is_unknown_until_its_law_is_given(folder: Path) -> None:
    strange = recorded_with(folder / "strange", [Vortex(torch.tensor([2.0], dtype=torch.float64))])
    found = diagnose(RecordingSet(strange), folder / "unknown")
    assert (found.verdict, found.effects) == ("unknown", ())
    own = diagnose(RecordingSet(strange), folder / "own", effects=[Vortex])
    assert names(own) == ["vortex"]


@pytest.mark.slow
def test_three_effects_that_another_simulator_adds_are_named_with_their_sizes(folder: Path) -> None:
    """Two effects may look like a third: each is exchanged for what explains most beside the others."""
    hidden = {"viscous_drag": {"coefficient": 0.6}, "friction_gradient": {"x": 0.3}, "force_gain": {"gain": 0.15}}
    world: dict[str, Any] = {"simulator": "mujoco", "frame_rate": 60, "steps": 75, "trajectories": 10}
    found = diagnose(
        RecordingSet(recorded(folder / "three", hidden, **world, split={"fit": 6, "select": 2, "report_same": 2})),
        folder / "of_three",
    )
    assert found.verdict == "named"
    assert {*found.blamed} == {*hidden}
    sizes = {effect.name: effect.parameters for effect in found.effects}
    for name, parameters in hidden.items():
        for key, value in parameters.items():
            assert sizes[name][key].value == pytest.approx(value, rel=0.03)
    parts = found.shrink.parts["same"]
    assert {*parts} == {*hidden}
    assert sum(parts.values()) == pytest.approx(1, abs=0.05)


@pytest.mark.slow
def test_what_one_mass_does_not_identify_apart_is_a_group(folder: Path) -> None:
    found = diagnose(
        RecordingSet(recorded(folder / "tilted", {"ground_tilt": {"x": 0.03, "y": 0.02}})), folder / "tilt"
    )
    assert found.verdict == "group"
    assert set(found.group) == {"ground_tilt", "constant_force"}
    assert "another mass" in found.next_experiment
    assert not (folder / "tilt" / NEXT).exists(), "no force profile of push tells them apart"


@pytest.mark.slow
def test_the_next_experiment_tells_apart_what_these_recordings_cannot(folder: Path) -> None:
    drag = {"viscous_drag": {"coefficient": 2.0}}
    slow = recorded(folder / "slow", drag, protocol="paper", protocol_of_split={}, split={"fit": 5, "report_same": 1})
    found = diagnose(RecordingSet(slow), folder / "of_slow")
    assert (found.verdict, set(found.group)) == ("group", {"viscous_drag", "quadratic_drag"})
    told = re.search(r"differ by (\d+) standard deviations .* like these differ by ([\d.]+)", found.next_experiment)
    assert told is not None
    assert float(told.group(1)) > 2 * float(told.group(2))
    config = folder / "of_slow" / NEXT
    small = ["trajectories=8", "steps=90", "guess_factor=1.3", "noise.position=0.0005", "noise.rotation=0.002"]
    hidden = f"effects.viscous_drag.coefficient={drag['viscous_drag']['coefficient']}"
    words = ["generate", "--config", str(config), f"--out={folder / 'next'}", "--workers=1", "--quiet", *small, hidden]
    assert main(words) == 0
    after = diagnose(RecordingSet(folder / "next"), folder / "of_next")
    assert (after.verdict, after.group) == ("named", ("viscous_drag",))


@pytest.mark.slow
def test_without_a_transfer_set_a_cause_is_not_certified(folder: Path, dragged: Path) -> None:
    drag = {"viscous_drag": {"coefficient": DRAG}}
    rich = recorded(folder / "rich", drag, split={"fit": 3, "report_same": 1}, seed=11)  # nothing of the other set
    alone = diagnose(RecordingSet(rich), folder / "alone")
    assert alone.gap.transfer is None
    assert "not certified" in caveat(alone)
    certified = diagnose(RecordingSet(rich), folder / "both", transfer=RecordingSet(dragged))
    assert certified.gap.transfer.before > 0
    assert names(certified) == names(alone) == ["viscous_drag"]
    with pytest.raises(ValueError, match="expected a recording of its own, found the poses of trajectory 0"):
        diagnose(RecordingSet(rich), folder / "copied", transfer=RecordingSet(rich))


@pytest.mark.slow
def test_the_command_prints_verdict_and_answers(folder: Path, free: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", str(free), "--out", str(folder / "command"), "--quiet"]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith("Verdict   none")
    assert len(printed) <= MOST_LINES + 1
    assert (folder / "command" / FILE).exists()


@pytest.mark.slow
def test_the_command_opens_the_set_once(folder: Path, free: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Path] = []
    first = RecordingSet.__init__

    def count(self: RecordingSet, place: Path | str) -> None:
        opened.append(Path(place))
        first(self, place)

    monkeypatch.setattr(RecordingSet, "__init__", count)
    assert main(["diagnose", str(free), "--out", str(folder / "once"), "--quiet", "--limit", "5"]) == 0
    assert opened == [free]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_diagnosis(folder: Path, free: Path) -> None:
    first, second = (diagnose(RecordingSet(free), folder / f"seed_{k}", seed=3) for k in (0, 1))
    assert first == second
    assert len(CATALOGUE) >= len(first.ranking)


@pytest.mark.slow
def test_an_interrupted_diagnosis_goes_on_to_the_same_result(folder: Path, free: Path) -> None:
    whole = diagnose(RecordingSet(free), folder / "whole")

    def interrupt(stage: Stage, what: str = "") -> None:
        if stage is Stage.TESTING:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        diagnose(RecordingSet(free), folder / "interrupted", say=interrupt)
    assert (folder / "interrupted" / resume.FILE).exists()

    said: list[Stage] = []
    again = diagnose(RecordingSet(free), folder / "interrupted", say=lambda stage, what="": said.append(stage))
    assert again == whole
    assert Stage.TESTING in said
    assert Stage.FITTING_NOMINAL not in said
    assert not (folder / "interrupted" / resume.FILE).exists()
