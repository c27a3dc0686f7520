"""Alike vehicles in a row, in one world, who drive by one script; the boxes of their chassis meet."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from simwarp.core.object_repr import Readable, plural
from simwarp.core.types import Material, Vec3, pose
from simwarp.model.builder import ModelBuilder
from simwarp.model.checks import whole_number
from simwarp.simulation.attachments import ForceElement
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.construction import add_chassis_box, add_vehicle
from simwarp.vehicle.driving.drivers import ScriptedDriver
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.runs import REFERENCE_DT, REFERENCE_FRICTION
from simwarp.vehicle.spec.vehicle_spec import SpecError, VehicleSpec
from simwarp.vehicle.tires.tires import ground
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicles, per_world

GAP: Final = 10.0
"""From a vehicle's frame of reference to that of the one behind it [m]."""
MOST_VEHICLES: Final = 64
HMMWV_BOX: Final[tuple[Vec3, Vec3]] = ((2.3, 1.05, 0.5), (0.0, 0.0, 0.2))
"""Half lengths of a HMMWV's box and its middle in the frame of reference [m]."""


@dataclasses.dataclass(frozen=True, repr=False)
class Convoy(Readable):
    """Vehicles in a row, ready to run.

    Attributes:
        builder: of their model.
        simulation: of them all.
        vehicles: the first one leads, along +X.
        driver: of them all.
        maneuver: whose script it follows.
        boxes: shapes of their chassis.
    """

    builder: ModelBuilder
    simulation: Simulation
    vehicles: Vehicles
    driver: ScriptedDriver
    maneuver: Maneuver
    boxes: tuple[int, ...]

    def _readable_title(self) -> str:
        name = self.vehicles.parts[0].spec.name
        return f": {len(self.vehicles)} '{name}' in each of {plural(self.simulation.model.world_count, 'world')}"


def set_up_convoy(
    spec: VehicleSpec, maneuver: Maneuver, *, vehicles: int = 4, gap: float = GAP,
    box: tuple[Vec3, Vec3] = HMMWV_BOX, worlds: int = 1, device: str | None = None, dt: float = REFERENCE_DT,
    friction: float = REFERENCE_FRICTION, elements: Callable[[Vehicles], Sequence[ForceElement]] = lambda vehicles: (),
) -> Convoy:  # fmt: skip
    """Builds vehicles at rest in a row on level ground, with their driver.

    Args:
        spec: of every one.
        maneuver: with a script.
        vehicles: how many.
        gap: from one to the next [m].
        box: half lengths of the box that stands for each in contacts, and its middle in the frame of reference [m].
        worlds, device, dt, friction: as of `set_up`.
        elements: returns further force elements for the vehicles, such as the soil below them.

    Raises:
        SpecError: boxes of neighbours overlap, or the manoeuvre has a path in place of a script.
        ModelError: the number of vehicles, the step or a size cannot be used.
    """
    count = whole_number("convoy", "vehicles", vehicles, 1, MOST_VEHICLES, "4 is usual")
    if not gap > 2.0 * box[0][0]:
        raise SpecError(f"gap: must be above the boxes' length, {2.0 * box[0][0]:g} m, got {gap!r}")
    if maneuver.follow is not None:
        raise SpecError(f"maneuver: must have a script, got '{maneuver.name}', which follows a path")
    builder = ModelBuilder()
    places = [np.array([-gap * number, 0.0, spec.start_height]) for number in range(count)]
    parts = [add_vehicle(builder, spec, at=pose(place), prefix=f"v{number}_") for number, place in enumerate(places)]
    boxes = tuple(add_chassis_box(builder, each, half=box[0], position=box[1]) for each in parts)
    if any(side.meets_shapes for side in parts[0].sides):
        builder.add_shape_plane(name="ground", material=Material(friction=friction))
    model = builder.finalize(world_count=worlds, device=device, per_world=per_world())
    acting = Vehicles(parts, model, ground=ground(model.device))
    acting.tires.ground_friction.fill_(friction)
    driver = ScriptedDriver(acting, maneuver.script)
    simulation = Simulation(model, dt, elements=[driver, acting, *elements(acting)], solver=VEHICLE_SOLVER)
    return Convoy(builder, simulation, acting, driver, maneuver, boxes)
