"""Residual laws: along a direction, with a size that is any function of one variable (piecewise linear)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.residual_law.motion import Direction, Kind, Region, Variable, directions_of, variables_of
from physid.diagnosis.settings.testing import ResidualLawSettings
from physid.diagnosis.testing import Hypothesis, LackOfFit
from physid.estimation.segmented_fit import PHASES
from physid.physics import Site


@dataclass(frozen=True)
class Law:
    """Something acts along a direction; its size is a piecewise linear function of a variable.

    Attributes:
        direction: Along what.
        variable: On what its size depends; None for nothing.
        region: Where it acts.
        active: The same as a mask, shape (R, T, N).
        knots: Values of the variable between which the size is linear, shape (B,); one for a constant.
    """

    direction: Direction
    variable: Variable | None
    region: Region
    active: Tensor
    knots: Tensor

    @property
    def site(self) -> Site:
        """Where what acts so is made.

        What follows the command is made where it is carried out. What opposes or drives a body along its way while it
        touches something acts like a friction.
        """
        if self.direction.kind == "shift":
            return "perception"
        if self.direction.commanded or (self.variable is not None and self.variable.commanded):
            return "actuation"
        return "contact" if self.region == "in contact" or self.direction.rubs else "dynamics"

    def basis(self) -> Tensor:
        """Return what each of B amplitudes contributes at each frame, shape (R, T, N, B): one if they are all one."""
        if self.variable is None:
            return self.active[..., None].to(self.knots)
        return hats(self.variable.value, self.knots) * self.active[..., None]


def hats(value: Tensor, knots: Tensor) -> Tensor:
    """Return piecewise linear functions that are one at one of the knots (B,) each, (..., B).

    Beyond the ends they go on straight, for as far again as the knots reach, and are constant from there: a few values
    that are far off would otherwise outweigh all others. Their sum is one everywhere.
    """
    reach = knots[-1] - knots[0]
    value = value.clamp(knots[0] - reach, knots[-1] + reach)
    right = torch.searchsorted(knots, value.contiguous()).clamp(1, len(knots) - 1)
    low, high = knots[right - 1], knots[right]
    share = (value - low) / (high - low)
    empty = value.new_zeros(*value.shape, len(knots))
    return empty.scatter(-1, right[..., None] - 1, (1 - share)[..., None]).scatter(
        -1, right[..., None], share[..., None]
    )


def list_laws(nominal_fit: NominalFit, hypothesis: Hypothesis, lack: LackOfFit) -> list[Law]:
    """List the laws that the motion lets one ask for."""
    settings, experiment = nominal_fit.settings, hypothesis.experiment
    prediction, timeline = lack.fit.jacobian.base, experiment.predictor.timeline
    segments, frame = experiment.predictor.segments, experiment.directions.frame
    planar = not bool(experiment.directions.free[..., 0].any())
    pieces = max(settings.residual_law.time, settings.residual_wrench.piece_time)
    seen = segments.spread(lack.sound)[..., None] & (experiment.scale[..., 0] > 0)
    return _combined(
        directions_of(prediction, timeline, frame, planar, settings.phases.still_speed),
        variables_of(prediction, timeline, frame, planar, settings.phases.still_speed),
        nominal_fit.phases == PHASES.index("free_fall"),
        seen,
        settings.residual_law,
        {"force": pieces, "torque": pieces, "shift": settings.residual_law.time},
        settings.residual_wrench.seldom,
    )


def _combined(
    directions: Sequence[Direction],
    variables: Sequence[Variable],
    flying: Tensor,
    seen: Tensor,
    settings: ResidualLawSettings,
    times: Mapping[Kind, float],
    seldom: float,
) -> list[Law]:
    """List all laws of a direction and at most one variable, everywhere or only in contact or in flight.

    Args:
        directions: Of forces, torques and shifts. A shift acts everywhere.
        variables: What sizes may depend on.
        flying: Where a body flies, shape (R, T, N).
        seen: Frames that are judged, shape (R, T, N).
        settings: How many knots functions have.
        times: [s] between the knots of functions of time, which may swing.
        seldom: Share of the frames below which a region or a direction does not count.
    """
    frames = float(seen.sum())
    regions: list[tuple[Region, Tensor]] = [("everywhere", seen)]
    parts: list[tuple[Region, Tensor]] = [("in contact", seen & ~flying), ("in flight", seen & flying)]
    if all(float(mask.sum()) > seldom * frames for _, mask in parts):
        regions += parts
    found = []
    for direction in directions:
        there = direction.value.abs().sum(-1) > 0
        for region, mask in regions if direction.kind != "shift" else regions[:1]:
            active = mask & there
            if float(active.sum()) <= seldom * frames:
                continue
            for variable in (None, *variables):
                if variable is None:
                    found.append(Law(direction, None, region, active, torch.zeros(1, dtype=torch.float64)))
                    continue
                defined = active & variable.defined
                if float(defined.sum()) <= seldom * frames:
                    continue
                places = _knots(variable, defined, settings, times[direction.kind])
                if len(places) > 1:
                    found.append(Law(direction, variable, region, defined, places))
    return found


def _knots(variable: Variable, active: Tensor, settings: ResidualLawSettings, apart: float) -> Tensor:
    """Return where a function of a variable bends; one value alone if the variable does not change.

    Times are equally far apart, other knots in the middles of as many equal parts of the frames.
    """
    values, count = variable.value[active].sort().values, settings.knots
    if variable.swings:
        first, last = float(values[0]), float(values[-1])
        times = min(max(2, round((last - first) / apart) + 1), settings.most_knots)
        return torch.linspace(first, last, times, dtype=torch.float64)
    places = values[((torch.arange(count) + 0.5) / count * len(values)).long()]
    span = float(places[-1] - places[0])
    distinct = torch.cat([places.new_ones(1, dtype=torch.bool), places.diff() > span / count**2])
    return places[distinct]


def over_pieces(law: Law, piece: Tensor, pieces: int, owner: Tensor, segments: int, frame: Tensor) -> Tensor:
    """Return the mean of a law's patterns over pieces of time, in the axes of the ground.

    Args:
        law: The law.
        piece: Which piece of its segment each frame is in, shape (R, T).
        pieces: How many there are at most.
        owner: Which segment each frame is in, -1 for none; shape (R, T).
        segments: How many there are.
        frame: Axes of the ground as rows, shape (3, 3).

    Returns:
        Shape (segments, pieces, N, 6, B).
    """
    turned = torch.cat([law.direction.value[..., :3] @ frame.T, law.direction.value[..., 3:] @ frame.T], -1)
    pattern = turned[..., None] * law.basis()[..., None, :]
    inside = (owner >= 0).flatten()
    place = (owner * pieces + piece).flatten()[inside]
    total = pattern.new_zeros(segments * pieces, *pattern.shape[2:]).index_add(0, place, pattern.flatten(0, 1)[inside])
    count = torch.bincount(place, minlength=segments * pieces).clamp_min(1).to(total)
    mean: Tensor = (total / count.reshape(-1, *[1] * (total.ndim - 1))).unflatten(0, (segments, pieces))
    return mean


def knots_of(laws: Sequence[Law]) -> Iterator[tuple[Law, slice]]:
    """Give each law with the places of its amplitudes among those of all."""
    start = 0
    for law in laws:
        yield law, slice(start, start + len(law.knots))
        start += len(law.knots)
