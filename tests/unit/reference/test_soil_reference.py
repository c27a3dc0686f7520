"""The reference of the deformable soil: closed forms, integrals over a wheel's contact, its own small steps.

Numbers of the quadrature (wheel 0.467 x 0.254 m, 6300 N) are those that the law's statement gives for Project Chrono's
soils; R is left out where they are compared.
"""

import dataclasses
import functools

import numpy as np
import pytest

from tests.reference.soil import (
    DIRECTION,
    PRESETS,
    SCALAR,
    GridSoil,
    Node,
    Rig,
    ShearMemory,
    advance,
    linearised,
    pressure,
    rectangle_inverse_b,
    slope,
)
from tests.reference.soil_quadrature import half_chord, rolling, rolling_sinkage, standing_sinkage
from tests.reference.soil_shapes import Body, Plate, Wheel, strip_share
from tests.reference.suspension_kinematics import exponential

WHEEL = Wheel(0.467, 0.254)
LOAD = 6300.0
MID = PRESETS["mid"]
QUIET = {name: dataclasses.replace(soil, damping=0.0) for name, soil in PRESETS.items()}
MEMORIES = pytest.mark.parametrize("memory", [DIRECTION, SCALAR], ids=lambda m: m.kind)


def at(x=0.0, y=0.0, z=0.0):
    return np.array([x, y, z])


# ---- plates ----------------------------------------------------------------------------------------------------------


def press(soil, plate, sinkages):
    """Vertical force of a plate at rest at each of these sinkages, one after the other."""
    return np.array([soil.react([Body(plate, at(z=-s))], 1e-3)[0].force[2] for s in sinkages])


@pytest.mark.parametrize("spacing", [0.05, 0.04])
def test_plate_pressed_unloaded_and_pressed_again(spacing):
    soil, plate = GridSoil(MID, spacing), Plate(0.2, 0.5)
    down = np.linspace(0.0, 0.07, 1401)
    force = press(soil, plate, down)
    sinkage = np.interp(10e3, force, down)
    assert sinkage == pytest.approx((10e3 / (0.1 * 2e6)) ** (1 / 1.1), rel=1e-4)
    assert sinkage == pytest.approx(0.0657, rel=0.01)
    # unloading runs along K_el to the residual sinkage, and stays at nothing
    top = force[-1]
    residual = 0.07 - top / 0.1 / 2e8
    up = np.linspace(0.07, 0.065, 101)
    np.testing.assert_allclose(press(soil, plate, up), np.maximum(0.1 * 2e8 * (up - residual), 0.0), atol=1e-6 * top)
    assert soil.depth(0.0, 0.0) == pytest.approx(residual, rel=1e-12)
    # pressed again with less load nothing is added; beyond the yield pressure the curve goes on
    press(soil, plate, np.linspace(residual, 0.07 - 1e-6, 50))
    assert soil.depth(0.0, 0.0) == pytest.approx(residual, rel=1e-12)
    deeper = np.linspace(0.07, 0.08, 11)
    np.testing.assert_allclose(press(soil, plate, deeper), 0.1 * 2e6 * deeper**1.1, rtol=1e-9)


def test_plate_on_soil_with_a_length():
    assert 1.0 / rectangle_inverse_b(0.2, 0.5) == pytest.approx(0.143, abs=5e-4)
    down = np.linspace(0.0, 0.008, 801)
    for angle in (0.0, np.pi / 2):
        soil = GridSoil(PRESETS["hard"], 0.05)
        body = [Body(Plate(0.2, 0.5), at(z=-s), exponential(at(z=angle))) for s in down]
        force = [soil.react([b], 1e-3)[0].force[2] for b in body]
        assert np.interp(10e3, force, down) == pytest.approx(0.0057, abs=5e-5)
    assert rectangle_inverse_b(1e-3, 0.9e-3) == 0.0


def test_damping_is_clamped_unless_soil_may_pull():
    node = Node.fresh()
    for clamp, expected in ((True, 0.0), (False, None)):
        stress = advance(node, 0.01, 10.0, at()[:2], 1e-3, MID, clamp=clamp)
        curve = 2e6 * 0.01**1.1
        assert stress.normal == pytest.approx(curve - 3e5 if expected is None else expected)
    assert advance(node, 0.005, -1.0, at()[:2], 1e-3, MID).normal == 0.0  # not in touch: no damping either
    fast = linearised(Node.fresh(), 0.01, 0.01, 10.0, at()[:2], 1e-3, MID)
    assert (float(fast.normal), float(fast.damping), float(fast.stiffness)) == (0.0, 0.0, 2e8)


