"""What several tests of runs begin with."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.training import regression


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Write the configuration of the smallest run into a folder, go there, and return the option that names it."""
    monkeypatch.chdir(tmp_path)
    name = regression.__name__
    (tmp_path / "line.yaml").write_text(
        f"model: {{class_path: {name}.Line}}\ndata: {{class_path: {name}.Points}}\n"
        "trainer: {max_epochs: 2, accelerator: cpu}\n"
    )
    return "--config=line.yaml"
