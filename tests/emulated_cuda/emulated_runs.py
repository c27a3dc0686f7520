"""Runs of programs on the emulated device, for tests."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

from tests.emulated_cuda.settings import SWITCH, Check, StreamOrder, is_on, why_unavailable

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
REPORTED = "emulated CUDA: "
WRONG = ("fault", "hazard", "races")
"""Beginnings of lines in which a process reports at its exit what was wrong."""


def skip_where_unavailable() -> None:
    """Skip a test where the device cannot be emulated, or is: a program in a program would run on it twice."""
    reason = why_unavailable() or ("runs on the emulated device already" if is_on() else "")
    if reason:
        pytest.skip(reason)


def once_per_run(factory: pytest.TempPathFactory, name: str, run: Callable[[], str]) -> Any:
    """What a program printed last, as JSON: it runs once, also where several workers need it."""
    skip_where_unavailable()
    folder = factory.getbasetemp()
    path = (folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder) / f"{name}.json"
    with FileLock(f"{path}.lock"):
        if not path.exists():
            path.write_text(run().splitlines()[-1], encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


def run_emulated(
    *arguments: str,
    check: Check = Check.MEMORY,
    streams: StreamOrder = StreamOrder.EAGER,
    seed: int = 1,
    folder: Path = ROOT,
    timeout: float = 1200.0,
    cleanly: bool = False,
) -> str:
    """Run Python with these arguments on the emulated device; what it prints.

    Args:
        arguments: of Python.
        check, streams, seed: of the device.
        folder: in which it runs.
        timeout: [s].
        cleanly: for a program that does not look for faults itself: the device must have been used, without a fault, a
            hazard of captures, or a race.

    Raises:
        AssertionError: it failed.
    """
    environment = {
        **os.environ, f"{SWITCH}_CHECK": check, f"{SWITCH}_STREAMS": streams, f"{SWITCH}_SEED": str(seed),
        f"{SWITCH}_REPORT": str(int(cleanly)),
    }  # fmt: skip
    command = [sys.executable, str(HERE), *arguments]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=timeout, check=False
    )
    assert done.returncode == 0, f"{' '.join(arguments)}: {done.stderr[-3000:]}"
    if cleanly:
        report = [line for line in done.stderr.splitlines() if line.startswith(REPORTED)]
        assert any(" kernels, " in line for line in report), "the device was not used"
        assert not any(line[len(REPORTED) :].startswith(WRONG) for line in report), "\n".join(report)
    return done.stdout
