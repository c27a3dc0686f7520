"""Whole manoeuvres: pass speeds, worlds of a batch, gradients of the bicycle, stops, hills and roads."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from simwarp.vehicle.assessment.maneuver_variants import drive_variants, highest_passed, outcomes, set_up_variants
from simwarp.vehicle.assessment.straight_results import climbed
from simwarp.vehicle.assessment.verdicts import passed, verdicts
from simwarp.vehicle.driving.maneuver_spec import FrictionPatch
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.driving.path_tracking import wheelbase
from simwarp.vehicle.driving.steering_ratio import angle_per_steering
from simwarp.vehicle.results.results import results
from simwarp.vehicle.results.road import tire_ground
from simwarp.vehicle.results.run_result import lateral_acceleration, smoothed
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.rigs import tire_forces
from simwarp.vehicle.rigs.standing_loads import standing_loads
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import AutomaticShafts, SpecError, VehicleSpec
from tests.reference.understeer import drag, understeer_gradient

HMMWV, SEDAN, GATOR = (load_vehicle(name) for name in ("hmmwv", "sedan", "gator"))


def driven(spec, name, dt=2e-3, friction=0.9, channels=(), **options):
    """Results by key, verdicts and the run."""
    what = maneuver(name, spec, **options)
    run = Drive(set_up(spec, what, device="cpu", dt=dt, friction=friction), channels=channels).run()
    return {item.key: item.value for item in results(run, what)}, verdicts(run, what), run


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "name", "speeds"),
    [(HMMWV, "iso-3888-1", (12, 15, 18, 21, 24)), (SEDAN, "iso-3888-2", (10, 13, 16, 19))],
    ids=["hmmwv", "sedan"],
)
def test_slow_runs_pass_and_fast_ones_fail(spec, name, speeds):
    """The table is monotone: what is too fast stays too fast."""
    found = drive_variants(spec, [maneuver(name, spec, speed=float(v)) for v in speeds], device="cpu", dt=2e-3)
    kept = [bool(each.passed) for each in found]
    assert kept == sorted(kept, reverse=True)
    assert kept[0]
    assert not kept[-1]
    assert highest_passed(found) == speeds[sum(kept) - 1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "name", "key", "values"),
    [
        # other gears at the start, other preview, gain and pedals, and no release of the throttle below 10 m/s
        (SEDAN, "iso-3888-2", "speed", (4.0, 9.0, 14.0)),
        (HMMWV, "iso-3888-1", "speed", (6.0, 18.0)),
        # from rest, each with an approach of its own
        (GATOR, "double-lane-change", "speed", (3.0, 6.0)),
        # wheels without bodies, whose speeds are numbers of the vehicle's own
        (load_vehicle("sedan-14dof"), "iso-3888-2", "speed", (6.0, 12.0)),
        # the pattern's times follow from the amplitude
        (SEDAN, "fishhook", "steering", (0.1, 0.3)),
    ],
    ids=["sedan", "hmmwv", "gator", "reduced", "fishhook"],
)
def test_a_world_of_a_batch_is_the_run_alone(spec, name, key, values):
    """Bit by bit in what is read off the worlds, so that pass speeds of a batch are those of single runs.

    Columns that the host reckons from rotations round in the order that suits the number of worlds.
    """
    variants = [maneuver(name, spec, **{key: value}) for value in values]
    batch = drive_variants(spec, variants, device="cpu", dt=2e-3)
    for each, what in zip(batch, variants, strict=True):
        alone = Drive(set_up(spec, what, device="cpu", dt=2e-3)).run()
        assert len(each.run["t_s"]) == len(alone["t_s"])
        for column in alone.columns:
            exact = column.startswith(("omega", "engine", "gear", "Fz", "throttle", "brake", "steer"))
            tolerance = 0.0 if exact else 1e-14 * max(1.0, np.abs(alone[column]).max())
            assert np.abs(each.run[column] - alone[column]).max() <= tolerance, column
        assert [item.passed for item in each.verdicts] == [item.passed for item in verdicts(alone, what)]


@pytest.mark.parametrize("name", ["sedan", "hmmwv", "skid-steer", "sedan-14dof", "hmmwv-14dof"])
def test_a_world_of_a_batch_starts_as_the_run_alone(name):
    """Bodies, shafts, wheels of reduced vehicles, gears and engines, each at the speed of its own world."""
    spec = load_vehicle(name)
    variants = [maneuver("slow-steer", spec, speed=speed) for speed in (0.5, 4.0, 17.0)]
    batch = set_up_variants(spec, variants, device="cpu", dt=2e-3)
    for world, what in enumerate(variants):
        alone = set_up(spec, what, device="cpu", dt=2e-3)
        pairs = [(getattr(each.simulation.state, name) for each in (batch, alone))
                 for name in ("body_v", "body_omega", "joint_qd", "joint_q", "body_x")]  # fmt: skip
        pairs += [(each.vehicle.memory[name] for each in (batch, alone)) for name in alone.vehicle.memory]
        for ours, theirs in pairs:
            np.testing.assert_array_equal(ours.numpy()[world], theirs.numpy()[0])


@pytest.mark.slow
def test_a_world_that_diverges_is_marked_and_the_others_go_on():
    variants = [maneuver("iso-3888-1", GATOR, speed=v, duration=1.0) for v in (5.0, 6.0, 7.0)]
    setup = set_up_variants(GATOR, variants, device="cpu", dt=2e-3)
    velocity = setup.simulation.state.body_v.numpy()
    velocity[1] = np.nan
    setup.simulation.state.body_v.assign(velocity)
    drive = Drive(setup, worlds=slice(0, 3))
    drive.run()
    found = outcomes(drive, variants)
    assert [each.broken for each in found] == [False, True, False]
    assert found[1].passed is False
    assert found[2].run["x_m"][-1] == pytest.approx(7.0 * 3.0, rel=0.05)


def test_variants_must_be_alike():
    with pytest.raises(SpecError, match="must be one or more, got none"):
        set_up_variants(SEDAN, [])
    with pytest.raises(SpecError, match="must have a driver on a path, got a script"):
        set_up_variants(SEDAN, [maneuver("acceleration", SEDAN)])
    with pytest.raises(SpecError, match=r"number 1 \(bump\): must have the bump of the first one"):
        set_up_variants(SEDAN, [maneuver("bump", SEDAN, speed=v) for v in (4.0, 8.0)])
    with pytest.raises(SpecError, match=r"number 1 \(split-braking\): must have the name of the first one"):
        set_up_variants(SEDAN, [maneuver("braking", SEDAN), maneuver("split-braking", SEDAN)])


def shifted(way: float) -> VehicleSpec:
    """The sedan with the centre of mass of its chassis moved forwards [m]."""
    parts = tuple(
        dataclasses.replace(part, com=np.asarray(part.com) + np.array([way, 0.0, 0.0]))
        for part in SEDAN.chassis.components
    )
    return dataclasses.replace(SEDAN, chassis=dataclasses.replace(SEDAN.chassis, components=parts))


@pytest.mark.slow
@pytest.mark.parametrize("way", [-0.2, 0.0, 0.3])
def test_the_understeer_gradient_is_that_of_tires_and_axles_on_their_rigs(way):
    """Statics without any driving: slip angles for each wheel's load, and the rear wheels' roll steer.

    The shipped sedan oversteers: its rear axle, a double wishbone like the front one, steers by half of its roll out of
    the turn, which is -2.1e-3 rad/(m/s²), while its tires make +0.5e-3. A bicycle without roll steer would be neutral.
    """
    spec = shifted(way)
    found, _, _ = driven(spec, "slow-steer", speed=15.0, steering=0.1)
    high = min(4.0, 0.9 * found["peak_lateral"])
    parts = understeer_gradient(spec, np.linspace(1.0, high, 7), 15.0)
    # statics take roll centres and roll steer as they are at rest: 5 % of the 2.8e-3 that the parts add up to
    assert found["understeer_gradient"] == pytest.approx(parts["gradient"], abs=1.4e-4)
    assert math.radians(found["roll_gradient"]) / 9.81 == pytest.approx(parts["roll"], rel=0.03)


@pytest.mark.slow
def test_the_yaw_gain_of_a_step_is_that_of_the_bicycle():
    """v / (l + K v²) with the gradient that ISO 4138 finds at the same speed and lateral acceleration."""
    ramp, _, _ = driven(SEDAN, "slow-steer", speed=15.0, steering=0.05)
    step, _, _ = driven(SEDAN, "step-input", speed=15.0, steering=0.03)
    bicycle = 15.0 / (2.776 + ramp["understeer_gradient"] * 15.0**2)
    # speed is held to 1 %, the throttle of the step is not
    assert step["yaw_gain_wheels"] == pytest.approx(bicycle, rel=0.02)
    assert 0.0 < step["yaw_response_time"] < 0.5
    # the driver's gradient takes the same turn from the steering wheel
    by_driver = 15.0 / (2.776 + ramp["understeer_handwheel_gradient"] * 15.0**2)
    assert step["yaw_gain"] == pytest.approx(angle_per_steering(SEDAN) * by_driver, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "speed"), [("hmmwv", 18.0), ("sedan", 8.0), ("hmmwv-14dof", 12.0), ("artcar", 1.2),
                                             ("skid-steer", 0.8)])  # fmt: skip
def test_a_test_begins_at_the_speed_that_is_asked_for(name, speed):
    """Within half of a percent, after the two seconds in which springs settle and the driver finds the throttle."""
    spec = load_vehicle(name)
    what = maneuver("slow-steer", spec, speed=speed, duration=0.02)
    run = Drive(set_up(spec, what, device="cpu", dt=1e-3)).run()
    assert np.interp(0.0, run["t_s"], run["speed_mps"]) == pytest.approx(speed, rel=0.005)
    found = {item.key for item in results(run, what)}
    assert {"entry_speed", "asked_speed"} <= found
    assert "entry_error" not in found


@pytest.mark.slow
def test_a_speed_that_the_engine_does_not_hold_is_told_and_not_passed():
    """The HMMWV ends at 20.2 m/s: what begins at 24 m/s has fallen below 23 two seconds later."""
    variants = [maneuver("iso-3888-1", HMMWV, speed=speed, duration=0.3) for speed in (16.0, 24.0)]
    held, not_held = drive_variants(HMMWV, variants, device="cpu", dt=2e-3)
    assert held.held
    assert not not_held.held
    assert {item.key: item.value for item in not_held.results}["entry_error"] < -4.0
    kept = tuple(dataclasses.replace(each, passed=True) for each in held.verdicts)
    passing = [dataclasses.replace(each, verdicts=kept) for each in (held, not_held)]
    assert highest_passed(passing) == 16.0


@pytest.mark.parametrize(("name", "gear"), [("hmmwv", 3), ("sedan", 2), ("hmmwv-14dof", 3)])
def test_gears_are_held_in_a_steady_turn(name, gear):
    """From rest in the gear of the last speed: an automatic would shift down at once."""
    spec = load_vehicle(name)
    for held in (gear, None):
        what = dataclasses.replace(maneuver("steady-state-circle", spec, duration=0.2), start=0.0, held_gear=held)
        setup = set_up(spec, what, device="cpu", dt=2e-3)
        setup.vehicle.gear.fill_(gear)
        assert spec.transmission is not None
        for _ in range(60 if spec.transmission.template == "automatic-map" else 300):
            setup.simulation.step()
        assert (int(setup.vehicle.gear.numpy()[0]) == gear) == (held is not None)
    assert maneuver("steady-state-circle", spec).held_gear == gear


@pytest.mark.slow
@pytest.mark.parametrize(("spec", "speed", "radius"), [(SEDAN, 3.5, 20.0), (HMMWV, 3.5, -25.0)])
def test_a_slow_circle_takes_the_angle_of_ackermann(spec, speed, radius):
    """l / r at 0.5 m/s², where a gradient of 2e-3 rad/(m/s²) adds 1e-3 rad: less than 1 % of 0.14 rad."""
    _, _, run = driven(spec, "steady-state-circle", speed=speed, radius=radius, duration=30.0)
    late = run["t_s"] > 25.0
    angle = 0.5 * (run["steerangle_FL_rad"] + run["steerangle_FR_rad"])[late].mean()
    curvature = (run["yawrate_radps"][late] / run["speed_mps"][late]).mean()
    assert 1.0 / curvature == pytest.approx(radius, rel=0.05)
    assert angle == pytest.approx(wheelbase(spec) * curvature, rel=0.02)


@pytest.mark.slow
def test_lateral_acceleration_is_speed_times_yaw_rate_and_change_of_sideslip():
    """In a fast lane change the sideslip turns nearly as fast as the vehicle: speed times yaw rate alone says 11 m/s²
    where the centre of mass feels 5. The difference is speed times the rate of the sideslip, as kinematics have it.
    """
    found, _, run = driven(HMMWV, "double-lane-change", speed=20.0)
    t = run["t_s"]
    vx, vy = np.gradient(run["x_m"], t), np.gradient(run["y_m"], t)
    course = np.unwrap(np.arctan2(vy, vx))
    inside = (t > 12.0) & (t < t[-1] - 0.5)
    turned = smoothed((np.hypot(vx, vy) * np.gradient(course, t)), 5)
    yawed = run["speed_mps"] * run["yawrate_radps"]
    # of the frame here, of the centre of mass there: 0.1 m apart, in a yaw acceleration of 3 rad/s²
    assert np.abs(turned - lateral_acceleration(run))[inside].max() < 0.3
    assert np.abs(run["v_times_yawrate_mps2"] - yawed)[inside].max() < 1e-3 * np.abs(yawed).max()
    assert np.abs(yawed[inside]).max() > 2.0 * found["peak_lateral"]


@pytest.mark.slow
def test_the_top_speed_of_the_hmmwv_is_where_its_engine_ends():
    """At 20 m/s: in third gear its engine turns at 2600 revolutions per minute, behind the fall of its torque's map."""
    found, _, run = driven(HMMWV, "acceleration", duration=30.0)
    assert found["top_speed"] == pytest.approx(20.2, abs=0.2)
    assert isinstance(HMMWV.transmission, AutomaticShafts)
    assert run["gear"][-1] == len(HMMWV.transmission.forward_ratios)
    assert np.ptp(run["speed_mps"][-500:]) < 0.01
    assert run["throttle"][-1] == 1.0


