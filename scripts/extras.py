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

from packaging.utils import canonicalize_name

from scripts import extra_results, setup_env
from scripts.bundle import BundleError, own_wheel
from scripts.extra_environments import install, make_environment, not_imported, trial_environment
from scripts.extra_results import CORE, ENDS, ExtraError, Outcome, named
from scripts.pip_calls import PipError, pip_reason
from scripts.setup_env import SetupError
from scripts.torch_build import TorchError

ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Trial:
    """Tests of an extra, and the packages that they read results back with."""

    tests: tuple[str, ...] = ()
    readers: tuple[str, ...] = ()
    slow: tuple[str, ...] = ()
    """Tests that count as slow, and belong to it nevertheless; of `tests`, slow ones are left out."""
    command: tuple[str, ...] = ()
    """What the wheel's own `simwarp` has to do in a folder by itself."""


TRIALS = {
    CORE: Trial(
        (
            "tests/unit/core",
            "tests/unit/geometry",
            "tests/tasks/test_pendulum.py",
            "tests/cli/test_cli_words.py",
            "tests/train/evaluation/test_filming.py",
        ),
        ("mujoco",),
        command=("train", "pendulum", "--iterations", "2", "--num-envs", "8", "--device", "cpu"),
    ),
    "viewer": Trial(("tests/unit/viewer/live/test_web_server.py", "tests/unit/viewer/live/test_page_frames.py")),
    "import": Trial(("tests/unit/importers", "tests/unit/geometry/test_mesh_import.py"), ("usd-core",)),
    "usd": Trial(("tests/unit/importers/test_usd_reader.py",), ("mujoco", "yourdfpy", "lxml")),
    "flex": Trial(("tests/unit/flex/test_volume_files.py", "tests/unit/flex/test_volume_mesh.py")),
    "plot": Trial(("tests/unit/exporters/test_run_report.py", "tests/unit/exporters/test_vehicle_sheet.py")),
    "wandb": Trial(
        ("tests/train/runs/test_training_loggers.py",),
        slow=("tests/train/runs/test_training_loggers.py::test_wandb_itself_keeps_every_iteration_in_the_run_folder",),
    ),
    "parquet": Trial(("tests/unit/exporters/test_run_tables.py",)),
    "mcap": Trial(("tests/unit/mcap", "tests/unit/ros2"), ("mcap-ros2-support",)),
    "minari": Trial(("tests/train/datasets",), ("pyarrow",)),
    "lerobot": Trial(("tests/train/datasets",), ("minari",)),
    "crg": Trial(("tests/unit/vehicle/roads/test_open_crg.py",)),
    "fmu": Trial(
        ("tests/cli/test_export_fmu.py",),
        ("fmpy",),
        ("tests/cli/test_export_fmu.py::test_an_fmu_moves_as_a_drive_does",),
    ),
    "fit": Trial(
        slow=(
            "tests/unit/identify/test_fit_laws.py::test_an_evolution_finds_the_same",
            "tests/unit/identify/test_fit_laws.py::test_a_stopped_evolution_goes_on_as_if_it_had_not_stopped",
        )
    ),
    "sweep": Trial(
        ("tests/train/sweeps", "tests/unit/search"),
        slow=("tests/cli/test_sweep.py::test_jobs_of_a_cluster_train_the_same_runs",),
    ),
    "sb3": Trial(
        ("tests/tasks/adapters/test_sb3_adapter.py",),
        ("moviepy",),
        slow=("tests/tasks/adapters/test_sb3_adapter.py::test_ppo_learns",),
    ),
    "skrl": Trial(("tests/tasks/adapters/test_skrl_adapter.py",)),
    "peers": Trial(("tests/cli/test_bench_peers.py",)),
    "docs": Trial(
        slow=("tests/project/test_site.py::test_the_site_builds_without_a_warning_and_has_every_public_name",)
    ),
}


def run_pytest(python: Path, *arguments: str) -> list[ElementTree.Element]:
    """Run tests with an environment's interpreter; their cases.

    Raises:
        ExtraError: pytest did not come to its end.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [str(python), "-m", "pytest", "-q", "-p", "no:cacheprovider", f"--junitxml={report}", *arguments]
        subprocess.run(command, cwd=ROOT, env=trial_environment(python), check=False)
        if not report.is_file():
            raise ExtraError(f"tests did not run to their end: {' '.join(arguments)}")
        return list(ElementTree.parse(report).iter("testcase"))


def run_tests(python: Path, extra: str, arguments: Sequence[str]) -> tuple[int, int, int]:
    """Run the tests of an extra; how many passed, were skipped and failed.

    Raises:
        ExtraError: none passed, or some were skipped for a package that is missing.
    """
    trial, cases = TRIALS[extra], []
    if trial.tests:
        cases += run_pytest(python, "-m", "not slow", *arguments, *trial.tests)
    if trial.slow:
        cases += run_pytest(python, *arguments, *trial.slow)
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
        env = trial_environment(python)
        ended = subprocess.run(
            command, cwd=folder, env=env, capture_output=True, encoding="utf-8", errors="replace", check=False
        )
    if ended.returncode:
        raise ExtraError(f"the wheel's simwarp {' '.join(words)}: {pip_reason(ended.stderr)}")


def try_extra(extra: str, at: str, wheel: Path, folder: Path, arguments: Sequence[str]) -> Outcome:
    """Make the environment of an extra in a folder, and run its tests; a refusal is an outcome, too."""
    began = time.monotonic()
    torch, error = "", ""
    chosen: dict[str, str] = {}
    counts = 0, 0, 0
    try:
        python, torch = make_environment(folder, at)
        versions = install(python, wheel, extra, at, TRIALS[extra].readers)
        if (after := setup_env.installed_torch(python)) != torch:
            raise ExtraError(f"extra '{extra}' at its {at} changed torch from {torch} to {after}")
        chosen = {each.name: versions[canonicalize_name(each.name)] for each in named(extra)}
        print(f"{extra} at its {at}: " + ", ".join(f"{name} {version}" for name, version in chosen.items()), flush=True)
        start(python, extra)
        counts = run_tests(python, extra, arguments)
        if unused := not_imported(python, named(extra)):
            raise ExtraError(f"no test imports {', '.join(unused)}")
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
    parser.add_argument(
        "--folder", type=Path, help="for environments; what they begin with stays there for the next run"
    )
    parser.add_argument("--keep", action="store_true", help="leave the environments of extras in --folder, too")
    parser.add_argument(
        "--json", type=Path, help="file of outcomes: written after each extra; what holds there is left out"
    )
    parser.add_argument("--again", action="store_true", help="try what holds already, too")
    parsed = parser.parse_args(words[:end])
    parsed.pytest = words[end + 1 :]
    if parsed.keep and not parsed.folder:
        parser.error("--keep: name the --folder that they are to stay in")
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
    built: Path | None = None
    try:
        if not (wanted := trials(chosen, kept)):
            return new
        built = Path(tempfile.mkdtemp(dir=folder))
        wheel = chosen.wheel.resolve() if chosen.wheel else own_wheel(built)
        for number, (extra, at) in enumerate(wanted, 1):
            print(f"trial {number} of {len(wanted)}: {extra} at its {at}", flush=True)
            new.append(try_extra(extra, at, wheel, folder / f"{extra}-{at}", chosen.pytest))
            if chosen.json:
                kept = extra_results.merged(kept, new[-1])
                extra_results.write(chosen.json, kept)
            if not chosen.keep:
                shutil.rmtree(folder / f"{extra}-{at}", ignore_errors=True)
    finally:
        if built:
            shutil.rmtree(built, ignore_errors=True)
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
