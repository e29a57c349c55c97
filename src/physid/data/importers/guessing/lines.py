"""Lines of a mapping, and names of columns as YAML writes them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import yaml

from physid.data.importers.tables.table import Table
from physid.strict import one_line

MOST_NAMED = 12  # columns that a comment lists


@dataclass
class Lines:
    """Lines of a mapping, each perhaps with a doubt."""

    lines: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    units: dict[str, str] = field(default_factory=dict)
    """Of each quantity whose unit no header says."""

    def say(self, line: str, doubt: str = "") -> None:
        """Write a line; a doubt goes behind it, and is listed at the end."""
        self.lines.append(f"{line:<52}  # not sure: {doubt}" if doubt else line)
        if doubt:
            self.doubt(f"{line.strip('# ').partition(':')[0]}: {doubt}")

    def doubt(self, doubt: str) -> None:
        """List a doubt at the end, once."""
        if doubt not in self.doubts:
            self.doubts.append(doubt)

    def name_left_out(self, table: Table) -> None:
        """Say in comments which columns of a log the lines leave out, if any, and what of it cannot be used."""
        said, open_ends = set[str](), [yaml.safe_load(self._written())]
        while open_ends:
            value = open_ends.pop()
            if isinstance(value, Mapping):
                open_ends += value.values()
            elif isinstance(value, list):
                open_ends += value
            else:
                said.add(str(value))
        left = [name for name in table.columns if not {name, name.partition("[")[0], name.rpartition("/")[0]} & said]
        if left:
            more = f" and {len(left) - MOST_NAMED} more" if len(left) > MOST_NAMED else ""
            named = ", ".join(map(quoted, left[:MOST_NAMED]))
            self.lines.append(f"# not read, of {table.path.name}: {named}{more}")
        self.lines += [f"# not to be used: {reason}" for reason in table.refused.values()]

    def text(self) -> str:
        """Return the mapping as YAML, with all doubts at its end."""
        doubts = "".join(f"#   {one_line(doubt)}\n" for doubt in self.doubts)
        return f"{self._written()}\n# {len(self.doubts)} lines are not sure:\n{doubts}"

    def _written(self) -> str:
        """Return the lines as YAML: names in comments are a log's own, and none of them ends its line."""
        return "\n".join(map(one_line, self.lines))


def listed(table: Table, columns: Sequence[str]) -> str:
    """Write columns as a list, or by the one name that stands for them all, and for nothing else."""
    names = [bare(one) for one in columns]
    stem = names[0].rpartition("/")[0]
    alone = bool(stem) and table.components(stem) == names
    return quoted(stem) if alone else f"[{', '.join(columns)}]"


def frame_of(table: Table, columns: Sequence[str], point: str = "") -> str:
    """Say which frame the log says that columns are in; nothing where it does not."""
    frame = " and ".join(table.frames.get(table.topic_of(bare(columns[0])), ()))
    return (
        f"in the frame {frame}: are its axes the world's" + (f", its origin {point}?" if point else "?")
        if frame
        else ""
    )


def quoted(name: str) -> str:
    """Quote a name for YAML where it needs it."""
    return (
        name
        if re.fullmatch(r"[A-Za-z_/][\w. /]*", name) and name.lower() not in ("yes", "no", "on", "off")
        else json.dumps(name, ensure_ascii=not name.isprintable())
    )


def bare(name: str) -> str:
    """Return a name without its quotes."""
    return str(json.loads(name)) if name.startswith('"') else name
