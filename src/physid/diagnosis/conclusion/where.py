"""Where a gap lies: its site, the cells of the map, and the phases of the motion in which effects are at work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from physid.diagnosis.conclusion.localisation import Place, places, sites
from physid.diagnosis.document.document import PHASES, SITES, Cell, Phase, Where
from physid.diagnosis.reference.nominal_fit import NominalFit
from physid.diagnosis.selection.search import Attribution
from physid.diagnosis.testing import Hypothesis
from physid.estimation.prediction import Prediction, Segmentation, Variants, has
from physid.estimation.segmented_fit import PHASES as CODES
from physid.estimation.segmented_fit import phases_of_steps
from physid.physics import Site, SolverError


def nowhere() -> Where:
    """Return what is said where there is no gap."""
    return Where(dict.fromkeys(SITES, 0.0), (), {})


def locate(nominal_fit: NominalFit, found: Attribution, shown: Hypothesis | None, laws: Mapping[Site, float]) -> Where:
    """Say where the gap lies.

    Args:
        nominal_fit: The recordings.
        found: What the search found.
        shown: The hypothesis whose effects are blamed; None where none are.
        laws: By how much the best residual law of each site predicts better, where none are.
    """
    settings, bodies = nominal_fit.settings, nominal_fit.observations.scene.bodies
    listed = places(found.lack, [body.name for body in bodies], settings.localisation.rounding)
    cells = [Cell(one.phase, one.body, one.dof, one.evidence) for one in listed if one.evidence > 0]
    shares = phase_shares(listed, nominal_fit, shown)
    return Where(sites(found, shown is not None, laws), tuple(cells[: settings.verdict.most_cells]), shares)


def phase_shares(found: Sequence[Place], nominal_fit: NominalFit, shown: Hypothesis | None) -> dict[Phase, float]:
    """Divide what happens among the phases of the motion: what the blamed effects do; else, the evidence.

    What a model that lacks an effect leaves is seen where its other parameters cannot follow, which is not where the
    effect acts: a drag that a friction imitates is missed where the body is slowest. Where effects are named, the model
    therefore goes from each predicted state to the next frame with them and without; the kinetic energy of what the
    velocities differ by, (m |dv|^2 + J |dw|^2) / 2 with J the mean of the principal moments, is summed by phase. Where
    nothing is named, squares of the evidence are. Both are of the trajectories that effects were fitted to: another
    protocol has other phases.

    Args:
        found: The cells of the map.
        nominal_fit: The recordings.
        shown: The hypothesis whose effects are blamed; None where none are.

    Returns:
        Shares with sum 1, the largest first; nothing where effects only change what is seen, where nothing stands out,
        or where a step without the effects cannot be simulated.
    """
    settings, sums = nominal_fit.settings, dict.fromkeys(PHASES, 0.0)
    if shown is None:
        for place in found:
            sums[place.phase] += place.evidence**2
    else:
        try:
            work, stepped = work_of(shown)
        except SolverError:
            return {}
        observations, rows = nominal_fit.observations, nominal_fit.observations.fitted
        scene = shown.experiment.predictor.model.scene_at(shown.fit.point.nominal[0])
        code = phases_of_steps(stepped, observations.timeline, scene, settings.phases)
        for phase in PHASES:
            sums[phase] = float(work[rows][code[rows] == CODES.index(phase)].sum())
    total = sum(sums.values())
    if total <= settings.localisation.work:
        return {}
    return {
        phase: each / total
        for phase, each in sorted(sums.items(), key=lambda row: -row[1])
        if each > settings.localisation.share * total
    }


def work_of(hypothesis: Hypothesis) -> tuple[Tensor, Prediction]:
    """Compute the kinetic energy of what effects change from each frame to the next.

    Returns:
        It [J], shape (R, T, N), and the hypothesis' prediction with the impulses of all these steps, those from the end
        of a segment to the next one too.
    """
    point, predictor = hypothesis.fit.point, hypothesis.experiment.predictor
    base = hypothesis.fit.jacobian.base
    without = point.effects.clone()
    for k in hypothesis.columns.tolist():
        # A camera or a clock moves nothing.
        if any(has(predictor.terms[k].effect, hook) for hook in ("act", "actuate")):
            without[0, k] = predictor.null[k]
    trajectories, frames, bodies = base.twist.shape[1:4]
    work, impulse = base.twist.new_zeros(trajectories, frames, bodies), torch.zeros_like(base.impulse)
    known = predictor.model.scene_at(point.nominal[0]).bodies
    mass = torch.tensor([body.mass for body in known], dtype=torch.float64)
    moment = torch.tensor([float(body.moments().mean()) for body in known], dtype=torch.float64)
    for first in (0, 1):
        pairs = Segmentation.pairs(trajectories, frames, first)
        at = pairs.trajectory, pairs.start
        variants = Variants.of_states(
            base.state[0][at].expand(2, -1, -1, -1),
            base.twist[0][at].expand(2, -1, -1, -1),
            point.nominal.expand(2, -1),
            torch.cat([point.effects, without]),
        )
        stepped = predictor.over(pairs, base.state[0]).predict(variants)
        twist = stepped.twist[:, pairs.trajectory, pairs.start + 1]
        square = (twist[0] - twist[1]).square()
        work[at] = (moment * square[..., :3].sum(-1) + mass * square[..., 3:].sum(-1)) / 2
        impulse[0][at] = stepped.impulse[0][at]
    return work, replace(base, impulse=impulse)
