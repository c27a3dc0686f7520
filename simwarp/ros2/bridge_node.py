"""What the bridge needs of a node: topics, services and parameters by name, and its turn to be called."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias


class ServiceKind(enum.Enum):
    """Types of services, which come with every installation of ROS 2."""

    TRIGGER = "std_srvs/srv/Trigger"
    """Does something."""
    SET_BOOL = "std_srvs/srv/SetBool"
    """Switches something."""


Answer: TypeAlias = Callable[[bool], tuple[bool, str]]
"""Of a service: what is asked for (True of a Trigger) -> whether it was done, and a line about it."""


class BridgeNode(Protocol):
    """A node of ROS 2. Messages are bytes in CDR, as they go over the network."""

    def publish_to(self, topic: str, kind: str, *, latched: bool) -> Callable[[bytes], None] | None:
        """A topic with messages of a type such as `sensor_msgs/msg/Imu`; returns what sends one. None: the type is not
        installed. Where `latched`, who comes later gets the last message, too.
        """
        ...

    def subscribe(self, topic: str, kind: str, receive: Callable[[bytes], None]) -> bool:
        """Receives the messages of a topic, all of them in their order. False: the type is not installed."""
        ...

    def serve(self, name: str, kind: ServiceKind, answer: Answer) -> None:
        """A service, of a name below the node's."""
        ...

    def parameter(self, name: str, value: int | float, change: Callable[[int | float], str]) -> None:
        """A parameter; `change` is called with a new value of that type, and returns why it is refused, else ""."""
        ...

    def handle(self, seconds: float) -> None:
        """Calls what has something to receive or to answer; returns at the latest after so much time without any."""
        ...

    def senders(self, topic: str) -> Sequence[str]:
        """Types of messages with which others publish to a topic, one for each publisher."""
        ...

    def listeners(self) -> int:
        """Subscriptions of others to the topics of this node."""
        ...

    def warn(self, text: str) -> None:
        """A line for the log of ROS."""
        ...
