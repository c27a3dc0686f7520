"""Messages with commands: what they do, and what is refused with one line."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.actuators import Actuators, ActuatorSpec, Law
from simwarp.ros2.command_topics import (
    CommandError,
    CommandTopic,
    JointCommands,
    action_topic,
    joint_topic,
    velocity_topic,
)
from tests.unit.ros2.ros_graph import TYPES, encoded


def message(kind: str, values: Mapping[str, Any]) -> Any:
    """As it comes over the network."""
    return TYPES.read(kind, encoded(kind, values))


def applied(topic: CommandTopic, values: Mapping[str, Any]) -> None:
    topic.read(message(topic.kind, values))()


class Moves(list[tuple[float, float, float]]):
    """What a base was commanded."""

    def __call__(self, ahead: float, left: float, turn: float) -> None:
        self.append((ahead, left, turn))


def no_rest() -> None:
    """Nothing."""


def twist(ahead: float, turn: float, left: float = 0.0) -> dict[str, Any]:
    return {"linear": {"x": ahead, "y": left}, "angular": {"z": turn}}


def test_a_twist_moves_ahead_and_turns() -> None:
    moves = Moves()
    applied(velocity_topic(moves, no_rest, stamped=False, sideways=False), twist(1.5, -0.25))
    applied(velocity_topic(moves, no_rest, stamped=True, sideways=True), {"twist": twist(1.5, -0.25, 0.125)})
    assert moves == [(1.5, 0.0, -0.25), (1.5, 0.125, -0.25)]


def test_a_twist_has_the_type_of_its_topic() -> None:
    for stamped, kind in ((False, "geometry_msgs/msg/Twist"), (True, "geometry_msgs/msg/TwistStamped")):
        topic = velocity_topic(Moves(), no_rest, stamped=stamped, sideways=False)
        assert (topic.topic, topic.kind) == ("/cmd_vel", kind)


def robot() -> sw.Simulation:
    """A chain of four: a drive for positions, a servo, a motor, and a prescribed speed."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    before: Any = sw.WORLD
    kinds: dict[str, Any] = {
        "driven": {"drive": sw.PositionDrive(stiffness=10.0, damping=1.0)},
        "servo": {"drive": sw.PositionDrive(stiffness=10.0, damping=1.0)},
        "free": {},
        "turning": {"drive": sw.PrescribedSpeed()},
    }
    for number, (name, options) in enumerate(kinds.items()):
        body = builder.add_body(name, mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.0, 0.0, float(number))))
        builder.add_joint_revolute(name, before, body, anchor=(0.0, 0.0, float(number)), axis=(0, 0, 1), **options)
        before = body
    model = builder.finalize(world_count=2, device="cpu")
    spec = ActuatorSpec(name="motor", terms=((model.dof("servo"), 2.0),), law=Law.SERVO, length_offset=0.5)
    return sw.Simulation(model, 0.01, elements=[Actuators(model, [spec])])


def columns(sim: sw.Simulation, name: str) -> int:
    return int(sim.model.dof(name))


