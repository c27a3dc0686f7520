"""Verdicts and results of handling, braking and lane tests on signals that are known in closed form."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from simwarp.vehicle.assessment.lane_verdicts import lane_verdicts
from simwarp.vehicle.assessment.verdicts import passed, verdict_rows, verdicts
from simwarp.vehicle.driving.handling_maneuvers import SINE_END, sine_pattern
from simwarp.vehicle.driving.lane_courses import obstacle_avoidance_course
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.driving.steering_ratio import angle_per_steering
from simwarp.vehicle.driving.vehicle_outline import Outline
from simwarp.vehicle.results.channels import COLUMNS, Run
from simwarp.vehicle.results.results import results
from simwarp.vehicle.spec.vehicle_files import load_vehicle

SEDAN = load_vehicle("sedan")
CAR = Outline(front=2.0, rear=-2.0, width=1.8)


def made_up(t, **columns):
    """A run with some columns; zeros in the others."""
    return Run({name: np.asarray(columns.get(name, np.zeros(len(t))), float) for name in COLUMNS} | {"t_s": t})


def values(found):
    return {item.key: item.value for item in found}


# ---- lanes -----------------------------------------------------------------------------------------------------------


def through(offset, yaw=0.0, last=80.0):
    """A car along the middles of the lanes of ISO 3888-2 for its width, and `offset` to the left of them."""
    course = obstacle_avoidance_course(CAR, 10.0)
    first, second, third = (lane.middle for lane in course.lanes)
    x = np.linspace(0.0, last, 801)
    y = np.interp(x, [24.5, 33.0, 49.0, 56.5], [first, second, second, third]) + offset
    return course, made_up(x / 10.0, x_m=x, y_m=y, yaw_rad=np.full(x.shape, yaw))


def test_a_car_along_the_middles_passes_by_half_the_room():
    course, run = through(0.0)
    found = lane_verdicts(run, course)
    # (1.1 w + 0.25 - w) / 2, (w + 1 - w) / 2 and (3 - w) / 2
    assert [item.value for item in found[:3]] == pytest.approx([-0.215, -0.5, -0.6], abs=1e-9)
    assert passed(found)


@pytest.mark.parametrize(("offset", "cone"), [(0.3, "1L"), (-0.3, "1R")])
def test_what_is_beyond_a_lane_is_told_with_its_cone(offset, cone):
    course, run = through(offset)
    first, second, third, end = lane_verdicts(run, course)
    assert first.value == pytest.approx(0.085, abs=1e-9)
    assert (first.passed, second.passed, third.passed, end.passed) == (False, True, True, True)
    assert cone in first.where
    assert not passed([first, second, third, end])


def test_a_corner_between_two_rows_is_seen():
    """Two rows 40 m apart: the first lane lies between them. Yawed by 0.2 rad a corner is 0.894 cos + 2 sin aside."""
    course = obstacle_avoidance_course(CAR, 10.0)
    run = made_up(np.array([0.0, 1.0]), x_m=[-5.0, 35.0], yaw_rad=[0.2, 0.2])
    first = lane_verdicts(run, course)[0]
    assert first.value == pytest.approx(0.9 * math.cos(0.2) + 2.0 * math.sin(0.2) - course.lanes[0].left, abs=1e-9)


def test_an_edge_that_passes_a_cone_between_two_corners_is_seen():
    """Across the entry, at a right angle: no corner is in the lane, its sides are."""
    course = obstacle_avoidance_course(Outline(front=20.0, rear=-20.0, width=60.0), 10.0)
    run = made_up(np.array([0.0, 0.01]), x_m=[16.0, 16.0], yaw_rad=[0.0, 0.0])
    narrow = dataclasses.replace(course, lanes=(dataclasses.replace(course.lanes[0], right=-1.0, left=1.0),))
    assert lane_verdicts(run, narrow)[0].value == pytest.approx(29.0)


def test_a_car_that_stops_between_the_cones_has_not_passed():
    course, run = through(0.0, last=40.0)
    first, second, third, end = lane_verdicts(run, course)
    assert first.passed
    assert second.passed
    assert (third.passed, third.where, end.passed) == (False, "not reached", False)
    assert verdict_rows([third])[0]["value"] is None


def test_a_run_that_is_not_finite_is_judged_up_to_there():
    course, run = through(0.0)
    x = run["x_m"].copy()
    x[400:] = np.nan
    assert [item.passed for item in lane_verdicts(Run(run.columns | {"x_m": x}), course)] == [True, True, False, False]


# ---- sine with dwell -------------------------------------------------------------------------------------------------


def test_the_pattern_is_a_sine_whose_second_peak_lasts():
    """0.7 Hz: the first peak after a quarter of a period, the second from three quarters on for half a second."""
    times, heights = np.array(sine_pattern()).T
    period = 1.0 / 0.7
    assert np.interp([0.25 * period, 0.5 * period, 0.75 * period], times, heights) == pytest.approx(
        [1, 0, -1], abs=1e-3
    )
    assert np.interp([0.75 * period + 0.25, 0.75 * period + 0.49], times, heights) == pytest.approx(-1.0, abs=1e-3)
    assert (times[-1], heights[-1]) == (pytest.approx(period + 0.5), 0.0)


@pytest.mark.parametrize(("decay", "kept"), [(3.0, True), (0.4, False)])
def test_yaw_rates_after_the_dwell_are_over_the_peak_of_the_second_half(decay, kept):
    """A yaw rate that decays from its peak at the end of the steering by exp(-decay t)."""
    t = np.arange(-200, 601) * 0.01
    times, heights = np.array(sine_pattern()).T
    pattern = np.interp(t, times, heights, left=0.0, right=0.0)
    rate: Any = np.where(t < SINE_END, 0.5 * pattern, -0.6 * np.exp(-decay * (t - SINE_END)))
    lateral = 2.5 * np.clip(t, 0.0, None)
    run = made_up(t, steer=0.2 * pattern, yawrate_radps=rate, x_m=20.0 * t, y_m=lateral)
    what = maneuver("sine-with-dwell", SEDAN, steering=0.2)
    found = values(results(run, what))
    assert found["yaw_peak"] == pytest.approx(-0.6, rel=0.01)
    # rows are 10 ms apart: the peak's row is up to 10 ms late
    assert found["yaw_ratio_1"] == pytest.approx(100.0 * math.exp(-decay), rel=0.02)
    assert found["yaw_ratio_2"] == pytest.approx(100.0 * math.exp(-1.75 * decay), rel=0.02)
    assert found["displacement"] == pytest.approx(2.5 * 1.07, abs=1e-6)
    judged = verdicts(run, what)
    # 0.2 is more than five times the sedan's steering at 0.3 g: the displacement of 2.675 m counts, 1.83 m suffice
    assert [item.passed for item in judged] == [kept, kept, True, True]
    small = verdicts(run, maneuver("sine-with-dwell", SEDAN, steering=0.05))
    assert len(small) == 3


def test_a_run_that_ends_early_has_no_ratio():
    t = np.arange(-200, 100) * 0.01
    found = verdicts(made_up(t), maneuver("sine-with-dwell", SEDAN))
    assert passed(found) is False


# ---- fishhook --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("wheels", "rows", "kept"), [("FL RL", 10, False), ("FL RL", 2, True), ("FL RR", 10, True)])
def test_two_wheels_of_a_side_that_lift_together_are_a_lift(wheels, rows, kept):
    t = np.arange(0, 300) * 0.01
    loads = {f"Fz_{wheel}_N": np.full(t.shape, 4e3) for wheel in ("FL", "FR", "RL", "RR")}
    for wheel in wheels.split():
        loads[f"Fz_{wheel}_N"][100 : 100 + rows] = 0.0
    found = verdicts(made_up(t, **loads), maneuver("fishhook", SEDAN))
    assert passed(found) is kept


# ---- ISO 4138, ISO 7401 ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("constant", ["radius", "speed"])
@pytest.mark.parametrize(("gradient", "by_driver"), [(0.004, 0.006), (-0.001, 0.002), (-0.003, -0.001)])
def test_the_understeer_gradients_of_a_bicycle_are_found(constant, gradient, by_driver):
    """Road wheels turn by l / r + K a, the steering wheel over its ratio with another K: roll steer is between them.
    On a circle of 40 m and at 20 m/s, to the right; roll 0.01 rad per m/s².
    """
    t = np.arange(0, 6001) * 0.01
    lateral = -6.0 * t / 60.0
    speed = np.sqrt(40.0 * -lateral + 1e-9) if constant == "radius" else np.full(t.shape, 20.0)
    curvature = -np.full(t.shape, 1.0 / 40.0) if constant == "radius" else lateral / 400.0
    angle = SEDAN_WHEELBASE * curvature + gradient * lateral
    run = made_up(
        t, latacc_com_mps2=lateral, speed_mps=speed, yawrate_radps=speed * curvature, steerangle_FL_rad=angle + 0.01,
        steerangle_FR_rad=angle - 0.01, roll_rad=0.01 * lateral,
        steer=(SEDAN_WHEELBASE * curvature + by_driver * lateral) / angle_per_steering(SEDAN),
    )  # fmt: skip
    name = "steady-state-circle" if constant == "radius" else "slow-steer"
    found = values(results(run, maneuver(name, SEDAN)))
    # means over a second of a curve (v of a) are off by its curvature: less than one in a thousand of l / r
    assert found["understeer_gradient"] == pytest.approx(gradient, abs=3e-5)
    assert found["understeer_handwheel_gradient"] == pytest.approx(by_driver, abs=3e-5)
    for prefix in ("understeer", "understeer_handwheel"):
        per_g = math.degrees(found[f"{prefix}_gradient"]) * 9.81
        assert found[f"{prefix}_gradient_deg_g"] == pytest.approx(per_g)
    key = "characteristic_speed" if by_driver > 0.0 else "critical_speed"
    assert found[key] == pytest.approx(math.sqrt(SEDAN_WHEELBASE / abs(by_driver)), rel=0.02)
    assert found["roll_gradient"] == pytest.approx(math.degrees(0.01) * 9.81, rel=0.01)
    assert found["understeer_straightness"] > 0.98


def test_a_curve_in_place_of_a_line_has_gradients_by_bands():
    """Oversteer below 2.6 m/s², understeer above, as the HMMWV has it: one line through both has no sure sign."""
    t = np.arange(0, 6001) * 0.01
    lateral = 6.0 * t / 60.0
    curvature = lateral / 400.0
    angle = SEDAN_WHEELBASE * curvature + 0.001 * (lateral - 2.6) ** 2
    run = made_up(
        t, latacc_com_mps2=lateral, speed_mps=np.full(t.shape, 20.0), yawrate_radps=20.0 * curvature,
        steerangle_FL_rad=angle, steerangle_FR_rad=angle, steer=angle, roll_rad=0.01 * lateral,
    )  # fmt: skip
    found = values(results(run, maneuver("slow-steer", SEDAN)))
    # with u = a - 2.5 from -1.5 to 1.5: u² has a variance of 1.5⁴ · 4/45 = 0.45, the slope's -0.2 u one of 0.03
    assert found["understeer_straightness"] == pytest.approx(0.03 / 0.48, abs=0.005)
    assert math.isnan(found["understeer_gradient"])
    assert math.isnan(found["understeer_gradient_deg_g"])
    # a line of least squares through a parabola rises as its tangent in the middle; the last band ends at 90 % of what
    # is reached, of which the mean over the last half second is 5.975 m/s²
    for key, middle in (("1", 1.5), ("2", 3.0), ("4", 0.5 * (4.0 + 0.9 * 5.975))):
        slope = 0.002 * (middle - 2.6)
        assert found[f"understeer_{key}_deg_g"] == pytest.approx(math.degrees(slope) * 9.81, abs=0.01)


SEDAN_WHEELBASE = 2.776


def test_a_second_order_step_response_has_its_times_and_overshoot():
    """Yaw rate as r0 (1 - e^(-z w t) ...), damping 0.5 and 8 rad/s: overshoot exp(-pi z / sqrt(1 - z²)) = 16.3 %."""
    t = np.arange(-200, 601) * 0.01
    steer = 0.1 * np.clip(t / 0.1, 0.0, 1.0)
    damping, rate = 0.5, 8.0
    later = np.clip(t - 0.05, 0.0, None)
    free = rate * math.sqrt(1.0 - damping**2)
    response = 1.0 - np.exp(-damping * rate * later) * (
        np.cos(free * later) + damping * rate / free * np.sin(free * later)
    )
    run = made_up(t, steer=steer, yawrate_radps=0.3 * response, latacc_com_mps2=4.0 * response)
    found = values(results(run, maneuver("step-input", SEDAN, steering=0.1)))
    assert found["yaw_gain"] == pytest.approx(3.0, rel=1e-3)
    assert found["yaw_overshoot"] == pytest.approx(16.3, abs=0.2)
    assert found["yaw_peak_time"] == pytest.approx(math.pi / free, abs=0.011)
    assert found["lateral_gain"] == pytest.approx(40.0, rel=1e-3)


# ---- braking, hills --------------------------------------------------------------------------------------------------


def test_a_stop_with_constant_deceleration_has_its_distance():
    """8 m/s² from 20 m/s: 25 m in 2.5 s, drifting to the left by 0.4 m while it turns by 3 degrees."""
    t = np.arange(0, 401) * 0.01
    speed = np.clip(20.0 - 8.0 * t, 0.0, None)
    part = np.clip(t / 2.5, 0.0, 1.0)
    way = 20.0 * np.minimum(t, 2.5) - 4.0 * np.minimum(t, 2.5) ** 2
    run = made_up(t, speed_mps=speed, x_m=way, y_m=0.4 * part, yaw_rad=math.radians(3.0) * part)
    what = maneuver("braking", SEDAN, speed=20.0)
    found = values(results(run, what))
    # standstill is 5 cm/s: nothing is left of the way
    assert found["stopping_distance"] == pytest.approx(25.0, abs=0.01)
    assert found["mean_deceleration"] == pytest.approx(8.0, rel=1e-3)
    assert found["developed_deceleration"] == pytest.approx(8.0, rel=0.01)
    assert found["yaw_deviation"] == pytest.approx(3.0, rel=0.01)
    assert found["course_deviation"] == pytest.approx(0.4, rel=0.01)
    assert passed(verdicts(run, what)) is True
    turned = Run(run.columns | {"yaw_rad": math.radians(20.0) * part})
    assert [item.passed for item in verdicts(turned, what)] == [True, False, True]


def test_a_vehicle_that_brakes_on_its_circle_keeps_its_yaw_rate_over_speed():
    """On a circle of 40 m to the right, from 12 m/s with 5 m/s²: 1.0 is the ratio of one that stays on it."""
    t = np.arange(0, 401) * 0.01
    end = np.minimum(t, 12.0 / 5.0)
    speed, way = 12.0 - 5.0 * end, 12.0 * end - 2.5 * end**2
    yaw = -way / 40.0
    run = made_up(
        t, speed_mps=speed, yawrate_radps=-speed / 40.0, yaw_rad=yaw, x_m=-40.0 * np.sin(yaw),
        y_m=40.0 * (np.cos(yaw) - 1.0), latacc_com_mps2=-(speed**2) / 40.0,
    )  # fmt: skip
    found = values(results(run, maneuver("brake-in-turn", SEDAN)))
    assert found["steady_radius"] == pytest.approx(-40.0)
    assert found["yaw_rate_ratio"] == pytest.approx(1.0, abs=1e-6)
    assert found["mean_deceleration"] == pytest.approx(5.0, abs=1e-9)
    # differences of rows 10 ms apart are an angle of 1.5e-3 rad off at the ends
    assert abs(found["path_deviation"]) < 0.02
    assert found["peak_sideslip"] < 0.2


def test_times_of_a_constant_acceleration():
    """3 m/s² from rest: 100 km/h after v / a, the quarter mile after sqrt(2 s / a)."""
    t = np.arange(0, 2001) * 0.01
    run = made_up(t, speed_mps=3.0 * t, x_m=1.5 * t**2)
    found = values(results(run, maneuver("acceleration", SEDAN)))
    assert found["time_to_100_kmh"] == pytest.approx(100.0 / 3.6 / 3.0, abs=1e-6)
    assert found["quarter_mile"] == pytest.approx(math.sqrt(2.0 * 402.336 / 3.0), abs=1e-4)
    assert found["quarter_mile_speed"] == pytest.approx(math.sqrt(2.0 * 402.336 * 3.0), abs=1e-3)
    assert found["greatest_acceleration"] == pytest.approx(3.0)


def test_peaks_over_a_bump_are_those_of_a_sine():
    """Height 0.05 sin(6 t): accelerations of 1.8 m/s²; loads and pitch as they are given."""
    t = np.arange(0, 401) * 0.01
    wave = np.sin(6.0 * t)
    loads = {f"Fz_{wheel}_N": 4e3 * (1.0 + share * wave) for wheel, share in
             (("FL", 0.5), ("FR", 0.4), ("RL", 0.2), ("RR", 0.1))}  # fmt: skip
    found = values(results(made_up(t, z_m=0.05 * wave, pitch_rad=0.01 * wave, **loads), maneuver("bump", SEDAN)))
    # second differences of rows 10 ms apart: 1 - (6 x 0.01)² / 3
    assert (found["peak_up"], found["peak_down"]) == (pytest.approx(1.8, rel=2e-3), pytest.approx(1.8, rel=2e-3))
    assert found["pitch_range"] == pytest.approx(math.degrees(0.02), rel=1e-3)
    assert (found["front_load"], found["rear_load"]) == (pytest.approx(1.5, rel=1e-3), pytest.approx(1.2, rel=1e-3))
    assert found["least_load"] == pytest.approx(0.5, rel=1e-3)


def test_a_hill_start_that_rolls_back_has_not_passed():
    t = np.arange(0, 1001) * 0.01
    what = maneuver("hill-start", SEDAN)
    lean = math.atan(what.slope)
    for back, kept in ((0.1, True), (0.5, False)):
        way = np.where(t < 3.0, 0.0, -back * np.clip(t - 3.0, 0.0, 1.0) + np.clip(t - 4.0, 0.0, None) ** 2)
        run = made_up(t, x_m=math.cos(lean) * way, z_m=math.sin(lean) * way)
        assert values(results(run, what))["rollback"] == pytest.approx(1e3 * back, rel=1e-6)
        assert passed(verdicts(run, what)) is kept


def test_manoeuvres_without_rules_have_no_verdict():
    run = made_up(np.arange(0, 100) * 0.01)
    assert verdicts(run, Maneuver(name="slope-hold", duration=1.0)) == []
    assert passed([]) is None
