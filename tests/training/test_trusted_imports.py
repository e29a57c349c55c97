"""No configuration imports or calls what lies outside the trusted packages, in whatever way it names it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from physid.cli import main
from physid.configuration import Configuration, ConfigurationError
from physid.schema.check import check_fit
from physid.training.runs.building import build

MARK = "was_imported"
HARM = f"""
import pathlib
pathlib.Path({MARK!r}).write_text("")
class X:
    def __init__(self, *_, **__): pathlib.Path({MARK!r}).write_text("")
def f(*_, **__): pathlib.Path({MARK!r}).write_text("")
"""
CALLBACK = "lightning.pytorch.callbacks.LambdaCallback"
LAUNCH = "{class_path: torch.distributed.launcher.api.elastic_launch, dict_kwargs: {entrypoint: stranger.f}}"
FSDP = "lightning.pytorch.strategies.FSDPStrategy"
BORING = "--allow=lightning.pytorch.demos"  # a fit takes data of physid alone, or of what is allowed
PLAIN: dict[str, Any] = {
    "model": {"class_path": "physid.training.learners.sysid.SysID"},
    "data": {"class_path": "lightning.pytorch.demos.boring_classes.BoringDataModule"},
    "trainer": {"max_epochs": 1, "accelerator": "cpu"},
}


@pytest.fixture
def stranger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Work in a folder with a module that leaves a mark when it is imported or called."""
    (tmp_path / "stranger.py").write_text(HARM)
    (tmp_path / "callbacks.yaml").write_text("[{class_path: stranger.X}]\n")
    (tmp_path / "simple").write_text("{class_path: stranger.X}\n")
    (tmp_path / "none.yaml").write_text(yaml.safe_dump(PLAIN))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path / MARK
    sys.modules.pop("stranger", None)


@pytest.mark.parametrize(
    "override",
    [
        "trainer.callbacks=[{class_path: stranger.X}]",
        "trainer.callbacks=[stranger.X]",
        """trainer.callbacks='[{class_path: stranger.X}]'""",
        """trainer.strategy='{class_path: stranger.X}'""",
        """trainer.profiler='{class_path: stranger.X}'""",
        """model.optimizer='{class_path: stranger.X}'""",
        """model.guess='{class_path: stranger.X}'""",
        "trainer.callbacks=callbacks.yaml",
        "trainer.callbacks=./callbacks.yaml",
        "trainer.profiler=simple",
        "trainer.callbacks=[{class_path: LambdaCallback, init_args: {on_fit_start: stranger.f}}]",
        f"trainer.callbacks=[{{class_path: {CALLBACK}, init_args: {{on_fit_start: stranger.f}}}}]",
        f"trainer.callbacks=[{{class_path: {CALLBACK}, dict_kwargs: {{on_fit_start: stranger.f}}}}]",
        f"trainer.strategy={{class_path: {FSDP}, init_args: {{auto_wrap_policy: stranger.f}}}}",
        f"trainer.strategy={{class_path: {FSDP}, init_args: {{activation_checkpointing: [stranger.X]}}}}",
        f"trainer.callbacks=[{{class_path: {CALLBACK}, init_args: {{on_fit_start: torch.os.abort}}}}]",
        f"trainer.callbacks=[{{class_path: {CALLBACK}, init_args: {{on_fit_start: torch.hub.load}}}}]",
        f"trainer.callbacks=[{{class_path: {CALLBACK}, init_args: {{on_fit_start: {LAUNCH}}}}}]",
        f"trainer.callbacks=[{{class_path: {CALLBACK}, dict_kwargs: {{on_fit_start: ./callbacks.yaml}}}}]",
        "trainer.strategy={class_path: FSDPStrategy, init_args: {auto_wrap_policy: ./callbacks.yaml}}",
        "trainer.callbacks=[{class_path: torch.utils.model_dump.__main__.X}]",
        "trainer.callbacks=[{class_path: torch.package.PackageImporter, init_args: {file_or_buffer: simple}}]",
    ],
)
def test_what_a_stranger_wrote_is_neither_imported_nor_called(
    override: str, stranger: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", "--config", "none.yaml", override, BORING]) == 2
    assert not stranger.exists()
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) <= 3
    assert "physid" in said


