"""Chrono's steerings, brakes, drivelines, engines and transmissions to ours. Its maps are over rpm, ours over rad/s."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from simwarp.core.types import formatted
from simwarp.importers.chrono_json import Node
from simwarp.vehicle.spec.vehicle_spec import (
    AutomaticCVT,
    AutomaticMap,
    AutomaticShafts,
    Brake,
    Driveline,
    Engine,
    EngineMap,
    EngineShafts,
    EngineSimple,
    ManualShafts,
    MultiAxleDriveline,
    PitmanArm,
    RackPinion,
    RigidPart,
    RotaryArm,
    ShaftsDriveline2WD,
    ShaftsDriveline4WD,
    SimpleDriveline,
    Steering,
    Transmission,
    Vec3,
)

RPM = math.pi / 30.0

COUNTED = -1.0
"""Reaction of shafts on the chassis in Chrono: drive shaft and driveline each turn it the same way, where they would
cancel, since the two exchange torque and speed with opposite signs (docs/decisions.md).
"""


def unit(node: Node, key: str) -> Vec3:
    """A direction, at length 1."""
    direction = np.array(node.vector(key, ""))
    length = float(np.linalg.norm(direction))
    if length == 0.0:
        raise node.place.at(key).error(f"must be a direction, got {formatted(node.value[key])}")
    x, y, z = (float(v) for v in direction / length)
    return x, y, z


# ---- steering --------------------------------------------------------------------------------------------------------


def pitman_arm(node: Node) -> PitmanArm:
    """PitmanArm. The tie rods' places on the link are those of the suspension."""
    node.skip("Tierod Locations", "Vehicle-Frame Inertia")  # inertia of so small parts is taken in the steering's axes
    pin, cross, idler = (node.child(f"{name} Joint") for name in ("Revolute", "Universal", "Revolute-Spherical"))
    return node.make(
        PitmanArm,
        max_angle=math.radians(pin.number("Maximum Angle (deg)", "°")),
        link=node.child("Steering Link").part(),
        arm=node.child("Pitman Arm").part(),
        arm_chassis=pin.vector("Location"),
        arm_axis=unit(pin, "Direction"),
        arm_link=cross.vector("Location"),
        universal_axis_arm=unit(cross, "Direction Arm"),
        universal_axis_link=unit(cross, "Direction Link"),
        idler_chassis=idler.vector("Location Chassis"),
        idler_link=idler.vector("Location Link"),
        idler_axis=unit(idler, "Direction"),
    )


def rack_pinion(node: Node) -> RackPinion:
    """RackPinion. The link's centre of mass is a place along the rack."""
    link, pinion = node.child("Steering Link"), node.child("Pinion")
    return node.make(
        RackPinion,
        max_angle=math.radians(pinion.number("Maximum Angle (deg)", "°")),
        pinion_radius=pinion.number("Radius", "m"),
        link=link.part((0.0, link.number("COM", "m"), 0.0)),
    )


def rotary_arm(node: Node) -> RotaryArm:
    """RotaryArm: the arm's centre of mass is its middle."""
    arm = node.child("Pitman Arm")
    pivot, tip = arm.vector("Point of Rotation"), arm.vector("Point to Draglink")
    part = arm.make(
        RigidPart,
        mass=arm.number("Mass", "kg"),
        com=tuple(0.5 * (a + b) for a, b in zip(pivot, tip, strict=True)),
        inertia=arm.vector("Inertia", "kg·m²"),
        products=arm.vector("Inertia Products", "kg·m²"),
    )
    return node.make(
        RotaryArm,
        max_angle=math.radians(arm.number("Maximum Angle (deg)", "°")),
        arm=part,
        arm_chassis=pivot,
        arm_axis=unit(arm, "Axis of Rotation"),
    )


STEERINGS: dict[str, Callable[[Node], Steering]] = {
    "PitmanArm": pitman_arm,
    "RackPinion": rack_pinion,
    "RotaryArm": rotary_arm,
}


def brake(node: Node) -> Brake:
    """BrakeSimple, or BrakeShafts, whose shaft stands still with the upright."""
    node.skip("Shaft Inertia")
    return node.make(Brake, max_torque=node.number("Maximum Torque", "N·m"))


