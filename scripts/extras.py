"""Try an extra at its floor or its ceiling: an environment of its own, the wheel with the extra, and its tests.

    python -m scripts.extras mcap --at floor
    python -m scripts.extras all --at ceiling --json results.json

At the floor every package that pyproject.toml names, for simwarp itself and for the extra, has the lowest version that
it admits and that has a wheel for this Python; what these bring along is the newest that they admit. At the ceiling all
are the newest. torch is installed first, and an extra that would install another one has failed. `core` is simwarp by
itself.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from scripts.bundle import BundleError, own_wheel
from scripts.bundle_wheels import pins
from scripts.pip_calls import PipError, offered, pip_environment, pip_reason
from scripts.setup_env import SetupError, environment_python, install_torch, installed_torch, make_venv
from scripts.torch_build import TorchError, has_cuda

ROOT = Path(__file__).resolve().parent.parent
CORE = "core"
# They run the tests and are no part of what is tried.
RUNNERS = ("pytest", "pytest-xdist", "hypothesis", "psutil")
BUILDS_OF_TORCH = {"torch", "triton"}


@dataclass(frozen=True)
class Trial:
    """Tests of an extra, and the packages that they read results back with, at the versions of constraints.txt."""

    tests: tuple[str, ...]
    readers: tuple[str, ...] = ()


TRIALS = {
    CORE: Trial(
        ("tests/unit/core", "tests/unit/geometry", "tests/tasks/test_pendulum.py", "tests/cli/test_cli_words.py"),
        ("mujoco",),
    ),
    "viewer": Trial(("tests/unit/viewer/live/test_web_server.py", "tests/unit/viewer/live/test_page_frames.py")),
    "import": Trial(("tests/unit/importers",), ("usd-core",)),
    "usd": Trial(("tests/unit/importers/test_usd_reader.py",), ("mujoco", "yourdfpy", "lxml")),
    "flex": Trial(("tests/unit/flex/test_volume_files.py", "tests/unit/flex/test_volume_mesh.py")),
    "plot": Trial(("tests/unit/exporters/test_run_report.py", "tests/unit/exporters/test_vehicle_sheet.py")),
    "wandb": Trial(("tests/train/runs/test_training_loggers.py",)),
    "parquet": Trial(("tests/unit/exporters/test_run_tables.py",)),
    "mcap": Trial(("tests/unit/mcap", "tests/unit/ros2"), ("mcap-ros2-support",)),
    "minari": Trial(("tests/train/datasets",), ("pyarrow",)),
    "lerobot": Trial(("tests/train/datasets",), ("minari",)),
    "crg": Trial(("tests/unit/vehicle/roads/test_open_crg.py",)),
    "fmu": Trial(("tests/cli/test_export_fmu.py",), ("fmpy",)),
    "fit": Trial(("tests/unit/identify/test_fit_laws.py",)),
    "sweep": Trial(("tests/train/sweeps", "tests/unit/search")),
    "sb3": Trial(("tests/tasks/adapters/test_sb3_adapter.py",)),
    "skrl": Trial(("tests/tasks/adapters/test_skrl_adapter.py",)),
    "peers": Trial(("tests/cli/test_bench_peers.py",)),
    "docs": Trial(("tests/project/test_site.py",)),
}


class ExtraError(Exception):
    """An extra does not hold what pyproject.toml says of it; the text is one line."""


@dataclass(frozen=True)
class Outcome:
    """What became of a trial: the versions of the packages that pyproject.toml names, and the tests."""

    extra: str
    at: str
    torch: str
    versions: dict[str, str]
    passed: int
    skipped: int
    failed: int
    wall_s: float


def named(extra: str) -> list[Requirement]:
    """Requirements of simwarp with an extra that apply on this machine, but for torch."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    texts = [*project["dependencies"], *([] if extra == CORE else project["optional-dependencies"][extra])]
    wanted = [Requirement(text) for text in texts]
    return [each for each in wanted if each.name != "torch" and (each.marker is None or each.marker.evaluate())]


