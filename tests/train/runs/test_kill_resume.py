"""Runs that are killed: no file is torn, little is lost, and going on is exact."""

import os
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from simwarp.core.files import DRAFT_PREFIX
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_folder import latest_run

INTERVAL = 3
OPTIONS = ["--device", "cpu", "--num-envs", "16", "--steps-per-iteration", "4", "--save-interval", str(INTERVAL)]
KILLS = 20


def start(folder, *arguments):
    command = [sys.executable, "-m", "simwarp", "train", "fast", *OPTIONS, *arguments]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(folder, *arguments):
    process = start(folder, *arguments)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err


def newest(folder):
    found = latest_run(folder / "runs", "fast")
    assert found is not None
    return found


def progress(folder):
    """The last iteration in the table; reading it never fails, whatever moment the process died in."""
    found = latest_run(folder / "runs", "fast")
    rows = read_progress(found.progress) if found else []
    return int(rows[-1]["iteration"]) if rows else 0


def wait_until(condition, process):
    deadline = time.monotonic() + 120.0
    while not condition():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline, "nothing happened"
        time.sleep(0.01)


def saved_iteration(folder):
    found = latest_run(folder / "runs", "fast")
    return load_checkpoint(found.latest_checkpoint())["iteration"] if found else 0


def same(left, right):
    """Whether two nested values are equal, bit by bit."""
    if isinstance(left, torch.Tensor):
        return torch.equal(left, right)
    if isinstance(left, dict):
        return left.keys() == right.keys() and all(same(left[key], right[key]) for key in left)
    if isinstance(left, list | tuple):
        return len(left) == len(right) and all(same(*pair) for pair in zip(left, right, strict=True))
    return left == right or (isinstance(left, float) and np.isnan([left, right]).all())


@pytest.mark.slow
def test_killed_runs_lose_at_most_one_interval_and_go_on_exactly(tmp_path):
    chance = random.Random(4)
    for _ in range(KILLS):
        before = saved_iteration(tmp_path)
        resume = ["--resume", str(newest(tmp_path).path)] if before else []
        process = start(tmp_path, "--iterations", "1000000", *resume)
        # Once it is under way, any moment is as good as another: an iteration takes some 10 ms
        wait_until(lambda before=before: saved_iteration(tmp_path) > before, process)
        time.sleep(chance.uniform(0.0, 0.5))
        process.kill()
        process.communicate(timeout=60)
        folder = newest(tmp_path)
        for path in folder.checkpoint_files():
            assert load_checkpoint(path)["iteration"] == int(path.stem.rpartition("_")[2])
        folder.load_config()
        saved = saved_iteration(tmp_path)
        assert saved > before
        assert progress(tmp_path) - saved <= INTERVAL
    _go_on_two_ways(tmp_path)


def _go_on_two_ways(folder):
    """From one checkpoint: ten iterations at once, and ten with a stop and a kill between."""
    base = saved_iteration(folder)
    copies = []
    for name in ("once", "twice"):
        copy = folder / name
        shutil.copytree(newest(folder).path, copy / "runs" / "fast" / "run")
        copies.append(copy)
    once, twice = copies
    run = Path("runs") / "fast" / "run"
    finish(once, "--resume", str(run), "--iterations", str(base + 10))
    finish(twice, "--resume", str(run), "--iterations", str(base + 4))
    process = start(twice, "--resume", str(run), "--iterations", "1000000")
    wait_until(lambda: progress(twice) > base + 5, process)
    process.kill()
    process.communicate(timeout=60)
    # Back to where the stop was: the kill may have come after the tenth iteration
    checkpoints = newest(twice).checkpoint_files()
    for path in checkpoints:
        if load_checkpoint(path)["iteration"] > base + 4:
            path.unlink()
    finish(twice, "--resume", str(run), "--iterations", str(base + 10))
    left, right = (load_checkpoint(newest(copy).latest_checkpoint()) for copy in (once, twice))
    assert left["iteration"] == right["iteration"] == base + 10
    # Only the number that was asked for on the way may differ
    assert [key for key in left if not same(left[key], right[key])] == []
    assert [row["mean_reward"] for row in read_progress(newest(once).progress)] == [
        row["mean_reward"] for row in read_progress(newest(twice).progress)
    ]


def test_a_process_killed_while_it_writes_leaves_the_old_file(tmp_path):
    # A child that stops for ever between the temporary file and its new name, where a kill would hurt most
    script = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from simwarp.train.runs.run_files import write_run_file\n"
        "Path.replace = lambda *_: (print('here', flush=True), time.sleep(60))\n"
        "write_run_file(Path(sys.argv[1]), b'new')\n"
    )
    path = tmp_path / "iteration_000001.pt"
    path.write_bytes(b"old")
    child = subprocess.Popen([sys.executable, "-c", script, str(path)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    assert child.stdout.readline() == "here\n"
    child.kill()
    child.communicate(timeout=30)
    assert path.read_bytes() == b"old"
    left = [name for name in os.listdir(tmp_path) if name != path.name]
    assert len(left) == 1
    assert left[0].startswith(DRAFT_PREFIX)
