"""A node of ROS 2 by rclpy: the only module that imports ROS."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

from simwarp.core.types import ModelError
from simwarp.ros2.bridge_node import Answer, ServiceKind

DEPTH: Final = 100
"""Messages that a topic keeps for who is slow."""
GLOBAL: Final = frozenset({"/clock", "/tf", "/tf_static"})
AT_ONCE: Final = 1000
"""Calls that are made in one turn, at most: who publishes without end does not stop the simulation."""


def _rclpy() -> Any:
    """The library.

    Raises:
        ModelError: it is not there.
    """
    try:
        return importlib.import_module("rclpy")
    except ImportError as error:
        raise ModelError(
            f"ros2: must have module '{error.name}' of ROS 2, got none; source /opt/ros/DISTRO/setup.bash, and install "
            "simwarp for the Python of that ROS"
        ) from None


def check_rclpy() -> None:
    """Refuses to go on where there is no ROS, before any work is done.

    Raises:
        ModelError: there is none.
    """
    _rclpy()


@contextmanager
def rclpy_node(name: str, arguments: Sequence[str] = ()) -> Iterator[RclpyNode]:
    """A node for as long as the context lasts. Signals are left to the caller.

    Args:
        name: of the node.
        arguments: of ROS, `--ros-args` and what follows.

    Raises:
        ModelError: there is no ROS, or no such name.
    """
    rclpy = _rclpy()
    from rclpy.exceptions import InvalidNodeNameException
    from rclpy.signals import SignalHandlerOptions

    context = rclpy.Context()
    try:
        rclpy.init(args=[*arguments], context=context, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # of arguments that ROS does not know, or cannot read
        text = " ".join(str(error).split())
        raise ModelError(
            f"ros2: --ros-args must be followed by what ROS knows, got {text}; see ros2 run --help"
        ) from None
    try:
        try:
            made = RclpyNode(rclpy.create_node(name, context=context), context)
        except InvalidNodeNameException as error:
            text = " ".join(str(error).split())
            raise ModelError(f"ros2: name must be one of a node, got '{name}' ({text}); take letters and _") from None
        try:
            yield made
        finally:
            made.close()
    finally:
        rclpy.try_shutdown(context=context)


class RclpyNode:
    """A `BridgeNode`.

    Args:
        node: of rclpy.
        context: of the node.
    """

    def __init__(self, node: Any, context: Any) -> None:
        from rclpy.executors import SingleThreadedExecutor

        self._node = node
        self._executor: Any = SingleThreadedExecutor(context=context)
        self._executor.add_node(node)
        self._calls = 0
        self._changes: dict[str, Callable[[int | float], str]] = {}
        self._publishers: list[Any] = []
        node.add_on_set_parameters_callback(self._changed)

    def publish_to(self, topic: str, kind: str, *, latched: bool) -> Callable[[bytes], None] | None:
        """A topic; None: the type is not installed."""
        from rclpy.qos import DurabilityPolicy, QoSProfile

        found = _type_of(kind)
        if found is None:
            return None
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        profile = QoSProfile(depth=1 if latched else DEPTH, durability=durability)
        publisher = self._node.create_publisher(found, _in_namespace(topic), profile)
        self._publishers.append(publisher)
        publish: Callable[[bytes], None] = publisher.publish
        return publish

    def subscribe(self, topic: str, kind: str, receive: Callable[[bytes], None]) -> bool:
        """Receives a topic; False: the type is not installed."""
        found = _type_of(kind)
        if found is None:
            return False

        def called(data: bytes) -> None:
            self._calls += 1
            receive(bytes(data))

        self._node.create_subscription(found, _in_namespace(topic), called, DEPTH, raw=True)
        return True

    def serve(self, name: str, kind: ServiceKind, answer: Answer) -> None:
        """A service below the node's name."""

        def called(request: Any, response: Any) -> Any:
            self._calls += 1
            response.success, response.message = answer(getattr(request, "data", True))
            return response

        self._node.create_service(_type_of(kind.value), f"~/{name}", called)

    def parameter(self, name: str, value: int | float, change: Callable[[int | float], str]) -> None:
        """A parameter, which may be given on the command line, too."""
        self._changes[name] = change
        self._node.declare_parameter(name, value)

    def handle(self, seconds: float) -> None:
        """Calls what is due; waits for it."""
        self._executor.spin_once(timeout_sec=seconds)
        for _ in range(AT_ONCE):
            before = self._calls
            self._executor.spin_once(timeout_sec=0.0)
            if self._calls == before:
                return

    def senders(self, topic: str) -> Sequence[str]:
        """Types of messages with which others publish to a topic."""
        return [each.topic_type for each in self._node.get_publishers_info_by_topic(_in_namespace(topic))]

    def listeners(self) -> int:
        """Subscriptions of others to this node's topics."""
        return sum(each.get_subscription_count() for each in self._publishers)

    def warn(self, text: str) -> None:
        """A line for the log of ROS."""
        self._node.get_logger().warning(text)

    def close(self) -> None:
        """Leaves ROS."""
        self._executor.shutdown()
        self._node.destroy_node()

    def _changed(self, parameters: Sequence[Any]) -> Any:
        from rcl_interfaces.msg import SetParametersResult

        self._calls += 1
        for each in parameters:
            change = self._changes.get(each.name)
            reason = "" if change is None else change(each.value)
            if reason:
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)


def _in_namespace(topic: str) -> str:
    """A topic's name, below the namespace of the node; clock and frames are those of all nodes."""
    return topic if topic in GLOBAL else topic.removeprefix("/")


def _type_of(kind: str) -> Any:
    """Class of a type such as `sensor_msgs/msg/Imu`; None where its package is not installed."""
    package, folder, name = kind.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{folder}"), name)
    except (ImportError, AttributeError):
        return None
