"""Surfaces of flexible meshes pressed into soil: their triangles are laid over the nodes of the ground from below, and
what a node does goes to the three nodes of the triangle above it, by its place in the triangle.

A mesh's node gets a force and a mass d, which stands for how the force changes with the velocity over the step:
(m + d) dv = h F. It is the larger one of the parts along the normal and across it: the matrix of a mesh takes one mass
for each node.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import ControlArrays, StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.soil.bekker_janosi_kernels import law_of
from simwarp.soil.deformed_surface_kernels import FARTHEST, node_drop
from simwarp.soil.footprint_kernels import Footprint, keep_footprint, kept_footprint, node_number, soil_at
from simwarp.soil.node_stress_kernels import node_stress
from simwarp.soil.pages_kernels import find_page, slot_in
from simwarp.soil.soil_columns_kernels import K_C
from simwarp.soil.soil_tables_kernels import SoilNodes, SoilReports, SoilTables
from simwarp.vehicle.tires.ground_kernels import ground_below

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

EDGE = wp.constant(-1.0e-6)
"""Least barycentric coordinate that is inside a triangle: nothing falls between two."""
UPRIGHT = wp.constant(1.0e-9)
"""Twice the area of a triangle seen from above, below which nothing lies under it [m^2]."""
AHEAD = wp.constant(3.0)
"""Ways of a step within which a surface above the ground counts."""
BELOW = wp.constant(1.0)
"""How far above a mesh the search for ground begins, where it is a mesh of several levels [m]."""


@wp.struct
class SoilSheets:
    """Flexible surfaces that sink in, shared by all worlds, and what is known of them in a step."""

    node_start: wp.array[int]  # CSR over sheets
    body: wp.array[int]  # of each node
    triangle_start: wp.array[int]  # CSR over sheets
    triangle: wp.array[wp.vec3i]  # numbers of nodes among all of these
    lift: wp.array[float]  # (sheets,) from the lower side up to the nodes [m]
    centre: wp.array[int]  # (sheets,) body that moments are about: the one it is glued to, or its first node's
    place: wp.array2d[wp.vec3]  # (W, nodes) of the lower side, from the sheet's first node [m]
    depth: wp.array2d[float]  # (W, nodes) in the ground at rest or soon; negative above it [m]
    low: wp.array2d[int]  # (W, triangles) those near the ground, from each sheet's first place on
    low_count: wp.array2d[int]  # (W, sheets)
    row: wp.array2d[int]  # (W, triangles) those of them that cross the row of nodes at work, likewise
    force: wp.array2d[wp.vec3]  # (W, nodes) before the velocity changed [N]
    mass: wp.array2d[float]  # (W, nodes) d [kg]
    before_v: wp.array2d[wp.vec3]  # (W, nodes) before the sub-step [m/s]


@wp.kernel
def survey_sheets(
    # inputs
    worlds: WorldRange,
    dt: float,
    soil: SoilTables,
    assets: Assets,
    state: StateArrays,
    # outputs
    sheets: SoilSheets,
    nodes: SoilNodes,
):
    """Which triangles may press on the ground, and the soil's nodes below them; dim (W, sheets)."""
    index, sheet = wp.tid()
    world = worlds.first + index
    first = sheets.node_start[sheet]
    origin = state.body_x[world, sheets.body[first]]
    for node in range(first, sheets.node_start[sheet + 1]):
        body = sheets.body[node]
        place = to_float(state.body_x[world, body] - origin) - wp.vec3(0.0, 0.0, sheets.lift[sheet])
        v = state.body_v[world, body]
        g = ground_below(world, origin, place, BELOW, soil.terrain, assets)
        depth = float(-1.0e9)
        if g.found == 1 and wp.isfinite(wp.length_sq(place) + wp.length_sq(v)):
            depth = g.arm[2] - place[2] + AHEAD * dt * wp.length(v) + soil.spacing
        sheets.place[world, node] = place
        sheets.depth[world, node] = depth
        sheets.before_v[world, node] = v
    foot = Footprint()
    foot.x1 = -1
    count = int(0)
    begin = sheets.triangle_start[sheet]
    reach = FARTHEST * wp.float64(soil.spacing)
    for triangle in range(begin, sheets.triangle_start[sheet + 1]):
        t = sheets.triangle[triangle]
        deepest = wp.max(wp.max(sheets.depth[world, t[0]], sheets.depth[world, t[1]]), sheets.depth[world, t[2]])
        flattest = wp.min(wp.min(sheets.depth[world, t[0]], sheets.depth[world, t[1]]), sheets.depth[world, t[2]])
        far = wp.max(wp.abs(origin[0]), wp.abs(origin[1])) > reach
        if deepest > 0.0 and flattest > -1.0e8 and not far:
            sheets.low[world, begin + count] = triangle
            count += 1
            a = sheets.place[world, t[0]]
            b = sheets.place[world, t[1]]
            c = sheets.place[world, t[2]]
            x0 = node_number(origin[0], wp.min(wp.min(a[0], b[0]), c[0]), soil.spacing)
            x1 = node_number(origin[0], wp.max(wp.max(a[0], b[0]), c[0]), soil.spacing) + 1
            y0 = node_number(origin[1], wp.min(wp.min(a[1], b[1]), c[1]), soil.spacing)
            y1 = node_number(origin[1], wp.max(wp.max(a[1], b[1]), c[1]), soil.spacing) + 1
            if count == 1:
                foot.x0 = x0
                foot.x1 = x1
                foot.y0 = y0
                foot.y1 = y1
            foot.x0 = wp.min(foot.x0, x0)
            foot.x1 = wp.max(foot.x1, x1)
            foot.y0 = wp.min(foot.y0, y0)
            foot.y1 = wp.max(foot.y1, y1)
    sheets.low_count[world, sheet] = count
    keep_footprint(world, nodes.foot.shape[1] - sheets.lift.shape[0] + sheet, foot, nodes)


