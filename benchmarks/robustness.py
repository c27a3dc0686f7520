"""Success of driving policies over conditions that they were not trained in: one axis at a time, and maps of two.

    python benchmarks/robustness.py obstacle-avoidance off-road                    # the shipped policies by camera
    python benchmarks/robustness.py obstacle-avoidance --policies shipped drawn=runs/obstacle-avoidance/NAME
    python benchmarks/robustness.py off-road --obs state --axes friction mass --maps
    python benchmarks/robustness.py hallway --values 3 --maps                      # coarse: long episodes are dear
    python benchmarks/robustness.py off-road --report-only                         # tables and picture, from the rows

A policy is LABEL=WHERE, WHERE being what `simwarp eval --checkpoint` takes; {task} in it is the task's name. All axes
start from the nominal point, at which tasks are trained by default; `drawn` is a point too, with all conditions drawn.
The same worlds are driven at all points, by all policies.

Rows are written to benchmarks/results/robustness/TASK.OBS.LABEL.csv as points finish. A point that is there, of the
same policy and as many episodes, is not evaluated again; after Ctrl-C the same command goes on. Beside the rows:
TASK.OBS.json with the machine, TASK.OBS.md with the tables, and docs/images/robustness_TASK_OBS.png.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import hashlib
import itertools
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
import warp as wp
from matplotlib.lines import Line2D
from rich.console import Console

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from simwarp.bench.machine import describe  # noqa: E402
from simwarp.core.warp_start import start_warp  # noqa: E402
from simwarp.tasks import resolve_device, task_class  # noqa: E402
from simwarp.tasks.driving.conditions import NEUTRAL, SEEN, Conditions  # noqa: E402
from simwarp.train.config import task_config_from_plain  # noqa: E402
from simwarp.train.evaluation.evaluation import wilson_interval  # noqa: E402
from simwarp.train.evaluation.figure_style import INK, PALE, new_figure, save_figure, style_axes  # noqa: E402
from simwarp.train.evaluation.grid import (  # noqa: E402
    EvaluationStoppedError,
    GridDisplay,
    GridPoint,
    GridSettings,
    PointResult,
    evaluate_grid,
)
from simwarp.train.evaluation.grid_plot import Percent, draw_heat_map  # noqa: E402
from simwarp.train.networks.policies import PolicySource, find_policy  # noqa: E402
from simwarp.train.runs.run_files import write_json, write_run_file  # noqa: E402
from simwarp.train.runs.run_folder import git_revision  # noqa: E402
from simwarp.train.runs.stopping import stop_on_signals  # noqa: E402
from simwarp.vehicle import load_vehicle, option_names, with_options  # noqa: E402

RESULTS: Final = ROOT / "benchmarks" / "results" / "robustness"
PICTURES: Final = ROOT / "docs" / "images"
SEED: Final = 1_000_003
EPISODES: Final = {"hallway": 48, "barrier-track": 48, "convoy": 64}
"""Of tasks whose episodes are long; of others `USUAL_EPISODES`."""
USUAL_EPISODES: Final = 128
"""At 95 % the interval is from 90 to 98 %, at 50 % from 41 to 59 %."""
COLUMNS: Final = (
    "digest", "point", "episodes", "successes", "success_low", "success_high", "mean_return", "mean_steps", "reasons",
    "wall_s",
)  # fmt: skip
COLOURS: Final = ("#0b6e99", "#b8470f", "#4d7c0f", "#7c3aed", "#be185d")
DRAWN: Final = "conditions=random"
NOMINAL: Final = "nominal"
WIDE: Final = 4
"""Panels beside each other."""

Row = dict[str, Any]
Changes = Mapping[str, Any]


@dataclasses.dataclass(frozen=True)
class Axis:
    """A condition that is varied.

    Attributes:
        field: of the task's configuration.
        values: of the field.
        label: in pictures and tables, with the unit.
        scale: of the values where they are shown.
        nominal: the value at the nominal point, as it is shown; None: that of the configuration.
    """

    field: str
    values: Sequence[Any]
    label: str
    scale: float = 1.0
    nominal: Any = None

    def told(self, value: Any) -> str:
        """A value as tables have it."""
        if isinstance(value, bool):
            return "full" if value else "reduced"
        return f"{value * self.scale:.4g}" if isinstance(value, int | float) else str(value)


DEGREES: Final = 180.0 / math.pi
SUN: Final = (63.435, -36.87)
"""Elevation and azimuth of the sun of `Lighting` [°]."""


def _radians(*degrees: float) -> tuple[float, ...]:
    return tuple(round(math.radians(each), 6) for each in degrees)


AXES: Final = {
    axis.field: axis
    for axis in (
        Axis("friction", (0.3, 0.4, 0.5, 0.6, 0.75, 0.9, 1.1), "friction of the ground"),
        Axis("mass", (0.8, 1.0, 1.2, 1.4, 1.6, 2.0), "mass of the chassis, factor"),
        Axis("light", (0.1, 0.2, 0.35, 0.6, 1.0, 1.5, 2.5), "light, factor"),
        Axis("sun_elevation", _radians(5, 10, 20, 35, 50, SUN[0], 85), "sun above the horizon [°]", DEGREES, SUN[0]),
        Axis("sun_azimuth", _radians(-135, -90, SUN[1], 0, 45, 90, 180), "sun's azimuth [°]", DEGREES, SUN[1]),
        Axis("fog", (0.0, 0.005, 0.01, 0.015, 0.02, 0.03, 0.05), "fog [1/m]"),
        Axis("image_noise", (0.0, 0.01, 0.02, 0.05, 0.1, 0.2), "noise of a pixel's value"),
        Axis("contrast", (0.4, 0.55, 0.7, 0.85, 1.0, 1.15, 1.3, 1.6), "contrast, factor"),
        Axis("image_delay", (0, 1, 2, 3), "delay of the image [control steps]"),
        Axis("action_delay", (0, 1, 2, 3), "delay of the actions [control steps]"),
        Axis("tires", (), "tire model", nominal="own"),
        Axis("full", (False, True), "model of the vehicle"),
    )
}


@dataclasses.dataclass(frozen=True)
class Map:
    """Two conditions that are varied together.

    Attributes:
        down, across: fields.
        rows, columns: values of them.
    """

    down: str
    rows: Sequence[Any]
    across: str
    columns: Sequence[Any]

    def changes(self) -> list[list[Changes]]:
        """What is changed in each cell."""
        return [[{self.down: one, self.across: other} for other in self.columns] for one in self.rows]


MAPS: Final = {
    "friction-mass": Map("friction", (0.3, 0.5, 0.75, 0.9), "mass", (0.8, 1.0, 1.4, 2.0)),
    "fog-light": Map("fog", (0.0, 0.01, 0.02, 0.03), "light", (0.2, 0.6, 1.0, 1.5)),
    "delays": Map("image_delay", (0, 1, 2), "action_delay", (0, 1, 2)),
}


def thinned(axis: Axis, count: int) -> Axis:
    """Return an axis with `count` of its numbers, both ends among them; models of tires and vehicles are all kept."""
    values = axis.values
    if len(values) <= count or not all(isinstance(value, int | float) for value in values):
        return axis
    places = [round(at * (len(values) - 1) / (count - 1)) for at in range(count)]
    return dataclasses.replace(axis, values=tuple(values[place] for place in places))


def axes_of_task(task: str, obs: str, wanted: Sequence[str]) -> dict[str, Axis]:
    """Return the axes that say something about a task: none of the camera by state, tires that there are."""
    found = {}
    cls: Any = task_class(task)
    for name in wanted:
        axis = AXES[name]
        if obs != "camera" and name in (*SEEN, "image_delay"):
            continue
        if name == "tires":
            axis = dataclasses.replace(axis, values=("own", *other_tires(cls)))
        if name == "full" and cls.vehicle_name == cls.full_name:
            continue
        found[name] = axis
    return found


def other_tires(cls: Any) -> list[str]:
    """Return the names of the tires that are shipped for a task's vehicle, but for its own and those without a law."""
    spec = load_vehicle(cls.vehicle_name)
    own = spec if cls.tire is None else with_options(spec, tire=cls.tire)
    names = [name for name in option_names(cls.vehicle_name, "tire") if "rigid" not in name]
    return [name for name in names if with_options(spec, tire=name).axles != own.axles]


