"""Topics of sensors: the messages that a sensor's frame becomes."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.ros2.frame_names import OPTICAL
from simwarp.ros2.ros_messages import MessageTypes, Template
from simwarp.ros2.world_rows import row_of
from simwarp.sensors import (
    Camera,
    ContactSensor,
    Encoder,
    FishEye,
    Gps,
    Imu,
    Lidar,
    LoadCell,
    Magnetometer,
    Pinhole,
    Radar,
    Radial,
    Speedometer,
    Tachometer,
)
from simwarp.simulation.attachments import Sensor

ENCODINGS: Final = {
    "rgb": "rgb8", "grey": "mono8", "depth": "32FC1", "range": "32FC1", "normals": "32FC3", "instance": "32SC1",
    "semantic": "32SC1",
}  # fmt: skip
"""Of the images of a camera's outputs (REP 118 for depth)."""
FLOAT32: Final = 7
"""Datatype of a PointField."""
RPM: Final = math.pi / 30.0
"""In rad/s."""
XYZ: Final = ("x", "y", "z")


class Context(NamedTuple):
    """What makes topics of a sensor.

    Attributes:
        types: of the messages.
        world: that is recorded.
        word: the sensor's name in topics.
        frame: of the sensor's mount.
    """

    types: MessageTypes
    world: int
    word: str
    frame: str

    @property
    def optical(self) -> str:
        """Frame of a camera's images."""
        return f"{self.word}_optical_frame"

    def header(self, frame: str | None = None) -> dict[str, str]:
        """Header in the sensor's frame, or in another."""
        return {"frame_id": frame or self.frame}


class Output(NamedTuple):
    """A topic, its message, and what writes the sensor's frame into that."""

    topic: str
    kind: str
    template: Template
    fill: Callable[[], None]


@functools.singledispatch
def outputs_of(sensor: Sensor, context: Context) -> list[Output]:
    """Topics of a sensor; none of a class that is not known."""
    return []


def optical_rotation(sensor: Sensor) -> tuple[float, ...] | None:
    """Rotation xyzw of the optical frame in that of a camera's mount; None of other sensors."""
    return OPTICAL if isinstance(sensor, Camera) else None


def mount_of(sensor: Sensor) -> Any:
    """Where a sensor is: the arrays of its mount; None of one whose messages tell of joints."""
    return None if isinstance(sensor, Tachometer) else getattr(sensor, "mount", None)


def _nothing() -> None:
    """Of a message that does not change."""


def _vector(
    template: Template, path: str, array: wp.array, world: int, first: int = 0, names: Sequence[str] = XYZ
) -> Callable[[], None]:
    """Writes three components of a frame into fields x, y and z."""
    row = row_of(array, world)
    cells = template.doubles([[f"{path}.{name}" for name in names]])

    def fill() -> None:
        cells.write(row()[first : first + len(names)])

    return fill


# ---- what casts rays -------------------------------------------------------------------------------------------------


@outputs_of.register
def _of_camera(sensor: Camera, context: Context) -> list[Output]:
    found = []
    for name, array in sensor.outputs.items():
        base = f"/{context.word}/{name}"
        info = context.types.template("sensor_msgs/msg/CameraInfo", camera_info(sensor, context.optical))
        image = _image(array, context, context.optical, ENCODINGS[name], turned=name == "normals")
        found += [
            Output(f"{base}/image_raw", "sensor_msgs/msg/Image", *image),
            Output(f"{base}/camera_info", "sensor_msgs/msg/CameraInfo", info, _nothing),
        ]
    return found


def _image(
    array: wp.array, context: Context, frame: str, encoding: str, *, turned: bool = False
) -> tuple[Template, Callable[[], None]]:
    """An image (W, height, width, channels), and what writes it; `turned`: vectors of the camera's axes."""
    _, height, width, channels = array.shape
    dtype = np.dtype(wp.dtype_to_numpy(array.dtype))
    step = width * channels * dtype.itemsize
    template = context.types.template(
        "sensor_msgs/msg/Image",
        {
            "header": context.header(frame), "height": height, "width": width, "encoding": encoding, "step": step,
            "data": np.zeros(height * step, np.uint8),
        },
    )  # fmt: skip
    pixels = template.numbers("data").view(dtype).reshape(height, width, channels)
    row = row_of(array, context.world)

    def fill() -> None:
        pixels[...] = row()

    def fill_turned() -> None:
        forward, left, up = np.moveaxis(row(), -1, 0)
        pixels[..., 0], pixels[..., 1], pixels[..., 2] = -left, -up, forward

    return template, fill_turned if turned else fill


