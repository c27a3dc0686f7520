"""What is seen of a manoeuvre: the vehicle's body, its ground with the ruts in it, and cones of its course."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from simwarp.cli.view.vehicle_subject import show_body
from simwarp.core.types import WORLD, pose
from simwarp.model.builder import ModelBuilder
from simwarp.scenery.roadside import cone
from simwarp.scenery.textures import TEXTURES, ground_texture
from simwarp.scenery.visual import add_visual, arranged
from simwarp.sensors.cameras.appearance import ImageTexture
from simwarp.sensors.instances import PlainAppearanceOptions
from simwarp.sensors.scene import Scene, Visuals
from simwarp.simulation.attachments import ForceElement
from simwarp.soil.soil import Soil
from simwarp.vehicle.driving.lane_courses import LaneCourse
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.runs import Setup
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle
from simwarp.viewer.default_visuals import paint

ASPHALT = (0.36, 0.37, 0.38)
SAND = (0.75, 0.68, 0.6)
CONE_HEIGHT: Final = 0.5
"""Of the cones of a course [m]; those of ISO 3888 are at least as high."""


def maneuver_scene(setup: Setup[AnyVehicle]) -> Scene:
    """The scene of a manoeuvre's simulation; a soil among its elements covers the ground."""
    return driven_scene(setup.vehicle, setup.simulation.elements, setup.maneuver)


def driven_scene(vehicle: AnyVehicle, elements: Sequence[ForceElement], maneuver: Maneuver) -> Scene:
    """The scene of a vehicle, the ground of its manoeuvre, covered by a soil among the force elements, and the cones of
    its course, which are seen and hit by nothing.
    """
    model = vehicle.model
    soil = next((each for each in elements if isinstance(each, Soil)), None)
    builder = model.builder
    assert isinstance(builder, ModelBuilder)
    visuals = Visuals(builder)
    show_body(visuals, vehicle.parts)
    if not any(instance.body == WORLD for instance in visuals.instances):
        lean = -0.5 * math.atan(maneuver.slope)
        turn = np.array([0.0, math.sin(lean), 0.0, math.cos(lean)])
        look: PlainAppearanceOptions = {}
        if soil is not None:
            image = ground_texture("sand", pixels=512)
            look = {"texture": visuals.texture(ImageTexture(image=image, metres=(TEXTURES["sand"],) * 2))}
        color = ASPHALT if soil is None else SAND
        visuals.add_plane(name="ground", pose=pose(rotation=turn), color=color, **look)
    paint(visuals, tile=5.0)
    if maneuver.course is not None:
        add_cones(visuals, maneuver.course)
    scene = visuals.finalize(model)
    if soil is not None:
        scene.cover_with(soil)
    return scene


def add_cones(visuals: Visuals, course: LaneCourse) -> None:
    """Cones beside the lanes of a course; their bases touch the lanes' edges from outside."""
    one = cone(height=CONE_HEIGHT)
    half = float(one.upper[1])
    places = [(each.x, each.y + half * each.outward, 0.0) for each in course.cones()]
    add_visual(visuals, arranged(one, places), name="cones")
