"""Tires of flexible triangles, which bend over what they roll on: the ground is whatever shapes the builder has."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import Material, Pose
from simwarp.meshes.lattices import revolved_triangles
from simwarp.meshes.materials import Elastic
from simwarp.meshes.mesh_parts import MeshPart, lumped_masses
from simwarp.meshes.mesh_specification import FlexibleMesh
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.spec.parts import SPECS, SpecError
from simwarp.vehicle.spec.vehicle_parts import Tire
from simwarp.vehicle.tires.tire_parameters import FlexibleParameters
from simwarp.vehicle.tires.wheel_reports import parameter_text

TEMPLATE = "flexible"
FINE = 2000
"""Points of a section by which its length is measured."""
DENSER: Final = 1.0
"""How much denser nodes stand on a tread along the axis than on a sidewall: it meets the ground, and bends there."""

Array = npt.NDArray[np.float64]


def flexible_parameters(tire: Tire) -> FlexibleParameters:
    """Parameters of a flexible tire.

    Raises:
        SpecError: another key, or a value that breaks a rule.
    """
    values: FlexibleParameters = SPECS.load(FlexibleParameters, tire.parameters, parameter_text)
    if not values.rim_radius < tire.radius:
        raise SpecError(
            f"parameters.rim_radius: must be less than the tire's radius of {tire.radius:g} m, got "
            f"{values.rim_radius:g}; lower it"
        )
    return values


def tire_section(tire: Tire, values: FlexibleParameters) -> Array:
    """(across + 3, 2) distance from the axis and place along it of the nodes of a section [m], from bead to bead, twice
    as dense on the tread as on the sidewalls; the first and the last lie inside the rim: with the beads, which are
    glued too, they clamp the edges.
    """
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, FINE)
    power = 2.0 / values.squareness
    along = 0.5 * tire.width * np.sign(angle) * np.abs(np.sin(angle)) ** power
    radius = values.rim_radius + (tire.radius - values.rim_radius) * np.abs(np.cos(angle)) ** power
    steps = np.hypot(np.diff(along), np.diff(radius)) + DENSER * np.abs(np.diff(along))
    length = np.concatenate([[0.0], np.cumsum(steps)])
    places = np.linspace(0.0, length[-1], values.across + 1)
    section = np.column_stack([np.interp(places, length, radius), np.interp(places, length, along)])
    first = float(np.hypot(*(section[1] - section[0])))
    inside = max(values.rim_radius - first, 0.5 * values.rim_radius)
    ends = [[inside, -0.5 * tire.width], [inside, 0.5 * tire.width]]
    return np.vstack([ends[:1], section, ends[1:]])


class TireShell:
    """The shell of a flexible tire before it is on its wheel.

    Args:
        tire: its description.

    Attributes:
        points, triangles: nodes [m] and triangles about the y axis.
        held: nodes that the rim holds.
        material: whose density gives the tire its mass.
        held_mass: of these nodes, which is the wheel's [kg].

    Raises:
        SpecError: a parameter breaks its rule.
    """

    def __init__(self, tire: Tire) -> None:
        self.values = values = flexible_parameters(tire)
        section = tire_section(tire, values)
        self.points, self.triangles = revolved_triangles(section, values.around)
        row = np.arange(len(self.points)) % len(section)
        self.held = np.flatnonzero((row < 2) | (row > len(section) - 3))
        made = {"young": values.young, "poisson": values.poisson, "damping_time": values.damping_time}
        light = MeshPart(
            elements=self.triangles, material=Elastic(density=1.0, **made), thickness=values.thickness
        )  # fmt: skip
        masses = lumped_masses(self.points, [light])
        density = tire.mass / float(masses.sum())
        self.material = Elastic(density=density, **made)
        self.held_mass = density * float(masses[self.held].sum())

    def held_inertia(self) -> Array:
        """(3,) of the part that the rim holds, as a hoop [kg·m²]."""
        square = self.held_mass * self.values.rim_radius**2
        return np.array([0.5 * square, square, 0.5 * square])

    def add(self, builder: ModelBuilder, name: str, body: int, place: Pose) -> FlexibleMesh:
        """The tire on its wheel."""
        values = self.values
        return builder.add_shell(
            name, self.points, self.triangles, thickness=values.thickness, material=self.material, pose=place,
            glue={body: self.held}, pressure=values.pressure, surface=Material(friction=values.friction),
        )  # fmt: skip
