"""Suspensions on their bench against linkages solved in NumPy, a planar one in closed form, and a standing vehicle."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from simwarp.vehicle.rigs import (
    RowStatus,
    SuspensionMotion,
    SuspensionReference,
    SuspensionRun,
    run_suspension_rig,
)
from simwarp.vehicle.rigs.post_rig import PostRig
from simwarp.vehicle.rigs.suspension_meanings import suspension_meanings
from simwarp.vehicle.spec.drivetrain_parts import SimpleDriveline
from simwarp.vehicle.spec.parts import BUMP_STOP
from simwarp.vehicle.spec.vehicle_spec import AntirollBar, SpecError, VehicleSpec
from tests.physics.sample_vehicles import samples, shipped
from tests.reference.double_wishbone import LeftWheel, four_bar
from tests.reference.suspension_kinematics import exponential, newton

BUILT = SuspensionReference.BUILT


def spring_force(line: Any, length: float, built: float) -> float:
    """Linear springs and tables between their ends, without bump stops."""
    rest = built if line.rest_length is None else line.rest_length
    if line.spring_curve is None:
        return float(line.preload - line.stiffness * (length - rest))
    x, y = zip(*line.spring_curve, strict=True)
    return float(line.preload - np.interp(length - rest, x, y))


@pytest.mark.quick("artcar rear")
@pytest.mark.parametrize("case", ["sedan rear", "hmmwv rear", "artcar rear"])
def test_levers_of_double_wishbones(case):
    """Rates of the rig are differences over 2 mm: their error is a third derivative times 2e-7 m², below 1e-4 of any
    ratio of these linkages.
    """
    name, travel = case.split()[0], 0.01 if case.startswith("artcar") else 0.04
    spec = shipped(name)
    radius, part = 0.9 * spec.axles[1].tire.radius, spec.axles[1]
    run = run_suspension_rig(spec, 1, travel=travel, points=5, reference=BUILT, loaded_radius=radius)
    curve = run.curves[SuspensionMotion.PARALLEL]
    assert (curve.status == RowStatus.DONE).all()
    reference = LeftWheel(part.suspension, part.location, radius, spring_force)
    lever = run.loads.wheelbase / run.loads.com_height
    for row, height in enumerate(np.linspace(-travel, travel, 5)):
        corner = reference.at(float(height))
        assert curve.toe[row, 0] == pytest.approx(corner.toe, abs=1e-6)
        assert curve.camber[row, 0] == pytest.approx(corner.camber, abs=1e-6)
        assert curve.caster[row, 0] == pytest.approx(corner.caster, abs=1e-6)
        assert curve.kingpin_inclination[row, 0] == pytest.approx(corner.kingpin_inclination, abs=1e-6)
        assert curve.scrub_radius[row, 0] == pytest.approx(corner.scrub_radius, abs=1e-6)
        assert curve.trail[row, 0] == pytest.approx(corner.trail, abs=1e-6)
        assert curve.motion_ratio[row, 0] == pytest.approx(corner.motion_ratio, abs=1e-4)
        assert curve.roll_centre[row] == pytest.approx([0.0, corner.roll_centre], abs=1e-4)
        assert curve.spring_load[row, 0] == pytest.approx(corner.load, rel=3e-4)
        assert curve.anti_dive[row, 0] == pytest.approx(
            -run.loads.brake_share[1] * lever * corner.slope[0] / corner.slope[2], abs=1e-3
        )
        assert curve.anti_squat[row, 0] == pytest.approx(-lever * corner.center_slope[0], abs=1e-3)
        assert curve.track_change[row] == pytest.approx(
            2.0 * (corner.contact[1] - reference.at(0.0).contact[1]), abs=1e-6
        )


def test_the_wheel_rate_is_the_springs_and_what_the_lever_adds():
    """dW/dz = k MR² + P dMR/dz. The rig takes slopes between points 2 mm apart: an error of some 1e-5."""
    spec = shipped("sedan")
    part = spec.axles[1]
    radius, line = 0.3, part.suspension.springs[0]
    run = run_suspension_rig(spec, 1, travel=0.02, points=21, reference=BUILT, loaded_radius=radius)
    reference = LeftWheel(part.suspension, part.location, radius, spring_force)
    above, here, below = (reference.at(height) for height in (1e-3, 0.0, -1e-3))
    change = float(above.motion_ratio[0] - below.motion_ratio[0]) / 2e-3
    ratio = float(here.motion_ratio[0])
    push = here.load / ratio
    rate = line.stiffness * ratio**2 + push * change
    parallel, opposite = (run.curves[m] for m in (SuspensionMotion.PARALLEL, SuspensionMotion.OPPOSITE))
    assert parallel.wheel_rate[10] == pytest.approx([rate, rate], rel=1e-3)
    # without a bar between its wheels, an axle resists rolling by half the square of its track
    track = 2.0 * float(here.contact[1])
    assert opposite.roll_stiffness[10] == pytest.approx(0.5 * rate * track**2, rel=1e-3)


def planar(spec: VehicleSpec) -> VehicleSpec:
    """A vehicle whose rear axle moves in front view alone: all hinges ahead, the tie rod beside the lower arm."""
    part: Any = spec.axles[1].suspension

    def along(point: Any, x: float, like: Any) -> Any:
        return (x, like[1], like[2])

    low_in, low_out = part.lower_arm_front, part.lower_arm_upright
    high_in, high_out = part.upper_arm_front, part.upper_arm_upright
    made = dataclasses.replace(
        part, lower_arm_front=along(0, 0.1, low_in), lower_arm_back=along(0, -0.1, low_in),
        lower_arm_upright=along(0, 0.0, low_out), upper_arm_front=along(0, 0.1, high_in),
        upper_arm_back=along(0, -0.1, high_in), upper_arm_upright=along(0, 0.0, high_out),
        tierod_chassis=along(0, -0.15, low_in), tierod_upright=along(0, -0.15, low_out),
    )  # fmt: skip
    axles = (spec.axles[0], dataclasses.replace(spec.axles[1], suspension=made))
    return dataclasses.replace(spec, axles=axles)


def test_the_roll_centre_lies_on_the_line_to_the_instant_centre():
    """A planar linkage: camber is the four-bar's turn; the line from the contact point to the crossing of both arms
    meets the middle plane in the roll centre. Differences over 2 mm leave 1e-5 of a metre's lever.
    """
    spec = planar(shipped("sedan"))
    part: Any = spec.axles[1].suspension
    radius = 0.3
    run = run_suspension_rig(spec, 1, travel=0.04, points=5, reference=BUILT, loaded_radius=radius)
    curve, place = run.curves[SuspensionMotion.PARALLEL], np.array(spec.axles[1].location)

    def front(point: Any) -> Any:
        return (place + np.array(point))[1:]

    lower = (front(part.lower_arm_front), front(part.lower_arm_upright))
    upper = (front(part.upper_arm_front), front(part.upper_arm_upright))
    for row, height in enumerate(np.linspace(-0.04, 0.04, 5)):
        turn, center, instant = four_bar(lower, upper, front(part.spindle.com), float(height))
        assert curve.camber[row, 0] == pytest.approx(-turn, abs=1e-7)
        assert curve.toe[row, 0] == pytest.approx(0.0, abs=1e-7)
        contact = center + radius * np.array([np.sin(turn), -np.cos(turn)])
        slope = (instant[1] - contact[1]) / (instant[0] - contact[0])
        assert curve.roll_centre[row, 1] == pytest.approx(-slope * contact[0], abs=2e-5)
        # rear brakes and drive forces find no lever in a linkage that moves straight up
        assert curve.anti_dive[row, 0] == pytest.approx(0.0, abs=1e-6)
        assert curve.anti_squat[row, 0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
def test_an_antiroll_bar_stiffens_rolling_alone():
    """Its arms turn so that the drop links keep their length; the roll stiffness grows by k (d twist / d roll)²."""
    spec = shipped("sedan")
    axle = spec.axles[1]
    length, width, drop, stiffness = 0.6, 0.2, -0.1, 2000.0
    bar = AntirollBar(
        location=axle.location, arm_mass=1.0, arm_inertia=(0.03, 0.01, 0.03), arm_length=length, arm_width=width,
        droplink_height=drop, stiffness=stiffness,
    )  # fmt: skip
    barred = dataclasses.replace(spec, axles=(spec.axles[0], dataclasses.replace(axle, antiroll_bar=bar)))
    plain, stiff = (
        run_suspension_rig(each, 1, travel=0.01, points=9, reference=BUILT, loaded_radius=0.3).curves
        for each in (spec, barred)
    )
    reference, place = LeftWheel(axle.suspension, axle.location, 0.3, spring_force), np.array(axle.location)

    def turn(travel: float) -> float:
        """Of the left arm about the bar's axis."""
        foot = reference.lower_arm(reference.upright(travel))(place + np.array([width, length, drop]))

        def gap(x: np.ndarray) -> np.ndarray:
            top = place + exponential(np.array([0.0, float(x[0]), 0.0])) @ np.array([width, length, 0.0])
            return np.array([np.linalg.norm(top - foot) - abs(drop)])

        return float(newton(gap, np.zeros(1))[0])

    track = 2.0 * float(reference.at(0.0).contact[1])
    twist = 2.0 * (turn(1e-4) - turn(-1e-4)) / 2e-4  # of both arms, per travel of the left wheel
    gain = stiff[SuspensionMotion.OPPOSITE].roll_stiffness[4] - plain[SuspensionMotion.OPPOSITE].roll_stiffness[4]
    assert gain == pytest.approx(stiffness * (twist * track / 2.0) ** 2, rel=2e-3)
    assert stiff[SuspensionMotion.PARALLEL].wheel_rate == pytest.approx(
        plain[SuspensionMotion.PARALLEL].wheel_rate, rel=1e-5
    )


