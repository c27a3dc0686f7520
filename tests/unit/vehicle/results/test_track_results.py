"""Results of runs on tracks from made-up columns with known answers, and means round the chains."""

import dataclasses
import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.vehicle import (
    TRACK_SOLVER,
    Drive,
    SpecError,
    TrackedVehicle,
    add_tracked_vehicle,
    load_tracked_vehicle,
    load_vehicle,
    maneuver,
    per_world,
    set_up,
    with_options,
)
from simwarp.vehicle.driving.maneuver_spec import CrossingKind
from simwarp.vehicle.driving.track_maneuvers import TRACK_MANEUVERS
from simwarp.vehicle.results.chain_plot import draw_chains
from simwarp.vehicle.results.chain_record import ChainRecord, lowest_shoe
from simwarp.vehicle.results.channels import Recorder, Run
from simwarp.vehicle.results.drive_plot import draw_run
from simwarp.vehicle.results.results import results
from simwarp.vehicle.results.track_readings import track_columns
from simwarp.vehicle.spec.track_parts import ShoeTrack, SimpleTrackDriveline
from simwarp.vehicle.tracks.shoe_construction import lay_track

SPEC = load_tracked_vehicle("m113")


def made_up(duration, **columns):
    """A run with the columns of tracks, zero but for those given as functions of time."""
    t = np.round(np.arange(0.0, duration + 0.005, 0.01), 9)
    found = {name: np.zeros_like(t) for name in track_columns((5, 5))} | {"t_s": t}
    return Run(found | {name: np.broadcast_to(value(t), t.shape).astype(float) for name, value in columns.items()})


def told(run, what):
    return {item.key: item.value for item in results(run, what)}


def test_times_to_speeds_and_energy():
    """A mass of 1000 kg from rest at 1 m/s² by 2 kN·m at 3 rad/s: 60 kJ in 10 s, of which 50 kJ are its motion."""
    run = made_up(
        10.0, speed_mps=lambda t: t, engine_Nm=lambda t: 2000.0, engine_radps=lambda t: 3.0,
        energy_J=lambda t: 500.0 * t**2, drive_W=lambda t: 5500.0,
    )  # fmt: skip
    found = told(run, maneuver("accelerate", SPEC))
    assert [found[f"time_to_{mark}"] for mark in (1, 2, 3, 4, 5, 10)] == pytest.approx([1, 2, 3, 4, 5, 10])
    assert [found[key] for key in ("engine_work", "drive_work", "energy_gain", "losses")] == pytest.approx(
        [60.0, 55.0, 50.0, 10.0]
    )


def test_a_turn_on_the_spot():
    run = made_up(5.0, yaw_rad=lambda t: np.angle(np.exp(1.0j * t)), yawrate_radps=lambda t: 1.0)
    found = told(run, maneuver("pivot", SPEC))
    assert found["turned"] == pytest.approx(math.degrees(5.0))  # beyond half a turn
    assert found["quarter_turn"] == pytest.approx(0.5 * math.pi, abs=1e-3)
    assert (found["steady_yaw_rate"], found["moved"]) == pytest.approx((1.0, 0.0))


@pytest.mark.parametrize("name", ["obstacle", "trench"])
def test_crossed_is_when_the_last_wheel_is_over(name):
    what = maneuver(name, SPEC)
    run = made_up(9.0, x_m=lambda t: 2.0 * t, pitch_rad=lambda t: 0.2 * np.sin(t), speed_mps=lambda t: 2.0)
    found = told(run, what)
    size = {"obstacle": 0.2, "trench": 1.2}[name]
    assert found["crossed_after"] == pytest.approx(0.5 * (5.0 + size + 3.407 + 0.305), abs=1e-6)
    near = run["t_s"] >= 0.5 * (5.0 - 2.0 * size)
    pitch = np.degrees(run["pitch_rad"][near])
    assert (found["nose_up"], found["nose_down"]) == pytest.approx((-pitch.min(), pitch.max()))
    stuck = made_up(9.0, x_m=lambda t: np.minimum(2.0 * t, 6.0), speed_mps=lambda t: 2.0)
    assert math.isnan(told(stuck, what)["crossed_after"])
    assert next(item for item in results(stuck, what) if item.key == "crossed_after").value_text == "stuck"


def test_a_climb_and_what_the_brakes_hold():
    """1 m/s along a slope of 3 in 4 for 6 s, then 1 mm/s back."""
    way = lambda t: np.where(t < 6.0, t, 6.0 - 1e-3 * (t - 6.0))  # noqa: E731
    run = made_up(
        10.0, x_m=lambda t: 0.8 * way(t), z_m=lambda t: 0.6 * way(t), brake=lambda t: (t >= 6.0) * 1.0,
        speed_mps=lambda t: np.where(t < 6.0, 1.0, -1e-3),
    )  # fmt: skip
    found = told(run, maneuver("slope", SPEC, slope=0.75))
    assert found["climbed"] == pytest.approx(6.0)
    assert found["held"] == pytest.approx(-3.0, abs=0.02)  # mm in the last 3 s
    slid = made_up(10.0, x_m=lambda t: -t, brake=lambda t: (t >= 6.0) * 1.0, speed_mps=lambda t: -1.0)
    lost = told(slid, maneuver("slope", SPEC))
    assert math.isnan(lost["climbed"])
    assert math.isnan(lost["held"])


