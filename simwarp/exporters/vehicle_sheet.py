"""What a vehicle is, as lines of a data sheet: masses, axles, springs, tires, driveline, from its description."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.path_tracking import wheelbase
from simwarp.vehicle.rigs.spring_rates import rate_range, spring_rate, without_stops
from simwarp.vehicle.rigs.standing_loads import standing_loads
from simwarp.vehicle.spec.parts import UNITS as KEY_UNITS, ForceLine, RigidPart, Spec
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_spec import AntirollBar, Axle, VehicleSpec
from simwarp.vehicle.stances import LineStance, Stance
from simwarp.vehicle.tracks.tracked_construction import add_tracked_vehicle

GRAVITY: Final = 9.81
"""Of axle loads [m/s²]."""
MOST_PARAMETERS: Final = 24
"""Of a tire that are listed; longer tables are counted."""
LEFT_OUT: Final = ("template", "inertia_axes", "name")
"""Fields of parts that the sheet tells in another place, or not."""
OWN_UNITS: Final[dict[tuple[type[Spec], str], str]] = {
    (AntirollBar, "stiffness"): "N·m/rad", (AntirollBar, "damping"): "N·m·s/rad",
}  # fmt: skip
"""Where the last word of a key does not tell the unit."""
TIRE_UNITS: Final[dict[tuple[str, str], str]] = {
    **{("", key): "N" for key in ("load", "nominal_load", "load_limit", "slip_stiffness")},
    **{("", key): "N/m" for key in ("vertical_stiffness", "bottom_stiffness", "bristle_stiffness",
                                    "lateral_stiffness")},
    **{("", key): "Pa" for key in ("pressure", "young")},
    **{("", key): "N·s/m" for key in ("vertical_damping", "bristle_damping")},
    **{("", key): "m" for key in ("rim_radius", "bottom_deflection", "disc_spacing", "crown", "thickness")},
    ("", "vertical_stiffness_square"): "N/m²", ("", "cornering_stiffness"): "N/rad", ("", "camber_limit"): "rad",
    ("", "stribeck_speed"): "m/s", ("", "damping_time"): "s", ("fiala", "rolling_resistance"): "m",
}  # fmt: skip
"""Of a tire's parameters, by template (empty: of any) and name; those that are left out have none."""
FURTHER_UNITS: Final = {"shift_latency": "s", "pin_stiffness": "N·m/rad", "pin_damping": "N·m·s/rad"}
"""The same by the key."""


@dataclasses.dataclass(frozen=True)
class Fact:
    """One line."""

    label: str
    value: str
    unit: str = ""


@dataclasses.dataclass(frozen=True)
class Section:
    """Lines under one title."""

    title: str
    facts: tuple[Fact, ...]


def vehicle_sheet(spec: AnyVehicleSpec, stands: Stance | None = None) -> list[Section]:
    """Sections of a data sheet.

    Axle loads are those at rest on level ground, as built, of a vehicle with two axles.

    Args:
        spec: of a vehicle on wheels or tracks.
        stands: how it stands, from `simwarp.vehicle.stance`: rates of springs are those there. None: as built.
    """
    found = _of_tracks(spec) if isinstance(spec, TrackedVehicleSpec) else _of_wheels(spec, stands)
    for title, part in (
        ("Driveline", spec.driveline), ("Engine", spec.engine), ("Transmission", spec.transmission),
    ):  # fmt: skip
        if part is not None:
            found.append(Section(title, (Fact("kind", part.template), *_numbers(part))))
    return found


