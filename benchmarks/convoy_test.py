"""The convoy test of the thesis: one simulated leader on the path, three followers, whose policy was trained on ghosts.

    python benchmarks/convoy_test.py                                # 200 runs of each model on each ground, then tables
    python benchmarks/convoy_test.py --models reduced --grounds rigid soft --runs 50
    python benchmarks/convoy_test.py --runs 0                       # table and picture again, from the rows
    python benchmarks/convoy_test.py --obs camera --drive-on --scattered 0 100 --models reduced --runs 16

Four vehicles in each world, four large obstacles on the way, rigid, hard and soft ground. Rows are written to
benchmarks/results/convoy as runs finish, and what is there is not run again. Run k has the same path, obstacles and
places on every ground and with both models.

A follower that touches something or loses the one ahead is done: it brakes, and the others go on. With --drive-on
touches end nothing; those of obstacles and those of vehicles ahead are counted. --scattered puts so many obstacles
of various sizes anywhere on the map besides, and --obs camera lets followers see by a camera each.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from simwarp import to_torch  # noqa: E402
from simwarp.statistics.proportions import wilson_interval  # noqa: E402
from simwarp.tasks import make  # noqa: E402
from simwarp.tasks.framework.agent_rows import Rows  # noqa: E402
from simwarp.train.evaluation.figure_style import new_figure, save_figure  # noqa: E402
from simwarp.train.networks.policies import find_policy, network_policy  # noqa: E402

RESULTS: Final = ROOT / "benchmarks" / "results" / "convoy"
PICTURES: Final = ROOT / "docs" / "images"
MODELS: Final = ("reduced", "full")
GROUNDS: Final = {"rigid": "none", "hard": "hard", "soft": "soft"}
COLOURS: Final = {"rigid": "tab:blue", "hard": "tab:brown", "soft": "tab:orange"}
FOLLOWERS: Final = 3
PATHS: Final = 200
SEED: Final = 1_000_003
BATCH: Final = 50
TOUCHES: Final = ("collision", "bumped")
COLUMNS: Final = ("run", "vehicle", "reason", "seconds", "deviation", "by_way", "distance", "way")
"""Of a row: run, vehicle from the head, why and when its part was over, mean distance from the path over time [m] and
over the way [m], distance to the one ahead at the end [m], place along the path at the end [m]."""
COUNTED: Final = ("largest", "hits", "bumps")
"""Beside these where followers drive on: largest distance from the path [m], touches of obstacles, and of vehicles
ahead."""

Row = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class Kind:
    """What kind of test it is.

    Attributes:
        obs: of the followers, state or camera.
        drive_on: a touch ends nothing, and touches are counted.
        scattered: obstacles on the map besides.
    """

    obs: str = "state"
    drive_on: bool = False
    scattered: int = 0

    @property
    def words(self) -> tuple[str, ...]:
        """Parts of the names of its files; the thesis's test of four obstacles by state has none."""
        parts = {
            self.obs: self.obs != "state",
            "on": self.drive_on,
            f"scattered-{self.scattered}": self.scattered > 0,
        }
        return tuple(word for word, there in parts.items() if there)


USUAL: Final = Kind()


