"""What an exported policy tells of its task, read back from the file by onnxruntime, and held to the task itself."""

import json

import pytest
import torch

import simwarp as sw
from simwarp.tasks import Task, TaskConfig, make, replace_fields
from simwarp.tasks.framework import registry
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import TrainConfig
from simwarp.train.networks.export import ExportFormat, export_policy
from simwarp.train.networks.policy_metadata import policy_metadata
from simwarp.train.runs.checkpoint import save_checkpoint

SETTINGS = {"num_envs": 2, "device": "cpu"}


def exported(tmp_path, name, **config):
    """The task, and the metadata of an untrained policy's file as onnxruntime reads it."""
    onnxruntime = pytest.importorskip("onnxruntime")
    task = make(name, 2, **config)
    trainer = Trainer(task, replace_fields(TrainConfig(), SETTINGS))
    save_checkpoint(tmp_path / "a.pt", trainer.checkpoint_of_policy())
    export_policy(tmp_path / "a.pt", ExportFormat.ONNX, tmp_path / "a.onnx")
    session = onnxruntime.InferenceSession(str(tmp_path / "a.onnx"), providers=["CPUExecutionProvider"])
    stored = {key: json.loads(text) for key, text in session.get_modelmeta().custom_metadata_map.items()}
    assert [group["name"] for group in stored["observations"]] == [item.name for item in session.get_inputs()]
    return task, stored


def column(stored, name, group="policy"):
    """The place of an observation by its name."""
    return stored["observation_names"][group].index(name)


def test_the_ant_tells_joints_torques_and_observations(tmp_path):
    task, stored = exported(tmp_path, "ant", torque=25.0)
    joints = [f"hip_{leg}" for leg in range(4)] + [f"ankle_{leg}" for leg in range(4)]
    assert stored["joint_names"] == stored["action_names"] == joints
    assert stored["action_scale"] == [25.0] * 8
    assert stored["control_rate"] == 50.0
    assert stored["observations"] == [{"name": "policy", "shape": [30], "dtype": "float32"}]
    assert len(stored["default_joint_pos"]) == 8
    assert not stored.keys() & {"joint_stiffness", "joint_damping", "joint_effort_limit"}  # torques: no drives
    # Names are where they say: what the simulation has under them
    seen = task.step(torch.rand(2, 8, generator=torch.Generator().manual_seed(0))).observations["policy"]
    for joint in joints:
        at = task.simulation.model.dof(joint)
        torch.testing.assert_close(seen[:, column(stored, f"angle {joint}")], task.views.joint_q[:, at])
        torch.testing.assert_close(seen[:, column(stored, f"rate {joint}")], task.views.joint_qd[:, at])
    torch.testing.assert_close(seen[:, column(stored, "height")], task.views.body_q[:, 0, 2])


def test_actions_move_the_joints_in_the_order_told():
    task = make("ant", 8, randomise={}, start_angle=0.0, start_rate=0.0)
    told = policy_metadata(task)
    task.apply(torch.eye(8))
    at = [task.simulation.model.dof(joint) for joint in told["joint_names"]]
    torch.testing.assert_close(task.views.joint_force[:, at], torch.eye(8) * told["action_scale"][0])


def test_a_driving_task_tells_steering_and_measurements(tmp_path):
    task, stored = exported(tmp_path, "off-road", obs="state")
    assert stored["action_names"] == ["steering", "pedals"]
    assert stored["control_rate"] == 10.0
    assert not stored.keys() & {"joint_names", "default_joint_pos", "action_scale", "joint_stiffness"}
    assert len(stored["observation_names"]["policy"]) == 38
    action = torch.tensor([[0.5, 0.8], [-0.25, 0.4]])
    for _ in range(5):
        seen = task.step(action).observations["policy"]
    torch.testing.assert_close(seen[:, column(stored, "steering")], action[:, 0])
    torch.testing.assert_close(seen[:, column(stored, "pedals")], action[:, 1])
    speed, aside, turn = task.motion().T
    torch.testing.assert_close(seen[:, column(stored, "yaw rate")], turn)
    torch.testing.assert_close(seen[:, column(stored, "speed to the left")], aside)
    assert (speed > 0.0).all()
    assert (seen[:, column(stored, "speed ahead")] > 0.0).all()


