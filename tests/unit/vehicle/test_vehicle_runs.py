"""Manoeuvres, what is recorded of them, and what the records amount to."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.driving.maneuvers import (
    LANE_CHANGE,
    MANEUVERS,
    lane_change_path,
    maneuver,
    maneuver_options,
)
from simwarp.vehicle.driving.paths import Path, circle
from simwarp.vehicle.results import results as results_module
from simwarp.vehicle.results.channels import COLUMNS, Run
from simwarp.vehicle.results.drive_plot import draw_run, joined
from simwarp.vehicle.results.results import deviation, results
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import SpecError

GATOR, HMMWV, ARTCAR = (load_vehicle(name) for name in ("gator", "hmmwv", "artcar"))


def made_up(t, **columns):
    """A run with some columns; zeros in the others."""
    return Run({name: np.asarray(columns.get(name, np.zeros(len(t))), float) for name in COLUMNS} | {"t_s": t})


def value(found, key):
    return next(item.value for item in found if item.key == key)


# ---- manoeuvres ------------------------------------------------------------------------------------------------------


def at(points, time):
    """A script's function, as its kernel reads it."""
    times, values = np.array(points).T
    index = np.searchsorted(times, time, side="right")
    if index in (0, len(times)):
        return values[min(index, len(times) - 1)]
    part = (time - times[index - 1]) / (times[index] - times[index - 1])
    return values[index - 1] + part * (values[index] - values[index - 1])


@pytest.mark.parametrize(
    ("spec", "speeds"), [(HMMWV, (12.0, 15.0)), (GATOR, (6.0, 7.0)), (ARTCAR, (1.5, 1.7))], ids=lambda v: ""
)
def test_reference_manoeuvres_are_those_of_the_recorded_runs(spec, speeds):
    accel, steer, brake = (maneuver(f"reference-{name}", spec) for name in ("accel", "steer", "brake"))
    assert (accel.start, accel.duration, steer.duration) == (1.0, 20.0, 25.0)
    for what in (accel, steer, brake):
        assert (at(what.script.braking, 0.0), at(what.script.throttle, 0.0)) == (1.0, 0.0)
        assert (at(what.script.braking, 0.999), at(what.script.braking, 1.001)) == (1.0, 0.0)
        assert at(what.script.speed, 0.5) < 0.0
    assert at(accel.script.throttle, 1.0) == at(accel.script.throttle, 21.0) == 1.0
    assert at(steer.script.speed, 1.0) == at(steer.script.speed, 26.0) == speeds[0]
    assert [at(steer.script.steering, 1.0 + t) for t in (14.9, 15.1, 15.2, 25.0)] == pytest.approx([0, 0.15, 0.3, 0.3])
    assert at(brake.script.speed, 20.9) == speeds[1]
    assert at(brake.script.speed, 21.0) < 0.0
    assert (at(brake.script.braking, 20.99), at(brake.script.braking, 21.0)) == (0.0, 1.0)
    assert (steer.script.proportional, steer.script.integral, steer.script.brake_share) == (0.5, 0.1, 0.2)


def test_lane_change_has_the_geometry_of_the_standard():
    assert np.diff([0.0, *LANE_CHANGE]).tolist() == [15.0, 30.0, 25.0, 25.0, 30.0]
    path = lane_change_path(50.0)
    y = np.interp([50, 65, 80, 95, 120, 132.5, 145, 175], *path.points.T)
    assert y == pytest.approx([0, 0, 1.75, 3.5, 3.5, 1.75, 0, 0], abs=1e-9)
    assert np.all(np.diff(path.points[:, 0]) > 0.0)
    assert np.abs(path.curvature()).max() < 0.04


