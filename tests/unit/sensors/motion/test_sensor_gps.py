"""Receivers against a geodesy library, magnetometers against spherical trigonometry."""

import math

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.motion.gps import GeoOrigin, Gps, GpsConfig, to_local
from simwarp.sensors.motion.magnetometer import Magnetometer, MagnetometerConfig
from simwarp.sensors.noise import NormalNoise, Quantisation
from tests.reference.sensors.geomagnetism import dipole
from tests.unit.sensors.sensor_probe import ball

ORIGINS = [
    GeoOrigin(), GeoOrigin(latitude=0.0, longitude=0.0, altitude=0.0), GeoOrigin(latitude=-33.9, longitude=151.2),
    GeoOrigin(latitude=78.2, longitude=-179.99, altitude=1200.0), GeoOrigin(latitude=89.99, longitude=30.0),
    GeoOrigin(latitude=48.1, longitude=11.6, altitude=519.0, heading=2.0),
]  # fmt: skip


def fixed(points: np.ndarray, sensor: type, config, **options):
    """A sensor that is at another point of space in every world."""
    model = ball(len(points))
    found = sensor(model, Mount(sw.WORLD), config, randomised=True, **options)
    sim = sw.Simulation(model, 0.01, sensors=[found])
    found.mount.position.assign(np.asarray(points, np.float64))
    sim.reset()
    return sim, found


def library(origin: GeoOrigin, enu: np.ndarray) -> np.ndarray:
    """(n, 3) latitude, longitude [deg], height [m] by PROJ."""
    pyproj = pytest.importorskip("pyproj")
    pipeline = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +ellps=WGS84 "
        f"+step +inv +proj=topocentric +lat_0={origin.latitude!r} +lon_0={origin.longitude!r} +h_0={origin.altitude!r} "
        "+step +inv +proj=cart +step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    longitude, latitude, height = pipeline.transform(*enu.T)
    return np.stack([latitude, longitude, height], axis=1)


