"""Chosen pixels of views: all rays of each, as `render` casts them, and nothing of the others."""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.sensors.cameras.appearance_kernels import AppearanceArrays
from simwarp.sensors.cameras.image_kernels import (
    GEOMETRY,
    GREY,
    JITTER_PURPOSE,
    RGB,
    Camera,
    Outputs,
    Views,
    eye_ray,
    pixel_direction,
    sample_place,
    write_geometry,
)
from simwarp.sensors.cameras.image_processing_kernels import ImagingArrays, byte_of, process
from simwarp.sensors.cameras.shade_kernels import LightArrays, light_along
from simwarp.sensors.random_kernels import subkey
from simwarp.sensors.ray_instances_kernels import RayScene

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.kernel
def render_chosen(
    # inputs
    chunk: int,
    chosen: wp.array[wp.vec2i],
    camera: Camera,
    views: Views,
    scene: RayScene,
    assets: Assets,
    appearance: AppearanceArrays,
    lights: LightArrays,
    imaging: ImagingArrays,
    # outputs
    outputs: Outputs,
):
    """A thread takes `chunk` of the chosen (view, pixel), each of a frame that one moment fills."""
    part = wp.tid()
    for place in range(part * chunk, wp.min((part + 1) * chunk, chosen.shape[0])):
        view = chosen[place][0]
        pixel = chosen[place][1]
        world = views.world[view]
        eye = views.start[view]
        rot = views.rot[view]
        slot = views.row[view]
        key = views.key[view]
        jitter = subkey(key, JITTER_PURPOSE)
        row = pixel / camera.width
        column = pixel - row * camera.width
        ahead = pixel_direction(float(column) + 0.5, float(row) + 0.5, camera)
        light = wp.vec3()
        for sample in range(camera.samples):
            within = sample_place(sample, pixel, jitter, camera)
            direction = rot * pixel_direction(float(column) + within[0], float(row) + within[1], camera)
            hit = eye_ray(world, eye, direction, camera, scene, assets)
            light += light_along(
                world, eye, direction, hit, camera.far, camera.spread, lights, scene, assets, appearance
            )  # fmt: skip
        value = process(world, light / float(camera.samples), ahead[0], pixel, key, imaging)
        if (camera.outputs & RGB) != 0:
            outputs.rgb[slot, 3 * pixel] = byte_of(value[0])
            outputs.rgb[slot, 3 * pixel + 1] = byte_of(value[1])
            outputs.rgb[slot, 3 * pixel + 2] = byte_of(value[2])
        if (camera.outputs & GREY) != 0:
            outputs.grey[slot, pixel] = byte_of(wp.clamp(wp.dot(camera.grey, value), 0.0, 1.0))
        if (camera.outputs & GEOMETRY) != 0:
            middle = eye_ray(world, eye, rot * ahead, camera, scene, assets)
            write_geometry(view, pixel, middle, ahead, camera, views, scene, outputs)
