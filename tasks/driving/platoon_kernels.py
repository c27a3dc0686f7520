"""Device half of a convoy of simulated vehicles: a driver takes the first along the path, policies drive the others.

Vehicles count from the head of the convoy. A follower's leaders are the vehicles ahead of it; where there are fewer
than it was trained with, the path's schedule goes on ahead of the first.
"""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange

from ..framework.control_step_kernels import follow as follow_request
from ..framework.frames_kernels import heading_quaternion, quat_product, rotate, to_heading
from ..framework.randomness_kernels import Draws
from .base_kernels import (
    Car,
    Drive,
    car_heading,
    is_upset,
    motion_of,
    not_negative,
    plane,
    point_of,
)
from .convoy_kernels import (
    APART,
    DURATION,
    LEADERS,
    Column,
    Follow,
    measure_leader,
    observe_leader,
    observe_truck,
    overlaps,
    time_of,
    write_follower_rewards,
)
from .navigation_kernels import Navigator
from .obstacles_kernels import Slots
from .routes_kernels import RouteTables, locate, route_at

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

CATCH_UP = wp.constant(0.5)
"""Speed that a driver adds per metre that it is behind its schedule [1/s]."""
HASTE = wp.constant(3.0)
"""The most that it adds [m/s]."""


@wp.struct
class Platoon:
    """Vehicles of a convoy, V in each world."""

    leading: int  # the first ones, which drivers take along the path; policies drive the N others
    chassis: wp.array[int]  # (V,) bodies
    shape: wp.array[int]  # (V,) of their boxes in contacts
    reference: wp.vec3d  # of all, in axes of the chassis [m]
    vehicle_of: wp.array[int]  # (B,) of a body; -1: of none
    start_x: wp.array[wp.vec3d]  # (B,) of bodies, settled, the reference point of their vehicle above the origin [m]
    start_rot: wp.array[wp.quatd]  # (B,)
    force: wp.array2d[wp.vec3]  # (W, S) contact forces on shapes [N]
    input: wp.array3d[float]  # (W, V, 4) steering, throttle, brake, clutch
    hit: wp.array2d[wp.bool]  # (W, V) the chassis touched something in this control step
    deviation: wp.array2d[float]  # (W, V) mean distance from the path, sideways [m]


@wp.func
def car_at(vehicle: int, platoon: Platoon) -> Car:
    """One of the vehicles, for what is asked of a single one; its inputs are the convoy's."""
    car = Car()
    car.chassis = platoon.chassis[vehicle]
    car.shape = platoon.shape[vehicle]
    car.reference = platoon.reference
    return car


@wp.func
def scheduled(world: int, vehicle: int, time: float, platoon: Platoon, routes: RouteTables, follow: Follow) -> float:
    """Length along the path where a vehicle should be [m]; negative ones are ahead of the first."""
    gone = time / DURATION
    places = float(platoon.chassis.shape[0] - 2 - vehicle)
    share = follow.begun[world] + APART * places + gone * gone
    return share * routes.length[int(follow.route[world])]


@wp.func
def scheduled_speed(world: int, time: float, routes: RouteTables, follow: Follow) -> float:
    """Speed of the schedule [m/s]."""
    return 2.0 * time / (DURATION * DURATION) * routes.length[int(follow.route[world])]


@wp.func
def vehicle_at(world: int, vehicle: int, platoon: Platoon, state: StateArrays) -> wp.vec3:
    """Place [m] and heading [rad] of a vehicle."""
    car = car_at(vehicle, platoon)
    place = plane(point_of(world, car, state))
    return wp.vec3(place[0], place[1], car_heading(world, car, state))


@wp.func
def ahead_at(
    world: int, vehicle: int, time: float, platoon: Platoon, state: StateArrays, routes: RouteTables, follow: Follow
) -> wp.vec3:
    """Place and heading of a vehicle, or of the schedule ahead of the first."""
    if vehicle >= 0:
        return vehicle_at(world, vehicle, platoon, state)
    return route_at(int(follow.route[world]), scheduled(world, vehicle, time, platoon, routes, follow), routes)


@wp.func
def forward_speed_of(world: int, vehicle: int, platoon: Platoon, state: StateArrays) -> float:
    """Speed ahead of a vehicle [m/s]."""
    car = car_at(vehicle, platoon)
    return motion_of(world, car_heading(world, car, state), car, state)[0]


@wp.func
def touches_from(
    world: int, vehicle: int, first: int, end: int, column: Column, platoon: Platoon, state: StateArrays
) -> bool:
    """Whether a vehicle is in another one, of those from `first` to before `end`."""
    own = vehicle_at(world, vehicle, platoon, state)
    touching = bool(False)
    for other in range(first, end):
        if other != vehicle:
            at = vehicle_at(world, other, platoon, state)
            touching = touching or overlaps(wp.vec2(own[0], own[1]), own[2], at, column)
    return touching