def camera_info(sensor: Camera, frame: str) -> dict[str, Any]:
    """Fields of a camera's CameraInfo; the middle of the first pixel is at (0, 0) there."""
    config, lens = sensor.config, sensor.config.lens
    width, height = config.width, config.height
    model, distortion = "plumb_bob", np.zeros(5)
    if isinstance(lens, FishEye):
        focal, model, distortion = width / lens.fov, "equidistant", np.zeros(4)
    elif isinstance(lens, (Pinhole, Radial)):
        focal = 0.5 * width / math.tan(0.5 * lens.fov)
        if isinstance(lens, Radial):
            distortion = np.array([lens.k1, lens.k2, 0.0, 0.0, lens.k3])
    else:
        focal, model, distortion = 0.0, "", np.zeros(0)  # a lens of one's own: not calibrated
    matrix = np.zeros((3, 4))
    if focal > 0.0:
        matrix[0, 0] = matrix[1, 1] = focal
        matrix[0, 2], matrix[1, 2], matrix[2, 2] = 0.5 * (width - 1), 0.5 * (height - 1), 1.0
    return {
        "header": {"frame_id": frame}, "height": height, "width": width, "distortion_model": model, "d": distortion,
        "k": matrix[:, :3], "r": np.eye(3), "p": matrix,
    }  # fmt: skip


@outputs_of.register
def _of_lidar(sensor: Lidar, context: Context) -> list[Output]:
    if "points" not in sensor.config.outputs:
        image = _image(sensor.ranges, context, context.frame, f"32FC{2 * sensor.returns}")
        return [Output(f"/{context.word}/ranges", "sensor_msgs/msg/Image", *image)]
    rows, columns = sensor.config.beams.shape
    row = row_of(sensor.points, context.world)
    found = []
    for number, topic in enumerate(("points", "points_first")[: sensor.returns]):
        template, points = _cloud(context, rows, columns, (*XYZ, "intensity"))
        fill = functools.partial(_fill_points, row, points, slice(4 * number, 4 * number + 4))
        found.append(Output(f"/{context.word}/{topic}", "sensor_msgs/msg/PointCloud2", template, fill))
    return found


def _cloud(context: Context, rows: int, columns: int, names: Sequence[str]) -> tuple[Template, npt.NDArray[np.float32]]:
    """A cloud of float32 fields, and their memory (rows, columns, fields)."""
    fields = [{"name": name, "offset": 4 * index, "datatype": FLOAT32, "count": 1} for index, name in enumerate(names)]
    step = 4 * len(names)
    template = context.types.template(
        "sensor_msgs/msg/PointCloud2",
        {
            "header": context.header(), "height": rows, "width": columns, "fields": fields, "point_step": step,
            "row_step": step * columns, "data": np.zeros(rows * columns * step, np.uint8), "is_dense": False,
        },
    )  # fmt: skip
    return template, template.numbers("data").view(np.float32).reshape(rows, columns, len(names))


def _fill_points(row: Callable[[], npt.NDArray[Any]], points: npt.NDArray[np.float32], channels: slice) -> None:
    """Points, NaN where nothing returned."""
    points[...] = row()[..., channels]
    points[points[..., 3] == 0.0, :3] = np.nan


@outputs_of.register
def _of_radar(sensor: Radar, context: Context) -> list[Output]:
    rows, columns = sensor.config.rays.shape
    names = (*XYZ, "range_rate", "amplitude", "instance")
    template, points = _cloud(context, rows, columns, names)
    row = row_of(sensor.data, context.world)

    def fill() -> None:
        values = row()
        distance, azimuth, elevation = (values[..., index].astype(np.float64) for index in range(3))
        level = distance * np.cos(elevation)
        points[..., 0], points[..., 1] = level * np.cos(azimuth), level * np.sin(azimuth)
        points[..., 2] = distance * np.sin(elevation)
        points[..., 3:] = values[..., 3:]
        points[values[..., 5] < 0.0, :3] = np.nan

    return [Output(f"/{context.word}/points", "sensor_msgs/msg/PointCloud2", template, fill)]


# ---- vectors ---------------------------------------------------------------------------------------------------------


