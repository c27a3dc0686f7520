"""Device half of the convoy: its worlds, its leaders, observations, rewards and ends."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange

from ..framework.frames_kernels import heading_quaternion, to_heading
from ..framework.randomness_kernels import Draws, episode_key, uniform_at
from .base_kernels import (
    Car,
    Drive,
    begin_physics,
    car_heading,
    is_upset,
    motion_of,
    place_car,
    plane,
    point_of,
    tilt_of,
    work_pedals,
)
from .navigation_kernels import Navigator, estimated_place, estimated_speed
from .obstacles_kernels import SlotArrays, Slots, drawn_thing, fill_slot
from .ranging_kernels import range_to
from .routes_kernels import RouteTables, route_at, route_distance

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

LEADERS = wp.constant(3)
BESIDE = wp.constant(8)
"""Obstacles beside the path; others stand where the path was made to pass them."""
APART = wp.constant(0.05)
"""Distance of the vehicles along the path, as a share of it."""
DURATION = wp.constant(60.0)
"""Time in which a leader that starts at the beginning comes to the end, ever faster [s]."""
CLEAR = wp.constant(1.5)
"""Least distance of what stands beside the path from a vehicle on it [m]."""
LENGTHS = wp.constant(20.0)
"""By which lengths are divided in observations [m]."""
SPEED = wp.constant(10.0)
"""By which speeds are divided [m/s]."""
PI = wp.constant(3.141592653589793)


@wp.struct
class Column:
    """Numbers of the task."""

    control_dt: float  # [s]
    dt: float  # [s]
    frame_steps: int  # physics steps between two images; 0: there is no camera
    latest_start: float
    own_half: wp.vec2  # lengths of the truck [m]
    leader_half: wp.vec2
    in_world_axes: int  # 1: the leader's place is observed in axes of the world
    raw: int  # 1: it is observed in metres, the heading as an angle, by five numbers
    cone: float  # [rad]
    near: float  # [m]
    softness: float  # [m]
    following_weight: float
    failure_weight: float
    speed_weight: float
    lost_distance: float  # [m]
    drive_on: int  # 1: a touch ends nothing
    map_half: wp.vec2  # half lengths of the rectangle in which scattered obstacles stand [m]
    reach: float  # of the rays [m]
    direction: wp.array[wp.vec2]  # (rays,)
    large: wp.array2d[wp.vec3]  # (K, L) x, y and radius of what generated paths pass [m]
    path: wp.array[wp.uint64]  # streams of the draws
    begin: wp.array[wp.uint64]
    sides: wp.array[wp.uint64]
    gaps: wp.array[wp.uint64]
    headings: wp.array[wp.uint64]
    scatter: wp.array[wp.uint64]
    ghost: int  # first leader among the instances of the scene
    shown_x: wp.array2d[wp.vec3d]  # (W, I) places of the scene; of no length: there is none
    shown_rot: wp.array2d[wp.quat]


@wp.struct
class Follow:
    """State of the running episode."""

    route: wp.array[wp.int64]  # (W,)
    begun: wp.array[float]  # (W,) where the nearest leader begins, as a share of the path
    steps: wp.array[wp.int64]  # (W,) control steps of the episode


@wp.struct
class Platoon:
    """Simulated vehicles of a convoy, V in each world: the truck alone behind ghosts, or leaders too."""

    leading: int  # the first ones, which drivers take along the path; policies drive the N others
    first: int  # vehicle that a follower may bump into; negative ones are ghosts
    chassis: wp.array[int]  # (V,) bodies
    shape: wp.array[int]  # (V,) of their boxes in contacts
    reference: wp.vec3d  # of all, in axes of the chassis [m]
    vehicle_of: wp.array[int]  # (B,) of a body; -1: of none
    start_x: wp.array[wp.vec3d]  # (B,) of bodies, settled, the reference point of their vehicle above the origin [m]
    start_rot: wp.array[wp.quatd]  # (B,)
    force: wp.array2d[wp.vec3]  # (W, S) contact forces on shapes [N]
    input: wp.array3d[float]  # (W, V, 4) steering, throttle, brake, clutch
    hit: wp.array2d[wp.bool]  # (W, V) the chassis touched something in this control step
    deviation: wp.array2d[float]  # (W, V) mean distance from the path [m]


@wp.func
def time_of(world: int, column: Column, follow: Follow) -> float:
    """Time since the episode began, at the end of the last control step [s]."""
    return float(follow.steps[world]) * column.control_dt


@wp.func
def length_at(world: int, places: int, time: float, routes: RouteTables, follow: Follow) -> float:
    """Length along the path of the schedule, so many places ahead of the vehicle before the last one [m]."""
    gone = time / DURATION
    share = follow.begun[world] + APART * float(places) + gone * gone
    return share * routes.length[int(follow.route[world])]


@wp.func
def leader_at(world: int, index: int, time: float, routes: RouteTables, follow: Follow) -> wp.vec3:
    """Place and heading of a ghost; the nearest is the first."""
    return route_at(int(follow.route[world]), length_at(world, index, time, routes, follow), routes)


@wp.func
def scheduled(world: int, vehicle: int, time: float, platoon: Platoon, routes: RouteTables, follow: Follow) -> float:
    """Length along the path where a vehicle should be [m]; negative ones are ahead of the first."""
    return length_at(world, platoon.chassis.shape[0] - 2 - vehicle, time, routes, follow)


@wp.func
def scheduled_speed(world: int, time: float, routes: RouteTables, follow: Follow) -> float:
    """Speed of the schedule, and of ghosts [m/s]."""
    return 2.0 * time / (DURATION * DURATION) * routes.length[int(follow.route[world])]


@wp.func
def show_leaders(world: int, time: float, column: Column, routes: RouteTables, follow: Follow):
    """Write the leaders' places into the scene, if there is one."""
    if column.shown_x.shape[0] == 0:
        return
    for i in range(LEADERS):
        at = leader_at(world, i, time, routes, follow)
        place = column.shown_x[world, column.ghost + i]
        place[0] = wp.float64(at[0])
        place[1] = wp.float64(at[1])
        column.shown_x[world, column.ghost + i] = place
        half = 0.5 * at[2]
        column.shown_rot[world, column.ghost + i] = wp.quat(0.0, 0.0, wp.sin(half), wp.cos(half))


