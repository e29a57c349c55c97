"""One tiny bank for all tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from physid.benchmark.bank import Bank, Size
from physid.benchmark.plan import Plan
from physid.benchmark.sealing.seal import seal

TINY = Plan("score", 3, Size(sets=8, trajectories=6, steps=60))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as slow what needs the bank, which takes twenty seconds to make."""
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent) and "bank" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def bank(tmp_path_factory: pytest.TempPathFactory) -> Bank:
    """Return a sealed bank; tests that write verdicts copy it."""
    return seal(tmp_path_factory.mktemp("bank"), TINY, quiet=True)
