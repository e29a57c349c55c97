"""Banks of simulators that share nothing with the model: dealt evenly, sealed through one protocol, told apart."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from tests.benchmark.conftest import TINY

from physid.benchmark.bank import Size, read_bank
from physid.benchmark.labels import Label, Part, open_labels
from physid.benchmark.plan import MISSING, OWN, RATES, Plan, Recorded, roles_of, simulators_of, tasks
from physid.benchmark.scoring.figures import by_recording
from physid.benchmark.scoring.judging import Judged
from physid.benchmark.sealing.hidden import ROLES, candidates, cells
from physid.benchmark.sealing.replay import steady
from physid.benchmark.sealing.seal import seal
from physid.benchmark.sealing.severity import severity
from physid.data import RecordingSet
from physid.data.generation.settings import GenerateConfig, Noise
from physid.effects import from_values
from physid.simulators import SIMULATORS

ALIKE = 0.05  # [-] by which severities by two simulators differ, where nothing hits anything
MIXED = Plan("score", 3, Size(sets=96, trajectories=6, steps=60), simulators_of("all"))


def test_a_bank_of_the_own_simulator_is_dealt_as_ever() -> None:
    assert Plan("score", 3, TINY.size).simulators == OWN
    assert {task.recorded for task in tasks(TINY)} == {Recorded()}


def test_simulators_rates_and_uneven_stamps_are_dealt_evenly_and_apart_from_each_other() -> None:
    dealt = tasks(MIXED)
    for name, values in {
        "simulator": [one.recorded.simulator for one in dealt],
        "rate": [str(one.recorded.frame_rate) for one in dealt],
        "uneven": [str(one.recorded.jitter > 0) for one in dealt],
    }.items():
        counts = Counter(values).values()
        assert max(counts) - min(counts) <= (1 if name != "uneven" else 33), name
    rates = Counter(one.recorded.frame_rate for one in dealt if one.recorded.simulator == "mujoco")
    assert set(rates) == set(RATES)
    assert sum(one.recorded.jitter > 0 for one in dealt) == 32


def test_a_simulator_gets_only_what_it_can_make() -> None:
    for task in tasks(MIXED):
        who = task.recorded.simulator
        assert any(candidates(task.role, *cell, who) for cell in cells(who)), (task.role, who)
        assert not task.film
    assert not any(candidates("native", *cell, "mujoco") for cell in cells("mujoco"))
    assert {kind.name for hidden in candidates("catalogue", "push", "straight", "closed_form") for kind in hidden.kinds
            if kind.site == "dynamics"} == {"viscous_drag"}  # fmt: skip


def test_roles_may_be_chosen_and_wrong_names_end_in_one_line() -> None:
    some = Plan("score", 1, Size(sets=14), ("mujoco",), roles_of("free, catalogue"))
    assert Counter(task.role for task in tasks(some)) == {"free": 5, "catalogue": 9}
    assert roles_of("") == roles_of("all") == ROLES
    with pytest.raises(ValueError, match=r'unknown simulator "bullet".*pybullet'):
        Plan("score", 1, Size(), simulators_of("bullet"))
    with pytest.raises(ValueError, match=r'unknown role "frei".*free'):
        Plan("score", 1, Size(), OWN, roles_of("frei"))
    with pytest.raises(ValueError, match="at least one simulator"):
        Plan("score", 1, Size(), ())


@pytest.mark.slow
def test_severity_does_not_depend_on_who_judges_or_how_often_it_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compared with the same simulator without the effect, a drag shows as much in each, at any frame rate."""
    drag = [from_values("viscous_drag", {"coefficient": 0.5})]
    plain = {"scene": "push", "protocol": "rich", "trajectories": 6, "video": False, "split": {"fit": 1}}
    plain |= {"noise": Noise(1e-3, 1e-3), "unknown": ("block.friction",), "true_values": {"block.friction": 0.2}}
    own = GenerateConfig(steps=97, **plain)
    for who, rate, steps in (("mujoco", 60.0, 25), ("closed_form", 30.0, 13)):
        assert steady(GenerateConfig(steps=steps, simulator=who, frame_rate=rate, **plain)) == steady(own)
    judged = severity(own, drag)
    monkeypatch.setattr("physid.benchmark.sealing.replay.JUDGE", "mujoco")
    assert severity(own, drag) == pytest.approx(judged, rel=ALIKE)


@pytest.mark.slow
def test_recordings_of_a_mixed_bank_have_the_rate_that_the_bank_says(tmp_path: Path) -> None:
    plan = Plan("score", 4, Size(sets=4, trajectories=6, steps=60), tuple(one.name for one in SIMULATORS), ("free",))
    bank = seal(tmp_path, plan, quiet=True)
    assert read_bank(tmp_path) == bank
    labels = open_labels(bank)
    for name, how in bank.recorded.items():
        recordings = RecordingSet(bank.recordings(name))
        assert (how.simulator, how.frame_rate) == (labels[name].simulator, labels[name].frame_rate)
        assert recordings.scene.time_step == pytest.approx(1 / how.frame_rate)
        assert (recordings.scene.integration is not None) == (how.simulator == "pybullet")
        stamped = recordings.read(0).time
        assert (stamped is not None) == labels[name].uneven
        if stamped is not None:
            lost = 1 - np.mean([one.length / round(60 / 240 * how.frame_rate) for one in recordings])
            assert -0.5 <= lost < 2 * MISSING


def test_results_are_broken_down_by_who_recorded_what(tmp_path: Path) -> None:
    part = Part("viscous_drag", "dynamics", {"coefficient": 0.2}, 2.0)
    free = Label("free", "push", "rich", simulator="mujoco", frame_rate=60.0)
    hidden = Label("catalogue", "toss", "rich", (part,), (("viscous_drag",),), 2.0, frame_rate=30.0, uneven=True)
    judged = [Judged("000", free, "none"), Judged("001", hidden, "named", ("tether",), ("tether",))]
    rows = {row[0]: row[1:] for row in by_recording(judged)}
    assert rows["mujoco, 60 Hz, free"] == ("1", "0", "0", "0", "0")
    assert rows["pybullet, uneven stamps, hidden"] == ("1", "100", "0", "0", "100")


@pytest.mark.parametrize(
    ("named", "grouped", "astray"),
    [
        (("viscous_drag",), True, False),
        (("quadratic_drag",), True, False),  # they cannot be told apart, and the verdict says so
        (("quadratic_drag",), False, True),
        (("viscous_drag", "observation_latency"), True, True),
        ((), False, False),
    ],
)
def test_a_cause_that_is_not_there_counts_as_astray(named: tuple[str, ...], grouped: bool, astray: bool) -> None:
    part = Part("viscous_drag", "dynamics", {"coefficient": 0.2}, 2.0)
    label = Label("catalogue", "push", "rich", (part,), (("viscous_drag",),), 2.0)
    assert Judged("000", label, "partial", named, grouped=grouped).astray == astray
    assert Judged("000", Label("free", "push", "rich"), "named", named).astray == bool(named)
