"""Ruts are seen: rays against a brute-force reference; camera, lidar and height query agree; nothing else changes."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.core.types import ModelError
from simwarp.kernels.core.world_range import WorldRange
from simwarp.sensors import Mount, Schedule
from simwarp.sensors.ranging.beams import beam_grid
from simwarp.sensors.ranging.lidar import Lidar, LidarConfig
from simwarp.sensors.ray_casting_kernels import cast_rays
from simwarp.sensors.scene import Visuals
from simwarp.soil import Soil, SoilWheel
from tests.reference.soil_surface import first_hits, touched_cells, touched_nodes
from tests.unit.soil.ruts import Eye, Rut
from tests.unit.soil.soil_wheels import RADIUS, WIDTH

SPACING = 0.05
MILLIMETRE = 1e-3


@functools.cache
def rutted(hilly: bool) -> Rut:
    """One that no test changes."""
    return Rut(hilly=hilly).roll()


def cast(rut: Rut, start: np.ndarray, direction: np.ndarray, reach: float = 100.0) -> tuple[np.ndarray, np.ndarray]:
    """Distances (2, R), -1 without a hit, and normals of rays in both worlds."""
    shape = (2, len(start))
    outputs: list[Any] = [wp.zeros(shape, dtype=dtype, device="cpu") for dtype in (float, wp.vec3, wp.int32)]
    tables = rut.scene.tables()
    rut.scene.place(rut.simulation.state, tables)
    rays = [np.broadcast_to(values, (2, *values.shape)).copy() for values in (start, direction)]
    wp.launch(
        cast_rays, dim=shape, outputs=outputs,
        inputs=[WorldRange(), tables, rut.model.assets, wp.array(rays[0], dtype=wp.vec3d, device="cpu"),
                wp.array(rays[1].astype(np.float32), dtype=wp.vec3, device="cpu"), reach], device="cpu",
    )  # fmt: skip
    return outputs[0].numpy(), outputs[1].numpy()


def rays_at_the_rut(count: int, seed: int, *, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Starts and directions: from high above, falling 1:10 along and across, out of the rut, or from below ground."""
    rng = np.random.default_rng(seed)
    aim = np.stack([rng.uniform(-0.3, 1.6, count), rng.uniform(-0.4, 0.4, count), rng.uniform(-0.08, 0.0, count)], 1)
    if kind == "high":
        start = np.stack(
            [rng.uniform(-1.0, 2.0, count), rng.uniform(-1.0, 1.0, count), rng.uniform(0.4, 3.0, count)], 1
        )
    elif kind == "oblique":
        angle = rng.uniform(0.0, 2.0 * np.pi, count)
        start = aim + rng.uniform(0.3, 0.9, count)[:, None] * np.stack(
            [np.cos(angle), np.sin(angle), 0.1 + 0 * angle], 1
        )
        start[:, 2] = np.maximum(start[:, 2], 0.3 * (start[:, 2] - aim[:, 2]))
    elif kind == "inside":
        start = aim + np.array((0.0, 0.0, 0.06)) * rng.uniform(0.0, 1.0, (count, 1))
        aim = start + rng.standard_normal((count, 3)) * (1.0, 1.0, 0.4)
    else:
        start = np.stack(
            [rng.uniform(-0.3, 1.6, count), rng.uniform(-0.5, 0.5, count), rng.uniform(-1.0, -0.3, count)], 1
        )
    way = aim - start
    return start, way / np.linalg.norm(way, axis=1, keepdims=True)


@pytest.mark.parametrize("kind", ["high", "oblique", "inside", "below"])
@pytest.mark.parametrize("hilly", [False, True])
def test_rays_hit_what_the_reference_hits(hilly, kind):
    rut = rutted(hilly)
    start, direction = rays_at_the_rut(400, 3, kind=kind)
    if hilly:  # the reference's heights are about zero
        start[:, 2] += 0.2
    direction = direction.astype(np.float32).astype(np.float64)
    nodes = touched_nodes(dict(rut.soil.memory), 0)
    assert len(nodes) > 100
    expected, normals = first_hits(nodes, SPACING, rut.undeformed, rut.base(), start, direction)
    t, n = (values[0] for values in cast(rut, start, direction))
    hit = t >= 0.0
    near = np.where(np.isfinite(expected), expected, -1.0)
    # 1e-5 m: float32 over a few metres; a grazing ray turns a height's rounding into a longer way
    slack = 1e-5 / np.maximum(np.abs((normals * direction).sum(axis=1)), 1e-2)
    same = (hit == (near >= 0.0)) & (np.abs(t - near) < slack)
    # On hills cells of nodes and of undeformed ground meet at edges up to a crease apart: rays through there may
    # go either way. Elsewhere a ray within rounding of a crest.
    assert same.mean() > (0.97 if hilly else 0.995)
    assert hit.mean() > 0.3
    dropped = np.abs(start[:, 2] + near * direction[:, 2]) > MILLIMETRE
    assert (same & hit & dropped).sum() > 20
    aligned = (n * normals).sum(axis=1)[same & hit]
    # a hit at an edge has either facet's normal
    assert (aligned > 1.0 - 1e-5).mean() > 0.99


