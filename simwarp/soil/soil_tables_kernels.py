"""What the kernels of the soil take: constants, the nodes in pages, the shapes that sink in, what they report."""

import warp as wp

from simwarp.vehicle.tires.ground_kernels import TerrainTables

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

PAGE_NODES = wp.constant(64)
SINKAGE = wp.constant(0)  # of plastic origin, z_p [m]
YIELD = wp.constant(1)  # pressure at which the node yields [Pa]
SHEAR = wp.constant(2)  # way that was sheared, J [m]
LEAN_X = wp.constant(3)  # direction of the shear, in the plane of the ground
LEAN_Y = wp.constant(4)
NODE_VALUES = wp.constant(5)

WHEEL = wp.constant(0)  # a cylinder about its axis
BOX = wp.constant(1)
BALL = wp.constant(2)
CAPSULE = wp.constant(3)
BLADE = wp.constant(4)  # cuts soil ahead of its edge, and presses on no node


@wp.struct
class SoilTables:
    """Constants of a soil. Arrays have leading dimension 1 (shared) or W."""

    spacing: float  # of the nodes [m]
    weighted: int  # 1: a node counts by the share of its cell that lies inside a wheel's width or below a box
    scalar_shear: int  # 1: shear without a direction of its own (Chrono's law)
    along_surface: int  # 1: pressure acts along the normal of a shape's surface, 0: of the undeformed ground
    length: float  # over which the direction of shear relaxes [m]
    rest_time: float  # displacement that holds a node at rest, per speed [s]
    rest_speed: float  # above which a node slides [m/s]
    pushed: float  # share of what a shape presses down that rises beside it; 0: none, and no node has a raise
    parameter: wp.array3d[float]  # (1 or W, soils, PARAMETERS)
    soil_map: wp.array3d[int]  # (1 or W, rows along y, columns along x) soils; no entries: soil 0 everywhere
    map_origin: wp.vec2d  # corner of the map's first cell, world [m]
    map_cell: wp.vec2d  # size of its cells [m]
    terrain: TerrainTables  # the undeformed ground


@wp.struct
class SoilShapes:
    """What sinks in, shared by all worlds. First axis: shape."""

    kind: wp.array[int]  # WHEEL, BOX, BALL, CAPSULE or BLADE
    body: wp.array[int]
    offset_b: wp.array[wp.vec3]  # of the shape's centre from the centre of mass, body axes [m]
    axis_b: wp.array[wp.vec3]  # of a wheel or capsule; the third of a box
    side_b: wp.array[wp.vec3]  # the first axis of a box
    radius: wp.array[float]  # of a wheel, ball or capsule; of the ball around a box [m]
    half_width: wp.array[float]  # of a wheel; half the straight length of a capsule [m]
    crown: wp.array[float]  # radius of a wheel's tread across [m]; 0: it is flat
    half: wp.array[wp.vec3]  # of a box [m]
    alone: wp.array[int]  # 1: nothing else that the soil or an element before it does acts on the body
    shared: wp.array[int]  # the other bodies that have shapes
    member_start: wp.array[int]  # CSR over them
    member: wp.array[int]  # their shapes
    adds: wp.array[int]  # 1 where another element writes the forces of such a body first, 2: its blocks too


@wp.struct
class SoilBlades:
    """Blades among the shapes, shared by all worlds: their axis is up, their side ahead. First axis: blade."""

    shape: wp.array[int]
    width: wp.array[float]  # of the edge [m]
    rake: wp.array[float]  # of the face, from the ground ahead [rad]
    friction: wp.array[float]  # angle of friction between face and soil [rad]
    adhesion: wp.array[float]  # between them [Pa]
    repose: wp.array[float]  # tangent of the angle that heaps slide down to
    reach: wp.array[float]  # ahead and beyond the ends, within which soil slides [m]


@wp.struct
class SoilNodes:
    """Nodes that were touched, in pages of 8 x 8. First axis: world."""

    node: wp.array3d[float]  # (W, pages * PAGE_NODES, NODE_VALUES)
    place_x: wp.array2d[int]  # (W, pages) of a page: first node / SIDE
    place_y: wp.array2d[int]
    used_at: wp.array2d[int]  # (W, pages) step in which it last was below a shape
    entry: wp.array2d[int]  # (W, entries) open addressing: page + 1, 0 where there is none
    count: wp.array[int]  # (W,) pages in use
    step: wp.array[int]  # (W,) steps so far
    recycled: wp.array[int]  # (W,) pages that were taken again, with the ruts in them
    foot: wp.array2d[wp.vec4i]  # (W, shapes) nodes below each in this step: columns from, to, rows from, to
    deepest: wp.array2d[float]  # (W, shapes) greatest drop of a node that each has left [m]
    # of bulldozing; (W, 0) without
    raised: wp.array2d[float]  # (W, pages * PAGE_NODES) height above the undeformed ground [m]
    highest: wp.array2d[float]  # (W, shapes) greatest such height that each has left [m]
    pending: wp.array2d[float]  # (W, shapes) sum of nodes' drops that is to rise beside each [m]


@wp.struct
class SoilReports:
    """Outputs, (W, shapes), and what a sub-step has to give back."""

    load: wp.array2d[float]  # vertical force [N]
    sinkage: wp.array2d[float]  # of the soil below the shape's centre [m]
    slip_ratio: wp.array2d[float]  # of a wheel, positive when driving
    touched: wp.array2d[int]  # nodes with pressure
    force_w: wp.array2d[wp.vec3]  # on the shape, at its centre [N]
    torque_w: wp.array2d[wp.vec3]  # about its centre [N·m]
    before_v: wp.array2d[wp.vec3]  # velocity of the body before the sub-step
    before_omega: wp.array2d[wp.vec3]
    pushed: wp.array2d[wp.vec3]  # force before the velocity changed [N]
    turned: wp.array2d[wp.vec3]  # moment about the body's centre of mass, likewise [N·m]
    mass: wp.array2d[wp.mat33]  # blocks of D, as `Control.element_mass` and the others
    coupling: wp.array2d[wp.mat33]
    inertia: wp.array2d[wp.mat33]
