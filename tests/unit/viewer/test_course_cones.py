"""Cones of a course in films, pictures and for sensors: outside of the lanes, and touching them."""

import numpy as np
import pytest

from simwarp.cli.view.maneuver_scene import CONE_HEIGHT, add_cones
from simwarp.model.builder import ModelBuilder
from simwarp.scenery.roadside import cone
from simwarp.scenery.visual import Label
from simwarp.sensors.scene import Visuals
from simwarp.vehicle.driving.lane_courses import double_lane_change_course, obstacle_avoidance_course
from simwarp.vehicle.driving.vehicle_outline import Outline

CAR = Outline(front=2.0, rear=-2.4, width=1.8)


@pytest.mark.parametrize("course_of", [double_lane_change_course, obstacle_avoidance_course])
def test_cones_stand_beside_the_lanes_and_touch_them(course_of):
    course = course_of(CAR, 20.0)
    visuals = Visuals(ModelBuilder())
    add_cones(visuals, course)
    (shown,) = visuals.instances
    assert shown.appearance.label == int(Label.CONE)
    (mesh,) = visuals.meshes
    cones = course.cones()
    each = np.asarray(mesh.vertices, float).reshape(len(cones), -1, 3)
    assert each.shape[1] == len(cone(height=CONE_HEIGHT).mesh.vertices)
    # vertices are single precision, at 150 m within 8 um
    near = 2e-5
    np.testing.assert_allclose(each[:, :, 2].max(axis=1), CONE_HEIGHT, atol=near)
    for points, mark in zip(each, cones, strict=True):
        away = mark.outward * (points[:, 1] - mark.y)
        assert away.min() == pytest.approx(0.0, abs=near), mark.name
        assert points[:, 0].mean() == pytest.approx(mark.x, abs=0.01), mark.name
        for lane in course.lanes:
            if lane.start <= mark.x <= lane.end:
                assert ((points[:, 1] >= lane.left - near) | (points[:, 1] <= lane.right + near)).all(), mark.name
