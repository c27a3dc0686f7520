"""C and C++ files to shared libraries in the cache; two processes may build the same one at a time."""

from __future__ import annotations

import functools
import hashlib
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
RUNTIME = (
    "device_memory.c", "device_threads.c", "device_threads.h", "device_runtime.h", "warp_counts.c", "warp_counts.h"
)  # fmt: skip
"""Files of the runtime of device code."""


@functools.cache
def target_flags() -> tuple[str, ...]:
    """Options of gcc for this machine: fused products where it has them. A cache may move to another machine."""
    flags = Path("/proc/cpuinfo").read_text(encoding="utf-8").partition("\nflags")[2].partition("\n")[0].split()
    return ("-mfma",) if "fma" in flags else ()


def digest(*parts: bytes | str) -> str:
    """Name for what these parts make."""
    sha = hashlib.sha256()
    for part in parts:
        sha.update(part.encode() if isinstance(part, str) else part)
        sha.update(b"\0")
    return sha.hexdigest()[:24]


def compile_library(command: Sequence[str], path: Path) -> None:
    """Run a compiler that writes a library, which appears under its name when it is complete.

    Raises:
        RuntimeError: the compiler failed.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.stem}.{os.getpid()}.part")
    done = subprocess.run([*command, "-o", str(part)], capture_output=True, text=True, check=False)
    if done.returncode:
        part.unlink(missing_ok=True)
        raise RuntimeError(f"{command[0]} failed for {path.name}: {done.stderr[-2000:]}")
    part.rename(path)


def runtime_library(cache: Path) -> Path:
    """The runtime of device code, built where the cache does not have it."""
    sources = [(HERE / name).read_bytes() for name in RUNTIME]
    path = cache / f"runtime_{digest(*sources, *target_flags())}.so"
    if not path.exists():
        flags = ["-O2", "-w", *target_flags(), "-U_FORTIFY_SOURCE", "-shared", "-fPIC", f"-I{HERE}"]
        files = [str(HERE / name) for name in RUNTIME if name.endswith(".c")]
        compile_library(["gcc", *flags, "-DEMU_CHECK", "-DEMU_RACE", *files, "-lm"], path)
    return path


def torch_library(source: Path, torch_folder: Path, cache: Path, libraries: Sequence[str]) -> Path:
    """A C++ file as an extension of the torch that lies in a folder."""
    version = (torch_folder / "version.py").read_bytes()
    path = cache / f"{source.stem}_{digest(source.read_bytes(), version)}.so"
    if not path.exists():
        flags = ["-O1", "-std=c++20", "-fPIC", "-shared", f"-I{torch_folder}/include", str(source)]
        linked = [f"-L{torch_folder}/lib", *(f"-l{each}" for each in libraries)]
        compile_library(["g++", *flags, *linked], path)
    return path
