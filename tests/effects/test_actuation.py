"""Effects of actuation against closed forms."""

import math
from itertools import pairwise

import pytest
import torch
from torch import Tensor

from physid.effects import from_values
from physid.effects.actuation.force_saturation import ForceSaturation
from physid.effects.probe import draw_probe

TOLERANCE = 1e-12
H = 1 / 240


def along_x(force: list[float]) -> Tensor:
    """Return wrenches (1, T, 1, 6) of forces along x."""
    wrench = torch.zeros(1, len(force), 1, 6, dtype=torch.float64)
    wrench[0, :, 0, 3] = torch.tensor(force)
    return wrench


def clock(command: Tensor) -> Tensor:
    """Return even times of the rows (1, T) [s]."""
    return H * torch.arange(command.shape[1], dtype=torch.float64)[None]


def acting(name: str, value: dict[str, float], command: Tensor) -> Tensor:
    """Return the force along x (T,) that acts."""
    return from_values(name, value).actuate(command, clock(command))[0, :, 0, 3]


def test_a_gain_scales_the_command() -> None:
    assert torch.allclose(acting("force_gain", {"gain": 0.5}, along_x([2.0, -4.0])), torch.tensor([3.0, -6.0]).double())


def test_a_dead_zone_swallows_small_forces_and_shortens_large_ones() -> None:
    force = acting("force_dead_zone", {"width": 1.0}, along_x([5.0, 1.0, -0.5, 0.0, -3.0]))
    assert torch.allclose(force, torch.tensor([4.0, 0.0, 0.0, 0.0, -2.0]).double(), atol=TOLERANCE)


def test_a_saturated_force_tends_to_its_limit_and_passes_when_small() -> None:
    effect = ForceSaturation(torch.tensor([16.0], dtype=torch.float64))
    assert float(effect.limit) == pytest.approx(5.0)
    force = acting("force_saturation", {"compression": 16.0}, along_x([0.1, 500.0]))
    assert torch.allclose(force, torch.tensor([0.1, 5.0]).double(), rtol=1e-6)


@pytest.mark.parametrize("steps", [1, 3, 7])
def test_a_delay_of_whole_steps_shifts_the_command(steps: int) -> None:
    command = along_x([1.0, 2.0, 4.0, 8.0, 16.0])
    wanted = torch.cat([torch.zeros(steps), command[0, :, 0, 3]])[:5].double()
    assert torch.allclose(acting("force_delay", {"delay": steps * H}, command), wanted, atol=1e-9)


def test_a_delay_of_half_a_step_gives_the_mean_of_two_commands() -> None:
    force = acting("force_delay", {"delay": 0.5 * H}, along_x([2.0, 4.0, 4.0]))
    assert torch.allclose(force, torch.tensor([1.0, 3.0, 4.0]).double())


@pytest.mark.parametrize("tau", [1e-4, 0.01, 0.1])
def test_a_lagging_force_builds_up_exponentially(tau: float) -> None:
    """The mean of 1 - exp(-t / tau) over step k, against the filter."""
    force = acting("force_lag", {"time_constant": tau}, along_x([1.0] * 20))
    edges = [math.exp(-k * H / tau) for k in range(21)]
    wanted = [1 - tau / H * (a - b) for a, b in pairwise(edges)]
    assert torch.allclose(force, torch.tensor(wanted).double(), atol=TOLERANCE)


def test_a_lag_and_a_delay_of_equal_size_lose_the_same_impulse() -> None:
    command = along_x([1.0] * 200)
    lost = [200 - acting(*each, command).sum() for each in DELAYED]
    assert torch.allclose(lost[0], lost[1], atol=1e-6)


DELAYED = (("force_lag", {"time_constant": 0.03}), ("force_delay", {"delay": 0.03}))


def test_a_misaligned_pusher_turns_force_and_torque() -> None:
    wrench = torch.tensor([0.0, 1.0, 5.0, 2.0, 0.0, 7.0], dtype=torch.float64).reshape(1, 1, 1, 6)
    turned = from_values("force_misalignment", {"angle": math.pi / 6}).actuate(wrench, clock(wrench)).flatten()
    c, s = math.cos(math.pi / 6), 0.5
    assert torch.allclose(turned, torch.tensor([-s, c, 5.0, 2 * c, 2 * s, 7.0], dtype=torch.float64))


def test_an_offset_force_turns_the_body_about_an_arm_that_goes_with_it() -> None:
    probe = draw_probe()
    half_turn = torch.tensor([0.0, 0.0, 1.0, 0.0], dtype=torch.float64)
    pose = torch.cat([probe.state.position, half_turn.expand(3, 2, 4)], -1)
    force = torch.tensor([0.0, 0.0, 0.0, 0.0, 2.0, 0.0], dtype=torch.float64).expand(3, 2, 6)
    inputs = probe.inputs.replace(wrench=force)
    torque = from_values("force_offset", {"x": 0.1}).act(probe.state.replace(pose=pose), inputs).wrench[..., :3]
    assert torch.allclose(torque, torch.tensor([0.0, 0.0, -0.2], dtype=torch.float64).expand(3, 2, 3))


@pytest.mark.parametrize(("name", "value"), [("force_delay", {"delay": 0.013}), ("force_lag", {"time_constant": 0.02})])
def test_what_is_late_does_not_depend_on_how_held_forces_are_cut_into_steps(name: str, value: dict[str, float]) -> None:
    source = torch.Generator().manual_seed(0)
    length = 0.002 + 0.02 * torch.rand(12, generator=source, dtype=torch.float64)
    force = 10 * torch.rand(12, generator=source, dtype=torch.float64)
    parts = torch.randint(1, 6, (12,), generator=source)
    fine = (length / parts).repeat_interleave(parts)
    effect, late = from_values(name, value), []
    for lengths, forces in ((length, force), (fine, force.repeat_interleave(parts))):
        time = (lengths.cumsum(0) - lengths)[None]
        late.append(effect.actuate(along_x(forces.tolist()), time)[0, :, 0, 3] * lengths)
    ends = parts.cumsum(0)
    summed = torch.stack([part.sum() for part in late[1].tensor_split(ends[:-1])])
    # The last row of either is held as long as the row before it.
    assert torch.allclose(summed[:-1], late[0][:-1], atol=TOLERANCE)
