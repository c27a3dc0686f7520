"""``simwarp drive --speeds`` and ``--steerings``: one manoeuvre in many worlds, each with a speed or amplitude."""

from __future__ import annotations

import dataclasses
import math
import re
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from simwarp.cli import DONE, FELL_SHORT, INTERRUPTED, UsageError
from simwarp.cli.drive.drive_progress import ManeuverBar
from simwarp.core.object_repr import plural
from simwarp.vehicle.assessment.course_plot import draw_course
from simwarp.vehicle.assessment.maneuver_variants import Outcome, highest_passed, outcomes, set_up_variants
from simwarp.vehicle.assessment.verdict import Verdict
from simwarp.vehicle.assessment.verdicts import verdict_rows
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.results.runs import Drive, SetUpOptions
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec

MOST_VARIANTS: Final = 1000
SHOWN_RESULTS: Final = 4
"""Results in the columns of a table; the others are in --json."""
ALONE: Final = (
    "soil", "soil_normal", "spacing", "channels", "csv", "output", "report", "chains", "video", "export_scene",
    "record", "sensors", "road",
)  # fmt: skip
"""Options of one run, which a batch of many does not have."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Batch:
    """What a batch of variants is asked for.

    Attributes:
        vehicle: on wheels.
        name: of the manoeuvre.
        key: option that differs, "speed" or "steering".
        values: of that option.
        chosen: the other options of the manoeuvre.
        dt: time step [s].
        friction: of the road.
        device: of the run.
        plot: file of a picture, or None.
    """

    vehicle: VehicleSpec
    name: str
    key: str
    values: Sequence[float]
    chosen: dict[str, float]
    dt: float
    friction: float
    device: str
    plot: Path | None


def parse_values(name: str, text: str) -> list[float]:
    """Numbers of "10:25:1" (first:last:step, both ends included) or "10,12.5,15".

    Args:
        name: of the option, for the message.
        text: as given.

    Raises:
        UsageError: it is neither, or there are too many.
    """
    number = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
    rule = "first:last:step, such as 10:25:1, or numbers with commas"
    if re.fullmatch(f"{number}:{number}:{number}", text):
        first, last, step = (float(part) for part in text.split(":"))
        if not step > 0.0 or last < first:
            raise UsageError(f"--{name}: must rise from first to last by a step above 0, got '{text}'")
        count = math.floor((last - first) / step + 1e-6) + 1
        if count > MOST_VARIANTS:
            raise UsageError(f"--{name}: must be at most {MOST_VARIANTS} values, got {count}; take a larger step")
        return [round(first + step * k, 9) for k in range(count)]
    if re.fullmatch(f"{number}(?:,{number})*", text):
        values = [float(part) for part in text.split(",")]
        if len(values) > MOST_VARIANTS:
            raise UsageError(f"--{name}: must be at most {MOST_VARIANTS} values, got {len(values)}")
        return values
    raise UsageError(f"--{name}: must be {rule}, got '{text}'")


def batch_variants(batch: Batch) -> list[Maneuver]:
    """The manoeuvre at each value.

    Raises:
        UsageError: the plot cannot be drawn of this manoeuvre.
        SpecError: there is no such manoeuvre or option, or a value cannot be used.
    """
    variants = [maneuver(batch.name, batch.vehicle, **batch.chosen, **{batch.key: value}) for value in batch.values]
    if batch.plot is not None and variants[0].course is None:
        raise UsageError(f"--plot: {batch.name} has no lanes to draw for many {batch.key}s; drive one")
    return variants


def run_batch(batch: Batch, variants: Sequence[Maneuver], console: Console) -> tuple[int, dict[str, Any]]:
    """Drives all variants, prints their table and returns the exit code with what --json writes.

    An interruption leaves what was recorded.

    Raises:
        SpecError: the variants cannot be driven together.
    """
    begin = time.perf_counter()
    options: SetUpOptions = {"device": batch.device, "dt": batch.dt, "friction": batch.friction}
    drive = Drive(set_up_variants(batch.vehicle, variants, **options), worlds=slice(0, len(variants)))
    interrupted = False
    title = f"{batch.vehicle.name}, {batch.name}, {plural(len(variants), 'world')}"
    with ManeuverBar(console, title, drive.setup.maneuver) as bar:
        try:
            drive.run(bar.advance)
        except KeyboardInterrupt:
            if not drive.recorder.rows:
                raise
            interrupted = True
    found = outcomes(drive, variants)
    wall = time.perf_counter() - begin
    console.print(title, style="bold", highlight=False, soft_wrap=True)
    console.print(_table(batch, found))
    best = highest_passed(found)
    judged = any(each.passed is not None for each in found)
    if judged and batch.key == "speed":
        told = "none of these speeds is passed" if math.isnan(best) else f"highest speed passed: {best:g} m/s"
        console.print(told, highlight=False, soft_wrap=True)
    if interrupted:
        console.print("interrupted: the last rows are missing", highlight=False, soft_wrap=True)
    console.print(f"{plural(len(found), 'world')}, {wall:.1f} s", highlight=False, soft_wrap=True)
    if batch.plot is not None:
        draw_course(found, batch.plot, title)
        console.print(f"wrote {batch.plot}", highlight=False, markup=False, soft_wrap=True)
    content = _content(batch, found, best, wall) | {"interrupted": interrupted}
    if interrupted:
        return INTERRUPTED, content
    return FELL_SHORT if all(each.broken for each in found) else DONE, content


def _table(batch: Batch, found: Sequence[Outcome]) -> Table:
    """A row for each variant."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column(batch.key, justify="right")
    head = next((each.results for each in found if each.results), ())
    shown = [item.key for item in head[:SHOWN_RESULTS]]
    for item in head[:SHOWN_RESULTS]:
        table.add_column(f"{item.label} [{item.unit}]" if item.unit else item.label, justify="right")
    table.add_column("verdict")
    for value, each in zip(batch.values, found, strict=True):
        texts = {item.key: item.value_text for item in each.results}
        table.add_row(f"{value:g}", *(texts.get(key, "") for key in shown), _verdict_text(each))
    return table


