"""The contact sheet of `simwarp sensor-demo`: a truck on a trail, and the measurements of all its sensors."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ModelError
from simwarp.sensors.cameras.camera import CameraConfig, look_at
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.motion.gps import GeoOrigin, to_local
from simwarp.simulation.simulation import Simulation
from simwarp.viewer.demo.landscape import ROOF, DemoWorld, make_world
from simwarp.viewer.demo.sensor_plots import (
    Traces,
    cloud_panel,
    depth_panel,
    instance_colors,
    normals_panel,
    radar_panel,
    range_panels,
    semantic_panel,
    traces,
)
from simwarp.viewer.demo.sensor_suite import (
    BLUR,
    Progress,
    SensorSuite,
    big_size,
    cloud_points,
    drive,
    make_sensor_suite,
    small_height,
)
from simwarp.viewer.demo.sheet import CAPTION, Panel, Sheet
from simwarp.viewer.free_camera import FreeCamera

LEAST_PANEL = 128
"""Width of a small picture [pixels]."""
MOST_PANEL = 2048
"""The same."""


@dataclasses.dataclass(frozen=True)
class Demo:
    """Result of `sensor_demo`.

    Attributes:
        sheet: the contact sheet.
        data: all that was measured, by names such as "rgb", "lidar points", "imu data".
        summary: numbers for people and scripts.
    """

    sheet: Sheet
    data: dict[str, npt.NDArray[Any]]
    summary: dict[str, Any]


def sensor_demo(*, seed: int = 0, device: str | None = None, panel: int = 320, report: Progress | None = None) -> Demo:
    """Drives a truck along a trail, measures with all its sensors, and puts the results on one sheet.

    Args:
        seed: of the landscape and of all noise.
        device: Warp device; None: the default.
        panel: width of a small picture [pixels].
        report: hears of the progress.

    Raises:
        ModelError: the pictures would be too small or too large.
    """
    if isinstance(panel, bool) or not isinstance(panel, int) or not LEAST_PANEL <= panel <= MOST_PANEL:
        rule = f"an integer from {LEAST_PANEL} to {MOST_PANEL} pixels"
        raise ModelError(f"sensor_demo: panel must be {rule}, got {panel!r}; four stand side by side")
    say: Progress = report or (lambda what, share: None)
    say("building the world", 0.0)
    world = make_world(seed, device)
    rig = make_sensor_suite(world, seed, panel)
    found, simulation = drive(world, rig, say)
    say("drawing", 1.0)
    sheet = _sheet(world, rig, found, simulation, panel)
    return Demo(sheet, _data(rig, found), _summary(world, rig, found))


def _sheet(world: DemoWorld, rig: SensorSuite, found: Traces, simulation: Simulation, panel: int) -> Sheet:
    small = small_height(panel)
    plot = round(0.72 * panel)
    sheet = Sheet(
        panel, [*[small] * 6, plot], 4, "simwarp sensor-demo",
        "one drive of a truck over hills, measured by the sensors on it: ray-cast cameras, lidar and radar at one "
        "moment; inertial unit, satellite receiver and wheel encoder all the way",
    )  # fmt: skip
    images = {name: camera.data.numpy()[0] for name, camera in rig.cameras.items()}
    sheet.put(0, 0, Panel("RGB", f"{big_size(panel)[0]} × {big_size(panel)[1]} pixels, 9 rays each", images["rgb"]))
    outputs = {name: array.numpy()[0] for name, array in rig.cameras["outputs"].outputs.items()}
    instance = outputs["instance"][..., 0]
    sheet.put(0, 2, Panel("grey", "uint8", np.repeat(outputs["grey"], 3, axis=2)))
    sheet.put(0, 3, depth_panel(outputs["depth"][..., 0], instance))
    sheet.put(1, 2, normals_panel(outputs["normals"], instance))
    sheet.put(1, 3, Panel("instance segmentation", "index in the scene", instance_colors(instance)))
    sheet.put(2, 0, semantic_panel(outputs["semantic"][..., 0], instance))
    for (row, column), name, title, note in (
        ((2, 1), "pinhole", "pinhole lens", "109° across, straight lines straight"),
        ((2, 2), "fish-eye", "fish-eye lens", "FOV model, 195° across"),
        ((2, 3), "radial", "radial lens", "k1 -0.22, k2 0.045: barrel"),
        ((3, 0), "noise", "shot and read noise", "exposure 0.2"),
        ((3, 1), "blur", "motion blur", f"{1e3 * BLUR:g} ms exposure, looking aside"),
        ((3, 2), "fog", "fog", "exp(-0.035 / m · distance)"),
        ((3, 3), "exposure", "exposure 1.9, vignetting", "cos⁴ law"),
    ):
        sheet.put(row, column, Panel(title, note, images[name]))
    wide, tall = sheet.width(2), sheet.height(4, 2)
    sheet.put(4, 0, _cloud(world, rig, simulation, wide, tall))
    strip = rig.lidar.config.beams.shape[0] * max(1, round(0.01 * tall))
    ranges, intensity = range_panels(rig.lidar.ranges.numpy()[0], wide, strip)
    sheet.put(4, 2, ranges)
    sheet.put(4, 2, intensity, down=strip + CAPTION + 4)
    down = 2 * (strip + CAPTION + 4)
    clusters = rig.radar.clusters.numpy()[0, : int(rig.radar.cluster_count.numpy()[0])]
    speed = float(found["speedometer"]["truth"][-1, 0])
    sheet.put(4, 2, radar_panel(rig.radar.data.numpy()[0], clusters, speed, wide, tall - down), down=down)
    radius = world.parts.spec.axles[0].tire.radius
    for column, drawn in enumerate(traces(found, radius, panel, plot)):
        sheet.put(6, column, drawn)
    return sheet


def _cloud(world: DemoWorld, rig: SensorSuite, simulation: Simulation, width: int, height: int) -> Panel:
    """The lidar's cloud from behind the truck, from above."""
    cloud, place = cloud_points(world, rig, simulation)
    lens = Pinhole(fov=1.1)
    camera = FreeCamera(
        world.scene, [0], CameraConfig(width=width, height=height, samples=1, lens=lens), rig.cameras["rgb"].lights
    )
    view = look_at(place + np.array([-14.0, 5.0, 8.0]), place + np.array([11.0, 0.0, -2.5]))
    background = camera.render(simulation.state, [view])[0]
    return cloud_panel(cloud, background, view, lens.fov, float(place[2]) - ROOF[2] - 0.47)


