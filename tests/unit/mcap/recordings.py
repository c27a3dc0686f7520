"""Readers of recordings, by two libraries that know nothing of each other."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader


class Read(NamedTuple):
    """A message, its topic, and the time at which it was delivered [ns]."""

    topic: str
    time: int
    message: Any


def read_by_mcap(path: Path) -> list[Read]:
    """All messages, decoded by mcap-ros2-support with the schemas in the file."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = reader.iter_decoded_messages(log_time_order=False)
        return [Read(channel.topic, message.log_time, decoded) for _, channel, message, decoded in found]


def read_by_rosbags(path: Path) -> list[Read]:
    """All messages, decoded by rosbags with the schemas in the file."""
    with AnyReader([path]) as reader:
        return [
            Read(connection.topic, time, reader.deserialize(data, connection.msgtype))
            for connection, time, data in reader.messages()
        ]


def stamp(message: Any) -> int:
    """Of a message's header [ns]."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def of(read: list[Read], topic: str) -> list[Read]:
    """Those of a topic."""
    return [each for each in read if each.topic == topic]


def vector(part: Any, names: str = "xyz") -> list[float]:
    """Numbers of a message's part."""
    return [getattr(part, name) for name in names]


def pixels(message: Any, dtype: Any) -> Any:
    """(height, width, C) of an image, or of points in rows and columns."""
    return np.frombuffer(bytes(message.data), dtype).reshape(message.height, message.width, -1)


def ns(time: float) -> int:
    """A time [s] in whole nanoseconds."""
    return round(time * 1_000_000_000)