def nominal_config(source: PolicySource, task: str) -> Any:
    """Return the configuration that a policy was trained with, at the nominal point of all conditions.

    Worlds that `simwarp train` begins with in place of those of an evaluation, such as harder ones, are set aside.
    """
    cls = task_class(task)
    config: Any = task_config_from_plain(cls, source.content["task_config"], f"checkpoint {source.path}: task_config")
    plain, worlds = cls.config_type(), cls.trained_in.keys() - {"conditions"}
    usual = {
        name: getattr(plain, name)
        for name in (*NEUTRAL, "friction", "tires", "full", "soil", "randomise", "sensing", "curriculum", *worlds)
    }
    return dataclasses.replace(config, conditions=Conditions.NOMINAL, **usual)


def changed(config: Any, changes: Changes) -> Any:
    """Return a configuration with some conditions changed, as they stand in `AXES`."""
    given: dict[str, Any] = dict(changes)
    if "action_delay" in given:
        given["action_delay"] = (given["action_delay"],) * 2
    if given.get("tires") == "own":
        given["tires"] = None
    if "conditions" in given:
        given["conditions"] = Conditions(given["conditions"])
    return dataclasses.replace(config, **given)


def nominal_value(config: Any, axis: Axis) -> Any:
    """Return the value of an axis at the nominal point."""
    if axis.nominal is not None:
        return _radians(axis.nominal)[0] if axis.scale == DEGREES else axis.nominal
    value = getattr(config, axis.field)
    return value[0] if isinstance(value, tuple) else value


