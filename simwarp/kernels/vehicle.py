"""A vehicle's inputs: steering, brakes, drag and powertrain, before each step."""

import warp as wp

from simwarp.kernels.powertrain import Powertrain, PowertrainState, run_powertrain
from simwarp.kernels.spatial import to_double, to_float
from simwarp.kernels.tables import ControlArrays, Parameters, StateArrays

wp.set_module_options({"enable_backward": False})


@wp.struct
class VehicleTables:
    """Where a vehicle's inputs act, shared by all worlds."""

    chassis: int
    drag: float  # 0.5 · density · coefficient · area [kg/m]
    steering_dof: wp.array[int]
    steering_travel: wp.array[float]  # at full input [rad or m]
    brake_dof: wp.array[int]
    brake_torque: wp.array[float]  # at full braking [N·m]


@wp.kernel
def run_vehicle(
    # inputs
    dt: float,
    vehicle: VehicleTables,
    powertrain: Powertrain,
    vehicle_input: wp.array2d[float],  # (W, 4): steering -1..1 (left +), throttle, braking, clutch 0..1
    parameters: Parameters,
    state: StateArrays,
    # outputs
    memory: PowertrainState,
    control: ControlArrays,
):
    """Turns the driver's inputs into targets, bounds and torques."""
    world = wp.tid()
    steering = wp.clamp(vehicle_input[world, 0], -1.0, 1.0)
    throttle = wp.clamp(vehicle_input[world, 1], 0.0, 1.0)
    braking = wp.clamp(vehicle_input[world, 2], 0.0, 1.0)
    clutch = wp.clamp(vehicle_input[world, 3], 0.0, 1.0)
    for index in range(vehicle.steering_dof.shape[0]):
        control.joint_target_q[world, vehicle.steering_dof[index]] = steering * vehicle.steering_travel[index]
    for index in range(vehicle.brake_dof.shape[0]):
        parameters.joint_friction[world, vehicle.brake_dof[index]] = braking * vehicle.brake_torque[index]
    v = state.body_v[world, vehicle.chassis]
    control.element_force[world, vehicle.chassis] = (-vehicle.drag * wp.length(v)) * v
    q = state.body_rot[world, vehicle.chassis]
    torque_b = run_powertrain(world, dt, throttle, clutch, powertrain, memory, parameters, control, state)
    control.element_torque[world, vehicle.chassis] = to_float(wp.quat_rotate(q, to_double(torque_b)))
