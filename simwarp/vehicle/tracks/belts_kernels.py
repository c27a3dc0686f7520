"""Forces of belts: tracks without shoes. One thread per belt of a world, then one per world that sums them up.

A belt's plane has x towards the sprocket and z up, from the track's origin, in axes of the chassis: `forward` is 1 with
the sprocket in front and -1 with it behind. Circles are the sprocket (0), the road wheels (1 to n, from the sprocket's
end on) and the idler (n + 1); span c leads from circle c to circle c + 1, the last one from the idler back.
Points are those of the belt that may touch the ground, from the sprocket to the idler.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double, to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.soil.bekker_janosi_kernels import Law, law_of
from simwarp.vehicle.tires.ground_kernels import TerrainTables, friction_at, ground_below
from simwarp.vehicle.tracks.belt_contact_kernels import (
    Pressed,
    press_hard,
    press_soil,
    soil_traction_of,
    traction_of,
)
from simwarp.vehicle.tracks.belt_tables_kernels import (
    BeltMemory,
    BeltParameter,
    BeltReports,
    BeltTables,
    BeltWork,
    PointKind,
    WheelColumn,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


PI = wp.constant(3.14159265)
LIFT = wp.constant(0.5)  # above a point from where a mesh is looked for [m]
LONGEST_MOVE = wp.constant(0.05)  # of an idler in one step: far from the solution its equation is not linear [m]
LEAST_LEVER = wp.constant(0.2)  # of the tension along the slide; less only where idler and wheels have met
LEAST_STIFFNESS = wp.constant(1.0)  # of a slack span [N/m]
SHORTEST = wp.constant(1.0e-3)  # of the way between two points [m]
LEAST_SINK = wp.constant(1.0e-9)  # of a wheel in the belt [m/N]: 0.1 mm under 100 kN
SLOW = wp.constant(0.05)  # speed of a belt below which points slide as where they are [m/s]
SHEAR_ENOUGH = wp.constant(6.0)  # lengths after which soil has its full shear but 0.2 %


@wp.struct
class Frame:
    """Place and motion of a belt's chassis in the world."""

    x: wp.vec3d  # of its centre of mass [m]
    ahead: wp.vec3  # its axes
    left: wp.vec3
    up: wp.vec3
    v: wp.vec3
    omega: wp.vec3
    origin: wp.vec3  # of the track, from the centre of mass, world axes [m]


@wp.struct
class Belt:
    """Numbers of a belt in this step."""

    tension: float
    speed: float
    traction: float
    force: wp.vec3
    torque: wp.vec3


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
def frame_of(world: int, belt: int, tables: BeltTables, state: StateArrays) -> Frame:
    """Place and motion of a belt's chassis."""
    body = tables.chassis[belt]
    q = state.body_rot[world, body]
    axes = wp.quat_to_matrix(q)
    frame = Frame()
    frame.x = state.body_x[world, body]
    frame.ahead = wp.vec3(float(axes[0, 0]), float(axes[1, 0]), float(axes[2, 0]))
    frame.left = wp.vec3(float(axes[0, 1]), float(axes[1, 1]), float(axes[2, 1]))
    frame.up = wp.vec3(float(axes[0, 2]), float(axes[1, 2]), float(axes[2, 2]))
    frame.v = state.body_v[world, body]
    frame.omega = state.body_omega[world, body]
    frame.origin = to_float(wp.quat_rotate(q, to_double(tables.origin_b[belt])))
    return frame


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
def find_ground(
    world: int, belt: int, depth: float, frame: Frame, terrain: TerrainTables, assets: Assets, tables: BeltTables,
    work: BeltWork, reports: BeltReports,
):  # fmt: skip
    """Places of all points, and the ground below them."""
    forward = tables.forward[belt]
    for point in range(tables.points[belt]):
        place = place_of_point(world, belt, point, depth, tables, work)
        arm = frame.origin + forward * place[0] * frame.ahead + place[1] * frame.up
        below = ground_below(world, frame.x, arm, LIFT, terrain, assets)
        work.place[world, belt, point] = place
        work.ground[world, belt, point] = below.arm
        work.normal[world, belt, point] = float(below.found) * below.normal
        reports.point_arm[world, belt, point] = arm


