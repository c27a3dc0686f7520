"""`simwarp bench SCENE --device emulated`: what the kernels of a step would do on a GPU, and a time by model.

Runs on the emulated device: `python -m tests.emulated_cuda -m tests.emulated_cuda.counts.scene_counts SCENE`.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from typing import Annotated, Any, Final

import tyro
from rich.box import SIMPLE_HEAD
from rich.table import Table

from scripts.gpu_static import assemble, assembler, plain_name
from simwarp.bench.machine import describe
from simwarp.bench.measure import SceneRun, TimedRun
from simwarp.bench.subjects import USUAL_SPACING
from simwarp.bench.workloads import ON_SOIL, SENSOR_SCENES, bench_scenes, vehicle_row_names
from simwarp.cli import DONE, UsageError, exit_code_of, explanation, input_errors
from simwarp.cli.benching import EMULATED, LARGEST_COUNT, whole_numbers
from simwarp.cli.options import CommonOptions, parse_options
from tests.emulated_cuda.counts.launch_counts import KernelCount
from tests.emulated_cuda.counts.time_model import H100, UNKNOWN_REGISTERS, WARP, kernel_seconds
from tests.emulated_cuda.device import Device, device
from tests.emulated_cuda.settings import Check

SAMPLE: Final = 64
"""Worlds that stand for all of them: two warps."""
STEPS_BEFORE: Final = 3
RESIDENT: Final = 8
"""Warps that share a multiprocessor's cache."""
NOTES: Final = (
    "emulated: no GPU ran; instructions, sectors and bytes are counted, times are by model (H100, to a factor of two)",
    "slots: instructions of a warp in a step; lanes: share of them that take part; warps: that fit a multiprocessor",
    "sectors: of 32 bytes, of a warp in a step; bytes: beyond the second cache, of a world; *: registers are spilled",
)


@dataclasses.dataclass(frozen=True)
class CountOptions(CommonOptions):
    """Counts of the kernels of one step on an emulated H100, and a time by model.

    Scenes, vehicles and sensors of `simwarp bench` can be counted, tasks cannot.
    """

    worlds: Annotated[str, tyro.conf.arg(metavar="N,N,...")] = "8192"
    """Numbers of worlds that the times are for; 64 of them are counted."""
    device: str = EMULATED
    """emulated."""
    dt: float | None = None
    """Time step [s]; by default the scene's own."""
    spacing: Annotated[float | None, tyro.conf.arg(metavar="m")] = None
    """Of the soil's nodes, of what drives on soil; by default 0.05."""


@dataclasses.dataclass(frozen=True)
class Row:
    """A kernel in a step of a scene.

    Attributes:
        worlds: that the time is for.
        kernel: its name.
        launches: in a step.
        registers: of a thread; None without an assembler, where the time assumes the budget.
        spilled: bytes of a thread that its registers do not hold; None likewise.
        warps_per_multiprocessor: that may run at a time.
        issue_slots: instructions that a warp issues in a step.
        lanes: mean share of a warp's lanes that take part in an instruction.
        sectors: of 32 bytes, that a warp touches in a step.
        sectors_per_request: of global memory.
        bytes: beyond the second cache, per world and step.
        model_us: time of a step's launches by model [us].
    """

    worlds: int
    kernel: str
    launches: int
    registers: int | None
    spilled: int | None
    warps_per_multiprocessor: int
    issue_slots: float
    lanes: float
    sectors: float
    sectors_per_request: float
    bytes: float
    model_us: float


def make_run(name: str, worlds: int, dt: float | None, spacing: float | None) -> TimedRun:
    """The scene in motion on the emulated device.

    Raises:
        UsageError: nothing of this name can be counted.
    """
    where = "cuda:0"
    scene = bench_scenes().get(name)
    if spacing is not None and name not in ON_SOIL:
        raise UsageError(f"--spacing is of what drives on soil ({', '.join(ON_SOIL)}), and '{name}' does not")
    if scene is not None:
        return SceneRun(scene, worlds, where, dt)
    if name in vehicle_row_names():
        from simwarp.bench.vehicle_rows import VehicleRun, VehicleScene

        return VehicleRun(
            VehicleScene(name=name, spacing=USUAL_SPACING if spacing is None else spacing), worlds, where, dt
        )
    sensors = [each for each in SENSOR_SCENES if each != "rays"]  # which are no simulation
    if name in sensors:
        from simwarp.bench.sensor_rows import SensorRun

        return SensorRun(name, worlds, where, dt)
    known = ", ".join([*bench_scenes(), *vehicle_row_names(), *sensors])
    raise UsageError(f"'{name}' cannot be counted on the emulated device; there are: {known}")


