"""Install simwarp from the folder this lies in, without a network (started by install.sh).

Joins the parts, checks them, and lets the pip of the bundle install the wheels into an environment or a folder.
Only the standard library is used.
"""

import argparse
import contextlib
import hashlib
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

BUNDLE = Path(__file__).resolve().parent
# A folder that was filled by --site has this in it, and only such a one is replaced.
SITE_MARK = ".simwarp-site"


class InstallError(Exception):
    """It cannot be installed; the text is one line with the remedy."""


class UsageError(InstallError):
    """The command line or the machine does not go with the bundle."""


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Leave it to the caller to print."""
        raise UsageError(message)


def checked_files(bundle: Path) -> list[str]:
    """The names of the bundle's files, after all of them were compared with their checksums.

    Raises:
        InstallError: If files are missing or damaged.
    """
    lines = (bundle / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    wanted = {name: digest for digest, name in (line.split("  ", 1) for line in lines)}
    missing = [name for name in wanted if not (bundle / name).is_file()]
    if missing:
        raise InstallError(f"of {len(wanted)} files {len(missing)} are missing: {', '.join(missing)}; bring them too")
    damaged = []
    for name, checksum in wanted.items():
        with (bundle / name).open("rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != checksum:
                damaged.append(name)
    if damaged:
        raise InstallError(f"damaged (checksum differs): {', '.join(damaged)}; bring them again")
    return sorted(wanted)


@contextlib.contextmanager
def wheels_beside(target: Path, files: Sequence[str]) -> Iterator[Path]:
    """A folder with all wheels, on the disk that the target is on, gone afterwards."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".simwarp-wheels-", dir=target.parent) as folder:
        parts = [BUNDLE / name for name in files if name.startswith("wheels.tar.")]
        with (
            subprocess.Popen(["cat", *parts], stdout=subprocess.PIPE) as joined,
            tarfile.open(fileobj=joined.stdout, mode="r|") as archive,
        ):
            archive.extractall(folder, filter="data")
        for name in files:
            if name.endswith(".whl"):
                shutil.copyfile(BUNDLE / name, Path(folder) / name)
        yield Path(folder)


def pip_install(python: Path, wheels: Path, *arguments: str) -> None:
    """Run the bundle's own pip, which needs not be installed.

    Raises:
        InstallError: If pip fails.
    """
    pip = next(wheels.glob("pip-*.whl")) / "pip"
    command = [str(python), str(pip), "--isolated", "install", "-q", "--no-index", "--no-deps", "--find-links"]
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    command += [str(wheels), "--disable-pip-version-check", "--root-user-action", "ignore", *arguments]
    done = subprocess.run(
        command, env=environment, capture_output=True, encoding="utf-8", errors="replace", check=False
    )
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        errors = [line for line in lines if line.startswith("ERROR: ")]
        raise InstallError(f"pip could not install: {(errors or lines or ['no message'])[-1][:300]}")


def into_environment(folder: Path, about: dict[str, Any], files: Sequence[str]) -> Path:
    """Install into a virtual environment, a new one unless it is there; its interpreter.

    Raises:
        UsageError: If the folder is something else, or has another Python.
        InstallError: If it fails.
    """
    python = folder / "bin" / "python"
    new = not python.exists()
    if new and folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder} is there and no virtual environment; name another one with --venv")
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    if not new:
        found = subprocess.run(
            [python, "-c", code], capture_output=True, encoding="utf-8", errors="replace", check=False
        ).stdout.strip()
        if found != about["python"]:
            raise UsageError(f"{folder} has Python {found or '(broken)'}, the bundle is for {about['python']}")
    try:
        with wheels_beside(folder, files) as wheels:
            if new:
                # The machine's own packages take the place of those that were left out.
                own = ["--system-site-packages"] if about["without"] else []
                make = [sys.executable, "-m", "venv", "--without-pip", *own, str(folder)]
                made = subprocess.run(make, capture_output=True, encoding="utf-8", errors="replace", check=False)
                if made.returncode:
                    raise InstallError(f"could not make {folder}: {(made.stderr or made.stdout).strip()[-300:]}")
            pip_install(python, wheels, "--requirement", str(BUNDLE / "requirements.txt"), "pip")
            # The version stays the same from one commit to the next.
            pip_install(python, wheels, "--force-reinstall", f"simwarp=={about['simwarp']}")
    except BaseException:
        if new:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    return python


