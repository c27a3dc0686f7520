"""``simwarp ros2``."""

from __future__ import annotations

import time
from typing import Any

from simwarp.cli import DONE, HELP, INTERRUPTED, ShortfallError
from simwarp.cli.options import parse_options, split_path
from simwarp.cli.ros.ros2_options import Ros2Options, split_ros
from simwarp.cli.ros.ros2_targets import plain_target, task_target, vehicle_target
from simwarp.cli.view.view_target import ViewTarget, find_target
from simwarp.core.stopping import stop_on_signals
from simwarp.ros2.bridge import Bridge, BridgeTarget, BridgeTimeoutError
from simwarp.ros2.rclpy_node import check_rclpy, rclpy_node


def run(arguments: list[str]) -> int:
    """Connect what the arguments say with ROS 2 until it is ended."""
    if HELP & set(arguments) and arguments[0].startswith("-"):
        parse_options(Ros2Options, arguments, "simwarp ros2 TARGET")
    name, arguments = split_path(arguments, "ros2", "TARGET")
    arguments, of_ros = split_ros(arguments)
    target = find_target(str(name))
    options: Any
    if target.kind == "task":
        options, make = task_target(target.name, arguments)
        options.check_bridge(target.kind)
        check_rclpy()
        options.console().print(f"building '{target.name}' ...", highlight=False, soft_wrap=True)
        return _serve(make(), options, of_ros)
    options = parse_options(Ros2Options, arguments, f"simwarp ros2 {target.name}")
    options.check_bridge(target.kind)
    check_rclpy()
    options.console().print(f"building '{target.name}' ...", highlight=False, soft_wrap=True)
    return _serve(_made(target, options), options, of_ros)


def _made(target: ViewTarget, options: Ros2Options) -> BridgeTarget:
    return vehicle_target(target.name, options) if target.kind == "vehicle" else plain_target(target, options)


def _serve(target: BridgeTarget, options: Ros2Options, of_ros: list[str]) -> int:
    """Runs the bridge; returns the exit code."""
    console = options.console()

    def say(text: str) -> None:
        console.print(text, highlight=False, soft_wrap=True)

    steps = None if options.seconds is None else max(1, round(options.seconds / target.dt))
    with rclpy_node(options.node, of_ros) as node, stop_on_signals() as stop:
        bridge = Bridge(node, target, options.bridge(), say)
        topics = ", ".join(f"{each.topic} ({each.kind})" for each in target.commands)
        way = "in lock-step" if options.lock_step else f"{options.real_time_factor:g} of real time"
        say(f"'{target.name}' in ROS 2, {way}, steps of {target.dt:g} s; takes {topics or 'no commands'}")
        begun = time.perf_counter()
        try:
            bridge.run(lambda: stop.requested, steps=steps)
        except BridgeTimeoutError as error:
            raise ShortfallError(str(error)) from error
        finally:
            wall = time.perf_counter() - begun
            say(f"{bridge.steps} steps, {bridge.elapsed:.3f} s simulated in {wall:.1f} s by the clock")
            options.emit(_content(target, options, bridge, wall))
    return INTERRUPTED if stop.requested else DONE


def _content(target: BridgeTarget, options: Ros2Options, bridge: Bridge, wall: float) -> dict[str, Any]:
    """For scripts."""
    return {
        "target": target.name, "lock_step": options.lock_step, "commands": [each.topic for each in target.commands],
        "steps": bridge.steps, "time": bridge.elapsed, "wall_s": wall, "lost_s": bridge.pace.lost,
        "refused": bridge.refused, "missed": bridge.missed,
    }  # fmt: skip
