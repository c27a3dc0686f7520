"""An MCAP file of ROS 2 messages that grows while it is written: what its finished chunks hold survives a crash."""

from __future__ import annotations

import enum
import struct
import time
import zlib
from pathlib import Path
from typing import IO, Any, Final

from simwarp.core.files import output_error
from simwarp.mcap.mcap_extra import not_installed
from simwarp.ros2.ros_messages import MessageTypes, Template

try:
    import lz4.frame
    import zstandard
    from mcap.data_stream import RecordBuilder
    from mcap.opcode import Opcode
    from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Footer, Header, Schema, Statistics, SummaryOffset
    from mcap.writer import MCAP0_MAGIC
except ImportError as error:
    raise not_installed(error) from None

CHUNK: Final = 4 * 2**20
"""Bytes of messages at which a chunk ends."""
ROOM: Final = 2**18
"""Bytes beyond them that are kept for the last message, at first."""
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


MESSAGE: Final = struct.Struct("<BQHIQQ")
"""Head of a message: opcode, length of what follows, channel, number, log time, publish time."""
MESSAGE_HEAD: Final = MESSAGE.size - 9
"""Bytes of it that count as the message's."""
INDEX: Final = struct.Struct("<BQHI")
"""Head of the index of a channel's messages in a chunk: opcode, length, channel, bytes of (time, place) pairs."""
FOOTER: Final = struct.Struct("<BQQQ")
"""Beginning of the footer that its own checksum covers: opcode, length, places of the summary and of its groups."""


