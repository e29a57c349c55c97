"""What can be identified: the paper's three statements against closed forms and profile likelihoods."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import torch

from physid.cli import main
from physid.training.identifiability.planned_experiment import (
    IdentifiabilityConfig,
    IdentifiabilityResult,
    analyse,
    predict,
)
from physid.training.initial_states.elimination import slopes
from physid.training.learners.engine import Engine
from physid.training.parameters.identifiability import Identifiability, SensorNoise

CONFIGS = Path(__file__).parents[2] / "configs" / "identifiability"
BOTH = ("block.mass", "block.friction")
GRAVITY = 9.81
CLOSED_FORM = 2e-3  # relative: a block at rest starts a solver's smoothing away from sliding
OFFSET, PROFILE = 2e-3, 5e-3  # relative: a misfit over 0.2 % of a parameter is a parabola to 0.2 %
PUSH = IdentifiabilityConfig("push", BOTH, trajectories=4, steps=120)


def kinds(observed: IdentifiabilityResult) -> list[str]:
    """Return the verdicts in order."""
    return [verdict.kind for verdict in observed.result.verdicts()]


def closed_form(config: IdentifiabilityConfig) -> np.ndarray:
    """Return Fisher's information on ln(mass), ln(friction) of a block with x = v h + (f / m - mu g) h^2 / 2."""
    (block,) = config.build_scene().bodies
    information, step = np.zeros((2, 2)), config.build_scene().time_step
    for drawn in config.draw():
        force = np.linalg.norm(drawn.wrench[:-1, 0, 3:], axis=-1)
        weight = np.full_like(force, block.friction * GRAVITY)
        pushed = -np.cumsum(np.cumsum(force) - force / 2) * step**2 / block.mass
        held = -np.cumsum(np.cumsum(weight) - weight / 2) * step**2
        slope = np.pad(np.stack([pushed, held]), ((0, 0), (1, 0))) / config.noise.position
        if config.start == "estimated":
            line = np.vander(np.arange(slope.shape[1]), 2)
            slope = slope - np.linalg.lstsq(line, slope.T)[0].T @ line.T
        information += slope @ slope.T
    return information


@pytest.mark.parametrize("start", ["known", "estimated"])
def test_the_information_on_a_pushed_block_is_that_of_the_closed_form(start: Literal["known", "estimated"]) -> None:
    config = dataclasses.replace(PUSH, constant_force=(4.0, 8.0), start=start)
    wanted = closed_form(config)
    assert analyse(config).result.information.numpy() == pytest.approx(wanted, rel=CLOSED_FORM)


def test_one_constant_push_identifies_mass_and_friction_in_one_combination_only() -> None:
    observed = analyse(dataclasses.replace(PUSH, constant_force=(5.5, 5.5)))
    assert kinds(observed) == ["combination", "combination"]
    assert math.isinf(observed.result.condition)
    values, _, rows = observed.result.transposed()
    assert float(values[1] / values[0]) < 1e-5
    # The acceleration f / m - mu g answers to ln(m) by -f / m, and to ln(mu) by -mu g.
    ratio = 0.12 * GRAVITY / (5.5 / 2.0)
    assert float(rows[0, 1] / rows[0, 0]) == pytest.approx(ratio, rel=CLOSED_FORM)
    assert f"block.mass * block.friction^{ratio:.2f}" in str(observed.result.verdicts()[0])


@pytest.mark.parametrize(("learn", "kind"), [(("block.mass",), "identified"), (("block.friction",), "identified")])
def test_a_constant_push_identifies_mass_or_friction_if_the_other_is_known(learn: tuple[str, ...], kind: str) -> None:
    assert kinds(analyse(dataclasses.replace(PUSH, learn=learn, constant_force=(5.5, 5.5)))) == [kind]


def test_forces_redrawn_at_each_step_make_a_push_badly_conditioned_but_not_singular() -> None:
    result = analyse(dataclasses.replace(PUSH, trajectories=16, steps=300)).result
    assert -0.9999 < float(result.correlation[0, 1]) < -0.995
    assert 30 < result.condition < 150
    for verdict in result.verdicts():
        assert verdict.kind == "identified"
        assert 10 < verdict.deviation / verdict.alone < 50


