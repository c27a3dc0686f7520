"""Laws of vehicles on belts: momentum, energy, worlds, symmetry, standing still; and statics, starts and steps as
recorded of the same vehicle shoe by shoe."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.vehicle import BeltParameter
from tests.unit.vehicle.tracks.belt_vehicles import (
    GRAVITY,
    arm_angles,
    drive,
    mass_of,
    pitch,
    reference_point,
    undamped,
    vehicle,
)

ROUNDING = 6e-7
"""Of a velocity of 10 m/s in float32."""


def high(**options):
    """Far above the ground, without gravity."""
    return vehicle(gravity=(0.0, 0.0, 0.0), at=sw.pose((0.0, 0.0, 50.0)), **options)


def masses(sim):
    return np.array([body.mass for body in sim.model.builder.bodies])


def momentum(sim):
    """Linear [kg·m/s], and angular about the origin of the chassis' start [kg·m²/s], of all bodies."""
    state, mass = sim.state, masses(sim)
    x, v, w = (getattr(state, name).numpy()[0].astype(float) for name in ("body_x", "body_v", "body_omega"))
    turned = [matrix_of(q) for q in state.body_rot.numpy()[0]]
    inertia = sim.model.body_inertia_b.numpy()[0].astype(float)
    spin = sum(r @ i @ r.T @ omega for r, i, omega in zip(turned, inertia, w, strict=True))
    return mass @ v, np.cross(x - (0.0, 0.0, 50.0), mass[:, None] * v).sum(axis=0) + spin


def kinetic(sim):
    state = sim.state
    v, w = (getattr(state, name).numpy()[0].astype(float) for name in ("body_v", "body_omega"))
    turned = [matrix_of(q) for q in state.body_rot.numpy()[0]]
    inertia = sim.model.body_inertia_b.numpy()[0].astype(float)
    spin = sum(omega @ r @ i @ r.T @ omega for r, i, omega in zip(turned, inertia, w, strict=True))
    return 0.5 * (masses(sim) @ np.sum(v * v, axis=1) + spin)


def test_tension_makes_no_momentum():
    """Tension, torsion bars and tensioners pull arms about by some m/s, and the whole does not move."""
    sim, _, _ = high()
    for _ in range(10):
        sim.step(10)
        linear, angular = momentum(sim)
        assert np.linalg.norm(linear) < mass_of(sim) * 100 * ROUNDING
        assert np.linalg.norm(angular) < 2.0 * mass_of(sim) * 100 * ROUNDING  # at two metres
    sim, parts, _ = high()
    sim.step(20)
    assert np.abs(arm_angles(sim, parts.left)).max() > 0.05, "something moves"


def stored(sim, parts, belts):
    """Energy of torsion bars, tensioners and belts [J]."""
    total = 0.0
    for belt, side in enumerate((parts.left, parts.right)):
        track = side.spec
        for angle, mount in zip(arm_angles(sim, side), track.road_wheels, strict=True):
            bar = mount.suspension
            total += 0.5 * bar.stiffness * angle**2 - bar.preload * angle
        tensioner, x = track.idler.tensioner, float(belts.idler.numpy()[0, belt])
        total += tensioner.force * x + 0.5 * tensioner.stiffness * x**2
        total += 0.5 * side.resting.stretch * float(belts.tension.numpy()[0, belt]) ** 2
    return total


def test_energy_stays_without_dampers():
    """Arms swing on torsion bars and the belt's tension, 11 kJ to and fro. What implicit springs take is of the first
    order in the step; extrapolated to none, a hundredth is left for terms of the second order."""
    balances, most = [], 0.0
    for dt in (2e-4, 1e-4):
        sim, parts, belts = high(track=undamped, dt=dt)
        sim.step()
        start, found = kinetic(sim) + stored(sim, parts, belts), []
        for _ in range(20):
            sim.step(round(0.01 / dt))
            most = max(most, kinetic(sim))
            found.append(kinetic(sim) + stored(sim, parts, belts) - start)
        balances.append(np.array(found))
    assert most > 5e3
    assert max(balance.max() for balance in balances) < 1e-4 * most, "it never grows"
    assert np.abs(2.0 * balances[1] - balances[0]).max() < 0.01 * most