def test_options_reach_the_manoeuvre():
    step = maneuver("step-steer", GATOR, speed=4.0, steering=-0.2, duration=18.0)
    assert (at(step.script.speed, 5.0), at(step.script.steering, 17.0), step.duration) == (4.0, -0.2, 18.0)
    ring = maneuver("constant-radius", HMMWV, radius=-20.0, speed=5.0)
    assert ring.follow is not None
    assert (ring.follow.speed, ring.follow.paths[0].points[:, 1].min()) == (5.0, pytest.approx(-40.0, abs=0.01))
    assert maneuver("slope-hold", HMMWV, slope=0.1).slope == 0.1
    sweep = maneuver("sine-sweep", HMMWV, steering=0.05)
    times, values = np.array(sweep.script.steering).T
    assert np.abs(values).max() == pytest.approx(0.05, rel=1e-3)
    # up to 3 Hz
    last = values[times > times[-1] - 1.0]
    assert np.count_nonzero(np.diff(np.sign(last))) in (5, 6, 7)
    for name in MANEUVERS:
        assert maneuver(name, HMMWV).duration > 0.0
        assert isinstance(maneuver_options(name), list)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("step-ster", {}, "did you mean step-steer"),
        ("zzz", {}, "choose from reference-accel"),
        ("reference-accel", {"speed": 3.0}, "it has none"),
        ("step-steer", {"radius": 3.0}, "it has speed, steering, duration"),
        ("step-steer", {"speed": -3.0}, r"speed: must be in \[0.01, 1000\], got -3.0; give m/s"),
        ("step-steer", {"steering": 1.5}, r"steering: must be in \[-1, 1\], got 1.5"),
        ("constant-radius", {"radius": 0.0}, "other than zero"),
        ("constant-radius", {"radius": math.nan}, "finite"),
        ("slope-hold", {"slope": 2.0}, r"slope: must be in \[-1, 1\], got 2.0; give rise per run"),
        ("sine-sweep", {"duration": 12.0}, "above 15 s"),
        ("step-steer", {"duration": 5.0}, "duration: must be above 15 s, where the step begins, got 5.0"),
        ("none.csv", {}, "cannot be read"),
    ],
)
def test_what_no_manoeuvre_takes_is_one_error(name, options, words):
    with pytest.raises(SpecError, match=words):
        maneuver(name, HMMWV, **options)


def test_a_script_from_a_table(tmp_path):
    file = tmp_path / "script.csv"
    file.write_text("t_s,steer,throttle,brake\n2,0,0,1\n3,0,0,0\n3,0,1,0\n5,0.2,1,0\n")
    what = maneuver(str(file), GATOR)
    assert (what.start, what.duration, what.name) == (0.0, 3.0, "script.csv")
    assert [at(what.script.throttle, t) for t in (0.5, 1.0, 2.0)] == [0.0, 1.0, 1.0]
    assert (at(what.script.steering, 2.0), at(what.script.braking, 0.0)) == (pytest.approx(0.1), 1.0)
    run = Drive(set_up(GATOR, what, device="cpu", dt=2e-3)).run()
    assert run["throttle"][-1] == 1.0
    assert run["speed_mps"][-1] > 4.0
    for text, words in (
        ("steer\n1\n", "column of times"), ("t_s,a\n1,2\n", "steering, throttle or braking"),
        ("t_s\n", "must have rows"), ("t_s,steer\n1,x\n", "line 2: must be a table of numbers"),
        ("t_s,steer\n1,0\n2,0\n1,0\n", "row 3: t_s: must be in order, got 1 after 2"),
        ("t_s,steer,throtle\n1,0,0\n2,0,1\n", r"column 'throtle': unknown \(did you mean 'throttle'\?\); known: t_s, "),
        ("t_s,steer\n1,0\n2,5\n", "row 2: steer: must be from -1 to 1, got 5"),
        ("t_s,throttle\n1,0\n2,3\n", "row 2: throttle: must be from 0 to 1, got 3"),
        ("t_s,brake\n1,-0.1\n2,0\n", "row 1: brake: must be from 0 to 1, got -0.1"),
        ("t_s,speed_target\n1,nan\n2,0\n", "row 1: speed_target: must be a finite number, got nan"),
        ("t_s,brake\nnan,0\n2,0\n", "row 1: t_s: must be a finite number"),
        ("t_s,brake\n1,1\n", "must have two or more rows with different times, got 1 alone"),
        ("t_s,brake\n1,1\n1,0\n", "two or more rows with different times"),
        ("t_s,steer,brake\n1,0,0\n2,0\n", "line 3: must have 3 numbers as the header has names, got 2"),
        ("t_s,steer,steering\n1,0,0\n2,0,0\n", "column 'steering': the same as 'steer'; leave out one"),
        ("t_s,steer,steer\n1,0,0\n2,0,0\n", "column 'steer': given twice"),
    ):  # fmt: skip
        file.write_text(text)
        with pytest.raises(SpecError, match=words) as caught:
            maneuver(str(file), GATOR)
        assert str(caught.value).startswith(str(file))
    # as spreadsheets write it, and with the columns of a record beside it
    file.write_text("\ufefft_s,steering,speed_target,yaw_rad,Fz_FL_N\n0,0,-1,9,9\n\n1,0.5,3,9,9\n", encoding="utf-8")
    assert maneuver(str(file), GATOR).script.speed == ((0.0, -1.0), (1.0, 3.0))