@pytest.mark.parametrize("value", ["'{class_path: stranger.X}'", "./callbacks.yaml", "a b"])
def test_a_text_in_place_of_a_class_is_refused_with_what_was_expected(
    value: str, stranger: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", "--config", "none.yaml", f"trainer.profiler={value}", BORING]) == 2
    said = capsys.readouterr().err
    assert "command line: trainer.profiler: expected a name, or a mapping with class_path and init_args" in said


def test_what_escapes_the_check_is_refused_where_it_is_imported(stranger: Path) -> None:
    """As a run of somebody else is, whose encoder a user takes: nothing has checked its configuration."""
    for callback in ("stranger.X", "torch.os.abort"):
        hooked = {"class_path": CALLBACK, "init_args": {"on_fit_start": callback}}
        config = {**PLAIN, "trainer": {"callbacks": [hooked]}}
        with pytest.raises(ValueError, match=r"expected a class of physid, torch\.optim, torch\.nn, lightning"):
            build(config, Path("run"), [], logger=False)
    assert not stranger.exists()


def test_what_is_allowed_is_imported_and_only_where_it_is_allowed(stranger: Path) -> None:
    def hooked() -> dict[str, Any]:
        callback = {"class_path": CALLBACK, "init_args": {"on_fit_start": "stranger.f"}}
        return {**PLAIN, "trainer": {"callbacks": [callback], "accelerator": "cpu"}}

    build(hooked(), Path("run"), [], ["stranger"], logger=False)
    assert stranger.exists()
    with pytest.raises(ValueError, match="--allow stranger"):
        build(hooked(), Path("run"), [], logger=False)


def bomb(levels: int) -> str:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.parametrize("kind", ["text", "file"])
def test_a_text_that_the_parser_would_read_as_a_bomb_is_refused(kind: str, stranger: Path) -> None:
    """As in the run of somebody else, which nothing has checked."""
    Path("bomb.yaml").write_text(bomb(9))
    value = bomb(9) if kind == "text" else "bomb.yaml"
    for section in ("max_epochs", "profiler"):
        with pytest.raises(ValueError, match=f"trainer.{section}.*expected aliases to repeat at most"):
            build({**PLAIN, "trainer": {section: value}}, Path("run"), [], logger=False)


def test_texts_among_the_data_are_measured_as_well(stranger: Path) -> None:
    with pytest.raises(ValueError, match=r"data.limit.*expected aliases to repeat at most"):
        build({**PLAIN, "data": {"limit": bomb(9)}}, Path("run"), [], logger=False)


def test_a_pipe_in_place_of_a_class_is_not_waited_for(stranger: Path) -> None:
    os.mkfifo("pipe")
    with pytest.raises(OSError, match="pipe: expected a regular file"):
        build({**PLAIN, "trainer": {"profiler": "pipe"}}, Path("run"), [], logger=False)


def test_the_policy_ends_with_what_is_built(stranger: Path) -> None:
    import jsonargparse

    parser = jsonargparse.ArgumentParser(exit_on_error=False)
    parser.add_argument("--call", type=Callable)
    build({**PLAIN, "trainer": {"accelerator": "cpu"}}, Path("run"), [], ["torch.optim"], logger=False)
    build({**PLAIN, "model": {**PLAIN["model"], "init_args": {"optimizer": {"class_path": "torch.optim.Adam"}}}},
          Path("run"), [], logger=False)  # fmt: skip
    assert callable(parser.parse_args(["--call=json.dumps"]).call)


def test_mappings_for_what_no_type_is_known_of_are_taken_and_inspected_to_their_leaves(stranger: Path) -> None:
    def strategy(value: object) -> Configuration:
        given = {"class_path": FSDP, "dict_kwargs": {"more": {"one": {"two": [value]}}}}
        return Configuration("run", {**PLAIN, "trainer": {"strategy": given}}, allowed=("lightning.pytorch.demos",))

    check_fit(strategy(3))
    check_fit(strategy("auto"))
    with pytest.raises(ConfigurationError, match="--allow stranger"):
        check_fit(strategy("stranger.f"))
