"""Lidar: noise by its moments, lost beams, worlds of their own, determinism, and mistakes."""

import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.sensors import Mount, Schedule
from simwarp.sensors.presets import load_config
from simwarp.sensors.ranging.beams import Beam, BeamTable, beam_grid
from simwarp.sensors.ranging.lidar import Lidar, LidarConfig, LidarNoise
from tests.unit.sensors.ray_scenes import carrier

RADIUS = 5.0
BEAMS = beam_grid(100, 40, elevation=(0.9, -0.9))
COUNT = 4000


def shell(visuals, builder):
    """A sphere about the sensor: all ranges and intensities are the same."""
    visuals.add_sphere(sw.WORLD, radius=RADIUS, reflectance=0.5)


def lidar_of(noise, *, worlds=1, seed=0, name="lidar", steps=0, per_world=(), fill=shell, **options):
    model, scene = carrier(fill, worlds=worlds)
    config = LidarConfig(schedule=Schedule(rate=100.0), beams=options.pop("beams", BEAMS), noise=noise, **options)
    lidar = Lidar(scene, Mount("carrier"), config, seed=seed, name=name, per_world=per_world)
    sim = sw.Simulation(model, dt=0.01, sensors=[lidar])
    for _ in range(steps):
        sim.step()
    return lidar, sim


def angles_of(points):
    return np.arctan2(points[..., 1], points[..., 0]), np.arcsin(points[..., 2] / np.linalg.norm(points, axis=-1))


def test_noise_has_its_moments():
    noise = LidarNoise(range=0.03, azimuth=0.002, elevation=0.001, intensity=0.02)
    lidar, _ = lidar_of(noise)
    points = lidar.points.numpy()[0].astype(float)
    azimuth, elevation = angles_of(points[..., :3])
    wanted = BEAMS.angles()
    samples = {
        "range": (np.linalg.norm(points[..., :3], axis=-1) - RADIUS, 0.03),
        "azimuth": ((azimuth - wanted[0] + np.pi) % (2 * np.pi) - np.pi, 0.002),
        "elevation": (elevation - wanted[1], 0.001),
        "intensity": (points[..., 3] - 0.5, 0.02),
    }
    for name, (errors, sigma) in samples.items():
        # within four standard deviations of mean and variance; the fourth moment of a normal one is 3, +- sqrt(96 / N)
        z = errors.ravel() / sigma
        assert abs(z.mean()) < 4.0 / math.sqrt(COUNT), name
        assert abs(z.var() - 1.0) < 4.0 * math.sqrt(2.0 / COUNT), name
        assert abs((z**4).mean() - 3.0) < 4.0 * math.sqrt(96.0 / COUNT), name
        # independent from beam to beam, along rows and along columns
        grid = (errors / sigma).reshape(40, 100)
        for a, b in ((grid[:, 1:], grid[:, :-1]), (grid[1:], grid[:-1])):
            assert abs((a * b).mean()) < 4.0 / math.sqrt(a.size), name
    names = list(samples)
    for k, one in enumerate(names):
        for other in names[:k]:
            product = samples[one][0] * samples[other][0] / (samples[one][1] * samples[other][1])
            assert abs(product.mean()) < 4.0 / math.sqrt(COUNT), (one, other)


@pytest.mark.parametrize("share", [0.1, 0.7])
def test_beams_drop_out_at_their_share(share):
    lidar, _ = lidar_of(LidarNoise(dropout=share))
    lost = COUNT - int(lidar.count.numpy()[0])
    assert abs(lost - share * COUNT) < 4.0 * math.sqrt(COUNT * share * (1.0 - share))
    ranges = lidar.ranges.numpy()[0]
    assert set(np.unique(ranges[..., 0].round(3))) == {0.0, RADIUS}
    assert ((ranges[..., 0] == 0.0) == (ranges[..., 1] == 0.0)).all()


def test_the_end_of_dropout():
    assert lidar_of(LidarNoise(dropout=1.0))[0].count.numpy().tolist() == [0]
    assert lidar_of(LidarNoise())[0].count.numpy().tolist() == [COUNT]


