"""Inputs of tracked vehicles before each step, and motion of their tracks after it; one thread per world."""

import warp as wp

from simwarp.kernels.core.fields import ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double, to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.vehicle.inputs_kernels import VehicleMotion, VehicleTables, member_of, point_velocity, publish_motion
from simwarp.vehicle.powertrain_kernels import Powertrain, PowertrainState, run_powertrain

wp.set_module_options({"enable_backward": False})


@wp.struct
class TrackTables:
    """The two tracks of a vehicle, left and right; shared by all worlds."""

    sprocket_dof: wp.vec2i
    tensioner_dof: wp.vec2i  # of the idlers' slides; -1: a belt's, which has a massless idler
    tensioner_sign: wp.vec2  # of an effort along the slide that tightens
    brake_torque: wp.vec2  # at full braking [N·m]
    steers_by_torque: int
    steers_by_brake: int
    torque_sign: float  # of what the gears' coupling brings to the sprockets


@wp.func
def inner_share(side: int, steering: float) -> float:
    """How much of the steering acts on a side: all on the inner one of a turn, nothing on the outer one."""
    return wp.max(wp.where(side == 0, steering, -steering), 0.0)


@wp.kernel
def run_tracked_vehicle(
    # inputs
    worlds: WorldRange,
    dt: float,
    vehicle: VehicleTables,
    tracks: TrackTables,
    powertrain: Powertrain,
    vehicle_input: wp.array3d[float],  # (W, 1, 4): steering -1..1 (left +), throttle, braking, clutch 0..1
    gyration: wp.array[int],  # (W,) 1: full steering turns the inner side's torque around
    parameters: Parameters,
    state: StateArrays,
    # outputs
    memory: PowertrainState,
    motion: VehicleMotion,
    control: ControlArrays,
):
    """Turns the driver's inputs into bounds and torques; dim (W, 1)."""
    index, number = wp.tid()
    world = worlds.first + index
    of = member_of(world, number, vehicle)
    steering = wp.clamp(vehicle_input[world, number, 0], -1.0, 1.0)
    throttle = wp.clamp(vehicle_input[world, number, 1], 0.0, 1.0)
    braking = wp.clamp(vehicle_input[world, number, 2], 0.0, 1.0)
    clutch = wp.clamp(vehicle_input[world, number, 3], 0.0, 1.0)
    v = state.body_v[world, vehicle.chassis]
    control.element_force[world, vehicle.chassis] = (-vehicle.drag * wp.length(v)) * v
    for side in range(2):
        inner = inner_share(side, steering) * float(tracks.steers_by_brake)
        dof = tracks.sprocket_dof[side]
        parameters.joint_friction[world, dof] = (braking + inner) * tracks.brake_torque[side]
        control.element_joint_force[world, dof] = 0.0
    torque_b = run_powertrain(of, dt, throttle, clutch, powertrain, memory, parameters, control, state)
    if tracks.steers_by_torque == 1:
        half = 0.5 * memory.drive_torque[world, number]
        for side in range(2):
            taken = float(1 + gyration[world]) * inner_share(side, steering)
            dof = tracks.sprocket_dof[side]
            control.element_joint_force[world, dof] = control.element_joint_force[world, dof] + half * (
                1.0 - taken - tracks.torque_sign
            )
    q = state.body_rot[world, vehicle.chassis]
    arm = to_float(wp.quat_rotate(q, to_double(vehicle.point)))
    motion.last_v[world, number] = point_velocity(world, vehicle.chassis, arm, state)
    control.element_torque[world, vehicle.chassis] = to_float(wp.quat_rotate(q, to_double(torque_b)))


@wp.func
def tensioner_force(world: int, dof: int, parameters: Parameters, state: StateArrays) -> float:
    """Effort of the spring and damper along an idler's slide [N]."""
    stiffness = parameters.joint_stiffness[world_row(world, parameters.joint_stiffness.shape[0]), dof]
    rest = parameters.joint_rest[world_row(world, parameters.joint_rest.shape[0]), dof]
    damping = parameters.joint_damping[world_row(world, parameters.joint_damping.shape[0]), dof]
    preload = parameters.joint_preload[world_row(world, parameters.joint_preload.shape[0]), dof]
    stretch = float(state.joint_q[world, dof]) - rest
    return preload - stiffness * stretch - damping * state.joint_qd[world, dof]


@wp.func
def publish_tracks(
    world: int, tracks: TrackTables, parameters: Parameters, state: StateArrays, sprocket_speed: wp.array2d[float],
    tension: wp.array2d[float],
):  # fmt: skip
    """How fast the sprockets turn, and what the tensioners leave to each run of their chains."""
    for side in range(2):
        sprocket_speed[world, side] = state.joint_qd[world, tracks.sprocket_dof[side]]
        if tracks.tensioner_dof[side] >= 0:
            force = tensioner_force(world, tracks.tensioner_dof[side], parameters, state)
            tension[world, side] = 0.5 * tracks.tensioner_sign[side] * force


@wp.kernel
def measure_tracked_vehicle(
    # inputs
    worlds: WorldRange,
    dt: float,
    vehicle: VehicleTables,
    tracks: TrackTables,
    parameters: Parameters,
    state: StateArrays,
    # outputs
    motion: VehicleMotion,
    sprocket_speed: wp.array2d[float],  # (W, 2) [rad/s]
    tension: wp.array2d[float],  # (W, 2) [N]
):
    """Motion of the vehicle's point and of its tracks after a step; dim (W, 1)."""
    index, number = wp.tid()
    world = worlds.first + index
    publish_motion(member_of(world, number, vehicle), vehicle, state, dt, motion)
    publish_tracks(world, tracks, parameters, state, sprocket_speed, tension)


@wp.kernel
def measure_set_tracked_vehicle(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    vehicle: VehicleTables,
    tracks: TrackTables,
    parameters: Parameters,
    state: StateArrays,
    # outputs
    motion: VehicleMotion,
    sprocket_speed: wp.array2d[float],  # (W, 2) [rad/s]
    tension: wp.array2d[float],  # (W, 2) [N]
):
    """The same where somebody set the state of their world; dim (W, 1)."""
    index, number = wp.tid()
    world = worlds.first + index
    if mask[world]:
        publish_motion(member_of(world, number, vehicle), vehicle, state, 0.0, motion)
        publish_tracks(world, tracks, parameters, state, sprocket_speed, tension)
