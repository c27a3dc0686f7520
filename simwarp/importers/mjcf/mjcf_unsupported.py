"""What of MJCF is refused, and options of the whole model that have other equations here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import mujoco
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
    "equality flex": "edges of a flex are not rigid; give it <elasticity>",
    "equality flexvert": "vertices of a flex are not tied to each other; give it <elasticity>",
    "equality flexstrain": "strains of a flex are not held at zero; give it <elasticity>",
    "equality distance": "use a spatial tendon with a range",
    "geom sdf": "there are no distance fields",
    "flex rigid": "a flex that does not bend is a body; write it as one",
    "flex dof": "a flex has all vertices free (dof full)",
    "flex yield": "there is no plastic flow; set yield to 0",
    "flex elasticity": "a flex is elastic: give <elasticity> young above 0, and elastic2d of a sheet",
    "flex edge": "edges of a sheet or solid are not rigid, and those of a line stiff or rigid: see <edge>",
    "flex section": "which way round a box lies is not told; use section circle, or add_rod",
    "flex line": "a line goes from vertex to vertex; use add_rod for rings and nets",
    "flex pin": "a line is held at its ends, a sheet or solid by one moving body",
    "composite": "write the parts out, or use flexcomp",
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
    _check_options(source)
    _check_contacts(source)


def _check_options(source: Source) -> None:
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


CONSTRAINTS: Final = ("equality", "frictionloss", "limit", "contact")
"""What the flag `constraint` switches off."""


def _frictionless(model: Any) -> None:
    model.dof_frictionloss[:] = model.tendon_frictionloss[:] = 0.0


def _unlimited(model: Any) -> None:
    model.jnt_limited[:] = model.tendon_limited[:] = 0


def _springless(model: Any) -> None:
    model.jnt_stiffness[:] = model.tendon_stiffness[:] = 0.0
    model.jnt_stiffnesspoly[:] = model.tendon_stiffnesspoly[:] = 0.0


def _undamped(model: Any) -> None:
    model.dof_damping[:] = model.tendon_damping[:] = 0.0
    model.dof_dampingpoly[:] = model.tendon_dampingpoly[:] = 0.0


def _unclamped(model: Any) -> None:
    model.actuator_ctrllimited[:] = 0


def _nothing(model: Any) -> None:
    """Its reader asks `is_off` itself."""


LAWS: Final[dict[str, tuple[Callable[[Any], None], str]]] = {
    "equality": (_nothing, "equality constraints are left out"),
    "frictionloss": (_frictionless, "dry friction of joints and tendons is left out"),
    "limit": (_unlimited, "stops of joints and tendons are left out"),
    "contact": (_nothing, "no two shapes meet"),
    "spring": (_springless, "springs of joints and tendons are left out"),
    "damper": (_undamped, "dampers of joints and tendons are left out"),
    "gravity": (_nothing, "a new builder gets none"),
    "clampctrl": (_unclamped, "controls are not clamped"),
    "actuation": (_nothing, "actuators are left out"),
    "filterparent": (_nothing, "parents and their children meet"),
}
"""Laws that a flag switches off: how they are taken out of the compiled model, and what that means."""

OF_SOLVER: Final = "a matter of MuJoCo's own solver"
SETTINGS: Final[dict[str, str]] = {
    "warmstart": OF_SOLVER, "refsafe": OF_SOLVER, "midphase": OF_SOLVER, "nativeccd": OF_SOLVER, "multiccd": OF_SOLVER,
    "island": OF_SOLVER, "autoreset": "a world that fails says so in world_status",
    "energy": "Simulation.diagnostics has energies", "fwdinv": OF_SOLVER, "invdiscrete": OF_SOLVER,
    "diagexact": OF_SOLVER, "ipc": OF_SOLVER, "speculative": OF_SOLVER,
}  # fmt: skip
"""Flags that move nothing, or whose counterpart is always on."""

OTHERS: Final[dict[str, str]] = {
    "sensor": "sensors measure all the same",
    "eulerdamp": "dampers are implicit all the same",
    "override": "contacts are rigid; margin and friction stay those of the geoms",
    "sleep": "nothing sleeps",
}
"""Flags that are not followed."""


def is_off(model: Any, law: str) -> bool:
    """True where a flag of the file switches a law of `LAWS` off."""
    return law in _disabled(model) or (law in CONSTRAINTS and "constraint" in _disabled(model))


def apply_flags(model: Any, report: ImportReport) -> None:
    """Takes what the flags switch off out of the compiled model, and reports every flag that is set."""
    for law, (take_out, note) in LAWS.items():
        if is_off(model, law):
            take_out(model)
            report.hold(f"flag {law}", "", f"disabled: {note}")
    for state, words in (("disabled", _disabled(model)), ("enabled", _enabled(model))):
        for word in words:
            if word in SETTINGS:
                report.hold(f"flag {word}", "", f"{state}: {SETTINGS[word]}")
            elif word not in LAWS and word != "constraint":
                report.approximate(f"flag {word}", "", f"{state}: {OTHERS.get(word, 'it is not followed')}")


def _disabled(model: Any) -> list[str]:
    return _words(model.opt.disableflags, mujoco.mjtDisableBit)


def _enabled(model: Any) -> list[str]:
    return _words(model.opt.enableflags, mujoco.mjtEnableBit)


def _words(flags: int, kinds: Any) -> list[str]:
    """Attributes of `<flag>` whose bits are set; a bit without a name by its number."""
    # members without "BL_" count the others
    names = {int(kind): name.partition("BL_")[2].lower() for name, kind in kinds.__members__.items() if "BL_" in name}
    bits = (1 << shift for shift in range(int(flags).bit_length()))
    return [names.get(bit, f"of bit {bit:#x}") for bit in bits if flags & bit]
