from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from physid.class_paths import load_class
from physid.cli import main
from physid.commands import COMMANDS
from physid.configuration import Configuration, ConfigurationError, compose
from physid.data.generation.settings import GenerateConfig
from physid.data.importers import read_mapping
from physid.schema.check import check_fit, check_keys
from physid.schema.free_mappings import free_mappings, types_of

SYSID = "physid.training.learners.sysid.SysID"


def write(folder: Path, **texts: str) -> dict[str, Path]:
    paths = {name: folder / f"{name}.yaml" for name in texts}
    for name, path in paths.items():
        path.write_text(texts[name])
    return paths


def test_later_layers_win_and_interpolation_sees_the_winner(tmp_path: Path) -> None:
    files = write(
        tmp_path,
        base="rate: 0.1\ndouble: ${rate}\nnested: {kept: 1, changed: 2}",
        middle="base: base.yaml\nnested: {changed: 3}",
        top="rate: 0.2",
    )
    composed = compose([files["middle"], files["top"]], ["nested.added=[1, 2]", "rate=1e-3"])
    assert composed.values == {"rate": 0.001, "double": 0.001, "nested": {"kept": 1, "changed": 3, "added": [1, 2]}}
    assert composed.name == "top"


@dataclass
class Section:
    low: float = 0.0
    high: float = 1.0
    weights: Mapping[str, float] | None = None


@dataclass
class Settings:
    shares: Mapping[str, float]
    section: Section
    deep: dict[str, Mapping[str, float]]


class Model:
    def __init__(
        self,
        rate: float = 0.1,
        inner: object = None,
        values: Mapping[str, float] | None = None,
        section: Section | None = None,
        make: Callable[[], object] | None = None,
    ) -> None:
        self.rate, self.inner = rate, inner


def test_a_free_mapping_is_replaced_and_a_section_is_merged(tmp_path: Path) -> None:
    files = write(
        tmp_path,
        base="shares: {a: 9, b: 1}\nsection: {low: 0.1, weights: {a: 1}}\ndeep: {x: {p: 1, q: 2}, y: {p: 3}}",
        top="base: base.yaml\nshares: {c: 1}\nsection: {high: 2, weights: {b: 2}}\ndeep: {x: {p: 5}}",
    )
    values = compose([files["top"]], reads=Settings).values
    assert values["shares"] == {"c": 1}
    assert values["section"] == {"low": 0.1, "high": 2, "weights": {"b": 2}}
    assert values["deep"] == {"x": {"p": 5}}


@pytest.mark.parametrize(
    ("override", "shares"),
    [("shares={c: 2}", {"c": 2}), ("shares.c=2", {"a": 9, "b": 1, "c": 2}), ("shares.a=2", {"a": 2, "b": 1})],
)
def test_an_override_replaces_a_free_mapping_or_changes_one_entry(
    tmp_path: Path, override: str, shares: dict[str, float]
) -> None:
    files = write(tmp_path, base="shares: {a: 9, b: 1}")
    assert compose([files["base"]], [override], reads=Settings).values["shares"] == shares


def test_a_key_with_dots_below_a_free_mapping_is_one_key_however_it_is_written(tmp_path: Path) -> None:
    files = write(
        tmp_path,
        dotted="shares: {block.mass: 1, block.friction: 0.3}",
        nested="shares: {block: {mass: 1, friction: 0.3}}",
    )
    for file in files.values():
        for override in ("shares.block.friction=0.4", "shares={block: {mass: 1, friction: 0.4}}"):
            found = compose([file], [override], reads=Settings)
            assert found.values["shares"] == {"block.mass": 1, "block.friction": 0.4}
            assert found.source_of("shares.block.friction") == "command line"
    deep = compose([files["dotted"]], ["deep.x.p=5", "section.weights.a.b=2"], reads=Settings).values
    assert deep["deep"] == {"x": {"p": 5}}
    assert deep["section"] == {"weights": {"a.b": 2}}


def test_a_tilde_is_the_home_folder_in_files_and_overrides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/ada")
    files = write(tmp_path, base="folder: ~/sets/a\nnothing: ~\nothers: [~/b, c~/d]")
    values = compose([files["base"]], ["camera=~/lens.yaml"]).values
    home = {"folder": "/home/ada/sets/a", "nothing": None, "others": ["/home/ada/b", "c~/d"]}
    assert values == home | {"camera": "/home/ada/lens.yaml"}
    assert read_mapping(files["base"], ["camera=~/lens.yaml"]) == values