class Runs:
    """A batch of runs.

    Args:
        model: reduced or full.
        ground: name of one of `GROUNDS`.
        first: number of the first run.
        count: of them.
        kind: of the test.
        options: further fields of the task's configuration.
    """

    def __init__(
        self, model: str, ground: str, first: int, count: int, kind: Kind = USUAL, **options: Any
    ) -> None:  # fmt: skip
        self.first, self.count, self.kind = first, count, kind
        self.task: Any = make(
            "convoy", count, seed=SEED, first_world=first, obs=kind.obs, leaders="simulated", leading=1,
            followers=FOLLOWERS, generated=True, generated_paths=PATHS, latest_start=0.0, full=model == "full",
            soil=GROUNDS[ground], drive_on=kind.drive_on, scattered=kind.scattered, **options,
        )  # fmt: skip
        self.task.keep_final_observations = False
        self.task.before_reset = self._look
        self._rows = Rows(self.task)
        self.way = torch.zeros(0)
        self._gone = self._weighted = self.largest = torch.zeros(())
        shipped = find_policy("convoy", Path("shipped"), obs=kind.obs)
        self.policy = network_policy(shipped.content, self.task)

    def _look(self) -> None:
        """Store where all vehicles are, before a world that is over begins anew."""
        task = self.task
        place = to_torch(task.vehicles.position)[..., :2].float()
        vehicles = place.shape[1]
        route = task.route.repeat_interleave(vehicles)
        way, aside = (each.view(-1, vehicles) for each in task.routes.locate(route, place.flatten(0, 1)))
        gone = (way - self.way).clamp(min=0.0) if len(self.way) else torch.zeros_like(way)
        self._gone = self._gone + gone
        self._weighted = self._weighted + gone * aside.abs()
        self.way = way
        self.largest = torch.maximum(self.largest, aside.abs())
        self.by_way = self._weighted / self._gone.clamp(min=0.01)
        self.deviation = task.deviation.clone()

    def play(self) -> list[Row]:
        """Return the rows of all runs."""
        task = self.task
        observations = self._rows.restart(SEED)
        rows: list[Row] = []
        while int(task.episode_index.min()) == 0:
            running = task.episode_index == 0
            steps = task.episode_steps + 1
            result = task.step(self.policy(observations).view(task.action.shape))
            observations = self._rows.flat(result.observations)
            ended = (result.end_reason >= 0) & running.unsqueeze(1)
            for world, agent in ended.nonzero().tolist():
                reason = task.end_reasons[int(result.end_reason[world, agent])]
                found = {name: float(value[world, agent]) for name, value in result.metrics.items()}
                rows.append(self._row(world, agent + 1, reason, int(steps[world]), found))
            for world in (running & (task.episode_index > 0)).nonzero().flatten().tolist():
                rows.append(self._row(world, 0, "driver", int(steps[world]), {}))
        return sorted(rows, key=lambda row: (row["run"], row["vehicle"]))

    def _row(self, world: int, vehicle: int, reason: str, steps: int, metrics: Mapping[str, float]) -> Row:
        values = (
            self.first + world, vehicle, reason, round(steps * self.task.config.control_dt, 3),
            round(float(self.deviation[world, vehicle]), 4), round(float(self.by_way[world, vehicle]), 4),
            round(metrics.get("distance", math.nan), 3),
            round(float(self.way[world, vehicle]), 2),
        )  # fmt: skip
        row = dict(zip(COLUMNS, values, strict=True))
        if self.kind.drive_on:
            counts = [metrics.get(name, math.nan) for name in ("obstacle_hits", "bumps")]
            row |= dict(zip(COUNTED, [round(float(self.largest[world, vehicle]), 4), *counts], strict=True))
        return row


def path_of(model: str, ground: str, kind: Kind = USUAL) -> Path:
    """Return the file of a case's rows."""
    return RESULTS / f"{'.'.join((model, ground, *kind.words))}.csv"


