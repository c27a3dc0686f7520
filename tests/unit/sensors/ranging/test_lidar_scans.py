"""Lidar scans: ranges, points and intensities against closed forms and a reference; sweeps; misses; noise; mistakes."""

import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.sensors import Mount, Schedule
from simwarp.sensors.ranging.beams import Beam, BeamTable, beam_grid
from simwarp.sensors.ranging.lidar import Lidar, LidarConfig, LidarNoise
from tests.reference.sensors import lidar as reference
from tests.unit.sensors.ray_scenes import carrier

AT_ONCE = Schedule(rate=10.0)
TILT = np.array([0.06, -0.09, 0.3, 0.0])
TILT[3] = math.sqrt(1.0 - TILT @ TILT)
FLOAT32 = 2e-6
"""Relative: some roundings of 6e-8 each in rotation, direction, intersection and norm."""


def frame(model, scene, beams, *, mount=None, schedule=AT_ONCE, seed=0, steps=0, dt=0.01, per_world=(), **options):
    """A lidar that has begun, after some steps."""
    lidar = Lidar(
        scene, mount or Mount("carrier"), LidarConfig(schedule=schedule, beams=beams, **options), seed=seed,
        per_world=per_world,
    )  # fmt: skip
    sim = sw.Simulation(model, dt=dt, sensors=[lidar])
    for _ in range(steps):
        sim.step()
    return lidar


def ground(visuals, builder):
    visuals.add_plane(reflectance=0.8)


def shell(visuals, builder):
    visuals.add_sphere(sw.WORLD, radius=5.0, reflectance=0.5)


def test_the_ground_has_its_closed_form():
    model, scene = carrier(ground, position=(3.0, -2.0, 1.5))
    beams = beam_grid(12, 5, elevation=(0.3, -0.5))
    lidar = frame(model, scene, beams, far=60.0)
    ranges, points = lidar.ranges.numpy()[0], lidar.points.numpy()[0]
    sine = np.sin(beams.angles()[1])
    down = sine < -1.5 / 60.0
    assert ranges[down, 0] == pytest.approx(1.5 / -sine[down], rel=FLOAT32)
    assert ranges[down, 1] == pytest.approx(0.8 * -sine[down], rel=1e-5)
    assert points[down, 2] == pytest.approx(np.full(down.sum(), -1.5), rel=FLOAT32)
    assert points[..., 3] == pytest.approx(ranges[..., 1])
    assert np.linalg.norm(points[..., :3], axis=-1) == pytest.approx(ranges[..., 0], rel=FLOAT32)
    # what looks up or beyond the far end comes back as zeros
    assert not ranges[~down].any()
    assert not points[~down].any()
    assert lidar.count.numpy().tolist() == [down.sum()]
    assert lidar.data is lidar.points


@pytest.mark.parametrize("mode", ["strongest", "first", "last", "mean", "dual"])
def test_a_scene_agrees_with_its_reference(mode):
    def fill(visuals, builder):
        visuals.add_plane(pose=sw.pose((0.0, 0.0, -1.2)), reflectance=0.3)
        visuals.add_sphere(sw.WORLD, radius=1.5, pose=sw.pose((6.0, 1.0, 0.0)), reflectance=0.9)
        visuals.add_sphere(sw.WORLD, radius=2.0, pose=sw.pose((11.0, -1.0, 1.0)), reflectance=0.6)

    model, scene = carrier(fill, position=(0.2, 0.1, 0.0), rotation=TILT)
    mount = Mount("carrier", sw.pose((0.3, -0.2, 0.4), (0.0, 0.1, -0.25, 1.0)))
    beams = beam_grid(24, 8, azimuth=(0.6, -0.6), elevation=(0.35, -0.35))
    beam = Beam(divergence=(0.06, 0.03), radius=2)
    lidar = frame(model, scene, beams, mount=mount, beam=beam, mode=mode)
    turn = matrix_of(TILT)
    start = np.array([0.2, 0.1, 0.0]) + turn @ mount.pose.position
    cast = reference.nearest(
        (reference.plane((0.0, 0.0, -1.2), (0.0, 0.0, 1.0)), 0.3),
        (reference.sphere((6.0, 1.0, 0.0), 1.5), 0.9),
        (reference.sphere((11.0, -1.0, 1.0), 2.0), 0.6),
    )
    axes = turn @ matrix_of(mount.pose.rotation)
    wanted = reference.scan(beams.directions(), beam.offsets(), start, axes, cast, mode)
    found = lidar.ranges.numpy()[0]
    assert (wanted[..., 1] > 0.0).mean() > 0.5
    assert ((found[..., 1::2] > 0.0) == (wanted[..., 1::2] > 0.0)).all()
    # near a silhouette of a sphere the range changes with the square root of the angle: 1e-7 rad is 1e-3 m there, and
    # with the pulse of 0.05 m some per cent of the intensity; elsewhere 1e-5
    error = np.abs(found - wanted)
    assert np.quantile(error, 0.95) < 3e-5
    assert error[..., 0::2].max() < 5e-3
    assert error[..., 1::2].max() < 3e-2