@wp.func
def bridged_normal(world: int, belt: int, point: int, tables: BeltTables, work: BeltWork) -> wp.vec3:
    """Normal of the ground, along the belt that of the line through the ground below both neighbours."""
    normal = work.normal[world, belt, point]
    if point == 0 or point == tables.points[belt] - 1:
        return normal
    a = work.normal[world, belt, point - 1]
    b = work.normal[world, belt, point + 1]
    if a[2] == 0.0 or b[2] == 0.0:
        return normal
    line = wp.normalize(work.ground[world, belt, point + 1] - work.ground[world, belt, point - 1])
    return wp.normalize(normal - wp.dot(normal, line) * line)


@wp.func
def belt_normal(
    world: int, belt: int, point: int, risen: float, frame: Frame, tables: BeltTables, work: BeltWork
) -> wp.vec3:  # fmt: skip
    """Normal of the belt at a point, towards the vehicle, world axes; `risen` is the slope of its lift."""
    place = tables.place[belt, point]
    along = work.along[world, belt, place]
    if tables.kind[belt, point] != PointKind.SPAN:
        before = work.along[world, belt, wp.max(place - 1, 0)]
        along = wp.normalize(before + along)
        if tables.kind[belt, point] == PointKind.SPROCKET:
            along = work.along[world, belt, 0]
        elif tables.kind[belt, point] == PointKind.IDLER:
            along = before
    inward = wp.normalize(-outward(along) - risen * along)
    return tables.forward[belt] * inward[0] * frame.ahead + inward[1] * frame.up


@wp.func
def load_wheels(
    world: int, belt: int, point: int, force: float, along: wp.vec2, tables: BeltTables, work: BeltWork,
    reports: BeltReports, joint_force: wp.array2d[float],
):  # fmt: skip
    """Shares a normal force between the wheels beside it by lever; the chassis holds sprocket and idler.

    Args:
        force: [N].
        along: its direction in the belt's plane.
    """
    kind = tables.kind[belt, point]
    place = tables.place[belt, point]
    share = tables.share[belt, point]
    wheels = tables.wheels[belt]
    if kind == PointKind.SPROCKET or kind == PointKind.IDLER:
        return
    first = 1.0 - share
    second = share
    if kind == PointKind.WHEEL:
        first = 1.0
        second = 0.0
    if place >= 1:
        joint_force[world, tables.arm[belt, place - 1]] += first * force * wp.dot(along, work.lever[world, belt, place])
        reports.load[world, belt, place - 1] += first * force
    if second > 0.0 and place < wheels:
        joint_force[world, tables.arm[belt, place]] += (
            second * force * wp.dot(along, work.lever[world, belt, place + 1])
        )
        reports.load[world, belt, place] += second * force


@wp.func
def wheels_motion(world: int, belt: int, point: int, tables: BeltTables, work: BeltWork) -> wp.vec2:
    """Velocity of a point by the wheels' motion in the chassis, in the belt's plane [m/s]."""
    kind = tables.kind[belt, point]
    place = tables.place[belt, point]
    if kind != PointKind.SPAN:
        return work.motion[world, belt, place]
    share = tables.share[belt, point]
    return (1.0 - share) * work.motion[world, belt, place] + share * work.motion[world, belt, place + 1]


@wp.struct
class Beside:
    """A point's neighbours along the belt."""

    before: int  # itself, at an end
    after: int
    to_before: float  # [m]
    to_after: float
    length: float  # of the belt that the point stands for [m]


@wp.func
def beside(world: int, belt: int, point: int, tables: BeltTables, work: BeltWork) -> Beside:
    """A point's neighbours along the belt."""
    last = tables.points[belt] - 1
    found = Beside()
    found.before = wp.max(point - 1, 0)
    found.after = wp.min(point + 1, last)
    here = work.place[world, belt, point]
    found.to_before = wp.max(wp.length(here - work.place[world, belt, found.before]), SHORTEST)
    found.to_after = wp.max(wp.length(work.place[world, belt, found.after] - here), SHORTEST)
    found.length = 0.5 * (found.to_before + found.to_after)
    if point == 0 or point == last:
        found.length = wp.where(point == 0, found.to_after, found.to_before)
    return found


