"""A vehicle and its mirror image: the description reflected in the plane y = 0 of the vehicle's frame.

Driven with the opposite steering, the mirror image drives the mirrored run: what turns to the left here turns to the
right there. Points and axes are reflected as they lie (polar vectors); torques and turns about them change their sense,
and so does a joint's positive angle about a reflected axis, which the opposite steering makes up for.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from simwarp.vehicle.spec.beam_axle_parts import BeamAxle
from simwarp.vehicle.spec.drivetrain_parts import AutomaticShafts, ShaftsDriveline2WD, ShaftsDriveline4WD
from simwarp.vehicle.spec.vehicle_spec import (
    Axle,
    Chassis,
    PinnedAxle,
    PitmanArm,
    RackPinion,
    RigidPart,
    RotaryArm,
    SolidAxle,
    SpecError,
    Steering,
    SteeringMount,
    Suspension,
    Tire,
    Trailer,
    Vec3,
    VehicleSpec,
)
from simwarp.vehicle.tires.parameter_vector import tire_vector
from simwarp.vehicle.tires.tire_file_rules import side_of

ASYMMETRIC_TIRES = ("pacejka89", "pacejka2002")
"""Templates whose parameters differ between left and right."""


def mirrored(spec: VehicleSpec) -> VehicleSpec:
    """The mirror image of a vehicle. Suspensions are symmetric as they are described; the rest is reflected.

    Raises:
        SpecError: a solid axle's drag link holds the left knuckle and nothing describes one on the right; or a tire
            that differs between left and right is mounted alike on both sides.
    """
    driveline, transmission = spec.driveline, spec.transmission
    # a torque about x turns the other way
    if isinstance(driveline, (ShaftsDriveline2WD, ShaftsDriveline4WD)):
        driveline = dataclasses.replace(driveline, reaction=-driveline.reaction)
    if isinstance(transmission, AutomaticShafts):
        transmission = dataclasses.replace(transmission, reaction=-transmission.reaction)
    return dataclasses.replace(
        spec, chassis=_chassis(spec.chassis), driveline=driveline, transmission=transmission,
        axles=tuple(_axle(index, axle) for index, axle in enumerate(spec.axles)),
        steerings=tuple(_mount(mount) for mount in spec.steerings),
        trailers=tuple(_trailer(trailer) for trailer in spec.trailers),
    )  # fmt: skip


def _chassis(chassis: Chassis) -> Chassis:
    return dataclasses.replace(
        chassis, components=tuple(mirrored_part(part) for part in chassis.components),
        size_center=flipped(chassis.size_center),
    )  # fmt: skip


def _trailer(trailer: Trailer) -> Trailer:
    hitch = dataclasses.replace(
        trailer.hitch, towing_point=flipped(trailer.hitch.towing_point),
        trailer_point=flipped(trailer.hitch.trailer_point),
    )  # fmt: skip
    axles = tuple(_axle(index, axle) for index, axle in enumerate(trailer.axles))
    return dataclasses.replace(trailer, hitch=hitch, chassis=_chassis(trailer.chassis), axles=axles)


def flipped(vector: Vec3) -> Vec3:
    """A point or a direction behind the mirror."""
    x, y, z = vector
    # no -0.0, which would read as a difference
    return (x, -y if y else 0.0, z)


def mirrored_part(part: RigidPart) -> RigidPart:
    """The same mass behind the mirror: the products of inertia with y change their sign."""
    xy, xz, yz = part.products
    return dataclasses.replace(part, com=flipped(part.com), products=(-xy if xy else 0.0, xz, -yz if yz else 0.0))


def _mount(mount: SteeringMount) -> SteeringMount:
    x, y, z, w = mount.rotation
    return dataclasses.replace(
        mount, steering=_steering(mount.steering), location=flipped(mount.location), rotation=(-x, y, -z, w)
    )


def _steering(steering: Steering) -> Steering:
    """A steering's points in its own frame, which is reflected with it."""
    match steering:
        case PitmanArm():
            points = (
                "arm_chassis", "arm_axis", "arm_link", "universal_axis_arm", "universal_axis_link", "idler_chassis",
                "idler_axis", "idler_link",
            )  # fmt: skip
            changes: dict[str, Any] = {name: flipped(getattr(steering, name)) for name in points}
            return dataclasses.replace(
                steering, link=mirrored_part(steering.link), arm=mirrored_part(steering.arm), **changes
            )
        case RackPinion():
            return dataclasses.replace(steering, link=mirrored_part(steering.link))
        case RotaryArm():
            return dataclasses.replace(
                steering, arm=mirrored_part(steering.arm), arm_chassis=flipped(steering.arm_chassis),
                arm_axis=flipped(steering.arm_axis),
            )  # fmt: skip
    raise SpecError(f"steering: template '{steering.template}' is not known")


def _axle(index: int, axle: Axle) -> Axle:
    if axle.tire.template in ASYMMETRIC_TIRES and not _sides_mirror(axle.tire, f"axles[{index}].tire"):
        side = axle.tire.parameters.get("measured_side")
        raise SpecError(
            f"axles[{index}].tire.parameters.measured_side: must be left or right to mirror the vehicle, got {side}: "
            f"{axle.tire.template} differs between left and right, and both sides have the same"
        )
    bar = axle.antiroll_bar
    return dataclasses.replace(
        axle, location=flipped(axle.location), suspension=_suspension(index, axle.suspension),
        antiroll_bar=None if bar is None else dataclasses.replace(bar, location=flipped(bar.location)),
    )  # fmt: skip


def _sides_mirror(tire: Tire, place: str) -> bool:
    """True if the tire of the right side is the mirror image of that of the left one."""
    parameters: Any = tire.parameters
    return tire_vector(tire, place).measured_side is not None or side_of(parameters.get("tir", {})) == "symmetric"


def _suspension(index: int, suspension: Suspension) -> Suspension:
    """Sides mirror each other already; what both share is reflected."""
    match suspension:
        case SolidAxle():
            if suspension.draglink_chassis is not None:
                raise SpecError(
                    f"axles[{index}].suspension.draglink_chassis: must be absent to mirror the vehicle: a drag link "
                    "holds the left knuckle, and nothing describes one on the right"
                )
            return dataclasses.replace(suspension, axle_tube=mirrored_part(suspension.axle_tube))
        case BeamAxle():
            return _beam(index, suspension)
        case PinnedAxle():
            return dataclasses.replace(
                suspension, axle_tube=mirrored_part(suspension.axle_tube), pin=flipped(suspension.pin)
            )
    return suspension


def _beam(index: int, spec: BeamAxle) -> BeamAxle:
    """What is not mirrored within it is reflected; a drag link to a knuckle changes the side that it holds."""
    if spec.bell_crank is not None:
        raise SpecError(
            f"axles[{index}].suspension.bell_crank: must be absent to mirror the vehicle: its tie rod holds the left "
            "knuckle, and nothing describes one on the right"
        )
    rods = tuple(
        rod
        if rod.mirrored
        else dataclasses.replace(rod, chassis_point=flipped(rod.chassis_point), axle_point=flipped(rod.axle_point))
        for rod in spec.rods
    )
    ends: dict[str, Any] = {
        name: flipped(getattr(spec, name))
        for name in ("draglink_chassis", "draglink_knuckle", "ball", "watt")
        if getattr(spec, name) is not None
    }
    return dataclasses.replace(spec, axle_tube=mirrored_part(spec.axle_tube), rods=rods, **ends)