def test_the_inside_of_a_room_has_its_closed_form():
    half = (4.0, 3.0, 1.5)

    def fill(visuals, builder):
        visuals.add_box(sw.WORLD, half=half, reflectance=1.0)

    model, scene = carrier(fill, position=(0.5, 1.0, 0.2))
    beams = beam_grid(16, 7, elevation=(1.2, -1.2))
    found = frame(model, scene, beams, outputs=["ranges"]).data.numpy()[0]
    cast = reference.nearest((reference.room(half), 1.0))
    wanted = reference.scan(beams.directions(), np.zeros((1, 2)), np.array([0.5, 1.0, 0.2]), np.eye(3), cast)
    assert found[..., 0] == pytest.approx(wanted[..., 0], rel=FLOAT32)
    assert found[..., 1] == pytest.approx(wanted[..., 1], rel=1e-5, abs=1e-6)


def test_ten_kilometres_away_nothing_changes():
    def at(shift):
        def fill(visuals, builder):
            visuals.add_sphere(sw.WORLD, radius=1.0, pose=sw.pose((shift + 4.0, 0.3, 0.1)))

        model, scene = carrier(fill, position=(shift, 0.0, 0.0))
        return frame(model, scene, beam_grid(9, 3, azimuth=(0.2, -0.2), elevation=(0.1, -0.1))).ranges.numpy()

    assert at(1.0e4) == pytest.approx(at(0.0), abs=1e-5)
    assert (at(0.0)[..., 1] > 0.0).mean() > 0.7


def test_a_housing_nearer_than_near_hides_nothing():
    def fill(visuals, builder):
        visuals.add_box(builder_body, half=(0.3, 0.3, 0.3), name="housing")
        visuals.add_sphere(sw.WORLD, radius=1.0, pose=sw.pose((5.0, 0.0, 0.0)))
        visuals.add_sphere(sw.WORLD, radius=1.0, pose=sw.pose((-9.0, 0.0, 0.0)))

    builder_body = 0
    model, scene = carrier(fill)
    beams = BeamTable(azimuth=(0.0, math.pi), elevation=(0.0,))
    assert frame(model, scene, beams).ranges.numpy()[0, 0, :, 0] == pytest.approx([0.3, 0.3])
    assert frame(model, scene, beams, near=0.5, far=6.0).ranges.numpy()[0, 0, :, 0] == pytest.approx([4.0, 0.0])


@pytest.mark.parametrize(("miss", "shown"), [("zero", 0.0), ("inf", math.inf), ("far", 20.0)])
def test_misses_are_shown_as_asked(miss, shown):
    model, scene = carrier(ground, position=(0.0, 0.0, 1.0))
    lidar = frame(model, scene, BeamTable(azimuth=(0.0,), elevation=(0.5, -0.5)), miss=miss, far=20.0)
    assert lidar.ranges.numpy()[0, 0, 0].tolist() == [shown, 0.0]
    assert lidar.points.numpy()[0, 0, 0].tolist() == [0.0] * 4
    assert lidar.ranges.numpy()[0, 1, 0, 0] == pytest.approx(1.0 / math.sin(0.5))
    assert lidar.count.numpy().tolist() == [1]


def test_a_beam_over_an_edge_has_returns_from_both_sides_of_it():
    # a square beam of 3 x 3 rays, 0.02 rad wide; an edge at 0.005 rad to the left lets two columns of rays pass
    def fill(visuals, builder):
        visuals.add_box(
            sw.WORLD, half=(0.5, 5.0, 5.0), reflectance=1.0, name="near", pose=sw.pose((10.5, 5.0 + 0.05, 0.0))
        )
        visuals.add_box(sw.WORLD, half=(0.5, 9.0, 9.0), reflectance=0.3, name="far", pose=sw.pose((20.5, 0.0, 0.0)))

    model, scene = carrier(fill)
    beams = BeamTable(azimuth=(0.0,), elevation=(0.0,))
    beam = Beam(divergence=0.02, radius=2, shape="rectangular")
    near, far = (10.0, 3.0 / 9.0), (20.0, 6.0 * 0.3 / 9.0)
    # slant rays are 1 + 0.01² longer: 2 mm at 20 m, which costs 4 % of the pulse, and 1e-4 of |n . d|
    slack = 1e-4 + 0.04
    wanted = {"first": near, "last": far, "strongest": near, "mean": ((3 * 10 + 6 * 20) / 9, near[1] + far[1])}
    for mode, (distance, intensity) in wanted.items():
        found = frame(model, scene, beams, beam=beam, mode=mode).ranges.numpy()[0, 0, 0]
        assert found[0] == pytest.approx(distance, rel=1.1e-4), mode
        assert found[1] == pytest.approx(intensity, rel=slack), mode
    scene.reflectance[:, scene.instance("near")] = 0.2
    dual = frame(model, scene, beams, beam=beam, mode="dual")
    assert dual.ranges.numpy()[0, 0, 0, 0::2] == pytest.approx([20.0, 10.0], rel=1.1e-4)
    assert dual.ranges.numpy()[0, 0, 0, 1::2] == pytest.approx([far[1], 0.2 * near[1]], rel=slack)
    assert dual.points.numpy()[0, 0, 0, [0, 4]] == pytest.approx([20.0, 10.0], rel=1.1e-4)
    assert dual.count.numpy().tolist() == [2]


