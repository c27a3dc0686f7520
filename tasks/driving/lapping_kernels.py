"""Device half of tasks on closed tracks: starts, progress, the place in the lane, rewards and ends."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays

from ..framework.frames_kernels import heading_quaternion, to_heading
from ..framework.randomness_kernels import Draws, episode_key, uniform_at
from .base_kernels import Car, car_heading, is_upset, motion_of, place_car, plane, point_of
from .navigation_kernels import Navigator
from .routes_kernels import RouteTables, locate, route_at

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

PREVIEW = wp.constant(5)
"""Number of points of the lane ahead in exact observations."""


@wp.struct
class Course:
    """Numbers of the task."""

    lane_half: float  # [m]
    preview: float  # distance of the points ahead [m]
    speed: float  # [m/s]
    progress_weight: float
    lap_weight: float
    failure_weight: float
    starts: wp.array2d[float]  # (K, S) lengths along the tracks [m]
    start_counts: wp.array[int]  # (K,)
    limits: wp.array[wp.int64]  # (K,) control steps that a lap may take
    track: wp.array[wp.uint64]  # streams of the draws
    begin: wp.array[wp.uint64]
    course: int  # its instance in the scene
    shown: wp.array2d[int]  # (W, I) assets of the scene; of no length: there is none, or one track only
    known: wp.array[int]  # (K,) assets


@wp.struct
class Lap:
    """State of the running episode and control step."""

    route: wp.array[wp.int64]  # (W,)
    begun: wp.array[float]  # (W,) length along the track at the start [m]
    arc: wp.array[float]  # (W,) at the end of the last control step [m]
    gain: wp.array[float]  # (W,) in that step [m]
    progress: wp.array[float]  # (W,) in the episode [m]


@wp.struct
class LanePlace:
    """A place in the lane."""

    arc: float  # [m]
    aside: float  # to the left of the middle [m]
    turn: float  # off its heading [rad]


@wp.func
def lane_place(world: int, car: Car, state: StateArrays, routes: RouteTables, lap: Lap) -> LanePlace:
    """Where in the lane the vehicle is."""
    route = int(lap.route[world])
    found = locate(route, plane(point_of(world, car, state)), routes)
    turn = car_heading(world, car, state) - route_at(route, found[0], routes)[2]
    place = LanePlace()
    place.arc = found[0]
    place.aside = found[1]
    place.turn = wp.atan2(wp.sin(turn), wp.cos(turn))
    return place


@wp.func
def point_ahead(
    world: int,
    index: int,
    place: LanePlace,
    car: Car,
    state: StateArrays,
    course: Course,
    routes: RouteTables,
    lap: Lap,
) -> wp.vec2:
    """A point of the middle of the lane ahead, in axes of the vehicle [m]."""
    at = route_at(int(lap.route[world]), place.arc + course.preview * float(index + 1), routes)
    away = wp.vec2(at[0], at[1]) - plane(point_of(world, car, state))
    return to_heading(away, car_heading(world, car, state))


@wp.kernel
def draw_lap(mask: wp.array[wp.bool], course: Course, draws: Draws, lap: Lap):
    """Track and start."""
    world = wp.tid()
    if mask[world]:
        tracks = course.start_counts.shape[0]
        route = int(uniform_at(episode_key(course.track, world, draws), 0, 0.0, float(tracks)))
        chance = uniform_at(episode_key(course.begin, world, draws), 0, 0.0, 1.0)
        lap.route[world] = wp.int64(route)
        lap.begun[world] = course.starts[route, int(chance * float(course.start_counts[route]))]
    if course.shown.shape[0] > 0:
        course.shown[world, course.course] = course.known[int(lap.route[world])]


@wp.kernel
def start_lap(
    mask: wp.array[wp.bool], car: Car, navigator: Navigator, state: StateArrays, routes: RouteTables, lap: Lap
):  # fmt: skip
    """In the middle of the lane, along it."""
    world = wp.tid()
    if not mask[world]:
        return
    at = route_at(int(lap.route[world]), lap.begun[world], routes)
    place = wp.vec3d(wp.float64(at[0]), wp.float64(at[1]), wp.float64(0.0))
    place_car(world, place, at[2], heading_quaternion(wp.float64(at[2])), car, navigator, state)
    lap.arc[world] = lap.begun[world]
    lap.gain[world] = 0.0
    lap.progress[world] = 0.0


@wp.kernel
def advance_lap(car: Car, state: StateArrays, routes: RouteTables, lap: Lap):
    """See how far the vehicle has come."""
    world = wp.tid()
    route = int(lap.route[world])
    arc = locate(route, plane(point_of(world, car, state)), routes)[0]
    length = routes.length[route]
    gain = arc - lap.arc[world]
    gain = gain - length * wp.rint(gain / length)
    lap.gain[world] = gain
    lap.progress[world] = lap.progress[world] + gain
    lap.arc[world] = arc


@wp.kernel
def measure_lane(
    car: Car, state: StateArrays, course: Course, routes: RouteTables, lap: Lap, aside: wp.array[float],
    turn: wp.array[float], ahead: wp.array2d[wp.vec2],
):  # fmt: skip
    """The vehicle's pose in the lane, and points ahead."""
    world = wp.tid()
    place = lane_place(world, car, state, routes, lap)
    aside[world] = place.aside
    turn[world] = place.turn
    for i in range(PREVIEW):
        ahead[world, i] = point_ahead(world, i, place, car, state, course, routes, lap)


