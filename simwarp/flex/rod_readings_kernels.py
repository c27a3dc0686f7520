"""Device half of the readings of rods."""

import warp as wp

from simwarp.kernels.core.fields import Parameters, StateArrays
from simwarp.kernels.core.tables import Topology, world_row

wp.set_module_options({"enable_backward": False})


@wp.kernel(enable_backward=False)
def measure_rod(
    # inputs
    joints: wp.array[int],
    topology: Topology,
    parameters: Parameters,
    state: StateArrays,
    # outputs
    strains: wp.array3d[float],
    forces: wp.array3d[float],
):
    """Deformation per length, and forces of springs and dampers, of elastic joints: a thread for each in each world."""
    world, element = wp.tid()
    joint = joints[element]
    length = parameters.joint_offset[world_row(world, parameters.joint_offset.shape[0]), joint]
    first = topology.joint_dof[joint]
    for local in range(6):
        dof = first + local
        q = state.joint_x[world, dof]
        rest = parameters.joint_rest[world_row(world, parameters.joint_rest.shape[0]), dof]
        stiffness = parameters.joint_stiffness[world_row(world, parameters.joint_stiffness.shape[0]), dof]
        damping = parameters.joint_damping[world_row(world, parameters.joint_damping.shape[0]), dof]
        preload = parameters.joint_preload[world_row(world, parameters.joint_preload.shape[0]), dof]
        stretch = float(q - wp.float64(rest))
        strains[world, element, local] = float(q / length)
        forces[world, element, local] = stiffness * stretch + damping * state.joint_qd[world, dof] - preload


@wp.kernel(enable_backward=False)
def measure_rod_stress(
    # inputs
    forces: wp.array3d[float],
    area: float,
    inertia: wp.vec2,
    torsion: float,
    reach: wp.vec2,
    is_round: bool,
    # outputs
    stress: wp.array3d[float],
):
    """Largest and least stress along a rod, and largest shear stress of twisting, in each element."""
    world, element = wp.tid()
    along = forces[world, element, 0] / area
    bend_y = wp.abs(forces[world, element, 4]) * reach[1] / inertia[0]
    bend_z = wp.abs(forces[world, element, 5]) * reach[0] / inertia[1]
    bending = bend_y + bend_z
    radius = wp.max(reach[0], reach[1])
    if is_round:
        bending = wp.sqrt(bend_y * bend_y + bend_z * bend_z)
    stress[world, element, 0] = along + bending
    stress[world, element, 1] = along - bending
    stress[world, element, 2] = wp.abs(forces[world, element, 3]) * radius / torsion
