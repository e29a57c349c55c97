"""Steps of the engine where nobody says how recordings were integrated: chosen by halving them, kept and reported."""

from __future__ import annotations

import dataclasses
from typing import Any, final

import torch
from torch import Tensor

from physid.estimation.least_squares import ChosenSteps, StepChoice
from physid.estimation.least_squares.discretisation import Judgement, halve_steps, judge_steps
from physid.estimation.measurement import Noise
from physid.estimation.prediction import Timeline
from physid.physics import PhysicsLayer
from physid.training.parameters import PhysicalParameters, Response, Trajectories

CHOICE = StepChoice(bias=0.1)
FIRST = 1 / 480
"""Longest steps before they are chosen [s]. Until parameters and initial states are near, bodies stop and turn at other
times than those recorded; steps that are short only where the model has events would hold it there."""
REVIEWS = (2, 6)
"""Epochs before which steps are chosen: when parameters have come near."""
NEAR = 0.25
"""Standard errors by which parameters may differ from those at which steps were chosen last."""
MOST_REVIEWS = 6
"""After so many choices a fit may end as it is; what its steps leave is in the intervals."""
NANO = 1e-9
Key = tuple[int, int, int]


@final
class StepControl:
    """The steps in which the trajectories of a fit are predicted.

    Args:
        chooses: Whether steps follow from the recordings.
        time_step: Nominal time between frames [s].

    Attributes:
        version: Grows whenever steps change.
    """

    def __init__(self, chooses: bool, time_step: float) -> None:
        self.chooses, self.version = chooses, 0
        self._time_step = time_step
        self._parts: dict[Key, Tensor] = {}
        self._reviews, self._asked = 0, False
        self._at = self._deviation = torch.empty(0, dtype=torch.float64)

    def lay(self, whole: Trajectories) -> Trajectories:
        """Return whole trajectories with the longest steps that there may be: those of the maker where they are known.

        A maker's steps go on while frames are missing.
        """
        if self.chooses:
            return whole.stepped(self._time_step)
        if whole.grid is None:
            return whole
        return whole.refined(whole.grid.parts_of(self._time_step))

    def apply(self, cut: Trajectories) -> Trajectories:
        """Return trajectories or segments with the steps chosen for them; where none were, with short ones."""
        if not self.chooses or cut.grid is None:
            return cut
        return cut.refined(self._parts_of(cut, short=True))

    def choose(
        self,
        layer: PhysicsLayer,
        physical: PhysicalParameters,
        started: Trajectories,
        noise: Noise,
        response: Response | None = None,
    ) -> Trajectories:
        """Choose the steps of trajectories with initial states, and return them so.

        Args:
            layer: The physics.
            physical: The physical parameters.
            started: With the longest steps that there may be.
            noise: Of the recorded poses.
            response: How the estimates follow, in which case steps are kept; None where none are fitted.
        """
        judgement = _judgement(layer, physical, started, noise, response)
        with torch.no_grad():
            chosen = halve_steps(judgement, CHOICE, self._parts_of(started, short=False))
            parts = _widened(chosen.parts)
            if response is not None:
                self._keep(started, parts, physical.coordinates.detach(), response.deviation())
        return started.refined(parts)

    def remaining(
        self,
        layer: PhysicsLayer,
        physical: PhysicalParameters,
        started: Trajectories,
        noise: Noise,
        response: Response,
    ) -> tuple[Tensor, ChosenSteps]:
        """Return what the steps that were chosen may still change of ln(parameter), (P,), and how they are judged.

        Args:
            layer: The physics.
            physical: The physical parameters.
            started: With initial states and the longest steps that there may be.
            noise: Of the recorded poses.
            response: How the estimates follow.
        """
        judgement = _judgement(layer, physical, started, noise, response)
        found: list[Tensor] = []

        def respond(apart: Tensor) -> Tensor:
            found.append(response(apart))
            return judgement.respond(apart)

        with torch.no_grad():
            parts = self._parts_of(started, short=True)
            judged = judge_steps(dataclasses.replace(judgement, respond=respond), parts, CHOICE)
        return torch.stack(found).sum(0), judged

    def due(self, epoch: int) -> bool:
        """Return whether steps are to be chosen before an epoch of training."""
        return self.chooses and (self._asked or epoch in REVIEWS)

    def settled(self, coordinates: Tensor) -> bool:
        """Return whether steps were chosen near these parameters; if not, that is done before the next epoch."""
        if not self.chooses or self._reviews >= MOST_REVIEWS:
            return True
        self._asked = not (
            len(self._at) == len(coordinates)
            and bool(((coordinates.detach() - self._at).abs() <= NEAR * self._deviation).all())
        )
        return not self._asked

    def ask(self) -> bool:
        """Have steps chosen before the next epoch; return whether that will be: after so many times it is not."""
        self._asked = self.chooses and self._reviews < MOST_REVIEWS
        return self._asked

    def reviewed(self) -> None:
        """Take note that all trajectories of an epoch have their steps."""
        self._asked = False
        self._reviews += 1

    def state_dict(self) -> dict[str, Any]:
        """Return what a checkpoint needs."""
        if not self._parts:
            return {}
        longest = max(len(one) for one in self._parts.values())
        padded = [torch.nn.functional.pad(one, (0, longest - len(one)), value=1) for one in self._parts.values()]
        keys = torch.tensor(list(self._parts))
        counts = torch.tensor([len(one) for one in self._parts.values()])
        known = {"keys": keys, "parts": torch.stack(padded), "counts": counts, "at": self._at}
        return {**known, "deviation": self._deviation, "reviews": self._reviews, "asked": self._asked}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take the steps of the run that is resumed or evaluated."""
        if not state:
            return
        rows = zip(state["keys"].tolist(), state["parts"], state["counts"].tolist(), strict=True)
        self._parts = {(key[0], key[1], key[2]): parts[:count] for key, parts, count in rows}
        self._at, self._deviation = state["at"], state["deviation"]
        self._reviews, self._asked = state["reviews"], state["asked"]
        self.version += 1

    def _keep(self, started: Trajectories, parts: Tensor, coordinates: Tensor, deviation: Tensor) -> None:
        """Keep what was chosen, and where."""
        assert started.grid is not None
        for row, key in enumerate(_keys(started)):
            self._parts[key] = parts[row, : int(started.grid.count[row])].cpu()
        self._at, self._deviation = coordinates.clone().cpu(), deviation.cpu()
        self.version += 1

    def _parts_of(self, cut: Trajectories, *, short: bool) -> Tensor:
        """Return into how many parts the steps of each are cut, shape (B, S); where nothing was chosen, short or 1."""
        assert cut.grid is not None
        parts = (cut.grid.steps / FIRST - NANO).ceil().long() if short else torch.ones_like(cut.grid.steps).long()
        for row, key in enumerate(_keys(cut)):
            known = self._parts.get(key)
            if known is not None:
                parts[row, : len(known)] = known.to(parts)
        return parts.clamp_min(1)


def _widened(parts: Tensor) -> Tensor:
    """Cut steps beside those that are cut as well: an event may move to them before steps are chosen again."""
    return torch.nn.functional.max_pool1d(parts[:, None].double(), 3, stride=1, padding=1)[:, 0].long()


def _keys(cut: Trajectories) -> list[Key]:
    """Name each trajectory or segment: its number in the set, when it begins [ns], and its frames."""
    assert cut.time is not None
    begins = (cut.time[:, 0] / NANO).round().long()
    return list(zip(cut.index.tolist(), begins.tolist(), cut.length.tolist(), strict=True))


def _judgement(
    layer: PhysicsLayer, physical: PhysicalParameters, started: Trajectories, noise: Noise, response: Response | None
) -> Judgement:
    """Return what the steps of trajectories are judged by."""
    assert started.time is not None and started.grid is not None
    parameters = physical()
    response = response or Response.unknown(1)
    deviation = response.deviation().clamp_min(1e-12)

    def predict(timeline: Timeline) -> tuple[Tensor, Tensor]:
        rollout = dataclasses.replace(started, grid=timeline.grid).rolled(layer, parameters)
        return rollout.pose, rollout.twist

    def respond(apart: Tensor) -> Tensor:
        return response(apart) / deviation

    bodies, spread = started.pose.shape[2], noise.spread().to(started.pose)
    frames = torch.arange(1, started.pose.shape[1], device=started.pose.device)
    followed = frames < started.length[:, None]
    counted = started.real[..., None].expand(-1, -1, bodies)
    return Judgement(Timeline(started.time, started.grid), predict, respond, spread, followed, counted)