def test_the_arguments_of_a_class_follow_the_same_rule(tmp_path: Path) -> None:
    named = f"class_path: {__name__}.Model"
    files = write(
        tmp_path,
        base=f"model: {{{named}, values: {{a: 1}}, section: {{low: 3, weights: {{a: 1}}}}}}",
        top="base: base.yaml\nmodel: {values: {b: 2}, section: {high: 4, weights: {b: 1}}}",
    )
    arguments = compose([files["top"]], ["model.values.c=3"], allowed=[__name__]).values["model"]["init_args"]
    assert arguments == {"values": {"b": 2, "c": 3}, "section": {"low": 3, "high": 4, "weights": {"b": 1}}}


def test_the_shipped_withheld_set_has_the_splits_that_its_file_names() -> None:
    shipped = Path(__file__).parent.parent / "configs" / "diagnose" / "withheld_drag.yaml"
    config = GenerateConfig.from_mapping(compose([shipped], reads=GenerateConfig).values)
    assert config.split == {"fit": 10, "select": 2, "report_same": 4, "report_transfer": 8}
    assert Counter(config.splits()) == config.split
    assert dict(config.effects) == {"viscous_drag": {"coefficient": 0.3}}


def test_every_configuration_without_classes_says_what_reads_it() -> None:
    for command in COMMANDS:
        if command.reads:
            assert dataclasses.is_dataclass(load_class(command.reads))
    generate = {command.name: command for command in COMMANDS}["generate"]
    kinds = types_of(load_class(generate.reads))
    values = {name: {"a": 1} for name in kinds}
    assert free_mappings(values, load_class(generate.reads)) == {
        "protocol_of_split": True,
        "split": True,
        "true_values": True,
        "effects": False,
    }


def test_nested_names_of_a_mapping_of_scalars_are_dotted_ones_layer_by_layer(tmp_path: Path) -> None:
    files = write(
        tmp_path,
        dotted="true_values: {block.mass: 1, block.friction: 0.3}",
        nested="true_values: {block: {mass: 1, friction: 0.3}}",
        twice="true_values: {block: {friction: 0.3}, block.friction: 0.4}",
        odd="model: {1: {class_path: physid.training.learners.sysid.SysID, values: {block.mass: 1}}}",
    )
    for name in ("dotted", "nested"):
        found = compose([files[name]], ["true_values.block.friction=0.4"], reads=GenerateConfig).values
        assert found["true_values"] == {"block.mass": 1, "block.friction": 0.4}
    with pytest.raises(
        ValueError, match=r"true_values: expected 'block.friction' once, found it by a dotted key and by"
    ):
        compose([files["twice"]], reads=GenerateConfig)
    assert list(compose([files["odd"]]).values["model"]) == [1]


@pytest.mark.parametrize(
    ("text", "value"), [("1e-3", 1e-3), ("1E5", 1e5), ("-2e+1", -20.0), ("null", None), ("'1e-3'", "1e-3")]
)
def test_a_number_in_scientific_notation_is_a_number_wherever_it_is_written(
    tmp_path: Path, text: str, value: object
) -> None:
    files = write(tmp_path, one=f"key: {text}")
    assert compose([files["one"]]).values == compose([], [f"key={text}"]).values == {"key": value}


def test_a_written_configuration_composes_to_itself(tmp_path: Path) -> None:
    files = write(tmp_path, one="a: 1e-7\nb: [x, {c: null}]\nd: '1e-3'\nname: kept")
    before = compose([files["one"]])
    again = tmp_path / "again.yaml"
    again.write_text(before.to_yaml())
    after = compose([again])
    assert (after.name, after.values) == (before.name, before.values) == ("kept", before.values)


def test_arguments_beside_a_class_belong_to_it_and_are_forgotten_with_it(tmp_path: Path) -> None:
    files = write(tmp_path, one="model: {class_path: a.B, rate: 1, size: 2}", two="model: {class_path: a.C, depth: 3}")
    assert compose([files["one"]], ["model.rate=5"]).values["model"]["init_args"] == {"rate": 5, "size": 2}
    assert compose([files["one"], files["two"]]).values["model"] == {"class_path": "a.C", "init_args": {"depth": 3}}


def test_an_override_reaches_into_a_list(tmp_path: Path) -> None:
    files = write(tmp_path, one="all: [{a: 1}, {a: 2}]")
    assert compose([files["one"]], ["all.1.a=5"]).values == {"all": [{"a": 1}, {"a": 5}]}
    with pytest.raises(ConfigurationError, match=r"all\.2: the list has 2 entries"):
        compose([files["one"]], ["all.2.a=5"])


