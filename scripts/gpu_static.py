"""What every kernel costs on a GPU, measured without one: time to compile, registers, spills and size of its code.

    .venv/bin/python -m scripts.gpu_static                   # all, as a table
    .venv/bin/python -m scripts.gpu_static --only collect --json kernels.json

NVRTC comes with Warp. The assembler, ptxas, is that of the package nvidia-cuda-nvcc (`pip install nvidia-cuda-nvcc`).
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import importlib.metadata
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import warp as wp

ARCH = 90
"""Hopper: what the package is tuned for."""
SETS = {
    "step": "simwarp.kernels.dynamics.step_stages",
    "collision": "simwarp.kernels.collision.collision_stages",
    "state": "simwarp.kernels.dynamics.world",
    "tires": "simwarp.vehicle.tires.tires_kernels",
    "camera": "simwarp.sensors.cameras.image_kernels",
    "soil": "simwarp.soil.pressing_kernels",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Cost:
    """Costs of one kernel.

    Attributes:
        kernel: its name.
        compile_cpu_s: CPU time of NVRTC for the whole module that it is in [s].
        registers: of a thread.
        spilled: bytes of a thread that its registers do not hold.
        code: bytes of machine code of the module.
    """

    kernel: str
    compile_cpu_s: float
    registers: int
    spilled: int
    code: int


def assembler() -> Path | None:
    """The assembler ptxas of the package nvidia-cuda-nvcc; None without it."""
    try:
        files = importlib.metadata.files("nvidia-cuda-nvcc") or []
    except importlib.metadata.PackageNotFoundError:
        return None
    return next((Path(str(file.locate())) for file in files if file.name == "ptxas"), None)


def step_kernels() -> list[wp.Kernel]:
    """All kernels of a step and of its collision, each in a module of its own."""
    names = ("step", "collision")
    return [kernel for name in names for kernel in importlib.import_module(SETS[name]).kernels_for_cuda_check()]


def modules(only: str) -> Iterator[tuple[str, Any]]:
    """Yield name and Warp module of every kernel set, and of every part of the step."""
    for name, path in SETS.items():
        module = importlib.import_module(path)
        hook = getattr(module, "kernels_for_cuda_check", None)
        if hook is not None:
            for kernel in hook():
                key = kernel.key.rpartition("__")[2]
                if only in f"{name} {key}":
                    yield key, kernel.module
        elif only in name:
            yield name, wp.get_module(module.__name__)


def costs_of(module: Any, ptxas: Path) -> list[Cost]:
    """Compile one Warp module; a row for each of its kernels."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.process_time()
        wp.compile_aot_module(module, device=None, arch=ARCH, module_dir=folder, use_ptx=True)
        spent = time.process_time() - begin
        assembled, size = assemble(next(Path(folder).glob("*.ptx")).read_bytes(), ptxas)
    return [Cost(plain_name(each.entry), spent, each.registers, each.spilled, size) for each in assembled]


@dataclasses.dataclass(frozen=True)
class Assembled:
    """A kernel as ptxas describes it: its name in PTX, registers of a thread, bytes of them that are spilled."""

    entry: str
    registers: int
    spilled: int


def assemble(ptx: bytes, ptxas: Path) -> tuple[list[Assembled], int]:
    """Assemble PTX, which Warp ends as C does; its kernels, and the bytes of machine code."""
    with tempfile.TemporaryDirectory() as folder:
        source, cubin = Path(folder) / "kernel.ptx", Path(folder) / "kernel.cubin"
        source.write_bytes(ptx.rstrip(b"\0"))
        command = [str(ptxas), "-v", f"-arch=sm_{ARCH}", "-o", str(cubin), str(source)]
        report = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", check=True).stderr
        size = cubin.stat().st_size
    found = []
    for part in report.split("Compiling entry function '")[1:]:
        spilled = sum(int(count) for count in re.findall(r"(\d+) bytes spill", part))
        registers = re.search(r"Used (\d+) registers", part)
        assert registers is not None, part
        found.append(Assembled(part.split("'")[0], int(registers[1]), spilled))
    return found, size


def plain_name(entry: str) -> str:
    """Name of a kernel from its name in PTX."""
    return re.sub(r"_[0-9a-f]{8}_cuda_kernel_forward.*", "", entry, flags=re.DOTALL).rpartition("__")[2]


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="sets or kernels with this in their name")
    parser.add_argument("--json", type=Path, help="file for the rows")
    options = parser.parse_args()
    ptxas = assembler()
    if ptxas is None:
        print("ptxas is not installed; pip install nvidia-cuda-nvcc", file=sys.stderr)
        return 2
    rows: list[Cost] = []
    print(f"{'kernel':32}{'NVRTC [CPU-s]':>14}{'registers':>11}{'spilled [B]':>13}{'code [kB]':>11}")
    for _, module in modules(options.only):
        for row in costs_of(module, ptxas):
            rows.append(row)
            print(f"{row.kernel:32}{row.compile_cpu_s:14.1f}{row.registers:11}{row.spilled:13}{row.code / 1e3:11.0f}",
                  flush=True)  # fmt: skip
    if options.json is not None:
        options.json.write_text(
            json.dumps([dataclasses.asdict(row) for row in rows], indent=1) + "\n", encoding="utf-8"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
