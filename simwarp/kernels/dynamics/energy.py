"""Mechanical energy of the worlds. It is not part of the step."""

import warp as wp

from simwarp.kernels.core.fields import Parameters, StateArrays
from simwarp.kernels.core.tables import Topology, world_row
from simwarp.kernels.core.vector_math import matrix_to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.dynamics.efforts import rotation_start, spring_stretch, table_work
from simwarp.kernels.meshes.mesh_links import NODE

wp.set_module_options({"enable_backward": False})


@wp.func
def stored_energy(dof: int, world: int, topology: Topology, parameters: Parameters, state: StateArrays) -> wp.float64:
    """Potential of a coordinate's spring, by its stiffness or table, zero at rest, and of its preload [J]."""
    stretch = spring_stretch(dof, world, topology, parameters, state)
    preload = wp.float64(parameters.joint_preload[world_row(world, parameters.joint_preload.shape[0]), dof])
    stiffness = wp.float64(parameters.joint_stiffness[world_row(world, parameters.joint_stiffness.shape[0]), dof])
    moved = stretch
    if rotation_start(dof, topology) < 0:
        moved = state.joint_x[world, dof]
    if topology.dof_table[dof, 0] >= 0:
        table = topology.dof_table[dof, 0]
        spring = table_work(table, stretch, topology) - table_work(table, wp.float64(0.0), topology)
        return stiffness * spring - preload * moved
    return wp.float64(0.5) * stiffness * stretch * stretch - preload * moved


@wp.kernel(enable_backward=False)
def measure_energy(
    # inputs
    worlds: WorldRange,
    topology: Topology,
    parameters: Parameters,
    state: StateArrays,
    # outputs
    energy: wp.array[wp.float64],
):
    """Kinetic energy of bodies, shafts and armatures, energy of the weights (zero at the origin), and that of joint
    springs (zero at rest), linear and by table, and preloads [J].
    """
    world = worlds.first + wp.tid()
    total = wp.float64(0.0)
    gravity = parameters.gravity[world_row(world, parameters.gravity.shape[0])]
    for link in range(topology.link_count):
        body = topology.link_body[link]
        if body >= 0:
            mass = parameters.body_mass[world_row(world, parameters.body_mass.shape[0]), body]
            inertia = parameters.body_inertia_b[world_row(world, parameters.body_inertia_b.shape[0]), body]
            v = state.body_v[world, body]
            spin = state.body_omega[world, body] * matrix_to_float(wp.quat_to_matrix(state.body_rot[world, body]))
            x = state.body_x[world, body]
            kinetic = 0.5 * mass * wp.dot(v, v)
            if topology.link_type[link] != NODE:  # a node has no orientation, whatever was written there
                kinetic += 0.5 * wp.dot(spin, inertia * spin)
            weight = (
                wp.float64(gravity[0]) * x[0] + wp.float64(gravity[1]) * x[1] + wp.float64(gravity[2]) * x[2]
            ) * wp.float64(mass)
            total += wp.float64(kinetic) - weight
    for dof in range(topology.dof_count):
        rate = state.joint_qd[world, dof]
        armature = parameters.joint_armature[world_row(world, parameters.joint_armature.shape[0]), dof]
        total += wp.float64(0.5 * armature * rate * rate)
        total += stored_energy(dof, world, topology, parameters, state)
    energy[world] = total
