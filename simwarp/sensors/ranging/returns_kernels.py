"""From the rays of one beam to its returns.

A ray i has a range r_i [m] and an intensity I_i = reflectance |n . d|; a ray that hits nothing has I_i = 0. A detector
integrates over its pulse, so that rays within 5 cm of each other add up. With n rays in the beam (misses included):

    J_i = 1/n sum_j max(0, 1 - |r_j - r_i| / 0.05 m) I_j

strongest: the ray of the largest J_i, the first of equals; its range and J_i
first:     the smallest range; its range and J_i
last:      the largest range; its range and J_i
mean:      range averaged over the rays with I_i > 0, intensity 1/n sum_j I_j
dual:      strongest, then first
"""

from enum import IntEnum

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

MAX_RAYS = wp.constant(81)
"""Rays of one beam."""
PER_PULSE = wp.constant(1.0 / 0.05)  # over the half width of the pulse's triangle, in range [1/m]
LEAST_INTENSITY = wp.constant(1.0e-6)
"""Rays of less are not seen."""


class ReturnMode(IntEnum):
    """Return that a detector reports of a beam that hits several surfaces."""

    STRONGEST = 0
    FIRST = 1
    LAST = 2
    MEAN = 3
    DUAL = 4
    """Strongest, then first: twice the channels."""


@wp.func
def pulse_intensity(ray: int, count: int, range_: wp.array[float], intensity: wp.array[float]) -> float:
    """J of a ray: what arrives together with it."""
    total = float(0.0)
    for other in range(count):
        share = 1.0 - wp.abs(range_[other] - range_[ray]) * PER_PULSE
        if share > 0.0:
            total += share * intensity[other]
    return total / float(count)


@wp.func
def strongest_return(count: int, range_: wp.array[float], intensity: wp.array[float]) -> wp.vec2:
    """(range, intensity); zeros: no return."""
    best = wp.vec2()
    for ray in range(count):
        if intensity[ray] > LEAST_INTENSITY:
            together = pulse_intensity(ray, count, range_, intensity)
            if together > best[1]:
                best = wp.vec2(range_[ray], together)
    return best


@wp.func
def extreme_return(count: int, side: float, range_: wp.array[float], intensity: wp.array[float]) -> wp.vec2:
    """(range, intensity) of the smallest (side 1) or the largest (side -1) range; zeros: no return."""
    found = int(-1)
    for ray in range(count):
        if intensity[ray] > LEAST_INTENSITY:
            if found < 0:
                found = ray
            elif side * range_[ray] < side * range_[found]:
                found = ray
    if found < 0:
        return wp.vec2()
    return wp.vec2(range_[found], pulse_intensity(found, count, range_, intensity))


@wp.func
def mean_return(count: int, range_: wp.array[float], intensity: wp.array[float]) -> wp.vec2:
    """(range, intensity); zeros: no return."""
    total = float(0.0)
    way = float(0.0)
    seen = int(0)
    for ray in range(count):
        if intensity[ray] > LEAST_INTENSITY:
            total += intensity[ray]
            way += range_[ray]
            seen += 1
    if seen == 0:
        return wp.vec2()
    return wp.vec2(way / float(seen), total / float(count))


@wp.func
def reduce_beam(mode: int, count: int, range_: wp.array[float], intensity: wp.array[float]) -> wp.vec4:
    """(range, intensity) of a beam's return, and of its second one in mode dual; zeros: no return."""
    first = wp.vec2()
    if mode == ReturnMode.FIRST or mode == ReturnMode.DUAL:
        first = extreme_return(count, 1.0, range_, intensity)
    if mode == ReturnMode.FIRST:
        return wp.vec4(first[0], first[1], 0.0, 0.0)
    best = wp.vec2()
    if mode == ReturnMode.LAST:
        best = extreme_return(count, -1.0, range_, intensity)
    elif mode == ReturnMode.MEAN:
        best = mean_return(count, range_, intensity)
    else:
        best = strongest_return(count, range_, intensity)
    return wp.vec4(best[0], best[1], first[0], first[1])
