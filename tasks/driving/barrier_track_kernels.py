"""Device half of the barrier track: corners in a barrier, and what driving beside the middle costs."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays

from .base_kernels import Car, car_heading, plane, point_of
from .lapping_kernels import Lap
from .routes_kernels import RouteTables, locate

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})


@wp.kernel
def find_corners_outside(
    half_width: float, corners: wp.array[wp.vec2], car: Car, state: StateArrays, routes: RouteTables, lap: Lap,
    outside: wp.array[wp.bool],
):  # fmt: skip
    """Whether a corner of the car is in a barrier."""
    world = wp.tid()
    point = plane(point_of(world, car, state))
    heading = car_heading(world, car, state)
    c = wp.cos(heading)
    s = wp.sin(heading)
    touching = bool(False)
    for i in range(corners.shape[0]):
        corner = corners[i]
        turned = wp.vec2(c * corner[0] - s * corner[1], s * corner[0] + c * corner[1])
        aside = locate(int(lap.route[world]), point + turned, routes)[1]
        touching = touching or wp.abs(aside) > half_width
    outside[world] = touching


@wp.kernel
def reward_lane_offset(
    weight: float, car: Car, state: StateArrays, routes: RouteTables, lap: Lap, terms: wp.array2d[float]
):
    """Term of the reward for the distance from the middle of the lane: (1, W)."""
    world = wp.tid()
    aside = locate(int(lap.route[world]), plane(point_of(world, car, state)), routes)[1]
    terms[0, world] = weight * wp.abs(aside)