BRAKES: dict[str, Callable[[Node], Brake]] = {"BrakeSimple": brake, "BrakeShafts": brake}


# ---- drivelines ------------------------------------------------------------------------------------------------------


def driven(node: Node, axles: tuple[int, ...], count: int) -> tuple[int, ...]:
    """The driven axles, if they are as many as the driveline drives."""
    if len(axles) != count:
        raise node.place.error(f"drives {count} axles, but the vehicle's Driveline.Suspension Indexes are {axles}")
    return axles


def shafts_2wd(node: Node, axles: tuple[int, ...]) -> ShaftsDriveline2WD:
    """ShaftsDriveline2WD. Directions only place the reaction on the chassis."""
    node.skip("Shaft Direction")
    inertia = node.child("Shaft Inertia")
    return node.make(
        ShaftsDriveline2WD,
        axle=driven(node, axles, 1)[0],
        driveshaft_inertia=inertia.number("Driveshaft", "kg·m²"),
        box_inertia=inertia.number("Differential Box", "kg·m²"),
        gear_ratio=node.child("Gear Ratio").number("Conical Gear"),
        locking_limit=node.number("Axle Differential Locking Limit", "N·m", 0.0),
        reaction=COUNTED,
    )


def shafts_4wd(node: Node, axles: tuple[int, ...]) -> ShaftsDriveline4WD:
    """ShaftsDriveline4WD. The central box is the drive shaft itself: Chrono gives its own inertia to nothing."""
    node.skip("Shaft Direction")
    inertia, ratio = node.child("Shaft Inertia"), node.child("Gear Ratio")
    inertia.skip("Central Differential Box")
    return node.make(
        ShaftsDriveline4WD,
        axles=driven(node, axles, 2),
        driveshaft_inertia=inertia.number("Driveshaft", "kg·m²"),
        front_shaft_inertia=inertia.number("Front Driveshaft", "kg·m²"),
        rear_shaft_inertia=inertia.number("Rear Driveshaft", "kg·m²"),
        front_box_inertia=inertia.number("Front Differential Box", "kg·m²"),
        rear_box_inertia=inertia.number("Rear Differential Box", "kg·m²"),
        front_gear_ratio=ratio.number("Front Conical Gear"),
        rear_gear_ratio=ratio.number("Rear Conical Gear"),
        axle_locking_limit=node.number("Axle Differential Locking Limit", "N·m", 0.0),
        central_locking_limit=node.number("Central Differential Locking Limit", "N·m", 0.0),
        reaction=COUNTED,
    )


def simple_driveline(node: Node, axles: tuple[int, ...]) -> SimpleDriveline:
    """SimpleDriveline: its torque on the wheels does not act back on the chassis."""
    return node.make(
        SimpleDriveline,
        axles=driven(node, axles, 2),
        front_torque_fraction=node.number("Front Torque Fraction"),
        front_gear_ratio=node.number("Front Conical Gear Ratio"),
        rear_gear_ratio=node.number("Rear Conical Gear Ratio"),
        front_max_bias=node.number("Front Differential Max Bias"),
        rear_max_bias=node.number("Rear Differential Max Bias"),
        reaction=0.0,
    )


def simple_multi_axle(node: Node, axles: tuple[int, ...]) -> MultiAxleDriveline:
    """SimpleDrivelineXWD: equal shares, without a bevel gear; its torque does not act back on the chassis either."""
    bias = node.number("Differential Max Bias")
    return node.make(MultiAxleDriveline, axles=axles, max_bias=bias, reaction=0.0)


DRIVELINES: dict[str, Callable[[Node, tuple[int, ...]], Driveline]] = {
    "ShaftsDriveline2WD": shafts_2wd,
    "ShaftsDriveline4WD": shafts_4wd,
    "SimpleDriveline": simple_driveline,
    "SimpleDrivelineXWD": simple_multi_axle,
}


# ---- engines and transmissions ---------------------------------------------------------------------------------------


def engine_simple(node: Node) -> EngineSimple:
    """EngineSimple: its speed is in rad/s already."""
    return node.make(
        EngineSimple,
        max_torque=node.number("Maximum Engine Torque", "N·m"),
        max_power=node.number("Maximum Engine Power", "W"),
        max_speed=node.number("Maximum Engine Speed", "rad/s"),
    )


