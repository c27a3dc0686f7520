"""The world of `simwarp sensor-demo`: a truck on a trail through hills, among rocks, trees and cones, and a car."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD, Pose, ShapeType, pose
from simwarp.geometry.visual_mesh import VisualMesh
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import Model
from simwarp.scenery.plants import bush, tree
from simwarp.scenery.roadside import barrier, cone, crate, pillar
from simwarp.scenery.rocks import rock
from simwarp.scenery.solids import ribbon, stream, tone, varied
from simwarp.scenery.terrain import flattened, height_at, hills
from simwarp.scenery.textures import TEXTURES, ground_texture
from simwarp.scenery.vehicle_visuals import add_vehicle_visual, vehicle_visual
from simwarp.scenery.visual import Label, Visual, add_visual
from simwarp.sensors.cameras.appearance import ImageTexture
from simwarp.sensors.instances import PlainAppearanceOptions
from simwarp.sensors.scene import Scene, Visuals
from simwarp.vehicle.construction import VehicleParts, add_vehicle
from simwarp.vehicle.driving.path_tracking import PathTracker, PathTrackingSpec, look_ahead_for
from simwarp.vehicle.driving.paths import Path, smooth
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.tires.tires import ground
from simwarp.vehicle.vehicle import Vehicle, per_world

Array = npt.NDArray[np.float64]

SIZE: Final = (220.0, 220.0)
"""Of the ground [m]."""
SPEED: Final = 7.0
"""Of the truck [m/s]."""
SEDAN_SPEED: Final = 9.0
"""Of the vehicle that comes towards it [m/s]."""
ROOF: Final = (-0.3, 0.0, 1.8)
"""Of the lidar, on a mast, in the truck's frame of reference [m]."""
TRAIL: Final = ((-84.0, -34.0), (-66.0, -34.0), (-49.0, -22.0), (-32.0, -1.0), (-13.0, 1.0), (5.0, -0.3), (26.0, 2.5),
                (50.0, 0.0), (80.0, 6.0))  # fmt: skip
"""Nodes of the path that the truck follows [m]."""


@dataclasses.dataclass(frozen=True)
class DemoWorld:
    """World of the demonstration, as it is simulated and rendered.

    Attributes:
        model: one world.
        scene: all that rays meet.
        vehicle, driver: force elements, the driver first.
        parts: of the truck.
        moment: time at which pictures are taken: the truck is near the origin [s].
    """

    model: Model
    scene: Scene
    vehicle: Vehicle
    driver: PathTracker
    parts: VehicleParts
    moment: float


def make_world(seed: int, device: str | None) -> DemoWorld:
    """Builds the world; `seed` changes hills, rocks and plants, not what stands beside the trail."""
    path = smooth(np.array(TRAIL))
    heights = _landscape(seed, path)
    spec = load_vehicle("hmmwv")
    start = np.append(path.points[0], height_at(heights, SIZE, path.points[:1])[0] + spec.start_height)
    ahead = path.tangents()[0]
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec, at=_upright(start, math.atan2(ahead[1], ahead[0])), speed=SPEED)
    field = builder.add_shape_height_field(WORLD, heights, size=SIZE, name="ground")
    # the moment at which the truck reaches the origin, give or take a step of its driver
    moment = round(float(np.interp(0.0, path.points[:, 0], path.arc)) / SPEED, 2)
    sedan = _add_sedan(builder, heights, moment)
    visuals = Visuals(builder)
    grass = ImageTexture(image=ground_texture("grass", seed, pixels=512), metres=2.0 * TEXTURES["grass"])
    visuals.show(
        field, texture=visuals.texture(grass), color=(1.0, 1.0, 1.0), label=int(Label.GROUND), reflectance=0.25
    )
    visuals.add_mesh(WORLD, _trail(path, heights), name="trail", label=int(Label.ROAD), reflectance=0.3)
    add_vehicle_visual(visuals, parts)
    _add_lidar(visuals, parts)
    add_visual(visuals, vehicle_visual("sedan"), name="sedan", body=sedan)
    _add_things(visuals, heights, path, seed)
    model = builder.finalize(1, device, per_world=per_world())
    terrain = ground(model.device, kind=ShapeType.HEIGHT_FIELD, asset=0)
    vehicle = Vehicle(parts, model, ground=terrain)
    follow = PathTrackingSpec(paths=(path,), speed=SPEED, steering=look_ahead_for(spec))
    return DemoWorld(model, visuals.finalize(model), vehicle, PathTracker(vehicle, follow), parts, moment)


