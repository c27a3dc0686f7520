"""What a page shows of one sensor: pictures, points in the scene, or lines."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD
from simwarp.sensors.cameras.camera import Camera
from simwarp.sensors.motion.gps import Gps
from simwarp.sensors.motion.imu import Imu
from simwarp.sensors.ranging.lidar import Lidar
from simwarp.sensors.ranging.radar import Radar
from simwarp.viewer.live.batches import body_positions, body_rotations, multiplied, turned
from simwarp.viewer.live.controls.charts import MOST_LINES, Chart
from simwarp.viewer.live.controls.joint_coordinates import of_world
from simwarp.viewer.live.page import ROOT

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView

Image = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]

WIDTH: Final = 128
"""Pictures are enlarged by whole numbers to about this many pixels."""
QUALITY: Final = 85
RAMP: Final = np.array([(48, 18, 59), (70, 134, 251), (27, 229, 181), (164, 252, 60), (251, 126, 33), (122, 4, 3)])
"""From near to far."""
MOST_SEEN: Final = 95.0
"""Percentile of the distances at which the ramp ends: the horizon alone would take most of it."""
NOTHING: Final = (24, 24, 28)


class CameraView:
    """Pictures of a camera, one of each output.

    Args:
        view: whose page; the folder that is open takes them.
        camera: the sensor.
    """

    def __init__(self, view: LiveView, camera: Camera) -> None:
        self._camera = camera
        gui: Any = view.server.viser.gui
        self._handles: dict[str, Any] = {}
        for name in camera.outputs:
            blank = np.zeros((camera.config.height, camera.config.width, 3), np.uint8)
            self._handles[name] = gui.add_image(blank, label=name, format="jpeg", jpeg_quality=QUALITY)

    def draw(self, world: int) -> None:
        """The newest frame of a world."""
        for name, handle in self._handles.items():
            pixels = of_world(self._camera.outputs[name], world)
            handle.image = enlarged(in_color(name, pixels, self._camera.config.far))

    def remove(self) -> None:
        """Takes them off the page."""
        for handle in self._handles.values():
            handle.remove()


class PointsView:
    """Returns of a lidar or radar as points in the scene, in colours of their distance."""

    def __init__(self, view: LiveView, sensor: Lidar | Radar) -> None:
        self._view, self._sensor = view, sensor
        self._handle: Any = None
        beams = sensor.config.beams if isinstance(sensor, Lidar) else None
        self._rays = None if beams is None else beams.directions()

    def points(self, world: int) -> Array:
        """(N, 3) in axes of the sensor [m]."""
        sensor = self._sensor
        if isinstance(sensor, Radar):
            returns = np.asarray(of_world(sensor.data, world), np.float64).reshape(-1, 6)
            reach, azimuth, elevation = returns[returns[:, 5] >= 0.0, :3].T
            flat = reach * np.cos(elevation)
            return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), reach * np.sin(elevation)], axis=-1)
        frame = np.asarray(of_world(sensor.data, world), np.float64)
        with np.errstate(invalid="ignore"):
            if sensor.config.outputs[0] == "points":
                found = frame[..., :3].reshape(-1, 3)
            else:
                assert self._rays is not None
                found = (frame[..., :1] * self._rays).reshape(-1, 3)
            found = found[np.isfinite(found).all(axis=1)]
            reach = np.linalg.norm(found, axis=1)
        return np.asarray(found[(reach > 0.0) & (reach < 0.999 * sensor.config.far)])

    def draw(self, world: int) -> None:
        """The newest frame, where the sensor is now."""
        page, mount = self._view.page, self._sensor.mount
        found = self.points(world)
        place, turn = mount_pose(self._view, mount, world)
        spots = (place + turned(turn, found) + page.shifts[page.chosen]).astype(np.float32)
        reach = np.linalg.norm(found, axis=1)
        color = ramp(reach, float(reach.max(initial=1.0)))
        if self._handle is None:
            scene: Any = self._view.server.viser.scene
            size = 0.004 * float(np.median(reach)) if len(reach) else 0.05
            self._handle = scene.add_point_cloud(
                f"{ROOT}/returns", spots, color, point_size=max(size, 0.01), point_shape="circle", precision="float32"
            )
        else:
            self._handle.points = spots
            self._handle.colors = color

    def remove(self) -> None:
        """Takes them out of the scene."""
        if self._handle is not None:
            self._handle.remove()


class ChannelView:
    """Lines of a sensor of a few numbers."""

    def __init__(self, view: LiveView, sensor: Any) -> None:
        self._view, self._sensor = view, sensor
        self._read: Callable[[int], Any] = lambda world: np.ravel(of_world(sensor.data, world))
        names = [f"{sensor.name} {index}" for index in range(min(int(np.prod(sensor.data.shape[1:])), MOST_LINES))]
        title = sensor.name
        if isinstance(sensor, Imu):
            axes = {"accelerometer": "a{} m/s²", "gyroscope": "ω{} rad/s"}
            names = [axes[part].format(axis) for part in sensor.config.outputs for axis in "xyz"]
        elif isinstance(sensor, Gps):
            names, title = [f"v {way} m/s" for way in ("east", "north", "up")], f"{sensor.name}: velocity"
            self._read = lambda world: of_world(sensor.velocity, world)
        self._chart = Chart(view, names, title)
        gui: Any = view.server.viser.gui
        self._text = gui.add_markdown("") if isinstance(sensor, Gps) else None
        self._world = -1

    def draw(self, world: int) -> None:
        """One more point."""
        if world != self._world:
            self._world = world
            self._chart.clear()
        self._chart.add(float(of_world(self._sensor.timestamp, world)), list(self._read(world)))
        if self._text is not None:
            latitude, longitude, height = of_world(self._sensor.data, world)
            self._text.content = f"{latitude:.7f}° N, {longitude:.7f}° E, {height:.2f} m"

    def remove(self) -> None:
        """Takes them off the page."""
        self._chart.remove()
        if self._text is not None:
            self._text.remove()


def view_of(view: LiveView, sensor: Any) -> CameraView | PointsView | ChannelView:
    """What suits a sensor."""
    if isinstance(sensor, Camera):
        return CameraView(view, sensor)
    if isinstance(sensor, (Lidar, Radar)):
        return PointsView(view, sensor)
    return ChannelView(view, sensor)


def mount_pose(view: LiveView, mount: Any, world: int) -> tuple[Array, Array]:
    """Place [m] and rotation xyzw of a mounted sensor in a world."""
    rows = np.array([world])
    own = world if len(mount.position) > 1 else 0
    place = np.asarray(of_world(mount.position, own), np.float64)
    turn = np.asarray(of_world(mount.rotation, own), np.float64)
    if int(mount.body) == WORLD:
        return place, turn
    state = view.subject.simulation.state
    carrier = body_rotations(state, rows)[0, mount.body]
    return body_positions(state, rows)[0, mount.body] + turned(carrier, place), multiplied(carrier, turn)


def in_color(name: str, pixels: Any, far: float) -> Image:
    """(H, W, 3) of an output: light as it is, distances from violet to red, labels each in a colour of its own."""
    if name == "rgb":
        return np.asarray(pixels, np.uint8)
    if name == "grey":
        return np.repeat(np.asarray(pixels, np.uint8), 3, axis=2)
    if name == "normals":
        return np.asarray(127.5 * (np.asarray(pixels) + 1.0), np.uint8)
    flat = np.asarray(pixels)[..., 0]
    if name in ("instance", "semantic"):
        turn = (0.618034 * flat[..., None] + np.array([0.0, 1.0 / 3.0, 2.0 / 3.0])) % 1.0
        seen = 60.0 + 180.0 * np.abs(2.0 * turn - 1.0)
        return np.where(flat[..., None] < 0, NOTHING, seen).astype(np.uint8)
    seen = flat < 0.999 * far
    most = float(np.percentile(flat[seen], MOST_SEEN)) if seen.any() else 1.0
    return np.where(seen[..., None], ramp(flat, most), NOTHING).astype(np.uint8)


def ramp(values: Any, most: float) -> Image:
    """(..., 3) colours of distances from 0 to `most`."""
    place = np.clip(np.asarray(values, np.float64) / max(most, 1e-9), 0.0, 1.0)
    steps = np.linspace(0.0, 1.0, len(RAMP))
    return np.stack([np.interp(place, steps, RAMP[:, k]) for k in range(3)], axis=-1).astype(np.uint8)


def enlarged(image: Image) -> Image:
    """With pixels repeated, so that small pictures can be seen."""
    factor = max(1, round(WIDTH / image.shape[1]))
    return np.repeat(np.repeat(image, factor, axis=0), factor, axis=1)
