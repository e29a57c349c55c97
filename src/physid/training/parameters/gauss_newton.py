"""Gauss-Newton with Levenberg's damping, for the handful of physical parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, final

import torch
from torch import Tensor, nn
from torch.optim import Optimizer

from physid.physics import SolverError

Closure = Callable[[], Any]
Quadratic = Callable[[], tuple[Tensor, Tensor]]
HALVED = 1.0
"""Damping that halves a step: less would try a step that has made the loss worse almost as it was."""
TRIES = 8
"""How often a step to where the physics has no solution is shortened."""


@final
class GaussNewton(Optimizer):
    """Minimise a sum of squares: x <- x - (H + damping diag H)^-1 g, one try per step.

    g is the exact gradient, from the closure; H = 2 J^T J only shapes the step, so J may come from differences. A
    step that has made the loss worse is taken back, and tried again from there with ten times the damping (Marquardt
    1963) and at most half as long; one that has not makes it ten times smaller. A point at which the physics has no
    solution counts as worse.

    No step promises more than the whole loss: with g = 2 J^T r, g^T H^-1 g / 2 = r^T J (J^T J)^-1 J^T r <= r^T r. Where
    dry friction bends the loss, or a body just touches another, the exact gradient of one point may be far from 2 J^T
    r, which is taken in its place where it promises more than that.

    Args:
        params: One tensor of parameters.
        damping: First damping, relative to the diagonal of H.
        max_step: Largest change of one parameter in a step, in its own unit.

    Raises:
        ValueError: If there is more than one tensor, or a setting is not positive.
    """

    def __init__(self, params: Iterable[nn.Parameter], damping: float = 1e-3, max_step: float = 1.0) -> None:
        if not (damping > 0 and max_step > 0):
            raise ValueError(f"damping and max_step must be positive, got {damping} and {max_step}")
        super().__init__(params, {"damping": damping, "max_step": max_step})
        if [len(group["params"]) for group in self.param_groups] != [1]:
            raise ValueError("GaussNewton takes one tensor, the physical parameters; use Adam for networks")

    def step(
        self,
        closure: Closure | None = None,
        quadratic: Quadratic | None = None,
        ends: tuple[Tensor, Tensor] | None = None,
    ) -> Any:
        """Judge the last step, and take the next.

        Args:
            closure: Computes the loss and its gradient.
            quadratic: Computes H (P, P) and 2 J^T r (P,) at the point where the closure was just evaluated.
            ends: Least and largest values, shape (P,) each; None where there are none. What a step would lead beyond
                an end stays there, and the others take the step that is best then.

        Returns:
            The loss before the step.

        Raises:
            ValueError: If closure or quadratic is missing.
        """
        if closure is None or quadratic is None:
            raise ValueError("GaussNewton needs a closure and the loss near by; SysID gives both")
        group = self.param_groups[0]
        parameter = group["params"][0]
        state = self.state[parameter]
        with torch.enable_grad():
            loss = self._evaluate(closure, parameter, ends)
        now = torch.as_tensor(loss).detach().double()
        if state and not now <= state["loss"]:
            state["damping"] = max(state["damping"] * 10, HALVED)
        else:
            damping = max(state["damping"] / 10, 1e-9) if state else group["damping"]
            curvature, slope = quadratic()
            gradient = parameter.grad.detach().clone()
            if _promised(gradient, curvature) > float(now):
                gradient = slope.to(gradient).reshape(gradient.shape)
            state.update(
                point=parameter.detach().clone(), loss=now, gradient=gradient, curvature=curvature, damping=damping
            )
        with torch.no_grad():
            parameter.copy_(state["point"] + _damped_step(state, group["max_step"], ends))
        return loss

    def take_back(self) -> None:
        """Go back to the point of the least loss so far, and begin anew from there: the loss will be another one."""
        for parameter, state in self.state.items():
            with torch.no_grad():
                parameter.copy_(state["point"])
        self.state.clear()

    def judge_last(self, values: Callable[[Tensor], Tensor]) -> None:
        """Judge the last step, where no other follows: go back to the best point if it has not made the loss less.

        Args:
            values: Computes the losses (K,) at points (K, P).
        """
        for parameter, state in self.state.items():
            try:
                loss = float(values(parameter.detach()[None])[0])
            except SolverError:
                loss = math.inf
            if not loss < float(state["loss"]):
                with torch.no_grad():
                    parameter.copy_(state["point"])

    def _evaluate(self, closure: Closure, parameter: Tensor, ends: tuple[Tensor, Tensor] | None) -> Any:
        """Return the loss; where the physics has no solution, after a step too long, that of a shorter one."""
        state, longest = self.state[parameter], self.param_groups[0]["max_step"]
        for _ in range(TRIES):
            try:
                return closure()
            except SolverError:
                if not state:
                    raise
                state["damping"] = state["damping"] * 10
                with torch.no_grad():
                    parameter.copy_(state["point"] + _damped_step(state, longest, ends))
        return closure()


def _promised(gradient: Tensor, curvature: Tensor) -> float:
    """Return by how much a step without damping shall make the loss fall, g^T H^-1 g / 2."""
    found = gradient.reshape(-1)
    return float(found @ torch.linalg.solve(_damped(curvature, 0.0), found)) / 2


def _damped(curvature: Tensor, damping: float) -> Tensor:
    """Return H + damping diag H. A parameter without any influence has a zero row: it stays where it is."""
    diagonal = curvature.diagonal()
    floor = torch.finfo(curvature.dtype).tiny + 1e-9 * diagonal.max()
    return curvature + torch.diag(damping * diagonal + floor)


def _damped_step(state: dict[str, Any], max_step: float, ends: tuple[Tensor, Tensor] | None) -> Tensor:
    """Solve (H + damping diag H) x = -g within the ends; shorten what promises too much or exceeds `max_step`."""
    damped, gradient = _damped(state["curvature"], state["damping"]), state["gradient"]
    step: Tensor = torch.linalg.solve(damped, -gradient.reshape(-1))
    if ends is not None:
        step = _bounded(
            damped, gradient.reshape(-1), step, *(end.to(step) - state["point"].reshape(-1) for end in ends)
        )
    step = step.reshape(gradient.shape)
    promised = float(step.reshape(-1) @ (damped @ step.reshape(-1))) / 2
    step = step * min(1.0, math.sqrt(float(state["loss"]) / promised) if promised > 0 else 1.0)
    return step * min(1.0, max_step / max(float(step.abs().max()), 1e-300))


def _bounded(matrix: Tensor, gradient: Tensor, step: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """Return the step (P,) that is best where some components are held at the ends that they would pass."""
    held = torch.zeros_like(step, dtype=torch.bool)
    while bool(((step < low) | (step > high))[~held].any()):
        held = held | (step < low) | (step > high)
        step, free = step.clamp(low, high), ~held
        left = -gradient[free] - matrix[free][:, held] @ step[held]
        step = step.index_copy(0, free.nonzero()[:, 0], torch.linalg.solve(matrix[free][:, free], left))
    return step
