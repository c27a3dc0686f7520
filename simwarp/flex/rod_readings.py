"""What a rod carries: strains, section forces and stresses of its elements, computed when they are asked for."""

from __future__ import annotations

import math
from typing import Any

import warp as wp

from simwarp.core.types import ModelError, formatted
from simwarp.flex.rod_readings_kernels import measure_rod_forces, measure_rod_strains, measure_rod_stress
from simwarp.model.rods import Rod
from simwarp.simulation.simulation import Simulation


def rod_strains(simulation: Simulation, rod: Rod) -> wp.array:
    """(W, E, 6) stretch, shear along y and z [1], twist and bending about y and z [1/m] of each element beyond its rest
    shape, in the axes of its section, at the present poses.

    Raises:
        ModelError: the rod is none of the simulation's model.
    """
    strains, joints = _prepared("rod_strains", simulation, rod)
    model = simulation.model
    wp.launch(
        measure_rod_strains, strains.shape[:2],
        inputs=[joints, model.topology, model.parameters, simulation.state.arrays], outputs=[strains],
        device=model.device,
    )  # fmt: skip
    return strains


def rod_forces(simulation: Simulation, rod: Rod) -> wp.array:
    """(W, E, 6) tension, shear force along y and z [N], torque about x and bending moments about y and z [N·m] that
    acted in each element in the last step, in the axes of its section: what its spring, its damper and the step's own
    damping made of it together. Stiffness times the strain of a pose is something else where a rod moves fast: the
    stretch that a step leaves in what spins is small, and the stiffness large.

    Raises:
        ModelError: the rod is none of the simulation's model, or the simulation records no reactions.
    """
    return _forces("rod_forces", simulation, rod)


def rod_stress(simulation: Simulation, rod: Rod) -> wp.array:
    """(W, E, 3) largest and least stress along the rod, N/A ± M r/I, and the shear stress of twisting T r/J at the
    section's edge [Pa]. Where the section is not round, T r/J with its largest distance is an estimate.

    Raises:
        ModelError: the rod is none of the simulation's model, or the simulation records no reactions.
    """
    forces = _forces("rod_stress", simulation, rod)
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


def _forces(call: str, simulation: Simulation, rod: Rod) -> wp.array:
    """`rod_forces`, asked for by `call`."""
    forces, joints = _prepared(call, simulation, rod)
    reports = simulation.diagnostics
    if reports.joint_reaction_force.shape[0] == 0:
        raise ModelError(
            f"{call}: forces of rod {formatted(rod.name)} are reactions of its joints, which the simulation does not "
            "record; make it with Simulation(..., joint_reactions=True)"
        )
    model = simulation.model
    wp.launch(
        measure_rod_forces, forces.shape[:2],
        inputs=[
            joints, simulation.dt / simulation.substeps, model.topology, model.parameters, simulation.state.arrays,
            reports.joint_reaction_force, reports.joint_reaction_torque,
        ],
        outputs=[forces], device=model.device,
    )  # fmt: skip
    return forces


def _prepared(call: str, simulation: Simulation, rod: Rod) -> tuple[wp.array, wp.array]:
    """Room for six numbers of each element, and the elements' joints."""
    model = simulation.model
    names = model.joint_names
    there = [joint < len(names) and names[joint] == f"{rod.name}:{index}" for index, joint in enumerate(rod.joints)]
    if not all(there):
        raise ModelError(
            f"{call}: rod must be one of the simulation's model, got {formatted(rod.name)}; pass what add_rod of its "
            "builder returned"
        )
    room = wp.empty((model.world_count, len(rod.joints), 6), dtype=float, device=model.device)
    joints: Any = wp.array(rod.joints, dtype=int, device=model.device)
    return room, joints
