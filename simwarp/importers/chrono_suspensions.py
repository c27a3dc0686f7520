"""Chrono's suspensions and anti-roll bars to ours. Its points are those of the left side, like ours."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from simwarp.core.types import formatted
from simwarp.importers.chrono_json import Node
from simwarp.vehicle.spec.parts import inertia_matrix
from simwarp.vehicle.spec.vehicle_spec import (
    BUMP_STOP,
    AntirollBar,
    Bushing,
    DamperMap,
    DoubleWishbone,
    DoubleWishboneReduced,
    ForceLine,
    MacPhersonStrut,
    MultiLink,
    PinnedAxle,
    Points,
    RigidPart,
    RigidSuspension,
    SingleWishbone,
    Suspension,
    TrailingArm,
    Vec3,
)
from simwarp.vehicle.suspensions.corner import arm_axes

DEGRESSIVE_SPEEDS = np.linspace(-2.0, 2.0, 81)
"""Speeds at which the law of a degressive damper is sampled [m/s]."""


def force_line(
    node: Node, other: str, *, damper: bool = False, chassis: str = "Location Chassis"
) -> ForceLine:  # fmt: skip
    """A spring, a shock or both between the keys `chassis` and `other`.

    The old key "Curve Data" is a curve of damping where `damper` is set, of stiffness otherwise.
    """
    fields: dict[str, Any] = {
        "chassis_point": node.vector(chassis),
        "arm_point": node.vector(other),
        "preload": node.number("Preload", "N", 0.0),
        "stiffness": node.number("Spring Coefficient", "N/m", 0.0),
        "damping": node.number("Damping Coefficient", "N·s/m", 0.0),
    }
    old_spring, old_damper = ("", "Curve Data") if damper else ("Curve Data", "")
    for field, keys in (
        ("spring_curve", ("Spring Curve Data", old_spring)),
        ("damper_curve", ("Damping Curve Data", old_damper)),
    ):
        for key in filter(None, keys):
            if key in node:
                fields[field] = node.pairs(key)
    if "Degressivity Compression" in node and "Degressivity Expansion" in node:
        fields["damper_curve"] = degressive(node, fields["damping"])
    if "Map Data" in node:
        fields["damper_map"] = damper_map(node)
    springs = "spring_curve" in fields or "Spring Coefficient" in node
    if "Free Length" in node or springs:
        fields["rest_length"] = node.number("Free Length", "m")
    if not springs and not {"damper_curve", "damper_map"} & set(fields) and "Damping Coefficient" not in node:
        raise node.place.at("Spring Coefficient").error("missing; give it, a damping coefficient or a curve of either")
    # in Chrono too a table acts in place of the coefficient beside it
    for linear, tables in (("stiffness", {"spring_curve"}), ("damping", {"damper_curve", "damper_map"})):
        if tables & set(fields):
            fields[linear] = 0.0
    if "Minimum Length" in node and "Maximum Length" in node:
        least, most = node.number("Minimum Length", "m"), node.number("Maximum Length", "m")
        if least > most:
            text = (
                f"Minimum Length: {least:g} m is above Maximum Length, {most:g} m; they are taken the other way round"
            )
            warnings.warn(f"{node.place.file}: {'.'.join(map(str, node.place.keys))}.{text}", stacklevel=2)
        fields |= {"min_length": min(least, most), "max_length": max(least, most), "bump_curve": BUMP_STOP}
    return node.make(ForceLine, **fields)


def degressive(node: Node, coefficient: float) -> Points:
    """Force c v / (1 + d |v|) over the rate v as a table, with a d for each direction."""
    compression = node.number("Degressivity Compression")
    expansion = node.number("Degressivity Expansion")
    slowing = np.where(DEGRESSIVE_SPEEDS < 0.0, compression, expansion)
    force = coefficient * DEGRESSIVE_SPEEDS / (1.0 + slowing * np.abs(DEGRESSIVE_SPEEDS))
    return tuple((float(v), float(f)) for v, f in zip(DEGRESSIVE_SPEEDS, force, strict=True))


def damper_map(node: Node) -> DamperMap:
    """Rows (rate, forces at the lengths): a map without a free length, whose "deformations" are lengths."""
    lengths = node.numbers("Deformation", unit="m")
    rows = node.get("Map Data", "a list of rows [rate, forces]")
    if not isinstance(rows, list) or not all(isinstance(row, list) and len(row) == len(lengths) + 1 for row in rows):
        raise node.place.at("Map Data").error(
            f"must be rows of a rate and {len(lengths)} forces, got {formatted(rows)}"
        )
    table = np.array(rows, dtype=np.float64).tolist()
    return lengths, tuple(row[0] for row in table), tuple(tuple(row[1:]) for row in table)


def bushing(node: Node) -> Bushing | None:
    """Compliance of an arm's joint."""
    if "Bushing Data" not in node:
        return None
    data = node.child("Bushing Data")
    if "DOF" in data:
        own = data.child("DOF")
        for key in ("Stiffness Linear", "Damping Linear", "Stiffness Rotational", "Damping Rotational"):
            if own.number(key, default=0.0) != 0.0:
                raise own.place.at(key).error(
                    f"must be 0, for a joint is free along its own axis, got {own.value[key]}"
                )
    return data.make(
        Bushing,
        stiffness_linear=data.number("Stiffness Linear", "N/m"),
        damping_linear=data.number("Damping Linear", "N·s/m"),
        stiffness_rotational=data.number("Stiffness Rotational", "N·m/rad"),
        damping_rotational=data.number("Damping Rotational", "N·m·s/rad"),
    )


