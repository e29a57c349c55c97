"""What the report of a diagnosis draws: errors over time, evidence over time, floors, formulas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physid.diagnosis.conclusion.conclusion import Conclusion
from physid.diagnosis.conclusion.gap import floor_of, floors_of, held_out_parts, residual_wrench_errors
from physid.diagnosis.conclusion.judgement import Judgement
from physid.diagnosis.conclusion.localisation import over_time
from physid.diagnosis.report.contents import Curve, ReportData, TimeMap
from physid.diagnosis.report.overlay import overlay
from physid.diagnosis.testing import Hypothesis, piece_frames
from physid.pages.numbers import percent

SMOOTH = 9  # frames over which curves are averaged


def draw(out: Path, conclusion: Conclusion, seconds: float, missing: str | None = None) -> ReportData:
    """Collect what the report draws; a film of recording and model is written.

    Args:
        out: Folder of the diagnosis; gets the film.
        conclusion: What was concluded, with the fits and the hypotheses behind it.
        seconds: How long the diagnosis took.
        missing: Text of a file with what is missing as effects; None where there is none.
    """
    judged = conclusion.judgement
    nominal_fit, found, shown = judged.nominal_fit, judged.found, judged.shown
    trajectories, frames = nominal_fit.observations.pose.shape[:2]
    parts = held_out_parts(nominal_fit.observations)
    step = nominal_fit.observations.scene.time_step
    curves = [
        Curve(
            split,
            np.arange(frames, dtype=np.float64) * step,
            _curve(found.whole_nominal, chosen),
            None if shown is None else _curve(shown, chosen),
        )
        for split, chosen in parts.items()
        if bool(chosen.any())
    ]
    free = None if found.contact_free else residual_wrench_errors(found.lack, found.nominal, nominal_fit.noise)
    kinds = nominal_fit.experiment.predictor.candidates
    return ReportData(
        title=nominal_fit.observations.title,
        curves=tuple(curves),
        time_map=_time_map(judged),
        levels=_levels(judged),
        residual_wrench={
            split: float(free[chosen].mean().sqrt())
            for split, chosen in parts.items()
            if free is not None and bool(chosen.any())
        },
        threshold=found.lack.reach(found.lack.rows[0].names),
        replicates=len(found.lack.null_best),
        formulas={kind.name: (kind.__doc__ or "").strip().splitlines()[0] for kind in kinds},
        next_config=conclusion.further.config if conclusion.further else None,
        missing_effects=missing,
        overlay=overlay(out, judged),
        facts={
            "recordings": f"{trajectories} trajectories of {frames} frames",
            "judged": _judged_in(judged),
            "candidates": str(len(kinds)),
            "took": f"{seconds:.0f} s",
        },
    )


def _judged_in(judged: Judgement) -> str:
    """Say in which frames effects are judged."""
    decided, whole = (
        float(one.predictor.segments.size.sum())
        for one in (judged.found.nominal.experiment, judged.nominal_fit.experiment)
    )
    return f"contact-free segments, {percent(decided / whole)} of the frames" if decided < whole else "in all frames"


def _levels(judged: Judgement) -> dict[str, float]:
    """Return the floors [m]: of the sensor, and of the numerics, where replays of one fit differ."""
    nominal_fit = judged.nominal_fit
    sensor = floor_of(nominal_fit.noise)
    whole = float(floors_of(nominal_fit.experiment, nominal_fit.noise).mean())
    return {"sensor": sensor, "numerical": max(whole - sensor**2, 0.0) ** 0.5}


def _curve(hypothesis: Hypothesis, chosen: Tensor) -> NDArray[np.float64]:
    """Return the root mean square position error of some trajectories over time, a running mean; shape (T,) [m]."""
    scale = hypothesis.experiment.scale[chosen][..., 3]
    weight = (scale / scale.amax().clamp_min(1e-30)) ** 2
    square = hypothesis.fit.residual[chosen][..., 3:].square().sum(-1) * weight
    total = torch.stack([square.sum((0, 2)), weight.sum((0, 2))])
    summed = torch.nn.functional.avg_pool1d(total[None], SMOOTH, 1, SMOOTH // 2, count_include_pad=False)[0]
    # Frames in which nothing counts, say after the end of all trajectories, continue what was before.
    seen = torch.where(summed[1] > 0, torch.arange(summed.shape[1]), 0).cummax(0).values
    error: NDArray[np.float64] = (summed[0] / summed[1].clamp_min(1e-9)).sqrt()[seen].numpy()
    return error


def _time_map(judged: Judgement) -> TimeMap | None:
    """Return the evidence over the time since the start of a segment."""
    lack, settings, scene = judged.found.lack, judged.nominal_fit.settings, judged.nominal_fit.observations.scene
    tables = {
        body.name: over_time(lack, number, settings.localisation.rounding) for number, body in enumerate(scene.bodies)
    }
    evidence = torch.cat([table for table, _ in tables.values()]).double().numpy()
    if not evidence.size:
        return None
    step = scene.time_step
    edges = step * piece_frames(settings.residual_wrench.piece_time, step) * np.arange(evidence.shape[1] + 1)
    edges[-1] = step * int(lack.fit.linear.segments.size.max())
    return TimeMap(tuple((name, dof) for name, (_, dofs) in tables.items() for dof in dofs), edges, evidence)