@wp.func
def is_corner_inside(away: wp.vec2, turn: float, half: wp.vec2, around: wp.vec2) -> bool:
    """Whether a corner of a rectangle lies within another one, which is about the origin.

    Args: middle of the first in axes of the second [m], its turn against it [rad], half lengths of both.
    """
    c = wp.cos(turn)
    s = wp.sin(turn)
    inside = bool(False)
    for i in range(4):
        x = half[0] * float(1 - 2 * (i // 2))
        y = half[1] * float(1 - 2 * (i % 2))
        place = wp.vec2(away[0] + c * x - s * y, away[1] + s * x + c * y)
        inside = inside or (wp.abs(place[0]) < around[0] and wp.abs(place[1]) < around[1])
    return inside


@wp.func
def overlaps(place: wp.vec2, heading: float, leader: wp.vec3, column: Column) -> bool:
    """Whether a corner of the truck is within a leader, or the other way round."""
    away = wp.vec2(leader[0], leader[1]) - place
    turn = leader[2] - heading
    touching = is_corner_inside(to_heading(away, heading), turn, column.leader_half, column.own_half)
    return touching or is_corner_inside(to_heading(-away, leader[2]), -turn, column.own_half, column.leader_half)


@wp.func
def car_at(vehicle: int, platoon: Platoon) -> Car:
    """One of the vehicles, for what is asked of a single one; its inputs are the convoy's."""
    car = Car()
    car.chassis = platoon.chassis[vehicle]
    car.shape = platoon.shape[vehicle]
    car.reference = platoon.reference
    return car


@wp.func
def vehicle_at(
    world: int, vehicle: int, time: float, platoon: Platoon, state: StateArrays, routes: RouteTables, follow: Follow
) -> wp.vec3:
    """Place [m] and heading [rad] of a vehicle, or of the schedule ahead of the first."""
    if vehicle < 0:
        return route_at(int(follow.route[world]), scheduled(world, vehicle, time, platoon, routes, follow), routes)
    car = car_at(vehicle, platoon)
    place = plane(point_of(world, car, state))
    return wp.vec3(place[0], place[1], car_heading(world, car, state))


@wp.func
def speed_of(
    world: int, vehicle: int, time: float, platoon: Platoon, state: StateArrays, routes: RouteTables, follow: Follow
) -> float:
    """Speed ahead of a vehicle, or of the schedule ahead of the first [m/s]."""
    if vehicle < 0:
        return scheduled_speed(world, time, routes, follow)
    car = car_at(vehicle, platoon)
    return motion_of(world, car_heading(world, car, state), car, state)[0]


@wp.func
def touches_from(
    world: int, vehicle: int, first: int, end: int, column: Column, platoon: Platoon, state: StateArrays,
    routes: RouteTables, follow: Follow,
) -> bool:  # fmt: skip
    """Whether a vehicle is in another one, of those from `first` to before `end`."""
    time = time_of(world, column, follow)
    own = vehicle_at(world, vehicle, time, platoon, state, routes, follow)
    touching = bool(False)
    for other in range(first, end):
        if other != vehicle:
            at = vehicle_at(world, other, time, platoon, state, routes, follow)
            touching = touching or overlaps(wp.vec2(own[0], own[1]), own[2], at, column)
    return touching


@wp.func
def behind_vehicle(
    world: int, vehicle: int, column: Column, platoon: Platoon, state: StateArrays, routes: RouteTables, follow: Follow
) -> wp.vec2:
    """From a vehicle to the one ahead, in the axes of that [m]."""
    time = time_of(world, column, follow)
    leader = vehicle_at(world, vehicle - 1, time, platoon, state, routes, follow)
    own = vehicle_at(world, vehicle, time, platoon, state, routes, follow)
    return to_heading(wp.vec2(leader[0] - own[0], leader[1] - own[1]), leader[2])


@wp.func
def row_of(world: int, agent: int, platoon: Platoon) -> int:
    """Row of an agent among those of all worlds."""
    return world * (platoon.chassis.shape[0] - platoon.leading) + agent


@wp.func
def mean_with(distance: float, world: int, vehicle: int, follow: Follow, platoon: Platoon) -> float:
    """The mean distance of a vehicle from the path, with that of one more control step [m]."""
    mean = platoon.deviation[world, vehicle]
    return mean + (distance - mean) / float(follow.steps[world] + wp.int64(1))


@wp.kernel
def draw_path(mask: wp.array[wp.bool], column: Column, draws: Draws, routes: RouteTables, follow: Follow):
    """Path and start."""
    world = wp.tid()
    if mask[world]:
        paths = float(routes.length.shape[0])
        follow.route[world] = wp.int64(int(uniform_at(episode_key(column.path, world, draws), 0, 0.0, paths)))
        later = uniform_at(episode_key(column.begin, world, draws), 0, 0.0, column.latest_start)
        follow.begun[world] = APART + later
    show_leaders(world, time_of(world, column, follow), column, routes, follow)


@wp.kernel
def draw_roadside(
    mask: wp.array[wp.bool], column: Column, draws: Draws, routes: RouteTables, follow: Follow, slots: Slots,
    model: SlotArrays, scene: SlotArrays,
):  # fmt: skip
    """Things at equal steps along the path, to either side, so far away that it stays free; large ones between; others
    anywhere.
    """
    world, slot = wp.tid()
    if not mask[world]:
        return
    route = int(follow.route[world])
    thing = drawn_thing(world, slot, slots, draws)
    place = wp.vec2()
    clear = float(0.5)
    if slot < BESIDE:
        reach = thing.scale * slots.reach[thing.kind]
        share = (float(slot) + 1.0) / (float(BESIDE) + 1.0)
        at = route_at(route, share * routes.length[route], routes)
        side = float(1.0)
        if uniform_at(episode_key(column.sides, world, draws), slot, 0.0, 1.0) < 0.5:
            side = -1.0
        gap = uniform_at(episode_key(column.gaps, world, draws), slot, 0.0, 2.0)
        aside = side * (reach + column.leader_half[1] + CLEAR + gap)
        place = wp.vec2(at[0] - aside * wp.sin(at[2]), at[1] + aside * wp.cos(at[2]))
    elif slot >= BESIDE + column.large.shape[1]:
        key = episode_key(column.scatter, world, draws)
        x = uniform_at(key, 2 * slot, -column.map_half[0], column.map_half[0])
        place = wp.vec2(x, uniform_at(key, 2 * slot + 1, -column.map_half[1], column.map_half[1]))
        clear = CLEAR
    else:
        large = column.large[route, slot - BESIDE]
        thing.kind = 0
        thing.scale = large[2] / slots.reach[0]
        place = wp.vec2(large[0], large[1])
    needed = thing.scale * slots.reach[thing.kind] + column.leader_half[1] + clear
    free = route_distance(route, place, routes) > needed
    sunk = -0.1 * (thing.scale * slots.tallness[thing.kind])
    heading = uniform_at(episode_key(column.headings, world, draws), slot, -PI, PI)
    fill_slot(world, slot, place, sunk, heading, thing, free, slots, model, scene)


@wp.kernel
def start_following(
    mask: wp.array[wp.bool], column: Column, car: Car, navigator: Navigator, state: StateArrays, routes: RouteTables,
    follow: Follow, platoon: Platoon,
):  # fmt: skip
    """On the path behind the leaders."""
    world = wp.tid()
    time = time_of(world, column, follow)
    if mask[world]:
        route = int(follow.route[world])
        at = route_at(route, (follow.begun[world] - APART) * routes.length[route], routes)
        place = wp.vec3d(wp.float64(at[0]), wp.float64(at[1]), wp.float64(0.0))
        place_car(world, place, at[2], heading_quaternion(wp.float64(at[2])), car, navigator, state)
        platoon.deviation[world, 0] = 0.0
        time = 0.0
    show_leaders(world, time, column, routes, follow)


@wp.func
def aim_leaders(world: int, begun: int, column: Column, routes: RouteTables, follow: Follow):
    """Show the leaders where they are when the image of the coming physics step is taken, if there is one."""
    if column.frame_steps > 0:
        if (begun + 1) % column.frame_steps == 0:
            time = time_of(world, column, follow) + float(begun + 1) * column.dt
            show_leaders(world, time, column, routes, follow)


@wp.kernel
def drive_on_behind(
    worlds: WorldRange,
    column: Column, routes: RouteTables, follow: Follow, reach: wp.array[float], request: wp.array2d[float],
    action: wp.array2d[float], car: Car, drive: Drive,
):  # fmt: skip
    """Before a physics step: steer, work the pedals, and move the leaders for an image."""
    world = worlds.first + wp.tid()
    begun = begin_physics(world, reach, request, action, car, drive)
    work_pedals(world, action[world, 1], car)
    aim_leaders(world, begun, column, routes, follow)


@wp.kernel
def aim_next(ahead: int, column: Column, routes: RouteTables, follow: Follow, drive: Drive):
    """Move the leaders for an image, after so many physics steps more than are counted."""
    world = wp.tid()
    begun = drive.physics_steps[world] + ahead
    drive.physics_steps[world] = begun
    aim_leaders(world, begun, column, routes, follow)


@wp.kernel
def show_now(time: wp.array[float], column: Column, routes: RouteTables, follow: Follow):
    """Show the leaders where they are at a time."""
    world = wp.tid()
    show_leaders(world, time[world], column, routes, follow)


@wp.kernel
def place_leaders(time: wp.array[float], routes: RouteTables, follow: Follow, places: wp.array2d[wp.vec3]):
    """Places and headings of the leaders at a time."""
    world = wp.tid()
    for i in range(LEADERS):
        places[world, i] = leader_at(world, i, time[world], routes, follow)


@wp.kernel
def follow_path(car: Car, state: StateArrays, routes: RouteTables, follow: Follow, platoon: Platoon):
    """Store the truck's distance from the path."""
    world = wp.tid()
    distance = route_distance(int(follow.route[world]), plane(point_of(world, car, state)), routes)
    platoon.deviation[world, 0] = mean_with(distance, world, 0, follow, platoon)


@wp.func
def measure_leader(
    world: int, leader: wp.vec3, speed: float, column: Column, navigator: Navigator, draws: Draws,
    policy: wp.array2d[float],
):  # fmt: skip
    """Write where a leader is, heading and speed as the instruments tell them, the leader's speed."""
    heading = navigator.heading[world]
    seen = wp.vec2(leader[0], leader[1]) - estimated_place(world, navigator, draws)
    if column.in_world_axes == 0:
        seen = to_heading(seen, heading)
    if column.raw == 1:
        policy[world, 0] = seen[0]
        policy[world, 1] = seen[1]
        policy[world, 2] = wp.atan2(wp.sin(heading), wp.cos(heading))
        policy[world, 3] = estimated_speed(world, navigator, draws)
        policy[world, 4] = speed
        return
    policy[world, 0] = seen[0] / LENGTHS
    policy[world, 1] = seen[1] / LENGTHS
    policy[world, 2] = wp.sin(heading)
    policy[world, 3] = wp.cos(heading)
    policy[world, 4] = estimated_speed(world, navigator, draws) / SPEED
    policy[world, 5] = speed / SPEED


@wp.kernel
def measure_follower(
    agent: int, column: Column, state: StateArrays, navigator: Navigator, draws: Draws, routes: RouteTables,
    follow: Follow, platoon: Platoon, policy: wp.array2d[float],
):  # fmt: skip
    """What a follower measures: place of the one ahead, heading and speed, the other's speed: (W, 6 or 5)."""
    world = wp.tid()
    ahead = platoon.leading + agent - 1
    time = time_of(world, column, follow)
    leader = vehicle_at(world, ahead, time, platoon, state, routes, follow)
    speed = speed_of(world, ahead, time, platoon, state, routes, follow)
    measure_leader(world, leader, speed, column, navigator, draws, policy)


@wp.func
def observe_leader(row: int, i: int, leader: wp.vec3, place: wp.vec2, heading: float, policy: wp.array2d[float]):
    """Write where a leader is; of the first one its heading too."""
    away = to_heading(wp.vec2(leader[0], leader[1]) - place, heading)
    policy[row, 2 * i] = away[0] / LENGTHS
    policy[row, 2 * i + 1] = away[1] / LENGTHS
    if i == 0:
        turn = leader[2] - heading
        policy[row, 6] = wp.sin(turn)
        policy[row, 7] = wp.cos(turn)
        policy[row, 9] = wp.length(away) / LENGTHS


@wp.func
def observe_truck(
    row: int, world: int, speed: float, column: Column, car: Car, state: StateArrays, action: wp.array2d[float],
    slots: Slots, policy: wp.array2d[float],
):  # fmt: skip
    """Write the first leader's speed, motion, tilt, inputs, and ranges to obstacles."""
    place = plane(point_of(world, car, state))
    heading = car_heading(world, car, state)
    policy[row, 8] = speed / SPEED
    motion = motion_of(world, heading, car, state)
    tilt = tilt_of(world, car, state)
    policy[row, 10] = motion[0] / SPEED
    policy[row, 11] = motion[1]
    policy[row, 12] = motion[2]
    for i in range(2):
        policy[row, 13 + i] = tilt[i]
        policy[row, 15 + i] = action[row, i]
    rays = column.direction.shape[0]
    for ray in range(rays):
        distance = float(column.reach)
        for slot in range(slots.place.shape[1]):
            away = to_heading(slots.place[world, slot] - place, heading)
            met = range_to(column.direction[ray], away, slots.radius[world, slot], column.reach)
            distance = wp.min(distance, met)
        policy[row, 17 + ray] = 1.0 - distance / column.reach


@wp.kernel
def observe_followers(
    column: Column, state: StateArrays, action: wp.array2d[float], routes: RouteTables, follow: Follow, slots: Slots,
    platoon: Platoon, policy: wp.array2d[float],
):  # fmt: skip
    """What each follower sees of those ahead and of itself: (W * N, 34)."""
    world, agent = wp.tid()
    vehicle = platoon.leading + agent
    row = row_of(world, agent, platoon)
    time = time_of(world, column, follow)
    own = vehicle_at(world, vehicle, time, platoon, state, routes, follow)
    for i in range(LEADERS):
        leader = vehicle_at(world, vehicle - 1 - i, time, platoon, state, routes, follow)
        observe_leader(row, i, leader, wp.vec2(own[0], own[1]), own[2], policy)
    speed = speed_of(world, vehicle - 1, time, platoon, state, routes, follow)
    observe_truck(row, world, speed, column, car_at(vehicle, platoon), state, action, slots, policy)


@wp.kernel
def compute_follower_rewards(
    column: Column, state: StateArrays, routes: RouteTables, follow: Follow, platoon: Platoon, terms: wp.array2d[float]
):
    """Following, failure and, if it counts, the difference in speed: (T, W * N)."""
    world, agent = wp.tid()
    vehicle = platoon.leading + agent
    row = row_of(world, agent, platoon)
    away = behind_vehicle(world, vehicle, column, platoon, state, routes, follow)
    vehicles = platoon.chassis.shape[0]
    struck = touches_from(world, vehicle, vehicle + 1, vehicles, column, platoon, state, routes, follow)
    distance = wp.length(away)
    failed = (platoon.hit[world, vehicle] and not struck) or is_upset(world, car_at(vehicle, platoon), state)
    failed = failed or distance > column.lost_distance
    failed = failed or touches_from(world, vehicle, platoon.first, vehicle, column, platoon, state, routes, follow)
    inside = wp.abs(wp.atan2(away[1], away[0])) < column.cone
    nearness = column.softness / (wp.max(distance - column.near, 0.0) + column.softness)
    terms[0, row] = column.following_weight * nearness * float(inside)
    terms[1, row] = column.failure_weight * float(failed)
    if terms.shape[0] > 2:
        time = time_of(world, column, follow)
        speed = speed_of(world, vehicle, time, platoon, state, routes, follow)
        difference = speed_of(world, vehicle - 1, time, platoon, state, routes, follow) - speed
        terms[2, row] = column.speed_weight * wp.abs(difference / (wp.abs(speed) + 0.05))


@wp.kernel
def end_followers(
    column: Column, state: StateArrays, routes: RouteTables, follow: Follow, platoon: Platoon, ends: wp.array2d[wp.bool]
):
    """Collision, bumped, lost, upset, goal: (R, W * N). Who is struck from behind goes on; with `drive_on` everyone."""
    world, agent = wp.tid()
    vehicle = platoon.leading + agent
    row = row_of(world, agent, platoon)
    gone = time_of(world, column, follow) / DURATION
    pushed = touches_from(world, vehicle, 0, platoon.chassis.shape[0], column, platoon, state, routes, follow)
    ending = column.drive_on == 0
    collided = ending and platoon.hit[world, vehicle] and not pushed
    bumped = touches_from(world, vehicle, platoon.first, vehicle, column, platoon, state, routes, follow)
    ends[0, row] = collided
    ends[1, row] = ending and bumped
    away = behind_vehicle(world, vehicle, column, platoon, state, routes, follow)
    ends[2, row] = wp.length(away) > column.lost_distance
    ends[3, row] = is_upset(world, car_at(vehicle, platoon), state)
    ends[4, row] = follow.begun[world] + gone * gone > 0.999 and not collided


@wp.kernel
def write_follower_metrics(
    column: Column, state: StateArrays, routes: RouteTables, follow: Follow, platoon: Platoon,
    metrics: wp.array2d[float],
):  # fmt: skip
    """Of each follower: distance from its leader, mean distance from the path, and whether an obstacle was hit.

    Args: column, state, routes, follow, platoon; rows (3, W * N).
    """
    world, agent = wp.tid()
    vehicle = platoon.leading + agent
    pushed = touches_from(world, vehicle, 0, platoon.chassis.shape[0], column, platoon, state, routes, follow)
    row = row_of(world, agent, platoon)
    metrics[0, row] = wp.length(behind_vehicle(world, vehicle, column, platoon, state, routes, follow))
    metrics[1, row] = platoon.deviation[world, vehicle]
    metrics[2, row] = float(platoon.hit[world, vehicle] and not pushed)
