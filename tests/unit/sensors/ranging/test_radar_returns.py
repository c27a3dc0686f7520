"""Radar: range, angles, amplitude and range rate of what moves; noise; clusters against a slow reference; mistakes."""

import math
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.kernels.core.world_range import WorldRange
from simwarp.sensors import Mount, Schedule
from simwarp.sensors.clock_kernels import SampleEvents
from simwarp.sensors.ranging.beams import BeamTable, beam_grid
from simwarp.sensors.ranging.clusters_kernels import CLUSTER_CHANNELS, ClusterFrames, cluster_returns
from simwarp.sensors.ranging.radar import Clusters, Radar, RadarConfig, RadarNoise, cluster_scratch
from simwarp.sensors.ranging.radar_kernels import CHANNELS
from tests.reference.sensors import radar as reference
from tests.unit.sensors.ray_scenes import carrier

AHEAD = BeamTable(azimuth=(0.0,), elevation=(0.0,))
FAN = beam_grid(9, 5, azimuth=(0.3, -0.3), elevation=(0.15, -0.15))
R, AZIMUTH, ELEVATION, VELOCITY, AMPLITUDE, INSTANCE = range(6)


def radar_of(model, scene, rays, *, mount=None, seed=0, steps=0, per_world=(), schedule=None, **options):
    radar = Radar(
        scene, mount or Mount("carrier"), RadarConfig(schedule=schedule or Schedule(rate=100.0), rays=rays, **options),
        seed=seed, per_world=per_world,
    )  # fmt: skip
    sim = sw.Simulation(model, dt=0.01, sensors=[radar])
    for _ in range(steps):
        sim.step()
    return radar, sim


def target(radius=1.0, body=1, **appearance):
    return lambda visuals, builder: visuals.add_sphere(body, radius=radius, name="target", **appearance)


def test_a_return_tells_where_it_comes_from():
    def fill(visuals, builder):
        visuals.add_sphere(sw.WORLD, radius=1.0, pose=sw.pose((30.0, 3.0, -2.0)), reflectance=0.9)
        visuals.add_sphere(sw.WORLD, radius=2.0, pose=sw.pose((20.0, -5.0, 1.0)), reflectance=0.4)

    model, scene = carrier(fill)
    centres, radii = np.array([[30.0, 3.0, -2.0], [20.0, -5.0, 1.0]]), np.array([1.0, 2.0])
    away = np.linalg.norm(centres, axis=1)
    rays = BeamTable(
        azimuth=np.diag(np.arctan2(centres[:, 1], centres[:, 0])), elevation=np.diag(np.arcsin(centres[:, 2] / away))
    )
    data = radar_of(model, scene, rays)[0].data.numpy()[0, [0, 1], [0, 1]]
    assert data[:, R] == pytest.approx(away - radii, rel=2e-6)
    assert data[:, AZIMUTH] == pytest.approx(np.arctan2(centres[:, 1], centres[:, 0]), abs=1e-6)
    assert data[:, ELEVATION] == pytest.approx(np.arcsin(centres[:, 2] / away), abs=1e-6)
    assert data[:, VELOCITY].tolist() == [0.0, 0.0]
    # both are hit head on
    assert data[:, AMPLITUDE] == pytest.approx([0.9, 0.4], rel=1e-4)
    assert data[:, INSTANCE].tolist() == [0.0, 1.0]
    far = radar_of(model, scene, rays, falloff=4.0)[0].data.numpy()[0, [0, 1], [0, 1], AMPLITUDE]
    assert far == pytest.approx([0.9 / (away[0] - 1.0) ** 4, 0.4 / (away[1] - 2.0) ** 4], rel=1e-4)