@wp.func
def press_down(
    world: int, belt: int, point: int, depth: float, rate: float, moved: float, near: Beside, p: wp.array[float],
    law: Law, now: Belt, tables: BeltTables, memory: BeltMemory,
) -> Pressed:  # fmt: skip
    """The normal force on a point, and the lift of the belt, a string between its neighbours' lifts.

    Args:
        depth: of the belt without lift below the ground [m].
        rate: of that [m/s].
        moved: way of the vehicle in this step, towards the sprocket [m].
        near: the point's neighbours.
    """
    before = now.tension / near.to_before
    after = now.tension / near.to_after
    backing = before + after + LEAST_STIFFNESS
    pulled = before * memory.lift[world, belt, near.before] + after * memory.lift[world, belt, near.after]
    share = tables.share[belt, point]
    if tables.kind[belt, point] != PointKind.SPAN or share == 0.0 or share == 1.0:
        backing += 1.0 / wp.max(p[BeltParameter.WHEEL_SINK], LEAST_SINK)
    found = Pressed()
    if tables.soft == 1:
        # the rut stays in the ground, over which the vehicle moves
        entering = wp.where(moved >= 0.0, point - 1, point + 1)
        step = wp.abs(moved) / wp.where(moved >= 0.0, near.to_before, near.to_after)
        rut = float(0.0)
        if entering >= 0 and entering < tables.points[belt]:
            rut = memory.sinkage[world, belt, entering]
        deepest = (memory.sinkage[world, belt, point] + step * rut) / (1.0 + step)
        found = press_soil(depth, rate, pulled / backing, backing, near.length, deepest, law, p)
        memory.sinkage[world, belt, point] = found.sinkage
    else:
        found = press_hard(depth, rate, pulled / backing, backing, near.length, p)
    memory.lift[world, belt, point] = found.lift
    risen = found.lift - memory.lift[world, belt, near.before]
    memory.bulge[world, belt] += 0.5 * risen * risen / near.to_before
    return found


@wp.func
def slide(
    world: int, belt: int, point: int, onwards: int, dt: float, most: float, axis: wp.vec3, across: wp.vec3,
    near: Beside, frame: Frame, now: Belt, tables: BeltTables, memory: BeltMemory, reports: BeltReports,
) -> wp.vec2:  # fmt: skip
    """The way that the belt has slid over the ground when it comes to a point, at most `most` [m].

    It brings along what it had slid at the point before, and slides on the way as midways, so that the sum over points
    is of second order; a belt at rest slides as its points do.
    """
    upstream = wp.clamp(point - onwards, 0, tables.points[belt] - 1)
    speed = wp.abs(now.speed)
    step = speed * dt / wp.where(upstream < point, near.to_before, near.to_after)
    arm = reports.point_arm[world, belt, point]
    midways = 0.5 * speed / (speed + SLOW)
    between = frame.v + wp.cross(frame.omega, arm + midways * (reports.point_arm[world, belt, upstream] - arm))
    slid = dt * wp.vec2(wp.dot(between, axis) - now.speed, wp.dot(between, across))
    arriving = wp.vec2()
    if upstream != point:
        arriving = memory.shear[world, belt, upstream]
    shear = (memory.shear[world, belt, point] + slid + step * arriving) / (1.0 + step)
    shear *= wp.min(most / wp.max(wp.length(shear), 1.0e-9), 1.0)
    memory.shear[world, belt, point] = shear
    return shear


