"""An actuator that needs time to build up its force."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.effects.actuation.force_delay import with_end
from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class ForceLag(Effect):
    """tau dw'/dt = w - w', averaged over each step, for the commanded wrench w; w' is zero at the first frame.

    Commands are held over steps h_k, so with e = exp(-h_k / tau) the lagging wrench goes as y_{k+1} = w_k + e (y_k -
    w_k), and its mean over step k is w_k + (tau / h_k) (1 - e) (y_k - w_k). At tau = 0 the derivative is (w_{k-1} -
    w_k) / h_k: a lag and a delay start alike.

    Attributes:
        time_constant: tau [s].
    """

    name: ClassVar[str] = "force_lag"
    site: ClassVar[Site] = "actuation"
    time_constant: Tensor = quantity("s", low=0.0, high=0.2, typical=0.03)

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        """Filter the commanded wrenches."""
        # Where tau < h / 500, exp(-h / tau) is below the smallest number; leaving it out keeps the derivative finite.
        length, constant = with_end(time).diff(dim=1), self.time_constant[:, None]
        fast = constant < length / 500
        slow = torch.where(fast, length, constant)
        decay = torch.where(fast, torch.zeros_like(slow), torch.exp(-length / slow))
        share = constant / length * (1 - decay)
        lagging, means = torch.zeros_like(wrench[:, 0]), []
        for k, command in enumerate(wrench.unbind(1)):
            behind = lagging - command
            means.append(command + share[:, k, None, None] * behind)
            lagging = command + decay[:, k, None, None] * behind
        return torch.stack(means, 1)
