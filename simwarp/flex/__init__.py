"""Flexible bodies: rods of elastic joints, their sections, materials and ends; volumes in cells (docs/flexible.md).

`ModelBuilder.add_rod` makes a rod, `Simulation` moves it, `rod_forces` and `rod_stress` read what it carries.
`box`, `lattice`, `tetrahedra` and `read` divide a volume into cells.
"""

from simwarp.meshes.materials import Elastic, Rubber
from simwarp.meshes.mesh_columns import mesh_cost
from simwarp.meshes.mesh_costs import MeshCost
from simwarp.meshes.mesh_specification import FlexibleMesh, MeshContact
from simwarp.meshes.volume_files import read, tetrahedra
from simwarp.meshes.volume_lattices import box, lattice
from simwarp.meshes.volume_mesh import EmbeddedSurface, VolumeMesh
from simwarp.model.rod_sections import Rectangle, Round, Section, Tube
from simwarp.model.rods import Clamp, Hinge, Rod
from simwarp.simulation.flexible_options import FlexibleOptions as Options

from .mesh_readings import mesh_inverted, mesh_positions, mesh_stress
from .rod_readings import rod_forces, rod_strains, rod_stress

__all__ = [
    "Clamp", "Elastic", "EmbeddedSurface", "FlexibleMesh", "Hinge", "MeshContact", "MeshCost", "Options", "Rectangle",
    "Rod", "Round", "Rubber", "Section", "Tube", "VolumeMesh", "box", "lattice", "mesh_cost", "mesh_inverted",
    "mesh_positions", "mesh_stress", "read", "rod_forces", "rod_strains", "rod_stress", "tetrahedra",
]  # fmt: skip
