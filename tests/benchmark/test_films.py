"""Sets of films: nothing but films and forces is given, and what is read from them is judged as anything else."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import pytest
from tests.benchmark.stub import ignorant

from physid.benchmark import plan
from physid.benchmark.bank import QUICK, Bank, Size
from physid.benchmark.films import NOISE, SCENES, filmed
from physid.benchmark.labels import open_labels
from physid.benchmark.plan import Plan, Task, tasks
from physid.benchmark.scoring.scoring import score
from physid.benchmark.sealing.hidden import ROLES, SHARES
from physid.benchmark.sealing.invent import inventions
from physid.benchmark.sealing.seal import seal
from physid.benchmark.sealing.severity import severity
from physid.benchmark.verdicts import diagnose_bank
from physid.data import RecordingSet
from physid.data.files import write_text
from physid.data.generation.settings import GenerateConfig, Noise
from physid.effects import from_values

TINY = Plan("score", 3, Size(sets=2, trajectories=6, steps=60))
SAME = ("wrench", "mask", "background")


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> Bank:
    """Return a bank in which every set has films."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "is_film", lambda turn: True)
        return seal(tmp_path_factory.mktemp("films"), TINY, quiet=True)


def test_one_set_in_fifteen_has_films_whatever_is_hidden() -> None:
    dealt = tasks(Plan("score", 0, Size(sets=150)))
    assert sum(task.film for task in dealt) == 9
    for role in ROLES:
        share = 150 * SHARES[role] / sum(SHARES.values()) / 15
        assert abs(sum(task.film for task in dealt if task.role == role) - share) <= 1, role
    assert not any(task.film for task in tasks(Plan("score", 0, QUICK))), "reading takes too long there"


@pytest.mark.slow
def test_films_and_forces_are_all_that_is_given(films: Bank) -> None:
    seen = set()
    for name in films.sets:
        recordings = RecordingSet(films.recordings(name))
        assert recordings.scene.name in SCENES
        assert {path.name for path in recordings.folder.iterdir()} == {"recording.yaml", "SHA256SUMS", "trajectories"}
        recordings.verify()
        for path in recordings.paths:
            with h5py.File(path) as file:
                shapes = {key: (value.shape, str(value.dtype), value.chunks) for key, value in file.items()}
                attributes = sorted(file.attrs) + [str(list(value.attrs)) for value in file.values()]
                seen.add((path.name, file.attrs["split"], str(shapes), str(attributes)))
                assert set(file) == {"frames", *SAME}
    assert len(seen) == TINY.size.trajectories


@pytest.mark.slow
def test_files_differ_in_size_by_what_the_images_take_alone(films: Bank) -> None:
    rest = set()
    for name in films.sets:
        for path in RecordingSet(films.recordings(name)).paths:
            with h5py.File(path) as file:
                rest.add(path.stat().st_size - sum(file[key].id.get_storage_size() for key in ("frames", *SAME)))
    assert len(rest) == 1
    assert len({path.stat().st_mtime_ns for path in (films.folder / "sets").rglob("*")}) == 1


@pytest.mark.slow
def test_what_is_believed_of_a_film_does_not_depend_on_what_is_hidden() -> None:
    free = [next(inventions(TINY, Task("001", "free", turn, film=True)))[0] for turn in range(2)]
    one, effects, label = next(inventions(TINY, Task("001", "catalogue", 0, film=True)))
    assert effects
    assert label.film
    assert label.noise == NOISE.position
    assert one in free


def test_a_film_shows_what_moves_along_the_ground_and_no_more() -> None:
    poses = GenerateConfig(
        scene="push", protocol="rich", trajectories=6, steps=121, video=False, split={"fit": 1}, noise=NOISE
    )
    film = dataclasses.replace(poses, video=True)
    raised, drag = from_values("camera_offset", {"z": 0.02}), from_values("viscous_drag", {"coefficient": 0.5})
    assert severity(poses, [raised]) > 1
    assert severity(film, [raised]) < 1e-3
    assert severity(film, [drag]) == pytest.approx(severity(poses, [drag]), rel=1e-3)


def test_films_are_half_as_many_and_half_as_long_but_not_too_short() -> None:
    plain = GenerateConfig(scene="push", trajectories=24, steps=300, video=False, noise=Noise(1e-4, 1e-4))
    for whole, half in (((24, 300), (12, 150)), ((8, 100), (6, 60)), ((6, 40), (6, 40))):
        one = filmed(dataclasses.replace(plain, trajectories=whole[0], steps=whole[1]))
        assert (one.trajectories, one.steps) == half
        assert (one.video, one.noise) == (True, NOISE)


@pytest.mark.slow
def test_a_diagnosis_gets_what_was_read_and_is_scored_by_source(films: Bank, tmp_path: Path) -> None:
    looked = []

    def looking(read: RecordingSet, out: Path) -> Mapping[str, Any]:
        films_of = RecordingSet(films.recordings(out.name))
        assert read.splits() == films_of.splits()
        assert all(one.pose is not None for one in read)
        looked.append(read.folder)
        return ignorant(read, out)

    labels = open_labels(films)
    free, other = sorted(films.sets, key=lambda name: ROLES.index(labels[name].role))
    write_text(films.verdict(other) / "failure.json", "{}")
    assert diagnose_bank(films, diagnose=looking, quiet=True) == (1, 0)
    assert looked == [films.verdict(free) / "read"]
    table = score(films, tmp_path / "score").tables["By source, of sets that are free or of medium severity and up"]
    assert ("films, free", "1", "0", "100", "100", "0") in table
    assert not any(row[0].startswith("poses") for row in table)