def test_a_drop_comes_to_rest():
    """From 10 cm above its place at rest, on the ground, with all of its dampers: nothing feeds a motion."""
    sim, _parts, belts = vehicle(at=sw.pose((0.0, 0.0, 0.8)))
    sim.step(500)
    peaks = []
    for _ in range(6):
        peak = 0.0
        for _ in range(100):
            sim.step(20)
            peak = max(peak, kinetic(sim))
        peaks.append(peak)
    assert all(after < 0.7 * before for before, after in itertools.pairwise(peaks))
    assert peaks[-1] < 1.0
    weight = mass_of(sim) * GRAVITY
    assert belts.force.numpy()[0, :, 2].sum() == pytest.approx(weight, rel=1e-3)
    np.testing.assert_allclose(belts.load.numpy().sum(), weight, rtol=5e-3)  # but for what lies on sprocket and idler
    np.testing.assert_allclose(belts.point_force.numpy()[0].sum(axis=1), belts.force.numpy()[0], rtol=1e-4, atol=1.0)


def test_worlds_do_not_matter_to_each_other_and_runs_repeat():
    alone, three, again = (vehicle(worlds=worlds) for worlds in (1, 3, 1))
    for sim, parts, _ in (alone, three, again):
        drive(sim, parts, 2000.0, 500.0)
        sim.step(300)
    first = alone[0].state.body_x.numpy()[0]
    for world in range(3):
        np.testing.assert_array_equal(three[0].state.body_x.numpy()[world], first)
    np.testing.assert_array_equal(again[0].state.body_x.numpy()[0], first)
    np.testing.assert_array_equal(again[2].point_force.numpy(), alone[2].point_force.numpy())


def test_a_reset_and_a_snapshot_bring_everything_back():
    sim, _parts, _ = vehicle(soil="soft")
    sim.step(200)
    first = sim.state.body_x.numpy().copy()
    kept = sim.snapshot()
    sim.step(200)
    later = sim.state.body_x.numpy().copy()
    sim.restore(kept)
    sim.step(200)
    np.testing.assert_array_equal(sim.state.body_x.numpy(), later)
    sim.reset()
    sim.step(200)
    np.testing.assert_array_equal(sim.state.body_x.numpy(), first)


def test_a_symmetric_vehicle_goes_straight():
    """With the left track on both sides nothing turns it but rounding: 1e-7 of 10 kN at a lever of 1 m, on 28 t m²."""
    sim, parts, belts = vehicle(symmetric=True)
    sim.step(500)
    drive(sim, parts, 2253.0, 2253.0)
    sim.step(2000)
    assert sim.body_velocity("chassis")[0] > 1.5
    assert abs(sim.body_position("chassis")[1]) < 1e-4
    assert abs(sim.body_rotation("chassis")[2]) < 1e-4
    force = belts.force.numpy()[0]
    np.testing.assert_allclose(force[0, [0, 2]], force[1, [0, 2]], rtol=1e-3)


def test_power_goes_into_motion_losses_and_sliding():
    """Of 5 kW from the sprockets: what does not become kinetic energy is lost in the belt, the pads and the arms, and
    in sliding by a shear length over the length of the contact, 5 mm of 2 m."""
    sim, parts, belts = vehicle(symmetric=True)
    sim.step(4000)
    drive(sim, parts, 2253.0, 2253.0)
    builder = sim.model.builder
    shafts = [builder.dof_start(side.sprocket) for side in (parts.left, parts.right)]
    inertia = [builder.joints[side.sprocket].inertia for side in (parts.left, parts.right)]
    sim.step(500)

    def moving():
        qd = sim.state.joint_qd.numpy()[0, shafts].astype(float)
        return kinetic(sim) + 0.5 * float(np.sum(inertia * qd**2))

    start, work, lost = moving(), 0.0, 0.0
    for _ in range(500):
        sim.step(2)
        qd = sim.state.joint_qd.numpy()[0, shafts].astype(float)
        work += 2e-3 * float(np.sum(2253.0 * qd))
        lost -= 2e-3 * float(np.sum(belts.resistance.numpy() * belts.speed.numpy()))
    rest = work - lost - (moving() - start)
    assert work > 1e4
    assert lost > 0.0
    assert abs(rest) < 0.03 * work