class McapFile:
    """A file with a channel for each topic, its messages in chunks (MCAP 0, https://mcap.dev/spec).

    Records are the library's; messages and their index are written here, many times as fast as by its Writer.

    Args:
        path: of the file, which is replaced.
        compression: of its chunks.

    Attributes:
        path: of the file.
        types: of the messages.
        size: bytes of all messages, before compression.
        closed: whether the file is complete.

    Raises:
        OutputError: the disk did not take it; so do the methods.
    """

    def __init__(self, path: Path, compression: Compression) -> None:
        self.path, self.types = path, MessageTypes()
        self.size, self.closed = 0, False
        self._compression = compression
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: dict[int, int] = {}
        # It grows once: memory that is made anew for each chunk would cost as much as its compression
        self._chunk, self._filled, self._begun = bytearray(CHUNK + ROOM), 0, time.monotonic()
        self._places: dict[int, list[int]] = {}
        """Time and place in the chunk of each message, by channel."""
        self._open, self._first, self._last = False, 0, 0
        self._chunks: list[ChunkIndex] = []
        self._stream: IO[bytes] | None = None
        try:
            self._stream = path.open("wb")
            self._stream.write(MCAP0_MAGIC)
            self._append(Header("ros2", "simwarp"))
        except OSError as error:
            raise self._failed(error) from error

    @property
    def messages(self) -> int:
        """Number that was written."""
        return sum(self._counts.values())

    def channel(self, topic: str, kind: str, *, latched: bool = False) -> int:
        """A new topic with messages of a type such as `sensor_msgs/msg/Imu`; returns its number.

        Args:
            topic: its name.
            kind: of its messages.
            latched: its last message is for those who come later, too.
        """
        if kind not in self._schemas:
            text = self.types.definition(kind).encode()
            self._schemas[kind] = Schema(id=len(self._schemas) + 1, data=text, encoding="ros2msg", name=kind)
            self._add(_bytes_of(self._schemas[kind]))
        number, schema = len(self._channels) + 1, self._schemas[kind].id
        metadata = {"offered_qos_profiles": LATCHED if latched else ""}
        self._channels[number] = Channel(
            id=number, topic=topic, message_encoding="cdr", schema_id=schema, metadata=metadata
        )
        self._add(_bytes_of(self._channels[number]))
        self._counts[number], self._places[number] = 0, []
        return number

    def write(self, channel: int, template: Template, time: int) -> None:
        """Writes a message as it is now.

        Args:
            channel: of its topic.
            template: the message.
            time: at which it is delivered [ns]; it never goes back.
        """
        data, place = template.data, self._filled
        size = len(data)
        self._counts[channel] = count = self._counts[channel] + 1
        if not self._open:
            self._open, self._first = True, time
        self._last = time
        self._places[channel] += (time, place)
        begin = place + MESSAGE.size
        self._filled = end = begin + size
        if end > len(self._chunk):
            self._chunk += bytes(end - len(self._chunk))
        MESSAGE.pack_into(self._chunk, place, Opcode.MESSAGE, MESSAGE_HEAD + size, channel, count, time, time)
        self._chunk[begin:end] = data
        self.size += size
        if end >= CHUNK:
            self.flush()

    def _add(self, record: bytes) -> None:
        """A record for the chunk, which is no message."""
        begin, self._filled = self._filled, self._filled + len(record)
        self._chunk += bytes(max(self._filled - len(self._chunk), 0))
        self._chunk[begin : self._filled] = record

    def tick(self) -> None:
        """Ends a chunk that has been open for long."""
        if self._open and time.monotonic() - self._begun > LONGEST_CHUNK:
            self.flush()

    def flush(self) -> None:
        """Ends the chunk and hands it to the operating system."""
        try:
            self._end_chunk()
            self._file().flush()
        except OSError as error:
            raise self._failed(error) from error
        self._begun = time.monotonic()

    def close(self) -> None:
        """Ends the file; a second call does nothing."""
        if self.closed or self._stream is None:
            return
        try:
            self._end_chunk()
            self._append(DataEnd(0))
            self._end_file()
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

    def _file(self) -> IO[bytes]:
        assert self._stream is not None
        return self._stream

    def _append(self, record: Any) -> None:
        self._file().write(_bytes_of(record))

    def _end_chunk(self) -> None:
        """Writes the chunk and the index of its messages."""
        if not self._open:
            return
        file = self._file()
        with memoryview(self._chunk) as whole, whole[: self._filled] as chunk:
            data, checksum = _compressed(chunk, self._compression), zlib.crc32(chunk)
        name = "" if self._compression is Compression.NONE else self._compression.value
        place = file.tell()
        self._append(Chunk(
            compression=name, data=data, message_start_time=self._first, message_end_time=self._last,
            uncompressed_crc=checksum, uncompressed_size=self._filled,
        ))  # fmt: skip
        end, offsets = file.tell(), {}
        for channel, places in self._places.items():
            if places:
                offsets[channel] = file.tell()
                pairs = struct.pack(f"<{len(places)}Q", *places)
                file.write(INDEX.pack(Opcode.MESSAGE_INDEX, INDEX.size - 9 + len(pairs), channel, len(pairs)) + pairs)
                places.clear()
        self._chunks.append(ChunkIndex(
            message_start_time=self._first, message_end_time=self._last, chunk_start_offset=place,
            chunk_length=end - place, message_index_offsets=offsets, message_index_length=file.tell() - end,
            compression=name, compressed_size=len(data), uncompressed_size=self._filled,
        ))  # fmt: skip
        self._filled, self._open = 0, False

    def _end_file(self) -> None:
        """Writes the summary, by which readers find topics and chunks, and the footer."""
        file = self._file()
        begin, summary, offsets = file.tell(), RecordBuilder(), []
        statistics = Statistics(
            attachment_count=0, channel_count=len(self._channels), channel_message_counts=self._counts,
            chunk_count=len(self._chunks), message_count=self.messages, metadata_count=0,
            message_start_time=self._chunks[0].message_start_time if self._chunks else 0,
            message_end_time=self._last, schema_count=len(self._schemas),
        )  # fmt: skip
        groups: list[tuple[Opcode, list[Any]]] = [
            (Opcode.SCHEMA, [*self._schemas.values()]), (Opcode.CHANNEL, [*self._channels.values()]),
            (Opcode.STATISTICS, [statistics]), (Opcode.CHUNK_INDEX, [*self._chunks]),
        ]  # fmt: skip
        for code, records in groups:
            start = summary.count
            for record in records:
                record.write(summary)
            offsets.append(SummaryOffset(code, begin + start, summary.count - start))
        of_groups = begin + summary.count
        for offset in offsets:
            offset.write(summary)
        data = summary.end()
        head = FOOTER.pack(Opcode.FOOTER, 8 + 8 + 4, begin, of_groups)
        file.write(data)
        self._append(Footer(summary_start=begin, summary_offset_start=of_groups, summary_crc=zlib.crc32(data + head)))
        file.write(MCAP0_MAGIC)


def _bytes_of(record: Any) -> bytes:
    """A record of the library, serialised."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def _compressed(data: memoryview, compression: Compression) -> bytes:
    if compression is Compression.LZ4:
        return bytes(lz4.frame.compress(data))
    return bytes(zstandard.compress(data) if compression is Compression.ZSTD else data)
