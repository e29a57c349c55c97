"""Significant is not material: what a tolerance lets pass, and what it does not."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from physid.diagnosis.conclusion.judgement import minor_effects
from physid.diagnosis.document.document import Minor
from physid.diagnosis.selection.evidence import least_gain
from physid.diagnosis.selection.materiality import (
    Excess,
    Tolerance,
    excess_of,
    share_closed,
    unexplained_size,
)
from physid.diagnosis.settings.conclusion import MaterialitySettings
from physid.estimation.measurement.sensor_noise import Noise
from physid.scenes import find_setup

NOISE = Noise(rotation=4e-3, position=6e-4)
SCENE = find_setup("push").scene
FRAMES = (5, 200, 1)


def left(shift: float = 0.0, turn: float = 0.0) -> Any:
    """Return a hypothesis whose residuals are the noise and a constant error of one position and one rotation."""
    residual = NOISE.draw(1, torch.zeros(*FRAMES, 6, dtype=torch.float64), torch.Generator().manual_seed(0))[0]
    residual[..., 3] += shift
    residual[..., 2] += turn
    scale = (1 / NOISE.spread()).expand(*FRAMES, 6)
    return SimpleNamespace(experiment=SimpleNamespace(scale=scale), fit=SimpleNamespace(residual=residual))


ALL = [torch.ones(FRAMES[0], dtype=torch.bool)]


@pytest.mark.parametrize("factor", [0.01, 100.0])
def test_a_tolerance_is_a_share_of_the_noise_or_of_the_size_whichever_is_more(factor: float) -> None:
    settings, size = MaterialitySettings(), float(SCENE.sizes.max())
    noise = Noise(rotation=factor * settings.share_of_size, position=factor * settings.share_of_size * size)
    found = Tolerance.of(noise, SCENE, settings)
    if factor < 1:
        assert (found.position, found.rotation) == (settings.share_of_size * size, 2 * settings.share_of_size)
    else:
        expected = settings.share_of_noise * 3**0.5 * noise.position, settings.share_of_noise * 3**0.5 * noise.rotation
        assert (found.position, found.rotation) == pytest.approx(expected)


def test_noise_alone_is_within_the_tolerance() -> None:
    assert not Tolerance.of(NOISE, SCENE, MaterialitySettings()).exceeded(excess_of(left(), NOISE, ALL))


@pytest.mark.parametrize(("shift", "turn"), [(6e-4, 0.0), (0.0, 4e-3)])
def test_an_error_as_large_as_the_noise_is_material_in_positions_and_in_rotations(shift: float, turn: float) -> None:
    excess = excess_of(left(shift, turn), NOISE, ALL)
    assert Tolerance.of(NOISE, SCENE, MaterialitySettings()).exceeded(excess)
    assert max(abs(excess.position - shift), abs(excess.rotation - turn)) < 0.3 * max(shift, turn)


def test_frames_weigh_as_little_in_an_excess_as_numerics_disturb_them_more() -> None:
    scale = torch.full((1, 3, 1, 6), 1000.0, dtype=torch.float64)
    scale[0, 1], scale[0, 2] = 500.0, 0.0  # twice the deviation; not there
    residual = torch.zeros(1, 3, 1, 6, dtype=torch.float64)
    residual[0, :, 0, 3] = torch.tensor([0.01, 0.02, 0.04])
    hypothesis: Any = SimpleNamespace(experiment=SimpleNamespace(scale=scale), fit=SimpleNamespace(residual=residual))
    noise = Noise(rotation=4e-3, position=1e-3)
    square = (0.01**2 + 0.25 * 0.02**2 - 2 * noise.floor**2) / 1.25
    found = excess_of(hypothesis, noise, [torch.ones(1, dtype=torch.bool)])
    assert found.position == pytest.approx(square**0.5)
    assert found.rotation == 0.0


def test_a_tenth_of_a_millimetre_beside_noise_of_six_is_not_material() -> None:
    assert not Tolerance.of(NOISE, SCENE, MaterialitySettings()).exceeded(excess_of(left(1e-4), NOISE, ALL))


@pytest.mark.parametrize(("share", "material"), [(0.01, False), (1.0, True)])
def test_what_a_better_model_would_move_counts_although_few_held_out_trajectories_do_not_show_it(
    share: float, material: bool
) -> None:
    lack: Any = SimpleNamespace(missing=share**2 * 100.0, frames=100.0)
    size = unexplained_size(lack, NOISE)
    assert size == pytest.approx(share * NOISE.position)
    assert (size > Tolerance.of(NOISE, SCENE, MaterialitySettings()).position) is material


def test_a_given_tolerance_decides() -> None:
    excess = excess_of(left(6e-4), NOISE, ALL)
    assert Tolerance.of(NOISE, SCENE, MaterialitySettings(tolerance=5e-4)).exceeded(excess)
    assert not Tolerance.of(NOISE, SCENE, MaterialitySettings(tolerance=2e-3)).exceeded(excess)


def test_no_tolerance_at_all_is_refused() -> None:
    with pytest.raises(ValueError, match="greater than 0"):
        Tolerance.of(NOISE, SCENE, MaterialitySettings(tolerance=0.0))


def test_half_the_error_left_closes_three_quarters_of_the_mean_square() -> None:
    assert share_closed(Excess(2e-3, 0.0), Excess(1e-3, 0.0)) == pytest.approx(0.75)
    assert share_closed(Excess(0.0, 2e-2), Excess(0.0, 0.0)) == pytest.approx(1.0)


def fitted(noise: Noise) -> Any:
    """Return a nominal fit, as far as a tolerance looks at it."""
    settings = SimpleNamespace(materiality=MaterialitySettings())
    return SimpleNamespace(noise=noise, observations=SimpleNamespace(scene=SCENE), settings=settings)


@pytest.mark.parametrize("frames", [100.0, 4000.0])
@pytest.mark.parametrize("noise", [NOISE, Noise(rotation=1e-3, position=6e-4), Noise(rotation=4e-3, position=1e-4)])
def test_an_effect_beside_others_counts_where_it_moves_predictions_by_the_tolerance(
    frames: float, noise: Noise
) -> None:
    allowed, least = Tolerance.of(noise, SCENE, MaterialitySettings()), frames * least_gain(fitted(noise))
    moved = [frames * (allowed.position / noise.position) ** 2, frames * (allowed.rotation / noise.rotation) ** 2]
    assert least == pytest.approx(min(moved))
    single: Any = SimpleNamespace(missing=least, frames=frames)
    assert unexplained_size(single, noise) <= allowed.position * (1 + 1e-12), "as small as what is not blamed alone"


@pytest.mark.parametrize(("share", "listed"), [(0.99, True), (1.01, False)])
def test_what_is_significant_beside_a_cause_is_minor_below_the_tolerance(share: float, listed: bool) -> None:
    frames = 500.0
    missing = share * frames * (Tolerance.of(NOISE, SCENE, MaterialitySettings()).position / NOISE.position) ** 2
    row = SimpleNamespace(names=("tether",), gain=missing, p_value=0.004)
    left = SimpleNamespace(significant=[row], missing=missing, frames=frames)
    every = torch.ones(2, dtype=torch.bool)
    nominal: Any = SimpleNamespace(
        held_out=torch.tensor([3.0, 1.0]) * missing, experiment=SimpleNamespace(fitted=every)
    )
    chosen: Any = SimpleNamespace(held_out=torch.tensor([0.5, 0.5]) * missing, experiment=nominal.experiment)
    found: Any = SimpleNamespace(left=left, nominal=nominal)
    said = minor_effects(fitted(NOISE), found, chosen)
    assert said == ((Minor(("tether",), 0.004, pytest.approx(0.25)),) if listed else ())
    assert minor_effects(fitted(NOISE), found, None) == (), "nothing is blamed"
    left.significant = []
    assert minor_effects(fitted(NOISE), found, chosen) == ()
