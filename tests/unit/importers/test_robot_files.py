"""Imported robots in files: names, actuators, coordinates, keyframes and the report come back with the model."""

import copy
import dataclasses
import json
import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.actuators import Actuators
from simwarp.importers import load_mjcf, load_robot, load_urdf, save_robot
from simwarp.importers.report import ImportedWarning
from tests.reference.imported_robots import ROBOTS

MODEL = """
<mujoco>
  <option timestep="0.004"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="torso" pos="0 0 1">
      <freejoint name="float"/>
      <geom name="trunk" type="box" size=".2 .1 .1" mass="2"/>
      <site name="imu" pos="0.1 0 0" quat="1 0.2 0 0"/>
      <camera name="eye" pos="0.2 0 0" fovy="50"/>
      <body name="arm" pos="0 0 -.1" quat="1 .3 .2 .1">
        <joint name="ball" type="ball" damping="0.1"/>
        <geom name="rod" type="capsule" size=".03 .1" mass=".3"/>
        <body name="hand" pos="0 0 -.2">
          <joint name="wrist" axis="0 1 0" range="-60 90" ref="10" armature=".01"/>
          <joint name="slide" type="slide" axis="0 0 1" range="-.1 .1" armature=".01"/>
          <geom name="palm" type="ellipsoid" size=".05 .04 .03" mass=".2"/>
          <site name="tool"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon><fixed name="cord"><joint joint="wrist" coef=".3"/><joint joint="slide" coef="-1"/></fixed></tendon>
  <actuator>
    <motor name="push" joint="slide" gear="20" ctrlrange="-1 1" forcerange="-5 9"/>
    <position name="turn" joint="wrist" kp="30" kv="2" ctrlrange="-.5 1"/>
    <general name="lift" site="tool" gear="0 0 1 0 0 .1" dyntype="filterexact" dynprm=".05"/>
    <motor name="pull" tendon="cord"/>
  </actuator>
  <sensor><gyro name="rates" site="imu" noise=".01" cutoff="20"/><jointpos name="angle" joint="wrist"/></sensor>
  <keyframe><key name="home" time=".5" qpos="0 0 1 .5 .5 .5 .5 1 0 0 0 .2 .01" qvel="1 0 0 0 0 0 0 0 0 .1 0"
    ctrl="0 .1 0 0"/></keyframe>
</mujoco>
"""


def check_same(mine, other, path="robot"):
    """Everything of two robots is equal, number by number, without the builder and what shows."""
    if dataclasses.is_dataclass(mine):
        assert type(mine) is type(other), path
        for field in dataclasses.fields(mine):
            if field.name not in ("builder", "show"):
                check_same(getattr(mine, field.name), getattr(other, field.name), f"{path}.{field.name}")
    elif isinstance(mine, dict):
        assert list(mine) == list(other), path
        for key in mine:
            check_same(mine[key], other[key], f"{path}[{key}]")
    elif isinstance(mine, np.ndarray):
        assert (mine.dtype, mine.shape, mine.tobytes()) == (other.dtype, other.shape, other.tobytes()), path
    elif isinstance(mine, (tuple, list)):
        assert len(mine) == len(other), path
        for index, (a, b) in enumerate(zip(mine, other, strict=True)):
            check_same(a, b, f"{path}[{index}]")
    elif hasattr(mine, "lines"):
        check_same(mine.lines, other.lines, f"{path}.lines")
        assert mine.source == other.source
    elif isinstance(mine, float):  # NumPy's among them
        assert float(mine).hex() == float(other).hex(), path
    else:
        assert repr(mine) == repr(other), path


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    file = tmp_path_factory.mktemp("robot") / "robot.xml"
    file.write_text(MODEL)
    with pytest.warns(ImportedWarning):
        return load_mjcf(file)