def tierod(node: Node) -> dict[str, Any]:
    """Its ends. Ours has no mass."""
    rod = node.child("Tierod")
    if "Mass" in rod:
        rod.skip("Inertia", "Bushing Data")
        warnings.warn(f"{rod.place.file}: Tierod.Mass: left out, tie rods have no mass", stacklevel=2)
    return {"tierod_chassis": rod.vector("Location Chassis"), "tierod_upright": rod.vector("Location Upright")}


def arm_points(arm: Node, name: str) -> dict[str, Any]:
    """Both pivots of an A-arm on the chassis, and the one on the upright."""
    return {
        f"{name}_front": arm.vector("Location Chassis Front"),
        f"{name}_back": arm.vector("Location Chassis Back"),
        f"{name}_upright": arm.vector("Location Upright"),
    }


def common(node: Node) -> dict[str, Any]:
    """Fields common to all suspensions: spindle, axle shaft, camber and toe."""
    return {
        "camber": node.angle("Camber Angle (deg)"),
        "toe": node.angle("Toe Angle (deg)"),
        "spindle": node.child("Spindle").part(),
        "axle_inertia": node.child("Axle").number("Inertia", "kg·m²"),
    }


def axes(node: Node) -> Literal["arm", "vehicle"]:
    """In which axes arms have their inertia."""
    return "vehicle" if node.flag("Vehicle-Frame Inertia") else "arm"


def double_wishbone(node: Node) -> DoubleWishbone:
    """DoubleWishbone."""
    upper, lower = node.child("Upper Control Arm"), node.child("Lower Control Arm")
    return node.make(
        DoubleWishbone,
        **common(node), **tierod(node), **arm_points(upper, "upper_arm"), **arm_points(lower, "lower_arm"),
        inertia_axes=axes(node),
        upright=node.child("Upright").part(),
        upper_arm=upper.part(),
        lower_arm=lower.part(),
        upper_arm_bushing=bushing(upper),
        lower_arm_bushing=bushing(lower),
        springs=(
            force_line(node.child("Spring"), "Location Arm"),
            force_line(node.child("Shock"), "Location Arm", damper=True),
        ),
    )  # fmt: skip


def double_wishbone_reduced(node: Node) -> DoubleWishboneReduced:
    """DoubleWishboneReduced."""
    return node.make(
        DoubleWishboneReduced,
        **common(node), **tierod(node),
        **arm_points(node.child("Upper Control Arm"), "upper_arm"),
        **arm_points(node.child("Lower Control Arm"), "lower_arm"),
        upright=node.child("Upright").part(),
        springs=(force_line(node.child("Shock"), "Location Upright"),),
    )  # fmt: skip


def single_wishbone(node: Node) -> SingleWishbone:
    """SingleWishbone: the arm turns about the vehicle's x, the upright about its z."""
    arm = node.child("Control Arm")
    return node.make(
        SingleWishbone,
        **common(node), **tierod(node),
        inertia_axes=axes(node),
        upright=node.child("Upright").part(),
        arm=arm.part(),
        arm_chassis=arm.vector("Location Chassis"),
        arm_upright=arm.vector("Location Upright"),
        springs=(force_line(node.child("Shock"), "Location Arm"),),
    )  # fmt: skip


def macpherson_strut(node: Node) -> MacPhersonStrut:
    """MacPhersonStrut: the strut lies on the line of its spring, its centre in the middle."""
    arm, spring = node.child("Control Arm"), node.child("Spring")
    top, bottom = spring.vector("Location Chassis"), spring.vector("Location Upright")
    return node.make(
        MacPhersonStrut,
        **common(node), **tierod(node), **arm_points(arm, "lower_arm"),
        upright=node.child("Upright").part(),
        strut=node.child("Strut").part(middle(top, bottom)),
        lower_arm=arm.part(),
        strut_chassis=top,
        strut_upright=bottom,
        springs=(
            force_line(spring, "Location Upright"),
            force_line(node.child("Shock"), "Location Upright", damper=True),
        ),
    )  # fmt: skip


