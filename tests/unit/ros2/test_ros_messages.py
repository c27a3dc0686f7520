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
