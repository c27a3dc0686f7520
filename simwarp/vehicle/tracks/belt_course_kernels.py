"""A belt around its wheels: circles, straight parts, the idler that tightens it, and its points; in the belt's plane.

Plane, circles and points are those of belts_kernels.
"""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.vehicle.tracks.belt_tables_kernels import (
    BeltMemory,
    BeltParameter,
    BeltTables,
    BeltWork,
    PointKind,
    WheelColumn,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

PI = wp.constant(3.14159265)
LONGEST_MOVE = wp.constant(0.05)  # of an idler in one step: far from the solution its equation is not linear [m]
LEAST_LEVER = wp.constant(0.2)  # of the tension along the slide; less only where idler and wheels have met


@wp.func
def cross2(a: wp.vec2, b: wp.vec2) -> float:
    """Positive if b points to the left of a."""
    return a[0] * b[1] - a[1] * b[0]


@wp.func
def outward(along: wp.vec2) -> wp.vec2:
    """Normal of a span, off the wheels: the belt runs clockwise, from the sprocket below the wheels to the idler."""
    return wp.vec2(-along[1], along[0])


@wp.func
def turn_between(before: wp.vec2, after: wp.vec2) -> float:
    """Angle by which the belt turns around a wheel, negative where a wheel stands above its neighbours' tangent."""
    return -wp.atan2(cross2(before, after), wp.dot(before, after))


@wp.func
def far_turn(before: wp.vec2, after: wp.vec2) -> float:
    """The same around sprocket and idler, where it is about half a turn."""
    turn = turn_between(before, after)
    return wp.where(turn < -0.5 * PI, turn + 2.0 * PI, turn)


@wp.func
def place_circles(
    world: int, belt: int, p: wp.array[float], tables: BeltTables, state: StateArrays, memory: BeltMemory,
    work: BeltWork,
):  # fmt: skip
    """Centres and radii of all circles, and how the wheels move in the chassis."""
    last = tables.wheels[belt] + 1
    for wheel in range(last - 1):
        row = tables.wheel[belt, wheel]
        dof = tables.arm[belt, wheel]
        sense = row[WheelColumn.SENSE]
        angle = sense * float(state.joint_x[world, dof])
        c = wp.cos(angle)
        s = wp.sin(angle)
        arm = wp.vec2(row[WheelColumn.ARM_X] * c + row[WheelColumn.ARM_Z] * s,
                      row[WheelColumn.ARM_Z] * c - row[WheelColumn.ARM_X] * s)  # fmt: skip
        lever = sense * wp.vec2(arm[1], -arm[0])
        work.center[world, belt, wheel + 1] = wp.vec2(row[WheelColumn.HINGE_X], row[WheelColumn.HINGE_Z]) + arm
        work.lever[world, belt, wheel + 1] = lever
        work.motion[world, belt, wheel + 1] = lever * state.joint_qd[world, dof]
        work.radius[world, belt, wheel + 1] = row[WheelColumn.RADIUS]
    slide = wp.vec2(p[BeltParameter.SLIDE_X], p[BeltParameter.SLIDE_Z])
    built = wp.vec2(p[BeltParameter.IDLER_X], p[BeltParameter.IDLER_Z])
    work.center[world, belt, 0] = wp.vec2()
    work.radius[world, belt, 0] = p[BeltParameter.SPROCKET_RADIUS]
    work.center[world, belt, last] = built + memory.idler[world, belt] * slide
    work.radius[world, belt, last] = p[BeltParameter.IDLER_RADIUS]
    for circle in range(last + 1):
        following = wp.where(circle == last, 0, circle + 1)
        way = work.center[world, belt, following] - work.center[world, belt, circle]
        drop = work.radius[world, belt, circle] - work.radius[world, belt, following]
        square = wp.max(wp.dot(way, way), 1.0e-6)
        length = wp.sqrt(wp.max(square - drop * drop, 0.0))
        along = wp.vec2(way[0] * length + way[1] * drop, way[1] * length - way[0] * drop) / square
        work.along[world, belt, circle] = along
        work.length[world, belt, circle] = length
        work.start[world, belt, circle] = work.center[world, belt, circle] + work.radius[world, belt, circle] * outward(
            along
        )


@wp.func
def tighten(world: int, belt: int, p: wp.array[float], tables: BeltTables, memory: BeltMemory, work: BeltWork) -> float:
    """One step of Newton for the idler's place, at which the belt has its length; returns the tension."""
    last = tables.wheels[belt] + 1
    excess = memory.bulge[world, belt] - p[BeltParameter.LENGTH]
    pushed = float(0.0)  # rate of the way around by the wheels' motion
    for circle in range(last + 1):
        before = work.along[world, belt, wp.where(circle == 0, last, circle - 1)]
        after = work.along[world, belt, circle]
        turn = turn_between(before, after)
        if circle == 0 or circle == last:
            turn = far_turn(before, after)
        else:
            pushed += wp.dot(before - after, work.motion[world, belt, circle])
        excess += work.length[world, belt, circle] + work.radius[world, belt, circle] * turn
    slide = wp.vec2(p[BeltParameter.SLIDE_X], p[BeltParameter.SLIDE_Z])
    lever = wp.dot(work.along[world, belt, last] - work.along[world, belt, last - 1], slide)
    lever = wp.where(lever < 0.0, wp.min(lever, -LEAST_LEVER), wp.max(lever, LEAST_LEVER))
    stiffness = p[BeltParameter.TENSIONER_STIFFNESS]
    force = p[BeltParameter.TENSIONER_FORCE]
    x = memory.idler[world, belt]
    stretch = p[BeltParameter.STRETCH]
    slope = lever + stretch * stiffness / lever
    excess -= stretch * (force + stiffness * x) / lever
    x += wp.clamp(excess / slope, -LONGEST_MOVE, LONGEST_MOVE)
    memory.idler[world, belt] = x
    return wp.max((force + stiffness * x + p[BeltParameter.TENSIONER_DAMPING] * pushed / slope) / lever, 0.0)


@wp.func
def wheel_direction(before: wp.vec2, after: wp.vec2) -> wp.vec2:
    """Direction of the belt where a wheel meets the ground: level, if the belt is that anywhere around the wheel."""
    rising = before[1] > 0.0
    falling = after[1] < 0.0
    if rising and not falling:
        return before
    if falling and not rising:
        return after
    return wp.vec2(-1.0, 0.0)


@wp.func
def place_of_point(world: int, belt: int, point: int, depth: float, tables: BeltTables, work: BeltWork) -> wp.vec2:
    """A point on the ground's side of the belt, in the belt's plane [m]."""
    kind = tables.kind[belt, point]
    place = tables.place[belt, point]
    share = tables.share[belt, point]
    if kind == PointKind.SPAN:
        along = work.along[world, belt, place]
        pin = work.start[world, belt, place] + share * work.length[world, belt, place] * along
        return pin + depth * outward(along)
    direction = wp.vec2()
    if kind == PointKind.WHEEL:
        direction = outward(wheel_direction(work.along[world, belt, place - 1], work.along[world, belt, place]))
    elif kind == PointKind.SPROCKET:
        direction = wp.normalize((1.0 - share) * outward(work.along[world, belt, 0]) + share * wp.vec2(1.0, 0.0))
    else:
        direction = wp.normalize(
            (1.0 - share) * outward(work.along[world, belt, place - 1]) + share * wp.vec2(-1.0, 0.0)
        )
    return work.center[world, belt, place] + (work.radius[world, belt, place] + depth) * direction


@wp.func
def wheels_motion(world: int, belt: int, point: int, tables: BeltTables, work: BeltWork) -> wp.vec2:
    """Velocity of a point by the wheels' motion in the chassis, in the belt's plane [m/s]."""
    kind = tables.kind[belt, point]
    place = tables.place[belt, point]
    if kind != PointKind.SPAN:
        return work.motion[world, belt, place]
    share = tables.share[belt, point]
    return (1.0 - share) * work.motion[world, belt, place] + share * work.motion[world, belt, place + 1]
