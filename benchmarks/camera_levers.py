"""Minutes by the clock until a policy by camera succeeds in nine of ten episodes, for each way to train it.

    python benchmarks/camera_levers.py TASK [--levers ppo,distill] [--seeds 1,2] [--out DIR] [--runs DIR]

Each way is a command, `simwarp train` or `simwarp distill`, that is stopped as soon as the last 256 or more episodes of
the training succeeded in 90 %, exploration included, or when its limit is over. Episodes in which a teacher led do not
count. The clock runs from the start of the command, and of that of the teacher. The policy of that moment is then
evaluated over 256 fresh worlds, off the clock.

Each run leaves one JSON file in --out; what has one is skipped. A table of all of them goes to standard output. For
times that mean something nothing else may run beside it.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import shlex
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.comparing import exit_code
from benchmarks.driving_curves import EPISODES, success, successes_of
from simwarp.bench.machine import describe
from simwarp.cli.sweeping import parse_seeds
from simwarp.core.files import read_json
from simwarp.tasks import InputError, task_class
from simwarp.train.algorithm.distillation import DistillationConfig
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_files import write_json
from simwarp.train.runs.run_folder import RunFolder, git_revision

ROOT = Path(__file__).resolve().parents[1]
SHARE = 0.9
POLL = 0.5
"""Time between two looks at the progress of a run [s]."""


@dataclasses.dataclass(frozen=True)
class Lever:
    """One way to train by camera.

    Attributes:
        label: what it changes.
        options: of the command.
        taught: a student of a policy by exact state, which is trained before, instead of PPO.
    """

    label: str
    options: tuple[str, ...] = ()
    taught: bool = False


DRAWN = ("--network.init-mean",)
"""The mean action at the start is that of the layers as they are drawn: no number is given."""
BFLOAT16 = ("--network.precision", "bfloat16")
SMALL = ("--task.camera-width", "64", "--task.camera-height", "36")
LEVERS: Mapping[str, Lever] = {
    "ppo": Lever("PPO, begins as drawn", DRAWN),
    "ppo-bfloat16": Lever("PPO, convolutions in bfloat16", DRAWN + BFLOAT16),
    "ppo-batch": Lever("PPO, twice the worlds, 2 epochs", (*DRAWN, "--num-envs", "512", "--ppo.epochs", "2")),
    "ppo-small": Lever("PPO, images of 64 x 36", DRAWN + SMALL),
    "ppo-both": Lever("PPO, images of 64 x 36, in bfloat16", DRAWN + SMALL + BFLOAT16),
    "ppo-rate": Lever("PPO, half the frame rate", (*DRAWN, "--task.camera-rate", "HALF")),
    "ppo-repeat": Lever("PPO, every action twice as long", (*DRAWN, "--task.decimation", "TWICE")),
    "start": Lever("PPO that begins by driving (default)"),
    "start-both": Lever("PPO that begins by driving, images of 64 x 36, in bfloat16", SMALL + BFLOAT16),
    "distill": Lever("a teacher's student", taught=True),
    "distill-bfloat16": Lever("student, in bfloat16", BFLOAT16, taught=True),
    "distill-shift": Lever(
        "student, images shifted by up to 4 pixels", ("--distillation.augmentation.shift", "4"), taught=True
    ),
    "distill-small": Lever("student, images of 64 x 36", SMALL, taught=True),
    "distill-both": Lever("student, images of 64 x 36, in bfloat16", SMALL + BFLOAT16, taught=True),
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Case:
    """One run: a task's lever, a seed, and where it goes.

    Attributes:
        task: its name.
        lever: key of :data:`LEVERS`.
        seed: of the training.
        extra: options of the task, for teacher, student and evaluation alike.
        teacher_extra: options of the teacher's training alone.
        runs: folder of the run folders.
        limit: after which it is stopped [s].
    """

    task: str
    lever: str
    seed: int
    extra: tuple[str, ...]
    teacher_extra: tuple[str, ...]
    runs: Path
    limit: float


def options_of(case: Case) -> list[str]:
    """Return the options of a lever, with what depends on the task."""
    usual = task_class(case.task).config_type()
    rate = getattr(usual, "camera_rate", None) or 1.0 / usual.control_dt
    known = {"HALF": f"{0.5 * rate:g}", "TWICE": str(2 * usual.decimation)}
    return [known.get(word, word) for word in LEVERS[case.lever].options]


def program(*words: str) -> list[str]:
    """Return the command line of simwarp in this interpreter."""
    return [sys.executable, "-m", "simwarp", *words]


def reached(folder: Path, reasons: frozenset[str], first: int) -> dict[str, float] | None:
    """Return iteration and environment steps at which nine of ten episodes succeeded; None before that.

    Args:
        folder: of the run.
        reasons: names of the ends that are a success.
        first: iterations that do not count.
    """
    rows = [row for row in read_progress(RunFolder(folder).progress) if int(row["iteration"]) > first]
    for row in rows:
        row["successes"] = str(successes_of(row, reasons))
    if not rows:
        return None
    steps, share = success(rows)
    above = (share >= SHARE).nonzero()[0]
    if not len(above):
        return None
    found = next(row for row in rows if float(row["env_steps"]) == steps[above[0]])
    return {"iteration": int(found["iteration"]), "env_steps": float(found["env_steps"])}


def newest(folder: Path) -> Path | None:
    """Return the newest run in a folder of runs; None where there is none."""
    found = sorted(path for path in folder.glob("*/") if (path / "config.json").is_file())
    return found[-1] if found else None


def stopped_at(command: Sequence[str], runs: Path, case: Case, first: int) -> dict[str, Any]:
    """Run a training until it is good enough; return what was reached, after how long [s], and its folder."""
    reasons = task_class(case.task).success_reasons
    before = newest(runs / case.task)
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
        begun = time.monotonic()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=errors)
        found, folder, code = None, None, None
        try:
            while (code := process.poll()) is None and found is None and time.monotonic() - begun < case.limit:
                time.sleep(POLL)
                folder = newest(runs / case.task)
                found = reached(folder, reasons, first) if folder is not None and folder != before else None
            taken = time.monotonic() - begun
        finally:
            process.terminate()
            process.wait()
        errors.seek(0)
        said = errors.read().strip()[-300:]
    if folder is None or folder == before:
        raise InputError(f"{shlex.join(command)} began no run: {said}")
    if code:
        raise InputError(f"{shlex.join(command)} ended with exit code {code}: {said}")
    found = found or reached(folder, reasons, first)
    return {"seconds": round(taken, 1), "reached": found, "run": folder}


def teacher_of(case: Case) -> tuple[Path, float]:
    """Return the run of the teacher of a seed, trained by PPO with the task's defaults, and what it took [s]."""
    runs = case.runs / f"teacher-{case.seed}"
    record = runs / f"{case.task}.json"
    if not record.is_file():
        begun = time.monotonic()
        subprocess.run(
            program("train", case.task, "--obs", "state", "--seed", str(case.seed), "--runs", str(runs), *case.extra,
                    *case.teacher_extra),
            check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        write_json(record, {"seconds": time.monotonic() - begun, **asked_of(case)})
    check_result(record, case)
    folder = newest(runs / case.task)
    assert folder is not None
    return folder, float(read_json(record, "teacher")["seconds"])


def asked_of(case: Case) -> dict[str, Any]:
    """Return what a result hangs on besides its command: results of another limit, or teacher, are not comparable."""
    return {
        "limit_s": case.limit, "extra": shlex.join(case.extra), "teacher_extra": shlex.join(case.teacher_extra)
    }  # fmt: skip


def check_result(path: Path, case: Case) -> None:
    """Hold a result that is there to what is asked for; older ones do not say what they hang on.

    Raises:
        InputError: it was measured otherwise.
    """
    there = read_json(path, "result")
    for key, now in asked_of(case).items():
        if there.get(key, now) != now:
            raise InputError(f"{path} was measured with {key} {there[key]!r}, not {now!r}: give another --out")


def measure(case: Case) -> dict[str, Any]:
    """Train one case until it is good enough; return its result."""
    lever, runs = LEVERS[case.lever], case.runs / f"{case.lever}-{case.seed}"
    common = ["--seed", str(case.seed), "--runs", str(runs), *case.extra, *options_of(case)]
    teaching, first = 0.0, 0
    if lever.taught:
        teacher, teaching = teacher_of(case)
        first = DistillationConfig().guided
        command = program("distill", case.task, "--teacher", str(teacher), *common)
    else:
        command = program("train", case.task, "--obs", "camera", *common)
    found = stopped_at(command, runs, case, first)
    evaluated = runs / "evaluation.json"
    subprocess.run(
        program("eval", case.task, "--obs", "camera", "--checkpoint", str(found["run"]), "--episodes", str(EPISODES),
                "--no-baselines", "--json", str(evaluated)),
        check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    return {
        "task": case.task,
        "lever": case.lever,
        "seed": case.seed,
        "command": shlex.join(["simwarp", *command[3:]]),
        **asked_of(case),
        "teacher_s": round(teaching, 1),
        "seconds": round(teaching + found["seconds"], 1),
        "reached": found["reached"],
        "success_rate": read_json(evaluated, "evaluation")["success_rate"],
        "revision": git_revision().get("revision"),
        "machine": describe(wp.get_device("cpu")),
    }


def table(results: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of all results, in Markdown."""
    lines = ["| task | way | seeds | min, until 90 % | environment steps | success then |", "|---|---|---|---|---|---|"]
    for task, name in dict.fromkeys((result["task"], result["lever"]) for result in results):
        found = [result for result in results if (result["task"], result["lever"]) == (task, name)]
        times = ", ".join(
            f"{result['seconds'] / 60:.1f}" if result["reached"] else f"not in {result['seconds'] / 60:.1f}"
            for result in found
        )
        steps = [result["reached"]["env_steps"] for result in found if result["reached"]]
        rates = ", ".join(f"{100 * result['success_rate']:.1f} %" for result in found)
        middle = f"{statistics.mean(steps):,.0f}".replace(",", " ") if steps else ""
        seeds = ", ".join(str(result["seed"]) for result in found)
        lines.append(f"| `{task}` | {LEVERS[name].label} | {seeds} | {times} | {middle} | {rates} |")
    return "\n".join(lines)


def main() -> int:
    """Do the runs that are missing, and report all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task")
    parser.add_argument("--levers", default=",".join(LEVERS), help=f"by comma, of {', '.join(LEVERS)}")
    parser.add_argument("--seeds", default="1,2", help="by comma")
    parser.add_argument("--limit", type=float, default=1800.0, help="seconds after which a training is stopped")
    parser.add_argument("--extra", default="", help="options of the task, for all")
    parser.add_argument("--teacher-extra", default="", help="options of the teacher's training")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks" / "results" / "driving" / "levers")
    parser.add_argument("--runs", type=Path, default=Path("runs") / "levers")
    options = parser.parse_args()
    wanted = [word for word in options.levers.split(",") if word]
    unknown = [word for word in wanted if word not in LEVERS]
    if unknown:
        parser.error(f"--levers must be of {', '.join(LEVERS)}, got {unknown[0]}")
    task_class(options.task)
    seeds = parse_seeds(options.seeds)
    extra, teaching = (tuple(shlex.split(text)) for text in (options.extra, options.teacher_extra))
    options.out.mkdir(parents=True, exist_ok=True)  # before hours of training, not after
    for seed in seeds:
        for name in wanted:
            path = options.out / f"{options.task}.{name}-{seed}.json"
            case = Case(options.task, name, seed, extra, teaching, options.runs, options.limit)
            if path.is_file():
                check_result(path, case)
                continue
            result = measure(case)
            write_json(path, result)
            print(json.dumps({key: result[key] for key in ("lever", "seed", "seconds", "reached", "success_rate")}),
                  file=sys.stderr, flush=True)  # fmt: skip
    print(table([read_json(path, "result") for path in sorted(options.out.glob("*.json"))]))
    return 0


if __name__ == "__main__":
    sys.exit(exit_code("camera_levers", main))
