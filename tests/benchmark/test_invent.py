"""What is drawn for a bank."""

from __future__ import annotations

from typing import Any

import pytest

from physid.benchmark.bank import Size
from physid.benchmark.plan import Plan, Task
from physid.benchmark.sealing import invent


def test_where_nothing_shows_another_configuration_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[Any] = []
    monkeypatch.setattr(invent, "draw_sizes", lambda config, *_: tried.append(config))
    plan = Plan("calibration", 5, Size(sets=10, trajectories=12, steps=60))
    assert list(invent.inventions(plan, Task("003", "pair", 0))) == []
    assert len(tried) == invent.TRIES
    drawn = [tried[first : first + invent.SAME] for first in range(0, len(tried), invent.SAME)]
    assert all(config is some[0] for some in drawn for config in some)
    assert len({repr(some[0]) for some in drawn}) == len(drawn)
