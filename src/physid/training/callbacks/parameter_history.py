"""The history of the learned parameters, beside the truth where there is one: the paper's figure."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast, final

import lightning as L
import torch
from torch import Tensor

from physid.data.files import write_picture, write_text
from physid.data.truth import Truth, read_truth
from physid.estimation.measurement.unexplained import unexplained_kinds
from physid.estimation.prediction.coordinates import Unknown, logged_names
from physid.training.callbacks.run_state import RunState
from physid.training.parameters import PhysicalParameters
from physid.typed_files import check_as

BLUE, RED = "tab:blue", "tab:red"


@final
class ParameterHistory(L.Callback):
    """Log each learned parameter after every epoch; write parameters.csv and parameters.png at the end.

    This is the only part of training that reads the truth: it logs params/NAME/true and params/NAME/relative_error
    beside params/NAME/estimate, and draws a red line. Where a run descends first and refines its estimate afterwards,
    by_gradient_estimate and by_gradient_relative_error are those before the refinement.

    Attributes:
        rows: One row for each epoch, the first guess first: epoch, evaluations, and the value of each parameter.
    """

    def __init__(self) -> None:
        self.rows: list[dict[str, float]] = []
        self._truth: Truth | None = None

    def setup(self, trainer: L.Trainer, pl_module: L.LightningModule, stage: str) -> None:
        """Read the truth of the recording set, if there is one."""
        recordings = getattr(getattr(trainer, "datamodule", None), "recordings", None)
        self._truth = None if recordings is None else read_truth(recordings.folder)

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Note the first guess."""
        if not self.rows:
            self._note(trainer, pl_module)

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Note and log the estimates."""
        self._note(trainer, pl_module)
        self._log(pl_module)
        if getattr(pl_module, "by_gradient", False):
            self._log(pl_module, "by_gradient_")

    def on_test_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Log the estimates that are tested."""
        self._log(pl_module)

    def on_fit_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Write the history and draw it."""
        if not trainer.is_global_zero or not self.rows:  # a fit of no epoch has no history
            return
        folder = Path(trainer.default_root_dir)
        table = io.StringIO()
        writer = csv.DictWriter(table, list(self.rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.rows)
        write_text(folder / "parameters.csv", table.getvalue())
        # A run that had ended and is resumed computes nothing anew: its checkpoint knows the figures.
        callbacks: list[L.Callback] = trainer.callbacks  # type: ignore[attr-defined]
        kept = next((each.figures for each in callbacks if isinstance(each, RunState)), {})
        figures = {**kept, **{name: float(value) for name, value in trainer.callback_metrics.items()}}
        draw(
            self.rows, self._true(pl_module), folder / "parameters.png", _intervals(figures), unexplained_kinds(figures)
        )

    def state_dict(self) -> dict[str, Any]:
        """Return the rows, so that a resumed run continues the curve."""
        return {"rows": self.rows}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take the rows of the run that is resumed.

        Raises:
            ValueError: If they are none.
        """
        rows = state_dict["rows"]
        check_as(list[dict[str, float]], rows, "ParameterHistory.rows")
        if any({"epoch", "evaluations"} - row.keys() or row.keys() != rows[0].keys() for row in rows):
            raise ValueError("ParameterHistory.rows: expected epoch, evaluations and the same parameters in each")
        self.rows = rows

    def _note(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        done = len(self.rows)
        self.rows.append(
            {"epoch": done, "evaluations": float(cast(Tensor, module.evaluations))}
            | PhysicalParameters.of(module).estimates()
        )

    def _log(self, module: L.LightningModule, prefix: str = "") -> None:
        true = self._true(module)
        values: dict[str, float] = {}
        for name, value in PhysicalParameters.of(module).estimates().items():
            values[f"{name}/{prefix}estimate"] = value
            if name in true:
                values[f"{name}/true"] = true[name]
                if true[name]:
                    values[f"{name}/{prefix}relative_error"] = abs(value / true[name] - 1)
        for name, value in values.items():
            module.log(f"params/{name}", torch.tensor(value, dtype=torch.float64))

    def _true(self, module: L.LightningModule) -> dict[str, float]:
        """Return the true values of the learned parameters, as far as they are known; an absent effect has none."""
        if self._truth is None:
            return {}
        physical, known = PhysicalParameters.of(module), dict(self._truth.parameters)
        known |= {one.name: one.null for one in physical.space.unknowns if one.name not in physical.scene.unknown}
        known |= {f"{name}.{key}": value for name, own in self._truth.effects.items() for key, value in own.items()}
        return {name: known[name] for name in physical.names if name in known}


def _intervals(figures: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Return the intervals that were logged, by parameter."""
    names = logged_names(figures, "low")
    found = {name: (figures[f"params/{name}/low"], figures[f"params/{name}/high"]) for name in names}
    return {name: ends for name, ends in found.items() if math.isfinite(ends[1])}


def draw(
    rows: list[dict[str, float]],
    true: dict[str, float],
    path: Path,
    intervals: Mapping[str, tuple[float, float]] | None = None,
    unexplained: Sequence[str] = (),
) -> None:
    """Draw each parameter over the epochs in blue, its final interval, and the truth in red.

    Args:
        rows: See `ParameterHistory`.
        true: True values by name, as far as they are known.
        path: The image to write.
        intervals: 90 % intervals by name, as far as they are known.
        unexplained: Of which kinds (position, rotation) the model leaves more than noise, for which no interval allows.
    """
    from matplotlib.figure import Figure

    names = [name for name in rows[0] if name not in ("epoch", "evaluations")]
    figure = Figure(figsize=(4 * len(names), 3), layout="constrained")
    for axes, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
        axes.plot([row["epoch"] for row in rows], [row[name] for row in rows], color=BLUE, marker=".", label="estimate")
        if intervals and name in intervals:
            low, high = intervals[name]
            last, value = rows[-1]["epoch"], rows[-1][name]
            spread = [[value - low], [high - value]]
            axes.errorbar([last], [value], spread, color=BLUE, capsize=4, label="90 % interval")
        if name in true:
            axes.axhline(true[name], color=RED, label="truth")
        unit = Unknown.of(name).unit
        shown = name.replace("$", r"\$")  # which begins a formula
        axes.set(xlabel="epoch", ylabel=f"{shown} [{unit}]" if unit else shown)
        said = f"{rows[-1][name]:.4g}"
        if intervals and name in intervals:
            low, high = intervals[name]
            said += f" ({low:.4g} to {high:.4g})"
        axes.set_title(f"{said} {unit}".rstrip(), fontsize="medium")  # an interval may be too small to be seen
        axes.legend()
    if unexplained:
        what = " and ".join(unexplained)
        doubt = f"the model leaves more than noise ({what}):\nthe truth may lie outside the intervals"
        figure.suptitle(doubt, color=RED, fontsize="small")
    write_picture(path, figure)
