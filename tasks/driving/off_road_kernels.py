"""Device half of off-road navigation: its worlds, starts, observations, rewards and ends."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays

from ..framework.frames_kernels import heading_quaternion, quat_product, tilt_to, to_heading
from ..framework.randomness_kernels import Draws, episode_key, uniform_at
from .base_kernels import (
    Car,
    Drive,
    car_heading,
    is_upset,
    motion_of,
    place_car,
    plane,
    point_of,
    tilt_of,
)
from .hills_kernels import HillTables, choose_hill, hill_height, hill_normal
from .navigation_kernels import Navigator, estimated_place, estimated_speed
from .obstacles_kernels import SlotArrays, Slots, drawn_thing, fill_slot
from .ranging_kernels import range_to

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

TRIES = wp.constant(6)
"""Places tried for each obstacle."""
SPEED = wp.constant(8.0)
"""By which speeds are divided in observations [m/s]."""
PI = wp.constant(3.141592653589793)


@wp.struct
class Ground:
    """Numbers of the task."""

    obstacles: int
    obstacle_scale: float
    hill_height: float  # greatest [m]
    hills: float  # share of it
    half: float
    border: wp.float64
    radius: float
    goal_radius: wp.float64
    clearance: float
    varied: int  # 1: every episode has shares of obstacles and hills of its own
    in_world_axes: int  # 1: the goal is observed in axes of the world
    progress_weight: wp.float64
    goal_weight: float
    failure_weight: float
    change_weight: float
    timeout_weight: float
    change_row: int  # of the reward's terms; -1: there is no such term
    timeout_row: int
    step_limit: wp.int64  # control steps of an episode
    raw: int  # 1: the goal is observed in metres, the heading as an angle, by five numbers
    any_heading: int  # 1: a start heads anywhere
    reach: float  # of the rays [m]
    direction: wp.array[wp.vec2]  # (rays,)
    start: wp.array[wp.uint64]  # streams of the draws
    target: wp.array[wp.uint64]
    field: wp.array[wp.uint64]
    texture: wp.array[wp.uint64]
    places: wp.array[wp.uint64]
    headings: wp.array[wp.uint64]
    share: wp.array[wp.uint64]
    facing: wp.array[wp.uint64]
    ground: int  # its instance in the scene
    shown: wp.array2d[int]  # (W, I) textures of the scene; of no length: there is none
    textures: wp.array[int]


@wp.struct
class Trip:
    """State of the running episode and control step."""

    goal: wp.array[wp.vec2d]  # (W,) [m]
    before: wp.array[wp.float64]  # (W,) distance from it before the control step [m]
    last_action: wp.array2d[float]  # (W, A) before the control step
    steps: wp.array[wp.int64]  # (W,) control steps of the episode


@wp.func
def start_angle(world: int, ground: Ground, draws: Draws) -> float:
    """Where on the circle an episode begins [rad]."""
    return uniform_at(episode_key(ground.start, world, draws), 0, -PI, PI)


@wp.func
def goal_angle(world: int, ground: Ground, draws: Draws) -> float:
    """Where on the circle its goal is [rad]."""
    turn = uniform_at(episode_key(ground.target, world, draws), 0, -0.5 * PI, 0.5 * PI)
    return start_angle(world, ground, draws) + PI + turn


@wp.func
def share_of(world: int, column: int, ground: Ground, draws: Draws) -> float:
    """Part of the obstacles (column 0) or of the hills' height (1) that an episode has."""
    if ground.varied == 0:
        return 1.0
    return uniform_at(episode_key(ground.share, world, draws), column, 0.0, 1.0)


@wp.func
def on_circle(angle: float, ground: Ground) -> wp.vec2:
    """A place on the circle of starts and goals [m]."""
    return wp.vec2(ground.radius * wp.cos(angle), ground.radius * wp.sin(angle))


