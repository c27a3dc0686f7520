"""A vehicle's inputs: steering, brakes, drag and powertrain, before each step."""

import warp as wp

from simwarp.kernels.core.fields import ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.spatial import matrix_to_float, to_double, to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.vehicle.powertrain import Powertrain, PowertrainState, run_powertrain

wp.set_module_options({"enable_backward": False})


@wp.struct
class VehicleTables:
    """Degrees of freedom that a vehicle's inputs act on, and their scales; shared by all worlds."""

    chassis: int
    point: wp.vec3  # whose motion is reported, from the chassis' centre of mass, body axes [m]
    drag: float  # 0.5 · density · coefficient · area [kg/m]
    steering_dof: wp.array[int]
    steering_travel: wp.array[float]  # at full input [rad or m]
    brake_dof: wp.array[int]
    brake_torque: wp.array[float]  # at full braking [N·m]
    lock_dof: wp.array[int]  # slip of the differentials' clutches
    lock_held: wp.array[float]  # torque of the open clutch [N·m]
    lock_torque: wp.array[float]  # torque added when it closes [N·m]


@wp.struct
class VehicleMotion:
    """Motion of the vehicles, per world, at a point of the chassis."""

    position: wp.array[wp.vec3d]  # world [m]
    angles: wp.array[wp.vec3]  # roll, pitch (nose down positive), yaw [rad]
    velocity_b: wp.array[wp.vec3]  # chassis axes [m/s]
    omega_b: wp.array[wp.vec3]  # [rad/s]; the third is the yaw rate
    acceleration_b: wp.array[wp.vec3]  # over the last step, without gravity [m/s²]
    last_v: wp.array[wp.vec3]  # velocity at the start of the step, world [m/s]


@wp.func
def point_velocity(world: int, body: int, arm: wp.vec3, state: StateArrays) -> wp.vec3:
    """Velocity of the point of a body at `arm` from its centre, world axes [m/s]."""
    return state.body_v[world, body] + wp.cross(state.body_omega[world, body], arm)


@wp.func
def publish_motion(world: int, vehicle: VehicleTables, state: StateArrays, dt: float, motion: VehicleMotion):
    """Motion of the vehicle's point; its acceleration is that of the last `dt`, zero where no time has passed."""
    q = state.body_rot[world, vehicle.chassis]
    r = wp.quat_to_matrix(q)
    arm = wp.quat_rotate(q, to_double(vehicle.point))
    v = point_velocity(world, vehicle.chassis, to_float(arm), state)
    motion.position[world] = state.body_x[world, vehicle.chassis] + arm
    motion.angles[world] = wp.vec3(
        wp.atan2(float(r[2, 1]), float(r[2, 2])),
        -wp.asin(wp.clamp(float(r[2, 0]), -1.0, 1.0)),
        wp.atan2(float(r[1, 0]), float(r[0, 0])),
    )
    axes = matrix_to_float(r)
    motion.velocity_b[world] = v * axes
    motion.omega_b[world] = state.body_omega[world, vehicle.chassis] * axes
    if dt > 0.0:
        motion.acceleration_b[world] = ((v - motion.last_v[world]) / dt) * axes
    else:
        motion.acceleration_b[world] = wp.vec3()


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
    """Motion of the vehicle's point after a step."""
    publish_motion(worlds.first + wp.tid(), vehicle, state, dt, motion)


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
    """Motion of the vehicle's point where somebody set the state of its world."""
    world = worlds.first + wp.tid()
    if mask[world]:
        publish_motion(world, vehicle, state, 0.0, motion)


@wp.kernel
def run_vehicle(
    # inputs
    worlds: WorldRange,
    dt: float,
    vehicle: VehicleTables,
    powertrain: Powertrain,
    vehicle_input: wp.array2d[float],  # (W, 4): steering -1..1 (left +), throttle, braking, clutch 0..1
    lock: wp.array2d[float],  # (W, locks) 0..1
    parameters: Parameters,
    state: StateArrays,
    # outputs
    memory: PowertrainState,
    motion: VehicleMotion,
    control: ControlArrays,
):
    """Turns the driver's inputs into targets, bounds and torques."""
    world = worlds.first + wp.tid()
    steering = wp.clamp(vehicle_input[world, 0], -1.0, 1.0)
    throttle = wp.clamp(vehicle_input[world, 1], 0.0, 1.0)
    braking = wp.clamp(vehicle_input[world, 2], 0.0, 1.0)
    clutch = wp.clamp(vehicle_input[world, 3], 0.0, 1.0)
    for index in range(vehicle.steering_dof.shape[0]):
        control.joint_target_q[world, vehicle.steering_dof[index]] = steering * vehicle.steering_travel[index]
    for index in range(vehicle.brake_dof.shape[0]):
        parameters.joint_friction[world, vehicle.brake_dof[index]] = braking * vehicle.brake_torque[index]
    for index in range(lock.shape[1]):
        torque = vehicle.lock_held[index] + wp.clamp(lock[world, index], 0.0, 1.0) * vehicle.lock_torque[index]
        parameters.joint_friction[world, vehicle.lock_dof[index]] = torque
    v = state.body_v[world, vehicle.chassis]
    control.element_force[world, vehicle.chassis] = (-vehicle.drag * wp.length(v)) * v
    q = state.body_rot[world, vehicle.chassis]
    torque_b = run_powertrain(world, dt, throttle, clutch, powertrain, memory, parameters, control, state)
    arm = to_float(wp.quat_rotate(q, to_double(vehicle.point)))
    motion.last_v[world] = point_velocity(world, vehicle.chassis, arm, state)
    control.element_torque[world, vehicle.chassis] = to_float(wp.quat_rotate(q, to_double(torque_b)))
