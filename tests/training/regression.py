"""The smallest model and data that a run takes, for tests of runs alone: a line through twelve points."""

from __future__ import annotations

from typing import Any

import lightning as L
import torch
from torch import Tensor
from torch.utils.data import DataLoader, TensorDataset


class Line(L.LightningModule):
    """A linear regression."""

    def __init__(self, rate: float = 0.01, harm: bool = False) -> None:
        super().__init__()
        self.net, self.rate, self.harm = torch.nn.Linear(3, 1), rate, harm

    def training_step(self, batch: list[Tensor], batch_idx: int) -> Tensor:
        loss: Tensor = (self.net(batch[0]) - batch[0].sum(-1, keepdim=True)).square().mean()
        self.log("train/loss", loss, on_step=False, on_epoch=True)
        return loss

    def on_train_start(self) -> None:
        if self.harm:
            raise KeyError("a mistake of the user's own")

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.Adam(self.parameters(), self.rate)


class Points(L.LightningDataModule):
    """Twelve points, shuffled."""

    def train_dataloader(self) -> DataLoader[Any]:
        return DataLoader(TensorDataset(torch.arange(36.0).reshape(12, 3) / 36), batch_size=4, shuffle=True)
