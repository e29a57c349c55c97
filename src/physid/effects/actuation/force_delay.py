"""Commands that arrive late."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics import Effect, Site, quantity


@final
@dataclass(frozen=True)
class ForceDelay(Effect):
    """w'(t) = w(t - d) for the commanded wrench w, averaged over each step; w = 0 before the first frame.

    Commands are held over steps of any lengths h_k. With the impulse that is still under way at t_k, G_k = int w dt
    from t_k - d to t_k, the mean over step k is w_k + (G_k - G_{k+1}) / h_k. This is continuous in d, and at d = 0 its
    derivative is (w_{k-1} - w_k) / h_k.

    Attributes:
        delay: d [s].
    """

    name: ClassVar[str] = "force_delay"
    site: ClassVar[Site] = "actuation"
    delay: Tensor = quantity("s", low=0.0, high=0.1, typical=0.02)

    def actuate(self, wrench: Tensor, time: Tensor) -> Tensor:
        """Shift the commanded wrenches."""
        edges = with_end(time)
        length = edges.diff(dim=1)
        given = torch.cat([torch.zeros_like(wrench[:, :1]), wrench * length[..., None, None]], 1).cumsum(1)
        # The interval in which t_k - d lies; below d = 0 the last one continues: differences around null are right.
        late = (edges - self.delay.detach()[:, None]).contiguous()
        steps = torch.arange(edges.shape[1], device=wrench.device)
        held = (torch.searchsorted(edges.expand(len(late), -1).contiguous(), late) - 1).minimum(steps - 1)
        left, begun = _rows(given, held + 1), (held >= 0)[..., None, None]
        last = _rows(wrench, held.clamp_min(0))
        open_for = edges.expand(len(late), -1).gather(1, held + 1) - edges + self.delay[:, None]
        under_way = torch.where(begun, given - left + last * open_for[..., None, None], given)
        return wrench - under_way.diff(dim=1) / length[..., None, None]


def with_end(time: Tensor) -> Tensor:
    """Append the time at which the last row ends, as long as the row before it; shape (..., T + 1)."""
    last = time[:, -1:]
    return torch.cat([time, last + (last - time[:, -2:-1] if time.shape[1] > 1 else torch.ones_like(last))], 1)


def _rows(values: Tensor, index: Tensor) -> Tensor:
    """Return rows (1 or B, T') of values (B, T'', N, 6)."""
    index = index.expand(values.shape[0], -1)[..., None, None]
    return values.gather(1, index.expand(*index.shape[:2], *values.shape[2:]))
