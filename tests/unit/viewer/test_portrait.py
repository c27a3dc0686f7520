"""Portraits: the robot fills the picture whatever its size, on a floor that touches its lowest point."""

import numpy as np
import pytest

import simwarp as sw
from simwarp.sensors import Visuals
from simwarp.viewer import portrait
from simwarp.viewer.portrait import FROM, _tile, _view


def robot(scale=1.0, height=0.0):
    """A trunk with an arm."""
    builder = sw.ModelBuilder()
    trunk = builder.add_solid("trunk", "box", (0.3 * scale, 0.2 * scale, 0.1 * scale), mass=1.0,
                              pose=sw.pose((0, 0, height + 0.5 * scale)))  # fmt: skip
    arm = builder.add_solid("arm", "capsule", (0.05 * scale, 0.2 * scale), mass=0.1,
                            pose=sw.pose((0.2 * scale, 0, height + 0.2 * scale)))  # fmt: skip
    builder.add_joint_free("float", trunk)
    builder.add_joint_revolute("hinge", trunk, arm, axis=(0, 1, 0), anchor=(0.2 * scale, 0, height + 0.45 * scale))
    return builder


def picture(builder, q=None):
    return portrait(Visuals(builder), q, width=80, height=60, samples=2).astype(float)


def differing(a, b):
    """Share of the pixels that differ by more than a shade."""
    return float((np.abs(a - b).max(axis=-1) > 12).mean())


def test_size_and_place_do_not_matter():
    first = picture(robot())
    # tiles are 1, 2 or 5 times a power of ten: at ten times the size the same picture; the edges' rays may round
    assert differing(picture(robot(10.0)), first) < 0.02
    assert differing(picture(robot(height=5.0)), first) < 0.02
    assert differing(picture(robot(2.0)), first) < 0.5  # the same robot on other tiles


def test_coordinates_move_what_is_drawn():
    first = picture(robot())
    q = [0.0, 0.0, 0.5, 0.0, 0.0, 0.0, -1.5]
    assert differing(picture(robot(), [0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]), first) < 0.01
    assert differing(picture(robot(), q), first) > 0.03
    with pytest.raises(sw.ModelError, match=r"q must have shape \(1, 7\)"):
        picture(robot(), [0.0] * 6)


@pytest.mark.parametrize("box", [(1.0, 1.0, 1.0), (5.0, 0.1, 0.1), (0.1, 0.1, 3.0), (0.2, 4.0, 0.2)])
def test_the_view_holds_all_corners_and_not_much_more(box):
    low, high = np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]) + box
    eye, target = _view(low, high, 4 / 3)
    forward = (target - eye) / np.linalg.norm(target - eye)
    assert np.allclose(forward, -np.array(FROM) / np.linalg.norm(FROM))
    right = np.cross(forward, (0, 0, 1))
    right = right / np.linalg.norm(right)
    up = np.cross(right, forward)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    away = corners - eye
    reach = [np.abs(away @ right) / (away @ forward), np.abs(away @ up) * (4 / 3) / (away @ forward)]
    assert 0.85 < np.max(reach) / np.tan(0.3) <= 1.0


def test_grounds_of_the_model_stay_where_they_are():
    builder = robot(height=0.3)
    builder.add_shape_plane(name="ground")
    visuals = Visuals(builder)
    portrait(visuals, width=16, height=12, samples=1)
    assert [instance.name for instance in visuals.instances].count("ground") == 1
    assert not [instance.name for instance in visuals.instances if instance.name.startswith("floor")]
    alone = Visuals(robot(height=0.3))
    portrait(alone, width=16, height=12, samples=1)
    (floor,) = (instance for instance in alone.instances if instance.name.startswith("floor"))
    # the arm's lower cap, 0.25 below its middle, at 0.2 + 0.3
    assert floor.pose.position[2] == pytest.approx(0.25, abs=1e-5)


@pytest.mark.parametrize(("size", "tile"), [(4.0, 1.0), (7.9, 1.0), (8.0, 2.0), (0.02, 0.005), (1.0, 0.2)])
def test_tiles_are_round_numbers(size, tile):
    assert _tile(size) == pytest.approx(tile)