def lowest(requirement: Requirement, versions: Sequence[str]) -> str:
    """The lowest of the versions that a requirement admits.

    Raises:
        ExtraError: it admits none.
    """
    fitting = [Version(text) for text in versions if Version(text) in requirement.specifier]
    if not fitting:
        raise ExtraError(f"no wheel of {requirement} for Python {sys.version_info.major}.{sys.version_info.minor}")
    return str(min(fitting))


def floors(python: Path, extra: str) -> list[str]:
    """Pins of all packages that pyproject.toml names for an extra at their lowest versions.

    Raises:
        ExtraError: a package has none.
    """
    pip = [str(python), "-m", "pip", "install"]
    return [f"{each.name}=={lowest(each, offered(pip, each.name))}" for each in named(extra)]


def pip(python: Path, *arguments: str) -> str:
    """Run pip install; what it printed.

    Raises:
        ExtraError: it failed.
    """
    command = [str(python), "-m", "pip", "install", "-q", *arguments]
    done = subprocess.run(
        command, env=pip_environment(), capture_output=True, encoding="utf-8", errors="replace", check=False
    )
    if done.returncode:
        conflicts = [line.strip() for line in done.stdout.splitlines() if " depends on " in line or "requested" in line]
        raise ExtraError("; ".join([pip_reason(done.stderr), *conflicts[:6]]))
    return done.stdout


def other_torch(report: str) -> list[str]:
    """Builds of torch that an installation would bring, by pip's report of it."""
    items = [item["metadata"] for item in json.loads(report)["install"]]
    return [f"{each['name']} {each['version']}" for each in items if canonicalize_name(each["name"]) in BUILDS_OF_TORCH]


def install(python: Path, wheel: Path, extra: str, at: str) -> dict[str, str]:
    """Install the wheel with an extra; the versions of all packages then.

    Raises:
        ExtraError: it cannot be installed, or another torch would be.
    """
    target = str(wheel) if extra == CORE else f"{wheel}[{extra}]"
    pinned = floors(python, extra) if at == "floor" else []
    if torches := other_torch(pip(python, "--dry-run", "--report", "-", target, *pinned)):
        raise ExtraError(f"extra '{extra}' at its {at} brings another torch: {', '.join(torches)}")
    pip(python, target, *pinned)
    tested = pins()
    readers = [f"{name}=={tested[canonicalize_name(name)]}" for name in (*RUNNERS, *TRIALS[extra].readers)]
    installed = versions_in(python)
    held = [f"{name}=={version}" for name, version in installed.items() if name not in BUILDS_OF_TORCH]
    held = [pin for pin in held if not pin.startswith("simwarp==")]
    wanted = [reader for reader in readers if canonicalize_name(reader.split("==")[0]) not in installed]
    if not wanted:
        return installed
    # What the tests need changes nothing of what is tried
    with tempfile.NamedTemporaryFile("w", suffix=".txt", encoding="utf-8", delete=False) as file:
        file.write("\n".join(held))
    try:
        pip(python, "--constraint", file.name, *wanted)
    finally:
        Path(file.name).unlink()
    return versions_in(python)


def versions_in(python: Path) -> dict[str, str]:
    """Versions of all packages of an environment, by canonical name."""
    code = "import importlib.metadata as m; print(*(f'{d.name}=={d.version}' for d in m.distributions()), sep='\\n')"
    done = subprocess.run([str(python), "-I", "-c", code], capture_output=True, encoding="utf-8", check=True)
    pairs = (line.split("==", 1) for line in done.stdout.splitlines())
    return {canonicalize_name(name): version for name, version in pairs}


