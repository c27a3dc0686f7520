"""Make the virtual environment that the Makefile works in: torch first, then simwarp with its tools.

Only the standard library is used, since this runs before anything is installed. Running it again changes
nothing and downloads nothing; after an interruption it goes on from there.

    python -m scripts.setup_env [FOLDER]               # the environment of a checkout, .venv
    python -m scripts.setup_env --only-torch FOLDER    # an environment with torch alone, as images begin
"""

import importlib.util
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import NoReturn

from scripts.pip_calls import PipError, offered, pip_environment, pip_reason
from scripts.torch_build import CONSTRAINTS, TorchError, choose, has_cuda, pinned, this_machine

ROOT = Path(__file__).resolve().parent.parent
SUPPORTED = ((3, 11), (3, 13))
# Everything that `python -m venv` makes before it writes pyvenv.cfg.
VENV_FOLDERS = {"bin", "include", "lib", "lib64", "Include", "Lib", "Scripts"}
ONLY_TORCH = "--only-torch"
STARTS = "import numpy, torch, warp, simwarp.cli"


class SetupError(Exception):
    """The set-up cannot go on; the text is one line with the remedy."""


def say(stage: int, text: str) -> None:
    """One line per stage."""
    print(f"[{stage}/3] {text}", flush=True)


def runs(python: Path, code: str) -> subprocess.CompletedProcess[str]:
    """Let the environment's interpreter run a line of code, out of the checkout's way."""
    command = [str(python), "-I", "-c", code]
    try:
        return subprocess.run(
            command, capture_output=True, encoding="utf-8", errors="replace", env=pip_environment(), check=False
        )
    except OSError as error:
        return subprocess.CompletedProcess(command, 1, "", str(error))


def pip_install(python: Path, torch: str, *arguments: str) -> None:
    """Run pip install with the pins, among them the build of torch that was chosen; what it writes goes to a file.

    Raises:
        SetupError: If pip fails.
    """
    folder = python.parent.parent
    # `==` would take a `+cpu` build for the plain version, and the other way round there is none to be found.
    pins = re.sub(r"^torch==.*$", f"torch==={torch}", CONSTRAINTS.read_text(encoding="utf-8"), flags=re.MULTILINE)
    (folder / "constraints.txt").write_text(pins, encoding="utf-8")
    command = [str(python), "-m", "pip", "install", "-q", "--constraint", str(folder / "constraints.txt"), *arguments]
    log = folder / "setup.log"
    with log.open("wb") as output:
        done = subprocess.run(command, cwd=ROOT, env=pip_environment(), stdout=output, stderr=output, check=False)
    if done.returncode:
        reason = pip_reason(log.read_text(encoding="utf-8", errors="replace"))
        raise SetupError(f"pip could not install {arguments[-1]}: {reason}; all it wrote is in {log}")


def installed_torch(python: Path) -> str:
    """Version of torch in the environment, with its build label; empty if there is none."""
    found = runs(python, "import importlib.metadata as m; print(m.version('torch'))")
    return found.stdout.strip() if found.returncode == 0 else ""


def fits(found: str, version: str, cuda: bool) -> bool:
    """A CPU machine may keep a CUDA build that is already there; a CUDA machine needs one."""
    base, _, label = found.partition("+")
    return base == version and not (cuda and label == "cpu")


def drop_half_installed(folder: Path) -> None:
    """Let pip install again what was being installed when something stopped it: it writes RECORD last."""
    packages = ("lib/python3.*/site-packages", "Lib/site-packages")
    for info in (info for place in packages for info in folder.glob(f"{place}/*.dist-info")):
        if not (info / "RECORD").exists():
            shutil.rmtree(info)


def belongs(folder: Path) -> bool:
    """True if the environment was made where it lies now; its commands hold that path."""
    lines = (folder / "pyvenv.cfg").read_text(encoding="utf-8").splitlines()
    return all(line.endswith(f" {folder}") for line in lines if line.startswith("command ="))


