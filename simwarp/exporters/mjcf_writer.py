"""A model of a tree as MJCF, the format of MuJoCo: the same bodies, joints, shapes and drives, in MuJoCo's equations.

Bodies, masses, inertias, joints, stops, springs, dampers, dry friction and armatures are MuJoCo's own, and so are
position drives (actuators `position` with kp, kv and forcerange). Contacts are explicit pairs with the friction of
each; they are soft in MuJoCo, rigid here. Names are those of the model.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Final
from xml.etree import ElementTree

import numpy as np

from simwarp.actuators import Activation, Actuators, ActuatorSpec, Law
from simwarp.core.constraints import Meaning, Positive
from simwarp.core.files import check_output, write_file
from simwarp.core.object_repr import ReadableFields
from simwarp.core.rotation import quat_from_matrix
from simwarp.core.types import WORLD, ModelError, formatted
from simwarp.exporters.mjcf_geoms import ShapeWriter
from simwarp.exporters.mjcf_joints import WIDE, FileJoint, JointWriter, text_of
from simwarp.exporters.mjcf_tree import Node, nodes_of, row_of
from simwarp.model.checks import whole_number
from simwarp.model.flexible_meshes import refuse_meshes
from simwarp.model.model import Model
from simwarp.model.rules import INFINITE, RULES, Name, instance_of

DYNAMICS: Final = {
    Activation.INTEGRATOR: "integrator", Activation.FILTER: "filter", Activation.FILTER_EXACT: "filterexact",
}  # fmt: skip


def write_motors(
    motors: Actuators, world: int, joints: Sequence[FileJoint], root: ElementTree.Element, notes: list[str]
) -> None:
    """Add actuators and the tendons that they need.

    Args:
        motors: the actuators; a servo is its joint's drive, which is there already.
        world: whose numbers are written.
        joints: of the file.
        root: of the file.
        notes: get a line for each property that is left out.

    Raises:
        ModelError: an actuator pulls on a frame, or on a coordinate that the file has not.
    """
    names = {joint.dof: joint.name for joint in joints if joint.kind in ("hinge", "slide")}
    actuators = root.find("actuator")
    assert actuators is not None
    for spec in (_of_world(motors, index, world) for index in range(len(motors))):
        thing = f"MJCF: actuator '{spec.name}'"
        if spec.site is not None:
            raise ModelError(f"{thing}: pulls on frames are not written, got one; leave it out")
        missing = [column for column, _ in spec.terms if column not in names]
        if missing:
            raise ModelError(f"{thing}: it must pull on hinges and slides, got column {missing[0]}; leave it out")
        if spec.delay > 0.0:
            notes.append(f"delay of actuator '{spec.name}'")
        if spec.law is Law.SERVO:
            continue
        if spec.torque_speed is not None:
            notes.append(f"torque-speed curve of actuator '{spec.name}'")
        element = ElementTree.SubElement(actuators, "general", name=spec.name)
        if len(spec.terms) == 1:
            column, coefficient = spec.terms[0]
            element.set("joint", names[column])
            element.set("gear", text_of(coefficient))
        else:
            element.set("tendon", spec.name)
            _write_tendon(spec, names, root)
        _write_law(spec, element)


def _of_world(motors: Actuators, index: int, world: int) -> ActuatorSpec:
    """An actuator with the numbers of a world."""

    def row(name: str) -> list[float]:
        values = getattr(motors, name).numpy()
        return [float(value) for value in np.ravel(values[world if values.shape[0] > 1 else 0][index])]

    gain, bias, (lower, upper) = row("gain"), row("bias"), row("force_range")
    bounded = lower > -INFINITE or upper < INFINITE
    return dataclasses.replace(
        motors.specs[index], gain=(gain[0], gain[1], gain[2]), bias=(bias[0], bias[1], bias[2]),
        time_constant=row("time_constant")[0],
        force_range=(max(lower, -WIDE), min(upper, WIDE)) if bounded else None,
    )  # fmt: skip


def _write_tendon(spec: ActuatorSpec, names: dict[int, str], root: ElementTree.Element) -> None:
    tendons = root.find("tendon")
    tendons = ElementTree.SubElement(root, "tendon") if tendons is None else tendons
    fixed = ElementTree.SubElement(tendons, "fixed", name=spec.name)
    for column, coefficient in spec.terms:
        ElementTree.SubElement(fixed, "joint", joint=names[column], coef=text_of(coefficient))


def _write_law(spec: ActuatorSpec, element: ElementTree.Element) -> None:
    """Gain and bias along a length that is 0 there where ours is `length_offset`, ranges and filter."""
    for word, (constant, slope, rate) in (("gain", spec.gain), ("bias", spec.bias)):
        element.set(f"{word}type", "affine")
        element.set(f"{word}prm", text_of([constant + slope * spec.length_offset, slope, rate]))
    for attribute, bounds in (
        ("ctrlrange", spec.ctrl_range), ("forcerange", spec.force_range), ("actrange", spec.activation_range),
    ):  # fmt: skip
        if bounds is not None:
            element.set(attribute, text_of(bounds))
    if spec.has_activation:
        element.set("dyntype", DYNAMICS[spec.activation])
        if spec.activation is not Activation.INTEGRATOR:
            element.set("dynprm", text_of(spec.time_constant))
        element.set("actearly", "true" if spec.early else "false")


FRICTION_IMPEDANCE: Final = 100.0
"""`impratio`: feet hardly creep under friction. Published models of legged robots have it."""
SOFTNESS: Final = 0.02
"""Time constant of contacts and stops, MuJoCo's own [s]."""