def test_nothing_is_zeros_and_no_instance():
    model, scene = carrier(lambda visuals, builder: visuals.add_plane(pose=sw.pose((0.0, 0.0, -1.0))))
    data = radar_of(model, scene, BeamTable(azimuth=(0.0,), elevation=(0.2, -0.2)), far=10.0)[0].data.numpy()[0, :, 0]
    assert data[0].tolist() == [0.0] * 5 + [-1.0]
    assert data[1, R] == pytest.approx(1.0 / math.sin(0.2))


def test_what_stands_comes_closer_to_what_drives():
    wall = sw.pose((50.0, 0.0, 0.0), (0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5)))
    model, scene = carrier(lambda visuals, builder: visuals.add_plane(pose=wall), velocity=(20.0, 0.0, 0.0))
    radar, _ = radar_of(model, scene, FAN, steps=3)
    d = FAN.directions()
    assert radar.data.numpy()[0, ..., VELOCITY] == pytest.approx(-20.0 * d[..., 0], rel=1e-6)
    assert radar.data.numpy()[0, ..., R] == pytest.approx((50.0 - 0.6) / d[..., 0], rel=2e-6)


@pytest.mark.parametrize(
    ("own", "other", "rate"), [(20.0, 20.0, 0.0), (20.0, 35.0, 15.0), (20.0, -10.0, -30.0), (0.0, 5.0, 5.0)]
)
def test_the_range_rate_of_a_car_ahead(own, other, rate):
    model, scene = carrier(
        target(), velocity=(own, 0.0, 0.0), bodies={"car": ((25.0, 0.0, 0.0), (other, 0.0, 0.0), (0.0, 0.0, 0.0))}
    )
    radar, _ = radar_of(model, scene, AHEAD, steps=4)
    found = radar.data.numpy()[0, 0, 0]
    assert found[VELOCITY] == pytest.approx(rate, abs=1e-5)
    assert found[R] == pytest.approx(24.0 + 0.04 * (other - own), rel=2e-6)


