"""`simwarp ros2`: vehicles, tasks and scenes in a graph in memory; and what it refuses."""

import contextlib
import json
import sys

import numpy as np
import pytest

from tests.unit.ros2.ros_graph import RosGraph

TWIST = {"linear": {"x": 2.0}, "angular": {"z": 0.25}}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def graph(monkeypatch):
    """What the command gets in place of ROS; the bridge has the graph's clock, too."""
    made = RosGraph()
    made.arguments = None

    @contextlib.contextmanager
    def node(name, arguments):
        made.name, made.arguments = name, arguments
        yield made

    monkeypatch.setattr("simwarp.cli.ros.ros2_command.rclpy_node", node)
    for module in ("simwarp.cli.ros.ros2_command", "simwarp.ros2.rclpy_node"):
        monkeypatch.setattr(f"{module}.check_rclpy", lambda: None)
    return made


def controlled(graph, topic, values, steps):
    """A controller that answers every state with the same command."""
    seen = [0]

    def look():
        if topic in graph.received and len(graph.sent["/tf"]) > seen[0] and seen[0] < steps:
            seen[0] = len(graph.sent["/tf"])
            graph.send(topic, values)
        graph.others[topic] = [graph.received[topic][0]]
        graph.subscribers = 1

    graph.always = look


def test_a_vehicle_in_lock_step_repeats_bit_by_bit(folder, command, graph):
    orders = []
    for name in ("a", "b"):
        graph.order.clear()
        graph.sent.clear()
        controlled(graph, "/cmd_vel", TWIST, 1000)
        words = ("ros2", "gator-14dof", "--lock-step", "--seconds", "1", "--sensors", "mems-imu@0:0:0.5", "--seed", "3")
        code, out, err = command(*words, "--json", f"{name}.json")
        assert code == 0, err
        orders.append(list(graph.order))
    assert orders[0] == orders[1]
    assert "steps of 0.02 s; takes /cmd_vel (geometry_msgs/msg/Twist), /ackermann_cmd" in out
    assert "50 steps, 1.000 s simulated in" in out
    content = json.loads((folder / "a.json").read_text())
    assert (content["steps"], content["refused"], content["missed"]) == (50, 0, {"mems-imu": 0})
    assert content["time"] == pytest.approx(1.0, abs=1e-6)
    assert len(graph.read("/odom")) == 51
    assert graph.read("/odom")[-1].twist.twist.linear.x > 0.5  # it drives
    assert graph.read("/vehicle/commands")[-1].position[0] > 0.0  # to the left
    assert len(graph.read("/mems_imu/data")) > 50
    frames = {each.child_frame_id: each for each in graph.read("/tf_static")[0].transforms}
    assert frames["mems_imu_link"].transform.translation.z == 0.5


def test_a_reset_of_a_vehicle_begins_anew(folder, command, graph):
    controlled(graph, "/cmd_vel", TWIST, 1000)
    look = graph.always
    done: list[int] = []

    def reset_once():
        look()
        if len(graph.sent["/odom"]) == 20 and not done:
            done.append(graph.call("reset"))

    graph.always = reset_once
    code, _, err = command("ros2", "gator-14dof", "--lock-step", "--seconds", "0.6")
    assert code == 0, err
    assert done == [(True, "begins anew; /clock goes on")]
    x = [each.pose.pose.position.x for each in graph.read("/odom")]
    assert len(x) == 32
    assert x[20] == x[0]
    assert x[1:12] == x[21:32]  # what came before plays no part


def test_a_task_takes_actions(folder, command, graph):
    states = {}
    for value in (0.0, 0.5):
        graph.sent.clear()
        controlled(graph, "/actions", {"data": [value]}, 1000)
        words = ("ros2", "pendulum", "--checkpoint", "zero", "--lock-step", "--seconds", "0.4", "--json", "a.json")
        code, _, err = command(*words)
        assert code == 0, err
        states[value] = [each.velocity[0] for each in graph.read("/joint_states")]
    content = json.loads((folder / "a.json").read_text())
    assert content["commands"] == ["/actions"]
    assert len(states[0.5]) == content["steps"] + 1
    assert states[0.0][0] == states[0.5][0]
    assert states[0.0][1] != states[0.5][1]
    assert set(graph.services) == {"reset", "pause", "step"}
    assert "seed" in graph.parameters


def test_a_seed_draws_the_worlds_of_a_reset(folder, command, graph):
    begun = {}
    for seed in (3, 4):
        graph.sent.clear()
        controlled(graph, "/actions", {"data": [0.0]}, 1000)
        look = graph.always
        done: list[int] = []

        def reset_once(look=look, done=done, seed=seed):
            look()
            if len(graph.sent["/odom"]) == 5 and not done:
                assert graph.set("seed", seed) == ""
                done.append(graph.call("reset"))

        graph.always = reset_once
        words = ("ros2", "pendulum", "--checkpoint", "zero", "--lock-step", "--seconds", "0.2")
        assert command(*words)[0] == 0
        assert done == [(True, f"begins anew with seed {seed}; /clock goes on")]
        begun[seed] = [each.position[0] for each in graph.read("/joint_states")][:6]
    assert begun[3][:5] == begun[4][:5]
    assert begun[3][5] != begun[4][5]


