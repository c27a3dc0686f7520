"""The learning curve as a picture."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.ticker import EngFormatter

from ..runs.progress_table import LOGGED, read_progress
from .figure_style import new_figure, save_figure

_PANELS = (("mean_reward", "mean return"), ("mean_episode_length", "mean episode length [steps]"))


def draw_learning_curve(progress: Path, picture: Path, title: str) -> None:
    """Draw return, episode length and what the task logs over environment steps, from ``progress.csv`` to a PNG."""
    rows = read_progress(progress)
    logged = [key for key in (rows[0] if rows else ()) if key.startswith(LOGGED)]
    panels = (*_PANELS, *((key, f"mean {key.removeprefix(LOGGED)}") for key in logged))
    figure = new_figure(4.0 * len(panels), 3.2)
    figure.suptitle(title)
    for column, (key, label) in enumerate(panels):
        axes = figure.add_subplot(1, len(panels), column + 1)
        points = [(float(row["env_steps"]), float(row[key])) for row in rows if row.get("env_steps") and row.get(key)]
        points = [(steps, value) for steps, value in points if math.isfinite(steps) and math.isfinite(value)]
        axes.plot([steps for steps, _ in points], [value for _, value in points], color="tab:blue")
        axes.set_xlabel("environment steps")
        axes.set_ylabel(label)
        axes.set_ylim(bottom=min(0.0, *(value for _, value in points)) if points else 0.0)
        axes.xaxis.set_major_formatter(EngFormatter())
        axes.grid(alpha=0.3)
    save_figure(figure, picture)
