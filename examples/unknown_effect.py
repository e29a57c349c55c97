"""An effect that no catalogue has: it is unknown, what is missing is said in words, and written down it is found.

MuJoCo records pushes of a block under a force across its velocity. The first diagnosis knows the catalogue only, and
leaves what it says is missing as an effect, a table of sizes, which the second one tries. The formula behind it stands
below as an effect, and is a candidate of the third.
Run it: python examples/unknown_effect.py [FOLDER]
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar, final

import torch
from torch import Tensor

from physid.data import RecordingSet
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig, Noise
from physid.diagnosis import MISSING, Diagnosis, summary_lines
from physid.diagnosis.diagnose import diagnose
from physid.effects.loading import own_effects
from physid.physics import Effect, Site, State, StepInputs, quantity

COEFFICIENT = 0.8
TOLERANCE = 0.1


@final
@dataclass(frozen=True)
class SideForce(Effect):
    """F = c z x v: a force to the left of the motion.

    Attributes:
        coefficient: c [N s/m].
    """

    name: ClassVar[str] = "side_force"
    site: ClassVar[Site] = "dynamics"
    coefficient: Tensor = quantity("N s/m", low=-5.0, high=5.0, typical=0.4)

    def act(self, state: State, inputs: StepInputs) -> StepInputs:
        """Add the force."""
        x, y, z = state.velocity.unbind(-1)
        return inputs.add_force(self.coefficient[:, None, None] * torch.stack([-y, x, 0 * z], -1))


def main(folder: Path) -> None:
    """Record, diagnose, try what is missing as it was measured, then as a formula."""
    hidden = GenerateConfig(
        scene="push",
        protocol="rich",
        simulator="mujoco",
        frame_rate=60.0,
        trajectories=12,
        steps=75,
        video=False,
        unknown=("block.mass", "block.friction"),
        guess_factor=1.2,
        noise=Noise(position=0.0005, rotation=0.002),
    )
    effect = SideForce(coefficient=torch.tensor([COEFFICIENT], dtype=torch.float64))
    generate(hidden, folder / "recordings", effects=(effect,), quiet=True)
    recordings = RecordingSet(folder / "recordings")
    first = diagnose(recordings, folder / "first")
    print("\n".join(summary_lines(first)))
    if first.verdict != "unknown" or [law.direction for law in first.residual][:1] != ["across the velocity"]:
        raise SystemExit(f"an unknown force across the velocity was hidden, the verdict is {first.verdict}")
    measured = own_effects([str(folder / "first" / MISSING)])
    _blaming("missing_force", diagnose(recordings, folder / "measured", effects=measured))
    found = _blaming("side_force", diagnose(recordings, folder / "formula", effects=[SideForce]))
    estimate = found.effects[0].parameters["coefficient"].value
    if abs(estimate / COEFFICIENT - 1) > TOLERANCE:
        raise SystemExit(f"the force is off by {estimate / COEFFICIENT - 1:.1%}; at most {TOLERANCE:.0%} is right")


def _blaming(name: str, found: Diagnosis) -> Diagnosis:
    """Print a diagnosis that blames an effect; end the program where it does not."""
    print("\n".join(["", *summary_lines(found)]))
    if found.blamed != (name,):
        raise SystemExit(f"at work is {name}, blamed is {', '.join(found.blamed) or 'nothing'}")
    return found


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with TemporaryDirectory() as made:
            main(Path(made))
