"""A policy that was trained here, in MuJoCo C: exported to ONNX, and run on the same robot and ground.

    python benchmarks/walk_in_mujoco.py hexapod
    python benchmarks/walk_in_mujoco.py quadruped-velocity --checkpoint runs/quadruped-velocity/NAME --film walk.mp4

The robot and the ground are written as MJCF from the task's own model; MuJoCo's state is read by the task's own code,
so that observations, commands, resets and the reasons to end are the same. The same episodes are run in both
simulators, by the same ONNX file. Writes benchmarks/results/mujoco/TASK.json, and prints both. Exit code 1 where MuJoCo
misses a bound.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import torch

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from simwarp.bench.machine import describe  # noqa: E402
from simwarp.core.files import write_file  # noqa: E402
from simwarp.core.warp_start import start_warp  # noqa: E402
from simwarp.exporters import mjcf_of  # noqa: E402
from simwarp.statistics.proportions import wilson_interval  # noqa: E402
from simwarp.tasks import NON_FINITE, Task, make, task_class  # noqa: E402
from simwarp.tasks.adapters.in_mujoco import SOFTNESS, STEPS, put_in_mujoco  # noqa: E402
from simwarp.train.config import task_config_from_plain  # noqa: E402
from simwarp.train.evaluation.evaluation import Evaluation, evaluate  # noqa: E402
from simwarp.train.evaluation.filming import Film, FilmOptions  # noqa: E402
from simwarp.train.evaluation.play import Frame, check_video_path, record, write_video  # noqa: E402
from simwarp.train.networks.export import Export, ExportFormat, export_policy, load_exported  # noqa: E402
from simwarp.train.networks.policies import find_policy  # noqa: E402
from simwarp.train.runs.run_files import write_json  # noqa: E402

RESULTS: Final = ROOT / "benchmarks" / "results" / "mujoco"
SEED: Final = 1_000_003
EPISODES: Final = 64
SIMULATORS: Final = ("simwarp", "mujoco")
STANDING: Final = 0.8
"""Share of episodes without a fall that a transfer has to reach."""
BOUNDS: Final = {"speed_error": 1.5 * 0.25, "turn_error": 1.5 * 0.2}
"""Largest mean errors of a transfer, of tasks that have such metrics [m/s, rad/s]."""


class OnnxPolicy:
    """An exported policy: observation groups in, actions out.

    Args:
        path: of the file.
        export: what is told of it.
    """

    def __init__(self, path: Path, export: Export) -> None:
        self._run = load_exported(path, ExportFormat.ONNX)
        self._groups = [name for name in export.inputs if not name.startswith("memory_")]
        if export.recurrent:
            raise SystemExit("a recurrent policy keeps a memory, which this script does not; take a feed-forward one")

    def __call__(self, observations: Mapping[str, torch.Tensor]) -> torch.Tensor:
        """Return (W, A) actions."""
        return self._run(*(observations[name].contiguous() for name in self._groups))[0]


def standing_share(task: Task[Any], result: Evaluation) -> tuple[int, tuple[float, float]]:
    """Episodes that no failure ended, and the interval of their share at 95 %."""
    failures = {NON_FINITE, *task.terminations()}  # time limits and other truncations are none
    fallen = sum(count for reason, count in result.end_reasons.items() if reason in failures)
    standing = result.episodes - fallen
    return standing, wilson_interval(standing, result.episodes)


def made_task(name: str, config: Any, simulator: str, worlds: int, there: Mapping[str, Any]) -> Task[Any]:
    """The task, in one of both simulators."""
    task = make(name, worlds, device="cpu", seed=SEED, config=config)
    if simulator == "mujoco":
        put_in_mujoco(task, **there)
    return task


def film_of(
    name: str, config: Any, policy: OnnxPolicy, path: Path, seconds: float, there: Mapping[str, Any]
) -> None:  # fmt: skip
    """Film the first four worlds in MuJoCo."""
    task = made_task(name, config, "mujoco", 4, there)
    film = Film(task, True, FilmOptions())
    frames: list[Frame] = []
    record(task, policy, seconds, SEED, film, None, frames)
    write_video(path, frames, f"{name} in MuJoCo", film.worlds)


def report(rows: Mapping[str, Mapping[str, Any]]) -> None:
    """Print both rows beside each other."""
    keys = [key for key, value in rows["mujoco"].items() if isinstance(value, int | float)]
    print(f"{'':<28}{'simwarp':>12}{'mujoco':>12}")
    for key in keys:
        print(f"{key:<28}{rows['simwarp'][key]:>12.4g}{rows['mujoco'][key]:>12.4g}")
    for simulator, row in rows.items():
        print(f"{simulator}: ended by {row['end_reasons']}, without a fall {row['standing_ci95']}")


def verdict(row: Mapping[str, Any]) -> dict[str, bool]:
    """Which of the bounds hold in MuJoCo."""
    held = {"standing": row["standing_share"] >= STANDING}
    return held | {name: row[name] <= most for name, most in BOUNDS.items() if name in row}


def measured(
    simulator: str, name: str, config: Any, policy: OnnxPolicy, episodes: int, there: Mapping[str, Any]
) -> dict[str, Any]:  # fmt: skip
    """The row of a simulator."""
    task = made_task(name, config, simulator, episodes, there)
    began = time.perf_counter()
    result = evaluate(task, policy, episodes, SEED)
    standing, interval = standing_share(task, result)
    return {
        **result.as_json(), "standing_share": standing / episodes, "standing_ci95": list(interval),
        "wall_s": time.perf_counter() - began,
    }  # fmt: skip


def parsed() -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task")
    parser.add_argument("--checkpoint", type=Path, help="run folder or checkpoint; by default as `simwarp eval`")
    parser.add_argument("--episodes", type=int, default=EPISODES)
    parser.add_argument("--mujoco-steps", type=int, default=STEPS, help="of MuJoCo in one sub-step of the task")
    parser.add_argument("--softness", type=float, default=SOFTNESS, help="time constant of MuJoCo's contacts [s]")
    parser.add_argument("--mjcf", type=Path, help="file for the robot and the ground of world 0")
    parser.add_argument("--film", type=Path, help="film of four worlds in MuJoCo")
    parser.add_argument("--seconds", type=float, default=10.0, help="length of the film")
    parser.add_argument("--out", type=Path, default=RESULTS)
    return parser.parse_args()


def main() -> int:
    options = parsed()
    start_warp()
    torch.set_num_threads(1)
    if options.film is not None:
        check_video_path(options.film)
    source = find_policy(options.task, options.checkpoint)
    config = task_config_from_plain(task_class(options.task), source.content["task_config"])
    task = make(options.task, 1, device="cpu", seed=SEED, config=config)
    there = {"steps": options.mujoco_steps, "softness": options.softness}
    timestep = config.dt / config.substeps / options.mujoco_steps
    written = mjcf_of(task.simulation.model, timestep=timestep, softness=options.softness)
    if options.mjcf is not None:
        write_file(options.mjcf, written.text)
    with tempfile.TemporaryDirectory() as folder:
        onnx = Path(folder) / "policy.onnx"
        policy = OnnxPolicy(onnx, export_policy(source.path, ExportFormat.ONNX, onnx))
        work = (options.task, config, policy, options.episodes, there)
        rows = {simulator: measured(simulator, *work) for simulator in SIMULATORS}
        if options.film is not None:
            film_of(options.task, config, policy, options.film, options.seconds, there)
    report(rows)
    held = verdict(rows["mujoco"])
    print("bounds: " + ", ".join(f"{name} {'held' if good else 'missed'}" for name, good in held.items()))
    options.out.mkdir(parents=True, exist_ok=True)
    write_json(options.out / f"{options.task}.json", {
        "task": options.task, "policy": options.checkpoint or source.origin, "seed": SEED, "in_mujoco": there,
        "left_out": list(written.notes), "held": held, **rows, "machine": describe(task.simulation.model.device),
    })  # fmt: skip
    return 0 if all(held.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