CASES: dict[str, tuple[Any, int]] = {
    **{
        f"{name} {axle}": (shipped(name), axle)
        for name in ("hmmwv", "hmmwv-reduced", "sedan", "artcar")
        for axle in (0, 1)
    },
    "gator 0": (shipped("gator"), 0),
    **{f"{name} 1": (spec, 1) for name, spec in samples().items() if name != "rigid-suspension"},
}


def mirrored(run: SuspensionRun) -> None:
    """A symmetric axle: left and right are alike in parallel travel, exchanged in opposite travel."""
    for motion, curve in run.curves.items():
        assert (curve.status == RowStatus.DONE).all()
        for name in ("toe", "camber", "caster", "kingpin_inclination", "scrub_radius", "trail", "spring_load"):
            values = getattr(curve, name)
            other = values[:, ::-1] if motion is SuspensionMotion.PARALLEL else values[::-1, ::-1]
            scale = max(1.0, float(np.nanmax(np.abs(values), initial=0.0)))
            assert values == pytest.approx(other, abs=1e-5 * scale, nan_ok=True), (motion, name)


@pytest.mark.quick("artcar 1", "trailing-arm 1", "pinned-axle 1")
@pytest.mark.parametrize("case", CASES)
def test_left_and_right_mirror_each_other(case):
    spec, axle = CASES[case]
    run = run_suspension_rig(spec, axle, travel=0.1 * spec.axles[axle].tire.radius, points=5, reference=BUILT)
    if case.startswith("pinned-axle"):  # its right wheel travels as the left one makes it: they lean alike
        leaning = run.curves[SuspensionMotion.OPPOSITE].camber
        assert list(run.curves) == [SuspensionMotion.OPPOSITE]
        assert leaning[:, 0] == pytest.approx(-leaning[:, 1], abs=1e-7)
        return
    mirrored(run)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hmmwv", "artcar"])