def slope(angle):
    """Gravity on a vehicle that stands on a plane that rises ahead by an angle [rad]."""
    return (-GRAVITY * math.sin(angle), 0.0, -GRAVITY * math.cos(angle))


BRAKED = {"dry_loss": 5.0}
"""Belts that hold up to five times their tension."""


@pytest.mark.parametrize("across", [False, True])
def test_it_stands_on_a_slope_without_creeping(across):
    """Up to the angle of friction, atan 0.8 = 38.7 degrees; with its belts held. Along the slope, and across it."""
    gravity = slope(math.radians(32.0))
    if across:
        gravity = (0.0, gravity[0], gravity[2])
    sim, _parts, _ = vehicle(gravity=gravity, law=BRAKED)
    sim.step(20000)  # its pitching, hardly damped, is over
    there = sim.body_position("chassis").copy()
    sim.step(4000)
    moved = sim.body_position("chassis") - there
    assert np.abs(moved).max() < 1e-4, "what is left of the pitching"


def test_it_slides_down_a_steeper_slope():
    """With g (sin a - mu cos a)."""
    angle = math.radians(45.0)
    sim, _parts, _ = vehicle(gravity=slope(angle), law=BRAKED)
    sim.step(3000)
    before = float(sim.body_velocity("chassis")[0])
    sim.step(1000)
    gained = float(sim.body_velocity("chassis")[0]) - before
    assert gained == pytest.approx(-GRAVITY * (math.sin(angle) - 0.8 * math.cos(angle)), rel=0.03)


def test_a_leaning_plane_is_a_leaning_pull():
    """Down a plane that leans by 45 degrees, as on a level one with gravity that leans: the same way along it, but for
    sums of float32 in other axes and a start that drops a little differently."""
    angle = math.radians(45.0)
    half = -0.5 * angle
    turn = np.array([0.0, math.sin(half), 0.0, math.cos(half)])
    found = []
    for leans in (False, True):
        at, options = sw.pose((0.0, 0.0, 0.62)), {"gravity": slope(angle)}
        if leans:
            place = matrix_of(turn) @ np.array([0.0, 0.0, 0.62])
            at, options = sw.pose(place, turn), {"ground": sw.vehicle.ground("cpu", rotation=turn)}
        sim, parts, _ = vehicle(at=at, law=BRAKED, **options)
        sim.step(1500)
        point = reference_point(sim, parts)
        found.append(matrix_of(turn).T @ point if leans else point)
    assert found[0][0] < -1.0
    np.testing.assert_allclose(found[1], found[0], atol=0.01)


def test_worlds_of_their_own():
    """Friction of the ground by world, and of the belt: the lesser one counts."""
    sim, parts, belts = vehicle(worlds=3, gravity=slope(math.radians(45.0)), law=BRAKED, randomised=True)
    belts.ground_friction[1] = 0.3
    belts.parameter[2, :, BeltParameter.FRICTION] = 0.5
    sim.step(3000)  # its pitching changes what it gains by some percent
    before = sim.state.body_v.numpy()[:, parts.chassis, 0].copy()
    sim.step(1000)
    gained = sim.state.body_v.numpy()[:, parts.chassis, 0] - before
    for world, friction in enumerate((0.8, 0.3, 0.5)):
        assert gained[world] == pytest.approx(-GRAVITY * math.sqrt(0.5) * (1.0 - friction), rel=0.05)


