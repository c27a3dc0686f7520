"""Try an extra at its floor or its ceiling: an environment of its own, the wheel with the extra, and its tests.

    python -m scripts.extras mcap --at floor
    python -m scripts.extras all --at both --json benchmarks/results/extras.json

At the floor every package that pyproject.toml names, for simwarp itself and for the extra, has the lowest version that
it admits and that has a wheel for this Python; what these bring along is the newest that they admit. At the ceiling all
are the newest. torch is installed first, and an extra that would install another one has failed. `core` is simwarp by
itself. What simwarp itself needs is installed once for each end; environments of extras begin with links to its files.

The wheel has to start where the checkout is out of its way. Tests import the checkout, of which the wheel was built, so
that all environments share the compiled kernels: they lie in Warp's usual cache, in a folder for each version of Warp.

Outcomes go to the file after each extra. What holds there by the same requirements of pyproject.toml is left out, so
that a run goes on after Ctrl-C; `--again` tries it. `python -m scripts.extra_results` then writes the table of
docs/installation.md.
"""

import argparse
import datetime
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from scripts import extra_results, setup_env
from scripts.bundle import BundleError, own_wheel
from scripts.bundle_wheels import pins
from scripts.extra_results import CORE, ENDS, ExtraError, Outcome, named
from scripts.pip_calls import PipError, offered, pip_environment, pip_reason
from scripts.setup_env import SetupError
from scripts.torch_build import TorchError, has_cuda

ROOT = Path(__file__).resolve().parent.parent
# They run the tests and are no part of what is tried.
RUNNERS = ("pytest", "pytest-xdist", "hypothesis", "psutil")
COMPILED = "import matplotlib.pyplot, pytest, rsl_rl.runners, scipy.spatial, torch, trimesh, tyro, warp"
BUILDS_OF_TORCH = {"torch", "triton"}


@dataclass(frozen=True)
class Trial:
    """Tests of an extra, and the packages that they read results back with, at the versions of constraints.txt."""

    tests: tuple[str, ...]
    readers: tuple[str, ...] = ()
    command: tuple[str, ...] = ()
    """What the wheel's own `simwarp` has to do in a folder by itself."""


