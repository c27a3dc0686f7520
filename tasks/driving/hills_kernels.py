"""Device half of hilly ground: which field a world shows, and the heights of the triangles that tires stand on."""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

FLATTEST = wp.constant(1e-3)
"""Least factor of the heights: a height field must not be flat altogether."""
AROUND = wp.constant(1.2)
"""Distance of the four places that a normal is made of [m]."""


@wp.struct
class HillTables:
    """Fields and what each world shows of them; without fields the ground is flat."""

    side: float  # of a field [m]
    heights: wp.array3d[float]  # (F, rows along y, columns along x) as shares of the factor
    assets: wp.array[int]  # (F,)
    shape: int  # the ground's in the model
    field: wp.array[wp.int64]  # (W,) what a world shows
    shape_asset: wp.array2d[int]  # (W, S) the model's, which tires read too
    shape_size: wp.array2d[wp.vec3]  # (W, S) the model's


@wp.func
def choose_hill(world: int, field: int, amplitude: float, hills: HillTables):
    """Give a world a field and an amplitude [m]."""
    hills.field[world] = wp.int64(field)
    hills.shape_asset[world, hills.shape] = hills.assets[field]
    size = hills.shape_size[world, hills.shape]
    size[2] = wp.max(amplitude, FLATTEST)
    hills.shape_size[world, hills.shape] = size


@wp.func
def hill_height(world: int, place: wp.vec2, hills: HillTables) -> float:
    """Height of the ground [m]."""
    if hills.heights.shape[0] == 0:
        return 0.0
    rows = float(hills.heights.shape[1])
    columns = float(hills.heights.shape[2])
    u = wp.clamp((place[0] / hills.side + 0.5) * (columns - 1.0), 0.0, columns - 1.001)
    v = wp.clamp((place[1] / hills.side + 0.5) * (rows - 1.0), 0.0, rows - 1.001)
    i = int(u)
    j = int(v)
    s = u - float(i)
    t = v - float(j)
    field = int(hills.field[world])
    low = hills.heights[field, j, i]
    high = hills.heights[field, j + 1, i + 1]
    # cells are cut from node (i, j) to node (i + 1, j + 1)
    other = hills.heights[field, j, i + 1]
    first = s
    second = t
    if t > s:
        other = hills.heights[field, j + 1, i]
        first = t
        second = s
    return hills.shape_size[world, hills.shape][2] * (low + first * (other - low) + second * (high - other))


@wp.func
def hill_normal(world: int, place: wp.vec2, hills: HillTables) -> wp.vec3:
    """Unit normal of the plane through the ground around a place."""
    x = hill_height(world, place + wp.vec2(AROUND, 0.0), hills) - hill_height(
        world, place - wp.vec2(AROUND, 0.0), hills
    )
    y = hill_height(world, place + wp.vec2(0.0, AROUND), hills) - hill_height(
        world, place - wp.vec2(0.0, AROUND), hills
    )
    return wp.normalize(wp.vec3(-x / (2.0 * AROUND), -y / (2.0 * AROUND), 1.0))


@wp.kernel
def show_hills(mask: wp.array[wp.bool], field: wp.array[wp.int64], amplitude: wp.array[float], hills: HillTables):
    """Give some worlds fields and amplitudes [m]."""
    world = wp.tid()
    if mask[world]:
        choose_hill(world, int(field[world]), amplitude[world], hills)


@wp.kernel
def measure_heights(place: wp.array2d[wp.vec2], hills: HillTables, height: wp.array2d[float]):
    """Heights at places of each world."""
    world, i = wp.tid()
    height[world, i] = hill_height(world, place[world, i], hills)


@wp.kernel
def measure_normals(place: wp.array[wp.vec2], hills: HillTables, normal: wp.array[wp.vec3]):
    """Normals at one place of each world."""
    world = wp.tid()
    normal[world] = hill_normal(world, place[world], hills)
