"""Lenses: closed forms, inverses, corners, and lenses that cannot be."""

import math
from typing import Any

import numpy as np
import pytest
import warp as wp

from simwarp.core.types import ModelError
from simwarp.sensors.cameras.lenses import FishEye, Pinhole, Radial, directions
from simwarp.sensors.cameras.lenses_kernels import Lens, lens_direction
from tests.reference.sensors import lenses as reference

# float32 rounds u, v, and one function each of sin, cos or sqrt: a few units in the last place of 1
ROUNDING = 1.0e-6
BARREL: dict[str, Any] = {"k1": -0.25, "k2": 0.06, "k3": -0.005}
CUSHION = {"k1": 0.3, "k2": 0.1, "k3": 0.05}
MIXED: dict[str, Any] = {"k1": -0.4, "k2": 0.3, "k3": -0.04}


@wp.kernel
def look(lens: Lens, u: wp.array[float], v: wp.array[float], direction_out: wp.array[wp.vec3]):
    """Directions of points of the image."""
    i = wp.tid()
    direction_out[i] = lens_direction(u[i], v[i], lens)  # type: ignore[index]


def cast(lens, u, v, aspect=1.0):
    """What the kernel makes of points of the image."""
    flat_u, flat_v = (np.ascontiguousarray(x, np.float32).reshape(-1) for x in (u, v))
    out = wp.zeros(flat_u.size, dtype=wp.vec3, device="cpu")
    inputs = [lens.numbers(aspect), wp.array(flat_u, device="cpu"), wp.array(flat_v, device="cpu")]
    wp.launch(look, dim=flat_u.size, inputs=inputs, outputs=[out], device="cpu")
    return out.numpy().astype(np.float64).reshape(*np.shape(u), 3)


@pytest.mark.parametrize("fov", [0.2, 1.4, 2.8])
def test_pinhole_is_its_closed_form(fov):
    u, v = reference.grid(33, 20)
    found = cast(Pinhole(fov=fov), u, v)
    np.testing.assert_allclose(found, reference.pinhole(u, v, fov), atol=ROUNDING)
    np.testing.assert_allclose(directions(Pinhole(fov=fov), 33, 20), reference.pinhole(u, v, fov), atol=1e-12)


def test_the_edges_of_the_image_are_the_field_of_view():
    for lens in (Pinhole(fov=1.1), FishEye(fov=1.1)):
        left, right, middle = cast(lens, np.array([-1.0, 1.0, 0.0]), np.zeros(3))
        assert math.atan2(left[1], left[0]) == pytest.approx(0.55, abs=1e-6)
        assert math.atan2(right[1], right[0]) == pytest.approx(-0.55, abs=1e-6)
        np.testing.assert_allclose(middle, [1.0, 0.0, 0.0], atol=1e-7)


def test_v_is_up_and_u_is_right():
    for lens in (Pinhole(), FishEye(), Radial(k1=0.1)):
        up, right = cast(lens, np.array([0.0, 0.3]), np.array([0.3, 0.0]))
        assert up[2] > 0.1
        assert right[1] < -0.1


@pytest.mark.parametrize("fov", [0.5, 2.0, 3.0])
def test_fish_eye_is_the_fov_model(fov):
    u, v = (0.7 * x for x in reference.grid(21, 21))  # the tangent of the paper ends at a right angle
    found = cast(FishEye(fov=fov), u, v)
    # near a right angle the paper's tangent loses digits, not the kernel's sine
    np.testing.assert_allclose(found, reference.fov_lens(u, v, fov), atol=ROUNDING)


def test_fish_eye_sees_behind():
    u, v = reference.grid(15, 15)
    found = cast(FishEye(fov=math.radians(270.0)), u, v)
    angle = np.hypot(u, v) * math.radians(135.0)
    np.testing.assert_allclose(found, reference.direction_at(angle, u, v), atol=ROUNDING)
    assert found[7, 0, 0] < 0.0


