"""Where the paper's loss of what is rolled out from films is smallest, for the encoder of a run with supervision.

    python benchmarks/video_landscape.py runs/NAME data/collide

The recordings are those that the run learned from. Each of 200 trajectories is rolled out from the pose that the run's
encoder reads from its first frame, and from the recorded one, over so many frames; the loss is the mean over every
tenth of them. The table says where it is smallest, relative to the truth: over all parameters that were learned, and
over each alone, the others being as the run has learned them; and how large it is there, at the truth and at the run's
end, relative to the smallest.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar
from torch import Tensor

from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.truth import FILE, read_truth
from physid.estimation.measurement import pose_difference
from physid.networks import as_image
from physid.training.runs.run import restore

TRAJECTORIES, AT_ONCE, EVERY = 200, 25, 10
WHICH = ("encoded", "recorded")
FAR = 0.3  # [-] of a parameter's logarithm: how far from the truth its lowest loss is sought
SCALE = 1e6  # [-] losses are of the order of 1e-6 m^2, below what scipy's tolerances are made for

Point = NDArray[np.float64]


def read(module: Any, data: RecordingsDataModule) -> list[dict[str, Tensor]]:
    """Return batches with the pose that the encoder reads from each first frame, and the recorded ones."""
    found = []
    for batch in data.train_dataloader():
        with torch.no_grad():
            encoded = module.model.encode(as_image(batch["frames"]), as_image(batch["background"])).pose
        found.append({**batch, "encoded": encoded, "recorded": batch["pose"][:, :1].to(encoded)})
    return found


@torch.no_grad()
def loss(module: Any, batches: list[dict[str, Tensor]], which: str, frames: int, point: Point) -> float:
    """Return the mean loss of trajectories rolled out over so many frames at a point ln(parameter) (P,)."""
    module.model.physical.coordinates.copy_(torch.from_numpy(point))
    total = []
    for batch in batches:
        rolled = module.model.roll_out(batch[which], batch["shown"], batch["wrench"][:, :frames])[:, ::EVERY]
        residual = pose_difference(rolled, batch["pose"][:, :frames][:, ::EVERY].to(rolled))
        total.append(sum(module.objective.pose_loss(residual, torch.ones(residual.shape[:2])).values()))
    return SCALE * float(torch.cat(total).mean())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a run of `physid fit`, with supervision")
    parser.add_argument("recordings", type=Path, help="the recordings that it learned from")
    parser.add_argument("--frames", type=int, nargs="+", default=[60, 100, 300], help="frames that are rolled out")
    given = parser.parse_args()
    torch.set_num_threads(1)
    module: Any = restore(given.run, given.recordings)
    module.eval()
    data = RecordingsDataModule(
        given.recordings, batch_size=AT_ONCE, video=[0], every=EVERY, limit=TRAJECTORIES, shuffle=False
    )
    truth = read_truth(given.recordings / FILE)
    if truth is None:
        raise SystemExit(f"{given.recordings}: expected {FILE}, found none")
    names = module.model.physical.names
    true = np.log([truth.parameters[name] for name in names])
    learned = module.model.physical.coordinates.detach().numpy().copy()
    batches = read(module, data)
    alone_too = " | ".join(f"{name} alone" for name in names)
    together = ", ".join(names)
    print(f"| rolled out from | frames | {together} | {alone_too} | loss at the truth | at the run's end |")
    for which in WHICH:
        for frames in given.frames:

            def at(point: Point, which: str = which, frames: int = frames) -> float:
                return loss(module, batches, which, frames, point)

            def alone(place: int) -> float:
                def one(value: float) -> float:
                    point = learned.copy()
                    point[place] = value
                    return at(point)

                span = (true[place] - FAR, true[place] + FAR)
                return float(minimize_scalar(one, bounds=span, options={"xatol": 1e-4}).x) - float(true[place])

            best = minimize(at, learned, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-4})
            where = ", ".join(f"{100 * np.expm1(x):+.2f} %" for x in best.x - true)
            each = " | ".join(f"{100 * np.expm1(alone(place)):+.2f} %" for place in range(len(names)))
            print(f"| {which} poses | {frames} | {where} | {each} |", end="")
            print(f" {at(true) / best.fun:.3g} | {at(learned) / best.fun:.3g} |", flush=True)


if __name__ == "__main__":
    main()
