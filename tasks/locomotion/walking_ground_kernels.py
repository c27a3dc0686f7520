"""Device half of rough ground: which patch a world shows, heights below points, and the curriculum of levels."""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.vector_math import to_double
from simwarp.sensors.ray_casting_kernels import closest_hit
from simwarp.sensors.ray_instances_kernels import RayScene, start_of_ray

from ..framework.randomness_kernels import Draws, bits_at, episode_key

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

SLOWEST = wp.constant(1.0e-3)
"""A command below this asks for no way [m/s]."""


@wp.struct
class Patches:
    """Patches that worlds share, and what is shown of them. Patch (k L + l) V + v is of kind k, level l, variant v."""

    shape: int  # the ground's in the model
    kinds: int  # K
    levels: int  # L
    variants: int  # V
    asset: wp.array[int]  # (K L V,)
    shape_asset: wp.array2d[int]  # (W, S) the model's
    instance: int  # the ground's in a scene
    tint: wp.array[wp.vec3]  # (L,) linear colours of the levels
    color: wp.array2d[wp.vec3]  # (W, I) the scene's; no entries: nobody looks


@wp.struct
class Heights:
    """What a height below a point is made of: little, as every thread of a CPU copies it."""

    shape: int  # the ground's in the model
    nodes: int  # along each side
    scale: float  # cells per metre
    shape_asset: wp.array2d[int]  # (W, S) the model's
    start: wp.array[int]  # of the model's height fields in
    height: wp.array[float]  # all of their nodes [m]


@wp.struct
class Rules:
    """How levels are chosen."""

    first: int  # worlds begin to climb on levels 0 to this
    fixed: int  # level of worlds that do not climb; -1: any
    reach: float  # distance from the middle to where a patch is left [m]
    beyond: float  # distance from the middle that is to be exceeded to go up [m]
    up: float  # share of the way that is enough to go up
    down: float  # share of the commanded way below which a world goes down
    least: float  # commanded way below which nothing is decided [m]
    again: int  # 1: who masters the last level goes to a random one; 0: it stays
    begin: wp.array[wp.uint64]  # streams: first level of a climb,
    kind: wp.array[wp.uint64]  # kind of a world that does not climb,
    level: wp.array[wp.uint64]  # its level, or that of a world that mastered the last one,
    variant: wp.array[wp.uint64]


@wp.struct
class Climb:
    """State of the worlds, (W,)."""

    climbing: wp.array[int]  # 1: levels follow what the robot achieves
    judged: wp.array[int]  # 1: the running episode is part of a climb
    kind: wp.array[wp.int64]  # index among the kinds that there are
    level: wp.array[wp.int64]
    variant: wp.array[wp.int64]
    walked: wp.array[float]  # way along the command in this episode [m]
    asked: wp.array[float]  # way that was commanded so far [m]
    expected: wp.array[float]  # and up to the end of the episode, if it goes on as now [m]
    farthest: wp.array[float]  # from the middle, along x or y, in this episode [m]


@wp.func
def whole_at(stream: wp.array[wp.uint64], world: int, draws: Draws, count: int) -> wp.int64:
    """Uniform whole number in [0, count)."""
    bits = bits_at(episode_key(stream, world, draws), 0) >> wp.uint64(32)
    return wp.int64((bits * wp.uint64(count)) >> wp.uint64(32))


@wp.func
def show_patch(world: int, patches: Patches, climb: Climb):
    """Put the patch of a world's state into the model, and its colour into the scene."""
    level = int(climb.level[world])
    patch = (int(climb.kind[world]) * patches.levels + level) * patches.variants + int(climb.variant[world])
    patches.shape_asset[world, patches.shape] = patches.asset[patch]
    if patches.color.shape[0] > 0:
        patches.color[world, patches.instance] = patches.tint[level]


@wp.func
def level_after(world: int, levels: int, rules: Rules, draws: Draws, climb: Climb) -> wp.int64:
    """Level that follows from an episode that is over, or the first one of a climb."""
    level = climb.level[world]
    walked = climb.walked[world]
    expected = climb.expected[world]
    if climb.judged[world] == 0:
        return whole_at(rules.begin, world, draws, rules.first + 1)
    if expected < rules.least:
        return level
    if walked > rules.up * wp.min(rules.reach, expected) and climb.farthest[world] > rules.beyond:
        if level + wp.int64(1) < wp.int64(levels):
            return level + wp.int64(1)
        if rules.again == 0:
            return level
        return whole_at(rules.level, world, draws, levels)
    if walked < rules.down * expected:
        return wp.max(level - wp.int64(1), wp.int64(0))
    return level


@wp.kernel
def choose_patch(
    # inputs
    mask: wp.array[wp.bool], rules: Rules, draws: Draws, patches: Patches,
    # outputs
    climb: Climb,
):  # fmt: skip
    """Gives the worlds of a mask a patch for a new episode."""
    world = wp.tid()
    if not mask[world]:
        return
    if climb.climbing[world] == 1:
        climb.level[world] = level_after(world, patches.levels, rules, draws, climb)
        climb.kind[world] = draws.world[world] % wp.int64(patches.kinds)
        climb.judged[world] = 1
    else:
        climb.kind[world] = whole_at(rules.kind, world, draws, patches.kinds)
        level = wp.int64(rules.fixed)
        if rules.fixed < 0:
            level = whole_at(rules.level, world, draws, patches.levels)
        climb.level[world] = level
        climb.judged[world] = 0
    climb.variant[world] = whole_at(rules.variant, world, draws, patches.variants)
    climb.walked[world] = 0.0
    climb.asked[world] = 0.0
    climb.expected[world] = 0.0
    climb.farthest[world] = 0.0
    show_patch(world, patches, climb)


