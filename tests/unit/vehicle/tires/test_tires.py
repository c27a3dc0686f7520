"""Tire forces: the kernel against its reference, and the laws that every tire keeps."""

import zlib
from typing import Any

import numpy as np
import pytest
import warp as wp

from simwarp.core.types import ShapeType
from simwarp.geometry.assets import add_ground_assets, height_field, triangle_mesh
from simwarp.kernels.collision.shape import Assets
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.vehicle.tires.parameter_vector_kernels import Common, Lugre, Tmeasy
from simwarp.vehicle.tires.tires import Mount, Tires, ground
from tests.reference.terrain import field_triangles, surface_height
from tests.reference.tires import (
    Coefficients as Pac02Coefficients,
    contact_of,
    lugre_friction,
    pac02_pure,
    pac02_slip,
    pac89_pure,
    plane,
    tire,
)
from tests.unit.vehicle.tires.tire_bench import (
    DT,
    TEMPLATES,
    States,
    bench,
    product,
    properties,
    quaternion,
    row_of,
    run,
    steady,
    values,
)

VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (name, {}) for name in TEMPLATES},
    "tmeasy car": ("tmeasy", {"pattern": "car"}),
    "pacejka2002 weights": ("pacejka2002", {"combined": "weights", "measured_side": "right"}),
    "pacejka2002 all terms": (
        "pacejka2002",
        {
            "tir": properties(
                QSX1=0.01,
                QSX2=1.2,
                QSX3=0.04,
                QSX4=0.1,
                QSX5=0.7,
                QSX7=0.5,
                QSX8=0.3,
                QSX9=0.9,
                QSX10=0.2,
                QSX11=1.1,
                QSY2=0.003,
                QSY3=0.001,
                QSY4=1e-4,
                QSY5=0.2,
                QSY6=0.1,
                QSY7=0.85,
                QSY8=-0.4,
                QBZ10=0.3,
                QEZ3=0.02,
                QFZ1=13.0,
                QFZ2=15.0,
                QFZ3=2.0,
                IP=9e5,
                PPX1=0.4,
                PPX2=-0.2,
                PPX3=0.1,
                PPX4=0.3,
                PPY1=-0.3,
                PPY2=0.5,
                PPY3=0.2,
                PPY4=-0.1,
                QPZ1=0.3,
                QPZ2=0.4,
                QPX1=0.2,
                QPFZ1=0.6,
                PDX3=1.5,
            ),
            "measured_side": "right",
        },
    ),
    "pacejka2002 separate": ("pacejka2002", {"mode": 3, "argument_limit": 1.5608}),
    "pacejka2002 longitudinal": ("pacejka2002", {"mode": 1}),
    "pacejka2002 lateral": ("pacejka2002", {"mode": 2}),
    "pacejka89 mirrored": ("pacejka89", {"measured_side": "right"}),
    **{f"{name} lagged": (name, {"relaxation_length": (0.2, 0.5)}) for name in TEMPLATES if name != "lugre"},
    "pacejka2002 of 5.2": (
        "pacejka2002",
        {
            "tir": properties(
                PROPERTY_FILE_FORMAT="MF-TYRE",
                FITTYP=5.0,
                USE_MODE=14.0,
                TYRESIDE="RIGHT",
                LONGVL=16.7,
                QSY3=0.002,
                QSY4=0.001,
                PDX3=1.5,
                PDY3=-2.9,
                PTX1=2.4,
                PTX2=1.4,
                PTX3=0.57,
                PTY1=2.1,
                PTY2=2.0,
                LSGKP=0.8,
                LSGAL=1.2,
                LMUX=0.9,
                LMUY=0.8,
                LKY=1.1,
                LGAY=3.0,
                FZMIN=6000.0,
                KPUMIN=-0.3,
                KPUMAX=0.4,
                ALPMIN=-0.2,
                ALPMAX=0.3,
                CAMMIN=-0.05,
                CAMMAX=0.1,
            ),
            "combined": None,
            "rolling_resistance": None,
        },
    ),
    "pacejka2002 of both sides": ("pacejka2002", {"tir": properties(TYRESIDE="SYMMETRIC"), "combined": "weights"}),
    "pacejka2002 mirror image": ("pacejka2002", {"tir": properties(USE_MODE=-4.0), "combined": "weights"}),
}
SLOPE = np.array([0.11, -0.07, 1.0])
# float32 of the deflection (1e-7 m of 0.02 m) and of the slip (1e-6 of 0.1) are some 1e-5 of the forces.
TOLERANCE = 1e-4