@wp.func
def goal_distance(world: int, car: Car, state: StateArrays, trip: Trip) -> wp.float64:
    """Distance from the goal [m]."""
    point = point_of(world, car, state)
    away = trip.goal[world] - wp.vec2d(point[0], point[1])
    return wp.sqrt(away[0] * away[0] + away[1] * away[1])


@wp.func
def is_off_map(world: int, car: Car, state: StateArrays, ground: Ground) -> bool:
    """Whether the vehicle has left the map."""
    point = point_of(world, car, state)
    return wp.abs(point[0]) > ground.border or wp.abs(point[1]) > ground.border


@wp.func
def is_at_goal(world: int, car: Car, drive: Drive, state: StateArrays, ground: Ground, trip: Trip) -> bool:
    """Whether the vehicle is there, and sound."""
    there = goal_distance(world, car, state, trip) < ground.goal_radius
    return there and not drive.hit[world] and not is_upset(world, car, state)


@wp.func
def has_failed(world: int, car: Car, drive: Drive, state: StateArrays, ground: Ground) -> bool:
    """Whether the vehicle touches an obstacle, has left the map or is turned over."""
    return drive.hit[world] or is_off_map(world, car, state, ground) or is_upset(world, car, state)


@wp.func
def is_late(world: int, ground: Ground, trip: Trip) -> bool:
    """Whether the time of the episode is over."""
    return trip.steps[world] >= ground.step_limit


@wp.kernel
def draw_ground(
    mask: wp.array[wp.bool], ground: Ground, draws: Draws, hills: HillTables, drive: Drive, trip: Trip
):  # fmt: skip
    """Goal, hills and texture of a new episode."""
    world = wp.tid()
    if not mask[world]:
        return
    goal = on_circle(goal_angle(world, ground, draws), ground)
    trip.goal[world] = wp.vec2d(wp.float64(goal[0]), wp.float64(goal[1]))
    fields = hills.heights.shape[0]
    if fields > 0:
        field = int(uniform_at(episode_key(ground.field, world, draws), 0, 0.0, float(fields)))
        rise = wp.clamp(2.0 * drive.difficulty[world] - 1.0, 0.0, 1.0)
        rise = rise * share_of(world, 1, ground, draws)
        choose_hill(world, field, rise * ground.hills * ground.hill_height, hills)
    if ground.shown.shape[0] > 0:
        count = float(ground.textures.shape[0])
        chosen = int(uniform_at(episode_key(ground.texture, world, draws), 0, 0.0, count))
        ground.shown[world, ground.ground] = ground.textures[chosen]


@wp.kernel
def draw_obstacles(
    mask: wp.array[wp.bool], ground: Ground, draws: Draws, hills: HillTables, drive: Drive, slots: Slots,
    model: SlotArrays, scene: SlotArrays,
):  # fmt: skip
    """An obstacle anywhere in the square, but far enough from start and goal: at the first of some tries that is."""
    world, slot = wp.tid()
    if not mask[world]:
        return
    thing = drawn_thing(world, slot, slots, draws)
    thing.scale = thing.scale * ground.obstacle_scale
    start = on_circle(start_angle(world, ground, draws), ground)
    goal = on_circle(goal_angle(world, ground, draws), ground)
    clear = ground.clearance + thing.scale * slots.reach[thing.kind]
    key = episode_key(ground.places, world, draws)
    place = wp.vec2()
    free = bool(False)
    for i in range(TRIES):
        if not free:
            column = 2 * (slot * TRIES + i)
            x = uniform_at(key, column, -ground.half, ground.half)
            y = uniform_at(key, column + 1, -ground.half, ground.half)
            tried = wp.vec2(x, y)
            free = wp.length(tried - start) > clear and wp.length(tried - goal) > clear
            if free or i == 0:
                place = tried
    most = float(ground.obstacles) * share_of(world, 0, ground, draws)
    wanted = wp.rint(most * wp.min(2.0 * drive.difficulty[world], 1.0))
    present = free and float(slot) < wanted
    heading = uniform_at(episode_key(ground.headings, world, draws), slot, -PI, PI)
    sunk = 0.1 * (thing.scale * slots.tallness[thing.kind])
    height = hill_height(world, place, hills) - sunk
    fill_slot(world, slot, place, height, heading, thing, present, slots, model, scene)


