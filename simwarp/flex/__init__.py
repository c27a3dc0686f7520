"""Flexible bodies: rods of elastic joints, their sections, materials and ends (docs/flexible.md).

`ModelBuilder.add_rod` makes a rod, `Simulation` moves it, `rod_forces` and `rod_stress` read what it carries.
"""

from simwarp.meshes.materials import Elastic, Rubber
from simwarp.model.mesh_specification import FlexibleMesh
from simwarp.model.rod_sections import Rectangle, Round, Section, Tube
from simwarp.model.rods import Clamp, Hinge, Rod
from simwarp.simulation.flexible_options import FlexibleOptions as Options

from .mesh_readings import mesh_positions, mesh_stress
from .rod_readings import rod_forces, rod_strains, rod_stress

__all__ = [
    "Clamp", "Elastic", "FlexibleMesh", "Hinge", "Options", "Rectangle", "Rod", "Round", "Rubber", "Section", "Tube",
    "mesh_positions", "mesh_stress", "rod_forces", "rod_strains", "rod_stress",
]  # fmt: skip