@wp.func
def press_point(
    world: int, belt: int, point: int, onwards: int, dt: float, p: wp.array[float], law: Law, friction: wp.array[float],
    frame: Frame, now: Belt, terrain: TerrainTables, tables: BeltTables, memory: BeltMemory, work: BeltWork,
    reports: BeltReports, joint_force: wp.array2d[float],
) -> wp.vec3:  # fmt: skip
    """Force of the ground on a point, world axes [N]; `onwards` is 1 where the belt's lower side moves towards the
    idler, which is the direction in which points are taken, else -1.
    """
    forward = tables.forward[belt]
    near = beside(world, belt, point, tables, work)
    normal = bridged_normal(world, belt, point, tables, work)
    arm = reports.point_arm[world, belt, point]
    depth = (work.ground[world, belt, point][2] - arm[2]) * normal[2]
    velocity = frame.v + wp.cross(frame.omega, arm)
    swing = wheels_motion(world, belt, point, tables, work)
    rate = -wp.dot(velocity + forward * swing[0] * frame.ahead + swing[1] * frame.up, normal)
    moved = forward * wp.dot(velocity, frame.ahead) * dt
    pressed = press_down(world, belt, point, depth, rate, moved, near, p, law, now, tables, memory)
    work.pull[world, belt, point] = 0.0
    if pressed.force <= 0.0 or normal[2] == 0.0:
        memory.shear[world, belt, point] = wp.vec2()
        return wp.vec3()
    axis = wp.normalize(frame.ahead - wp.dot(frame.ahead, normal) * normal)
    across = wp.cross(normal, axis)
    slip = wp.vec2(wp.dot(velocity, axis) - now.speed, wp.dot(velocity, across))
    most = p[BeltParameter.SHEAR_LENGTH]
    if tables.soft == 1:
        most = SHEAR_ENOUGH * law.shear_length
    shear = slide(world, belt, point, onwards, dt, most, axis, across, near, frame, now, tables, memory, reports)
    pull = wp.vec2()
    push = normal
    if tables.soft == 1:
        pull = soil_traction_of(shear, slip, pressed.force, pressed.area, law, p[BeltParameter.SHEAR_DAMPING])
        risen = memory.lift[world, belt, near.after] - memory.lift[world, belt, near.before]
        risen /= near.to_before + near.to_after
        push = belt_normal(world, belt, point, risen, frame, tables, work)
    else:
        road = friction_at(world, frame.x + to_double(arm), friction, terrain)
        pull = traction_of(shear, slip, pressed.force, wp.min(road, p[BeltParameter.FRICTION]), p)
    work.pull[world, belt, point] = forward * pull[0]
    in_plane = wp.vec2(forward * wp.dot(push, frame.ahead), wp.dot(push, frame.up))
    load_wheels(world, belt, point, pressed.force, in_plane, tables, work, reports, joint_force)
    return pressed.force * push + pull[0] * axis + pull[1] * across


@wp.func
def pull_wheels(
    world: int, belt: int, tension: float, tables: BeltTables, work: BeltWork, joint_force: wp.array2d[float]
) -> float:  # fmt: skip
    """The tension's forces on the wheels; returns what the ground pulls towards the sprocket [N].

    The tensioner sets the tension at the idler. Towards the sprocket it falls by what the ground pulls that way.
    """
    pulled = float(0.0)
    count = tables.points[belt]
    for k in range(count):
        point = count - 1 - k
        pull = work.pull[world, belt, point]
        if tables.kind[belt, point] == PointKind.WHEEL:
            circle = tables.place[belt, point]
            there = wp.max(tension - pulled - 0.5 * pull, 0.0)
            bend = work.along[world, belt, circle] - work.along[world, belt, circle - 1]
            joint_force[world, tables.arm[belt, circle - 1]] += there * wp.dot(bend, work.lever[world, belt, circle])
        pulled += pull
    return pulled


@wp.func
def resist(
    world: int, belt: int, dt: float, tension: float, pulled: float, load: float, speed: float, p: wp.array[float],
    memory: BeltMemory,
) -> float:  # fmt: skip
    """Resistance of a belt to its motion, positive forwards [N]: dry, over a short way, and growing with the speed.

    Args:
        tension: at the idler, and of the upper run [N].
        pulled: what the ground pulls towards the sprocket, by which the lower run's tension falls until there [N].
        load: of the road wheels [N].
    """
    most = p[BeltParameter.LOSS_WAY]
    way = wp.clamp(memory.loss_way[world, belt] + dt * speed, -most, most)
    memory.loss_way[world, belt] = way
    at_sprocket = wp.max(tension - 0.5 * pulled, 0.0)
    dry = p[BeltParameter.LOSS_DRY] * tension + p[BeltParameter.LOSS_SPROCKET] * at_sprocket
    dry += p[BeltParameter.LOSS_ROLLING] * load
    viscous = p[BeltParameter.LOSS_LINEAR] * speed + p[BeltParameter.LOSS_SQUARE] * wp.abs(speed) * speed
    return -(dry * way / most + tension * viscous)