def test_nothing_to_see():
    model, scene = carrier(lambda visuals, builder: None)
    lidar = frame(model, scene, beam_grid(6, 3), steps=12)
    assert lidar.count.numpy().tolist() == [0]
    assert not lidar.points.numpy().any()


def test_a_frozen_world_does_not_disturb_its_neighbours():
    model, scene = carrier(ground, worlds=3, position=(0.0, 0.0, 1.0))
    lidar = Lidar(scene, Mount("carrier"), LidarConfig(schedule=Schedule(rate=100.0), beams=beam_grid(8, 3)))
    sim = sw.Simulation(model, dt=0.01, sensors=[lidar])
    before = lidar.points.numpy().copy()
    speed = sim.state.body_v.numpy()
    speed[1] = np.nan
    sim.state.body_v.assign(speed)
    for _ in range(3):
        sim.step()
    assert lidar.valid.numpy().tolist() == [True, False, True]
    assert np.array_equal(lidar.points.numpy()[[0, 2]], before[[0, 2]])
    assert np.isfinite(lidar.points.numpy()).all()


# ---- sweeps ----------------------------------------------------------------------------------------------------------

SWEEP = Schedule(rate=10.0, window=0.1)
WALL = 12.0


def wall(visuals, builder):
    visuals.add_plane(pose=sw.pose((WALL, 0.0, 0.0), (0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5))))


