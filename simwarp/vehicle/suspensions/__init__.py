"""Suspension templates: from the description of an axle to bodies, joints and springs.

Each template builds its linkage and returns what carries the spindles; `add_axle` then adds the spindles with their
wheels and tires, the hinges with the brakes, and the turns that a driveline couples to.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from simwarp.core.rotation import quat_multiply, rotate
from simwarp.core.types import pose
from simwarp.meshes.mesh_specification import FlexibleMesh
from simwarp.vehicle.spec.beam_axle_parts import BeamAxle
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.tabulated_suspension import TabulatedSuspension
from simwarp.vehicle.spec.vehicle_spec import (
    Axle,
    DoubleWishbone,
    DoubleWishboneReduced,
    MacPhersonStrut,
    MultiLink,
    PinnedAxle,
    RigidSuspension,
    SingleWishbone,
    SolidAxle,
    Suspension,
    ThreeLink,
    TrailingArm,
)
from simwarp.vehicle.suspensions.antiroll_bar import add_antiroll_bar
from simwarp.vehicle.suspensions.corner import Array, AttachmentBodies, Frame
from simwarp.vehicle.suspensions.independent_suspensions import (
    double_wishbone,
    double_wishbone_reduced,
    macpherson_strut,
    multi_link,
    single_wishbone,
    three_link,
    trailing_arm,
)
from simwarp.vehicle.suspensions.rigid_axles import beam_axle, pinned_axle, solid_axle
from simwarp.vehicle.tires.flexible_tires import TEMPLATE as FLEXIBLE, TireShell
from simwarp.vehicle.tires.rigid_tires import TEMPLATE, add_rigid_tire

__all__ = ["Side", "add_antiroll_bar", "add_axle"]


@dataclasses.dataclass(frozen=True)
class Side:
    """Indices of one wheel's parts: bodies and joints of the builder."""

    name: str
    axle: int
    side: float
    carrier: int
    """Body that the spindle turns in."""
    spindle: int
    spin: int
    """Hinge of the spindle; its dry friction is the brake."""
    turn: int
    """Rotation of the wheel seen from the chassis: the driveline's axle shaft."""
    bar: int
    """Body that the link of an anti-roll bar holds."""
    shape: int = -1
    """Cylinder of a rigid tire, -1 of others."""
    mesh: FlexibleMesh | None = None
    """Of a flexible tire."""

    @property
    def meets_shapes(self) -> bool:
        """Whether its tire stands on shapes of the builder, in contact: rigid and flexible ones do."""
        return self.shape >= 0 or self.mesh is not None


def add_axle(frame: Frame, index: int, axle: Axle, chassis: int, tierod_body: int) -> tuple[Side, Side]:
    """Both sides of an axle, left and right.

    Args:
        frame: of the axle, not mirrored.
        index: of the axle, from the front.
        chassis: body, or WORLD for an axle on a bench.
        tierod_body: steering link, or the chassis.
    """
    left, right = (
        dataclasses.replace(frame, name=f"{frame.name}.{name}", side=side)
        for name, side in (("left", 1.0), ("right", -1.0))
    )
    if isinstance(axle.suspension, RigidSuspension):
        chassis = tierod_body  # what steers it turns it as a whole, as the joint of an articulated vehicle does
    match axle.suspension:
        case SolidAxle() as spec:
            holders = solid_axle(frame, left, right, spec, chassis, tierod_body)
        case BeamAxle() as spec:
            holders = beam_axle(frame, left, right, spec, chassis, tierod_body)
        case PinnedAxle() as spec:
            holders = pinned_axle(frame, spec, chassis)
        case spec:
            holders = (_side(left, spec, chassis, tierod_body), _side(right, spec, chassis, tierod_body))
    return (
        _add_spindle(left, index, axle, chassis, holders[0]),
        _add_spindle(right, index, axle, chassis, holders[1]),
    )


LINKAGES: Final[dict[type, Callable[[Frame, Any, int, int], AttachmentBodies]]] = {
    DoubleWishbone: double_wishbone, DoubleWishboneReduced: double_wishbone_reduced, SingleWishbone: single_wishbone,
    MacPhersonStrut: macpherson_strut, MultiLink: multi_link, TrailingArm: trailing_arm,
    ThreeLink: three_link,
}  # fmt: skip
"""What builds one side of a suspension: frame, description, chassis, body of the tie rod."""


def _side(frame: Frame, suspension: Suspension, chassis: int, tierod_body: int) -> AttachmentBodies:
    """The linkage of one side of an axle whose sides move on their own."""
    if isinstance(suspension, RigidSuspension):
        return AttachmentBodies(chassis, chassis)
    return LINKAGES[type(suspension)](frame, suspension, chassis, tierod_body)


def _add_spindle(frame: Frame, index: int, axle: Axle, chassis: int, holder: AttachmentBodies) -> Side:
    builder = frame.builder
    assert not isinstance(axle.suspension, TabulatedSuspension)  # its wheels are no bodies of the dynamics
    rotation, axis = _wheel_axis(frame, axle.suspension)
    part = axle.suspension.spindle
    inertia = np.diag(part.inertia) + np.diag(axle.wheel.inertia) + np.diag(axle.tire.inertia)
    inertia[1, 1] += axle.suspension.axle_inertia
    center = (part.com[0], part.com[1] + axle.wheel.offset, part.com[2])
    mass = part.mass + axle.wheel.mass + axle.tire.mass
    shell = None
    if axle.tire.template == FLEXIBLE:
        try:
            shell = TireShell(axle.tire)
        except SpecError as error:
            raise SpecError(f"axles[{index}].tire.{error}") from None
        inertia += np.diag(shell.held_inertia()) - np.diag(axle.tire.inertia)
        mass += shell.held_mass - axle.tire.mass
    spindle = builder.add_body(
        f"{frame.name}.spindle", mass=mass, inertia=inertia, pose=pose(frame.at(center), rotation), strict=False
    )
    brake = 0.0 if axle.brake is None else axle.brake.max_torque
    spin = builder.add_joint_revolute(f"{frame.name}.spin", holder.carrier, spindle, axis=axis, friction=brake)
    turn = builder.add_joint_relative_rotation(f"{frame.name}.axle", chassis, spindle, axis=axis)
    shape = -1
    if axle.tire.template == TEMPLATE:
        shape = add_rigid_tire(builder, f"{frame.name}.tire", spindle, axle.tire, f"axles[{index}].tire")
    mesh = None
    if shell is not None:
        mesh = shell.add(builder, f"{frame.name}.tire", spindle, pose(frame.at(center), rotation))
    return Side(frame.name, index, frame.side, holder.carrier, spindle, spin, turn, holder.bar, shape, mesh)


def _wheel_axis(frame: Frame, suspension: Suspension) -> tuple[Array, Array]:
    """Orientation (xyzw) of the spindle and its axis of rotation in the world, with toe and camber as built.

    Positive toe turns the front of the left wheel inwards; positive camber leans its top outwards.
    """
    toe = -frame.side * getattr(suspension, "toe", 0.0)
    camber = -frame.side * getattr(suspension, "camber", 0.0)
    about_z = np.array([0.0, 0.0, np.sin(toe / 2.0), np.cos(toe / 2.0)])
    about_x = np.array([np.sin(camber / 2.0), 0.0, 0.0, np.cos(camber / 2.0)])
    rotation = quat_multiply(frame.origin.rotation, quat_multiply(about_z, about_x))
    return rotation, rotate(rotation, np.array([0.0, 1.0, 0.0]))
