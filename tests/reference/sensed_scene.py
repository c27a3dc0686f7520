"""A sled with all kinds of sensors between two boxes, for what shows them."""

from __future__ import annotations

from typing import Any

import numpy as np

import simwarp as sw
from simwarp.sensors.cameras.camera import Camera, CameraConfig
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.motion.gps import Gps
from simwarp.sensors.motion.imu import Imu
from simwarp.sensors.ranging.beams import beam_grid
from simwarp.sensors.ranging.lidar import Lidar, LidarConfig
from simwarp.sensors.scene import Scene, Visuals
from simwarp.viewer.default_visuals import paint

DISTANCE = 3.0
"""From the sled's sensors to the face of the box ahead [m]."""


def sensed_scene(worlds: int) -> tuple[sw.Simulation, Scene]:
    """A sled at rest on a plane, looking along x; its camera gives colours, distances and labels."""
    builder = sw.ModelBuilder()
    sled = builder.add_body("sled", mass=10.0, inertia=np.eye(3), pose=sw.pose((0.0, 0.0, 0.25)))
    builder.add_shape_box(sled, half=(0.4, 0.3, 0.25), name="sled")
    builder.add_shape_plane(name="ground", material=sw.Material(friction=1.0))
    builder.add_shape_box(sw.WORLD, half=(0.5, 2.0, 1.0), pose=sw.pose((DISTANCE + 1.0, 0.0, 1.0)), name="ahead")
    builder.add_shape_box(sw.WORLD, half=(1.0, 0.2, 0.5), pose=sw.pose((1.0, 2.0, 0.5)), name="left")
    visuals = Visuals(builder)
    paint(visuals)
    model = builder.finalize(world_count=worlds, device="cpu")
    scene = visuals.finalize(model)
    ahead = Mount("sled", sw.pose((0.5, 0.0, 0.1)))
    every = Schedule(rate=20.0)
    sensors: list[Any] = [
        Camera(
            scene, ahead, CameraConfig(schedule=every, width=64, height=48, outputs=("rgb", "depth", "instance")),
            name="eye",
        ),
        Lidar(
            scene, ahead,
            LidarConfig(schedule=every, beams=beam_grid(61, 9, azimuth=(1.5, -1.5), elevation=(0.3, -0.3))),
            name="lidar",
        ),
        Imu(model, ahead, name="imu"),
        Gps(model, ahead, name="gps"),
    ]  # fmt: skip
    return sw.Simulation(model, 5e-3, sensors=sensors), scene