@wp.struct
class Above:
    """The lowest triangle above a place of the ground."""

    triangle: int  # -1: none
    weight: wp.vec3  # of its nodes
    height: float  # of its lower side, from the sheet's first node [m]
    normal: wp.vec3  # of any length, upwards


@wp.func
def list_row(world: int, sheet: int, y: float, sheets: SoilSheets) -> int:
    """Lists the triangles over a row of the soil's nodes; returns how many they are."""
    begin = sheets.triangle_start[sheet]
    count = int(0)
    for at in range(begin, begin + sheets.low_count[world, sheet]):
        triangle = sheets.low[world, at]
        t = sheets.triangle[triangle]
        first = sheets.place[world, t[0]][1]
        second = sheets.place[world, t[1]][1]
        third = sheets.place[world, t[2]][1]
        room = 1.0e-4 * (wp.abs(first - second) + wp.abs(first - third))
        least = wp.min(wp.min(first, second), third) - room
        most = wp.max(wp.max(first, second), third) + room
        if least <= y and y <= most:
            sheets.row[world, begin + count] = triangle
            count += 1
    return count


@wp.func
def lowest_above(world: int, sheet: int, count: int, x: float, y: float, sheets: SoilSheets) -> Above:
    """The triangle that is lowest over a place, from the sheet's first node, among those of the row."""
    found = Above()
    found.triangle = -1
    begin = sheets.triangle_start[sheet]
    for at in range(begin, begin + count):
        triangle = sheets.row[world, at]
        t = sheets.triangle[triangle]
        a = sheets.place[world, t[0]]
        ab = sheets.place[world, t[1]] - a
        ac = sheets.place[world, t[2]] - a
        dx = x - a[0]
        dy = y - a[1]
        normal = wp.cross(ab, ac)
        if wp.abs(normal[2]) > UPRIGHT:
            second = (dx * ac[1] - dy * ac[0]) / normal[2]
            third = (ab[0] * dy - ab[1] * dx) / normal[2]
            if second >= EDGE and third >= EDGE and second + third <= 1.0 - EDGE:
                height = a[2] + second * ab[2] + third * ac[2]
                if found.triangle < 0 or height < found.height:
                    found.triangle = triangle
                    found.weight = wp.vec3(1.0 - second - third, second, third)
                    found.height = height
                    found.normal = normal
    return found