def test_springs_bear_the_standing_vehicle(name):
    """The bench finds from hardpoints, springs and weights where a simulated vehicle settles on posts without grip. The
    lever rule is that of the vehicle as built: it leaves the shift of the load as the vehicle pitches.
    """
    spec = shipped(name)
    rig = PostRig(spec, 1, grip=1e-3)
    built = [body.pose.position[2] for body in rig.simulation.model.builder.bodies]
    rig.simulation.step(4000)
    chassis = built[rig.vehicle.parts.chassis]
    travel = rig.suspension_travel()[0] - [built[body] - chassis for body in rig.spindles]
    for axle in (0, 1):
        run = run_suspension_rig(spec, axle, points=3)
        load = rig.loads()[0, 2 * axle : 2 * axle + 2].mean()
        rate = run.parameters()["wheel_rate_N_per_mm"] * 1e3
        shift = (load - run.loads.wheel_load[axle]) / rate
        assert travel[2 * axle : 2 * axle + 2].mean() == pytest.approx(run.reference_travel + shift, abs=1.5e-4)


@pytest.mark.slow
def test_worlds_that_do_not_reach_are_marked_and_the_others_stay():
    """Arms of the model car end at some centimetres. Rates of the last states are of those that are reached."""
    run = run_suspension_rig(shipped("artcar"), 1, travel=0.2, points=21, reference=BUILT)
    curve = run.curves[SuspensionMotion.PARALLEL]
    lost = curve.status == RowStatus.DIVERGED
    assert 0 < lost.sum() < 21
    assert np.isnan(curve.camber[lost]).all()
    assert np.isfinite(curve.camber[~lost]).all()
    # the trapezoidal rule gives the load back: its error is the rate's curvature over 2 cm, most near the end of travel
    rate, load, height = (values[~lost, 0] for values in (curve.wheel_rate, curve.spring_load, curve.travel))
    assert 0.5 * (rate[1:] + rate[:-1]) * np.diff(height) == pytest.approx(np.diff(load), rel=0.1)
    assert (curve.wheel_rate[~lost] > 0.0).all()
    assert (run.curves[SuspensionMotion.OPPOSITE].roll_stiffness[~lost & ~lost[::-1]] > 0.0).all()