def _of_wheels(spec: VehicleSpec, stands: Stance | None) -> list[Section]:
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec)
    mass, center = _masses(builder)
    places = [np.asarray(builder.bodies[side.spindle].pose.position, float) for side in parts.sides]
    x = [0.5 * (places[k][0] + places[k + 1][0]) for k in range(0, len(places), 2)]
    ground = min(
        place[2] - spec.all_axles[side.axle].tire.radius for place, side in zip(places, parts.sides, strict=True)
    )
    whole = [
        Fact("mass", _number(mass), "kg"),
        Fact("mass of the body alone", _number(builder.bodies[parts.chassis].mass), "kg"),
        Fact("wheelbase", _number(wheelbase(spec)), "m"),
        Fact("centre of mass behind the first axle", _number(x[0] - center[0]), "m"),
        Fact("centre of mass above the ground, as built", _number(center[2] - ground), "m"),
    ]
    if len(x) == 2:
        share = (center[0] - x[1]) / (x[0] - x[1])
        for name, part in (("first", share), ("second", 1.0 - share)):
            whole.append(Fact(f"load on the {name} axle at rest", _number(part * mass * GRAVITY), "N"))
    elif spec.trailers:
        whole += _train(spec)
    found = [Section("Vehicle", tuple(whole))]
    for index, axle in enumerate(spec.all_axles):
        left, right = places[2 * index], places[2 * index + 1]
        lines = None if stands is None else stands.axles[index].lines
        found.append(Section(f"Axle {index}", tuple(_axle(axle, float(left[1] - right[1]), lines))))
    for mount in spec.steerings:
        found.append(Section("Steering", (Fact("kind", mount.steering.template), *_numbers(mount.steering))))
    return found


def _train(spec: VehicleSpec) -> Iterator[Fact]:
    """Loads of a vehicle with trailers, by the lever rule."""
    loads = standing_loads(spec)
    for index, load in enumerate(loads.wheel_load):
        whose = "" if index < loads.own_axles else ", of a trailer,"
        yield Fact(f"load on axle {index}{whose} at rest", _number(2.0 * load), "N")
    for number, (trailer, load) in enumerate(zip(spec.trailers, loads.hitch_load, strict=True)):
        yield Fact(f"trailer {number}", trailer.name)
        yield Fact(f"hitch of trailer {number}", trailer.hitch.kind)
        yield Fact(f"load on the hitch of trailer {number} at rest", _number(load), "N")


def _axle(axle: Axle, track: float, stands: Sequence[LineStance] | None) -> Iterator[Fact]:
    suspension, tire = axle.suspension, axle.tire
    yield Fact("track", _number(track), "m")
    yield Fact("steered", "no" if axle.steering is None else "yes")
    yield Fact("suspension", suspension.template)
    yield from _numbers(suspension)
    for index, line in enumerate(getattr(suspension, "springs", ())):
        yield from _line(line, index, None if stands is None else stands[index])
    if axle.antiroll_bar is not None:
        yield from (
            dataclasses.replace(fact, label=f"anti-roll bar: {fact.label}") for fact in _numbers(axle.antiroll_bar)
        )
    if axle.brake is not None:
        yield Fact("brake, greatest torque of a wheel", _number(axle.brake.max_torque), "N·m")
    yield Fact("tire", tire.template)
    yield from (Fact(f"tire: {name}", _number(getattr(tire, name)), unit) for name, unit in
                (("radius", "m"), ("width", "m"), ("mass", "kg")))  # fmt: skip
    numbers = {key: value for key, value in tire.parameters.items() if _is_number(value)}
    if len(numbers) <= MOST_PARAMETERS:
        yield from (
            Fact(f"tire: {key.replace('_', ' ')}", _number(value), tire_unit(tire.template, key))
            for key, value in numbers.items()
        )
    else:
        yield Fact("tire: parameters", f"{len(numbers)} numbers")
    for key, value in tire.parameters.items():
        if isinstance(value, dict):
            yield Fact(f"tire: {key}", f"{len(value)} numbers")


def _line(line: ForceLine, number: int, stands: LineStance | None) -> Iterator[Fact]:
    """A spring, a damper or both."""
    head = line_name(line, number)
    if line.stiffness:
        yield Fact(f"{head}: stiffness", _number(line.stiffness), "N/m")
    if line.spring_curve is not None:
        yield Fact(f"{head}: spring curve", f"{len(line.spring_curve)} points")
        yield from _rates(head, line, stands)
    if line.rest_length is not None:
        yield Fact(f"{head}: free length", _number(line.rest_length), "m")
    if line.preload:
        yield Fact(f"{head}: preload", _number(line.preload), "N")
    if line.damping:
        yield Fact(f"{head}: damping", _number(line.damping), "N·s/m")
    if line.damper_curve is not None:
        yield Fact(f"{head}: damper curve", f"{len(line.damper_curve)} points")
    if line.damper_map is not None:
        yield Fact(f"{head}: damper map", f"{len(line.damper_map[0])} lengths, {len(line.damper_map[1])} rates")
    for key, name in (("min_length", "bump stop"), ("max_length", "rebound stop")):
        if getattr(line, key) is not None:
            yield Fact(f"{head}: {name} at a length of", _number(getattr(line, key)), "m")


