"""ROS 2 messages of a fixed size: the library serialises one, and afterwards its numbers are written in place.

Serialising a message anew takes as long as hundreds of its numbers: a recording would slow down a fast simulation.
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.ros2.messages_extra import not_installed

try:
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore
except ImportError as error:
    raise not_installed(error) from None

HEADER: Final = 4
"""Bytes of a serialised message before its fields; they are aligned from there."""
STAMP: Final = struct.Struct("<iI")
"""Of a time: seconds, nanoseconds."""
SECOND: Final = 1_000_000_000
"""In nanoseconds."""
FURTHER: Final = {
    "ackermann_msgs/msg/AckermannDrive": (
        "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\nfloat32 acceleration\nfloat32 jerk\n"
    ),
    "ackermann_msgs/msg/AckermannDriveStamped": "std_msgs/Header header\nackermann_msgs/AckermannDrive drive\n",
}
"""Definitions of messages that are common and no part of an installation."""

Places = dict[str, tuple[np.dtype[Any], int, int]]
"""Path of a field -> dtype, first byte, count."""


class MessageTypes:
    """The common message types of ROS 2: their definitions, and messages with all fields that are not given zero."""

    def __init__(self) -> None:
        self._store = _store()

    def definition(self, kind: str) -> str:
        """Text of a message type such as `sensor_msgs/msg/Imu`, with those that it is made of."""
        return str(self._store.generate_msgdef(kind, ros_version=2)[0])

    def read(self, kind: str, data: bytes) -> Any:
        """The message that serialised bytes hold.

        Raises:
            ValueError: they hold no message of this type.
        """
        try:
            return self._store.deserialize_cdr(data, kind)
        except Exception as error:  # the library raises what its generated code meets: SerdeError, struct.error, ...
            raise ValueError(f"{len(data)} bytes are no {kind}") from error

    def template(self, kind: str, values: Mapping[str, Any]) -> Template:
        """A message of fields by name, those of messages within it as mappings in turn."""
        message = self._message(kind, values)
        data = bytearray(self._store.serialize_cdr(message, kind))
        found: Places = {}
        end = self._places(message, (Nodetype.NAME, kind), HEADER, "", found)
        assert end == len(data), f"{kind}: {end} bytes were expected, got {len(data)}"
        return Template(data, found)

    def _message(self, kind: str, values: Mapping[str, Any]) -> Any:
        fields = self._store.get_msgdef(kind).fields
        names = [name for name, _ in fields]
        assert set(values) <= set(names), f"{kind} has {names}, got {[*values]}"
        return self._store.types[kind](**{name: self._value(inner, values.get(name)) for name, inner in fields})

    def _value(self, description: Any, given: Any) -> Any:
        node, what = description
        if node is Nodetype.NAME:
            return self._message(what, given or {})
        if node is Nodetype.BASE:
            nothing: Any = "" if what[0] == "string" else False if what[0] == "bool" else 0
            return nothing if given is None else given
        inner, length = what
        if inner[0] is Nodetype.BASE and inner[1][0] != "string":
            count = length if node is Nodetype.ARRAY else 0
            dtype = np.dtype(inner[1][0])
            return np.zeros(count, dtype) if given is None else np.array(given, dtype).reshape(-1)
        return [self._value(inner, each) for each in given or ()]

    def _places(self, value: Any, description: Any, at: int, path: str, found: Places) -> int:
        """Enters the numbers of a value that begins at a byte; returns where it ends (CDR, OMG formal/02-06-51, 15.3).

        A number begins at a multiple of its size.
        """
        node, what = description
        if node is Nodetype.NAME:
            for name, inner in self._store.get_msgdef(what).fields:
                at = self._places(getattr(value, name), inner, at, f"{path}.{name}" if path else name, found)
            return at
        if node is Nodetype.BASE:
            if what[0] == "string":
                return _aligned(at, 4) + 4 + len(value.encode()) + 1
            return _enter(found, path, np.dtype(what[0]), at, 1)
        inner, _ = what
        if node is Nodetype.SEQUENCE:
            at = _aligned(at, 4) + 4
        if inner[0] is Nodetype.BASE and inner[1][0] != "string":
            return _enter(found, path, np.dtype(inner[1][0]), at, len(value)) if len(value) else at
        for index, each in enumerate(value):
            at = self._places(each, inner, at, f"{path}[{index}]", found)
        return at


@functools.cache
def _store() -> Any:
    """The library's types, which it makes code for as they are asked for: tenths of a second, once in a process."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    for kind, text in FURTHER.items():
        store.register(get_types_from_msg(text, kind))
    return store


def _aligned(at: int, size: int) -> int:
    return HEADER + -(-(at - HEADER) // size) * size


def _enter(found: Places, path: str, dtype: np.dtype[Any], at: int, count: int) -> int:
    at = _aligned(at, dtype.itemsize)
    found[path] = (dtype, at, count)
    return at + count * dtype.itemsize


class Template:
    """A serialised message whose numbers may be changed.

    Args:
        data: the message.
        places: of its numbers.

    Attributes:
        data: the message as it is now.
    """

    def __init__(self, data: bytearray, places: Places) -> None:
        self.data = data
        self._places = places
        stamps = [path for path in places if path.endswith(("stamp.sec", "clock.sec"))]
        self._only = places[stamps[0]][1] if len(stamps) == 1 else None
        self._seconds = self._slots(stamps, 4)
        self._words = np.frombuffer(data, np.uint32, (len(data) - HEADER) // 4, HEADER)

    def stamp(self, time: int) -> None:
        """Writes a time [ns] into all of its stamps."""
        seconds, rest = divmod(time, SECOND)
        if self._only is not None:
            STAMP.pack_into(self.data, self._only, seconds, rest)
            return
        self._words[self._seconds], self._words[self._seconds + 1] = seconds, rest

    def numbers(self, path: str) -> npt.NDArray[Any]:
        """(n,) the numbers of a field, to be written: views of the message."""
        dtype, at, count = self._places[path]
        return np.frombuffer(self.data, dtype, count, at)

    def doubles(self, paths: Sequence[Sequence[str]]) -> Doubles:
        """A table of float64 numbers from anywhere in the message.

        Args:
            paths: of each number, row by row.
        """
        return Doubles(self.data, np.array([self._slots(row, 8) for row in paths]))

    def _slots(self, paths: Sequence[str], size: int) -> npt.NDArray[np.int64]:
        return np.array([(self._places[path][1] - HEADER) // size for path in paths], np.int64)


class Doubles:
    """Float64 numbers of a message.

    Args:
        data: the message.
        slots: of the numbers, counted from the first field.
    """

    def __init__(self, data: bytearray, slots: npt.NDArray[np.int64]) -> None:
        self._all = np.frombuffer(data, np.float64, (len(data) - HEADER) // 8, HEADER)
        self._slots = slots

    def write(self, values: npt.ArrayLike) -> None:
        """Writes all of them, in the shape of the table."""
        self._all[self._slots] = values
