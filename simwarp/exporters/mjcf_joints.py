"""Joints of MJCF with their laws, and the drives of their coordinates as actuators."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import ReadableFields
from simwarp.core.types import Dof, ModelError, PositionDrive
from simwarp.exporters.mjcf_tree import Node, PlacedMotion, row_of
from simwarp.model.model import Model
from simwarp.model.rules import INFINITE

Array = npt.NDArray[np.float64]

WIDE: Final = 1.0e6
"""Stands for a stop that is not there, where the other one is [m or rad]."""
LAWS: Final = {
    "joint_armature": "armature", "joint_stiffness": "stiffness", "joint_damping": "damping",
    "joint_friction": "frictionloss",
}  # fmt: skip
"""Parameters of a coordinate, and MJCF's attributes of a joint."""


@dataclasses.dataclass(frozen=True)
class FileJoint(ReadableFields):
    """A joint of the file.

    Attributes:
        name: in the file.
        kind: "free", "hinge", "slide" or "ball".
        body: of ours that it moves.
        dof: first column of `State.joint_q` that it has, -1 of a floating body whose coordinates have no names. Hinges
            and slides have the same coordinate; balls and floating bodies have quaternions in the file.
        driven: an actuator of the same name holds the target of its drive, `Control.joint_target_q`; "velocity": that
            of its rate, `joint_target_qd`; empty: none does.
        origin: of the body's frame in the file from its centre of mass, body axes [m].
    """

    name: str
    kind: str
    body: int
    dof: int
    driven: str = ""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)


def text_of(values: Any) -> str:
    """Numbers as an attribute: digits that bring back the same float64."""
    return " ".join(repr(float(value)) for value in np.asarray(values, np.float64).reshape(-1))


class JointWriter:
    """Writes the joints of one world.

    Args:
        model: of them.
        world: whose parameters are written.
        actuators: element that gets the actuators.
    """

    def __init__(self, model: Model, world: int, actuators: ElementTree.Element) -> None:
        self.model = model
        self.joints: list[FileJoint] = []
        self._actuators = actuators
        names = (
            *LAWS, "joint_rest", "joint_preload", "joint_limit_lower", "joint_limit_upper", "drive_stiffness",
            "drive_damping", "drive_effort_limit", "drive_effort_lower",
        )  # fmt: skip
        self._rows = {name: row_of(model, name, world).astype(np.float64) for name in names}

    def write(self, node: Node, element: ElementTree.Element) -> None:
        """Add the joints of a body to its element."""
        builder, origin = self.model.builder, tuple(node.origin.tolist())
        if node.floats:
            named = node.free_joint >= 0
            name = builder.joints[node.free_joint].name if named else f"{self.model.body_names[node.body]}:free"
            dof = builder.dof_start(node.free_joint) if named else -1
            if named and any(own != Dof() for own in builder.joints[node.free_joint].dofs):
                raise ModelError(
                    f"MJCF: joint '{name}': laws of a floating body are not written, got some; leave them out"
                )
            ElementTree.SubElement(element, "freejoint", name=name)
            self.joints.append(FileJoint(name, "free", node.body, dof, origin=origin))
        for motion in node.motions:
            self._write_motion(node, motion, element, origin)

    def _write_motion(
        self, node: Node, motion: PlacedMotion, element: ElementTree.Element, origin: tuple[float, float, float]
    ) -> None:
        spec = self.model.builder.joints[motion.joint]
        single = len(spec.dofs) == 1 or motion.kind == "ball"
        name = spec.name if single else f"{spec.name}:{motion.local}"
        dof = self.model.builder.dof_start(motion.joint) + motion.local
        frame = node.frame
        joint = ElementTree.SubElement(
            element, "joint", name=name, type=motion.kind, pos=text_of(frame.axes.T @ (motion.anchor - frame.x))
        )
        if motion.kind != "ball":
            joint.set("axis", text_of(frame.axes.T @ motion.axis))
        for key, value in self._laws(f"MJCF: joint '{name}'", motion, dof):
            joint.set(key, value)
        driven = self._write_drive(name, motion, dof)
        self.joints.append(FileJoint(name, motion.kind, node.body, dof, driven, origin))

    def _laws(self, thing: str, motion: PlacedMotion, dof: int) -> Iterator[tuple[str, str]]:
        """Attributes of stops, springs, dampers, dry friction and armature."""
        spec = self.model.builder.joints[motion.joint]
        count = 3 if motion.kind == "ball" else 1
        for own in spec.dofs[motion.local : motion.local + count]:
            if own.spring_table or own.damper_table or own.damper_map:
                raise ModelError(f"{thing}: laws must be linear, got a table; give stiffness and damping")
        columns = slice(dof, dof + count)
        if np.any(self._rows["joint_preload"][columns]):
            raise ModelError(f"{thing}: preload is not written, got one; move the rest of the spring instead")
        for parameter, attribute in LAWS.items():
            values = self._rows[parameter][columns]
            if np.ptp(values) > 0.0:
                raise ModelError(f"{thing}: a ball must have one {attribute} about all axes, got {values.tolist()}")
            if values[0] != 0.0:
                yield attribute, text_of(values[0])
        rest = self._rows["joint_rest"][columns]
        if np.any(rest) and np.any(self._rows["joint_stiffness"][columns]):
            if count > 1:
                raise ModelError(f"{thing}: the spring of a ball must rest at 0, got {rest.tolist()}; leave it out")
            yield "springref", text_of(rest[0])
        lower, upper = self._rows["joint_limit_lower"][columns], self._rows["joint_limit_upper"][columns]
        if np.any(lower > -INFINITE) or np.any(upper < INFINITE):
            if count > 1:
                raise ModelError(f"{thing}: stops of a ball are not written, got some; leave them out")
            yield "range", text_of([max(lower[0], -WIDE), min(upper[0], WIDE)])

    def _write_drive(self, name: str, motion: PlacedMotion, dof: int) -> str:
        """Add the actuator of a drive; returns what it holds."""
        spec = self.model.builder.joints[motion.joint]
        drives = [own.drive for own in spec.dofs[motion.local : motion.local + (3 if motion.kind == "ball" else 1)]]
        if all(drive is None for drive in drives):
            return ""
        if motion.kind == "ball" or not isinstance(drives[0], PositionDrive):
            kind = "a ball's" if motion.kind == "ball" else type(drives[0]).__name__
            raise ModelError(f"MJCF: joint '{name}': drives must be PositionDrive of a hinge or slide, got {kind}")
        stiffness, damping = self._rows["drive_stiffness"][dof], self._rows["drive_damping"][dof]
        holds = "position" if stiffness > 0.0 else "velocity"
        actuator = ElementTree.SubElement(self._actuators, holds, name=name, joint=name)
        if stiffness > 0.0:
            actuator.set("kp", text_of(stiffness))
        actuator.set("kv", text_of(damping))
        upper, lower = self._rows["drive_effort_limit"][dof], self._rows["drive_effort_lower"][dof]
        lower = -upper if lower > 0.0 else lower
        if upper < INFINITE or lower > -INFINITE:
            actuator.set("forcerange", text_of([lower if lower > -INFINITE else -1e9, min(upper, 1e9)]))
        return holds
