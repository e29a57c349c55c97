"""Where a gap lies: the site whose effects explain most together, the phases in which effects act."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from physid.diagnosis.conclusion.localisation import Place, over_time, places, sites
from physid.diagnosis.conclusion.where import phase_shares, work_of
from physid.diagnosis.inputs.model_source import read_nominal_model
from physid.diagnosis.selection.search import Attribution
from physid.diagnosis.settings.settings import Settings
from physid.diagnosis.testing.lack_of_fit import Row
from physid.diagnosis.testing.null_tails import together
from physid.diagnosis.testing.score_test import Conditional, Group
from physid.effects import CATALOGUE, find
from physid.estimation.prediction import Predictor, Segmentation, Timeline, Variants
from physid.scenes.setups.push import PUSH

STRENGTH = 100.0  # squared residual that a typical size makes
NAMES = ("viscous_drag", "tether", "adhesion")  # two of the dynamics, one of contact


def found(*sizes: float) -> Attribution:
    """Return a search that named nothing; of each effect (all are orthogonal) the data want so many typical sizes."""
    one, count = torch.ones(1, dtype=torch.float64), len(NAMES)
    groups = [Group((name,), torch.tensor([k]), one, one, -one, one) for k, name in enumerate(NAMES)]
    wanted = torch.tensor(sizes, dtype=torch.float64)[:, None]
    conditional = Conditional(
        STRENGTH * torch.eye(count, dtype=torch.float64), STRENGTH * wanted, *3 * [torch.zeros(0)]
    )
    rows = [
        Row((name,), STRENGTH * size**2, STRENGTH * size**2, one, one, together([]), together([]), 0.0)
        for name, size in zip(NAMES, sizes, strict=True)
    ]
    lack = SimpleNamespace(groups=groups, conditional=conditional, rows=rows)
    predictor = SimpleNamespace(candidates=CATALOGUE)
    experiment = SimpleNamespace(predictor=predictor)
    nominal = SimpleNamespace(experiment=experiment, held_out=torch.zeros(1), settings=Settings())
    return Attribution(cast(Any, nominal), cast(Any, lack), [], None, None, [])


def test_where_nothing_is_named_a_site_stands_for_its_best_residual_law() -> None:
    """At a temperature of a tenth of the best gain; whatever the effects of the catalogue explain."""
    shares = sites(found(0.9, 0.9, 1.0), False, {"perception": 900.0, "contact": 700.0, "dynamics": 0.0})
    assert list(shares) == ["perception", "actuation", "dynamics", "contact"]
    assert shares["contact"] / shares["perception"] == pytest.approx(math.exp(-200 / 180), rel=1e-2)
    assert shares["actuation"] == 0 < shares["dynamics"] < 0.01
    assert abs(sum(shares.values()) - 1) < 1e-3


def test_where_no_law_explains_the_gap_no_site_stands_out() -> None:
    assert not any(sites(found(0.9, 0.9, 1.0), False, {}).values())


def test_evidence_over_time_is_that_of_one_body_and_no_rounding() -> None:
    places = ((0, "y", 0), (0, "x", 1), (1, "x", 0), (0, "x", 0), (0, "x", None))
    cells = [SimpleNamespace(body=body, dof=dof, piece=piece) for body, dof, piece in places]
    gain = torch.tensor([[4.0, 5.0], [9.0, 7.0], [16.0, 3.0], [1e-9, 1.0], [25.0, 1.0]], dtype=torch.float64)
    lack = SimpleNamespace(cells=cells, cell_gain=gain, counted=torch.tensor([True, False]))
    table, dofs = over_time(lack, 0, rounding=1e-6)
    assert dofs == ["x", "y"]
    assert table.tolist() == [[0.0, 3.0], [2.0, 0.0]]


def test_what_was_tried_explains_all_that_it_gains_over_trajectories() -> None:
    """Three trajectories that a tried effect predicts better by 33 each count as a row of 99, not of 33."""
    search = found(1.0, 0.0, 1.0)
    nominal = SimpleNamespace(**vars(search.nominal) | {"held_out": torch.full((3,), 100.0)})
    tried = SimpleNamespace(names=("adhesion",), held_out=torch.full((3,), 67.0))
    shares = sites(replace(search, nominal=cast(Any, nominal), tried=[cast(Any, tried)]), True, {})
    assert shares == sites(found(1.0, 0.0, math.sqrt(0.99)), True, {})
    assert 0.1 < shares["contact"] < 0.5


def test_effects_of_two_sites_share_what_they_explain_together() -> None:
    search = found(3.0, 0.0, 0.0)  # the drag alone explains as much as with the other
    nominal = SimpleNamespace(**vars(search.nominal) | {"held_out": torch.full((3,), 300.0)})
    tried = SimpleNamespace(names=("viscous_drag", "adhesion"), held_out=torch.zeros(3))
    shares = sites(replace(search, nominal=cast(Any, nominal), tried=[cast(Any, tried)]), True, {})
    assert (shares["dynamics"], shares["contact"]) == pytest.approx((0.75, 0.25))


@pytest.mark.parametrize("strength", [1.0, 30.0])  # below and above what the least temperature belongs to
def test_an_explanation_that_falls_behind_weighs_less_by_the_temperature_of_the_best(strength: float) -> None:
    settings = Settings().localisation
    best, behind = STRENGTH * strength**2, STRENGTH * (0.97 * strength) ** 2
    shares = sites(found(strength, 0.0, 0.97 * strength), True, {})
    temperature = max(settings.least, settings.named * best)
    ratio = math.exp((behind - best) / (2 * temperature))
    nothing = math.exp(-best / (2 * temperature))  # the tether, which explains nothing
    assert shares["contact"] == pytest.approx(ratio / (1 + ratio + nothing), abs=2e-4)


DRAG, SPEED, STEP = 0.4, 1.0, 1 / 240  # [N s/m], [m/s], [s]


def coasting(name: str, size: float, frames: int = 241, height: float = 0.0, pieces: int = 1) -> tuple[Any, Any]:
    """Return recordings and the hypothesis that one effect acts, of a block that slides along x until it rests.

    It falls before if it starts at a height, and its motion may be predicted in pieces.
    """
    model, kind = read_nominal_model(PUSH.scene, None), find(name)
    wrench = torch.zeros(1, frames, 1, 6, dtype=torch.float64)
    timeline = Timeline.regular(wrench, STEP)
    whole = Segmentation.whole(torch.tensor([frames]), frames)
    predictor = Predictor(model, timeline, whole, [find("tether"), kind])
    pose = torch.tensor(
        [[0.0, 0.0, height + PUSH.scene.bodies[0].size[2] / 2, 0.0, 0.0, 0.0, 1.0]], dtype=torch.float64
    )
    twist = torch.tensor([[0.0, 0.0, 0.0, SPEED, 0.0, 0.0]], dtype=torch.float64)
    columns = torch.tensor([len(predictor.terms) - 1])
    effects = predictor.null[None].clone()
    effects[0, columns] = size
    point = Variants.of_states(pose[None, None], twist[None, None], model.guess[None], effects)
    if pieces > 1:
        whole, segments = predictor.predict(point), Segmentation.equal(1, frames, -(-frames // pieces))
        predictor, at = predictor.over(segments), (segments.trajectory, segments.start)
        point = point.replace(pose=whole.state[0][at][None], twist=whole.twist[0][at][None])
    jacobian = SimpleNamespace(base=predictor.predict(point))
    hypothesis = SimpleNamespace(
        fit=SimpleNamespace(point=point, jacobian=jacobian),
        experiment=SimpleNamespace(predictor=predictor),
        columns=columns,
    )
    observations = SimpleNamespace(timeline=timeline, scene=PUSH.scene, fitted=torch.tensor([True]))
    return SimpleNamespace(observations=observations, settings=Settings()), hypothesis


def test_the_work_of_a_drag_is_the_energy_of_what_it_takes_from_the_velocity_in_a_step() -> None:
    """In each step the drag changes the velocity by c v dt / m, whatever friction does beside it."""
    _, hypothesis = coasting("viscous_drag", DRAG)
    work, speed = work_of(hypothesis)[0][0, :, 0], hypothesis.fit.jacobian.base.twist[0, 0, :, 0, 3]
    mass, moving = PUSH.scene.bodies[0].mass, speed > 0.05
    expected = mass / 2 * (DRAG * speed * STEP / mass).square()
    assert 100 < int(moving.sum()) < len(speed) - 1
    assert torch.allclose(work[moving], expected[moving], rtol=0.05)
    assert float(work[speed.abs() < 1e-6].max()) < 1e-12
    assert float(work[-1]) == 0, "no step follows the last frame"


def test_a_drag_is_at_work_where_the_block_coasts() -> None:
    shares = phase_shares([Place("impact", "block", "x", 9.0, 1.0)], *coasting("viscous_drag", DRAG))
    assert next(iter(shares)) == "coast"
    assert shares["coast"] > 0.99
    assert sum(shares.values()) == pytest.approx(1)


def test_trajectories_that_effects_were_not_fitted_to_have_no_say_in_where_they_are_at_work() -> None:
    nominal_fit, hypothesis = coasting("viscous_drag", DRAG)
    nominal_fit.observations.fitted = torch.tensor([False])
    assert phase_shares([], nominal_fit, hypothesis) == {}


def test_a_contact_effect_is_never_at_work_in_free_fall_wherever_segments_end() -> None:
    """Impulses of a segment end with its last frame: the step to the next one, here at a hit, is simulated too."""
    nominal_fit, hypothesis = coasting("friction_drift", 0.5, frames=60, height=0.05, pieces=12)
    _, stepped = work_of(hypothesis)
    hit = int(stepped.impulse[0, 0].sum(-1).argmax())
    assert hit % 5 == 4, "the last frame of a segment"
    assert not bool(hypothesis.fit.jacobian.base.impulse[0, 0, hit].any())
    assert list(phase_shares([], nominal_fit, hypothesis)) == ["impact", "coast"]


@pytest.mark.parametrize(("name", "size"), [("observation_latency", 0.01), ("clock_rate", 0.1)])
def test_what_only_the_camera_sees_is_at_work_nowhere(name: str, size: float) -> None:
    assert phase_shares([Place("coast", "block", "x", 9.0, 1.0)], *coasting(name, size)) == {}


def test_where_nothing_is_named_the_squares_of_the_evidence_are_divided() -> None:
    places = [Place("coast", "block", dof, evidence, 0.0) for dof, evidence in (("x", 3.0), ("y", 4.0))]
    nominal_fit = cast(Any, SimpleNamespace(settings=Settings()))
    shares = phase_shares([*places, Place("impact", "block", "z", 5.0, 0.0)], nominal_fit, None)
    assert shares == pytest.approx({"coast": 0.5, "impact": 0.5})
    assert phase_shares([], nominal_fit, None) == {}


def test_a_place_has_the_root_of_what_its_force_gains_in_all_segments_that_count() -> None:
    cells = [
        SimpleNamespace(phase=phase, body=k, dof=dof) for k, (phase, dof) in enumerate([("rest", "x"), ("coast", "rz")])
    ]
    cells.append(SimpleNamespace(phase=None, body=0, dof="x"))
    gain = torch.tensor([[9.0, 16.0, 0.0, 100.0], [1.0, 2.0, 1.0, 0.0], [50.0, 0.0, 0.0, 0.0]]).double()
    counted = torch.tensor([True, True, True, False])
    lack: Any = SimpleNamespace(cells=cells, cell_gain=gain, counted=counted, excess=50.0)
    first, second = places(lack, ["block", "other"], 0.1)
    assert (first.phase, first.body, first.dof, second.phase, second.body) == ("rest", "block", "x", "coast", "other")
    assert (first.evidence, second.evidence) == pytest.approx((5.0, 2.0))
    assert (first.share, second.share) == pytest.approx((0.5, 0.08))