@wp.func
def inverse_half_width_below(
    world: int, sheet: int, foot: Footprint, origin: wp.vec3d, soil: SoilTables, sheets: SoilSheets, assets: Assets
) -> float:  # fmt: skip
    """Perimeter over twice the area [1/m] of the rectangle with the second moments of the touched nodes; 0: none."""
    count = float(0.0)
    sums = wp.vec2()
    xx = float(0.0)
    xy = float(0.0)
    yy = float(0.0)
    spacing = wp.float64(soil.spacing)
    for row in range(foot.y0, foot.y1 + 1):
        y = float(wp.float64(row) * spacing - origin[1])
        crossing = list_row(world, sheet, y, sheets)
        for column in range(foot.x0, foot.x1 + 1):
            x = float(wp.float64(column) * spacing - origin[0])
            above = lowest_above(world, sheet, crossing, x, y, sheets)
            if above.triangle >= 0:
                g = ground_below(world, origin, wp.vec3(x, y, above.height), BELOW, soil.terrain, assets)
                if g.found == 1 and g.arm[2] > above.height:
                    count += 1.0
                    sums += wp.vec2(x, y)
                    xx += x * x
                    xy += x * y
                    yy += y * y
    if count == 0.0:
        return 0.0
    mean = sums / count
    xx = xx / count - mean[0] * mean[0]
    xy = xy / count - mean[0] * mean[1]
    yy = yy / count - mean[1] * mean[1]
    middle = 0.5 * (xx + yy)
    apart = wp.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    # of n nodes in a row the variance is (n^2 - 1) / 12 squares of the spacing
    cell = soil.spacing * soil.spacing
    length = wp.sqrt(12.0 * wp.max(middle + apart, 0.0) + cell)
    width = wp.sqrt(12.0 * wp.max(middle - apart, 0.0) + cell)
    return (length + width) / (length * width)


@wp.func
def clear_nodes(world: int, sheet: int, sheets: SoilSheets):
    """Nothing acts on the nodes of a sheet yet."""
    for node in range(sheets.node_start[sheet], sheets.node_start[sheet + 1]):
        sheets.force[world, node] = wp.vec3()
        sheets.mass[world, node] = 0.0


@wp.func
def write_nodes(world: int, sheet: int, sheets: SoilSheets, control: ControlArrays):
    """All that acts on the nodes of a sheet."""
    for node in range(sheets.node_start[sheet], sheets.node_start[sheet + 1]):
        body = sheets.body[node]
        d = sheets.mass[world, node]
        control.element_force[world, body] = sheets.force[world, node]
        control.element_torque[world, body] = wp.vec3()
        control.element_mass[world, body] = wp.mat33(d, 0.0, 0.0, 0.0, d, 0.0, 0.0, 0.0, d)
        control.element_coupling[world, body] = wp.mat33()
        control.element_inertia[world, body] = wp.mat33()


