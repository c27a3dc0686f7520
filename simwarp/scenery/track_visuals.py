"""Visuals of tracked vehicles: a hull, and moving sprockets, wheels, arms and shoes in place of their shapes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, Unpack

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import rotate
from simwarp.core.types import WORLD, Pose, Vec3, finite_vector, pose
from simwarp.scenery.solids import tube
from simwarp.scenery.track_bodies import OLIVE, hull_mesh, shoe_mesh, shoe_width, sprocket_mesh, track_wheel_mesh
from simwarp.scenery.visual import Label
from simwarp.vehicle.spec.belt_parts import BeltTrack
from simwarp.vehicle.spec.track_parts import ShoeTrack
from simwarp.vehicle.tracks.belt_construction import BeltTrackParts
from simwarp.vehicle.tracks.shoe_construction import ShoeTrackParts
from simwarp.vehicle.tracks.tracked_construction import TrackedVehicleParts

if TYPE_CHECKING:
    from simwarp.model.specifications import JointSpec as Joint
    from simwarp.sensors.instances import PlainAppearanceOptions
    from simwarp.sensors.scene import Visuals

Array = npt.NDArray[np.float64]

CIRCLE_POINTS: Final = 72
"""Of a wheel, on the way of a belt around it."""
ROD: Final = 0.1
"""Radius of an arm over that of its wheel."""


def add_tracked_vehicle_visual(
    visuals: Visuals, parts: TrackedVehicleParts, *, color: Vec3 | None = None,
    **appearance: Unpack[PlainAppearanceOptions],
) -> list[int]:  # fmt: skip
    """The picture of a tracked vehicle, from the measures of its description; returns the instances, the hull first.

    All shoes of a track show one mesh. The vehicle's own shapes stay as they are seen: hide them before.

    Args:
        visuals: of the builder that `parts` was added to.
        parts: from `simwarp.vehicle.add_tracked_vehicle`.
        color: of the paint, linear; None: olive.
        appearance: fields of `Appearance`; label and reflectance are those of vehicles unless given.
    """
    own: PlainAppearanceOptions = {"label": int(Label.VEHICLE), "reflectance": 0.6}
    look = own | appearance
    paint = OLIVE if color is None else finite_vector("vehicle visual", "color", color, 3)
    hull = hull_mesh(parts.spec, paint)
    place = pose(parts.reference) if parts.chassis != WORLD else _fixed_frame(visuals, parts)
    found = [visuals.add_mesh(parts.chassis, hull, name=f"{parts.prefix}hull", pose=place, **look)]
    for name, track, side in (("left", parts.left, parts.spec.left), ("right", parts.right, parts.spec.right)):
        label = f"{parts.prefix}{name}"
        if isinstance(track, ShoeTrackParts) and isinstance(side, ShoeTrack):
            found += _add_track(visuals, label, track, side, look)
        elif isinstance(track, BeltTrackParts) and isinstance(side, BeltTrack):
            found += _add_belt(visuals, label, parts, track, side, look)
    return found


def _add_belt(
    visuals: Visuals, name: str, parts: TrackedVehicleParts, belt: BeltTrackParts, track: BeltTrack,
    look: PlainAppearanceOptions,
) -> list[int]:  # fmt: skip
    """Instances of a track by belt: wheels on their arms; sprocket, idler and the shoes, as at rest, on the hull."""
    builder = visuals.builder
    side = 1.0 if name.endswith("left") else -1.0
    middle = parts.reference + np.array([0.0, side * parts.spec.track_offset, 0.0])

    def place(x: float, y: float, z: float) -> Array:
        """In the axes of the chassis."""
        return middle + np.array([x, side * y, z])

    found = []
    for label, location, mesh in (
        ("sprocket", track.sprocket_location, sprocket_mesh(track.sprocket)),
        ("idler", track.idler_location, track_wheel_mesh(track.idler.wheel, rubber=False)),
    ):
        at = pose(place(*location))
        found.append(visuals.add_mesh(parts.chassis, mesh, name=f"{name}_{label}", pose=at, **look))
    hull = builder.bodies[parts.chassis].pose
    for k, (arm, mount) in enumerate(zip(belt.arms, track.road_wheels, strict=True)):
        body = builder.joints[arm].child
        away = hull.position + rotate(hull.rotation, place(*mount.location)) - builder.bodies[body].pose.position
        back = np.array([-1.0, -1.0, -1.0, 1.0]) * builder.bodies[body].pose.rotation
        wheel = track_wheel_mesh(mount.suspension.wheel)
        at = pose(rotate(back, away))
        found.append(visuals.add_mesh(body, wheel, name=f"{name}_wheel_{k}", pose=at, **look))
    asset = visuals.add_mesh_asset(shoe_mesh(track.shoe, shoe_width(track)))
    for k, (x, z, angle) in enumerate(_around(belt, track.shoes)):
        turn = (0.0, -math.sin(0.5 * angle), 0.0, math.cos(0.5 * angle))
        at = pose(place(x, 0.0, z), turn)
        found.append(visuals.add_mesh_instance(parts.chassis, asset, name=f"{name}_shoe_{k}", pose=at, **look))
    return found


def _around(belt: BeltTrackParts, shoes: int) -> list[tuple[float, float, float]]:
    """Places x, z and directions of shoes that lie evenly on the taut way around sprocket, wheels and idler [m, rad],
    from the track's origin: the convex hull of circles.
    """
    rest, angle = belt.resting, np.linspace(0.0, 2.0 * math.pi, CIRCLE_POINTS, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = (rest.centers[:, None] + rest.radii[:, None, None] * circle).reshape(-1, 2)
    order = np.lexsort((points[:, 1], points[:, 0]))
    hull: list[Array] = []
    for run in (order, order[::-1]):  # lower, then upper half, from left to right and back
        first = len(hull)
        for point in points[run]:
            while len(hull) >= first + 2 and _turns_right(hull[-2], hull[-1], point):
                hull.pop()
            hull.append(point)
        hull.pop()
    way = np.array([*hull, hull[0]])
    passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    ends = np.linspace(0.0, passed[-1], shoes + 1)
    pins = np.stack([np.interp(ends, passed, way[:, k]) for k in (0, 1)], axis=1) * (rest.forward, 1.0)
    middle, along = 0.5 * (pins[1:] + pins[:-1]), np.diff(pins, axis=0) * (rest.forward)
    # shoes go from the lower pin of a sprocket in front over its far side: forwards below
    angles = np.arctan2(along[:, 1], along[:, 0])
    return list(zip(middle[:, 0].tolist(), middle[:, 1].tolist(), angles.tolist(), strict=True))


def _turns_right(a: Array, b: Array, c: Array) -> bool:
    """True if the way from a over b to c does not turn to the left."""
    return bool((b[0] - a[0]) * (c[1] - a[1]) <= (b[1] - a[1]) * (c[0] - a[0]))


def _fixed_frame(visuals: Visuals, parts: TrackedVehicleParts) -> Pose:
    """The vehicle's frame of reference in the world, of a hull that is built into it."""
    builder, spec = visuals.builder, parts.spec
    sprocket = builder.bodies[builder.joints[parts.left.sprocket].child].pose
    away = np.add(spec.left.sprocket_location, (0.0, spec.track_offset, 0.0))
    return pose(sprocket.position - rotate(sprocket.rotation, away), sprocket.rotation)