def _landscape(seed: int, path: Path) -> Any:
    """Hills that are lower near the path, and level at its start."""
    low, high = (
        hills(seed + k, size=SIZE, spacing=1.0, amplitude=a, wavelength=w)
        for k, (a, w) in enumerate(((0.55, (7.0, 30.0)), (9.0, (45.0, 90.0))))
    )
    rows, columns = low.shape
    x, y = np.linspace(-0.5 * SIZE[0], 0.5 * SIZE[0], columns), np.linspace(-0.5 * SIZE[1], 0.5 * SIZE[1], rows)
    nodes = path.points[::4]
    away = np.full(low.shape, np.inf)
    for a, b in nodes:
        away = np.minimum(away, np.hypot(x[None] - a, y[:, None] - b))
    share = np.clip((away - 10.0) / 60.0, 0.0, 1.0)
    ground_heights = low + (share * share * (3.0 - 2.0 * share)) * (high + 6.0)
    level = flattened(ground_heights, SIZE, [(*path.points[0], 5.0)], blend=6.0)
    return level - height_at(level, SIZE, path.points[:1])[0].astype(np.float32)


def _upright(place: Sequence[float] | Array, yaw: float) -> Pose:
    return pose(place, (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)))


def _add_sedan(builder: ModelBuilder, heights: Any, moment: float) -> int:
    """A body that slides along a straight line and is beside the trail, ahead of the truck, at the moment."""
    place, yaw = np.array([22.0, 5.0]), math.pi + 0.06
    ahead = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    there = np.append(place, height_at(heights, SIZE, [place])[0])
    begin = there - SEDAN_SPEED * moment * ahead
    sedan = builder.add_body(
        "sedan", mass=1500.0, inertia=(600.0, 2500.0, 2500.0), pose=_upright(begin, yaw), velocity=SEDAN_SPEED * ahead
    )
    builder.add_joint_prismatic("way", WORLD, sedan, axis=ahead)
    return sedan


def _add_lidar(visuals: Visuals, parts: VehicleParts) -> None:
    """The housing of the lidar, which it does not see itself, and its mast."""
    appearance: PlainAppearanceOptions = {"label": int(Label.VEHICLE), "reflectance": 0.3}
    for name, radius, half, below, color in (
        ("lidar", 0.1, 0.08, 0.0, (0.03, 0.03, 0.035)), ("mast", 0.03, 0.22, 0.28, (0.45, 0.45, 0.45)),
    ):  # fmt: skip
        at = parts.reference + np.asarray(ROOF) - (0.0, 0.0, below)
        visuals.add_cylinder(
            parts.chassis, radius=radius, half_length=half, name=name, pose=pose(at), color=color, **appearance
        )  # fmt: skip


def _trail(path: Path, heights: Any) -> VisualMesh:
    """Two ruts of bare soil, laid on the ground."""
    tangent = path.tangents()
    across = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    offsets = np.array([-1.5, -1.25, -0.7, -0.45, 0.45, 0.7, 1.25, 1.5])
    count = len(path.points) - 1
    rng = stream("trail")
    soil = varied(tone("8a6a48"), 7 * count, rng, 0.1).reshape(7, count, 3)
    soil[[1, 5]] *= 0.72
    strip = ribbon(path.points[None] + offsets[:, None, None] * across[None], soil)
    points = strip.vertices.copy()
    points[:, 2] = height_at(heights, SIZE, points[:, :2]) + 0.03
    return dataclasses.replace(strip, vertices=points)