def metres_apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distances of places [deg, deg, m] near each other [m]: exact on the ellipsoid, by the library."""
    pyproj = pytest.importorskip("pyproj")
    _, _, along = pyproj.Geod(ellps="WGS84").inv(a[:, 1], a[:, 0], b[:, 1], b[:, 0])
    return np.hypot(along, a[:, 2] - b[:, 2])


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("reach", [1.0e3, 1.0e4, 1.0e6])
def test_places_are_those_of_a_geodesy_library(origin, reach):
    rng = np.random.default_rng(7)
    points = rng.uniform(-1.0, 1.0, (200, 3)) * [reach, reach, 500.0]
    _, gps = fixed(points, Gps, GpsConfig(origin=origin))
    c, s = math.cos(origin.heading), math.sin(origin.heading)
    expected = library(origin, points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    assert gps.data.dtype is wp.float64
    # 64 bits of a radius of 6e6 m: 1e-9 m. The library makes one pass of Bowring's iteration only, which is off by
    # 2e-4 m at the 80 km of height that the tangent plane has after 1000 km; the way back below needs none
    assert metres_apart(gps.data.numpy(), expected).max() < (1e-6 if reach <= 1.0e4 else 5e-4)
    assert np.array_equal(gps.data.numpy(), gps.truth.numpy())
    back = to_local(origin, *gps.data.numpy().T)
    assert np.abs(back - points).max() < 1e-7


def test_the_plane_rises_above_the_ellipsoid():
    _, gps = fixed(np.array([[0.0, 0.0, 0.0], [1000.0, 0.0, 0.0]]), Gps, GpsConfig())
    altitude = gps.data.numpy()[:, 2]
    assert altitude[0] == pytest.approx(260.0, abs=1e-6)
    assert altitude[1] - altitude[0] == pytest.approx(1.0e6 / (2.0 * 6.38e6), rel=0.01)


def test_the_spherical_earth_divides_metres_by_a_radius():
    origin = GeoOrigin(latitude=43.07, longitude=-89.4, altitude=260.0)
    _, gps = fixed(np.array([[300.0, 400.0, 5.0]]), Gps, GpsConfig(origin=origin, earth="sphere"))
    latitude = 43.07 + math.degrees(400.0 / 6371000.0)
    longitude = -89.4 + math.degrees(300.0 / (6371000.0 * math.cos(math.radians(latitude))))
    assert gps.data.numpy()[0] == pytest.approx([latitude, longitude, 265.0], abs=1e-11)


def test_longitudes_stay_within_half_a_turn():
    origin = GeoOrigin(latitude=10.0, longitude=179.9999)
    _, gps = fixed(np.array([[-100.0, 0.0, 0.0], [100.0, 0.0, 0.0]]), Gps, GpsConfig(origin=origin))
    west, east = gps.data.numpy()[:, 1]
    assert 179.99 < west < 180.0
    assert -180.0 < east < -179.99


@pytest.mark.parametrize("heading", [0.0, 0.7])
def test_velocity_is_that_of_the_place(heading):
    origin = GeoOrigin(latitude=48.1, longitude=11.6, altitude=519.0, heading=heading)
    velocity, omega, arm = np.array([20.0, -7.0, 3.0]), np.array([0.0, 0.3, 0.5]), np.array([1.0, 2.0, 0.5])
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_body(
        "plane", mass=1.0, inertia=(1.0, 1.0, 1.0), velocity=velocity, omega=omega, pose=sw.pose((3.0e4, -4.0e4, 100.0))
    )
    gps = Gps(model := builder.finalize(1, "cpu"), Mount("plane", sw.pose(arm)), GpsConfig(origin=origin))
    sim = sw.Simulation(model, 0.01, sensors=[gps])
    found = gps.velocity.numpy()[0]
    # one second on, along a straight line: east, north and up from the change of the place
    v = velocity + np.cross(omega, arm)
    c, s = math.cos(heading), math.sin(heading)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    p = sim.state.body_x.numpy()[0] + arm
    places = library(origin, np.concatenate([p - v * 0.5, p + v * 0.5]) @ turn)
    change = places[1] - places[0]
    middle = math.radians(places[:, 0].mean())
    e2 = 0.00669437999014
    w = 1.0 - e2 * math.sin(middle) ** 2
    expected = [
        math.radians(change[1]) * (6378137.0 / math.sqrt(w) + 600.0) * math.cos(middle),
        math.radians(change[0]) * (6378137.0 * (1.0 - e2) / w**1.5 + 600.0), change[2],
    ]  # fmt: skip
    # the radii at 600 m for places at 600 to 815 m (4e-5 of 20 m/s); float32
    assert found == pytest.approx(expected, abs=1.5e-3)
    # 50 km away, up is another direction: by 8 mrad, 0.17 m/s of 21
    assert abs(found[2] - v[2]) > 0.05


def test_noise_acts_in_metres():
    n = 2000
    noise = (NormalNoise(std=(2.0, 3.0, 1.0), mean=(1.0, -1.0, 0.5)),)
    config = GpsConfig(noise=noise, velocity_noise=(Quantisation(step=0.1),))
    points = np.tile([500.0, -300.0, 20.0], (n, 1))
    _, gps = fixed(points, Gps, config, seed=3)
    off = gps.position.numpy() - points
    # five standard errors; positions in float32 of 500 m: 3e-5 m
    assert off.mean(axis=0) == pytest.approx([1.0, -1.0, 0.5], abs=5.0 * 3.0 / math.sqrt(n))
    assert off.std(axis=0) == pytest.approx([2.0, 3.0, 1.0], rel=5.0 / math.sqrt(2 * n))
    reported = to_local(config.origin, *gps.data.numpy().T)
    assert np.abs(reported - gps.position.numpy()).max() < 1e-4
    assert metres_apart(gps.truth.numpy(), library(config.origin, points)).max() < 1e-6


@pytest.mark.parametrize("heading", [0.0, 0.7])
def test_noise_acts_along_the_axes_of_the_place(heading):
    """400 km to the east, up is 3.6 degrees off: noise upwards alone may not move the receiver along the ground."""
    origin = GeoOrigin(latitude=48.1, longitude=11.6, altitude=519.0, heading=heading)
    config = GpsConfig(origin=origin, noise=(NormalNoise(std=0.0, mean=(0.0, 0.0, 100.0)),))
    points = np.array([[0.0, 0.0, 0.0], [4.0e5, 1.0e5, 30.0]])
    _, gps = fixed(points, Gps, config)
    change = gps.data.numpy() - gps.truth.numpy()
    # degrees to 1e-12: a tenth of a micrometre; along the origin's up it would be 6 m, 6e-5 degrees
    assert np.abs(change[:, :2]).max() < 1e-11
    assert change[:, 2] == pytest.approx([100.0, 100.0], abs=1e-6)
    assert np.linalg.norm(gps.position.numpy() - points, axis=1) == pytest.approx([100.0, 100.0], abs=0.05)


def test_a_frame_is_the_latest_sample_of_its_window_and_late():
    model = ball(1, gravity=(0.0, 0.0, 0.0))
    gps = Gps(model, Mount("ball"), GpsConfig(schedule=Schedule(rate=10.0, window=0.05, lag=0.1)))
    sim = sw.Simulation(model, 0.01, sensors=[gps])
    sim.state.body_v.assign(np.full((1, 1, 3), [10.0, 0.0, 0.0], np.float32))
    for step in range(1, 41):
        sim.step()
        done = (step - 15) // 10 * 10 + 5
        x = 0.1 * done if step >= 15 else 0.0
        assert gps.position.numpy()[0, 0] == pytest.approx(x, abs=1e-5)
        assert gps.timestamp.numpy()[0] == pytest.approx(0.01 * done if step >= 15 else 0.0, abs=1e-6)


@pytest.mark.parametrize("origin", ORIGINS[:4])
@pytest.mark.parametrize("heading", [0.0, 1.1])
def test_the_magnetic_field_is_that_of_a_dipole(origin, heading):
    origin = GeoOrigin(
        latitude=origin.latitude, longitude=origin.longitude, altitude=origin.altitude, heading=heading
    )  # fmt: skip
    turn = np.array([0.1, -0.5, 0.3, 0.8])
    turn /= np.linalg.norm(turn)
    model = ball(1)
    sensor = Magnetometer(model, Mount("ball", sw.pose((0.0, 0.0, 0.0), turn)), MagnetometerConfig(origin=origin))
    sw.Simulation(model, 0.01, sensors=[sensor])
    world = matrix_of(turn) @ sensor.data.numpy()[0]
    c, s = math.cos(heading), math.sin(heading)
    enu = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ world
    # the reference's place is geocentric: 0.19 deg off the normal at most, and the distance that of the ellipsoid
    phi = math.radians(origin.latitude)
    a, b = 6378137.0, 6356752.314245
    across = a**2 / math.hypot(a * math.cos(phi), b * math.sin(phi))
    r, z = (across + origin.altitude) * math.cos(phi), (across * (b / a) ** 2 + origin.altitude) * math.sin(phi)
    centric = math.atan2(z, r)
    expected = dipole(math.degrees(centric), origin.longitude, (80.65, -72.68), 3.05e-5, 6371200.0 / math.hypot(r, z))
    tilt = phi - centric  # up of the ellipsoid leans south of the radius
    ct, st = math.cos(tilt), math.sin(tilt)
    reference = [expected[0], ct * expected[1] - st * expected[2], st * expected[1] + ct * expected[2]]
    assert enu == pytest.approx(reference, abs=2e-11)  # float32 of 6e-5 T: 4e-12
    assert 2e-5 < np.linalg.norm(world) < 7e-5


def test_the_field_points_north_and_into_the_ground():
    model = ball(1)
    sensor = Magnetometer(model, Mount("ball"), MagnetometerConfig())
    sw.Simulation(model, 0.01, sensors=[sensor])
    east, north, up = sensor.data.numpy()[0]
    assert north > abs(east)
    assert up < -north  # Wisconsin: 70 deg
    assert math.degrees(math.atan2(-up, math.hypot(east, north))) == pytest.approx(70.0, abs=3.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda m: Gps(m, Mount("car")), "sensor 'gps': model has no body 'car'"),
        (lambda m: Magnetometer(m, Mount("car")), "sensor 'magnetometer': model has no body 'car'"),
        (lambda m: GeoOrigin(latitude=91.0), r"GeoOrigin: latitude must be in \[-90, 90\], got 91\.0; give degrees"),
        (lambda m: GeoOrigin(longitude=math.nan), "GeoOrigin: longitude must be a finite number"),
        (lambda m: GpsConfig(earth="flat"), "GpsConfig: earth must be one of 'wgs84', 'sphere', got 'flat'"),  # type: ignore[arg-type]
        (lambda m: MagnetometerConfig(strength=math.inf), "MagnetometerConfig: strength must be .*finite"),
        (lambda m: MagnetometerConfig(strength=-1e-5), "MagnetometerConfig: strength must be zero or positive, got -1"),
        (
            lambda m: MagnetometerConfig(pole_latitude=100.0),
            r"MagnetometerConfig: pole_latitude must be in \[-90, 90\], got 100\.0; give degrees",
        ),
        (
            lambda m: GpsConfig(earth="sphere", origin=GeoOrigin(latitude=-90.0)),
            r"GpsConfig: earth 'sphere' needs an origin whose latitude is within 89 degrees, got -90\.0; use 'wgs84'",
        ),
    ],
)
def test_mistakes_are_one_clear_error(make, message):
    with pytest.raises(sw.ModelError, match=message):
        make(ball(1))
