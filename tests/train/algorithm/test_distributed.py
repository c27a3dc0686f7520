"""Two processes train one policy: their parameters stay equal, and a run of two goes on exactly."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from simwarp.tasks import InputError
from simwarp.train.algorithm.distributed import Processes, processes
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_folder import RunFolder, latest_run

WORKER = """
import sys, torch, warp as wp
from pathlib import Path
from rich.console import Console
from simwarp.tasks import replace_fields, task_class
from simwarp.train.algorithm import mini_batch_shares
from simwarp.train.runs import training
from simwarp.train.config import Objective, default_config
from simwarp.train.algorithm.distributed import processes
from simwarp.train.runs.run_saver import RunSaver

out, *phases = sys.argv[1:]
rank = processes().rank
seen = []
write = RunSaver._write

def save(self):
    trainer, lock = self.trainer, self.lock
    assert (lock is not None and lock.is_own()) == (rank == 0)  # the first process holds the run
    modules = (trainer.algorithm.actor, trainer.algorithm.critic)
    state = {f"{i} {k}": v.clone() for i, m in enumerate(modules) for k, v in m.state_dict().items()}
    state["position"] = trainer.task.position.clone()
    seen.append((trainer.iteration, trainer.algorithm.learning_rate, state))
    return write(self)

RunSaver._write = save
mini_batch_shares.LEAST_NUMBERS = 8  # mini-batches this small are shared among threads too
task = task_class("fast")
runs = {}
for phase in phases:  # NAME:OBJECTIVE:ITERATIONS:THREADS, a name seen before is resumed
    name, objective, iterations, threads = phase.split(":")
    config = replace_fields(default_config(task), {
        "num_envs": 8, "iterations": int(iterations), "steps_per_iteration": 8, "device": "cpu", "save_interval": 1,
        "ppo.objective": Objective(objective), "threads": int(threads),
    })
    result = training.train(
        "fast", config, task.config_type(max_episode_steps=12), root=Path(out) / name, resume=runs.get(name),
        console=Console(quiet=rank > 0),
    )
    runs[name] = Path(result.run)
    assert result.env_steps == int(iterations) * 8 * 8 * processes().count
torch.save(seen, Path(out) / f"rank{rank}.pt")
"""


def torchrun(*arguments, cwd, count=2):
    environment = {k: v for k, v in os.environ.items() if k not in ("RANK", "WORLD_SIZE", "LOCAL_RANK")}
    environment |= {"OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", str(count)]
    return subprocess.run([*command, *arguments], cwd=cwd, capture_output=True, text=True, timeout=120, env=environment)


@pytest.mark.slow
def test_both_ranks_have_the_same_parameters_and_go_on_exactly(tmp_path):
    (tmp_path / "worker.py").write_text(WORKER, encoding="utf-8")
    phases = ["whole:clip:4:1", "part:clip:2:1", "part:clip:4:1", "kl:kl-penalty:3:1"]
    phases += ["shared:clip:2:2", "shared:clip:3:2", "shared-kl:kl-penalty:2:3"]
    done = torchrun("worker.py", str(tmp_path), *phases, cwd=tmp_path)
    assert done.returncode == 0, done.stderr[-4000:]
    first, second = (torch.load(tmp_path / f"rank{rank}.pt") for rank in (0, 1))
    assert [entry[0] for entry in first] == [1, 2, 3, 4, 1, 2, 3, 4, 1, 2, 3, 1, 2, 3, 1, 2]
    for (_, rate, mine), (_, other_rate, other) in zip(first, second, strict=True):
        assert rate == other_rate
        assert all(torch.equal(mine[name], other[name]) for name in mine if name != "position")
        # The worlds of the second process are worlds 8 to 15 of the batch
        assert not torch.equal(mine["position"], other["position"])
    for rank in (first, second):
        assert all(torch.equal(rank[3][2][name], rank[7][2][name]) for name in rank[3][2])
    folder = latest_run(tmp_path / "whole", "fast")
    assert folder is not None
    assert not (folder.path / "writer.json").exists()
    assert len(list((tmp_path / "whole" / "fast").iterdir())) == 1
    rows = read_progress(folder.progress)
    assert [int(row["env_steps"]) for row in rows] == [128, 256, 384, 512]
    # 16 worlds whose clocks were spread over 12 steps: 32 steps end some 40 episodes, of both processes
    assert 32 <= sum(float(row["episodes"]) for row in rows) <= 48
    content = load_checkpoint(folder.latest_checkpoint())
    assert len(content["other_processes"]) == 1
    assert not torch.equal(content["worlds"]["extra"]["position"],
                           content["other_processes"][0]["worlds"]["extra"]["position"])  # fmt: skip


@pytest.mark.slow
def test_the_command_under_torchrun_speaks_once_and_can_be_resumed_alone(tmp_path):
    options = ["-m", "simwarp", "train", "fast", "--device", "cpu", "--num-envs", "8", "--steps-per-iteration", "8"]
    done = torchrun(*options, "--iterations", "3", "--json", "out.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stdout.count("done after 3 iterations") == 1
    folder = latest_run(tmp_path / "runs", "fast")
    assert isinstance(folder, RunFolder)
    alone = subprocess.run(
        [sys.executable, *options, "--iterations", "4", "--resume", str(folder.path)],
        cwd=tmp_path, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert alone.returncode == 0, alone.stderr
    assert "the worlds start afresh" in alone.stdout


def test_what_torchrun_says(monkeypatch):
    for name in ("RANK", "LOCAL_RANK", "WORLD_SIZE", "LOCAL_WORLD_SIZE", "MASTER_ADDR"):
        monkeypatch.delenv(name, raising=False)
    assert processes() == Processes()
    assert processes().threads(3) == 3
    assert processes().rsl_rl() is None
    for name, value in {"RANK": "5", "LOCAL_RANK": "1", "WORLD_SIZE": "8", "MASTER_ADDR": "a"}.items():
        monkeypatch.setenv(name, value)
    assert processes() == Processes(5, 1, 8)
    monkeypatch.setenv("LOCAL_WORLD_SIZE", "4")
    assert processes() == Processes(5, 1, 8, 4)
    assert processes().rsl_rl() == {"global_rank": 5, "local_rank": 1, "world_size": 8}
    assert processes().device("cpu") == "cpu"
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert processes().device("auto") == processes().device("cuda") == "cuda:1"
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    with pytest.raises(InputError, match="unknown device 'cuda:1'"):
        processes().device("auto")
    monkeypatch.setenv("RANK", "8")
    with pytest.raises(InputError, match="start the processes by torchrun"):
        processes()
    monkeypatch.setenv("RANK", "x")
    with pytest.raises(InputError, match="whole numbers"):
        processes()


def test_files_that_a_killed_process_left_are_swept(tmp_path):
    folder = RunFolder(Path(tmp_path))
    folder.checkpoints.mkdir()
    for path in (tmp_path / ".config.json.ab12.tmp", folder.checkpoints / ".simwarp-x.pt"):
        path.write_text("half")
    (tmp_path / "config.json").write_text("{}")
    folder.sweep()
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["checkpoints", "config.json"]
