"""The command that teaches a shell what can follow `physid`."""

from __future__ import annotations

import inspect
import re
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from physid.commands.command import Command

CONFIGURED = ("--config", "--print-config", "--allow")

# Where no word fits, `-o default` completes files: a configuration, a folder of runs.
SCRIPT = """\
_physid() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD - 1]}} words=""
    case "$COMP_CWORD ${{COMP_WORDS[1]}} $word" in
    1\\ *) words="{commands} --help --version" ;;
{options}
    *)
        case "${{COMP_WORDS[1]}} $before" in
{values}
        esac ;;
    esac
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _physid physid
"""
ZSH = "autoload -U +X compinit bashcompinit && compinit && bashcompinit\n"


def completion(shell: Literal["bash", "zsh"] = "bash") -> None:
    """Print what makes a shell complete commands, options and their values.

    For the shells to come: physid completion >> ~/.bashrc, or physid completion zsh >> ~/.zshrc.

    Examples:
      physid completion >> ~/.bashrc
      source <(physid completion)

    Args:
        shell: bash or zsh.
    """
    from physid.commands import COMMANDS

    values = [line for command in COMMANDS for line in _values(command)]
    options = [f'    *" {command.name} -"*) words="{" ".join(_options(command))}" ;;' for command in COMMANDS]
    names = " ".join(command.name for command in COMMANDS)
    script = SCRIPT.format(commands=names, values="\n".join(values), options="\n".join(options))
    print((ZSH if shell == "zsh" else "") + script, end="")


def _choices(parameter: inspect.Parameter) -> list[str]:
    """Return the words that a parameter may be, where its type lists them."""
    annotation = str(parameter.annotation)
    return re.findall(r"['\"]([\w-]+)['\"]", annotation) if annotation.startswith("Literal[") else []


def _options(command: Command) -> list[str]:
    """Return the options of a command."""
    options = [f"--{name.replace('_', '-')}" for name in command.options]
    return [*options, *(CONFIGURED if command.configurable else ()), "--help"]


def _values(command: Command) -> list[str]:
    """Return the cases for what may follow an option, or the word before a positional."""
    lines, before = [], [command.name]
    for each in inspect.signature(command.function).parameters.values():
        option = each.kind is each.KEYWORD_ONLY
        words = _choices(each)
        if words:
            follows = [f"--{each.name.replace('_', '-')}"] if option else before
            pattern = "|".join(f'"{command.name} {word}"' for word in follows)
            lines.append(f'        {pattern}) words="{" ".join(words)}" ;;')
        before = before if option else words
    return lines