def _add_things(visuals: Visuals, heights: Any, path: Path, seed: int) -> None:
    """Adds obstacles beside the trail near the truck when pictures are taken, then woods and rocks all around."""
    count = 0

    def put(visual: Visual, x: float, y: float, yaw: float = 0.0, scale: float = 1.0, sink: float = 0.0) -> None:
        nonlocal count
        count += 1
        z = float(height_at(heights, SIZE, [(x, y)])[0]) - sink
        add_visual(visuals, visual, name=f"{visual.name} {count}", at=_upright((x, y, z), yaw), scale=scale)

    cones = [cone(kind) for kind in ("orange", "red", "green")]
    for k, arc in enumerate(np.arange(-2.0, 26.0, 4.0)):
        middle = np.interp(0.0, path.points[:, 0], path.arc) + arc
        at = [float(np.interp(middle, path.arc, path.points[:, axis])) for axis in range(2)]
        put(cones[0], at[0], at[1] - 2.4, 0.3 * k, 1.2)
    put(cones[1], 5.5, 3.0, scale=1.2)
    put(cones[2], 9.5, 3.3, scale=1.2)
    put(crate(size=(1.2, 1.2, 1.2)), 14.0, -5.4, 0.3)
    put(crate(size=(1.0, 1.0, 1.0), seed=1), 15.3, -5.9, 0.9)
    put(pillar(width=0.9, height=4.5), 25.0, -5.5, 0.2)
    for k in range(3):
        put(barrier(), 17.5 + 2.1 * k, -7.6 + 0.35 * k, 0.17)
    for k, (kind, x, y, size) in enumerate((
        ("boulder", 3.0, 6.4, 1.0), ("slab", 9.5, 8.4, 1.1), ("shard", 14.0, 12.5, 1.5), ("cobble", 4.0, -7.4, 0.7),
        ("mossy", 11.5, -9.5, 1.2), ("boulder", 34.0, 9.5, 1.3), ("shard", 31.0, -9.0, 1.4), ("cobble", -4.5, 5.0, 0.6),
        ("slab", -6.0, -6.0, 0.9), ("mossy", 44.0, -5.0, 1.3),
    )):  # fmt: skip
        put(rock(kind, seed + k), x, y, 0.7 * k, size, sink=0.15)
    for k, (kind, x, y) in enumerate((
        ("oak", 17.5, 15.5), ("birch", 27.0, 14.0), ("spruce", 22.0, -13.5), ("spruce", 30.0, -16.0),
        ("oak", 8.0, -15.0), ("poplar", 38.0, 11.5), ("birch", 36.0, -12.0), ("dead", 11.5, 17.0), ("oak", 1.0, 14.5),
        ("spruce", -7.0, 12.0),
    )):  # fmt: skip
        put(tree(kind, seed + k), x, y, 0.9 * k, sink=0.1)
    _add_woods(put, path, seed)


def _add_woods(put: Any, path: Path, seed: int) -> None:
    """Trees, bushes and rocks away from the trail."""
    rng = stream("demo woods", seed)
    kinds = [tree(kind, seed + 20 + k) for k, kind in enumerate(("spruce", "oak", "birch", "spruce", "poplar"))]
    bushes = [bush(seed=seed + k) for k in range(2)]
    rocks = [rock(kind, seed + 40 + k) for k, kind in enumerate(("boulder", "mossy", "slab"))]
    done = 0
    while done < 150:
        x, y = rng.uniform(-100.0, 100.0, 2)
        away = float(np.hypot(*(path.points - (x, y)).T).min())
        choice, scale, yaw = rng.random(), rng.uniform(0.8, 1.5), rng.uniform(-math.pi, math.pi)
        if away < 18.0:
            continue
        visual = kinds[rng.integers(5)] if choice < 0.6 else bushes[rng.integers(2)] if choice < 0.8 else rocks[
            rng.integers(3)
        ]  # fmt: skip
        put(visual, float(x), float(y), yaw, scale, sink=0.15)
        done += 1
