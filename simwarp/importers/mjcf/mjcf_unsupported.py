"""What of MJCF is refused, and options of the whole model that have other equations here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from simwarp.importers.mjcf.mjcf_files import Tag
from simwarp.importers.mjcf.mjcf_source import DEFAULT_SOLIMP, DEFAULT_SOLREF, Source
from simwarp.importers.report import ImportReport

NEW_FIELD: Final = "there is no such law; set it to 0"

REFUSABLE: Final[dict[str, str]] = {
    "mocap": "bodies are not moved by hand; drive a joint with a prescribed position",
    "free joint law": "floating bodies carry no dry friction",
    "ball range": "limits are per coordinate, not a cone",
    "dampingpoly": NEW_FIELD,
    "stiffnesspoly": NEW_FIELD,
    "springyield": NEW_FIELD,
    "delay": NEW_FIELD,
    "surfacevel": NEW_FIELD,
    "adhesion": "nothing sticks to a surface",
    "gravcomp": "no body is held against gravity",
    "density": "there is no fluid",
    "viscosity": "there is no fluid",
    "wind": "there is no fluid",
    "muscle": "there are no muscles",
    "cylinder": "there are no pneumatic cylinders",
    "damper": "there is no such actuator; give the joint damping",
    "plugin": "plugins are code of MuJoCo",
    "slidercrank": "there is no such transmission",
    "actuator user": "its law is code of the user",
    "actuator dcmotor": "its electrical state has no counterpart; see ActuatorSpec.torque_speed",
    "actuator pid": "there is no integral control; write it into the task",
    "actuator so3": "there is no control of rotations",
    "actuator armature": "give armature and damping to the joint",
    "actuator on ball or free joint": "the wrench on a free joint must have one frame and no length: split it in two",
    "transmission so3": "there is no control of rotations",
    "transmission undefined": "it pulls on nothing",
    "tendon actuatorfrcrange": "forces are bounded by actuator, not by tendon",
    "spatial tendon": "only tendons straight between two sites have a counterpart",
    "equality polycoef": "couplings are linear",
    "equality flex": "there are no flexible bodies",
    "equality flexvert": "there are no flexible bodies",
    "equality flexstrain": "there are no flexible bodies",
    "equality distance": "use a spatial tendon with a range",
    "geom sdf": "there are no distance fields",
    "flex": "there are no flexible bodies",
    "composite": "there are no flexible bodies; write the parts out",
    "skin": "there are no skins",
}
"""Kinds that `allow` takes, and why each is refused."""

_BY_TAG: Final = ("composite", "plugin")
"""Kinds that are tags of the source; the compiled model has their parts."""
_SHORTCUTS: Final = ("cylinder", "damper")
"""Tags of actuators that compile to general ones."""


def check_tags(tags: Sequence[Tag], report: ImportReport) -> None:
    """Refuse elements by their tags, wherever they are but in defaults."""
    for tag in tags:
        if tag.tag in _BY_TAG and not {"default", "extension"} & set(tag.inside):
            report.refuse(tag.tag, tag.attributes.get("name", tag.attributes.get("plugin", "")))
        if tag.tag in ("numeric", "text", "tuple"):
            report.hold(f"custom {tag.tag}", tag.attributes.get("name", ""), "left out: data without equations")
        if tag.tag == "option" and tag.attributes.get("cone") == "pyramidal":
            report.approximate("option cone", "pyramidal", "friction cones are round")


def shortcut_actuators(tags: Sequence[Tag]) -> dict[int, str]:
    """Tags of the actuators that are refused and that the compiled model cannot tell from others, by index."""
    actuators = [tag for tag in tags if tag.inside[:1] == ("actuator",)]
    return {index: tag.tag for index, tag in enumerate(actuators) if tag.tag in _SHORTCUTS}


def check_model(source: Source) -> None:
    """Options of the whole model, and parts that carry what no joint or geom tells."""
    model, report = source.model, source.report
    options = model.opt
    for name in ("density", "viscosity"):
        if getattr(options, name):
            report.refuse(name, "")
    if np.any(options.wind):
        report.refuse("wind", "")
    for body in np.nonzero(model.body_mocapid >= 0)[0]:
        report.refuse("mocap", source.label("body", int(body)))
    for body in np.nonzero(model.body_gravcomp)[0]:
        report.refuse("gravcomp", source.label("body", int(body)))
    for skin in range(model.nskin):
        report.refuse("skin", source.label("skin", skin))
    for flex in range(model.nflex):
        report.refuse("flex", source.label("flex", flex))
    _check_options(source)
    _check_contacts(source)


def _check_options(source: Source) -> None:
    import mujoco

    options, report = source.model.opt, source.report
    if options.integrator != mujoco.mjtIntegrator.mjINT_EULER:
        name = mujoco.mjtIntegrator(options.integrator).name.removeprefix("mjINT_").lower()
        report.approximate("option integrator", name, "semi-implicit steps, implicit in springs, dampers and servos")
    if options.impratio != 1.0:
        report.approximate("option impratio", "", "contacts are rigid along and across the normal")
    if options.noslip_iterations:
        report.approximate("option noslip_iterations", "", "contacts do not creep: the passes are not needed")
    if options.disableactuator:
        report.approximate("option actuatorgroupdisable", "", "the actuators of all groups act")


def _check_contacts(source: Source) -> None:
    """Explicit pairs, and the one line that tells of rigid contacts."""
    model, report = source.model, source.report
    for pair in range(model.npair):
        label = source.label("pair", pair)
        report.hold("pair", label)
        if model.pair_margin[pair] or model.pair_gap[pair]:
            report.approximate("pair margin", label, "margin and gap are 0")
        if np.any(model.pair_solref[pair] != DEFAULT_SOLREF) or np.any(model.pair_solimp[pair] != DEFAULT_SOLIMP):
            report.approximate("pair solref", label, "contacts are rigid, without MuJoCo's softness")
        if model.pair_adhesion[pair]:
            report.refuse("adhesion", label)
