"""Tracked vehicles of Project Chrono: its JSON files, as they are, to our descriptions.

    spec = load_chrono_tracked_vehicle("data/vehicle/M113/vehicle/M113_Vehicle_SinglePin.json")

Bands (`TrackAssemblyBandANCF`, `TrackAssemblyBandBushing`) are not read.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from simwarp.importers.chrono_drivetrain import ENGINES, TRANSMISSIONS
from simwarp.importers.chrono_json import Node
from simwarp.importers.chrono_vehicle import Files, chassis, open_vehicle
from simwarp.vehicle.spec.parts import ForceLine, RigidPart
from simwarp.vehicle.spec.track_parts import (
    BrakedDifferential,
    DoublePinShoe,
    DoublePinSprocket,
    RoadWheelMount,
    ShoePad,
    ShoeTrack,
    SimpleTrackDriveline,
    SinglePinShoe,
    SinglePinSprocket,
    SlidingIdler,
    SupportRoller,
    Tensioner,
    TorsionArm,
    TrackWheel,
)
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_parts import Brake
from simwarp.vehicle.spec.vehicle_spec import Vec3

OFFSETS_ALIKE = 1.0e-6
"""By which the two tracks may differ in their distance from the middle [m]."""


def load_chrono_tracked_vehicle(
    vehicle_json: str | Path, *, engine: str | Path | None = None, transmission: str | Path | None = None,
    root: str | Path | None = None,
) -> TrackedVehicleSpec:  # fmt: skip
    """The vehicle of a Chrono file of type Vehicle, template TrackedVehicle.

    Args:
        vehicle_json: its path.
        engine: file of its engine, given together with a transmission.
        transmission: file of its transmission.
        root: the folder that file names are relative to; None: the nearest folder above the vehicle's file in which
            its chassis is found.

    Raises:
        SpecError: a file that cannot be read, an unknown key or template, or a value that breaks a rule.
    """
    node, chassis_file, files = open_vehicle(Path(vehicle_json), "TrackedVehicle", root)
    mounts = list(node.each("Track Assemblies"))
    if len(mounts) != 2:
        raise node.place.at("Track Assemblies").error(f"must be two, left and right, got {len(mounts)}")
    left, right = (mount.number("Offset", "m") for mount in mounts)
    if not (left > 0.0 and abs(left + right) <= OFFSETS_ALIKE):
        rule = f"must be equal, the left one positive and the right one negative, got {left} and {right}"
        raise node.place.at("Track Assemblies").error(rule)
    tracks = [files.part("TrackAssembly", ASSEMBLIES, mount.text("Input File"), files) for mount in mounts]
    spec = node.make(
        TrackedVehicleSpec,
        name=node.text("Name") if "Name" in node else Path(vehicle_json).stem,
        chassis=files.part("Chassis", {"RigidChassis": chassis}, chassis_file),
        left=tracks[0], right=tracks[1], track_offset=left,
        driveline=files.part("TrackDriveline", DRIVELINES, node.child("Driveline").text("Input File"))
        if "Driveline" in node else None,
        engine=None if engine is None else files.part("Engine", ENGINES, engine),
        transmission=None if transmission is None else files.part("Transmission", TRANSMISSIONS, transmission),
    )  # fmt: skip
    node.finish()
    return spec


def assembly(node: Node, files: Files) -> ShoeTrack:
    """TrackAssemblySinglePin and DoublePin. Parts of the right side are those of the left, mirrored."""
    sprocket, idler, shoes = node.child("Sprocket"), node.child("Idler"), node.child("Track Shoes")
    mounts = []
    for mount in node.each("Suspension Subsystems"):
        part = files.part("TrackSuspension", SUSPENSIONS, mount.text("Input File"), files, mount.flag("Has Shock"))
        mounts.append(mount.make(RoadWheelMount, location=mount.vector("Location"), suspension=part))
    rollers = [
        roller.make(
            SupportRoller,
            location=roller.vector("Location"),
            wheel=files.part("TrackWheel", WHEELS, roller.text("Input File")),
        )
        for roller in (node.each("Rollers") if "Rollers" in node else ())
    ]
    pins = shoes.child("RSDA Data") if "RSDA Data" in shoes else None
    return node.make(
        ShoeTrack,
        sprocket=files.part("Sprocket", SPROCKETS, sprocket.text("Input File")),
        sprocket_location=sprocket.vector("Location"),
        idler=files.part("Idler", {"TranslationalIdler": translational_idler}, idler.text("Input File"), files),
        idler_location=idler.vector("Location"),
        road_wheels=tuple(mounts),
        shoe=files.part("TrackShoe", SHOES, shoes.text("Input File")),
        shoes=shoes.whole("Number Shoes"),
        rollers=tuple(rollers),
        pin_stiffness=0.0 if pins is None else pins.number("Stiffness Rotational", "N·m/rad"),
        pin_damping=0.0 if pins is None else pins.number("Damping Rotational", "N·m·s/rad"),
        brake=files.part("TrackBrake", {"TrackBrakeSimple": brake}, node.child("Brake").text("Input File"))
        if "Brake" in node else None,
    )  # fmt: skip


def left_side(point: Vec3) -> Vec3:
    """A point of a part of either side as that of the left one: inwards is -y there."""
    x, y, z = point
    return x, -abs(y) if y != 0.0 else 0.0, z


def friction(node: Node) -> float:
    """Of a material; what penalty contacts use is left out, as restitution of chains under load is."""
    node.skip("Coefficient of Restitution", "Properties", "Coefficients")
    return node.number("Coefficient of Friction")


def track_wheel(node: Node) -> TrackWheel:
    """SingleTrackWheel and DoubleTrackWheel."""
    wheel, double = node.child("Wheel"), node.choice("Template", WHEELS) == "DoubleTrackWheel"
    return wheel.make(
        TrackWheel,
        mass=wheel.number("Mass", "kg"), inertia=wheel.vector("Inertia", "kg·m²"), radius=wheel.number("Radius", "m"),
        width=wheel.number("Width", "m"), gap=wheel.number("Gap", "m") if double else 0.0,
        friction=friction(node.child("Contact Material")),
    )  # fmt: skip


def damper_suspension(node: Node, files: Files, has_shock: bool) -> TorsionArm:
    """TranslationalDamperSuspension: a torsion bar, and a damper along a line."""
    arm, spring = node.child("Suspension Arm"), node.child("Torsional Spring")
    arm.skip("Radius")
    shock = damper_line(node) if "Damper" in node else None
    return node.make(
        TorsionArm,
        arm=arm.part(left_side(arm.vector("COM"))),
        hinge=left_side(arm.vector("Location Chassis")), wheel_joint=left_side(arm.vector("Location Wheel")),
        stiffness=spring.number("Spring Constant", "N·m/rad"),
        damping=spring.number("Damping Coefficient", "N·m·s/rad"),
        free_angle=spring.number("Free Angle", "rad"), preload=spring.number("Preload", "N·m"),
        shock=shock if has_shock else None,
        wheel=files.part("TrackWheel", WHEELS, node.text("Road Wheel Input File")),
    )  # fmt: skip


def damper_line(node: Node) -> ForceLine:
    """The damper of a suspension."""
    damper = node.child("Damper")
    return damper.make(
        ForceLine,
        chassis_point=left_side(damper.vector("Location Chassis")),
        arm_point=left_side(damper.vector("Location Arm")),
        damping=damper.number("Damping Coefficient", "N·s/m"),
    )


def translational_idler(node: Node, files: Files) -> SlidingIdler:
    """TranslationalIdler. Chrono's preload is the force at the free length."""
    carrier, tensioner = node.child("Carrier"), node.child("Tensioner")
    carrier.skip("Visualization Radius", "Location Wheel")
    return node.make(
        SlidingIdler,
        carrier=carrier.make(
            RigidPart, mass=carrier.number("Mass", "kg"), com=left_side(carrier.vector("COM")),
            inertia=carrier.vector("Inertia", "kg·m²"),
        ),
        slide=left_side(carrier.vector("Location Chassis")),
        slide_angle=math.radians(carrier.number("Pitch Angle", "°", 0.0)),
        tensioner=tensioner.make(
            Tensioner,
            carrier_point=left_side(tensioner.vector("Location Carrier")),
            chassis_point=left_side(tensioner.vector("Location Chassis")),
            free_length=tensioner.number("Free Length", "m"),
            stiffness=tensioner.number("Spring Coefficient", "N/m"),
            damping=tensioner.number("Damping Coefficient", "N·s/m"),
            preload=tensioner.number("Preload", "N"),
        ),
        wheel=files.part("TrackWheel", WHEELS, node.text("Idler Wheel Input File")),
    )  # fmt: skip


