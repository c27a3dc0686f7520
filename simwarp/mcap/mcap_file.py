"""An MCAP file of ROS 2 messages that grows while it is written: what its finished chunks hold survives a crash."""

from __future__ import annotations

import enum
import time
from pathlib import Path
from typing import IO, Any, Final

from simwarp.core.files import output_error
from simwarp.mcap.mcap_extra import not_installed
from simwarp.ros2.ros_messages import MessageTypes, Template

try:
    from mcap.writer import CompressionType, Writer
except ImportError as error:
    raise not_installed(error) from None

CHUNK: Final = 4 * 2**20
"""Bytes of messages at which a chunk ends."""
LONGEST_CHUNK: Final = 1.0
"""Time by the clock after which a chunk ends [s]: what a crash may lose."""
LATCHED: Final = (
    "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n  deadline: {sec: 9223372036, nsec: 854775807}\n"
    "  lifespan: {sec: 9223372036, nsec: 854775807}\n  liveliness: 1\n"
    "  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}\n  avoid_ros_namespace_conventions: false"
)
"""Quality of service of topics whose last message is for those who come later, too: keep the last, reliable, transient
local."""


class Compression(enum.Enum):
    """Compression of the chunks of a file."""

    NONE = "none"
    LZ4 = "lz4"
    """Fast."""
    ZSTD = "zstd"
    """Smaller and slower."""


class McapFile:
    """A file with a channel for each topic.

    Args:
        path: of the file, which is replaced.
        compression: of its chunks.

    Attributes:
        path: of the file.
        types: of the messages.
        messages: number that was written.
        size: bytes of all messages, before compression.
        closed: whether the file is complete.

    Raises:
        OutputError: the disk did not take it; so do the methods.
    """

    def __init__(self, path: Path, compression: Compression) -> None:
        self.path, self.types = path, MessageTypes()
        self.messages, self.size, self.closed = 0, 0, False
        self._schemas: dict[str, int] = {}
        self._counts: dict[int, int] = {}
        self._pending, self._begun = 0, time.monotonic()
        self._stream: IO[bytes] | None = None
        try:
            self._stream = path.open("wb")
            kind = CompressionType[compression.name]
            # Chunks end here and not in the library, which does not hand them on to the disk
            self._writer = Writer(self._stream, chunk_size=2**62, compression=kind)
            self._writer.start(profile="ros2", library="simwarp")
        except OSError as error:
            raise self._failed(error) from error

    def channel(self, topic: str, kind: str, *, latched: bool = False) -> int:
        """A new topic with messages of a type such as `sensor_msgs/msg/Imu`; returns its number.

        Args:
            topic: its name.
            kind: of its messages.
            latched: its last message is for those who come later, too.
        """
        if kind not in self._schemas:
            text = self.types.definition(kind).encode()
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text)
        metadata = {"offered_qos_profiles": LATCHED if latched else ""}
        number: int = self._writer.register_channel(topic, "cdr", self._schemas[kind], metadata)
        self._counts[number] = 0
        return number

    def write(self, channel: int, template: Template, time: int) -> None:
        """Writes a message as it is now.

        Args:
            channel: of its topic.
            template: the message.
            time: at which it is delivered [ns].
        """
        self._counts[channel] += 1
        # it is copied, so that its memory may be written into again
        data: Any = template.data
        self._writer.add_message(channel, time, data, time, self._counts[channel])
        self.messages += 1
        self.size += len(template.data)
        self._pending += len(template.data)
        if self._pending >= CHUNK:
            self.flush()

    def tick(self) -> None:
        """Ends a chunk that has been open for long."""
        if self._pending and time.monotonic() - self._begun > LONGEST_CHUNK:
            self.flush()

    def flush(self) -> None:
        """Ends the chunk and hands it to the operating system."""
        try:
            self._writer.flush()
        except OSError as error:
            raise self._failed(error) from error
        self._pending, self._begun = 0, time.monotonic()

    def close(self) -> None:
        """Ends the file; a second call does nothing."""
        if self.closed or self._stream is None:
            return
        try:
            self._writer.finish()
            self._stream.close()
        except OSError as error:
            raise self._failed(error) from error
        self.closed = True

    def _failed(self, error: OSError) -> Exception:
        """Leaves the file as it is: readers recover its finished chunks."""
        self.closed = True
        stream: Any = self._stream
        if stream is not None:
            # What is still in its buffer would fail again
            try:
                stream.close()
            except OSError:
                stream.raw.close()
        return output_error(self.path, error)
