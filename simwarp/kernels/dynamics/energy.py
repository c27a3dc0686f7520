"""Mechanical energy of the worlds, for whoever asks: no part of the step."""

import warp as wp

from simwarp.kernels.core.fields import Parameters, StateArrays
from simwarp.kernels.core.spatial import matrix_to_float
from simwarp.kernels.core.tables import Topology, world_row
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.dynamics.efforts import table_segment, table_slope

wp.set_module_options({"enable_backward": False})


@wp.func
def table_integral(table: int, x: wp.float64, topology: Topology) -> wp.float64:
    """Integral of a table's law from 0 to `x`: what a spring by table stores there [J]."""
    low = wp.min(x, wp.float64(0.0))
    high = wp.max(x, wp.float64(0.0))
    first = table_segment(table, low, topology)
    last = table_segment(table, high, topology)
    total = wp.float64(0.0)
    for segment in range(first, last + 1):  # linear in each, the first and the last one cut off at `low` and `high`
        begin = low
        end = high
        if segment > first:
            begin = topology.table_x[segment]
        if segment < last:
            end = topology.table_x[segment + 1]
        middle = wp.float64(0.5) * (begin + end) - topology.table_x[segment]
        total += (end - begin) * (topology.table_y[segment] + table_slope(segment, topology) * middle)
    return wp.where(x < wp.float64(0.0), -total, total)


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
            kinetic = 0.5 * (mass * wp.dot(v, v) + wp.dot(spin, inertia * spin))
            weight = (
                wp.float64(gravity[0]) * x[0] + wp.float64(gravity[1]) * x[1] + wp.float64(gravity[2]) * x[2]
            ) * wp.float64(mass)
            total += wp.float64(kinetic) - weight
    for dof in range(topology.dof_count):
        rate = state.joint_qd[world, dof]
        stretch = (
            float(state.joint_x[world, dof])
            - parameters.joint_rest[world_row(world, parameters.joint_rest.shape[0]), dof]
        )
        armature = parameters.joint_armature[world_row(world, parameters.joint_armature.shape[0]), dof]
        stiffness = parameters.joint_stiffness[world_row(world, parameters.joint_stiffness.shape[0]), dof]
        preload = parameters.joint_preload[world_row(world, parameters.joint_preload.shape[0]), dof]
        stored = wp.float64(0.5 * stiffness * stretch * stretch)
        table = topology.dof_table[dof, 0]
        if table >= 0:
            stored = wp.float64(stiffness) * table_integral(table, wp.float64(stretch), topology)
        total += wp.float64(0.5 * armature * rate * rate - preload * float(state.joint_x[world, dof])) + stored
    energy[world] = total
