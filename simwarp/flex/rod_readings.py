"""What a rod carries: strains, section forces and stresses of its elements, computed when they are asked for."""

from __future__ import annotations

import math
from typing import Any

import warp as wp

from simwarp.core.types import ModelError, formatted
from simwarp.flex.rod_readings_kernels import measure_rod, measure_rod_stress
from simwarp.model.rods import Rod
from simwarp.simulation.simulation import Simulation


def rod_strains(simulation: Simulation, rod: Rod) -> wp.array:
    """(W, E, 6) stretch, shear along y and z [1], twist and bending about y and z [1/m] of each element beyond its rest
    shape, in the axes of its section.

    Raises:
        ModelError: the rod is none of the simulation's model.
    """
    return _measured("rod_strains", simulation, rod)[0]


def rod_forces(simulation: Simulation, rod: Rod) -> wp.array:
    """(W, E, 6) tension, shear force along y and z [N], torque about x and bending moments about y and z [N·m] of each
    element, in the axes of its section, damping included.

    Raises:
        ModelError: the rod is none of the simulation's model.
    """
    return _measured("rod_forces", simulation, rod)[1]


def rod_stress(simulation: Simulation, rod: Rod) -> wp.array:
    """(W, E, 3) largest and least stress along the rod, N/A ± M r/I, and the shear stress of twisting T r/J at the
    section's edge [Pa]. Where the section is not round, T r/J with its largest distance is an estimate.

    Raises:
        ModelError: the rod is none of the simulation's model.
    """
    forces = _measured("rod_stress", simulation, rod)[1]
    worlds, elements, _ = forces.shape
    section = rod.section
    is_round = math.isclose(section.torsion, section.inertia_y + section.inertia_z, rel_tol=1e-9)
    stress = wp.empty((worlds, elements, 3), dtype=float, device=forces.device)
    wp.launch(
        measure_rod_stress, (worlds, elements),
        inputs=[
            forces, section.area, wp.vec2(section.inertia_y, section.inertia_z), section.torsion,
            wp.vec2(section.reach_y, section.reach_z), is_round,
        ],
        outputs=[stress], device=forces.device,
    )  # fmt: skip
    return stress


def _measured(call: str, simulation: Simulation, rod: Rod) -> tuple[Any, Any]:
    """Strains and forces."""
    model = simulation.model
    names = model.joint_names
    there = [joint < len(names) and names[joint] == f"{rod.name}:{index}" for index, joint in enumerate(rod.joints)]
    if not all(there):
        raise ModelError(
            f"{call}: rod must be one of the simulation's model, got {formatted(rod.name)}; pass what add_rod of its "
            "builder returned"
        )
    shape = (model.world_count, len(rod.joints), 6)
    strains, forces = (wp.empty(shape, dtype=float, device=model.device) for _ in range(2))
    joints: Any = wp.array(rod.joints, dtype=int, device=model.device)
    wp.launch(
        measure_rod, shape[:2], inputs=[joints, model.topology, model.parameters, simulation.state.arrays],
        outputs=[strains, forces], device=model.device,
    )  # fmt: skip
    return strains, forces