@pytest.mark.slow
def test_a_stop_without_locked_wheels_has_the_deceleration_of_its_brakes():
    """(torques / radius + rolling resistance) over the mass with the wheels' inertia; the engine drags a little."""
    found, judged, _ = driven(SEDAN, "braking", speed=20.0, brakes=0.3)
    stand = standing_loads(SEDAN)
    torque, inertia, roll = 0.0, 0.0, 0.0
    for axle, load, radius in zip(SEDAN.axles, stand.wheel_load, stand.loaded_radius, strict=True):
        assert axle.brake is not None
        torque += 2.0 * 0.3 * axle.brake.max_torque / radius
        roll += 2.0 * drag(SEDAN, 0, load) * load
        inertia += 2.0 * (axle.wheel.inertia[1] + axle.tire.inertia[1]) / radius**2
    closed = (torque + roll) / (stand.mass + inertia)
    # engine and converter at idle push and drag by a few per cent of that; radii by the shift of loads 1 %
    assert found["developed_deceleration"] == pytest.approx(closed, rel=0.05)
    assert passed(judged) is True


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.3, 0.05])
def test_locked_wheels_slide_as_the_tire_rig_has_it(friction):
    """Full brakes: the force of all four tires at a slip of -1 over the mass, down to ice under water."""
    _, _, run = driven(SEDAN, "braking", speed=12.0, brakes=1.0, friction=friction, duration=4.0 / friction**0.5)
    stand = standing_loads(SEDAN)
    force = 0.0
    for axle, load in zip(SEDAN.axles, stand.wheel_load, strict=True):
        force -= 2.0 * float(tire_forces(axle.tire, slip_ratio=-1.0, load=load, speed=8.0, friction=friction).fx)
    t, speed = run["t_s"], run["speed_mps"]
    sliding = (t > 0.5) & (speed > 4.0)
    # loads shift by a few per cent of themselves, of which the force is not quite a share
    assert -np.polyfit(t[sliding], speed[sliding], 1)[0] == pytest.approx(force / stand.mass, rel=0.03)
    assert np.abs(run["omega_FL_radps"][sliding]).max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.9, 0.4])
