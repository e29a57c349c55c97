"""A pusher that does not act through the centre."""

from dataclasses import dataclass
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.physics import Effect, Site, State, StepInputs, quantity
from physid.physics.rotations import rotate


@final
@dataclass(frozen=True)
class ForceOffset(Effect):
    """tau' = tau + R (x, y, 0) x f: the force f acts at a point of the body beside its centre.

    The point moves with the body, so this effect needs the attitude R and acts at the step. It moves the point of
    application of all forces listed before it: put it before effects of the other sites.

    Attributes:
        x: Along the first axis of the body [m].
        y: Along the second axis of the body [m].
    """

    name: ClassVar[str] = "force_offset"
    site: ClassVar[Site] = "actuation"
    x: Tensor = quantity("m", low=-0.1, high=0.1, typical=0.01)
    y: Tensor = quantity("m", low=-0.1, high=0.1, typical=0.01)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add the torque of the force about the centre."""
        arm = torch.stack([self.x, self.y, torch.zeros_like(self.x)], -1)[:, None]
        return inputs.add_torque(torch.linalg.cross(rotate(state.quaternion, arm), inputs.wrench[..., 3:]))
