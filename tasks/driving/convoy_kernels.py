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
    cone: float  # [rad]
    near: float  # [m]
    softness: float  # [m]
    following_weight: float
    failure_weight: float
    speed_weight: float
    lost_distance: float  # [m]
    reach: float  # of the rays [m]
    direction: wp.array[wp.vec2]  # (rays,)
    large: wp.array2d[wp.vec3]  # (K, L) x, y and radius of what generated paths pass [m]
    path: wp.array[wp.uint64]  # streams of the draws
    begin: wp.array[wp.uint64]
    sides: wp.array[wp.uint64]
    gaps: wp.array[wp.uint64]
    headings: wp.array[wp.uint64]
    ghost: int  # first leader among the instances of the scene
    shown_x: wp.array2d[wp.vec3d]  # (W, I) places of the scene; of no length: there is none
    shown_rot: wp.array2d[wp.quat]


@wp.struct
class Follow:
    """State of the running episode."""

    route: wp.array[wp.int64]  # (W,)
    begun: wp.array[float]  # (W,) where the nearest leader begins, as a share of the path
    deviation: wp.array[float]  # (W,) mean distance from the path [m]
    steps: wp.array[wp.int64]  # (W,) control steps of the episode


@wp.func
def time_of(world: int, column: Column, follow: Follow) -> float:
    """Time since the episode began, at the end of the last control step [s]."""
    return float(follow.steps[world]) * column.control_dt


@wp.func
def leader_at(world: int, index: int, time: float, routes: RouteTables, follow: Follow) -> wp.vec3:
    """Place and heading of a leader; the nearest is the first."""
    route = int(follow.route[world])
    gone = time / DURATION
    share = follow.begun[world] + APART * float(index) + gone * gone
    return route_at(route, share * routes.length[route], routes)


@wp.func
def leader_speed(world: int, time: float, routes: RouteTables, follow: Follow) -> float:
    """Speed of the leaders [m/s]."""
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
def is_bumped(world: int, column: Column, car: Car, state: StateArrays, routes: RouteTables, follow: Follow) -> bool:
    """Whether the truck is in one of the leaders."""
    place = plane(point_of(world, car, state))
    heading = car_heading(world, car, state)
    touching = bool(False)
    for i in range(LEADERS):
        leader = leader_at(world, i, time_of(world, column, follow), routes, follow)
        touching = touching or overlaps(place, heading, leader, column)
    return touching


@wp.func
def behind_leader(
    world: int, column: Column, car: Car, state: StateArrays, routes: RouteTables, follow: Follow
) -> wp.vec2:
    """From the truck to the nearest leader, in the leader's axes [m]."""
    leader = leader_at(world, 0, time_of(world, column, follow), routes, follow)
    return to_heading(wp.vec2(leader[0], leader[1]) - plane(point_of(world, car, state)), leader[2])


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
    """Things at equal steps along the path, to either side, so far away that it stays free; and large ones between."""
    world, slot = wp.tid()
    if not mask[world]:
        return
    route = int(follow.route[world])
    thing = drawn_thing(world, slot, slots, draws)
    place = wp.vec2()
    if slot < BESIDE:
        reach = thing.scale * slots.reach[thing.kind]
        share = (float(slot) + 1.0) / (float(BESIDE) + 1.0)
        at = route_at(route, share * routes.length[route], routes)
        side = float(1.0)
        if uniform_at(episode_key(column.sides, world, draws), slot, 0.0, 1.0) < 0.5:
            side = -1.0
        gap = uniform_at(episode_key(column.gaps, world, draws), slot, 0.0, 2.0)
        aside = side * (reach + column.leader_half[1] + 1.5 + gap)
        place = wp.vec2(at[0] - aside * wp.sin(at[2]), at[1] + aside * wp.cos(at[2]))
    else:
        large = column.large[route, slot - BESIDE]
        thing.kind = 0
        thing.scale = large[2] / slots.reach[0]
        place = wp.vec2(large[0], large[1])
    needed = thing.scale * slots.reach[thing.kind] + column.leader_half[1] + 0.5
    free = route_distance(route, place, routes) > needed
    sunk = -0.1 * (thing.scale * slots.tallness[thing.kind])
    heading = uniform_at(episode_key(column.headings, world, draws), slot, -PI, PI)
    fill_slot(world, slot, place, sunk, heading, thing, free, slots, model, scene)


