"""Commands of the pages, made short enough to run: which options, and which commands are not run, and why."""

from __future__ import annotations

import importlib.util
import re
import shlex
from pathlib import Path

SHORT: dict[str, dict[str, str]] = {
    "train": {"--iterations": "2", "--num-envs": "4", "--steps-per-iteration": "8", "--task.max-episode-steps": "20"},
    "distill": {"--iterations": "2", "--num-envs": "4", "--steps-per-iteration": "8", "--task.max-episode-steps": "20"},
    "sweep": {"--iterations": "1", "--num-envs": "4", "--steps-per-iteration": "8", "--seeds": "0"},
    "eval": {"--episodes": "2", "--task.max-episode-steps": "20"},
    "play": {"--seconds": "0.2"},
    "view": {"--record": "view.html", "--seconds": "0.2", "--worlds": "1"},
    "record": {"--episodes": "2", "--task.max-episode-steps": "20"},
    "clone": {"--epochs": "1"},
    "drive": {"--dt": "0.003"},
    "bench": {"--seconds": "0.02", "--worlds": "1"},
}
"""Options that replace those of a command, or are added to it."""
LEFT_OUT = {"view": ("--drive", "--reload", "--keys", "--record-trajectories"), "bench": ("--threads", "--peers")}
"""Options without which a command is run: they wait for a person, or for a library that is not installed everywhere."""
OTHERS = {
    ("train", "--resume"): {"--iterations": "3"},  # what the run has, and some more
    ("sweep", "--search"): {"--trials": "2"},
    ("drive", "soil-rigid"): {"--spacing": "0.1"},
    ("drive", "step-steer"): {"--duration": "15.1"},  # it steers at 15 s
    ("drive", "--speeds"): {"--speeds": "12,15"},
    ("drive", "--vary"): {"--worlds": "3", "--worst": "1", "--worst-film": "png"},
    ("drive", "--search"): {"--trials": "2", "--speeds": "14,15"},
    ("drive", "drawbar"): {"--duration": "5.5"},  # it pulls from 5 s on
}
"""Further options, where a command has words that ask for them."""
NAMED_RUN = "2026-01-31_12-00-00"
"""Of the run folders that pages name."""
VALUES = 2
"""Of a key of a grid: the first ones are run."""

NOT_RUN = {
    r"simwarp sweep .*--launcher slurm": "needs a cluster",
    r"simwarp doctor --gpu": "needs a CUDA device",
    r"simwarp ros2": "needs a running ROS 2; tests/unit/ros2/test_rclpy_node.py runs where it is present",
    r"simwarp drive .*--view": "serves a page until it is closed; `view --drive` is the same page",
    r"simwarp (train|eval|play|distill|view) (my-robot|my-quadruped|my-go2)": (
        "a package that was installed by pip; tests/cli/test_cli_new_task.py installs and trains one"
    ),
    r"simwarp drive .*road\.json": "the reader's own bitmaps; tests/cli/test_drive_roads.py has such",
    r"simwarp fit (?!--list)": "the reader's own logs; tests/cli/test_fit.py fits some",
    r"simwarp train my_task\.py": "the reader's own files; tests/train/networks/test_any_observations.py has such",
    r"simwarp \w+ mine\.py": "needs Go2's own MJCF file, which its reader downloads",
    r"simwarp (replay|view) \S*broken\.npz": "needs a world that broke down; test_cli_new_task.py replays one",
    r"simwarp (clone|train) hallway .*(driven\.npz|cloned\.pt)": "needs a person who drove: test_drive_and_clone.py",
    r"simwarp (clone|distill) off-road .*governed\.(npz|pt)": "needs what benchmarks/off_road_teacher.py records",
    r"(?!simwarp)": "other programs: scripts of benchmarks have tests in tests/benchmarks, examples in test_docs.py",
}
"""Commands that are parsed and not run, as patterns of how they begin -> why."""
NEEDS = {
    r"simwarp (sweep|drive) .*--search": "optuna", r"simwarp view|simwarp .*--(html|film)": "viser",
    r"simwarp .*\.parquet": "pyarrow", r"simwarp .*\.mcap": "rosbags",
    r"simwarp record .*--format minari": "minari", r"simwarp record .*--format lerobot": "pyarrow",
}  # fmt: skip
"""Commands that are run only where an extra is installed, as patterns of how they begin -> its module."""


def reason(words: list[str]) -> str | None:
    """Return why a command is not run; None if it is."""
    text = shlex.join(words)
    return next((why for pattern, why in NOT_RUN.items() if re.match(pattern, text)), None)


def lacks(words: list[str]) -> str | None:
    """Return the module that a command needs and that is not installed; None if all are there."""
    text = shlex.join(words)
    needed = (module for pattern, module in NEEDS.items() if re.match(pattern, text))
    return next((module for module in needed if importlib.util.find_spec(module) is None), None)


def shortened(words: list[str]) -> list[str]:
    """Return a command of `simwarp` with options by which it takes seconds."""
    command, text = words[1], shlex.join(words)
    wanted = dict(SHORT.get(command, {}))
    for (name, part), options in OTHERS.items():
        if name == command and part in text:
            wanted |= options
    if "--help" in words:
        return words
    kept = _without(words, {*wanted, *LEFT_OUT.get(command, ())})
    found = [_fewer(word) if before == "--grid" else word for before, word in zip(["", *kept], kept, strict=False)]
    return [*found, *(word for option in wanted.items() for word in option)]


def _without(words: list[str], options: set[str]) -> list[str]:
    """Return words without some options and their values."""
    kept, dropping = [], False
    for word in words:
        if word.startswith("--"):
            dropping = word in options
        if not dropping:
            kept.append(word)
    return kept


def _fewer(grid: str) -> str:
    key, equals, values = grid.partition("=")
    return f"{key}{equals}{','.join(values.split(',')[:VALUES])}"


def program(commands: list[list[str]], report: Path) -> str:
    """Return Python that runs commands one after the other in one process, and writes their exit codes to a file.

    A run that one of them trains takes the place of the run that the pages name: its reader reads the date of theirs.
    """
    return f"""
import json, pathlib, shutil, time
from simwarp import cli

codes = []
for words in {commands!r}:
    print("$", *words, flush=True)
    start = time.perf_counter()
    before = set(pathlib.Path("runs").glob("*/*"))
    code = cli.main(words[1:])
    codes.append((words, code, time.perf_counter() - start))
    for run in set(pathlib.Path("runs").glob("*/*")) - before if words[1] == "train" else ():
        named = run.with_name({NAMED_RUN!r})
        if named.exists():
            shutil.rmtree(named)
            shutil.copytree(run, named)
    pathlib.Path({str(report)!r}).write_text(json.dumps(codes))
"""
