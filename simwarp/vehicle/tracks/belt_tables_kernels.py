"""What the kernels of belts take: parameters, tables, what they remember, a step's own numbers, reports."""

from enum import IntEnum

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


class BeltParameter(IntEnum):
    """Columns of `Belts.parameter`."""

    FRICTION = 0
    WIDTH = 1  # area of pads that presses soil, per length of the belt [m]
    DEPTH = 2  # of the ground's side below the pins [m]
    GROUND_STIFFNESS = 3  # per length [N/m²]
    GROUND_DAMPING = 4  # time [s]
    SHEAR_LENGTH = 5  # [m]
    SHEAR_DAMPING = 6  # time [s]
    WHEEL_SINK = 7  # of a wheel in the belt, per force [m/N]
    LENGTH = 8  # of the belt [m]
    STRETCH = 9  # of the belt, per tension [m/N]
    SPROCKET_RADIUS = 10  # of the belt's path [m]
    IDLER_RADIUS = 11
    PITCH_RADIUS = 12  # speed of the belt per sprocket's speed [m]
    IDLER_X = 13  # of the idler as built [m]
    IDLER_Z = 14
    SLIDE_X = 15  # direction in which its coordinate grows
    SLIDE_Z = 16
    TENSIONER_FORCE = 17  # as built, against that direction [N]
    TENSIONER_STIFFNESS = 18  # [N/m]
    TENSIONER_DAMPING = 19  # [N·s/m]
    LOSS_DRY = 20  # resistance per tension
    LOSS_LINEAR = 21  # [s/m]
    LOSS_SQUARE = 22  # [s²/m²]
    LOSS_WAY = 23  # over which the dry resistances come up [m]
    LOSS_SPROCKET = 24  # resistance per mean tension of the runs at the sprocket
    LOSS_ROLLING = 25  # per load of the road wheels
    PATCH = 26  # b of Bekker's law: twice the area of a pad over its perimeter [m]
    SIDE_WIDTH = 27  # area of pads beside these, per length of the belt [m]
    SIDE_HEIGHT = 28  # of those above these [m]


class WheelColumn(IntEnum):
    """Columns of `BeltTables.wheel`, in the belt's plane."""

    HINGE_X = 0
    HINGE_Z = 1
    ARM_X = 2  # from the hinge to the wheel's centre, as built [m]
    ARM_Z = 3
    RADIUS = 4  # of the belt's path [m]
    SENSE = 5  # 1: the arm's coordinate turns from z to x


class PointKind(IntEnum):
    """Where a point of the belt lies."""

    SPAN = 0
    """On a straight part: `place` is the span, `share` the way along it."""
    WHEEL = 1
    """Under the wheel of circle `place`."""
    SPROCKET = 2
    """Before the sprocket: `share` of the turn from the lower span to straight ahead."""
    IDLER = 3


COLUMNS = wp.constant(len(BeltParameter))
WHEEL_COLUMNS = wp.constant(len(WheelColumn))


@wp.struct
class BeltTables:
    """Constants, shared by all worlds. First axis: belt."""

    chassis: wp.array[int]  # body
    shaft: wp.array[int]  # degree of freedom
    arm: wp.array2d[int]  # degrees of freedom, wheel by wheel
    wheels: wp.array[int]  # how many
    points: wp.array[int]  # how many
    origin_b: wp.array[wp.vec3]  # of the track from the chassis' centre of mass, body axes [m]
    forward: wp.array[float]
    wheel: wp.array3d[float]  # (belts, wheels, WheelColumn)
    kind: wp.array2d[int]  # (belts, points) PointKind
    place: wp.array2d[int]
    share: wp.array2d[float]
    add: int  # 1: another element writes chassis and shafts before
    soft: int  # 1: on soil


@wp.struct
class BeltMemory:
    """What outlives a step, (W, belts) and (W, belts, points)."""

    idler: wp.array2d[float]  # coordinate along the slide, positive as the slide's [m]
    loss_way: wp.array2d[float]  # [m]
    bulge: wp.array2d[float]  # by which the lift lengthens the way around [m]
    lift: wp.array3d[float]  # of the belt by the ground, off the wheels' common tangents [m]
    shear: wp.array3d[wp.vec2]  # way over the ground since it was touched: forwards, to the left [m]
    sinkage: wp.array3d[float]  # deepest of the soil below [m]


@wp.struct
class BeltWork:
    """A step's own numbers, (W, belts, circles) and (W, belts, points)."""

    center: wp.array3d[wp.vec2]  # of circles [m]
    lever: wp.array3d[wp.vec2]  # motion of a wheel's centre per rate of its arm [m]
    motion: wp.array3d[wp.vec2]  # of circles' centres in the chassis [m/s]
    radius: wp.array3d[float]  # of the path [m]
    start: wp.array3d[wp.vec2]  # of spans [m]
    along: wp.array3d[wp.vec2]  # unit, of spans
    length: wp.array3d[float]  # of spans [m]
    place: wp.array3d[wp.vec2]  # of points, on the ground's side [m]
    ground: wp.array3d[wp.vec3]  # below points, from the chassis' centre of mass, world axes [m]
    normal: wp.array3d[wp.vec3]  # of the ground; zero: there is none
    pull: wp.array3d[float]  # of the ground on points, towards the sprocket [N]


@wp.struct
class BeltReports:
    """Outputs, (W, belts) but for the last three."""

    tension: wp.array2d[float]  # at the idler [N]
    speed: wp.array2d[float]  # of the belt around the wheels, positive forwards [m/s]
    traction: wp.array2d[float]  # of the ground, forwards [N]
    resistance: wp.array2d[float]  # of the belt to its motion, positive forwards [N]
    force: wp.array2d[wp.vec3]  # of the ground on the belt, world axes [N]
    torque: wp.array2d[wp.vec3]  # about the chassis' centre of mass [N·m]
    load: wp.array3d[float]  # (W, belts, wheels) of the ground on wheels, from the sprocket's end on [N]
    point_force: wp.array3d[wp.vec3]  # (W, belts, points) [N]
    point_arm: wp.array3d[wp.vec3]  # (W, belts, points) from the chassis' centre of mass, world axes [m]
