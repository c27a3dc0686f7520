"""Worlds with a rut that cameras and lidars see, for tests: a wheel has rolled through the first, above the second."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import warp as wp

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.core.types import ShapeType
from simwarp.sensors.cameras.camera import CameraConfig, look_at
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.scene import Scene, Visuals
from simwarp.soil import Soil, SoilWheel
from simwarp.vehicle import ground
from simwarp.viewer.free_camera import FreeCamera
from tests.reference.terrain import field_triangles
from tests.unit.soil.soil_wheels import RADIUS, WIDTH

SIZE = (4.0, 4.0)
TURN = 0.3
MIDDLE = (0.513, 0.107, 0.2)
"""Of the height field, which is turned about the vertical and meets no node."""


def hills() -> np.ndarray:
    """Of 17 x 17 nodes, 25 cm apart: gentle, so that a wheel rolls over them."""
    x, y = np.meshgrid(np.linspace(-2.0, 2.0, 17), np.linspace(-2.0, 2.0, 17))
    return 0.04 * np.sin(2.0 * x) * np.cos(1.5 * y)


class Rut:
    """Ground with a soil that covers it, and a wheel that no camera sees.

    Args:
        hilly: on a height field, else on the plane z = 0.
        options: of the `Soil`.
    """

    def __init__(self, *, hilly: bool = False, covered: bool = True, sensors: Any = None, **options: Any) -> None:
        builder = sw.ModelBuilder()
        self.wheel = builder.add_body("wheel", mass=650.0, inertia=(20.0, 30.0, 20.0), pose=sw.pose((0, 0, RADIUS)))
        turn = (0.0, 0.0, math.sin(0.5 * TURN), math.cos(0.5 * TURN))
        if hilly:
            place = sw.pose(MIDDLE, turn)
            builder.add_shape_height_field(sw.WORLD, hills(), size=SIZE, name="ground", pose=place, mask=0)
        visuals = Visuals(builder)
        if not hilly:
            visuals.add_plane(name="ground", color=(0.5, 0.4, 0.3), label=3)
        self.model = builder.finalize(2, "cpu")
        under = ground("cpu", kind=ShapeType.HEIGHT_FIELD, x=MIDDLE, rotation=turn) if hilly else None
        wheels = [SoilWheel(body=self.wheel, radius=RADIUS, width=WIDTH)]
        self.soil = Soil(self.model, wheels, "mid", ground=under, **options)
        # float32 about the origin, not about the wheel: pictures before and after have the same roundings
        self.scene: Scene = visuals.finalize(self.model, origin_body=sw.WORLD)
        if covered:
            self.scene.cover_with(self.soil)
        made = [] if sensors is None else sensors(self)
        self.simulation = sw.Simulation(self.model, 1e-3, elements=[self.soil], sensors=made, threads=1)

    def roll(self, steps: int = 700, speed: float = 2.0) -> Rut:
        """Lets the wheel roll along +X from the origin in the first world, and fall from high above in the second."""
        state = self.simulation.state
        x = np.zeros((2, 1, 3))
        x[:, :, 2] = [[RADIUS + float(self.soil.height([(0.0, 0.0)]).numpy()[0, 0])], [50.0]]
        state.body_x.assign(x)
        state.body_v.fill_(wp.vec3(speed, 0.0, 0.0))
        state.body_omega.fill_(wp.vec3(0.0, speed / RADIUS, 0.0))
        self.simulation.measure()
        self.simulation.step(steps)
        return self

    def undeformed(self, x: float, y: float) -> tuple[float, float]:
        """Height of the undeformed ground and the vertical part of its normal, from the field's own triangles."""
        if not self.scene.shape.max() >= 0:
            return 0.0, 1.0
        for p, q, r in self.base():
            a: np.ndarray = np.stack([q - p, r - p], axis=1)
            u, v = np.linalg.solve(a[:2], np.array((x, y)) - p[:2]).tolist()
            if min(u, v) >= -1e-9 and u + v <= 1.0 + 1e-9:
                n = np.cross(a[:, 0], a[:, 1])
                return float(p[2] + a[2] @ (u, v)), float(n[2] / np.linalg.norm(n))
        raise AssertionError("beyond the border")

    def base(self) -> np.ndarray:
        """(T, 3, 3) triangles of the undeformed ground; two large ones for the plane."""
        if not self.scene.shape.max() >= 0:
            far = 100.0
            a, b, c, d = (np.array((x, y, 0.0)) for x, y in ((-far, -far), (far, -far), (far, far), (-far, far)))
            return np.array([[a, b, c], [a, c, d]])
        local = field_triangles(hills(), SIZE)
        cos, sin = math.cos(TURN), math.sin(TURN)
        return local @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]) + np.array(MIDDLE)


class Eye:
    """A camera above the rut, in both worlds."""

    def __init__(self, rut: Rut, eye: tuple[float, float, float] = (0.5, -0.4, 1.5), *, width: int = 96) -> None:
        self.rut = rut
        self.position = np.array(eye)
        self.pose = look_at(eye, (0.5, 0.0, 0.0))
        config = CameraConfig(
            width=width, height=width, lens=Pinhole(fov=1.2), far=200.0,
            outputs=("rgb", "range", "normals", "instance", "semantic"),
        )  # fmt: skip
        self.camera = FreeCamera(rut.scene, [0, 1], config)

    def look(self) -> dict[str, np.ndarray]:
        """All outputs, (2, height, width, channels)."""
        self.camera.render(self.rut.simulation.state, [self.pose, self.pose])
        return {name: array.numpy().copy() for name, array in self.camera.outputs.items()}

    def directions(self) -> np.ndarray:
        """(height, width, 3) unit directions of its pixels' rays, world axes."""
        width = self.camera.config.width
        across = (width - 1.0 - 2.0 * np.arange(width)) / width * math.tan(0.6)
        ahead = np.stack(np.broadcast_arrays(1.0, across[None, :], across[:, None]), axis=-1)
        ahead = ahead @ matrix_of(self.pose.rotation).T
        return ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