def test_the_range_rate_is_that_of_the_surface_and_of_the_mount():
    # a turning plate off the axis of a turning carrier: every term of the formula counts
    def fill(visuals, builder):
        visuals.add_box(1, half=(0.2, 8.0, 8.0))

    omega, v = np.array([0.3, -0.2, 0.7]), np.array([3.0, -1.0, 0.5])
    spin, u = np.array([0.4, 0.9, -0.6]), np.array([-2.0, 4.0, 1.0])
    offset = np.array([1.0, 0.6, -0.3])
    model, scene = carrier(
        fill, velocity=v, omega=omega, bodies={"plate": ((12.0, 1.0, -1.0), u, spin)}
    )  # fmt: skip
    mount = Mount("carrier", sw.pose(offset, (0.0, 0.0, 0.1, 1.0)))
    found = radar_of(model, scene, FAN, mount=mount)[0].data.numpy()[0].reshape(-1, 6)
    assert (found[:, AMPLITUDE] > 0.0).all()
    angle = 2.0 * math.atan(0.1)
    turn = np.array(
        [[math.cos(angle), -math.sin(angle), 0.0], [math.sin(angle), math.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )
    points = offset + reference.positions(found.astype(float)) @ turn.T
    for point, one in zip(points, found, strict=True):
        wanted = reference.range_rate(
            point, u + np.cross(spin, point - [12.0, 1.0, -1.0]), offset, v + np.cross(omega, offset)
        )
        assert one[VELOCITY] == pytest.approx(wanted, abs=2e-5)


def test_a_sweeping_radar_measures_columns_in_their_turn():
    wall = sw.pose((12.0, 0.0, 0.0), (0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5)))
    model, scene = carrier(lambda visuals, builder: visuals.add_plane(pose=wall), velocity=(8.0, 0.0, 0.0))
    rays = beam_grid(8, 1, azimuth=(0.3, -0.3), elevation=(0.0, 0.0))
    radar, _ = radar_of(model, scene, rays, steps=8, schedule=Schedule(rate=10.0, window=0.08))
    wanted = (12.0 - 8.0 * 0.01 * np.arange(8)) / np.cos(rays.angles()[0][0])
    assert radar.data.numpy()[0, 0, :, R] == pytest.approx(wanted, rel=2e-6)


def test_noise_has_its_moments():
    noise = RadarNoise(range=0.2, azimuth=0.01, elevation=0.02, velocity=0.3, amplitude=0.01, dropout=0.1)
    model, scene = carrier(lambda visuals, builder: visuals.add_sphere(sw.WORLD, radius=9.0, reflectance=0.5))
    rays = beam_grid(80, 50, azimuth=(1.0, -1.0), elevation=(0.7, -0.7))
    data = radar_of(model, scene, rays, noise=noise)[0].data.numpy()[0].reshape(-1, 6).astype(float)
    seen = data[:, AMPLITUDE] > 0.0
    count = len(data)
    assert abs(count - seen.sum() - 0.1 * count) < 4.0 * math.sqrt(count * 0.09)
    truth = np.stack([np.full(count, 9.0), *(a.ravel() for a in rays.angles()), np.zeros(count), np.full(count, 0.5)])
    errors = (data[seen, :5] - truth.T[seen]) / [0.2, 0.01, 0.02, 0.3, 0.01]
    n = seen.sum()
    assert np.abs(errors.mean(axis=0)).max() < 4.0 / math.sqrt(n)
    assert np.abs(errors.var(axis=0) - 1.0).max() < 4.0 * math.sqrt(2.0 / n)
    mixed = errors.T @ errors / n - np.diag((errors**2).mean(axis=0))
    assert np.abs(mixed).max() < 4.0 / math.sqrt(n)


def test_worlds_have_their_own_noise_backscatter_and_targets():
    where = (15.0, 0.0, 0.0)
    model, scene = carrier(target(), worlds=3, bodies={"car": (where, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))})
    radar, sim = radar_of(model, scene, AHEAD, per_world=("dropout", "backscatter"))
    assert radar.data.numpy()[:, 0, 0, AMPLITUDE] == pytest.approx([0.5] * 3)
    radar.backscatter[1:2] = 0.1
    radar.noise["dropout"][2:3] = 1.0
    body_x = sim.state.body_x.numpy()
    body_x[0, 1] = (18.0, 0.0, 0.0)
    sim.state.body_x.assign(body_x)
    sim.step()
    data = radar.data.numpy()[:, 0, 0]
    assert data[:, R] == pytest.approx([17.0, 14.0, 0.0], rel=1e-6)
    assert data[:, AMPLITUDE] == pytest.approx([0.5, 0.1, 0.0])
    assert data[:, INSTANCE].tolist() == [0.0, 0.0, -1.0]


# ---- clusters --------------------------------------------------------------------------------------------------------


def gather(returns, distance, least=1, capacity=64):
    """The kernel on returns (W, N, 6): (W, capacity, 6), counts, overflows."""
    worlds, rays, _ = returns.shape
    frames: Any = ClusterFrames()
    tick: Any = SampleEvents()
    frames.cluster = wp.zeros((worlds, capacity * CLUSTER_CHANNELS), dtype=float, device="cpu")
    frames.count = wp.zeros(worlds, dtype=int, device="cpu")
    frames.overflow = wp.zeros(worlds, dtype=int, device="cpu")
    tick.complete = wp.full(worlds, 1, dtype=int, device="cpu")
    tick.row = wp.array(np.arange(worlds), dtype=int, device="cpu")
    scratch = cluster_scratch(worlds, rays, "cpu")
    flat: Any = wp.array(returns.reshape(worlds, rays * CHANNELS), dtype=float, device="cpu")
    wp.launch(
        cluster_returns, dim=worlds, device="cpu", outputs=[frames],
        inputs=[WorldRange(), distance, least, capacity, flat, scratch, tick],
    )  # fmt: skip
    found = frames.cluster.numpy().reshape(worlds, capacity, CLUSTER_CHANNELS)
    return found, frames.count.numpy(), frames.overflow.numpy()


