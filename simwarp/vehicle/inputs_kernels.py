"""Vehicles' inputs: steering, brakes, drag and powertrain, before each step; one thread per vehicle of a world."""

import warp as wp

from simwarp.kernels.core.fields import ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.vector_math import matrix_to_float, to_double, to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.vehicle.powertrain_kernels import Member, Powertrain, PowertrainState, run_powertrain

wp.set_module_options({"enable_backward": False})


@wp.struct
class VehicleTables:
    """Degrees of freedom that a vehicle's inputs act on, and their scales; shared by all worlds. Of V alike vehicles
    in a world those of the first, and the shifts (V,) of the others' indices.
    """

    body_shift: wp.array[int]
    dof_shift: wp.array[int]
    coupling_shift: wp.array[int]
    chassis: int
    point: wp.vec3  # whose motion is reported, from the chassis' centre of mass, body axes [m]
    drag: float  # 0.5 · density · coefficient · area [kg/m]
    trailer_body: wp.array[int]  # chassis of the trailers, of which each hangs on the one before
    trailer_drag: wp.array[float]  # likewise
    steering_dof: wp.array[int]
    steering_travel: wp.array[float]  # at full input [rad or m]
    brake_dof: wp.array[int]
    brake_torque: wp.array[float]  # at full braking [N·m]
    lock_dof: wp.array[int]  # slip of the differentials' clutches
    lock_held: wp.array[float]  # torque of the open clutch [N·m]
    lock_torque: wp.array[float]  # torque added when it closes [N·m]
    motor_dof: wp.array[int]  # of a differential drive: left, right
    motor_speed: float  # its motors' at full throttle, or at full steering on the spot [rad/s]


@wp.struct
class VehicleMotion:
    """Motion of the vehicles, (W, V), at a point of the chassis."""

    position: wp.array2d[wp.vec3d]  # world [m]
    angles: wp.array2d[wp.vec3]  # roll, pitch (nose down positive), yaw [rad]
    velocity_b: wp.array2d[wp.vec3]  # chassis axes [m/s]
    omega_b: wp.array2d[wp.vec3]  # [rad/s]; the third is the yaw rate
    acceleration_b: wp.array2d[wp.vec3]  # over the last step, without gravity [m/s²]
    last_v: wp.array2d[wp.vec3]  # velocity at the start of the step, world [m/s]
    articulation: wp.array3d[float]  # (W, V, trailers) yaw of each in axes of the unit before it [rad]


@wp.func
def member_of(world: int, vehicle: int, tables: VehicleTables) -> Member:
    """A vehicle of a world."""
    m = Member()
    m.world = world
    m.vehicle = vehicle
    m.body = tables.body_shift[vehicle]
    m.dof = tables.dof_shift[vehicle]
    m.coupling = tables.coupling_shift[vehicle]
    return m


@wp.func
def point_velocity(world: int, body: int, arm: wp.vec3, state: StateArrays) -> wp.vec3:
    """Velocity of the point of a body at `arm` from its centre, world axes [m/s]."""
    return state.body_v[world, body] + wp.cross(state.body_omega[world, body], arm)


@wp.func
def publish_motion(of: Member, vehicle: VehicleTables, state: StateArrays, dt: float, motion: VehicleMotion):
    """Motion of the vehicle's point; its acceleration is that of the last `dt`, zero where no time has passed."""
    chassis = of.body + vehicle.chassis
    q = state.body_rot[of.world, chassis]
    r = wp.quat_to_matrix(q)
    arm = wp.quat_rotate(q, to_double(vehicle.point))
    v = point_velocity(of.world, chassis, to_float(arm), state)
    motion.position[of.world, of.vehicle] = state.body_x[of.world, chassis] + arm
    motion.angles[of.world, of.vehicle] = wp.vec3(
        wp.atan2(float(r[2, 1]), float(r[2, 2])),
        -wp.asin(wp.clamp(float(r[2, 0]), -1.0, 1.0)),
        wp.atan2(float(r[1, 0]), float(r[0, 0])),
    )
    axes = matrix_to_float(r)
    motion.velocity_b[of.world, of.vehicle] = v * axes
    motion.omega_b[of.world, of.vehicle] = state.body_omega[of.world, chassis] * axes
    if dt > 0.0:
        motion.acceleration_b[of.world, of.vehicle] = ((v - motion.last_v[of.world, of.vehicle]) / dt) * axes
    else:
        motion.acceleration_b[of.world, of.vehicle] = wp.vec3()
    before = axes
    for each in range(vehicle.trailer_body.shape[0]):
        behind = matrix_to_float(wp.quat_to_matrix(state.body_rot[of.world, of.body + vehicle.trailer_body[each]]))
        ahead = wp.vec3(behind[0, 0], behind[1, 0], behind[2, 0]) * before
        motion.articulation[of.world, of.vehicle, each] = wp.atan2(ahead[1], ahead[0])
        before = behind


