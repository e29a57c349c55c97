from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from physid.configuration import Configuration, ConfigurationError, compose
from physid.schema import check_keys


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


@pytest.mark.parametrize("override", ["novalue", "=3", "a..b=1", "a=[1,"])
def test_a_broken_override_is_refused(override: str) -> None:
    with pytest.raises(ConfigurationError):
        compose([], [override])


def test_a_missing_file_suggests_the_nearest_one(tmp_path: Path) -> None:
    write(tmp_path, push_friction="a: 1")
    with pytest.raises(ConfigurationError, match=r'does not exist; did you mean ".*push_friction\.yaml"'):
        compose([tmp_path / "push_frction.yaml"])


class Model:
    def __init__(self, rate: float = 0.1, inner: object = None) -> None:
        self.rate, self.inner = rate, inner


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"modl": 1}, 'unknown key "modl"; did you mean "model"'),
        ({"model": {"class_path": f"{__name__}.Model", "init_args": {"rat": 1}}}, '"model.rat"; did you mean "rate"'),
        ({"model": {"class_path": f"{__name__}.Modell"}}, 'has no "Modell"; did you mean "Model"'),
        ({"model": {"class_path": "absent_module.Model"}}, "cannot import absent_module.Model"),
        ({"model": {"class_path": 3}}, "expected a dotted path"),
        ({"trainer": {"rte": 1}}, '"trainer.rte"; did you mean "rate"'),
        ({"model": [{"class_path": f"{__name__}.Model", "init_args": {"inr": 1}}]}, '"model.0.inr"'),
    ],
)
def test_an_unknown_key_or_class_is_refused_with_the_nearest_one(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        check_keys(Configuration("run", values), {"model": None, "trainer": Model})