# ---- records ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [1e-3, 2e-3, 3e-3])
def test_rows_are_at_whole_hundredths_whatever_the_step(dt):
    run = Drive(set_up(GATOR, Maneuver(name="x", duration=0.5), device="cpu", dt=dt)).run()
    assert tuple(run.columns) == COLUMNS
    assert run["t_s"] == pytest.approx(-1.0 + 0.01 * np.arange(151), abs=1e-9)
    assert all(np.isfinite(values).all() for values in run.columns.values())


def test_rows_hold_the_inputs_of_their_own_time():
    what = maneuver("reference-accel", GATOR)
    drive = Drive(set_up(GATOR, Maneuver(name="x", script=what.script, duration=0.2), device="cpu"))
    run = drive.run()
    t = run["t_s"]
    assert np.array_equal(run["brake"][t < -1e-9], np.ones(100))
    assert not run["brake"][t > -1e-9].any()
    assert np.array_equal(run["throttle"], (t > -1e-9).astype(float))


def test_acceleration_is_that_of_the_chassis():
    run = Drive(set_up(GATOR, maneuver("step-steer", GATOR, speed=5.0, duration=18.0), device="cpu", dt=2e-3)).run()
    steady = run["t_s"] > 17.0
    # a steady turn: v times yaw rate, and a little gravity for the roll
    assert run["latacc_com_mps2"][steady] == pytest.approx(run["v_times_yawrate_mps2"][steady], rel=0.1, abs=0.1)


def test_a_run_goes_through_its_file(tmp_path):
    t = np.arange(-1.0, 1.0, 0.01)
    run = made_up(t, speed_mps=np.sin(t), gear=np.where(t > 0.3, 2.0, 1.0))
    run.write(tmp_path / "run.csv")
    assert (tmp_path / "run.csv").read_text().splitlines()[0] == ",".join(COLUMNS)
    again = Run.read(tmp_path / "run.csv")
    for name in COLUMNS:
        assert again[name] == pytest.approx(run[name], rel=1e-8, abs=1e-12)


# ---- results ---------------------------------------------------------------------------------------------------------


def test_times_to_speeds_and_stopping():
    t = np.arange(-1.0, 12.0, 0.01)
    speed = np.clip(2.0 * t, 0.0, 16.0)
    what = Maneuver(name="reference-accel", duration=12.0)
    found = results(made_up(t, speed_mps=speed), what)
    assert [value(found, f"time_to_{mark}") for mark in (5, 10, 15)] == pytest.approx([2.5, 5.0, 7.5], abs=1e-6)
    assert value(found, "top_speed") == 16.0
    assert not any(item.key == "time_to_20" for item in found)
    brake = (t >= 9.0).astype(float)
    slowing = np.where(brake > 0.0, np.maximum(16.0 - 8.0 * (t - 9.0), 0.0), speed)
    found = results(made_up(t, speed_mps=slowing, brake=brake), Maneuver(name="reference-brake", duration=12.0))
    assert value(found, "stopping_distance") == pytest.approx(16.0, abs=0.01)
    assert value(found, "stopping_time") == pytest.approx(2.0, abs=0.015)
    never = results(made_up(t, speed_mps=speed, brake=brake), Maneuver(name="reference-brake", duration=12.0))
    assert math.isnan(value(never, "stopping_distance"))
    assert next(item for item in never if item.key == "stopping_distance").value_text == "still moving at the end"


def test_a_vehicle_without_engine_has_no_stopping_distance():
    t = np.arange(-1.0, 12.0, 0.01)
    what = Maneuver(name="reference-brake", script=maneuver("reference-brake", HMMWV).script, duration=12.0)
    with np.errstate(all="raise"):
        found = results(made_up(t, brake=(t >= 9.0).astype(float)), what)
    told = {item.key: (item.value_text, item.unit_text) for item in found}
    for key in ("stopping_distance", "stopping_time", "mean_deceleration"):
        assert told[key] == ("it does not drive", "")
    assert told["speed_to_hold"] == ("not reached", "")
    assert next(item for item in found if item.key == "speed_to_hold").label == "speed to hold (15 m/s)"
    near = results(made_up(t, speed_mps=np.full(len(t), 14.9)), what)
    assert not any(item.key == "speed_to_hold" for item in near)