@pytest.mark.parametrize("name", TRACK_MANEUVERS)
def test_a_run_of_a_moment_has_results(name):
    found = results(made_up(0.01), maneuver(name, SPEC))
    assert {"top_speed", "engine_work", "losses"} <= {item.key for item in found}


def test_manoeuvres_know_their_vehicle():
    for name in TRACK_MANEUVERS:
        what = maneuver(name, SPEC)
        assert (what.name, what.start) == (name, 2.0)
    trench = maneuver("trench", SPEC, width=0.8).crossing
    assert trench is not None
    assert (trench.kind, trench.beyond) == (CrossingKind.TRENCH, 5.8)
    with pytest.raises(
        SpecError, match="is for vehicles on tracks, got 'gator' on wheels; choose from reference-accel"
    ):
        maneuver("accelerate", load_vehicle("gator"))
    with pytest.raises(SpecError, match="is for vehicles on wheels, got 'M113' on tracks; choose from accelerate"):
        maneuver("slope-hold", SPEC)


def test_set_up_of_tracks():
    what = dataclasses.replace(maneuver("pivot", SPEC), slope=0.1)
    simple = with_options(SPEC, driveline="simple")
    assert simple.driveline == SimpleTrackDriveline()
    setup = set_up(simple, what, worlds=2, device="cpu")
    assert isinstance(setup.vehicle, TrackedVehicle)
    assert setup.vehicle.gyration.numpy().tolist() == [1, 1]
    # as high above the slope as its description says, nose up
    height = setup.vehicle.position.numpy()[0] @ np.array([-0.1, 0.0, 1.0]) / math.hypot(1.0, 0.1)
    assert height == pytest.approx(SPEC.start_height, abs=1e-6)
    assert setup.vehicle.angles.numpy()[0, 1] == pytest.approx(-math.atan(0.1), abs=1e-6)
    with pytest.raises(SpecError, match="on_soil: must be False of a vehicle on tracks, got True for 'M113'"):
        set_up(SPEC, what, on_soil=True)
    with pytest.raises(SpecError, match="tire: 'M113' has tracks and no tires, got 'tmeasy'; leave it out"):
        with_options(SPEC, tire="tmeasy")


def test_a_drawbar_test_of_tracks_measures_slip_at_the_pins_of_the_sprockets():
    setup = set_up(SPEC, maneuver("drawbar", SPEC), device="cpu")
    recorder = Drive(setup).recorder
    assert recorder.names[-3:] == ("slip", "pull_N", "pull_per_weight")
    parts = setup.vehicle.parts
    dofs = [setup.simulation.model.joint_dof_start[side.sprocket] for side in (parts.left, parts.right)]
    rates = setup.simulation.state.joint_qd.numpy().copy()
    rates[0, dofs] = 8.0, 12.0
    setup.simulation.set_joint_state(None, setup.simulation.state.joint_q.numpy(), rates)
    setup.simulation.step()
    # 10 rad/s at 0.245 m, of a vehicle that stands but for some mm/s
    assert recorder._further["slip"].numpy()[0] == pytest.approx(1.0, abs=2e-3)
    idle = dataclasses.replace(SPEC, driveline=None, engine=None, transmission=None)
    with pytest.raises(SpecError, match="driveline: must turn the sprockets in a drawbar test, got none"):
        set_up(idle, maneuver("drawbar", SPEC), device="cpu")


def test_names_lead_to_the_right_loader():
    assert sw.vehicle.all_vehicle_names() == [
        *sw.vehicle.vehicle_names(), *sw.vehicle.reduced_vehicle_names(), "m113", "m113-belt", "m113-double-pin",
    ]  # fmt: skip
    assert sw.vehicle.load_any_vehicle("m113") == SPEC
    assert sw.vehicle.load_any_vehicle("m113-belt") == sw.vehicle.with_belts(SPEC)
    assert sw.vehicle.load_any_vehicle("gator") == load_vehicle("gator")
    with pytest.raises(SpecError, match="vehicle 'm113': has tracks; load it by load_tracked_vehicle"):
        load_vehicle("m113")
    with pytest.raises(SpecError, match=r"did you mean 'm113'.*known: artcar, .*, m113, m113-belt, m113-double-pin"):
        sw.vehicle.load_any_vehicle("m1133")


