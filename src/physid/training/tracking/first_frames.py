"""What bodies look like, and where they are in the first frames of films: where reading begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import torch
from torch import Tensor

from physid.data import RecordingSet
from physid.networks import PlanarChart, PoseChart, as_image
from physid.scenes import Scene
from physid.training.tracking.films import Filmed, Footage, Recorded
from physid.training.tracking.light import SteadyLight
from physid.training.tracking.shadows import cast_shadow_of
from physid.training.tracking.tracker import Reader, chart_for
from physid.training.vision import MODELS, CastShadow, ChartName, Decoder, PoseRefinement, VideoModel, chart_of

SEARCHING = PoseRefinement(steps=8, headings=24)
LOOKS = 2
"""How often the look of bodies is cut out and first poses are found by it: first by one film, then by many."""
UNSURE = 1e-3
"""Deviation of the scale where no pose is known beforehand: about what drawn edges are off by."""


@final
@dataclass(frozen=True)
class Beginning:
    """Where reading begins.

    Attributes:
        reader: Knows what the bodies look like.
        pose: About the initial poses, shape (R, N, 7).
        footage: The films as the reader draws them: with shadows if it draws these.
    """

    reader: Reader
    pose: Tensor
    footage: Footage


def first_frames_of(
    scene: Scene, recordings: RecordingSet, known: Sequence[Filmed], chart: ChartName | None, trained: Any = None
) -> Beginning:
    """Begin to read films.

    A trained model knows the bodies and finds them. Without one, initial poses that are known tell what the bodies look
    like. Without these, bodies on the ground are found by their outlines, and told from each other by their masks;
    a heading that no outline tells is that of the first trajectory. Shadows that one lamp explains are drawn from then
    on, so that a body's edges may be as faint as they are beside its shadow; all others stay out of the frames.

    Args:
        scene: Gives camera, ground and sizes.
        recordings: The films.
        known: What is known of those that are looked at.
        chart: Which poses there are; None to judge by the first ones.
        trained: A module of a fit from video, with an attribute `model`.

    Raises:
        ValueError: If the initial poses cannot be found.
    """
    footage = SteadyLight(Recorded(recordings))
    if trained is not None:
        model: VideoModel = trained.model.eval()
        frame, _, background = _first_frames(footage, range(len(known)))
        first = model.read(as_image(frame)[:, None], as_image(background))[1][:, 0].double()
        return Beginning(Reader.of_model(model), first, footage)
    lit, looked = footage.with_shadows(), range(len(known))[:MODELS]
    sights = [lit.first(index) for index in looked]
    places = [one.first for one in known if one.first is not None]
    whole = len(places) == len(known)
    first = torch.from_numpy(np.stack(places)) if whole else _find(scene, chart or "planar", footage, len(known))
    name = chart or (chart_for(scene, first) if whole else "planar")
    shadow = cast_shadow_of(scene, sights, first)
    if shadow is not None and not whole:
        first = _find(scene, name, lit, len(known), first, shadow)
        shadow = cast_shadow_of(scene, sights, first) or shadow
    shown = footage if shadow is None else lit
    reader = Reader.of_first_frames(scene, name, shown, first, shadow)
    if not whole:
        reader.calibration.deviation.fill_(UNSURE)
        reader.calibration.stretch.zero_()
    return Beginning(reader, first, shown)


def _first_frames(footage: Footage, indices: Sequence[int]) -> tuple[Tensor, Tensor, Tensor]:
    """Return first frames (R, H, W, 3), masks (R, N, H, W) and backgrounds (R, H, W, 3)."""
    first = [footage.first(index) for index in indices]
    frame, mask, background = (torch.from_numpy(np.stack(each)) for each in zip(*first, strict=True))
    return frame, mask, background


def _find(
    scene: Scene,
    name: ChartName,
    footage: Footage,
    count: int,
    rough: Tensor | None = None,
    shadow: CastShadow | None = None,
) -> Tensor:
    """Find initial poses (R, N, 7) by what the first film shows, from rough ones; without these by outlines first."""
    chart = chart_of(scene, name)
    if not isinstance(chart, PlanarChart):
        raise ValueError(
            "expected the poses of the first frames, which tell what the bodies look like, found none; only bodies on "
            "the ground are found without them: record initial poses, or name the run of a trained encoder (--encoder)"
        )
    frame, mask, background = _first_frames(footage, range(count))
    image, behind, decoder = as_image(frame), as_image(background), Decoder(scene)
    decoder.shadow = shadow
    if rough is None:
        rough = _centres(chart, mask)
        pose = _fit_outlines(scene, chart, rough[:1], mask[:1])
    else:
        rough = rough.to(image)
        pose = rough[:1]
    decoder.cut(image[:1], mask[:1], pose)
    for _ in range(LOOKS):
        pose = SEARCHING(chart, decoder, rough[:, None], image[:, None], behind)[:, 0]
        decoder.cut(image[:MODELS], mask[:MODELS], pose[:MODELS])
    return pose.double()


def _centres(chart: PlanarChart, mask: Tensor) -> Tensor:
    """Place unturned bodies where the middles of their masks (R, N, H, W) are, shape (R, N, 7)."""
    height, width = mask.shape[-2:]
    share = mask.float() / mask.sum((-2, -1), keepdim=True).clamp_min(1)
    column = (share.sum(-2) * (torch.arange(width) + 0.5)).sum(-1)
    row = (share.sum(-1) * (torch.arange(height) + 0.5)).sum(-1)
    numbers = chart.neutral().repeat(*mask.shape[:2], 1)
    numbers[..., 0], numbers[..., 1] = 2 * column / width - 1, 2 * row / height - 1
    return chart.to_pose(numbers)


def _fit_outlines(scene: Scene, chart: PoseChart, rough: Tensor, mask: Tensor) -> Tensor:
    """Turn and move bodies (R, N, 7) until their outlines fill their masks (R, N, H, W): drawn in plain colours."""
    decoder, image = Decoder(scene), torch.zeros(len(mask), 3, *mask.shape[-2:])
    decoder.patches.zero_()
    for body in range(mask.shape[1]):
        decoder.patches[:, body, :, body % 3] = 1.0
        image[:, body % 3] += mask[:, body]
    return SEARCHING(chart, decoder, rough[:, None], image[:, None], torch.zeros_like(image))[:, 0]