def test_a_step_of_the_steering():
    t = np.arange(-1.0, 25.005, 0.01)
    steer = np.clip((t - 15.0) / 0.2, 0.0, 1.0) * 0.3
    yaw_rate = 0.4 * (1.0 - np.exp(-np.maximum(t - 15.0, 0.0) / 0.3))
    run = made_up(t, speed_mps=np.full(len(t), 12.0), yawrate_radps=yaw_rate, steer=steer)
    found = results(run, Maneuver(name="reference-steer", duration=25.0))
    assert value(found, "steady_yaw_rate") == pytest.approx(0.4, abs=1e-6)
    assert value(found, "steady_radius") == pytest.approx(30.0, rel=1e-5)
    assert value(found, "yaw_rise_time") == pytest.approx(0.3 * math.log(10.0), abs=0.012)
    straight = made_up(t, speed_mps=np.full(len(t), 12.0))
    assert math.isnan(value(results(straight, Maneuver(name="step-steer", duration=25.0)), "steady_radius"))


@pytest.mark.slow
def test_gain_and_lag_of_a_sweep():
    what = maneuver("sine-sweep", HMMWV)
    t = np.arange(-1.0, 50.0, 0.01)
    steer = np.array([at(what.script.steering, time + 1.0) for time in t])
    # a lag of first order
    yaw_rate = np.zeros(len(t))
    for k in range(1, len(t)):
        yaw_rate[k] = yaw_rate[k - 1] + 0.01 / 0.2 * (1.5 * steer[k] - yaw_rate[k - 1])
    found = results(made_up(t, steer=steer, yawrate_radps=yaw_rate), what)
    for frequency in (0.3, 0.5, 1.0, 2.0):
        phase = 2.0 * math.pi * frequency * 0.2
        assert value(found, f"yaw_gain_{frequency:g}_hz") == pytest.approx(1.5 / math.hypot(1.0, phase), rel=0.08)
        assert value(found, f"yaw_lag_{frequency:g}_hz") == pytest.approx(math.degrees(math.atan(phase)), abs=5.0)


def test_deviation_from_a_circle_and_creep():
    angle = np.linspace(0.0, 9.0, 200)
    t = np.linspace(0.0, 10.0, 200)
    run = made_up(t, x_m=31.0 * np.sin(angle), y_m=30.0 - 31.0 * np.cos(angle))
    assert deviation(run, circle(30.0)) == pytest.approx(1.0, abs=0.01)
    still = made_up(t, x_m=np.where(t < 1.0, 0.0, 0.002), y_m=1e-5 * np.maximum(t - 5.0, 0.0))
    found = results(still, Maneuver(name="slope-hold", duration=10.0))
    assert value(found, "creep") == pytest.approx(0.05, rel=0.02)
    assert value(found, "moved") == pytest.approx(2.0, rel=0.01)


def deviation_by_places(run, path):
    """Place by place, as the distance is defined."""
    start, chord = path.points[:-1], np.diff(path.points, axis=0)
    squared = (chord * chord).sum(axis=1)
    found = []
    for place in np.stack([run["x_m"], run["y_m"]], axis=1):
        part = np.clip(((place - start) * chord).sum(axis=1) / squared, 0.0, 1.0)
        if not path.closed:
            part[0] = min(part[0], ((place - start[0]) @ chord[0]) / squared[0])
            part[-1] = max(part[-1], ((place - start[-1]) @ chord[-1]) / squared[-1])
        found.append(np.linalg.norm(place - start - part[:, None] * chord, axis=1).min())
    return np.array(found)


@pytest.mark.parametrize("closed", [False, True])
def test_deviations_of_all_places_at_once_are_those_place_by_place(closed):
    """Bit by bit, along, before and beyond a path of many chords and of few, in more places than are taken at once."""
    rng = np.random.default_rng(4)
    for chords in (3, 40, 300):
        points = np.cumsum(rng.normal(loc=(1.0, 0.0), size=(chords + 1, 2)), axis=0)
        path = Path(points=points, closed=closed)
        t = np.linspace(0.0, 1.0, 300)
        x, y = (np.cumsum(rng.normal(scale=0.3, size=300) + drift) - 20.0 for drift in (0.004 * chords, 0.0))
        run = made_up(t, x_m=x, y_m=y)
        assert np.array_equal(deviation(run, path), deviation_by_places(run, path))


def test_a_run_that_ended_at_once_has_no_results():
    run = made_up(np.array([-1.0, -0.99]))
    for name in MANEUVERS:
        assert results(run, maneuver(name, HMMWV)) == []
    one = made_up(np.array([-0.01, 0.0, 0.01]))
    for name in results_module._SPECIAL.keys() & MANEUVERS.keys():
        assert results(one, maneuver(name, HMMWV))


@pytest.mark.quick("reference-steer")
@pytest.mark.parametrize("name", ["reference-steer", "double-lane-change", "slope-hold"])
def test_pages_are_drawn_of_short_runs_too(tmp_path, name):
    what = maneuver(name, GATOR)
    for count in (1, 40):
        t = np.linspace(-1.0, 1.0, count)
        path = None if what.follow is None else what.follow.paths[0]
        run = made_up(t, x_m=np.maximum(t, 0.0))
        draw_run(run, tmp_path / "page.svg", "title", results(run, what), path)
        assert (tmp_path / "page.svg").stat().st_size > 10_000