def _data(rig: SensorSuite, found: Traces) -> dict[str, npt.NDArray[Any]]:
    """Everything that was measured."""
    data = {name: camera.data.numpy()[0] for name, camera in rig.cameras.items() if name != "outputs"}
    data |= {name: array.numpy()[0] for name, array in rig.cameras["outputs"].outputs.items()}
    data |= {"lidar points": rig.lidar.points.numpy()[0], "lidar ranges": rig.lidar.ranges.numpy()[0]}
    data |= {"radar returns": rig.radar.data.numpy()[0], "radar clusters": rig.radar.clusters.numpy()[0]}
    return data | {f"{name} {field}": values for name, fields in found.items() for field, values in fields.items()}


def _summary(world: DemoWorld, rig: SensorSuite, found: Traces) -> dict[str, Any]:
    """Errors of measurements against the true values, and counts."""
    error = found["imu"]["data"] - found["imu"]["truth"]
    gps = found["gps"]["position"] - to_local(GeoOrigin(), *found["gps"]["truth"].T)
    return {
        "instances": world.scene.instance_count,
        "moment_s": world.moment,
        "lidar_returns": int(rig.lidar.count.numpy()[0]),
        "radar_clusters": int(rig.radar.cluster_count.numpy()[0]),
        "accelerometer_rms": float(np.sqrt((error[:, :3] ** 2).mean())),
        "gyroscope_rms": float(np.sqrt((error[:, 3:] ** 2).mean())),
        "gps_rms_m": float(np.sqrt((gps[:, :2] ** 2).sum(axis=1).mean())),
    }