def test_joints_are_commanded_by_name() -> None:
    sim = robot()
    topic = joint_topic(sim, 1)
    assert topic is not None
    applied(topic, {"name": ["free", "driven"], "effort": [0.5, -0.25]})
    applied(topic, {"name": ["driven"], "position": [0.75], "velocity": [0.125]})
    applied(topic, {"name": ["turning"], "velocity": [2.0]})
    applied(topic, {"name": ["servo"], "position": [0.25]})
    control = sim.control
    wanted = {
        "joint_force": {"free": 0.5, "driven": -0.25}, "joint_target_q": {"driven": 0.75},
        "joint_target_qd": {"driven": 0.125, "turning": 2.0},
    }  # fmt: skip
    for name, values in wanted.items():
        row = np.zeros(4)
        for joint, value in values.items():
            row[columns(sim, joint)] = value
        assert np.array_equal(getattr(control, name).numpy(), [np.zeros(4), row]), name
    (actuators,) = (each for each in sim.elements if isinstance(each, Actuators))
    assert np.array_equal(actuators.ctrl.numpy(), [[0.0], [2.0 * 0.25 + 0.5]])


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no names": ({"effort": [1.0]}, "name must hold joints, got none"),
    "unknown": ({"name": ["fre"], "effort": [1.0]}, "no joint of one coordinate is called 'fre'; did you mean 'free'?"),
    "unlike": ({"name": ["xyz"], "effort": [1.0]}, "is called 'xyz'; they are driven, servo, free, turning"),
    "twice": ({"name": ["free", "free"], "effort": [1.0, 1.0]}, "name must hold each joint once, got 'free' twice"),
    "short": ({"name": ["free", "driven"], "effort": [1.0]}, "effort must hold 2 numbers, one for each name, or none"),
    "long": ({"name": ["free"], "effort": [1.0, 2.0]}, "effort must hold 1 numbers, one for each name, or none, got 2"),
    "nothing": ({"name": ["free"]}, "must hold position, velocity or effort, got none of them"),
    "NaN": ({"name": ["driven"], "position": [math.nan]}, "position must be finite, got nan; the message was left out"),
    "infinite": ({"name": ["free", "driven"], "effort": [0.0, math.inf]}, r"effort\[1\] must be finite, got inf"),
    "no drive": ({"name": ["free"], "position": [1.0]}, "joint 'free' takes no position: it has no drive"),
    "no speed": ({"name": ["free"], "velocity": [1.0]}, "joint 'free' takes no velocity: it has no drive"),
    "prescribed": ({"name": ["turning"], "effort": [1.0]}, "joint 'turning' takes no effort: its motion is prescribed"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_wrong_joint_commands_are_one_line_and_change_nothing(case: str) -> None:
    values, words = WRONG[case]
    sim = robot()
    commands = JointCommands(sim, 0)
    with pytest.raises(CommandError, match=f"^/joint_commands: .*{words}") as found:
        commands.read(message("sensor_msgs/msg/JointState", values))
    assert "\n" not in str(found.value)
    for name in ("joint_force", "joint_target_q", "joint_target_qd"):
        assert not getattr(sim.control, name).numpy().any()


def test_a_model_without_joints_takes_no_joint_commands() -> None:
    builder = sw.ModelBuilder()
    builder.add_body("ball", mass=1.0, inertia=(0.1, 0.1, 0.1))
    assert joint_topic(sw.Simulation(builder.finalize(1, "cpu"), 0.01), 0) is None


def test_actions_have_the_length_of_an_action() -> None:
    acted: list[list[float]] = []
    topic = action_topic(3, acted.append, lambda: acted.append([]))
    applied(topic, {"data": [0.5, -1.0, 2.0]})
    assert acted == [[0.5, -1.0, 2.0]]
    for values, words in (
        ([1.0], "data must hold 3 numbers, got 1; give a whole action"),
        ([0.0] * 4, "data must hold 3 numbers, got 4"),
        ([0.0, math.nan, 0.0], r"data\[1\] must be finite, got nan"),
    ):
        with pytest.raises(CommandError, match=f"^/actions: {words}"):
            applied(topic, {"data": values})
    assert len(acted) == 1
    assert topic.rest is not None
    topic.rest()
    assert acted[-1] == []


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (twist(math.nan, 0.0), "linear.x must be finite, got nan; the message was left out"),
        (twist(0.0, -math.inf), "angular.z must be finite, got -inf"),
        (twist(1.0, 0.0, 0.5), "linear.y must be 0, got 0.5; this base does not move sideways"),
    ],
)
def test_wrong_twists_are_one_line(values: Any, words: str) -> None:
    moves = Moves()
    reads: Callable[[Any], Any] = velocity_topic(moves, no_rest, stamped=False, sideways=False).read
    with pytest.raises(CommandError, match=f"^/cmd_vel: {words}"):
        reads(message("geometry_msgs/msg/Twist", values))
    assert moves == []