def test_a_circle_is_drawn_without_complaint(tmp_path, caplog):
    what = maneuver("constant-radius", HMMWV)
    assert what.follow is not None
    angle = np.linspace(0.0, 5.0, 400)
    run = made_up(np.linspace(-1.0, 30.0, 400), x_m=30.0 * np.sin(angle), y_m=30.0 - 30.0 * np.cos(angle))
    draw_run(run, tmp_path / "page.svg", "title", results(run, what), what.follow.paths[0])
    assert caplog.messages == []


def panels(run, monkeypatch, tmp_path, path=None) -> dict[str, Any]:
    """The axes of a page by the words before the unit in their titles."""
    figures: list[Any] = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *more, **options: figures.append(self))
    draw_run(run, tmp_path / "page.png", "title", path=path)
    figures[0].draw_without_rendering()
    return {axes.get_title("left").partition(" [")[0]: axes for axes in figures[0].axes}


def test_panels_of_a_standing_vehicle_do_not_magnify_noise(tmp_path, monkeypatch):
    noise = 1e-5 * np.random.default_rng(0).normal(size=400)
    run = made_up(np.linspace(-1.0, 3.0, 400), engine_radps=noise, speed_mps=noise, omega_FL_radps=noise)
    drawn = panels(run, monkeypatch, tmp_path)
    for name, least in (("engine", 2.0), ("speed", 0.1), ("wheel speeds", 0.2)):
        assert np.ptp(drawn[name].get_ylim()) >= least


def test_legends_are_beside_the_panels(tmp_path, monkeypatch):
    drawn = panels(made_up(np.linspace(-1.0, 3.0, 400)), monkeypatch, tmp_path)
    told = {name: axes for name, axes in drawn.items() if axes.get_legend() is not None}
    assert len(told) == 4
    for axes in told.values():
        legend, inside = axes.get_legend().get_window_extent(), axes.get_window_extent()
        assert legend.y0 > inside.y1 - 1.0
        title = axes._left_title.get_window_extent()
        assert title.x1 < legend.x0


def test_a_part_of_a_circle_has_no_chord(tmp_path, monkeypatch):
    angle = np.linspace(0.0, 3.0, 400)
    run = made_up(np.linspace(-1.0, 3.0, 400), x_m=3.0 * np.sin(angle), y_m=3.0 - 3.0 * np.cos(angle))
    drawn = panels(run, monkeypatch, tmp_path, circle(3.0))["way"].lines[0].get_xydata()
    assert np.isnan(drawn).any()
    steps = np.linalg.norm(np.diff(drawn, axis=0), axis=1)
    assert np.nanmax(steps) < 0.06


def test_results_stay_on_the_page():
    told = [f"result {k} with a long name {k:.3f} m/s" for k in range(9)] + ["x" * 200, "y"]
    lines = joined(told)
    assert "   ·   ".join(lines) == "   ·   ".join(told)
    assert all(len(line) <= 120 for line in lines if "x" not in line)
    assert len(lines) == 5


def test_a_small_circle_is_as_round_as_a_large_one():
    assert len(circle(3.0).points) == 361
    # its corners turn by a degree
    assert np.abs(circle(0.5).curvature() - 2.0).max() < 1e-3


def test_a_path_needs_two_axles():
    one = dataclasses.replace(
        HMMWV, axles=HMMWV.axles[:1], wheelbase=None, driveline=None, engine=None, transmission=None
    )
    for name in ("constant-radius", "double-lane-change"):
        with pytest.raises(SpecError, match="axles: must be two or more"):
            maneuver(name, one)


def test_a_vehicle_holds_on_a_slope():
    run = Drive(set_up(GATOR, maneuver("slope-hold", GATOR, duration=15.0), device="cpu", dt=2e-3)).run()
    found = results(run, maneuver("slope-hold", GATOR))
    assert value(found, "creep") < 1.0
    # it stands on the slope: nose up, on wheels that carry its weight's normal part
    assert run["pitch_rad"][-1] == pytest.approx(-math.atan(0.2), abs=0.03)


def test_wrong_settings_are_refused():
    with pytest.raises(SpecError, match="dt"):
        set_up(GATOR, maneuver("slope-hold", GATOR), dt=0.0)
    with pytest.raises(SpecError, match="friction"):
        set_up(GATOR, maneuver("slope-hold", GATOR), friction=math.nan)
