"""What the environment says of the emulated device."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

SWITCH = "EMULATED_CUDA"
"""Environment variable that is 1 in processes with the emulated device."""


class Check(StrEnum):
    """What is checked of device code.

    Values:
        OFF: nothing, but accesses of other memory than the device's are faults.
        MEMORY: accesses out of bounds, of freed memory, misaligned ones.
        RACE: also words that two threads of a launch touch without order.
        COUNT: nothing; what warps do may be counted (`launch_counts`).
    """

    OFF = "off"
    MEMORY = "memory"
    RACE = "race"
    COUNT = "count"


class StreamOrder(StrEnum):
    """When operations of streams run.

    Values:
        EAGER: at once, in the order of the calls.
        LAZY: as late as CUDA allows, so that what is not synchronised comes too late.
        RANDOM: interleaved by the seed.
    """

    EAGER = "eager"
    LAZY = "lazy"
    RANDOM = "random"


@dataclass(frozen=True)
class Settings:
    """Settings of the emulated device, each from an environment variable `EMULATED_CUDA_<NAME>`.

    Attributes:
        check: what is checked of device code.
        seed: order of blocks and of threads in them, and of streams; 0 is the natural one.
        streams: when operations of streams run.
        cache: folder of translated kernels.
        report: print counts and faults at the exit.
        trace: print Python's stack at each fault.
        optimisation: option of gcc; empty: -O1, or -O0 for long PTX, which compiles ten times faster.
        name: of the device.
    """

    check: Check
    seed: int
    streams: StreamOrder
    cache: Path
    report: bool
    trace: bool
    optimisation: str
    name: str

    @classmethod
    def from_environment(cls) -> Settings:
        """Read the variables.

        Raises:
            ValueError: one has a value that is not among those allowed.
        """

        def read(name: str, default: str) -> str:
            return os.environ.get(f"{SWITCH}_{name}") or default

        return cls(
            check=Check(read("CHECK", "memory")),
            seed=int(read("SEED", "1")),
            streams=StreamOrder(read("STREAMS", "eager")),
            cache=cache_folder(),
            report=read("REPORT", "0") != "0",
            trace=read("TRACE", "0") != "0",
            optimisation=read("OPT", ""),
            name=read("NAME", "NVIDIA H100 80GB HBM3 (emulated)"),
        )


def cache_folder() -> Path:
    """Folder of translated kernels and of the device's own libraries; Warp keeps its PTX where it keeps all kernels."""
    return Path(os.environ.get(f"{SWITCH}_CACHE") or Path.home() / ".cache" / "simwarp-emulated-cuda")


def is_on() -> bool:
    """Whether this process has the emulated device."""
    return os.environ.get(SWITCH) == "1"


def why_unavailable() -> str:
    """Why this machine cannot emulate the device, in one line; empty where it can."""
    if not sys.platform.startswith("linux") or platform.machine() != "x86_64":
        return f"the emulated CUDA device needs x86-64 Linux, not {platform.machine()} {sys.platform}"
    missing = [name for name in ("gcc", "g++") if not shutil.which(name)]
    return f"the emulated CUDA device needs {' and '.join(missing)}: install a C and C++ compiler" if missing else ""
