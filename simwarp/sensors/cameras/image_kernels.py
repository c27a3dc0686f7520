"""Images: rays through the pixels of all views that are due, and what they bring back.

A view is a camera in one world. A pixel is the mean of its rays, which may be spread over several sub-steps (motion
blur); depth, normals and the like are those of one ray through its middle when the frame is complete.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.rays.ray_modules import RAY_MODULE_OPTIONS
from simwarp.sensors.cameras.appearance_kernels import AppearanceArrays
from simwarp.sensors.cameras.image_processing_kernels import ImagingArrays, byte_of, process
from simwarp.sensors.cameras.lenses_kernels import Lens, lens_direction
from simwarp.sensors.cameras.shade_kernels import LightArrays, facing, light_along
from simwarp.sensors.clock_kernels import BEGIN, SampleEvents
from simwarp.sensors.motion.mount_motion_kernels import MountArrays, mount_position, mount_rotation
from simwarp.sensors.random_kernels import draw_bits, subkey
from simwarp.sensors.ray_casting_kernels import closest_hit
from simwarp.sensors.ray_hit_kernels import RayHit
from simwarp.sensors.ray_instances_kernels import RayScene, start_of_ray

wp.set_module_options(RAY_MODULE_OPTIONS)

RGB = wp.constant(1)
GREY = wp.constant(2)
DEPTH = wp.constant(4)
RANGE = wp.constant(8)
NORMALS = wp.constant(16)
INSTANCE = wp.constant(32)
SEMANTIC = wp.constant(64)
LIGHT = wp.constant(1 + 2)  # outputs that need light
GEOMETRY = wp.constant(4 + 8 + 16 + 32 + 64)  # those that need a ray through the middle
JITTER_PURPOSE = wp.constant(2)
UNIT = wp.constant(2.3283064365386963e-10)  # 2^-32


@wp.struct
class Camera:
    """Numbers of a camera, shared by all its views."""

    width: int
    height: int
    lens: Lens
    outputs: int  # bits
    side: int  # a pixel has side x side strata
    stride: int  # the next ray's stratum; no common divisor with side²
    samples: int  # rays of a pixel in one frame
    near: float  # rays start this far from the camera [m]
    far: float  # and end this far from it [m]
    spread: float  # width of a ray's share of the image at 1 m [m]
    grey: wp.vec3  # weights of the channels


@wp.struct
class Views:
    """Poses and sample ranges of all views in this launch."""

    world: wp.array[int]
    start: wp.array[wp.vec3]  # of its rays, as rays have it [m]
    rot: wp.array[wp.mat33]  # camera axes to world axes
    sample_from: wp.array[int]  # rays [from, to) of every pixel are cast now
    sample_to: wp.array[int]
    samples: wp.array[int]  # of the whole frame
    first: wp.array[int]  # 1: forget the sum
    complete: wp.array[int]  # 1: the frame is done
    row: wp.array[int]  # of the outputs
    key: wp.array[wp.uint64]


@wp.struct
class Outputs:
    """Frames as rows of (pixels x channels) values."""

    rgb: wp.array2d[wp.uint8]
    grey: wp.array2d[wp.uint8]
    depth: wp.array2d[float]  # along the axis [m]
    range: wp.array2d[float]  # along the ray [m]
    normals: wp.array2d[float]
    instance: wp.array2d[int]
    semantic: wp.array2d[int]


@wp.kernel
def aim_views(
    # inputs
    worlds: WorldRange,
    camera: Camera,
    mount: MountArrays,
    tick: SampleEvents,
    state: StateArrays,
    scene: RayScene,
    # outputs
    views: Views,
):
    """The views of a mounted camera, one per world, as its clock says."""
    world = worlds.first + wp.tid()
    views.world[world] = world
    views.sample_from[world] = 0
    views.sample_to[world] = 0
    views.complete[world] = 0
    lit = camera.outputs & LIGHT
    if tick.collecting[world] == 0 or (lit == 0 and tick.complete[world] == 0):
        return
    views.start[world] = start_of_ray(world, mount_position(world, mount, state), scene)
    rot = wp.quat_to_matrix(mount_rotation(world, mount, state))
    views.rot[world] = wp.mat33(
        float(rot[0, 0]), float(rot[0, 1]), float(rot[0, 2]),
        float(rot[1, 0]), float(rot[1, 1]), float(rot[1, 2]),
        float(rot[2, 0]), float(rot[2, 1]), float(rot[2, 2]),
    )  # fmt: skip
    views.first[world] = tick.first[world]
    views.complete[world] = tick.complete[world]
    views.row[world] = tick.row[world]
    views.key[world] = tick.key[world]
    if lit != 0:
        # a world that stands still needs no rays over time
        samples = camera.samples
        if tick.mode[world] == BEGIN:
            samples = camera.side * camera.side
        views.samples[world] = samples
        views.sample_from[world] = int(wp.round(tick.fraction_from[world] * float(samples)))
        views.sample_to[world] = int(wp.round(tick.fraction_to[world] * float(samples)))


@wp.kernel
def aim_freely(
    # inputs
    worlds: WorldRange,
    camera: Camera,
    place: wp.array[wp.vec3d],  # world [m]
    scene: RayScene,
    # outputs
    views: Views,
):
    """Views whose world and axes are set already: a whole frame from these places, now."""
    view = worlds.first + wp.tid()
    views.start[view] = start_of_ray(views.world[view], place[view], scene)
    views.samples[view] = camera.samples
    views.sample_from[view] = 0
    views.sample_to[view] = camera.samples
    if (camera.outputs & LIGHT) == 0:
        views.sample_to[view] = 0
    views.first[view] = 1
    views.complete[view] = 1
    views.row[view] = view


@wp.func
def sample_place(sample: int, pixel: int, key: wp.uint64, camera: Camera) -> wp.vec2:
    """Position of a ray in its pixel, 0 to 1: at random in its stratum; the middle where there is but one."""
    if camera.side == 1:
        return wp.vec2(0.5, 0.5)
    strata = camera.side * camera.side
    stratum = (sample * camera.stride) % strata
    bits = draw_bits(key, pixel * camera.samples + sample)
    x = float(wp.uint32(bits >> wp.uint64(32))) * UNIT
    y = float(wp.uint32(bits & wp.uint64(0xFFFFFFFF))) * UNIT
    side = float(camera.side)
    return wp.vec2((float(stratum % camera.side) + x) / side, (float(stratum / camera.side) + y) / side)


@wp.func
def pixel_direction(column: float, row: float, camera: Camera) -> wp.vec3:
    """Direction in the camera's axes of a place of the image, in pixels from its upper left corner."""
    scale = 1.0 / float(camera.width)
    return lens_direction(
        2.0 * column * scale - 1.0, (float(camera.height) - 2.0 * row) * scale, camera.lens
    )  # fmt: skip


