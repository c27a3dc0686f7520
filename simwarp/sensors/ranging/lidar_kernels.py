"""Lidar: casts the beams whose time has come, reduces their rays to returns, and adds the noise of the detector."""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import matrix_to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.rays.ray_modules import RAY_MODULE_OPTIONS
from simwarp.sensors.clock_kernels import SampleEvents
from simwarp.sensors.random_kernels import draw_normals, draw_uniform
from simwarp.sensors.ranging.beams_kernels import (
    Scan,
    column_at,
    is_swept,
    left_vector,
    offset_direction,
    perturbed_direction,
    sensor_motion,
    sweep_back,
)
from simwarp.sensors.ranging.returns_kernels import MAX_RAYS, ReturnMode, reduce_beam
from simwarp.sensors.ray_casting_kernels import closest_hit
from simwarp.sensors.ray_instances_kernels import RayScene, start_of_ray

wp.set_module_options(RAY_MODULE_OPTIONS)

DRAWS = wp.constant(4)
"""Random numbers of a beam: angles, first return, second return, dropout."""
FAINT = wp.constant(1.0e-6)
"""Intensity of a return that noise would make negative: 0 means that there is none."""


@wp.struct
class LidarSettings:
    """Settings by which beams become returns."""

    mode: int  # ReturnMode
    miss: float  # range that the image shows where nothing returns [m]
    points: int  # 1: write the cloud
    ranges: int  # 1: write the image
    ray: wp.array[wp.vec2]  # tangents of the rays' angles from the beam's axis, to the left and upwards


@wp.struct
class LidarNoiseArrays:
    """Standard deviations and a probability, leading dimension 1 or W."""

    range: wp.array[float]  # [m]
    azimuth: wp.array[float]  # [rad]
    elevation: wp.array[float]  # [rad]
    intensity: wp.array[float]
    threshold: wp.array[float]  # returns that are measured below it are lost
    dropout: wp.array[float]  # share of beams that are lost


@wp.func
def write_return(
    place: int, row: int, found: wp.vec2, direction: wp.vec3, settings: LidarSettings, points: wp.array2d[float],
    ranges: wp.array2d[float],
):  # fmt: skip
    """A return, or the lack of one (intensity 0), as the `place`-th of its frame."""
    there = found[1] > 0.0
    if settings.points == 1:
        point = wp.where(there, found[0], 0.0) * direction
        for k in range(3):
            points[row, 4 * place + k] = point[k]
        points[row, 4 * place + 3] = found[1]
    if settings.ranges == 1:
        ranges[row, 2 * place] = wp.where(there, found[0], settings.miss)
        ranges[row, 2 * place + 1] = found[1]


@wp.func
def measured(found: wp.vec2, key: wp.uint64, draw: int, near: float, world: int, noise: LidarNoiseArrays) -> wp.vec2:
    """(range, intensity) of a return with its noise; zeros where it is lost."""
    if found[1] <= 0.0:
        return wp.vec2()
    r = found[0]
    i = found[1]
    sigma_r = noise.range[world_row(world, noise.range.shape[0])]
    sigma_i = noise.intensity[world_row(world, noise.intensity.shape[0])]
    if sigma_r > 0.0 or sigma_i > 0.0:
        drawn = draw_normals(key, draw)
        r = wp.max(r + sigma_r * drawn[0], near)
        i = wp.max(i + sigma_i * drawn[1], FAINT)
    if i < noise.threshold[world_row(world, noise.threshold.shape[0])]:
        return wp.vec2()
    return wp.vec2(r, i)


@wp.kernel
def scan_lidar(
    # inputs
    worlds: WorldRange,
    threads: int,
    scan: Scan,
    settings: LidarSettings,
    noise: LidarNoiseArrays,
    state: StateArrays,
    scene: RayScene,
    assets: Assets,
    tick: SampleEvents,
    # outputs
    points: wp.array2d[float],  # (W·slots, rows · columns · channels)
    ranges: wp.array2d[float],
):
    """The columns whose time falls into this sub-step; `threads` threads share them."""
    index, thread = wp.tid()
    world = worlds.first + index
    if tick.collecting[world] == 0:
        return
    columns = scan.direction.shape[1]
    begin = column_at(tick.fraction_from[world], columns)
    width = column_at(tick.fraction_to[world], columns) - begin
    row = tick.row[world]
    key = tick.key[world]
    swept = is_swept(world, scan, tick)
    motion = sensor_motion(world, scan.mount, state)
    x = motion.x
    rot = matrix_to_float(wp.quat_to_matrix(motion.rot))
    count = settings.ray.shape[0]
    returns = wp.where(settings.mode == ReturnMode.DUAL, 2, 1)
    range_ = wp.zeros(shape=MAX_RAYS, dtype=float)
    intensity = wp.zeros(shape=MAX_RAYS, dtype=float)
    sigma_h = noise.azimuth[world_row(world, noise.azimuth.shape[0])]
    sigma_v = noise.elevation[world_row(world, noise.elevation.shape[0])]
    dropout = noise.dropout[world_row(world, noise.dropout.shape[0])]
    for place in range(thread, width * scan.direction.shape[0], threads):
        column = begin + place % width
        beam = (place / width) * columns + column
        direction = scan.direction[place / width, column]
        found = wp.vec4()
        if dropout <= 0.0 or draw_uniform(key, DRAWS * beam + 3) >= dropout:
            left = left_vector(direction)
            if swept:
                x, rot = sweep_back(column, columns, world, scan, motion, tick)
            start = start_of_ray(world, x, scene)
            for k in range(count):
                d = rot * offset_direction(direction, left, settings.ray[k])
                hit = closest_hit(world, start + scan.near * d, d, scan.far - scan.near, scene, assets)
                range_[k] = 0.0
                intensity[k] = 0.0
                if hit.t >= 0.0:
                    range_[k] = scan.near + hit.t
                    reflectance = scene.reflectance[world_row(world, scene.reflectance.shape[0]), hit.instance]
                    intensity[k] = reflectance * wp.abs(wp.dot(hit.normal, d))
            found = reduce_beam(settings.mode, count, range_, intensity)
        if sigma_h > 0.0 or sigma_v > 0.0:
            angles = draw_normals(key, DRAWS * beam)
            direction = perturbed_direction(direction, sigma_h * angles[0], sigma_v * angles[1])
        one = measured(wp.vec2(found[0], found[1]), key, DRAWS * beam + 1, scan.near, world, noise)
        write_return(returns * beam, row, one, direction, settings, points, ranges)
        if returns == 2:
            two = measured(wp.vec2(found[2], found[3]), key, DRAWS * beam + 2, scan.near, world, noise)
            write_return(returns * beam + 1, row, two, direction, settings, points, ranges)


@wp.kernel
def count_returns(
    # inputs
    worlds: WorldRange,
    tick: SampleEvents,
    channels: int,
    frame: wp.array2d[float],  # (W·slots, values): intensities are the last of each `channels`
    # outputs
    count: wp.array[int],  # (W·slots,)
):
    """Returns in a frame that is complete."""
    world = worlds.first + wp.tid()
    if tick.complete[world] == 0:
        return
    row = tick.row[world]
    total = int(0)
    for place in range(frame.shape[1] / channels):
        if frame[row, channels * place + channels - 1] > 0.0:
            total += 1
    count[row] = total