def test_a_stop_takes_what_friction_allows(friction):
    """v² / (2 mu g) with the friction that the tires make of the road's; locked wheels slide below their peak."""
    found, judged, _ = driven(HMMWV, "braking", speed=15.0, friction=friction)
    ideal = found["braking_from"] ** 2 / (2.0 * friction * 9.81)
    # between the grip at the peak (a little above the nominal) and sliding tires, and 0.1 s of the foot's way
    assert 0.8 * ideal < found["stopping_distance"] < 1.6 * ideal + 1.5
    assert passed(judged) is True


@pytest.mark.slow
def test_split_friction_turns_towards_the_side_that_grips():
    """The left side slides on a third of the friction: the vehicle turns to the right, and stops later than on one."""
    split, _, run = driven(SEDAN, "split-braking", speed=12.0)
    assert split["yaw_after_1_s"] < -1.0
    even, _, _ = driven(SEDAN, "split-braking", speed=12.0, left=1.0)
    assert abs(even["yaw_deviation"]) < 1.0
    assert split["mean_deceleration"] < 0.9 * even["mean_deceleration"]
    assert run["t_s"][0] == pytest.approx(-2.0)


@pytest.mark.slow
def test_a_hill_is_held_and_left_upwards():
    for spec in (SEDAN, GATOR):
        found, judged, _ = driven(spec, "hill-start", slope=0.1)
        assert found["creep"] < 1.0
        assert passed(judged) is True


