"""What is seen of a manoeuvre: the vehicle's body, and its ground with the ruts in it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from simwarp.cli.view.vehicle_subject import show_body
from simwarp.core.types import WORLD, pose
from simwarp.model.builder import ModelBuilder
from simwarp.scenery.textures import TEXTURES, ground_texture
from simwarp.sensors.cameras.appearance import ImageTexture
from simwarp.sensors.instances import PlainAppearanceOptions
from simwarp.sensors.scene import Scene, Visuals
from simwarp.simulation.attachments import ForceElement
from simwarp.soil.soil import Soil
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.runs import Setup
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle
from simwarp.viewer.default_visuals import paint

ASPHALT = (0.36, 0.37, 0.38)
SAND = (0.75, 0.68, 0.6)


def maneuver_scene(setup: Setup[AnyVehicle]) -> Scene:
    """The scene of a manoeuvre's simulation; a soil among its elements covers the ground."""
    return driven_scene(setup.vehicle, setup.simulation.elements, setup.maneuver)


def driven_scene(vehicle: AnyVehicle, elements: Sequence[ForceElement], maneuver: Maneuver) -> Scene:
    """The scene of a vehicle and the ground of its manoeuvre, covered by a soil among the force elements."""
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
    scene = visuals.finalize(model)
    if soil is not None:
        scene.cover_with(soil)
    return scene