@wp.func
def side_shares(gear: int, throttle: float, steering: float, braking: float) -> wp.vec2:
    """Speeds of the left and the right side over the largest, -1..1. Together the two inputs may ask for more than a
    side can do: then both sides are slower by as much, so that the curvature stays. Brakes slow both down alike.
    """
    ahead = throttle * wp.sign(float(gear))
    if gear == 0:
        ahead = 0.0
    left = ahead - steering
    right = ahead + steering
    fastest = wp.max(1.0, wp.max(wp.abs(left), wp.abs(right)))
    return wp.vec2(left, right) * ((1.0 - braking) / fastest)


@wp.kernel
def measure_vehicle(
    # inputs
    worlds: WorldRange,
    dt: float,
    vehicle: VehicleTables,
    state: StateArrays,
    # outputs
    motion: VehicleMotion,
):
    """Motion of the vehicles' points after a step; dim (W, V)."""
    index, number = wp.tid()
    publish_motion(member_of(worlds.first + index, number, vehicle), vehicle, state, dt, motion)


@wp.kernel
def measure_set_vehicle(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    vehicle: VehicleTables,
    state: StateArrays,
    # outputs
    motion: VehicleMotion,
):
    """Motion of the vehicles' points where somebody set the state of their world; dim (W, V)."""
    index, number = wp.tid()
    world = worlds.first + index
    if mask[world]:
        publish_motion(member_of(world, number, vehicle), vehicle, state, 0.0, motion)


@wp.kernel
def run_vehicle(
    # inputs
    worlds: WorldRange,
    dt: float,
    vehicle: VehicleTables,
    powertrain: Powertrain,
    vehicle_input: wp.array3d[float],  # (W, V, 4): steering -1..1 (left +), throttle, braking, clutch 0..1
    lock: wp.array3d[float],  # (W, V, locks) 0..1
    parameters: Parameters,
    state: StateArrays,
    # outputs
    memory: PowertrainState,
    motion: VehicleMotion,
    control: ControlArrays,
):
    """Turns the drivers' inputs into targets, bounds and torques; dim (W, V)."""
    index, number = wp.tid()
    world = worlds.first + index
    of = member_of(world, number, vehicle)
    chassis = of.body + vehicle.chassis
    steering = wp.clamp(vehicle_input[world, number, 0], -1.0, 1.0)
    throttle = wp.clamp(vehicle_input[world, number, 1], 0.0, 1.0)
    braking = wp.clamp(vehicle_input[world, number, 2], 0.0, 1.0)
    clutch = wp.clamp(vehicle_input[world, number, 3], 0.0, 1.0)
    for each in range(vehicle.steering_dof.shape[0]):
        control.joint_target_q[world, of.dof + vehicle.steering_dof[each]] = steering * vehicle.steering_travel[each]
    for each in range(vehicle.brake_dof.shape[0]):
        parameters.joint_friction[world, of.dof + vehicle.brake_dof[each]] = braking * vehicle.brake_torque[each]
    for each in range(lock.shape[2]):
        torque = vehicle.lock_held[each] + wp.clamp(lock[world, number, each], 0.0, 1.0) * vehicle.lock_torque[each]
        parameters.joint_friction[world, of.dof + vehicle.lock_dof[each]] = torque
    if vehicle.motor_dof.shape[0] > 0:
        shares = side_shares(memory.gear[world, number], throttle, steering, braking)
        for side in range(2):
            control.joint_target_qd[world, of.dof + vehicle.motor_dof[side]] = shares[side] * vehicle.motor_speed
    v = state.body_v[world, chassis]
    control.element_force[world, chassis] = (-vehicle.drag * wp.length(v)) * v
    for each in range(vehicle.trailer_body.shape[0]):
        behind = of.body + vehicle.trailer_body[each]
        v_behind = state.body_v[world, behind]
        control.element_force[world, behind] = (-vehicle.trailer_drag[each] * wp.length(v_behind)) * v_behind
    q = state.body_rot[world, chassis]
    torque_b = run_powertrain(of, dt, throttle, clutch, powertrain, memory, parameters, control, state)
    arm = to_float(wp.quat_rotate(q, to_double(vehicle.point)))
    motion.last_v[world, number] = point_velocity(world, chassis, arm, state)
    control.element_torque[world, chassis] = to_float(wp.quat_rotate(q, to_double(torque_b)))
