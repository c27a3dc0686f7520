"""Soil against closed forms, and its laws: balance, bits, mirrors, energy."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.soil import PRESETS, ShearMemory, Soil, SoilBox, SoilSpec, SoilSphere, SoilWheel
from tests.unit.soil.soil_wheels import GRAVITY, RADIUS, WIDTH, pressed, rolling, sinkage

AREA = 0.1
DISC = math.sqrt(AREA / math.pi)
ARRAYS = ("body_x", "body_rot", "body_v", "body_omega")


@pytest.mark.parametrize(("soil", "load", "expected"), [("mid", 1.0e4, 0.0657), ("soft", 2.0e3, 0.1234)])
def test_a_plate_sinks_as_bekker_says(soil, load, expected):
    """z = (W / (A k))^(1/n); soft: (2000 / (0.1 * 0.2e6))^(1 / 1.1) = 0.1233 m."""
    spec = PRESETS[soil]
    assert (load / (AREA * spec.k_phi)) ** (1.0 / spec.exponent) == pytest.approx(expected, rel=2e-3)
    simulation, element = pressed(soil, load=load, spacing=0.01, radius=DISC, width=0.2, disc=True)
    # nodes cover the disc but for 1 % of its area; the rest is what it swings past the balance
    assert sinkage(simulation, 0.1) == pytest.approx(expected, rel=0.015)
    assert float(element.load.numpy()[0, 0]) == pytest.approx(load, rel=1e-3)


def test_unloading_is_elastic_and_reloading_meets_the_curve():
    load, spec = 1.0e4, PRESETS["mid"]
    simulation, element = pressed("mid", load=load, spacing=0.01, radius=DISC, width=0.2, disc=True)
    deep = sinkage(simulation, 0.1)
    simulation.control.body_force.fill_(wp.vec3(0.0, 0.0, 0.9 * load))
    simulation.step(3000)
    # a tenth of the pressure is left: the rest of the elastic sinkage is given back
    back = 0.9 * load / AREA / spec.elastic
    assert deep - sinkage(simulation, 0.1) == pytest.approx(back, rel=0.05)
    for share in np.linspace(0.9, 0.0, 300):  # slowly: put on at once, it would swing past
        simulation.control.body_force.fill_(wp.vec3(0.0, 0.0, float(share) * load))
        simulation.step(10)
    assert sinkage(simulation, 0.1) == pytest.approx(deep, abs=0.1e-3)
    assert float(element.load.numpy()[0, 0]) == pytest.approx(load, rel=2e-3)


@pytest.mark.parametrize(("soil", "expected"), [("soft", 0.248), ("mid", 0.0565), ("hard", 0.0110)])
@pytest.mark.parametrize("spacing", [0.01, 0.05])
def test_a_standing_wheel_sinks_as_quadrature_says(soil, expected, spacing):
    simulation, element = pressed(soil, load=6300.0, spacing=spacing)
    # 5 cm nodes: the wheel's contact is 0.1 m long on hard soil
    assert sinkage(simulation, RADIUS) == pytest.approx(expected, rel=0.02 if spacing < 0.02 else 0.065)
    assert float(element.sinkage.numpy()[0, 0]) == pytest.approx(sinkage(simulation, RADIUS), abs=2e-3)


@pytest.mark.parametrize("memory", list(ShearMemory))
def test_sheared_soil_holds_as_janosi_says(memory):
    """A disc of 100 kg dragged at 5 cm/s: H = W tan(phi) (1 - exp(-s / K))."""
    builder = sw.ModelBuilder()
    mass = 100.0
    turn = (math.sin(0.25 * math.pi), 0.0, 0.0, math.cos(0.25 * math.pi))
    slider = builder.add_body("slider", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((0.0, 0.0, 0.1)))
    body = builder.add_body("disc", mass=mass, inertia=(5.0, 5.0, 5.0), pose=sw.pose((0.0, 0.0, 0.1), turn))
    builder.add_joint_prismatic("along", sw.WORLD, slider, axis=(1, 0, 0), drive=sw.VelocityMotor(effort_limit=1e6))
    builder.add_joint_prismatic("up", slider, body, axis=(0, 0, 1))
    model = builder.finalize(1, "cpu")
    element = Soil(model, [SoilWheel(body=body, radius=DISC, width=0.2)], "mid", spacing=0.02, shear_memory=memory)
    simulation = sw.Simulation(model, 1e-3, elements=[element], threads=1)
    simulation.step(3000)
    simulation.control.joint_target_qd.fill_(0.05)
    for steps in (100, 200, 400, 800):
        simulation.step(steps)
        way = float(simulation.state.body_x.numpy()[0, body, 0])
        force = -float(element.force_w.numpy()[0, 0, 0])
        expected = float(element.load.numpy()[0, 0]) * math.tan(math.radians(30.0)) * (1.0 - math.exp(-way / 0.01))
        # nodes at the leading edge are new: 2 cm of 36 cm every 0.4 s
        assert force == pytest.approx(expected, rel=0.08)


def test_a_wheel_that_does_not_turn_is_held_on_a_slope():
    """Of 20 %, for a minute, once it has come to rest: the direction of shear keeps its force."""
    lean = math.atan(0.2)
    builder = sw.ModelBuilder(gravity=(GRAVITY * math.sin(lean), 0.0, -GRAVITY * math.cos(lean)))
    body = builder.add_body("w", mass=650.0, inertia=(1e6, 1e6, 1e6), pose=sw.pose((0.0, 0.0, RADIUS)))
    model = builder.finalize(1, "cpu")
    element = Soil(model, [SoilWheel(body=body, radius=RADIUS, width=WIDTH)], "mid")
    simulation = sw.Simulation(model, 2e-3, elements=[element], threads=1)
    simulation.step(10_000)  # new nodes come under its front for some 20 s, by 1 mm
    place = simulation.state.body_x.numpy()[0, 0].copy()
    simulation.step(30_000)
    assert np.linalg.norm(simulation.state.body_x.numpy()[0, 0] - place) < 3e-4


def test_worlds_are_equal_bit_by_bit_and_independent():
    runs = {}
    for worlds in (1, 2, 17):
        simulation, element = rolling(worlds, torque=600.0, pages=64)
        simulation.step(700)
        runs[worlds] = {name: getattr(simulation.state, name).numpy() for name in ARRAYS}
        assert float(element.load.numpy().min()) > 1000.0
    for worlds in (2, 17):
        for name in ARRAYS:
            for world in range(worlds):
                np.testing.assert_array_equal(runs[worlds][name][world], runs[1][name][0], err_msg=name)


def test_another_soil_in_one_world_leaves_the_others():
    plain, _ = rolling(5, torque=600.0, pages=64, per_world=True)
    other, element = rolling(5, torque=600.0, pages=64, per_world=True)
    values = element.parameter.numpy()
    values[3] = PRESETS["soft"].values()
    element.parameter.assign(values)
    for simulation in (plain, other):
        simulation.step(500)
    for name in ARRAYS:
        a, b = (getattr(simulation.state, name).numpy() for simulation in (plain, other))
        np.testing.assert_array_equal(np.delete(a, 3, axis=0), np.delete(b, 3, axis=0), err_msg=name)
    assert other.state.body_x.numpy()[3, 0, 2] < plain.state.body_x.numpy()[3, 0, 2] - 0.02


def test_a_reset_makes_fresh_soil_in_its_worlds_alone():
    simulation, element = rolling(4, torque=600.0, pages=64)
    simulation.step(400)
    first = {name: getattr(simulation.state, name).numpy().copy() for name in ARRAYS}
    simulation.reset(np.array([False, True, False, False]))
    simulation.step(400)
    again = {name: getattr(simulation.state, name).numpy() for name in ARRAYS}
    on, _ = rolling(4, torque=600.0, pages=64)
    on.step(800)
    for name in ARRAYS:
        np.testing.assert_array_equal(again[name][1], first[name][1], err_msg=name)
        np.testing.assert_array_equal(again[name][2], getattr(on.state, name).numpy()[2], err_msg=name)
    assert element.recycled.numpy().max() == 0


def test_a_snapshot_brings_the_ruts_back(tmp_path):
    simulation, _ = rolling(2, torque=600.0, pages=64)
    simulation.step(300)
    kept = simulation.snapshot()
    simulation.step(300)
    there = simulation.state.body_x.numpy().copy()
    simulation.restore(kept)
    simulation.step(300)
    np.testing.assert_array_equal(simulation.state.body_x.numpy(), there)


def test_threads_do_not_change_bits():
    a, _ = rolling(6, torque=600.0, pages=64, threads=1)
    b, _ = rolling(6, torque=600.0, pages=64, threads=3)
    for simulation in (a, b):
        simulation.step(300)
    np.testing.assert_array_equal(a.state.body_x.numpy(), b.state.body_x.numpy())


@pytest.mark.parametrize("direction", [0.5 * math.pi, math.pi, -0.5 * math.pi])
def test_a_quarter_turn_changes_nothing(direction):
    plain, _ = rolling(torque=600.0)
    turned, _ = rolling(torque=600.0, direction=direction)
    for simulation in (plain, turned):
        simulation.step(1000)
    (x, y, z), (u, v, w) = (simulation.state.body_x.numpy()[0, 0] for simulation in (plain, turned))
    cos, sin = math.cos(direction), math.sin(direction)
    assert (cos * u + sin * v, -sin * u + cos * v, w) == pytest.approx((x, y, z), abs=1e-4)


def test_used_up_pages_are_recycled_and_counted():
    simulation, element = rolling(2, torque=900.0, pages=8)
    many, _ = rolling(2, torque=900.0, pages=64)
    for each in (simulation, many):
        each.step(3000)
    assert float(simulation.state.body_x.numpy()[0, 0, 0]) > 2.0
    assert element.recycled.numpy().min() > 0
    # nothing comes back to its ruts here: what lies behind may be forgotten
    np.testing.assert_array_equal(simulation.state.body_x.numpy(), many.state.body_x.numpy())


@pytest.mark.parametrize("seed", range(4))
def test_soil_gives_no_energy(seed):
    """A wheel that is thrown about comes to rest: kinetic and potential energy never exceed what it began with."""
    rng = np.random.default_rng(seed)
    simulation, _ = rolling(1, soil=("soft", "mid", "hard", "mid")[seed], speed=float(rng.uniform(-2.0, 2.0)), dt=2e-3)
    state = simulation.state
    state.body_omega.assign(rng.normal(size=(1, 1, 3)).astype(np.float32))
    simulation.measure()

    def energy() -> float:
        v, omega = state.body_v.numpy()[0, 0], state.body_omega.numpy()[0, 0]
        spin = omega @ np.diag((20.0, 30.0, 20.0)) @ omega  # the wheel hardly leans
        return 0.5 * 650.0 * float(v @ v) + 0.5 * float(spin) + 650.0 * GRAVITY * float(state.body_x.numpy()[0, 0, 2])

    start = energy()
    most = start
    for _ in range(100):
        simulation.step(10)
        most = max(most, energy())
    lift = 650.0 * GRAVITY * RADIUS
    assert most - start < 0.02 * (abs(start - lift) + 100.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda m: SoilSpec(k_phi=0.0), "k_phi must be positive"),
        (lambda m: SoilSpec(k_phi=1e6, exponent=2.5), "exponent must be in [0.2, 2], got 2.5"),
        (lambda m: SoilSpec(k_phi=1e6, friction_angle=30.0), "friction_angle must be within ±1.047 rad"),
        (lambda m: SoilSpec(k_phi=1e6, cohesion=-1.0), "cohesion must be zero or positive, got -1.0; give 0 for none"),
        (lambda m: SoilSpec(k_phi=1e9), "elastic must be at least k_phi n z"),
        (lambda m: SoilSpec(k_phi=math.nan), "k_phi must be a finite number, got nan"),
        (lambda m: Soil(m, [SoilWheel(body=0, radius=0.4, width=0.2)], spacing=0.11), "spacing must be positive"),
        (lambda m: Soil(m, [], "mid"), "shapes must be at least one"),
        (lambda m: Soil(m, [SoilWheel(body=0, radius=0.4, width=0.2)], "mud"), "preset must be soft, mid, hard, clay"),
        (lambda m: Soil(m, [SoilWheel(body=0, radius=0.4, width=0.2)], pages=1), "pages"),
        (lambda m: Soil(m, [SoilWheel(body="x", radius=0.4, width=0.2)]), "'x'"),
        (lambda m: Soil(m, [SoilWheel(body=1, radius=0.4, width=WIDTH)]), "must be an integer >= 0 and <= 0, got 1"),
        (lambda m: Soil(m, [SoilBox(body=0, half=(0.1, 0.0, 0.1))]), "SoilBox: half must be"),
        (lambda m: Soil(m, [SoilSphere(body=0, radius=0.04)]), "half the narrowest shape's width, 0.04 m, got 0.05"),
        (lambda m: Soil(m, [SoilBox(body=0, half=(2.0, 1.0, 0.1))], pages=50), "pages must be an integer >= 169"),
        (lambda m: Soil(m, [m]), "shapes must be of SoilWheel, SoilBox"),
        (lambda m: Soil(m, [SoilWheel(body=0, radius=0.4, width=0.2)], soil_map=[[0, 3]]), "indices below 1, got 3"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line(make, message):
    builder = sw.ModelBuilder()
    builder.add_body("b", mass=1.0, inertia=(1.0, 1.0, 1.0))
    model = builder.finalize(1, "cpu")
    with pytest.raises(sw.ModelError) as found:
        make(model)
    assert message in str(found.value)
    assert "\n" not in str(found.value)


def test_a_wheel_may_fly_lie_and_fall():
    """Lifted, upside down, dropped from 2 m, on its side: finite, and in the ground at the end."""
    turns = ((0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0), (0.7071068, 0.0, 0.0, 0.7071068), (0.5, 0.5, 0.5, 0.5))
    for turn in turns:
        builder = sw.ModelBuilder()
        body = builder.add_body("w", mass=50.0, inertia=(2.0, 3.0, 2.0), pose=sw.pose((0.0, 0.0, 2.5), turn))
        model = builder.finalize(1, "cpu")
        element = Soil(model, [SoilWheel(body=body, radius=RADIUS, width=WIDTH)], "mid")
        simulation = sw.Simulation(model, 2e-3, elements=[element], threads=1)
        simulation.step(1500)
        x, v = simulation.state.body_x.numpy()[0, 0], simulation.state.body_v.numpy()[0, 0]
        assert np.isfinite(x).all()
        assert 0.0 < x[2] < 0.6
        assert np.abs(v).max() < 0.3


def test_a_world_that_flies_off_or_breaks_down_does_not_hold_up_the_others():
    """Its footprint was as long as its way in a step: a billion nodes at 1e6 m/s."""
    simulation, _ = rolling(4, pages=64)
    plain, _ = rolling(4, pages=64)
    v, x, q = (getattr(simulation.state, name).numpy() for name in ("body_v", "body_x", "body_rot"))
    v[0] = (1e6, 1e6, -1e6)
    x[1, 0, 0] = 1e12
    q[2] = np.nan
    for array, values in zip(("body_v", "body_x", "body_rot"), (v, x, q), strict=True):
        getattr(simulation.state, array).assign(values)
    for each in (simulation, plain):
        each.step(200)
    np.testing.assert_array_equal(simulation.state.body_x.numpy()[3], plain.state.body_x.numpy()[3])


@pytest.mark.parametrize("place", [(1e5, -2e5), (-1e6, 1e6)])
def test_soil_far_from_the_origin_is_that_at_the_origin(place):
    near, _ = pressed("mid", load=6300.0)
    far, _ = pressed("mid", load=6300.0, place=(place[0] + 0.003, place[1] + 0.001))
    # places are known to 1e-10 m there, spacing to 1e-9 of itself: nodes may be shifted by a millimetre
    assert sinkage(far, RADIUS) == pytest.approx(sinkage(near, RADIUS), rel=0.02)
