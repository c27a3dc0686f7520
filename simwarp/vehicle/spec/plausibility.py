"""Plausibility of a vehicle as a whole: lengths of one scale, wheels near the ground, axles that exist.

Every number may be right by itself and wrong beside the others, as millimetres are. What is refused here would
otherwise end in a simulation that breaks down, far from its cause.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Final, Protocol

from simwarp.vehicle.spec.drivetrain_parts import (
    Driveline,
    MultiAxleDriveline,
    ShaftsDriveline2WD,
    ShaftsDriveline4WD,
    SimpleDriveline,
)
from simwarp.vehicle.spec.parts import Spec, SpecError, refuse
from simwarp.vehicle.spec.trailer_parts import Unit
from simwarp.vehicle.spec.vehicle_parts import Axle, SteeringMount

WHEELBASES: Final = (0.05, 50.0)
"""From model cars to heavy transporters [m]."""
REACH: Final = 2.0
"""Longest length of a part and farthest point from its axle's frame, in wheelbases."""
BODY_REACH: Final = 5.0
"""The same for the box of the chassis, which may overhang."""
TIRE_REACH: Final = 20.0
"""Substitute for two wheelbases of a vehicle with one axle, in radii of its tires."""
SUNK: Final = 0.5
LIFTED: Final = 5.0
"""Depth in the ground and height above it at which the lowest wheel may start, in radii of its tire."""

LENGTHS: Final = frozenset(
    {
        "rest_length", "min_length", "max_length", "offset", "radius", "width", "pinion_radius", "arm_length",
        "arm_width", "droplink_height",
    }
)  # fmt: skip
CURVES_OVER_LENGTH: Final = frozenset({"spring_curve", "bump_curve"})
METRES: Final = "give metres, not millimetres"


class Assembled(Protocol):
    """A whole vehicle: what is looked at here of a `VehicleSpec`."""

    @property
    def axles(self) -> tuple[Axle, ...]:
        """From front to rear."""
        ...

    @property
    def steerings(self) -> tuple[SteeringMount, ...]:
        """In the order of their numbers."""
        ...

    @property
    def units(self) -> tuple[Unit, ...]:
        """The vehicle without its trailers, then these."""
        ...

    @property
    def driveline(self) -> Driveline | None:
        """From the transmission to the wheels."""
        ...

    @property
    def start_height(self) -> float:
        """Of the frame of reference above the ground at the start [m]."""
        ...


def check_vehicle(spec: Assembled) -> None:
    """All of it.

    Raises:
        SpecError: the key that does not fit, with what it is held against.
    """
    _check_steerings(spec)
    _check_driven_axles(spec)
    for unit in spec.units:
        _check_lengths(unit, spec.steerings if unit.hitch is None else ())
    _check_start(spec)
    for unit in spec.units[1:]:
        _check_level(unit, spec.start_height)


def _check_steerings(spec: Assembled) -> None:
    count = len(spec.steerings)
    used = set()
    for index, axle in enumerate(spec.axles):
        if axle.steering is None:
            continue
        key = f"axles[{index}].steering"
        if count == 0:
            raise refuse(key, "left out, for the vehicle has no steerings", axle.steering, "or describe one there")
        if not 0 <= axle.steering < count:
            raise refuse(key, f"the index of a steering, {_indices(count)}", axle.steering)
        used.add(axle.steering)
    for index in range(count):
        if index not in used:
            rule = "the steering of an axle: no axle names it"
            remedy = f'give "steering": {index} to the axle whose tie rods it holds, or leave it out'
            raise SpecError(f"steerings[{index}]: must be {rule}; {remedy}")


def _check_driven_axles(spec: Assembled) -> None:
    count = len(spec.axles)
    match spec.driveline:
        case ShaftsDriveline2WD(axle=axle):
            if not -1 <= axle < count:
                rule = f"the index of an axle, {_indices(count)}, or -1 for the last"
                raise refuse("driveline.axle", rule, axle)
        case SimpleDriveline(axles=axles) | ShaftsDriveline4WD(axles=axles) | MultiAxleDriveline(axles=axles):
            for place, axle in enumerate(axles):
                if not 0 <= axle < count:
                    raise refuse(f"driveline.axles[{place}]", f"the index of an axle, {_indices(count)}", axle)
            if len(set(axles)) < len(axles):
                rule = "two different axles" if len(axles) == 2 else "different axles"
                raise refuse("driveline.axles", rule, axles)


def _indices(count: int) -> str:
    return "0" if count == 1 else f"0 to {count - 1}"


