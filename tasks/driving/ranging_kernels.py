"""Device half of an ideal planar laser scanner: distances to round obstacles in a fan of directions."""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})


@wp.func
def range_to(direction: wp.vec2, place: wp.vec2, radius: float, reach: float) -> float:
    """Distance along a ray to a disc, at most the reach; 0 inside of it. One of negative radius is not there."""
    ahead = place[0] * direction[0] + place[1] * direction[1]
    square = place[0] * place[0] + place[1] * place[1]
    # half a chord, squared: negative where the ray passes the disc
    chord = radius * radius - (square - ahead * ahead)
    distance = reach
    if radius >= 0.0 and chord > 0.0 and (ahead > 0.0 or square < radius * radius):
        distance = wp.min(wp.max(ahead - wp.sqrt(chord), 0.0), reach)
    return distance


@wp.kernel
def measure_ranges(
    place: wp.array2d[wp.vec2], radius: wp.array2d[float], reach: float, direction: wp.array[wp.vec2],
    ranges: wp.array2d[float],
):  # fmt: skip
    """Distances to the first disc on each ray."""
    row, ray = wp.tid()
    nearest = float(reach)
    for i in range(place.shape[1]):
        nearest = wp.min(nearest, range_to(direction[ray], place[row, i], radius[row, i], reach))
    ranges[row, ray] = nearest