@pytest.fixture(scope="module")
def file(robot, tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "robot.json"
    save_robot(robot, path)
    return path


def trajectory(robot):
    """State after some steps with the actuators at work, as bytes."""
    model = robot.builder.finalize(1, "cpu")
    actuators = Actuators(model, robot.actuators)
    actuators.ctrl[...] = 0.5
    simulation = sw.Simulation(model, dt=1e-3, elements=[actuators])
    for _ in range(20):
        simulation.step()
    return simulation.state.joint_q.numpy().tobytes()


def test_a_robot_comes_back_with_all_its_names(robot, file, recwarn):
    again = load_robot(file)
    assert not recwarn.list  # its warnings were given when it was read
    check_same(robot, again)
    assert {"sites", "cameras", "keyframes", "sensors", "actuators", "frames"} <= {
        name for name, value in vars(robot).items() if value
    }
    assert again.mass == robot.mass
    qpos = np.array([0.1, 0.2, 1.0, 0.5, 0.5, -0.5, 0.5, 0.6, 0.8, 0.0, 0.0, 0.3, 0.01])
    assert again.q_from(qpos).tobytes() == robot.q_from(qpos).tobytes()
    assert np.allclose(again.qpos_from(again.q_from(qpos)), qpos, atol=1e-12)
    assert again.frame("tool").body == robot.bodies["hand"]
    assert trajectory(again) == trajectory(robot)
    assert again.show is None


def load_robot_of(robot):
    """The same robot in a builder of its own."""
    return dataclasses.replace(robot, builder=copy.deepcopy(robot.builder))


def test_saving_again_gives_the_same_file(file, tmp_path):
    save_robot(load_robot(file), tmp_path / "second.json")
    assert (tmp_path / "second.json").read_bytes() == file.read_bytes()


def test_its_model_alone(robot, file, tmp_path):
    assert sw.load_model(file).bodies[0].name == robot.builder.bodies[0].name
    sw.save_model(robot.builder, tmp_path / "model.json")
    with pytest.raises(sw.ModelError, match=r"^model.json: robot: missing: this file has a model alone"):
        load_robot(tmp_path / "model.json")


def _changed(file, folder, *keys_and_value):
    *keys, last, value = keys_and_value
    whole = json.loads(file.read_text())
    owner = whole["robot"]
    for key in keys:
        owner = owner[key]
    owner[last] = value
    path = folder / "changed.json"
    path.write_text(json.dumps(whole))
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("bodies", "torso", 9), "robot.bodies.torso: must be in 0..3, got 9"),
        (("dofs", "wrist", -1), "robot.dofs.wrist: must be in 0.."),
        (("shapes", "trunk", [7]), "robot.shapes.trunk[0]: must be in 0..3, got 7"),
        (("sites", "imu", "body", 4), "robot.sites.imu.body: must be in -1..3, got 4"),
        (("sites", "imu", "rotation", [1, 1, 0, 0]), "robot.sites.imu.rotation: must be a unit quaternion"),
        (("sites", "imu", "colour", 1), "robot.sites.imu.colour: unknown key"),
        (("keyframes", "home", "q", [1.0]), "robot.keyframes.home.q: must have 11 numbers, got 1"),
        (("keyframes", "home", "qd", math.nan), "robot.keyframes.home.qd: must be a list"),
        (("actuators", 0, "law", "motor"), "robot.actuators[0].law: must be one of effort, servo, got 'motor'"),
        (("actuators", 0, "gain", [1.0, 2.0, math.nan]), "robot.actuators[0].gain[2]: must be a finite number"),
        (("joints", 0, "kind", "hinge"), "robot.joints[0].kind: must be one of scalar, ball, free, got 'hinge'"),
        (("joints", 0, "position", 8), "robot.joints[0].position: must be in 0.."),
        (("joints", 0, "dof", 10**12), "robot.joints[0].dof: must be in 0.."),
        (("initial", [0.0]), "robot.initial: must have"),
        (("position_count", 10**15), "robot.initial: must have 1000000000000000 numbers"),
        (("report", 0, "fate", "kept"), "robot.report[0].fate: must be one of held, near, refused, got 'kept'"),
        (("gravity", 1), "robot.gravity: unknown key"),
    ],
    ids=lambda value: None if isinstance(value, tuple) else value.partition(":")[0],
)
def test_what_is_broken_is_refused_in_one_line(file, tmp_path, change, message):
    with pytest.raises(sw.ModelError) as refused:
        load_robot(_changed(file, tmp_path, *change))
    text = str(refused.value)
    assert text.startswith("changed.json: ")
    assert message in text
    assert "\n" not in text


@pytest.mark.skipif(not ROBOTS.exists(), reason="published robots are not here")
@pytest.mark.parametrize(
    ("path", "options"),
    [
        ("mjcf/go2/go2.xml", {}), ("mjcf/panda/panda.xml", {}), ("mjcf/2f85/2f85.xml", {}),
        ("mjcf/shadow_hand/right_hand.xml", {}), ("urdf/r2d2/r2d2.urdf", {"base": "floating"}),
    ],
    ids=lambda value: value.partition("/")[2] if isinstance(value, str) else None,
)  # fmt: skip
@pytest.mark.quick("go2/go2.xml-options0")
@pytest.mark.filterwarnings("ignore::simwarp.importers.report.ImportedWarning")
def test_published_robots_come_back(tmp_path, path, options):
    reader = load_urdf if path.endswith(".urdf") else load_mjcf
    robot = reader(ROBOTS / path, **options)
    save_robot(robot, tmp_path / "robot.json")
    again = load_robot(tmp_path / "robot.json")
    check_same(robot, again)
    save_robot(again, tmp_path / "second.json")
    assert (tmp_path / "second.json").read_bytes() == (tmp_path / "robot.json").read_bytes()


def test_a_drive_of_a_joint_by_its_name(robot):
    again = load_robot_of(robot)
    again.set_drive("wrist", sw.PositionDrive(stiffness=1.5, effort_limit=2.0))
    index, local = again.builder.coordinate_of(again.dofs["wrist"])
    assert again.builder.joints[index].dofs[local].drive == sw.PositionDrive(stiffness=1.5, effort_limit=2.0)
    assert again.builder.joints[index].dofs[local].armature == 0.01
    for name, message in (
        ("wrists", "no joint or tendon 'wrists'; did you mean 'wrist'"), ("ball", "'ball' has 3 coordinates"),
    ):  # fmt: skip
        with pytest.raises(sw.ModelError, match=message):
            again.set_drive(name, None)
