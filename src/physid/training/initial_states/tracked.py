"""The initial states of the training segments, from one evaluation of the loss to the next."""

from __future__ import annotations

import dataclasses
from typing import final

import torch
from torch import Tensor

from physid.physics.layer import SolverError
from physid.scenes.scene import Scene
from physid.training.initial_states.fitted import Explaining, Starts, TrackedFit
from physid.training.parameters.sensitivity import sensitivity

IMPROVE = 2
"""Steps of the initial states for each step of the parameters."""


@final
class TrackedInitialStates:
    """Fits initial states a little at every evaluation, beginning where they were and following the parameters.

    Args:
        scene: What the first guess needs.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._last: TrackedFit | None = None
        self._index = self._point = torch.empty(0)
        self._resumed: dict[str, Tensor] | None = None

    def improve(self, explaining: Explaining, *, afresh: bool) -> tuple[TrackedFit, int]:
        """Improve the initial states for the present parameters.

        Args:
            explaining: Trajectories, model and loss.
            afresh: Whether to fit from the first guess as well, to leave a local minimum.

        Returns:
            The initial states and how they follow the parameters, and how many rollouts of all trajectories that took.
        """
        cut, physical = explaining.trajectories, explaining.physical
        try:
            starts, spent = explaining.fit(self.starts(explaining), IMPROVE)
        except SolverError:  # moved along with a step of the parameters that was too long
            starts, spent = explaining.fit(Starts.guess(cut, self._scene), IMPROVE)
        if afresh:
            starts, more = explaining.better(starts, Starts.guess(cut, self._scene))
            spent += more
        answer = sensitivity(explaining.layer, physical, starts.of(cut))
        self._last = explaining.follow(starts, answer)
        self._index, self._point = cut.index, physical.logarithm.detach().clone()
        return self._last, spent + 2 * len(answer) + self._last.rollouts

    def last(self, explaining: Explaining, *, fitted: bool) -> TrackedFit | None:
        """Return what was found last; where nothing was, improve. None if initial states are not fitted."""
        if not fitted:
            return None
        return self.improve(explaining, afresh=False)[0] if self._last is None else self._last

    def starts(self, explaining: Explaining) -> Starts:
        """Return the initial states to begin with: the last ones, moved along with the parameters; else a guess."""
        cut = explaining.trajectories
        if self._last is not None and torch.equal(self._index, cut.index):
            return self._last.at(explaining.physical.logarithm.detach() - self._point)
        starts = Starts.guess(cut, self._scene)
        if self._resumed is not None and torch.equal(self._resumed["index"], cut.index):
            starts = dataclasses.replace(starts, pose=self._resumed["pose"], twist=self._resumed["twist"])
        return starts

    def state_dict(self, logarithm: Tensor) -> dict[str, Tensor]:
        """Return what a checkpoint needs, the states moved along with the parameters; empty if there is nothing."""
        if self._last is None:
            return {}
        starts = self._last.at(logarithm.detach() - self._point)
        return {"index": self._index, "pose": starts.pose, "twist": starts.twist}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Take the initial states of the run that is resumed."""
        self._resumed = state or None
