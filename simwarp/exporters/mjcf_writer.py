"""A model of a tree as MJCF, the format of MuJoCo: the same bodies, joints, shapes and drives, in MuJoCo's equations.

Bodies, masses, inertias, joints, stops, springs, dampers, dry friction and armatures are MuJoCo's own, and so are
position drives (actuators `position` with kp, kv and forcerange). Contacts are explicit pairs with the friction of
each; they are soft in MuJoCo, rigid here. Names are those of the model.
"""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Annotated, Final
from xml.etree import ElementTree

import numpy as np

from simwarp.actuators import Actuators
from simwarp.core.constraints import Meaning, Positive
from simwarp.core.files import check_output, write_file
from simwarp.core.readable import ReadableFields
from simwarp.core.rotation import quat_from_matrix
from simwarp.core.types import WORLD, ModelError, formatted
from simwarp.exporters.mjcf_geoms import ShapeWriter
from simwarp.exporters.mjcf_joints import FileJoint, JointWriter, text_of
from simwarp.exporters.mjcf_motors import write_motors
from simwarp.exporters.mjcf_tree import Node, nodes_of, row_of
from simwarp.model.checks import whole_number
from simwarp.model.model import Model
from simwarp.model.rules import RULES, Name, instance_of

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