@pytest.mark.parametrize("digit", ["\N{SUPERSCRIPT TWO}", "\N{ARABIC-INDIC DIGIT ONE}"])
def test_digits_of_other_scripts_number_no_item(digit: str) -> None:
    assert compose([], ["a=[b, c]", f"a.{digit}=1"]).values["a"] == {digit: 1}


def test_every_key_knows_where_it_was_set_last(tmp_path: Path) -> None:
    files = write(tmp_path, one="base: two.yaml\na: {b: 1}", two="a: {b: 2, c: 3}\nm: {class_path: x.Y, n: 1}")
    composed = compose([files["one"]], ["m.o=2"])
    sources = [composed.source_of(key) for key in ("a.b", "a.c", "m.init_args.n", "m.init_args.o")]
    assert [Path(source).name for source in sources] == ["one.yaml", "two.yaml", "two.yaml", "command line"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rate: 1\ncopy: ${rat}", 'copy: "\\${rat}" names no key; did you mean "rate"'),
        ("base: one.yaml", "builds on itself"),
        ("base: absent.yaml", "absent.yaml does not exist"),
        ("a: [1,", "one.yaml:1: no valid YAML|one.yaml:2: no valid YAML"),
        ("a: 1\na: 2", "no valid YAML: found duplicate key"),
        ("a: ${b", r"one.yaml: an interpolation is written \$\{key\}; .*\$\{b"),
        ("a: '${'", "one.yaml: an interpolation is written"),
        ("a: " + "9" * 400, "one.yaml: a: expected an integer of at most 64 bits"),
        ("a: &a [1, *a]", "inside of itself"),
        ("base: {a: 1}", "base: expected a file or a list of files"),
        ("base: 3", "base: expected a file or a list of files"),
        ("model: {class_path: torch.nn.Linear, init_args: 3, bias: true}", "model.init_args: expected a mapping"),
        ("- 1", "expected a mapping"),
        ("a: ???", 'key "a" must be given: a=VALUE'),
        ("a: ${oc.env:SURELY_NOT_SET}", "SURELY_NOT_SET"),
        ("a: ${b}\nb: ${a}", "a|b"),
        ("a: '\\${b}'", "interpolation left unresolved"),
    ],
)
def test_a_mistake_in_a_file_is_one_line_that_names_it(tmp_path: Path, text: str, message: str) -> None:
    files = write(tmp_path, one=text)
    with pytest.raises(ConfigurationError, match=message) as caught:
        compose([files["one"]])
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    "override",
    [
        "novalue",
        "=3",
        "a..b=1",
        "a=[1,",
        "a=" + "9" * 400,
        "a=" + "[" * 5000,
        "a=${b",
        "a=&a [*a]",
        ".".join("a" * 3000) + "=1",
        "a" + "[0]" * 3000 + "=1",
        "a=!!bool maybe",
    ],
)
def test_a_broken_override_is_refused(override: str) -> None:
    with pytest.raises(ConfigurationError):
        compose([], [override])


