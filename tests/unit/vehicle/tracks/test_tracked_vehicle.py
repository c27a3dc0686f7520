"""Tracked vehicles at work: engine and drivelines against closed forms, steering, brakes, worlds, snapshots, errors."""

import dataclasses

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.vehicle import (
    TRACK_SOLVER,
    ScriptedDriver,
    ScriptSpec,
    SprocketContact,
    TrackedVehicle,
    add_tracked_vehicle,
    load_tracked_vehicle,
    per_world,
    place_vehicle,
    with_belts,
)
from simwarp.vehicle.spec.drivetrain_parts import EngineSimple
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.track_parts import SimpleTrackDriveline

SPEC = load_tracked_vehicle("m113")
SIMPLE = dataclasses.replace(SPEC, driveline=SimpleTrackDriveline())
LEGACY = dataclasses.replace(SPEC, driveline=SimpleTrackDriveline(legacy=True))


def simulation(spec=SPEC, worlds=1, driver=None, **options):
    builder = sw.ModelBuilder()
    parts = add_tracked_vehicle(builder, spec, **options)
    builder.add_shape_plane(material=sw.Material(friction=0.9))
    model = builder.finalize(worlds, "cpu", per_world=per_world(), contact_capacity=250)
    vehicle = TrackedVehicle(parts, model)
    elements = [vehicle] if driver is None else [ScriptedDriver(vehicle, driver), vehicle]
    solver = dataclasses.replace(TRACK_SOLVER, max_iterations=30)
    return sw.Simulation(model, 1e-3, elements=elements, solver=solver, check_start=False), vehicle


def drive(vehicle, *, steering=0.0, throttle=0.0, braking=0.0, world=slice(None)):
    rows = vehicle.input.numpy().copy()
    rows[world] = (steering, throttle, braking, 0.0)
    vehicle.input.assign(rows)


def sprocket_torques(sim, vehicle, spec):
    """What the driveline gives to each sprocket: half by the gears' coupling, the rest by the element."""
    starts = sim.model.joint_dof_start
    added = sim.control.element_joint_force.numpy()[0]
    half = 0.5 * float(vehicle.drive_torque.numpy()[0]) * (-1.0 if spec.driveline.legacy else 1.0)
    return [half + float(added[starts[side.sprocket]]) for side in (vehicle.parts.left, vehicle.parts.right)]


def test_a_converter_that_stays_at_stall_gives_the_torque_of_its_balance():
    """Engine torque - losses = (speed / K)², times the ratio of stall and that of the first gear: 163 rad/s, 540.7 N·m
    and 4506 N·m as the recorded vehicle had them for ever, since its transmission sees it drive backwards."""
    sim, vehicle = simulation(LEGACY)
    drive(vehicle, throttle=1.0)
    sim.step(600)
    assert vehicle.engine_speed.numpy()[0] == pytest.approx(162.8, abs=0.5)
    assert vehicle.engine_torque.numpy()[0] == pytest.approx(540.7, abs=0.5)
    drawn = []
    for _ in range(40):
        sim.step(5)
        drawn.append((vehicle.drive_torque.numpy()[0], *sprocket_torques(sim, vehicle, LEGACY)))
    total, left, right = np.mean(drawn, axis=0)
    # less what the shaft between takes while the vehicle gathers speed: 0.3 / 0.24² kg·m² times some 8 rad/s², 1 %
    assert total == pytest.approx(4506.0, rel=0.03)
    assert left == pytest.approx(0.5 * total)
    assert right == pytest.approx(0.5 * total)
    assert vehicle.velocity_b.numpy()[0, 0] > 0.3


@pytest.mark.parametrize("legacy", [False, True])
def test_a_sprocket_that_has_lost_its_grip_does_not_run_away(legacy):
    """Nobody gives it a torque: shafts with a negative inertia reach 1e6 rad/s in 0.1 s."""
    spec = LEGACY if legacy else SIMPLE
    left, right = (
        dataclasses.replace(track, sprocket=dataclasses.replace(track.sprocket, friction=0.0))
        for track in (spec.left, spec.right)
    )
    sim, vehicle = simulation(dataclasses.replace(spec, left=left, right=right), sprocket=SprocketContact.DRUM)
    sim.step(100)
    assert np.abs(vehicle.sprocket_speed.numpy()).max() < 1.0


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize(("steering", "gyration", "left", "right"), [
    (0.0, 0, 1.0, 1.0), (0.5, 0, 0.5, 1.0), (-1.0, 0, 1.0, 0.0), (1.0, 1, -1.0, 1.0), (-0.25, 1, 1.0, 0.5),
])  # fmt: skip
def test_steering_takes_torque_from_the_inner_side(legacy, steering, gyration, left, right):
    spec = dataclasses.replace(SPEC, driveline=SimpleTrackDriveline(legacy=legacy, gyration=bool(gyration)))
    sim, vehicle = simulation(spec)
    assert vehicle.gyration.numpy()[0] == gyration
    drive(vehicle, throttle=1.0, steering=steering)
    sim.step(30)
    half = 0.5 * float(vehicle.drive_torque.numpy()[0])
    assert abs(half) > 10.0
    assert sprocket_torques(sim, vehicle, spec) == pytest.approx([left * half, right * half], abs=1e-3 * abs(half))