@pytest.mark.parametrize("hilly", [False, True])
def test_camera_and_height_query_agree(hilly):
    rut = rutted(hilly)
    for place in ((0.5, -0.4, 1.5), (-0.9, 0.1, 0.45)):  # from above, and falling 1:10 to 1:3 along the rut
        eye = Eye(rut, place)
        seen = eye.look()
        points = eye.position + seen["range"].astype(np.float64) * eye.directions()
        for world in (0, 1):
            there = seen["range"][world, ..., 0] < 10.0
            where = points[world][there]
            height, normal = (array.numpy()[world] for array in rut.soil.surface(where[:, :2]))
            inside = np.isfinite(height)
            assert inside.sum() > 1000
            # hills: a crack between nodes and undeformed ground is at most a crease high
            off = np.abs(where[:, 2] - height)[inside]
            assert np.quantile(off, 0.999) < (MILLIMETRE if hilly else 1e-5)
            axes = matrix_of(eye.pose.rotation)
            facing = (seen["normals"][world][there] @ axes.T * normal).sum(axis=1)[inside]
            assert (facing > 1.0 - 1e-5).mean() > 0.98  # the rest at edges


def test_depth_of_the_rut_is_what_the_wheel_reports():
    rut = Rut()
    rut.roll(1)  # sets the second world apart
    rut.simulation.reset()
    rut.simulation.state.body_v.zero_()
    rut.simulation.step(1500)
    place = rut.simulation.state.body_x.numpy()[0, 0]
    depth = -float(rut.soil.height([place[:2]]).numpy()[0, 0])
    assert depth > 0.03
    # what springs back of mid soil below 200 kPa: 1 mm
    assert depth == pytest.approx(float(rut.soil.sinkage.numpy()[0, 0]), abs=1.1 * MILLIMETRE)
    t, _ = cast(rut, np.array([[*place[:2], 2.0]]), np.array([[0.0, 0.0, -1.0]]))
    assert t[0, 0] == pytest.approx(2.0 + depth, abs=1e-5)


def test_lidar_and_height_query_agree():
    eye = np.array((-0.6, 0.05, 0.35))
    angles = (0.35, -0.35)

    def sensors(rut: Rut) -> list[Lidar]:
        beams = beam_grid(60, 24, azimuth=angles, elevation=(-0.1, -0.8))
        config = LidarConfig(schedule=Schedule(rate=1000.0), beams=beams, far=50.0)
        return [Lidar(rut.scene, Mount(sw.WORLD, sw.pose(eye)), config)]

    rut = Rut(sensors=sensors).roll()
    lidar = rut.simulation.sensors[0]
    assert isinstance(lidar, Lidar)
    points = lidar.points.numpy()[..., :3].astype(np.float64).reshape(2, -1, 3) + eye
    there = lidar.points.numpy()[..., 3].reshape(2, -1) > 0.0
    height = rut.soil.height(points[..., :2]).numpy()
    assert np.abs(points[..., 2] - height)[there].max() < 1e-5
    assert there.all()
    assert points[0, :, 2].min() < -0.05
    assert np.abs(points[1, :, 2]).max() < 1e-5  # nobody was in the second world


@pytest.mark.parametrize("hilly", [False, True])
def test_pictures_change_at_the_rut_alone(hilly):
    rut, bare = Rut(hilly=hilly), Rut(hilly=hilly, covered=False)
    eye = Eye(rut)
    fresh, without = eye.look(), Eye(bare).look()
    for name, picture in fresh.items():
        assert np.array_equal(picture, without[name]), name
    rut.roll()
    after = eye.look()
    points = eye.position + fresh["range"][0].astype(np.float64) * eye.directions()
    cells = np.array(sorted(touched_cells(touched_nodes(dict(rut.soil.memory), 0)))) * SPACING
    low, high = cells.min(axis=0) - 1e-6, cells.max(axis=0) + SPACING + 1e-6
    beside = ((points[..., :2] < low) | (points[..., :2] > high)).any(axis=-1)
    changed = (after["rgb"] != fresh["rgb"]).any(axis=-1)[0]
    assert 0.1 < beside.mean() < 0.95
    for name, picture in after.items():
        assert np.array_equal(picture[0][beside], fresh[name][0][beside]), name
        assert np.array_equal(picture[1], fresh[name][1]), name  # the second world has no rut
    assert changed[~beside].mean() > 0.9
    # pressed soil is darker all in all, and still the ground
    assert after["rgb"][0][~beside].mean() < 0.9 * fresh["rgb"][0][~beside].mean()
    for name in ("instance", "semantic"):
        assert np.array_equal(after[name], fresh[name])
    rut.simulation.reset(np.array([True, False]))
    for name, picture in eye.look().items():
        assert np.array_equal(picture, fresh[name]), name


