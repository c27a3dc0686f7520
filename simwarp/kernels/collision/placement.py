"""The shapes of one world, placed: poses, bounds, speeds, and which of them come near each other."""

import dataclasses
from typing import Any

import warp as wp

from simwarp.core.types import ArrayLayout, FrictionLaw, FrictionRule, ShapeType
from simwarp.kernels.collision.broad import Grid, GridScratch, fill_grid
from simwarp.kernels.collision.shape import Assets, Manifold, ManifoldScratch, Shape
from simwarp.kernels.collision.support import Bounds, core_radius, inner_point, shape_bounds
from simwarp.kernels.collision.surfaces import is_triangle_surface, triangle_surface_bounds
from simwarp.kernels.collision.triangles import RawContacts, RawContactScratch
from simwarp.kernels.core.face_tables import face_point
from simwarp.kernels.core.fields import Parameters, StateArrays
from simwarp.kernels.core.scratch import (
    ScratchGroup,
    make_memory,
    memory_layouts,
    memory_struct,
    scratch_array,
    slot_function,
)
from simwarp.kernels.core.tables import StepConfig, Topology, world_row
from simwarp.kernels.core.vector_math import matrix_to_float, to_float

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

HULL = wp.constant(int(ShapeType.HULL))
PLANE = wp.constant(int(ShapeType.PLANE))
CONVEX = wp.constant(int(FrictionLaw.CONVEX))
PRODUCT = wp.constant(int(FrictionRule.PRODUCT))


class ShapeScratch(ScratchGroup, packed=False):
    """Placed shapes and the last step's contacts of one world."""

    x = scratch_array(wp.vec3d, "shapes")
    rot = scratch_array(wp.mat33, "shapes")
    lower = scratch_array(wp.vec3, "shapes")  # bounds relative to x, world axes
    upper = scratch_array(wp.vec3, "shapes")
    velocity = scratch_array(wp.vec3, "shapes")
    sweep = scratch_array(wp.float32, "shapes")  # speed that rotation adds to the surface [m/s]

    shape0 = scratch_array(wp.int32, "contacts")  # of the last step
    shape1 = scratch_array(wp.int32, "contacts")
    feature = scratch_array(wp.int32, "contacts")
    face = scratch_array(wp.int32, "on_faces")
    arm1 = scratch_array(wp.vec3, "contacts")
    impulse_w = scratch_array(wp.vec3, "contacts")
    moment_w = scratch_array(wp.vec3, "contacts")


GROUPS = (ShapeScratch, GridScratch, ManifoldScratch, RawContactScratch)
CollisionScratch = memory_struct("CollisionScratch", __name__, GROUPS)
pack_grid = slot_function("pack_grid", __name__, GridScratch, Grid, CollisionScratch)
pack_manifold = slot_function("pack_manifold", __name__, ManifoldScratch, Manifold, CollisionScratch)
pack_raw = slot_function("pack_raw", __name__, RawContactScratch, RawContacts, CollisionScratch)


@dataclasses.dataclass(frozen=True, kw_only=True)
class CollisionSizes:
    """Lengths of the scratch of one world; `buckets` of the grid, 0 without one; contacts `on_faces` of meshes, 0
    without faces.
    """

    shapes: int
    contacts: int
    buckets: int
    on_faces: int

    @property
    def in_grid(self) -> int:
        """Shapes in the grid."""
        return self.shapes if self.buckets else 0

    @property
    def bucket_ends(self) -> int:
        """Buckets, and their end."""
        return self.buckets + 1


def collision_layouts(slots: int, sizes: CollisionSizes) -> dict[str, ArrayLayout]:
    """The arrays of the scratch."""
    return memory_layouts(GROUPS, slots, sizes)


def make_collision_scratch(device: wp.Device, slots: int, sizes: CollisionSizes) -> Any:
    """Allocates the scratch."""
    return make_memory(CollisionScratch, collision_layouts(slots, sizes), device)


