"""Commands as processes, and what may be done to them: limits, full disks, signals."""

import contextlib
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from tests.campaign.hostile import EITHER
from tests.campaign.oracle import DRAFT, Attack, Outcome, shorten
from tests.campaign.tally import Tally

PATIENCE = 600.0
"""For a process to end, on a busy machine [s]."""


class Ended(NamedTuple):
    """How a process ended."""

    code: int
    out: str
    err: str


def start(folder: Path, *words: str, before: Callable[[], None] | None = None) -> subprocess.Popen[str]:
    """Start a command in a folder, which hears Ctrl-C even where the tests themselves run in the background."""

    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if before is not None:
            before()

    command = [sys.executable, "-m", "simwarp", *words]
    return subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=prepare
    )


def end(process: subprocess.Popen[str]) -> Ended:
    """Wait for a process."""
    try:
        out, err = process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
        err += f"still at work after {PATIENCE:g} s\n"
    # Python may end itself by SIGINT after it has told of an interruption: a shell calls that 130 too
    return Ended(130 if process.returncode == -signal.SIGINT else process.returncode, out, err)


def run(folder: Path, *words: str, before: Callable[[], None] | None = None) -> Ended:
    """Run a command in a folder."""
    return end(start(folder, *words, before=before))


def small_files(largest: int) -> Callable[[], None]:
    """What a process does before it starts so that no file of its grows beyond a size [bytes]."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))


@contextlib.contextmanager
def small_disk(folder: Path, size: str) -> Iterator[bool]:
    """A file system of so many bytes at `folder`; False where this user may not make one."""
    folder.mkdir(exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    made = os.geteuid() == 0 and subprocess.run(command, capture_output=True).returncode == 0
    try:
        yield made
    finally:
        if made:
            subprocess.run(["umount", "--lazy", str(folder)], check=True)


def drafts(*folders: Path) -> list[str]:
    """Files that were begun and left."""
    return [str(path) for folder in folders for path in folder.rglob(f"*{DRAFT}*")]


def judge(ended: Ended, codes: tuple[int, ...], names: tuple[str, ...] = (), most: int = 1) -> str:
    """What is wrong with an end: its code, a traceback, more than one line, or a line that names nothing."""
    lines = ended.err.splitlines()
    if "Traceback" in ended.err:
        return f"traceback: {shorten(ended.err[-300:], 400)}"
    if ended.code not in codes:
        return f"exit code {ended.code}: {shorten(ended.err)}"
    if len(lines) > most or not all(line.startswith("simwarp: ") for line in lines):
        return f"not one line: {shorten(ended.err)}"
    missing = [name for name in names if name not in ended.err]
    return f"does not name {missing[0]}: {shorten(ended.err)}" if missing else ""


def note(tally: Tally, what: str, wrong: str, result: str) -> None:
    """Count one fault."""
    failure, _, detail = wrong.partition(":")
    tally.add(Attack(what, EITHER), Outcome(result, failure, detail))


@contextlib.contextmanager
def timed(tally: Tally) -> Iterator[Tally]:
    """Measure how long the faults of a kind take; then write and check what was counted."""
    begin = time.perf_counter()
    yield tally
    tally.duration_s = round(time.perf_counter() - begin, 1)
    tally.check()