# ---- shear -----------------------------------------------------------------------------------------------------------


def drag(soil, plate, heading, distances, sinkage):
    """Force against the motion and across, relative to the normal force, of a plate dragged at 0.5 m/s."""
    ahead = at(np.cos(heading), np.sin(heading))
    dt, x, found = (distances[1] - distances[0]) / 0.5, at(z=-sinkage), []
    for _ in distances[1:]:
        force = soil.react([Body(plate, x, velocity=0.5 * ahead)], dt)[0].force
        x = x + dt * 0.5 * ahead
        found.append([-force @ ahead, force @ np.array([-ahead[1], ahead[0], 0.0]), force[2]])
    return np.array(found).T


@MEMORIES
@pytest.mark.parametrize("heading", [0.0, 0.7, np.pi])
@pytest.mark.parametrize("name", ["mid", "hard"])
@pytest.mark.sweep
def test_sheared_plate_follows_janosi_and_hanamoto(memory, heading, name):
    soil = PRESETS[name]
    # over a single node: all of its soil is sheared by the same distance
    grid = GridSoil(soil, 10.0, memory=memory, share=False)
    s = np.linspace(0.0, 0.05, 501)
    along, across, normal = drag(grid, Plate(2.0, 2.0), heading, s, 0.02)
    assert len(grid.nodes) == 1
    expected = (100.0 * soil.cohesion + normal * soil.friction) * -np.expm1(-s[1:] / soil.shear_modulus)
    np.testing.assert_allclose(across, 0.0, atol=1e-9 * along.max())
    if memory.kind == "scalar":
        np.testing.assert_allclose(along, expected, rtol=1e-9)
    else:
        # its price: a direction that grows over a millimetre; less than 1 % after five
        np.testing.assert_allclose(along, expected * -np.expm1(-s[1:] / 1e-3), rtol=1e-6)
        np.testing.assert_allclose(along[60:], expected[60:], rtol=0.01)


@MEMORIES
def test_shear_reversed(memory):
    node, dt, v = Node.fresh(), 1e-4, 0.5
    for _ in range(1000):
        advance(node, 0.02, 0.0, at(v)[:2], dt, MID, memory=memory)
    sigma = pressure(node, 0.02, MID)
    back = np.array([advance(node, 0.02, 0.0, at(-v)[:2], dt, MID, memory=memory).tangential[0] for _ in range(100)])
    s = 0.05 + v * dt * np.arange(1, 101)
    full = sigma * MID.friction * -np.expm1(-s / 0.01)
    turned = 1.0 if memory.kind == "scalar" else 1.0 - 2.0 * np.exp(-(s - 0.05) / 1e-3)
    np.testing.assert_allclose(back, full * turned, rtol=0.01, atol=1e-3 * sigma)


def test_plate_is_held_on_a_slope():
    """20 % at 3 ms: the direction memory stands still; it settles first."""
    n = at(-0.2, 0.0, 1.0) / np.sqrt(1.04)
    soil = GridSoil(MID, (10.0, 10.0), slope(n), share=False)
    turn = exponential(at(0.0, -np.arctan(0.2), 0.0))
    plate = Plate(2.0, 2.0)  # over the one node at the origin
    load = 100.0 * 60e3
    rig = Rig(Body(plate, at(), turn), load / 9.81, 1.0, (0.0, -load), free=(True, True, False))
    places = []
    for _ in range(4000):
        rig.step(soil, 3e-3)
        places.append(rig.body.position.copy())
    assert len(soil.nodes) == 1
    moved = np.linalg.norm(places[-1] - places[1000])
    assert moved < 1e-4  # 9 s; less than 1 mm in 60 s
    assert np.linalg.norm(rig.velocity[:2]) < 1e-5


# ---- shapes ----------------------------------------------------------------------------------------------------------


def inside(wheel, p, axis):
    """Whether points are in the wheel."""
    y = p @ axis
    radius = wheel.radius - (y * y / (2.0 * wheel.crown) if wheel.crown else 0.0)
    return (np.abs(y) <= 0.5 * wheel.width) & (np.einsum("ki,ki->k", p, p) - y * y <= radius**2)