def sprocket_fields(node: Node, profile: Node) -> dict[str, Any]:
    """What all sprockets have."""
    return {
        "mass": node.number("Gear Mass", "kg"), "inertia": node.vector("Gear Inertia", "kg·m²"),
        "axle_inertia": node.number("Axle Inertia", "kg·m²"), "teeth": node.whole("Number Teeth"),
        "separation": node.number("Gear Separation", "m"), "backlash": node.number("Lateral Backlash", "m"),
        "assembly_radius": profile.number("Assembly Radius", "m"),
        "tip_radius": profile.number("Addendum Radius", "m"), "arc_radius": profile.number("Arc Radius", "m"),
        "friction": friction(node.child("Contact Material")),
    }  # fmt: skip


def single_pin_sprocket(node: Node) -> SinglePinSprocket:
    """SprocketSinglePin."""
    profile = node.child("Profile")
    radius = profile.number("Arc Centers Radius", "m")
    return node.make(SinglePinSprocket, arc_center_radius=radius, **sprocket_fields(node, profile))


def double_pin_sprocket(node: Node) -> DoublePinSprocket:
    """SprocketDoublePin."""
    profile = node.child("Profile")
    return node.make(
        DoublePinSprocket,
        arc_center_height=profile.number("Arc Center Height", "m"),
        arc_center_offset=profile.number("Arc Center Offset", "m"),
        **sprocket_fields(node, profile),
    )


