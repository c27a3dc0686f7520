"""Choice of the build of torch to ask pip for.

PyPI's wheel for Linux is the CUDA build, gigabytes with what it pulls in; the CPU build is called `+cpu` and comes
from torch's own index or from wherever pip's configuration finds it. On other systems PyPI has the CPU build.
Only the standard library is used, since this runs before anything is installed.
"""

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

CONSTRAINTS = Path(__file__).resolve().parent.parent / "constraints.txt"
CPU_INDEX = "https://download.pytorch.org/whl/cpu"
# torch 2.13.0 for Linux on PyPI is 0.53 GB (0.43 on ARM), the CUDA libraries it asks for the rest.
CUDA_SIZE = "some 2.5 GB"
REMEDY = (
    "without a network, run the install.sh of a bundle that `make bundle` wrote elsewhere; "
    "or name an index or a folder of wheels in PIP_INDEX_URL or PIP_FIND_LINKS"
)


class TorchError(Exception):
    """No build of torch can be had as asked; the text is one line with the remedy."""


@dataclass(frozen=True)
class Build:
    """A build of torch that pip can get: its version with the label, where from, and what the user should know."""

    version: str
    arguments: tuple[str, ...] = ()
    note: str = ""


def pinned(name: str) -> str:
    """The tested version of a package, from constraints.txt."""
    for line in CONSTRAINTS.read_text(encoding="utf-8").splitlines():
        if line.startswith(f"{name}=="):
            return line.split("==", 1)[1].strip()
    raise TorchError(f"constraints.txt pins no {name}")


def has_cuda() -> bool:
    """True if a CUDA driver answers; SIMWARP_TORCH=cpu or =cuda overrides."""
    wish = os.environ.get("SIMWARP_TORCH", "").lower()
    if wish in ("cpu", "cuda"):
        return wish == "cuda"
    if wish:
        raise TorchError(f"SIMWARP_TORCH is {wish!r}; it must be 'cpu' or 'cuda'")
    if shutil.which("nvidia-smi") is None:
        return _driver_answers()
    try:
        listed = subprocess.run(
            ["nvidia-smi", "-L"], capture_output=True, encoding="utf-8", errors="replace", timeout=30, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return listed.returncode == 0 and "GPU" in listed.stdout


def _driver_answers() -> bool:
    """Whether the driver's library counts a device: containers may have it without nvidia-smi. Asked in a process of
    its own, since a driver that does not work may end it.
    """
    ask = (
        "import ctypes; cuda, count = ctypes.CDLL('libcuda.so.1'), ctypes.c_int(); "
        "assert cuda.cuInit(0) == 0 and cuda.cuDeviceGetCount(ctypes.byref(count)) == 0 and count.value > 0"
    )
    try:
        asked = subprocess.run([sys.executable, "-I", "-c", ask], capture_output=True, timeout=30, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return asked.returncode == 0


def choose(version: str, *, cuda: bool, linux: bool, offers: Callable[..., list[str]], target: str) -> Build:
    """The build to install: what pip's configuration offers, then torch's own index, then the plain pin.

    Args:
        version: The pinned version, without a label.
        cuda: True if the build has to use CUDA.
        linux: True if it is for Linux, where the plain version is the CUDA build.
        offers: Versions that pip finds with these additional arguments.
        target: Python and system it is for, in words.

    Raises:
        TorchError: If no build can be had.
    """
    here, label = offers(), f"{version}+cpu"
    if not (linux and cuda):
        if label in here:
            return Build(label, note="CPU build")
        if not linux and version in here:
            return Build(version, note="CPU build")
        index = ("--extra-index-url", CPU_INDEX)
        if label in offers(*index):
            return Build(label, index, note=f"CPU build, from {CPU_INDEX}")
    with_cuda = [v for v in here if v == version or v.startswith(f"{version}+cu")]
    if linux and with_cuda:
        why = "" if cuda else "no CPU build to be had, so the "
        return Build(with_cuda[0], note=f"{why}CUDA build, {CUDA_SIZE} to download")
    if label in here:
        raise TorchError(f"only the CPU build of torch {version} can be had for {target}; SIMWARP_TORCH=cpu takes it")
    found = f"only {', '.join(here[-3:])}" if here else "none"
    raise TorchError(f"no torch {version} for {target}: pip finds {found}; {REMEDY}")


def this_machine() -> str:
    """Python and system in words."""
    return f"Python {'.'.join(platform.python_version_tuple()[:2])} on {platform.system()} {platform.machine()}"