def test_a_braked_differential_steers_by_the_inner_brake_and_a_brake_holds_both():
    sim, vehicle = simulation()
    assert SPEC.left.brake is not None
    most = SPEC.left.brake.max_torque
    dofs = [sim.model.joint_dof_start[side.sprocket] for side in (vehicle.parts.left, vehicle.parts.right)]
    for steering, braking, left, right in (
        (0.5, 0.0, 0.5, 0.0), (-0.25, 0.0, 0.0, 0.25), (1.0, 0.5, 1.5, 0.5), (0.0, 1.0, 1.0, 1.0),
    ):  # fmt: skip
        drive(vehicle, steering=steering, braking=braking)
        sim.step()
        friction = sim.model.joint_friction.numpy()[0, dofs]
        np.testing.assert_allclose(friction, [left * most, right * most])
    sim.step(500)
    np.testing.assert_allclose(vehicle.sprocket_speed.numpy(), 0.0, atol=1e-2)  # held, but for the solver's residual


def test_readings_are_those_of_the_joints():
    sim, vehicle = simulation()
    drive(vehicle, throttle=0.5)
    sim.step(200)
    for k, (side, track) in enumerate(((vehicle.parts.left, SPEC.left), (vehicle.parts.right, SPEC.right))):
        dof = sim.model.joint_dof_start[side.tensioner]
        q, rate = sim.state.joint_q.numpy()[0, dof], sim.state.joint_qd.numpy()[0, dof]
        tensioner = track.idler.tensioner
        force = tensioner.force + tensioner.stiffness * q + tensioner.damping * rate  # shorter when forwards
        assert vehicle.tension.numpy()[0, k] == pytest.approx(0.5 * force, rel=1e-5)
        speed = sim.state.joint_qd.numpy()[0, sim.model.joint_dof_start[side.sprocket]]
        assert vehicle.sprocket_speed.numpy()[0, k] == speed
    x, reference = sim.body_position("chassis"), vehicle.parts.reference
    assert np.linalg.norm(vehicle.position.numpy()[0] - x) == pytest.approx(np.linalg.norm(reference), rel=1e-6)


def test_a_world_does_not_matter_to_the_others():
    sim, vehicle = simulation(worlds=3)
    alone, single = simulation()
    for each in (vehicle, single):
        drive(each, throttle=0.7, steering=0.2)
    drive(vehicle, throttle=0.1, steering=-1.0, braking=1.0, world=1)
    for each in (sim, alone):
        each.step(60)
    for world in (0, 2):
        np.testing.assert_array_equal(sim.state.body_x.numpy()[world], alone.state.body_x.numpy()[0])
    assert not np.array_equal(sim.state.body_x.numpy()[1], alone.state.body_x.numpy()[0])


def test_a_snapshot_goes_on_and_a_reset_starts_again():
    sim, vehicle = simulation(SIMPLE)
    drive(vehicle, throttle=0.8)
    vehicle.gyration.fill_(1)
    sim.step(40)
    kept = sim.snapshot()
    sim.step(20)
    first = sim.state.body_x.numpy().copy()
    sim.restore(kept)
    sim.step(20)
    np.testing.assert_array_equal(sim.state.body_x.numpy(), first)
    sim.reset()
    assert not vehicle.input.numpy().any()
    assert not vehicle.gyration.numpy().any()
    assert vehicle.engine_speed.numpy()[0] == 0.0


def test_a_driver_measures_its_speed():
    """A pedal of 0.5 per error, at the speed of the vehicle's frame of reference one step before."""
    script = ScriptSpec(speed=((0.0, 2.5),), integral=0.0)
    sim, vehicle = simulation(SIMPLE, driver=script)
    sim.step(400)
    speed = vehicle.velocity_b.numpy()[0, 0].copy()
    sim.step()
    throttle = vehicle.input.numpy()[0, 1]
    assert 0.1 < speed < 2.5
    assert throttle == pytest.approx(min(0.5 * (2.5 - speed), 1.0), abs=1e-6)