TRIALS = {
    CORE: Trial(
        ("tests/unit/core", "tests/unit/geometry", "tests/tasks/test_pendulum.py", "tests/cli/test_cli_words.py"),
        ("mujoco",),
        ("train", "pendulum", "--iterations", "2", "--num-envs", "8", "--device", "cpu"),
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
    "crg": Trial(("tests/unit/vehicle/test_open_crg.py",)),
    "fmu": Trial(("tests/cli/test_export_fmu.py",), ("fmpy",)),
    "fit": Trial(("tests/unit/identify/test_fit_laws.py",)),
    "sweep": Trial(("tests/train/sweeps", "tests/unit/search")),
    "sb3": Trial(("tests/tasks/adapters/test_sb3_adapter.py",)),
    "skrl": Trial(("tests/tasks/adapters/test_skrl_adapter.py",)),
    "peers": Trial(("tests/cli/test_bench_peers.py",)),
    "docs": Trial(("tests/project/test_site.py",)),
}


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

    What simwarp itself needs has them in the environment that this one began with.

    Raises:
        ExtraError: a package has none.
    """
    pip, there = [str(python), "-m", "pip", "install"], versions_in(python)
    own = [] if extra == CORE else named(extra)
    core = {each.name: there.get(canonicalize_name(each.name)) for each in named(CORE)}
    begun = [f"{name}=={version}" for name, version in core.items() if version]
    missing = [each for each in named(CORE) if not core[each.name]]
    return [*begun, *(f"{each.name}=={lowest(each, offered(pip, each.name))}" for each in [*missing, *own])]


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
        command += [f"--junitxml={report}", *TRIALS[extra].tests]
        subprocess.run(command, cwd=ROOT, env=trial_environment(), check=False)
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


def start(python: Path, extra: str) -> None:
    """Let the wheel start where the checkout is out of its way, and do what its trial asks.

    Raises:
        ExtraError: it does not.
    """
    started = setup_env.runs(python, setup_env.STARTS)
    if started.returncode:
        raise ExtraError(f"the wheel does not start: {pip_reason(started.stderr)}")
    if not (words := TRIALS[extra].command):
        return
    with tempfile.TemporaryDirectory() as folder:
        command = [str(python.with_name("simwarp")), *words]
        env = trial_environment()
        ended = subprocess.run(
            command, cwd=folder, env=env, capture_output=True, encoding="utf-8", errors="replace", check=False
        )
    if ended.returncode:
        raise ExtraError(f"the wheel's simwarp {' '.join(words)}: {pip_reason(ended.stderr)}")


def linked(source: str, target: str) -> None:
    """A second name of a file, or a copy on file systems that have none; pip unlinks what it replaces."""
    try:
        os.link(source, target)
    except FileExistsError:
        pass  # pip's own files, or those of a trial that was interrupted
    except OSError:
        shutil.copy2(source, target)


def trial_environment() -> dict[str, str]:
    """The user's environment, but for packages of elsewhere; bytecode is kept, for tests start many processes."""
    return {name: value for name, value in pip_environment().items() if name != "PYTHONDONTWRITEBYTECODE"}


def site_packages(folder: Path) -> Path:
    """Where an environment keeps its packages."""
    return next(found for place in ("lib/python3.*", "Lib") for found in folder.glob(f"{place}/site-packages"))


def make_base(folder: Path, at: str) -> None:
    """Make the environment that those of extras begin with: torch, what simwarp itself needs, and what runs tests.

    Raises:
        ExtraError, SetupError, TorchError, PipError: it cannot be made.
    """
    setup_env.make_venv(folder)
    python = setup_env.environment_python(folder)
    setup_env.install_torch(python, has_cuda())
    asked = floors(python, CORE) if at == "floor" else [str(each) for each in named(CORE)]
    tested = pins()
    pip(python, *asked, *(f"{name}=={tested[name]}" for name in RUNNERS))
    # What is imported is compiled here, once for all
    imported = subprocess.run([str(python), "-I", "-c", COMPILED], env=trial_environment(), check=False)
    if imported.returncode:
        raise ExtraError(f"packages of simwarp at their {at} cannot be imported")


def make_environment(folder: Path, at: str) -> tuple[Path, str]:
    """Make an environment with the files of a base, which is made once; its Python, and the version of torch in it.

    Raises:
        ExtraError, SetupError, TorchError, PipError: it cannot be made.
    """
    base, python = folder.with_name(f"base-{at}"), setup_env.environment_python(folder)
    if not (base / "made").exists():
        make_base(base, at)
        (base / "made").touch()
    setup_env.make_venv(folder)
    for each in site_packages(base).iterdir():
        place = site_packages(folder) / each.name
        if each.is_dir():
            shutil.copytree(each, place, copy_function=linked, dirs_exist_ok=True)
        else:
            linked(str(each), str(place))
    return python, setup_env.installed_torch(python)


def try_extra(extra: str, at: str, wheel: Path, folder: Path, arguments: Sequence[str]) -> Outcome:
    """Make the environment of an extra in a folder, and run its tests; a refusal is an outcome, too."""
    began = time.monotonic()
    torch, error = "", ""
    chosen: dict[str, str] = {}
    counts = 0, 0, 0
    try:
        python, torch = make_environment(folder, at)
        versions = install(python, wheel, extra, at)
        if (after := setup_env.installed_torch(python)) != torch:
            raise ExtraError(f"extra '{extra}' at its {at} changed torch from {torch} to {after}")
        chosen = {each.name: versions[canonicalize_name(each.name)] for each in named(extra)}
        print(f"{extra} at its {at}: " + ", ".join(f"{name} {version}" for name, version in chosen.items()), flush=True)
        start(python, extra)
        counts = run_tests(python, extra, arguments)
    except (ExtraError, SetupError, TorchError, PipError) as wrong:
        error = " ".join(str(wrong).split())
    said, wall = extra_results.requirements(extra), round(time.monotonic() - began, 1)
    today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    return Outcome(extra, at, said, chosen, torch, platform.python_version(), today, *counts, error, wall)


def options(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line; what follows `--` goes to pytest."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    end = words.index("--") if "--" in words else len(words)
    parser = argparse.ArgumentParser(description="Try extras at their floor or ceiling.", allow_abbrev=False)
    parser.add_argument(
        "extras", nargs="+", choices=[*TRIALS, "all"], metavar="EXTRA", help="tried in this order, or all"
    )
    parser.add_argument("--at", choices=[*ENDS, "both"], required=True)
    parser.add_argument("--wheel", type=Path, help="instead of one that is built from the checkout")
    parser.add_argument("--folder", type=Path, help="for environments, which are kept; otherwise they are removed")
    parser.add_argument(
        "--json", type=Path, help="file of outcomes: written after each extra; what holds there is left out"
    )
    parser.add_argument("--again", action="store_true", help="try what holds already, too")
    parsed = parser.parse_args(words[:end])
    parsed.pytest = words[end + 1 :]
    if parsed.json and parsed.pytest:
        parser.error("--json: a part of the tests, chosen by arguments of pytest, is no outcome")
    return parsed


def trials(chosen: argparse.Namespace, outcomes: Sequence[Outcome]) -> list[tuple[str, str]]:
    """Extras and ends to try."""
    ends = ENDS if chosen.at == "both" else [chosen.at]
    wanted = [(extra, at) for extra in (TRIALS if "all" in chosen.extras else chosen.extras) for at in ends]
    if chosen.again:
        return wanted
    left = [each for each in wanted if not extra_results.done(outcomes, *each)]
    if len(left) < len(wanted):
        print(f"{len(wanted) - len(left)} of {len(wanted)} trials hold already, in {chosen.json}", flush=True)
    return left


def try_all(chosen: argparse.Namespace, folder: Path) -> list[Outcome]:
    """Try what was asked for, and keep each outcome as soon as it is there.

    Raises:
        BundleError, ExtraError: nothing can be tried.
    """
    kept = extra_results.read(chosen.json) if chosen.json else []
    new: list[Outcome] = []
    try:
        if not (wanted := trials(chosen, kept)):
            return new
        wheel = chosen.wheel.resolve() if chosen.wheel else own_wheel(Path(tempfile.mkdtemp(dir=folder)))
        for number, (extra, at) in enumerate(wanted, 1):
            print(f"trial {number} of {len(wanted)}: {extra} at its {at}", flush=True)
            new.append(try_extra(extra, at, wheel, folder / f"{extra}-{at}", chosen.pytest))
            if chosen.json:
                kept = extra_results.merged(kept, new[-1])
                extra_results.write(chosen.json, kept)
            if not chosen.folder:
                shutil.rmtree(folder / f"{extra}-{at}", ignore_errors=True)
    finally:
        print(extra_results.summary(new), flush=True)
    return new


def main(arguments: Sequence[str] | None = None) -> int:
    """Try extras; 1 if one does not hold."""
    chosen = options(arguments)
    signal.signal(signal.SIGTERM, setup_env.interrupted)
    # Tests import a small part of what is installed: that is compiled when it is imported
    os.environ.setdefault("PIP_NO_COMPILE", "1")
    folder = chosen.folder or Path(tempfile.mkdtemp(prefix="simwarp-extras-"))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        outcomes = try_all(chosen, folder.resolve())
    except (BundleError, ExtraError) as error:
        print(f"extras: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"extras: {error.filename or folder}: {error.strerror}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        kept = f"; outcomes until then are in {chosen.json}: run it again and it goes on" if chosen.json else ""
        print(f"extras: interrupted{kept}", file=sys.stderr)
        return 130
    finally:
        if not chosen.folder:
            shutil.rmtree(folder, ignore_errors=True)
    wrong = [each for each in outcomes if not each.holds]
    for each in wrong:
        print(f"extras: {each.extra} at its {each.at}: {each.text}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
