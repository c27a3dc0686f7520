"""Meshes of primitives against their formulas, and closed as trimesh sees it."""

import numpy as np
import pytest
import trimesh

from simwarp.geometry.primitive_meshes import COARSE, SIDES, primitive_mesh


def around(sides: int) -> float:
    """Area of a regular polygon in a circle, over that of the circle."""
    return sides * np.sin(2.0 * np.pi / sides) / (2.0 * np.pi)


@pytest.mark.parametrize("coarse", [False, True])
@pytest.mark.parametrize(
    ("kind", "sizes", "volume", "corners"),
    [
        ("cube", {"size": 0.4}, 0.4**3, (0.2, 0.2, 0.2)),
        ("cylinder", {"radius": 0.3, "height": 0.5}, np.pi * 0.3**2 * 0.5, (0.3, 0.3, 0.25)),
        ("cone", {"radius": 0.3, "height": 0.5}, np.pi * 0.3**2 * 0.5 / 3.0, (0.3, 0.3, 0.25)),
        ("sphere", {"radius": 0.3}, 4.0 / 3.0 * np.pi * 0.3**3, (0.3, 0.3, 0.3)),
        ("capsule", {"radius": 0.3, "height": 0.5}, np.pi * 0.3**2 * (0.5 + 0.4), (0.3, 0.3, 0.55)),
    ],
)
def test_they_are_closed_and_as_large_as_they_should_be(kind, sizes, volume, corners, coarse):
    points, faces = primitive_mesh(kind, sizes, coarse=coarse)
    mesh = trimesh.Trimesh(points, faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    sides = COARSE if coarse else SIDES
    assert points.max(axis=0) == pytest.approx(corners, rel=1e-12)
    assert points.min(axis=0) == pytest.approx(-np.array(corners), rel=1e-12)
    if kind in ("cylinder", "cone"):  # a prism and a pyramid over the polygon, exactly
        assert mesh.volume == pytest.approx(volume * around(sides), rel=1e-12)
    elif kind == "cube":
        assert mesh.volume == pytest.approx(volume, rel=1e-12)
    else:  # frusta of pyramids, whose rings lie at equal angles, and the tube
        angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, sides // 2 + 1)
        r, z = 0.3 * np.cos(angle), 0.3 * np.sin(angle)
        frusta = np.pi / 3.0 * np.sum(np.diff(z) * (r[1:] ** 2 + r[1:] * r[:-1] + r[:-1] ** 2))
        tube = np.pi * 0.3**2 * sizes.get("height", 0.0)
        assert mesh.volume == pytest.approx((frusta + tube) * around(sides), rel=1e-12)
        assert mesh.volume == pytest.approx(volume, rel=0.05)


@pytest.mark.parametrize("kind", ["sphere", "capsule"])
def test_round_ones_have_all_corners_on_their_surface(kind):
    points, _ = primitive_mesh(kind, {"radius": 0.3, "height": 0.5} if kind == "capsule" else {"radius": 0.3})
    inside = np.clip(points[:, 2], -0.25, 0.25) if kind == "capsule" else np.zeros(len(points))
    axis = np.stack([np.zeros(len(points)), np.zeros(len(points)), inside], axis=1)
    assert np.linalg.norm(points - axis, axis=1) == pytest.approx(0.3, rel=1e-12)