def into_site(folder: Path, about: dict[str, Any], files: Sequence[str]) -> None:
    """Install into a folder for PYTHONPATH, which is replaced as a whole if this made it.

    Raises:
        UsageError: If the folder holds something else.
    """
    if folder.exists() and not (folder / SITE_MARK).exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder} holds something else; name a new folder with --site")
    with wheels_beside(folder, files) as wheels:
        draft = wheels / "site"
        requirements = ["--requirement", str(BUNDLE / "requirements.txt"), f"simwarp=={about['simwarp']}"]
        pip_install(Path(sys.executable), wheels, "--target", str(draft), *requirements)
        (draft / SITE_MARK).write_text(f"simwarp {about['simwarp']}\n", encoding="utf-8")
        if folder.exists():
            folder.rename(wheels / "old")
        draft.rename(folder)


def start(python: Path, site: Path | None) -> str:
    """Import everything once; the version of torch.

    Raises:
        InstallError: If it does not start.
    """
    environment = dict(os.environ) | ({"PYTHONPATH": str(site)} if site else {})
    code = "import numpy, torch, warp, simwarp; print(torch.__version__)"
    started = subprocess.run(
        [python, "-c", code], env=environment, capture_output=True, encoding="utf-8", errors="replace", check=False
    )
    if started.returncode == 0:
        return started.stdout.splitlines()[-1]
    why = (started.stderr.strip().splitlines() or ["no message"])[-1]
    if "No module named 'torch'" in why:
        why += "; the bundle was written --without torch: name the Python that has it in PYTHON, or its --venv"
    raise InstallError(f"installed, but it does not start: {why}")


def check_machine(about: dict[str, Any], new: bool) -> None:
    """Refuse another kind of machine before anything is written, or a new environment that would lack packages.

    Raises:
        UsageError: If the bundle is for another system or processor, or what it leaves out would not be seen.
    """
    system = "Linux" if about["platform"].startswith("manylinux") else "Darwin"
    if platform.system() != system or not about["platform"].endswith(platform.machine()):
        here = f"{platform.system()} {platform.machine()}"
        raise UsageError(f"the bundle is for {about['platform']}, this is {here}; write one with --platform")
    if new and about["without"] and sys.prefix != sys.base_prefix:
        # An environment made from another one sees the packages of the Python below both.
        names = ", ".join(about["without"])
        raise UsageError(
            f"the bundle leaves out {names}; install into the environment that has it: --venv {sys.prefix}"
        )


def interrupted(signum: int, frame: object) -> NoReturn:
    """SIGTERM ends as Ctrl-C does."""
    raise KeyboardInterrupt


def install(arguments: Sequence[str]) -> None:
    """Check the bundle, install it, and say how to start."""
    parser = Parser(prog="sh install.sh", description="Install simwarp without a network.")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--venv", metavar="DIR", default="simwarp-env", help="environment to make or use (%(default)s)")
    where.add_argument("--site", metavar="DIR", help="folder for PYTHONPATH instead of an environment")
    wanted = parser.parse_args(arguments)
    about = json.loads((BUNDLE / "bundle.json").read_text(encoding="utf-8"))
    folder = Path(wanted.site or wanted.venv).absolute()
    check_machine(about, new=not wanted.site and not (folder / "bin" / "python").exists())
    print("[1/3] checking the parts", flush=True)
    files = checked_files(BUNDLE)
    print(f"[2/3] installing into {folder}", flush=True)
    if wanted.site:
        python = Path(sys.executable)
        into_site(folder, about, files)
        command = f"PYTHONPATH={folder} {python} -m simwarp"
    else:
        python = into_environment(folder, about, files)
        command = f"{folder}/bin/simwarp"
    torch = start(python, folder if wanted.site else None)
    print(f"[3/3] simwarp {about['simwarp']} with torch {torch} starts: {command} doctor", flush=True)


def main() -> int:
    """Install; any failure is one line on stderr."""
    signal.signal(signal.SIGTERM, interrupted)
    try:
        install(sys.argv[1:])
    except InstallError as error:
        print(f"install: {error}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    except OSError as error:
        print(f"install: {error.filename or BUNDLE}: {error.strerror}", file=sys.stderr)
        return 1
    except (ValueError, KeyError, tarfile.TarError):
        print("install: the bundle's lists do not fit together; bring all its files again", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("install: interrupted; nothing half-made is left", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
