"""Chrono's rear chassis, connectors and balancers, of vehicles whose frame is in parts.

A rear chassis on a steered joint is the arm of a steering here, whose axles are rigid ones that it turns. One on a
torsion bar becomes part of the chassis, and so do the beams of a balancer: what twists and walks there is held here.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from simwarp.core.types import formatted
from simwarp.importers.chrono_json import Node, of_matrix
from simwarp.vehicle.spec.parts import merged
from simwarp.vehicle.spec.vehicle_spec import RigidPart, RotaryArm, SteeringMount, Vec3

MAIN: Final = -1
"""Index of the chassis itself."""


@dataclasses.dataclass(frozen=True)
class Frames:
    """Where the chassis of a vehicle are, and what they add to it.

    Attributes:
        offsets: of the frame of reference of each rear chassis in that of the vehicle [m].
        steerings: index of the steering that turns each rear chassis; None of one that is part of the chassis.
        mounts: these steerings.
        held: parts that belong to the chassis, in the vehicle's frame.
    """

    offsets: tuple[Vec3, ...] = ()
    steerings: tuple[int | None, ...] = ()
    mounts: tuple[SteeringMount, ...] = ()
    held: tuple[RigidPart, ...] = ()

    def of_part(self, part: Node) -> tuple[Vec3, int | None]:
        """Offset of the chassis that a part hangs on, and the steering that turns it."""
        index = part.whole("Chassis Index") if "Chassis Index" in part else MAIN
        if index == MAIN:
            return (0.0, 0.0, 0.0), None
        if not 0 <= index < len(self.offsets):
            count = len(self.offsets)
            rule = f"-1, the chassis, or a rear chassis, of which the vehicle has {count}"
            raise part.place.at("Chassis Index").error(f"must be {rule}, got {index}")
        return self.offsets[index], self.steerings[index]


def read_frames(
    node: Node, chassis: Node, files: Any, mounts: int, components: Callable[[Node], list[RigidPart]]
) -> Frames:
    """All rear chassis and balancers of a vehicle.

    Args:
        node: the vehicle's object.
        chassis: that of its chassis.
        files: its subsystems' (`node`, `part`).
        mounts: how many steerings it has itself.
        components: reads those of a chassis.
    """
    found = Frames()
    rear = list(node.each("Rear Chassis")) if "Rear Chassis" in node else []
    before: dict[int, tuple[Node, Vec3]] = {MAIN: (chassis, (0.0, 0.0, 0.0))}
    for index, entry in enumerate(rear):
        file = files.node(entry.text("Input File"))
        file.choice("Type", ("ChassisRear",))
        file.choice("Template", ("RigidChassisRear",))
        on = entry.whole("Chassis Index") if "Chassis Index" in entry else MAIN
        if on not in before or (on != MAIN and found.steerings[on] is not None):
            rule = "-1, the chassis, or a rear chassis above it that is no steered one"
            raise entry.place.at("Chassis Index").error(f"must be {rule}, got {on}")
        ahead, offset = before[on]
        joint = np.add(offset, ahead.vector("Rear Connector Location"))
        here = vec3(joint - file.vector("Front Connector Location"))
        parts = [moved(part, here) for part in components(file)]
        turned = connector(files.node(entry.text("Connector Input File")), entry)
        file.finish()
        steering: int | None = None
        mount: tuple[SteeringMount, ...] = ()
        if turned is None:
            found = dataclasses.replace(found, held=(*found.held, *parts))
        else:
            steering = mounts + len(found.mounts)
            mount = (arm_of(file, parts, vec3(joint), turned),)
        before[index] = file, here
        found = dataclasses.replace(
            found, offsets=(*found.offsets, here), steerings=(*found.steerings, steering),
            mounts=(*found.mounts, *mount),
        )  # fmt: skip
    return dataclasses.replace(found, held=(*found.held, *balancers(node, files, found)))


def connector(node: Node, entry: Node) -> float | None:
    """Largest angle of a steered connector [rad]; None of one that holds."""
    node.choice("Type", ("ChassisConnector",))
    templates: Mapping[str, str] = {
        "ChassisConnectorArticulated": "Maximum Steering Angle (deg)",
        "ChassisConnectorTorsion": "Torsional Stiffness",
    }
    template = node.text("Template")
    if template not in templates:
        raise entry.place.at("Connector Input File").error(
            f"must be that of a {' or a '.join(templates)}, got {formatted(template)}: a trailer is no rear chassis; "
            "describe it among the `trailers` of a vehicle"
        )
    value = node.number(templates[template])
    node.finish()
    if template == "ChassisConnectorArticulated":
        return math.radians(value)
    warnings.warn(f"{node.place.file}: Torsional Stiffness: left out; the rear chassis does not twist", stacklevel=4)
    return None


def arm_of(node: Node, parts: Sequence[RigidPart], joint: Vec3, largest: float) -> SteeringMount:
    """A rear chassis as what a steering turns about the vertical through its joint."""
    mass, com, inertia = merged(tuple(parts))
    part = of_matrix(node, mass, np.subtract(com, joint), inertia)
    arm = node.make(RotaryArm, max_angle=largest, arm=part, arm_chassis=(0.0, 0.0, 0.0))
    return node.make(SteeringMount, steering=arm, location=joint)


def balancers(node: Node, files: Any, frames: Frames) -> list[RigidPart]:
    """Beams of the balancers, which are held: their masses are the chassis's, and springs hang on it."""
    found: list[RigidPart] = []
    for entry in node.each("Subchassis") if "Subchassis" in node else ():
        file = files.node(entry.text("Input File"))
        file.choice("Type", ("Subchassis",))
        file.choice("Template", ("Balancer",))
        offset, steering = frames.of_part(entry)
        if steering is not None:
            raise entry.place.at("Chassis Index").error("must be a chassis that no steering turns")
        beam = file.child("Beam")
        beam.skip("Size", "Pin Location", "Pin Direction")
        file.skip("Maximum Pitch")
        place = vec3(np.add(offset, entry.vector("Subchassis Location")))
        left = beam.part()
        right = dataclasses.replace(left, com=(left.com[0], -left.com[1], left.com[2]))
        found += [moved(part, place) for part in (left, right)]
        file.finish()
        warnings.warn(f"{file.place.file}: Beam: does not walk here; axles spring on the chassis", stacklevel=4)
    return found


def moved(part: RigidPart, by: Vec3) -> RigidPart:
    """A part at another place."""
    return dataclasses.replace(part, com=vec3(np.add(part.com, by)))


def vec3(values: Any) -> Vec3:
    """Three numbers."""
    x, y, z = (float(value) for value in values)
    return x, y, z
