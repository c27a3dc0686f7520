"""Good files to spoil: a run folder, a checkpoint, trajectories, the dump of a broken world, made once."""

import shutil
from pathlib import Path

import torch

from simwarp.cli import main
from simwarp.tasks import make
from tests.campaign.oracle import run_in_process

LOADING = 300.0
"""For loading torch and compiling kernels [s]."""

ARM = """<robot name="arm"><link name="base"/><link name="rod"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1"
izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="hinge" type="continuous"><parent link="base"/>
<child link="rod"/><axis xyz="0 1 0"/></joint></robot>"""
SCRIPT = "t_s,steering,throttle,braking\n0,0,0.1,0\n0.02,0.1,0.2,0\n"


def make_material(folder: Path) -> Path:
    """Make the files below `folder/good`; returns `folder`."""
    good = folder / "good"
    good.mkdir(parents=True)
    command(
        "train",
        "fast",
        "--num-envs=4",
        "--steps-per-iteration=4",
        "--iterations=2",
        "--save-interval=1",
        "--device=cpu",
        f"--runs={folder / 'runs'}",
    )
    (run,) = (folder / "runs" / "fast").iterdir()
    shutil.move(run, good / "run")
    shutil.rmtree(folder / "runs")
    shutil.copy(sorted((good / "run" / "checkpoints").glob("*.pt"))[-1], good / "fast.pt")
    command(
        "record",
        "fast",
        f"--checkpoint={good / 'fast.pt'}",
        "--episodes=3",
        "--task.max-episode-steps=4",
        f"--output={good / 'fast.npz'}",
    )
    _break_a_world(good / "broken.npz")
    (good / "short.csv").write_text(SCRIPT)
    (good / "arm.urdf").write_text(ARM)
    (good / "fit.toml").write_text(FIT)
    return folder


FIT = """target = "sedan"
dt = 0.005
[[runs]]
file = "short.csv"
[readings]
speed_mps = "steering"
[parameters]
"chassis.components[0].mass" = {}
"""
"""A fit whose readings are no speeds: it is held to what must be refused before it begins."""


def command(*words: str) -> None:
    run = run_in_process(words, main, LOADING)
    assert run.code == 0, (words, run)


def _break_a_world(path: Path) -> None:
    task = make("pendulum", 2, seed=5, guard_steps=20)
    assert task.guard is not None
    task.guard.path = path
    for step in range(4):
        action = torch.zeros(2, 1)
        if step == 2:
            action[1] = torch.nan
        task.step(action)
    task.drain_statistics()
    assert path.exists()
