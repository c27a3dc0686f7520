"""From the description of tracks by belt to bodies and joints of a ModelBuilder: a chassis, arms, and a shaft each.

The belt is no body. Its mass travels with the vehicle: the lower run's in the road wheels' arms, the rest in
the chassis, which has sprockets, idlers and rollers too. What turns with it is the inertia of the shaft.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np

from simwarp.core.rotation import rotate
from simwarp.core.types import pose
from simwarp.vehicle.spec.belt_parts import BeltTrack
from simwarp.vehicle.spec.parts import Array, RigidPart, inertia_matrix, merged
from simwarp.vehicle.spec.track_parts import RoadWheelMount, TrackSprocket, TrackWheel
from simwarp.vehicle.suspensions.corner import Frame
from simwarp.vehicle.tracks.belt_path import RestingBelt, rest_belt, running_radius
from simwarp.vehicle.tracks.shoe_construction import trailing_arm_axes

THIN: Final = 1.0e-3
"""Least moment of inertia of a part that has none about an axis [kg·m²]: descriptions ask for positive ones."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BeltTrackParts:
    """Indices, in the builder, of what a track by belt is made of."""

    spec: BeltTrack
    resting: RestingBelt
    chassis: int
    """Body."""
    origin: Array
    """(3,) of the track from the chassis' centre of mass, body axes [m]."""
    sprocket: int
    """Joint, a shaft; its coordinate is positive in forward drive [rad]."""
    arms: tuple[int, ...]
    """Joints, from front to rear; coordinates are positive with the wheel up [rad]."""


def chassis_parts(track: BeltTrack, track_offset: float, side: float) -> tuple[RigidPart, ...]:
    """What a track leaves to the chassis, in the vehicle's frame of reference: `merged` adds it to the chassis' own.

    Args:
        track: described as a left one.
        track_offset: of its middle from the vehicle's [m].
        side: 1 of the left track, -1 of the right one.

    Raises:
        SpecError: its belt does not go around.
    """
    resting = rest_belt(track)
    sprocket, idler = track.sprocket, track.idler
    per_length = track.shoe.mass / track.shoe.pitch
    idler_x, idler_z = (np.array([resting.forward, 1.0]) * resting.centers[-1]).tolist()
    upper = per_length * abs(idler_x)
    # The arms hold the lower run at their wheels' centres; the upper one makes up for its height below them
    fallen = lower_run_mass(track) * float(np.mean(resting.radii[1:-1])) / upper
    height = 0.5 * (resting.radii[0] + resting.radii[-1] + idler_z) - fallen
    rod = upper * idler_x**2 / 12.0 + THIN
    x0, y0, z0 = track.sprocket_location

    def part(mass: float, place: tuple[float, float, float], inertia: tuple[float, float, float]) -> RigidPart:
        x, y, z = place
        com = (x0 + x, side * (track_offset + y0 + y), z0 + z)
        return RigidPart(mass=mass, com=com, inertia=inertia)

    def still(wheel: TrackWheel | TrackSprocket, radius: float, x: float, z: float) -> RigidPart:
        """A wheel with the belt around half of it, but for the spin of both."""
        arc = math.pi * radius * per_length
        own = 0.5 * arc * radius**2
        return part(wheel.mass + arc, (x, 0.0, z), (wheel.inertia[0] + own, THIN, wheel.inertia[2] + own))

    carrier = idler.carrier
    beside = (idler_x + carrier.com[0], carrier.com[1], idler_z + carrier.com[2])
    carried = [
        still(sprocket, resting.radii[0], 0.0, 0.0), still(idler.wheel, resting.radii[-1], idler_x, idler_z),
        part(carrier.mass, beside, carrier.inertia), part(upper, (0.5 * idler_x, 0.0, height), (THIN, rod, rod)),
    ]  # fmt: skip
    carried += [
        RigidPart(
            mass=roller.wheel.mass, inertia=(roller.wheel.inertia[0], THIN, roller.wheel.inertia[2]),
            com=(roller.location[0], side * (track_offset + roller.location[1]), roller.location[2]),
        )
        for roller in track.rollers
    ]  # fmt: skip
    return tuple(carried)