def engine_map(node: Node) -> EngineMap:
    """EngineSimpleMap."""
    return node.make(
        EngineMap,
        max_speed=RPM * node.number("Maximal Engine Speed RPM", "rpm"),
        full_throttle=node.pairs("Map Full Throttle", RPM),
        zero_throttle=node.pairs("Map Zero Throttle", RPM),
    )


def engine_shafts(node: Node) -> EngineShafts:
    """EngineShafts. The block is bolted to the chassis: its inertia is the chassis's."""
    node.skip("Motor Block Inertia")
    return node.make(
        EngineShafts,
        inertia=node.number("Motorshaft Inertia", "kg·m²"),
        torque=node.pairs("Torque Map", RPM),
        losses=node.pairs("Losses Map", RPM),
    )


ENGINES: dict[str, Callable[[Node], Engine]] = {
    "EngineSimple": engine_simple,
    "EngineSimpleMap": engine_map,
    "EngineShafts": engine_shafts,
}


def automatic_map(node: Node) -> AutomaticMap:
    """AutomaticTransmissionSimpleMap."""
    box = node.child("Gear Box")
    return node.make(
        AutomaticMap,
        forward_ratios=box.numbers("Forward Gear Ratios"),
        reverse_ratio=box.number("Reverse Gear Ratio"),
        shift_points=tuple((RPM * down, RPM * up) for down, up in box.pairs("Shift Points Map RPM")),
    )


def automatic_shafts(node: Node) -> AutomaticShafts:
    """AutomaticTransmissionShafts."""
    node.skip("Transmission Block Inertia")  # as that of the motor block
    box, converter = node.child("Gear Box"), node.child("Torque Converter")
    return node.make(
        AutomaticShafts,
        motorshaft_inertia=node.number("Motorshaft Inertia", "kg·m²"),
        input_inertia=node.number("Input Shaft Inertia", "kg·m²"),
        driveshaft_inertia=node.number("Driveshaft Inertia", "kg·m²"),
        capacity_factor=converter.pairs("Capacity Factor Map"),
        torque_ratio=converter.pairs("Torque Ratio Map"),
        forward_ratios=box.numbers("Forward Gear Ratios"),
        reverse_ratio=box.number("Reverse Gear Ratio"),
        upshift_speed=RPM * box.number("Upshift RPM", "rpm"),
        downshift_speed=RPM * box.number("Downshift RPM", "rpm"),
        shift_latency=box.number("Shift Latency", "s", 0.5),
        reaction=COUNTED,
    )


def manual_shafts(node: Node) -> ManualShafts:
    """ManualTransmissionShafts."""
    node.skip("Transmission Block Inertia")
    box = node.child("Gear Box")
    return node.make(
        ManualShafts,
        motorshaft_inertia=node.number("Motorshaft Inertia", "kg·m²"),
        input_inertia=node.number("Input Shaft Inertia", "kg·m²"),
        driveshaft_inertia=node.number("Driveshaft Inertia", "kg·m²"),
        clutch_limit=node.number("Clutch Torque Limit", "N·m"),
        forward_ratios=box.numbers("Forward Gear Ratios"),
        reverse_ratio=box.number("Reverse Gear Ratio"),
    )


def cvt(node: Node) -> AutomaticCVT:
    """AutomaticTransmissionSimpleCVT: its speeds are in rad/s already."""
    box = node.child("Gear Box")
    return node.make(
        AutomaticCVT,
        min_ratio=box.number("Minimum Gear Ratio"),
        max_ratio=box.number("Maximum Gear Ratio"),
        speed_begin=box.number("Driveshaft Speed Begin", "rad/s"),
        speed_end=box.number("Driveshaft Speed End", "rad/s"),
        efficiency=box.number("Efficiency", default=1.0),
    )


TRANSMISSIONS: dict[str, Callable[[Node], Transmission]] = {
    "AutomaticTransmissionSimpleMap": automatic_map,
    "AutomaticTransmissionShafts": automatic_shafts,
    "ManualTransmissionShafts": manual_shafts,
    "AutomaticTransmissionSimpleCVT": cvt,
}
