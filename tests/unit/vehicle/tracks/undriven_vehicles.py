"""Tracked vehicles whose sprockets tests turn themselves."""

import dataclasses

from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec


def undriven(spec: TrackedVehicleSpec) -> TrackedVehicleSpec:
    """Without engine, driveline and brakes, which hold until a `TrackedVehicle` lets them go."""
    left, right = (dataclasses.replace(track, brake=None) for track in (spec.left, spec.right))
    return dataclasses.replace(spec, left=left, right=right, driveline=None, engine=None, transmission=None)