def read_rows(path: Path) -> list[Row]:
    """Return the rows of a file; none where there is no such file."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8") as file:
        return [
            {name: value if name == "reason" else float(value) for name, value in row.items()}
            for row in csv.DictReader(file)
        ]


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """Add rows to a file."""
    new = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerows(rows)


def left(
    models: Sequence[str], grounds: Sequence[str], runs: int, batch: int, kind: Kind = USUAL
) -> Iterator[tuple[str, str, int, int]]:
    """Yield model, ground, first run and number of the batches that are not there yet, ground by ground in turn."""
    for first in range(0, runs, batch):
        for model in models:
            for ground in grounds:
                there = {int(row["run"]) for row in read_rows(path_of(model, ground, kind))}
                count = min(batch, runs - first)
                if not there.issuperset(range(first, first + count)):
                    yield model, ground, first, count


def mean_interval(values: Sequence[float]) -> dict[str, float]:
    """Return mean and 95 % interval (normal) of a sample."""
    sample = np.array(values)
    half = 1.96 * float(sample.std(ddof=1)) / math.sqrt(len(sample)) if len(sample) > 1 else math.nan
    return {"mean": float(sample.mean()), "low": float(sample.mean()) - half, "high": float(sample.mean()) + half}


def share(rows: Sequence[Row], reasons: Sequence[str]) -> dict[str, Any]:
    """Return how many rows ended for one of some reasons: count, share and its 95 % interval."""
    return rate(sum(row["reason"] in reasons for row in rows), len(rows))


def rate(count: int, of: int) -> dict[str, Any]:
    """Return a count, its share and the 95 % interval of that."""
    low, high = wilson_interval(count, of)
    return {"count": count, "share": count / of, "low": low, "high": high}


def vehicle_numbers(rows: Sequence[Row], vehicle: int) -> dict[str, Any]:
    """Return the numbers of a vehicle.

    ``first`` counts those that failed while everyone ahead still drove.
    """
    own = [row for row in rows if row["vehicle"] == vehicle]
    failed = {(row["run"], row["vehicle"]): row["seconds"] for row in rows if row["reason"] not in ("goal", "driver")}
    first = [
        row for row in own
        if (row["run"], vehicle) in failed
        and all(failed.get((row["run"], ahead), math.inf) >= row["seconds"] for ahead in range(vehicle))
    ]  # fmt: skip
    found: dict[str, Any] = {
        "runs": len(own),
        "deviation": mean_interval([row["deviation"] for row in own]),
        "by_way": mean_interval([row["by_way"] for row in own]),
        "way": mean_interval([row["way"] for row in own]),
        "reasons": {reason: share(own, [reason])["count"] for reason in sorted({row["reason"] for row in own})},
    }
    if vehicle > 0:
        found["distance"] = mean_interval([row["distance"] for row in own])
        found |= {"touches": share(own, TOUCHES), "lost": share(own, ["lost"]), "first": len(first)}
    if own and "largest" in own[0]:
        found["largest"] = mean_interval([row["largest"] for row in own])
        found["most"] = max(row["largest"] for row in own)
        if vehicle > 0:
            found["touches"] = rate(sum(row["hits"] + row["bumps"] > 0 for row in own), len(own))
            found |= {name: mean_interval([row[name] for row in own]) for name in ("hits", "bumps")}
    return found


def numbers_of(models: Sequence[str], grounds: Sequence[str], kind: Kind = USUAL) -> dict[str, Any]:
    """Return the numbers of all cases of which there are rows: model -> ground -> numbers by vehicle."""
    found: dict[str, Any] = {}
    for model in models:
        for ground in grounds:
            rows = read_rows(path_of(model, ground, kind))
            if rows:
                numbers = [vehicle_numbers(rows, vehicle) for vehicle in range(FOLLOWERS + 1)]
                found.setdefault(model, {})[ground] = numbers
    return found


def paired(model: str, quantity: str, kind: Kind = USUAL) -> list[Row]:
    """Return the differences of each ground from rigid ground, run by run: mean and 95 % interval of each vehicle.

    Args:
        model: reduced or full.
        quantity: name of a column.
        kind: of the test.
    """
    found = []
    rows = {
        ground: {(row["run"], row["vehicle"]): row for row in read_rows(path_of(model, ground, kind))}
        for ground in GROUNDS
    }
    for ground in ("hard", "soft"):
        for vehicle in range(FOLLOWERS + 1):
            both = [key for key in rows[ground].keys() & rows["rigid"].keys() if key[1] == vehicle]
            change = [rows[ground][key][quantity] - rows["rigid"][key][quantity] for key in sorted(both)]
            if both and not any(map(math.isnan, change)):
                about = {"model": model, "ground": ground, "vehicle": vehicle, "runs": len(both)}
                found.append({**about, **mean_interval(change)})
    return found


def percent(value: Mapping[str, float]) -> str:
    """Return a share with its interval."""
    return f"{100 * value['share']:.1f} % ({100 * value['low']:.1f} to {100 * value['high']:.1f})"


def mean(value: Mapping[str, float]) -> str:
    """Return a mean with its interval."""
    return f"{value['mean']:.2f} ({value['low']:.2f} to {value['high']:.2f})"


def cells_of(each: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the table has of a vehicle, by heading."""
    cells = {"runs": each["runs"]}
    for name in ("touches", "lost"):
        cells[name] = percent(each[name]) if name in each else "–"
    if "largest" in each:
        for name in ("hits", "bumps"):
            cells[name] = mean(each[name]) if name in each else "–"
        cells |= {"largest [m]": mean(each["largest"]), "the largest of all": f"{each['most']:.1f}"}
    cells |= {"off the path [m]": mean(each["deviation"]), "by way": mean(each["by_way"])}
    cells |= {"reached [m]": f"{each['way']['mean']:.0f}"}
    return cells if "largest" in each else cells | {"failed first": each.get("first", "–")}


