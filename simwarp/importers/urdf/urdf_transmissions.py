"""Transmissions of a URDF file: actuators that act on one joint through a gear."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from simwarp.actuators import ActuatorSpec
from simwarp.core.wording import nearest
from simwarp.importers.links.link_tree import Assembled
from simwarp.importers.report import ImportReport
from simwarp.importers.urdf.urdf_joints import JointValues


def read_transmissions(
    elements: Sequence[Any], values: Sequence[JointValues], assembled: Assembled, prefix: str,
    report: ImportReport,
) -> tuple[ActuatorSpec, ...]:  # fmt: skip
    """An actuator for each transmission: effort on the joint = reduction x effort of the actuator, whose range is the
    joint's effort limit over the reduction. Those that are not usable are refused.
    """
    of = {value.joint.name: value for value in values}
    made: list[ActuatorSpec] = []
    for element in elements:
        name = element.get("name") or "transmission"
        joints, actuators = element.findall("joint"), element.findall("actuator")
        kind = (element.findtext("type") or element.get("type") or "SimpleTransmission").rpartition("/")[2].strip()
        if len(joints) != 1 or len(actuators) > 1 or kind != "SimpleTransmission":
            told = f"type {kind} of {len(joints)} joints and {len(actuators)} actuators: only simple ones of one joint"
            report.refuse("transmission", name, told)
            continue
        joint = joints[0].get("name", "")
        if joint not in of:
            report.refuse("transmission", name, f"it must name a joint, got '{joint}'{nearest(joint, of)}")
            continue
        if prefix + joint not in assembled.dofs:
            report.refuse("transmission", name, f"joint '{joint}' has no coordinate to act on")
            continue
        reduction = _reduction([*joints, *actuators])
        if reduction is None:
            report.refuse("transmission", name, "its mechanicalReduction must be a number other than 0; write 1")
            continue
        label = (actuators[0].get("name") if actuators else None) or name
        while any(other.name == prefix + label for other in made):
            label += "_"
        effort = of[joint].effort
        reach = None if effort is None else effort / abs(reduction)
        made.append(
            ActuatorSpec(
                name=prefix + label, terms=((assembled.dofs[prefix + joint], reduction),),
                force_range=None if reach is None else (-reach, reach),
            )
        )  # fmt: skip
        _report_interface(element, name, report)
    return tuple(made)


def _reduction(places: Sequence[Any]) -> float | None:
    """The last one that is written; None where it is not usable."""
    texts = [found.strip() for place in places if (found := place.findtext("mechanicalReduction")) is not None]
    if not texts:
        return 1.0
    try:
        value = float(texts[-1])
    except ValueError:
        return None
    return value if math.isfinite(value) and value != 0.0 else None


def _report_interface(element: Any, name: str, report: ImportReport) -> None:
    """An actuator that is asked for a position or a speed in ROS is asked for an effort here."""
    found = {(tag.text or "").strip().rpartition("/")[2] for tag in element.iter("hardwareInterface")}
    others = sorted(found - {"EffortJointInterface", ""})
    if others:
        report.approximate("transmission", name, f"its control is an effort, in place of {', '.join(others)}")
    else:
        report.hold("transmission", name)