def random_states(rng, row, worlds, speed):
    """Wheels near the sloping plane in any direction, deflected by up to 8 cm (or not at all), far from the origin."""
    radius = row.values[Common.RADIUS]
    n = SLOPE / np.linalg.norm(SLOPE)
    x, q, v, omega = (np.zeros((worlds, k)) for k in (3, 4, 3, 3))
    for w in range(worlds):
        q[w] = product(quaternion((0, 0, 1), rng.uniform(-3, 3)), quaternion((1, 0, 0), rng.uniform(-0.2, 0.2)))
        q[w] = product(q[w], quaternion((0, 1, 0), rng.uniform(-3, 3)))
        frame = States(x[w : w + 1], q[w : w + 1], v[w : w + 1], omega[w : w + 1]).wheel(0)
        forward = np.cross(frame.axis, n)
        forward /= np.linalg.norm(forward)
        place = rng.uniform(-3000, 3000, size=2)
        ground_x = np.array([*place, -(n[0] * place[0] + n[1] * place[1]) / n[2]])
        x[w] = ground_x + (radius - rng.uniform(-0.01, 0.08)) * (n - (n @ frame.axis) * frame.axis)
        s = speed * rng.uniform(0.0, 1.0) * rng.choice([-1, 1, 1])
        v[w] = s * forward + rng.normal(size=3) * 0.1 * abs(s) + 0.02 * rng.normal(size=3)
        omega[w] = frame.axis * s / radius * (1 + rng.normal() * 0.2) + 0.3 * rng.normal(size=3)
    return States(x, q, v, omega)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("speed", [30.0, 3.0, 0.2])
@pytest.mark.sweep
def test_kernel_agrees_with_reference(variant, speed):
    template, changes = VARIANTS[variant]
    rng = np.random.default_rng(zlib.crc32(f"{variant} {speed}".encode()))
    row = row_of(template, **changes)
    worlds = 60
    states = random_states(rng, row, worlds, speed)
    rotation = wp.quat_between_vectors(wp.vec3(0.0, 0.0, 1.0), wp.vec3(*SLOPE))
    terrain = ground("cpu", rotation=np.array(rotation))
    normal = terrain.rot.numpy()[0][:, 2].astype(float)
    friction = rng.uniform(0.05, 1.2, size=worlds).astype(np.float32)
    tires = bench(row, worlds, terrain=terrain, randomised=True)
    tires.ground_friction[:] = friction
    start = (rng.normal(size=tires.state.shape) * 0.01).astype(np.float32)
    tires.state[:] = start
    tires.apply(DT, states.arrays())
    mirror = -1.0 if row.measured_side == "right" else 1.0
    touching = 0
    for w in range(worlds):
        z = start[w, 0].astype(float)
        expected = tire(
            row.model, states.wheel(w), row.contact, values(row), plane(normal), float(friction[w]), z, DT, mirror
        )  # fmt: skip
        touching += expected.load > 0.0
        # at the verge of contact the force is that of the deflection's rounding: 1e-7 m times 400 kN/m and more
        margin = TOLERANCE * max(expected.load, float(np.linalg.norm(expected.force))) + 0.2
        assert abs(tires.load.numpy()[w, 0] - expected.load) < margin
        assert np.abs(tires.force_w.numpy()[w, 0] - expected.force).max() < margin
        assert np.abs(tires.torque_w.numpy()[w, 0] - expected.torque).max() < margin
        assert np.abs(tires.force.numpy()[w, 0] - expected.force).max() < margin
        assert np.abs(tires.state.numpy()[w, 0] - z).max() < 2e-5 * max(1.0, np.abs(z).max())
    assert 0.6 * worlds < touching < worlds


