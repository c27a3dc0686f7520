"""Small scenes for the tests of cameras, and pictures of them."""

import numpy as np

import simwarp as sw
from simwarp.sensors.cameras.camera import Camera, CameraConfig, look_at
from simwarp.sensors.cameras.image_processing import Imaging
from simwarp.sensors.cameras.lights import Lighting
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.scene import Visuals

DARK = Lighting(suns=(), ambient=0.0, ambient_below=0.0, sky=0.0, horizon=0.0, below=0.0)
"""No light at all; `dataclasses.replace` adds some."""
LINEAR = Imaging(gamma=1.0)
EVERY_STEP = Schedule(rate=1000.0)


def empty_builder():
    """A builder with nothing to see: a model needs a body."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_body("anchor", mass=1.0, inertia=(1.0, 1.0, 1.0))
    return builder


def wall_visuals(distance=2.0, **appearance):
    """A plane across X at a distance, that faces the origin."""
    visuals = Visuals(empty_builder())
    visuals.add_plane(pose=look_at_plane(distance), **appearance)
    return visuals


def look_at_plane(distance):
    """The frame of a plane at x = distance whose outer side faces the origin; its x axis is up, its y axis left."""
    quarter = np.sqrt(0.5)
    return sw.pose((distance, 0.0, 0.0), (0.0, -quarter, 0.0, quarter))


def take(visuals, eye=(0.0, 0.0, 0.0), target=(1.0, 0.0, 0.0), *, worlds=1, lights=DARK, scene_arrays=(), mount=None,
         change=None, seed=0, per_world=(), name="camera", **config):  # fmt: skip
    """Pictures of all worlds at the start, by output; `change(scene, camera)` may write into arrays first."""
    model = visuals.builder.finalize(worlds, "cpu")
    scene = visuals.finalize(model, per_world=scene_arrays)
    options = {"schedule": EVERY_STEP, "imaging": LINEAR, **config}
    where = Mount(sw.WORLD, look_at(eye, target)) if mount is None else mount
    camera = Camera(
        scene, where, CameraConfig(**options), lights=lights, seed=seed, per_world=per_world, name=name
    )  # fmt: skip
    if change is not None:
        change(scene, camera)
    sw.Simulation(model, 0.001, sensors=[camera])
    return {output: array.numpy() for output, array in camera.outputs.items()}