@pytest.mark.parametrize("crown", [None, 0.5])
@pytest.mark.parametrize("turn", [(0, 0, 0), (0, 0, 0.7), (0.1, 0.3, 0.2), (-0.6, 0, 1.0), (1.2, 0.4, -2.0)])
@pytest.mark.sweep
def test_height_of_a_wheel_by_search(crown, turn):
    rng = np.random.default_rng(3)
    wheel, rotation = Wheel(0.4, 0.25, crown), exponential(np.array(turn, dtype=float))
    half = wheel.extent(rotation)
    xy = rng.uniform(-1.02, 1.02, (60, 2)) * half[:2]
    found = wheel.height(xy, rotation)
    z = np.linspace(-0.55, 0.55, 4001)
    for place, height in zip(xy, found, strict=True):
        hits = z[inside(wheel, np.column_stack([np.tile(place, (len(z), 1)), z]), rotation[:, 1])]
        if len(hits) > 1:
            assert height == pytest.approx(hits[0], abs=3e-4)
        else:
            assert height == np.inf or inside(wheel, np.array([[*place, height + 1e-9]]), rotation[:, 1])[0]


def test_lying_wheel_is_a_disc():
    flat = Wheel(0.4, 0.25).columns(np.array([[0.0, 0.0], [0.3, 0.2], [0.3, 0.3]]), exponential(at(np.pi / 2)), None)
    np.testing.assert_allclose(flat.height[:2], -0.125)
    assert flat.height[2] == np.inf


def test_share_of_a_cell_in_a_strip():
    rng = np.random.default_rng(5)
    points = rng.uniform(-0.5, 0.5, (200_000, 2)) * (0.05, 0.08)
    for angle, low, high in ((0.0, -0.01, 0.02), (0.6, -0.02, 0.005), (2.0, -1.0, 0.01), (1e-9, 0.0, 0.1)):
        e = np.array([np.cos(angle), np.sin(angle)])
        inner = (points @ e >= low) & (points @ e <= high)
        assert strip_share(e, low, high, np.array([0.05, 0.08])) == pytest.approx(inner.mean(), abs=4e-3)


def standing_load(place, heading, share=True):
    """Vertical force on the wheel pressed 5.65 cm deep into mid soil on a grid of 5 cm."""
    body = Body(WHEEL, at(place[0], place[1], 0.467 - 0.0565), exponential(at(z=heading)))
    return GridSoil(MID, 0.05, share=share).react([body], 1e-3)[0].force[2]


def test_load_does_not_change_as_a_wheel_drifts():
    """Shares of cells: exact across the wheel; along it the pressure's curve is sampled."""
    drift = np.linspace(-0.05, 0.05, 8)
    across = [standing_load((0.01, y), 0.0) for y in drift]
    np.testing.assert_allclose(across, across[0], rtol=1e-12)
    # without shares 5 or 6 rows bear
    rows = [standing_load((0.01, y), 0.0, share=False) for y in (0.0, 0.025)]
    assert rows[1] == pytest.approx(1.2 * rows[0], rel=1e-12)
    for heading, bound in ((0.0, 0.015), (0.4, 0.005)):
        along = [standing_load((x, 0.01), heading) for x in drift]
        assert np.mean(along) == pytest.approx(LOAD, rel=0.005)
        assert np.ptp(along) < bound * LOAD


def test_node_under_two_bodies_belongs_to_the_lower():
    plates = [Body(Plate(1.0, 1.0), at(z=-0.01)), Body(Plate(0.5, 1.0), at(z=-0.02))]
    both = GridSoil(MID, 0.1).react(plates, 1e-3)
    assert both[0].force[2] == pytest.approx(0.5 * 2e6 * 0.01**1.1, rel=0.15)
    assert both[1].force[2] == pytest.approx(0.5 * 2e6 * 0.02**1.1, rel=1e-9)
    same = GridSoil(MID, 0.1).react([plates[0], plates[0]], 1e-3)
    assert same[0].force[2] == pytest.approx(2e6 * 0.01**1.1, rel=1e-9)
    assert same[1].force[2] == 0.0


# ---- a wheel and integrals over its contact --------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "sinkage"), [("soft", 0.248), ("mid", 0.0565), ("hard", 0.0110)])
def test_standing_wheel(name, sinkage):
    found = standing_sinkage(WHEEL, PRESETS[name], LOAD)
    assert found == pytest.approx(sinkage, abs=0.51 * 10 ** -(3 if name == "soft" else 4))
    soil = GridSoil(QUIET[name], 0.01)
    down = np.linspace(found - 0.002, found + 0.002, 5)
    force = [soil.react([Body(WHEEL, at(z=0.467 - s))], 1e-3)[0].force[2] for s in down]
    assert np.interp(LOAD, force, down) == pytest.approx(found, rel=0.01)