@wp.func
def placed(
    shape: int, world: int, origin: wp.vec3d, scratch_slot: int, topology: Topology, parameters: Parameters,
    scratch: CollisionScratch,
) -> Shape:  # fmt: skip
    """The shape relative to an origin. A plane is moved along itself to the origin's foot, so that it stays near."""
    s = Shape()
    s.kind = topology.shape_type[shape]
    s.rot = scratch.rot[scratch_slot, shape]
    offset = scratch.x[scratch_slot, shape] - origin
    if s.kind == PLANE:
        n = wp.vec3d(wp.float64(s.rot[0, 2]), wp.float64(s.rot[1, 2]), wp.float64(s.rot[2, 2]))
        offset = n * (wp.dot(n, offset) / wp.dot(n, n))
    s.x = to_float(offset)
    s.size = parameters.shape_size[world_row(world, parameters.shape_size.shape[0]), shape]
    s.margin = parameters.shape_margin[world_row(world, parameters.shape_margin.shape[0]), shape]
    s.asset = parameters.shape_asset[world_row(world, parameters.shape_asset.shape[0]), shape]
    return s


@wp.func
def bounds_of(s: Shape, assets: Assets) -> Bounds:
    """Bounds of any shape."""
    b = Bounds()
    if is_triangle_surface(s.kind):
        b = triangle_surface_bounds(s, assets)
    else:
        b = shape_bounds(s, assets)
    return b


@wp.func
def place_shapes(
    world: int, scratch_slot: int, topology: Topology, parameters: Parameters, state: StateArrays, assets: Assets,
    scratch: CollisionScratch,
):  # fmt: skip
    """Poses, bounds and speeds of all shapes."""
    for shape in range(topology.shape_count):
        body = topology.shape_body[shape]
        x = parameters.shape_x[world_row(world, parameters.shape_x.shape[0]), shape]
        rot = wp.quat_to_matrix(parameters.shape_rot[world_row(world, parameters.shape_rot.shape[0]), shape])
        velocity = wp.vec3()
        omega = wp.vec3()
        if body >= 0:
            q = state.body_rot[world, body]
            arm = wp.quat_rotate(q, x)
            x = state.body_x[world, body] + arm
            rot = matrix_to_float(wp.quat_to_matrix(q)) * rot
            omega = state.body_omega[world, body]
            velocity = state.body_v[world, body] + wp.cross(omega, to_float(arm))
        scratch.x[scratch_slot, shape] = x
        scratch.rot[scratch_slot, shape] = rot
        scratch.velocity[scratch_slot, shape] = velocity
        geometry = placed(shape, world, x, scratch_slot, topology, parameters, scratch)
        bounds = Bounds()
        if body < 0 and geometry.kind == HULL:
            # a scene of many rocks: a ball about each costs one look, the exact box one for each of its corners
            r = core_radius(geometry, assets) + geometry.margin
            centre = inner_point(geometry, assets)
            bounds.lower = centre - wp.vec3(r, r, r)
            bounds.upper = centre + wp.vec3(r, r, r)
        else:
            bounds = bounds_of(geometry, assets)
        scratch.lower[scratch_slot, shape] = bounds.lower
        scratch.upper[scratch_slot, shape] = bounds.upper
        sweep = float(0.0)
        if body >= 0:
            sweep = wp.length(omega) * wp.length(wp.max(wp.abs(bounds.lower), wp.abs(bounds.upper)))
        scratch.sweep[scratch_slot, shape] = sweep


@wp.func
def widen_to_faces(
    world: int, scratch_slot: int, topology: Topology, parameters: Parameters, state: StateArrays,
    scratch: CollisionScratch,
):  # fmt: skip
    """Bounds and speeds of the spheres of nodes, so that they hold the faces that come with these."""
    for shape in range(topology.shape_count):
        v = scratch.velocity[scratch_slot, shape]
        thick = scratch.upper[scratch_slot, shape]
        for face in range(topology.face_start[shape], topology.face_start[shape + 1]):
            for k in range(3):
                point = topology.face[face, k]
                d = to_float(face_point(point, world, topology, state) - scratch.x[scratch_slot, shape])
                scratch.lower[scratch_slot, shape] = wp.min(scratch.lower[scratch_slot, shape], d - thick)
                scratch.upper[scratch_slot, shape] = wp.max(scratch.upper[scratch_slot, shape], d + thick)
                body = topology.face_point[point, 0]
                speed = wp.vec3()
                if body >= 0:
                    arm = to_float(wp.quat_rotate(state.body_rot[world, body], topology.face_place[point]))
                    speed = state.body_v[world, body] + wp.cross(state.body_omega[world, body], arm)
                scratch.sweep[scratch_slot, shape] = wp.max(scratch.sweep[scratch_slot, shape], wp.length(speed - v))