def test_a_sweep_of_a_moving_sensor_is_sheared():
    # towards the wall at 8 m/s while 40 columns fire over 0.1 s; steps of 0.01 s take four of them each
    model, scene = carrier(wall, velocity=(8.0, 0.0, 0.0))
    beams = beam_grid(40, 2, azimuth=(0.3, -0.3), elevation=(0.1, -0.1))
    azimuth, elevation = beams.angles()
    slant = np.cos(azimuth) * np.cos(elevation)
    column = np.arange(40)
    swept = frame(model, scene, beams, schedule=SWEEP, steps=10)
    assert swept.timestamp.numpy().tolist() == pytest.approx([0.1])
    wanted = (WALL - 8.0 * 0.1 * column / 40) / slant
    assert swept.ranges.numpy()[0, ..., 0] == pytest.approx(wanted, rel=FLOAT32)
    held = frame(model, scene, beams, schedule=SWEEP, steps=10, sweep=False)
    wanted = (WALL - 8.0 * 0.01 * (column // 4 + 1)) / slant
    assert held.ranges.numpy()[0, ..., 0] == pytest.approx(wanted, rel=FLOAT32)


def test_a_sweep_of_a_turning_sensor_is_sheared():
    model, scene = carrier(wall, omega=(0.0, 0.0, 2.0))
    # off the axis, so that the turn also carries it along
    mount = Mount("carrier", sw.pose((0.5, 0.0, 0.0)))
    beams = beam_grid(30, 1, azimuth=(0.2, -0.2), elevation=(0.0, 0.0))
    lidar = frame(model, scene, beams, mount=mount, schedule=SWEEP, steps=30, dt=1.0 / 300.0)
    turned = 2.0 * 0.1 * np.arange(30) / 30
    wanted = (WALL - 0.5 * np.cos(turned)) / np.cos(beams.angles()[0][0] + turned)
    assert lidar.ranges.numpy()[0, 0, :, 0] == pytest.approx(wanted, rel=FLOAT32)
    # columns that fire within a sub-step: first order, so that (omega dt)²/2 · 0.5 m remain of the place
    lidar = frame(model, scene, beams, mount=mount, schedule=SWEEP, steps=5, dt=0.02)
    assert lidar.ranges.numpy()[0, 0, :, 0] == pytest.approx(wanted, abs=0.5 * (2.0 * 0.02) ** 2 / 2 * 1.1)


def test_the_first_frame_is_of_a_world_at_rest():
    model, scene = carrier(wall, velocity=(8.0, 0.0, 0.0))
    beams = beam_grid(10, 1, azimuth=(0.3, -0.3), elevation=(0.0, 0.0))
    lidar = frame(model, scene, beams, schedule=SWEEP)
    assert lidar.ranges.numpy()[0, 0, :, 0] == pytest.approx(WALL / np.cos(beams.angles()[0][0]), rel=FLOAT32)
    assert lidar.valid.numpy().tolist() == [True]
    assert lidar.timestamp.numpy().tolist() == [0.0]


def test_a_sweep_is_published_as_a_whole_and_after_its_lag():
    model, scene = carrier(wall, velocity=(8.0, 0.0, 0.0), worlds=2)
    beams = BeamTable(azimuth=(0.0,) * 4, elevation=(0.0,))
    config = LidarConfig(schedule=Schedule(rate=10.0, window=0.1, lag=0.03), beams=beams, outputs="ranges")
    lidar = Lidar(scene, Mount("carrier"), config)
    sim = sw.Simulation(model, dt=0.01, sensors=[lidar])
    at_rest = np.full(4, WALL, np.float32)
    first = WALL - 8.0 * np.array([0.0, 0.025, 0.05, 0.075])
    for step in range(1, 25):
        sim.step()
        now = lidar.data.numpy()[1, 0, :, 0]
        wanted = at_rest if step < 13 else first if step < 23 else first - 0.8
        assert now == pytest.approx(wanted, rel=FLOAT32), step
        assert lidar.timestamp.numpy()[1] == pytest.approx(0.0 if step < 13 else 0.1 if step < 23 else 0.2)
    sim.reset(np.array([True, False]))
    assert lidar.data.numpy()[0, 0, :, 0] == pytest.approx(at_rest, rel=FLOAT32)
    assert lidar.data.numpy()[1, 0, :, 0] == pytest.approx(first - 0.8, rel=FLOAT32)
    # the other world was in the middle of a sweep, and goes on with it; this one begins anew
    for _ in range(13):
        sim.step()
    assert lidar.data.numpy()[0, 0, :, 0] == pytest.approx(first, rel=FLOAT32)
    assert lidar.data.numpy()[1, 0, :, 0] == pytest.approx(first - 1.6, rel=FLOAT32)
    assert lidar.timestamp.numpy() == pytest.approx([0.1, 0.3])


def test_a_snapshot_in_the_middle_of_a_sweep_repeats_it():
    model, scene = carrier(wall, velocity=(8.0, 0.0, 0.0))
    beams = beam_grid(40, 2, azimuth=(0.3, -0.3), elevation=(0.1, -0.1))
    noise = LidarNoise(range=0.02, dropout=0.2)
    lidar = Lidar(scene, Mount("carrier"), LidarConfig(schedule=SWEEP, beams=beams, noise=noise))
    sim = sw.Simulation(model, dt=0.01, sensors=[lidar])
    for _ in range(14):
        sim.step()
    kept = sim.snapshot()
    runs = []
    for _ in range(2):
        for _ in range(9):
            sim.step()
        runs.append((lidar.points.numpy().copy(), lidar.count.numpy().copy()))
        sim.restore(kept)
    assert runs[0][0].any()
    assert np.array_equal(runs[0][0], runs[1][0])
    assert np.array_equal(runs[0][1], runs[1][1])


NOISY = {"noise": LidarNoise(range=0.02, azimuth=0.001, dropout=0.1), "beam": Beam(divergence=0.01, radius=2)}


def test_threads_that_share_a_sweep_change_nothing(monkeypatch):
    model, scene = carrier(wall, velocity=(8.0, 0.0, 0.0), worlds=2)
    beams = beam_grid(40, 3, azimuth=(0.3, -0.3), elevation=(0.1, -0.1))
    alone = frame(model, scene, beams, schedule=SWEEP, steps=10, **NOISY).points.numpy().copy()
    monkeypatch.setattr("simwarp.sensors.ranging.lidar.thread_count", lambda *_: 7)
    shared = frame(model, scene, beams, schedule=SWEEP, steps=10, **NOISY)
    assert np.array_equal(shared.points.numpy(), alone)


@pytest.mark.cuda
def test_a_gpu_sees_the_same():
    seen = {}
    for device in ("cpu", "cuda:0"):
        model, scene = carrier(wall, velocity=(8.0, 0.0, 0.0), worlds=2, device=device)
        beams = beam_grid(40, 3, azimuth=(0.3, -0.3), elevation=(0.1, -0.1))
        lidar = frame(model, scene, beams, schedule=SWEEP, steps=10, **NOISY)
        seen[device] = lidar.points.numpy().copy(), lidar.count.numpy().copy()
    assert seen["cuda:0"][0] == pytest.approx(seen["cpu"][0], rel=1e-5, abs=1e-5)
    assert seen["cuda:0"][1].tolist() == seen["cpu"][1].tolist()
