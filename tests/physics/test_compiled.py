from __future__ import annotations

import logging

import pytest
import torch
from tests.physics.test_fused import GRADIENT, STATE, draw
from torch import Tensor

from physid.physics import Parameters, PhysicsLayer, State
from physid.physics.compiled import compile_or_not
from physid.physics.contact_problem import lcp
from physid.scenes import SETUPS, Setup

needs_cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")


def roll(setup: Setup, device: str, steps: int = 20) -> tuple[Tensor, Tensor]:
    """Return the poses of some trajectories, and the gradient of the last ones by friction."""
    case = draw(setup, 3, steps)
    given = {name: value.to(device) for name, value in case.tensors.items()}
    friction = given["friction"].requires_grad_()
    parameters = Parameters.of_boxes(given["size"], given["mass"], friction, given["restitution"])
    layer = PhysicsLayer(case.world, backend="reference")
    poses = layer.rollout(State(given["pose"], given["twist"]), given["wrench"], parameters).pose
    return poses.detach().cpu(), torch.autograd.grad(poses[:, -1].sum(), friction)[0].cpu()


@pytest.mark.slow
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
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of torch, of its own compiler
@pytest.mark.parametrize("setup", SETUPS, ids=lambda setup: setup.scene.name)
def test_a_gpu_gives_what_the_cpu_gives(setup: Setup) -> None:
    (pose, slope), (expected, wanted) = roll(setup, "cuda"), roll(setup, "cpu")
    torch.testing.assert_close(pose, expected, rtol=0, atol=STATE * float(expected.abs().max()))
    torch.testing.assert_close(slope, wanted, rtol=0, atol=GRADIENT * float(wanted.abs().max()))
