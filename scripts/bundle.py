"""Write everything that a machine without network needs to install simwarp: wheels in parts, and install.sh.

The downloaded wheels are kept in .cache/bundle, so that a second run fetches only what changed. The folder with the
result appears whole or not at all.
"""

import argparse
import contextlib
import hashlib
import json
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name, parse_wheel_filename

from scripts.bundle_wheels import Shelf, Target, WheelError, pins, requirements
from scripts.pip_calls import PipError, offered, pip_environment, pip_reason
from scripts.torch_build import CUDA_SIZE, TorchError, choose, pinned

ROOT = Path(__file__).resolve().parent.parent
CACHE = ROOT / ".cache" / "bundle"
PART_BYTES = 45_000_000
CHECKSUMS = "SHA256SUMS"
PYTHONS = ("3.11", "3.12", "3.13")
# The oldest systems that the wheels of torch and Warp run on, by processor.
PLATFORMS = {"x86_64": "manylinux_2_28_x86_64", "aarch64": "manylinux_2_34_aarch64", "arm64": "macosx_14_0_arm64"}
SOURCES = ("simwarp", "pyproject.toml", "README.md", "LICENSE", "MANIFEST.in")
README = """\
simwarp {simwarp} for Python {python} on {platform}, {torch}. No network is needed:

    sh install.sh                    an environment in ./simwarp-env; --venv DIR names another, or one that is there
    sh install.sh --site DIR         a folder for PYTHONPATH instead
    PYTHON=/path/to/python{python} sh install.sh

Bring all files of this folder, in any order and in as many goes as it takes; install.sh says which are missing.
"""


class BundleError(Exception):
    """The bundle cannot be written; the text is one line with the remedy."""


