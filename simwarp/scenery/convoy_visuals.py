"""What is seen of vehicles in a row: their bodies and wheels in place of the boxes that stand for them in contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simwarp.scenery.vehicle_visuals import add_vehicle_visual
from simwarp.sensors.scene import Visuals

if TYPE_CHECKING:
    from simwarp.vehicle.results.vehicle_row import Convoy


def convoy_visuals(convoy: Convoy) -> Visuals:
    """Visuals of a convoy's vehicles, without any ground: add one, then `finalize(convoy.simulation.model)`."""
    visuals = Visuals(convoy.builder)
    for box, parts in zip(convoy.boxes, convoy.vehicles.parts, strict=True):
        visuals.hide(box)
        add_vehicle_visual(visuals, parts)
    return visuals