def _add_track(
    visuals: Visuals, name: str, side: ShoeTrackParts, track: ShoeTrack, look: PlainAppearanceOptions
) -> list[int]:
    """Instances of one track."""
    joints = visuals.builder.joints
    axles = {joint.child: joint for joint in reversed(joints)}
    found = [
        visuals.add_mesh(joints[side.sprocket].child, sprocket_mesh(track.sprocket), name=f"{name}_sprocket", **look)
    ]
    found.append(
        visuals.add_mesh(side.idler, track_wheel_mesh(track.idler.wheel, rubber=False), name=f"{name}_idler", **look)
    )
    found += _add_rod(
        visuals, f"{name}_carrier", joints[side.tensioner], axles[side.idler], track.idler.wheel.radius, look
    )
    for k, (arm, body, mount) in enumerate(zip(side.arms, side.road_wheels, track.road_wheels, strict=True)):
        wheel = mount.suspension.wheel
        found.append(visuals.add_mesh(body, track_wheel_mesh(wheel), name=f"{name}_wheel_{k}", **look))
        found += _add_rod(visuals, f"{name}_arm_{k}", joints[arm], axles[body], wheel.radius, look)
    rollers = [joint.child for joint in joints if joint.name.startswith(f"{name}.roller")]
    for k, (body, roller) in enumerate(zip(rollers, track.rollers, strict=True)):
        found.append(visuals.add_mesh(body, track_wheel_mesh(roller.wheel), name=f"{name}_roller_{k}", **look))
    asset = visuals.add_mesh_asset(shoe_mesh(track.shoe, shoe_width(track)))
    found += [
        visuals.add_mesh_instance(body, asset, name=f"{name}_shoe_{k}", **look) for k, body in enumerate(side.shoes)
    ]
    return found


def _add_rod(
    visuals: Visuals, name: str, joint: Joint, axle: Joint, radius: float, look: PlainAppearanceOptions
) -> list[int]:
    """The body between a joint of the chassis and a wheel's axle, as a rod; none where both are at one place."""
    ends = [joint.frame1.position, axle.frame0.position]
    if np.linalg.norm(ends[1] - ends[0]) < 1e-3:
        return []
    return [visuals.add_mesh(joint.child, tube(ends, ROD * radius, 0.8 * OLIVE, 6), name=name, **look)]