@wp.func
def eye_ray(
    world: int, eye: wp.vec3, direction: wp.vec3, camera: Camera, scene: RayScene, assets: Assets
) -> RayHit:  # fmt: skip
    """Hit of a ray from the camera between near and far; its t counts from the camera."""
    hit = closest_hit(world, eye + camera.near * direction, direction, camera.far - camera.near, scene, assets)
    if hit.t >= 0.0:
        hit.t += camera.near
    return hit


@wp.func
def write_geometry(
    view: int, pixel: int, hit: RayHit, ahead: wp.vec3, camera: Camera, views: Views, scene: RayScene, outputs: Outputs
):  # fmt: skip
    """Depth, range, normal and labels of a pixel; `ahead`: the ray's direction in the camera's axes."""
    slot = views.row[view]
    distance = camera.far
    depth = camera.far
    normal = wp.vec3()
    label = int(-1)
    if hit.t >= 0.0:
        distance = hit.t
        depth = distance * ahead[0]
        normal = facing(wp.transpose(views.rot[view]) * hit.normal, ahead)
        label = scene.label[hit.instance]
    if (camera.outputs & DEPTH) != 0:
        outputs.depth[slot, pixel] = depth
    if (camera.outputs & RANGE) != 0:
        outputs.range[slot, pixel] = distance
    if (camera.outputs & NORMALS) != 0:
        outputs.normals[slot, 3 * pixel] = normal[0]
        outputs.normals[slot, 3 * pixel + 1] = normal[1]
        outputs.normals[slot, 3 * pixel + 2] = normal[2]
    if (camera.outputs & INSTANCE) != 0:
        outputs.instance[slot, pixel] = hit.instance
    if (camera.outputs & SEMANTIC) != 0:
        outputs.semantic[slot, pixel] = label


@wp.kernel
def render(
    # inputs
    worlds: WorldRange,
    chunk: int,
    camera: Camera,
    views: Views,
    scene: RayScene,
    assets: Assets,
    appearance: AppearanceArrays,
    lights: LightArrays,
    imaging: ImagingArrays,
    # outputs
    sums: wp.array2d[wp.vec3],
    outputs: Outputs,
):
    """A thread takes `chunk` pixels of a view."""
    index, part = wp.tid()
    view = worlds.first + index
    sample_from = views.sample_from[view]
    sample_to = views.sample_to[view]
    complete = views.complete[view]
    if sample_from == sample_to and complete == 0:
        return
    world = views.world[view]
    eye = views.start[view]
    rot = views.rot[view]
    slot = views.row[view]
    key = views.key[view]
    jitter = subkey(key, JITTER_PURPOSE)
    total = camera.width * camera.height
    weight = 1.0 / float(wp.max(views.samples[view], 1))
    lit = camera.outputs & LIGHT
    # the only ray of a pixel is that through its middle
    shared = int(0)
    if lit != 0 and camera.side == 1:
        shared = 1
    for pixel in range(part * chunk, wp.min((part + 1) * chunk, total)):
        row = pixel / camera.width
        column = pixel - row * camera.width
        ahead = pixel_direction(float(column) + 0.5, float(row) + 0.5, camera)
        direction = rot * ahead
        hit = RayHit()
        if lit != 0:
            light = wp.vec3()
            if views.first[view] == 0:
                light = sums[view, pixel]
            for sample in range(sample_from, sample_to):
                if shared == 0:
                    place = sample_place(sample, pixel, jitter, camera)
                    direction = rot * pixel_direction(float(column) + place[0], float(row) + place[1], camera)
                hit = eye_ray(world, eye, direction, camera, scene, assets)
                light += light_along(
                    world, eye, direction, hit, camera.far, camera.spread, lights, scene, assets, appearance
                )  # fmt: skip
            if complete == 1:
                value = process(world, weight * light, ahead[0], pixel, key, imaging)
                if (camera.outputs & RGB) != 0:
                    outputs.rgb[slot, 3 * pixel] = byte_of(value[0])
                    outputs.rgb[slot, 3 * pixel + 1] = byte_of(value[1])
                    outputs.rgb[slot, 3 * pixel + 2] = byte_of(value[2])
                if (camera.outputs & GREY) != 0:
                    outputs.grey[slot, pixel] = byte_of(wp.clamp(wp.dot(camera.grey, value), 0.0, 1.0))
            else:
                sums[view, pixel] = light
        if complete == 1 and (camera.outputs & GEOMETRY) != 0:
            if shared == 0:
                hit = eye_ray(world, eye, rot * ahead, camera, scene, assets)
            write_geometry(view, pixel, hit, ahead, camera, views, scene, outputs)
