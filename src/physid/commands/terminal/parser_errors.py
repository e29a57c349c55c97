"""What the parser says in many lines, in one."""

from __future__ import annotations

import difflib
import inspect
import re

from physid.commands.command import Command


def shorten(message: str) -> str:
    """Return one line of what the parser says in many: the key, what was expected, and what came.

    Where building an optional object failed, its own message stands among those of the alternatives.
    """
    own = re.search(r"^Errors:\n +- (?!Problem|Expected)(.*?)\n +- Expected", message, re.MULTILINE | re.DOTALL)
    if own:  # alternatives may have alternatives
        return inspect.cleandoc(re.sub(r".*^ *Errors:\n +- ", "", own[1], flags=re.MULTILINE | re.DOTALL))
    key = ".".join(re.findall(r'Parser key "([^"]+)"', message))
    if not key:
        return " ".join(message.split())
    building = re.search(r"Problem with given class_path '(\S+)':\n(.*?)\n +- Expected", message, re.DOTALL)
    if building and not re.search("Parser key|Expected", building[2]):
        return f"{key}: {building[1]}: {inspect.cleandoc(building[2])}"
    deepest = max(re.findall(r"^([ -]*)Expected", message, re.MULTILINE) or [""], key=len)
    wanted = re.findall(rf"^{deepest}Expected an? (.*?)(?:\. Got value: .*)?$", message, re.MULTILINE)
    kinds = [re.sub(r"^<class '(?:\w+\.)*(\w+)'>$", r"\1", kind).replace("NoneType", "null") for kind in wanted]
    kinds = [re.sub(r"^typing\.Literal\[(.*)\]$", r"one of \1", kind) for kind in kinds]
    came = re.search(r"(?:Got|Given) value: (.*)$", message, re.MULTILINE)
    given = f", got {came[1]}" if came else ""
    return f"{key}: expected {' or '.join(kinds)}{given}" if kinds else f"{key}: {' '.join(message.split()[3:])}"


def suggestion(command: Command, stray: str) -> str:
    """Say what a word that means nothing here may have been meant for."""
    from physid.shipped import names

    word = stray.split()[0]
    ends = {name.rpartition("/")[2]: name for name in names() if name.startswith(f"{command.name}/")}
    close = [word] if word in ends else difflib.get_close_matches(word, ends, n=1, cutoff=0.7)
    if command.configurable and close:
        return f"; did you mean --config {ends[close[0]]}? physid configs {command.name} lists all there are"
    return f"; physid {command.name} --help shows what it takes"
