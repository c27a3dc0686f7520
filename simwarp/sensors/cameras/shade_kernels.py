"""Light that comes along a ray: surfaces lit by suns, lamps and the sky, shadows, fog. All in linear light.

Surfaces are matt (Lambert). White is 1: a white surface that faces a sun of colour 1 sends 1 towards the camera.
"""

import warp as wp

from simwarp.kernels.collision.shape import HULL, MESH, Assets
from simwarp.kernels.core.tables import world_row
from simwarp.sensors.cameras.appearance_kernels import AppearanceArrays, surface_color
from simwarp.sensors.ray_casting_kernels import any_hit
from simwarp.sensors.ray_hit_kernels import RayHit
from simwarp.sensors.ray_instances_kernels import RayScene, start_of_ray

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

LIFT = wp.constant(4.0e-6)  # of distances: shadow rays start this far off a surface, which float32 has misplaced
LIFT_LEAST = wp.constant(2.0e-5)  # [m]
PRESSED_DARKER = wp.constant(0.45)  # share of its albedo that deeply pressed soil loses: it is dense, and smooth
PRESSED_DEPTH = wp.constant(0.02)  # over which it gets dark [m]


@wp.struct
class LightArrays:
    """Lights of all worlds; leading dimension 1 or W."""

    shadows: int
    shadow_reach: float  # distance towards a sun within which occluders count [m]
    sun_direction: wp.array2d[wp.vec3]  # (1 or W, suns) unit, towards the sun
    sun_color: wp.array2d[wp.vec3]
    lamp_position: wp.array2d[wp.vec3d]  # (1 or W, lamps) world [m]
    lamp_color: wp.array2d[wp.vec3]  # at 1 m
    ambient_above: wp.array[wp.vec3]  # on surfaces that look up
    ambient_below: wp.array[wp.vec3]
    sky_zenith: wp.array[wp.vec3]
    sky_horizon: wp.array[wp.vec3]
    sky_below: wp.array[wp.vec3]
    fog_density: wp.array[float]  # [1/m]
    fog_color: wp.array[wp.vec3]


@wp.func
def sky_color(world: int, direction: wp.vec3, lights: LightArrays) -> wp.vec3:
    """Colour of the sky: from the horizon to the zenith with the square root of the sine of the elevation."""
    horizon = lights.sky_horizon[world_row(world, lights.sky_horizon.shape[0])]
    if direction[2] <= 0.0:
        return lights.sky_below[world_row(world, lights.sky_below.shape[0])]
    share = wp.sqrt(direction[2])
    return (1.0 - share) * horizon + share * lights.sky_zenith[world_row(world, lights.sky_zenith.shape[0])]


@wp.func
def fogged(world: int, light: wp.vec3, distance: float, lights: LightArrays) -> wp.vec3:
    """Light after so much fog: exp(-density distance) of it, the rest of the fog's colour."""
    density = lights.fog_density[world_row(world, lights.fog_density.shape[0])]
    if density <= 0.0:
        return light
    clear = wp.exp(-density * distance)
    return clear * light + (1.0 - clear) * lights.fog_color[world_row(world, lights.fog_color.shape[0])]


@wp.func
def light_on(
    world: int, point: wp.vec3, normal: wp.vec3, travelled: float, lights: LightArrays, scene: RayScene, assets: Assets
) -> wp.vec3:  # fmt: skip
    """Light that a white surface at a point sends back.

    Args:
        world: index.
        point: as rays have it [m].
        normal: unit, on the side that is looked at.
        travelled: length of the ray that found the point [m], for its error.
        lights: of all worlds.
        scene: instances that cast shadows.
        assets: its geometry.
    """
    up = 0.5 + 0.5 * normal[2]
    total = up * lights.ambient_above[world_row(world, lights.ambient_above.shape[0])]
    total += (1.0 - up) * lights.ambient_below[world_row(world, lights.ambient_below.shape[0])]
    lift = LIFT_LEAST + LIFT * (travelled + wp.length(point))
    start = point + lift * normal
    for sun in range(lights.sun_direction.shape[1]):
        towards = lights.sun_direction[world_row(world, lights.sun_direction.shape[0]), sun]
        cosine = wp.dot(normal, towards)
        if cosine > 0.0:
            hidden = int(0)
            if lights.shadows == 1:
                hidden = any_hit(world, start, towards, lights.shadow_reach, scene, assets)
            if hidden == 0:
                total += cosine * lights.sun_color[world_row(world, lights.sun_color.shape[0]), sun]
    for lamp in range(lights.lamp_position.shape[1]):
        way = (
            start_of_ray(world, lights.lamp_position[world_row(world, lights.lamp_position.shape[0]), lamp], scene)
            - start
        )
        square = wp.dot(way, way)
        distance = wp.sqrt(square)
        cosine = wp.dot(normal, way)
        if cosine > 0.0:
            hidden = int(0)
            if lights.shadows == 1:
                hidden = any_hit(world, start, way / distance, distance, scene, assets)
            if hidden == 0:
                total += (cosine / (distance * square)) * lights.lamp_color[
                    world_row(world, lights.lamp_color.shape[0]), lamp
                ]
    return total


@wp.func
def facing(normal: wp.vec3, direction: wp.vec3) -> wp.vec3:
    """The normal on the side from which a ray comes."""
    if wp.dot(normal, direction) > 0.0:
        return -normal
    return normal


@wp.func
def hit_color(
    world: int, hit: RayHit, footprint: float, scene: RayScene, appearance: AppearanceArrays
) -> wp.vec3:  # fmt: skip
    """Linear albedo of what a ray hit."""
    instance = hit.instance
    kind = scene.kind[instance]
    tree = int(-1)
    if kind == MESH or kind == HULL:
        tree = scene.place_asset[world, instance]
    color = surface_color(
        scene.color[world_row(world, scene.color.shape[0]), instance],
        scene.texture[world_row(world, scene.texture.shape[0]), instance],
        tree, hit.triangle, hit.bary, hit.local, footprint, appearance,
    )  # fmt: skip
    if hit.drop > 0.0:
        color *= 1.0 - PRESSED_DARKER * (1.0 - wp.exp(-hit.drop / PRESSED_DEPTH))
    return color


@wp.func
def light_along(
    world: int, start: wp.vec3, direction: wp.vec3, hit: RayHit, reach: float, spread: float, lights: LightArrays,
    scene: RayScene, assets: Assets, appearance: AppearanceArrays,
) -> wp.vec3:  # fmt: skip
    """Linear light that comes along a ray.

    Args:
        world: index.
        start: of the ray [m].
        direction: of the ray, unit.
        hit: its nearest hit.
        reach: distance of what it does not hit [m].
        spread: width of a sample at a distance of 1 m [m].
        lights, scene, assets, appearance: the scene and its lighting.
    """
    if hit.t < 0.0:
        return fogged(world, sky_color(world, direction, lights), reach, lights)
    normal = facing(hit.normal, direction)
    # a sample on a slanting surface is longer than wide: something between both
    slant = wp.max(-wp.dot(normal, direction), 1.0e-3)
    footprint = spread * hit.t / wp.sqrt(slant)
    albedo = hit_color(world, hit, footprint, scene, appearance)
    arriving = light_on(world, start + hit.t * direction, normal, hit.t, lights, scene, assets)
    return fogged(world, wp.cw_mul(albedo, arriving), hit.t, lights)