def key_of(config: Any, changes: Changes) -> str:
    """Return the name of a point: what differs from the nominal one, in the order of `AXES`."""
    if "conditions" in changes:
        return DRAWN
    parts = []
    for name, axis in AXES.items():
        if name not in changes:
            continue
        if changes[name] != nominal_value(config, axis):
            parts.append(f"{name}={changes[name]}")
    return " ".join(parts) or NOMINAL


def wanted_points(config: Any, axes: Mapping[str, Axis], maps: Sequence[str]) -> dict[str, Changes]:
    """Return the points, each once: name -> what is changed. The nominal one and the drawn one come first."""
    changes: Changes
    points: dict[str, Changes] = {NOMINAL: {}, DRAWN: {"conditions": "random"}}
    for name, axis in axes.items():
        for value in axis.values:
            changes = {name: value}
            points.setdefault(key_of(config, changes), changes)
    for name in maps:
        if MAPS[name].down in axes and MAPS[name].across in axes:
            for changes in itertools.chain(*MAPS[name].changes()):
                points.setdefault(key_of(config, changes), changes)
    return points


# ---- rows -----------------------------------------------------------------------------------------------------------


def path_of(task: str, obs: str, label: str) -> Path:
    """Return the file of a policy's rows."""
    return RESULTS / f"{task}.{obs}.{label}.csv"


def read_rows(path: Path, digest: str | None = None) -> dict[str, Row]:
    """Return the rows of a file, by point: those of a policy, or without a digest of the last one that was evaluated.

    Of two rows of a point the one with more episodes counts.
    """
    if not path.exists():
        return {}
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    digest = rows[-1]["digest"] if digest is None and rows else digest
    found: dict[str, Row] = {}
    for text in rows:
        row = {name: text[name] if name in ("digest", "point", "reasons") else float(text[name]) for name in COLUMNS}
        known = found.get(text["point"])
        if text["digest"] == digest and (known is None or known["episodes"] <= row["episodes"]):
            found[text["point"]] = row
    return found


def write_row(path: Path, digest: str, point: str, result: PointResult) -> None:
    """Add the row of a point to a file."""
    value = result.evaluation
    low, high = value.success_ci95
    values = (
        digest, point, value.episodes, round(value.success_rate * value.episodes), round(low, 4), round(high, 4),
        round(value.mean_return, 4), round(value.mean_episode_length, 2), json.dumps(value.end_reasons),
        round(result.seconds, 1),
    )  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    new = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        writer.writerow(values)


def digest_of(source: PolicySource) -> str:
    """Return what tells a policy from others: the beginning of its file's hash."""
    return hashlib.sha256(source.path.read_bytes()).hexdigest()[:12]


# ---- evaluation -----------------------------------------------------------------------------------------------------


