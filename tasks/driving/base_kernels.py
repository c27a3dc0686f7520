"""Device half of the driving tasks: where the vehicle is, what it is told, what it touches, where it is placed."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange

from ..framework.control_step_kernels import follow
from ..framework.frames_kernels import (
    ONE,
    TWO,
    heading_of,
    heading_quaternion,
    quat_product,
    rotate,
    tilt_to,
)
from .navigation_kernels import Navigator

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

UPSET = wp.constant(wp.float64(0.5))
"""Cosine of the angle at which a chassis is upset: 60 degrees."""


@wp.struct
class Car:
    """A vehicle, and what of it a task looks at."""

    chassis: int  # body
    shape: int  # of its box in contacts
    trailer_shapes: wp.array[int]  # of its trailers' boxes
    reference: wp.vec3d  # its point, in axes of the chassis [m]
    bodies: wp.array[int]  # (N,) all that it consists of
    start_x: wp.array[wp.vec3d]  # (N,) of its bodies, settled, the reference point above the origin [m]
    start_rot: wp.array[wp.quatd]  # (N,)
    force: wp.array2d[wp.vec3]  # (W, S) contact forces on shapes [N]
    input: wp.array2d[float]  # (W, 4) steering, throttle, brake, clutch
    throttle_alone: int  # 1: the pedal's action is throttle from end to end


@wp.struct
class Drive:
    """State of the running control step and episode."""

    physics_steps: wp.array[int]  # (W,) begun in this control step
    hit: wp.array[wp.bool]  # (W,) the chassis touched something in it
    difficulty: wp.array[float]  # (W,) of the episode


@wp.func
def plane(v: wp.vec3d) -> wp.vec2:
    """What is seen of a place from above."""
    return wp.vec2(float(v[0]), float(v[1]))


@wp.func
def point_of(world: int, car: Car, state: StateArrays) -> wp.vec3d:
    """The vehicle's point of reference [m]."""
    return state.body_x[world, car.chassis] + rotate(state.body_rot[world, car.chassis], car.reference)


@wp.func
def car_heading(world: int, car: Car, state: StateArrays) -> float:
    """The vehicle's heading [rad]."""
    return float(heading_of(state.body_rot[world, car.chassis]))


@wp.func
def motion_of(world: int, heading: float, car: Car, state: StateArrays) -> wp.vec3:
    """Speed ahead and to the left [m/s], yaw rate [rad/s]."""
    v = state.body_v[world, car.chassis]
    c = wp.cos(heading)
    s = wp.sin(heading)
    return wp.vec3(c * v[0] + s * v[1], c * v[1] - s * v[0], state.body_omega[world, car.chassis][2])


@wp.func
def tilt_of(world: int, car: Car, state: StateArrays) -> wp.vec2:
    """How far the axes ahead and to the left rise, as sines."""
    q = state.body_rot[world, car.chassis]
    return wp.vec2(float(TWO * (q[0] * q[2] - q[3] * q[1])), float(TWO * (q[1] * q[2] + q[3] * q[0])))


@wp.func
def is_upset(world: int, car: Car, state: StateArrays) -> bool:
    """Whether the chassis leans more than 60 degrees."""
    q = state.body_rot[world, car.chassis]
    return ONE - TWO * (q[0] * q[0] + q[1] * q[1]) < UPSET


@wp.func
def not_negative(value: float) -> float:
    """The value, or 0; NaN stays."""
    result = value
    if value < 0.0:
        result = 0.0
    return result


@wp.func
def touch(world: int, car: Car, drive: Drive):
    """Notice a touch of the physics step that is over."""
    force = car.force[world, car.shape]
    if force[0] != 0.0 or force[1] != 0.0 or force[2] != 0.0:
        drive.hit[world] = True
    for each in range(car.trailer_shapes.shape[0]):
        behind = car.force[world, car.trailer_shapes[each]]
        if behind[0] != 0.0 or behind[1] != 0.0 or behind[2] != 0.0:
            drive.hit[world] = True


@wp.func
def work_pedals(world: int, pedal: float, car: Car):
    """Throttle where positive, brake where negative; or throttle alone, none at -1."""
    if car.throttle_alone == 1:
        car.input[world, 1] = 0.5 * (pedal + 1.0)
        return
    car.input[world, 1] = not_negative(pedal)
    car.input[world, 2] = not_negative(-pedal)