def test_constant_pushes_of_different_strength_identify_mass_and_friction() -> None:
    drawn, spread = analyse(PUSH).result, analyse(dataclasses.replace(PUSH, constant_force=(4.0, 8.0))).result
    assert spread.condition < drawn.condition / 3


def test_a_slide_identifies_the_friction_and_nothing_about_the_mass() -> None:
    observed = analyse(IdentifiabilityConfig("slide", BOTH, trajectories=4, steps=120))
    assert kinds(observed) == ["unobservable", "identified"]
    mass, friction = observed.result.verdicts()
    assert math.isinf(mass.deviation)
    assert math.isinf(mass.alone)
    assert friction.deviation == pytest.approx(friction.alone)


def test_a_collision_with_a_block_of_known_mass_tells_both_under_one_constant_push() -> None:
    config = IdentifiabilityConfig("collide", BOTH, constant_force=(5.5, 5.5), trajectories=4, steps=120, segment=30)
    observed = analyse(config)
    assert kinds(observed) == ["identified", "identified"]
    assert observed.result.condition < 20


def test_four_times_the_noise_or_a_sixteenth_of_the_information_gives_four_times_the_deviation() -> None:
    result = analyse(PUSH).result
    noisy = analyse(dataclasses.replace(PUSH, noise=SensorNoise(4e-3, 4e-2))).result
    fewer = Identifiability(result.names, result.information / 16)
    for other in (noisy, fewer):
        for name, deviation in other.deviations.items():
            assert deviation == pytest.approx(4 * result.deviations[name])


@pytest.mark.parametrize("protocol", ["paper", "rich"])
@pytest.mark.parametrize("fixed", [0, 1])
def test_the_misfit_rises_by_the_square_of_the_expected_deviations_where_the_other_parameter_is_fitted_again(
    protocol: str, fixed: int
) -> None:
    config = dataclasses.replace(PUSH, protocol=protocol)
    deviation = list(analyse(config).result.deviations.values())[fixed]
    assert profile(config, fixed, OFFSET) == pytest.approx((OFFSET / deviation) ** 2, rel=PROFILE)


def test_the_misfit_stays_where_it_is_along_a_combination_that_nothing_is_known_about() -> None:
    config = dataclasses.replace(PUSH, constant_force=(5.5, 5.5))
    alone = analyse(config).result.verdicts()[0].alone
    assert profile(config, 0, OFFSET) < 1e-8 * (OFFSET / alone) ** 2


@torch.no_grad()
def profile(config: IdentifiabilityConfig, fixed: int, offset: float) -> float:
    """Return the misfit [sigma^2] with one parameter held off its optimum and the other one fitted again.

    Args:
        config: The experiment, of two parameters.
        fixed: Which parameter is held.
        offset: By how much, relative.
    """
    physical, layer = config.build_parameters(), Engine().layer(config.build_scene())
    recorded = predict(layer, physical, config.draw())
    scale = torch.tensor([1 / config.noise.rotation] * 3 + [1 / config.noise.position] * 3, dtype=torch.float64)
    physical.coordinates[fixed] += offset
    for _ in range(4):
        misfit = (recorded.residual(layer, physical()) * scale).flatten()
        slope = (slopes(layer, physical, recorded)[0][1 - fixed] * scale).flatten()
        physical.coordinates[1 - fixed] -= slope @ misfit / (slope @ slope)
    return float((recorded.residual(layer, physical()) * scale).square().sum())


def test_trajectories_whose_slope_depends_on_the_step_are_left_out() -> None:
    config = IdentifiabilityConfig("toss", ("block.friction", "block.restitution"), trajectories=4, steps=240)
    physical, layer = config.build_parameters(), Engine().layer(config.build_scene())
    _, usable = slopes(layer, physical, predict(layer, physical, config.draw()))
    assert 0 < int((~usable).sum()) <= 4
    assert "left out" in analyse(config).table()


