"""Which classes the parser of a configuration may import: it asks for every path that a value names, however deep."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from jsonargparse import ArgumentError, _common, set_parsing_settings

from physid.class_paths import TRUSTED, ClassPathError, require_trusted

DENIED = re.compile(r"Importing '([\w.]+)' is not allowed")
"""How jsonargparse begins to say so."""


@contextmanager
def only_trusted_imports(allowed: Sequence[str] = ()) -> Iterator[None]:
    """Let values in the block import from `TRUSTED` and what the user allows, and from nowhere else.

    `physid.schema.check` says where a wrong path was set, by the types of what it is set for; but types that cannot be
    resolved, short names of classes and text within text escape it. The parser checks where it imports, and also
    where an object that it has found was defined: `torch.os.abort` is of `posix`.

    Args:
        allowed: Packages or modules that the user trusts beside `TRUSTED`.

    Raises:
        ClassPathError: If a value names something else.
    """
    before = dict(_common.parsing_settings)  # of the process; no public function takes a setting back
    set_parsing_settings(
        import_path_denylist=["*"],
        import_path_allowlist=[*TRUSTED, *allowed],
        instantiate_subclass_spec_in_any=False,
    )
    try:
        yield
    except ArgumentError as error:
        if (denied := DENIED.search(str(error))) is None:
            raise
        require_trusted(denied[1], allowed)
        raise ClassPathError(f"{denied[1]}: expected a class of {', '.join(TRUSTED)}") from None
    finally:
        _common.parsing_settings.clear()
        _common.parsing_settings.update(before)
