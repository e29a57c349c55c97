"""Steps of learning from video: rates by the phase, gradients clipped, nothing that is not finite."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, cast

import lightning as L
import torch
from torch import Tensor
from torch.optim import SGD, AdamW, Optimizer

from physid.data.files import read_tensors
from physid.training.learners.phases import Phases, epochs_done, epochs_of
from physid.training.parameters import PhysicalParameters
from physid.training.training_module import NonFiniteLossError, OptimizerFactory
from physid.training.vision import VideoModel

DEFAULT_OPTIMIZER: OptimizerFactory = partial(AdamW, lr=1e-3, weight_decay=1e-2)
LARGEST_GRADIENT = 1.0


def build_optimizers(factory: OptimizerFactory, model: VideoModel, parameter_rate: float) -> list[Optimizer]:
    """Build the optimizer that follows the gradient, of two groups, and the one that takes steps found elsewhere.

    Args:
        factory: Gives the first; its rate of learning is the encoder's highest.
        model: What is learned: the encoder, and the logarithms of the physical parameters.
        parameter_rate: The parameters' highest rate of learning, about their relative change in one step of Adam.

    Returns:
        Both; the second moves each logarithm by minus its gradient.
    """
    parameters = list(model.physical.parameters())
    encoder = [*model.encoder.parameters(), *model.supervision.parameters()]
    groups = [
        {"name": "encoder", "params": encoder},
        {"name": "parameters", "params": parameters, "lr": parameter_rate, "weight_decay": 0.0},
    ]
    optimizer = cast(Callable[[Any], Optimizer], factory)(groups)
    for group in optimizer.param_groups:
        group["highest"] = group["lr"]
    return [optimizer, SGD([{"name": "refinement", "params": parameters}], lr=1.0)]


def take_step(module: L.LightningModule, loss: Tensor, phases: Phases, batch_idx: int) -> None:
    """Descend along the gradient of a loss, at the rates of the phase.

    Raises:
        NonFiniteLossError: If the gradient is not finite; nothing is changed then.
    """
    trainer = module.trainer
    done, epochs = epochs_done(trainer, batch_idx), epochs_of(trainer)
    optimizer = cast(Sequence[Optimizer], module.optimizers())[0]
    rates = (phases.encoder_share(done, epochs), phases.parameter_share(done, epochs))
    for group, rate in zip(optimizer.param_groups, rates, strict=True):
        group["lr"] = rate * group["highest"]
    optimizer.zero_grad()
    module.manual_backward(loss)
    for group in optimizer.param_groups:
        norm = torch.nn.utils.clip_grad_norm_(group["params"], LARGEST_GRADIENT)
        if not torch.isfinite(norm):
            raise NonFiniteLossError(
                f"the gradient is not finite in epoch {trainer.current_epoch}; lower the learning rate or shorten the "
                "horizon; checkpoints/last.ckpt holds the last good state"
            )
    optimizer.step()
    PhysicalParameters.of(module).confine()


def take_encoder(model: VideoModel, checkpoint: Path) -> None:
    """Replace a model's encoder by that of another run.

    Raises:
        ValueError: If there is no such checkpoint, or its encoder is of another kind.
    """
    if not checkpoint.is_file():
        raise ValueError(f"model.vision.weights: expected a checkpoint of a fit from video, found none at {checkpoint}")
    state = read_tensors(checkpoint, ("state_dict",))["state_dict"]
    for name, part in (("encoder", model.encoder), ("supervision", model.supervision)):
        prefix = f"model.{name}."
        try:
            part.load_state_dict({key.removeprefix(prefix): state[key] for key in state if key.startswith(prefix)})
        except RuntimeError as error:
            reason = str(error).splitlines()[-1].strip()
            raise ValueError(
                f"{checkpoint}: expected an encoder of the same method and chart, found another: {reason}"
            ) from None
