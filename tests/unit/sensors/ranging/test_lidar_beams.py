"""Tables of beams, the rays within one, and the reduction of rays to returns against its slow reference."""
# mypy: disable-error-code="index,attr-defined,arg-type"

import math

import numpy as np
import pytest
import warp as wp

from simwarp.core.types import ModelError
from simwarp.sensors.ranging.beams import HDL_32E_ELEVATION, VLP_16_ELEVATION, Beam, BeamTable, beam_grid
from simwarp.sensors.ranging.beams_kernels import column_at
from simwarp.sensors.ranging.returns_kernels import MAX_RAYS, ReturnMode, reduce_beam
from tests.reference.sensors import lidar as reference

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.kernel
def reduce_bundles(
    mode: int,
    ranges: wp.array2d[float],
    intensities: wp.array2d[float],
    found: wp.array[wp.vec4],
):
    bundle = wp.tid()
    r = wp.zeros(shape=MAX_RAYS, dtype=float)
    i = wp.zeros(shape=MAX_RAYS, dtype=float)
    for ray in range(ranges.shape[1]):
        r[ray] = ranges[bundle, ray]
        i[ray] = intensities[bundle, ray]
    found[bundle] = reduce_beam(mode, ranges.shape[1], r, i)


@wp.kernel
def find_columns(columns: int, window: int, begin: wp.array[int]):
    part = wp.tid()
    begin[part] = column_at(float(part) / float(window), columns)


def reduced(mode, ranges, intensities):
    found = wp.zeros(len(ranges), dtype=wp.vec4, device="cpu")
    wp.launch(
        reduce_bundles, dim=len(ranges), device="cpu", outputs=[found],
        inputs=[
            int(ReturnMode[mode.upper()]),
            *(wp.array(each, dtype=float, device="cpu") for each in (ranges, intensities)),
        ],
    )  # fmt: skip
    return found.numpy()


def test_a_full_turn_does_not_repeat_its_first_column():
    table = beam_grid(8, 3, elevation=(0.2, -0.4))
    azimuth, elevation = table.angles()
    assert np.degrees(azimuth[0]).tolist() == pytest.approx([180.0 - 45.0 * k for k in range(8)])
    assert elevation[:, 0].tolist() == pytest.approx([0.2, -0.1, -0.4])
    assert table.shape == (3, 8)
    d = table.directions()
    assert np.linalg.norm(d[:, 0] - d[:, -1], axis=-1).min() > 0.5
    other_way = beam_grid(8, 1, azimuth=(-math.pi, math.pi)).angles()[0]
    assert np.degrees(other_way[0]).tolist() == pytest.approx([-180.0 + 45.0 * k for k in range(8)])


def test_a_part_of_a_turn_has_both_ends():
    azimuth, elevation = beam_grid(5, 1, azimuth=(0.4, -0.4), elevation=(0.1, -0.3)).angles()
    assert azimuth[0].tolist() == pytest.approx([0.4, 0.2, 0.0, -0.2, -0.4])
    assert elevation.tolist() == [[pytest.approx(-0.1)] * 5]


def test_directions_point_where_the_axes_say():
    d = BeamTable(azimuth=(0.0, math.pi / 2), elevation=(0.0, math.pi / 2)).directions()
    assert d[0, 0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-15)
    assert d[0, 1] == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)
    assert d[1, 0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)


def test_a_table_may_differ_by_row_and_column():
    azimuth = np.array([[0.0, 0.1, 0.2], [0.01, 0.11, 0.21]])
    table = BeamTable(azimuth=azimuth, elevation=(0.1, -0.1))
    assert table.shape == (2, 3)
    assert np.array_equal(table.angles()[0], azimuth)
    assert table.directions()[1, 2] == pytest.approx(reference.direction(0.21, -0.1))


