"""A ground with a grain: friction depends on the heading of the slip."""

from dataclasses import dataclass
from typing import ClassVar, final

from torch import Tensor

from physid.effects.touch import grain, slip
from physid.physics import Effect, Site, State, StepInputs, quantity


@final
@dataclass(frozen=True)
class AnisotropicFriction(Effect):
    """mu' = mu (1 + a cos 2p + b sin 2p), p the heading of the slip on the ground from the world's first axis.

    The second harmonic of a grain at any angle, linear in both parameters; friction stays opposed to the slip. The
    heading fades out below a slip of 0.01 m/s, where mu' tends to mu.

    Attributes:
        along: a [-], friction along the first axis against across it.
        oblique: b [-], friction at 45 degrees against at 135 degrees.
    """

    name: ClassVar[str] = "anisotropic_friction"
    site: ClassVar[Site] = "contact"
    slowest: ClassVar[float] = 0.01
    along: Tensor = quantity("-", low=-0.6, high=0.6, typical=0.3)
    oblique: Tensor = quantity("-", low=-0.6, high=0.6, typical=0.3)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Change the friction with the ground by heading."""
        x, y, _ = slip(state, inputs).unbind(-1)
        square = x**2 + y**2 + self.slowest**2
        factor = grain(x, y, square, self.along, self.oblique)
        return inputs.replace(ground_friction=inputs.ground_friction * factor)