@wp.kernel
def start_following(
    mask: wp.array[wp.bool], column: Column, car: Car, navigator: Navigator, state: StateArrays, routes: RouteTables,
    follow: Follow,
):  # fmt: skip
    """On the path behind the leaders."""
    world = wp.tid()
    time = time_of(world, column, follow)
    if mask[world]:
        route = int(follow.route[world])
        at = route_at(route, (follow.begun[world] - APART) * routes.length[route], routes)
        place = wp.vec3d(wp.float64(at[0]), wp.float64(at[1]), wp.float64(0.0))
        place_car(world, place, at[2], heading_quaternion(wp.float64(at[2])), car, navigator, state)
        follow.deviation[world] = 0.0
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
def follow_path(car: Car, state: StateArrays, routes: RouteTables, follow: Follow):
    """Store the truck's distance from the path."""
    world = wp.tid()
    distance = route_distance(int(follow.route[world]), plane(point_of(world, car, state)), routes)
    mean = follow.deviation[world]
    follow.deviation[world] = mean + (distance - mean) / float(follow.steps[world] + wp.int64(1))


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
    policy[world, 0] = seen[0] / LENGTHS
    policy[world, 1] = seen[1] / LENGTHS
    policy[world, 2] = wp.sin(heading)
    policy[world, 3] = wp.cos(heading)
    policy[world, 4] = estimated_speed(world, navigator, draws) / SPEED
    policy[world, 5] = speed / SPEED


@wp.kernel
def measure_column(
    column: Column, navigator: Navigator, draws: Draws, routes: RouteTables, follow: Follow, policy: wp.array2d[float]
):  # fmt: skip
    """Place of the first leader, heading and speed as the instruments tell them, the leader's speed."""
    world = wp.tid()
    time = time_of(world, column, follow)
    leader = leader_at(world, 0, time, routes, follow)
    speed = leader_speed(world, time, routes, follow)
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
def observe_column(
    column: Column, car: Car, state: StateArrays, action: wp.array2d[float], routes: RouteTables, follow: Follow,
    slots: Slots, policy: wp.array2d[float],
):  # fmt: skip
    """The leaders' places, the first one's heading and speed, motion, tilt, inputs, ranges to obstacles."""
    world = wp.tid()
    time = time_of(world, column, follow)
    place = plane(point_of(world, car, state))
    heading = car_heading(world, car, state)
    for i in range(LEADERS):
        observe_leader(world, i, leader_at(world, i, time, routes, follow), place, heading, policy)
    speed = leader_speed(world, time, routes, follow)
    observe_truck(world, world, speed, column, car, state, action, slots, policy)


@wp.func
def write_follower_rewards(
    row: int, away: wp.vec2, failed: bool, ahead_speed: float, speed: float, column: Column, terms: wp.array2d[float]
):  # fmt: skip
    """Write following, failure and, if it counts, the difference in speed: columns of (T, rows).

    Args: row, from truck to leader in the leader's axes [m], whether it failed, the leader's speed and its own [m/s].
    """
    distance = wp.length(away)
    inside = wp.abs(wp.atan2(away[1], away[0])) < column.cone
    nearness = column.softness / (wp.max(distance - column.near, 0.0) + column.softness)
    terms[0, row] = column.following_weight * nearness * float(inside)
    terms[1, row] = column.failure_weight * float(failed)
    if terms.shape[0] > 2:
        difference = ahead_speed - speed
        terms[2, row] = column.speed_weight * wp.abs(difference / (wp.abs(speed) + 0.05))


@wp.kernel
def compute_convoy_rewards(
    column: Column, car: Car, drive: Drive, state: StateArrays, routes: RouteTables, follow: Follow,
    terms: wp.array2d[float],
):  # fmt: skip
    """Following, failure and, if it counts, the difference in speed: (T, W)."""
    world = wp.tid()
    away = behind_leader(world, column, car, state, routes, follow)
    failed = drive.hit[world] or is_upset(world, car, state) or wp.length(away) > column.lost_distance
    failed = failed or is_bumped(world, column, car, state, routes, follow)
    speed = motion_of(world, car_heading(world, car, state), car, state)[0]
    write_follower_rewards(
        world, away, failed, leader_speed(world, time_of(world, column, follow), routes, follow), speed, column, terms
    )  # fmt: skip


@wp.kernel
def end_column(
    column: Column, car: Car, drive: Drive, state: StateArrays, routes: RouteTables, follow: Follow,
    ends: wp.array2d[wp.bool],
):  # fmt: skip
    """Collision, bumped, lost, upset, goal: (R, W)."""
    world = wp.tid()
    away = behind_leader(world, column, car, state, routes, follow)
    gone = time_of(world, column, follow) / DURATION
    ends[0, world] = drive.hit[world]
    ends[1, world] = is_bumped(world, column, car, state, routes, follow)
    ends[2, world] = wp.length(away) > column.lost_distance
    ends[3, world] = is_upset(world, car, state)
    ends[4, world] = follow.begun[world] + gone * gone > 0.999 and not drive.hit[world]


@wp.kernel
def write_convoy_metrics(
    column: Column, car: Car, drive: Drive, state: StateArrays, routes: RouteTables, follow: Follow,
    metrics: wp.array2d[float],
):  # fmt: skip
    """Distance from the leader, mean distance from the path, and whether an obstacle was hit: (3, W)."""
    world = wp.tid()
    metrics[0, world] = wp.length(behind_leader(world, column, car, state, routes, follow))
    metrics[1, world] = follow.deviation[world]
    metrics[2, world] = float(drive.hit[world])
