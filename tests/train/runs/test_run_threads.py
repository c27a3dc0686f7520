"""A run on two threads that fails or is interrupted leaves no thread behind, and its process ends."""

from __future__ import annotations

import gc
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from simwarp.tasks import replace_fields, task_class
from simwarp.train.algorithm import mini_batch_shares
from simwarp.train.config import default_config
from simwarp.train.runs.run_folder import latest_run
from simwarp.train.runs.training import train

STEPS = 16
LAST_WORDS = 60.0
"""Time in which a process that was interrupted ends, also where other tests have the processors [s]."""


def own_threads() -> set[str]:
    return {thread.name.rpartition("_")[0] for thread in threading.enumerate() if thread.name.startswith("simwarp")}


def no_thread_is_left() -> bool:
    gc.collect()
    for _ in range(100):  # those of the simulation end on their own, soon
        if not own_threads():
            return True
        time.sleep(0.02)
    return False


class Sand(Exception):
    """In the works."""


@pytest.mark.quick("apply", "reset")
@pytest.mark.parametrize("hook", ["apply", "begin_step", "observations", "rewards", "terminations", "reset", "metrics"])
def test_what_a_hook_raises_ends_the_threads(hook, tmp_path, monkeypatch):
    monkeypatch.setattr(mini_batch_shares, "LEAST_NUMBERS", 8)  # mini-batches this small are shared among threads too
    kind: Any = task_class("pendulum")
    begun: list[set[str]] = []
    hooked = getattr(kind, hook)

    def hindered(task: Any, *arguments: Any) -> Any:
        if task.iteration >= 2:
            begun.append(own_threads())
            raise Sand
        return hooked(task, *arguments)

    monkeypatch.setattr(kind, hook, hindered)
    settings = {"num_envs": 8, "steps_per_iteration": STEPS, "iterations": 4, "device": "cpu", "threads": 2}
    config = replace_fields(default_config(kind), settings)
    assert no_thread_is_left()
    with pytest.raises(Sand):
        # two episodes in an iteration: resets are among what happens in it
        train(
            "pendulum",
            config,
            kind.config_type(max_episode_steps=STEPS // 2),
            root=tmp_path,
            console=Console(quiet=True),
        )
    assert begun == [{"simwarp", "simwarp-learner"}]  # those that step worlds, and those that learn
    assert no_thread_is_left()


INTERRUPTED = """
import gc, os, signal, sys, threading, time
from pathlib import Path
from rich.console import Console
from simwarp.tasks import replace_fields, task_class
from simwarp.train.config import default_config
from simwarp.train.runs.training import train

kind, root, times = task_class("pendulum"), Path(sys.argv[1]), int(sys.argv[2])
steps, reached = [0], {150: threading.Event(), 160: threading.Event()}  # in the middle of the third iteration
rewards = kind.rewards

def counted(task):
    steps[0] += 1
    if steps[0] in reached:
        reached[steps[0]].set()
    return rewards(task)

def interrupt():
    for step in (150, 160)[:times]:
        reached[step].wait()
        os.kill(os.getpid(), signal.SIGINT)

kind.rewards = counted
threading.Thread(target=interrupt, daemon=True).start()
settings = {"num_envs": 16, "steps_per_iteration": 64, "iterations": 100000, "device": "cpu", "threads": 2}
try:
    result = train("pendulum", replace_fields(default_config(kind), settings), kind.config_type(), root=root,
                   console=Console(quiet=True))
    print("saved", result.interrupted)
except KeyboardInterrupt:
    print("at once")
gc.collect()
for _ in range(100):
    left = [thread.name for thread in threading.enumerate() if thread.name.startswith("simwarp")]
    if not left:
        break
    time.sleep(0.02)
print(left)
"""


@pytest.mark.parametrize(("times", "how"), [(1, "saved True"), (2, "saved True")])
@pytest.mark.slow
def test_ctrl_c_in_the_middle_of_a_run_ends_the_threads(times, how, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, str(tmp_path), str(times)], capture_output=True, text=True,
        timeout=2.0 * LAST_WORDS,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-2:] == [how, "[]"]
    assert "Traceback" not in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("times", [1, 2])
def test_the_command_ends_cleanly(times, tmp_path):
    arguments = ["train", "pendulum", "--device", "cpu", "--num-envs", "16", "--threads", "2", "--iterations", "100000"]
    process = subprocess.Popen(
        [sys.executable, "-m", "simwarp", *arguments, "--save-interval", "2", "--steps-per-iteration", "100"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        folder = wait_for_checkpoint(tmp_path)
        for _ in range(times):
            process.send_signal(signal.SIGINT)
            time.sleep(0.05)
        out, err = process.communicate(timeout=LAST_WORDS)
    finally:
        process.kill()
    assert process.returncode == 130, err
    assert "Traceback" not in err
    assert "interrupted" in out + err
    assert "interrupted and saved" in out  # the second one is a copy
    assert not [file for file in folder.rglob("*") if file.suffix in (".tmp", ".draft")]


def wait_for_checkpoint(root: Path) -> Path:
    """The folder of a run once it has saved."""
    for _ in range(int(120.0 / 0.02)):
        folder = latest_run(root / "runs", "pendulum") if (root / "runs").exists() else None
        if folder is not None and folder.checkpoint_files():
            return folder.path
        time.sleep(0.02)
    raise AssertionError("no checkpoint appeared")
