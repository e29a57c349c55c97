"""Hide a drag in recordings and find it: where the model is off, what it lacks, and how far the gap closes.

PyBullet records pushes of a block with an effect that the model does not know. `diagnose` sees the recordings only.
Run it: python examples/diagnose_hidden_drag.py
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from physid.data import RecordingSet
from physid.data.generation.generate import generate
from physid.data.generation.settings import GenerateConfig, Noise
from physid.diagnosis.diagnose import diagnose
from physid.diagnosis.document.sentences import summary_lines

DRAG = 0.5
TOLERANCE = 0.1


def main() -> None:
    """Record, diagnose and check."""
    hidden = GenerateConfig(
        scene="push",
        protocol="rich",
        protocol_of_split={"report_transfer": "paper"},
        trajectories=10,
        steps=120,
        video=False,
        split={"fit": 6, "report_same": 2, "report_transfer": 2},
        unknown=("block.friction",),
        guess_factor=1.3,
        effects={"viscous_drag": {"coefficient": DRAG}},
        noise=Noise(position=0.0005, rotation=0.002),
    )
    with TemporaryDirectory() as folder:
        generate(hidden, Path(folder, "recordings"), workers=1, quiet=True)
        found = diagnose(RecordingSet(Path(folder, "recordings")), Path(folder, "diagnosis"))
    print("\n".join(summary_lines(found)))
    named = {effect.name: effect.parameters for effect in found.effects}
    if list(named) != ["viscous_drag"]:
        raise SystemExit(f"hidden was a viscous drag, blamed is {', '.join(named) or 'nothing'}")
    estimate = named["viscous_drag"]["coefficient"].value
    if abs(estimate / DRAG - 1) > TOLERANCE:
        raise SystemExit(f"the drag is off by {estimate / DRAG - 1:.1%}; at most {TOLERANCE:.0%} is right")


if __name__ == "__main__":
    main()
