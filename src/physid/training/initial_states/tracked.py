"""The fit of the training segments, from one step of the optimizer to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import final

import torch
from torch import Tensor

from physid.estimation.least_squares import Experiment, Fit, gauss_newton, search, try_new_states
from physid.estimation.least_squares.levenberg_marquardt import NONE
from physid.estimation.least_squares.multi_start import choose
from physid.estimation.prediction import Variants
from physid.physics import SolverError
from physid.training.initial_states.explaining import Explaining, States, started
from physid.training.initial_states.fitted import FITTING
from physid.training.parameters import Trajectories

IMPROVE = 1
"""Jacobians of the initial states for each step of the parameters."""
SETTLED = 0.5
"""Squared residual, in units of the noise, that a step of the initial states may still gain at the end of a fit."""
SEARCHED = 2.0
"""Squared residual, in units of the noise, that a search for other initial states may still gain at the end of a fit:
about what a parameter that is off by a standard error costs."""
SEARCHES = 2
"""Searches for other initial states over which the least loss must gain more than that, or only ripples are left."""


@dataclass(frozen=True)
class _Base:
    """The best states so far.

    Attributes:
        pose: Shape (B, N, 7).
        twist: Shape (B, N, 6).
        response: How their free directions follow the coordinates, shape (B, D, P).
        coordinates: Of the parameters there, shape (P,).
        loss: In units of the noise; infinite where the next ones are to replace these.
    """

    pose: Tensor
    twist: Tensor
    response: Tensor
    coordinates: Tensor
    loss: float

    @classmethod
    def of(cls, fit: Fit) -> _Base:
        """Take those of a fit."""
        coordinates, point = fit.point.nominal[0], fit.point
        response = fit.linear.response()[..., : len(coordinates)]
        return cls(point.pose[0], point.twist[0], response, coordinates, float(fit.loss.sum()))

    def moved(self, experiment: Experiment, coordinates: Tensor) -> States:
        """Return the states, moved along with the coordinates (P,)."""
        change = self.response @ (coordinates.cpu() - self.coordinates)
        pose, twist = experiment.directions.move(self.pose, self.twist, change)
        return pose, twist


@final
class TrackedFit:
    """Fits initial states a little at a time, beginning where they were best and following the parameters.

    A step of the parameters that was too long, and is taken back, leads the states astray: each fit begins from the
    best one so far, not from the last.
    """

    def __init__(self) -> None:
        self._last: tuple[Experiment, Fit] | None = None
        self._base: _Base | None = None
        self._index = torch.empty(0)
        self._resumed: dict[str, Tensor] | None = None
        self._loss = self._gained = math.inf
        self._searched = False
        self._best: tuple[float, ...] = ()  # least loss at each search so far

    @property
    def exhausted(self) -> bool:
        """Whether the least loss has hardly changed since the search before the last: only ripples are left."""
        return len(self._best) > SEARCHES and self._best[-1 - SEARCHES] - self._best[-1] < SEARCHED

    @property
    def converged(self) -> bool:
        """Whether the last step of the initial states, and the last search for others, gained next to nothing."""
        return self._last is None or (self._searched and self._gained < SETTLED)

    @property
    def last(self) -> Fit | None:
        """The last fit; None before the first."""
        return None if self._last is None else self._last[1]

    @torch.no_grad()
    def improve(self, explaining: Explaining, *, afresh: bool = False) -> tuple[Fit, int]:
        """Improve the initial states for the present parameters.

        Args:
            explaining: Trajectories, model and loss.
            afresh: Whether new guesses replace what explains a trajectory worse, and other states are searched for, to
                leave a local minimum: a step of the parameters that was too long, and is taken back, leaves the states
                where it led them.

        Returns:
            The fit, linearised there, and how many rollouts of all trajectories that took.
        """
        states = self.states(explaining)
        try:
            self._last = _improved(explaining, states, self._base, afresh=afresh)
        except SolverError:
            if states is None:
                raise
            # The states were moved along with a step of the parameters that was too long.
            self._last = _improved(explaining, None, None, afresh=False)
        same = torch.equal(self._index, explaining.trajectories.index)
        self._index = explaining.trajectories.index
        experiment, fit = self._last
        loss = float(fit.loss.sum())
        if self._base is None or not same or loss <= self._base.loss:
            self._base = _Base.of(fit)
        self._gained, self._loss = self._loss - loss, loss
        if afresh:
            self._searched = self._gained < SEARCHED
            assert self._base is not None
            self._best = (*self._best[-SEARCHES:], self._base.loss)
        return fit, experiment.predictor.simulated[0]

    @torch.no_grad()
    def linearised(self, explaining: Explaining) -> tuple[Fit, Experiment]:
        """Return the experiment, linearised at the present parameters and the best initial states."""
        if explaining.fitted:
            self.improve(explaining)
            assert self._last is not None
            return self._last[1], self._last[0]
        experiment, point = explaining.begin()
        return experiment.linearise(point, NONE), experiment

    @torch.no_grad()
    def states(self, explaining: Explaining) -> States | None:
        """Return the initial states to begin with: the last ones, moved along with the parameters; None for a guess."""
        cut = explaining.trajectories
        if not explaining.fitted:
            return None
        if self._last is not None and torch.equal(self._index, cut.index):
            assert self._base is not None
            return self._base.moved(self._last[0], explaining.physical.coordinates.detach())
        if self._resumed is not None and torch.equal(self._resumed["index"], cut.index):
            return self._resumed["pose"], self._resumed["twist"]
        return None

    def forget_loss(self) -> None:
        """Let the next fit replace the best one so far, as the loss will be another one."""
        if self._base is not None:
            self._base = replace(self._base, loss=math.inf)
        self._loss, self._best = math.inf, ()

    def started(self, explaining: Explaining) -> Trajectories:
        """Return trajectories that are predicted from where the fit stands, at the present parameters."""
        if not explaining.fitted:
            return explaining.trajectories
        states = self.states(explaining)
        experiment, point = explaining.begin(states=states)
        if states is None:
            self.begin(explaining, (point.pose[0], point.twist[0]))
        begun = experiment.predictor.begun(point)
        return started(explaining.trajectories, begun.pose[0], begun.twist[0])

    def state_dict(self, coordinates: Tensor) -> dict[str, Tensor]:
        """Return what a checkpoint needs, the states moved along with the parameters; empty if there is nothing."""
        if self._last is None:
            return {}
        assert self._base is not None
        pose, twist = self._base.moved(self._last[0], coordinates.detach())
        kept = {f"base_{name}": torch.as_tensor(value) for name, value in vars(self._base).items()}
        kept |= {"loss": torch.tensor(self._loss).double(), "searched": torch.tensor(self._searched)}
        kept["best"] = torch.tensor(self._best, dtype=torch.float64)
        return {"index": self._index, "pose": pose, "twist": twist, **kept}

    def begin(self, explaining: Explaining, states: States | None) -> None:
        """Take initial states that were fitted for the present parameters; None to guess them."""
        if states is not None:
            self._resumed = {"index": explaining.trajectories.index, "pose": states[0], "twist": states[1]}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Take the initial states of the run that is resumed."""
        self._resumed = state or None
        if "base_loss" in state:
            self._index = state["index"]
            pose, twist, response, at = (state[f"base_{name}"] for name in ("pose", "twist", "response", "coordinates"))
            self._base = _Base(pose, twist, response, at, float(state["base_loss"]))
            self._loss, self._searched = float(state["loss"]), bool(state["searched"])
            self._best = tuple(state.get("best", torch.empty(0)).tolist())


def _improved(
    explaining: Explaining, states: States | None, base: _Base | None, *, afresh: bool
) -> tuple[Experiment, Fit]:
    """Improve states, or the best ones unmoved where these explain a segment better.

    An initial speed that friction stops at once leaves hardly a slope, and how it follows the parameters is any number.
    """
    experiment, point = explaining.begin(states=states)
    held = experiment.with_known_parameters()
    if states is not None and base is not None and len(base.pose) == len(states[0]):
        still = point.replace(pose=base.pose[None], twist=base.twist[None])
        point = choose(held, Variants.join((point, still)))
    if afresh:
        point = search(held, held.linearise(try_new_states(held, point), NONE))
    return experiment, gauss_newton(held.replace(settings=FITTING), point, NONE, IMPROVE)
