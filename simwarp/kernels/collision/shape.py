"""One shape as the narrow phase sees it: placed in the pair's frame, float32."""

import warp as wp

from simwarp.core.types import ShapeType
from simwarp.kernels.core.scratch import ScratchGroup, scratch_array
from simwarp.kernels.rays.wide_tree import Trees

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

PLANE = wp.constant(int(ShapeType.PLANE))
SPHERE = wp.constant(int(ShapeType.SPHERE))
CAPSULE = wp.constant(int(ShapeType.CAPSULE))
CYLINDER = wp.constant(int(ShapeType.CYLINDER))
BOX = wp.constant(int(ShapeType.BOX))
ELLIPSOID = wp.constant(int(ShapeType.ELLIPSOID))
CONE = wp.constant(int(ShapeType.CONE))
HULL = wp.constant(int(ShapeType.HULL))
HEIGHT_FIELD = wp.constant(int(ShapeType.HEIGHT_FIELD))
MESH = wp.constant(int(ShapeType.MESH))
SPROCKET = wp.constant(int(ShapeType.SPROCKET))
GROOVE = wp.constant(int(ShapeType.GROOVE))
TRIANGLE = wp.constant(64)  # internal: the columns of `rot` are the three vertices relative to `x`; no size

MANIFOLD_CONTACTS = wp.constant(8)
POLYGON_CAPACITY = wp.constant(32)
FACE_VERTICES = wp.constant(16)  # most vertices of a support polygon


@wp.struct
class Shape:
    """A placed shape. The pair's frame has world axes and its origin near the two shapes, so that float32 suffices."""

    kind: int  # ShapeType
    x: wp.vec3  # origin [m]
    rot: wp.mat33  # shape axes to world axes
    size: wp.vec3  # ShapeType tells its meaning
    margin: float  # the surface is thickened by this much [m]
    asset: int  # index into `Assets`, -1: none


@wp.struct
class Assets:
    """Geometry shared by all worlds and shapes, in the local frame of the asset, unscaled. Each kind (hulls, height
    fields, meshes) counts its own assets; their data are concatenated.
    """

    hull_vertex: wp.array[wp.vec3]
    hull_vertex_start: wp.array[int]  # CSR over assets
    hull_face: wp.array[
        int
    ]  # vertices of all faces in turn, counter-clockwise seen from outside; index within the hull
    hull_face_vertex_start: wp.array[int]  # CSR over faces
    hull_face_start: wp.array[int]  # CSR over assets: its faces
    hull_normal: wp.array[wp.vec3]  # outward unit normals of the faces
    hull_edge: wp.array[wp.vec3]  # directions of the edges, parallel ones merged
    hull_edge_start: wp.array[int]  # CSR over assets
    hull_centre: wp.array[wp.vec3]  # a point well inside, one per asset
    hull_radius: wp.array[float]  # of the sphere about that point that holds all vertices

    field_height: wp.array[float]  # row by row, columns along x [m]
    field_start: wp.array[int]  # CSR over assets
    field_nodes: wp.array[wp.vec2i]  # columns and rows of grid nodes
    field_spacing: wp.array[wp.vec2d]  # between columns and between rows [m]; the grid's middle is the origin
    field_range: wp.array[wp.vec2]  # lowest and highest node [m]

    mesh: wp.array[wp.uint64]  # ids of wp.Mesh, for what is near a box
    trees: Trees  # the same meshes, for rays
    mesh_neighbour: wp.array[wp.vec3]  # unit normal of the triangle across edge k of triangle t: [3 t + k]; 0: border
    mesh_neighbour_start: wp.array[int]  # CSR over assets
    mesh_lower: wp.array[wp.vec3]  # bounds
    mesh_upper: wp.array[wp.vec3]

    sprocket_teeth: wp.array[int]
    # radii of the circle of the arcs' centres and of the arcs, of tips of 1 m; angle of arcs from gaps' middles [rad]
    sprocket_arc: wp.array[wp.vec3]


class ManifoldScratch(ScratchGroup, packed=False, prefix="pair_"):
    """Scratch that receives the contacts of one pair, all in the pair's frame."""

    normal = scratch_array(wp.vec3, MANIFOLD_CONTACTS)  # from shape 0 to shape 1
    point = scratch_array(
        wp.vec3, MANIFOLD_CONTACTS
    )  # on the surface of shape 0; that of shape 1: point + gap * normal
    gap = scratch_array(wp.float32, MANIFOLD_CONTACTS)  # negative: penetration [m]
    feature = scratch_array(wp.int32, MANIFOLD_CONTACTS)  # equal for the same geometric contact in the next step
    weights = scratch_array(wp.vec3, MANIFOLD_CONTACTS)  # of the corners of a mesh's face
    polygon = scratch_array(wp.vec3, 4, POLYGON_CAPACITY)  # of the clipping


Manifold = ManifoldScratch.struct("Manifold", __name__)


@wp.func
def triangle_shape(p0: wp.vec3, p1: wp.vec3, p2: wp.vec3, margin: float) -> Shape:
    """A triangle as a shape: both its sides are solid."""
    s = Shape()
    s.kind = TRIANGLE
    s.x = (p0 + p1 + p2) / 3.0
    s.rot = wp.matrix_from_cols(p0 - s.x, p1 - s.x, p2 - s.x)
    s.size = wp.vec3()
    s.margin = margin
    s.asset = -1
    return s
