"""Make the virtual environment that the Makefile works in: torch first, then simwarp with its tools.

Only the standard library is used, since this runs before anything is installed. Running it again changes
nothing and downloads nothing.
"""

import os
import platform
import shutil
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CPU_INDEX = "https://download.pytorch.org/whl/cpu"
PROBE_SECONDS = 4.0
SUPPORTED = ((3, 11), (3, 13))


def say(stage: int, text: str) -> None:
    """One line per stage."""
    print(f"[{stage}/3] {text}", flush=True)


def fail(text: str) -> None:
    """End with one line on stderr."""
    sys.exit(f"setup: {text}")


def has_cuda() -> bool:
    """Whether a CUDA driver answers; SIMWARP_TORCH=cpu or =cuda overrides."""
    wish = os.environ.get("SIMWARP_TORCH", "").lower()
    if wish in ("cpu", "cuda"):
        return wish == "cuda"
    if wish:
        fail(f"SIMWARP_TORCH is {wish!r}; it must be 'cpu' or 'cuda'")
    if shutil.which("nvidia-smi") is None:
        return False
    try:
        listed = subprocess.run(["nvidia-smi", "-L"], capture_output=True, text=True, timeout=30, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return listed.returncode == 0 and "GPU" in listed.stdout


def reachable(url: str) -> bool:
    """Whether the index answers soon. pip itself would retry an unreachable one for a long time."""
    try:
        with urllib.request.urlopen(f"{url}/torch/", timeout=PROBE_SECONDS) as answer:
            return bool(answer.status == 200)
    except (OSError, urllib.error.URLError, ValueError):
        return False


def pinned(name: str) -> str:
    """The tested version of a package, from constraints.txt."""
    for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith(f"{name}=="):
            return line.split("==", 1)[1].strip()
    fail(f"constraints.txt pins no {name}")
    return ""


def torch_request(version: str, cuda: bool) -> list[str]:
    """The arguments that make pip take the right build of torch.

    PyPI's Linux wheel is the CUDA build (gigabytes); the CPU build is called `+cpu` and comes from torch's
    own index, or from wherever pip's configuration finds it. On other systems PyPI has the CPU build.
    """
    if cuda:
        # Arbitrary equality: `==` would also take a `+cpu` wheel that pip's configuration offers.
        return [f"torch==={version}"]
    if platform.system() != "Linux":
        return [f"torch=={version}"]
    index = ["--extra-index-url", CPU_INDEX] if reachable(CPU_INDEX) else []
    return [f"torch=={version}+cpu", *index]


def installed_torch(python: Path) -> str:
    """Version of torch in the environment, with its build label; empty if there is none."""
    code = "import importlib.metadata as m; print(m.version('torch'))"
    found = subprocess.run([python, "-c", code], capture_output=True, text=True, check=False)
    return found.stdout.strip() if found.returncode == 0 else ""


def fits(found: str, version: str, cuda: bool) -> bool:
    """A CPU machine may keep a CUDA build that is already there; a CUDA machine needs one."""
    base, _, label = found.partition("+")
    return base == version and not (cuda and label == "cpu")


def pip(python: Path, *arguments: str) -> None:
    """Run pip install with the pins; only its errors are shown."""
    command = [
        str(python), "-m", "pip", "install", "-qq", "--disable-pip-version-check",
        "--constraint", str(ROOT / "constraints.txt"), *arguments,
    ]  # fmt: skip
    if subprocess.run(command, cwd=ROOT, check=False).returncode:
        fail(f"pip could not install {arguments[0]}; its message is above")


def make_venv(folder: Path) -> Path:
    """Create the environment, or keep it if its interpreter runs."""
    python = folder / "bin" / "python"
    low, high = SUPPORTED
    check = f"import sys, pip; sys.exit(not {low} <= sys.version_info[:2] <= {high})"
    if python.exists() and subprocess.run([python, "-c", check], capture_output=True).returncode == 0:
        say(1, f"virtual environment {folder.name} is there")
        return python
    say(1, f"virtual environment {folder.name} with Python {platform.python_version()}")
    made = subprocess.run([sys.executable, "-m", "venv", "--clear", str(folder)], check=False)
    if made.returncode:
        fail("could not make the virtual environment (on Debian and Ubuntu: apt install python3-venv)")
    return python


def main() -> None:
    """Environment, torch, simwarp."""
    if not SUPPORTED[0] <= sys.version_info[:2] <= SUPPORTED[1]:
        fail(f"needs Python 3.11 to 3.13, got {platform.python_version()}; set PYTHON=python3.12 or the like")
    folder = ROOT / (sys.argv[1] if len(sys.argv) > 1 else ".venv")
    python = make_venv(folder)
    cuda, version = has_cuda(), pinned("torch")
    build = "CUDA" if cuda else "CPU"
    found = installed_torch(python)
    if fits(found, version, cuda):
        say(2, f"torch {found} is there ({build} machine)")
    else:
        say(2, f"torch {version}, {build} build: downloading and installing")
        pip(python, *torch_request(version, cuda))
    say(3, "simwarp (editable), its dependencies and tools at the versions of constraints.txt")
    pip(python, "setuptools>=77")
    pip(python, "--no-build-isolation", "--editable", ".[dev]")


if __name__ == "__main__":
    main()
