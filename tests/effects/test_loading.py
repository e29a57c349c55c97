"""A user's own effect in a file."""

import re
from pathlib import Path

import pytest
import torch

from physid.cli import main
from physid.effects import from_values, known_effects
from physid.effects.loading import admit_files, load, own_effects
from physid.effects.probe import draw_probe
from physid.estimation.prediction.coordinates import is_effect
from physid.training.parameters import read_posterior

GUIDE = Path(__file__).parents[2] / "docs" / "adding_an_effect.md"


def worked_example() -> str:
    """Return the first block of Python in the guide."""
    block = re.search(r"```python\n(.*?)```", GUIDE.read_text(), re.DOTALL)
    assert block is not None
    return block.group(1)


@pytest.fixture
def nothing_admitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Admit effects for the time of a test."""
    monkeypatch.setattr("physid.effects._admitted", {})


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


def test_a_file_stands_for_all_effects_that_it_defines(example: Path, tmp_path: Path) -> None:
    assert [effect.name for effect in own_effects([str(example)])] == ["magnetic_brake"]
    both = tmp_path / "both.py"
    _, _, second = worked_example().partition("@final")
    second = second.replace("MagneticBrake", "Second").replace("magnetic_brake", "second_brake")
    both.write_text(f"{worked_example()}\n\n@final{second}")
    assert [effect.name for effect in own_effects([str(both)])] == ["magnetic_brake", "second_brake"]
    aliased = f'{worked_example()}\n\nBrake = MagneticBrake\n\n\nclass Base(Effect):\n    """Of others."""\n'
    both.write_text(aliased)
    assert [effect.name for effect in own_effects([str(both)])] == ["magnetic_brake"]
    both.write_text("from physid.physics import Effect\nfrom physid.effects.dynamics.tether import Tether\n")
    with pytest.raises(ValueError, match=r"both\.py defines no effect, which is a class derived from"):
        own_effects([str(both)])


@pytest.mark.usefixtures("nothing_admitted")
def test_effects_that_are_admitted_are_found_like_those_of_the_catalogue(example: Path) -> None:
    with pytest.raises(ValueError, match=r'unknown effect "magnetic_brake".*need --allow FILE\.py'):
        from_values("magnetic_brake", {"coefficient": 1.0})
    assert not is_effect("magnetic_brake.coefficient")
    assert admit_files(["my_package", f"{example}:MagneticBrake"]) == ("my_package",)
    assert from_values("magnetic_brake", {"coefficient": 1.0}).values()["coefficient"].tolist() == [1.0]
    assert is_effect("magnetic_brake.coefficient")
    assert [kind.name for kind in known_effects()][-1] == "magnetic_brake"
    timed = example.parent / "12:00" / "my_effects.py"
    timed.parent.mkdir()
    timed.write_text(example.read_text())
    assert admit_files([str(timed)]) == admit_files([f"{timed}:MagneticBrake"]) == ()
    assert admit_files([str(example)]) == (), "to admit them again replaces them"


@pytest.mark.slow
@pytest.mark.usefixtures("nothing_admitted")
def test_an_effect_of_a_file_is_generated_by_workers_fitted_tested_and_sampled(
    example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    made = "generate --config generate/push --out brake trajectories=8 steps=60 video=false protocol=rich --workers 2"
    words = [*made.split(), "simulator=mujoco", "frame_rate=60", "effects.magnetic_brake.coefficient=4.0"]
    assert main(words) == 2
    assert "need --allow FILE.py" in capsys.readouterr().err
    assert not (tmp_path / "brake").exists()
    assert main([*words, "--allow", str(example)]) == 0
    learn = "model.learn=[block.mass,block.friction,magnetic_brake.coefficient]"
    assert main(["fit", "brake", learn, "--allow", str(example)]) == 0
    known = read_posterior(tmp_path / "runs" / "brake")
    assert dict(zip(known.names, known.space.to_values(known.point).tolist(), strict=True)) == {
        "block.mass": pytest.approx(2.0, rel=1e-3),
        "block.friction": pytest.approx(0.12, rel=1e-3),
        "magnetic_brake.coefficient": pytest.approx(4.0, rel=2e-2),
    }
    monkeypatch.setattr("physid.effects._admitted", {})
    assert main(["test", "--run-dir", "runs/brake"]) == 2
    assert "those of your own need --allow FILE.py" in capsys.readouterr().err
    assert main(["sample", "runs/brake"]) == 0, "what is known of it needs no file"
    assert main(["test", "--run-dir", "runs/brake", "--allow", str(example)]) == 0


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
