"""Contacts of balls with what drives and guides chains: concave arcs of a sprocket, and a groove between two discs."""

import math

import warp as wp

from simwarp.kernels.collision.clip import write_contact
from simwarp.kernels.collision.shape import Assets, Manifold, Shape
from simwarp.kernels.collision.support import column, safe_direction, sign_of

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

TURN = wp.constant(2.0 * math.pi)


@wp.func
def sphere_sprocket(a: Shape, b: Shape, reach: float, flip: int, assets: Assets, out: Manifold) -> int:
    """A ball and the arc of a sprocket whose centre is nearest to it, as if the ball's centre were in the sprocket's
    middle plane; none beyond the half width, the arcs' centres, or the tips, nor where the ball's centre is behind the
    arc. The feature is the arc's number.
    """
    p = (a.x - b.x) * b.rot
    teeth = assets.sprocket_teeth[b.asset]
    arc = assets.sprocket_arc[b.asset]
    centre = b.size[0] * arc[0]
    radius = b.size[0] * arc[1]
    if wp.abs(p[2]) > b.size[1] or p[0] * p[0] + p[1] * p[1] > centre * centre:
        return 0
    pitch = TURN / float(teeth)
    angle = wp.atan2(p[1], p[0])
    tooth = wp.round(angle / pitch)
    side = sign_of(angle - pitch * tooth)
    middle = pitch * tooth + side * arc[2]
    radial = wp.vec3(wp.cos(middle), wp.sin(middle), 0.0)
    d = wp.vec3(p[0], p[1], 0.0) - centre * radial
    away = safe_direction(d, -radial)
    gap = radius - b.margin - a.size[0] - a.margin - wp.length(d)
    behind = wp.length(d) >= radius
    if gap >= reach or behind or wp.length(centre * radial + radius * away) > b.size[0]:
        return 0
    feature = 2 * ((int(tooth) + teeth) % teeth)
    if arc[2] > 0.0 and side < 0.0:
        feature += 1
    n = b.rot * away
    write_contact(0, n, a.x + (a.size[0] + a.margin) * n, gap, feature, flip, out)
    return 1


@wp.func
def sphere_groove(a: Shape, b: Shape, reach: float, flip: int, out: Manifold) -> int:
    """A ball between two discs and the nearer of them; none beyond their radius. The feature is the disc's number."""
    p = (a.x - b.x) * b.rot
    gap = b.size[1] - b.margin - a.size[0] - a.margin - wp.abs(p[2])
    if gap >= reach or p[0] * p[0] + p[1] * p[1] > b.size[0] * b.size[0]:
        return 0
    n = sign_of(p[2]) * column(b.rot, 2)
    write_contact(0, n, a.x + (a.size[0] + a.margin) * n, gap, wp.where(p[2] < 0.0, 1, 0), flip, out)
    return 1
