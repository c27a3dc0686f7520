"""Flags of MJCF's `<option><flag>`: what they switch off in the file is off here, and each is named in the report."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from simwarp.importers.report import ImportReport

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
    import mujoco

    return _words(model.opt.disableflags, mujoco.mjtDisableBit)


def _enabled(model: Any) -> list[str]:
    import mujoco

    return _words(model.opt.enableflags, mujoco.mjtEnableBit)


def _words(flags: int, kinds: Any) -> list[str]:
    """Attributes of `<flag>` whose bits are set; a bit without a name by its number."""
    # members without "BL_" count the others
    names = {int(kind): name.partition("BL_")[2].lower() for name, kind in kinds.__members__.items() if "BL_" in name}
    bits = (1 << shift for shift in range(int(flags).bit_length()))
    return [names.get(bit, f"of bit {bit:#x}") for bit in bits if flags & bit]