def _verdict_text(outcome: Outcome) -> str:
    if outcome.broken:
        return "broke down"
    if outcome.passed is None:
        return ""
    failed = [verdict for verdict in outcome.verdicts if not verdict.passed]
    told = "pass" if not failed else "FAIL: " + "; ".join(verdict_line(verdict) for verdict in failed[:2])
    return told if outcome.held else f"speed not held; {told}"


def verdict_line(verdict: Verdict) -> str:
    """A verdict in short: place, value and unit, or the rule where there is no place."""
    what = verdict.where or verdict.rule
    if math.isnan(verdict.value):
        return what if verdict.where else f"{what}: not reached"
    return f"{what}: {verdict.value_text} {verdict.unit}".rstrip()


def verdict_table(found: Iterable[Verdict]) -> Table:
    """Rules with limits, values and pass or fail."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for name in ("rule", "limit", "value", "unit", "where", "verdict"):
        table.add_column(name, justify="right" if name in ("limit", "value") else "left")
    for verdict in found:
        table.add_row(
            verdict.rule, f"{verdict.limit:.3g}", verdict.value_text, verdict.unit, verdict.where,
            "pass" if verdict.passed else "FAIL",
        )  # fmt: skip
    return table


def _content(batch: Batch, found: Sequence[Outcome], best: float, wall: float) -> dict[str, Any]:
    """For scripts."""
    rows = [
        {
            batch.key: float(value),
            "passed": each.passed,
            "held": each.held,
            "broken": each.broken,
            "results": {item.key: item.value for item in each.results},
            "verdicts": verdict_rows(each.verdicts),
        }
        for value, each in zip(batch.values, found, strict=True)
    ]
    return {
        "vehicle": batch.vehicle.name,
        "maneuver": batch.name,
        "options": batch.chosen,
        "friction": batch.friction,
        "dt": batch.dt,
        "worlds": len(found),
        "rows": rows,
        "highest_passed": float(best) if np.isfinite(best) and batch.key == "speed" else None,
        "plot": None if batch.plot is None else str(batch.plot),
        "wall_s": wall,
    }
