"""What a stranger's text and YAML may cost: no more than its size."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from physid.data.importers.mapping_files import read_mapping
from physid.training.runs.loggers import read_rows
from physid.yaml_files import DEEPEST, LARGEST_FILE, YamlError, parse_yaml, read_bytes, read_text, read_yaml

BOMB = "a0: &a0 [x, x]\n" + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 12))
MERGES = "a0: &a0 {x: 1}\n" + "".join(f"a{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 10)}]}}\n" for n in range(1, 9))
SECONDS = 1.0  # a limit that a bomb of 10^11 nodes misses by far


@pytest.mark.parametrize("text", ["a: 1\nb: [x, {c: null}]", "a: &one {b: 1}\nc: [*one, *one]\nd: {<<: *one, e: 2}"])
def test_plain_values_and_a_few_aliases_are_read(text: str) -> None:
    values = parse_yaml(text, "here")
    assert values["a"] in (1, {"b": 1})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOMB, "expected aliases to repeat at most 10 times"),
        (MERGES, "expected aliases to repeat at most 10 times"),
        ("a: &a [*a]", "found \\*a inside of itself"),
        ("[" * (DEEPEST + 1), f"at most {DEEPEST} levels"),
        ("{a: " * 100_000, f"at most {DEEPEST} levels"),
        ("a: {b: " + "9" * 400 + "}", "a.b: expected an integer of at most 64 bits"),
        ("a: 0x" + "f" * 5000, "a: expected an integer of at most 64 bits"),
        ("a: " + "9" * 5000, "here:1: expected numbers of at most 1000 letters"),
        ("a: " + ":".join(["1"] * 500_000), "here:1: expected numbers of at most 1000 letters"),
        ("a: " + ":".join(["1"] * 300) + ":1.5", "no valid YAML: a tag"),
        ("? " + "k" * 10_000 + "\n: [" + "1," * 1000 + "]", "keys of at most 1000 letters, found one of 10000"),
        ("a: !!bool maybe", "no valid YAML: a tag .* of a value that is none"),
        ("a: !!int ''", "no valid YAML: a tag"),
        ("a: !!float ''", "no valid YAML"),
        ("a: !!int '_'", "no valid YAML"),
        ("a: !!timestamp now", "no valid YAML: a tag"),
        ("a: [1,", "here:[12]: no valid YAML"),
        ("a: *b", "here:1: no valid YAML: found undefined alias"),
        ("a: !!python/object/apply:os.system [true]", "could not determine a constructor"),
        ("a: 2001-13-01", "no valid YAML"),
        ("a: \x00", "no valid YAML"),
    ],
)
def test_what_is_no_yaml_or_costs_too_much_is_refused_at_once_in_one_line(text: str, message: str) -> None:
    start = time.perf_counter()
    with pytest.raises(YamlError, match=message) as caught:
        parse_yaml(text, "here")
    assert time.perf_counter() - start < SECONDS
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 300


def test_a_file_that_is_no_text_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_bytes(b"a: \xff")
    with pytest.raises(YamlError, match=r"a\.yaml: expected text in UTF-8, found byte 0xff"):
        read_yaml(path)


def a_pipe(path: Path) -> None:
    os.mkfifo(path)


def an_endless_device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def a_very_large_file(path: Path) -> None:
    path.touch()
    os.truncate(path, LARGEST_FILE + 1)


@pytest.mark.parametrize("make", [a_pipe, an_endless_device, a_very_large_file])
@pytest.mark.parametrize("read", [read_text, read_yaml])
def test_what_never_ends_is_refused_before_it_is_read(
    tmp_path: Path, make: Callable[[Path], None], read: Callable[[Path], object]
) -> None:
    path = tmp_path / "a.yaml"
    make(path)
    start = time.perf_counter()
    with pytest.raises(OSError, match=rf"^{path}: expected (a regular file|at most 67 MB), found .*; put a"):
        read(path)
    assert time.perf_counter() - start < SECONDS


def test_a_folder_and_a_missing_file_are_refused_as_the_system_does(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError) as caught:
        read_text(tmp_path)
    assert caught.value.filename == str(tmp_path)
    with pytest.raises(FileNotFoundError):
        read_text(tmp_path / "a.yaml")


def test_a_text_is_read_as_python_reads_it_up_to_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes("a,b\r\n1,ü\r3\n".encode())
    assert read_text(path) == path.read_text(encoding="utf-8")
    assert read_bytes(path, path.stat().st_size) == path.read_bytes()
    with pytest.raises(OSError, match="expected at most 0 MB"):
        read_bytes(path, path.stat().st_size - 1)


@pytest.mark.slow
def test_what_grows_with_a_run_is_read_whole(tmp_path: Path) -> None:
    """A history of days may be larger than any description."""
    history = tmp_path / "metrics.csv"
    history.write_text("epoch,loss\n" + 700 * f"1,{'3' * 100_000}\n")
    assert history.stat().st_size > LARGEST_FILE
    assert len(read_rows(history)) == 700
    with pytest.raises(OSError, match=r"expected at most 67 MB, found more; put another file there"):
        read_text(history)


def test_a_mapping_may_come_through_a_pipe_that_the_command_line_names(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=lambda: pipe.write_text("time: t\n"))
    writer.start()
    assert read_mapping(pipe) == {"time": "t"}
    writer.join()
