"""The command line: find the command, read its arguments, run it, and say in one or two lines what went wrong."""

from __future__ import annotations

import difflib
import os
import re
import signal
import sys
from argparse import ArgumentError, HelpFormatter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physid.commands import COMMANDS, Command, format_help
from physid.commands.terminal.parser_errors import shorten, suggestion
from physid.commands.terminal.screen import interruptible, stoppable, styled, write_any_sign
from physid.strict import nearest, one_line

if TYPE_CHECKING:
    from jsonargparse import ArgumentParser

OK, FAILED, USAGE, INTERRUPTED, TERMINATED = 0, 1, 2, 130, 143
LONGEST, MOST_LINES = 1000, 6
"""Letters of a line of an error, which may quote what a file holds, and its lines; the project's own have three."""
TRACEBACK = "PHYSID_TRACEBACK"
HOMELESS = "Could not determine home directory."
"""What pathlib says to a user without a home, as containers have, and HOME unset."""
PRINT, SETTINGS, ALLOW = "--print-config", "--settings", "allow"

OVERVIEW = """\
usage: physid COMMAND [options] [key=value ...]

Identify physical parameters (mass, friction, restitution) from video and known forces, and find out
where, why and by how much reality leaves the model.

{commands}
A first run, from nothing to an identified friction:
  physid generate --config generate/push trajectories=20 video=false
  physid fit data/push

Every value of a configuration file can be overridden: `trainer.max_epochs=3` or `--trainer.max_epochs 3`.
`physid COMMAND --help` explains one command. PHYSID_TRACEBACK=1 shows where in the code an error arose.
"""


class UsageError(ValueError):
    """The command line itself is wrong."""


@dataclass(frozen=True)
class Arguments:
    """The words after a command, sorted.

    Attributes:
        files: What stands behind each `--config`.
        overrides: `key=value` for the configuration.
        own: Words for the command's own parser.
        allowed: What stands behind each `--allow`.
    """

    files: tuple[str, ...]
    overrides: tuple[str, ...]
    own: tuple[str, ...]
    allowed: tuple[str, ...] = ()


