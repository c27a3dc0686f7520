"""Visuals of the shipped vehicles: a body in the vehicle's frame of reference, and wheels of their own."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, Unpack

import numpy as np

from simwarp.core.rotation import frame_from_axis
from simwarp.core.types import ModelError, ShapeType, Vec3, finite_vector, pose
from simwarp.geometry.visual_mesh import VisualMesh, joined
from simwarp.scenery.solids import Array, mirrored, moved
from simwarp.scenery.vehicle_bodies import PLAIN_STYLE, STYLES, BodyStyle, wheel_mesh
from simwarp.scenery.visual import Label, Proxy, Visual
from simwarp.vehicle.construction import trailer_boxes
from simwarp.vehicle.reduced.reduced_construction import standing_center
from simwarp.vehicle.spec.vehicle_files import load_vehicle

if TYPE_CHECKING:
    from simwarp.sensors.instances import PlainAppearanceOptions
    from simwarp.sensors.scene import Visuals
    from simwarp.vehicle.construction import UnitParts, VehicleParts
    from simwarp.vehicle.spec.vehicle_spec import Axle, Unit, VehicleSpec
    from simwarp.vehicle.vehicle_convoy import Convoy

VEHICLES: Final = tuple(STYLES)
"""Vehicles that have a body."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VehicleVisuals:
    """A vehicle's visual.

    Attributes:
        body: without trailers, in the vehicle's frame of reference (X forward, Y left, Z up), without wheels.
        wheels: front left, front right, rear left, rear right, about their own middles; they spin about y.
        places: (4, 3) middles of the wheels in the vehicle's frame when it stands on them [m].
    """

    body: VisualMesh
    wheels: tuple[VisualMesh, ...]
    places: Array


PLAIN: Final[Vec3] = (0.5, 0.1, 0.05)
"""Paint of a vehicle that is drawn from its shapes."""
TRAILER_PAINT: Final[Vec3] = (0.55, 0.56, 0.58)
"""Of trailers, unless a colour is given."""
DARK: Final[Vec3] = (0.03, 0.03, 0.035)
DRAWBAR: Final = 0.05
"""Its radius [m]."""
ALIKE: Final = 0.02
"""Wheelbase, track and tires that differ by a smaller share are those of the shipped vehicle."""


def vehicle_visuals_of(name: str, *, color: Vec3 | None = None, spec: VehicleSpec | None = None) -> VehicleVisuals:
    """The picture of a shipped vehicle without its trailers: 320 to 700 triangles for its body, 280 for a wheel.

    Args:
        name: one of `VEHICLES`, or that with a hyphen and more, such as "hmmwv-reduced".
        color: of its paint, linear; None: its own.
        spec: of another vehicle in its form: length, width and height follow its wheelbase, track and tires, and it
            stands on its wheels as built. None: the shipped one.
    """
    style, shipped = _style(name), load_vehicle(_kind(name))
    factors = None if spec is None else _factors(spec, shipped)
    spec = shipped if spec is None or factors is None else spec
    places = _places(spec)
    if factors is None:  # the shipped ones sag on their springs: the heights are measured
        places[:, 2] = np.repeat(style.axles, 2)
    radii = [spec.axles[axle].tire.radius for axle in (0, -1)]
    body = joined(style.parts(_paint(style, color)))
    # the body stands level over its wheels, which need not be level in the frame of reference
    (front, high), (rear, low) = places[0, [0, 2]], places[-1, [0, 2]]
    high, low = high - radii[0], low - radii[1]
    points = body.vertices * (1.0 if factors is None else factors) + np.array([0.5 * (front + rear), 0.0, 0.0])
    points[:, 2] += low + (high - low) * (points[:, 0] - rear) / (front - rear) if front > rear else low
    return VehicleVisuals(
        body=dataclasses.replace(body, vertices=points), wheels=_wheels(style, spec.axles), places=places
    )