@pytest.mark.parametrize(
    ("vehicle", "axle", "options", "message"),
    [
        ("gator", 1, {}, "must have a suspension that travels, got 'rigid-suspension'"),
        ("gator", 2, {}, "axle: must be from 0 .front. to 1 of 'gator', got 2"),
        ("sedan", 0, {"travel": 0.0}, "travel: must be > 0 m, got 0: the range would be empty"),
        (
            "sedan",
            0,
            {"loaded_radius": 0.0},
            "loaded_radius: must be above 0 and at most the tire's radius of .*, got 0",
        ),
        ("sedan", 0, {"loaded_radius": np.nan}, "loaded_radius: must be above 0"),
        ("sedan", 0, {"points": 4}, "points: must be an odd number"),
    ],
)
def test_what_no_bench_can_hold_is_one_line(vehicle, axle, options, message):
    with pytest.raises(SpecError, match=message):
        run_suspension_rig(shipped(vehicle), axle, **options)


def with_stops(spec: VehicleSpec, axle: int, **lengths: float) -> VehicleSpec:
    """A vehicle whose first spring of an axle has stops at these lengths [m]."""
    part = spec.axles[axle]
    sprung: Any = part.suspension
    stopped = dataclasses.replace(sprung.springs[0], bump_curve=BUMP_STOP, **lengths)
    part = dataclasses.replace(part, suspension=dataclasses.replace(sprung, springs=(stopped, *sprung.springs[1:])))
    return dataclasses.replace(spec, axles=(*spec.axles[:axle], part, *spec.axles[axle + 1 :]))


