"""Commands that arrive late."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics.effect import Effect, Site, quantity


@final
@dataclass(frozen=True)
class ForceDelay(Effect):
    """w'(t) = w(t - d) for the commanded wrench w, averaged over each step; w = 0 before the first frame.

    Commands are held over a step h, so with d = (n + r) h the mean over step k is exactly (1 - r) w_{k-n} + r
    w_{k-n-1}. This is continuous in d, and at d = 0 its derivative is (w_{k-1} - w_k) / h.

    Attributes:
        delay: d [s].
    """

    name: ClassVar[str] = "force_delay"
    site: ClassVar[Site] = "actuation"
    delay: Tensor = quantity("s", low=0.0, high=0.1, typical=0.02)

    def actuate(self, wrench: Tensor, time_step: float) -> Tensor:
        """Shift the commanded wrenches."""
        steps = self.delay / time_step
        # Below zero the first interval continues, so that differences taken around the null value are right.
        whole = steps.detach().floor().clamp_min(0)
        rest = (steps - whole)[:, None, None, None]
        return (1 - rest) * _earlier(wrench, whole.long()) + rest * _earlier(wrench, whole.long() + 1)


def _earlier(wrench: Tensor, steps: Tensor) -> Tensor:
    """Return the wrenches (B, T, N, 6) that were commanded whole `steps` (1 or B,) before; zero before the first."""
    index = torch.arange(wrench.shape[1], device=wrench.device) - steps[:, None]
    index = index.expand(wrench.shape[0], -1)[..., None, None]
    taken = wrench.gather(1, index.clamp_min(0).expand_as(wrench))
    return torch.where(index < 0, torch.zeros_like(taken), taken)