@outputs_of.register
def _of_imu(sensor: Imu, context: Context) -> list[Output]:
    parts, unknown = sensor.config.outputs, np.eye(1, 9)[0] * -1.0
    values: dict[str, Any] = {
        "header": context.header(), "orientation": {"w": 1.0}, "orientation_covariance": unknown,
    }  # fmt: skip
    fields = {"gyroscope": "angular_velocity", "accelerometer": "linear_acceleration"}
    values |= {f"{field}_covariance": unknown for part, field in fields.items() if part not in parts}
    template = context.types.template("sensor_msgs/msg/Imu", values)
    fills = [_vector(template, fields[part], sensor.data, context.world, 3 * index) for index, part in enumerate(parts)]

    def fill() -> None:
        for each in fills:
            each()

    return [Output(f"/{context.word}/data", "sensor_msgs/msg/Imu", template, fill)]


@outputs_of.register
def _of_gps(sensor: Gps, context: Context) -> list[Output]:
    fix = context.types.template(
        "sensor_msgs/msg/NavSatFix", {"header": context.header(), "status": {"status": 0, "service": 1}}
    )
    cells, row = fix.doubles([["latitude", "longitude", "altitude"]]), row_of(sensor.data, context.world)
    speed = context.types.template("geometry_msgs/msg/TwistStamped", {"header": context.header("enu")})
    return [
        Output(f"/{context.word}/fix", "sensor_msgs/msg/NavSatFix", fix, lambda: cells.write(row())),
        Output(
            f"/{context.word}/vel", "geometry_msgs/msg/TwistStamped", speed,
            _vector(speed, "twist.linear", sensor.velocity, context.world),
        ),
    ]  # fmt: skip


@outputs_of.register
def _of_magnetometer(sensor: Magnetometer, context: Context) -> list[Output]:
    template = context.types.template("sensor_msgs/msg/MagneticField", {"header": context.header()})
    fill = _vector(template, "magnetic_field", sensor.data, context.world)
    return [Output(f"/{context.word}/mag", "sensor_msgs/msg/MagneticField", template, fill)]


@outputs_of.register
def _of_speedometer(sensor: Speedometer, context: Context) -> list[Output]:
    template = context.types.template("geometry_msgs/msg/TwistStamped", {"header": context.header()})
    fill = _vector(template, "twist.linear", sensor.data, context.world, names=("x",))
    return [Output(f"/{context.word}/twist", "geometry_msgs/msg/TwistStamped", template, fill)]


@outputs_of.register(ContactSensor)
@outputs_of.register(LoadCell)
def _of_force(sensor: Any, context: Context) -> list[Output]:
    template = context.types.template("geometry_msgs/msg/WrenchStamped", {"header": context.header()})
    fills = [_vector(template, "wrench.force", sensor.data, context.world)]
    if isinstance(sensor, LoadCell):
        fills.append(_vector(template, "wrench.torque", sensor.data, context.world, 3))

    def fill() -> None:
        for each in fills:
            each()

    return [Output(f"/{context.word}/wrench", "geometry_msgs/msg/WrenchStamped", template, fill)]


@outputs_of.register(Encoder)
@outputs_of.register(Tachometer)
def _of_turning(sensor: Any, context: Context) -> list[Output]:
    names, field, scale = [context.word], "velocity", 1.0
    if isinstance(sensor, Encoder):
        names = _joints_of(sensor)
        field = "velocity" if sensor.config.reading == "speed" else "position"
    elif sensor.config.unit == "rpm":
        scale = RPM
    template = context.types.template(
        "sensor_msgs/msg/JointState", {"name": names, field: np.zeros(len(names))}
    )  # fmt: skip
    cells, row = template.numbers(field), row_of(sensor.data, context.world)

    def fill() -> None:
        cells[...] = scale * row().astype(np.float64)

    return [Output(f"/{context.word}/joint_states", "sensor_msgs/msg/JointState", template, fill)]


def _joints_of(sensor: Encoder) -> list[str]:
    """Names of an encoder's joints, with a number where one has several coordinates."""
    found, starts = [], sensor.model.joint_dof_start
    for dof in sensor.dofs:
        joint = int(np.searchsorted(starts, dof, side="right")) - 1
        name = sensor.model.joint_names[joint]
        found.append(name if starts[joint + 1] - starts[joint] == 1 else f"{name}_{dof - starts[joint]}")
    return found
