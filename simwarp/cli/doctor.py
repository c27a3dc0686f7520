"""``simwarp doctor``: what this machine offers, and what is wrong with it."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import tyro
from rich.table import Table

from simwarp.cli import DONE, FELL_SHORT
from simwarp.cli.options import CommonOptions, parse_options

REPORT = "simwarp-gpu.json"
"""File of `doctor --gpu`, in the present folder."""
_MIN_FREE_BYTES = 1 << 30
_GIB = 1 << 30


@dataclasses.dataclass(frozen=True)
class DoctorOptions(CommonOptions):
    """Device, versions, driver, kernel cache; what is wrong and what to do. Exit code 1 where something is wrong."""

    gpu: tyro.conf.FlagCreatePairsOff[bool] = False
    """Also try the GPU: every scene against the CPU, and a training; writes a report to send (minutes)."""
    warm: tyro.conf.FlagCreatePairsOff[bool] = False
    """Also compile what commands need, small models first (minutes, once per machine): later starts take seconds.
    For the device that commands use by default."""
    device: str = "cuda:0"
    """GPU that --gpu tries."""
    worlds: int = 32
    """Of every scene that --gpu tries."""


@dataclasses.dataclass(frozen=True)
class Problem:
    """Something wrong and its remedy."""

    problem: str
    remedy: str


def run(arguments: list[str]) -> int:
    """Examine the machine; 1 where there is a problem."""
    options = parse_options(DoctorOptions, arguments, "simwarp doctor")
    if options.gpu and options.json is None:
        options = dataclasses.replace(options, json=REPORT)
    options.check()
    from simwarp.train.runs.run_folder import versions

    device, problems = examine_devices()
    cache, cache_problems = examine_cache()
    packages = versions()
    problems += cache_problems + examine_versions(packages)
    console = options.console()
    if options.gpu:
        from simwarp.cli.gpu_trial import GpuTrial

        trial = GpuTrial(options.device, options.worlds, console)  # refuses what is no GPU, before anything is tried
    table = Table(show_header=False, box=None)
    for name, value in device.items():
        table.add_row(name.replace("_", " "), _words(value))
    for name, value in cache.items():
        table.add_row(f"cache {name.replace('_', ' ')}", _words(value))
    table.add_row("versions", ", ".join(f"{name} {number or 'missing'}" for name, number in packages.items()))
    console.print(table)
    for item in problems:
        console.print(f"problem: {item.problem}\n  remedy: {item.remedy}", highlight=False, soft_wrap=True)
    report: dict[str, Any] = {"device": device, "versions": packages, "cache": cache}
    if options.warm:
        from simwarp.cli.warming import subjects, warm

        warmed = warm(subjects(), device["device"], console)
        report["warm"] = [each._asdict() for each in warmed]
        problems += [Problem(f"{each.name}: {each.problem}", "send us this line") for each in warmed if each.problem]
    if options.gpu:
        tried, wrong = trial.run()
        report["gpu"] = tried
        problems += [Problem(text, "send us the report") for text in wrong]
        for text in wrong:
            console.print(f"problem: {text}", highlight=False, soft_wrap=True)
    if not problems:
        console.print("nothing is wrong")
    report["problems"] = [dataclasses.asdict(item) for item in problems]
    options.emit(report)
    if options.gpu and options.json != "-":
        words = "it names hardware, versions, folders of the cache, times and differences, and nothing else"
        console.print(f"send us {options.json}: {words}", highlight=False, soft_wrap=True)
    return FELL_SHORT if problems else DONE


def _words(value: Any) -> str:
    """Return a fact as a person reads it."""
    if isinstance(value, list):
        return ", ".join(str(item) for item in value) or "none"
    return "none" if value is None else str(value)


def _nvidia_smi() -> list[str]:
    """Return one ``name, driver version`` line per GPU that the driver reports."""
    if shutil.which("nvidia-smi") is None:
        return []
    command = ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader"]
    try:
        done = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", timeout=20)
    except (OSError, subprocess.TimeoutExpired):
        return []
    return [line.strip() for line in done.stdout.splitlines() if line.strip()] if done.returncode == 0 else []


def examine_devices() -> tuple[dict[str, Any], list[Problem]]:
    """Return the devices, and the disagreements of driver, Warp and torch."""
    import torch
    import warp as wp

    gpus = _nvidia_smi()
    in_warp = [str(found) for found in wp.get_cuda_devices()]
    in_torch = [f"cuda:{index}" for index in range(torch.cuda.device_count())]
    facts: dict[str, Any] = {
        "device": in_torch[0] if in_torch and in_warp else "cpu",
        "cpu_cores": os.cpu_count(),
        "gpus": gpus,
        "warp_devices": ["cpu", *in_warp],
        "torch_devices": ["cpu", *in_torch],
        "torch_cuda": torch.version.cuda,
    }
    problems = []
    if gpus and not in_warp:
        problems.append(
            Problem("there is a GPU that Warp cannot use", "update the NVIDIA driver (Warp needs CUDA 12+)")
        )
    if (gpus or in_warp) and not in_torch:
        why = "is a CPU build" if torch.version.cuda is None else f"(CUDA {torch.version.cuda}) does not see it"
        problems.append(
            Problem(
                f"there is a GPU, but torch {torch.__version__} {why}: models that name no device are on the CPU",
                "install a CUDA build: see pytorch.org",
            )
        )
    return facts, problems


def examine_cache() -> tuple[dict[str, Any], list[Problem]]:
    """Return place and size of Warp's kernel cache, and whether it can be written."""
    import warp as wp

    path = Path(wp.config.kernel_cache_dir or "")
    facts: dict[str, Any] = {"path": str(path)}
    problems = []
    if not (path.is_dir() and os.access(path, os.W_OK)):
        problems.append(
            Problem(f"kernel cache {path} cannot be written", "set WARP_CACHE_PATH to a folder of your own")
        )
    else:
        size = _folder_bytes(path)
        free = shutil.disk_usage(path).free
        facts |= {"size_gib": round(size / _GIB, 3), "free_gib": round(free / _GIB, 1)}
        if free < _MIN_FREE_BYTES:
            problems.append(Problem(f"less than 1 GiB free at {path}", "free some space, or set WARP_CACHE_PATH"))
    return facts, problems


def _folder_bytes(folder: Path) -> int:
    """Return the bytes of all files in a folder; other processes may be at work in it."""
    total = 0
    for file in folder.rglob("*"):
        with contextlib.suppress(OSError):
            total += file.lstat().st_size
    return total


def examine_versions(packages: dict[str, str | None]) -> list[Problem]:
    """Return the violated requirements: dependencies that are missing or outside the supported range."""
    from importlib.metadata import PackageNotFoundError, requires

    from packaging.requirements import Requirement

    try:
        wanted = [Requirement(line) for line in requires("simwarp") or []]
    except PackageNotFoundError:
        return [Problem("simwarp itself is not installed", "pip install -e . in the checkout")]
    problems = []
    for requirement in wanted:
        if requirement.marker is not None or requirement.name not in packages:
            continue
        found = packages[requirement.name]
        if found is None or not requirement.specifier.contains(found, prereleases=True):
            problems.append(
                Problem(
                    f"{requirement.name} {found or 'is missing'}; simwarp needs {requirement.specifier}",
                    f"pip install '{requirement.name}{requirement.specifier}' -c constraints.txt",
                )
            )
    return problems
