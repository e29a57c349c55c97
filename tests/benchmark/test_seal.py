"""A bank gives nothing away: each test looks for one kind of hint."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml
from tests.benchmark.conftest import TINY

from physid.benchmark.bank import QUICK, Bank, Size, read_bank, write_bank
from physid.benchmark.labels import open_labels
from physid.benchmark.plan import Plan, Task, tasks
from physid.benchmark.sealing.configurations import in_view
from physid.benchmark.sealing.hidden import CONFUSIONS, ROLES, candidates
from physid.benchmark.sealing.invent import inventions
from physid.benchmark.sealing.native import NATIVE
from physid.benchmark.sealing.outside import OUTSIDE
from physid.benchmark.sealing.recorded_set import make
from physid.benchmark.sealing.seal import seal, seal_all
from physid.data import RecordingSet
from physid.data.generation.draw import OutOfViewError, draw
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.effects import CATALOGUE, find
from physid.physics import Effect

MANY = Size(sets=150)


def files(bank: Bank, name: str) -> list[Path]:
    """Return all files of a set, below its folder."""
    folder = bank.recordings(name)
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


def test_every_role_is_there_and_every_set_has_a_label(bank: Bank) -> None:
    labels = open_labels(bank)
    assert labels.keys() == bank.sets.keys()
    assert {task.role for task in tasks(Plan("score", 0, QUICK))} == set(ROLES)
    for label in labels.values():
        assert (label.role == "free") == (not label.effects)
        assert (label.severity > 0) == bool(label.effects)


def test_names_and_order_say_nothing() -> None:
    ranks = {role: [] for role in ROLES}  # type: dict[str, list[float]]
    for seed in range(16):
        dealt = tasks(Plan("score", seed, MANY))
        assert [task.name for task in dealt] == [f"{number:03d}" for number in range(MANY.sets)]
        for place, task in enumerate(dealt):
            ranks[task.role].append(place / (MANY.sets - 1))
    for role, places in ranks.items():
        assert abs(np.mean(places) - 0.5) < 4 * (1 / 12 / len(places)) ** 0.5, role


def test_all_sets_hold_the_same_files_of_the_same_length_size_and_date(bank: Bank) -> None:
    first, *others = bank.sets
    wanted = files(bank, first)
    assert "truth.yaml" not in {path.name for path in wanted}
    for name in others:
        assert files(bank, name) == wanted
    for path in wanted:
        places = [bank.recordings(name) / path for name in bank.sets]
        assert len({place.stat().st_mtime_ns for place in places}) == 1
        bodies = {place: RecordingSet(place.parents[len(path.parts) - 1]).scene.bodies for place in places}
        if path.suffix == ".h5":
            for count in {len(body) for body in bodies.values()}:
                assert len({place.stat().st_size for place in places if len(bodies[place]) == count}) == 1


def test_no_metadata_differ(bank: Bank) -> None:
    seen = set()
    for name in bank.sets:
        for path in sorted((bank.recordings(name) / "trajectories").glob("*.h5")):
            with h5py.File(path) as file:
                shapes = {key: (value.shape[0], str(value.dtype), value.chunks is None) for key, value in file.items()}
                attributes = {key: [str(k) for k in value.attrs] for key, value in file.items()}
                split, other = file.attrs["split"], sorted(set(file.attrs) - {"split", "protocol"})
                seen.add((path.name, split, str(shapes), str(attributes), str(other)))
    assert len(seen) == TINY.size.trajectories


def test_no_text_names_an_effect_a_seed_or_the_truth(bank: Bank) -> None:
    names = [kind.name for kind in (*CATALOGUE, *NATIVE, *OUTSIDE)]
    texts = [(bank.folder / "bank.yaml").read_text()]
    texts += [
        path.read_text()
        for path in (bank.folder / "sets").rglob("*")
        if path.suffix in (".yaml", "") and path.is_file()
    ]
    for text in texts:
        assert not [word for word in (*names, "seed", "effect", *ROLES[2:], "truth") if word in text]
    assert set(yaml.safe_load(texts[0])) == {"format", "version", "purpose", "seal", "sets", "recorded"}


@pytest.mark.slow
def test_what_is_believed_does_not_depend_on_what_is_hidden() -> None:
    for name in ("004", "011"):
        free = [next(inventions(TINY, Task(name, "free", turn)))[0] for turn in range(8)]
        by_cell = {(one.scene, one.protocol): one for one in free}
        assert len(by_cell) == 8
        for turn in range(3):
            one, effects, _ = next(inventions(TINY, Task(name, "outside", turn)))
            assert effects
            assert one == by_cell[one.scene, one.protocol]


def test_first_guesses_are_no_fixed_multiple_of_the_truth(bank: Bank) -> None:
    labels = open_labels(bank)
    factors = set()
    for name, label in labels.items():
        scene = RecordingSet(bank.recordings(name)).scene
        ratio = {round(scene.value(unknown) / label.parameters[unknown], 6) for unknown in scene.unknown}
        assert len(ratio) == 1
        factors |= ratio
    assert len(factors) == len(labels)


def test_velocities_are_not_given(bank: Bank) -> None:
    assert all(one.twist is None for name in bank.sets for one in RecordingSet(bank.recordings(name)))


def test_the_seal_is_salted_so_that_guesses_cannot_be_tried(bank: Bank, tmp_path: Path) -> None:
    labels = open_labels(bank)
    (tmp_path / "sets").mkdir()
    assert seal_all(tmp_path, labels) != bank.seal


@pytest.mark.slow
def test_a_second_call_makes_the_same_recordings_and_an_interrupted_one_goes_on(tmp_path: Path) -> None:
    small = Plan("score", 5, Size(sets=2, trajectories=6, steps=60))
    first = seal(tmp_path / "one", small, quiet=True)
    again = seal(tmp_path / "two", small, quiet=True)
    assert first.sets == again.sets
    (tmp_path / "two" / "sealed" / "parts" / "001.json").unlink()
    (tmp_path / "two" / "bank.yaml").unlink()
    assert seal(tmp_path / "two", small, quiet=True).sets == first.sets
    with pytest.raises(ValueError, match="another seed, size, purpose"):
        seal(tmp_path / "one", Plan("score", 6, small.size), quiet=True)


@pytest.mark.slow
def test_a_bank_that_is_sealed_stays_as_it_was_published_and_a_spent_one_stays_spent(tmp_path: Path) -> None:
    small = Plan("score", 5, Size(sets=1, trajectories=6, steps=60))
    first = seal(tmp_path, small, quiet=True)
    before = (tmp_path / "bank.yaml").read_bytes()
    assert seal(tmp_path, small, quiet=True) == first
    assert (tmp_path / "bank.yaml").read_bytes() == before
    write_bank(dataclasses.replace(first, purpose="calibration"))
    with pytest.raises(ValueError, match="expected a bank for score, found one for calibration"):
        seal(tmp_path, small, quiet=True)


@pytest.mark.slow
def test_long_sets_of_a_light_block_stay_in_view() -> None:
    """With the transfer protocol's forces and 300 frames some masses and frictions left the view in every draw."""
    size = Size(sets=1, trajectories=6, steps=300)
    config = in_view(size, "push", "rich", np.random.default_rng(3))
    for index, split in enumerate(config.splits()):
        motion = draw(config, index, config.protocol_for(split))[1]  # an error if every draw leaves the view
        assert len(motion.pose) == size.steps


