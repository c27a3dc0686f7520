"""Success of the shipped off-road policy over obstacles, height of hills and softness of the soil, all three together.

    python benchmarks/off_road_grid.py                       # by camera, 48 episodes of each of 18 points
    python benchmarks/off_road_grid.py --obs state           # the policy by exact state, in the same worlds
    python benchmarks/off_road_grid.py --report-only         # table and picture again, from the rows

Rows are written to benchmarks/results/driving/off-road-grid/OBS.csv as points finish, and a point that is there, of the
same policy and as many episodes, is not evaluated again: after Ctrl-C the same command goes on. Beside the rows:
OBS.json with the machine and the revision, and docs/images/off_road_grid_OBS.png. All points have the same seed; on all
grounds the same worlds are driven. The camera sees the ground with the ruts that wheels leave in soil.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import torch
import warp as wp
from rich.console import Console

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.comparing import exit_code
from benchmarks.robustness import evaluate_points
from benchmarks.robustness_points import ROOT, Row, nominal_config, read_rows
from benchmarks.robustness_report import PICTURES, SEED, percent
from simwarp.bench.machine import describe
from simwarp.core.files import read_json
from simwarp.core.warp_start import start_warp
from simwarp.statistics.proportions import wilson_interval
from simwarp.tasks import resolve_device
from simwarp.tasks.driving.soil import SoilKind
from simwarp.train.evaluation.figure_style import INK, new_figure, save_figure
from simwarp.train.evaluation.grid import GridPoint, GridSettings
from simwarp.train.evaluation.grid_plot import Percent, draw_heat_map
from simwarp.train.networks.policies import find_policy
from simwarp.train.runs.run_files import write_json
from simwarp.train.runs.run_folder import git_revision

TASK: Final = "off-road"
RESULTS: Final = ROOT / "benchmarks" / "results" / "driving" / "off-road-grid"
OBSTACLES: Final = (0, 20, 50)
HILLS: Final = (0.0, 1.0)
GROUNDS: Final = {"rigid": SoilKind.NONE, "hard": SoilKind.HARD, "soft": SoilKind.SOFT}
EPISODES: Final = 48
"""Of each point: at 95 % the interval is from 86 to 99 %, at 50 % from 36 to 64 %."""
REASONS: Final = ("collision", "time_limit", "off_map", "upset")

Place = tuple[str, float, int]
"""Ground, hills, obstacles."""


def places(grounds: Sequence[str] = tuple(GROUNDS)) -> list[Place]:
    """Return all points, those of each ground together."""
    return list(itertools.product(grounds, HILLS, OBSTACLES))


def name_of(place: Place) -> str:
    """Return the name of a point in the rows."""
    ground, hills, obstacles = place
    return f"ground={ground} hills={hills:g} obstacles={obstacles}"


def point_at(place: Place, config: Any) -> GridPoint:
    """Return a point to evaluate, given the configuration in nominal conditions."""
    ground, hills, obstacles = place
    values = {"obstacles": obstacles, "hills": hills, "soil": GROUNDS[ground]}
    return GridPoint({**values, "soil": ground}, dataclasses.replace(config, **values))


def cell_of(row: Row) -> dict[str, Any]:
    """Return success with its 95 % interval, and shares of the ends that are none, of a row."""
    episodes, successes, reasons = int(row["episodes"]), int(row["successes"]), json.loads(row["reasons"])
    low, high = wilson_interval(successes, episodes)
    ends = {reason: reasons.get(reason, 0) for reason in REASONS}
    return {
        "episodes": episodes, "successes": successes, "success": successes / episodes, "low": low, "high": high,
        "mean_steps": row["mean_steps"], **ends,
    }  # fmt: skip


def cells_of(obs: str) -> dict[Place, dict[str, Any]]:
    """Return the cells of all points that have rows."""
    rows = read_rows(RESULTS / f"{obs}.csv")
    return {place: cell_of(rows[name_of(place)]) for place in places() if name_of(place) in rows}


def marginal(cells: Mapping[Place, Mapping[str, Any]], **fixed: Any) -> dict[str, Any] | None:
    """Return the share of success over all cells with some of ``ground``, ``hills``, ``obstacles`` fixed."""
    chosen = [
        cell for place, cell in cells.items()
        if all(dict(zip(("ground", "hills", "obstacles"), place, strict=True))[key] == fixed[key] for key in fixed)
    ]  # fmt: skip
    if not chosen:
        return None
    episodes, successes = (sum(cell[key] for cell in chosen) for key in ("episodes", "successes"))
    low, high = wilson_interval(successes, episodes)
    return {"success": successes / episodes, "low": low, "high": high, "episodes": episodes}


def table(cells: Mapping[Place, Mapping[str, Any]]) -> str:
    """Return success [%] with 95 % intervals as a table in Markdown: a line for each ground and height of hills."""
    shown = " | ".join(f"{count} obstacles" for count in OBSTACLES)
    ends = ", ".join(reason.replace("_", " ") for reason in REASONS)
    lines = [f"| ground | hills | {shown} | {ends} of all |", "|---|---|" + "---|" * (len(OBSTACLES) + 1)]
    for ground, hills in itertools.product(GROUNDS, HILLS):
        line = [cells.get((ground, hills, count)) for count in OBSTACLES]
        there = [cell for cell in line if cell is not None]
        if there:
            counts = ", ".join(str(sum(cell[reason] for cell in there)) for reason in REASONS)
            total = sum(cell["episodes"] for cell in there)
            lines.append(f"| {ground} | {hills:g} | {' | '.join(map(percent, line))} | {counts} of {total} |")
    for head, key, values in (
        ("ground", "ground", GROUNDS),
        ("hills", "hills", HILLS),
        ("obstacles", "obstacles", OBSTACLES),
    ):
        told = "; ".join(f"{value} {percent(marginal(cells, **{key: value}))}" for value in values)
        lines.append(f"\n{head}, over all others: {told}")
    return "\n".join(lines) + "\n"


def draw(obs: str, cells: Mapping[Place, Mapping[str, Any]], picture: Path) -> None:
    """Draw a map of obstacles and hills for each ground."""
    there = [ground for ground in GROUNDS if any(place[0] == ground for place in cells)]
    episodes = sorted({cell["episodes"] for cell in cells.values()})
    note = (
        f"{TASK}, --obs {obs}, the policy that ships: {' or '.join(map(str, episodes))} episodes per cell, the same "
        "worlds on all grounds; small numbers: Wilson intervals at 95 %."
    )
    figure = new_figure(2.9 * len(there), 3.1, f"{TASK} by {obs}: success [%]", note)
    for place, ground in enumerate(there):
        panel = figure.add_subplot(1, len(there), place + 1)
        parts: dict[tuple[int, int], Percent | None] = {}
        for at, hills in enumerate(HILLS):
            for to, count in enumerate(OBSTACLES):
                cell = cells.get((ground, hills, count))
                share = None if cell is None else (100 * cell["success"], 100 * cell["low"], 100 * cell["high"])
                parts[at, to] = share
        draw_heat_map(panel, parts, len(HILLS), len(OBSTACLES))
        panel.set_xticks(range(len(OBSTACLES)), [str(count) for count in OBSTACLES])
        panel.set_yticks(range(len(HILLS)), [f"{hills:g}" for hills in HILLS])
        panel.set_xlabel("obstacles", color=INK, fontsize=8)
        panel.set_ylabel("hills" if place == 0 else "", color=INK, fontsize=8)
        panel.set_title(
            f"{ground} ground" if ground == "rigid" else f"{ground} soil", loc="left", fontsize=9, color=INK
        )
    save_figure(figure, picture, dpi=100)


def report(obs: str, device: str, *, again: bool = False) -> None:
    """Write numbers, table and picture of the points that have rows.

    Args:
        obs: observations of the policy.
        device: that was evaluated on.
        again: nothing was evaluated: machine and revision are those of the last evaluation.
    """
    cells = cells_of(obs)
    if not cells:
        return
    path = RESULTS / f"{obs}.json"
    made = {"machine": describe(wp.get_device(device)), **git_revision()}
    if again and path.is_file():
        before = read_json(path, "results")
        made = {key: before[key] for key in made if key in before}
    numbers = [{**dict(zip(("ground", "hills", "obstacles"), place, strict=True)), **cells[place]} for place in cells]
    command = "python benchmarks/off_road_grid.py" + (f" --obs {obs}" if obs != "camera" else "")
    write_json(path, {"command": command, "task": TASK, "obs": obs, "seed": SEED, **made, "points": numbers})
    print(table(cells))
    draw(obs, cells, PICTURES / f"off_road_grid_{obs}.png")


def main(arguments: Sequence[str] | None = None) -> int:
    """Evaluate what is missing, then report; 130 after an interruption."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--obs", choices=("camera", "state"), default="camera")
    parser.add_argument("--grounds", nargs="+", choices=tuple(GROUNDS), default=tuple(GROUNDS))
    parser.add_argument("--episodes", type=int, default=EPISODES)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--report-only", action="store_true")
    options = parser.parse_args(arguments)
    if options.episodes < 1:
        parser.error(f"--episodes must be at least 1, got {options.episodes}")
    start_warp()
    torch.set_num_threads(1)
    device, whole = resolve_device(options.device), True
    if not options.report_only:
        source = find_policy(TASK, Path("shipped"), obs=options.obs)
        config = nominal_config(source, TASK)
        points = {name_of(place): point_at(place, config) for place in places(options.grounds)}
        settings = GridSettings(episodes=options.episodes, seed=SEED, device=device, paths_driven=False)
        path, name = RESULTS / f"{options.obs}.csv", f"{TASK} by {options.obs}"
        whole = evaluate_points(TASK, name, source, points, path, settings, Console(stderr=True))
    report(options.obs, device, again=options.report_only)
    return 0 if whole else 130


if __name__ == "__main__":
    sys.exit(exit_code("off_road_grid", main))