@wp.kernel
def run_belts(
    worlds: WorldRange, dt: float, tables: BeltTables, parameter: wp.array3d[float], soil: wp.array3d[float],
    ground_friction: wp.array[float], terrain: TerrainTables, assets: Assets, state: StateArrays, memory: BeltMemory,
    work: BeltWork, reports: BeltReports, joint_force: wp.array2d[float],
):  # fmt: skip
    """Forces of all belts; dim (W, belts).

    Args:
        dt: step over which the forces will act [s].
        tables: see there.
        parameter: (1 or W, belts, BeltParameter).
        soil: (1 or W, 1, SoilParameter), read where `tables.soft` is 1.
        ground_friction: (1 or W,) friction of the ground.
        terrain, assets: the ground.
        state: of bodies and joints.
        memory: in and out.
        work: of this step.
        reports: out.
        joint_force: (W, D) in and out: entries of arms are written, those of shafts added to or written.
    """
    index, belt = wp.tid()
    world = worlds.first + index
    p = parameter[world_row(world, parameter.shape[0]), belt]
    frame = frame_of(world, belt, tables, state)
    shaft = tables.shaft[belt]
    radius = p[BeltParameter.PITCH_RADIUS]
    place_circles(world, belt, p, tables, state, memory, work)
    now = Belt()
    now.tension = tighten(world, belt, p, tables, memory, work)
    now.speed = radius * state.joint_qd[world, shaft]
    find_ground(world, belt, p[BeltParameter.DEPTH], frame, terrain, assets, tables, work, reports)
    law = Law()
    if tables.soft == 1:
        law = law_of(world_row(world, soil.shape[0]), 0, 1.0 / p[BeltParameter.PATCH], soil)
    for wheel in range(tables.wheels[belt]):
        joint_force[world, tables.arm[belt, wheel]] = 0.0
        reports.load[world, belt, wheel] = 0.0
    count = tables.points[belt]
    memory.bulge[world, belt] = 0.0
    onwards = wp.where(tables.forward[belt] * now.speed >= 0.0, 1, -1)
    for k in range(count):
        point = wp.where(onwards > 0, k, count - 1 - k)
        force = press_point(
            world, belt, point, onwards, dt, p, law, ground_friction, frame, now, terrain, tables, memory, work,
            reports, joint_force,
        )  # fmt: skip
        reports.point_force[world, belt, point] = force
        now.force += force
        now.torque += wp.cross(reports.point_arm[world, belt, point], force)
    pulled = pull_wheels(world, belt, now.tension, tables, work, joint_force)
    traction = tables.forward[belt] * pulled
    load = float(0.0)
    for wheel in range(tables.wheels[belt]):
        load += reports.load[world, belt, wheel]
    resistance = resist(world, belt, dt, now.tension, pulled, load, now.speed, p, memory)
    torque = radius * (resistance - traction)
    joint_force[world, shaft] = wp.where(tables.add == 1, joint_force[world, shaft], 0.0) + torque
    reports.tension[world, belt] = now.tension
    reports.speed[world, belt] = now.speed
    reports.traction[world, belt] = traction
    reports.resistance[world, belt] = resistance
    reports.force[world, belt] = now.force
    reports.torque[world, belt] = now.torque


@wp.kernel
def sum_belts(
    worlds: WorldRange, tables: BeltTables, reports: BeltReports, force: wp.array2d[wp.vec3],
    torque: wp.array2d[wp.vec3],
):  # fmt: skip
    """The belts' forces on chassis, in the order of the belts; dim W. Sums that threads share have no order.

    Args:
        tables: see there.
        reports: of `run_belts`.
        force: (W, B) in and out, at the centre of mass, world axes [N].
        torque: (W, B) in and out [N·m].
    """
    world = worlds.first + wp.tid()
    count = tables.chassis.shape[0]
    if tables.add == 0:
        for belt in range(count):
            force[world, tables.chassis[belt]] = wp.vec3()
            torque[world, tables.chassis[belt]] = wp.vec3()
    for belt in range(count):
        body = tables.chassis[belt]
        force[world, body] += reports.force[world, belt]
        torque[world, body] += reports.torque[world, belt]
