"""A trolley with a camera, a lidar, an inertial unit and GPS, in worlds that all look different.

Every world has obstacles of its own in number, place, size and colour, its own light, and sensors that are wrong in
their own way. Nothing of it is copied: obstacles are one mesh, its instances are numbers per world.

Run: python examples/sensors.py --worlds 12 --plot sensors.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

import simwarp as sw
from simwarp import Model
from simwarp.scenery import ground_texture, rock
from simwarp.sensors import (
    Camera,
    CameraConfig,
    Gps,
    GpsConfig,
    ImageTexture,
    Imu,
    ImuConfig,
    Lidar,
    LidarConfig,
    Lighting,
    Lights,
    Mount,
    NormalNoise,
    Pinhole,
    Scene,
    Schedule,
    Visuals,
    beam_grid,
)
from simwarp.viewer import caption, grid

ROCKS = 8
SPEED = 3.0
DT = 0.005


def build(worlds: int) -> tuple[Model, Scene, list[int]]:
    """A trolley on a rail over sand, and rocks that no world has placed yet: model, scene, instances of the rocks."""
    builder = sw.ModelBuilder()
    trolley = builder.add_body(
        "trolley", mass=20.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 0.0, 0.6)), velocity=(SPEED, 0.0, 0.0)
    )
    builder.add_joint_prismatic("rail", sw.WORLD, trolley, axis=(1.0, 0.0, 0.0))
    visuals = Visuals(builder)
    sand = visuals.texture(ImageTexture(image=ground_texture("sand"), metres=5.0))
    visuals.add_plane(texture=sand, color=(1.0, 1.0, 1.0), reflectance=0.3)
    shape = visuals.add_mesh_asset(rock().mesh)
    rocks = [visuals.add_mesh_instance(sw.WORLD, shape, name=f"rock {k}", reflectance=0.8) for k in range(ROCKS)]
    model = builder.finalize(worlds)
    scene = visuals.finalize(model, per_world=("x", "size", "color", "enabled"))
    return model, scene, rocks


def scatter(scene: Scene, rocks: list[int], draws: np.random.Generator) -> None:
    """Rocks of every world: places beside the rail, scales, tints, and how many there are."""
    worlds = scene.model.world_count
    x = scene.x.numpy()
    x[:, rocks, 0] = draws.uniform(5.0, 16.0, (worlds, ROCKS))
    x[:, rocks, 1] = draws.choice([-1.0, 1.0], (worlds, ROCKS)) * draws.uniform(1.8, 6.0, (worlds, ROCKS))
    size, color, enabled = scene.size.numpy(), scene.color.numpy(), scene.enabled.numpy()
    size[:, rocks] = draws.uniform(0.3, 0.9, (worlds, ROCKS, 1))
    color[:, rocks] = draws.uniform(0.4, 1.0, (worlds, ROCKS, 3))
    enabled[:, rocks] = np.arange(ROCKS) < draws.integers(3, ROCKS + 1, (worlds, 1))
    for array, values in ((scene.x, x), (scene.size, size), (scene.color, color), (scene.enabled, enabled)):
        array.assign(values)


def make_sensors(scene: Scene, draws: np.random.Generator) -> tuple[Camera, Lidar, Imu, Gps]:
    """One of each, with light and GPS noise of every world's own."""
    model, worlds = scene.model, scene.model.world_count
    head = Mount("trolley", sw.pose((0.3, 0.0, 0.5)))
    lights = Lights(Lighting(), worlds, model.device, per_world=("sun_direction", "sun_color"))
    angle, height = draws.uniform(0.0, 2.0 * np.pi, worlds), draws.uniform(0.2, 1.2, worlds)
    sun = np.stack([np.cos(angle) * np.cos(height), np.sin(angle) * np.cos(height), np.sin(height)], axis=1)
    lights.sun_direction.assign(sun[:, None])
    lights.sun_color.assign(np.stack([np.ones(worlds), 0.7 + 0.2 * height, 0.5 + 0.4 * height], axis=1)[:, None])
    camera = Camera(
        scene, head,
        CameraConfig(schedule=Schedule(rate=20.0, lag=0.02), width=160, height=90, lens=Pinhole(fov=1.4), samples=2),
        lights=lights,
    )  # fmt: skip
    lidar = Lidar(
        scene, head,
        LidarConfig(schedule=Schedule(rate=10.0), beams=beam_grid(180, 4, elevation=(0.0, -0.15)), far=40.0),
    )  # fmt: skip
    imu = Imu(model, head, ImuConfig(schedule=Schedule(rate=200.0), accelerometer_noise=(NormalNoise(std=0.05),)))
    gps = Gps(model, head, GpsConfig(schedule=Schedule(rate=20.0), noise=(NormalNoise(std=1.0),)), randomised=True)
    gps.noise.parameter(0, "std").assign(np.repeat(draws.uniform(0.1, 2.0, (worlds, 1)), 3, axis=1))
    return camera, lidar, imu, gps


def main() -> None:
    """Places, drives, and compares what GPS was told to be wrong by with what it was."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--worlds", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--plot", type=Path, help="writes what the cameras see at the start")
    options = parser.parse_args()

    draws = np.random.default_rng(0)
    model, scene, rocks = build(options.worlds)
    scatter(scene, rocks, draws)
    camera, lidar, imu, gps = make_sensors(scene, draws)
    sim = sw.Simulation(model, DT, sensors=[camera, lidar, imu, gps])
    images = camera.data.numpy().copy()  # the first frames are there at once

    errors, force = [], []
    for _ in range(round(options.seconds / DT)):
        sim.step()
        errors.append(gps.position.numpy()[:, 1].copy())  # the rail is y = 0
        force.append(imu.data.numpy()[:, 2].copy())
    std = gps.noise.parameter(0, "std").numpy()[:, 0]
    found = np.std(errors, axis=0)
    print(f"upwards the accelerometers read {np.mean(force):.2f} m/s² on the average")
    for world in range(min(options.worlds, 12)):
        seen = int((scene.enabled.numpy()[world, rocks] > 0).sum())
        near = lidar.ranges.numpy()[world, 0, :, 0]
        nearest = f"{near[near > 0].min():5.2f} m" if (near > 0).any() else "nothing"
        print(
            f"world {world:2}: {seen} rocks, nearest {nearest}; GPS noise {std[world]:.2f} m, seen {found[world]:.2f} m"
        )
    if options.plot is not None:
        sheet = grid(list(images[:12]), 4)
        Image.fromarray(caption(sheet, f"{min(options.worlds, 12)} worlds, one mesh")).save(options.plot)
        print(f"wrote {options.plot}")


if __name__ == "__main__":
    main()