def count_step(name: str, worlds: int, dt: float | None, spacing: float | None) -> list[KernelCount]:
    """Counts of one step in the middle of the scene's motion, of a sample of the worlds with its share of the cache."""
    sample = min(worlds, SAMPLE)
    run = make_run(name, sample, dt, spacing)
    run.settle_device = "cpu"
    run.set_motion()
    for _ in range(STEPS_BEFORE):
        run.single_step()
    run.wait()
    counts = device().counts
    counts.start(l1_bytes=H100.l1_bytes // RESIDENT, l2_bytes=H100.l2_bytes * sample // worlds)
    run.single_step()  # fills the second cache
    run.wait()
    counts.clear()
    run.single_step()
    run.wait()
    return counts.stop()


def registers_of(target: Device, kernels: Sequence[KernelCount]) -> dict[str, tuple[int, int]]:
    """Registers and spilled bytes of a thread by kernel; empty without an assembler."""
    ptxas = assembler()
    if ptxas is None:
        return {}
    names = {each.kernel for each in kernels}
    texts = [text for text in target.ptx if any(f".entry {name}(" in text for name in names)]
    found = [each for text in texts for each in assemble(text.encode(), ptxas)[0]]
    return {each.entry: (each.registers, each.spilled) for each in found}


def make_row(count: KernelCount, worlds: int, assembled: dict[str, tuple[int, int]]) -> Row:
    """Row of a kernel for a number of worlds."""
    registers, spilled = assembled.get(count.kernel, (None, None))
    # launches need not have a thread for each world: a camera's have one per pixel
    share = worlds / min(worlds, SAMPLE)
    warps = max(1, round(count.warps / count.launches * share))
    used = UNKNOWN_REGISTERS if registers is None else registers
    seconds = kernel_seconds(H100, count, warps=warps, registers=used)
    requests, sectors = count.loads + count.stores, count.load_sectors + count.store_sectors
    of_warp = count.launches / count.warps
    return Row(
        worlds, plain_name(count.kernel) or count.kernel, count.launches, registers, spilled,
        min(H100.warps, H100.registers // (used * WARP)), count.slots * of_warp,
        count.lane_slots / max(count.slots, 1) / WARP, sectors * of_warp, sectors / max(requests, 1),
        count.bytes_of_memory / min(worlds, SAMPLE), 1e6 * seconds * count.launches,
    )  # fmt: skip


def main(arguments: list[str]) -> int:
    """Count, print the table, write the JSON."""
    name, *rest = arguments
    options = parse_options(CountOptions, rest, f"simwarp bench {name} --device {EMULATED}")
    options.check()
    numbers = whole_numbers("worlds", options.worlds, LARGEST_COUNT)
    target = device()
    if target.settings.check is not Check.COUNT:
        raise UsageError("scene_counts needs EMULATED_CUDA_CHECK=count in the environment")
    console = options.console()
    rows: list[Row] = []
    totals = []
    for worlds in numbers:
        console.print(
            f"counting {worlds} worlds on the emulated device; the first time compiles for minutes", highlight=False
        )
        counts = count_step(name, worlds, options.dt, options.spacing)
        assembled = registers_of(target, counts)
        found = [make_row(each, worlds, assembled) for each in counts]
        rows += found
        step = sum(each.model_us for each in found) * 1e-6
        totals.append({"worlds": worlds, "model_step_us": step * 1e6, "model_steps_per_s": worlds / step})
        console.print(_table(found))
        console.print(
            f"{worlds} worlds: {step * 1e6:.0f} us per step by model, {worlds / step:.3g} world-steps/s",
            highlight=False,
        )
    notes = [*NOTES]
    if assembler() is None:
        notes.append(f"registers are not known ({UNKNOWN_REGISTERS} assumed): pip install nvidia-cuda-nvcc")
    for note in notes:
        console.print(note, highlight=False, soft_wrap=True)
    options.emit(
        {
            "scene": name,
            "kind": "emulated",
            "machine": _machine(target),
            "rows": [dataclasses.asdict(each) for each in rows],
            "totals": totals,
            "notes": notes,
        }
    )
    return DONE


def _machine(target: Device) -> dict[str, Any]:
    import warp as wp

    return {**describe(wp.get_device("cpu")), "device": EMULATED, "gpu": target.settings.name}


def _short(value: float) -> str:
    """Three digits, with a suffix for thousands and millions."""
    for scale, suffix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= scale:
            return f"{value / scale:.3g}{suffix}"
    return f"{value:.3g}"


def _table(rows: Sequence[Row]) -> Table:
    table = Table(box=SIMPLE_HEAD)
    table.add_column("kernel", no_wrap=True)
    for head in ("regs", "warps", "slots", "lanes", "sectors", "/request", "bytes", "us"):
        table.add_column(head, justify="right", no_wrap=True)
    for row in rows:
        registers = "-" if row.registers is None else f"{row.registers}{'*' if row.spilled else ''}"
        name = row.kernel + (f" x{row.launches}" if row.launches > 1 else "")
        table.add_row(
            name, registers, str(row.warps_per_multiprocessor), _short(row.issue_slots), f"{row.lanes:.0%}",
            _short(row.sectors), f"{row.sectors_per_request:.1f}", _short(row.bytes), _short(row.model_us),
        )  # fmt: skip
    return table


if __name__ == "__main__":
    try:
        code = main(sys.argv[1:])
    except input_errors() as error:
        print(f"simwarp: {explanation(error)}", file=sys.stderr)
        code = exit_code_of(error) or 2
    sys.exit(code)