def test_two_milliseconds_are_short_enough():
    """The same place at rest as with 1 ms, and the same speed, within a hundredth."""
    found = []
    for dt in (1e-3, 2e-3):
        sim, parts, _ = vehicle(dt=dt)
        sim.step(round(4.0 / dt))
        rest = reference_point(sim, parts)[2], pitch(sim)
        drive(sim, parts, 2253.0, 2253.0)
        sim.step(round(2.0 / dt))
        found.append((*rest, float(sim.body_velocity("chassis")[0])))
    np.testing.assert_allclose(found[1], found[0], rtol=0.01, atol=1e-3)


@pytest.mark.parametrize("preset", ["soft", "clay", "snow", "hard"])
def test_rear_wheels_run_in_the_ruts_of_those_in_front(preset):
    """The last wheel finds soil sunk by all before it, though it hardly carries anything; a pitching vehicle presses a
    little less there than at the deepest point. Without torque, the soil brings it to a stop."""
    sim, parts, belts = vehicle(soil=preset, law={"width": 0.38})
    sim.step(3000)
    drive(sim, parts, 2253.0, 2253.0)
    sim.step(3000)
    before = float(sim.body_velocity("chassis")[0])
    assert before > 0.3
    sinkage, load = belts.memory["sinkage"].numpy()[0], belts.load.numpy()[0]
    wheels = belts._tables.kind.numpy()[0] == 1
    assert sinkage.max() > 0.002
    assert np.all(sinkage[:, wheels][:, -1] > 0.8 * sinkage.max(axis=1))
    assert np.all(load[:, -1] < load.max(axis=1))
    drive(sim, parts, 0.0, 0.0)
    sim.step(4000)
    assert abs(sim.body_velocity("chassis")[0]) < 0.7 * before


def test_it_stands_as_recorded():
    """Project Chrono, shoe by shoe with penalty contacts, 10 s at rest. The belt has no shoes that wedge between wheels
    and sprocket: arms next to them and the tension of the tighter side differ most."""
    sim, parts, belts = vehicle()
    sim.step(10000)
    assert reference_point(sim, parts)[2] == pytest.approx(0.5932, abs=0.005)
    assert pitch(sim) == pytest.approx(0.0104, abs=0.005)
    np.testing.assert_allclose(belts.tension.numpy()[0], (91.0e3, 66.4e3), rtol=0.12)
    np.testing.assert_allclose(-3.95 + belts.idler.numpy()[0], (-4.0391, -4.0860), atol=0.02)
    for name, arms in (
        ("left", (0.000, -0.172, -0.206, -0.225, -0.182)), ("right", (-0.088, -0.209, -0.228, -0.254, -0.227)),
    ):  # fmt: skip
        np.testing.assert_allclose(arm_angles(sim, getattr(parts, name)), arms, atol=0.05)


def half_round(builder):
    """A half round of 0.2 m across the way, 5 m ahead."""
    x = np.linspace(-10.0, 30.0, 801)
    heights = np.tile(np.sqrt(np.clip(0.04 - (x - 5.0) ** 2, 0.0, None)), (3, 1))
    builder.add_shape_height_field(sw.WORLD, heights, size=(40.0, 8.0), pose=sw.pose((10.0, 0.0, 0.0)), name="ground")
    return "ground"


def test_it_climbs_over_a_half_round_as_recorded():
    """At 2 m/s with the same speed control: the recorded run pitched from -0.125 to 0.181 rad, and its reference point
    rose and fell from 0.347 to 0.997 m. A tenth of the swing."""
    sim, parts, _ = vehicle(terrain=half_round)
    sim.step(3000)
    integral, pitches, heights = 0.0, [], []
    for _ in range(800):
        error = 2.0 - float(sim.body_velocity("chassis")[0])
        throttle = 0.5 * error + 0.1 * integral
        integral += 0.01 * error if abs(throttle) < 1.0 else 0.0
        torque = 2253.0 * min(max(throttle, 0.0), 1.0)
        drive(sim, parts, torque, torque)
        sim.step(10)
        pitches.append(pitch(sim))
        heights.append(reference_point(sim, parts)[2])
    assert reference_point(sim, parts)[0] > 9.0, "it is over"
    assert min(pitches) == pytest.approx(-0.125, abs=0.03)
    assert max(pitches) == pytest.approx(0.181, abs=0.03)
    assert max(heights) == pytest.approx(0.997, abs=0.065)
    assert min(heights) == pytest.approx(0.347, abs=0.065)


