"""The configuration of a set is closed and typed."""

from collections import Counter

import pytest

from physid.data.generation.settings import GenerateConfig
from physid.data.splits import assign_splits


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"scene": "pussh"}, 'unknown scene "pussh"; did you mean "push"'),
        ({}, "generate: missing key scene"),
        ({"scene": "push", "trajectorys": 3}, 'unknown key "trajectorys"; did you mean "trajectories"'),
        ({"scene": "push", "trajectories": 0}, "trajectories must be a whole number of at least 1, got 0"),
        ({"scene": "push", "video": "yes"}, "generate: video: expected true or false, found 'yes'"),
        ({"scene": "push", "protocol": "papr"}, 'no protocol "papr"; did you mean "paper"'),
        ({"scene": "push", "split": {"trian": 1}}, 'unknown split "trian"; did you mean "train"'),
        ({"scene": "push", "unknown": ["block.masss"]}, 'unknown parameter "block.masss"; did you mean "block.mass"'),
        ({"scene": "push", "true_values": {"block.mass": -1.0}}, "block.mass must be a number above 0"),
        ({"scene": "push", "noise": {"positon": 1.0}}, 'noise: unknown key "positon"; did you mean "position"'),
        (
            {"scene": "push", "effects": {"viscus_drag": {}}},
            'unknown effect "viscus_drag"; did you mean "viscous_drag"',
        ),
        ({"scene": "push", "effects": {"viscous_drag": {"coeff": 1.0}}}, 'no parameter "coeff"; did you mean "coeffic'),
        ({"scene": "push", "simulator": "mujuco"}, 'unknown simulator "mujuco"; did you mean "mujoco"'),
        ({"scene": "push", "frame_rate": 0.0}, "frame_rate must be a number of at least 0.01, got 0.0"),
        ({"scene": "push", "jitter": 0.5}, "jitter must be at most 0.4, got 0.5"),
        ({"scene": "push", "missing": 0.95}, "missing must be at most 0.9, got 0.95"),
        ({"scene": "push", "force_rate": -1.0}, "force_rate must be a number of at least 0.01, got -1"),
        ({"scene": "push", "simulator": 3}, "simulator: expected a text, found 3"),
        (
            {"scene": "push", "unknown": "block.mass"},
            r"unknown: expected a list such as \[block.mass\], found",
        ),
        ({"scene": "push", "split": [1]}, r"split: expected a mapping, found \[1\]"),
        ({"scene": "push", "effects": {"viscous_drag": {"coefficient": "1"}}}, "effects.* a finite number, found '1'"),
        ({"scene": "push", "substeps": 0}, "substeps must be a whole number of at least 1, got 0"),
        ({"scene": "push", "seed": 1.5}, "seed: expected a whole number, found 1.5"),
    ],
)
def test_a_mistake_is_named_before_anything_is_made(values: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        GenerateConfig.from_mapping(values).build_effects()


def test_a_configuration_written_and_read_again_is_the_same() -> None:
    config = GenerateConfig("collide", unknown=("block.mass", "block.friction"), effects={"force_gain": {"gain": 0.1}})
    assert GenerateConfig.from_mapping(config.to_mapping()) == config


def test_bodies_of_one_material_have_one_guess_and_one_truth() -> None:
    config = GenerateConfig("collide", unknown=("block.friction",), guess_factor=1.5)
    assert [body.friction for body in config.known_scene().bodies] == pytest.approx([0.15, 0.15])
    assert config.true_parameters() == {
        "block.mass": 1.5,
        "block.friction": 0.1,
        "block.restitution": 0.0,
        "other.mass": 1.0,
    }


def test_splits_have_their_shares_and_so_has_any_first_part() -> None:
    assert Counter(assign_splits(1000, {"train": 9, "test": 1})) == {"train": 900, "test": 100}
    splits = assign_splits(64, {"fit": 0.5, "select": 0.25, "report_same": 0.25})
    assert splits[:8] == assign_splits(8, {"fit": 0.5, "select": 0.25, "report_same": 0.25})
    for part in (8, 20, 50):
        assert abs(Counter(splits[:part])["fit"] - 0.5 * part) <= 1
