"""`simwarp new-task --robot`: packages around robots that float or are fixed, their tests, and what is refused."""

import importlib
import json
import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import torch

from simwarp import cli
from simwarp.cli.robots.robot_task import inertia_along
from simwarp.importers import load_mjcf, load_robot
from simwarp.tasks import make
from simwarp.tasks.framework import registry
from tests.cli.test_import_command import URDF

WALKER = """<mujoco><worldbody><body name="trunk" pos="0 0 1"><freejoint name="float"/>
<geom type="box" size=".3 .2 .1" mass="4"/>
<body name="left" pos="0 .2 0"><joint name="left_hip" axis="0 1 0" range="-60 60" armature=".01"/>
<geom type="capsule" fromto="0 0 0 0 0 -.4" size=".05" mass=".5"/></body>
<body name="right" pos="0 -.2 0"><joint name="right_hip" axis="0 1 0" range="-60 60" armature=".01"/>
<geom type="capsule" fromto="0 0 0 0 0 -.4" size=".05" mass=".5"/></body></body></worldbody>
<actuator><motor joint="left_hip" gear="2" ctrlrange="-10 10"/><motor joint="right_hip" ctrlrange="-20 20"/></actuator>
</mujoco>"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with robots, in which commands run and packages are found; their tasks are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registry, "_tasks", dict(registry._tasks))
    (tmp_path / "walker.xml").write_text(WALKER)
    (tmp_path / "two.urdf").write_text(URDF)
    return tmp_path


def made(folder, monkeypatch, name, *arguments):
    """The module of a new package."""
    assert cli.main(["new-task", name, "--robot", *arguments]) == 0
    monkeypatch.syspath_prepend(str(folder / name))
    return importlib.import_module(f"{name.replace('-', '_')}.task")


def task_robot(module):
    """The robot of a package."""
    return load_robot(module.ROBOT)


@pytest.mark.filterwarnings("ignore::simwarp.importers.report.ImportedWarning")
def test_inertia_along_a_joint_is_that_of_the_mass_matrix(folder):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path("walker.xml")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    robot = load_mjcf("walker.xml")
    for name, column in (("left_hip", 6), ("right_hip", 7)):
        index, _ = robot.builder.coordinate_of(robot.dofs[name])
        assert inertia_along(robot.builder, index) == pytest.approx(mass[column, column], rel=1e-9)


def test_a_robot_that_floats_stands(folder, monkeypatch):
    module = made(folder, monkeypatch, "stand-walker", "walker.xml")
    # the largest effort at one radian, half of the critical damping of a leg about its hip
    leg = inertia_along(task_robot(module).builder, 1)
    damping = pytest.approx(math.sqrt(20.0 * leg), rel=1e-3)
    for name in ("left_hip", "right_hip"):
        assert module.JOINTS[name] == (20.0, damping, 20.0, -1.0, 1.0)
    assert module.HOME == {"left_hip": 0.0, "right_hip": 0.0}
    task: Any = make("stand-walker", num_worlds=3, seed=1)
    # feet 0.45 m below the trunk's middle, which the file puts at 1 m: float32
    assert task.home[task.robot.dofs["float"] + 2] == pytest.approx(0.45, abs=1e-6)
    assert task.step(torch.zeros(3, 2)).observations["policy"].shape == (3, 15)
    # down, seen from a base that stands upright
    assert torch.allclose(task.in_base(task.down), task.down, atol=0.05)
    q = task.simulation.state.joint_q.numpy().copy()
    q[:, 3:6] = [0.0, 0.5 * torch.pi, 0.0]  # a nod: forward points down
    task.simulation.set_joint_state(None, q, None)
    assert torch.allclose(task.in_base(task.down), torch.tensor([1.0, 0.0, 0.0]), atol=1e-5)
    assert task.terminations()["fell"].all()
    assert "command" not in task.extra_state()


def test_a_robot_that_follows_velocities(folder, monkeypatch):
    made(folder, monkeypatch, "walk-walker", "walker.xml", "--velocity")
    task: Any = make("walk-walker", num_worlds=64, seed=1)
    assert task.step(torch.zeros(64, 2)).observations["policy"].shape == (64, 18)
    forward = task.command[:, 0].abs()
    assert 0.32 <= forward.min() < 0.4
    assert 0.7 < forward.max() <= 0.8  # of 64 uniform ones
    assert 0.25 < (task.command[:, 0] > 0).float().mean() < 0.75
    assert task.command[:, 1].abs().max() <= 0.32
    assert task.command.std(dim=0).min() > 0.12  # uniform in +-0.32: 0.18
    # what is paid is paid for the commanded velocity, in axes of the base
    task.views.body_omega.zero_()
    speeds = torch.zeros(64, 3)
    speeds[:, :2] = task.command[:, :2]
    task.views.body_v[:, task.base] = task.in_base(speeds)
    assert task.rewards()["speed"].min() > 0.9
    assert task.metrics()["success"].all()
    # who stands earns nothing at 0.5 m/s, less at more
    task.views.body_v.zero_()
    wanted = task.command[:, :2].norm(dim=1)
    assert torch.allclose(task.rewards()["speed"], 1.0 - 2.0 * wanted, atol=1e-6)
    assert not task.metrics()["success"].any()


def test_a_robot_with_a_fixed_base_reaches_goals(folder, monkeypatch):
    module = made(folder, monkeypatch, "reach-two", "two.urdf", "--base", "fixed")
    # 1 kg·m² on a drive of 7 N·m/rad
    assert module.JOINTS == {"turn": (7.0, 2.646, 7.0, -1.0, 1.0)}
    task: Any = make("reach-two", num_worlds=4, seed=1)
    for _ in range(140):
        task.step(4.0 * task.away())
    assert task.metrics()["success"].all()  # who walks towards the goal arrives


def test_files_of_the_package(folder):
    assert cli.main(["new-task", "boxed-walker", "--robot", "walker.xml", "--json", "out.json"]) == 0
    files = {
        "pyproject.toml", "README.md", "boxed_walker/__init__.py", "boxed_walker/task.py", "boxed_walker/robot.json",
        "tests/test_boxed_walker.py",
    }  # fmt: skip
    assert set(json.loads((folder / "out.json").read_text())["files"]) == files
    package = folder / "boxed-walker"
    for name in files - {"boxed_walker/robot.json"}:
        text = (package / name).read_text()
        assert "%v" not in text
        assert not any(line.strip().startswith("@") and line.strip().endswith("@") for line in text.splitlines())
    assert 'boxed_walker = ["robot.json"]' in (package / "pyproject.toml").read_text()
    lines = (package / "boxed_walker/task.py").read_text().splitlines()
    assert max(map(len, lines)) <= 120
    assert not [line for line in lines if line != line.rstrip()]


def standing(module, name):
    """Height of the lowest point of a new task's robot at its start, without noise [m], and the task."""
    task: Any = make(name, num_worlds=2, seed=1, start_noise=1e-6)
    return task.robot.lowest_point(task.simulation.state), task