def rough(builder):
    """Ground of random heights of 0.3 m and less, 0.3 m apart, around a level start."""
    heights = np.random.default_rng(1).uniform(-0.3, 0.3, (401, 401))
    heights[180:220, 180:220] = 0.0
    builder.add_shape_height_field(sw.WORLD, heights, size=(120.0, 120.0), name="ground")
    return "ground"


@pytest.mark.parametrize("soil", [None, "clay"])
def test_rough_ground_and_any_torques(soil):
    """Nothing flies or tumbles: 12 kN·m a sprocket, more than drives there and less than turns it over."""
    rng = np.random.default_rng(2)
    sim, parts, belts = vehicle(worlds=4, terrain=rough, soil=soil)
    shafts = [sim.model.builder.dof_start(side.sprocket) for side in (parts.left, parts.right)]
    force = np.zeros_like(sim.control.joint_force.numpy())
    for _ in range(12):
        force[:, shafts] = rng.uniform(-9000.0, 12000.0, (4, 2))
        sim.control.joint_force.assign(force)
        sim.step(500)
        assert np.linalg.norm(sim.state.body_v.numpy()[:, parts.chassis], axis=1).max() < 15.0
        assert sim.state.body_x.numpy()[:, parts.chassis, 2].max() < 2.0
        turned = sim.state.body_rot.numpy()[:, parts.chassis]
        assert np.min(1.0 - 2.0 * (turned[:, 0] ** 2 + turned[:, 1] ** 2)) > 0.8, "upright"
        assert np.isfinite(belts.point_force.numpy()).all()


def test_a_slack_belt_pulls_nowhere():
    """A tensioner that pushes with nothing: the wheels carry the vehicle alone."""

    def slack(side):
        tensioner = dataclasses.replace(side.idler.tensioner, preload=-2.25e5, stiffness=1.0e6, damping=0.0)
        return dataclasses.replace(side, idler=dataclasses.replace(side.idler, tensioner=tensioner))

    with pytest.raises(sw.vehicle.SpecError, match="must be tightened by its tensioner"):
        vehicle(track=slack)
    sim, _parts, belts = vehicle()
    belts.parameter[:, :, BeltParameter.TENSIONER_FORCE] = 0.0
    belts.parameter[:, :, BeltParameter.TENSIONER_STIFFNESS] = 1.0
    sim.step(4000)
    assert belts.tension.numpy().max() < 10.0
    assert belts.force.numpy()[0, :, 2].sum() == pytest.approx(mass_of(sim) * GRAVITY, rel=1e-2)
    assert np.isfinite(sim.state.body_x.numpy()).all()


def test_behind_elements_that_drive_it_adds():
    """Belts that are not alone leave what others wrote to chassis and shafts."""
    sim, parts, belts = vehicle()
    belts._tables.add = 1
    sim.control.element_force.fill_(100.0)
    sim.control.element_joint_force.fill_(7.0)
    launches = belts.record(sim, sim.dt)
    for launch in launches:
        launch.launch()
    force = sim.control.element_force.numpy()[0, parts.chassis]
    np.testing.assert_allclose(force, 100.0 + belts.force.numpy()[0].sum(axis=0), rtol=1e-5)
    dof = sim.model.builder.dof_start(parts.left.sprocket)
    radius = belts.parameter.numpy()[0, 0, BeltParameter.PITCH_RADIUS]
    own = radius * (belts.resistance.numpy() - belts.traction.numpy())[0, 0]
    assert sim.control.element_joint_force.numpy()[0, dof] == pytest.approx(7.0 + own, rel=1e-5)