BUMPS_CELL = 0.4


def bumpy_ground():
    """A height field of gentle random bumps as terrain of tires, its assets, and as the reference's ground."""
    rng = np.random.default_rng(11)
    heights = (0.03 * rng.normal(size=(25, 25))).astype(np.float32)
    size = (24 * BUMPS_CELL, 24 * BUMPS_CELL)
    triangles = field_triangles(heights, size)
    assets = Assets()
    corners = triangles.reshape(-1, 3)
    mesh = triangle_mesh(corners, np.arange(len(corners)).reshape(-1, 3))
    keep = add_ground_assets(assets, [height_field(heights, size)], [mesh], "cpu")
    return assets, keep, lambda x, y: surface_height(triangles, x, y)


@pytest.mark.parametrize("contact", ["single-point", "four-point", "envelope"])
def test_contact_on_bumps_agrees_with_reference(contact):
    rng = np.random.default_rng(5)
    row = row_of("tmeasy", contact=contact)
    assets, keep, under = bumpy_ground()
    worlds = 24
    q = np.stack([product(quaternion((0, 0, 1), a), quaternion((1, 0, 0), 0.1)) for a in rng.uniform(-3, 3, worlds)])
    x = np.concatenate([rng.uniform(-4, 4, size=(worlds, 2)), rng.uniform(0.4, 0.48, size=(worlds, 1))], axis=1)
    states = States(x, q, rng.normal(size=(worlds, 3)) * [8.0, 8.0, 0.2], rng.normal(size=(worlds, 3)))
    found = {}
    for kind in (ShapeType.HEIGHT_FIELD, ShapeType.MESH):
        tires = bench(row, worlds, terrain=ground("cpu", kind=kind))
        tires.apply(DT, states.arrays(), assets)
        found[kind] = tires
    del keep
    field = found[ShapeType.HEIGHT_FIELD]
    touching = 0
    for w in range(worlds):
        expected = contact_of(states.wheel(w), row.contact, values(row), under)
        deflection = 0.0 if expected is None else expected.deflection
        touching += expected is not None
        # float32 of lengths near 0.5 m; the area of the envelope sums 100 of them, and its root steepens small ones
        margin = 2e-6 if contact != "envelope" else 2e-5
        assert abs(field.deflection.numpy()[w, 0] - deflection) < margin
        if expected is not None:
            assert abs(field.camber.numpy()[w, 0] - expected.camber) < 1e-5
    assert touching > worlds // 2
    # the mesh has the same triangles, found by rays in float32: a few 1e-7 m, times 400 kN/m and the law of slip
    difference = np.abs(field.force_w.numpy() - found[ShapeType.MESH].force_w.numpy()).max()
    assert difference < 1e-4 * field.load.numpy().max()


@pytest.mark.parametrize("contact", ["four-point", "envelope"])
def test_flat_ground_looks_the_same_to_every_method(contact):
    states = steady(row_of("tmeasy"), slip=0.05, angle=0.03)
    one = run(row_of("tmeasy"), states)
    other = run(row_of("tmeasy", contact=contact), states)
    # float32 of 0.45 m is 3e-8 m of 0.02 m, a few times; 100 columns of 9 mm over a chord of 0.25 m find its area,
    # and so the deflection, within 1 %
    margin = 1e-5 if contact == "four-point" else 0.01
    assert abs(other.deflection.numpy()[0, 0] / one.deflection.numpy()[0, 0] - 1.0) < margin


