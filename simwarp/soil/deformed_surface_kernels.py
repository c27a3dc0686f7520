"""The deformed ground: how far nodes lie below the undeformed one, and its surface between them.

Nodes span a regular grid. A cell between columns i, i + 1 and rows j, j + 1 is cut from node (i, j) to (i + 1, j + 1),
as those of height fields are (kernels/collision/surfaces.py). A cell none of whose corners was touched is undeformed
ground as it is: a height field may have creases there that the nodes do not see.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.tables import world_row
from simwarp.soil.pages_kernels import find_page, slot_in
from simwarp.soil.soil_tables_kernels import SINKAGE, SoilNodes
from simwarp.vehicle.tires.ground_kernels import TerrainTables, open_ground_below

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

FARTHEST = wp.constant(wp.float64(1.0e9))
"""Nodes from the origin beyond which there is no soil: their numbers are whole numbers of 32 bits."""


@wp.struct
class SoilCover:
    """A soil as rays and queries see it."""

    spacing: float  # of the nodes [m]
    terrain: TerrainTables  # the undeformed ground, a plane or a height field
    nodes: SoilNodes


@wp.struct
class SoilCell:
    """Nodes of a cell: (column, row), then one column on, one row on, both on. Heights are from a given point [m]."""

    touched: int  # 0: nobody touched it, or it reaches beyond the ground; the rest is not set
    height: wp.vec4
    drop: wp.vec4
    top: float  # the highest and the lowest of the undeformed heights
    bottom: float


@wp.struct
class Facet:
    """A triangle of a cell: height and drop are value + (x, y) . slope, with x and y in cells from its first node."""

    height: float
    height_slope: wp.vec2
    drop: float
    drop_slope: wp.vec2


@wp.struct
class SurfacePoint:
    """A point of the deformed ground."""

    found: int  # 0: there is no ground
    rise: float  # of the ground above the point of the query [m]
    normal: wp.vec3  # unit, upwards


@wp.func
def node_drop(world: int, slot: int, n: wp.vec3, nodes: SoilNodes) -> float:
    """How far a node lies below the undeformed ground, whose normal is n, along the vertical; negative above it [m]."""
    drop = nodes.node[world, slot, SINKAGE] / n[2]
    if nodes.raised.shape[1] > 0:
        drop -= nodes.raised[world, slot]
    return drop


@wp.func
def is_touched(world: int, slot: int, nodes: SoilNodes) -> bool:
    """False where a node's level is that of the undeformed ground."""
    touched = nodes.node[world, slot, SINKAGE] != 0.0
    if nodes.raised.shape[1] > 0:
        touched = touched or nodes.raised[world, slot] != 0.0
    return touched


@wp.func
def greatest_raise(world: int, nodes: SoilNodes) -> float:
    """How far above the undeformed ground any node of a world may lie [m]."""
    highest = float(0.0)
    for shape in range(nodes.highest.shape[1]):
        highest = wp.max(highest, nodes.highest[world, shape])
    return highest


@wp.func
def level_range(world: int, nodes: SoilNodes) -> wp.vec2:
    """How far above and below the undeformed ground any node of a world may lie [m]."""
    deepest = float(0.0)
    for wheel in range(nodes.deepest.shape[1]):
        deepest = wp.max(deepest, nodes.deepest[world, wheel])
    return wp.vec2(greatest_raise(world, nodes), deepest)


@wp.func
def cell_of(x: wp.float64, spacing: float) -> int:
    """Column or row of the cell that holds a coordinate."""
    return int(wp.floor(x / wp.float64(spacing)))


