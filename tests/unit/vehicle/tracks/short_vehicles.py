"""A tracked vehicle with short chains, for tests whose device is slow: one road wheel a side, 31 shoes."""

import dataclasses

from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec

IDLER_X = -1.40
"""Where 31 shoes of 0.154 m close around a sprocket, the first road wheel and the idler of an M113 [m]."""
SHOES = 31


def shortened(spec: TrackedVehicleSpec) -> TrackedVehicleSpec:
    """The M113, shoe by shoe, cut off behind its first road wheels."""
    left, right = (
        dataclasses.replace(
            track, road_wheels=track.road_wheels[:1], idler_location=(IDLER_X, *track.idler_location[1:]), shoes=SHOES
        )
        for track in (spec.left, spec.right)
    )
    return dataclasses.replace(spec, left=left, right=right)