@wp.kernel
def start_trip(
    mask: wp.array[wp.bool], ground: Ground, draws: Draws, hills: HillTables, car: Car, navigator: Navigator,
    state: StateArrays, trip: Trip,
):  # fmt: skip
    """On the circle, facing its middle or anywhere."""
    world = wp.tid()
    if not mask[world]:
        return
    angle = start_angle(world, ground, draws)
    heading = angle + PI
    if ground.any_heading == 1:
        heading = uniform_at(episode_key(ground.facing, world, draws), 0, -PI, PI)
    place = on_circle(angle, ground)
    turn = heading_quaternion(wp.float64(heading))
    height = hill_height(world, place, hills)
    if hills.heights.shape[0] > 0:
        up = hill_normal(world, place, hills)
        turn = quat_product(tilt_to(wp.vec3d(wp.float64(up[0]), wp.float64(up[1]), wp.float64(up[2]))), turn)
    at = wp.vec3d(wp.float64(place[0]), wp.float64(place[1]), wp.float64(height))
    place_car(world, at, heading, turn, car, navigator, state)
    for i in range(trip.last_action.shape[1]):
        trip.last_action[world, i] = 0.0


@wp.kernel
def begin_trip(car: Car, state: StateArrays, action: wp.array2d[float], trip: Trip):
    """Store what a control step is compared with."""
    world = wp.tid()
    trip.before[world] = goal_distance(world, car, state, trip)
    for i in range(action.shape[1]):
        trip.last_action[world, i] = action[world, i]


@wp.func
def goal_from(world: int, place: wp.vec2d, heading: float, ground: Ground, trip: Trip) -> wp.vec2:
    """The goal as seen from a place, in axes of the heading or of the world [m]."""
    goal = trip.goal[world]
    seen = wp.vec2(float(goal[0] - place[0]), float(goal[1] - place[1]))
    if ground.in_world_axes == 0:
        seen = to_heading(seen, heading)
    return seen


@wp.func
def write_goal(
    world: int, place: wp.vec2d, heading: float, speed: float, ground: Ground, trip: Trip, policy: wp.array2d[float]
):  # fmt: skip
    """Observe the goal, the direction to it, heading and speed: six numbers."""
    seen = goal_from(world, place, heading, ground, trip)
    policy[world, 0] = seen[0] / ground.radius
    policy[world, 1] = seen[1] / ground.radius
    policy[world, 2] = wp.atan2(seen[1], seen[0]) / PI
    policy[world, 3] = wp.sin(heading)
    policy[world, 4] = wp.cos(heading)
    policy[world, 5] = speed / SPEED


@wp.kernel
def observe_trip(
    ground: Ground, car: Car, state: StateArrays, action: wp.array2d[float], slots: Slots, trip: Trip,
    policy: wp.array2d[float],
):  # fmt: skip
    """Exact goal, motion, tilt, inputs, ranges to obstacles, and the distance from the goal."""
    world = wp.tid()
    point = point_of(world, car, state)
    heading = car_heading(world, car, state)
    motion = motion_of(world, heading, car, state)
    tilt = tilt_of(world, car, state)
    write_goal(world, wp.vec2d(point[0], point[1]), heading, motion[0], ground, trip, policy)
    for i in range(2):
        policy[world, 6 + i] = motion[1 + i]
        policy[world, 8 + i] = tilt[i]
        policy[world, 10 + i] = action[world, i]
    rays = ground.direction.shape[0]
    for ray in range(rays):
        policy[world, 12 + ray] = ground.reach
    for slot in range(slots.place.shape[1]):
        radius = slots.radius[world, slot]
        away = to_heading(slots.place[world, slot] - plane(point), heading)
        # what is farther away than rays reach is met by none
        if radius >= 0.0 and wp.length(away) - radius < ground.reach:
            for ray in range(rays):
                distance = range_to(ground.direction[ray], away, radius, ground.reach)
                policy[world, 12 + ray] = wp.min(policy[world, 12 + ray], distance)
    for ray in range(rays):
        policy[world, 12 + ray] = 1.0 - policy[world, 12 + ray] / ground.reach
    away_from_goal = goal_distance(world, car, state, trip)
    policy[world, 12 + rays] = float(away_from_goal / wp.float64(ground.radius))