def run_tests(python: Path, extra: str, arguments: Sequence[str]) -> tuple[int, int, int]:
    """Run the tests of an extra; how many passed, were skipped and failed.

    Raises:
        ExtraError: none passed, or some were skipped for a package that is missing.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [str(python), "-m", "pytest", "-q", "-m", "not slow", "-p", "no:cacheprovider", *arguments]
        subprocess.run([*command, f"--junitxml={report}", *TRIALS[extra].tests], cwd=ROOT, check=False)
        if not report.is_file():
            raise ExtraError(f"tests of extra '{extra}' did not run to their end")
        cases = list(ElementTree.parse(report).iter("testcase"))
    skipped = [case.find("skipped") for case in cases]
    reasons = [str(each.get("message")) for each in skipped if each is not None]
    missing = sorted({reason for reason in reasons if "could not import" in reason})
    failed = sum(case.find("failure") is not None or case.find("error") is not None for case in cases)
    passed = len(cases) - len(reasons) - failed
    if missing:
        raise ExtraError(f"tests of extra '{extra}' were skipped: {'; '.join(missing)}")
    if not passed:
        raise ExtraError(f"of the tests of extra '{extra}' none passed, {failed} failed")
    return passed, len(reasons), failed


def try_extra(extra: str, at: str, wheel: Path, folder: Path, arguments: Sequence[str]) -> Outcome:
    """Make the environment of an extra in a folder, and run its tests.

    Raises:
        ExtraError: it does not hold.
    """
    began = time.monotonic()
    make_venv(folder)
    python = environment_python(folder)
    torch = install_torch(python, has_cuda())
    versions = install(python, wheel, extra, at)
    if (after := installed_torch(python)) != torch:
        raise ExtraError(f"extra '{extra}' at its {at} changed torch from {torch} to {after}")
    chosen = {each.name: versions[canonicalize_name(each.name)] for each in named(extra)}
    print(f"{extra} at its {at}: " + ", ".join(f"{name} {version}" for name, version in chosen.items()), flush=True)
    passed, skipped, failed = run_tests(python, extra, arguments)
    return Outcome(extra, at, torch, chosen, passed, skipped, failed, round(time.monotonic() - began, 1))


def options(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line; what follows `--` goes to pytest."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    end = words.index("--") if "--" in words else len(words)
    parser = argparse.ArgumentParser(description="Try extras at their floor or ceiling.", allow_abbrev=False)
    parser.add_argument("extra", choices=[*TRIALS, "all"])
    parser.add_argument("--at", choices=["floor", "ceiling"], required=True)
    parser.add_argument("--wheel", type=Path, help="instead of one that is built from the checkout")
    parser.add_argument("--folder", type=Path, help="for environments, which are kept; otherwise they are removed")
    parser.add_argument("--json", type=Path, help="file for the outcomes")
    parsed = parser.parse_args(words[:end])
    parsed.pytest = words[end + 1 :]
    return parsed


def main(arguments: Sequence[str] | None = None) -> int:
    """Try one extra or all; 1 if one does not hold."""
    chosen = options(arguments)
    # Tests import a small part of what is installed: that is compiled when it is imported
    os.environ.setdefault("PIP_NO_COMPILE", "1")
    folder = chosen.folder or Path(tempfile.mkdtemp(prefix="simwarp-extras-"))
    folder.mkdir(parents=True, exist_ok=True)
    outcomes, wrong = [], []
    try:
        wheel = chosen.wheel.resolve() if chosen.wheel else own_wheel(Path(tempfile.mkdtemp(dir=folder)))
        for extra in TRIALS if chosen.extra == "all" else [chosen.extra]:
            try:
                outcomes.append(try_extra(extra, chosen.at, wheel, folder / f"{extra}-{chosen.at}", chosen.pytest))
                if outcomes[-1].failed:
                    wrong.append(f"{extra}: {outcomes[-1].failed} tests failed")
            except (ExtraError, SetupError, TorchError, PipError) as error:
                wrong.append(f"{extra}: {error}")
            if not chosen.folder:
                shutil.rmtree(folder / f"{extra}-{chosen.at}", ignore_errors=True)
    except BundleError as error:
        wrong.append(str(error))
    finally:
        if not chosen.folder:
            shutil.rmtree(folder, ignore_errors=True)
    for each in outcomes:
        print(f"{each.extra:<8} {each.at}: {each.passed} passed, {each.skipped} skipped, {each.failed} failed")
    if chosen.json:
        chosen.json.write_text(json.dumps([asdict(each) for each in outcomes], indent=2) + "\n", encoding="utf-8")
    for line in wrong:
        print(f"extras: {' '.join(line.split())}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