def test_a_combination_of_three_names_its_parts_only() -> None:
    mixed, single = torch.tensor([1.0, 0.5, 0.0]), torch.tensor([0.0, 0.0, 1.0])
    seen = 1e3 * torch.stack([mixed, single]).double()
    result = Identifiability(("a.mass", "a.friction", "a.restitution"), seen.T @ seen)
    mass, friction, restitution = result.verdicts()
    assert mass.combination == friction.combination == "a.mass * a.friction^0.50"
    assert mass.combined == pytest.approx(1e-3)
    assert restitution.kind == "identified"
    assert restitution.deviation == pytest.approx(1e-3)


def test_nothing_is_known_without_any_trajectory() -> None:
    result = Identifiability(("a.mass", "a.friction"), torch.zeros(2, 2, dtype=torch.float64))
    assert [verdict.kind for verdict in result.verdicts()] == ["unobservable"] * 2
    assert math.isinf(result.condition)
    assert torch.isfinite(result.correlation).all()


@pytest.mark.slow
@pytest.mark.parametrize("file", sorted(path.name for path in CONFIGS.glob("*.yaml")))
def test_every_configuration_prints_a_table_and_leaves_figures_and_a_picture(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tiny = ["trajectories=2", "steps=40", f"--out={tmp_path}"]
    assert main(["identifiability", "--config", str(CONFIGS / file), *tiny]) == 0
    assert "verdict" in capsys.readouterr().out
    figures = json.loads((tmp_path / "identifiability.json").read_text())
    assert figures["config"]["trajectories"] == 2
    assert set(figures["verdicts"]) == set(figures["config"]["learn"])
    assert (tmp_path / "identifiability.png").stat().st_size > 1000


def test_a_fit_does_not_report_what_is_not_identifiable_without_a_warning(
    recordings: Callable[[str], Path], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = CONFIGS.parent / "sysid" / "slide_friction.yaml"
    tiny = [
        "trainer.max_epochs=1",
        "data.limit=2",
        f"data.folder={recordings('slide')}",
        f"--run-dir={tmp_path / 'run'}",
    ]
    assert main(["fit", "--config", str(file), *tiny, "model.learn=[block.mass]"]) == 0
    assert "do not rely on the estimate of block.mass: not at all" in caplog.text


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("scene=pusch", 'did you mean "push"'),
        ("protocol=poor", 'has no protocol "poor"'),
        ("learn=[block.mas]", 'did you mean "block.mass"'),
        ("learn=block.mass", "learn: expected a list such as [block.mass], found"),
        ("learn=[]", "learn must be a list of parameters such as [block.mass], got none"),
        ("learn=[block.restitution]", "must be positive, got 0.0; set it in values"),
        ("noise.position=0", "noise.position must be a number above 0"),
        ("noise.positon=1", 'did you mean "position"'),
        ("trajectories=0", "trajectories must be a whole number"),
        ("constant_force=[1,2,3]", "constant_force: expected a list of 2, found 3"),
        ("start=guessed", "start: expected 'known' or 'estimated', found 'guessed'"),
        ("segment=x", "segment: expected a whole number, found 'x'"),
        ("values=3", "values: expected a mapping, found 3"),
        ("protocl=rich", 'did you mean "protocol"'),
        ("accept=0", "accept must be a number above 0"),
    ],
)
def test_a_mistake_is_answered_in_one_line(override: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identifiability", "--config", str(CONFIGS / "push.yaml"), override]) == 2
    message = capsys.readouterr().err
    assert said in message
    assert message.count("\n") == 1


@pytest.mark.parametrize(("left", "kind"), [(4e-4, "combination"), (2e-3, "identified")])
def test_what_is_left_where_derivatives_cancel_identifies_nothing_however_little_noise_there_is(
    left: float, kind: str
) -> None:
    # Two derivatives at an angle of `left`; poses so exact that either parameter would be known to 1e-6.
    alone, between = 1e-6, math.sqrt(1 - left**2)
    information = torch.tensor([[1.0, between], [between, 1.0]], dtype=torch.float64) / alone**2
    for verdict in Identifiability(BOTH, information).verdicts():
        assert verdict.deviation == pytest.approx(alone / left, rel=1e-6)
        assert verdict.deviation < 0.05
        assert verdict.alone == pytest.approx(alone)
        assert verdict.kind == kind
        if kind == "combination":
            assert verdict.combination == "block.mass * block.friction"
            assert verdict.combined == pytest.approx(alone, rel=1e-4)
