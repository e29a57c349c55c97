"""Mappings as a user writes them: a YAML file, and `key=value` laid over it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from physid.strict import at_home
from physid.yaml_files import YamlError, is_index, parse_yaml, read_yaml


def read_mapping(path: Path | None, words: Iterable[str] = ()) -> dict[str, Any]:
    """Read a mapping file and lay `key=value` over it; a dot leads into what is nested, as in units.position=mm.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is no YAML, or a word no `key=value`.
    """
    values: dict[str, Any] = {}
    if path is not None:
        # The command line may name a pipe, as <(...) of a shell is one.
        read = parse_yaml(path.read_text(encoding="utf-8"), str(path)) if path.is_fifo() else read_yaml(path)
        if not isinstance(read, dict):
            raise ValueError(f"{path}: expected a mapping in YAML, found {type(read).__name__}")
        values = read
    for word in words:
        key, equals, text = word.partition("=")
        if not equals or not key.strip():
            raise ValueError(f"--map: expected key=value, say position=[x,y,z] or units.position=mm, got {word!r}")
        try:
            value = parse_yaml(text, f"--map {key}")
        except YamlError:
            if text.lstrip().startswith("["):
                raise ValueError(f"--map {key}: expected a list such as [x, y, z], got {text!r}") from None
            value = text  # {stem}_forces.csv is a name, and no YAML
        _lay(values, key.strip().split("."), value, word)
    return {key: at_home(value) for key, value in values.items()}


def with_episodes(values: dict[str, Any]) -> dict[str, Any]:
    """Add to a mapping what LeRobot's format says: the columns of stamps and of episodes."""
    timed = any(values.get(key) is not None for key in ("time", "rate", "time_step"))
    return ({} if timed else {"time": "timestamp"}) | {"trajectory": "episode_index"} | values


def _lay(values: Any, keys: list[str], value: Any, word: str) -> None:
    """Lay one value over nested mappings and lists."""
    place = values
    for key in keys[:-1]:
        if isinstance(place, list):
            if not is_index(key) or int(key) >= len(place):
                raise ValueError(f"--map {word}: expected a number below {len(place)} for {key!r}")
            place = place[int(key)]
        else:
            place = place.setdefault(key, {}) if isinstance(place, dict) else None
        if not isinstance(place, dict | list):
            raise ValueError(f"--map {word}: {key} is a value of its own, and holds no {keys[-1]}")
    if isinstance(place, list):
        place[int(keys[-1])] = value
    else:
        place[keys[-1]] = value