def test_faint_returns_are_lost():
    # half of the measured intensities are below the mean
    lidar, _ = lidar_of(LidarNoise(intensity=0.02, threshold=0.5))
    assert abs(int(lidar.count.numpy()[0]) - COUNT / 2) < 4.0 * math.sqrt(COUNT / 4)
    seen = lidar.ranges.numpy()[0, ..., 1]
    assert seen[seen > 0.0].min() >= 0.5
    # without a threshold nothing is lost, however faint
    lidar, _ = lidar_of(LidarNoise(intensity=10.0))
    assert lidar.count.numpy().tolist() == [COUNT]
    assert lidar.ranges.numpy()[..., 1].min() == pytest.approx(1e-6)


def test_both_returns_of_dual_have_noise_of_their_own():
    lidar, _ = lidar_of(LidarNoise(range=0.03, dropout=0.2), mode="dual", beam=Beam(divergence=0.01, radius=2))
    points = lidar.points.numpy()[0].reshape(-1, 8)
    assert ((points[:, 3] > 0.0) == (points[:, 7] > 0.0)).all()
    seen = points[points[:, 3] > 0.0].astype(float)
    one = (np.linalg.norm(seen[:, :3], axis=1) - RADIUS) / 0.03
    two = (np.linalg.norm(seen[:, 4:7], axis=1) - RADIUS) / 0.03
    assert abs((one * two).mean()) < 4.0 / math.sqrt(len(seen))
    assert abs(two.var() - 1.0) < 4.0 * math.sqrt(2.0 / len(seen))


def test_worlds_do_not_depend_on_each_other():
    noise = LidarNoise(range=0.03, azimuth=0.002, intensity=0.02, dropout=0.1)
    beams = beam_grid(12, 4)
    few, _ = lidar_of(noise, worlds=2, steps=3, beams=beams)
    many, _ = lidar_of(noise, worlds=5, steps=3, beams=beams)
    assert np.array_equal(few.points.numpy(), many.points.numpy()[:2])
    assert not np.array_equal(many.points.numpy()[0], many.points.numpy()[1])


def test_randomness_hangs_on_seed_name_frame_and_episode():
    noise = LidarNoise(range=0.03)
    beams = beam_grid(12, 4)
    lidar, sim = lidar_of(noise, beams=beams)
    frames = [lidar.points.numpy().copy()]
    sim.step()
    frames.append(lidar.points.numpy().copy())
    sim.reset()
    frames.append(lidar.points.numpy().copy())
    frames.append(lidar_of(noise, beams=beams, seed=1)[0].points.numpy())
    frames.append(lidar_of(noise, beams=beams, name="other")[0].points.numpy())
    for k, one in enumerate(frames):
        for other in frames[:k]:
            assert not np.array_equal(one, other)
    assert np.array_equal(frames[0], lidar_of(noise, beams=beams)[0].points.numpy())


def test_noise_may_differ_by_world_and_be_written():
    lidar, sim = lidar_of(LidarNoise(range=(0.0, 0.1, 0.0)), worlds=3, per_world=("dropout", "mount"))
    assert lidar.noise["range"].shape == lidar.noise["dropout"].shape == lidar.mount.position.shape == (3,)
    assert lidar.noise["azimuth"].shape == (1,)

    def spread():
        return np.linalg.norm(lidar.points.numpy()[..., :3].astype(float), axis=-1).std(axis=(1, 2))

    assert spread() == pytest.approx([0.0, 0.1, 0.0], rel=0.06, abs=1e-5)
    lidar.noise["range"][0:1] = 0.2
    lidar.noise["dropout"][2:3] = 1.0
    sim.step()
    assert spread()[:2] == pytest.approx([0.2, 0.1], rel=0.06)
    assert lidar.count.numpy().tolist() == [COUNT, COUNT, 0]
    assert lidar_of(LidarNoise(), worlds=3)[0].noise["range"].shape == (1,)