def _check_lengths(unit: Unit, steerings: Sequence[SteeringMount]) -> None:
    places = [axle.location[0] for axle in unit.axles]
    if unit.hitch is not None:
        places.insert(0, unit.hitch.trailer_point[0])
    wheelbase = max(places) - min(places)
    if len(places) > 1:
        reach, scale = REACH * wheelbase, f"{REACH:g} wheelbases of {wheelbase:.4g} m"
        far = max(range(1, len(places)), key=lambda index: abs(places[index] - places[0]))
        if not WHEELBASES[0] <= wheelbase <= WHEELBASES[1]:
            start = "axles[0].location" if unit.hitch is None else "hitch.trailer_point"
            which = far if unit.hitch is None else far - 1
            rule = f"{WHEELBASES[0]:g} to {WHEELBASES[1]:g} m along x from {start}"
            raise SpecError(f"{unit.key}axles[{which}].location: must be {rule}, got {wheelbase:.6g} m; {METRES}")
    else:
        radius = unit.axles[0].tire.radius
        reach, scale = TIRE_REACH * radius, f"{TIRE_REACH:g} radii of its tire of {radius:.4g} m"
    parts: list[tuple[str, Spec]] = [(f"axles[{index}]", axle) for index, axle in enumerate(unit.axles)]
    parts += [(f"steerings[{index}]", mount) for index, mount in enumerate(steerings)]
    parts += [(f"chassis.components[{index}]", part) for index, part in enumerate(unit.chassis.components)]
    for key, part in parts:
        for where, length, value in lengths(part, f"{unit.key}{key}"):
            if length > reach:
                raise SpecError(f"{where}: must be within {reach:.4g} m ({scale}), got {value}; {METRES}")
    for key in ("size", "size_center"):
        value = getattr(unit.chassis, key)
        if math.hypot(*value) > BODY_REACH / REACH * reach:
            raise refuse(f"{unit.key}chassis.{key}", f"within {BODY_REACH / REACH * reach:.4g} m", value, METRES)


def lengths(part: Spec, key: str) -> Iterator[tuple[str, float, object]]:
    """Key path, size [m] and value of every point, length and curve over a length in a description and below it."""
    for field in dataclasses.fields(part):
        name, value = field.name, getattr(part, field.name)
        where = f"{key}.{name}"
        if isinstance(value, Spec):
            yield from lengths(value, where)
        elif isinstance(value, float):
            if name in LENGTHS:
                yield where, abs(value), value
        elif isinstance(value, tuple) and value:
            if isinstance(value[0], Spec):
                for index, item in enumerate(value):
                    yield from lengths(item, f"{where}[{index}]")
            elif name in CURVES_OVER_LENGTH:
                size = max(abs(x) for x, _ in value)
                yield where, size, f"one with x up to {size:g}"
            elif len(value) == 3 and isinstance(value[0], (int, float)) and is_point(name):
                yield where, math.hypot(*value), value


def is_point(name: str) -> bool:
    """Whether a field of this name that holds three numbers is a place."""
    return not (name.endswith("inertia") or name in ("products", "momentum", "moment") or "axis" in name)


def _lowest(unit: Unit) -> tuple[float, float]:
    """Height of the lowest tire's bottom in the vehicle's frame as built, and that tire's radius [m]."""
    heights = [
        unit.origin[2] + axle.location[2] + axle.suspension.spindle.com[2] - axle.tire.radius for axle in unit.axles
    ]
    lowest = min(range(len(heights)), key=heights.__getitem__)
    return heights[lowest], unit.axles[lowest].tire.radius


def _check_start(spec: Assembled) -> None:
    """The lowest wheel stands near the ground."""
    bottom, radius = _lowest(spec.units[0])
    low, high = -bottom - SUNK * radius, -bottom + LIFTED * radius
    if not low <= spec.start_height <= high:
        rule = f"from {low:.4g} to {high:.4g} m, where the wheels are near the ground"
        raise refuse("start_height", rule, spec.start_height, f"they touch it at {-bottom:.4g}")


def _check_level(unit: Unit, start_height: float) -> None:
    """A trailer's wheels are near the ground where its hitch lies as high as that of what tows it."""
    bottom, radius = _lowest(unit)
    above = bottom + start_height
    if unit.hitch is not None and not -SUNK * radius <= above <= LIFTED * radius:
        rule = f"as high above the trailer's wheels as the towing point is: they are {above:.4g} m above the ground"
        raise refuse(f"{unit.key}hitch.trailer_point", rule, unit.hitch.trailer_point, METRES)
