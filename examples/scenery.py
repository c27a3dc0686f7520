"""Scenery of the driving tasks: an off-road world, a convoy, a corridor and a race track, all made by computing.

Below each picture is what a policy's camera sees of that world, 80 x 45 pixels; below those are the things that worlds
are made of.

Run: python examples/scenery.py --plot scenery.png
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

import numpy as np
from PIL import Image

import simwarp as sw
from simwarp import Vec3, scenery
from simwarp.sensors import CameraConfig, ImageTexture, Lamp, Lighting, Pinhole, Visuals, look_at
from simwarp.viewer import FreeCamera, grid

View = tuple[Vec3, Vec3]
"""Position of a camera, and the point that it looks at."""
GREEN = (0.05, 0.09, 0.03)


class World:
    """Things that are seen, and from where: by people, and by a policy."""

    def __init__(self) -> None:
        self.builder = sw.ModelBuilder()
        self.visuals = Visuals(self.builder)
        self.lighting = Lighting()
        self.far: View = ((-10.0, -8.0, 6.0), (0.0, 0.0, 0.0))
        self.near: View = ((-8.0, 0.0, 1.2), (0.0, 0.0, 1.0))
        self.fov = 0.9

    def ground(self, kind: str, heights: np.ndarray | None = None, size: tuple[float, float] = (1.0, 1.0)) -> None:
        """A plane, or hills, with a picture of a ground on it. Comes first."""
        texture = ImageTexture(image=scenery.ground_texture(kind), metres=scenery.TEXTURES[kind])
        if heights is not None:
            shape = self.builder.add_shape_height_field(sw.WORLD, heights, size=size, name="hills")
            self.visuals = Visuals(self.builder)
            self.visuals.show(shape, texture=self.visuals.texture(texture), color=(1.0, 1.0, 1.0))
        else:
            self.visuals.add_plane(name="ground", texture=self.visuals.texture(texture), color=(1.0, 1.0, 1.0))

    def put(
        self, visual: scenery.Visual, x: float, y: float, z: float = 0.0, yaw: float = 0.0, scale: float = 1.0
    ) -> None:
        """A thing at a place."""
        name = f"{visual.name} {len(self.visuals.instances)}"
        scenery.add_visual(self.visuals, visual, name=name, at=scenery.yaw_pose(x, y, z, yaw), scale=scale)

    def pictures(self, width: int) -> list[np.ndarray]:
        """A picture for people and a policy's, magnified, both `width` pixels wide and 9/16 of it high."""
        # a body far below: models have at least one
        self.builder.add_body("nobody", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 0.0, -1e3)))
        model = self.builder.finalize(1, "cpu")
        scene = self.visuals.finalize(model, origin_body=sw.WORLD)
        state = sw.Simulation(model, 1e-3).state
        found = []
        for (eye, target), pixels, samples, fov in (
            (self.far, width, 2, self.fov), (self.near, 80, 1, math.pi / 2.0),
        ):  # fmt: skip
            config = CameraConfig(width=pixels, height=pixels * 9 // 16, lens=Pinhole(fov=fov), samples=samples)
            picture = FreeCamera(scene, [0], config, self.lighting).render(state, [look_at(eye, target)])[0]
            size = (width, width * 9 // 16)
            found.append(np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.NEAREST)))
        return found


def off_road(seed: int) -> World:
    """Rocks, bushes and trees on hills that are level at the start and at the goal."""
    size, start, goal = (120.0, 120.0), (-25.0, 0.0), (25.0, 5.0)
    discs = [(*start, 5.0), (*goal, 5.0)]
    hills = scenery.flattened(scenery.hills(seed, size=size, amplitude=3.5), size, discs)
    world = World()
    world.ground("grass", hills, size)
    makers = [lambda k: scenery.rock(scenery.ROCKS[k % 5], k), lambda k: scenery.bush(scenery.BUSHES[k % 3], k),
              lambda k: scenery.tree(scenery.TREES[k % 5], k)]  # fmt: skip
    places = scenery.scattered(50, seed, half=45.0, apart=6.0, keep_clear=[(*start, 9.0), (*goal, 9.0)])
    for k, (x, y, yaw) in enumerate(places.tolist()):
        z = float(scenery.height_at(hills, size, [(x, y)])[0])
        world.put(makers[k % 3](k), x, y, z - 0.2, yaw, 0.7 if k % 3 == 0 else 1.0)
    z = float(scenery.height_at(hills, size, [start])[0])
    world.put(scenery.vehicle_visual("gator"), *start, z)
    world.far = ((start[0] - 9.0, -7.0, z + 4.5), (start[0] + 4.0, 1.0, z + 0.5))
    world.near = ((start[0] + 1.5, 0.0, z + 1.0), (start[0] + 11.5, 1.0, z + 1.0))
    return world


def convoy(seed: int) -> World:
    """Three trucks on a path, rocks and trees beside it."""
    world = World()
    world.ground("dirt")
    path = scenery.convoy_path(seed % scenery.CONVOY_PATHS)
    world.visuals.add_mesh(sw.WORLD, scenery.road(path, width=7.0), name="road")
    tangent = path.tangents()
    for k, (x, y, yaw) in enumerate(scenery.beside(path, 24, seed, distance=(6.0, 12.0)).tolist()):
        thing = scenery.tree(scenery.TREES[k % 5], k) if k % 2 else scenery.rock(scenery.ROCKS[k % 5], k)
        world.put(thing, x, y, yaw=yaw)
    index = [int(np.searchsorted(path.arc, arc)) for arc in (60.0, 70.0, 80.0, 52.0)]
    places = [(*path.points[i].tolist(), math.atan2(*tangent[i][::-1])) for i in index]
    for (x, y, yaw), color in zip(places[:3], (None, GREEN, None), strict=True):
        world.put(scenery.vehicle_visual("hmmwv", color=color), x, y, yaw=yaw)
    x, y, yaw = places[0]
    ahead = np.array([math.cos(yaw), math.sin(yaw)])
    away = (x, y) - 13.0 * ahead + 9.0 * np.array([ahead[1], -ahead[0]])
    world.far = ((float(away[0]), float(away[1]), 6.5), (*places[1][:2], 0.5))
    x, y, yaw = places[3]
    world.near = ((x, y, 1.4), (x + math.cos(yaw), y + math.sin(yaw), 1.38))
    return world


