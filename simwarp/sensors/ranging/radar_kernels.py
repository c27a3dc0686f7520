"""Radar: one ray per direction, with the speed at which its surface recedes.

The range rate of the surface point p on a body, seen from the sensor s along d = (p - s) / |p - s|, is

    d|p - s|/dt = d . (v_body + omega_body x (p - x_body) - v_s)

where v_s is the velocity of the sensor's origin, on its body. A thing that stands while the sensor moves has a range
rate, and one that moves along with it has none. Amplitude: backscatter |n . d| r^-k.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import matrix_to_float, to_double
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.rays.ray_modules import RAY_MODULE_OPTIONS
from simwarp.sensors.clock_kernels import SampleEvents
from simwarp.sensors.motion.mount_motion_kernels import body_rate, body_velocity
from simwarp.sensors.random_kernels import draw_normals, draw_uniform
from simwarp.sensors.ranging.beams_kernels import (
    Scan,
    SensorMotion,
    column_at,
    is_swept,
    perturbed_direction,
    sensor_motion,
    sweep_back,
)
from simwarp.sensors.ray_casting_kernels import closest_hit
from simwarp.sensors.ray_hit_kernels import RayHit
from simwarp.sensors.ray_instances_kernels import RayScene, start_of_ray, world_position

wp.set_module_options(RAY_MODULE_OPTIONS)

CHANNELS = wp.constant(6)
"""Of a return: range, azimuth, elevation, velocity, amplitude, instance."""
DRAWS = wp.constant(4)
"""Random numbers of a ray: angles, range and velocity, amplitude, dropout."""

FAINT = wp.constant(1.0e-20)
"""Amplitude of a return that noise would make negative: 0 means that there is none."""


@wp.struct
class RadarNoiseArrays:
    """Standard deviations and a probability, leading dimension 1 or W."""

    range: wp.array[float]  # [m]
    azimuth: wp.array[float]  # [rad]
    elevation: wp.array[float]  # [rad]
    velocity: wp.array[float]  # [m/s]
    amplitude: wp.array[float]
    threshold: wp.array[float]  # returns that are measured below it are lost
    dropout: wp.array[float]  # share of rays that are lost


@wp.struct
class RadarReturn:
    """Return of one ray."""

    range: float  # [m]
    velocity: float  # range rate, positive: going away [m/s]
    amplitude: float  # 0: nothing
    instance: int
    direction: wp.vec3  # sensor axes


@wp.func
def range_rate(
    world: int, hit: RayHit, point: wp.vec3d, d: wp.vec3, motion: SensorMotion, state: StateArrays, scene: RayScene
) -> float:
    """Speed at which the surface recedes from the sensor [m/s]."""
    body = scene.body[hit.instance]
    v = body_velocity(world, body, state)
    if body >= 0:
        v = v + wp.cross(body_rate(world, body, state), point - state.body_x[world, body])
    return float(wp.dot(v - motion.v, to_double(d)))


@wp.func
def with_noise(
    found: RadarReturn, key: wp.uint64, ray: int, near: float, world: int, noise: RadarNoiseArrays
) -> RadarReturn:
    """A return as it is measured; amplitude 0 where it is lost."""
    result = found
    sigma_h = noise.azimuth[world_row(world, noise.azimuth.shape[0])]
    sigma_v = noise.elevation[world_row(world, noise.elevation.shape[0])]
    if sigma_h > 0.0 or sigma_v > 0.0:
        angles = draw_normals(key, DRAWS * ray)
        result.direction = perturbed_direction(found.direction, sigma_h * angles[0], sigma_v * angles[1])
    sigma_r = noise.range[world_row(world, noise.range.shape[0])]
    sigma_d = noise.velocity[world_row(world, noise.velocity.shape[0])]
    if sigma_r > 0.0 or sigma_d > 0.0:
        drawn = draw_normals(key, DRAWS * ray + 1)
        result.range = wp.max(found.range + sigma_r * drawn[0], near)
        result.velocity = found.velocity + sigma_d * drawn[1]
    sigma_a = noise.amplitude[world_row(world, noise.amplitude.shape[0])]
    if sigma_a > 0.0:
        result.amplitude = wp.max(found.amplitude + sigma_a * draw_normals(key, DRAWS * ray + 2)[0], FAINT)
    if result.amplitude < noise.threshold[world_row(world, noise.threshold.shape[0])]:
        result.amplitude = 0.0
    return result


@wp.func
def write_return(place: int, row: int, found: RadarReturn, returns: wp.array2d[float]):
    """A return; zeros and instance -1 where there is none."""
    at = CHANNELS * place
    if found.amplitude > 0.0:
        d = found.direction
        returns[row, at] = found.range
        returns[row, at + 1] = wp.atan2(d[1], d[0])
        returns[row, at + 2] = wp.atan2(d[2], wp.length(wp.vec2(d[0], d[1])))
        returns[row, at + 3] = found.velocity
        returns[row, at + 4] = found.amplitude
        returns[row, at + 5] = float(found.instance)
    else:
        for k in range(CHANNELS - 1):
            returns[row, at + k] = 0.0
        returns[row, at + 5] = -1.0


@wp.kernel
def scan_radar(
    # inputs
    worlds: WorldRange,
    threads: int,
    scan: Scan,
    falloff: float,  # exponent k of the range law
    backscatter: wp.array2d[float],  # (1 or W, I)
    noise: RadarNoiseArrays,
    state: StateArrays,
    scene: RayScene,
    assets: Assets,
    tick: SampleEvents,
    # outputs
    returns: wp.array2d[float],  # (W·slots, rows · columns · CHANNELS)
):
    """The columns whose time falls into this sub-step; `threads` threads share them."""
    index, thread = wp.tid()
    world = worlds.first + index
    if tick.collecting[world] == 0:
        return
    columns = scan.direction.shape[1]
    begin = column_at(tick.fraction_from[world], columns)
    width = column_at(tick.fraction_to[world], columns) - begin
    key = tick.key[world]
    swept = is_swept(world, scan, tick)
    motion = sensor_motion(world, scan.mount, state)
    x = motion.x
    rot = matrix_to_float(wp.quat_to_matrix(motion.rot))
    dropout = noise.dropout[world_row(world, noise.dropout.shape[0])]
    for place in range(thread, width * scan.direction.shape[0], threads):
        column = begin + place % width
        ray = (place / width) * columns + column
        found = RadarReturn()
        found.direction = scan.direction[place / width, column]
        if dropout <= 0.0 or draw_uniform(key, DRAWS * ray + 3) >= dropout:
            if swept:
                x, rot = sweep_back(column, columns, world, scan, motion, tick)
            d = rot * found.direction
            start = start_of_ray(world, x, scene) + scan.near * d
            hit = closest_hit(world, start, d, scan.far - scan.near, scene, assets)
            if hit.t >= 0.0:
                found.range = scan.near + hit.t
                found.instance = hit.instance
                point = world_position(world, start + hit.t * d, scene)
                found.velocity = range_rate(world, hit, point, d, motion, state, scene)
                strength = backscatter[world_row(world, backscatter.shape[0]), hit.instance]
                found.amplitude = strength * wp.abs(wp.dot(hit.normal, d))
                if falloff > 0.0:
                    found.amplitude *= wp.pow(wp.max(found.range, 1.0e-3), -falloff)
                if found.amplitude > 0.0:
                    found = with_noise(found, key, ray, scan.near, world, noise)
        write_return(ray, tick.row[world], found, returns)