@wp.func
def begin_physics(
    world: int, reach: wp.array[float], request: wp.array2d[float], action: wp.array2d[float], car: Car, drive: Drive
) -> int:  # fmt: skip
    """What comes before each physics step: the touch of the one before, and the action's way; steps begun before."""
    steps = drive.physics_steps[world]
    if steps > 0:
        touch(world, car, drive)
    drive.physics_steps[world] = steps + 1
    follow(world, reach, request, action)
    car.input[world, 0] = action[world, 0]
    return steps


@wp.func
def place_car(
    world: int, place: wp.vec3d, heading: float, turn: wp.quatd, car: Car, navigator: Navigator, state: StateArrays
):  # fmt: skip
    """Put the settled vehicle, at rest, on the ground below its point of reference; its heading is known then."""
    for index in range(car.bodies.shape[0]):
        body = car.bodies[index]
        state.body_x[world, body] = place + rotate(turn, car.start_x[index])
        state.body_rot[world, body] = quat_product(turn, car.start_rot[index])
        state.body_v[world, body] = wp.vec3()
        state.body_omega[world, body] = wp.vec3()
    if navigator.heading.shape[0] > 0:
        navigator.heading[world] = heading


@wp.kernel
def begin_drive(drive: Drive):
    """Clear the touches of the control step before."""
    world = wp.tid()
    drive.physics_steps[world] = 0
    drive.hit[world] = False


@wp.kernel
def drive_on(
    worlds: WorldRange,
    reach: wp.array[float], request: wp.array2d[float], action: wp.array2d[float], car: Car, drive: Drive
):  # fmt: skip
    """Before a physics step: steer and work the pedals."""
    world = worlds.first + wp.tid()
    begin_physics(world, reach, request, action, car, drive)
    work_pedals(world, action[world, 1], car)


@wp.kernel
def steer(action: wp.array2d[float], car: Car):
    """Steering and pedals."""
    world = wp.tid()
    car.input[world, 0] = action[world, 0]
    work_pedals(world, action[world, 1], car)


@wp.kernel
def finish_physics(car: Car, drive: Drive):
    """After a physics step: a touch may be over before the control step is."""
    touch(wp.tid(), car, drive)


@wp.kernel
def begin_drive_episode(mask: wp.array[wp.bool], level: wp.array[float], drive: Drive):
    """The difficulty stays as it is now for a whole episode."""
    world = wp.tid()
    if mask[world]:
        drive.difficulty[world] = level[world]
        drive.hit[world] = False


@wp.kernel
def place_cars(
    mask: wp.array[wp.bool], place: wp.array[wp.vec3d], heading: wp.array[wp.float64], normal: wp.array[wp.vec3d],
    car: Car, navigator: Navigator, state: StateArrays,
):  # fmt: skip
    """Place the vehicles of some worlds on ground of these normals."""
    world = wp.tid()
    if mask[world]:
        turn = quat_product(tilt_to(normal[world]), heading_quaternion(heading[world]))
        place_car(world, place[world], float(heading[world]), turn, car, navigator, state)


@wp.kernel
def measure_pose(car: Car, state: StateArrays, point: wp.array[wp.vec3d], heading: wp.array[float]):
    """Point of reference and heading."""
    world = wp.tid()
    point[world] = point_of(world, car, state)
    heading[world] = car_heading(world, car, state)


@wp.kernel
def measure_motion(car: Car, state: StateArrays, motion: wp.array[wp.vec3]):
    """Speeds and yaw rate."""
    world = wp.tid()
    motion[world] = motion_of(world, car_heading(world, car, state), car, state)


@wp.kernel
def measure_tilt(car: Car, state: StateArrays, tilt: wp.array[wp.vec2]):
    """Rise of the axes ahead and to the left."""
    world = wp.tid()
    tilt[world] = tilt_of(world, car, state)


@wp.kernel
def find_upset(car: Car, state: StateArrays, upset: wp.array[wp.bool]):
    """Whether the vehicle is turned over."""
    world = wp.tid()
    upset[world] = is_upset(world, car, state)
