"""Device half of the readings of rods."""

import warp as wp

from simwarp.kernels.core.fields import Parameters, StateArrays
from simwarp.kernels.core.tables import Topology, world_row
from simwarp.kernels.core.vector_math import to_double, turned
from simwarp.kernels.dynamics.elastic import frame_halfway, lever_of
from simwarp.kernels.dynamics.joints import JointFrames, rotation_vector

wp.set_module_options({"enable_backward": False})


@wp.kernel(enable_backward=False)
def measure_rod_strains(
    # inputs
    joints: wp.array[int],
    topology: Topology,
    parameters: Parameters,
    state: StateArrays,
    # outputs
    strains: wp.array3d[float],
):
    """Deformation per length of elastic joints at the present poses: a thread for each in each world."""
    world, element = wp.tid()
    joint = joints[element]
    length = parameters.joint_offset[world_row(world, parameters.joint_offset.shape[0]), joint]
    first = topology.joint_dof[joint]
    for local in range(6):
        strains[world, element, local] = float(state.joint_x[world, first + local] / length)


@wp.struct
class Placed:
    """A frame on a body at the start of the last step: its axes as columns, its origin from the body's centre, and that
    centre; world axes [m].
    """

    axes: wp.mat33d
    arm: wp.vec3d
    centre: wp.vec3d


@wp.func
def placed_before(world: int, body: int, dt: float, anchor: wp.vec3d, frame: wp.mat33d, state: StateArrays) -> Placed:
    """A frame of a joint where the last step found it: poses have moved by dt times the velocities since then."""
    placed = Placed()
    placed.axes = frame
    placed.arm = anchor
    if body >= 0:
        turn = wp.quat_to_matrix(turned(state.body_rot[world, body], state.body_omega[world, body] * (-dt)))
        placed.axes = turn * frame
        placed.arm = turn * anchor
        placed.centre = state.body_x[world, body] - to_double(state.body_v[world, body] * dt)
    return placed


@wp.kernel(enable_backward=False)
def measure_rod_forces(
    # inputs
    joints: wp.array[int],
    dt: float,
    topology: Topology,
    parameters: Parameters,
    state: StateArrays,
    reaction_force: wp.array2d[wp.vec3],
    reaction_torque: wp.array2d[wp.vec3],
    # outputs
    forces: wp.array3d[float],
):
    """Forces along the six coordinates of elastic joints that acted in the last step, by the joints' reactions on their
    second bodies: a thread for each in each world.
    """
    world, element = wp.tid()
    joint = joints[element]
    anchor0 = parameters.joint_anchor0[world_row(world, parameters.joint_anchor0.shape[0]), joint]
    anchor1 = parameters.joint_anchor1[world_row(world, parameters.joint_anchor1.shape[0]), joint]
    frame0 = parameters.joint_frame0[world_row(world, parameters.joint_frame0.shape[0]), joint]
    frame1 = parameters.joint_frame1[world_row(world, parameters.joint_frame1.shape[0]), joint]
    first = placed_before(world, topology.joint_body0[joint], dt, anchor0, frame0, state)
    second = placed_before(world, topology.joint_body1[joint], dt, anchor1, frame1, state)
    frames = JointFrames()
    frames.f0 = first.axes
    frames.f1 = second.axes
    frames.d = (second.centre - first.centre) + (second.arm - first.arm)
    halfway = frame_halfway(frames, rotation_vector(frames.f0, frames.f1))
    along = reaction_force[world, joint] * halfway.middle
    about = reaction_torque[world, joint] * halfway.middle
    turning = along * lever_of(halfway, 1.0) + about * halfway.spread
    for k in range(3):
        forces[world, element, k] = -along[k]
        forces[world, element, 3 + k] = -turning[k]


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
