"""The commands that say what can follow `physid`: words for a shell, and configurations."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
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
        *" --"*) ;;
        *)
            # A key of the configuration, where no file begins so.
            if [ -n "$word" ] && ! compgen -f -- "$word" > /dev/null; then
                case "${{COMP_WORDS[1]}}" in
{keys}
                esac
                [ -n "$(compgen -W "$words" -- "$word")" ] && compopt -o nospace 2> /dev/null
            fi ;;
        esac ;;
    esac
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _physid physid
"""
ZSH = "autoload -U +X compinit bashcompinit && compinit && bashcompinit\n"


def completion(shell: Literal["bash", "zsh"] = "bash") -> None:
    """Print what makes a shell complete commands, options, their values, and keys of configurations.

    For the shells to come: physid completion >> ~/.bashrc, or physid completion zsh >> ~/.zshrc.

    Examples:
      physid completion >> ~/.bashrc
      source <(physid completion)

    Args:
        shell: bash or zsh.
    """
    from physid.commands import COMMANDS
    from physid.commands.configured import keys_of

    values = [line for command in COMMANDS for line in _values(command)]
    options = [f'    *" {command.name} -"*) words="{" ".join(_options(command))}" ;;' for command in COMMANDS]
    keys = [f'                {command.name}) words="{" ".join(f"{key}=" for key in found)}" ;;'
            for command in COMMANDS if (found := keys_of(command))]  # fmt: skip
    names = " ".join(command.name for command in COMMANDS)
    script = SCRIPT.format(commands=names, values="\n".join(values), options="\n".join(options), keys="\n".join(keys))
    print((ZSH if shell == "zsh" else "") + script, end="")


def configs(name: str | None = None, *, out: Path | None = None) -> None:
    """List, show or copy the configurations that come with physid.

    Without a name all are listed. Every command that takes --config takes such a name as well as a file, and single
    values are changed on the command line; a copy is for more than that. It brings along what the file builds on.

    Examples:
      physid configs
      physid configs sysid/push_friction
      physid configs sysid/push_friction --out mine
      physid fit --config mine/sysid/push_friction.yaml

    Args:
        name: One of them, or a folder of them such as sysid; all by default.
        out: Folder to copy to, instead of showing; what lies there already is left.
    """
    from physid.configuration import ConfigurationError
    from physid.data.files import write_text
    from physid.shipped import SHIPPED, SUFFIX, names, summary, with_bases
    from physid.strict import nearest

    known = names()
    asked = (name or "").removeprefix("configs/").removesuffix(SUFFIX).strip("/")
    chosen = [each for each in known if not asked or each == asked or each.startswith(f"{asked}/")]
    if not chosen:
        raise ConfigurationError(f'configs: there is no "{name}"{nearest(asked, known)}; physid configs lists them')
    if out is None and chosen == [asked]:
        print((SHIPPED / f"{asked}{SUFFIX}").read_text(), end="")
        return
    if out is None:
        width = max(map(len, chosen))
        print("\n".join(f"{each:<{width}}  {summary(each)}" for each in chosen))
        return
    for each in dict.fromkeys(base for one in chosen for base in with_bases(one)):
        target = out / f"{each}{SUFFIX}"
        if target.exists():
            print(f"{target} is there already, and is left")
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        write_text(target, (SHIPPED / f"{each}{SUFFIX}").read_text())
        print(target)


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