def table(numbers: dict[str, Any]) -> str:
    """Return the numbers as a table in Markdown."""
    rows = [
        {"model": model, "ground": ground, "vehicle": vehicle, **cells_of(each)}
        for model, grounds in numbers.items() for ground, vehicles in grounds.items()
        for vehicle, each in enumerate(vehicles)
    ]  # fmt: skip
    lines = [f"| {' | '.join(rows[0])} |", "|" + "---|" * len(rows[0])]
    return "\n".join([*lines, *(f"| {' | '.join(map(str, row.values()))} |" for row in rows)])


DRAWN: Final = {
    "deviation": "off the path [m]", "largest": "largest distance [m]", "hits": "obstacles touched, per run",
    "touches": "runs with a touch", "lost": "runs that lost it",
}  # fmt: skip
"""Quantities of the picture; those of followers that drive on are left away where they do not."""


def draw(numbers: dict[str, Any], picture: Path) -> None:
    """Draw deviation, touches and losses of the vehicles, by ground and model."""
    last = next(iter(next(iter(numbers.values())).values()))[-1]
    quantities = [quantity for quantity in DRAWN if quantity in last]
    figure = new_figure(3.3 * len(quantities), 2.6 * len(numbers))
    grid = figure.subplots(len(numbers), len(quantities), squeeze=False, sharey="col")
    for line, (model, grounds) in zip(grid, numbers.items(), strict=True):
        for place, (ground, vehicles) in enumerate(grounds.items()):
            for axes, quantity in zip(line, quantities, strict=True):
                shown = [(index, each[quantity]) for index, each in enumerate(vehicles) if quantity in each]
                at = np.array([index for index, _ in shown]) + 0.26 * (place - 1)
                middle = np.array([each.get("mean", each.get("share")) for _, each in shown])
                off = [middle - [each["low"] for _, each in shown], [each["high"] for _, each in shown] - middle]
                axes.bar(at, middle, 0.24, yerr=np.maximum(off, 0.0), capsize=2.0, color=COLOURS[ground], label=ground)
                axes.set_xticks(range(FOLLOWERS + 1), ["leader", *map(str, range(1, FOLLOWERS + 1))])
                axes.set_ylabel(DRAWN[quantity])
                axes.grid(alpha=0.3)
        line[0].set_ylabel(f"{model}: {DRAWN['deviation']}")
        line[0].legend(fontsize="small")
    save_figure(figure, picture)


def report(kind: Kind) -> None:
    """Write numbers, table and picture of a kind of test, from the rows that are there."""
    numbers = numbers_of(MODELS, tuple(GROUNDS), kind)
    if not numbers:
        return
    name = "_".join(("convoy_test", *kind.words))
    (RESULTS / f"{name}.json").write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    print(f"{' '.join(kind.words)}\n{table(numbers)}" if kind.words else table(numbers))
    for model in numbers:
        for quantity in ("deviation", "by_way", *(("largest", "hits") if kind.drive_on else ())):
            for each in paired(model, quantity, kind):
                what = f"{model} {quantity} of vehicle {each['vehicle']}, {each['ground']} less rigid"
                interval = f"{each['mean']:+.3f} ({each['low']:+.3f} to {each['high']:+.3f})"
                print(f"{what}: {interval}{'' if quantity == 'hits' else ' m'}, {each['runs']} runs")
    draw(numbers, PICTURES / f"{name}.png")


def main() -> None:
    """Run what is missing, then write tables and the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", nargs="+", choices=MODELS, default=MODELS)
    parser.add_argument("--grounds", nargs="+", choices=tuple(GROUNDS), default=tuple(GROUNDS))
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--batch", type=int, default=BATCH, help="runs side by side")
    parser.add_argument("--obs", choices=("state", "camera"), default="state", help="of the followers")
    parser.add_argument("--drive-on", action="store_true", help="touches end nothing; they are counted")
    parser.add_argument("--scattered", nargs="+", type=int, default=[0], help="obstacles on the map besides")
    options = parser.parse_args()
    RESULTS.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    kinds = [Kind(options.obs, options.drive_on, scattered) for scattered in options.scattered]
    for kind in kinds:
        missing = left(options.models, options.grounds, options.runs, options.batch, kind)
        for model, ground, first, count in missing:
            write_rows(path_of(model, ground, kind), Runs(model, ground, first, count, kind).play())
            print(f"{' '.join((model, ground, *kind.words))}: runs {first} to {first + count - 1}", file=sys.stderr)
    for kind in kinds:
        report(kind)


if __name__ == "__main__":
    main()