def test_a_step_shorter_than_the_patch_lifts_the_envelope_gently():
    """A kerb of 2 cm: one point takes its flank for an endless slope, the envelope sees a part of it."""
    row = row_of("tmeasy")
    heights = np.zeros((3, 401), dtype=np.float32)
    heights[:, 200:] = 0.02
    assets = Assets()
    keep = add_ground_assets(assets, [height_field(heights, (4.0, 4.0))], [], "cpu")
    x = np.linspace(-0.3, 0.3, 61)
    zero = np.zeros_like(x)
    still = np.zeros((61, 3))
    states = States(np.stack([x, zero, zero + 0.46], axis=-1), np.tile([0.0, 0.0, 0.0, 1.0], (61, 1)), still, still)
    jumps = {}
    for contact in ("single-point", "envelope"):
        tires = bench(row_of("tmeasy", contact=contact), 61, terrain=ground("cpu", kind=ShapeType.HEIGHT_FIELD))
        tires.apply(DT, states.arrays(), assets)
        jumps[contact] = np.abs(np.diff(tires.deflection.numpy()[:, 0])).max()
    del keep
    assert row.values[Common.RADIUS] - 0.46 < 0.02
    assert jumps["single-point"] > 0.02
    assert jumps["envelope"] < 0.005


# ---- laws ------------------------------------------------------------------------------------------------------------

SLIPS = np.linspace(-0.9, 0.9, 37)
ANGLES = np.linspace(-0.5, 0.5, 37)


def grid_states(row, **options):
    slip, angle = (a.ravel() for a in np.meshgrid(SLIPS, ANGLES))
    return steady(row, slip=slip, angle=angle, **options)


@pytest.mark.parametrize("template", TEMPLATES)
@pytest.mark.sweep
def test_rolling_backwards_reverses_the_force(template):
    """Turned by half a turn about the vertical the whole scene is the same scene."""
    row = row_of(template)
    if template == "pacejka2002":
        pytest.skip("plysteer and conicity tell forwards from backwards")
    states = grid_states(row)
    back = States(states.x, states.q, -states.v, -states.omega)
    a, b = run(row, states, 200), run(row, back, 200)
    assert np.abs(a.force_w.numpy()[..., :2] + b.force_w.numpy()[..., :2]).max() < 1e-5 * 8000.0
    assert np.abs(a.force_w.numpy()[..., 2] - b.force_w.numpy()[..., 2]).max() < 1e-5 * 8000.0


@pytest.mark.parametrize("template", TEMPLATES)
@pytest.mark.sweep
def test_a_mirror_changes_the_side_only(template):
    row = row_of(template, measured_side="left")
    states = grid_states(row, camber=0.03)
    flip = np.array([1.0, -1.0, 1.0])
    mirrored = States(
        states.x * flip, states.q * np.array([-1.0, 1.0, -1.0, 1.0]), states.v * flip, -states.omega * flip
    )
    a, b = run(row, states, 200, side="left"), run(row, mirrored, 200, side="right")
    assert np.abs(a.force_w.numpy() * flip - b.force_w.numpy()).max() < 1e-5 * 8000.0
    assert np.abs(a.torque_w.numpy() * -flip - b.torque_w.numpy()).max() < 1e-5 * 8000.0
    if template == "pacejka2002":
        same_side = run(row, mirrored, 200, side="left")
        assert np.abs(a.force_w.numpy() * flip - same_side.force_w.numpy()).max() > 100.0


@pytest.mark.parametrize("template", TEMPLATES)
@pytest.mark.sweep
def test_driving_pushes_and_drifting_is_resisted(template):
    row = row_of(template)
    slips = steady(row, slip=[-0.05, 0.05])
    force = run(row, slips, 300).force_w.numpy()[:, 0, 0]
    assert force[0] < -2000.0
    assert force[1] > 2000.0
    tires = run(row, steady(row, angle=[-0.05, 0.05]), 300)
    side = tires.force_w.numpy()[:, 0, 1]
    assert side[0] > 1000.0
    assert side[1] < -1000.0
    if template not in ("tmsimple", "lugre"):
        # a trail behind the middle turns the wheel towards where it goes
        aligning = tires.torque_w.numpy()[:, 0, 2]
        assert aligning[0] < -20.0
        assert aligning[1] > 20.0