def main(words: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0 done, 1 failed, 2 wrong input, 130 interrupted, 143 terminated."""
    words = list(sys.argv[1:] if words is None else words)
    # Read when torch loads: its idle threads would spin, and take the cores away from the threads of the rollout.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    came: list[int] = []
    try:
        with interruptible(), stoppable() as came:
            return _run(words)
    except KeyboardInterrupt as interrupt:
        return _stopped(came, str(interrupt))
    except BrokenPipeError:
        # The reader (`| head`) has seen enough; a closed stdout must not fail once more at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except Exception as error:
        if came:  # an import that was interrupted ends with any error
            return _stopped(came)
        if isinstance(error, MemoryError | RuntimeError | OSError):
            from physid.data.refusals import out_of_memory

            if out_of_memory(error):
                return _explain(error, FAILED)
        if isinstance(error, RuntimeError) and str(error) == HOMELESS:
            error = UsageError(
                "HOME: expected the folder of the user, which wandb and others write to, found none; set it"
            )
        if isinstance(error, ValueError | OSError | ArgumentError):
            return _explain(error, USAGE)
        if not isinstance(error, RuntimeError) or not type(error).__module__.startswith("physid."):
            raise
        return _explain(error, FAILED)


def program() -> None:
    """Run the command of this process and end it."""
    write_any_sign()
    code = main()
    # Python only tidies up now, and a Ctrl-C would print a traceback: the first is ignored, the second ends it at once.
    signal.signal(signal.SIGINT, lambda *_: signal.signal(signal.SIGINT, signal.SIG_DFL))
    sys.exit(code)


def overview() -> str:
    """Return the help of `physid` itself."""
    lines = [f"  {styled(f'{command.name:<16}', 'bold', sys.stdout)}{command.summary}\n" for command in COMMANDS]
    return OVERVIEW.format(commands="".join(lines))


def sort_words(words: Sequence[str], options: Mapping[str, bool]) -> Arguments:
    """Sort the words after a command into files, overrides and the command's own arguments.

    Args:
        words: What follows the command.
        options: Names of the command's own options, and whether each takes a value.

    Returns:
        The sorted words; options are spelt as the parser knows them, `--run_dir=X`.

    Raises:
        UsageError: If an option lacks its value.
    """
    files: list[str] = []
    overrides: list[str] = []
    own: list[str] = []
    allowed: list[str] = []
    rest = list(words)
    while rest:
        word = rest.pop(0)
        option, equals, value = word.partition("=")
        name = option.lstrip("-").replace("-", "_")
        if not word.strip():
            raise UsageError("expected a path or another value, found an empty word; is a variable of the shell empty?")
        if not word.startswith("-"):
            (overrides if equals and re.fullmatch(r"[\w.-]+", option) else own).append(word)
            continue
        if options.get(name, True) and not equals:
            if not rest or rest[0].startswith("--"):
                raise UsageError(f"{option}: no such option, or its value is missing{nearest(option, _spelt(options))}")
            value = rest.pop(0)
        if not value.strip() and options.get(name, name in ("config", ALLOW)):
            raise UsageError(f"{option}: expected a value, found none; is a variable of the shell empty?")
        if name == "config":
            files.append(value)
        elif name in options:
            own.append(f"--{name}={value or 'true'}")
        elif name == ALLOW:
            allowed += filter(None, value.split(","))
        elif close := difflib.get_close_matches(name, options, n=1, cutoff=0.8):
            raise UsageError(f"no option {option}{nearest(option, _spelt(close))}")
        else:
            overrides.append(f"{option.lstrip('-')}={value}")
    return Arguments(tuple(files), tuple(overrides), tuple(own), tuple(allowed))


def _run(words: list[str]) -> int:
    """Run the command that the words ask for."""
    if not words or words[0] in ("--help", "-h", "help"):
        print(overview(), end="")
        return OK
    if words[0] == "--version":
        from physid import __version__

        print(f"physid {__version__}")
        return OK
    known = {command.name: command for command in COMMANDS}
    if words[0] not in known:
        raise UsageError(f'unknown command "{words[0]}"{nearest(words[0], known)}')
    return _run_command(known[words[0]], words[1:])


def _run_command(command: Command, words: list[str]) -> int:
    """Read a command's arguments and run it."""
    from physid.commands.configured import configure, keys_of

    parser = _build_parser(command)
    if "--help" in words or "-h" in words:
        # Of settings there is a table of their own, with units (--settings).
        keys = {} if command.settings else keys_of(command, usual=True)
        print(format_help(parser.format_help(), command, keys), end="")
        return OK
    if command.settings and SETTINGS in words:
        from physid.class_paths import load_class

        kind = load_class(command.settings)
        assert kind is not None
        print(kind().listing())
        return OK
    shown = command.configurable and PRINT in words
    arguments = sort_words([word for word in words if not (shown and word == PRINT)], command.options)
    for word in arguments.overrides:
        if word in words and os.path.exists(word):
            raise UsageError(
                f"{word} is a file or folder here as well as key=value; write ./{word} for it, --{word} for the key"
            )
    arguments = replace(arguments, files=tuple(str(_here("config", Path(file))) for file in arguments.files))
    if command.laid:  # the command reads key=value itself
        laid = tuple(f"--{command.laid}={word}" for word in arguments.overrides)
        arguments = replace(arguments, overrides=(), own=arguments.own + laid)
    values = _parse(parser, arguments.own, command)
    command.check(values)
    if command.configurable:
        found = configure(command, values, arguments.files, arguments.overrides, arguments.allowed)
        values["configuration"] = found
        if shown and found:
            print(found.to_yaml(), end="")
            return OK
    elif stray := [
        *(["--config"] * bool(arguments.files)),
        *(["--allow"] * bool(arguments.allowed)),
        *arguments.overrides,
    ]:
        word = stray[0].partition("=")[0]
        known = nearest(word, _spelt(command.options))
        raise UsageError(f'{command.name} has no option "{word}", and takes no key=value{known}')
    command.function(**values)
    return OK


def _build_parser(command: Command) -> ArgumentParser:
    """Build the parser of a command from the signature and docstring of its function."""
    from jsonargparse import ArgumentParser

    # The docstrings say defaults and units in words; the plain formatter leaves jsonargparse's types out.
    parser = ArgumentParser(
        prog=f"physid {command.name}", formatter_class=HelpFormatter, exit_on_error=False, allow_abbrev=False
    )
    skip: set[str | int] = {"configuration"} if command.configurable else set()
    parser.add_function_arguments(command.function, as_group=False, as_positional=True, skip=skip)
    return parser


def _parse(parser: ArgumentParser, words: Sequence[str], command: Command) -> dict[str, Any]:
    """Parse a command's own words into the arguments of its function."""
    try:
        values = dict(parser.parse_args(command.place(words)).as_dict())
        return {name: _here(name, value) for name, value in values.items()}
    except ArgumentError as error:
        message = shorten(str(error))
        stray = message.partition("unrecognized arguments: ")[2]
        if stray.endswith((".yaml", ".yml")) and command.configurable:
            message += f"; did you mean --config {stray}?"
        elif stray:
            message += suggestion(command, stray)
        raise UsageError(f"{command.name}: {message}") from None


def _here(name: str, value: Any) -> Any:
    """Return a path as this machine has it: with what ~ stands for, as shells do it in most places and not in all.

    Raises:
        UsageError: If it is an address.
    """
    if isinstance(value, list):
        return [_here(name, each) for each in value]
    if not isinstance(value, Path):
        return value
    if re.match(r"[A-Za-z][\w+.-]+:/", str(value)) and not value.exists():
        raise UsageError(
            f"{name.replace('_', '-')}: expected a file or folder of this machine, found the address {value}"
        )
    return Path(os.path.expanduser(value))


def _spelt(options: Iterable[str]) -> list[str]:
    """Return the options as a user writes them."""
    return [f"--{name.replace('_', '-')}" for name in options]


def _stopped(came: Sequence[int], reason: str = "") -> int:
    """Say in one line that a signal has ended the command, and return the exit code."""
    word, code = ("terminated", TERMINATED) if signal.SIGTERM in came else ("interrupted", INTERRUPTED)
    print(f"\n{word}{f': {reason}' if reason else ''}", file=sys.stderr)
    return code


def _explain(error: Exception, code: int) -> int:
    """Print an error without its traceback and return the exit code."""
    if os.environ.get(TRACEBACK, "") not in ("", "0"):
        raise error
    message = str(error)
    if code == FAILED or isinstance(error, OSError | UnicodeEncodeError):
        from physid.data.refusals import worded

        message = worded(error)
    message = message or type(error).__name__
    many = isinstance(error, ArgumentError) or "Does not validate against" in message
    # Files and names in it are a stranger's: what they hold shall not reach the terminal as a command to it.
    lines = [one_line(line) for line in (shorten(message) if many else message).splitlines()]
    cut = "\n".join(line if len(line) <= LONGEST else f"{line[:LONGEST]}..." for line in lines[:MOST_LINES])
    print(f"{styled('physid:', 'red', sys.stderr)} {cut}", file=sys.stderr)
    return code
