"""One picture per recorded run: the reference and ours, one above the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from simwarp.core.files import replacing
from simwarp.vehicle.results.channels import Run
from simwarp.verify.vehicle_cases import LOADS, Case, low_pass

REFERENCE, OURS = "#b8bfc6", "#c8102e"
LOAD_NAMES = ("front left", "front right", "rear left", "rear right")


def draw(case: Case, known: Run, ours: Run, target: Path) -> None:
    """Writes the picture of a case."""
    figure = Figure(figsize=(11.0, 8.0), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(case.title, x=0.01, ha="left", fontsize=13, fontweight="bold")
    axes = figure.subplots(4, 2, sharex=True).ravel()

    def show(axis: int, title: str, reference: np.ndarray, mine: np.ndarray) -> None:
        place = axes[axis]
        place.plot(known["t_s"], reference, color=REFERENCE, linewidth=3.0, label="reference")
        place.plot(ours["t_s"], mine, color=OURS, linewidth=1.0, label="simwarp")
        place.set_title(title, loc="left", fontsize=9)
        place.spines[["top", "right"]].set_visible(False)
        place.grid(alpha=0.25, linewidth=0.5)

    show(0, "speed [m/s]", known["speed_mps"], ours["speed_mps"])
    show(1, "yaw rate [rad/s]", known["yawrate_radps"], ours["yawrate_radps"])
    show(2, "speed x yaw rate [m/s²]", *(run["speed_mps"] * run["yawrate_radps"] for run in (known, ours)))
    show(3, "gear", known["gear"], ours["gear"])
    for index, name in enumerate(LOADS):
        smooth = [low_pass(run[name][5:], 0.01) / 1e3 for run in (known, ours)]
        padded = [np.concatenate([np.full(5, np.nan), values]) for values in smooth]
        show(4 + index, f"load {LOAD_NAMES[index]} [kN], low-pass 10 Hz", *padded)
    for axis in axes[-2:]:
        axis.set_xlabel("time [s]", fontsize=9)
    axes[0].legend(frameon=False, fontsize=8)
    axes[0].set_xlim(known["t_s"][0], known["t_s"][-1])
    with replacing(target) as draft:
        figure.savefig(draft, dpi=110)