@pytest.mark.parametrize(
    ("slip", "memory", "pull", "torque"),
    [
        (0.1, SCALAR, 0.31, 0.50),
        (0.4, SCALAR, 0.57, 0.74),
        (0.05, SCALAR, 0.21, None),
        (0.1, DIRECTION, 0.28, None),
        (0.1, ShearMemory(length=0.5e-3), 0.29, None),
        (0.05, ShearMemory(length=0.5e-3), 0.13, None),
    ],
)
def test_rolling_wheel(slip, memory, pull, torque):
    found = rolling(WHEEL, MID, LOAD, slip, memory)
    assert found.sinkage == pytest.approx(0.0828, abs=5.1e-5)
    assert found.pull == pytest.approx(pull, abs=5.1e-3)
    assert torque is None or found.torque == pytest.approx(torque, abs=5.1e-3)


def test_damping_lifts_a_rolling_wheel():
    assert rolling_sinkage(WHEEL, MID, LOAD, 4.6 / 0.467) == pytest.approx(0.064, abs=5e-4)


@pytest.mark.parametrize("memory", [DIRECTION, SCALAR], ids=lambda m: m.kind)
@pytest.mark.parametrize("name", list(PRESETS))
@pytest.mark.parametrize("load", [2000.0, 4000.0, LOAD])
@pytest.mark.sweep
def test_pull_rises_with_slip(name, load, memory):
    pulls = [rolling(WHEEL, PRESETS[name], load, slip, memory).pull for slip in (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6)]
    assert (np.diff(pulls) > 0.0).all()
    assert max(pulls) < PRESETS[name].friction + (0.0 if name != "hard" else 0.02)


def roll_at_depth(soil, depth, slip, dt, speed=1.0, implicit=False):
    """Mean load, pull / load and torque / (load r) over four cells of a wheel moved at a depth."""
    spin = at(0.0, speed / (WHEEL.radius * (1.0 - slip)))
    body = Body(WHEEL, at(z=WHEEL.radius - depth), velocity=at(speed), spin=spin)
    rig = Rig(body, 1.0, 1.0, free=(False, False, False))
    lead = half_chord(WHEEL.radius, depth) + 0.05
    steps = [round(length / speed / dt) for length in (lead, 4 * soil.spacing[0])]
    for _ in range(steps[0]):
        rig.step(soil, dt, implicit)
    x, z, turning = np.mean([rig.step(soil, dt, implicit) for _ in range(steps[1])], axis=0)
    return z, x / z, -turning / z / WHEEL.radius


@MEMORIES
@pytest.mark.parametrize("implicit", [False, True], ids=["explicit", "implicit"])
@pytest.mark.parametrize("slip", [0.1, 0.4])
@pytest.mark.parametrize("spacing", [0.01, 0.05])
def test_grid_against_the_integrals(spacing, slip, implicit, memory):
    expected = rolling(WHEEL, QUIET["mid"], LOAD, slip, memory, speed=1.0)
    soil = GridSoil(QUIET["mid"], (spacing, WHEEL.width), memory=memory)
    load, pull, torque = roll_at_depth(soil, expected.sinkage, slip, 5e-4, implicit=implicit)
    assert load == pytest.approx(LOAD, rel=1e-3)
    assert pull == pytest.approx(expected.pull, rel=0.01)
    assert torque == pytest.approx(expected.torque, rel=0.005)


def test_first_passes_deepen_a_rut_less_and_less():
    soil = GridSoil(MID, (0.05, WHEEL.width))
    ruts: list[float] = []
    for _ in range(4):
        sinkage = ruts[-1] + 0.02 if ruts else 0.06
        body = Body(WHEEL, at(z=WHEEL.radius - sinkage), velocity=at(2.0), spin=at(0.0, 2.0 / 0.467 / 0.95))
        rig = Rig(body, 642.0, 8.0, (0.0, -LOAD), free=(False, True, False))
        for _ in range(700):
            rig.step(soil, 1e-3)
        ruts.append(soil.depth(0.8, 0.0))
    increments = np.diff(ruts)
    assert (increments > 0.0).all()
    assert (np.diff(increments) < 0.0).all()


# ---- the linearly implicit step --------------------------------------------------------------------------------------