@wp.func
def may_touch(scratch_slot: int, shape0: int, shape1: int, reach: float, scratch: CollisionScratch) -> bool:
    """True if the bounds of two shapes come within reach."""
    d = to_float(scratch.x[scratch_slot, shape1] - scratch.x[scratch_slot, shape0])
    lower = d + scratch.lower[scratch_slot, shape1] - scratch.upper[scratch_slot, shape0]
    upper = scratch.lower[scratch_slot, shape0] - d - scratch.upper[scratch_slot, shape1]
    return wp.max(wp.max(lower), wp.max(upper)) < reach


@wp.func
def near_distance(world: int, config: StepConfig, parameters: Parameters) -> float:
    """What shapes at rest may be apart and still touch within a step [m]."""
    gravity = parameters.gravity[world_row(world, parameters.gravity.shape[0])]
    return config.contact_margin + wp.length(gravity) * config.dt * config.dt


@wp.func
def reach_time(world: int, config: StepConfig, topology: Topology, parameters: Parameters) -> float:
    """Time that shapes are given to meet [s]: a step. With the convex law it is longer by the largest friction: what
    slides has contacts at gaps of friction x speed x step.
    """
    if config.friction_law != CONVEX:
        return config.dt
    largest = float(0.0)
    row = world_row(world, parameters.shape_friction.shape[0])
    for shape in range(topology.shape_count):
        largest = wp.max(largest, parameters.shape_friction[row, shape])
    if topology.friction_rule == PRODUCT:
        largest = wp.max(largest, largest * largest)
    for pair in range(topology.given_count):
        largest = wp.max(largest, topology.given_surface[pair, 0])
    return config.dt * (1.0 + largest)


@wp.func
def pair_reach(
    scratch_slot: int, shape0: int, shape1: int, near: float, time: float, scratch: CollisionScratch
) -> float:  # fmt: skip
    """What two shapes may be apart and still touch within a time [m]."""
    approach = (
        wp.length(scratch.velocity[scratch_slot, shape1] - scratch.velocity[scratch_slot, shape0])
        + scratch.sweep[scratch_slot, shape0]
        + scratch.sweep[scratch_slot, shape1]
    )
    return near + time * approach


@wp.func
def fill_world_grid(
    scratch_slot: int, near: float, time: float, topology: Topology, scratch: CollisionScratch, grid: Grid
):
    """Sorts the placed shapes into the grid."""
    fastest = float(0.0)
    for shape in range(topology.shape_count):
        fastest = wp.max(fastest, wp.length(scratch.velocity[scratch_slot, shape]) + scratch.sweep[scratch_slot, shape])
    fill_grid(
        near + time * fastest,
        topology,
        scratch.x[scratch_slot],
        scratch.lower[scratch_slot],
        scratch.upper[scratch_slot],
        grid,
    )


@wp.func
def pair_origin(
    scratch_slot: int, shape0: int, shape1: int, topology: Topology, scratch: CollisionScratch
) -> wp.vec3d:  # fmt: skip
    """Origin of a pair's frame: near both shapes, of which one may be as large as the terrain."""
    origin = scratch.x[scratch_slot, shape0]
    if topology.shape_body[shape0] < 0:
        origin = scratch.x[scratch_slot, shape1]
    if is_triangle_surface(topology.shape_type[shape0]):
        origin = scratch.x[scratch_slot, shape1]
    elif is_triangle_surface(topology.shape_type[shape1]):
        origin = scratch.x[scratch_slot, shape0]
    return origin