@pytest.mark.slow
@pytest.mark.parametrize("stop", ["bump", "rebound"])
def test_stops_are_marked_and_their_share_of_the_rate_is_told(stop):
    """A stop that begins at half the travel. Without it, loads are those of the vehicle that has none, bitwise; with
    it, beside its beginning, the rate is larger by that of the stop times the square of the motion ratio.
    """
    spec = shipped("sedan")
    options: dict[str, Any] = {"travel": 0.02, "points": 21, "reference": BUILT, "loaded_radius": 0.3}
    plain = run_suspension_rig(spec, 1, **options).curves
    ratio = plain[SuspensionMotion.PARALLEL].motion_ratio[:, 0, 0]
    line = spec.axles[1].suspension.springs[0]
    built = math.dist(line.chassis_point, line.arm_point)
    sign = -1.0 if stop == "bump" else 1.0  # a bump stop meets a line that is shorter
    key = "min_length" if stop == "bump" else "max_length"
    begin = built + sign * 0.01 * float(ratio[10])
    found = run_suspension_rig(with_stops(spec, 1, **{key: begin}), 1, **options)
    for motion in (SuspensionMotion.PARALLEL, SuspensionMotion.OPPOSITE):
        curve = found.curves[motion]
        assert (curve.free_wheel_rate == plain[motion].wheel_rate).all()
        assert (plain[motion].free_wheel_rate == plain[motion].wheel_rate).all()
        assert (plain[motion].into_stop == 0.0).all()
        travel = -sign * curve.travel[:, 0]
        inside = curve.stop_names(0) == stop
        assert set(curve.stop_names(0)) == {"", stop}
        assert (inside == (travel > 0.0102)).all() or (inside == (travel > 0.0098)).all()
    curve = found.curves[SuspensionMotion.PARALLEL]
    deep = np.flatnonzero(-sign * curve.travel[:, 0] > 0.0125)
    deep = deep[(deep > 0) & (deep < 20)]
    added = (curve.wheel_rate - curve.free_wheel_rate)[deep, 0]
    # 1e5 N/m of the stop, up to its 10 mm; its load of at most 500 N on the ratio's slope adds some hundredths
    assert added == pytest.approx(1e5 * ratio[deep] ** 2, rel=0.05)
    column = found.rows()["stop_L"]
    assert list(column[:21]) == list(curve.stop_names(0))
    assert found.parameters()["into_stop_mm"] == 0.0


@pytest.mark.slow
def test_shares_in_braking_and_driving_are_named_by_the_axle():
    """A front axle dives in braking and lifts in driving; a rear one lifts and squats. One without a drive has none."""
    spec = shipped("artcar")
    rear = SimpleDriveline(front_torque_fraction=0.0, front_gear_ratio=1.0, rear_gear_ratio=1.0)
    names = {}
    for drive, driveline in (("rear", rear), ("both", dataclasses.replace(rear, front_torque_fraction=0.5))):
        for axle in (0, 1):
            vehicle = dataclasses.replace(spec, driveline=driveline)
            run = run_suspension_rig(vehicle, axle, travel=0.005, points=3, reference=BUILT)
            names[drive, axle] = [key for key in run.parameters() if key.startswith("anti_")]
            columns = [key for key in run.rows().columns if key.startswith("anti_") and "_L_" in key]
            assert sorted(columns) == sorted(key.replace("_percent", "_L_percent") for key in names[drive, axle])
            assert set(suspension_meanings(run.parameters(), front=run.front)) == set(run.parameters())
    assert names["rear", 0] == ["anti_dive_percent"]
    assert names["rear", 1] == names["both", 1] == ["anti_lift_percent", "anti_squat_percent"]
    assert names["both", 0] == ["anti_dive_percent", "anti_lift_percent"]


def test_gains_are_slopes_with_the_signs_that_the_table_tells():
    """Of a run, toe, track and steer of the states beside the middle one: the definitions once more, by hand."""
    run = run_suspension_rig(shipped("artcar"), 0, travel=0.004, points=3, reference=BUILT)
    parallel, opposite = run.curves[SuspensionMotion.PARALLEL], run.curves[SuspensionMotion.OPPOSITE]
    found, rise = run.parameters(), np.ptp(parallel.travel[:, 0])
    assert found["toe_gain_deg_per_m"] == pytest.approx(np.rad2deg(parallel.toe[2, 0] - parallel.toe[0, 0]) / rise)
    widened = parallel.track_change[2] - parallel.track_change[0]
    assert found["track_gain_mm_per_m"] == pytest.approx(1e3 * widened / rise)
    # the left wheel rises against the chassis: the chassis leans to the left
    leaning = 2.0 * math.atan2(2.0 * opposite.travel[2, 0], run.loads.track[0])
    heading = opposite.steer[2].mean() - opposite.steer[0].mean()
    assert opposite.travel[2, 0] > 0.0
    assert found["roll_steer_deg_per_deg"] == pytest.approx(heading / leaning, rel=1e-3)
    assert found["roll_camber_deg_per_deg"] == pytest.approx(
        (opposite.camber[2, 0] - opposite.camber[0, 0]) / leaning, rel=1e-3
    )
