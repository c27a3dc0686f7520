"""A vehicle on level ground, for the page: with its real body, ready to be driven."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from simwarp.core.types import Material, pose
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import resolve_device
from simwarp.sensors.scene import Scene, Visuals
from simwarp.simulation.attachments import ForceElement, Sensor
from simwarp.simulation.simulation import Simulation
from simwarp.simulation.solver_options import SolverOptions
from simwarp.vehicle.construction import VehicleParts, add_vehicle
from simwarp.vehicle.results.road import check_plain_road
from simwarp.vehicle.results.runs import START_REACH
from simwarp.vehicle.roads.road_files import road_of
from simwarp.vehicle.roads.road_surface import add_road, road_ground
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec
from simwarp.vehicle.tires.tires import ground
from simwarp.vehicle.tracks.tracked_construction import TrackedVehicleParts, add_tracked_vehicle
from simwarp.vehicle.tracks.tracked_files import load_any_vehicle
from simwarp.vehicle.tracks.tracked_vehicle import TRACK_SOLVER, AnyVehicle, TrackedVehicle
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
ROAD_WINDOW: Final = ((-150.0, 150.0), (-50.0, 50.0))
"""Of random roads: first and last x and y [m]."""
LIVE_TRACK_SOLVER = dataclasses.replace(TRACK_SOLVER, max_iterations=30)
"""A step of tracks takes milliseconds a world: fewer iterations, and a step of the page for each."""


@dataclasses.dataclass(frozen=True)
class Additions:
    """What else acts on a vehicle and measures it.

    Attributes:
        before: makes the force elements that come before the vehicle's own.
        sensors: makes the sensors.
        track_solver: of tracks of shoes.
    """

    before: Callable[[AnyVehicle, AnyVehicleSpec], Sequence[ForceElement]] = lambda vehicle, spec: ()
    sensors: Callable[[AnyVehicle, Scene], Sequence[Sensor]] = lambda vehicle, scene: ()
    track_solver: SolverOptions = LIVE_TRACK_SOLVER


def vehicle_subject(
    name: str, worlds: int, device: str, additions: Additions | None = None, *, road: str | None = None
) -> Subject:  # fmt: skip
    """A shipped vehicle, or that of a JSON file, at rest on asphalt.

    Args:
        name: of it, or path of its file.
        worlds: how many.
        device: of the worlds.
        additions: to the vehicle; None: there are none.
        road: below it, as `simwarp drive` takes it; None: a plane.

    Raises:
        SpecError: a file cannot be read, or breaks a rule.
    """
    more = Additions() if additions is None else additions
    spec = load_any_vehicle(name)
    below = None if road is None else road_of(road, ROAD_WINDOW)
    if below is not None:
        check_plain_road(below, spec)
    lift = 0.0 if below is None else below.highest(START_REACH)
    builder = ModelBuilder()
    parts: VehicleParts | TrackedVehicleParts
    if isinstance(spec, TrackedVehicleSpec):
        parts = add_tracked_vehicle(builder, spec, at=pose((0.0, 0.0, spec.start_height + lift)))
    else:
        parts = add_vehicle(builder, spec, at=pose((0.0, 0.0, spec.start_height + lift)))
    if below is None:
        builder.add_shape_plane(name="ground", material=Material(friction=FRICTION))
    else:
        add_road(builder, below, friction=FRICTION)
    visuals = Visuals(builder)
    show_body(visuals, parts)
    paint(visuals, tile=5.0)
    model = builder.finalize(
        world_count=worlds, device=resolve_device(None if device == "auto" else device), per_world=per_world()
    )
    vehicle: AnyVehicle
    if isinstance(parts, TrackedVehicleParts):
        belt_ground = road_ground(model, below) if below is not None and parts.spec.on_belts else None
        vehicle, solver, steps = TrackedVehicle(parts, model, ground=belt_ground), more.track_solver, 1
        if vehicle.belts is not None:
            solver, steps = VEHICLE_SOLVER, round(CONTROL / DT)
            vehicle.belts.ground_friction.fill_(FRICTION)
    else:
        terrain = ground(model.device) if below is None else road_ground(model, below, friction=FRICTION)
        vehicle, solver = Vehicle(parts, model, ground=terrain), VEHICLE_SOLVER
        steps = round(CONTROL / DT)
        vehicle.tires.ground_friction.fill_(FRICTION)
    scene = visuals.finalize(model)
    acting = [*more.before(vehicle, spec), vehicle, *with_hand(model)]
    simulation = Simulation(model, DT, elements=acting, sensors=more.sensors(vehicle, scene), solver=solver)

    def reset(mask: Mask | None) -> None:
        simulation.reset(None if mask is None else np.asarray(mask))

    shot = Shot(body=parts.chassis, target=(0.0, 0.0, 0.3), eye=(-7.0, -5.0, 3.2))
    elements: dict[str, Any] = {"vehicle": vehicle}
    return Subject(
        spec.name, simulation, scene, steps * DT, lambda: simulation.advance(steps), reset, shot,
        elements=elements, series=joint_series(simulation),
    )  # fmt: skip


def show_body(visuals: Visuals, parts: VehicleParts | TrackedVehicleParts) -> None:
    """The vehicle's body and its wheels or tracks, in place of its shapes."""
    from simwarp.scenery.track_visuals import add_tracked_vehicle_visual
    from simwarp.scenery.vehicle_visuals import add_vehicle_visual

    visuals.hide(*(each.shape for each in visuals.instances if each.body >= 0))
    if isinstance(parts, TrackedVehicleParts):
        add_tracked_vehicle_visual(visuals, parts)
    else:
        add_vehicle_visual(visuals, parts)
