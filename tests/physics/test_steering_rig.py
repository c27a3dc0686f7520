"""A steering from lock to lock against Ackermann's geometry and the circle that its wheels roll on."""

from __future__ import annotations

import numpy as np
import pytest

from simwarp.vehicle.rigs import RowStatus, run_steering_rig
from simwarp.vehicle.rigs.steering_rig import _turning_points, ackermann_difference
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.vehicle.suspensions.kinematics import travel_table
from tests.physics.sample_vehicles import shipped

WHEELBASE, TRACK = 3.0, 1.6


def ideal(radius: np.ndarray) -> np.ndarray:
    """(n, 2) headings of front wheels that roll about a point of the rear axle's line, `radius` to the left."""
    return np.stack([np.arctan(WHEELBASE / (radius - way * TRACK / 2.0)) for way in (1.0, -1.0)], axis=1)


def test_ideal_wheels_have_all_of_ackermanns_difference():
    radius = np.array([-20.0, -6.0, 6.0, 20.0])
    steer = ideal(radius)
    found = ackermann_difference(steer, WHEELBASE, TRACK)
    assert found == pytest.approx(np.abs(steer[:, 0] - steer[:, 1]), rel=1e-12)
    centers = np.array([[[WHEELBASE, 0.8], [WHEELBASE, -0.8], [0.0, 0.8], [0.0, -0.8]]] * 4)
    headings = np.concatenate([steer, np.zeros((4, 2))], axis=1)
    assert _turning_points(centers, headings) == pytest.approx(np.stack([0.0 * radius, radius], axis=1), abs=1e-9)


@pytest.mark.parametrize("name", ["hmmwv", "sedan", "gator", "artcar"])
def test_angles_are_those_of_the_linkage(name):
    spec = shipped(name)
    curve = run_steering_rig(spec, points=11, box_ratio=2.0)
    assert (curve.status == RowStatus.DONE).all()
    table = travel_table(spec, 0, 0.0, np.linspace(-1.0, 1.0, 11))
    assert curve.steer == pytest.approx(table.steer, abs=1e-12)
    assert curve.handwheel[-1] == pytest.approx(2.0 * spec.steerings[0].steering.max_angle)
    left, right = curve.steer.T
    inner, outer = left[-1], right[-1]
    base = spec.axles[0].location[0] + spec.axles[0].suspension.spindle.com[0]
    base -= spec.axles[1].location[0] + spec.axles[1].suspension.spindle.com[0]
    base += table.center[-1, :, 0].mean() - table.center[5, :, 0].mean()
    track = table.center[-1, 0, 1] - table.center[-1, 1, 1]
    wanted = np.arctan(1.0 / (1.0 / np.tan(inner) + track / base))
    assert curve.ackermann[-1] == pytest.approx((inner - outer) / (inner - wanted), rel=1e-9)
    # symmetric: what the left lock does on the left, the right lock does on the right
    assert curve.steer[0] == pytest.approx(-curve.steer[-1, ::-1], abs=1e-6)
    assert curve.kerb_circle[0] == pytest.approx(curve.kerb_circle[-1], rel=1e-5)
    # between the circles of wheels that turn as the outer and as the inner one
    circles = [2.0 * base / np.sin(angle) for angle in (outer, inner)]
    assert min(circles) < curve.kerb_circle[-1] < max(circles) + 2.0 * track
    assert curve.turn_radius[-1] > 0.0 > curve.turn_radius[0]


def test_the_ratio_is_the_slope_of_the_angles():
    curve = run_steering_rig(shipped("sedan"), points=41)
    mean = curve.steer.mean(axis=1)
    slope = (mean[21] - mean[19]) / (curve.handwheel[21] - curve.handwheel[19])
    assert curve.ratio[20] == pytest.approx(1.0 / slope, rel=1e-9)
    assert np.isfinite(curve.ratio).all()


def test_the_kerb_circle_is_that_of_the_lowest_points():
    """Of 3600 points of each wheel's circle the lowest one is the contact point within half a degree times the lean in
    radians, 0.1 mm aside; wheels lean by up to 5 degrees at lock, which moves their contact points by 7 to 30 mm.
    """
    spec = shipped("sedan")
    curve = run_steering_rig(spec, points=3)
    tables = [travel_table(spec, axle, 0.0, 1.0) for axle in (0, 1)]
    centers, axes = (np.concatenate([getattr(t, name)[0] for t in tables]) for name in ("center", "axis"))
    headings = np.concatenate([t.steer[0] for t in tables])
    turning = _turning_points(centers[None, :, :2], headings[None])[0]
    angle = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)[:, None]
    away = []
    for center, axis, wheel in zip(centers, axes, (0, 0, 1, 1), strict=True):
        ahead = np.cross(axis, (0.0, 0.0, 1.0))
        ahead /= np.linalg.norm(ahead)
        points = center + spec.axles[wheel].tire.radius * (
            np.cos(angle) * ahead + np.sin(angle) * np.cross(axis, ahead)
        )
        away.append(np.linalg.norm(points[points[:, 2].argmin(), :2] - turning))
    assert curve.kerb_circle[-1] == pytest.approx(2.0 * max(away), abs=5e-4)


@pytest.mark.parametrize(
    ("vehicle", "options", "message"),
    [
        ("skid-steer", {}, "'skid-steer' has no steered axle"),
        ("sedan", {"axle": 1}, "axle: must be a steered one of 'sedan' .0., got 1"),
        ("sedan", {"axle": 5}, "axle: must be from 0 .front. to 1"),
        ("sedan", {"points": 2}, "points: must be 3 or more"),
        ("sedan", {"box_ratio": 0.0}, "box_ratio: must be > 0"),
    ],
)
def test_what_does_not_steer_is_one_line(vehicle, options, message):
    with pytest.raises(SpecError, match=message):
        run_steering_rig(shipped(vehicle), **options)
