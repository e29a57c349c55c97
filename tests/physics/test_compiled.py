from __future__ import annotations

import logging

import numpy as np
import pytest
import torch
from torch import Tensor

from physid.physics import lcp
from physid.physics.compiled import compile_or_not
from physid.physics.layer import PhysicsLayer
from physid.physics.parameters import Parameters
from physid.physics.state import State
from physid.physics.world import Plane, World
from physid.scenes.catalogue import SETUPS
from physid.scenes.setup import Setup

needs_cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
STATE, GRADIENT = 1e-9, 1e-7


def roll(setup: Setup, device: str, steps: int = 20, batch: int = 3) -> tuple[Tensor, Tensor]:
    """Return the poses of some trajectories, and the gradient of the last ones by friction."""
    scene, generator = setup.scene, np.random.default_rng(0)
    drawn = [setup.draw(scene, "rich", generator, steps) for _ in range(batch)]
    pose, twist, wrench = (
        torch.stack([torch.as_tensor(getattr(one, name)) for one in drawn]).to(device)
        for name in ("pose", "twist", "wrench")
    )
    size, mass, friction = (
        torch.tensor([[getattr(body, name) for body in scene.bodies]], dtype=torch.float64, device=device)
        for name in ("size", "mass", "friction")
    )
    friction.requires_grad_()
    world = World(
        time_step=scene.time_step, gravity=scene.gravity, ground=Plane(scene.ground.normal, scene.ground.offset)
    )
    layer = PhysicsLayer(world, backend="reference")
    poses = layer.rollout(State(pose, twist), wrench, Parameters.of_boxes(size, mass, friction)).pose
    return poses.detach().cpu(), torch.autograd.grad(poses[:, -1].sum(), friction)[0].cpu()


def test_a_newton_step_is_one_graph_and_gives_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    setup = next(one for one in SETUPS if one.scene.name == "push")
    expected = roll(setup, "cpu", steps=3)
    step = torch.compile(lcp._Path.advance, backend="aot_eager", fullgraph=True)
    monkeypatch.setattr(lcp, "_newton_step", lambda compiled: step)
    for have, wanted in zip(roll(setup, "cpu", steps=3), expected, strict=True):
        torch.testing.assert_close(have, wanted, rtol=0, atol=STATE)


def test_what_cannot_be_compiled_runs_as_it_is_and_says_so_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(function: object) -> object:
        def call(*args: object) -> None:
            raise torch._dynamo.exc.BackendCompilerFailed(broken, RuntimeError("no compiler"), None)

        return call

    monkeypatch.setattr(torch, "compile", broken)
    seen: list[int] = []
    doubled = compile_or_not(seen.append, "the list")
    with caplog.at_level(logging.INFO):
        doubled(1)
        doubled(2)
    assert seen == [1, 2]
    (record,) = caplog.records
    assert record.getMessage().startswith("the list is not compiled, which is slower: ")


@needs_cuda
@pytest.mark.parametrize("setup", SETUPS, ids=lambda setup: setup.scene.name)
def test_a_gpu_gives_what_the_cpu_gives(setup: Setup) -> None:
    (pose, slope), (expected, wanted) = roll(setup, "cuda"), roll(setup, "cpu")
    torch.testing.assert_close(pose, expected, rtol=0, atol=STATE * float(expected.abs().max()))
    torch.testing.assert_close(slope, wanted, rtol=0, atol=GRADIENT * float(wanted.abs().max()))