def evaluate_policy(task: str, label: str, where: str, options: argparse.Namespace, console: Console) -> bool:
    """Evaluate a policy at the points that are not there yet; False if it was asked to stop."""
    source = find_policy(task, Path(where.replace("{task}", task)), obs=options.obs)
    config, digest, path = nominal_config(source, task), digest_of(source), path_of(task, options.obs, label)
    episodes = options.episodes or EPISODES.get(task, USUAL_EPISODES)
    axes = axes_of_task(task, options.obs, options.axes)
    if options.values:
        axes = {name: thinned(axis, options.values) for name, axis in axes.items()}
    there = read_rows(path, digest)
    missing = {
        point: changes
        for point, changes in wanted_points(config, axes, options.maps).items()
        if point not in there or there[point]["episodes"] < episodes
    }
    console.print(f"{task}, {label}: {source.origin}; {len(missing)} points to evaluate", highlight=False)
    if not missing:
        return True
    points = [GridPoint(changes or {"conditions": NOMINAL}, changed(config, changes)) for changes in missing.values()]
    names = {id(point): name for point, name in zip(points, missing, strict=True)}
    results: list[PointResult] = []
    written: list[PointResult] = []

    def after() -> None:
        for result in results[len(written) :]:
            write_row(path, digest, names[id(result.point)], result)
            written.append(result)

    settings = GridSettings(
        episodes=episodes, seed=SEED, device=resolve_device(options.device), num_envs=options.num_envs,
        paths_driven=False,
    )  # fmt: skip
    with stop_on_signals() as stop, GridDisplay(console, len(points), 1, episodes) as display:
        try:
            evaluate_grid(task, source.policy, points, settings, results=results, display=display, stop=stop,
                          after=after)  # fmt: skip
        except EvaluationStoppedError as stopped:
            console.print(f"stopped at {stopped.where}; the same command goes on", highlight=False)
            return False
    return True


# ---- report ---------------------------------------------------------------------------------------------------------


def labels_of(task: str, obs: str, first: Sequence[str]) -> list[str]:
    """Return the labels of the policies that have rows: those asked for first, then others by name."""
    known = sorted(path.name.removeprefix(f"{task}.{obs}.")[:-4] for path in RESULTS.glob(f"{task}.{obs}.*.csv"))
    return [label for label in first if label in known] + [label for label in known if label not in first]


def numbers_of(task: str, obs: str, labels: Sequence[str]) -> dict[str, Any]:
    """Return the rows of all policies by axis and map: label -> parts; points that are not there are left away."""
    config: Any = dataclasses.replace(task_class(task).config_type())
    found: dict[str, Any] = {}
    for label in labels:
        rows = read_rows(path_of(task, obs, label))

        def told(changes: Changes, rows: Mapping[str, Row] = rows) -> dict[str, Any] | None:
            row = rows.get(key_of(config, changes))
            if row is None:
                return None
            episodes, successes = int(row["episodes"]), int(row["successes"])
            low, high = wilson_interval(successes, episodes)
            return {
                "episodes": episodes, "successes": successes, "success": successes / episodes, "low": low,
                "high": high, "reasons": json.loads(row["reasons"]),
            }  # fmt: skip

        axes = {
            name: [{"value": value, **cell} for value in axis.values if (cell := told({name: value}))]
            for name, axis in axes_of_task(task, obs, tuple(AXES)).items()
        }
        maps = {}
        for name, each in MAPS.items():
            cells = [[told(changes) for changes in line] for line in each.changes()]
            there = sum(cell is not None for line in cells for cell in line)
            if there >= len(each.rows) + len(each.columns):  # more than the two axes have
                maps[name] = cells
        found[label] = {
            "digest": next((row["digest"] for row in rows.values()), None),
            "nominal": told({}), "drawn": told({"conditions": "random"}),
            "axes": {name: cells for name, cells in axes.items() if len(cells) > 1}, "maps": maps,
        }  # fmt: skip
    return found


def percent(cell: Mapping[str, float] | None) -> str:
    """Return a rate with its interval [%]."""
    if cell is None:
        return "–"
    return f"{100 * cell['success']:.1f} ({100 * cell['low']:.0f} to {100 * cell['high']:.0f})"