def random_returns(rng, rays, spots, spread, dim):
    """Returns about some spots of a road, a third of them missing."""
    centres = rng.uniform((5.0, -30.0, -2.0), (60.0, 30.0, 4.0), (spots, 3))
    points = centres[rng.integers(0, spots, rays)] + spread * rng.normal(size=(rays, 3)) * (np.arange(3) < dim)
    r = np.linalg.norm(points, axis=1)
    returns = np.zeros((rays, 6))
    returns[:, R] = r
    returns[:, AZIMUTH], returns[:, ELEVATION] = np.arctan2(points[:, 1], points[:, 0]), np.arcsin(points[:, 2] / r)
    returns[:, VELOCITY] = rng.normal(size=rays)
    returns[:, AMPLITUDE] = rng.uniform(0.1, 1.0, rays)
    returns[rng.uniform(size=rays) < 0.33] = (0.0, 0.0, 0.0, 0.0, 0.0, -1.0)
    return returns.astype(np.float32)


def off_the_border(returns, distance):
    """The returns without one of each two that are exactly as far apart as neighbours may be, to float32."""
    points = reference.positions(returns.astype(float))
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2)
    doubtful = np.argwhere(np.abs(gaps - distance) < 2e-5)
    returns[doubtful.max(axis=1, initial=-1)[doubtful[:, 0] != doubtful[:, 1]]] = (0.0, 0.0, 0.0, 0.0, 0.0, -1.0)
    return returns


@pytest.mark.parametrize("distance", [0.4, 1.0, 2.5])
@pytest.mark.parametrize("least", [1, 3])
def test_clusters_agree_with_their_reference(distance, least):
    rng = np.random.default_rng(11)
    # tight groups, long loose chains on a sheet, and dust
    kinds = [(9, 0.15, 3), (25, 0.5, 3), (4, 3.0, 2), (150, 0.01, 3), (1, 0.6, 3)]
    returns = np.stack([off_the_border(random_returns(rng, 300, *kind), distance) for kind in kinds])
    found, count, overflow = gather(returns, distance, least, capacity=200)
    assert overflow.tolist() == [0] * len(kinds)
    sizes = []
    for world, returned in enumerate(returns):
        wanted = reference.clusters(returned, distance, least)
        assert count[world] == len(wanted), world
        # float32: positions of 60 m to 1e-5
        assert found[world, : len(wanted)] == pytest.approx(wanted, rel=1e-5, abs=2e-5)
        assert not found[world, len(wanted) :].any()
        sizes.append(len(wanted))
    assert max(sizes) > 20
    assert min(sizes) >= 1


def test_all_of_one_place_and_none_at_all():
    returns = np.zeros((3, 200, 6), np.float32)
    returns[0, :] = (10.0, 0.1, 0.0, -3.0, 0.5, 2.0)
    returns[2, 77] = (4.0, 0.0, 0.0, 1.0, 0.25, 2.0)
    found, count, _ = gather(returns, 1.0)
    assert count.tolist() == [1, 0, 1]
    assert found[0, 0] == pytest.approx([10.0 * math.cos(0.1), 10.0 * math.sin(0.1), 0.0, -3.0, 100.0, 200.0], rel=1e-5)
    assert found[2, 0] == pytest.approx([4.0, 0.0, 0.0, 1.0, 0.25, 1.0])


def test_neighbours_across_every_face_of_their_cells():
    # pairs a little nearer and a little farther than the distance, in random directions from random places
    rng = np.random.default_rng(5)
    for gap, together in ((0.999, True), (1.001, False)):
        returns = np.zeros((400, 2, 6), np.float32)
        for world in range(400):
            way = rng.normal(size=3)
            first = np.array([20.0, 0.0, 0.0]) + rng.uniform(-3.0, 3.0, 3)
            for k, p in enumerate((first, first + gap * way / np.linalg.norm(way))):
                r = np.linalg.norm(p)
                returns[world, k] = (r, math.atan2(p[1], p[0]), math.asin(p[2] / r), 0.0, 1.0, 0.0)
        assert (gather(returns, 1.0)[1] == (1 if together else 2)).all()