def test_belts_drive_manoeuvres_and_have_no_pins():
    """Their record lacks the pins' columns alone; what lies across the way is for chains."""
    spec = sw.vehicle.with_belts(SPEC)
    setup = sw.vehicle.set_up(spec, maneuver("accelerate", spec))
    recorder = sw.vehicle.Recorder(setup.simulation, setup.vehicle)
    setup.simulation.step(2500)  # two seconds on the brakes first
    recorder.sample()
    assert not any(name.startswith("pin_") for name in recorder.names)
    row = dict(zip(recorder.names, recorder.rows[-1][0].tolist(), strict=True))
    assert 0.2 < row["speed_mps"] < row["track_speed_L_mps"] < 3.0
    assert row["ground_z_N"] == pytest.approx(11342.9 * 9.81, rel=0.2)  # it pitches
    assert row["idler_L_m"] == pytest.approx(-4.02, abs=0.05)
    with pytest.raises(SpecError, match="obstacle: must be driven shoe by shoe, got belts"):
        sw.vehicle.set_up(spec, maneuver("obstacle", spec))
    with pytest.raises(ModelError, match="is on belts, which have no pins"):
        sw.vehicle.ChainRecord(setup.simulation, setup.vehicle)


# ---- chains ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def resting():
    """The vehicle 0.25 s after its start in two worlds, and records of its chains."""
    builder = sw.ModelBuilder()
    parts = add_tracked_vehicle(builder, SPEC)
    builder.add_shape_plane(material=sw.Material(friction=0.9))
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle = TrackedVehicle(parts, model)
    solver = dataclasses.replace(TRACK_SOLVER, max_iterations=30)
    sim = sw.Simulation(model, 1e-3, elements=[vehicle], solver=solver, joint_reactions=True, check_start=False)
    sim.step(250)
    return sim, vehicle


def test_a_profile_has_the_sums_of_its_chain(resting):
    sim, vehicle = resting
    record, recorder = ChainRecord(sim, vehicle), Recorder(sim, vehicle)
    with pytest.raises(ModelError, match="must have a sample"):
        record.profiles()
    record.sample()
    recorder.sample()
    row = dict(zip(recorder.names, recorder.table()[0, 0], strict=True))
    profiles = record.profiles()
    for name, profile, track in zip("LR", profiles, (SPEC.left, SPEC.right), strict=True):
        assert len(profile.place) == track.shoes
        assert profile.place[1] == track.shoe.pitch
        # between pins, forces are interpolated: neighbours differ by some per cent, means by their squares
        assert profile.tension.mean() == pytest.approx(row[f"pin_mean_{name}_N"], rel=0.02)
        # the first place is below the sprocket, and places follow each other a pitch apart (chords, on curves)
        assert profile.x[0] == pytest.approx(track.sprocket_location[0], abs=1e-6)
        assert profile.z[0] < track.sprocket_location[2] - 0.2
        steps = np.hypot(np.diff(profile.x), np.diff(profile.z))
        assert (steps < track.shoe.pitch + 1e-4).all()  # the chain's joints are as close
        # centres of shoes that turn by 37° are cos(18°) of a pitch apart, points between them that again
        assert (steps > 0.9 * 0.95 * track.shoe.pitch).all()
        assert profile.x[: track.shoes // 2].max() > track.sprocket_location[0] + 0.15  # round the far side first
        # no shoe of the upper run bears on the ground
        assert not profile.load[profile.z > -0.3].any()
    # shoes lie flat below the wheels: their normal loads are the ground's force, but for the slopes at both ends
    assert sum(profile.load.sum() for profile in profiles) == pytest.approx(row["ground_z_N"], rel=0.02)


def test_the_mean_of_a_state_with_itself_is_that_state(resting, tmp_path):
    sim, vehicle = resting
    once, twice = ChainRecord(sim, vehicle), ChainRecord(sim, vehicle)
    for record, count in ((once, 1), (twice, 2)):
        for _ in range(count):
            record.sample()
    for one, two in zip(once.profiles(), twice.profiles(), strict=True):
        np.testing.assert_allclose(two.tension, one.tension, rtol=1e-14)
    draw_chains(once, tmp_path / "a.svg", "at rest")
    assert "load under the shoes" in (tmp_path / "a.svg").read_text() or (tmp_path / "a.svg").stat().st_size > 10_000
    plain = sw.Simulation(sim.model, 1e-3, elements=[TrackedVehicle(vehicle.parts, sim.model)], check_start=False)
    with pytest.raises(ModelError, match="make it with joint_reactions=True"):
        ChainRecord(plain, vehicle)


@pytest.mark.parametrize("moved", [0, 1, 20, 62])
def test_the_lowest_shoe_is_that_below_the_sprocket_wherever_numbers_begin(moved):
    """As laid, pin 0 is straight below the axis, between the centres of the last shoe and the first one."""
    track = SPEC.left
    assert isinstance(track, ShoeTrack)
    laid = lay_track(track)
    centres = np.roll(laid.centres, moved, axis=0)
    before, after = math.cos(laid.angles[-1]), math.cos(laid.angles[0])
    expected = 62.0 + before / (before + after)
    assert (lowest_shoe(centres[:, 0], centres[:, 1], track) - moved) % 63 == pytest.approx(expected, rel=1e-12)


def test_pages_of_runs_on_tracks_are_drawn(tmp_path):
    run = made_up(2.0, speed_mps=lambda t: t, tension_L_N=lambda t: 1e5)
    without = Run({name: values for name, values in run.columns.items() if not name.startswith("pin_")})
    draw_run(without, tmp_path / "page.svg", "M113", results(run, maneuver("accelerate", SPEC)))
    assert (tmp_path / "page.svg").stat().st_size > 10_000
