"""What a fit found, for people and for programs: tables as plain values, a page of plots, files."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any, Final

import numpy as np

from simwarp.core import files
from simwarp.identify.fit import Fit, FitResult, FittedReading
from simwarp.identify.fit_ranges import ranges_of
from simwarp.vehicle.results.plot_style import BLUE, INK, ORANGE, legend
from simwarp.vehicle.rigs.rig_plots import label_axes, plot_page

STRONG: Final = 0.9
"""Correlation from which two parameters are named together."""
MOST_PANELS: Final = 24
"""Of a page of plots."""
COLUMNS: Final = 3
PANEL: Final = (4.6, 2.5)
"""[in]."""


def content_of(result: FitResult) -> dict[str, Any]:
    """All numbers for programs."""
    return {
        "parameters": result.rows(), "cost": result.cost, "first_cost": result.first_cost,
        "iterations": result.iterations, "reason": result.reason, "diverged": result.diverged,
        "correlations": strong_correlations(result), "unidentified": unidentified(result),
        "readings": [
            {"run": each.run, "reading": each.reading, "held_out": each.held_out, "rms": each.rms,
             "share": share_of(each)}
            for each in result.readings
        ],
        "patch": result.patch,
    }  # fmt: skip


def share_of(reading: FittedReading) -> float | None:
    """What is left over, over the spread of what was measured; None of a reading that is constant."""
    spread = float(np.std(reading.measured))
    return reading.rms / spread if spread > 0.0 else None


def strong_correlations(result: FitResult) -> list[dict[str, Any]]:
    """Pairs of parameters that the data tell apart badly."""
    found = []
    for first in range(result.count):
        for second in range(first):
            value = float(result.uncertainty.correlation[first, second])
            if abs(value) >= STRONG:
                found.append({"first": result.names[second], "second": result.names[first], "correlation": value})
    return sorted(found, key=lambda row: -abs(row["correlation"]))


def unidentified(result: FitResult) -> list[str]:
    """A line for every parameter and combination of parameters that the data do not tell."""
    lines = []
    found = result.uncertainty
    for index in np.flatnonzero(found.without_influence[: result.count]):
        lines.append(f"{result.names[index]}: no reading changes with it")
    for direction in found.directions:
        named = [(index, share) for index, share in direction if not found.without_influence[index]]
        if named:
            parts = ", ".join(f"{result.names[index]} ({share:+.2f})" for index, share in named)
            lines.append(f"together: {parts}: only other combinations change the readings")
    return lines


def write_results(fit: Fit, result: FitResult, folder: Path) -> dict[str, Path]:
    """Write all files of a result into a folder: what, by what it is.

    Raises:
        OutputError: the disk did not take one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    ranges = [dataclasses.asdict(each) for each in ranges_of(fit, result)]
    documents: dict[str, Any] = {
        "result": content_of(result), "patch": result.patch, "target": result.document, "ranges": ranges,
    }  # fmt: skip
    names = {"target": f"{fit.target.name}-fitted.json"}
    written = {}
    for what, value in documents.items():
        path = folder / names.get(what, f"{what}.json")
        files.write_file(path, files.layout(_finite(value)) + "\n")
        written[what] = path
    written["plot"] = folder / "fit.png"
    draw_fit(result, written["plot"], f"{fit.target.name}: fitted and measured")
    return written


def _finite(value: Any) -> Any:
    """The value with null where a number is not finite."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def draw_fit(result: FitResult, target: Path, title: str) -> None:
    """Write a page with a panel for every reading of every run: measured, and as the model has it.

    Args:
        result: of a fit.
        target: .png, .pdf or .svg.
        title: the heading.
    """
    shown = result.readings[:MOST_PANELS]
    columns = min(COLUMNS, len(shown))
    rows = math.ceil(len(shown) / columns)
    with plot_page(target, title, rows, columns, (PANEL[0] * columns, PANEL[1] * rows + 0.6)) as panels:
        for axes, reading in zip(panels.flat, shown, strict=False):
            axes.plot(reading.time, reading.measured, ".", color=BLUE, markersize=2.0, label="measured")
            axes.plot(reading.time, reading.predicted, "-", color=ORANGE, linewidth=1.2, label="model")
            beside = "held out: " if reading.held_out else ""
            label_axes(axes, f"{beside}{reading.run}", "t [s]")
            axes.set_ylabel(reading.reading, fontsize=8, color=INK)
            legend(axes)
        for axes in list(panels.flat)[len(shown) :]:
            axes.set_visible(False)
