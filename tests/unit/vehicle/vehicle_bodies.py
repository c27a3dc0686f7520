"""Bodies of a described vehicle at their places as built, in float64: for tests of masses and inertias."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from simwarp.vehicle.spec.vehicle_spec import RigidPart, SteeringMount, VehicleSpec


class Body(NamedTuple):
    """Mass, centre of mass in the vehicle's frame, inertia about it in axes of the vehicle."""

    name: str
    mass: float
    com: np.ndarray
    inertia: np.ndarray


def matrix(part: RigidPart) -> np.ndarray:
    (xx, yy, zz), (xy, xz, yz) = part.inertia, part.products
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def rotation(q: tuple[float, float, float, float]) -> np.ndarray:
    x, y, z, w = q
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross


def arm_axes(suspension: Any, name: str) -> np.ndarray:
    """Columns: axes of an arm, x from its back to its front pivot, z normal to its plane; single arms lie along y."""
    if hasattr(suspension, f"{name}_front"):
        front, back, tip = (np.array(getattr(suspension, f"{name}_{end}")) for end in ("front", "back", "upright"))
        z = np.cross(back - tip, front - tip)
        x = front - back
        x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
        return np.column_stack([x, np.cross(z, x), z])
    y = np.subtract(suspension.arm_upright, suspension.arm_chassis)
    y = y / np.linalg.norm(y)
    x = np.cross(y, [0.0, 0.0, 1.0])
    x = x / np.linalg.norm(x)
    return np.column_stack([x, y, np.cross(x, y)])


def side_bodies(spec: VehicleSpec, index: int) -> list[Body]:
    """Of the left side of an axle."""
    axle = spec.axles[index]
    suspension: Any = axle.suspension
    found = []
    for field in dataclasses.fields(suspension):
        part = getattr(suspension, field.name)
        if not isinstance(part, RigidPart):
            continue
        mass, inertia = part.mass, matrix(part)
        if field.name == "spindle":
            mass += axle.wheel.mass + axle.tire.mass
            inertia = inertia + np.diag(axle.wheel.inertia) + np.diag(axle.tire.inertia)
        elif field.name.endswith("arm") and suspension.inertia_axes == "arm":
            axes = arm_axes(suspension, field.name)
            inertia = axes @ inertia @ axes.T
        found.append(Body(f"{index}.{field.name}", mass, np.add(axle.location, part.com), inertia))
    return found


def mirrored(body: Body) -> Body:
    flip = np.diag([1.0, -1.0, 1.0])
    return Body(body.name + ".right", body.mass, flip @ body.com, flip @ body.inertia @ flip)


def steering_bodies(mount: SteeringMount) -> list[Body]:
    turn = rotation(mount.rotation)
    parts = [(f.name, getattr(mount.steering, f.name)) for f in dataclasses.fields(mount.steering)]
    return [
        Body(f"steering.{name}", part.mass, np.array(mount.location) + turn @ part.com, turn @ matrix(part) @ turn.T)
        for name, part in parts
        if isinstance(part, RigidPart)
    ]


def bodies(spec: VehicleSpec) -> list[Body]:
    """All of a vehicle."""
    found = [Body("chassis", part.mass, np.array(part.com), matrix(part)) for part in spec.chassis.components]
    for mount in spec.steerings:
        found += steering_bodies(mount)
    for index in range(len(spec.axles)):
        left = side_bodies(spec, index)
        found += left + [mirrored(body) for body in left]
    return found


def total(parts: list[Body]) -> Body:
    """The sum of bodies, its inertia about the common centre of mass."""
    mass = sum(body.mass for body in parts)
    com = np.sum([body.mass * body.com for body in parts], axis=0) / mass
    inertia = np.zeros((3, 3))
    for body in parts:
        arm = body.com - com
        inertia += body.inertia + body.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Body("total", mass, com, inertia)
