"""The bridge: lock-step, free running, services, what it says where nothing comes, and what it refuses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp import sensors as s
from simwarp.ros2.bridge import Bridge, BridgeOptions, BridgeTarget, BridgeTimeoutError
from simwarp.ros2.command_topics import CommandTopic, joint_topic, velocity_topic
from tests.unit.mcap.recordings import ns, stamp
from tests.unit.ros2.ros_graph import RosGraph

DT = 0.01
STEPS = 2
"""Physics steps of a control step."""
JOINTS = "/joint_commands"
LOCK = BridgeOptions(lock_step=True)


class Rig:
    """A hinged arm with an inertial unit, bridged into a graph in memory."""

    def __init__(self, options: BridgeOptions = LOCK, *missing: str, **changes: Any) -> None:
        builder = sw.ModelBuilder()
        hull = builder.add_body("hull", mass=2.0, inertia=(0.2, 0.3, 0.4), pose=sw.pose((0, 0, 5.0)))
        arm = builder.add_body("arm", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.5, 0, 5.0)))
        builder.add_joint_revolute("hinge", hull, arm, anchor=(0.2, 0.0, 5.0), axis=(0.0, 1.0, 0.0))
        model = builder.finalize(1, "cpu")
        imu = s.Imu(model, s.Mount("arm"), s.ImuConfig(schedule=s.Schedule(rate=100.0, lag=0.01)))
        self.sim = sw.Simulation(model, DT, sensors=[imu], threads=1)
        self.seeds: list[int] = []
        self.rests = 0
        self.moves: list[float] = []
        joints = joint_topic(self.sim, 0)
        assert joints is not None
        commands: list[CommandTopic] = [joints]
        if changes.pop("mobile", False):

            def move(ahead: float, left: float, turn: float) -> None:
                self.moves.append(ahead)

            commands.append(velocity_topic(move, lambda: move(0.0, 0.0, 0.0), stamped=False, sideways=False))
        fields: dict[str, Any] = {"commands": commands, "refusal": "it has no base that can be driven"}
        self.target = BridgeTarget("arm", self.sim, STEPS * DT, self._advance, self._reset, **(fields | changes))
        self.graph = RosGraph(*missing)
        self.lines: list[str] = []
        self.options = options
        self.bridge = Bridge(self.graph, self.target, options, self.lines.append, clock=lambda: self.graph.now)

    def _advance(self, seen: Any) -> None:
        for _ in range(STEPS):
            self.sim.step()
            seen()

    def _reset(self, seed: int) -> None:
        self.seeds.append(seed)
        self.sim.reset()

    def torque(self, value: float) -> None:
        """A command of the controller."""
        self.graph.send(JOINTS, {"name": ["hinge"], "effort": [value]})

    def answer(self, values: list[float]) -> None:
        """A controller that answers every state with the next of some torques."""
        seen, left = [0], list(values)

        def look() -> None:
            states = len(self.graph.sent["/odom"])
            if states > seen[0] and left:
                seen[0] = states
                self.torque(left.pop(0))

        self.graph.always = look
        self.join()

    def join(self) -> None:
        """The controller is there: it publishes commands and listens to the state."""
        self.graph.others[JOINTS] = ["sensor_msgs/msg/JointState"]
        self.graph.subscribers = 1

    def run(self, steps: int, seconds: float = 1e9) -> None:
        end = self.graph.now + seconds
        self.bridge.run(lambda: self.graph.now >= end, steps=steps)


TORQUES = [0.5 * math.sin(0.7 * step) for step in range(12)]


# ---- lock-step -------------------------------------------------------------------------------------------------------


def test_the_nth_command_moves_the_nth_step() -> None:
    rig = Rig()
    rig.answer(TORQUES)
    rig.run(12)
    alone = Rig()
    states = [alone.sim.state.joint_qd.numpy()[0].copy()]
    for torque in TORQUES:
        alone.sim.control.joint_force[:, alone.sim.model.dof("hinge")] = torque
        for _ in range(STEPS):
            alone.sim.step()
        states.append(alone.sim.state.joint_qd.numpy()[0].copy())
    found = [float(each.velocity[0]) for each in rig.graph.read("/joint_states")]
    column = alone.sim.model.dof("hinge")
    assert found == [float(each[column]) for each in states]
    assert rig.bridge.steps == 12


def test_the_same_commands_repeat_a_run_bit_by_bit() -> None:
    quick, slow = Rig(), Rig()
    quick.answer(TORQUES)
    slow.answer(TORQUES)
    look, calls = slow.graph.always, [0]

    def late() -> None:
        """Seconds between a state and its command."""
        calls[0] += 1
        if calls[0] % 7 == 0:
            slow.graph.now += 3.0
            look()

    slow.graph.always = late
    quick.run(12)
    slow.run(12)
    assert quick.graph.order == slow.graph.order
    assert len(quick.graph.order) > 12 * 5
    assert slow.graph.now - quick.graph.now > 30.0


def test_each_step_ends_with_its_state_and_the_clock() -> None:
    rig = Rig()
    rig.answer(TORQUES[:4])
    rig.run(4)
    clocks = [each.clock.sec * 1_000_000_000 + each.clock.nanosec for each in rig.graph.read("/clock")]
    ends = [ns(step * STEPS * DT) for step in range(5)]
    states = [stamp(each) for each in rig.graph.read("/odom")]
    assert np.allclose(states, ends, atol=10)
    assert np.allclose(sorted(set(clocks) & set(states)), states)
    frames = [stamp(each) for each in rig.graph.read("/imu/data")]
    assert np.allclose(frames, [ns(step * DT) for step in range(8)], atol=10)  # one step late: its lag
    assert rig.bridge.missed == {"imu": 0}


def test_commands_that_come_at_once_are_kept() -> None:
    rig = Rig()
    rig.join()

    def send() -> None:
        for value in TORQUES[:5]:
            rig.torque(value)

    rig.graph.turns = [send]
    rig.run(5)
    assert rig.bridge.steps == 5
    assert rig.sim.control.joint_force.numpy()[0, rig.sim.model.dof("hinge")] == np.float32(TORQUES[4])


def test_it_waits_for_a_controller_before_the_first_state() -> None:
    rig = Rig()
    rig.run(3, seconds=5.0)
    assert rig.graph.order == []  # who comes later would have missed it
    rig.join()
    rig.run(0)
    assert len(rig.graph.sent["/odom"]) == 1


def test_a_controller_that_listens_to_nothing_is_enough() -> None:
    rig = Rig()
    rig.graph.turns = [lambda: None, lambda: rig.torque(0.1)]
    rig.run(1)
    assert rig.bridge.steps == 1


def test_what_it_waits_for_is_a_line() -> None:
    rig = Rig()
    rig.run(1, seconds=25.0)
    text = "waiting for /joint_commands (sensor_msgs/msg/JointState) at 0.000 s, for {} s by the clock: "
    text += "nobody publishes it"
    assert rig.lines == [text.format(2), text.format(12), text.format(22)]
    rig.lines.clear()
    rig.graph.others[JOINTS] = ["std_msgs/msg/Float64MultiArray"]
    rig.run(1, seconds=3.0)
    assert len(rig.lines) == 1
    assert rig.lines[0].endswith("it is published as std_msgs/msg/Float64MultiArray, which is another type")
    rig.lines.clear()
    rig.answer(TORQUES[:2])
    rig.run(3, seconds=4.0)
    (line,) = rig.lines
    assert line.startswith("waiting for /joint_commands (sensor_msgs/msg/JointState) at 0.040 s, for 2 s by the clock:")
    assert line.endswith("somebody publishes it, and nothing more has come")


def test_waiting_may_end_the_bridge() -> None:
    rig = Rig(BridgeOptions(lock_step=True, wait_timeout=1.5))
    with pytest.raises(BridgeTimeoutError, match=r"^ros2: waiting for /joint_commands .*; --wait-timeout 1.5 ends it"):
        rig.run(1)
    assert rig.graph.now == pytest.approx(101.5, abs=0.2)


def test_a_command_that_is_refused_moves_no_step() -> None:
    rig = Rig()
    rig.join()
    rig.graph.turns = [
        lambda: rig.graph.send(JOINTS, {"name": ["hinge"], "effort": [math.nan]}),
        lambda: rig.graph.send(JOINTS, {"name": ["hing"], "effort": [1.0]}),
        lambda: rig.graph.received[JOINTS][1](b"\0\1\0\0junk"),
    ]
    rig.run(1, seconds=1.0)
    assert (rig.bridge.steps, rig.bridge.refused) == (0, 3)
    assert rig.graph.warnings == [
        "/joint_commands: effort must be finite, got nan; the message was left out",
        "/joint_commands: no joint of one coordinate is called 'hing'; did you mean 'hinge'?",
        "/joint_commands: 8 bytes are no sensor_msgs/msg/JointState; the message was left out",
    ]
    assert rig.lines == [f"warning: {text}" for text in rig.graph.warnings]


def test_the_same_mistake_again_and_again_is_a_line_every_five_seconds() -> None:
    rig = Rig(BridgeOptions(factor=1.0))
    rig.graph.always = lambda: rig.torque(math.nan)
    rig.run(10_000, seconds=12.0)
    assert rig.bridge.refused > 500
    assert len(rig.graph.warnings) == 3


def test_another_topic_may_be_waited_for() -> None:
    rig = Rig(BridgeOptions(lock_step=True, wait_for="/cmd_vel"), mobile=True)
    drive = {"linear": {"x": 1.5}}
    rig.graph.turns = [
        lambda: rig.torque(0.25), lambda: rig.torque(0.5), lambda: rig.graph.send("/cmd_vel", drive),
        lambda: rig.graph.send("/cmd_vel", drive),
    ]  # fmt: skip
    rig.run(2)
    assert rig.moves == [1.5, 1.5]
    assert rig.sim.control.joint_force.numpy()[0, rig.sim.model.dof("hinge")] == 0.5


# ---- free running ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [0.5, 1.0, 4.0])
def test_time_runs_at_a_factor_of_the_clocks(factor: float) -> None:
    rig = Rig(BridgeOptions(factor=factor))
    rig.run(50)
    assert rig.graph.now - 100.0 == pytest.approx(49 * STEPS * DT / factor, rel=1e-6)
    assert rig.lines == []


def test_the_newest_command_holds() -> None:
    rig = Rig(BridgeOptions(factor=1.0))
    rig.graph.turns = [lambda: rig.torque(0.25), lambda: rig.torque(0.5)]
    rig.run(10)
    assert rig.bridge.steps == 10
    assert rig.sim.control.joint_force.numpy()[0, rig.sim.model.dof("hinge")] == 0.5


def test_a_base_rests_where_no_command_comes_any_more() -> None:
    rig = Rig(BridgeOptions(factor=1.0, command_timeout=0.1), mobile=True)
    rig.graph.turns = [lambda: rig.graph.send("/cmd_vel", {"linear": {"x": 2.0}})]
    rig.run(10)
    assert rig.moves == [2.0, 0.0]
    assert rig.lines == ["no /cmd_vel for 0.1 s of simulated time: it rests until the next one"]
    rig.graph.turns = [lambda: rig.graph.send("/cmd_vel", {"linear": {"x": 3.0}})]
    rig.run(12)
    assert rig.moves == [2.0, 0.0, 3.0]
    never = Rig(BridgeOptions(factor=1.0, command_timeout=0.0), mobile=True)
    never.graph.turns = [lambda: never.graph.send("/cmd_vel", {"linear": {"x": 2.0}})]
    never.run(100)
    assert never.moves == [2.0]


def test_a_simulation_that_is_too_slow_says_so() -> None:
    rig = Rig(BridgeOptions(factor=1.0))

    def slow() -> None:
        rig.graph.now += 0.05

    rig.graph.always = slow
    rig.run(10_000, seconds=13.0)
    assert len(rig.lines) == 2
    for line in rig.lines:
        assert line.startswith("lags: 0.40 of real time, 1 was asked for; /clock goes as slowly"), line


def test_commands_of_another_type_are_a_line() -> None:
    rig = Rig(BridgeOptions(factor=1.0), mobile=True)
    rig.graph.others["/cmd_vel"] = ["geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/Twist"]
    rig.run(10_000, seconds=20.0)
    (line,) = rig.graph.warnings
    assert line.startswith(
        "/cmd_vel is published as geometry_msgs/msg/TwistStamped, and must be geometry_msgs/msg/Twist"
    )


# ---- services and parameters -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("lock_step", [True, False])
def test_a_reset_begins_anew_and_the_clock_goes_on(lock_step: bool) -> None:
    rig = Rig(BridgeOptions(lock_step=lock_step, seed=3), seeded=True)
    rig.join()
    rig.graph.turns = [lambda: rig.torque(0.5), lambda: rig.torque(0.5)]
    rig.run(2)
    rig.torque(0.25)  # of the episode that ends
    assert rig.graph.set("seed", 7) == ""
    assert rig.graph.call("reset") == (True, "begins anew with seed 7; /clock goes on")
    rig.run(2, seconds=0.5)
    rig.graph.turns = [lambda: rig.torque(0.125)]
    rig.run(3, seconds=0.5)
    assert rig.seeds == [7]
    times = [each.clock.sec + 1e-9 * each.clock.nanosec for each in rig.graph.read("/clock")]
    assert times == sorted(times)
    heights = [each.pose.pose.position.z for each in rig.graph.read("/odom")]
    assert heights.count(5.0) >= 2  # of the first state, and after the reset
    assert rig.graph.set("seed", -1) == "seed must be an integer >= 0, got -1"


def test_what_has_no_seed_has_no_parameter_for_it() -> None:
    rig = Rig()
    assert "seed" not in rig.graph.parameters
    assert rig.graph.call("reset") == (True, "begins anew; /clock goes on")


def test_a_pause_holds_time() -> None:
    rig = Rig(BridgeOptions(factor=1.0))
    rig.graph.turns = [lambda: rig.graph.call("pause", True) and None]
    rig.run(10, seconds=3.0)
    before = rig.bridge.steps
    assert before <= 1
    assert rig.graph.call("step") == (True, "takes one step of 0.02 s with the command that holds")
    rig.run(10, seconds=1.0)
    assert rig.bridge.steps == before + 1
    assert rig.graph.call("pause", False) == (True, "goes on")
    assert rig.graph.call("step") == (False, "must be paused; call pause with data: true")
    begun = rig.graph.now
    rig.run(before + 11)
    assert rig.graph.now - begun == pytest.approx(9 * STEPS * DT, abs=1e-6)  # what was paused is not made up for


def test_a_pause_holds_commands_in_lock_step() -> None:
    rig = Rig()
    rig.join()
    rig.graph.call("pause", True)
    rig.graph.turns = [lambda: rig.torque(0.25)]
    rig.run(3, seconds=30.0)
    assert (rig.bridge.steps, rig.lines) == (0, [])
    assert rig.graph.call("step")[0]
    rig.run(3, seconds=0.5)
    assert rig.bridge.steps == 1
    assert not rig.sim.control.joint_force.numpy().any()  # a step of its own
    rig.graph.call("pause", False)
    rig.run(3, seconds=0.5)
    assert rig.bridge.steps == 2


def test_the_factor_may_be_changed() -> None:
    rig = Rig(BridgeOptions(factor=1.0))
    rig.run(10)
    assert rig.graph.set("real_time_factor", 0.5) == ""
    begun = rig.graph.now
    rig.run(30)
    assert rig.graph.now - begun == pytest.approx(20 * 2.0 * STEPS * DT, abs=2.0 * STEPS * DT)
    assert rig.graph.set("real_time_factor", -1.0) == (
        "real_time_factor must be from 0 (as fast as it goes) to 1000, got -1"
    )
    assert "real_time_factor" not in Rig().graph.parameters


# ---- what is not there -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "changes", "message"),
    [
        ({"wait_for": "/cmd_vel"}, {}, "'arm' takes no /cmd_vel: it has no base that can be driven; it takes /joint"),
        ({"wait_for": "/joint_command"}, {}, "takes no /joint_command: .*; did you mean '/joint_commands'?"),
        ({}, {"commands": []}, "'arm' takes no commands: it has no base that can be driven; leave out --lock-step"),
        ({"rate": 10.0}, {}, "rate must be at least 50 in lock-step, where controllers wait .*, got 10; leave it out"),
    ],
)  # fmt: skip
def test_mistakes_are_one_line(options: Any, changes: Any, message: str) -> None:
    with pytest.raises(sw.ModelError, match=message) as found:
        Rig(BridgeOptions(lock_step=True, **options), **changes)
    assert "\n" not in str(found.value)


def test_types_that_are_not_installed_are_left_out() -> None:
    rig = Rig(BridgeOptions(factor=0.0), "tf2_msgs", "geometry_msgs", mobile=True)
    assert rig.graph.warnings == [
        "/tf is left out: tf2_msgs is not installed; apt install ros-$ROS_DISTRO-tf2-msgs",
        "/tf_static is left out: tf2_msgs is not installed; apt install ros-$ROS_DISTRO-tf2-msgs",
        "/cmd_vel is left out: geometry_msgs is not installed; apt install ros-$ROS_DISTRO-geometry-msgs",
    ]
    rig.run(2)
    assert len(rig.graph.sent["/odom"]) == 3
    with pytest.raises(sw.ModelError, match="ros2: /cmd_vel: geometry_msgs is not installed; apt install ros-"):
        Rig(BridgeOptions(lock_step=True, wait_for="/cmd_vel"), "geometry_msgs", mobile=True)


def test_static_frames_are_kept_for_who_comes_later() -> None:
    rig = Rig(BridgeOptions(factor=0.0))
    rig.run(1)
    assert rig.graph.latched == {"/tf_static"}
    frames = {each.child_frame_id: each.header.frame_id for each in rig.graph.read("/tf_static")[0].transforms}
    assert frames == {"odom": "map", "imu_link": "arm"}


def test_what_it_listens_to_it_does_not_send() -> None:
    rig = Rig(BridgeOptions(factor=0.0))
    rig.run(1)
    assert not set(rig.graph.received) & set(rig.graph.kinds)
