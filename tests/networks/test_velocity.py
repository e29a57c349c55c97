import pytest
import torch

from physid.networks.symmetry import Symmetry
from physid.networks.velocity import velocity_from_poses
from physid.physics import Parameters
from physid.physics.rotations import exponential, multiply

TOLERANCE = 1e-9
STEP = 1 / 240
NO_LIMIT = (float("inf"), float("inf"))
MASS = torch.tensor([[1.5, 0.8]], dtype=torch.float64)
SIZE = torch.tensor([[[0.2, 0.3, 0.25], [0.2, 0.2, 0.2]]], dtype=torch.float64)
PARAMETERS = Parameters.of_boxes(SIZE, MASS, torch.zeros_like(MASS))


def drawn(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def unturned(position: torch.Tensor) -> torch.Tensor:
    turn = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=torch.float64).expand(*position.shape[:-1], 4)
    return torch.cat([position, turn], -1)


def stepped(velocity: torch.Tensor, force: torch.Tensor, substeps: int | None) -> tuple[torch.Tensor, torch.Tensor]:
    """Positions and velocities (B, S + 1, N, 3) under forces (B, S, N, 3), exactly or by a semi-implicit integrator."""
    position, states = drawn(*velocity.shape, seed=5), []
    for acceleration in (force / MASS[:, None, :, None]).unbind(1):
        states.append((position, velocity))
        for _ in range(substeps or 1):
            h = STEP / (substeps or 1)
            half = acceleration * h / 2 if substeps is None else 0.0
            velocity = velocity + acceleration * h
            position = position + (velocity - half) * h
    states.append((position, velocity))
    return torch.stack([p for p, _ in states], 1), torch.stack([v for _, v in states], 1)


@pytest.mark.parametrize("at", [0, 1, 2])
@pytest.mark.parametrize("stride", [1, 4])
@pytest.mark.parametrize("substeps", [None, 1, 3])
def test_known_forces_make_it_exact_for_either_kind_of_motion(at: int, stride: int, substeps: int | None) -> None:
    force = 5 * drawn(3, 2 * stride, 2, 3)
    position, velocity = stepped(drawn(3, 2, 3, seed=1), force, substeps)
    wrench = torch.cat([torch.zeros_like(force), force], -1)
    estimate = velocity_from_poses(unturned(position[:, ::stride]), wrench, PARAMETERS, STEP, at=at, substeps=substeps)
    assert torch.allclose(estimate.twist[..., 3:], velocity[:, at * stride], atol=TOLERANCE)
    assert estimate.twist[..., :3].abs().max() < TOLERANCE
    assert estimate.disagreement.max() < TOLERANCE


def test_it_is_equation_four_of_the_paper_for_two_frames_under_constant_force() -> None:
    force = drawn(1, 1, 2, 3).expand(1, 2, 2, 3)
    position, _ = stepped(drawn(1, 2, 3, seed=1), force, None)
    expected = (position[:, 2] - position[:, 1]) / STEP + force[:, 0] / (2 * MASS[..., None]) * STEP
    wrench = torch.cat([torch.zeros_like(force), force], -1)
    twist = velocity_from_poses(unturned(position), wrench, PARAMETERS, STEP, at=2).twist
    assert torch.allclose(twist[..., 3:], expected, atol=TOLERANCE)


@pytest.mark.parametrize("at", [0, 1, 2])
def test_a_spin_about_a_fixed_axis_under_torque_is_found_exactly(at: int) -> None:
    speed, torque = 3.0, 0.02
    acceleration = torque / PARAMETERS.inertia[0, :, 2]
    time = STEP * torch.arange(3, dtype=torch.float64)[:, None]
    angle = 2.9 + speed * time + acceleration * time**2 / 2  # passes half a turn
    zero = torch.zeros_like(angle)
    pose = torch.cat([torch.zeros(3, 2, 3), exponential(torch.stack([zero, zero, angle], -1))], -1)[None]
    wrench = torch.zeros(1, 2, 2, 6, dtype=torch.float64)
    wrench[..., 2] = torque
    twist = velocity_from_poses(pose, wrench, PARAMETERS, STEP, at=at).twist[0]
    assert torch.allclose(twist[:, 2], speed + acceleration * time[at], atol=TOLERANCE)
    assert twist[:, [0, 1, 3, 4, 5]].abs().max() < TOLERANCE