class UsageError(BundleError):
    """The command line asks for something that cannot be."""


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Leave it to the caller to print."""
        raise UsageError(message)


def say(stage: int, text: str) -> None:
    """One line per stage."""
    print(f"[{stage}/3] {text}", flush=True)


def own_wheel(folder: Path) -> Path:
    """Build simwarp's wheel from the checkout as it is; the same files give the same bytes.

    Raises:
        BundleError: If it cannot be built.
    """
    source = folder / "source"
    source.mkdir()
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
        else:
            shutil.copy(ROOT / name, source)
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", str(folder)]
    environment = pip_environment() | {"SOURCE_DATE_EPOCH": "1704067200"}
    built = subprocess.run(
        [*command, str(source)], env=environment, capture_output=True, encoding="utf-8", errors="replace", check=False
    )
    if built.returncode:
        raise BundleError(f"could not build simwarp's wheel: {pip_reason(built.stdout + built.stderr)}")
    return next(folder.glob("simwarp-*.whl"))


def fill_shelf(own: Path, target: Target, without: frozenset[str], cuda: bool) -> tuple[list[Path], str]:
    """Download what is not there yet; the wheels of everything but simwarp, and the version of torch among them."""
    folder = CACHE / f"{target.python}-{target.platform}"
    folder.mkdir(parents=True, exist_ok=True)
    shelf = Shelf(folder, target, pins(), without)
    torch = ""
    if "torch" not in without:
        version = pinned("torch")
        pip = [sys.executable, "-m", "pip", "download", "-q", "--dest", str(folder), *target.pip_flags()]
        words = f"Python {target.python} on {target.platform}"
        there = [str(parse_wheel_filename(path.name)[1]) for path in folder.glob("torch-*.whl")]
        if not cuda and f"{version}+cpu" in there:
            torch = f"{version}+cpu"
        else:
            offers = partial(offered, pip, "torch")
            build = choose(version, cuda=cuda, linux=target.linux, offers=offers, target=words)
            torch, shelf.indexes["torch"] = build.version, build.arguments
            if torch not in there:
                say(2, f"torch {torch}, {build.note}")
        shelf.pinned["torch"] = torch
    roots = [*requirements(own, (), target.markers()), Requirement("pip")]
    wheels = shelf.fill(roots)
    unknown = without - shelf.left_out
    if unknown:
        raise UsageError(f"--without {sorted(unknown)[0]}: simwarp needs no such package")
    return sorted(wheels.values()), torch


def pack(wheels: Iterable[Path], folder: Path) -> int:
    """Write the wheels into numbered parts of one tar archive; how many. The same wheels give the same parts.

    Raises:
        BundleError: If the disk does not take them.
    """
    command = ["split", "-b", str(PART_BYTES), "-d", "-a", "3", "-", str(folder / "wheels.tar.")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as split:
        assert split.stdin is not None
        assert split.stderr is not None
        with contextlib.suppress(BrokenPipeError), tarfile.open(fileobj=split.stdin, mode="w|") as archive:
            for wheel in wheels:
                entry = tarfile.TarInfo(wheel.name)
                entry.size = wheel.stat().st_size
                with wheel.open("rb") as file:
                    archive.addfile(entry, file)
        with contextlib.suppress(BrokenPipeError):
            split.stdin.close()
        reason = split.stderr.read().decode(errors="replace").strip()
    if split.returncode:
        raise BundleError(f"could not write the parts: {reason[-300:]}")
    return len(list(folder.glob("wheels.tar.*")))


def write_bundle(folder: Path, own: Path, wheels: Sequence[Path], about: dict[str, Any]) -> int:
    """Write all files of the bundle; the number of parts."""
    count = pack(wheels, folder)
    shutil.copyfile(own, folder / own.name)
    for name in ("install.sh", "install.py"):
        shutil.copyfile(ROOT / "scripts" / f"bundle_{name}", folder / name)
    (folder / "install.sh").chmod(0o755)
    lines = []
    for wheel in wheels:
        name, version, _, _ = parse_wheel_filename(wheel.name)
        lines += [f"{name}==={version}\n"] if name != "pip" else []
    (folder / "requirements.txt").write_text("".join(lines), encoding="utf-8")
    about = {"simwarp": str(parse_wheel_filename(own.name)[1]), **about}
    (folder / "bundle.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    torch = f"with torch {about['torch']}" if about["torch"] else "for the torch that is there"
    (folder / "README.txt").write_text(README.format(**(about | {"torch": torch})), encoding="utf-8")
    sums = [(path.name, hashlib.sha256(path.read_bytes()).hexdigest()) for path in sorted(folder.iterdir())]
    (folder / CHECKSUMS).write_text("".join(f"{digest}  {name}\n" for name, digest in sums), encoding="utf-8")
    return count


def check_folder(output: Path) -> None:
    """Make way to the folder, and refuse to replace one that holds anything but an earlier bundle.

    Raises:
        UsageError: If it does, or cannot be written.
    """
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        names = {path.name for path in output.iterdir()} if output.exists() else set()
        listed = (output / CHECKSUMS).read_text(encoding="utf-8") if CHECKSUMS in names else ""
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else "no bundle's"
        raise UsageError(f"--output {output}: {why}") from None
    if output.is_symlink():
        raise UsageError(f"--output {output} is a link; name the folder itself")
    strange = sorted(names - {line.split("  ", 1)[-1] for line in listed.splitlines()} - {CHECKSUMS})
    if strange:
        raise UsageError(
            f"--output {output} holds {strange[0]!r}, which is of no bundle; move it or name another folder"
        )


def replace_folder(draft: Path, output: Path, aside: Path) -> None:
    """Put the finished folder in the place of the earlier one, or leave that where it is."""
    if output.exists():
        output.rename(aside)
    try:
        draft.rename(output)
    except BaseException:
        if aside.exists():
            aside.rename(output)
        raise


def python_version(text: str) -> str:
    """One of the versions that simwarp runs on."""
    if text not in PYTHONS:
        raise argparse.ArgumentTypeError(f"{text!r} is not one of {', '.join(PYTHONS)}")
    return text


def platform_tag(text: str) -> str:
    """A platform as wheels name it."""
    if not re.fullmatch(r"(manylinux_2_\d{1,2}|macosx_\d{2}_\d{1,2})_(x86_64|aarch64|arm64)", text):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the kind of {', '.join(PLATFORMS.values())}")
    return text


def folder_name(text: str) -> str:
    """A name that means a folder."""
    if not text.strip() or "\0" in text:
        raise argparse.ArgumentTypeError("the name is empty" if not text.strip() else "the name has a zero byte")
    return text


def options(arguments: Sequence[str]) -> argparse.Namespace:
    """Read the command line."""
    parser = Parser(prog="make bundle", description=__doc__.partition("\n")[0] if __doc__ else "")
    here = PLATFORMS.get(platform.machine(), PLATFORMS["x86_64"])
    version = ".".join(platform.python_version_tuple()[:2])
    add = parser.add_argument
    add("--python", type=python_version, default=version, help="version over there (%(default)s)")
    kinds = ", ".join(PLATFORMS.values())
    add("--platform", type=platform_tag, default=here, help=f"platform over there (%(default)s), such as {kinds}")
    add("--cuda", action="store_true", help=f"the CUDA build of torch, {CUDA_SIZE}, instead of the CPU build")
    add("--without", action="append", default=[], metavar="NAME", help="package that is there already, e.g. torch")
    add("--output", type=folder_name, default="bundle", metavar="DIR", help="folder to write (%(default)s)")
    chosen = parser.parse_args(arguments)
    if "pip" in chosen.without:
        parser.error("--without pip: install.sh works with it")
    if chosen.cuda and not chosen.platform.startswith("manylinux"):
        parser.error(f"--cuda: there is no CUDA build of torch for {chosen.platform}")
    return chosen


def bundle(arguments: Sequence[str]) -> None:
    """Wheels, parts, install.sh; then the folder is put in its place."""
    chosen = options(arguments)
    target = Target(chosen.python, chosen.platform)
    without = frozenset(canonicalize_name(name) for name in chosen.without)
    output = Path(os.path.abspath(chosen.output))
    check_folder(output)
    with tempfile.TemporaryDirectory(prefix=".bundle-", dir=output.parent) as folder:
        work, draft = Path(folder), Path(folder) / "bundle"
        draft.mkdir()
        say(1, "simwarp's own wheel")
        own = own_wheel(work)
        left_out = f", without {', '.join(sorted(without))}" if without else ""
        say(2, f"wheels for Python {target.python} on {target.platform}{left_out}: fetching those that are new")
        wheels, torch = fill_shelf(own, target, without, chosen.cuda)
        say(3, f"{len(wheels)} wheels, {sum(path.stat().st_size for path in wheels) / 1e6:.0f} MB: packing")
        about = {"python": target.python, "platform": target.platform, "torch": torch, "without": sorted(without)}
        count = write_bundle(draft, own, wheels, about)
        replace_folder(draft, output, work / "old")
    print(
        f"bundle: {output}, {count} parts of at most {PART_BYTES / 1e6:.0f} MB; over there: sh install.sh", flush=True
    )


def interrupted(signum: int, frame: object) -> NoReturn:
    """SIGTERM ends as Ctrl-C does."""
    raise KeyboardInterrupt


def main() -> int:
    """Write the bundle; any failure is one line on stderr."""
    signal.signal(signal.SIGTERM, interrupted)
    try:
        bundle(sys.argv[1:])
    except (BundleError, WheelError, TorchError, PipError) as error:
        print(f"bundle: {error}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    except OSError as error:
        print(f"bundle: {error.filename or ROOT}: {error.strerror}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("bundle: interrupted; what was downloaded is kept for the next run", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