def multi_link(node: Node) -> MultiLink:
    """MultiLink."""
    arm, lateral, trailing = node.child("Upper Arm"), node.child("Lateral"), node.child("Trailing Link")
    for link in (lateral, trailing):
        # The axes of the cross only choose how a link's spin about its own length is held.
        link.skip("Universal Joint Axis Link", "Universal Joint Axis Chassis")
    return node.make(
        MultiLink,
        **common(node), **tierod(node), **arm_points(arm, "upper_arm"),
        upright=node.child("Upright").part(),
        upper_arm=arm.part(),
        lateral=lateral.part(),
        trailing_link=trailing.part(),
        lateral_chassis=lateral.vector("Location Chassis"),
        lateral_upright=lateral.vector("Location Upright"),
        trailing_link_chassis=trailing.vector("Location Chassis"),
        trailing_link_upright=trailing.vector("Location Upright"),
        springs=(
            force_line(node.child("Spring"), "Location Link"),
            force_line(node.child("Shock"), "Location Link", damper=True),
        ),
    )  # fmt: skip


def rigid_suspension(node: Node) -> RigidSuspension:
    """RigidSuspension."""
    return node.make(RigidSuspension, **common(node))


def pinned_axle(node: Node) -> PinnedAxle:
    """RigidPinnedAxle."""
    tube = node.child("Axle Tube" if "Axle Tube" in node else "Tube")
    return node.make(
        PinnedAxle,
        spindle=node.child("Spindle").part(),
        axle_tube=tube.part(),
        pin=tube.vector("Pin Location"),
        axle_inertia=node.child("Axle").number("Inertia", "kg·m²"),
    )


def trailing_arm(node: Node) -> TrailingArm:
    """SemiTrailingArm: the arm turns about the line of its two pivots.

    Its inertia is given in axes of its own, x along the pivots and z normal to the plane with "Location Spindle"; ours
    in those of the vehicle. The spindle's own place is where the wheel turns.
    """
    arm = node.child("Trailing Arm")
    outer, inner = arm.vector("Location Chassis Outer"), arm.vector("Location Chassis Inner")
    axes = arm_axes(inner, outer, arm.vector("Location Spindle")) * (-1.0, -1.0, 1.0)
    axis = np.subtract(outer, inner)
    return node.make(
        TrailingArm,
        **common(node),
        arm=turned(arm, axes),
        pivot=middle(outer, inner),
        pivot_axis=tuple(float(v) for v in axis / np.linalg.norm(axis)),
        springs=(
            force_line(node.child("Spring"), "Location Arm"),
            force_line(node.child("Shock"), "Location Arm", damper=True),
        ),
    )


def turned(node: Node, axes: npt.NDArray[np.float64]) -> RigidPart:
    """A part whose inertia is given in the axes that are columns of a rotation matrix, in those of the vehicle."""
    part = node.part()
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = (axes @ inertia_matrix(part) @ axes.T).tolist()
    return node.make(RigidPart, mass=part.mass, com=part.com, inertia=(xx, yy, zz), products=(xy, xz, yz))


def middle(a: Vec3, b: Vec3) -> Vec3:
    """The point between two."""
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2


SUSPENSIONS: dict[str, Callable[[Node], Suspension]] = {
    "DoubleWishbone": double_wishbone,
    "DoubleWishboneReduced": double_wishbone_reduced,
    "SingleWishbone": single_wishbone,
    "MacPhersonStrut": macpherson_strut,
    "MultiLink": multi_link,
    "RigidSuspension": rigid_suspension,
    "RigidPinnedAxle": pinned_axle,
    "SemiTrailingArm": trailing_arm,
}


def antiroll_bar(node: Node, location: Vec3) -> AntirollBar:
    """AntirollBarRSD at a place of the vehicle."""
    arm, spring = node.child("Arm"), node.child("RSD")
    return node.make(
        AntirollBar,
        location=location,
        arm_mass=arm.number("Mass", "kg"),
        arm_inertia=arm.vector("Inertia", "kg·m²"),
        arm_length=arm.number("Length", "m"),
        arm_width=arm.number("Width", "m"),
        droplink_height=node.child("Droplink").number("Height", "m"),
        stiffness=spring.number("Spring Coefficient", "N·m/rad"),
        damping=spring.number("Damping Coefficient", "N·m·s/rad"),
    )