@wp.func
def behind_vehicle(world: int, vehicle: int, platoon: Platoon, state: StateArrays) -> wp.vec2:
    """From a vehicle to the one ahead, in the axes of that [m]."""
    leader = vehicle_at(world, vehicle - 1, platoon, state)
    own = vehicle_at(world, vehicle, platoon, state)
    return to_heading(wp.vec2(leader[0] - own[0], leader[1] - own[1]), leader[2])


@wp.func
def notice_touches(world: int, platoon: Platoon):
    """Notice touches of the physics step that is over."""
    for vehicle in range(platoon.shape.shape[0]):
        force = platoon.force[world, platoon.shape[vehicle]]
        if force[0] != 0.0 or force[1] != 0.0 or force[2] != 0.0:
            platoon.hit[world, vehicle] = True


@wp.func
def work_inputs(world: int, action: wp.array2d[float], platoon: Platoon):
    """Steering and pedals of the vehicles that policies drive."""
    for vehicle in range(platoon.leading, platoon.chassis.shape[0]):
        first = 2 * (vehicle - platoon.leading)
        pedal = action[world, first + 1]
        platoon.input[world, vehicle, 0] = action[world, first]
        platoon.input[world, vehicle, 1] = not_negative(pedal)
        platoon.input[world, vehicle, 2] = not_negative(-pedal)


@wp.kernel
def drive_platoon(
    worlds: WorldRange,
    reach: wp.array[float], request: wp.array2d[float], action: wp.array2d[float], drive: Drive, platoon: Platoon
):  # fmt: skip
    """Before a physics step: touches of the one before, the actions' way, steering and pedals."""
    world = worlds.first + wp.tid()
    if drive.physics_steps[world] > 0:
        notice_touches(world, platoon)
    drive.physics_steps[world] = drive.physics_steps[world] + 1
    follow_request(world, reach, request, action)
    work_inputs(world, action, platoon)


@wp.kernel
def steer_platoon(action: wp.array2d[float], platoon: Platoon):
    """Steering and pedals, (W, N * 2)."""
    work_inputs(wp.tid(), action, platoon)


@wp.kernel
def begin_platoon(platoon: Platoon):
    """Clear the touches of the control step before."""
    world = wp.tid()
    for vehicle in range(platoon.shape.shape[0]):
        platoon.hit[world, vehicle] = False


@wp.kernel
def notice_platoon(platoon: Platoon):
    """After a physics step: a touch may be over before the control step is."""
    notice_touches(wp.tid(), platoon)


@wp.kernel
def finish_platoon(
    column: Column, state: StateArrays, routes: RouteTables, follow: Follow, platoon: Platoon
):  # fmt: skip
    """After a control step: the last touch, and each vehicle's distance from the path."""
    world = wp.tid()
    notice_touches(world, platoon)
    for vehicle in range(platoon.chassis.shape[0]):
        place = plane(point_of(world, car_at(vehicle, platoon), state))
        # Beside it: those at the head go on straight beyond its end
        distance = wp.abs(locate(int(follow.route[world]), place, routes)[1])
        mean = platoon.deviation[world, vehicle]
        steps = float(follow.steps[world] + wp.int64(1))
        platoon.deviation[world, vehicle] = mean + (distance - mean) / steps


@wp.kernel
def start_platoon(
    mask: wp.array[wp.bool], navigator: Navigator, state: StateArrays, routes: RouteTables, follow: Follow,
    platoon: Platoon,
):  # fmt: skip
    """Every vehicle, settled and at rest, where it should be at the beginning."""
    world = wp.tid()
    if not mask[world]:
        return
    route = int(follow.route[world])
    for body in range(platoon.vehicle_of.shape[0]):
        vehicle = platoon.vehicle_of[body]
        if vehicle >= 0:
            at = route_at(route, scheduled(world, vehicle, 0.0, platoon, routes, follow), routes)
            turn = heading_quaternion(wp.float64(at[2]))
            place = wp.vec3d(wp.float64(at[0]), wp.float64(at[1]), wp.float64(0.0))
            state.body_x[world, body] = place + rotate(turn, platoon.start_x[body])
            state.body_rot[world, body] = quat_product(turn, platoon.start_rot[body])
            state.body_v[world, body] = wp.vec3()
            state.body_omega[world, body] = wp.vec3()
    for vehicle in range(platoon.chassis.shape[0]):
        platoon.deviation[world, vehicle] = 0.0
        platoon.hit[world, vehicle] = False
    if navigator.heading.shape[0] > 0:
        last = platoon.chassis.shape[0] - 1
        navigator.heading[world] = route_at(route, scheduled(world, last, 0.0, platoon, routes, follow), routes)[2]


@wp.kernel
def begin_driver(mask: wp.array[wp.bool], follow: Follow, path: wp.array[int], segment: wp.array[int]):
    """A driver's path, and no place on it known yet."""
    world = wp.tid()
    if mask[world]:
        path[world] = int(follow.route[world])
        segment[world] = -1


