"""Device half of obstacle avoidance: pillars, observations, rewards and ends."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.tasks.driving.base_kernels import (
    Car,
    Drive,
    car_heading,
    is_upset,
    motion_of,
    point_of,
)
from simwarp.tasks.driving.ranging_kernels import range_to
from simwarp.tasks.framework.frames_kernels import to_heading
from simwarp.tasks.framework.randomness_kernels import Draws, episode_key, uniform_at

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

PILLARS = wp.constant(3)
ROAD_HALF_WIDTH = wp.constant(wp.float64(7.5))
TRUCK_HALF_WIDTH = wp.constant(wp.float64(1.2))
SPEED = wp.constant(10.0)
"""By which speeds are divided in observations [m/s]."""
LENGTHS = wp.constant(25.0)
"""By which places of pillars are divided [m]."""
PASSED = wp.constant(wp.float64(3.0))
"""Distance behind the vehicle at which a pillar is no longer the next one [m]."""


@wp.struct
class Road:
    """Numbers of the task."""

    end: wp.float64  # [m]
    spread: float  # of the pillars across the road [m]
    progress_weight: wp.float64
    goal_weight: float
    failure_weight: float
    reach: float  # of the rays [m]
    radius: float  # of a pillar [m]
    direction: wp.array[wp.vec2]  # (rays,)
    aside: wp.array[wp.uint64]  # stream of the pillars' places
    first: int  # pillar among the shapes
    shape_x: wp.array2d[wp.vec3d]  # (W, S)
    before: wp.array[wp.float64]  # (W,) distance to the end before the control step [m]


@wp.func
def distance_to_end(world: int, road: Road, car: Car, state: StateArrays) -> wp.float64:
    """Distance from the end of the road, at its middle [m]."""
    point = point_of(world, car, state)
    x = road.end - point[0]
    return wp.sqrt(x * x + point[1] * point[1])


@wp.func
def is_off_road(world: int, car: Car, state: StateArrays) -> bool:
    """Whether the truck is beside the road, or turned over."""
    aside = wp.abs(point_of(world, car, state)[1]) + TRUCK_HALF_WIDTH
    return aside > ROAD_HALF_WIDTH or is_upset(world, car, state)


@wp.func
def is_at_end(world: int, road: Road, car: Car, drive: Drive, state: StateArrays) -> bool:
    """Whether the truck is at the end, and sound."""
    there = point_of(world, car, state)[0] > road.end
    return there and not drive.hit[world] and not is_off_road(world, car, state)


@wp.kernel
def draw_pillars(mask: wp.array[wp.bool], road: Road, draws: Draws):
    """Pillars anywhere across the road."""
    world = wp.tid()
    if not mask[world]:
        return
    key = episode_key(road.aside, world, draws)
    for i in range(PILLARS):
        place = road.shape_x[world, road.first + i]
        place[1] = wp.float64(uniform_at(key, i, -road.spread, road.spread))
        road.shape_x[world, road.first + i] = place


@wp.kernel
def begin_way(road: Road, car: Car, state: StateArrays):
    """Store what progress is measured from."""
    world = wp.tid()
    road.before[world] = distance_to_end(world, road, car, state)


@wp.func
def write_measured(world: int, motion: wp.vec3, steering: float, policy: wp.array2d[float]):
    """Speed, yaw rate, steering."""
    policy[world, 0] = motion[0] / SPEED
    policy[world, 1] = motion[2]
    policy[world, 2] = steering


@wp.kernel
def measure_way(car: Car, state: StateArrays, action: wp.array2d[float], policy: wp.array2d[float]):
    """What a vehicle measures beside its camera."""
    world = wp.tid()
    motion = motion_of(world, car_heading(world, car, state), car, state)
    write_measured(world, motion, action[world, 0], policy)


@wp.kernel
def observe_way(
    road: Road, car: Car, state: StateArrays, action: wp.array2d[float], policy: wp.array2d[float]
):  # fmt: skip
    """What is measured, place across the road, heading, motion, inputs, the next two pillars, ranges to pillars."""
    world = wp.tid()
    point = point_of(world, car, state)
    heading = car_heading(world, car, state)
    motion = motion_of(world, heading, car, state)
    write_measured(world, motion, action[world, 0], policy)
    policy[world, 3] = motion[1]
    policy[world, 4] = action[world, 1]
    policy[world, 5] = float(point[1] / ROAD_HALF_WIDTH)
    policy[world, 6] = wp.sin(heading)
    policy[world, 7] = wp.cos(heading)
    policy[world, 8] = float((road.end - point[0]) / road.end)
    passed = int(0)
    for i in range(PILLARS):
        if road.shape_x[world, road.first + i][0] < point[0] - PASSED:
            passed += 1
    for i in range(2):
        place = wp.vec2(2.0 * LENGTHS, 0.0)
        if passed + i < PILLARS:
            pillar = road.shape_x[world, road.first + passed + i]
            place = to_heading(wp.vec2(float(pillar[0] - point[0]), float(pillar[1] - point[1])), heading)
        policy[world, 9 + 2 * i] = place[0] / LENGTHS
        policy[world, 10 + 2 * i] = place[1] / LENGTHS
    for ray in range(road.direction.shape[0]):
        distance = float(road.reach)
        for i in range(PILLARS):
            pillar = road.shape_x[world, road.first + i]
            away = to_heading(wp.vec2(float(pillar[0] - point[0]), float(pillar[1] - point[1])), heading)
            distance = wp.min(distance, range_to(road.direction[ray], away, road.radius, road.reach))
        policy[world, 13 + ray] = 1.0 - distance / road.reach


@wp.kernel
def compute_road_rewards(road: Road, car: Car, drive: Drive, state: StateArrays, terms: wp.array2d[float]):
    """Failure, progress, goal: (T, W)."""
    world = wp.tid()
    failed = drive.hit[world] or is_off_road(world, car, state)
    nearer = road.before[world] - distance_to_end(world, road, car, state)
    terms[0, world] = road.failure_weight * float(failed)
    terms[1, world] = float(road.progress_weight * nearer)
    terms[2, world] = road.goal_weight * float(is_at_end(world, road, car, drive, state))


@wp.kernel
def end_way(road: Road, car: Car, drive: Drive, state: StateArrays, ends: wp.array2d[wp.bool]):
    """Goal, collision, off the road: (R, W)."""
    world = wp.tid()
    ends[0, world] = is_at_end(world, road, car, drive, state)
    ends[1, world] = drive.hit[world]
    ends[2, world] = is_off_road(world, car, state)


@wp.kernel
def measure_road_distance(car: Car, state: StateArrays, metrics: wp.array2d[float]):
    """Distance along the road: (1, W)."""
    world = wp.tid()
    metrics[0, world] = float(point_of(world, car, state)[0])
