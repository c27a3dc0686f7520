"""The time model of an H100 beside what an H200 measured, kernel by kernel.

`python benchmarks/gpu_model_check.py [SCENE ...]` reads the counts of the emulated device in `results/gpu_counts`, and
times and counters in `results/gpu_h200`. Both GPUs have 132 multiprocessors; the H200's memory answers 4.8 TB/s in
place of 3.35.
"""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from pathlib import Path
from typing import Any, Final

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

RESULTS: Final = Path(__file__).parent / "results"
WARP: Final = 32
BLOCK: Final = 32
"""Threads of a block that the model assumes."""


@dataclasses.dataclass(frozen=True)
class Pair:
    """What the model says of a kernel's launches in a step, and what a GPU measured.

    Attributes:
        scene, worlds, kernel: of which.
        model_us, measured_us: time [us]; measured between events, the launch included.
        slots, instructions: that a warp issues, counted by emulation and by the GPU.
        model_lanes, lanes: mean share of a warp's lanes that take part.
        model_sectors, sectors: of global memory, that a warp touches.
        model_registers, registers: of a thread.

    What a GPU was not asked for is None.
    """

    scene: str
    worlds: int
    kernel: str
    model_us: float
    measured_us: float
    slots: float
    model_lanes: float
    model_sectors: float
    model_registers: int | None
    instructions: float | None = None
    lanes: float | None = None
    sectors: float | None = None
    registers: int | None = None

    @property
    def ratio(self) -> float:
        """Model over measurement."""
        return self.model_us / self.measured_us


def scenes() -> list[str]:
    """Scenes that were both counted and measured."""
    counted = {path.stem for path in (RESULTS / "gpu_counts").glob("*.json")}
    return sorted(counted & {path.stem.removeprefix("speed_") for path in (RESULTS / "gpu_h200").glob("speed_*.json")})


def pairs(scene: str) -> list[Pair]:
    """Kernels of a scene, for each number of worlds that was both counted and measured.

    Raises:
        ValueError: the two do not have the same kernels.
    """
    counts, speeds = _read("gpu_counts", scene)["rows"], _read("gpu_h200", f"speed_{scene}")["rows"]
    counters = _counters(scene)
    found = []
    for run in speeds:
        rows = [row for row in counts if row["worlds"] == run["worlds"]]
        if run["block"] != BLOCK or not rows:
            continue
        times = run["kernels_us"]
        if {row["kernel"] for row in rows} != set(times):
            raise ValueError(f"{scene}, {run['worlds']} worlds: counted and measured kernels are not the same")
        found += [_pair(scene, row, times[row["kernel"]], counters) for row in rows]
    return found


def error_factor(found: list[Pair]) -> float:
    """By how much the model is off on average, up or down: 1 is perfect."""
    return math.exp(sum(abs(math.log(each.ratio)) for each in found) / len(found))


def main(names: list[str]) -> int:
    """Print a table for each scene and number of worlds."""
    unknown = [name for name in names if name not in scenes()]
    if unknown:
        print(f"'{unknown[0]}' was not both counted and measured; there are: {', '.join(scenes())}", file=sys.stderr)
        return 2
    console = Console()
    for scene in names or scenes():
        found = pairs(scene)
        for worlds in dict.fromkeys(each.worlds for each in found):
            console.print(_table([each for each in found if each.worlds == worlds]))
    return 0


def _read(folder: str, name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((RESULTS / folder / f"{name}.json").read_text(encoding="utf-8"))
    return found


def _counters(scene: str) -> dict[tuple[int, str], dict[str, Any]]:
    if not (RESULTS / "gpu_h200" / f"counters_{scene}.json").exists():
        return {}
    data = _read("gpu_h200", f"counters_{scene}")
    return {(data["worlds"], row["kernel"]): row for row in data["rows"]}


def _pair(scene: str, row: dict[str, Any], measured: float, counters: dict[tuple[int, str], dict[str, Any]]) -> Pair:
    pair = Pair(
        scene, row["worlds"], row["kernel"], row["model_us"], measured,
        row["issue_slots"], row["lanes"], row["sectors"], row["registers"],
    )  # fmt: skip
    counter = counters.get((row["worlds"], row["kernel"]))
    if counter is None:
        return pair
    warps = counter["blocks"] * math.ceil(counter["block"] / WARP)
    return dataclasses.replace(
        pair, instructions=counter["warp_instructions"] / warps, lanes=counter["lanes"],
        sectors=(counter["load_sectors"] + counter["store_sectors"]) / warps, registers=counter["registers"],
    )  # fmt: skip


def _table(found: list[Pair]) -> Table:
    model, measured = sum(each.model_us for each in found), sum(each.measured_us for each in found)
    title = f"{found[0].scene}, {found[0].worlds} worlds: model over measured {model / measured:.2f}"
    table = Table(box=SIMPLE_HEAD, title=f"{title}, a kernel is off by a factor of {error_factor(found):.2f}")
    table.add_column("kernel", no_wrap=True)
    for head in ("model us", "us", "ratio", "slots", "inst.", "lanes", "meas.", "sectors", "meas.", "regs", "meas."):
        table.add_column(head, justify="right", no_wrap=True)
    for each in sorted(found, key=lambda pair: -pair.measured_us):
        table.add_row(
            each.kernel, f"{each.model_us:.0f}", f"{each.measured_us:.0f}", f"{each.ratio:.2f}",
            f"{each.slots:.0f}", _text(each.instructions, ".0f"), f"{each.model_lanes:.0%}", _text(each.lanes, ".0%"),
            f"{each.model_sectors:.0f}", _text(each.sectors, ".0f"), _text(each.model_registers, "d"),
            _text(each.registers, "d"),
        )  # fmt: skip
    table.add_row("all", f"{model:.0f}", f"{measured:.0f}", f"{model / measured:.2f}", *[""] * 8)
    return table


def _text(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
