"""A graph of ROS 2 in memory, with a clock of its own: what the bridge needs of a node."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from simwarp.ros2.bridge_node import Answer, ServiceKind
from simwarp.ros2.ros_messages import MessageTypes

TYPES = MessageTypes()


def encoded(kind: str, values: Mapping[str, Any]) -> bytes:
    """A message as it goes over the network."""
    return bytes(TYPES.template(kind, values).data)


class RosGraph:
    """A `BridgeNode` whose other end is the test.

    Args:
        missing: packages that are not installed.

    Attributes:
        now: time of its clock [s], which goes on while it is waited for.
        sent: topic -> messages of the bridge.
        latched: topics whose last message is kept.
        others: topic -> types with which others publish.
        subscribers: of the bridge's topics.
        turns: called one after the other, one whenever the bridge lets the node handle something.
        always: called at each of these.
        warnings: lines.
        name, arguments: with which a command opened it.
    """

    name: str
    arguments: Any

    def __init__(self, *missing: str) -> None:
        self.now = 100.0
        self.missing = missing
        self.kinds: dict[str, str] = {}
        self.sent: dict[str, list[bytes]] = defaultdict(list)
        self.order: list[tuple[str, bytes]] = []
        self.latched: set[str] = set()
        self.others: dict[str, list[str]] = defaultdict(list)
        self.subscribers = 0
        self.received: dict[str, tuple[str, Callable[[bytes], None]]] = {}
        self.services: dict[str, tuple[ServiceKind, Answer]] = {}
        self.parameters: dict[str, tuple[int | float, Callable[[int | float], str]]] = {}
        self.turns: list[Callable[[], None]] = []
        self.always: Callable[[], None] = lambda: None
        self.warnings: list[str] = []

    def publish_to(self, topic: str, kind: str, *, latched: bool) -> Callable[[bytes], None] | None:
        if kind.partition("/")[0] in self.missing:
            return None
        self.kinds[topic] = kind
        if latched:
            self.latched.add(topic)

        def publish(data: bytes) -> None:
            assert isinstance(data, bytes)
            self.sent[topic].append(data)
            self.order.append((topic, data))

        return publish

    def subscribe(self, topic: str, kind: str, receive: Callable[[bytes], None]) -> bool:
        if kind.partition("/")[0] in self.missing:
            return False
        self.received[topic] = kind, receive
        return True

    def serve(self, name: str, kind: ServiceKind, answer: Answer) -> None:
        self.services[name] = kind, answer

    def parameter(self, name: str, value: int | float, change: Callable[[int | float], str]) -> None:
        self.parameters[name] = value, change

    def handle(self, seconds: float) -> None:
        self.always()
        if self.turns:
            self.turns.pop(0)()
        else:
            self.now += seconds

    def senders(self, topic: str) -> Sequence[str]:
        return list(self.others[topic])

    def listeners(self) -> int:
        return self.subscribers

    def warn(self, text: str) -> None:
        self.warnings.append(text)

    # ---- the other end -----------------------------------------------------------------------------------------------

    def send(self, topic: str, values: Mapping[str, Any]) -> None:
        """A message of another node."""
        kind, receive = self.received[topic]
        receive(encoded(kind, values))

    def call(self, service: str, data: bool = True) -> tuple[bool, str]:
        """A service of the bridge."""
        return self.services[service][1](data)

    def set(self, parameter: str, value: float) -> str:
        """Why a parameter was refused; ""."""
        return self.parameters[parameter][1](value)

    def read(self, topic: str) -> list[Any]:
        """Messages of a topic."""
        return [TYPES.read(self.kinds[topic], data) for data in self.sent[topic]]