def hallway(seed: int) -> World:
    """A corridor, and a lane between red and green cones in it."""
    world = World()
    track = scenery.indoor_track(seed)
    ways = scenery.corridor(track, seed=seed)
    tiles = world.visuals.texture(
        ImageTexture(image=scenery.ground_texture("tiles"), metres=scenery.TEXTURES["tiles"])
    )  # fmt: skip
    world.visuals.add_mesh(sw.WORLD, ways.floor, name="floor", texture=tiles)
    world.put(ways.walls, 0.0, 0.0)
    for color, side in (("green", 1.0), ("red", -1.0)):
        world.put(scenery.arranged(scenery.cone(color, height=0.22), track.marks(0.6, side)), 0.0, 0.0)
    bend = int(track.starts("turn")[0])
    x, y, yaw = track.at(track.arc[bend] - 1.5).tolist()
    world.put(scenery.vehicle_visual("artcar"), x, y, yaw=yaw)
    ahead = np.array([math.cos(yaw), math.sin(yaw)])
    lamps = [Lamp(position=tuple(place), color=2.2) for place in ways.lamps.tolist()]
    world.lighting = Lighting(suns=(), lamps=lamps, shadows=False, ambient=0.3, ambient_below=0.2)
    world.visuals.add_mesh(sw.WORLD, ways.ceiling, name="ceiling")
    world.far = ((x - 1.7 * ahead[0], y - 1.7 * ahead[1], 0.85), (x + ahead[0], y + ahead[1], 0.3))
    world.near = ((x, y, 0.27), (x + ahead[0], y + ahead[1], 0.26))
    world.fov = 1.3
    return world


def race(seed: int) -> World:
    """A track between barriers."""
    world = World()
    world.ground("grass")
    track = scenery.race_track(seed)
    course = scenery.race_course(track)
    world.visuals.add_mesh(sw.WORLD, course.road, name="road")
    world.put(course.left, 0.0, 0.0)
    world.put(course.right, 0.0, 0.0)
    x, y, yaw = track.at(0.2 * track.length).tolist()
    world.put(scenery.vehicle_visual("sedan"), x, y, yaw=yaw)
    ahead = np.array([math.cos(yaw), math.sin(yaw)])
    world.far = ((x - 11.0 * ahead[0], y - 11.0 * ahead[1], 6.0), (x + 5.0 * ahead[0], y + 5.0 * ahead[1], 0.5))
    world.near = ((x + 1.5 * ahead[0], y + 1.5 * ahead[1], 1.05), (x + 3.0 * ahead[0], y + 3.0 * ahead[1], 1.04))
    return world


def line_up(visuals: Sequence[scenery.Visual], ground: str, scales: Sequence[float] = ()) -> World:
    """Things side by side."""
    world = World()
    world.ground(ground)
    scales = scales or [1.0] * len(visuals)
    extents = [scale * (visual.upper - visual.lower) for visual, scale in zip(visuals, scales, strict=True)]
    widths = [float(np.hypot(*extent[:2])) for extent in extents]
    total, tall = sum(widths), max(float(extent[2]) for extent in extents)
    at = 0.5 * total
    for visual, width, scale in zip(visuals, widths, scales, strict=True):
        world.put(visual, 0.0, at - 0.5 * width, yaw=2.4, scale=scale)
        at -= width
    world.fov = 0.5
    world.far = ((-2.1 * total, 0.0, 0.5 * total + 0.4 * tall), (0.0, 0.0, 0.4 * tall))
    return world


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--width", type=int, default=320, help="of one picture [pixels], a multiple of 16")
    parser.add_argument("--plot", default=None, help="picture to write")
    args = parser.parse_args()
    if args.width < 80 or args.width % 16:
        raise SystemExit(f"--width: must be a multiple of 16 from 80 on, got {args.width}")
    tasks = [off_road(args.seed), convoy(args.seed), hallway(args.seed), race(args.seed)]
    plants = [scenery.tree(kind, 1) for kind in scenery.TREES] + [scenery.bush(kind, 1) for kind in scenery.BUSHES]
    made = [scenery.crate(), scenery.barrier(), scenery.pillar(width=0.6, height=2.0)]
    things = [
        line_up([scenery.rock(kind, 1) for kind in scenery.ROCKS], "sand"),
        line_up(plants, "snow"),
        line_up([*(scenery.cone(color) for color in scenery.CONES), *made], "concrete"),
        line_up([scenery.vehicle_visual(name) for name in scenery.VEHICLES], "asphalt", [1.0, 1.3, 3.0, 1.0]),
    ]
    views = [world.pictures(args.width) for world in tasks]
    sheet = [far for far, _ in views] + [near for _, near in views] + [each.pictures(args.width)[0] for each in things]
    triangles = sum(len(mesh.triangles) for world in (*tasks, *things) for mesh in world.visuals.meshes)
    print(f"{len(sheet)} pictures of {len(tasks) + len(things)} worlds, {triangles} triangles")
    if args.plot:
        Image.fromarray(grid(sheet, 4)).save(args.plot, optimize=True)
        print(f"wrote {args.plot}")


if __name__ == "__main__":
    main()