def test_coefficients_of_a_node():
    """By hand, from the list: k_s between two points of the curve, shear with q = |v_t| h / l."""
    h, v = 2e-3, np.array([0.3, 0.4])
    law = linearised(Node.fresh(), 0.02, 0.021, -0.5, v, h, MID)
    sigma1 = 2e6 * 0.021**1.1
    assert law.normal == pytest.approx(sigma1 + 0.5 * 3e4)
    assert law.stiffness == pytest.approx(2e6 * (0.021**1.1 - 0.02**1.1) / 0.001)
    m = (sigma1 + 1.5e4) * np.tan(np.pi / 6) * (1.0 - np.exp(-0.1))
    g = 0.01 * np.exp(-0.5 / 0.02)
    assert law.shear == pytest.approx(h * h * m * (1.0 - np.exp(-1.0)) / 1e-3 + h * m * g / 1e-3)
    d = (1.0 - np.exp(-1.0)) * np.array([0.6, 0.8]) + g / 1e-3 * v
    np.testing.assert_allclose(law.tangential, -m * d, rtol=1e-12)
    scalar = linearised(Node.fresh(), 0.02, 0.021, -0.5, v, h, MID, memory=SCALAR)
    assert scalar.shear == pytest.approx(h * m / 0.5)
    np.testing.assert_allclose(scalar.tangential, -m * np.array([0.6, 0.8]), rtol=1e-12)
    still = linearised(Node.fresh(), 0.02, 0.02, 0.0, at()[:2], h, MID, memory=SCALAR)
    assert float(still.stiffness) == 2e8
    assert np.isfinite([still.shear, *still.tangential]).all()


def test_matrix_is_symmetric_and_dissipates():
    motion = {"velocity": at(1.0, 0.2, -0.3), "spin": at(0.1, 2.5, 0.4)}
    body = Body(WHEEL, at(0.01, 0.02, 0.42), exponential(at(0.05, 0.0, 0.3)), **motion)
    found = GridSoil(MID, 0.05).react([body], 2e-3, implicit=True)[0]
    np.testing.assert_allclose(found.matrix, found.matrix.T, rtol=1e-12)
    assert np.linalg.eigvalsh(found.matrix).min() > -1e-9 * np.abs(found.matrix).max()


def test_track_turned():
    """By 90 degrees all turns with it; by 37 the wheel meets its nodes otherwise."""
    found = []
    for angle in (0.0, np.pi / 2, np.radians(37.0)):
        turn = exponential(at(z=angle))
        soil = GridSoil(MID, 0.05)
        body = Body(WHEEL, turn @ at(0.013, 0.007, 0.41), turn, turn @ at(2.0), turn @ at(0.0, 5.0))
        for _ in range(150):
            reaction = soil.react([body], 1e-3, implicit=True)[0]
            body = body.moved(1e-3)
        found.append(np.concatenate([turn.T @ reaction.force, turn.T @ reaction.moment]))
    scale = np.abs(found[0]).max()
    np.testing.assert_allclose(found[1], found[0], atol=1e-9 * scale)
    np.testing.assert_allclose(found[2], found[0], atol=0.03 * scale)


@functools.cache
def drop_depth(dt, implicit, wheel=WHEEL, mass=642.0, soil=MID, **options):
    """Greatest sinkage of a wheel that meets the soil at 1 m/s under its constant load."""
    grid = GridSoil(soil, (0.05, wheel.width), **options)
    rig = Rig(Body(wheel, at(z=wheel.radius), velocity=at(z=-1.0)), mass, 8.0, (0.0, -LOAD))
    depth = 0.0
    for _ in range(round(0.25 / dt)):
        rig.step(grid, dt, implicit)
        depth = max(depth, wheel.radius - rig.body.position[2])
    return depth


@pytest.mark.parametrize(("damp_ahead", "bound"), [(True, 0.01), (False, 0.007)], ids=["listed", "present"])
def test_drop_against_small_steps(damp_ahead, bound):
    """First order: the error of a drop is about that part per millisecond, for the mass that belongs to the load."""
    exact = drop_depth(1e-4, implicit=False)
    for h in (1e-3, 3e-3):
        found = drop_depth(h, implicit=True, damp_ahead=damp_ahead)
        assert found == pytest.approx(exact, rel=bound * h / 1e-3)