def test_a_pose_is_given_by_joints_and_the_base_follows(folder, monkeypatch):
    options = ("walker.xml", "--pose", "left_hip=0.5", "--pose", "r*_hip=-0.25,right_hip=-0.5")
    module = made(folder, monkeypatch, "posed-walker", *options)
    assert module.HOME == {"left_hip": 0.5, "right_hip": -0.5}
    assert module.JOINTS["left_hip"][3:] == (-0.5, pytest.approx(math.pi / 3, abs=1e-3))  # 1 rad around, in the stops
    lowest, task = standing(module, "posed-walker")
    assert lowest == pytest.approx(0.0, abs=1e-5)  # float32, and noise of 1e-6 rad
    # a capsule's end: 0.4 m away along the leg, 0.05 m around
    assert task.views.body_q[0, task.base, 2] == pytest.approx(0.4 * math.cos(0.5) + 0.05, abs=1e-5)


def test_a_keyframe_gives_the_pose(folder, monkeypatch):
    key = '<keyframe><key name="home" qpos="0 0 1 1 0 0 0 .3 -.2"/></keyframe></mujoco>'
    (folder / "walker.xml").write_text(WALKER.replace("</mujoco>", key))
    module = made(folder, monkeypatch, "key-walker", "walker.xml", "--pose", "right_hip=0.1")
    assert module.HOME == {"left_hip": 0.3, "right_hip": 0.1}
    assert standing(module, "key-walker")[0] == pytest.approx(0.0, abs=1e-5)


def test_joints_that_cannot_stand_at_0_start_in_the_middle(folder, monkeypatch):
    (folder / "two.urdf").write_text(URDF.replace('lower="-1"', 'lower="0.5"'))
    assert made(folder, monkeypatch, "mid-two", "two.urdf", "--base", "fixed").HOME == {"turn": 1.25}


def test_a_ground_of_the_file_is_stood_upon(folder, monkeypatch):
    ground = '<worldbody><geom type="plane" size="1 1 1" pos="0 0 .2"/>'
    (folder / "walker.xml").write_text(WALKER.replace("<worldbody>", ground))
    module = made(folder, monkeypatch, "high-walker", "walker.xml")
    assert standing(module, "high-walker")[0] == pytest.approx(0.2, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("options", [("walker.xml",), ("walker.xml", "--velocity"), ("two.urdf", "--base", "fixed")])
def test_the_package_passes_its_own_test_and_trains(folder, options):
    assert cli.main(["new-task", "my-robot", "--robot", *options]) == 0
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    done = subprocess.run(words, cwd=folder / "my-robot", capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout[-4000:]
    assert "5 passed" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--velocity",), "--velocity is about a robot: add --robot FILE"),
        (("--base", "fixed"), "--base is about a robot"),
        (("--pose", "a=1"), "--pose is about a robot"),
        (("--robot", "walker.xml", "--pose", "left_hip"), "--pose must be JOINT=VALUE [rad or m], got 'left_hip'"),
        (("--robot", "walker.xml", "--pose", "left_hip=nan"), "--pose must be JOINT=VALUE"),
        (("--robot", "walker.xml", "--pose", "left_hop=1"), "no hinge or slide with 'left_hop'; did you mean left_hip"),
        (
            ("--robot", "walker.xml", "--pose", "*_hip=2"),
            "'left_hip' must be within its limits, -1.047 to 1.047, got 2",
        ),
        (("--robot", "none.urdf"), "there must be a file"),
        (("--robot", "two.urdf"), "add --base fixed or --base floating"),
        (("--robot", "two.urdf", "--base", "fixed", "--velocity"), "--velocity is for robots whose base floats"),
        (("--robot", "stone.xml"), "a task needs joints that can be driven, and there is none"),
        (("--robot", "robot.obj"), "no reader is for 'robot.obj'"),
    ],
)
def test_mistakes_get_one_line(folder, capfd, arguments, message):
    (folder / "robot.obj").write_text("")
    (folder / "stone.xml").write_text(
        '<mujoco><worldbody><body><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>'
    )
    assert cli.main(["new-task", "mine", *arguments]) == 2
    err = capfd.readouterr().err
    assert message in err
    assert err.count("\n") == 1
    assert not (folder / "mine").exists()
