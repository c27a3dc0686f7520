"""The lowest point of shapes, against points all over their surfaces."""

import numpy as np
import pytest

import simwarp as sw
from simwarp.importers.imported import lowest_point

COUNT = 200_000
_turn = np.pi * (1.0 + 5.0**0.5) * np.arange(COUNT)
_height = 1.0 - 2.0 * (np.arange(COUNT) + 0.5) / COUNT
SPHERE = np.stack([np.cos(_turn), np.sin(_turn), _height], 1)
SPHERE[:, :2] *= np.sqrt(1.0 - _height**2)[:, None]
_angle = np.linspace(0.0, 2.0 * np.pi, 10_001)
CIRCLE = np.stack([np.cos(_angle), np.sin(_angle), 0.0 * _angle], 1)
UP = np.array([0.0, 0.0, 1.0])
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
HALF, SCALE = np.array([0.3, 0.1, 0.6]), np.array([0.5, 2.0, 1.5])

SHAPES = {
    "sphere": (lambda b, o, p: b.add_shape_sphere(o, radius=0.3, pose=p), 0.3 * SPHERE),
    "capsule": (
        lambda b, o, p: b.add_shape_capsule(o, radius=0.1, half_length=0.4, pose=p),
        np.concatenate([0.1 * SPHERE + 0.4 * UP, 0.1 * SPHERE - 0.4 * UP]),
    ),
    "cylinder": (
        lambda b, o, p: b.add_shape_cylinder(o, radius=0.2, half_length=0.4, pose=p),
        np.concatenate([0.2 * CIRCLE + 0.4 * UP, 0.2 * CIRCLE - 0.4 * UP]),
    ),
    "cone": (
        lambda b, o, p: b.add_shape_cone(o, radius=0.2, half_length=0.4, pose=p),
        np.concatenate([0.2 * CIRCLE - 0.4 * UP, [0.4 * UP]]),
    ),
    "box": (lambda b, o, p: b.add_shape_box(o, half=tuple(HALF), pose=p), HALF * CORNERS),
    "ellipsoid": (lambda b, o, p: b.add_shape_ellipsoid(o, half=tuple(HALF), pose=p), HALF * SPHERE),
    "hull": (
        lambda b, o, p: b.add_shape_hull(o, HALF * CORNERS, scale=tuple(SCALE), pose=p),
        SCALE * HALF * CORNERS,
    ),
}


def matrix(rotation):
    """(3, 3) of a quaternion xyzw."""
    x, y, z, w = rotation
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2.0 * (w * cross + cross @ cross)


def some_rotation(random):
    rotation = random.normal(size=4)
    return rotation / np.linalg.norm(rotation)


@pytest.mark.parametrize("kind", SHAPES)
def test_the_lowest_point_is_that_of_the_surface(kind):
    add, points = SHAPES[kind]
    random = np.random.default_rng(3)
    for _ in range(8):
        builder = sw.ModelBuilder()
        builder.add_shape_plane()  # the world's: below, but none of the robot
        body = builder.add_body("b", mass=1.0, inertia=(1, 1, 1))
        place, own = random.normal(size=3), random.normal(size=3)
        turn, own_turn = some_rotation(random), some_rotation(random)
        add(builder, body, sw.pose(own, own_turn))
        world = place + (own + points @ matrix(own_turn).T) @ matrix(turn).T
        found = lowest_point(builder, [body], [[*place, *turn]])
        # 200 000 points on a sphere of 0.6 m are 4 mm apart: the lowest one is at most (4 mm)² / 0.6 m above
        assert found == pytest.approx(world[:, 2].min(), abs=3e-5)


def test_only_the_bodies_that_are_asked_for_count_and_those_without_shapes_by_their_centres():
    builder = sw.ModelBuilder()
    high, low = (builder.add_body(name, mass=1.0, inertia=(1, 1, 1)) for name in ("high", "low"))
    places = [[0, 0, 2, 0, 0, 0, 1], [0, 0, 1, 0, 0, 0, 1]]
    assert lowest_point(builder, [high, low], places) == 1.0
    for body in (high, low):
        builder.add_shape_sphere(body, radius=0.25)
    assert lowest_point(builder, [high, low], places) == 0.75
    assert lowest_point(builder, [high], places) == 1.75
