"""The same view of the runs as a workspace of Weights & Biases, for those who log there."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

NAME = "physid"
GROUPS = {"loss": "Losses", "error": "Errors", "schedule": "Schedules"}
SCORES = ("test/position_error", "test/rotation_error", "test/psnr", "test/ssim", "seconds")


def build_workspace(runs: Sequence[Mapping[str, Any]], path: str) -> Any:
    """Build a workspace with a panel for everything that the runs have logged; needs no network.

    Args:
        runs: What `read_run` has read.
        path: ENTITY/PROJECT.

    Returns:
        A `wandb_workspaces.workspaces.Workspace`; `save()` publishes it.

    Raises:
        ValueError: If the path is no ENTITY/PROJECT, or the extra wandb is missing.
    """
    try:
        panels: Any = importlib.import_module("wandb_workspaces.reports.v2")
        workspaces: Any = importlib.import_module("wandb_workspaces.workspaces")
    except ImportError:
        raise ValueError("a workspace needs the extra wandb: pip install 'physid[wandb]'") from None
    entity, slash, project = path.partition("/")
    if not (entity and slash and project):
        raise ValueError(f"expected ENTITY/PROJECT of Weights & Biases, got {path!r}")
    sections = {"Parameters": [_parameter(panels, name) for name in _names(runs, "parameters")]}
    for group, title in GROUPS.items():
        names = _names(({"curves": _of_group(run, group)} for run in runs), "curves")
        sections[title] = [_curve(panels, name, group) for name in names]
    scores = [name for name in SCORES if any(name in run["figures"] for run in runs)]
    sections["Scores"] = [panels.BarPlot(title=name, metrics=[name]) for name in scores]
    if any(run["media"] for run in runs):
        sections["Films"] = [panels.MediaBrowser(title="prediction and frames", media_keys=["prediction", "frames"])]
    filled = [workspaces.Section(name=title, panels=each, is_open=True) for title, each in sections.items() if each]
    return workspaces.Workspace(entity=entity, project=project, name=NAME, sections=filled)


def publish(runs: Sequence[Mapping[str, Any]], path: str) -> str:
    """Publish the workspace and return its address.

    Args:
        runs: What `read_run` has read.
        path: ENTITY/PROJECT.

    Returns:
        Where it can be seen.

    Raises:
        ValueError: If the path is no ENTITY/PROJECT, the extra wandb is missing, or the server refuses.
    """
    workspace = build_workspace(runs, path)
    try:
        return str(workspace.save().url)
    except Exception as error:  # whatever the client raises: no account, no network, no such project
        raise ValueError(f"{path}: the workspace cannot be published: {error}") from None


def _parameter(panels: Any, name: str) -> Any:
    """Return a panel of a parameter beside its truth."""
    keys = [f"params/{name}/estimate", f"params/{name}/true"]
    return panels.LinePlot(title=name, x="epoch", y=keys)


def _curve(panels: Any, name: str, group: str) -> Any:
    """Return a panel of a curve; losses fall over decades."""
    return panels.LinePlot(title=name, x="epoch", y=[name], log_y=group == "loss")


def _of_group(run: Mapping[str, Any], group: str) -> list[Mapping[str, Any]]:
    return [curve for curve in run["curves"] if curve["group"] == group]


def _names(runs: Iterable[Mapping[str, Any]], key: str) -> list[str]:
    """Return the names of all parameters or curves, sorted."""
    return sorted({each["name"] for run in runs for each in run[key]})
