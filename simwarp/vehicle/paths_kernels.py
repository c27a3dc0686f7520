"""Paths on the ground for drivers: where on a path a point is, found near where it was before."""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class PathTables:
    """Polylines in the plane, seen from above. A closed path ends where it starts, with the same point again."""

    start: wp.array[int]  # (paths + 1,) CSR over points
    closed: wp.array[int]  # (paths,) 1: goes on from its end at its start
    x: wp.array[wp.vec2d]  # [m]
    tangent: wp.array[wp.vec2]  # unit, at the points
    curvature: wp.array[float]  # there [1/m], positive to the left
    arc: wp.array[float]  # length from the path's start [m]


@wp.struct
class PathPoint:
    """The point of a path that is nearest to a place."""

    segment: int  # of its path
    distance: float  # of the place from the path [m], positive to the left of it
    arc: float  # [m]
    curvature: float  # [1/m]
    tangent: wp.vec2


@wp.func
def segment_part(first: int, x: wp.vec2d, paths: PathTables) -> float:
    """Foot of the perpendicular on the line through two points, 0 at the first and 1 at the second."""
    along = paths.x[first + 1] - paths.x[first]
    return float(wp.dot(x - paths.x[first], along) / wp.dot(along, along))


@wp.func
def segment_distance(first: int, x: wp.vec2d, paths: PathTables) -> float:
    """Distance of a point from a segment, ends included [m]."""
    part = wp.float64(wp.clamp(segment_part(first, x, paths), 0.0, 1.0))
    return float(wp.length(x - paths.x[first] - part * (paths.x[first + 1] - paths.x[first])))


@wp.func
def nearest_segment(path: int, hint: int, x: wp.vec2d, paths: PathTables) -> int:
    """Nearest segment downhill from `hint`, so that a path may cross itself; of all segments if it is -1."""
    first = paths.start[path]
    count = paths.start[path + 1] - first - 1
    best = wp.clamp(hint, 0, count - 1)
    distance = segment_distance(first + best, x, paths)
    if hint < 0:
        for segment in range(1, count):
            other = segment_distance(first + segment, x, paths)
            if other < distance:
                distance = other
                best = segment
        return best
    direction = int(1)
    left = int(2 * count)
    while left > 0:
        left -= 1
        following = best + direction
        if paths.closed[path] == 1:
            following = (following + count) % count
        other = distance
        if following >= 0 and following < count:
            other = segment_distance(first + following, x, paths)
        if other < distance:
            distance = other
            best = following
        elif direction == 1:
            direction = -1
        else:
            left = 0
    return best


@wp.func
def nearest_on_path(path: int, hint: int, x: wp.vec2d, paths: PathTables) -> PathPoint:
    """Nearest point of a path, and the offset from it. Open paths go on straight beyond their ends."""
    found = PathPoint()
    first = paths.start[path]
    count = paths.start[path + 1] - first - 1
    found.segment = nearest_segment(path, hint, x, paths)
    a = first + found.segment
    part = segment_part(a, x, paths)
    inner = wp.clamp(part, 0.0, 1.0)
    if paths.closed[path] == 1 or (found.segment > 0 and part < 0.0) or (found.segment < count - 1 and part > 1.0):
        part = inner
    chord = paths.x[a + 1] - paths.x[a]
    offset = x - paths.x[a] - wp.float64(part) * chord
    beside = chord[0] * offset[1] - chord[1] * offset[0]
    found.distance = float(wp.length(offset))
    if beside < wp.float64(0.0):
        found.distance = -found.distance
    found.arc = paths.arc[a] + part * (paths.arc[a + 1] - paths.arc[a])
    found.tangent = wp.normalize((1.0 - inner) * paths.tangent[a] + inner * paths.tangent[a + 1])
    found.curvature = (1.0 - inner) * paths.curvature[a] + inner * paths.curvature[a + 1]
    return found