def test_reflectance_and_groups_of_instances():
    def fill(visuals, builder):
        visuals.add_sphere(sw.WORLD, radius=2.0, reflectance=0.9, group=2, name="inner")
        visuals.add_sphere(sw.WORLD, radius=3.0, reflectance=0.2, group=1, name="outer")

    one = BeamTable(azimuth=(0.0,), elevation=(0.0,))
    seen = {groups: lidar_of(LidarNoise(), fill=fill, beams=one, groups=groups)[0].ranges.numpy().ravel()
            for groups in (1, 2, 3, 4)}  # fmt: skip
    assert seen[1] == pytest.approx([3.0, 0.2])
    assert seen[2] == pytest.approx([2.0, 0.9])
    assert seen[3] == pytest.approx([2.0, 0.9])
    assert seen[4].tolist() == [0.0, 0.0]


def test_a_preset_scans_a_room():
    model, scene = carrier(shell)
    lidar = Lidar(scene, Mount("carrier"), load_config("vlp-16"), name="roof")
    sim = sw.Simulation(model, dt=0.005, sensors=[lidar])
    for _ in range(12):
        sim.step()
    assert lidar.timestamp.numpy().tolist() == [pytest.approx(0.05)]
    assert lidar.count.numpy().tolist() == [16 * 900]
    # within 5.5 standard deviations
    assert np.linalg.norm(lidar.points.numpy()[0, ..., :3], axis=-1) == pytest.approx(RADIUS, abs=0.055)


ONE = BeamTable(azimuth=(0.0,), elevation=(0.0,))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Schedule(rate=0.0), r"Schedule: rate must be positive, got 0\.0; give frames per second \[Hz\]"),
        (lambda: LidarNoise(range=-0.1), r"LidarNoise: range must be zero or positive, got -0\.1"),
        (lambda: LidarNoise(dropout=1.5), r"LidarNoise: dropout must be in \[0, 1\], got 1\.5"),
        (lambda: LidarNoise(azimuth=()), r"LidarNoise: azimuth must be a number or a list, got \(\)"),
        (lambda: config(schedule=10.0), "LidarConfig: schedule must be a Schedule, got 10.0"),
        (lambda: config(beams=[0.0]), "LidarConfig: beams must be a BeamTable"),
        (lambda: config(mode="nearest"), "mode must be one of 'strongest', 'first', 'last', 'mean', "),
        (lambda: config(miss="nan"), "miss must be one of 'zero', 'inf', 'far', got 'nan'"),
        (lambda: config(outputs=()), r"outputs must be one or more, got \(\)"),
        (lambda: config(outputs=("points", "points")), "outputs must be different"),
        (lambda: config(near=5.0, far=2.0), r"near must be below far = 2\.0 m, got 5\.0; use 0 for none"),
        (lambda: config(far=0.0), r"far must be positive, got 0\.0; give the largest range \[m\]"),
        (lambda: lidar_of(LidarNoise(range=(0.1, 0.2)), worlds=3), "range must be one number or one for each of 3 "),
        (lambda: on("missing"), "sensor 'lidar': .*missing"),
        (lambda: on("carrier", per_world=("far",)), "lidar 'lidar': per_world names an unknown parameter 'far'; "),
        (lambda: on(7), "sensor 'lidar': body must be WORLD .* got 7"),
        (lambda: lidar_of(LidarNoise(), outputs="points")[0].ranges, "'ranges' is not among its outputs"),
    ],
)  # fmt: skip
def test_mistakes_are_named(make, message):
    with pytest.raises(ModelError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


def config(**options):
    return LidarConfig(**{"schedule": Schedule(rate=1.0), "beams": ONE, **options})


def on(body, **options):
    _, scene = carrier(shell)
    return Lidar(scene, Mount(body), config(), **options)


def test_what_is_no_scene_is_refused():
    model, _ = carrier(shell)
    with pytest.raises(ModelError, match="lidar 'lidar': scene must be a Scene, got"):
        Lidar(model, Mount("carrier"), config())
