"""What a command is: a typed function whose docstring is its help."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Command:
    """A command: a function, and how it is called.

    Attributes:
        function: What runs; parameters without a default are positional, keyword-only ones are options.
        reads: Dotted path of the class whose fields its configuration gives, if that names no classes itself.
    """

    function: Callable[..., None]
    reads: str = ""

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
        return {each.name: each.annotation != "bool" for each in parameters if each.kind is each.KEYWORD_ONLY}

    @property
    def summary(self) -> str:
        """The first line of the docstring."""
        return self.guide.partition("\n")[0]

    @property
    def guide(self) -> str:
        """The docstring without its list of arguments."""
        return inspect.cleandoc(self.function.__doc__ or "").partition("\nArgs:")[0].strip()

    def place(self, words: Sequence[str]) -> list[str]:
        """Spell what may follow the positionals as options: `diagnosis seal` becomes `diagnosis --step=seal`."""
        bare = [index for index, word in enumerate(words) if not word.startswith("-")][len(self.positionals) :]
        names = dict(zip(bare, self.optional, strict=False))
        return [f"--{names[index]}={word}" if index in names else word for index, word in enumerate(words)]

    def _places(self) -> list[inspect.Parameter]:
        parameters = inspect.signature(self.function).parameters.values()
        return [each for each in parameters if each.kind is not each.KEYWORD_ONLY and each.name != "configuration"]