@wp.kernel
def show_patches(patches: Patches, climb: Climb):
    """Shows in every world what its state says."""
    show_patch(wp.tid(), patches, climb)


@wp.kernel
def record_walk(
    # inputs
    velocity: wp.array[wp.vec2], command: wp.array[wp.vec2], position: wp.array[wp.vec3], clock: wp.array[wp.int64],
    limit: int, dt: float,
    # outputs
    climb: Climb,
):  # fmt: skip
    """Counts the way of a control step along what was commanded, and no more of it than that."""
    world = wp.tid()
    speed = wp.length(command[world])
    if speed > SLOWEST:
        along = wp.dot(velocity[world], command[world]) / speed
        climb.walked[world] = climb.walked[world] + dt * wp.min(along, speed)
        climb.asked[world] = climb.asked[world] + dt * speed
    away = wp.max(wp.abs(position[world][0]), wp.abs(position[world][1]))
    climb.farthest[world] = wp.max(climb.farthest[world], away)
    left = wp.max(wp.int64(limit) - clock[world], wp.int64(0))
    climb.expected[world] = climb.asked[world] + speed * dt * float(left)


@wp.func
def ground_height(world: int, x: float, y: float, ground: Heights) -> float:
    """Height of the ground in a world [m], of the triangles that feet stand on; beyond the border that of its nearest
    point. What `height_field_height` tells in float64, with a normal: in float32 places are off by a micrometre.
    """
    if not wp.isfinite(x + y):
        return 0.0  # a world that broke down
    last = float(ground.nodes - 1)
    u = wp.clamp(x * ground.scale + 0.5 * last, 0.0, last)
    v = wp.clamp(y * ground.scale + 0.5 * last, 0.0, last)
    i = wp.min(int(u), ground.nodes - 2)
    j = wp.min(int(v), ground.nodes - 2)
    s = u - float(i)
    t = v - float(j)
    node = ground.start[ground.shape_asset[world, ground.shape]] + j * ground.nodes + i
    low = ground.height[node]
    high = ground.height[node + ground.nodes + 1]
    # cells are cut from node (i, j) to node (i + 1, j + 1)
    if t > s:
        other = ground.height[node + ground.nodes]
        return low + t * (other - low) + s * (high - other)
    beside = ground.height[node + 1]
    return low + s * (beside - low) + t * (high - beside)


@wp.func
def grid_point(position: wp.vec3, heading: wp.vec2, offset: wp.vec2) -> wp.vec2:
    """World place of a point that is given ahead and to the left of a robot [m]."""
    x = heading[0] * offset[0] - heading[1] * offset[1]
    y = heading[1] * offset[0] + heading[0] * offset[1]
    return wp.vec2(position[0] + x, position[1] + y)


@wp.kernel
def measure_heights(
    # inputs
    point: wp.array2d[wp.vec2], ground: Heights,
    # outputs
    height: wp.array2d[float],
):  # fmt: skip
    """Heights at points of each world."""
    world, i = wp.tid()
    p = point[world, i]
    height[world, i] = ground_height(world, p[0], p[1], ground)


@wp.kernel
def scan_field(
    # inputs
    position: wp.array[wp.vec3], heading: wp.array[wp.vec2], threads: int, grid: wp.array[wp.vec2], stand: float,
    limit: float, ground: Heights,
    # outputs
    scan: wp.array2d[float],
):  # fmt: skip
    """Heights of the patch below the grid, over that of the feet of a robot that stands.

    The threads of a world share its points: one on a CPU, as many as there are points on a GPU.
    """
    world, first = wp.tid()
    base = position[world]
    for i in range(first, grid.shape[0], threads):
        p = grid_point(base, heading[world], grid[i])
        height = ground_height(world, p[0], p[1], ground)
        scan[world, i] = wp.clamp(height - (base[2] - stand), -limit, limit)


@wp.kernel
def scan_plane(
    # inputs
    position: wp.array[wp.vec3], heading: wp.array[wp.vec2], threads: int, grid: wp.array[wp.vec2], stand: float,
    limit: float,
    # outputs
    scan: wp.array2d[float],
):  # fmt: skip
    """The same over the plane z = 0."""
    world, first = wp.tid()
    for i in range(first, grid.shape[0], threads):
        scan[world, i] = wp.clamp(stand - position[world][2], -limit, limit)


@wp.kernel
def scan_rays(
    # inputs
    position: wp.array[wp.vec3], heading: wp.array[wp.vec2], threads: int, grid: wp.array[wp.vec2], stand: float,
    limit: float, lift: float, scene: RayScene, assets: Assets,
    # outputs
    scan: wp.array2d[float],
):  # fmt: skip
    """The same by rays straight down, from `lift` above the base: what they meet first is the ground."""
    world, first = wp.tid()
    base = position[world]
    for i in range(first, grid.shape[0], threads):
        p = grid_point(base, heading[world], grid[i])
        start = start_of_ray(world, to_double(wp.vec3(p[0], p[1], base[2] + lift)), scene)
        # a ray that meets nothing within this length is clipped all the same
        hit = closest_hit(world, start, wp.vec3(0.0, 0.0, -1.0), lift + stand + limit, scene, assets)
        scan[world, i] = wp.where(hit.t < 0.0, -limit, wp.clamp(lift + stand - hit.t, -limit, limit))