@wp.func
def soil_cell(world: int, column: int, row: int, x: wp.vec3d, cover: SoilCover, assets: Assets) -> SoilCell:
    """The cell at a column and row, its heights from the point x."""
    cell = SoilCell()
    slots = wp.vec4i(-1, -1, -1, -1)
    page = find_page(world, column >> 3, row >> 3, cover.nodes)
    touched = bool(False)
    for corner in range(4):
        i = column + (corner & 1)
        j = row + (corner >> 1)
        here = page
        if (i >> 3) != (column >> 3) or (j >> 3) != (row >> 3):
            here = find_page(world, i >> 3, j >> 3, cover.nodes)
        if here >= 0:
            slots[corner] = slot_in(here, i, j)
            touched = touched or is_touched(world, slots[corner], cover.nodes)
    if not touched:
        return cell
    spacing = wp.float64(cover.spacing)
    for corner in range(4):
        dx = float(wp.float64(column + (corner & 1)) * spacing - x[0])
        dy = float(wp.float64(row + (corner >> 1)) * spacing - x[1])
        g = open_ground_below(world, x, wp.vec3(dx, dy, 0.0), cover.terrain, assets)
        if g.found == 0:
            return cell
        if slots[corner] >= 0:
            cell.drop[corner] = node_drop(world, slots[corner], g.normal, cover.nodes)
        cell.height[corner] = g.arm[2] - cell.drop[corner]
        cell.top = wp.where(corner == 0, g.arm[2], wp.max(cell.top, g.arm[2]))
        cell.bottom = wp.where(corner == 0, g.arm[2], wp.min(cell.bottom, g.arm[2]))
    cell.touched = 1
    return cell


@wp.func
def facet_of(cell: SoilCell, upper: bool) -> Facet:
    """The triangle of a cell on the side of larger y (`upper`) or of larger x."""
    f = Facet()
    h = cell.height
    d = cell.drop
    f.height = h[0]
    f.drop = d[0]
    if upper:
        f.height_slope = wp.vec2(h[3] - h[2], h[2] - h[0])
        f.drop_slope = wp.vec2(d[3] - d[2], d[2] - d[0])
    else:
        f.height_slope = wp.vec2(h[1] - h[0], h[3] - h[1])
        f.drop_slope = wp.vec2(d[1] - d[0], d[3] - d[1])
    return f


@wp.func
def facet_normal(f: Facet, spacing: float) -> wp.vec3:
    """Unit, upwards."""
    return wp.normalize(wp.vec3(-f.height_slope[0], -f.height_slope[1], spacing))


@wp.func
def surface_below(world: int, x: wp.vec3d, cover: SoilCover, assets: Assets) -> SurfacePoint:
    """The deformed ground vertically below or above x."""
    found = SurfacePoint()
    g = open_ground_below(world, x, wp.vec3(), cover.terrain, assets)
    found.found = g.found
    found.rise = g.arm[2]
    found.normal = g.normal
    if g.found == 0 or wp.max(wp.abs(x[0]), wp.abs(x[1])) > FARTHEST * wp.float64(cover.spacing):
        return found
    column = cell_of(x[0], cover.spacing)
    row = cell_of(x[1], cover.spacing)
    cell = soil_cell(world, column, row, x, cover, assets)
    if cell.touched == 1:
        place = wp.vec2(
            float(x[0] / wp.float64(cover.spacing) - wp.float64(column)),
            float(x[1] / wp.float64(cover.spacing) - wp.float64(row)),
        )
        facet = facet_of(cell, place[1] > place[0])
        found.rise = facet.height + wp.dot(facet.height_slope, place)
        found.normal = facet_normal(facet, cover.spacing)
    return found


@wp.kernel
def find_heights(
    # inputs
    cover: SoilCover,
    assets: Assets,
    place: wp.array2d[wp.vec2d],
    # outputs
    height: wp.array2d[wp.float64],
    normal: wp.array2d[wp.vec3],
):
    """Heights and normals of the deformed ground at places (1 or W, N); dim (W, N). NaN and zeros without ground."""
    world, index = wp.tid()
    p = place[world_row(world, place.shape[0]), index]
    x = wp.vec3d(p[0], p[1], wp.float64(0.0))
    # from a point near the ground: float32 holds what is left
    x[2] = wp.float64(open_ground_below(world, x, wp.vec3(), cover.terrain, assets).arm[2])
    found = surface_below(world, x, cover, assets)
    height[world, index] = wp.float64(wp.nan)
    if found.found == 1:
        height[world, index] = x[2] + wp.float64(found.rise)
    normal[world, index] = found.normal