@wp.kernel
def find_lane_departures(
    car: Car, state: StateArrays, course: Course, routes: RouteTables, lap: Lap, outside: wp.array[wp.bool]
):  # fmt: skip
    """Whether the vehicle has left its lane."""
    world = wp.tid()
    found = locate(int(lap.route[world]), plane(point_of(world, car, state)), routes)
    outside[world] = wp.abs(found[1]) > course.lane_half


@wp.kernel
def measure_lap(car: Car, state: StateArrays, course: Course, action: wp.array2d[float], policy: wp.array2d[float]):
    """Speed, yaw rate, steering."""
    world = wp.tid()
    motion = motion_of(world, car_heading(world, car, state), car, state)
    policy[world, 0] = motion[0] / course.speed
    policy[world, 1] = motion[2]
    policy[world, 2] = action[world, 0]


@wp.kernel
def observe_lap(
    car: Car, state: StateArrays, course: Course, routes: RouteTables, lap: Lap, action: wp.array2d[float],
    policy: wp.array2d[float],
):  # fmt: skip
    """The place in the lane, points of the lane ahead, motion and inputs."""
    world = wp.tid()
    place = lane_place(world, car, state, routes, lap)
    policy[world, 0] = place.aside / course.lane_half
    policy[world, 1] = wp.sin(place.turn)
    policy[world, 2] = wp.cos(place.turn)
    for i in range(PREVIEW):
        ahead = point_ahead(world, i, place, car, state, course, routes, lap)
        policy[world, 3 + 2 * i] = ahead[0] / (float(PREVIEW) * course.preview)
        policy[world, 4 + 2 * i] = ahead[1] / (float(PREVIEW) * course.preview)
    at = 3 + 2 * PREVIEW
    motion = motion_of(world, car_heading(world, car, state), car, state)
    policy[world, at] = motion[0] / course.speed
    policy[world, at + 1] = motion[1] / course.speed
    policy[world, at + 2] = motion[2]
    for i in range(action.shape[1]):
        policy[world, at + 3 + i] = action[world, i]


@wp.func
def is_lapped(
    world: int, outside: wp.array[wp.bool], car: Car, state: StateArrays, routes: RouteTables, lap: Lap
) -> bool:
    """Whether a full lap is driven, and the vehicle is sound."""
    whole = lap.progress[world] >= routes.length[int(lap.route[world])]
    return whole and not outside[world] and not is_upset(world, car, state)


@wp.kernel
def compute_lap_rewards(
    outside: wp.array[wp.bool], car: Car, state: StateArrays, course: Course, routes: RouteTables, lap: Lap,
    terms: wp.array2d[float],
):  # fmt: skip
    """Progress, lap, failure: (T, W)."""
    world = wp.tid()
    terms[0, world] = course.progress_weight * lap.gain[world]
    terms[1, world] = course.lap_weight * float(is_lapped(world, outside, car, state, routes, lap))
    terms[2, world] = course.failure_weight * float(outside[world] or is_upset(world, car, state))


@wp.kernel
def end_lap(
    outside: wp.array[wp.bool], car: Car, state: StateArrays, routes: RouteTables, lap: Lap, ends: wp.array2d[wp.bool]
):  # fmt: skip
    """Off the lane, upset, a lap: (R, W)."""
    world = wp.tid()
    ends[0, world] = outside[world]
    ends[1, world] = is_upset(world, car, state)
    ends[2, world] = is_lapped(world, outside, car, state, routes, lap)


@wp.kernel
def find_slow(clock: wp.array[wp.int64], course: Course, lap: Lap, cuts: wp.array2d[wp.bool]):
    """Whether the time for a lap is over: (1, W)."""
    world = wp.tid()
    cuts[0, world] = clock[world] >= course.limits[int(lap.route[world])]


@wp.kernel
def write_lap_metrics(
    car: Car, state: StateArrays, routes: RouteTables, lap: Lap, metrics: wp.array2d[float]
):  # fmt: skip
    """Share of the lap, and the distance from the middle of the lane: (2, W)."""
    world = wp.tid()
    metrics[0, world] = lap.progress[world] / routes.length[int(lap.route[world])]
    metrics[1, world] = wp.abs(locate(int(lap.route[world]), plane(point_of(world, car, state)), routes)[1])
