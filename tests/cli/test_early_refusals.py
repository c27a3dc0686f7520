"""What is wrong whatever torch, Warp and the kernels hold is answered before they are imported."""

import subprocess
import sys

import pytest

from simwarp.cli.early.early_refusals import refuse_early
from simwarp.task_names import known_tasks

PROGRAM = """
import sys
from simwarp import cli
for name in {missing!r}:
    sys.modules[name] = None
code = cli.main({words!r})
print(code, sorted({{"torch", "warp", "mujoco", "scipy"}} & set(sys.modules)))
"""
DATASET = "meta"
"""Folder by which a dataset of LeRobot is known."""
CASES = {
    "an unknown task": (["record", "pendulm"], [], "unknown task 'pendulm'; did you mean pendulum?"),
    "an unknown task to train": (["train", "pendulm", "--iterations", "3"], [], "unknown task 'pendulm'"),
    "an unknown task to clone": (["clone", "antt", "--data", "there"], [], "unknown task 'antt'; did you mean ant"),
    "an unknown format": (
        ["record", "pendulum", "--format", "hdf5"], [], "--format must be npz or minari or lerobot, got 'hdf5'",
    ),
    "no episodes": (["record", "pendulum", "--episodes", "0"], [], "episodes must be at least 1, got 0"),
    "no such quality": (["record", "ant", "--video-quality=52"], [], "video-quality must be from 0 to 51, got 52"),
    "no minari": (
        ["record", "pendulum", "--format", "minari"], ["minari"],
        "format minari must have module 'minari', got none; pip install 'simwarp[minari]'",
    ),
    "no pyarrow": (
        ["record", "pendulum", "--format", "lerobot"], ["pyarrow"],
        "format lerobot must have module 'pyarrow', got none; pip install 'simwarp[lerobot]'",
    ),
    "no pyarrow to read": (
        ["clone", "pendulum", "--data", "there"], ["pyarrow"],
        "format lerobot must have module 'pyarrow', got none; pip install 'simwarp[lerobot]'",
    ),
    "an output that is there": (
        ["record", "pendulum", "--task.dt", "0.01", "--format", "lerobot", "--output", "there"], [],
        "--output: 'there' exists already; give another name or remove it",
    ),
    "a folder that is no run": (["record", "there", "--format", "lerobot"], [], "unknown task 'there'"),
    "an output without a folder": (
        ["record", "pendulum", "--output", "nowhere/p.npz"], [],
        "--output: cannot write 'nowhere/p.npz': folder nowhere does not exist; make it first",
    ),
    "another ending": (["record", "pendulum", "--output", "p.zip"], [], "--output must end in .npz, got 'p.zip'"),
    "no data": (["clone", "pendulum"], [], "which trajectories? usage: simwarp clone pendulum --data FILE_OR_FOLDER"),
    "data that are not there": (
        ["clone", "pendulum", "--data", "gone.npz"], [],
        "trajectories 'gone.npz': there is no such file or folder; write it with `simwarp record pendulum",
    ),
    "a folder of something else": (["clone", "pendulum", "--data", "."], [], "'.': the folder holds no dataset"),
    "clone would write over its data": (
        ["clone", "pendulum", "--data", "p.npz", "--output", "p.npz"], [], "--output would overwrite 'p.npz'",
    ),
    "an unknown target of ROS": (["ros2", "gatr"], [], "nothing is called 'gatr'; did you mean gator?"),
    "an option of ROS": (
        ["ros2", "pendulum", "--task.dt", "0.01", "--wait-for", "/a"], [], "--wait-for: is of --lock-step; add it",
    ),
    "no ROS": (["ros2", "gator", "--lock-step"], ["rclpy"], "ros2: must have module 'rclpy' of ROS 2, got none"),
    "an unknown target to view": (["view", "gatr"], [], "nothing is called 'gatr'; did you mean gator?"),
    "no mcap": (
        ["drive", "gator", "--record", "a.mcap"], ["mcap"],
        "recording: must have module 'mcap', got none; pip install 'simwarp[mcap]'",
    ),
    "no mcap to view": (
        ["view", "gator", "--record=a.mcap"], ["mcap"],
        "recording: must have module 'mcap', got none; pip install 'simwarp[mcap]'",
    ),
    "another kind of record": (
        ["eval", "pendulum", "--record", "a.bag"], [], "--record: the name must end in .mcap, got 'a.bag'; rename it",
    ),
    "a record without a folder": (
        ["play", "pendulum", "--record", "nowhere/a.mcap"], [], "--record: cannot write 'nowhere/a.mcap'",
    ),
}  # fmt: skip
"""Case -> words, modules that are not installed, beginning or part of the line."""


@pytest.mark.parametrize("case", CASES)
def test_wrong_words_are_answered_before_anything_heavy_is_imported(case, tmp_path):
    words, missing, line = CASES[case]
    (tmp_path / "there" / DATASET).mkdir(parents=True)
    (tmp_path / "p.npz").write_bytes(b"")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(words=words, missing=missing)], cwd=tmp_path, capture_output=True,
        text=True, timeout=120,
    )  # fmt: skip
    assert line in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout.split("\n")[0] == "2 []"


@pytest.mark.parametrize(
    "words",
    [
        ["record", "pendulum", "--output", "new.npz", "--task.dt", "0.01", "--checkpoint", "zero"],
        ["record", "--num-envs", "3", "pendulum"],
        ["record", "mine.py:Task", "--format", "lerobot", "--full"],
        ["record", "pendulum", "--full", "--obs", "state", "--video_quality", "3"],
        ["record", "--num-envs", "3", "of-another-package"],
        ["record", "run"],
        ["clone", "pendulum", "--data=p.npz", "--epochs", "3", "--network.kind", "mlp"],
        ["clone", "mine.py:Task", "--data", "there"],
        ["train", "--resume", "run"],
        ["drive", "gator", "--record", "new.mcap", "--sensors", "mems-imu"],
        ["view", "gator", "--record", "new.html"],
        ["view", "m113-belt"],
        ["view", "card-house", "--no-open"],
        ["list"],
    ],
    ids=" ".join,
)
def test_other_words_are_left_to_the_command(words, tmp_path, monkeypatch):
    pytest.importorskip("mcap", reason="needs the extra mcap")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there" / DATASET).mkdir(parents=True)
    (tmp_path / "p.npz").write_bytes(b"")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.json").write_text("{}", encoding="utf-8")
    refuse_early(words[0], words[1:])
    assert {path.name for path in tmp_path.iterdir()} == {"there", "p.npz", "run"}


def test_tasks_that_are_registered_already_are_left_to_the_command():
    import simwarp.tasks  # noqa: F401  with its registry

    assert known_tasks() is None
    refuse_early("record", ["of-another-package"])