def test_a_camera_is_a_group_without_names_of_its_parts():
    told = policy_metadata(make("off-road", 1))
    assert [group["name"] for group in told["observations"]] == ["policy", "camera"]
    assert told["observations"][1]["dtype"] == "uint8"
    assert list(told["observation_names"]) == ["policy"]


def test_a_reaching_task_tells_its_torques(tmp_path):
    task, stored = exported(tmp_path, "racer3-reach")
    assert stored["joint_names"] == [f"joint_{number}" for number in range(1, 7)]
    assert stored["action_scale"] == [joint.torque for joint in type(task).arm.joints]
    assert stored["control_rate"] == 50.0
    seen = task.restart(seed=3)["policy"]
    # The target lies on the ground: half a cube above it
    torch.testing.assert_close(seen[:, column(stored, "target z")], torch.full((2,), 0.015))
    torch.testing.assert_close(seen[:, column(stored, "angle joint_2")], task.views.joint_q[:, 1])


def test_displacements_are_no_torques_of_joints():
    told = policy_metadata(make("irb120-reach", 1, actions="displacement", displacement=0.03))
    assert told["action_names"] == ["grip x", "grip y", "grip z"]
    assert told["action_scale"] == [0.03] * 3
    assert "joint_names" not in told


@pytest.mark.parametrize(
    ("name", "config"),
    [
        ("ant", {"orientation": "quaternion", "lateral": True}),
        ("hexapod", {}),
        ("hallway", {"obs": "state"}),
        ("barrier-track", {}),
        ("pendulum", {}),
        ("fast", {}),
    ],
)
def test_names_fit_in_every_configuration(name, config):
    task = make(name, 1, **config)
    told = policy_metadata(task)  # refuses what does not fit
    assert told["control_rate"] == pytest.approx(1.0 / task.config.control_dt)
    assert ("observation_names" in told) == (name not in ("pendulum", "fast"))


class Arm(Task):
    """Two hinges with drives; actions are targets."""

    config_type = TaskConfig
    action_size = 2
    action_joints = ("elbow", "shoulder")
    action_scale = (0.4, 0.5)
    default_positions = (0.1, 0.2)

    def build(self, builder):
        last = sw.WORLD
        for place, (name, stiffness) in enumerate((("shoulder", 30.0), ("elbow", 20.0))):
            body = builder.add_body(name, mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((place, 0, 1)))
            drive = sw.PositionDrive(stiffness=stiffness, damping=0.1 * stiffness, effort_limit=2.0 * stiffness)
            builder.add_joint_revolute(name, last, body, axis=(0, 1, 0), anchor=(place, 0, 1), drive=drive)
            last = body

    def apply(self, action):
        pass

    def observations(self):
        return {"policy": self.views.joint_q}

    def rewards(self):
        return {"none": torch.zeros(self.num_worlds)}

    def terminations(self):
        return {}

    def reset(self, world_mask):
        pass


@pytest.fixture
def arm(monkeypatch):
    monkeypatch.setattr(registry, "_tasks", dict(registry._tasks))
    return registry.register("two-hinges")(Arm)


def test_gains_are_those_of_the_drives_in_the_order_of_the_actions(arm, tmp_path):
    _, stored = exported(tmp_path, "two-hinges")
    assert stored["joint_names"] == ["elbow", "shoulder"]
    assert stored["joint_stiffness"] == [20.0, 30.0]
    assert stored["joint_damping"] == [2.0, 3.0]
    assert stored["joint_effort_limit"] == [40.0, 60.0]
    assert stored["default_joint_pos"] == [0.1, 0.2]
    assert stored["action_scale"] == [0.4, 0.5]
    assert stored["control_rate"] == 100.0