@pytest.mark.parametrize("template", ["tmeasy", "tmsimple"])
@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_rill_force_stays_below_the_maximum_of_its_direction(template, friction):
    row = row_of(template)
    tires = run(row, grid_states(row), friction=friction)
    load = tires.load.numpy()[:, 0].astype(float)
    force = tires.force_w.numpy()[:, 0].astype(float)
    q = load / row.values[Tmeasy.NOMINAL_LOAD]
    pattern = {"tmeasy": ((0.89965, 0.77751), (0.75876, 0.72628)), "tmsimple": ((0.91432, 0.79538), (0.75948, 0.72714))}
    size = np.hypot(force[:, 0], force[:, 1])
    limit = 0.0
    for axis, (a, b) in enumerate(pattern[template]):
        largest = row.values[Tmeasy.NOMINAL_LOAD] * (q * (2 * a - b) + q * q * (b - a)) * friction / 0.8
        limit = limit + (largest * force[:, axis] / np.maximum(size, 1e-9)) ** 2
    assert np.all(size <= np.sqrt(limit) * (1 + 1e-5) + 1e-3)
    assert size.max() > 0.9 * np.sqrt(limit).min()


def test_fiala_forces_stay_below_friction_each():
    row = row_of("fiala")
    force = run(row, grid_states(row), friction=0.5).force_w.numpy()[:, 0]
    limit = 0.9835 * 0.5 / 0.8 * force[:, 2]
    assert np.all(np.abs(force[:, :2]) <= limit[:, None] * (1 + 1e-5))


def test_pacejka_force_stays_in_the_ellipse():
    tir = {key: v for key, v in properties().items() if not key.startswith(("PH", "PV"))}
    row = row_of("pacejka2002", tir=tir)
    states = grid_states(row)
    force = run(row, states).force_w.numpy()[:, 0].astype(float)
    p = Pac02Coefficients(row.values)
    x, y, _, _ = pac02_pure(p, 0.1, 0.1, 0.0, float(force[0, 2]), 0.9 / 0.8)
    used = np.hypot(force[:, 0] / (x["mu"] * force[:, 2]), force[:, 1] / (y["mu"] * force[:, 2]))
    assert used.max() <= 1.0 + 1e-5
    assert used.max() > 0.95


@pytest.mark.parametrize("template", TEMPLATES)
def test_off_the_ground_nothing_acts(template):
    row = row_of(template)
    radius = row.values[Common.RADIUS]
    heights = np.array([radius + 1e-4, radius + 1.0, -0.01, np.nan])
    zero, moving = np.zeros(4), np.ones((4, 3))
    states = States(np.stack([zero, zero, heights], axis=-1), np.tile([0.0, 0.0, 0.0, 1.0], (4, 1)), moving, moving)
    tires = bench(row, 4)
    tires.state.fill_(0.01)
    tires.apply(DT, states.arrays())
    for array in (tires.load, tires.force_w, tires.torque_w, tires.slip_ratio, tires.slip_angle, tires.state):
        assert np.all(array.numpy() == 0.0)
    assert np.all(tires.force.numpy() == 0.0)
    assert np.all(tires.torque.numpy() == 0.0)


@pytest.mark.parametrize("template", TEMPLATES)
def test_the_ground_does_not_pull(template):
    """Spring and damper of a wheel that leaves the ground fast would."""
    row = row_of(template)
    states = steady(row)
    states.v[:, 2] = 1000.0
    tires = run(row, states)
    assert np.all(tires.force_w.numpy() == 0.0)
    states.v[:, 2] = -1.0
    # Fiala's damper of 75 N·s/m is the weakest; lateral velocities do not enter
    assert run(row, states).load.numpy()[0, 0] > 8050.0


# ---- formulas by hand ------------------------------------------------------------------------------------------------


def test_pacejka_89_by_hand():
    """5 kN, 5 % slip, 4 degrees. F_x: B 0.1335477, D 4716.156, E -0.4655491; F_y: B 0.08957909, D 3941.002,
    E 0.3330219; M_z: B -0.1257321, D 39.60308, E -0.8357775.
    """
    row = row_of("pacejka89").values
    f_x, f_y, m_z = pac89_pure(5.0, 4.0, 0.0, 5.0, 1.0, row)
    assert f_x == pytest.approx(3754.29268, rel=1e-7)
    assert f_y == pytest.approx(1922.85528, rel=1e-7)
    assert m_z == pytest.approx(-36.1053459, rel=1e-7)