@pytest.mark.slow
def test_locked_wheels_slide_down_a_slope_of_ice():
    """By g (sin - friction cos), with the friction of tires at rest: the road's over the measurement's, 0.05 / 0.8.

    Tires once took any road's friction below a tenth for a tenth, and held.
    """
    wheels = ("FL", "FR", "RL", "RR")
    found, judged, run = driven(SEDAN, "hill-start", slope=0.1, friction=0.05, channels=["Fx_*", "Fy_*"])
    lean, held, t = math.atan(0.1), 0.05 / 0.8, run["t_s"]
    slow = (t > 0.25) & (t < 1.0)  # below 1 m/s, from which on the law of slip takes over
    for wheel in wheels:
        share = np.hypot(run[f"Fx_{wheel}_N"], run[f"Fy_{wheel}_N"])[slow] / run[f"Fz_{wheel}_N"][slow]
        # never more; where springs still ring, bristles follow the load a little late
        assert held * 0.95 < share.min() <= share.max() < held * 1.0001
    speed = np.gradient(climbed(run, maneuver("hill-start", SEDAN, slope=0.1)), t)
    closed = -9.81 * (math.sin(lean) - held * math.cos(lean))
    # the track's change on the springs holds tires against each other across, by 2 % of the load: 5 % of the rest
    assert np.polyfit(t[slow], speed[slow], 1)[0] == pytest.approx(closed, rel=0.1)
    assert found["creep"] > 100.0
    assert passed(judged) is False