@dataclasses.dataclass(frozen=True)
class Mjcf(ReadableFields):
    """A model as MJCF.

    Attributes:
        text: of the file.
        joints: of the file, in its order.
        notes: what the model has and the file has not, a line each.
    """

    text: str
    joints: tuple[FileJoint, ...]
    notes: tuple[str, ...]


@RULES.arguments("mjcf_of")
def mjcf_of(
    model: Annotated[Model, instance_of(Model, "pass what finalize returned")], *, actuators: Actuators | None = None,
    world: int = 0, timestep: Annotated[Positive, Meaning("seconds, 0.002 is usual")] = 0.002,
    softness: Annotated[Positive, Meaning("seconds, 0.02 is MuJoCo's own")] = SOFTNESS, name: Name = "simwarp",
) -> Mjcf:  # fmt: skip
    """A model as MJCF.

    Args:
        model: a tree of bodies: no loops, couplings, shafts or springs between bodies.
        actuators: of the model, written as MuJoCo's own; their delays and torque-speed curves are left out.
        world: whose parameters are written.
        timestep: of MuJoCo [s].
        softness: time constant of contacts, stops and dry friction, MuJoCo's `solref` [s]; it makes at least two of its
            steps of it.
        name: of the model.

    Raises:
        ModelError: the model has a part that MJCF has not, or the writer; says which.
    """
    if actuators is not None and (not isinstance(actuators, Actuators) or actuators.model is not model):
        raise ModelError(
            f"mjcf_of: actuators must be Actuators of the same model, got {formatted(actuators)}; make them"
        )
    refuse_meshes("mjcf_of", model.builder)
    world = whole_number("mjcf_of", "world", world, 0, model.world_count - 1, "count from 0")
    soft = text_of([softness, 1.0])
    root = ElementTree.Element("mujoco", model=name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    ElementTree.SubElement(
        root, "option", timestep=text_of(timestep), gravity=text_of(row_of(model, "gravity", world)),
        integrator="implicitfast", cone="elliptic", impratio=text_of(FRICTION_IMPEDANCE),
    )  # fmt: skip
    defaults = ElementTree.SubElement(root, "default")
    ElementTree.SubElement(defaults, "joint", solreflimit=soft, solreffriction=soft)
    ElementTree.SubElement(defaults, "pair", solref=soft)
    assets, bodies, pairs, driving = (
        ElementTree.SubElement(root, part) for part in ("asset", "worldbody", "contact", "actuator")
    )
    notes: list[str] = []
    joints, shapes = JointWriter(model, world, driving), ShapeWriter(model, world, assets, notes)
    shapes.write(None, bodies)
    masses, inertias = row_of(model, "body_mass", world), row_of(model, "body_inertia_b", world)
    elements = {WORLD: bodies}
    nodes = nodes_of(model, world)
    frames = {node.body: node.frame for node in nodes}
    for node in nodes:
        frame = node.frame
        if node.parent != WORLD:
            frame = frames[node.parent].inverse().of(frame)
        x, y, z, w = quat_from_matrix(frame.axes)
        element = ElementTree.SubElement(
            elements[node.parent], "body", name=model.body_names[node.body], pos=text_of(frame.x),
            quat=text_of([w, x, y, z]),
        )  # fmt: skip
        elements[node.body] = element
        joints.write(node, element)
        _write_inertia(node, float(masses[node.body]), np.array(inertias[node.body], np.float64), element)
        shapes.write(node, element)
    shapes.write_pairs(pairs)
    if actuators is not None:
        write_motors(actuators, world, joints.joints, root, notes)
    ElementTree.indent(root)
    return Mjcf(ElementTree.tostring(root, encoding="unicode") + "\n", tuple(joints.joints), tuple(notes))


def save_mjcf(
    model: Model, path: str | os.PathLike[str], *, actuators: Actuators | None = None, world: int = 0,
    timestep: float = 0.002, softness: float = SOFTNESS,
) -> Mjcf:  # fmt: skip
    """Write a model as a file of MuJoCo; returns what is in it.

    Args:
        model: see `mjcf_of`.
        path: of the file.
        actuators: of the model, see `mjcf_of`.
        world: whose parameters are written.
        timestep: of MuJoCo [s].
        softness: time constant of contacts, stops and dry friction there [s].

    Raises:
        ModelError: as `mjcf_of`.
        FileError: the path cannot be written to.
        OutputError: the disk did not take it.
    """
    target = check_output(Path(path), "save_mjcf")
    made = mjcf_of(model, actuators=actuators, world=world, timestep=timestep, softness=softness)
    write_file(target, made.text)
    return made


def _write_inertia(node: Node, mass: float, inertia: np.ndarray, element: ElementTree.Element) -> None:
    symmetric = 0.5 * (inertia + inertia.T)
    entries = [symmetric[pair] for pair in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    ElementTree.SubElement(
        element, "inertial", pos=text_of(-node.origin), mass=text_of(mass), fullinertia=text_of(entries)
    )
