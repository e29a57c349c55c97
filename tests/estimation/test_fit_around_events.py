"""Fits to segments that are cut around impacts: a block that is dropped, found again with its bounce and friction."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physid.estimation.prediction import NominalModel, Predictor, Segmentation, Timeline, Variants
from physid.estimation.segmented_fit import (
    Observed,
    SegmentedFit,
    SegmentedFitSettings,
    fit_around_events,
    fit_short_segments,
    fit_with_chosen_steps,
    tumbles,
    weighed,
)
from physid.physics.rotations import exponential, multiply
from physid.scenes import find_setup

STEP, FRAMES, G = 1 / 120, 48, 9.81
SCENE = replace(find_setup("toss").scene, time_step=STEP, integration=None, unknown=("block.restitution",))
HALF = SCENE.bodies[0].size[2] / 2
PARTS = 8
SPREAD = (3e-3, 5e-4)  # [rad, m]
FELL, HEIGHT = 20, G / 2 * (19.5 * STEP) ** 2  # it lands between the frames 19 and 20


def dropped(lean: float = 0.0) -> tuple[Observed, Predictor]:
    """Return what a noisy camera sees of two blocks that are dropped, and the model with a wrong restitution."""
    timeline = Timeline.regular(torch.zeros(2, FRAMES, 1, 6).double(), STEP)
    whole, true = Segmentation.equal(2, FRAMES, FRAMES), NominalModel(SCENE)
    pose, twist = torch.zeros(1, 2, 1, 7).double(), torch.zeros(1, 2, 1, 6).double()
    pose[..., 2], pose[..., 0] = HALF + HEIGHT, torch.tensor([[0.5], [-0.8]])
    pose[..., 3:] = exponential(torch.tensor([lean, 0.0, 0.0]).double())
    none = torch.zeros(1, 0).double()
    fine = Predictor(true, timeline.refined(PARTS), whole)
    seen = fine.predict(Variants.of_states(pose, twist, true.guess[None], none)).pose[0]
    off = torch.randn(2, FRAMES, 1, 6, generator=torch.Generator().manual_seed(0)).double()
    off = off * torch.tensor([SPREAD[0]] * 3 + [SPREAD[1]] * 3)
    seen = torch.cat([seen[..., :3] + off[..., 3:], multiply(exponential(off[..., :3]), seen[..., 3:])], -1)
    seen[1, 7, 0, 0] += 0.3  # no motion explains it
    present = torch.ones(2, FRAMES, 1).double()
    present[0, -3:] = 0.0
    guess = replace(SCENE, bodies=(replace(SCENE.bodies[0], restitution=0.45),))
    observed = Observed(seen, present, timeline, torch.tensor([True, True]))
    return observed, Predictor(NominalModel(guess), timeline.refined(PARTS), whole)


SETTINGS = SegmentedFitSettings()


def restitution(found: SegmentedFit) -> float:
    return float(found.experiment.predictor.model.to_values(found.fit.point.nominal))


@pytest.fixture(scope="module")
def short() -> SegmentedFit:
    return fit_short_segments(*dropped(), SETTINGS)


@pytest.fixture(scope="module")
def landed(short: SegmentedFit) -> SegmentedFit:
    return fit_around_events(short, SETTINGS)


def test_short_segments_show_the_noise_and_no_pose_that_no_motion_explains(short: SegmentedFit) -> None:
    assert short.observed.present[1, 7] == 0 == short.observed.present[0, -1]
    assert float(short.observed.present.sum()) == 2 * FRAMES - 4
    assert int(short.experiment.predictor.segments.size.max()) <= SETTINGS.first_guess.length(STEP)
    assert not bool(short.events.any())
    assert short.noise.position == pytest.approx(SPREAD[1], rel=0.2)
    assert short.noise.rotation == pytest.approx(SPREAD[0], rel=0.2)
    first = (1 / SETTINGS.rounds.first_rotation_noise, 1 / SETTINGS.rounds.first_position_noise)
    scale = short.experiment.scale
    assert scale[0, 0, 0].tolist() == pytest.approx([first[0]] * 3 + [first[1]] * 3)
    assert not bool(scale[1, 7].any())


@pytest.mark.parametrize("robust", [False, True])
def test_short_segments_are_fitted_without_a_frame_that_stands_alone_off_them(robust: bool) -> None:
    observed, predictor = dropped()
    observed.pose[0, 9, 0, 1] += 24 * SPREAD[1]  # 12 mm, as some motion between two frames explains
    rounds = SETTINGS.rounds.model_copy(update={"robust": robust})
    found = fit_short_segments(observed, predictor, SETTINGS.model_copy(update={"rounds": rounds})).observed.present
    assert bool(found[0, 9]) is not robust
    assert float(found.sum()) == 2 * FRAMES - 4 - robust


def test_a_dropped_block_is_cut_around_its_landing_and_its_bounce_is_found(landed: SegmentedFit) -> None:
    segments = landed.experiment.predictor.segments
    contact = segments.spread(segments.contact)
    assert bool(landed.events[:, FELL - 1 : FELL + 2].any(1).all())
    assert not bool(landed.events[:, :15].any())
    assert bool(contact[:, FELL].all())
    assert not bool(contact[:, 0].any()), "it falls freely"
    assert restitution(landed) == pytest.approx(SCENE.bodies[0].restitution, rel=0.05)
    assert bool((landed.fit.loss < 1.5 * landed.experiment.counted()).all())
    assert torch.allclose(landed.experiment.scale[0, 0, 0, 3:], torch.full((3,), 1 / landed.noise.position).double())
    assert landed.steps is None
    assert not bool(tumbles(landed, SETTINGS).any())


def test_steps_are_chosen_where_a_fit_stands_and_noise_and_frames_are_weighed_anew(landed: SegmentedFit) -> None:
    found = fit_with_chosen_steps(landed, SETTINGS)
    assert found.steps is not None
    assert found.steps.bias <= SETTINGS.steps.bias
    predictor = found.experiment.predictor
    assert predictor.timeline is found.steps.timeline
    assert predictor.late is not None
    assert torch.equal(predictor.late.grid.steps, predictor.timeline.grid.steps), "nothing acts late"
    assert found.noise.position == pytest.approx(SPREAD[1], rel=0.2)
    assert restitution(found) == pytest.approx(SCENE.bodies[0].restitution, rel=0.05)
    assert torch.equal(found.observed.present, landed.observed.present)


@pytest.mark.parametrize("robust", [False, True])
def test_a_frame_that_stands_alone_counts_less_only_if_that_is_asked_for(robust: bool, landed: SegmentedFit) -> None:
    observed, fit = landed.observed, landed.fit
    off = fit.residual.clone()
    off[0, 8, 0, 4] += 5 * SPREAD[1]
    noise, experiment = weighed(
        landed.experiment, replace(fit, residual=off), observed.present, None, SETTINGS.noise, robust=robust
    )
    assert noise.position == pytest.approx(SPREAD[1], rel=0.2)
    share = (experiment.scale * noise.spread()).square()
    assert torch.allclose(share, share[..., :1].expand_as(share))
    assert bool((share[0, 8] < 0.9).all()) is robust
    assert not bool(share[1, 7].any())
    assert bool((share[..., 0].le(observed.present + 1e-12)).all())
    if not robust:
        assert torch.allclose(share[..., 0], observed.present)


@pytest.mark.parametrize(("lean", "edge"), [(0.0, False), (0.5, True)])
def test_a_block_that_lands_on_an_edge_tumbles_and_one_that_lands_flat_does_not(lean: float, edge: bool) -> None:
    first = fit_short_segments(*dropped(lean), SETTINGS)
    assert tumbles(first, SETTINGS).tolist() == [edge] * 2
    blind = replace(first, observed=replace(first.observed, present=0 * first.observed.present))
    assert not bool(tumbles(blind, SETTINGS).any()), "where nothing is seen nothing tumbles"
