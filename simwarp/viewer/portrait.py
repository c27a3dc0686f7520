"""A picture of one robot as it stands: the camera finds its place, a floor lies under it where the model has none."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import pose
from simwarp.sensors.cameras.camera import CameraConfig, look_at
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.cameras.lights import Lighting, Sun
from simwarp.sensors.instances import GREY
from simwarp.sensors.scene import Scene, Visuals
from simwarp.simulation.simulation import Simulation
from simwarp.viewer.default_visuals import GROUNDS, add_bodies, paint
from simwarp.viewer.free_camera import FreeCamera

Array = npt.NDArray[np.float64]

FIELD: Final = 0.6
"""Of view, across [rad]."""
FROM: Final = (1.0, -0.85, 0.5)
"""Direction from the robot to the camera: its front is +X."""
ROOM: Final = 1.06
"""Distance of the camera over that from which the robot just fills the picture."""
TILES: Final = 4.0
"""Squares of the floor along the robot."""


def portrait(
    visuals: Visuals, q: npt.ArrayLike | None = None, *, width: int = 960, height: int = 720, samples: int = 3
) -> npt.NDArray[np.uint8]:
    """(height, width, 3) picture of a builder's first world, from the front, the right and above.

    Args:
        visuals: of the builder, painted here where nobody has; a floor is added below where it has no ground.
        q: (dofs,) coordinates [m or rad]; as built when None. Loops are closed from there.
        width, height: of the picture [pixels].
        samples: s x s rays per pixel.

    Raises:
        ModelError: the builder has no body, or `q` has another length.
    """
    builder = visuals.builder
    if not any(instance.body >= 0 for instance in visuals.instances):
        add_bodies(visuals)
    simulation = Simulation(builder.finalize(1, "cpu"), dt=1e-3, check_start=False)
    if q is not None:
        simulation.set_joint_state(None, np.asarray(q, np.float32).reshape(1, -1), None)
    has_ground = any(instance.kind in GROUNDS for instance in visuals.instances)
    config = CameraConfig(width=width, height=height, samples=samples, lens=Pinhole(fov=FIELD), far=1e4, near=1e-3)
    low, high = FreeCamera(_scene(visuals, simulation), [0], config).extent(simulation.state, fixed=not has_ground)[0]
    size = max(float(np.linalg.norm(high - low)), 1e-3)
    if not has_ground:
        visuals.add_plane(name="floor under the robot", pose=pose((0.0, 0.0, low[2])))
    _uncover_grounds(visuals)
    paint(visuals, tile=_tile(size))
    eye, target = _view(low, high, width / height)
    camera = FreeCamera(_scene(visuals, simulation), [0], config, _lighting(size))
    picture: npt.NDArray[Any] = camera.render(simulation.state, [look_at(eye, target)])[0]
    return picture


def _scene(visuals: Visuals, simulation: Simulation) -> Scene:
    return visuals.finalize(simulation.model)


def _uncover_grounds(visuals: Visuals) -> None:
    """Grounds of one colour show no scale: they are painted as those without a colour."""
    for index, instance in enumerate(visuals.instances):
        if instance.kind in GROUNDS and instance.appearance.texture < 0:
            appearance = dataclasses.replace(instance.appearance, color=GREY)
            visuals.instances[index] = dataclasses.replace(instance, appearance=appearance)


def _tile(size: float) -> float:
    """Side of the floor's squares: 1, 2 or 5 times a power of ten [m]."""
    wanted = size / TILES
    power = 10.0 ** math.floor(math.log10(wanted))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted * 1.0001))


def _view(low: Array, high: Array, aspect: float) -> tuple[Array, Array]:
    """Eye and target, so that the box between two corners just fits into the picture."""
    target = 0.5 * (low + high)
    back = np.array(FROM) / np.linalg.norm(FROM)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    away = corners - target
    across = math.tan(0.5 * FIELD)
    reach = np.maximum(np.abs(away @ right) / across, np.abs(away @ up) * aspect / across)
    distance = ROOM * float((reach + away @ back).max())
    return target + back * max(distance, 1e-2), target


def _lighting(size: float) -> Lighting:
    """A sun from the robot's right, and haze in which the floor ends."""
    return Lighting(suns=(Sun(direction=(0.35, -0.8, 1.2)),), shadow_reach=20.0 * size, fog_density=0.03 / size)
