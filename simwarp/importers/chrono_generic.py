"""Chrono's GenericWheeledSuspension, which lists bodies and joints, where these make a double wishbone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from simwarp.core.rotation import matrix_of
from simwarp.importers.chrono_json import Node, of_matrix
from simwarp.importers.chrono_suspensions import force_line
from simwarp.vehicle.spec.vehicle_spec import DoubleWishbone, ForceLine, RigidPart, Suspension, Vec3

HALF_HINGE: Final = 0.1
"""Between a hinge's middle and the pivots that stand for its axis [m]: their distance matters to nothing."""
BODIES: Final = ("Chassis", "Subchassis", "Steering")
"""Names that a file does not list."""


def double_wishbone(node: Node) -> DoubleWishbone:
    """An upright on balls of two arms with hinges on the chassis, a rod to it, and springs to the lower arm."""
    node.skip("Independent", "Steerable", "Vehicle-Frame Inertia", "Antiroll Body")
    spindle = node.child("Spindle")
    upright = spindle.text("Attachment Body")
    bodies = {each.text("Name"): each for each in node.each("Bodies")}
    arms = _arms(node, upright)
    if upright not in bodies or set(bodies) != {upright, *arms} or len(arms) != 2:
        raise _unlike(node, "Bodies", f"{', '.join(bodies)} with arms {', '.join(arms) or 'none'}")
    lower, upper = sorted(arms, key=lambda name: arms[name]["upright"][2])
    rods = list(node.each("Distance Constraints"))
    if len(rods) != 1 or rods[0].text("Body2") != upright or rods[0].text("Body1") not in BODIES:
        raise _unlike(
            node, "Distance Constraints", f"{len(rods)} rods, one from chassis or steering to {upright} wanted"
        )
    (rod,) = rods
    rod.skip("Name", "Mirrored")
    points = {f"{role}_{end}": arms[name][end] for role, name in (("upper_arm", upper), ("lower_arm", lower))
              for end in ("front", "back", "upright")}  # fmt: skip
    return node.make(
        DoubleWishbone,
        **points,
        inertia_axes="vehicle",
        camber=node.angle("Camber Angle (deg)"),
        toe=node.angle("Toe Angle (deg)"),
        spindle=spindle.part(),
        axle_inertia=node.child("Axle").number("Inertia", "kg·m²"),
        upright=_body(bodies[upright]),
        upper_arm=_body(bodies[upper]),
        lower_arm=_body(bodies[lower]),
        tierod_chassis=rod.vector("Point1"),
        tierod_upright=rod.vector("Point2"),
        springs=_lines(node, lower),
    )


def _unlike(node: Node, key: str, found: str) -> Exception:
    rule = "must make a double wishbone: an upright on balls of two arms, which are hinged on the chassis"
    return node.place.at(key).error(f"{rule}, got {found}; describe the suspension by another template")


def _arms(node: Node, upright: str) -> dict[str, dict[str, Vec3]]:
    """Pivots and ball of every arm."""
    found: dict[str, dict[str, Vec3]] = {}
    for joint in node.each("Joints"):
        joint.skip("Name", "Mirrored")
        kind, first, second = joint.text("Type"), joint.text("Body1"), joint.text("Body2")
        place = np.array(joint.vector("Position"))
        axis = matrix_of(np.array(joint.quaternion("Rotation")))[:, 2]
        if kind == "Revolute" and first == "Chassis" and second != upright:
            ahead = axis if axis[0] >= 0.0 else -axis
            front, back = place + HALF_HINGE * ahead, place - HALF_HINGE * ahead
            found.setdefault(second, {}).update(front=_vec3(front), back=_vec3(back))
        elif kind == "Spherical" and second == upright:
            found.setdefault(first, {})["upright"] = _vec3(place)
        else:
            raise _unlike(node, "Joints", f"a joint of type {kind} between {first} and {second}")
    if any(len(ends) < 3 for ends in found.values()):
        raise _unlike(node, "Joints", "an arm without a hinge or without a ball")
    return found


def _vec3(values: Any) -> Vec3:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _body(node: Node) -> RigidPart:
    """Its inertia turned from its own axes into those of the vehicle."""
    node.skip("Name", "Mirrored")
    turn = matrix_of(np.array(node.quaternion("Rotation")))
    xy, xz, yz = node.vector("Products of Inertia", "kg·m²")
    own = np.diag(node.vector("Moments of Inertia", "kg·m²")) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
    return of_matrix(node, node.number("Mass", "kg"), np.array(node.vector("Position")), turn @ own @ turn.T)


def _lines(node: Node, arm: str) -> tuple[ForceLine, ...]:
    found = []
    for line in node.each("TSDAs"):
        line.skip("Name", "Mirrored")
        ends = line.text("Body1"), line.text("Body2")
        if ends != ("Chassis", arm):
            raise _unlike(node, "TSDAs", f"a spring between {ends[0]} and {ends[1]}, not Chassis and {arm}")
        found.append(force_line(line, "Point2", chassis="Point1"))
    return tuple(found)


GENERIC: Final[dict[str, Callable[[Node], Suspension]]] = {"GenericWheeledSuspension": double_wishbone}
