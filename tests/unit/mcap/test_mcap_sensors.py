"""Sensors in recordings: values, stamps with the lag, and frames that put what is seen where it is."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp import sensors as s
from simwarp.core.rotation import matrix_of
from simwarp.ros2.sensor_topics import camera_info
from tests.unit.mcap.recordings import Read, ns, of, pixels, read_by_mcap, read_by_rosbags, stamp, vector

DT, STEPS, WORLD = 0.005, 60, 1
SIGHT = s.Mount("car", sw.pose((0.4, 0.1, 0.3), (0.02, 0.15, 0.05, 0.98)))
"""Ahead and down, and turned about all axes."""


class Rig:
    """A car that flies over a ground and turns, in two worlds; a wheel on it; sensors of all sorts with lags."""

    def __init__(self, path: Path) -> None:
        builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
        car = builder.add_body("car", mass=10.0, inertia=(1, 1, 1), pose=sw.pose((0, 0, 1.0)), velocity=(3.0, 0.0, 0.0))
        builder.add_shape_sphere(car, radius=0.2)
        wheel = builder.add_body("wheel", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0, 0.5, 1.0)))
        builder.add_joint_revolute("axle", car, wheel, anchor=(0.0, 0.5, 1.0), axis=(0.0, 1.0, 0.0))
        visuals = s.Visuals(builder)
        visuals.add_plane(color=(0.3, 0.35, 0.2), reflectance=0.3)
        model = builder.finalize(2, "cpu")
        scene = visuals.finalize(model)
        lagging = s.Schedule(rate=50.0, lag=0.015)
        camera = s.CameraConfig(
            schedule=s.Schedule(rate=20.0, lag=0.02), width=32, height=18,
            outputs=("rgb", "grey", "depth", "range", "normals", "instance", "semantic"),
        )  # fmt: skip
        beams = s.beam_grid(16, 4, azimuth=(0.5, -0.5), elevation=(0.6, -0.3))
        self.camera = s.Camera(scene, SIGHT, camera, name="hood-camera")
        self.lidar = s.Lidar(scene, SIGHT, s.LidarConfig(schedule=lagging, beams=beams), name="roof lidar")
        self.dual = s.Lidar(scene, SIGHT, s.LidarConfig(schedule=lagging, beams=beams, mode="dual"), name="dual")
        self.ranges = s.Lidar(
            scene, SIGHT, s.LidarConfig(schedule=lagging, beams=beams, outputs="ranges"), name="ranges"
        )
        self.radar = s.Radar(scene, SIGHT, s.RadarConfig(schedule=lagging, rays=beams))
        self.imu = s.Imu(model, SIGHT, s.ImuConfig(schedule=s.Schedule(rate=200.0, window=0.005, lag=0.01)))
        self.gyroscope = s.Imu(model, SIGHT, s.ImuConfig(schedule=lagging, outputs=("gyroscope",)), name="gyroscope")
        self.gps = s.Gps(model, SIGHT, s.GpsConfig(schedule=lagging))
        self.magnetometer = s.Magnetometer(model, SIGHT, s.MagnetometerConfig(schedule=lagging))
        self.encoder = s.Encoder(model, "axle", s.EncoderConfig(schedule=lagging))
        self.tachometer = s.Tachometer(model, "axle", s.TachometerConfig(schedule=lagging))
        self.speedometer = s.Speedometer(model, SIGHT, s.SpeedometerConfig(schedule=lagging))
        self.contact = s.ContactSensor(model, SIGHT, s.ContactSensorConfig(schedule=lagging), name="bumper")
        self.load_cell = s.LoadCell(model, "axle", s.LoadCellConfig(schedule=lagging))
        self.all: list[Any] = [each for each in vars(self).values() if isinstance(each, sw.Sensor)]
        self.sim = sw.Simulation(model, DT, sensors=self.all, joint_reactions=True, threads=1)
        self.sim.state.body_omega[WORLD, car] = (0.1, -0.2, 0.8)
        self.sim.state.body_omega[WORLD, wheel] = (0.1, 9.0, 0.8)
        self.sim.begin_sensors()
        self.frames: dict[str, list[tuple[float, float, Any]]] = {sensor.name: [] for sensor in self.all}
        """Of each sensor: the time it was taken, the time it was there, and all it shows."""
        with sw.mcap.Writer(path, self.sim, world=WORLD, rate=1.0 / DT) as self.writer:
            self.note()
            for _ in range(STEPS):
                self.sim.step()
                self.writer.add()
                self.note()

    def note(self) -> None:
        """Keeps the frames that are new."""
        now = float(self.sim.time.numpy()[WORLD])
        for sensor in self.all:
            frames, taken = self.frames[sensor.name], float(sensor.timestamp.numpy()[WORLD])
            if not frames or taken > frames[-1][0]:
                shown = {name: array.numpy()[WORLD].copy() for name, array in sensor.frames.data.items()}
                frames.append((taken, now, shown))


@dataclasses.dataclass(frozen=True)
class Recorded:
    rig: Rig
    path: Path
    read: list[Read]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    path = tmp_path_factory.mktemp("mcap") / "run.mcap"
    rig = Rig(path)
    return Recorded(rig, path, read_by_mcap(path))


VALUES: dict[str, tuple[str, Any]] = {
    "/imu/data": ("data", lambda m: [*vector(m.linear_acceleration), *vector(m.angular_velocity)]),
    "/gyroscope/data": ("data", lambda m: vector(m.angular_velocity)),
    "/gps/fix": ("data", lambda m: [m.latitude, m.longitude, m.altitude]),
    "/gps/vel": ("velocity", lambda m: vector(m.twist.linear)),
    "/magnetometer/mag": ("data", lambda m: vector(m.magnetic_field)),
    "/speedometer/twist": ("data", lambda m: [m.twist.linear.x]),
    "/bumper/wrench": ("data", lambda m: vector(m.wrench.force)),
    "/load_cell/wrench": ("data", lambda m: [*vector(m.wrench.force), *vector(m.wrench.torque)]),
    "/encoder/joint_states": ("data", lambda m: list(m.position)),
    "/hood_camera/rgb/image_raw": ("rgb", lambda m: pixels(m, np.uint8)),
    "/hood_camera/grey/image_raw": ("grey", lambda m: pixels(m, np.uint8)),
    "/hood_camera/depth/image_raw": ("depth", lambda m: pixels(m, np.float32)),
    "/hood_camera/range/image_raw": ("range", lambda m: pixels(m, np.float32)),
    "/hood_camera/instance/image_raw": ("instance", lambda m: pixels(m, np.int32)),
    "/hood_camera/semantic/image_raw": ("semantic", lambda m: pixels(m, np.int32)),
    "/ranges/ranges": ("ranges", lambda m: pixels(m, np.float32)),
    "/roof_lidar/points": ("points", lambda m: np.nan_to_num(pixels(m, np.float32).reshape(4, 16, 4))),
    "/dual/points": ("points", lambda m: np.nan_to_num(pixels(m, np.float32).reshape(4, 16, 4))),
}
"""Topic: output of the sensor, and its numbers in a message. Points without a return are NaN, and zero in a sensor."""


def sensor_of(rig: Rig, topic: str) -> str:
    word = topic.split("/")[1]
    return next(each.name for each in rig.all if each.name.replace("-", "_").replace(" ", "_") == word)


@pytest.mark.parametrize("topic", VALUES)
def test_all_frames_are_there_to_the_last_bit(recorded: Recorded, topic: str) -> None:
    output, numbers = VALUES[topic]
    frames, found = recorded.rig.frames[sensor_of(recorded.rig, topic)], of(recorded.read, topic)
    assert len(found) == len(frames) > 2
    for each, (taken, there, shown) in zip(found, frames, strict=True):
        assert (stamp(each.message), each.time) == (ns(taken), ns(there))
        wanted = shown[output][..., :4] if topic == "/dual/points" else shown[output]
        assert np.array_equal(np.asarray(numbers(each.message), wanted.dtype), wanted)


def test_messages_carry_the_lag_of_their_sensors(recorded: Recorded) -> None:
    assert recorded.rig.writer.missed == dict.fromkeys([each.name for each in recorded.rig.all], 0)
    for topic in VALUES:
        sensor = next(each for each in recorded.rig.all if each.name == sensor_of(recorded.rig, topic))
        late = [each.time - stamp(each.message) for each in of(recorded.read, topic)]
        assert late[0] == 0  # the first frame is there as a world begins
        # sums of a step of single precision
        assert np.allclose(late[1:], ns(sensor.frames.schedule.lag), atol=100)


def test_another_library_reads_the_same(recorded: Recorded) -> None:
    other = read_by_rosbags(recorded.path)
    assert len(other) == len(recorded.read)
    for topic, (_, numbers) in VALUES.items():
        one, two = of(recorded.read, topic), of(other, topic)
        assert [(each.time, stamp(each.message)) for each in one] == [(each.time, stamp(each.message)) for each in two]
        for left, right in zip(one, two, strict=True):
            assert np.array_equal(numbers(left.message), numbers(right.message))
            assert left.message.header.frame_id == right.message.header.frame_id


def rigid(transform: Any) -> Any:
    """(4, 4) of a TransformStamped: child to parent."""
    matrix = np.eye(4)
    matrix[:3, :3] = matrix_of(np.array(vector(transform.transform.rotation, "xyzw")))
    matrix[:3, 3] = vector(transform.transform.translation)
    return matrix


def to_map(read: list[Read], frame: str, time: int) -> Any:
    """(4, 4) from a frame to the map at a time [ns], along the tree."""
    edges = {each.child_frame_id: each for found in of(read, "/tf_static") for each in found.message.transforms}
    for found in of(read, "/tf"):
        if found.time == time:
            edges |= {each.child_frame_id: each for each in found.message.transforms}
    matrix = np.eye(4)
    while frame != "map":
        matrix, frame = rigid(edges[frame]) @ matrix, edges[frame].header.frame_id
    return matrix


def test_frames_are_a_tree(recorded: Recorded) -> None:
    parents: dict[str, str] = {}
    for found in recorded.read:
        if found.topic in ("/tf", "/tf_static"):
            for each in found.message.transforms:
                assert parents.setdefault(each.child_frame_id, each.header.frame_id) == each.header.frame_id
    assert {"odom", "base_link", "wheel", "hood_camera_link", "hood_camera_optical_frame"} <= set(parents)
    for child in parents:
        way = [child]
        while way[-1] in parents:
            way.append(parents[way[-1]])
            assert len(way) <= len(parents) + 1
        assert way[-1] == "map"
    named = {each.message.header.frame_id for each in recorded.read if each.topic in VALUES}
    assert named - {"", "enu"} <= set(parents)


def test_an_optical_frame_looks_along_z_with_x_to_the_right(recorded: Recorded) -> None:
    (static,) = of(recorded.read, "/tf_static")
    optical = next(each for each in static.message.transforms if each.child_frame_id == "hood_camera_optical_frame")
    assert optical.header.frame_id == "hood_camera_link"
    # columns: x, y and z of the optical frame in that of the camera, x ahead, y left, z up (REP 103)
    assert np.array_equal(rigid(optical)[:3, :3], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    assert np.array_equal(rigid(optical)[:3, 3], np.zeros(3))


def test_depth_images_lie_on_the_ground(recorded: Recorded) -> None:
    """Pixels go through the camera's matrix, and through the tree at their stamps, to z = 0."""
    images, infos = (of(recorded.read, f"/hood_camera/depth/{name}") for name in ("image_raw", "camera_info"))
    for image, info in zip(images, infos, strict=True):
        assert stamp(image.message) == stamp(info.message)
        k = np.array(info.message.k).reshape(3, 3)
        depth = pixels(image.message, np.float32)[..., 0].astype(float)
        row, column = np.indices(depth.shape)
        rays = np.stack([column, row, np.ones_like(row)]).reshape(3, -1)
        near = depth.ravel() < 20.0
        assert near.sum() > 50
        points = np.linalg.solve(k, rays)[:, near] * depth.ravel()[near]
        matrix = to_map(recorded.read, image.message.header.frame_id, stamp(image.message))
        # rays are cast in single precision: 1e-6 of 20 m
        assert np.abs((matrix[:3, :3] @ points + matrix[:3, 3:])[2]).max() < 2e-5