@pytest.mark.parametrize("k", [BARREL, CUSHION, MIXED, {"k1": -0.1}], ids=str)
@pytest.mark.parametrize("fov", [0.6, 1.3])
def test_radial_round_trip_in_all_pixels_and_corners(k, fov):
    width, height = 40, 30
    lens = Radial(fov=fov, **k)
    u, v = reference.grid(width, height)
    u[0, 0], v[0, 0] = -1.0, height / width  # the very corners
    u[-1, -1], v[-1, -1] = 1.0, -height / width
    found = cast(lens, u, v, height / width)
    r = np.hypot(found[..., 1], found[..., 2]) / found[..., 0]
    scale = math.tan(0.5 * fov)
    wanted = np.hypot(u, v) * scale
    # the inverse is iterated to 2e-7 relative; float32 of the law adds some 4e-7
    np.testing.assert_allclose(reference.moved(r, [k.get(n, 0.0) for n in ("k1", "k2", "k3")]), wanted, rtol=2e-6)
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1.0, atol=ROUNDING)
    np.testing.assert_allclose(lens.points(found), np.stack([u, v], axis=-1), atol=3e-6)


def test_radial_is_inverted_up_to_its_fold():
    # r - r^3 / 2 turns back at sqrt(2/3), which it moves to 2/3 of that
    fold = math.sqrt(2.0 / 3.0)
    lens = Radial(fov=2.0 * math.atan(0.9999 * 2.0 / 3.0 * fold), k1=-0.5)
    u = np.linspace(0.0, 1.0, 50)
    found = cast(lens, u, np.zeros_like(u), 0.0)
    wanted = u * math.tan(0.5 * lens.fov)
    np.testing.assert_allclose(reference.moved(-found[:, 1] / found[:, 0], (-0.5, 0.0, 0.0)), wanted, atol=1e-6)


def test_radial_on_the_host_is_that_of_the_kernel():
    u, v = reference.grid(16, 9)
    for lens in (Radial(fov=1.2, **MIXED), Pinhole(fov=1.2), FishEye(fov=4.0)):
        np.testing.assert_allclose(cast(lens, u, v, 9 / 16), directions(lens, 16, 9), atol=2e-6)


def test_small_radial_distortions_are_inverted_as_the_power_series_says():
    k = (-0.02, 0.004, 0.001)
    u = np.linspace(0.05, 1.0, 12)
    fov = 1.0
    found = cast(Radial(fov=fov, k1=k[0], k2=k[1], k3=k[2]), u, np.zeros_like(u), 0.0)
    # the first term left out is some 300 k1^5 r^10: 1e-9
    series = reference.drap_lefevre(u * math.tan(0.5 * fov), k)
    np.testing.assert_allclose(-found[:, 1] / found[:, 0], series, rtol=2e-6)


def test_without_coefficients_radial_is_a_pinhole():
    u, v = reference.grid(8, 8)
    np.testing.assert_allclose(cast(Radial(fov=1.0), u, v), cast(Pinhole(fov=1.0), u, v), atol=ROUNDING)


def test_points_are_where_directions_come_from():
    u, v = reference.grid(12, 10)
    for lens in (Pinhole(fov=1.2), FishEye(fov=5.0), Radial(fov=1.2, **BARREL)):
        np.testing.assert_allclose(lens.points(directions(lens, 12, 10)), np.stack([u, v], axis=-1), atol=1e-9)
    assert np.isnan(Pinhole().points([-1.0, 0.2, 0.1])).all()


def test_intrinsics_project_to_pixels():
    width, height, fov = 64, 48, 1.1
    matrix = Pinhole(fov=fov).intrinsics(width, height)
    ahead = directions(Pinhole(fov=fov), width, height)[7, 11] * 3.0
    column, row, depth = matrix @ [-ahead[1], -ahead[2], ahead[0]] / ahead[0]
    assert (column, row, depth) == pytest.approx((11.5, 7.5, 1.0))
    assert matrix[0, 0] == pytest.approx(0.5 * width / math.tan(0.5 * fov))


def test_a_lens_that_folds_is_refused():
    with pytest.raises(ModelError, match=r"must rise up to the corner .* k1=-0.5"):
        Radial(fov=1.6, k1=-0.5).numbers(1.0)
    Radial(fov=0.7, k1=-0.5).numbers(1.0)
    with pytest.raises(ModelError, match=r"fov must be in \(0, 3\.14159\), got 90\.0; give radians, FishEye sees more"):
        Pinhole(fov=90.0)
    with pytest.raises(ModelError, match=r"FishEye: fov must be positive, got 0\.0; give radians"):
        FishEye(fov=0.0)
    with pytest.raises(ModelError, match="k1 must be a finite number"):
        Radial(k1=math.nan)
