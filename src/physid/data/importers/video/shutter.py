"""Whether a film has a rolling shutter: rows exposed one after another shear what moves fast."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from physid.data.importers.video.pictures import Image
from physid.data.importers.video.shadows import smoothed
from physid.data.importers.video.sights import find_bodies

Array = NDArray[np.float64]
MOST_FRAMES = 90  # of a film that are looked at: finding the body takes a tenth of a second each
FEWEST = 16  # frames with the body that tell anything
CERTAIN = 5.0  # standard errors that the delay has to differ from zero by
SEEN = 0.3  # [px] by which the shutter has to move the edges of the fastest body
LONGEST = 1.5  # frames that the rows of one image take: more is no shutter


@final
class ShutterGauge:
    """Measures the delay from row to row of a film by how the silhouette of a body shears with its speed.

    A body that moves by v = (v_x, v_y) pixels from frame to frame is drawn as S x with S = 1 + d v e_y^T where rows
    follow each other by d frames. The second moments C of its silhouette change by d (M C + C M^T), M = v e_y^T, beside
    what perspective changes, which is linear in the place of the body, and what a turn in the image changes, J C + C
    J^T, which is left out of every frame. Least squares over all frames give d and its standard error.

    Args:
        background: The empty scene, shape (H, W, 3).
    """

    def __init__(self, background: Image) -> None:
        self._background, self._behind = background, smoothed(background)
        self._count = 0
        self._frames, self._places, self._moments = list[int](), list[Array](), list[Array]()

    def look(self, image: Image) -> None:
        """Take the next frame."""
        self._count += 1
        if self._count > MOST_FRAMES:
            return
        try:
            mask = find_bodies(image, self._background, 1, self._behind)[0]
        except ValueError:
            return
        rows, columns = np.nonzero(mask)
        if len(rows) < FEWEST or min(rows.min(), columns.min()) == 0:
            return
        if rows.max() == mask.shape[0] - 1 or columns.max() == mask.shape[1] - 1:
            return
        points = np.stack([columns, rows], 1).astype(np.float64)
        self._frames.append(self._count)
        self._places.append(points.mean(0))
        self._moments.append(np.cov(points.T))

    def delay(self) -> tuple[float, float, float] | None:
        """Return how many frames one image takes from top to bottom, its standard error, and what it moves [px].

        The last is how far the fastest body is sheared from its top to its bottom. None where too little is seen.
        """
        frame, place, moment = (np.array(each) for each in (self._frames, self._places, self._moments))
        if len(frame) < FEWEST:
            return None
        inner = np.flatnonzero((frame[2:] - frame[:-2]) == 2) + 1
        if len(inner) < FEWEST:
            return None
        speed = (place[inner + 1] - place[inner - 1]) / 2
        here = place[inner] - place[inner].mean(0)
        mean = moment[inner].mean(0)
        design, wanted = list[Array](), list[Array]()
        turned = _changed(np.array([[0.0, -1.0], [1.0, 0.0]]), mean)
        kept = np.linalg.svd(turned[None])[2][1:]  # what no turn changes
        for (x, y), (across, down), seen in zip(here, speed, moment[inner], strict=True):
            shutter = _changed(np.array([[0.0, across], [0.0, down]]), mean)
            smooth = np.concatenate([factor * np.eye(3) for factor in (1.0, x, y, x * x, x * y, y * y)], 1)
            design.append(kept @ np.concatenate([shutter[:, None], smooth], 1))
            wanted.append(kept @ seen[[0, 0, 1], [0, 1, 1]])
        matrix, vector = np.concatenate(design), np.concatenate(wanted)
        found, _, rank, _ = np.linalg.lstsq(matrix, vector, rcond=None)
        left = vector - matrix @ found
        variance = float(left @ left) / max(len(vector) - int(rank), 1)
        deviation = float(np.sqrt(variance * np.linalg.pinv(matrix.T @ matrix)[0, 0]))
        height = self._background.shape[0]
        tall = 2 * np.sqrt(3 * mean[1, 1])  # of a body whose rows are alike
        shear = float(abs(found[0]) * np.linalg.norm(speed, axis=1).max() * tall)
        return height * float(found[0]), height * deviation, shear

    def remark(self) -> str:
        """Say that the film has a rolling shutter, and what to do; nothing where it has none to speak of."""
        measured = self.delay()
        if measured is None:
            return ""
        frames, deviation, shear = measured
        if abs(frames) < CERTAIN * deviation or shear < SEEN or abs(frames) > LONGEST:
            return ""
        return (
            f"a rolling shutter: from the top row to the bottom one {abs(frames):.2f} +- {deviation:.2f} frames pass, "
            f"which shears the body by up to {shear:.1f} px; physid takes all rows for one moment: film with a global "
            "shutter, a faster one (more frames a second, more light), or slower motions"
        )


def _changed(matrix: Array, moments: Array) -> Array:
    """Return the change A C + C A^T of second moments, as (xx, xy, yy)."""
    change = matrix @ moments + moments @ matrix.T
    return np.asarray(change[[0, 0, 1], [0, 1, 1]])
