"""A vehicle on level ground, for the page: with its real body, ready to be driven."""

from __future__ import annotations

from typing import Any

import numpy as np

from simwarp.core.types import Material, pose
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import resolve_device
from simwarp.sensors.scene import Visuals
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.tires.tires import ground
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world
from simwarp.viewer.default_visuals import paint
from simwarp.viewer.live.controls.joint_coordinates import joint_series
from simwarp.viewer.live.hand import with_hand
from simwarp.viewer.live.subject import Mask, Subject
from simwarp.viewer.studio import Shot

DT = 1e-3
"""Step of the physics [s]."""
CONTROL = 1.0 / 50.0
"""Time of one step of the page [s]."""
FRICTION = 0.9


def vehicle_subject(name: str, worlds: int, device: str) -> Subject:
    """A shipped vehicle, or that of a JSON file, at rest on asphalt.

    Raises:
        SpecError: the file cannot be read, or breaks a rule.
    """
    spec = load_vehicle(name)
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec, at=pose((0.0, 0.0, spec.start_height)))
    builder.add_shape_plane(name="ground", material=Material(friction=FRICTION))
    visuals = Visuals(builder)
    show_body(visuals, parts)
    paint(visuals, tile=5.0)
    model = builder.finalize(
        world_count=worlds, device=resolve_device(None if device == "auto" else device), per_world=per_world()
    )
    vehicle = Vehicle(parts, model, ground=ground(model.device))
    vehicle.tires.ground_friction.fill_(FRICTION)
    simulation = Simulation(model, DT, elements=[vehicle, *with_hand(model)], solver=VEHICLE_SOLVER)
    steps = round(CONTROL / DT)

    def reset(mask: Mask | None) -> None:
        simulation.reset(None if mask is None else np.asarray(mask))

    shot = Shot(body=parts.chassis, target=(0.0, 0.0, 0.3), eye=(-7.0, -5.0, 3.2))
    elements: dict[str, Any] = {"vehicle": vehicle}
    return Subject(
        spec.name, simulation, visuals.finalize(model), steps * DT, lambda: simulation.advance(steps), reset, shot,
        elements=elements, series=joint_series(simulation),
    )  # fmt: skip


def show_body(visuals: Visuals, parts: Any) -> None:
    """The vehicle's body and wheels, in place of its shapes."""
    from simwarp.scenery.vehicle_visuals import add_vehicle_visual

    for instance in [each for each in visuals.instances if each.body >= 0]:
        visuals.hide(instance.shape)
    add_vehicle_visual(visuals, parts)