def test_a_missing_file_suggests_the_nearest_one(tmp_path: Path) -> None:
    write(tmp_path, push_friction="a: 1")
    with pytest.raises(ConfigurationError, match=r'does not exist; did you mean ".*push_friction\.yaml"'):
        compose([tmp_path / "push_frction.yaml"])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"modl": 1}, 'unknown key "modl"; did you mean "model"'),
        ({"model": {"class_path": f"{__name__}.Model", "init_args": {"rat": 1}}}, '"model.rat"; did you mean "rate"'),
        ({"model": {"class_path": f"{__name__}.Modell"}}, 'has no "Modell"; did you mean "Model"'),
        ({"model": {"class_path": "torch.nn.absent.Model"}}, "cannot import torch.nn.absent.Model"),
        (
            {"model": {"class_path": "absent_module.Model"}},
            "expected a class of physid, torch.optim, .* --allow absent_module",
        ),
        ({"model": {"class_path": "torch.nn.functional.relu"}}, "expected a class of that package, found <function"),
        ({"model": {"class_path": "torch.hub.load"}}, "expected a class of physid, torch.optim"),
        ({"model": {"class_path": "lightning.fabric.utilities.cloud_io.os.system"}}, "cannot import"),
        ({"model": {"class_path": "os.system"}}, "--allow os"),
        ({"model": {"class_path": f"{__name__}.Model", "init_args": 3}}, "model.init_args: expected a mapping"),
        (
            {"model": {"class_path": f"{__name__}.Model", "init_args": {"make": "os.getpid"}}},
            "model.init_args.make.*--allow os",
        ),
        ({"model": {"class_path": f"{__name__}.Model", "init_args": {"inner": {"class_path": "os.x"}}}}, "--allow os"),
        ({"trainer": 3}, "trainer: expected a mapping of keys to values, got 3"),
        ({"trainer": {"make": "os.getpid"}}, "trainer.make.*--allow os"),
        ({"trainer": {"inner": [{"class_path": "os.getpid"}]}}, "trainer.inner.0.class_path.*--allow os"),
        ({"model": {"class_path": 3}}, "expected a dotted path"),
        ({"trainer": {"rte": 1}}, '"trainer.rte"; did you mean "rate"'),
        ({"model": [{"class_path": f"{__name__}.Model", "init_args": {"inr": 1}}]}, '"model.0.inr"'),
        (
            {"model": {"class_path": SYSID, "init_args": {"impacts": {"steps": {"shortes": 0.1}}}}},
            'model.impacts: steps: unknown key "shortes"; did you mean "shortest"',
        ),
        (
            {"model": {"class_path": SYSID, "init_args": {"impacts": {"rounds": {"step_choices": -1}}}}},
            "model.impacts: rounds.step_choices: expected a number of at least 0, found -1",
        ),
    ],
)
def test_an_unknown_key_or_class_is_refused_with_the_nearest_one(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        check_keys(Configuration("run", values, allowed=(__name__,)), {"model": None, "trainer": Model})


@pytest.mark.parametrize(
    "values",
    [
        {"9" * 100_000: 1},
        {"trainer": {"9" * 100_000: 1}},
        {"trainer": {"inner": {"9" * 100_000: {"class_path": "os.getpid"}}}},
        {"model": {"class_path": f"{__name__}.Model", "init_args": {"9" * 100_000: 1}}},
        {"model": {"class_path": f"{__name__}.{'M' * 100_000}"}},
        {"model": {"class_path": f"{'m' * 100_000}.Model"}},
        {"model": {"class_path": f"torch.{'m' * 100_000}.Model"}},
        {"model": {"class_path": "9" * 100_000}},
        {"model": {"class_path": 10**10_000}},
        {"model": {"class_path": f"{__name__}.Model", "init_args": "9" * 100_000}},
    ],
)
def test_a_message_does_not_grow_with_what_it_quotes(values: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError) as caught:
        check_keys(Configuration("run", values, allowed=(__name__,)), {"model": None, "trainer": Model})
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("value", [None, 3, "physid.training.sysid.SysID", {}, {"class_path": 3}, ["x"]])
def test_a_fit_needs_a_model_and_data_that_name_their_class(value: object) -> None:
    named = {"data": {"class_path": "physid.data.batches.datamodule.RecordingsDataModule"}}
    with pytest.raises(ConfigurationError, match="model: expected a mapping with the class_path of a LightningModule"):
        check_fit(Configuration("run", {**named, "model": value}))


def test_a_class_of_another_kind_is_refused() -> None:
    kind = {"class_path": "physid.data.batches.datamodule.RecordingsDataModule"}
    with pytest.raises(ConfigurationError, match=r"model\.class_path: expected a LightningModule, got .*DataModule"):
        check_fit(Configuration("run", {"data": kind, "model": kind}))


@pytest.mark.parametrize("key", ["logger", "default_root_dir", "fast_dev_run"])
def test_what_a_run_decides_itself_is_not_ignored_silently(key: str) -> None:
    fit = Path(__file__).parent.parent / "configs" / "sysid" / "push_friction.yaml"
    with pytest.raises(
        ConfigurationError, match=rf"trainer\.{key} cannot be chosen, since a run keeps all in its folder"
    ):
        check_fit(compose([fit], [f"trainer.{key}=x"]))


def test_no_module_is_imported_before_it_is_trusted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "surely_hostile.py").write_text("from pathlib import Path\nPath('hit').touch()\nclass Model: ...")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    written = write(tmp_path, one="model: {class_path: surely_hostile.Model, values: {a: 1}}")
    with pytest.raises(ConfigurationError, match="--allow surely_hostile"):
        check_keys(compose([written["one"]]), {"model": None})
    assert not (tmp_path / "hit").exists()
    check_keys(compose([written["one"]], allowed=["surely_hostile"]), {"model": None})
    assert (tmp_path / "hit").exists()


