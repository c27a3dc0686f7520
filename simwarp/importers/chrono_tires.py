"""Chrono's tires to ours, parameters under the names of `simwarp.vehicle.tires.tire_parameters`."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from simwarp.core.types import formatted
from simwarp.importers.chrono_json import Node
from simwarp.vehicle.spec.vehicle_files import read_text
from simwarp.vehicle.spec.vehicle_spec import SpecError, Tire
from simwarp.vehicle.tires.tire_file_units import in_si_units
from simwarp.vehicle.tires.tire_files import parse_tir

SLOPES = (
    ("Initial Slopes dF{0}/ds{0} [N]", "slope"),
    ("Maximum F{0} Load [N]", "max"),
    ("Sliding F{0} Load [N]", "slide"),
)
SLIPS = (("Slip s{0} at Maximum F{0}", "max_slip"), ("Slip s{0} where sliding begins", "slide_slip"))
ALIGNING = (
    ("Normalized Trail at Zero Slip sy", "trail"),
    ("Slip sy where Trail Changes Sign", "trail_zero_slip"),
    ("Slip sy where Trail Tends to Zero", "trail_end_slip"),
)


def common(node: Node) -> dict[str, Any]:
    """Fields common to several templates."""
    found = {}
    if "Coefficient of Friction" in node:
        found["reference_friction"] = node.number("Coefficient of Friction")
    for key in ("Rolling Resistance Coefficient", "Rolling Resistance Coefficients"):
        if key in node:
            found["rolling_resistance"] = node.number(key)
    return found


def rated(node: Node) -> dict[str, Any]:
    """A tire that Chrono guesses: a load index counts before a load, as in Chrono."""
    found: dict[str, Any] = {}
    if "Parameters" in node:
        return found
    kind = node.text("Vehicle Type").lower()
    if kind not in ("truck", "passenger"):
        raise node.place.at("Vehicle Type").error(f"must be 'Truck' or 'Passenger', got {formatted(kind)}")
    found["pattern"] = "truck" if kind == "truck" else "car"
    node.skip("Maximum Bearing Capacity [N]")
    if "Load Index" in node:
        found["load_index"] = node.whole("Load Index")
    else:
        found["load"] = node.number("Maximum Bearing Capacity [N]", "N")
    if "Inflation Pressure Design [Pa]" in node and "Inflation Pressure Use [Pa]" in node:
        found["design_pressure"] = node.number("Inflation Pressure Design [Pa]", "Pa")
        found["use_pressure"] = node.number("Inflation Pressure Use [Pa]", "Pa")
    return found


def measured(node: Node, radius: float, *, simple: bool) -> dict[str, Any]:
    """A tire with all its values."""
    found: dict[str, Any] = {}
    if "Parameters" not in node:
        return found
    values = node.child("Parameters")
    vertical = values.child("Vertical")
    found["nominal_load"] = vertical.number("Nominal Vertical Force [N]", "N")
    found["load_limit"] = vertical.number("Maximum Vertical Force [N]", "N", 3.5 * found["nominal_load"])
    found["vertical_stiffness"] = vertical.number("Vertical Tire Stiffness [N/m]", "N/m")
    damping = [key for key in ("Tire Vertical Damping [Ns/m]", "Vertical Tire Damping [Ns/m]") if key in vertical]
    found["vertical_damping"] = vertical.number(damping[0] if damping else "Tire Vertical Damping [Ns/m]", "N·s/m")
    if "Tire Bottoming Radius [m]" in vertical:
        found["bottom_deflection"] = radius - vertical.number("Tire Bottoming Radius [m]", "m")
    if "Tire Bottoming Stiffness [N/m]" in vertical:
        found["bottom_stiffness"] = vertical.number("Tire Bottoming Stiffness [N/m]", "N/m")
    for room, axis in (("Longitudinal", "x"), ("Lateral", "y")):
        part = values.child(room)
        for key, name in SLOPES if simple else SLOPES + SLIPS:
            found[f"{name}_{axis}"] = part.numbers(key.format(axis), 2)
        if simple:
            part.skip(*(key.format(axis) for key, _ in SLIPS))
    if not simple:
        aligning = values.child("Aligning")
        found |= {name: aligning.numbers(key, 2) for key, name in ALIGNING}
    return found


def rill(template: str, node: Node, root: Path) -> Tire:
    """TMeasyTire and TMsimpleTire."""
    design = node.child("Design")
    radius = design.number("Unloaded Radius [m]", "m")
    if "Roundness of Cross Section" in design:
        roundness = design.number("Roundness of Cross Section")
        if roundness != 0.0:
            warnings.warn(f"{design.place.file}: Roundness of Cross Section: left out, treads are flat", stacklevel=2)
    parameters = {
        **rated(node),
        **measured(node, radius, simple=template == "tmsimple"),
        "rim_radius": design.number("Rim Radius [m]", "m"),
        **common(node),
    }
    return node.make(
        Tire,
        template=template,
        mass=design.number("Mass [kg]", "kg"),
        inertia=design.vector("Inertia [kg.m2]", "kg·m²"),
        radius=radius,
        width=design.number("Width [m]", "m"),
        parameters=parameters,
    )


def vertical(node: Node) -> dict[str, Any]:
    """Spring or table, and damper; the table counts, as in Chrono."""
    found: dict[str, Any] = {
        "vertical_stiffness": node.number("Vertical Stiffness", "N/m"),
        "vertical_damping": node.number("Vertical Damping", "N·s/m"),
        "rolling_resistance": node.number("Rolling Resistance"),
    }
    if "Vertical Curve Data" in node:
        found["vertical_curve"] = node.pairs("Vertical Curve Data")
    return found


def fiala(node: Node, root: Path) -> Tire:
    """FialaTire."""
    brush = node.child("Fiala Parameters")
    brush.skip("X Relaxation Length", "Y Relaxation Length")  # Chrono's law no longer uses them
    return node.make(
        Tire,
        template="fiala",
        mass=node.number("Mass", "kg"),
        inertia=node.vector("Inertia", "kg·m²"),
        radius=brush.number("Unloaded Radius", "m"),
        width=brush.number("Width", "m"),
        parameters={
            **vertical(brush),
            "slip_stiffness": brush.number("CSLIP", "N"),
            "cornering_stiffness": brush.number("CALPHA", "N/rad"),
            "friction_sliding": brush.number("UMIN"),
            "friction_static": brush.number("UMAX"),
            **common(node),
        },
    )


def pacejka89(node: Node, root: Path) -> Tire:
    """Pac89Tire."""
    design = node.child("Design Parameters")
    coefficients = {}
    for room, letter, count in (("Lateral", "a", 14), ("Longitudinal", "b", 11), ("Aligning", "c", 18)):
        part = node.child(f"{room} Coefficients")
        coefficients[room.lower()] = tuple(part.number(f"{letter}{index}") for index in range(count))
    return node.make(
        Tire,
        template="pacejka89",
        mass=node.number("Mass", "kg"),
        inertia=node.vector("Inertia", "kg·m²"),
        radius=design.number("Unloaded Radius", "m"),
        width=design.number("Width", "m"),
        parameters={
            **vertical(design),
            "lateral_stiffness": design.number("Lateral Stiffness", "N/m"),
            **coefficients,
            **common(node),
        },
    )


def pacejka2002(node: Node, root: Path) -> Tire:
    """Pac02Tire: its property file, relative to the root, also has the size."""
    path = root / node.text("TIR Specification File")
    tir = parse_tir(read_text(path), path.name)
    sizes = {}
    try:
        values = in_si_units(tir)
    except SpecError as error:
        raise tir.located(error) from None
    for key in ("UNLOADED_RADIUS", "WIDTH"):
        value = values.get(key)
        if not isinstance(value, float):
            rule = f"{path.name}: {key}: must be a number, got {formatted(value)}"
            raise node.place.at("TIR Specification File").error(rule)
        sizes[key] = value
    return node.make(
        Tire,
        template="pacejka2002",
        mass=node.number("Mass", "kg"),
        inertia=node.vector("Inertia", "kg·m²"),
        radius=sizes["UNLOADED_RADIUS"],
        width=sizes["WIDTH"],
        parameters={"tir": tir, "combined": "friction-ellipse", **common(node)},
    )


def rigid(node: Node, root: Path) -> Tire:
    """RigidTire: a cylinder in contact."""
    material = node.child("Contact Material")
    # Stiffness and damping are those of Chrono's penalty contact; ours is rigid. A mesh only refines the cylinder.
    material.skip("Properties", "Coefficients")
    node.skip("Contact Mesh")
    return node.make(
        Tire,
        template="rigid",
        mass=node.number("Mass", "kg"),
        inertia=node.vector("Inertia", "kg·m²"),
        radius=node.number("Radius", "m"),
        width=node.number("Width", "m"),
        parameters={
            "friction": material.number("Coefficient of Friction"),
            "restitution": material.number("Coefficient of Restitution", default=0.0),
        },
    )


TIRES: dict[str, Callable[[Node, Path], Tire]] = {
    "TMeasyTire": functools.partial(rill, "tmeasy"),
    "TMsimpleTire": functools.partial(rill, "tmsimple"),
    "FialaTire": fiala,
    "Pac89Tire": pacejka89,
    "Pac02Tire": pacejka2002,
    "RigidTire": rigid,
}
