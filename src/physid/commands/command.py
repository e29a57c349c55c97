"""What a command is: a typed function whose docstring is its help."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from physid.strict import LARGEST, whole

CONFIGURED = """\
  --config FILE         A configuration, or the name of a shipped one (physid configs); of several, later ones win.
  key=value             Overrides one value, in YAML: trainer.max_epochs=3, data.segment=null.
  --print-config        Print the resolved configuration and do nothing.
  --allow WHAT          Let the configuration name classes of a package of your own (my_package), or effects of a file
                        of your own (my_effects.py), whose code is then run.
"""

RANGES: Mapping[str, tuple[int, int | None]] = {
    "limit": (1, None),
    "count": (1, LARGEST["sample"]),
    "seeds": (1, LARGEST["seeds"]),
    "seed": (0, LARGEST["seed"]),
}
"""Least and largest value of options that are whole numbers; that of `PROCESSES` is said in `Command.check`."""
PROCESSES = ("workers", "at_once")


@dataclass(frozen=True)
class Command:
    """A command: a function, and how it is called.

    Attributes:
        function: What runs; parameters without a default are positional, keyword-only ones are options.
        reads: Dotted path of the class whose fields its configuration, or its words key=value, give, if these name no
            classes themselves.
        usual: The shipped configuration for recordings that come without one.
        laid: Option that takes the words key=value, where there is no configuration to take them.
        settings: Dotted path of the class whose `listing` the option --settings prints.
    """

    function: Callable[..., None]
    reads: str = ""
    usual: str = ""
    laid: str = ""
    settings: str = ""

    @property
    def name(self) -> str:
        """The word on the command line."""
        return self.function.__name__.rstrip("_")

    @property
    def configurable(self) -> bool:
        """Whether the command takes `--config` files and `key=value` overrides."""
        return "configuration" in inspect.signature(self.function).parameters

    @property
    def positionals(self) -> list[str]:
        """The names of what must be given, in order."""
        return [each.name for each in self._places() if each.default is each.empty]

    @property
    def optional(self) -> list[str]:
        """The names of what may follow, in order."""
        return [each.name for each in self._places() if each.default is not each.empty]

    @property
    def options(self) -> dict[str, bool]:
        """The names of the options, and whether each takes a value (a flag does not)."""
        parameters = inspect.signature(self.function).parameters.values()
        own = {each.name: each.annotation != "bool" for each in parameters if each.kind is each.KEYWORD_ONLY}
        return own | ({"settings": False} if self.settings else {})

    @property
    def summary(self) -> str:
        """The first line of the docstring."""
        return self.guide.partition("\n")[0]

    @property
    def guide(self) -> str:
        """The docstring without its list of arguments."""
        return inspect.cleandoc(self.function.__doc__ or "").partition("\nArgs:")[0].strip()

    @property
    def lists(self) -> set[str]:
        """The names of what may be given several times."""
        parameters = inspect.signature(self.function).parameters.values()
        return {each.name for each in parameters if "list[" in str(each.annotation)}

    def place(self, words: Sequence[str]) -> list[str]:
        """Spell what may follow the positionals as options: `diagnosis seal` becomes `diagnosis --step=seal`.

        What may be given several times becomes one list: `a.csv b.csv --map k=v` as `--sources=["a.csv", "b.csv"]
        --map=["k=v"]`.
        """
        gathered: dict[str, list[str]] = {}
        rest, bare, slots = [], 0, [*self.positionals, *self.optional]
        for word in words:
            name, equals, value = word.lstrip("-").partition("=")
            if word.startswith("-"):
                known = bool(equals) and name in self.lists
            else:
                name, value = (slots + slots[-1:] * (bare + 1 - len(slots)))[bare] if slots else "", word
                known, bare = name in self.lists, bare + 1
            if known:
                gathered.setdefault(name, []).append(value)
            elif not word.startswith("-") and name in self.optional and bare <= len(slots):
                rest.append(f"--{name}={word}")
            else:
                rest.append(word)
        return rest + [f"--{name}={json.dumps(values)}" for name, values in gathered.items()]

    def check(self, values: Mapping[str, object]) -> None:
        """Check the numbers among a command's own arguments.

        Raises:
            ValueError: If one is out of its range.
        """
        for name, value in values.items():
            where, most = f"{self.name}: --{name.replace('_', '-')}", LARGEST["workers"]
            if name in RANGES and value is not None:
                low, high = RANGES[name]
                whole(value, where, low=low, high=high)
            elif name in PROCESSES and isinstance(value, int) and not (value < 0 or 1 <= value <= most):
                raise ValueError(f"{where} must be from 1 to {most}, or -1 for one on each core, got {value}")

    def _places(self) -> list[inspect.Parameter]:
        parameters = inspect.signature(self.function).parameters.values()
        return [each for each in parameters if each.kind is not each.KEYWORD_ONLY and each.name != "configuration"]


def format_help(options: str, command: Command, keys: Mapping[str, str]) -> str:
    """Return the help of one command: what it does, examples, its options, how its configuration is given.

    Args:
        options: What the parser says of them.
        command: The command.
        keys: Those of its configuration, with their defaults.
    """
    _, _, options = options.partition("\n\n")
    options = re.sub(r"(--\w+) \{true,false\}(?:\n {24}| +)", lambda flag: f"{flag[1]:<22}", options)
    options = re.sub(r", --\w+\+ \w+", "", options)  # jsonargparse's way to append to a list
    options = re.sub(r"--\w+", lambda option: option[0].replace("_", "-"), options)
    positional = "".join(f" {each.upper()}" for each in command.positionals)
    positional += "".join(f" [{each.upper()}]" for each in command.optional)
    configured = CONFIGURED if command.configurable else ""
    named = "[--config FILE]" if "recordings" in command.optional else "--config FILE"
    usage = f" {named} [key=value ...]" if command.configurable else ""
    options = _with_defaults(options, command)
    head = f"usage: physid {command.name}{positional}{usage} [options]\n\n{command.guide}\n\n"
    return head + options + configured + _listed(keys)


def _with_defaults(options: str, command: Command) -> str:
    """Add to the help of options the defaults that their docstrings do not say."""
    for each in inspect.signature(command.function).parameters.values():
        default = each.default
        if default in (None, "", each.empty) or isinstance(default, bool) or each.kind is not each.KEYWORD_ONLY:
            continue
        found = re.search(rf"^  --{each.name.replace('_', '-')} .*?(?=^  -|\Z)", options, re.MULTILINE | re.DOTALL)
        if found and "default" not in found[0]:
            options = options[: found.end()].rstrip() + f" [{default}]\n" + options[found.end() :]
    return options


def _listed(keys: Mapping[str, str]) -> str:
    """List the keys of a configuration with their defaults."""
    lines = "\n".join(f"  {key}={default}".rstrip() for key, default in keys.items())
    return f"\nkeys, with their defaults:\n{lines}\n" if keys else ""
