"""What the seed decides: success of one task's final policies, trained with several seeds and nothing else changed.

    simwarp sweep hallway --obs state --seeds 0-4
    python benchmarks/seeds.py runs/sweeps/hallway-...          # or the sweeps of several tasks
    python benchmarks/seeds.py --report-only                    # the table, from what is there

Every run of a sweep that was trained to its end is evaluated over the same fresh worlds, with its own task's settings.
The numbers go to benchmarks/results/seeds/TASK.OBS.json, those of each seed as it is known: a policy that is there,
with as many episodes, is not evaluated again. Two runs of one task and seed are refused. A table of all is printed.
"""

from __future__ import annotations

import argparse
import statistics
import sys
from pathlib import Path
from typing import Any, Final

import torch
import warp as wp

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.comparing import exit_code  # noqa: E402
from benchmarks.robustness_points import digest_of  # noqa: E402
from simwarp.bench.machine import describe  # noqa: E402
from simwarp.core.files import read_json  # noqa: E402
from simwarp.core.warp_start import start_warp  # noqa: E402
from simwarp.tasks import InputError, make, task_class  # noqa: E402
from simwarp.train.config import task_config_from_plain  # noqa: E402
from simwarp.train.evaluation.evaluation import evaluate  # noqa: E402
from simwarp.train.networks.policies import find_policy  # noqa: E402
from simwarp.train.runs.progress_table import read_progress, seconds_trained  # noqa: E402
from simwarp.train.runs.run_files import write_json  # noqa: E402
from simwarp.train.runs.run_folder import git_revision, open_run  # noqa: E402

RESULTS: Final = ROOT / "benchmarks" / "results" / "seeds"
SEED: Final = 1_000_003
EPISODES: Final = 256


def result_of(folder: Path, known: dict[str, Any], episodes: int) -> tuple[str, str, dict[str, Any]] | None:
    """Evaluate the final policy of a run.

    Args:
        folder: of the run.
        known: results that are there, by TASK.OBS and seed.
        episodes: that are driven.

    Returns:
        TASK.OBS, the seed and its result; None for a run that is not at its end.
    """
    run = open_run(folder)
    config = run.load_config()
    train = config["train_config"]
    rows = read_progress(run.progress)
    if not rows or int(rows[-1]["iteration"]) < train["iterations"]:
        return None
    source = find_policy(config["task"], folder)
    name, plain = source.content["task"], source.content["task_config"]
    key, seed, steps = f"{name}.{plain.get('obs', 'state')}", str(train["seed"]), int(float(rows[-1]["env_steps"]))
    found, digest = known.get(key, {}).get(seed), digest_of(source)
    if found and (found["episodes"], found.get("policy")) == (episodes, digest):
        return key, seed, found
    task: Any = make(name, episodes, device="cpu", seed=SEED, config=task_config_from_plain(task_class(name), plain))
    evaluation = evaluate(task, source.policy(task), episodes, SEED)
    return key, seed, {
        **evaluation.as_json(), "policy": digest, "env_steps": steps, "train_s": round(seconds_trained(rows), 1),
        "num_envs": train["num_envs"], "revision": git_revision().get("revision"),
        "machine": describe(wp.get_device("cpu")),
    }  # fmt: skip


def runs_in(folder: Path) -> list[Path]:
    """Return the runs of a sweep."""
    found = sorted(path.parent for path in folder.glob("*/config.json"))
    if not found:
        raise InputError(f"{folder} holds no runs: give the folder of a sweep, such as runs/sweeps/hallway-1a2b3c4d")
    return found


def load() -> dict[str, dict[str, Any]]:
    """Return the results that are there, by TASK.OBS and seed."""
    return {path.stem: read_json(path, "results") for path in sorted(RESULTS.glob("*.json"))}


def table(known: dict[str, dict[str, Any]]) -> str:
    """Return the table of all tasks, in Markdown."""
    lines = [
        "| task | environment steps | success of seeds | median | worst | core-minutes of training |",
        "|---|---|---|---|---|---|",
    ]
    for key, seeds in known.items():
        name, _, obs = key.partition(".")
        rows = [seeds[seed] for seed in sorted(seeds, key=int)]
        rates = [100.0 * row["success_rate"] for row in rows]
        minutes = [row["train_s"] / 60.0 for row in rows]
        steps = f"{rows[0]['env_steps']:,}".replace(",", " ")
        lines.append(
            f"| `{name}`, {obs} | {steps} | {', '.join(f'{rate:.1f}' for rate in rates)} % |"
            f" {statistics.median(rates):.1f} % | {min(rates):.1f} % | {min(minutes):.1f} to {max(minutes):.1f} |"
        )
    return "\n".join(lines)


def main() -> int:
    """Evaluate what is not there yet, and report all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sweeps", nargs="*", type=Path, help="folders of sweeps over seeds")
    parser.add_argument("--episodes", type=int, default=EPISODES, help="of each policy")
    parser.add_argument("--report-only", action="store_true", help="evaluate nothing")
    options = parser.parse_args()
    known = load()
    if not options.report_only:
        start_warp()
        torch.set_num_threads(1)
        RESULTS.mkdir(parents=True, exist_ok=True)
        folders = [run for sweep in options.sweeps for run in runs_in(sweep)]
        taken: dict[tuple[str, str], Path] = {}
        for folder in folders:
            result = result_of(folder, known, options.episodes)
            if result is None:
                print(f"{folder} is not at its end: left out", file=sys.stderr)
                continue
            key, seed, content = result
            if (other := taken.setdefault((key, seed), folder)) != folder:
                parser.error(f"{folder} and {other} are both {key} of seed {seed}: give the sweep of one setting")
            known.setdefault(key, {})[seed] = content
            write_json(RESULTS / f"{key}.json", dict(sorted(known[key].items())))
            print(f"{key} seed {seed}: {100 * content['success_rate']:.1f} %", file=sys.stderr, flush=True)
    print(table(known))
    return 0


if __name__ == "__main__":
    sys.exit(exit_code("seeds", main))
