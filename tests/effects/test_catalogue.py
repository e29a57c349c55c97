"""Laws of every effect of the catalogue."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest
import torch
from torch import Tensor

from physid.effects import CATALOGUE, describe, find, from_values, laws
from physid.effects.probe import Probe, draw_probe
from physid.physics import Effect, Site, quantity

RELATIVE = 1e-5
STEP = 1e-6
DESIGN = [
    "force_gain",
    "force_dead_zone",
    "force_saturation",
    "force_delay",
    "force_lag",
    "force_misalignment",
    "force_offset",
    "viscous_drag",
    "quadratic_drag",
    "constant_force",
    "ground_tilt",
    "gravity_error",
    "tether",
    "com_offset",
    "inertia_scale",
    "mass_drift",
    "stribeck_friction",
    "anisotropic_friction",
    "body_anisotropic_friction",
    "friction_gradient",
    "friction_drift",
    "torsional_friction",
    "load_dependent_friction",
    "adhesion",
    "ground_restitution",
    "object_restitution",
    "object_friction",
    "contact_compliance",
    "length_scale",
    "camera_yaw",
    "camera_offset",
    "observation_latency",
    "observation_lag",
    "observation_smoothing",
    "clock_rate",
    "lens_distortion",
    "object_size",
]

each_effect = pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.name)


def test_the_catalogue_holds_what_was_promised() -> None:
    assert [effect.name for effect in CATALOGUE] == DESIGN


@each_effect
def test_an_effect_declares_name_site_formula_units_and_ranges(effect: type[Effect]) -> None:
    laws.declares_itself(effect)


@each_effect
def test_an_effect_of_null_size_changes_not_one_bit(effect: type[Effect]) -> None:
    laws.null_is_identity(effect)


@each_effect
def test_an_effect_shows_in_the_derivative_at_its_null_value(effect: type[Effect]) -> None:
    laws.derivative_at_null_shows(effect)


@each_effect
def test_a_batch_of_effects_equals_a_loop_over_them(effect: type[Effect]) -> None:
    laws.batch_equals_loop(effect)


@each_effect
@pytest.mark.parametrize("at", ["null", "typical"])
def test_the_derivative_is_the_limit_of_differences_from_a_side(effect: type[Effect], at: str) -> None:
    probe = draw_probe()
    start = {key: torch.tensor([getattr(q, at)], dtype=torch.float64) for key, q in effect.quantities().items()}
    for key, q in effect.quantities().items():
        step = STEP * (q.typical - q.null)
        value = start[key].clone().requires_grad_()
        total = _sum(probe, effect(**start | {key: value}))
        slope = torch.autograd.grad(total, value)[0]
        left, right = (
            (_sum(probe, effect(**start | {key: start[key] + shift})) - total) / shift for shift in (-step, step)
        )
        # Where poses are taken between frames the two sides differ, and one of them is meant.
        scale = float(slope.abs().max())
        assert any(
            torch.allclose(slope, each, RELATIVE, RELATIVE * scale) for each in (left, right, (left + right) / 2)
        )


@each_effect
def test_a_typical_effect_touches_what_its_site_allows_and_nothing_else(effect: type[Effect]) -> None:
    probe = draw_probe()
    before = probe.untouched()
    after = probe.show(from_values(effect.name, {key: q.typical for key, q in effect.quantities().items()}))
    changed = {name for name in before if not torch.equal(before[name], after[name])}
    allowed = {
        "actuation": {"actuate", "wrench"},
        "dynamics": {"wrench", "gravity", "mass", "inertia", "centre_of_mass"},
        "contact": {"wrench", "compliance"} | {f"{what}_{kind}" for what in ("ground", "body") for kind in PAIR},
        "perception": {"observe", "size", "inertia"},
    }
    assert changed
    assert changed <= allowed[effect.site]


PAIR = ("friction", "restitution")


@dataclass(frozen=True)
class _Broken(Effect):
    """F = c + 1, which is not zero at c = 0, and does not depend on d at all."""

    name: ClassVar[str] = "broken"
    site: ClassVar[Site] = "dynamics"
    c: Tensor = quantity("N", low=0.0, high=1.0, typical=0.5)

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        return wrench + (1 + self.c**2).mean()


def test_the_laws_catch_an_effect_that_breaks_them() -> None:
    with pytest.raises(ValueError, match="change nothing at its null"):
        laws.null_is_identity(_Broken)
    with pytest.raises(ValueError, match="other than zero"):
        laws.derivative_at_null_shows(_Broken)
    with pytest.raises(ValueError, match="each world of a batch by itself"):
        laws.batch_equals_loop(_Broken)


def test_an_effect_is_found_by_name_and_a_slip_is_answered_with_the_nearest() -> None:
    assert find("viscous_drag").name == "viscous_drag"
    with pytest.raises(ValueError, match='unknown effect "viscos_drag"; did you mean "viscous_drag"'):
        find("viscos_drag")


def test_an_effect_is_built_from_numbers_that_are_checked() -> None:
    assert float(from_values("viscous_drag", {"coefficient": 0.5}).values()["coefficient"]) == 0.5
    with pytest.raises(ValueError, match='did you mean "coefficient"'):
        from_values("viscous_drag", {"coeficient": 0.5})
    with pytest.raises(ValueError, match=r"viscous_drag.coefficient must lie between 0 and 5 \[N s/m\], got 500"):
        from_values("viscous_drag", {"coefficient": 500})
    with pytest.raises(ValueError, match="must be a finite number"):
        from_values("viscous_drag", {"coefficient": float("nan")})


def test_the_documented_table_is_the_catalogue() -> None:
    page = (Path(__file__).parents[2] / "docs" / "effects.md").read_text()
    for row in describe():
        line = f"| {row.parameter} | {row.unit} | {row.range} | {row.typical} |"
        assert line in page, f"docs/effects.md lacks {row.name}: {line}"
        assert f"`{row.name}`" in page


def _sum(probe: Probe, effect: Effect) -> Tensor:
    """Return one random sum of all that an effect changes."""
    source, before = torch.Generator().manual_seed(3), probe.untouched()
    changes = [shown - before[name] for name, shown in probe.show(effect).items()]
    return torch.stack(
        [(torch.rand(one.shape, generator=source, dtype=one.dtype) * one).sum() for one in changes]
    ).sum()