def line_name(line: ForceLine, number: int) -> str:
    """What a line is, with its index among the `springs` of its axle."""
    springs = line.stiffness or line.spring_curve is not None or line.preload
    damps = line.damping or line.damper_curve is not None or line.damper_map is not None
    kinds = [name for name, has in (("spring", springs), ("damper", damps)) if has]
    return f"{' and '.join(kinds) or 'stop'} {number}"


def _rates(head: str, line: ForceLine, stands: LineStance | None) -> Iterator[Fact]:
    """Of a spring with a curve: its rate where it stands, and those between its stops [N/mm]."""
    length = math.dist(line.chassis_point, line.arm_point) if stands is None else stands.length
    place = "as built" if stands is None else "at rest"
    yield Fact(
        f"{head}: rate {place}, {1e3 * length:.1f} mm long", _number(1e-3 * spring_rate(without_stops(line), length)),
        "N/mm",
    )  # fmt: skip
    if stands is not None and stands.stop in ("bump", "rebound"):
        label = f"{head}: the same with its {stands.stop} stop, {1e3 * stands.into_stop:.1f} mm in"
        yield Fact(label, _number(1e-3 * spring_rate(line, length)), "N/mm")
    low, high = rate_range(line)
    between = "between its stops" if line.bump_curve is not None else "over its curve"
    yield Fact(f"{head}: rates {between}", f"{1e-3 * low:.4g} to {1e-3 * high:.4g}", "N/mm")


def tire_unit(template: str, key: str) -> str:
    """Unit of a parameter of a tire; empty where it has none."""
    return TIRE_UNITS.get((template, key), TIRE_UNITS.get(("", key), ""))


def _of_tracks(spec: TrackedVehicleSpec) -> list[Section]:
    builder = ModelBuilder()
    add_tracked_vehicle(builder, spec)
    mass, _ = _masses(builder)
    whole = (
        Fact("mass", _number(mass), "kg"),
        Fact("mass of the hull alone", _number(sum(part.mass for part in spec.chassis.components)), "kg"),
        Fact("distance of the tracks", _number(2.0 * spec.track_offset), "m"),
    )
    return [Section("Vehicle", whole), Section("Track", tuple(_numbers(spec.left)))]


def _masses(builder: ModelBuilder) -> tuple[float, Any]:
    """Mass [kg] and centre of mass (3,) [m] of all bodies."""
    masses = np.array([body.mass for body in builder.bodies])
    places = np.array([body.pose.position for body in builder.bodies], float)
    return float(masses.sum()), masses @ places / masses.sum()


def _numbers(part: Spec) -> Iterator[Fact]:
    """Numbers of a description; curves by the count of their points, nested parts and points not at all."""
    for field in dataclasses.fields(part):
        value: object = getattr(part, field.name)
        label = field.name.replace("_", " ")
        if field.name in LEFT_OUT or value is None or isinstance(value, Spec):
            continue
        if isinstance(value, bool | str):
            yield Fact(label, {True: "yes", False: "no"}.get(value, str(value)) if isinstance(value, bool) else value)
        elif _is_number(value):
            yield Fact(label, _number(value), _unit(part, field.name))
        elif isinstance(value, Sequence) and value and all(_is_number(each) for each in value):
            if "ratio" in field.name or "axles" in field.name:
                yield Fact(label, ", ".join(_number(each) for each in value))
        elif isinstance(value, Sequence) and value and not isinstance(value[0], RigidPart | Spec):
            yield Fact(label, f"{len(value)} points")


def _unit(part: Spec, name: str) -> str:
    return OWN_UNITS.get((type(part), name), FURTHER_UNITS.get(name, KEY_UNITS.get(name.rsplit("_", 1)[-1], "")))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(value: object) -> str:
    return f"{value:.5g}"
