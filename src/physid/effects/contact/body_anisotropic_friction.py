"""A sole with a grain: friction depends on the heading of the slip relative to the body."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.effects.touch import grain, slip
from physid.physics import Effect, Site, State, StepInputs, quantity
from physid.physics.rotations import to_matrix


@final
@dataclass(frozen=True)
class BodyAnisotropicFriction(Effect):
    """mu' = mu (1 + a cos 2p + b sin 2p), p the heading of the slip on the ground from the body's first axis.

    The law of `anisotropic_friction`, with a grain that turns with the body. The heading fades out below a slip of
    0.01 m/s, where mu' tends to mu.

    Attributes:
        along: a [-], friction along the body's first axis against across it.
        oblique: b [-], friction at 45 degrees against at 135 degrees.
    """

    name: ClassVar[str] = "body_anisotropic_friction"
    site: ClassVar[Site] = "contact"
    slowest: ClassVar[float] = 0.01
    along: Tensor = quantity("-", low=-0.6, high=0.6, typical=0.3)
    oblique: Tensor = quantity("-", low=-0.6, high=0.6, typical=0.3)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Change the friction with the ground by heading."""
        velocity = slip(state, inputs)
        axes = to_matrix(state.quaternion)
        x, y = (velocity * axes[..., 0]).sum(-1), (velocity * axes[..., 1]).sum(-1)
        square = velocity.square().sum(-1) + self.slowest**2
        factor = grain(x, y, square, self.along, self.oblique)
        return inputs.replace(ground_friction=inputs.ground_friction * factor)
