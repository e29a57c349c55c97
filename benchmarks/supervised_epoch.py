"""Where the time of an epoch of supervised learning from video goes, phase by phase, in CPU time of one thread.

    python benchmarks/supervised_epoch.py                  64 films of 300 frames
    python benchmarks/supervised_epoch.py --films 16

Films of `push` are made first. Each phase then runs alone, one epoch to warm up and two that are profiled; the parts
do not overlap, and "the rest" is what Lightning, logging and the losses take. At last the warm-up runs as it would
without what makes its convolutions cheap.
"""

from __future__ import annotations

import argparse
import cProfile
import logging
import pstats
import tempfile
import time
import warnings
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from unittest import mock

import lightning as L
import torch

from physid.data.batches.datamodule import RecordingsDataModule
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig
from physid.networks import PoseEncoder
from physid.networks.encoder import Layers
from physid.training.learners.phases import Phases
from physid.training.learners.supervised import SupervisedID
from physid.training.learners.video import Objective
from physid.training.refinement.horizon import Horizon
from physid.training.vision.drawing.synthetic_images import SyntheticImages
from physid.training.vision.pose_refinement import PoseRefinement
from physid.training.vision.reading import Vision

EPOCHS = 2
PHASES = {"warm-up": Phases(warm_up=3, refine=0), "joint": Phases(0, 0), "refine": Phases(warm_up=0, refine=3)}
PARTS = {
    "decode frames": ("dataset.py", "_film"),
    "imagine images": ("synthetic_images.py", "draw_images"),
    "encode": ("video/model.py", "encode"),
    "roll out": ("video/model.py", "roll_out"),
    "backward": ("module.py", "manual_backward"),
    "optimizer": ("adam.py", "step"),
    "pose_refinement": ("refine.py", "__call__"),
    "normal equations": ("refinement.py", "add_to"),
}
"""File and function of each part."""


class Profiled(L.Callback):
    """Profiles all epochs but the first, which compiles and reads things once."""

    def __init__(self) -> None:
        self.profile, self.seconds, self._start = cProfile.Profile(time.process_time), 0.0, 0.0

    def on_train_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Begin."""
        if trainer.current_epoch == 1:
            self._start = time.process_time()
            self.profile.enable()

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """End."""
        self.profile.disable()
        self.seconds = time.process_time() - self._start


def measure(folder: Path, phases: Phases, *, fast: bool | None = None) -> tuple[float, Mapping[str, float]]:
    """Return the CPU time of an epoch [s], and of each part [s]; fast is that of `Layers`."""
    L.seed_everything(0, verbose=False)
    model = SupervisedID(
        learn=["block.friction"],
        encoder=partial(PoseEncoder, layers=Layers(fast=fast)),
        vision=Vision(pose_refinement=PoseRefinement(steps=8, headings=24)),
        objective=Objective(synthetic_images=SyntheticImages(frames=4), horizon=Horizon(trajectories=2)),
        phases=phases,
    )
    data, profiled = RecordingsDataModule(str(folder), batch_size=4, video=[0], draw=1, every=10), Profiled()
    trainer = L.Trainer(
        max_epochs=EPOCHS + 1, accelerator="cpu", callbacks=[profiled], logger=False, enable_checkpointing=False,
        enable_progress_bar=False, default_root_dir=folder.parent, enable_model_summary=False, limit_val_batches=0,
    )  # fmt: skip
    trainer.fit(model, datamodule=data)
    spent = dict.fromkeys(PARTS, 0.0)
    for (file, _, name), (*_, cumulative, _) in pstats.Stats(profiled.profile).stats.items():  # type: ignore[attr-defined]
        for part, (wanted, function) in PARTS.items():
            if name == function and file.endswith(wanted):
                spent[part] += cumulative
    return profiled.seconds / EPOCHS, {part: value / EPOCHS for part, value in spent.items()}


def main() -> None:
    """Print one line per phase."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--films", type=int, default=64)
    films = parser.parse_args().films
    torch.set_num_threads(1)
    logging.getLogger("lightning.pytorch").setLevel(logging.ERROR)
    warnings.filterwarnings("ignore")
    with tempfile.TemporaryDirectory() as folder:
        generate(GenerateConfig("push", trajectories=films), Path(folder, "push"), quiet=True)
        print(f"| phase | CPU time of an epoch [s] | {' | '.join(f'{part} [%]' for part in PARTS)} | the rest [%] |")
        print("|---" * (len(PARTS) + 3) + "|")
        for name, phases in PHASES.items():
            whole, parts = measure(Path(folder, "push"), phases)
            shares = [100 * value / whole for value in parts.values()]
            cells = [f"{share:.0f}" if share >= 0.5 else "" for share in [*shares, 100 - sum(shares)]]
            print(f"| {name} | {whole:.2f} | {' | '.join(cells)} |", flush=True)
        shipped, _ = measure(Path(folder, "push"), PHASES["warm-up"])
        with mock.patch("physid.networks.encoder.convolve_focused", lambda layers, image, occupied: layers(image)):
            whole, _ = measure(Path(folder, "push"), PHASES["warm-up"])
            single, _ = measure(Path(folder, "push"), PHASES["warm-up"], fast=False)
    print(
        f"\nwarm-up, an epoch [s]: {shipped:.2f} as shipped, {whole:.2f} with convolutions of whole images, "
        f"{single:.2f} with those in single precision"
    )


if __name__ == "__main__":
    main()
