"""Soil under vehicles: their wheels as shapes of a soil, whose loads and slips their tires report; shoes of tracks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from simwarp.core.types import ModelError, formatted, pose
from simwarp.soil.soil import USUAL_SPACING, Soil
from simwarp.soil.soil_parameters import SoilSpec
from simwarp.soil.soil_shapes import SoilBox, SoilShape, SoilWheel
from simwarp.soil.soil_sheets import SoilMesh
from simwarp.vehicle.spec.track_parts import pad_around
from simwarp.vehicle.tires.contact_tires import ContactTires
from simwarp.vehicle.tires.soil_tires import TEMPLATE, SoilTires, soil_rigid_parameters
from simwarp.vehicle.vehicle import Vehicle, Vehicles

if TYPE_CHECKING:
    from simwarp.vehicle.tracks.tracked_vehicle import TrackedVehicle


def wheels_of(vehicle: Vehicle) -> list[SoilWheel]:
    """Wheels of a vehicle on `soil-rigid` tires, in the order of its reports.

    Raises:
        ModelError: its tires make forces of their own, or bend.
    """
    spec = vehicle.parts.spec
    if not isinstance(vehicle.tires, SoilTires):
        found = ", ".join(dict.fromkeys(axle.tire.template for axle in spec.all_axles))
        raise ModelError(
            f"soil: tires of vehicle '{spec.name}' must be {TEMPLATE}, got {found}, which do not deform it; "
            f"with_options(spec, tire='{TEMPLATE}'), or --tire {TEMPLATE}"
        )
    tires = [spec.all_axles[side.axle].tire for side in vehicle.parts.sides]
    return [
        SoilWheel(
            body=side.spindle, radius=tire.radius, width=tire.width, crown=soil_rigid_parameters(tire).crown
        )
        for side, tire in zip(vehicle.parts.sides, tires, strict=True)
    ]  # fmt: skip


def pads_of(vehicle: TrackedVehicle) -> list[SoilBox]:
    """Pads of a vehicle's shoes as boxes, shoe after shoe: those of the left track, then of the right one.

    Pads at a shoe's sides are one box across it: higher than the pad in its middle, it presses beside that alone.

    Raises:
        ModelError: the vehicle has no shoes.
    """
    parts, boxes = vehicle.parts, []
    for side, track in zip(parts.chains, (parts.spec.left, parts.spec.right), strict=bool(parts.chains)):
        pads = [track.shoe.ground_pad]
        if track.shoe.side_pads:
            pads.append(pad_around(track.shoe.side_pads))
        shapes = [((0.5 * x, 0.5 * y, 0.5 * z), pose(pad.center)) for pad in pads for x, y, z in [pad.size]]
        boxes += [SoilBox(body=body, half=half, pose=place) for body in side.shoes for half, place in shapes]
    if not boxes:
        raise ModelError(f"soil: vehicle '{parts.spec.name}' has no shoes; the ground of belts is their own")
    return boxes


def soil_under_tracks(
    vehicle: TrackedVehicle, soil: SoilSpec | str | Sequence[SoilSpec | str] = "mid", *,
    shapes: Sequence[SoilShape] = (), **options: Any,
) -> Soil:  # fmt: skip
    """Soil under the shoes of a tracked vehicle. Its outputs are those of `pads_of`, then of further shapes.

    Args:
        vehicle: shoe by shoe, in a model without other ground under it.
        soil: a `SoilSpec` or the name of a preset, or several for `soil_map`.
        shapes: what sinks in beside the shoes: a belly, rocks.
        options: further arguments of `Soil`.

    Raises:
        ModelError: the vehicle has no shoes, or a value breaks its rule.
    """
    return Soil(vehicle.model, [*pads_of(vehicle), *shapes], soil, **options)


def meshes_of(vehicle: Vehicle) -> list[SoilMesh]:
    """Flexible tires of a vehicle, in the order of its reports; none where it has others."""
    return [SoilMesh(mesh=side.mesh) for side in vehicle.parts.sides if side.mesh is not None]


def _checked_vehicles(vehicles: Any) -> list[Vehicle | Vehicles]:
    listed = list(vehicles) if isinstance(vehicles, Iterable) else [vehicles]
    if not listed or not all(isinstance(each, Vehicle | Vehicles) for each in listed):
        raise ModelError(
            f"soil_under: vehicles must be at least one Vehicle or Vehicles, got {formatted(vehicles)}; "
            "Soil takes wheels of other bodies"
        )
    if any(each.model is not listed[0].model for each in listed):
        raise ModelError("soil_under: vehicles must be of one model, got several; add them all to one ModelBuilder")
    return listed


def soil_under(
    vehicles: Vehicle | Vehicles | Sequence[Vehicle | Vehicles],
    soil: SoilSpec | str | Sequence[SoilSpec | str] = "mid", *,
    shapes: Sequence[SoilShape] = (), **options: Any,
) -> Soil:  # fmt: skip
    """Soil under the wheels of vehicles of one model; their `tires` report its loads, slips and sinkages.

    Args:
        vehicles: on `soil-rigid` tires, or on flexible ones.
        soil: a `SoilSpec` or the name of a preset, or several for `soil_map`.
        shapes: what sinks in beside the wheels: bellies, rocks. In the outputs they come after rigid wheels, before
            flexible tires.
        options: further arguments of `Soil`. Without them the ground is that of the first vehicle, and `spacing` 0.05 m
            or half the width of narrower wheels.

    Raises:
        ModelError: the tires of one make forces of their own, or a value breaks its rule.
    """
    given = _checked_vehicles([vehicles] if isinstance(vehicles, Vehicle | Vehicles) else vehicles)
    below = [[each] if isinstance(each, Vehicle) else list(each) for each in given]
    meshes = [[mesh for vehicle in each for mesh in meshes_of(vehicle)] for each in below]
    wheels = [
        [] if bent else [wheel for vehicle in each for wheel in wheels_of(vehicle)]
        for each, bent in zip(below, meshes, strict=True)
    ]
    first_tires = given[0].tires
    options.setdefault("ground", first_tires.terrain if isinstance(first_tires, SoilTires) else None)
    narrowest = min(axle.tire.width for each in below for axle in each[0].parts.spec.all_axles)
    options.setdefault("spacing", min(USUAL_SPACING, 0.5 * narrowest))
    rigid = [wheel for each in wheels for wheel in each]
    bent = [mesh for each in meshes for mesh in each]
    made = Soil(given[0].model, [*rigid, *shapes], soil, meshes=bent, **options)
    first = {True: 0, False: len(rigid) + len(shapes)}
    for whole, each in zip(given, below, strict=True):
        is_rigid = isinstance(whole.tires, SoilTires)
        count = len(each[0].parts.sides)
        for number, vehicle in enumerate((whole, *each)):
            assert isinstance(vehicle.tires, SoilTires | ContactTires)
            vehicle.tires.show(made, first[is_rigid] + count * max(number - 1, 0))
        first[is_rigid] += count * len(each)
    return made