def test_forgotten_pages_are_level_again():
    rut = Rut(pages=8)  # two rows of four: 1.6 m
    eye = Eye(rut, (0.0, -0.4, 1.5))
    fresh = eye.look()
    way = np.stack([np.linspace(-0.1, 0.5, 13), np.zeros(13)], axis=1)
    rut.roll(300, speed=3.0)
    assert rut.soil.height(way).numpy()[0].min() < -0.05
    rut.simulation.step(1000)
    assert rut.soil.recycled.numpy()[0] > 0
    assert not rut.soil.height(way).numpy().any()
    last = rut.simulation.state.body_x.numpy()[0, 0]
    assert rut.soil.height([last[:2]]).numpy()[0, 0] < -0.05
    after = eye.look()
    points = eye.position + fresh["range"][0].astype(np.float64) * eye.directions()
    left = points[..., 0] < 0.5
    assert left.mean() > 0.1
    assert np.array_equal(after["rgb"][0][left], fresh["rgb"][0][left])


def test_a_snapshot_brings_the_rut_back():
    rut = Rut()
    eye = Eye(rut)
    rut.roll(300)
    there, kept = eye.look(), rut.simulation.snapshot()
    rut.simulation.reset()
    assert not np.array_equal(eye.look()["rgb"], there["rgb"])
    rut.simulation.restore(kept)
    assert np.array_equal(eye.look()["rgb"], there["rgb"])


def test_heights_take_points_of_several_forms():
    rut = rutted(False)
    points = np.stack([np.linspace(-0.2, 1.0, 7), np.linspace(-0.1, 0.1, 7)], axis=1)
    shared = rut.soil.height(points).numpy()
    own = rut.soil.height(np.stack([points, points])).numpy()
    on_device = rut.soil.height(wp.array(points[None], dtype=wp.vec2d, ndim=2, device="cpu")).numpy()
    assert shared.shape == (2, 7)
    assert np.array_equal(shared, own)
    assert np.array_equal(shared, on_device)
    assert shared[0].min() < -0.05
    assert not shared[1].any()
    assert np.isnan(rutted(True).soil.height([(50.0, 0.0)]).numpy()).all()
    with pytest.raises(ModelError, match=r"points must be \(N, 2\), \(2, N, 2\), or vec2d .* got \(3,\)"):
        rut.soil.height((1.0, 2.0, 3.0))


def test_soil_may_come_after_the_simulation():
    def sensors(rut: Rut) -> list[Lidar]:
        config = LidarConfig(schedule=Schedule(rate=1000.0), beams=beam_grid(20, 8, elevation=(-0.1, -0.8)))
        return [Lidar(rut.scene, Mount(sw.WORLD, sw.pose((0.5, 0.0, 0.35))), config)]

    early, late = Rut(sensors=sensors), Rut(sensors=sensors, covered=False)
    late.scene.cover_with(late.soil)
    points = [rut.roll().simulation.sensors[0].data.numpy() for rut in (early, late)]
    assert np.array_equal(*points)
    assert points[0][0, ..., 2].min() < -0.4


def test_mistakes_are_told():
    builder = sw.ModelBuilder()
    body = builder.add_body("wheel", mass=1.0, inertia=(1.0, 1.0, 1.0))
    visuals = Visuals(builder)
    model = builder.finalize(1, "cpu")
    soil = Soil(model, [SoilWheel(body=body, radius=RADIUS, width=WIDTH)])
    with pytest.raises(ModelError, match="which plane on WORLD is the soil's ground, got none"):
        visuals.finalize(model).cover_with(soil)
    visuals.add_plane(name="floor")
    visuals.add_plane(name="table", pose=sw.pose((0.0, 0.0, 1.0)))
    visuals.add_box(sw.WORLD, half=(1.0, 1.0, 1.0), name="crate")
    scene = visuals.finalize(model)
    with pytest.raises(ModelError, match=r"got floor, table; .* name one with ground="):
        scene.cover_with(soil)
    with pytest.raises(ModelError, match="must be a plane on WORLD, got crate"):
        scene.cover_with(soil, "crate")
    other = builder.finalize(1, "cpu")
    with pytest.raises(ModelError, match="must get a soil of the scene's model"):
        visuals.finalize(other).cover_with(soil)
    scene.cover_with(soil, "floor")
    with pytest.raises(ModelError, match="takes one soil, got a second"):
        scene.cover_with(soil, "floor")
