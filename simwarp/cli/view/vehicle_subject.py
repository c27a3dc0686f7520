"""A vehicle on level ground, for the page: with its real body, ready to be driven."""

from __future__ import annotations

from typing import Any

import numpy as np

from simwarp.core.types import Material, ModelError, pose
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import resolve_device
from simwarp.sensors.scene import Visuals
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.tires.tires import ground
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world
from simwarp.viewer.default_appearance import paint
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
    simulation = Simulation(model, DT, elements=[vehicle], solver=VEHICLE_SOLVER)
    steps = round(CONTROL / DT)

    def reset(mask: Mask | None) -> None:
        simulation.reset(None if mask is None else np.asarray(mask))

    shot = Shot(body=parts.chassis, target=(0.0, 0.0, 0.3), eye=(-7.0, -5.0, 3.2))
    elements: dict[str, Any] = {"vehicle": vehicle}
    return Subject(
        spec.name, simulation, visuals.finalize(model), steps * DT, lambda: simulation.advance(steps), reset, shot,
        elements=elements,
    )  # fmt: skip


def show_body(visuals: Visuals, parts: Any) -> None:
    """The vehicle's body and wheels; of one without a body of its own that of its shapes, or boxes and cylinders."""
    from simwarp.scenery.vehicle_visuals import add_vehicle_visual

    for instance in [each for each in visuals.instances if each.body >= 0]:
        visuals.hide(instance.shape)
    try:
        add_vehicle_visual(visuals, parts)
    except ModelError:  # a vehicle of one's own
        long, wide, tall = (float(value) for value in (*parts.spec.chassis.size, 0.5, 0.5, 0.5)[:3])
        visuals.add_box(parts.chassis, half=(0.5 * long, 0.5 * wide, 0.5 * tall), name="body", color=(0.5, 0.1, 0.05))
        for index, side in enumerate(parts.sides):
            tire = parts.spec.axles[index // 2].tire
            turned = np.array([np.sin(np.pi / 4), 0.0, 0.0, np.cos(np.pi / 4)])
            visuals.add_cylinder(
                side.spindle, radius=tire.radius, half_length=0.12, name=f"wheel_{index}", pose=pose(rotation=turned),
                color=(0.03, 0.03, 0.03),
            )  # fmt: skip