def vehicle_visual(name: str, *, color: Vec3 | None = None) -> Visual:
    """A whole vehicle as one thing that stands on level ground, its wheels still: for parked cars, and for ghosts that
    are moved as one.

    Args:
        name, color: as of `vehicle_visuals_of`.

    Returns:
        A visual with one BOX around it without its mirrors; its origin is below that of the vehicle's frame.
    """
    style, spec = _style(name), load_vehicle(_kind(name))
    places = _places(spec)
    middle = 0.5 * (places[0, 0] + places[-1, 0])
    body = moved(joined(style.parts(_paint(style, color))), (middle, 0.0, 0.0))
    wheels = [
        moved(wheel, (*place[:2], spec.axles[-(index // 2)].tire.radius))
        for index, (wheel, place) in enumerate(zip(_wheels(style, spec.axles), places.tolist(), strict=True))
    ]
    mesh = joined([body, *wheels])
    (long, wide, tall), at = style.size, 0.5 * float(mesh.vertices[:, 0].min() + mesh.vertices[:, 0].max())
    box = Proxy(
        kind=ShapeType.BOX, size=(0.5 * long, 0.5 * wide, 0.5 * tall), pose=pose((at, 0.0, 0.5 * tall))
    )  # fmt: skip
    return Visual(name=_kind(name), mesh=mesh, proxies=(box,), label=Label.VEHICLE, reflectance=0.6)


def add_vehicle_visual(
    visuals: Visuals, parts: VehicleParts, *, like: str | None = None, color: Vec3 | None = None,
    prefix: str | None = None, box: int | None = None, **appearance: Unpack[PlainAppearanceOptions],
) -> list[int]:  # fmt: skip
    """The body on the chassis and a wheel on every spindle, so that wheels spin and steer; returns the instances.

    A vehicle that is none of `VEHICLES`, nor said to be like one, is drawn from its shapes: the box that stands for it
    in contacts, or one of its description's `chassis.size`, and wheels as large as its tires.

    Args:
        visuals: of the builder that `parts` was added to.
        parts: from `simwarp.vehicle.construction.add_vehicle`.
        like: name of the body, in the vehicle's own size; None: that of the vehicle's description.
        color: of the paint, linear; None: the body's own.
        prefix: of the names of the instances, "body" and "wheel_0" to "wheel_3"; the vehicle's own when None.
        box: shape that stands for the chassis in contacts, from `simwarp.vehicle.add_chassis_box`: the body takes its
            place. Instances that were added before it get other indices.
        appearance: fields of `Appearance`; label and reflectance are those of vehicles unless given.

    Raises:
        ModelError: there is no body of the name `like`.
    """
    spec = parts.spec
    name = spec.name if like is None else _kind(like)
    prefix = parts.prefix if prefix is None else prefix
    visuals.hide(*trailer_boxes(visuals.builder, parts))
    own: PlainAppearanceOptions = {"label": int(Label.VEHICLE), "reflectance": 0.6}
    appearance = own | appearance
    if has_body(name):
        if box is not None:
            visuals.hide(box)
        body, place = vehicle_visuals_of(name, color=color, spec=spec).body, pose(parts.reference)
        instances = [visuals.add_mesh(parts.chassis, body, name=f"{prefix}body", pose=place, **appearance)]
    else:
        instances = [_show_box(visuals, parts, box, f"{prefix}body", PLAIN if color is None else color, appearance)]
    style = STYLES[_kind(name)] if has_body(name) else PLAIN_STYLE
    for index, (side, wheel) in enumerate(zip(parts.sides, _wheels(style, spec.all_axles), strict=True)):
        place = pose()
        if not parts.has_wheel_bodies:  # the chassis carries its wheels as the vehicle stands
            place = pose(np.add(parts.reference, standing_center(spec.all_axles[side.axle], index % 2)))
        instances.append(
            visuals.add_mesh(side.spindle, wheel, name=f"{prefix}wheel_{index}", pose=place, **appearance)
        )  # fmt: skip
    for number, (unit, part) in enumerate(zip(parts.units[1:], spec.units[1:], strict=True)):
        instances += _show_trailer(visuals, unit, part, f"{prefix}trailer_{number}", color, appearance)
    return instances


def _show_trailer(
    visuals: Visuals, unit: UnitParts, part: Unit, name: str, color: Vec3 | None, appearance: PlainAppearanceOptions
) -> list[int]:  # fmt: skip
    """A trailer's box, and the drawbar from it to the hitch where that lies outside of the box."""
    paint = TRAILER_PAINT if color is None else color
    size, center = np.array(part.chassis.size), np.array(part.chassis.size_center)
    half = (0.5 * size).tolist()
    instances = [
        visuals.add_box(
            unit.chassis, half=(half[0], half[1], half[2]), pose=pose(unit.reference + center), name=name, color=paint,
            **appearance,
        )
    ]  # fmt: skip
    assert part.hitch is not None  # of trailers
    hitch, front = np.array(part.hitch.trailer_point), center[0] + half[0]
    if hitch[0] > front:
        foot = np.array([front, hitch[1], max(hitch[2], center[2] - half[2])])
        way = hitch - foot
        length = float(np.linalg.norm(way))
        place = pose(unit.reference + 0.5 * (hitch + foot), frame_from_axis("drawbar", way / length))
        instances.append(
            visuals.add_capsule(
                unit.chassis, radius=DRAWBAR, half_length=0.5 * length, name=f"{name}_drawbar", pose=place,
                color=DARK, **appearance,
            )
        )  # fmt: skip
    return instances


def _show_box(
    visuals: Visuals, parts: VehicleParts, box: int | None, name: str, color: Vec3, appearance: PlainAppearanceOptions
) -> int:
    """Show a vehicle's chassis as a box: the one in contacts, or that of its description."""
    if box is not None:
        visuals.show(box, color=color, **appearance)
        return visuals.index_of(box)
    chassis = parts.spec.chassis
    long, wide, tall = chassis.size
    half = (0.5 * long, 0.5 * wide, 0.5 * tall)
    place = pose(np.add(parts.reference, chassis.size_center))
    return visuals.add_box(parts.chassis, half=half, pose=place, name=name, color=color, **appearance)


def convoy_visuals(convoy: Convoy) -> Visuals:
    """Visuals of a convoy (`simwarp.vehicle.set_up_convoy`): bodies and wheels in place of the boxes in contacts.

    There is no ground in them: add one, then `finalize(convoy.simulation.model)`.
    """
    from simwarp.sensors.scene import Visuals

    visuals = Visuals(convoy.builder)
    for box, parts in zip(convoy.boxes, convoy.vehicles.parts, strict=True):
        add_vehicle_visual(visuals, parts, box=box)
    return visuals


def has_body(name: str) -> bool:
    """Return True if a vehicle of this name has a body: it is one of `VEHICLES`, or that with a hyphen and more."""
    return any(name == kind or name.startswith(f"{kind}-") for kind in VEHICLES)


def _kind(name: str) -> str:
    for kind in VEHICLES:
        if name == kind or name.startswith(f"{kind}-"):
            return kind
    raise ModelError(f"vehicle visual: name must be one of {', '.join(VEHICLES)}, got {name!r}; say which it is like")


def _style(name: str) -> BodyStyle:
    return STYLES[_kind(name)]


def _paint(style: BodyStyle, color: Vec3 | None) -> Array:
    return style.color if color is None else finite_vector("vehicle visual", "color", color, 3)


def _wheels(style: BodyStyle, axles: Sequence[Axle]) -> tuple[VisualMesh, ...]:
    """Two per axle, left and right, in the sizes of its tires."""
    left = [wheel_mesh(style, axle.tire.radius, axle.tire.width) for axle in axles]
    return tuple(wheel for mesh in left for wheel in (mesh, mirrored(mesh)))


def _factors(spec: VehicleSpec, shipped: VehicleSpec) -> Array | None:
    """(3,) lengths of a vehicle over a shipped one's: wheelbase, track, radius of its tires; None: it is alike."""

    def lengths(each: VehicleSpec) -> Array:
        places = _places(each)
        radius = np.mean([axle.tire.radius for axle in each.axles])
        wheelbase = places[0, 0] - places[-1, 0] if len(each.axles) > 1 else 0.0
        return np.array([wheelbase, np.ptp(places[:, 1]), radius])

    factors = lengths(spec) / lengths(shipped)
    if factors[0] <= 0.0:  # one axle: as long as it is wide
        factors[0] = factors[1]
    return None if np.all(np.abs(factors - 1.0) < ALIKE) else factors


def _places(spec: VehicleSpec) -> Array:
    """(wheels, 3) middles of the wheels in the vehicle's frame, as built [m]."""
    return np.array([
        np.add(axle.location, np.multiply(axle.suspension.spindle.com, (1.0, side, 1.0)))
        for axle in spec.axles for side in (1.0, -1.0)
    ])  # fmt: skip