def lower_run_mass(track: BeltTrack) -> float:
    """Mass of the belt that the road wheels' arms carry [kg]."""
    resting = rest_belt(track)
    per_length = track.shoe.mass / track.shoe.pitch
    around = abs(resting.centers[-1][0]) + math.pi * (resting.radii[0] + resting.radii[-1])
    return max(track.shoes * track.shoe.mass - per_length * float(around), 0.0)


def belt_inertia(track: BeltTrack) -> float:
    """Inertia about the sprocket's axis of all that turns with the belt, and of the belt [kg·m²]."""
    radius = running_radius(track, rest_belt(track))
    wheels = [track.idler.wheel, *(mount.suspension.wheel for mount in track.road_wheels)]
    wheels += [roller.wheel for roller in track.rollers]
    spins = sum(wheel.inertia[1] * (radius / wheel.radius) ** 2 for wheel in wheels)
    own = track.sprocket.axle_inertia + track.sprocket.inertia[1]
    return own + track.shoes * track.shoe.mass * radius**2 + spins


def add_belt_track(frame: Frame, spec: BeltTrack, chassis: int) -> BeltTrackParts:
    """Adds a track by belt to a chassis, whose mass has `chassis_parts` already.

    Args:
        frame: of the track: its builder, the prefix of its names, its origin in the world, its side.
        spec: described as a left one.
        chassis: body.

    Raises:
        SpecError: the belt does not go around.
    """
    resting = rest_belt(spec)
    builder = frame.builder
    brake = 0.0 if spec.brake is None else spec.brake.max_torque
    sprocket = builder.add_shaft(f"{frame.name}.sprocket", inertia=belt_inertia(spec), friction=brake)
    run = lower_run_mass(spec) / len(spec.road_wheels)
    arms = tuple(_add_arm(frame, index, mount, chassis, run) for index, mount in enumerate(spec.road_wheels))
    body = builder.bodies[chassis].pose
    back = np.array([-body.rotation[0], -body.rotation[1], -body.rotation[2], body.rotation[3]])
    origin = rotate(back, frame.at(spec.sprocket_location) - body.position)
    return BeltTrackParts(
        spec=spec, resting=resting, chassis=chassis, origin=origin, sprocket=sprocket, arms=arms,
    )  # fmt: skip


def _add_arm(frame: Frame, index: int, mount: RoadWheelMount, chassis: int, run: float) -> int:
    """A trailing arm with its road wheel, whose spin belongs to the belt, and some of the belt at its end."""
    place = dataclasses.replace(frame, origin=pose(frame.at(mount.location), frame.origin.rotation))
    suspension, builder = mount.suspension, frame.builder
    axes = trailing_arm_axes(suspension.hinge, suspension.wheel_joint)
    own = axes @ inertia_matrix(suspension.arm) @ axes.T
    wheel = suspension.wheel
    end = RigidPart(mass=wheel.mass + run, inertia=(wheel.inertia[0], THIN, wheel.inertia[2]))
    total, com, inertia = merged((suspension.arm, end))
    inertia += own - inertia_matrix(suspension.arm)
    mirror = np.diag([1.0, frame.side, 1.0])
    body = builder.add_body(
        f"{frame.name}.arm{index}", mass=total, inertia=mirror @ inertia @ mirror,
        pose=pose(place.at((float(com[0]), float(com[1]), float(com[2]))), frame.origin.rotation), strict=False,
    )  # fmt: skip
    trailing = math.copysign(1.0, suspension.hinge[0] - suspension.wheel_joint[0])
    axis = rotate(frame.origin.rotation, np.array([0.0, trailing, 0.0]))
    joint = builder.add_joint_revolute(
        f"{frame.name}.arm{index}", chassis, body, axis=axis, anchor=place.at(suspension.hinge),
        stiffness=suspension.stiffness, damping=suspension.damping, rest=suspension.free_angle,
        preload=suspension.preload,
    )  # fmt: skip
    if suspension.shock is not None:
        place.add_line(f"shock{index}", chassis, body, suspension.shock)
    return joint
