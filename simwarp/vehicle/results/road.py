"""The road of a manoeuvre below tires that are force laws: a plane or slope, with bumps and patches of friction."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.types import ShapeType
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.driving.maneuver_spec import FrictionPatch, Maneuver
from simwarp.vehicle.roads.random_roads import MOST_NODES, SPACING
from simwarp.vehicle.roads.road_files import Window
from simwarp.vehicle.roads.road_surface import RoadSurface
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_spec import SpecError, VehicleSpec
from simwarp.vehicle.tires.ground_kernels import TerrainTables
from simwarp.vehicle.tires.parameter_vector import MODELS
from simwarp.vehicle.tires.tires import ground

Array = npt.NDArray[np.float64]

BUMP_CELLS: Final = 40
"""Of a height field along a bump."""
ROAD_AHEAD: Final = 50.0
"""Before the origin and behind the bump [m], beside what the manoeuvre covers."""
ROAD_SIDE: Final = 20.0
"""To either side of a bump [m]."""
DRIFT: Final = 0.01
"""Of the way that a vehicle may come straight ahead, as much more to either side: nobody holds it on its line."""
STRAIGHT_LENGTH: Final = 2400.0
"""Most ahead, of random roads below manoeuvres without steering [m]."""
TURN_AHEAD: Final = 900.0
"""Most ahead, below those with steering [m]."""
TURN_REACH: Final = 150.0
"""Most to the sides and behind, of random roads below manoeuvres with steering [m]."""
MOST_SPEED: Final = 60.0
"""Taken for vehicles whose pedals alone decide [m/s]."""
MOST_CELLS: Final = 200_000
"""Of a height field along the road."""
CELL: Final = 0.25
"""Of a map of friction [m]."""


def check_road(maneuver: Maneuver, spec: VehicleSpec, on_soil: bool, road: RoadSurface | None = None) -> None:
    """Refuses bumps and patches of friction below tires that do not read them, and two grounds at once.

    Args:
        maneuver: with its road.
        spec: of the vehicle with its tires.
        on_soil: True if it drives on soil.
        road: in place of the manoeuvre's plane.

    Raises:
        SpecError: there is a bump, a patch or a map of friction, and a tire is no force law on a road; or the manoeuvre
            has a ground of its own beside the road.
    """
    if road is not None:
        check_own_ground(maneuver)
    if maneuver.bump is None and not maneuver.patches and (road is None or road.friction is None):
        return
    template = next((axle.tire.template for axle in spec.all_axles if axle.tire.template not in MODELS), None)
    template = "soil" if template is None and on_soil else template
    if template is not None:
        rule = f"must be driven on tires that are force laws, got {template}; leave out --tire and --soil"
        raise SpecError(f"maneuver: {maneuver.name}: {rule}")


def check_own_ground(maneuver: Maneuver) -> None:
    """Refuses manoeuvres with a ground of their own, where a road is given.

    Raises:
        SpecError: it has a slope, a bump, patches of friction, or something lies across its way.
    """
    own = {
        "a slope": maneuver.slope, "a bump": maneuver.bump, "patches of friction": maneuver.patches,
        "an obstacle": maneuver.crossing,
    }  # fmt: skip
    found = next((name for name, value in own.items() if value), None)
    if found is not None:
        raise SpecError(f"road: must be driven by a manoeuvre on level ground, got {maneuver.name} with {found}")


def check_below_tracks(road: RoadSurface) -> None:
    """Refuses maps that tracks do not read.

    Raises:
        SpecError: the road has a map of friction, or soils.
    """
    if road.friction is not None:
        raise SpecError("road: must be of one friction below tracks, got a map of friction; leave it out")
    if road.soils:
        raise SpecError(f"road: must be rigid below tracks, got soils {', '.join(road.soils)}; leave them out")


def check_plain_road(road: RoadSurface, spec: AnyVehicleSpec) -> None:
    """Refuses maps that a vehicle does not read where no soil is laid.

    Raises:
        SpecError: the road has soils, or a map of friction below tracks or tires that are no force laws.
    """
    if isinstance(spec, TrackedVehicleSpec):
        check_below_tracks(road)
        return
    if road.soils:
        rule = f"must be rigid here, got soils {', '.join(road.soils)}"
        raise SpecError(f"road: {rule}; simwarp drive --tire soil-rigid sinks into them")
    template = next((axle.tire.template for axle in spec.axles if axle.tire.template not in MODELS), None)
    if road.friction is not None and template is not None:
        raise SpecError(
            f"road: a map of friction must be below tires that are force laws, got {template}; leave it out"
        )


def road_window(maneuver: Maneuver) -> Window:
    """First and last x and y of the ground that a manoeuvre needs below random roads [m].

    It holds the path that is followed; without one it goes ahead as far as the vehicle may come, and where it turns as
    far to the sides as it may come then. Beyond the border there is no ground.
    """
    way = min(_longest_way(maneuver), STRAIGHT_LENGTH)
    side = ROAD_SIDE + DRIFT * way
    x, y = (-ROAD_AHEAD, way + ROAD_AHEAD), (-side, side)
    if maneuver.follow is not None:
        points = np.concatenate([path.points for path in maneuver.follow.paths])
        (left, low), (right, high) = np.clip([points.min(axis=0), points.max(axis=0)], -way, way).tolist()
        # behind the end of an open path it goes straight on
        ahead = right if all(path.closed for path in maneuver.follow.paths) else way
        x, y = (min(left, 0.0) - ROAD_AHEAD, ahead + ROAD_AHEAD), (low - ROAD_SIDE, high + ROAD_SIDE)
    begins = next((time for time, value in maneuver.script.steering if value), math.inf)
    if maneuver.intervention is not None:
        begins = min(begins, maneuver.start)
    if begins != math.inf:
        # where it begins to turn, it may come to any side
        reach = min(max(way - begins * _fastest(maneuver), ROAD_AHEAD), TURN_REACH)
        x = (min(x[0], -reach), max(x[1], min(way, TURN_AHEAD) + ROAD_AHEAD))
        y = (min(y[0], -reach), max(y[1], reach))
    widest = MOST_NODES * SPACING[0] * SPACING[1] / (x[1] - x[0] + 1.0) - 2.0 * SPACING[1]
    share = min(1.0, widest / (y[1] - y[0]))
    return x, (share * y[0], share * y[1])


def _fastest(maneuver: Maneuver) -> float:
    """Speed that a manoeuvre holds or begins with [m/s]; `MOST_SPEED` where pedals alone decide."""
    held = [value for _, value in maneuver.script.speed if value > 0.0]
    if maneuver.follow is not None:
        held.append(maneuver.follow.speed)
    if not held or any(value for _, value in maneuver.script.throttle):
        return MOST_SPEED
    return max(*held, maneuver.initial_speed)


def _longest_way(maneuver: Maneuver) -> float:
    """That a vehicle may come from its start [m]."""
    return _fastest(maneuver) * (maneuver.start + maneuver.duration)


def add_bump(builder: ModelBuilder, maneuver: Maneuver) -> int:
    """The height field of the road with a manoeuvre's bump, as an asset; -1 where there is no bump.

    Raises:
        SpecError: the bump is too short beside the road.
    """
    bump = maneuver.bump
    if bump is None:
        return -1
    reach = _reach(maneuver)
    step = bump.length / BUMP_CELLS
    cells = 2 * math.ceil(reach / step)
    if cells > MOST_CELLS:
        least = 2.0 * reach * BUMP_CELLS / MOST_CELLS
        raise SpecError(f"length: must be at least {least:.3g} m of a bump on this road, got {bump.length!r}")
    part = (step * (np.arange(cells + 1) - cells // 2) - bump.start) / bump.length
    heights = np.where((part > 0.0) & (part < 1.0), bump.height * np.sin(np.pi * np.clip(part, 0.0, 1.0)), 0.0)
    return builder.add_height_field_asset(np.tile(heights, (2, 1)), size=(step * cells, 2.0 * ROAD_SIDE))


def _reach(maneuver: Maneuver) -> float:
    """Half length of the road, about the origin [m]."""
    assert maneuver.bump is not None
    way = maneuver.initial_speed * (maneuver.start + maneuver.duration)
    return max(way, maneuver.bump.start + maneuver.bump.length) + ROAD_AHEAD


def tire_ground(maneuver: Maneuver, device: wp.DeviceLike, rotation: Array, asset: int) -> TerrainTables:
    """Terrain for the tires of a manoeuvre.

    Args:
        maneuver: with its slope, bump and patches.
        device: of the arrays.
        rotation: of the plane, xyzw.
        asset: of `add_bump`.
    """
    options: dict[str, Any] = {}
    if maneuver.patches:
        options |= _friction_map(maneuver.patches)
    if asset >= 0:
        return ground(device, kind=ShapeType.HEIGHT_FIELD, asset=asset, **options)
    return ground(device, rotation=rotation, **options)


def _friction_map(patches: tuple[FrictionPatch, ...]) -> dict[str, Any]:
    """Cells around all patches, with a rim of ordinary road; later patches lie on earlier ones."""
    x0, x1 = min(patch.x[0] for patch in patches), max(patch.x[1] for patch in patches)
    y0, y1 = min(patch.y[0] for patch in patches), max(patch.y[1] for patch in patches)
    columns, rows = (math.ceil((high - low) / CELL - 1e-9) + 2 for low, high in ((x0, x1), (y0, y1)))
    origin = (x0 - CELL, y0 - CELL)
    x, y = (start + CELL * (0.5 + np.arange(count)) for start, count in zip(origin, (columns, rows), strict=True))
    factors = np.ones((rows, columns))
    for patch in patches:
        along = (x > patch.x[0]) & (x < patch.x[1])
        across = (y > patch.y[0]) & (y < patch.y[1])
        factors[np.ix_(across, along)] = patch.factor
    return {"friction_map": factors, "friction_origin": origin, "friction_cell": (CELL, CELL)}