@wp.kernel
def measure_trip(ground: Ground, navigator: Navigator, draws: Draws, trip: Trip, policy: wp.array2d[float]):
    """Goal, heading and speed as the instruments tell them."""
    world = wp.tid()
    place = estimated_place(world, navigator, draws)
    speed = estimated_speed(world, navigator, draws)
    at = wp.vec2d(wp.float64(place[0]), wp.float64(place[1]))
    heading = navigator.heading[world]
    if ground.raw == 0:
        write_goal(world, at, heading, speed, ground, trip, policy)
        return
    seen = goal_from(world, at, heading, ground, trip)
    policy[world, 0] = seen[0]
    policy[world, 1] = seen[1]
    policy[world, 2] = wp.atan2(seen[1], seen[0])
    policy[world, 3] = wp.atan2(wp.sin(heading), wp.cos(heading))
    policy[world, 4] = speed


@wp.kernel
def compute_trip_rewards(
    ground: Ground, car: Car, drive: Drive, state: StateArrays, action: wp.array2d[float], trip: Trip,
    terms: wp.array2d[float],
):  # fmt: skip
    """Progress, goal, failure and, if they count, the change of the action and the end of the time: (T, W)."""
    world = wp.tid()
    nearer = trip.before[world] - goal_distance(world, car, state, trip)
    terms[0, world] = float(ground.progress_weight * nearer)
    reached = is_at_goal(world, car, drive, state, ground, trip)
    terms[1, world] = ground.goal_weight * float(reached)
    failed = has_failed(world, car, drive, state, ground)
    terms[2, world] = ground.failure_weight * float(failed)
    if ground.timeout_row >= 0:
        late = is_late(world, ground, trip) and not reached and not failed
        terms[ground.timeout_row, world] = ground.timeout_weight * float(late)
    if ground.change_row >= 0:
        square = float(0.0)
        for i in range(action.shape[1]):
            change = action[world, i] - trip.last_action[world, i]
            square += change * change
        terms[ground.change_row, world] = ground.change_weight * wp.sqrt(square)


@wp.kernel
def end_trip(
    ground: Ground, car: Car, drive: Drive, state: StateArrays, trip: Trip, ends: wp.array2d[wp.bool]
):  # fmt: skip
    """Goal, collision, off the map, upset and, if it counts, the end of the time: (R, W)."""
    world = wp.tid()
    ends[0, world] = is_at_goal(world, car, drive, state, ground, trip)
    ends[1, world] = drive.hit[world]
    ends[2, world] = is_off_map(world, car, state, ground)
    ends[3, world] = is_upset(world, car, state)
    if ground.timeout_row >= 0:
        ends[4, world] = is_late(world, ground, trip)


@wp.kernel
def write_trip_metrics(
    car: Car, state: StateArrays, slots: Slots, trip: Trip, metrics: wp.array2d[float]
):  # fmt: skip
    """Distance from the goal, and the number of obstacles: (2, W)."""
    world = wp.tid()
    metrics[0, world] = float(goal_distance(world, car, state, trip))
    count = float(0.0)
    for slot in range(slots.radius.shape[1]):
        if slots.radius[world, slot] >= 0.0:
            count += 1.0
    metrics[1, world] = count