def test_a_base_as_long_as_a_book_is_refused_in_few_words(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(f"base: {'x' * 100_000}\n")
    with pytest.raises(ConfigurationError, match="got 100000 letters") as said:
        compose([tmp_path / "a.yaml"])
    assert len(str(said.value)) < 500


@pytest.mark.parametrize("backwards", [False, True])
def test_interpolations_that_multiply_are_refused_before_they_are_followed(backwards: bool, tmp_path: Path) -> None:
    lines = ["a0: xxxxxxxxxx", *(f"a{k}: '{10 * f'${{a{k - 1}}}'}'" for k in range(1, 12))]
    file = tmp_path / "bomb.yaml"
    file.write_text("\n".join(reversed(lines) if backwards else lines))
    with pytest.raises(ConfigurationError, match="interpolations to make at most 1000000 letters"):
        compose([file])
    lists = [f"m{k}: [{', '.join(9 * [repr(f'${{m{k - 1}}}')])}]" for k in range(1, 12)]
    file.write_text("\n".join(["m0: {l: [1, 2]}", *lists]))
    with pytest.raises(ConfigurationError, match="interpolations to make at most 1000000 letters"):
        compose([file])


def test_few_interpolations_are_followed_and_one_in_another_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "one.yaml"
    file.write_text("a: {b: long, c: '${.b}er', d: '${a.c} than ${..e.0}'}\ne: [short]\nn: b\n")
    assert compose([file]).values["a"] == {"b": "long", "c": "longer", "d": "longer than short"}
    file.write_text("a: {b: 1}\nn: b\nc: '${a.${n}}'\n")
    with pytest.raises(ConfigurationError, match="c: expected no interpolation within another one"):
        compose([file])


@pytest.mark.parametrize("way", ["${oc.select:a0,0}", "${oc.select:'a0'}", "${oc.dict.values:p}", "${p.v}"])
def test_interpolations_that_cannot_be_measured_are_refused(way: str, tmp_path: Path) -> None:
    file = tmp_path / "one.yaml"
    file.write_text(f'a0: xxx\nl: {{v: x}}\np: "${{l}}"\nb: "{way}"\n')
    with pytest.raises(ConfigurationError, match=r"b: expected \$\{key\} of a value that is written out, or"):
        compose([file])


def test_the_environment_may_be_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PLACE", "here")
    (tmp_path / "one.yaml").write_text("a: '${oc.env:PLACE}/${oc.env:OTHER,there}'\n")
    assert compose([tmp_path / "one.yaml"]).values == {"a": "here/there"}


def test_bases_that_multiply_are_refused(tmp_path: Path) -> None:
    for level in range(25):
        (tmp_path / f"{level}.yaml").write_text(f"base: [{level + 1}.yaml, {level + 1}.yaml]\n")
    (tmp_path / "25.yaml").write_text("a: 1\n")
    with pytest.raises(ConfigurationError, match=r"0.yaml: builds on more than 100 files"):
        compose([tmp_path / "0.yaml"])
    assert compose([tmp_path / "22.yaml"]).values == {"a": 1}


@pytest.mark.parametrize(
    "name", ["../x", "a/../../x", "/tmp/x", "..", ".", "''", "'a\\0b'", '"a\\nb"', "{a: 1}", "[x]", "null", "true"]
)
def test_a_name_stays_in_the_folder_that_it_is_a_place_in(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.yaml").write_text(f"name: {name}\n" if "0" not in name else 'name: "a\\0b"\n')
    with pytest.raises(
        ConfigurationError, match=r"a\.yaml: name: expected a plain name .* give another one: name=NAME"
    ) as said:
        compose([tmp_path / "a.yaml"])
    assert len(str(said.value).splitlines()) == 1
    assert compose([tmp_path / "a.yaml"], ["name=mine"]).name == "mine"


@pytest.mark.parametrize("name", ["push", "nested/push", "a..b", "7", "1.5", "with space", "größe"])
def test_a_plain_name_is_taken_as_it_is(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.yaml").write_text(f"name: {name}\n")
    assert compose([tmp_path / "a.yaml"]).name == name


def test_neither_a_fit_nor_a_set_is_written_elsewhere_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    for config in ("generate/push", "sysid/push_friction", "identifiability/push"):
        command = config.partition("/")[0].replace("sysid", "fit")
        for name in ("../escaped", str(tmp_path / "escaped")):
            assert main([command, "--config", config, f"name={name}"]) == 2
            assert "command line: name: expected a plain name" in capsys.readouterr().err
    assert [path.name for path in tmp_path.rglob("*")] == ["work"]
