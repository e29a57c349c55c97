"""A user's own effect in a file."""

import re
from pathlib import Path

import pytest
import torch

from physid.effects.loading import load, own_effects
from physid.effects.probe import draw_probe

GUIDE = Path(__file__).parents[2] / "docs" / "adding_an_effect.md"


def worked_example() -> str:
    """Return the first block of Python in the guide."""
    block = re.search(r"```python\n(.*?)```", GUIDE.read_text(), re.DOTALL)
    assert block is not None
    return block.group(1)


@pytest.fixture
def example(tmp_path: Path) -> Path:
    """Write the worked example of the guide to a file."""
    path = tmp_path / "my_effects.py"
    path.write_text(worked_example())
    return path


def test_the_worked_example_of_the_guide_obeys_all_laws_and_does_what_it_says(example: Path) -> None:
    effect = load(f"{example}:MagneticBrake")
    probe = draw_probe()
    after = effect(coefficient=torch.tensor([2.0], dtype=torch.float64)).act(probe.state, probe.inputs)
    x, y = probe.state.position[..., 0], probe.state.position[..., 1]
    wanted = -2.0 * torch.exp(-(x**2 + y**2) / 0.3**2)[..., None] * probe.state.velocity
    assert torch.allclose(after.wrench[..., 3:] - probe.inputs.wrench[..., 3:], wanted)


def test_own_effects_have_names_of_their_own(example: Path) -> None:
    assert [effect.name for effect in own_effects([f"{example}:MagneticBrake"])] == ["magnetic_brake"]
    with pytest.raises(ValueError, match="magnetic_brake more than once"):
        own_effects([f"{example}:MagneticBrake"] * 2)


@pytest.mark.parametrize("place", ["my_effects.py", ":MyEffect", "my_effects.py:"])
def test_a_place_without_file_or_class_is_refused(place: str) -> None:
    with pytest.raises(ValueError, match=r"FILE\.py:CLASS"):
        load(place)


def test_what_cannot_be_loaded_is_explained(example: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no file"):
        load(f"{tmp_path}/none.py:MagneticBrake")
    with pytest.raises(ValueError, match='has no class "MagnetBrake"; did you mean "MagneticBrake"'):
        load(f"{example}:MagnetBrake")
    broken = tmp_path / "broken.py"
    broken.write_text(worked_example().replace("state.velocity", "state.speed"))
    with pytest.raises(
        ValueError, match=r"fails where its laws are checked: AttributeError: .*speed.*adding_an_effect"
    ):
        load(f"{broken}:MagneticBrake")
    with pytest.raises(ValueError, match="must be a class derived from"):
        load(f"{example}:torch")
    broken = tmp_path / "broken.py"
    broken.write_text("1 / 0")
    with pytest.raises(ValueError, match="cannot be run: ZeroDivisionError"):
        load(f"{broken}:Any")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"magnetic_brake"', '"viscous_drag"', "taken by the catalogue"),
        ('"magnetic_brake"', '"Magnetic Brake"', "name must be a word"),
        ('"dynamics"', '"magic"', "site must be one of actuation, dynamics, contact, perception"),
        ("frozen=True", "frozen=False", "frozen dataclass"),
        ("F = -c exp(-(x^2 + y^2) / r^2) v with r = 0.3 m, a", "A", "must begin with its formula"),
        ("typical=1.0", "typical=0.0", "null and a typical value"),
        ("def act", "def work", "must override one of"),
        ("-self.coefficient", "1 - self.coefficient", "must change nothing at its null values"),
        ("-self.coefficient[", "-(self.coefficient**2)[", "other than zero at its null value"),
        ("-self.coefficient[", "-self.coefficient.sqrt()[", "finite derivative at its null value"),
        ("-self.coefficient[:, None, None]", "-self.coefficient.mean()", "each world of a batch by itself"),
    ],
)
def test_an_effect_that_breaks_a_law_is_refused(example: Path, old: str, new: str, message: str) -> None:
    text = example.read_text()
    assert old in text
    example.write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=message):
        load(f"{example}:MagneticBrake")
