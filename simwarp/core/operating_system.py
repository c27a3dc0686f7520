"""What differs between Linux, macOS and Windows: memory, processes, signals, files.

Modules of POSIX alone (`fcntl`, `resource` and others) are imported nowhere else (`tests/project/test_portability.py`).
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any, Final

WINDOWS: bool = sys.platform == "win32"

STOP: Final[int] = getattr(signal, "CTRL_BREAK_EVENT", signal.SIGTERM)
"""Signal that requests another process to stop. SIGTERM of Windows ends it as it is; there, Ctrl-Break is heard."""

KILL: Final[int] = getattr(signal, "SIGKILL", signal.SIGTERM)
"""Signal that ends another process as it is."""

STOPPED_UNHEARD: Final = frozenset({-signal.SIGTERM, 0xC000013A})
"""Exit codes of a process that was requested to stop before it listened; the second one is of Windows."""

RESERVED: Final = frozenset(
    ("CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$", *(f"{port}{n}" for port in ("COM", "LPT") for n in range(1, 10)))
)
"""Names that are devices of Windows in every folder and with every ending."""

PATIENCE: Final = 2.0
"""Time that the replacement of a file waits for others to close it, on Windows [s]."""


def own_session() -> dict[str, Any]:
    """Return arguments of `subprocess.Popen` for a process that Ctrl-C in this terminal does not reach."""
    return {"creationflags": 0x200} if WINDOWS else {"start_new_session": True}  # CREATE_NEW_PROCESS_GROUP


def process_started(pid: int) -> str | None:
    """Return when a process was started, by psutil; empty where that cannot be known, None if there is none."""
    try:
        import psutil
    except ImportError:
        return ""
    try:
        return str(psutil.Process(pid).create_time())
    except psutil.NoSuchProcess:
        return None
    except psutil.Error:
        return ""


def total_memory() -> int:
    """Return the bytes of the machine's memory."""
    if hasattr(os, "sysconf"):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    import psutil

    return int(psutil.virtual_memory().total)


def available_memory() -> int | None:
    """Return the bytes that can be had without swapping, where Linux does not count them; None without psutil."""
    try:
        import psutil
    except ImportError:
        return None
    return int(psutil.virtual_memory().available)


def address_space_limit() -> int | None:
    """Return the bytes of address space that this process may have (`ulimit -v`); None where there is no limit."""
    try:
        import resource
    except ImportError:
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def ended_by_file_size(code: int) -> bool:
    """Return True if an exit code says that a process wrote beyond the limit of file sizes (`ulimit -f`)."""
    number = getattr(signal, "SIGXFSZ", None)
    return number is not None and code == -number


def name_trouble(name: str) -> str:
    """Return why Windows takes no file of this name; empty where it does, and on other systems."""
    if not WINDOWS:
        return ""
    if is_reserved(name):
        return "is a device of Windows"
    wrong = sorted(set(name) & set('<>:"|?*'))
    return f"has {' '.join(wrong)}, which Windows takes in no name" if wrong else ""


def is_reserved(name: str) -> bool:
    """Return True if the name of a file or folder is a device on Windows, such as `aux` or `nul.txt`."""
    return name.partition(".")[0].rstrip(" ").upper() in RESERVED


def put_in_place(draft: Path, target: Path) -> None:
    """Let a draft take the place of a file. Windows refuses that while another process reads it: wait for a moment.

    Raises:
        OSError: it cannot be done.
    """
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            draft.replace(target)
        except PermissionError:
            if not WINDOWS or time.monotonic() > deadline:
                raise
            time.sleep(0.02)
        else:
            return


def open_for_writing(target: Path) -> int | None:
    """Return a handle of a device or FIFO; None where no process reads the FIFO.

    Raises:
        OSError: it cannot be opened.
    """
    if not hasattr(os, "O_NONBLOCK"):  # Windows: no FIFO stands in a folder
        return os.open(target, os.O_WRONLY | getattr(os, "O_BINARY", 0))
    try:
        handle = os.open(target, os.O_WRONLY | os.O_NONBLOCK)
    except OSError as error:
        if error.errno != errno.ENXIO:
            raise
        return None
    os.set_blocking(handle, True)
    return handle
