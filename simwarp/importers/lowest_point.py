"""The lowest point of shapes, for robots that have to stand on the ground."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import quat_conjugate, quat_multiply, rotate
from simwarp.core.types import WORLD, ShapeType
from simwarp.model.builder import ModelBuilder
from simwarp.model.specifications import ShapeSpec

Array = npt.NDArray[np.float64]

DOWN = np.array([0.0, 0.0, -1.0])


def lowest_point(builder: ModelBuilder, bodies: Iterable[int], places: npt.ArrayLike) -> float:
    """Height of the lowest point of the shapes on bodies; where they have none, of their centres of mass [m].

    Args:
        builder: that has the bodies.
        bodies: indices of those that count.
        places: (B, 7) positions and quaternions xyzw of all bodies, as a world of `State.body_q`.
    """
    poses = np.asarray(places, np.float64)
    counted = set(bodies) - {WORLD}
    heights = [_lowest(builder, shape, poses[shape.body]) for shape in builder.shapes if shape.body in counted]
    return min(heights or [float(poses[body, 2]) for body in counted])


def _lowest(builder: ModelBuilder, shape: ShapeSpec, place: Array) -> float:
    rotation = quat_multiply(place[3:], shape.pose.rotation)
    middle = place[:3] + rotate(place[3:], shape.pose.position)
    return float(middle[2]) - _reach(builder, shape, rotate(quat_conjugate(rotation), DOWN))


def _reach(builder: ModelBuilder, shape: ShapeSpec, way: Array) -> float:
    """How far a shape reaches from its origin along a unit vector in its axes [m]."""
    size, across, along = shape.size, math.hypot(way[0], way[1]), abs(float(way[2]))
    match shape.type:
        case ShapeType.SPHERE:
            return float(size[0])
        case ShapeType.CAPSULE:
            return float(size[0] + size[1] * along)
        case ShapeType.CYLINDER:
            return float(size[0] * across + size[1] * along)
        case ShapeType.CONE:
            return float(max(size[1] * way[2], size[0] * across - size[1] * way[2]))
        case ShapeType.BOX:
            return float(np.abs(size * way).sum())
        case ShapeType.ELLIPSOID:
            return float(np.linalg.norm(size * way))
        case ShapeType.HULL:
            return float((builder.hulls[shape.asset].vertices * size @ way).max())
        case ShapeType.MESH:
            return float((builder.meshes[shape.asset].vertices * size @ way).max())
    return 0.0