def tables(task: str, numbers: Mapping[str, Any]) -> str:
    """Return success rates [%] with 95 % intervals as tables in Markdown: axes, then maps."""
    labels = list(numbers)
    lines = [f"| {task}: success [%] | | {' | '.join(labels)} |", "|---|---|" + "---|" * len(labels)]
    for name, about in (("nominal", "all conditions as in training by default"), ("drawn", "all conditions drawn")):
        lines.append(f"| {about} | | {' | '.join(percent(numbers[label][name]) for label in labels)} |")
    for name, axis in AXES.items():
        cells = {
            label: {json.dumps(cell["value"]): cell for cell in numbers[label]["axes"].get(name, ())}
            for label in labels
        }
        values = list(dict.fromkeys(value for each in cells.values() for value in each))
        for place, value in enumerate(values):
            head = axis.label if place == 0 else ""
            told = " | ".join(percent(cells[label].get(value)) for label in labels)
            lines.append(f"| {head} | {axis.told(json.loads(value))} | {told} |")
    for name, each in MAPS.items():
        down, across = AXES[each.down], AXES[each.across]
        for label in labels:
            if name in numbers[label]["maps"]:
                shown = " | ".join(across.told(value) for value in each.columns)
                lines += ["", f"| {label}: {down.label} \\ {across.label} | {shown} |"]
                lines.append("|---|" + "---|" * len(each.columns))
                for value, cells_of in zip(each.rows, numbers[label]["maps"][name], strict=True):
                    lines.append(f"| {down.told(value)} | {' | '.join(map(percent, cells_of))} |")
    return "\n".join(lines) + "\n"


def _draw_axis(panel: Any, axis: Axis, usual: Any, numbers: Mapping[str, Any]) -> None:
    """Draw the curve of each policy along an axis."""
    style_axes(panel)
    values = list(
        dict.fromkeys(cell["value"] for each in numbers.values() for cell in each["axes"].get(axis.field, ()))
    )
    numeric = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    places = {value: float(value) * axis.scale if numeric else float(at) for at, value in enumerate(values)}
    for index, each in enumerate(numbers.values()):
        cells = each["axes"].get(axis.field, ())
        aside = 0.0 if numeric else 0.12 * (index - 0.5 * (len(numbers) - 1))
        x = [places[cell["value"]] + aside for cell in cells]
        y = np.array([100.0 * cell["success"] for cell in cells])
        off = [y - [100.0 * cell["low"] for cell in cells], [100.0 * cell["high"] for cell in cells] - y]
        panel.errorbar(
            x, y, yerr=np.maximum(off, 0.0), color=COLOURS[index % len(COLOURS)], capsize=2.5, linewidth=1.3,
            markersize=3.5, marker="o", linestyle="-" if numeric else "none", clip_on=False,
        )  # fmt: skip
    if not numeric:
        panel.set_xticks(list(places.values()), [axis.told(value) for value in values], fontsize=7)
        panel.tick_params(axis="x", rotation=20 if len(values) > 2 else 0)
        panel.set_xlim(-0.5, len(values) - 0.5)
    else:
        panel.axvline(usual * axis.scale, color=PALE, linewidth=4.0, zorder=0)
    panel.set_ylim(0.0, 100.0)
    panel.grid(axis="y", color=PALE, linewidth=0.8)
    panel.set_xlabel(axis.label, color=INK, fontsize=8)


