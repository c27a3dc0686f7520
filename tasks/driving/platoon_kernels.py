"""Device half of a convoy of simulated vehicles: a driver takes the first along the path, policies drive the others.

Vehicles count from the head of the convoy. A follower's leaders are the vehicles ahead of it; where there are fewer
than it was trained with, the path's schedule goes on ahead of the first.
"""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange

from ..framework.control_step_kernels import follow as follow_request
from ..framework.frames_kernels import heading_quaternion, quat_product, rotate
from .base_kernels import Drive, not_negative, plane, point_of
from .convoy_kernels import (
    Column,
    Follow,
    Platoon,
    car_at,
    mean_with,
    scheduled,
    scheduled_speed,
    time_of,
    touches_from,
)
from .navigation_kernels import Navigator
from .routes_kernels import RouteTables, locate, route_at

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

CATCH_UP = wp.constant(0.5)
"""Speed that a driver adds per metre that it is behind its schedule [1/s]."""
HASTE = wp.constant(3.0)
"""The most that it adds [m/s]."""


@wp.struct
class Touches:
    """Touches of followers, where they drive on after one; of no length where they do not."""

    count: wp.array3d[int]  # (W, N, 2) in the episode: of obstacles, and of vehicles ahead
    last: wp.array3d[wp.bool]  # (W, N, 2) whether there was one at the end of the last control step


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
        platoon.deviation[world, vehicle] = mean_with(distance, world, vehicle, follow, platoon)


@wp.kernel
def start_platoon(
    mask: wp.array[wp.bool], state: StateArrays, routes: RouteTables, follow: Follow, platoon: Platoon, touches: Touches
):
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
    for agent in range(touches.count.shape[1]):
        for kind in range(2):
            touches.count[world, agent, kind] = 0
            touches.last[world, agent, kind] = False


@wp.kernel
def start_heading(
    mask: wp.array[wp.bool], agent: int, navigator: Navigator, routes: RouteTables, follow: Follow, platoon: Platoon
):
    """The heading of a follower's instruments, where it should be at the beginning."""
    world = wp.tid()
    if mask[world]:
        arc = scheduled(world, platoon.leading + agent, 0.0, platoon, routes, follow)
        navigator.heading[world] = route_at(int(follow.route[world]), arc, routes)[2]


@wp.kernel
def count_touches(
    column: Column, state: StateArrays, routes: RouteTables, follow: Follow, platoon: Platoon, touches: Touches
):
    """After a control step: count the touches of followers that began in it."""
    world, agent = wp.tid()
    vehicle = platoon.leading + agent
    pushed = touches_from(world, vehicle, 0, platoon.chassis.shape[0], column, platoon, state, routes, follow)
    bumped = touches_from(world, vehicle, platoon.first, vehicle, column, platoon, state, routes, follow)
    for kind in range(2):
        now = platoon.hit[world, vehicle] and not pushed
        if kind == 1:
            now = bumped
        if now and not touches.last[world, agent, kind]:
            touches.count[world, agent, kind] = touches.count[world, agent, kind] + 1
        touches.last[world, agent, kind] = now


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