def test_a_constant_angular_velocity_about_any_axis_is_found_in_world_axes() -> None:
    spin, start = 4 * drawn(1, 2, 3), exponential(drawn(1, 2, 3, seed=2))
    turns = torch.stack([multiply(exponential(spin * STEP * k), start) for k in range(3)], 1)
    pose = torch.cat([torch.zeros(1, 3, 2, 3), turns], -1)
    twist = velocity_from_poses(pose, torch.zeros(1, 2, 2, 6).double(), PARAMETERS, STEP, at=1).twist
    assert torch.allclose(twist[..., :3], spin, atol=TOLERANCE)


@pytest.mark.parametrize(("at", "hit"), [(0, 1), (2, 0)])
def test_a_collision_in_the_other_interval_does_no_harm(at: int, hit: int) -> None:
    before, after = torch.tensor([1.0, 0.0, 0.0]).double(), torch.tensor([-0.5, 0.2, 0.0]).double()
    first, second = (before, (before + after) / 2) if hit == 1 else ((before + after) / 2, after)
    position = torch.stack([0 * first, STEP * first, STEP * (first + second)]).expand(1, 2, 3, 3).transpose(1, 2)
    estimate = velocity_from_poses(unturned(position), torch.zeros(1, 2, 2, 6).double(), PARAMETERS, STEP, at=at)
    assert torch.allclose(estimate.twist[..., 3:], before if at == 0 else after, atol=1e-2)
    assert torch.allclose(estimate.disagreement[..., 1], (second - first).norm().expand(1, 2), atol=TOLERANCE)


def test_averaging_halves_the_noise_of_a_single_interval() -> None:
    noise, zero = 1e-5, torch.zeros(4000, 2, 2, 6).double()
    pose = unturned(noise * drawn(4000, 3, 2, 3))
    twist = velocity_from_poses(pose, zero, PARAMETERS, STEP).twist[..., 3:]
    single = ((pose[:, 1] - pose[:, 0])[..., :3] / STEP).std()
    assert twist.std() / single == pytest.approx(0.5, abs=0.02)


def test_turns_that_cannot_be_seen_do_not_count_as_motion() -> None:
    angle = torch.tensor([0.0, torch.pi / 2 + 0.01, torch.pi + 0.02], dtype=torch.float64)
    turn = exponential(torch.stack([0 * angle, 0 * angle, angle], -1))
    pose = torch.cat([torch.zeros(3, 3).double(), turn], -1)[None, :, None].expand(-1, -1, 2, -1)
    zero = torch.zeros(1, 2, 2, 6).double()
    twist = velocity_from_poses(pose, zero, PARAMETERS, STEP, symmetries=[Symmetry.SQUARE] * 2).twist
    assert torch.allclose(twist[..., 2], torch.full((1, 2), 0.01 / STEP).double(), atol=TOLERANCE)


def test_gradients_reach_poses_forces_and_masses() -> None:
    pose, wrench = unturned(1e-4 * drawn(2, 3, 2, 3)), drawn(2, 2, 2, 6)
    mass = MASS.clone().requires_grad_()

    def speed(pose: torch.Tensor, wrench: torch.Tensor, mass: torch.Tensor) -> torch.Tensor:
        return velocity_from_poses(pose, wrench, PARAMETERS.replace(mass=mass), 1.0, tolerance=NO_LIMIT).twist

    assert torch.autograd.gradcheck(speed, (pose.requires_grad_(), wrench.requires_grad_(), mass))


@pytest.mark.parametrize(
    ("frames", "forces", "at", "complaint"),
    [(2, 2, 0, "pose must have shape"), (3, 3, 0, "even number"), (3, 0, 0, "even number"), (3, 2, 3, "at must be")],
)
def test_what_cannot_be_meant_is_refused(frames: int, forces: int, at: int, complaint: str) -> None:
    pose, wrench = unturned(drawn(1, frames, 2, 3)), drawn(1, forces, 2, 6)
    with pytest.raises(ValueError, match=complaint):
        velocity_from_poses(pose, wrench, PARAMETERS, STEP, at=at)