def draw(task: str, obs: str, numbers: Mapping[str, Any], picture: Path) -> None:
    """Draw curves along the axes, a line per policy, and the maps of each policy below."""
    axes = [AXES[name] for name in AXES if any(name in each["axes"] for each in numbers.values())]
    maps = [(name, label) for name in MAPS for label, each in numbers.items() if name in each["maps"]]
    rows = math.ceil(len(axes) / WIDE), math.ceil(len(maps) / 2)
    heights = [2.0] * rows[0] + [2.5] * rows[1]
    legend = [
        Line2D([], [], color=COLOURS[at % len(COLOURS)], marker="o", label=label) for at, label in enumerate(numbers)
    ]
    episodes = sorted({each["nominal"]["episodes"] for each in numbers.values() if each["nominal"]})
    note = (
        f"{task}, --obs {obs}: {' or '.join(map(str, episodes))} episodes per point, the same worlds at all; bars and "
        "small numbers: Wilson intervals at 95 %. A grey line is the nominal value, which all other conditions have."
    )
    figure = new_figure(11.0, sum(heights) + 0.9, f"{task}: success [%] over conditions", note, legend=legend)
    grid = figure.add_gridspec(len(heights), 2 * WIDE, height_ratios=heights)
    for place, axis in enumerate(axes):
        row, column = divmod(place, WIDE)
        usual = nominal_value(task_class(task).config_type(), axis)
        _draw_axis(figure.add_subplot(grid[row, 2 * column : 2 * column + 2]), axis, usual, numbers)
    for place, (name, label) in enumerate(maps):
        row, column = divmod(place, 2)
        panel = figure.add_subplot(grid[rows[0] + row, WIDE * column : WIDE * column + WIDE])
        down, across = AXES[MAPS[name].down], AXES[MAPS[name].across]
        ones, others = MAPS[name].rows, MAPS[name].columns
        cells: dict[tuple[int, int], Percent | None] = {
            (at, to): None if cell is None else (100 * cell["success"], 100 * cell["low"], 100 * cell["high"])
            for at, line in enumerate(numbers[label]["maps"][name])
            for to, cell in enumerate(line)
        }
        draw_heat_map(panel, cells, len(ones), len(others))
        panel.set_xticks(range(len(others)), [across.told(value) for value in others])
        panel.set_yticks(range(len(ones)), [down.told(value) for value in ones])
        panel.set_xlabel(across.label, color=INK, fontsize=8)
        panel.set_ylabel(down.label, color=INK, fontsize=8)
        panel.set_title(label, loc="left", fontsize=9, color=INK)
    save_figure(figure, picture, dpi=100)


def report(task: str, options: argparse.Namespace, console: Console) -> None:
    """Write numbers, tables and picture of a task, of all policies that have rows."""
    labels = labels_of(task, options.obs, [label for label, _ in options.policies])
    numbers = numbers_of(task, options.obs, labels)
    if not numbers:
        console.print(f"{task}: no rows yet")
        return
    machine = describe(wp.get_device(resolve_device(options.device)))
    content = {
        "task": task,
        "obs": options.obs,
        "seed": SEED,
        "machine": machine,
        **git_revision(),
        "policies": numbers,
    }
    write_json(RESULTS / f"{task}.{options.obs}.json", content)
    text = tables(task, numbers)
    write_run_file(RESULTS / f"{task}.{options.obs}.md", text.encode())
    print(text)
    if any(each["axes"] or each["maps"] for each in numbers.values()):
        draw(task, options.obs, numbers, PICTURES / f"robustness_{task}_{options.obs}.png")


def policy_word(text: str) -> tuple[str, str]:
    """Return label and place of ``LABEL=WHERE``; a place alone is its own label."""
    label, equals, where = text.partition("=")
    if not equals:
        return Path(text).name, text
    if not label or not where or "/" in label:
        raise argparse.ArgumentTypeError(f"must be LABEL=WHERE, got {text!r}")
    return label, where


def main(arguments: Sequence[str] | None = None) -> int:
    """Evaluate what is missing, then report; 130 after an interruption."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="+", help="names of driving tasks")
    parser.add_argument("--policies", nargs="+", type=policy_word, default=[("shipped", "shipped")])
    parser.add_argument("--obs", choices=("camera", "state"), default="camera")
    parser.add_argument("--axes", nargs="*", choices=tuple(AXES), default=tuple(AXES))
    parser.add_argument(
        "--values", type=int, choices=range(2, 10), metavar="N", help="at most, of each axis: 2 or more"
    )
    parser.add_argument("--maps", nargs="*", choices=tuple(MAPS), default=tuple(MAPS))
    parser.add_argument("--episodes", type=int, help="of each point; by default 128, fewer where they are long")
    parser.add_argument("--num-envs", type=int, help="worlds stepped together; by default one per episode")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--report-only", action="store_true")
    options = parser.parse_args(arguments)
    start_warp()
    torch.set_num_threads(1)
    console = Console(stderr=True)
    for task in options.tasks:
        for label, where in () if options.report_only else options.policies:
            if not evaluate_policy(task, label, where, options, console):
                report(task, options, console)
                return 130
        report(task, options, console)
    return 0


if __name__ == "__main__":
    sys.exit(main())