@wp.kernel
def pace_driver(
    vehicle: int, column: Column, state: StateArrays, routes: RouteTables, follow: Follow, platoon: Platoon,
    target: wp.array[float],
):  # fmt: skip
    """Speed of a driver for the coming control step: that of the schedule, and more where the vehicle is late [m/s]."""
    world = wp.tid()
    time = time_of(world, column, follow) + column.control_dt
    place = plane(point_of(world, car_at(vehicle, platoon), state))
    late = scheduled(world, vehicle, time, platoon, routes, follow) - locate(int(follow.route[world]), place, routes)[0]
    speed = scheduled_speed(world, time, routes, follow)
    target[world] = wp.max(speed + wp.min(CATCH_UP * late, HASTE), 0.0)


@wp.kernel
def observe_platoon(
    column: Column, state: StateArrays, action: wp.array2d[float], routes: RouteTables, follow: Follow, slots: Slots,
    platoon: Platoon, policy: wp.array2d[float],
):  # fmt: skip
    """What each follower sees of those ahead and of itself: (W * N, 34)."""
    world, agent = wp.tid()
    vehicle = platoon.leading + agent
    row = world * (platoon.chassis.shape[0] - platoon.leading) + agent
    time = time_of(world, column, follow)
    own = vehicle_at(world, vehicle, platoon, state)
    for i in range(LEADERS):
        leader = ahead_at(world, vehicle - 1 - i, time, platoon, state, routes, follow)
        observe_leader(row, i, leader, wp.vec2(own[0], own[1]), own[2], policy)
    speed = forward_speed_of(world, vehicle - 1, platoon, state)
    observe_truck(row, world, speed, column, car_at(vehicle, platoon), state, action, slots, policy)


@wp.kernel
def measure_platoon(
    column: Column, state: StateArrays, navigator: Navigator, draws: Draws, platoon: Platoon, policy: wp.array2d[float]
):  # fmt: skip
    """What a single follower measures: place of the one ahead, heading and speed, the other's speed: (W, 6)."""
    world = wp.tid()
    ahead = platoon.chassis.shape[0] - 2
    speed = forward_speed_of(world, ahead, platoon, state)
    measure_leader(world, vehicle_at(world, ahead, platoon, state), speed, column, navigator, draws, policy)


@wp.kernel
def compute_platoon_rewards(column: Column, state: StateArrays, platoon: Platoon, terms: wp.array2d[float]):
    """Following, failure and, if it counts, the difference in speed: (T, W * N)."""
    world, agent = wp.tid()
    vehicle = platoon.leading + agent
    row = world * (platoon.chassis.shape[0] - platoon.leading) + agent
    away = behind_vehicle(world, vehicle, platoon, state)
    vehicles = platoon.chassis.shape[0]
    collided = platoon.hit[world, vehicle] and not touches_from(
        world, vehicle, vehicle + 1, vehicles, column, platoon, state
    )  # fmt: skip
    failed = collided or is_upset(world, car_at(vehicle, platoon), state) or wp.length(away) > column.lost_distance
    failed = failed or touches_from(world, vehicle, 0, vehicle, column, platoon, state)
    ahead = forward_speed_of(world, vehicle - 1, platoon, state)
    write_follower_rewards(row, away, failed, ahead, forward_speed_of(world, vehicle, platoon, state), column, terms)


@wp.kernel
def end_platoon(column: Column, state: StateArrays, follow: Follow, platoon: Platoon, ends: wp.array2d[wp.bool]):
    """Collision, bumped, lost, upset, goal: (R, W * N). Who is struck from behind goes on."""
    world, agent = wp.tid()
    vehicle = platoon.leading + agent
    vehicles = platoon.chassis.shape[0]
    row = world * (vehicles - platoon.leading) + agent
    gone = time_of(world, column, follow) / DURATION
    bumped = touches_from(world, vehicle, 0, vehicle, column, platoon, state)
    struck = touches_from(world, vehicle, vehicle + 1, vehicles, column, platoon, state)
    collided = platoon.hit[world, vehicle] and not bumped and not struck
    ends[0, row] = collided
    ends[1, row] = bumped
    ends[2, row] = wp.length(behind_vehicle(world, vehicle, platoon, state)) > column.lost_distance
    ends[3, row] = is_upset(world, car_at(vehicle, platoon), state)
    ends[4, row] = follow.begun[world] + gone * gone > 0.999 and not collided


@wp.kernel
def write_platoon_metrics(
    column: Column, state: StateArrays, platoon: Platoon, metrics: wp.array2d[float]
):  # fmt: skip
    """Of each follower: distance from its leader, mean distance from the path, and whether an obstacle was hit.

    Args: column, state, platoon; rows (3, W * N).
    """
    world, agent = wp.tid()
    vehicle = platoon.leading + agent
    other = touches_from(world, vehicle, 0, platoon.chassis.shape[0], column, platoon, state)
    row = world * (platoon.chassis.shape[0] - platoon.leading) + agent
    metrics[0, row] = wp.length(behind_vehicle(world, vehicle, platoon, state))
    metrics[1, row] = platoon.deviation[world, vehicle]
    metrics[2, row] = float(platoon.hit[world, vehicle] and not other)