def test_pacejka_2002_by_hand():
    """At the nominal load, where (F_z - F_z0) / F_z0 is 0, and no camber: slip 5 %, slip angle -0.06 rad."""
    row = row_of("pacejka2002", mode=3).values
    p = Pac02Coefficients(row)
    f_x, f_y, _ = pac02_slip(p, 0.05, -0.06, 0.0, 35000 * 0.580904846, 1.0, 0.4699)
    assert f_x == pytest.approx(11664.4158, rel=1e-7)
    assert f_y == pytest.approx(6203.55678, rel=1e-7)


@pytest.mark.parametrize(("template", "slip", "angle"), [("pacejka89", 0.05, 0.0), ("pacejka89", 0.0, np.deg2rad(4.0))])
def test_the_kernel_gives_the_formula(template, slip, angle):
    row = row_of(template)
    states = steady(row, slip=slip, angle=angle, load=5000.0)
    tires = run(row, states, friction=0.8)
    f_x, f_y, _ = pac89_pure(100 * slip, np.degrees(angle), 0.0, 5.0, 1.0, row.values)
    # the load is found within some 0.01 N, the slip within 1e-6
    assert np.abs(tires.force_w.numpy()[0, 0] - [f_x, -f_y, 5000.0]).max() < 0.5
    assert tires.slip_ratio.numpy()[0, 0] == pytest.approx(slip, abs=2e-6)
    assert tires.slip_angle.numpy()[0, 0] == pytest.approx(angle, abs=1e-6)


# ---- LuGre -----------------------------------------------------------------------------------------------------------


def test_lugre_slides_with_its_friction():
    """Locked wheels, any direction: the force opposes the velocity with g + viscosity, both those of the road."""
    row = row_of("lugre", viscosity=(0.01, 0.01))
    speeds = np.array([0.01, 0.1, 1.0, 10.0])
    angles = np.array([0.3, 1.2, -2.0, 3.0])
    states = steady(row, slip=np.full(4, -1.0), angle=angles, speed=1.0)
    states.v *= speeds[:, None]
    states.v = states.v.astype(np.float32).astype(float)
    # the slowest needs some z = g / sigma0 = 14 mm of the way
    force = run(row, states, 10000, friction=0.4).force_w.numpy()[:, 0].astype(float)
    friction = lugre_friction(speeds, 0.5, row.values) + 0.5 * 0.01 * speeds
    direction = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    assert np.abs(force[:, :2] + friction[:, None] * force[:, 2:] * direction).max() < 1e-4 * 8000.0


def test_lugre_follows_its_equation():
    """A ramp of 2 m/s² in steps of 1 ms against Runge-Kutta steps of 10 us."""
    row = row_of("lugre", disc_count=1)
    states = steady(row, slip=-1.0, speed=1.0)
    tires = bench(row, 1, friction=0.8)
    for step in range(300):
        states.v[0] = [2.0 * DT * (step + 0.5), 0.0, 0.0]
        tires.apply(DT, states.arrays())
    z, h = 0.0, 1e-5
    s0 = row.values[Lugre.BRISTLE_STIFFNESS]

    def rate(t, z):
        return 2.0 * t - s0 * 2.0 * t / lugre_friction(2.0 * t, 1.0, row.values) * z

    for step in range(30000):
        t = step * h
        k1 = rate(t, z)
        k2 = rate(t + 0.5 * h, z + 0.5 * h * k1)
        k3 = rate(t + 0.5 * h, z + 0.5 * h * k2)
        z += h * (k1 + 2 * k2 + 2 * k3 + rate(t + h, z + h * k3)) / 6
    # a ramp taken as steps around its middle errs in the second order: (rate h)² / 24 = (150 · 1e-3)² / 24 = 1e-3
    assert tires.state.numpy()[0, 0, 0] == pytest.approx(z, rel=1e-3)


