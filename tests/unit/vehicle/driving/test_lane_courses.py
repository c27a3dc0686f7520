"""Courses of lanes: cones where the standards put them, outlines of the shipped vehicles, lines that keep between."""

import numpy as np
import pytest

from simwarp.cli import UsageError
from simwarp.cli.drive.drive_batch import parse_values
from simwarp.vehicle.driving.lane_courses import (
    double_lane_change_course,
    driven_line,
    obstacle_avoidance_course,
)
from simwarp.vehicle.driving.vehicle_outline import Outline, outline_of
from simwarp.vehicle.spec.vehicle_files import load_vehicle, vehicle_names
from simwarp.vehicle.spec.vehicle_spec import SpecError

CAR = Outline(front=2.2, rear=-2.2, width=1.8)


def test_cones_of_the_double_lane_change_are_where_the_standard_puts_them():
    """By hand for w = 1.8 m: 2.23, 2.41 and 2.59 m wide; the right edges are at -1.115, 2.385 and -1.115 m."""
    course = double_lane_change_course(CAR, 20.0)
    cones = {cone.name: (cone.x, cone.y) for cone in course.cones()}
    expected = {
        "1R1": (20.0, -1.115), "1L1": (20.0, 1.115), "1L3": (35.0, 1.115),
        "2R1": (65.0, 2.385), "2L1": (65.0, 4.795), "2L5": (90.0, 4.795),
        "3R1": (115.0, -1.115), "3L1": (115.0, 1.475), "3L5": (145.0, 1.475),
    }  # fmt: skip
    for name, place in expected.items():
        assert cones[name] == pytest.approx(place, abs=1e-12), name
    # 15 m in two parts, 25 and 30 m in four; on both sides
    assert len(cones) == 2 * (3 + 5 + 5)


def test_cones_of_the_obstacle_avoidance_are_where_the_standard_puts_them():
    """By hand for w = 1.8 m: 2.23 m, 2.8 m from 1 m beside the first lane's left edge, and 3 m instead of 2.59 m."""
    course = obstacle_avoidance_course(CAR, 0.0)
    assert [(lane.start, lane.end) for lane in course.lanes] == [(0.0, 12.0), (25.5, 36.5), (49.0, 61.0)]
    edges = [(lane.right, lane.left) for lane in course.lanes]
    assert np.array(edges) == pytest.approx(np.array([(-1.115, 1.115), (2.115, 4.915), (-1.115, 1.885)]), abs=1e-12)
    wide = obstacle_avoidance_course(Outline(front=2.0, rear=-2.0, width=2.2), 0.0)
    assert wide.lanes[2].width == pytest.approx(1.3 * 2.2 + 0.25)


def test_outlines_hold_wheels_and_body():
    """The sedan's wheels are wider than its body of 1.8 m, its body longer; of the HMMWV tires are the outermost."""
    sedan, hmmwv = (outline_of(load_vehicle(name)) for name in ("sedan", "hmmwv"))
    assert (sedan.front, sedan.rear) == (2.25, -2.25)
    assert sedan.width >= 1.8
    spec = load_vehicle("hmmwv")
    front = spec.axles[0].location[0] + spec.axles[0].suspension.spindle.com[0] + spec.axles[0].tire.radius
    assert hmmwv.front == pytest.approx(front)
    assert 2.0 < hmmwv.width < 2.2


def test_corners_turn_with_the_vehicle():
    corners = CAR.corners(np.array([1.0]), np.array([2.0]), np.array([0.5 * np.pi]))[0]
    assert corners == pytest.approx(np.array([[0.1, 4.2], [0.1, -0.2], [1.9, -0.2], [1.9, 4.2]]), abs=1e-12)


@pytest.mark.parametrize("name", vehicle_names())
@pytest.mark.parametrize("course_of", [double_lane_change_course, obstacle_avoidance_course])
def test_the_driven_line_keeps_the_outline_between_the_cones(name, course_of):
    """Corners of an outline along the line stay inside by nearly half the room (`share`), seen at many places."""
    outline = outline_of(load_vehicle(name))
    course = course_of(outline, 20.0)
    line = driven_line(course, 0.0, course.end + 20.0)
    x = np.linspace(5.0, course.end + 15.0, 3000)
    y = np.interp(x, *line.points.T)
    slope = np.interp(x, line.points[:, 0], np.gradient(line.points[:, 1], line.points[:, 0]))
    corners = outline.corners(x, y, np.arctan(slope)).reshape(-1, 2)
    for lane in course.lanes:
        inside = (corners[:, 0] >= lane.start) & (corners[:, 0] <= lane.end)
        over = np.maximum(corners[inside, 1] - lane.left, lane.right - corners[inside, 1])
        room = 0.5 * (lane.width - outline.width)
        # half of the room stays free up to the arc of the heading's small angle: sin and cos of 0.2 rad and less
        assert over.max() < -0.25 * room
    assert line.points[0, 1] == pytest.approx(0.0, abs=1e-9)
    assert line.points[-1, 1] == pytest.approx(course.lanes[-1].middle, abs=1e-9)


def test_a_line_that_cannot_be_is_one_error():
    course = double_lane_change_course(CAR, 20.0)
    with pytest.raises(SpecError, match=r"must begin before x = 20 m and end behind 145 m"):
        driven_line(course, 25.0, 200.0)


def test_values_of_a_batch():
    assert parse_values("speeds", "10:12:0.5") == [10.0, 10.5, 11.0, 11.5, 12.0]
    assert parse_values("speeds", "0.1:0.3:0.1") == [0.1, 0.2, 0.3]
    assert parse_values("speeds", "3,5.5") == [3.0, 5.5]
    for text, words in (
        ("10:5:1", "must rise"), ("1:2:0", "must rise"), ("x", "first:last:step"), ("1:2", "first:last:step"),
        ("1:1e9:1", "at most 1000"),
    ):  # fmt: skip
        with pytest.raises(UsageError, match=words):
            parse_values("speeds", text)