@pytest.mark.slow
def test_a_higher_bump_throws_more():
    low, high = (driven(SEDAN, "bump", height=height)[0] for height in (0.01, 0.04))
    assert high["peak_up"] > 1.5 * low["peak_up"]
    assert high["front_load"] > low["front_load"] > 1.0
    flat = driven(SEDAN, "bump", height=0.0)[0]
    assert flat["pitch_range"] < 0.3 * low["pitch_range"]


@pytest.mark.slow
def test_a_long_bump_is_followed():
    """Slowly over 8 m: the pitch is the difference of the road's heights below the axles over the wheelbase."""
    found, _, _ = driven(SEDAN, "bump", speed=2.0, height=0.1, length=8.0)
    x = np.linspace(-8.0, 16.0, 5000)
    height = np.where((x > 0.0) & (x < 8.0), 0.1 * np.sin(np.pi * np.clip(x / 8.0, 0.0, 1.0)), 0.0)
    pitch = (np.interp(x + 2.776, x, height) - height) / 2.776
    # the springs' natural frequency is ten times that of the passage: overshoots of a few per cent
    assert found["pitch_range"] == pytest.approx(math.degrees(np.ptp(pitch)), rel=0.08)
    assert found["front_load"] < 1.2


def test_patches_of_friction_are_where_they_were_laid():
    what = dataclasses.replace(
        maneuver("braking", SEDAN),
        patches=(FrictionPatch(x=(10.0, 20.0), y=(0.0, 5.0), factor=0.3), FrictionPatch(x=(12.0, 13.0), y=(0.0, 1.0),
                                                                                      factor=0.1)),
    )  # fmt: skip
    terrain: Any = tire_ground(what, "cpu", np.array([0.0, 0.0, 0.0, 1.0]), -1)
    factors, origin, cell = terrain.friction_map.numpy(), terrain.friction_origin, terrain.friction_cell

    def factor(x, y):
        column, row = (math.floor((p - float(o)) / float(c)) for p, o, c in zip((x, y), origin, cell, strict=True))
        rows, columns = factors.shape
        return factors[min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)]

    assert factor(15.0, 2.0) == pytest.approx(0.3)
    assert factor(12.5, 0.5) == pytest.approx(0.1)
    for x, y in ((9.9, 2.0), (20.1, 2.0), (15.0, -0.1), (15.0, 5.1), (0.0, 0.0), (500.0, 0.5)):
        assert factor(x, y) == 1.0, (x, y)


def test_roads_of_patches_and_bumps_need_tires_that_read_them():
    rigid = dataclasses.replace(SEDAN, axles=tuple(
        dataclasses.replace(axle, tire=dataclasses.replace(axle.tire, template="rigid", parameters={}))
        for axle in SEDAN.axles
    ))  # fmt: skip
    with pytest.raises(SpecError, match="split-braking: must be driven on tires that are force laws, got rigid"):
        set_up(rigid, maneuver("split-braking", rigid), device="cpu")