@wp.kernel
def press_sheets(
    # inputs
    worlds: WorldRange,
    dt: float,
    soil: SoilTables,
    assets: Assets,
    state: StateArrays,
    # in and out
    sheets: SoilSheets,
    nodes: SoilNodes,
    # outputs
    reports: SoilReports,
    control: ControlArrays,
):
    """Forces and masses of the nodes of each sheet; dim (W, sheets). The soil's nodes are summed row by row."""
    index, sheet = wp.tid()
    world = worlds.first + index
    shape = nodes.foot.shape[1] - sheets.lift.shape[0] + sheet
    clear_nodes(world, sheet, sheets)
    origin = state.body_x[world, sheets.body[sheets.node_start[sheet]]]
    foot = kept_footprint(world, shape, nodes)
    touched = int(0)
    sunk = float(0.0)
    deepest = nodes.deepest[world, shape]
    if sheets.low_count[world, sheet] > 0:
        copy = world_row(world, soil.parameter.shape[0])
        kind = soil_at(world, state.body_x[world, sheets.centre[sheet]], soil)
        inverse_b = float(0.0)
        if soil.parameter[copy, kind, K_C] != 0.0:
            inverse_b = inverse_half_width_below(world, sheet, foot, origin, soil, sheets, assets)
        law = law_of(copy, kind, inverse_b, soil.parameter)
        spacing = wp.float64(soil.spacing)
        area = soil.spacing * soil.spacing
        for row in range(foot.y0, foot.y1 + 1):
            y = float(wp.float64(row) * spacing - origin[1])
            crossing = list_row(world, sheet, y, sheets)
            for column in range(foot.x0, foot.x1 + 1):
                x = float(wp.float64(column) * spacing - origin[0])
                above = lowest_above(world, sheet, crossing, x, y, sheets)
                page = find_page(world, column >> 3, row >> 3, nodes)
                if above.triangle >= 0 and page >= 0:
                    g = ground_below(world, origin, wp.vec3(x, y, above.height), BELOW, soil.terrain, assets)
                    n = g.normal
                    t = sheets.triangle[above.triangle]
                    w = above.weight
                    v = (
                        w[0] * sheets.before_v[world, t[0]]
                        + w[1] * sheets.before_v[world, t[1]]
                        + w[2] * sheets.before_v[world, t[2]]
                    )
                    # how fast the surface rises over a place that stands still
                    rise = wp.dot(v, above.normal) / above.normal[2]
                    sinkage = n[2] * (g.arm[2] - above.height)
                    after = n[2] * (g.arm[2] - above.height - dt * rise)
                    if g.found == 1 and wp.max(sinkage, after) > 0.0:
                        slot = slot_in(page, column, row)
                        stress = node_stress(slot, world, dt, sinkage, after, v, n, law, soil, nodes)
                        drop = node_drop(world, slot, n, nodes)
                        deepest = wp.max(deepest, drop)
                        if stress.bears == 1:
                            force = area * (stress.pressure * n - stress.against)
                            d = area * wp.max(dt * dt * stress.stiffness + dt * stress.damping, stress.drag)
                            touched += 1
                            sunk = wp.max(sunk, drop)
                            for k in range(3):
                                node = t[k]
                                sheets.force[world, node] = sheets.force[world, node] + w[k] * force
                                sheets.mass[world, node] = sheets.mass[world, node] + wp.max(w[k], 0.0) * d
    nodes.deepest[world, shape] = deepest
    reports.touched[world, shape] = touched
    reports.sinkage[world, shape] = sunk
    write_nodes(world, sheet, sheets, control)


@wp.kernel
def report_sheets(
    # inputs
    worlds: WorldRange,
    dt: float,
    shapes: int,  # that come before the sheets
    sheets: SoilSheets,
    state: StateArrays,
    # outputs
    reports: SoilReports,
):
    """What acted on the sheets in a sub-step, F - d dv / h; dim (W, sheets)."""
    index, sheet = wp.tid()
    world = worlds.first + index
    first = sheets.node_start[sheet]
    origin = state.body_x[world, sheets.body[first]]
    from_centre = to_float(origin - state.body_x[world, sheets.centre[sheet]])
    total = wp.vec3()
    moment = wp.vec3()
    for node in range(first, sheets.node_start[sheet + 1]):
        dv = state.body_v[world, sheets.body[node]] - sheets.before_v[world, node]
        force = sheets.force[world, node] - (sheets.mass[world, node] / dt) * dv
        total += force
        moment += wp.cross(from_centre + sheets.place[world, node], force)
    shape = shapes + sheet
    reports.force_w[world, shape] = total
    reports.torque_w[world, shape] = moment
    reports.load[world, shape] = total[2]
    reports.slip_ratio[world, shape] = 0.0
