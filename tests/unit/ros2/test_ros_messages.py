"""Messages whose numbers are written in place: the bytes are those that the library serialises."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from simwarp.ros2.frame_names import Names, topic_word
from simwarp.ros2.ros_messages import MessageTypes

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = MessageTypes()
KINDS: dict[str, Any] = {
    "rosgraph_msgs/msg/Clock": {},
    "sensor_msgs/msg/Imu": {"header": {"frame_id": "imu"}},
    "sensor_msgs/msg/NavSatFix": {"header": {"frame_id": "gps_link"}},
    "sensor_msgs/msg/MagneticField": {"header": {"frame_id": ""}},
    "nav_msgs/msg/Odometry": {"header": {"frame_id": "odom"}, "child_frame_id": "base_link"},
    "sensor_msgs/msg/CameraInfo": {"distortion_model": "plumb_bob", "d": np.zeros(5)},
    "sensor_msgs/msg/JointState": {"name": ["a", "longer", ""], "position": np.zeros(3), "effort": np.zeros(3)},
    "geometry_msgs/msg/WrenchStamped": {"header": {"frame_id": "ab"}},
    "geometry_msgs/msg/TwistStamped": {"header": {"frame_id": "abc"}},
    "sensor_msgs/msg/Image": {"encoding": "rgb8", "data": np.zeros(7, np.uint8)},
    "sensor_msgs/msg/PointCloud2": {"fields": [{"name": "x"}, {"name": "intensity"}], "data": np.zeros(5, np.uint8)},
    "tf2_msgs/msg/TFMessage": {"transforms": [{"child_frame_id": "x" * n} for n in range(4)]},
}  # fmt: skip


def leaf(message: Any, path: str) -> Any:
    """The value at a path such as `transforms[2].header.stamp.sec`."""
    for part in path.replace("[", ".[").split("."):
        message = message[int(part[1:-1])] if part.startswith("[") else getattr(message, part)
    return message


@pytest.mark.parametrize("kind", KINDS)
def test_every_number_is_written_where_the_library_reads_it(kind: str) -> None:
    template = TYPES.template(kind, KINDS[kind])
    rng, wanted = np.random.default_rng(7), {}
    for path in template._places:
        cells = template.numbers(path)
        values = rng.integers(0, 2 if cells.dtype == bool else 100, cells.shape).astype(cells.dtype)
        if cells.dtype.kind == "f":
            values = rng.normal(size=cells.shape).astype(cells.dtype)
        cells[...] = values
        wanted[path] = values
    message = STORE.deserialize_cdr(bytes(template.data), kind)
    for path, values in wanted.items():
        assert np.array_equal(np.atleast_1d(leaf(message, path)), values), path
    # and what is no number is as it was given
    assert bytes(STORE.serialize_cdr(message, kind)) == bytes(template.data)


def test_a_table_and_a_stamp_reach_all_transforms() -> None:
    kind = "tf2_msgs/msg/TFMessage"
    template = TYPES.template(kind, KINDS[kind])
    cells = template.doubles([[f"transforms[{k}].transform.translation.{axis}" for axis in "xyz"] for k in range(4)])
    values = np.arange(12.0).reshape(4, 3) / 7.0
    cells.write(values)
    template.stamp(5_000_000_321)
    for transform, row in zip(STORE.deserialize_cdr(bytes(template.data), kind).transforms, values, strict=True):
        assert (transform.header.stamp.sec, transform.header.stamp.nanosec) == (5, 321)
        place = transform.transform.translation
        assert (place.x, place.y, place.z) == tuple(row)


@pytest.mark.parametrize(
    ("name", "word"),
    [("hood-camera", "hood_camera"), ("a//b c", "a_b_c"), ("3d", "n3d"), ("Lidär", "Lid_r"), ("-", "unnamed")],
)
def test_words_of_topics_are_those_that_ros_takes(name: str, word: str) -> None:
    assert topic_word(name) == word


def test_names_differ() -> None:
    names = Names("map")
    assert [names("map"), names("a"), names("a"), names("a_2")] == ["map_2", "a", "a_2", "a_2_2"]


LATER = [store for store in Stores if store.name.startswith("ROS2_") and store.name > "ROS2_HUMBLE"]
USED = [*KINDS, "geometry_msgs/msg/Twist", "std_msgs/msg/Float64MultiArray"]


@pytest.mark.parametrize("store", LATER, ids=lambda store: store.name)
def test_later_distributions_have_the_same_definitions(store: Stores) -> None:
    later = get_typestore(store)
    for kind in USED:
        # fields, those of messages within it included; comments and constants may differ
        pending, seen = [kind], set()
        while pending:
            name = pending.pop()
            if name in seen:
                continue
            seen.add(name)
            assert later.get_msgdef(name).fields == STORE.get_msgdef(name).fields, name
            for _, description in STORE.get_msgdef(name).fields:
                inner: Any = description
                while isinstance(inner[1], tuple) and isinstance(inner[1][0], tuple):
                    inner = inner[1][0]
                if inner[0].name == "NAME":
                    pending.append(inner[1])
        assert len(seen) > (kind == "nav_msgs/msg/Odometry") * 8


def test_bytes_that_are_no_message_are_an_error() -> None:
    for data in (b"", b"\0\1\0\0", b"\0\1\0\0" + bytes(range(20))):
        with pytest.raises(ValueError, match=rf"{len(data)} bytes are no geometry_msgs/msg/Twist"):
            TYPES.read("geometry_msgs/msg/Twist", data)


def test_an_ackermann_command_reads_back() -> None:
    kind = "ackermann_msgs/msg/AckermannDriveStamped"
    template = TYPES.template(kind, {"header": {"frame_id": "base_link"}, "drive": {"speed": 1.5}})
    template.numbers("drive.steering_angle")[...] = -0.25
    message = TYPES.read(kind, bytes(template.data))
    assert (message.header.frame_id, message.drive.speed, message.drive.steering_angle) == ("base_link", 1.5, -0.25)
    assert len(template.data) == 4 + 8 + 4 + 10 + 2 + 5 * 4  # two bytes align the numbers
