"""Actuators of a simulation as actuators `general` of MJCF: the same affine laws, ranges and filters."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final
from xml.etree import ElementTree

import numpy as np

from simwarp.actuators import Activation, Actuators, ActuatorSpec, Law
from simwarp.core.types import ModelError
from simwarp.exporters.mjcf_joints import WIDE, FileJoint, text_of
from simwarp.model.rules import INFINITE

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