def shoe_fields(node: Node, shoe: Node, contact: Node) -> dict[str, Any]:
    """What all shoes have: the first box that meets the ground, and the first that does not, are its pads; what else
    meets the ground is beside them. The guide is as wide as the narrowest box around its point.
    """
    shapes = list(contact.each("Shoe Shapes"))
    guide = node.vector("Guide Pin Center")
    widths: list[float] = []
    pads: dict[bool, list[ShoePad]] = {True: [], False: []}
    for shape in shapes:
        shape.skip("Type", "Orientation", "Material Index")
        size, center = shape.vector("Dimensions"), shape.vector("Location")
        pads[shape.flag("Ground Contact")].append(shape.make(ShoePad, center=center, size=size))
        if all(abs(p - c) <= 0.5 * s for p, c, s in zip(guide, center, size, strict=True)):
            widths.append(size[1])
    if not all(pads.values()):
        raise contact.place.at("Shoe Shapes").error("must have a box with and one without Ground Contact, got one kind")
    materials = [friction(material) for material in contact.each("Shoe Materials")]
    return {
        "mass": shoe.number("Mass", "kg"), "inertia": shoe.vector("Inertia", "kg·m²"),
        "height": shoe.number("Height", "m"), "guide": guide,
        **({"guide_width": min(widths)} if widths else {}),
        "ground_pad": pads[True][0], "side_pads": tuple(pads[True][1:]), "wheel_pad": pads[False][0],
        "friction": materials[0],
    }  # fmt: skip


def single_pin_shoe(node: Node) -> SinglePinShoe:
    """TrackShoeSinglePin."""
    shoe, contact = node.child("Shoe"), node.child("Contact")
    cylinder = contact.child("Cylinder Shape")
    contact.skip("Cylinder Material")
    return node.make(
        SinglePinShoe,
        pitch=shoe.number("Pitch", "m"),
        roller_radius=cylinder.number("Radius", "m"), roller_front=cylinder.number("Front Offset", "m"),
        roller_rear=cylinder.number("Rear Offset", "m"), **shoe_fields(node, shoe, contact),
    )  # fmt: skip


def double_pin_shoe(node: Node) -> DoublePinShoe:
    """TrackShoeDoublePin. Two connectors as one body: their masses, and what their distance adds, together."""
    shoe, connector, contact = node.child("Shoe"), node.child("Connector"), node.child("Contact")
    contact.skip("Connector Material")
    topology = node.choice("Topology", ("One Connector", "Two Connectors")) if "Topology" in node else "Two Connectors"
    return node.make(
        DoublePinShoe,
        length=shoe.number("Length", "m"), width=shoe.number("Width", "m"),
        connector=connector.make(
            RigidPart, mass=connector.number("Mass", "kg"), inertia=connector.vector("Inertia", "kg·m²")
        ),
        connector_length=connector.number("Length", "m"), connector_radius=connector.number("Radius", "m"),
        connector_width=connector.number("Width", "m"), joined=topology == "One Connector",
        **shoe_fields(node, shoe, contact),
    )  # fmt: skip


def simple_driveline(node: Node) -> SimpleTrackDriveline:
    """SimpleTrackDriveline."""
    return node.make(SimpleTrackDriveline, differential_bias=node.number("Differential Max Bias"))


def braked_differential(node: Node) -> BrakedDifferential:
    """TrackDrivelineBDS."""
    return node.make(
        BrakedDifferential,
        driveshaft_inertia=node.number("Driveshaft Inertia", "kg·m²"),
        box_inertia=node.number("Differential Box Inertia", "kg·m²"),
        bevel_ratio=node.number("Conical Gear Ratio"),
    )


def brake(node: Node) -> Brake:
    """TrackBrakeSimple."""
    return node.make(Brake, max_torque=node.number("Maximum Torque", "N·m"))


ASSEMBLIES = {"TrackAssemblySinglePin": assembly, "TrackAssemblyDoublePin": assembly}
SPROCKETS = {"SprocketSinglePin": single_pin_sprocket, "SprocketDoublePin": double_pin_sprocket}
SHOES = {"TrackShoeSinglePin": single_pin_shoe, "TrackShoeDoublePin": double_pin_shoe}
SUSPENSIONS = {"TranslationalDamperSuspension": damper_suspension}
WHEELS = {"SingleTrackWheel": track_wheel, "DoubleTrackWheel": track_wheel}
DRIVELINES = {"SimpleTrackDriveline": simple_driveline, "TrackDrivelineBDS": braked_differential}