def test_it_is_placed_as_one_whole():
    sim, vehicle = simulation(worlds=2)
    drive(vehicle, throttle=1.0)
    sim.step(100)
    before = sim.state.body_x.numpy().copy()
    place_vehicle(sim, vehicle, [[3.0, -2.0], [0.0, 40.0]], heading=1.0)
    np.testing.assert_allclose(vehicle.position.numpy()[:, :2], [[3.0, -2.0], [0.0, 40.0]], atol=1e-6)
    np.testing.assert_allclose(vehicle.angles.numpy()[:, 2], 1.0, atol=1e-6)
    after = sim.state.body_x.numpy()
    bodies = vehicle.bodies.numpy()
    for world in range(2):
        apart = [np.linalg.norm(x[world, bodies[1:]] - x[world, bodies[0]], axis=1) for x in (before, after)]
        np.testing.assert_allclose(apart[0], apart[1], rtol=1e-12)
    sim.step(100)
    assert sim.diagnostics.position_error.numpy().max() < 1e-4


def test_shoes_with_two_pins_make_a_vehicle():
    """As many connectors as shoes; the recorded one weighs 11 850.9 kg, and its chains hold through the release."""
    spec = load_tracked_vehicle("m113-double-pin")
    sim, vehicle = simulation(spec)
    builder = sim.model.builder
    assert sum(body.mass for body in builder.bodies) == pytest.approx(11850.9, abs=0.05)
    assert len(builder.bodies) == 1 + 2 * 13 + 2 * (63 + 64)
    assert [len(side.pins) for side in vehicle.parts.chains] == [126, 128]
    sim.step(300)
    assert sim.diagnostics.position_error.numpy().max() < 1e-4
    assert (vehicle.tension.numpy() > 3e4).all()
    drive(vehicle, throttle=1.0)
    sim.step(200)
    assert (vehicle.sprocket_speed.numpy() > 0.3).all()


def test_one_description_makes_chains_or_belts():
    """The same driveline, inputs and readings; a belt has neither shoes nor pins."""
    sim, vehicle = simulation(with_belts(SPEC))
    assert vehicle.belts is not None
    assert len(vehicle.parts.belts) == 2
    assert not vehicle.parts.chains
    assert len(sim.model.builder.bodies) == 11
    assert load_tracked_vehicle("m113-belt") == with_belts(SPEC)
    drive(vehicle, throttle=1.0)
    sim.step(700)
    assert vehicle.velocity_b.numpy()[0, 0] > 0.5
    np.testing.assert_allclose(vehicle.tension.numpy(), vehicle.belts.tension.numpy())
    kept, speed = sim.snapshot(), vehicle.velocity_b.numpy().copy()
    sim.step(50)
    after = sim.state.body_x.numpy().copy()
    sim.restore(kept)
    np.testing.assert_array_equal(vehicle.velocity_b.numpy()[:, 0], speed[:, 0])
    sim.step(50)
    np.testing.assert_array_equal(sim.state.body_x.numpy(), after)
    drive(vehicle, braking=1.0)
    sim.step(1500)
    np.testing.assert_allclose(vehicle.sprocket_speed.numpy(), 0.0, atol=1e-2)


def test_what_cannot_be_driven_is_refused():
    builder = sw.ModelBuilder()
    parts = add_tracked_vehicle(builder, SPEC)
    shared = builder.finalize(2, "cpu")
    with pytest.raises(ModelError, match="every world needs its own joint_friction, but the model shares it"):
        TrackedVehicle(parts, shared)
    builder = sw.ModelBuilder()
    parts = add_tracked_vehicle(builder, SPEC, hull_fixed=True)
    with pytest.raises(ModelError, match="the hull is fixed; build it with hull_fixed=False"):
        TrackedVehicle(parts, builder.finalize(1, "cpu", per_world=per_world()))
    builder = sw.ModelBuilder()
    parts = add_tracked_vehicle(builder, SPEC)
    model = builder.finalize(1, "cpu", per_world=per_world())
    with pytest.raises(ModelError, match="soil is that of belts, and 'M113' has chains"):
        TrackedVehicle(parts, model, soil="mid")
    with pytest.raises(SpecError, match=r"right\.track: must be 'shoes' as that of the left one, got 'belt'"):
        dataclasses.replace(SPEC, right=with_belts(SPEC).right)
    with pytest.raises(SpecError, match="hull_fixed: must be False for belts"):
        add_tracked_vehicle(sw.ModelBuilder(), with_belts(SPEC), hull_fixed=True)
    with pytest.raises(SpecError, match="transmission: must be given together with an engine"):
        dataclasses.replace(SPEC, engine=None)
    with pytest.raises(SpecError, match="driveline: must be given for an engine to drive"):
        dataclasses.replace(SPEC, engine=EngineSimple(max_torque=1.0, max_power=1.0, max_speed=1.0), driveline=None)