@pytest.mark.parametrize("topic", ["/roof_lidar/points", "/dual/points_first", "/radar/points"])
def test_points_lie_on_the_ground(recorded: Recorded, topic: str) -> None:
    for found in of(recorded.read, topic):
        message = found.message
        assert [field.name for field in message.fields][:3] == ["x", "y", "z"]
        points = pixels(message, np.float32).reshape(-1, message.point_step // 4)[:, :3].astype(float)
        seen = np.isfinite(points).all(axis=1)
        assert 0 < seen.sum() < len(seen)
        matrix = to_map(recorded.read, message.header.frame_id, stamp(message))
        heights = (points[seen] @ matrix[:3, :3].T + matrix[:3, 3])[:, 2]
        # single precision of up to 100 m
        assert np.abs(heights).max() < 1e-4


def test_normals_of_the_ground_point_up(recorded: Recorded) -> None:
    found = of(recorded.read, "/hood_camera/normals/image_raw")[-1]
    normals = pixels(found.message, np.float32).reshape(-1, 3)
    seen = np.abs(normals).sum(axis=1) > 0.0
    matrix = to_map(recorded.read, found.message.header.frame_id, stamp(found.message))
    assert np.abs(normals[seen] @ matrix[:3, :3].T - (0.0, 0.0, 1.0)).max() < 1e-5


def test_what_is_not_measured_is_said_so(recorded: Recorded) -> None:
    message = of(recorded.read, "/gyroscope/data")[0].message
    assert message.linear_acceleration_covariance[0] == message.orientation_covariance[0] == -1.0
    assert message.angular_velocity_covariance[0] == 0.0


def test_a_tachometer_tells_radians(recorded: Recorded) -> None:
    frames = recorded.rig.frames["tachometer"]
    wanted = [shown["data"][0] * np.pi / 30.0 for _, _, shown in frames]
    found = [each.message.velocity[0] for each in of(recorded.read, "/tachometer/joint_states")]
    assert np.allclose(found, wanted, rtol=1e-7)


@pytest.mark.parametrize(
    ("lens", "model"),
    [
        (s.Pinhole(fov=1.2), "plumb_bob"), (s.Radial(fov=1.1, k1=-0.1, k2=0.01, k3=0.002), "plumb_bob"),
        (s.FishEye(fov=2.5), "equidistant"),
    ],
)  # fmt: skip
def test_calibrations_project_as_the_lenses_do(lens: Any, model: str) -> None:
    """The models of ROS, written out, against the lens: directions in optical axes to columns and rows."""
    width, height = 64, 40
    builder = sw.ModelBuilder()
    builder.add_body("post", mass=1.0, inertia=(1, 1, 1))
    scene = s.Visuals(builder).finalize(builder.finalize(1, "cpu"))
    camera = s.Camera(scene, s.Mount("post"), s.CameraConfig(width=width, height=height, lens=lens))
    info = camera_info(camera, "frame")
    assert info["distortion_model"] == model
    ahead = np.random.default_rng(3).uniform((-0.5, -0.3, 1.0), (0.5, 0.3, 1.0), (50, 3))
    x, y = ahead[:, 0], ahead[:, 1]
    r2 = x**2 + y**2
    if model == "plumb_bob":
        k1, k2, _, _, k3 = info["d"]
        factor = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    else:
        r = np.sqrt(r2)
        factor = np.arctan(r) / r
    found = np.stack([x * factor, y * factor, np.ones_like(x)], axis=1) @ np.reshape(info["k"], (3, 3)).T
    uv = lens.points(np.stack([ahead[:, 2], -x, -y], axis=1))
    # the middle of pixel (row, column) is at u = (2 column + 1) / width - 1, v = (height - 2 row - 1) / width
    column, row = ((uv[:, 0] + 1.0) * width - 1.0) / 2.0, (height - 1.0 - uv[:, 1] * width) / 2.0
    assert np.allclose(found[:, :2], np.stack([column, row], axis=1), atol=1e-9)