def test_actions_of_another_length_are_refused(folder, command, graph):
    controlled(graph, "/actions", {"data": [0.5, 0.5]}, 1)
    words = ("ros2", "pendulum", "--checkpoint", "zero", "--lock-step", "--seconds", "0.4", "--wait-timeout", "0.2")
    code, out, err = command(*words)
    assert (code, err.count("\n")) == (1, 1)
    assert "simwarp: ros2: waiting for /actions (std_msgs/msg/Float64MultiArray) at 0.000 s" in err
    assert err.endswith("--wait-timeout 0.2 ends it\n")
    assert "warning: /actions: data must hold 1 numbers, got 2; give a whole action" in out


def test_a_policy_follows_commanded_speeds(folder, command, graph):
    controlled(graph, "/cmd_vel", {"linear": {"x": 0.5, "y": 100.0}, "angular": {"z": -0.25}}, 1000)
    seen = []
    import simwarp.cli.ros.ros2_targets as targets

    speeds = targets._speeds

    def kept(commands, before, stamped):
        topic = speeds(commands, before, stamped)
        before.append(lambda: seen.append({name: float(each.values[0]) for name, each in commands.items()}))
        return topic

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(targets, "_speeds", kept)
        words = ("ros2", "quadruped-velocity", "--checkpoint", "zero", "--lock-step", "--seconds", "0.1")
        code, _, err = command(*words)
    assert code == 0, err
    assert len(seen) == 5
    assert {"ahead", "left", "turn"} == set(seen[0])
    for each in seen:
        assert each["ahead"] == 0.5
        assert each["turn"] == -0.25
        assert 0.0 < each["left"] < 100.0  # within what it was trained for


def test_a_scene_takes_joint_commands_and_arguments_go_to_ros(folder, command, graph):
    graph.turns = [lambda: graph.send("/joint_commands", {"name": graph.names[:1], "effort": [0.5]})]
    words = ("ros2", "four-bar", "--real-time-factor", "0", "--seconds", "0.1", "--node", "bench")
    graph.names = ["crank_pivot"]
    code, _, err = command(*words, "--ros-args", "-r", "__ns:=/lab", "--", "--json", "a.json")
    assert code == 0, err
    assert graph.arguments == ["--ros-args", "-r", "__ns:=/lab"]
    assert graph.name == "bench"
    assert json.loads((folder / "a.json").read_text())["commands"] == ["/joint_commands"]
    joints = graph.read("/joint_states")[-1]
    assert np.isfinite(joints.position).all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("pendulum", "ros2: must have module 'rclpy' of ROS 2, got none; source /opt/ros/DISTRO/setup.bash"),
        ("gator", "ros2: must have module 'rclpy' of ROS 2, got none; source /opt/ros/DISTRO/setup.bash"),
        ("gatr", "nothing is called 'gatr'; did you mean"),
        ("gator --wait-for /cmd_vel", "--wait-for: is of --lock-step; add it, or leave this out"),
        ("gator --wait-timeout 3", "--wait-timeout: is of --lock-step; add it, or leave this out"),
        ("gator --lock-step --real-time-factor 2", "--real-time-factor: is of free running; in --lock-step commands"),
        ("gator --real-time-factor nan", "real-time-factor must be"),
        ("gator --command-timeout -1", "--command-timeout must be from 0 to 1e+06, got -1"),
        ("gator --seconds 0", "--seconds must be positive and at most 1e+06, got 0"),
        ("gator --rate -5", "--rate must be positive, got -5"),
        ("gator --seed -1", "--seed must be a whole number from 0 to"),
        ("pendulum --sensors vlp-16", "--sensors: are mounted on vehicles; a task has sensors of its own"),
        ("gator --sensors vlp-16@1:2", "a place must be x:y:z in metres, got '1:2' of 'vlp-16'"),
    ],
)  # fmt: skip
def test_mistakes_are_one_line(folder, command, monkeypatch, arguments, words):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    code, _, err = command("ros2", *arguments.split())
    assert (code, err.count("\n")) == (2, 1), err
    assert words in err
    assert list(folder.iterdir()) == []


def test_topics_that_a_target_does_not_take_are_one_line(folder, command, graph):
    code, _, err = command("ros2", "four-bar", "--lock-step", "--wait-for", "/cmd_vel")
    assert (code, err.count("\n")) == (2, 1)
    assert "ros2: 'four-bar' takes no /cmd_vel: it has no base that can be driven; it takes /joint_commands" in err
