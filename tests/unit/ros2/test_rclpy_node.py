"""The node of rclpy: where ROS 2 is present, with a second node at the other end; what is said where it is not."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import simwarp as sw
from simwarp.ros2.bridge import Bridge, BridgeOptions
from simwarp.ros2.rclpy_node import check_rclpy, rclpy_node
from tests.project.page_commands import python_blocks
from tests.unit.mcap.recordings import stamp
from tests.unit.ros2.test_bridge import JOINTS, TORQUES, Rig

ROOT = Path(__file__).parents[3]
PATIENCE = 20.0
"""For discovery, on a loaded machine [s]."""


def test_without_ros_one_line_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(
        sw.ModelError, match=r"ros2: must have module 'rclpy' of ROS 2, got none; source /opt/ros/"
    ) as e:
        check_rclpy()
    assert "\n" not in str(e.value)


class Peer:
    """Another node, in a context of its own."""

    def __init__(self, rclpy: Any, name: str) -> None:
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        self.context = rclpy.Context()
        rclpy.init(context=self.context, args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node(name, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def spin(self) -> None:
        for _ in range(20):
            self.executor.spin_once(timeout_sec=0.0)

    def call(self, kind: Any, name: str, **fields: Any) -> Callable[[], Any]:
        """A service; returns what gives its answer, None before."""
        client = self.node.create_client(kind, name)
        assert client.wait_for_service(timeout_sec=PATIENCE)
        future = client.call_async(kind.Request(**fields))
        return lambda: future.result() if future.done() else None

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def peer(monkeypatch: pytest.MonkeyPatch) -> Iterator[Peer]:
    rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not present")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    made = Peer(rclpy, "peer")
    yield made
    made.close()


def bridged(node: Any, rig: Rig, options: BridgeOptions) -> Bridge:
    return Bridge(node, rig.target, options, rig.lines.append)


def test_a_controller_in_lock_step_repeats_the_run_of_the_graph_in_memory(peer: Peer) -> None:
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import Imu, JointState

    alone = Rig()
    alone.answer(TORQUES)
    alone.run(12)
    left, found = [*TORQUES], []
    publisher = peer.node.create_publisher(JointState, JOINTS, 10)

    def answer(state: Any) -> None:
        found.append(state)
        if left:
            publisher.publish(JointState(name=["hinge"], effort=[left.pop(0)]))

    sent: dict[str, list[bytes]] = {"/odom": [], "/imu/data": []}
    for topic, kind in (("/odom", Odometry), ("/imu/data", Imu)):
        peer.node.create_subscription(kind, topic, sent[topic].append, 100, raw=True)
    peer.node.create_subscription(Odometry, "/odom", answer, 10)
    rig, end = Rig(), time.monotonic() + PATIENCE

    def stop() -> bool:
        peer.spin()
        return time.monotonic() > end

    with rclpy_node("bridge") as node:
        bridge = bridged(node, rig, BridgeOptions(lock_step=True))
        bridge.run(stop, steps=12)
        while len(found) < 13 and not stop():
            pass
    assert bridge.steps == 12, rig.lines
    for topic, data in sent.items():
        assert data == alone.graph.sent[topic], topic
    for ours, theirs in zip(alone.graph.read("/odom"), found, strict=True):
        assert stamp(ours) == stamp(theirs)
        assert (ours.header.frame_id, ours.child_frame_id) == (theirs.header.frame_id, theirs.child_frame_id)
        for name in "xyz":
            assert getattr(ours.pose.pose.position, name) == getattr(theirs.pose.pose.position, name)
            assert getattr(ours.twist.twist.linear, name) == getattr(theirs.twist.twist.linear, name)


def test_services_parameters_and_wrong_messages(peer: Peer) -> None:
    from sensor_msgs.msg import JointState
    from std_srvs.srv import SetBool, Trigger

    rig = Rig(seeded=True)
    publisher = peer.node.create_publisher(JointState, JOINTS, 10)
    end = time.monotonic() + 3.0 * PATIENCE
    with rclpy_node("bridge", ["--ros-args", "-p", "seed:=5"]) as node:
        bridge = bridged(node, rig, BridgeOptions(factor=1.0))
        pending: list[Callable[[], Any]] = []
        script: list[Callable[[], Any]] = [
            lambda: pending.append(peer.call(SetBool, "/bridge/pause", data=True)),
            lambda: pending.append(peer.call(Trigger, "/bridge/step")),
            lambda: pending.append(peer.call(Trigger, "/bridge/reset")),
            lambda: pending.append(peer.call(SetBool, "/bridge/pause", data=False)),
        ]

        def stop() -> bool:
            peer.spin()
            if pending and pending[-1]() is None:
                return time.monotonic() > end
            if script:
                script.pop(0)()
                return False
            if publisher.get_subscription_count() and not bridge.refused:
                publisher.publish(JointState(name=["hinge"], effort=[math.nan]))
            return bridge.refused > 0 or time.monotonic() > end

        bridge.run(stop)
    answers = [each() for each in pending]
    assert [(each.success, each.message) for each in answers] == [
        (True, "paused"), (True, "takes one step of 0.02 s with the command that holds"),
        (True, "begins anew with seed 5; /clock goes on"), (True, "goes on"),
    ]  # fmt: skip
    assert rig.seeds == [5]
    assert rig.lines[-1] == "warning: /joint_commands: effort must be finite, got nan; the message was left out"


def test_the_controller_of_the_page_drives_a_vehicle(tmp_path: Path) -> None:
    pytest.importorskip("rclpy", reason="ROS 2 is not present")
    (block,) = python_blocks(ROOT / "docs" / "ros2.md")
    script = tmp_path / "controller.py"
    script.write_text(block, encoding="utf-8")
    words = ["ros2", "gator-14dof", "--lock-step", "--seconds", "0.5", "--wait-timeout", "60", "--json", "-"]
    controller = subprocess.Popen([sys.executable, str(script)], cwd=tmp_path)
    try:
        command = [sys.executable, "-m", "simwarp", *words]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=500, check=False)
    finally:
        controller.kill()
        controller.wait()
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert (content["steps"], content["refused"]) == (25, 0)
    assert "takes /cmd_vel (geometry_msgs/msg/Twist), /ackermann_cmd" in done.stderr


def test_names_that_ros_does_not_take_are_one_line(peer: Peer) -> None:
    with pytest.raises(sw.ModelError, match="ros2: name must be one of a node, got 'a-b' ") as found, rclpy_node("a-b"):
        pass
    assert "\n" not in str(found.value)
    with (
        pytest.raises(sw.ModelError, match=r"ros2: --ros-args must be followed by what ROS knows, got .*nonsense"),
        rclpy_node("bridge", ["--ros-args", "--nonsense"]),
    ):
        pass
