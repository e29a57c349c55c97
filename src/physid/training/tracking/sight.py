"""Whether bodies are where a reader has put them, and look like themselves."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physid.data.reading import HiddenFrames

LOST = 0.5
"""Share of the differences between film and drawing in those between film, drawing and background, where bodies, and
the shadows that are drawn with them, lie: beyond this the film looks more like the empty scene than like the bodies."""
HIDDEN = 0.2
"""How far [-] a share may go from the film's median to `LOST` before it is remarked; where something of another colour
hides a part of the bodies, it goes about that part of the way. Without that it went at most 0.05, and 0.17 in tosses,
whose faces differ."""
FIRST_KNOWN = 2
"""The first frame before which two show how bodies move; until then they are looked for where they were."""
UNSTEADY = 5.0
"""Median deviations of a film's shares by which one must exceed their median to be remarked: films in which the share
wanders, because other faces come into view, have large ones."""


def unlike(drawn: Tensor, image: Tensor, background: Tensor) -> Tensor:
    """Return how little images look like drawings where bodies are drawn: 0 for equal, 1 for the background.

    Args:
        drawn: Drawings (B, 3, H, W).
        image: Frames, likewise.
        background: Of the empty scenes, likewise.

    Returns:
        The shares (see `LOST`), shape (B,); 1 where no body is drawn.
    """
    covered = (drawn != background).any(1, keepdim=True)
    here, there = (((one - image).abs() * covered).sum((1, 2, 3)) for one in (drawn, background))
    return torch.where(covered.any((1, 2, 3)), here / (here + there).clamp_min(1e-9), 1.0)


def require_sight(share: Tensor, frame: int, indices: Sequence[int], real: Tensor) -> None:
    """Refuse a frame in which bodies are lost.

    Args:
        share: What `unlike` says of each trajectory, shape (B,).
        frame: Number of the frame.
        indices: Trajectories.
        real: Whether each has such a frame, shape (B,).

    Raises:
        ValueError: If one is lost; the message names trajectory and frame.
    """
    lost = (share > LOST) & real
    if bool(lost.any()):
        row = int(lost.nonzero()[0, 0])
        mend = "cut the film there" if frame >= FIRST_KNOWN else "begin the film with every body at rest"
        raise ValueError(
            f"trajectory {indices[row]}: expected the bodies near where they were last, lost sight of them in "
            f"frame {frame}: {float(share[row]):.0%} of what should be bodies looks like the background instead "
            f"(0 % would be perfect); {mend}, or record at a higher rate"
        )


def hidden_frames(share: Tensor, index: int) -> HiddenFrames | None:
    """Return the frames in which much of what should be the bodies does not look like them; None if there are none.

    Args:
        share: What `unlike` says of each frame, shape (T,).
        index: The trajectory.
    """
    usual = share.median()
    deviation = (share - usual).abs().median()
    way = (share - usual) / (LOST - usual).clamp_min(1e-9)
    hidden = ((way > HIDDEN) & (share - usual > UNSTEADY * deviation)).nonzero()[:, 0].tolist()
    if not hidden:
        return None
    return HiddenFrames(index, len(hidden), hidden[0], hidden[-1], float(way.max().clamp(max=1)))
