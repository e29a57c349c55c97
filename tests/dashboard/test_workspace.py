"""The workspace for Weights & Biases, built without network and held against a snapshot.

After a wanted change: python -m tests.dashboard.test_workspace writes the snapshot anew.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import pytest
from tests.dashboard.folders import write_runs

from physid.cli import main
from physid.dashboard.folders import find_runs
from physid.dashboard.run import read_run
from physid.dashboard.workspace import build_workspace

# wandb_workspaces 0.4 itself uses what pydantic calls deprecated.
pytestmark = pytest.mark.filterwarnings("ignore:Pydantic V1 style")
SNAPSHOT = Path(__file__).parent / "workspace.json"


def sections(root: Path) -> Any:
    """Return sections and panels of the workspace about some runs, without the numbers drawn for identity."""
    runs = [read_run(folder, root) for folder in find_runs(root)]
    model = build_workspace(runs, "somebody/physid")._to_model()
    content = json.loads(model.model_dump_json(by_alias=True, exclude_none=True))
    found = content["spec"]["section"]["panelBankConfig"]["sections"]
    return [
        {
            "name": section["name"],
            "panels": [{key: panel[key] for key in ("viewType", "config")} for panel in section["panels"]],
        }
        for section in found
    ]


def test_the_workspace_has_a_panel_for_everything_that_was_logged(tmp_path: Path) -> None:
    pytest.importorskip("wandb_workspaces", reason="needs the extra wandb: pip install 'physid[wandb]'")
    assert sections(write_runs(tmp_path / "runs")) == json.loads(SNAPSHOT.read_text())


def test_a_path_that_is_no_entity_and_project_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("wandb_workspaces", reason="needs the extra wandb: pip install 'physid[wandb]'")
    assert main(["dashboard", str(write_runs(tmp_path / "runs")), "--wandb=physid"]) == 2
    assert "expected ENTITY/PROJECT of Weights & Biases, got 'physid'" in capsys.readouterr().err


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        SNAPSHOT.write_text(json.dumps(sections(write_runs(Path(folder) / "runs")), indent=1) + "\n")