# ---- worlds ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("template", TEMPLATES)
@pytest.mark.sweep
def test_worlds_do_not_know_of_each_other(template):
    row = row_of(template)
    states = grid_states(row)
    many = run(row, states, 3)
    for w in (0, 500, len(states.x) - 1):
        part = States(*(a[w : w + 1] for a in (states.x, states.q, states.v, states.omega)))
        one = run(row, part, 3)
        assert np.array_equal(one.force_w.numpy()[0], many.force_w.numpy()[w])
        assert np.array_equal(one.torque_w.numpy()[0], many.torque_w.numpy()[w])
        assert np.array_equal(one.state.numpy()[0], many.state.numpy()[w])


@pytest.mark.parametrize("template", [name for name in TEMPLATES if name not in ("tmeasy", "pacejka2002")])
@pytest.mark.sweep
def test_friction_of_each_world_scales_sliding(template):
    """Locked wheels, down to ice under water, and up to the limit of 1."""
    row = row_of(template)
    states = steady(row, slip=np.full(5, -1.0))
    tires = bench(row, 5, randomised=True)
    tires.ground_friction[:] = np.array([0.02, 0.1, 0.4, 0.8, 1.7])
    for _ in range(1000):
        tires.apply(DT, states.arrays())
    force = tires.force_w.numpy()[:, 0, 0]
    assert force[3] < -3000.0
    # Fiala's parabola and the bent part of Pacejka 89 depend on the friction, too: a few per cent of the force
    margin = {"fiala": 0.15, "pacejka89": 1e-5}.get(template, 1e-5)
    assert force / force[3] == pytest.approx(np.array([0.02, 0.1, 0.4, 0.8, 1.0]) / 0.8, rel=margin)


def test_a_map_of_friction_counts_where_the_wheel_stands():
    row = row_of("tmsimple")
    states = steady(row, slip=np.full(4, -1.0))
    states.x[:, 0] = [0.5, 1.5, 0.5, -7.0]
    states.x[:, 1] = [0.5, 0.5, 1.5, 0.5]
    terrain = ground("cpu", friction_map=[[1.0, 0.5], [0.25, 1.0]])
    force = run(row, states, friction=0.8, terrain=terrain).force_w.numpy()[:, 0, 0]
    assert force / force[0] == pytest.approx([1.0, 0.5, 0.25, 1.0], rel=1e-5)


def test_forces_act_at_the_centre_of_mass_of_the_spindle():
    """A wheel beside its spindle's centre of mass: only the torque knows."""
    row = row_of("tmeasy")
    states = steady(row, slip=0.05, angle=0.04)
    body = States(states.x - [0.0, 0.1, 0.0], states.q, states.v, states.omega)
    tires = Tires([Mount(row, 1, offset=(0.0, 0.1, 0.0))], 1, 2, "cpu")
    arrays = body.arrays()
    for name in ("body_x", "body_rot", "body_v", "body_omega"):
        one = getattr(arrays, name)
        setattr(arrays, name, wp.array(np.concatenate([one.numpy()] * 2, axis=1), dtype=one.dtype, device="cpu"))
    tires.force.fill_(7.0)
    tires.apply(DT, arrays)
    plain = run(row, states)
    force = plain.force.numpy()[0, 0]
    assert np.allclose(tires.force.numpy()[0, 1], force, rtol=1e-5)
    assert np.allclose(
        tires.torque.numpy()[0, 1], plain.torque.numpy()[0, 0] + np.cross([0.0, 0.1, 0.0], force), rtol=1e-4, atol=0.1
    )  # fmt: skip
    assert np.all(tires.force.numpy()[0, 0] == 7.0)


def test_reset_zeroes_the_worlds_of_the_mask():
    tires = bench(row_of("tmeasy"), 3)
    tires.state.fill_(0.5)
    tires.reset(wp.array([True, False, True], dtype=wp.bool, device="cpu"))
    assert np.array_equal(tires.state.numpy()[:, 0, 0], [0.0, 0.5, 0.0])


def test_one_tire_stands_on_a_body():
    with pytest.raises(SpecError, match="different bodies"):
        Tires([Mount(row_of("tmeasy"), 0), Mount(row_of("tmeasy"), 0)], 1, 1, "cpu")
