"""Compose a configuration: files on files, overrides, interpolations; resolved once, with nothing left over.

What a later layer says of a section replaces the same keys of an earlier one and leaves the others. What it says of a
free mapping, whose keys the user chooses (`split`, `effects`, `values`), replaces the whole of it (`free_mappings`).
"""

from __future__ import annotations

import copy
import io
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from physid.schema.free_mappings import free_mappings
from physid.shipped import find_configuration, nearest_configuration
from physid.strict import at_home, is_seen, joined, nearest, shown
from physid.yaml_files import DEEPEST, YamlError, is_index, parse_yaml, read_yaml, require_modest_interpolations

COMMAND_LINE = "command line"
CLASS_KEYS = ("class_path", "init_args", "dict_kwargs")
NOT_FREE: dict[str, bool] = {}
Layer = tuple[str, dict[str, Any], tuple[str, ...]]
"""Where values come from, the values, and the path to what an override gives (none for a file)."""

LONGEST_PATH = 1000
"""[letters] of the name of a file; systems take some thousand."""


MOST_FILES = 100
"""That a configuration builds on, each as often as it is named: two that name two each, and so on, are a million."""


class ConfigurationError(ValueError):
    """A mistake in a configuration, said in one or two lines: the key or file, what was expected, the nearest match."""


@dataclass(frozen=True)
class Configuration:
    """A resolved configuration.

    Attributes:
        name: Name of the run or recording set: the key `name`, else the stem of the last file.
        values: Plain dicts, lists and scalars, without any interpolation left; `base` and `name` are taken out.
        layers: What was laid over each other, the lowest first: where it comes from, and its own values.
        allowed: Packages beside the trusted ones whose classes it may name (see `class_paths`).
    """

    name: str
    values: dict[str, Any]
    layers: tuple[tuple[str, dict[str, Any]], ...] = ()
    allowed: tuple[str, ...] = ()

    @property
    def recordings(self) -> str:
        """Which recordings it names for a fit; RECORDINGS if none."""
        data = self.values.get("data") or {}
        return str((data.get("init_args") or {}).get("folder", data.get("folder", "RECORDINGS")))

    def source_of(self, key: str) -> str:
        """Return where a dotted key was set last: a file, or the command line."""
        path = [part for part in key.split(".") if part not in CLASS_KEYS]
        sources = [source for source, values in self.layers if _has(values, path)]
        files = [source for source, _ in self.layers if source != COMMAND_LINE]
        return (sources or files or ["configuration"])[-1]

    def to_yaml(self) -> str:
        """Return the configuration as a YAML file that composes to the same configuration."""
        from omegaconf import OmegaConf

        # OmegaConf reads '1e-3' without quotes as a number, so only its own writer knows which strings need quotes.
        return OmegaConf.to_yaml(OmegaConf.create({"name": self.name, **self.values}))


def compose(
    files: Sequence[Path | str],
    overrides: Sequence[str] = (),
    *,
    reads: type | None = None,
    allowed: Sequence[str] = (),
) -> Configuration:
    """Lay files and overrides over each other and resolve the interpolations.

    A file may be a name of one that is shipped (see `shipped`). It may name a lower one with `base: other.yaml`
    (relative to itself, or shipped; or a list of them). Later files win over earlier ones and overrides win over all.
    Beside a `class_path`, keys may be written without `init_args`; where a later layer changes the class, the arguments
    of the earlier class are dropped. A free mapping is replaced as a whole, by `split: {fit: 10}` in a file as by
    `split={fit: 10}`; `split.fit=10` changes one entry, as does `true_values.block.friction=0.4`. Texts that begin with
    `~/` name places below the user's home folder.

    Args:
        files: Configuration files or names, the most general first.
        overrides: `key.sub=value` each, the value in YAML.
        reads: The class whose fields the keys are, if the configuration names none itself.
        allowed: Packages beside the trusted ones whose classes it may name.

    Returns:
        The resolved configuration.

    Raises:
        ConfigurationError: If a file is missing or no YAML mapping, an override has no `=`, an interpolation fails, or
            the name would lead out of the folder that runs or recording sets lie in.
        ValueError: If a mapping names one thing twice (see `joined`).
    """
    opened: list[Path] = []
    layers: list[Layer] = [(*layer, ()) for file in files for layer in _read(Path(file), (), opened)]
    layers += [_parse_override(override) for override in overrides]
    merged = _overlay(layers, NOT_FREE)
    # Which mappings are free is said by the classes, and which classes there are by the layers.
    if free := free_mappings(merged, reads, allowed):
        merged = _overlay(layers, free)
    merged.setdefault("name", Path(files[-1]).stem if files else "run")
    values = _resolve(merged)
    name = values.pop("name")
    found = Configuration(str(name), values, tuple((source, own) for source, own, _ in layers), tuple(allowed))
    if not _is_plain(name):
        raise ConfigurationError(
            f"{found.source_of('name')}: name: expected a plain name such as push, or nested/push, since a folder of "
            f"runs/ or data/ gets it, found {shown(name)}; give another one: name=NAME"
        )
    return found