def test_tables_of_real_lidars():
    assert np.degrees(VLP_16_ELEVATION).tolist() == pytest.approx(list(range(15, -16, -2)))
    degrees = np.degrees(HDL_32E_ELEVATION)
    # the published table rounds a spacing of 4/3 degrees to hundredths
    assert degrees == pytest.approx(np.linspace(10.67, -30.67, 32), abs=0.012)
    assert len(VLP_16_ELEVATION) == 16


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: BeamTable(azimuth=(), elevation=(0.0,)), "BeamTable: azimuth must hold at least one angle"),
        (lambda: BeamTable(azimuth=(0.0,), elevation=(2.0,)), r"within ±pi/2 rad, got 2; angles are in radians"),
        (lambda: BeamTable(azimuth=(math.nan,), elevation=(0.0,)), "azimuth must be finite"),
        (lambda: BeamTable(azimuth="front", elevation=(0.0,)), "azimuth must be a table of angles"),
        (lambda: BeamTable(azimuth=np.zeros((3, 4)), elevation=np.zeros(2)), r"shapes \(3, 4\) and \(2,\)"),
        (lambda: beam_grid(0, 3), "columns must be at least 1, got 0"),
        (lambda: beam_grid(4, 2.5), "rows must be a whole number, got 2.5"),
        (lambda: beam_grid(4, 1, azimuth=(0.0, 360.0)), "at most 2 pi rad, got 360; angles are in radians"),
        (
            lambda: Beam(divergence=-0.1),
            r"divergence must be in \[0, 1\.5708\], got -0\.1; give radians, 0 for one ray",
        ),
        (
            lambda: Beam(divergence=(0.1, 0.2, 0.3)),
            r"divergence must be a number or a list of 2 items, got \(0\.1, 0\.2, 0\.3\)",
        ),
        (
            lambda: Beam(radius=6),
            r"radius must be from 1 to 5, got 6; give rings of rays, of which \(2 radius - 1\)² are cast",
        ),
        (
            lambda: Beam(radius=1.5),
            r"radius must be a whole number, got 1\.5; give rings of rays, of which \(2 radius - 1\)² are cast",
        ),
        (lambda: Beam(shape="round"), "shape must be one of 'elliptic', 'rectangular', got 'round'"),
    ],
)
def test_mistakes_are_named(make, message):
    with pytest.raises(ModelError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("radius", [2, 3, 5])
def test_rays_fill_the_cross_section(radius):
    count = (2 * radius - 1) ** 2
    wide, high = 0.004, 0.002
    square = Beam(divergence=(wide, high), radius=radius, shape="rectangular").offsets()
    round_ = Beam(divergence=(wide, high), radius=radius, shape="elliptic").offsets()
    for offsets in (square, round_):
        assert offsets.shape == (count, 2)
        assert offsets[0].tolist() == [0.0, 0.0]
        assert np.abs(offsets).max(axis=0) == pytest.approx([wide / 2, high / 2])
        assert offsets.mean(axis=0) == pytest.approx([0.0, 0.0], abs=1e-12)
    # corners belong to the rectangle alone
    assert np.hypot(square[:, 0] / wide, square[:, 1] / high).max() == pytest.approx(math.sqrt(0.5))
    assert np.hypot(round_[:, 0] / wide, round_[:, 1] / high).max() == pytest.approx(0.5)
    assert len(np.unique(square.round(9), axis=0)) == count
    # equal areas: of a disc with rays of equal energy the mean square radius is half the square of the radius, but for
    # the rays on its very rim
    inside = (np.arange(radius) * 8.0).clip(1.0)
    rings = np.arange(radius) / (radius - 1)
    assert np.mean((round_[:, 0] / (wide / 2)) ** 2 + (round_[:, 1] / (high / 2)) ** 2) == pytest.approx(
        (inside * rings**2).sum() / count
    )


def test_one_ray_without_divergence():
    assert Beam().offsets().tolist() == [[0.0, 0.0]]
    assert Beam(radius=3).offsets().tolist() == [[0.0, 0.0]]
    assert Beam(divergence=0.1).offsets().tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize("mode", ["strongest", "first", "last", "mean", "dual"])
def test_returns_agree_with_their_reference(mode):
    rng = np.random.default_rng(3)
    for rays in (1, 9, 25, 81):
        # clusters closer than the pulse, gaps between them, misses, faint ones
        ranges = (rng.integers(1, 5, (40, rays)) * 3.0 + rng.uniform(0.0, 0.12, (40, rays))).astype(np.float32)
        intensities = rng.uniform(0.0, 1.0, (40, rays)).astype(np.float32)
        intensities[rng.uniform(size=(40, rays)) < 0.2] = 0.0
        intensities[rng.uniform(size=(40, rays)) < 0.1] = 5e-7
        intensities[0] = 0.0
        ranges[intensities == 0.0] = 0.0
        found = reduced(mode, ranges, intensities)
        for k in range(40):
            wanted = np.ravel(reference.reduce_beam(mode, ranges[k].astype(float), intensities[k].astype(float)))
            # float32: 1e-7 of 12 m and, through the pulse's slope, 1e-6 m / 0.05 m of the intensity
            assert found[k, : len(wanted)] == pytest.approx(wanted, rel=3e-6, abs=1e-5), (rays, k)


def test_a_beam_on_two_surfaces():
    # nine rays: four on a bright post at 10 m, four on a wall at 20 m, one lost
    ranges = np.array([[10.0] * 4 + [20.0] * 4 + [0.0]])
    intensities = np.array([[0.5] * 4 + [0.4] * 4 + [0.0]])
    near, far = (10.0, 2.0 / 9.0), (20.0, 1.6 / 9.0)
    assert reduced("first", ranges, intensities)[0, :2] == pytest.approx(near)
    assert reduced("last", ranges, intensities)[0, :2] == pytest.approx(far)
    assert reduced("strongest", ranges, intensities)[0, :2] == pytest.approx(near)
    assert reduced("mean", ranges, intensities)[0, :2] == pytest.approx((15.0, 3.6 / 9.0))
    assert reduced("dual", ranges, np.where(intensities > 0.0, 0.9 - intensities, 0.0))[0] == pytest.approx(
        [20.0, 2.0 / 9.0, 10.0, 1.6 / 9.0]
    )


def test_columns_are_shared_out_without_gap_or_overlap():
    for columns in (1, 7, 16, 900, 1080, 4500):
        for window in (1, 3, 7, 10, 25, 33):
            begin = wp.zeros(window + 1, dtype=int, device="cpu")
            wp.launch(find_columns, dim=window + 1, inputs=[columns, window], outputs=[begin], device="cpu")
            wanted = [-(-part * columns // window) for part in range(window + 1)]
            assert begin.numpy().tolist() == wanted