def environment_python(folder: Path) -> Path:
    """The interpreter of an environment, made or to be made."""
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def make_venv(folder: Path) -> Path:
    """Create the environment, or keep it if it was made here and its interpreter runs.

    Raises:
        SetupError: If it cannot be made, or if the folder holds anything else.
    """
    python = environment_python(folder)
    low, high = SUPPORTED
    check = f"import sys, pip; sys.exit(not {low} <= sys.version_info[:2] <= {high})"
    if (folder / "pyvenv.cfg").is_file() and belongs(folder) and runs(python, check).returncode == 0:
        drop_half_installed(folder)
        say(1, f"virtual environment {folder.name} is there")
        return python
    if not folder.is_dir() and (folder.exists() or folder.is_symlink()):
        raise SetupError(f"{folder} is not a folder; move it out of the way")
    if folder.is_dir() and not (folder / "pyvenv.cfg").exists() and {p.name for p in folder.iterdir()} - VENV_FOLDERS:
        raise SetupError(f"{folder} is no virtual environment and not empty; move it out of the way")
    for module in ("venv", "ensurepip"):
        if importlib.util.find_spec(module) is None:
            package = f"python3.{sys.version_info.minor}-venv"
            raise SetupError(f"{sys.executable} has no module {module} (Debian and Ubuntu: apt install {package})")
    say(1, f"virtual environment {folder.name} with Python {platform.python_version()}")
    command = [sys.executable, "-m", "venv", "--clear", str(folder)]
    made = subprocess.run(
        command, env=pip_environment(), capture_output=True, encoding="utf-8", errors="replace", check=False
    )
    if made.returncode:
        raise SetupError(f"could not make {folder}: {pip_reason(made.stdout + made.stderr)}")
    return python


def install_torch(python: Path, cuda: bool) -> str:
    """Install the right build of torch if none is there; its version with the label."""
    version = pinned("torch")
    found = installed_torch(python)
    if fits(found, version, cuda):
        say(2, f"torch {found} is there ({'CUDA' if cuda else 'CPU'} machine)")
        return found
    linux = platform.system() == "Linux"
    offers = partial(offered, [str(python), "-m", "pip", "install"], "torch")
    build = choose(version, cuda=cuda, linux=linux, offers=offers, target=this_machine())
    say(2, f"torch {build.version}, {build.note}: downloading and installing")
    pip_install(python, build.version, *build.arguments, f"torch==={build.version}")
    return build.version


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Let a second set-up of the same checkout wait for the first; Windows has no locks of folders."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("setup: another one works here; waiting for it", flush=True)
            fcntl.flock(handle, fcntl.LOCK_EX)
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(handle)


def set_up(folder: Path, *, only_torch: bool = False) -> None:
    """Environment, torch, simwarp; then the mark that it is done, which names the checkout."""
    done = folder / ".setup-done"
    with suppress(NotADirectoryError):
        done.unlink(missing_ok=True)
    cuda = has_cuda()
    python = make_venv(folder)
    torch = install_torch(python, cuda)
    if only_torch:
        return
    say(3, "simwarp (editable), its dependencies and tools at the versions of constraints.txt")
    pip_install(python, torch, "setuptools>=77")
    # A path that type checkers and editors follow; otherwise setuptools installs an import hook, which they cannot
    pip_install(
        python, torch, "--no-build-isolation", "--config-settings", "editable_mode=compat", "--editable", ".[dev]"
    )
    started = runs(python, STARTS)
    if started.returncode:
        why = pip_reason(started.stderr)
        raise SetupError(f"installed, but it does not start: {why}; remove {folder} and run `make setup` again")
    done.write_text(f"{ROOT}\n", encoding="utf-8")


def interrupted(signum: int, frame: object) -> NoReturn:
    """SIGTERM ends as Ctrl-C does."""
    raise KeyboardInterrupt


def main() -> int:
    """Set the environment up; any failure is one line on stderr."""
    if not SUPPORTED[0] <= sys.version_info[:2] <= SUPPORTED[1]:
        text = f"needs Python 3.11 to 3.13, got {platform.python_version()}; set PYTHON=python3.12 or the like"
        print(f"setup: {text}", file=sys.stderr)
        return 1
    words = [word for word in sys.argv[1:] if word != ONLY_TORCH]
    signal.signal(signal.SIGTERM, interrupted)
    try:
        with alone(ROOT):
            set_up(ROOT / (words[0] if words else ".venv"), only_torch=ONLY_TORCH in sys.argv)
    except (SetupError, TorchError, PipError) as error:
        print(f"setup: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"setup: {error.filename or ROOT}: {error.strerror}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("setup: interrupted; run it again and it goes on from there", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
