"""What the report of a diagnosis draws: errors over time, evidence over time, floors, formulas."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physid.diagnosis.conclusion.conclusion import Conclusion
from physid.diagnosis.conclusion.gap import floor_of, freeform_errors, held_out_parts, position_floors
from physid.diagnosis.conclusion.localisation import over_time
from physid.diagnosis.reference.nominal_fit import Prepared
from physid.diagnosis.report.contents import Curve, ReportData, TimeMap
from physid.diagnosis.report.sentences import percent
from physid.diagnosis.selection.attribution import Attribution
from physid.diagnosis.testing.hypothesis import Hypothesis
from physid.diagnosis.testing.lack_of_fit import Stage
from physid.diagnosis.testing.residual_wrench import piece_frames

SMOOTH = 9  # frames over which curves are averaged


def draw(title: str, prepared: Prepared, found: Attribution, conclusion: Conclusion, seconds: float) -> ReportData:
    """Collect what the report draws.

    Args:
        title: Name of the recording set.
        prepared: The recordings and the fitted nominal model.
        found: What the search found.
        conclusion: What was concluded.
        seconds: How long the diagnosis took.
    """
    trajectories, frames = prepared.observations.pose.shape[:2]
    parts = held_out_parts(prepared.observations)
    step = prepared.observations.scene.time_step
    curves = [
        Curve(
            split,
            np.arange(frames, dtype=np.float64) * step,
            _curve(found.whole_nominal, chosen),
            None if conclusion.shown is None else _curve(conclusion.shown, chosen),
        )
        for split, chosen in parts.items()
        if bool(chosen.any())
    ]
    free = None if found.calm else freeform_errors(found.stage, found.nominal.experiment, prepared.noise)
    kinds = prepared.experiment.predictor.candidates
    return ReportData(
        title=title,
        curves=tuple(curves),
        time_map=_time_map(found.stage, [body.name for body in prepared.observations.scene.bodies], prepared),
        levels=_levels(prepared),
        freeform={
            split: float(free[chosen].mean().sqrt())
            for split, chosen in parts.items()
            if free is not None and bool(chosen.any())
        },
        threshold=found.stage.reach(found.stage.rows[0].names),
        replicates=len(found.stage.null_best),
        formulas={kind.name: (kind.__doc__ or "").strip().splitlines()[0] for kind in kinds},
        next_config=conclusion.further.config if conclusion.further else None,
        facts={
            "recordings": f"{trajectories} trajectories of {frames} frames",
            "judged": _judged(found, prepared),
            "candidates": str(len(kinds)),
            "took": f"{seconds:.0f} s",
        },
    )


def _judged(found: Attribution, prepared: Prepared) -> str:
    """Say in which frames effects are judged."""
    judged, whole = (float(one.predictor.windows.size.sum()) for one in (found.nominal.experiment, prepared.experiment))
    return f"where nothing is hit, {percent(judged / whole)} of the frames" if judged < whole else "in all frames"


def _levels(prepared: Prepared) -> dict[str, float | None]:
    """Return the floors [m]: of the sensor, and of the numerics, where replays of one fit differ."""
    sensor = floor_of(prepared.noise)
    whole = float(position_floors(prepared.experiment, prepared.noise).mean())
    return {"sensor": sensor, "numerical": max(whole - sensor**2, 0.0) ** 0.5}


def _curve(hypothesis: Hypothesis, chosen: Tensor) -> NDArray[np.float64]:
    """Return the root mean square position error of some trajectories over time, a running mean; shape (T,) [m]."""
    scale = hypothesis.experiment.scale[chosen][..., 3]
    weight = (scale / scale.amax().clamp_min(1e-30)) ** 2
    square = hypothesis.fit.residual[chosen][..., 3:].square().sum(-1) * weight
    total = torch.stack([square.sum((0, 2)), weight.sum((0, 2))])
    summed = torch.nn.functional.avg_pool1d(total[None], SMOOTH, 1, SMOOTH // 2, count_include_pad=False)[0]
    error: NDArray[np.float64] = (summed[0] / summed[1].clamp_min(1e-9)).sqrt().numpy()
    return error


def _time_map(stage: Stage, names: list[str], prepared: Prepared) -> TimeMap | None:
    """Return the evidence over the time since the start of a window."""
    tables = {name: over_time(stage, body) for body, name in enumerate(names)}
    evidence = torch.cat([table for table, _ in tables.values()]).double().numpy()
    if not evidence.size:
        return None
    step = prepared.observations.scene.time_step
    edges = step * piece_frames(step) * np.arange(evidence.shape[1] + 1)
    edges[-1] = step * int(stage.fit.linear.windows.size.max())
    return TimeMap(tuple((name, dof) for name, (_, dofs) in tables.items() for dof in dofs), edges, evidence)