@pytest.mark.parametrize("written", [0, 1])
@pytest.mark.slow
def test_where_an_effect_drives_bodies_out_of_view_another_is_hidden(
    written: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the first trajectory, of which nothing is written then, or in a later one."""
    small, tried = Plan("score", 5, Size(sets=2, trajectories=6, steps=60)), list[list[str]]()

    def unlucky(config: GenerateConfig, out: Path, *, effects: Sequence[Effect], quiet: bool) -> None:
        tried.append([effect.name for effect in effects])
        if len(tried) == 1 and effects:
            if written:
                generate(dataclasses.replace(config, trajectories=1), out, effects=effects, quiet=quiet)
            raise OutOfViewError("trajectory 1: a body left the view")
        generate(config, out, effects=effects, quiet=quiet)

    monkeypatch.setattr("physid.benchmark.sealing.recorded_set.generate", unlucky)
    task = next(task for task in tasks(small) if task.role == "catalogue")
    name, label = make(tmp_path, small, task)
    first, second = tried
    assert first != second
    assert [part.name for part in label.effects] == second
    assert len(RecordingSet(tmp_path / "sets" / name)) == 6


def test_calibration_banks_and_scored_banks_never_share_their_randomness() -> None:
    score, calibration = (Plan(purpose, 1, MANY) for purpose in ("score", "calibration"))
    assert [task.role for task in tasks(score)] != [task.role for task in tasks(calibration)]
    assert score.generator(1, 0).random() != calibration.generator(1, 0).random()


def test_changed_labels_do_not_fit_the_seal(bank: Bank, tmp_path: Path) -> None:
    copy = tmp_path / "sealed" / "labels.json"
    copy.parent.mkdir()
    values = json.loads((bank.folder / "sealed" / "labels.json").read_text())
    copy.write_text(json.dumps(values))
    other = Bank(tmp_path, bank.purpose, bank.sets, bank.seal)
    write_bank(other)
    assert open_labels(other) == open_labels(bank)
    values["sets"]["000"]["severity"] += 1e-9
    copy.write_text(json.dumps(values))
    with pytest.raises(ValueError, match="changed after the bank was sealed"):
        open_labels(other)


def test_bank_yaml_is_read_back_and_a_missing_one_names_the_remedy(bank: Bank, tmp_path: Path) -> None:
    assert read_bank(bank.folder) == bank
    with pytest.raises(FileNotFoundError, match="benchmark diagnosis seal"):
        read_bank(tmp_path)


def test_every_confusion_names_effects_and_a_protocol_that_exist() -> None:
    for one in CONFUSIONS:
        assert all(find(name) for name in one.effects)
        for protocol in one.protocols:
            assert len(candidates("alias", one.scene, protocol)) >= len(one.effects)
            plain = {kind.name for hidden in candidates("catalogue", one.scene, protocol) for kind in hidden.kinds}
            assert not plain & set(one.effects), "exactly one effect is asked for only where it can be told"
