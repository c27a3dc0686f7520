"""Where a vehicle is: another position and heading in every world of a simulation."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from simwarp.core.array_devices import array_from_host, array_on
from simwarp.core.types import ModelError, formatted, numbers
from simwarp.model.model import Model
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.placing_kernels import move_vehicles
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle


def place_vehicle(
    simulation: Simulation, vehicle: AnyVehicle, position: Any, heading: Any = 0.0, world_mask: Any = None
) -> None:
    """Moves a vehicle, with what joints hold to it, to a position and heading in the worlds of a mask.

    The vehicle moves as one rigid whole: it is turned about the vertical and shifted. Its height (unless given), lean,
    turns of wheels, shafts and gear stay; velocities turn with it: a rolling vehicle rolls along its new heading.
    Arrays on the simulation's device are not copied, others are moved there. Sensors take a frame there; a path
    tracker looks for its place anew.

    Args:
        simulation: in which the vehicle is.
        vehicle: one of the simulation's elements.
        position: (W, 2) x, y or (W, 3) x, y, z of the origin of the vehicle's frame of reference, world [m]; one row is
            for all worlds. Without z the height stays.
        heading: (W,) or one number, direction of the vehicle's x axis seen from above, from the world's +X towards +Y
            [rad].
        world_mask: (W,) bool; all worlds when None.

    Raises:
        ModelError: shapes do not fit, or a number on the host is not finite.
    """
    model = simulation.model
    if vehicle.model is not model:
        raise ModelError("place_vehicle: the vehicle is of another model than the simulation; pass one of its elements")
    worlds = model.world_count
    position, heading = map(_by_numbers, (position, heading))
    columns = 2 if np.shape(position)[-1:] == (2,) else 3
    place = _doubles("position", position, (worlds, columns), model)
    angle = _doubles("heading", heading, (worlds,), model)
    mask = simulation._mask("place_vehicle", world_mask)
    reference = wp.vec3d(*vehicle.parts.reference)
    wp.launch(
        move_vehicles, worlds,
        inputs=[mask, vehicle.bodies, reference, place, angle], outputs=[simulation.state.arrays],
        device=model.device,
    )  # fmt: skip
    simulation.measure(mask)
    for part in simulation.elements:
        if getattr(part, "vehicle", None) is vehicle and hasattr(part, "restart"):
            part.restart(mask)  # a tracker of paths, which looks around from where it was


def _by_numbers(value: Any) -> Any:
    """A Warp array of vectors or of other numbers than float64 as a tensor, which converts them where they lie."""
    if isinstance(value, wp.array) and (value.dtype != wp.float64 or not value.is_contiguous):
        return wp.to_torch(value, requires_grad=False)
    return value


def _doubles(name: str, value: Any, shape: tuple[int, ...], model: Model) -> wp.array:
    """Numbers for every world on the model's device; those of a tensor or Warp array there stay there."""
    thing, remedy = f"place_vehicle: {name} must", "give one for all worlds, or one for each"
    if isinstance(value, wp.array) and value.shape == shape and value.is_contiguous:
        return array_on(thing, value, model.device)
    if hasattr(value, "data_ptr"):
        if tuple(value.shape) not in (shape, shape[1:]):
            raise ModelError(f"{thing} have shape {shape}, got {tuple(value.shape)}; {remedy}")
        return array_on(thing, value.detach().double().expand(shape), model.device, wp.float64)
    given = numbers(value)
    if not np.isfinite(given).all():
        raise ModelError(f"{thing} be finite numbers of shape {shape}, got {formatted(value)}; {remedy}")
    try:
        rows = np.ascontiguousarray(np.broadcast_to(given, shape))
    except ValueError:
        raise ModelError(f"{thing} have shape {shape}, got {given.shape}; {remedy}") from None
    return array_from_host(thing, rows, model.device, wp.float64)