def flatten(values: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every scalar of nested dicts and lists with its dotted key."""
    items = values.items() if isinstance(values, dict) else enumerate(values) if isinstance(values, list) else None
    if items is None:
        yield prefix, values
        return
    for key, value in items:
        yield from flatten(value, f"{prefix}.{key}" if prefix else str(key))


def _read(file: Path, above: tuple[Path, ...], opened: list[Path]) -> list[tuple[str, dict[str, Any]]]:
    """Read a file and what it builds on, the lowest first; `opened` gets what was read."""
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    file = find_configuration(file)
    if file.resolve() in above:
        raise ConfigurationError(f"{file}: builds on itself ({' -> '.join(one.name for one in above)} -> {file.name})")
    if os.path.lexists(file) and not file.is_file():
        raise ConfigurationError(f"{file}: expected a configuration file, found something else, say a folder")
    if not file.is_file():
        raise ConfigurationError(f"config file {file} does not exist{nearest_configuration(file)}")
    opened.append(file)
    if len(opened) > MOST_FILES:
        raise ConfigurationError(f"{opened[0]}: builds on more than {MOST_FILES} files, the last of them {file}")
    try:
        values = read_yaml(file, lambda text: OmegaConf.to_container(OmegaConf.load(io.StringIO(text)), resolve=False))
    except YamlError as error:
        raise ConfigurationError(str(error)) from None
    except OSError as error:
        raise ConfigurationError(f"{file}: cannot be read: {str(error).splitlines()[0]}") from None
    except OmegaConfBaseException as error:
        reason = str(error).splitlines()[0]
        raise ConfigurationError(f"{file}: an interpolation is written ${{key}}; {reason}") from None
    if not isinstance(values, dict):
        raise ConfigurationError(f"{file}: expected a mapping of keys to values, got {type(values).__name__}")
    named = {str(key): value for key, value in values.items()}
    bases = named.pop("base", None) or []
    below = [bases] if isinstance(bases, str) else bases
    if not isinstance(below, list) or not all(isinstance(base, str) for base in below):
        raise ConfigurationError(f"{file}: base: expected a file or a list of files, got {bases!r}")
    longest = max(below, key=len, default="")
    if len(longest) > LONGEST_PATH:
        raise ConfigurationError(f"{file}: base: expected the path of a file, got {len(longest)} letters")
    lower = [find_configuration(Path(at_home(base)), file.parent) for base in below]
    return [each for base in lower for each in _read(base, (*above, file.resolve()), opened)] + [(str(file), named)]


def _parse_override(override: str) -> Layer:
    """Return what `a.b=value` stands for: nested mappings, and the path to what is given as a whole."""
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    key, equals, value = override.partition("=")
    if not equals or not all(key.split(".")):
        raise ConfigurationError(f'expected an override of the form key.sub=value, got "{_short(override)}"')
    if key.count(".") + key.count("[") >= DEEPEST:
        raise ConfigurationError(f'expected at most {DEEPEST} levels of keys, got "{_short(key)}"')
    try:
        parse_yaml(value, COMMAND_LINE)
        parsed = OmegaConf.to_container(OmegaConf.from_dotlist([override]), resolve=False)
    except (YamlError, yaml.YAMLError, OmegaConfBaseException) as error:
        reason = str(error).splitlines()[0].removeprefix(f"{COMMAND_LINE}: ").removeprefix("no valid YAML: ")
        raise ConfigurationError(
            f'{COMMAND_LINE}: the value of "{_short(override)}" is no valid YAML: {reason}'
        ) from None
    values = {str(key): value for key, value in parsed.items()} if isinstance(parsed, dict) else {}
    return COMMAND_LINE, values, tuple(key.split("."))


def _overlay(layers: Sequence[Layer], free: dict[str, bool]) -> dict[str, Any]:
    """Return the layers laid over each other."""
    merged: Any = {}
    for source, values, path in layers:
        merged = _merge(merged, values, source, free, path)
    return dict(merged)


def _merge(
    earlier: Any, later: Any, source: str, free: dict[str, bool] = NOT_FREE, path: tuple[str, ...] = (), key: str = ""
) -> Any:
    """Return `earlier` overlaid by `later`: sections merge, list items can be named by index, all else is replaced.

    Args:
        earlier: Lower value.
        later: Upper value.
        source: Where the upper one comes from.
        free: Dotted keys of the mappings that are replaced as a whole, and whether they hold scalars alone ...
        path: ... but for those on the way to what an override gives.
        key: Dotted key of the values.
    """
    if isinstance(earlier, list) and isinstance(later, dict) and later and all(map(is_index, later)):
        merged_list = list(earlier)
        for index, value in later.items():
            if int(index) >= len(earlier):
                raise ConfigurationError(f"{source}: {key}.{index}: the list has {len(earlier)} entries")
            merged_list[int(index)] = _merge(earlier[int(index)], value, source, free, path[1:], f"{key}.{int(index)}")
        return merged_list
    if not isinstance(later, dict):
        return [_merge(None, each, source) for each in later] if isinstance(later, list) else later
    if free.get(key):
        later = joined(later, f"{source}: {key}")
    earlier = earlier if isinstance(earlier, dict) and (path or key not in free) else {}
    if "class_path" in earlier or "class_path" in later:
        earlier, later = _align(earlier, later, f"{source}: {key}")
    merged = copy.copy(earlier)
    for name, value in later.items():
        way = path if name == "init_args" and path[:1] != ("init_args",) else path[1:]
        whole = f"{key}.{name}" if key else str(name)
        merged[name] = _merge(earlier.get(name), value, source, free, way, whole)
    return merged


def _align(earlier: dict[str, Any], later: dict[str, Any], where: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return both layers of one class with its arguments under `init_args`, forgetting those of another class."""
    if not isinstance(later.get("init_args") or {}, dict):
        raise ConfigurationError(f"{where}.init_args: expected a mapping of arguments, got {later['init_args']!r}")
    arguments = {name: value for name, value in later.items() if name not in CLASS_KEYS}
    rest = {name: value for name, value in later.items() if name in CLASS_KEYS}
    if arguments:
        rest["init_args"] = {**(rest.get("init_args") or {}), **arguments}
    if rest.get("class_path", earlier.get("class_path")) != earlier.get("class_path"):
        earlier = {}
    return earlier, rest


def _resolve(merged: dict[str, Any]) -> dict[str, Any]:
    """Resolve every interpolation, once, and refuse what is left."""
    from omegaconf import OmegaConf
    from omegaconf.errors import InterpolationKeyError, MissingMandatoryValue, OmegaConfBaseException

    try:
        require_modest_interpolations(merged, "configuration")
        values = OmegaConf.to_container(OmegaConf.create(merged), resolve=True, throw_on_missing=True)
    except YamlError as error:
        raise ConfigurationError(str(error)) from None
    except MissingMandatoryValue as error:
        raise ConfigurationError(f'key "{error.full_key}" must be given: {error.full_key}=VALUE') from None
    except InterpolationKeyError as error:
        wanted = str(error).split("'")[1]
        known = [key for key, _ in flatten(merged)]
        raise ConfigurationError(f'{error.full_key}: "${{{wanted}}}" names no key{nearest(wanted, known)}') from None
    except OmegaConfBaseException as error:
        raise ConfigurationError(f"{error.full_key or 'configuration'}: {str(error).splitlines()[0]}") from None
    for key, value in flatten(values):
        if isinstance(value, str) and "${" in value:
            raise ConfigurationError(f"{key}: interpolation left unresolved in {value!r}")
    return {str(key): at_home(value) for key, value in values.items()} if isinstance(values, dict) else {}


def _is_plain(name: object) -> bool:
    """Return whether a name stays in the folder that it is a place in; one from elsewhere must not write anywhere."""
    if not isinstance(name, str | int | float) or isinstance(name, bool):
        return False
    path = PurePosixPath(str(name))
    return bool(path.parts) and not path.is_absolute() and ".." not in path.parts and is_seen(str(name))


def _short(text: str, most: int = 60) -> str:
    """Return a text as a message can quote it."""
    return text if len(text) <= most else f"{text[:most]}..."


def _has(values: Any, path: Sequence[str]) -> bool:
    """Return whether nested values hold a path; `init_args` may be left out of the path."""
    if not path:
        return True
    if isinstance(values, list):
        return is_index(path[0]) and int(path[0]) < len(values) and _has(values[int(path[0])], path[1:])
    if not isinstance(values, dict):
        return False
    inner = values.get("init_args")
    return (path[0] in values and _has(values[path[0]], path[1:])) or (inner is not None and _has(inner, path))