@functools.cache
def roll_freely(dt, implicit, speed, **options):
    """Mean sinkage, pull / W and torque / (W r) at slip 0.1, free to sink."""
    soil = GridSoil(MID, (0.05, WHEEL.width), **options)
    spin = speed / (WHEEL.radius * 0.9)
    start = rolling_sinkage(WHEEL, MID, LOAD, spin)
    body = Body(WHEEL, at(z=WHEEL.radius - start), velocity=at(speed), spin=at(0.0, spin))
    rig = Rig(body, 71.0, 8.0, (0.0, -LOAD), free=(False, True, False))
    found = []
    for i in range(round(1.4 / speed / dt)):
        x, _, turning = rig.step(soil, dt, implicit)
        if i * dt * speed > 0.6:
            found.append((WHEEL.radius - rig.body.position[2], x / LOAD, -turning / LOAD / WHEEL.radius))
    return np.mean(found, axis=0)


def test_small_steps_with_damping_against_the_integrals():
    expected = rolling(WHEEL, MID, LOAD, 0.1, DIRECTION, speed=4.6)
    sinkage, pull, torque = roll_freely(1e-4, implicit=False, speed=4.6)
    assert sinkage == pytest.approx(expected.sinkage, rel=0.002)
    assert pull == pytest.approx(expected.pull, abs=0.001)
    assert torque == pytest.approx(expected.torque, abs=0.001)


@pytest.mark.parametrize(
    ("damp_ahead", "speed", "bound"),
    [(True, 2.0, 0.01), (True, 4.6, 0.015), (False, 2.0, 0.01), (False, 4.6, 0.002)],
    ids=["listed-slow", "listed-fast", "present-slow", "present-fast"],
)
def test_rolling_against_small_steps(damp_ahead, speed, bound):
    """R of nodes reached within the step, with the velocity of the present pose, is what costs at speed."""
    exact = roll_freely(1e-4, implicit=False, speed=speed)
    for h in (1e-3, 3e-3):
        sinkage, pull, torque = roll_freely(h, implicit=True, speed=speed, damp_ahead=damp_ahead)
        assert sinkage == pytest.approx(exact[0], rel=bound * max(1.0, h / 1e-3))
        assert pull == pytest.approx(exact[1], abs=0.006 * h / 1e-3)
        assert torque == pytest.approx(exact[2], abs=0.006 * h / 1e-3)


@MEMORIES
def test_locked_wheel_stops_where_small_steps_stop(memory):
    stops = []
    for h, implicit in ((1e-4, False), (1e-3, True), (3e-3, True)):
        soil = GridSoil(MID, (0.05, WHEEL.width), memory=memory)
        body = Body(WHEEL, at(z=0.467 - 0.0565), velocity=at(2.0))
        rig = Rig(body, LOAD / 9.81, 8.0, (0.0, -LOAD), free=(True, True, False))
        while rig.velocity[0] > 1e-3:
            rig.step(soil, h, implicit)
        stops.append(rig.body.position[0])
    assert stops[1] == pytest.approx(stops[0], rel=0.02)
    assert stops[2] == pytest.approx(stops[0], rel=0.05)


@pytest.mark.parametrize("damp_ahead", [True, False])
@pytest.mark.parametrize("seed", [*range(6), 11, 56])
@pytest.mark.sweep
def test_soil_gives_no_energy(seed, damp_ahead):
    """A wheel of 100 to 800 kg/m^3 thrown onto soil, 1 to 4 ms: its energy and that in the soil never rise by 2 %.

    The worst of 75 seeds are among these. Wheels a hundred times lighter can gain half of what they began with.
    """
    rng = np.random.default_rng(seed)
    r, density = np.exp(rng.uniform(np.log(0.06), np.log(0.5))), np.exp(rng.uniform(np.log(100), np.log(800)))
    h, wheel = rng.uniform(1e-3, 4e-3), Wheel(r, 0.6 * r)
    mass = density * np.pi * r * r * wheel.width
    params = PRESETS[("soft", "mid", "hard")[seed % 3]]
    soil = GridSoil(params, (min(0.05, r / 5), wheel.width), damp_ahead=damp_ahead)
    velocity, spin = at(rng.uniform(-3, 3), 0.0, rng.uniform(-2, 0)), at(0.0, rng.uniform(-5, 5) / r)
    rig = Rig(Body(wheel, at(z=r), velocity=velocity, spin=spin), mass, 0.5 * mass * r * r, (0.0, -9.81 * mass))
    masses = np.array([mass, mass, rig.inertia])
    energy = [0.5 * masses @ rig.velocity**2]
    for _ in range(round(0.8 / h)):
        rig.step(soil, h)
        height = rig.body.position[2] - r
        energy.append(0.5 * masses @ rig.velocity**2 + 9.81 * mass * height + soil.stored(rig.body))
    assert np.isfinite(energy).all()
    assert max(energy - np.minimum.accumulate(energy)) < 0.02 * energy[0]