def test_clusters_beyond_the_capacity_are_counted():
    returns = np.zeros((2, 30, 6), np.float32)
    returns[..., AMPLITUDE] = 1.0
    returns[0, :, R] = 3.0 * np.arange(1, 31)
    returns[1, :, R] = 3.0
    found, count, overflow = gather(returns, 1.0, capacity=8)
    assert count.tolist() == [8, 1]
    assert overflow.tolist() == [22, 0]
    assert found[0, :, 0] == pytest.approx(3.0 * np.arange(1, 9))
    assert found[1, 1:].sum() == 0.0


def test_a_radar_gathers_its_cars():
    def fill(visuals, builder):
        for body in (1, 2):
            visuals.add_box(body, half=(2.0, 0.9, 0.7))

    cars = {
        "ahead": ((20.0, 3.0, 0.0), (25.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        "oncoming": ((30.0, -4.0, 0.0), (-20.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    }
    model, scene = carrier(fill, velocity=(22.0, 0.0, 0.0), bodies=cars, worlds=2)
    rays = beam_grid(180, 6, azimuth=(0.35, -0.35), elevation=(0.06, -0.06))
    radar, sim = radar_of(model, scene, rays, clusters=Clusters(distance=2.5, capacity=4))
    sim.step()
    assert radar.cluster_count.numpy().tolist() == [2, 2]
    assert radar.cluster_overflow.numpy().tolist() == [0, 0]
    returns, clusters = radar.data.numpy()[1].reshape(-1, 6), radar.clusters.numpy()[1]
    wanted = reference.clusters(returns, 2.5)
    assert clusters[:2] == pytest.approx(wanted, rel=1e-5, abs=1e-5)
    assert not clusters[2:].any()
    # the car ahead, to the left, runs away; the other one comes; cos of the angle off the axis is above 0.98
    assert clusters[0, 3] == pytest.approx(3.0, rel=0.02)
    assert clusters[1, 3] == pytest.approx(-42.0, rel=0.02)
    assert clusters[0, 1] == pytest.approx(3.0, abs=0.9)
    assert clusters[1, 1] == pytest.approx(-4.0, abs=0.9)
    assert np.array_equal(radar.clusters.numpy()[0], radar.clusters.numpy()[1])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RadarNoise(velocity=-1.0), r"RadarNoise: velocity must be zero or positive, got -1\.0"),
        (lambda: RadarNoise(dropout=2.0), r"RadarNoise: dropout must be in \[0, 1\], got 2\.0"),
        (
            lambda: Clusters(distance=0.0),
            r"Clusters: distance must be positive, got 0\.0; give the largest gap within a cluster \[m\]",
        ),
        (lambda: Clusters(capacity=0), "Clusters: capacity must be at least 1, got 0"),
        (lambda: config(schedule=1.0), "RadarConfig: schedule must be a Schedule, got 1.0"),
        (lambda: config(falloff=-2.0), r"falloff must be zero or positive, got -2\.0; give 4 for the radar equation"),
        (lambda: config(near=-1.0), r"near must be zero or positive, got -1\.0"),
        (lambda: config(clusters=5), "clusters must be a Clusters, got 5"),
        (lambda: on("missing"), "sensor 'radar': .*missing"),
        (lambda: on("carrier").clusters, "there are no clusters"),
    ],
)
def test_mistakes_are_named(make, message):
    with pytest.raises(ModelError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


def config(**options):
    return RadarConfig(**{"schedule": Schedule(rate=1.0), "rays": AHEAD, **options})


def on(body):
    _, scene = carrier(target(body=0))
    return Radar(scene, Mount(body), config())
