"""Device half of paths to drive along: places ahead, and where a vehicle is along them."""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

FARTHEST = wp.constant(3.0e38)


@wp.struct
class RouteTables:
    """Paths as points at equal steps."""

    closed: int
    length: wp.array[float]  # (K,) [m]
    steps: wp.array[int]  # (K,)
    points: wp.array2d[wp.vec3]  # (K, P) x, y [m] and heading [rad]


@wp.func
def route_at(route: int, arc: float, routes: RouteTables) -> wp.vec3:
    """Place and heading at a length along a route; closed ones go on with the next lap, open ones end straight."""
    length = routes.length[route]
    steps = routes.steps[route]
    laps = float(0.0)
    if routes.closed == 1:
        laps = wp.floor(arc / length)
    inside = wp.max(arc - laps * length, 0.0)
    u = wp.min(inside / length, 1.0) * float(steps)
    low = wp.clamp(int(u), 0, steps - 1)
    first = routes.points[route, low]
    at = first + (u - float(low)) * (routes.points[route, low + 1] - first)
    if routes.closed == 1:
        turn = routes.points[route, steps][2] - routes.points[route, 0][2]
        at[2] = at[2] + laps * turn
    else:
        over = arc - wp.min(inside, length)
        at[0] = at[0] + over * wp.cos(at[2])
        at[1] = at[1] + over * wp.sin(at[2])
    return at


@wp.func
def square_from(place: wp.vec2, point: wp.vec3) -> float:
    """Square of the distance of two places."""
    x = place[0] - point[0]
    y = place[1] - point[1]
    return x * x + y * y


@wp.func
def nearest_point(route: int, place: wp.vec2, routes: RouteTables) -> int:
    """The first of the nearest points of a route."""
    nearest = int(0)
    least = float(FARTHEST)
    for i in range(routes.steps[route] + 1):
        square = square_from(place, routes.points[route, i])
        if square < least:
            least = square
            nearest = i
    return nearest


@wp.func
def route_distance(route: int, place: wp.vec2, routes: RouteTables) -> float:
    """Distance from a route, but for a quarter of a step squared [m]."""
    return wp.sqrt(square_from(place, routes.points[route, nearest_point(route, place, routes)]))


@wp.func
def locate(route: int, place: wp.vec2, routes: RouteTables) -> wp.vec2:
    """Length along a route of its nearest point, and how far to the left of it a place is [m]."""
    nearest = nearest_point(route, place, routes)
    here = routes.points[route, nearest]
    x = place[0] - here[0]
    y = place[1] - here[1]
    c = wp.cos(here[2])
    s = wp.sin(here[2])
    step = routes.length[route] / float(routes.steps[route])
    return wp.vec2(float(nearest) * step + (c * x + s * y), c * y - s * x)


@wp.kernel
def find_route_places(
    route: wp.array[wp.int64], arc: wp.array2d[float], routes: RouteTables, places: wp.array2d[wp.vec3]
):
    """Places at lengths along routes."""
    row, i = wp.tid()
    places[row, i] = route_at(int(route[row]), arc[row, i], routes)


@wp.kernel
def measure_route_distances(
    route: wp.array[wp.int64], place: wp.array2d[float], routes: RouteTables, distance: wp.array[float]
):  # fmt: skip
    """Distances of places from routes."""
    row = wp.tid()
    distance[row] = route_distance(int(route[row]), wp.vec2(place[row, 0], place[row, 1]), routes)


@wp.kernel
def locate_on_routes(
    route: wp.array[wp.int64], place: wp.array2d[float], routes: RouteTables, arc: wp.array[float],
    aside: wp.array[float],
):  # fmt: skip
    """Where places are along routes, and beside them."""
    row = wp.tid()
    found = locate(int(route[row]), wp.vec2(place[row, 0], place[row, 1]), routes)
    arc[row] = found[0]
    aside[row] = found[1]
