"""What sinks into soil: wheels, boxes, spheres, capsules and cylinders on bodies of a model."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Annotated, Any, Final, NamedTuple, TypeAlias

import numpy as np
import warp as wp

from simwarp.core.constraints import Angle, Ge, Gt, Meaning, NotNegative, Positive
from simwarp.core.rotation import rotate
from simwarp.core.types import ModelError, Pose, ShapeType, Vec3, pose
from simwarp.model.checks import checked_instances, whole_number
from simwarp.model.model import Model
from simwarp.model.rules import Lengths, Passive, Vector3, held_fields, instance_of
from simwarp.soil.soil_columns_kernels import SIDE
from simwarp.soil.soil_parameters import USUAL_ANGLE
from simwarp.soil.soil_tables_kernels import BALL, BLADE, BOX, CAPSULE, WHEEL, SoilShapes as ShapeTables

GivenPose: TypeAlias = Annotated[Pose, instance_of(Pose, "make it by sw.pose")]
Carrier: TypeAlias = Annotated[int | str, Meaning("an integer, the body's index, or its name")]
USUAL_FRICTION: Final = math.radians(20.0)
"""Between steel and sand [rad]."""
Size: TypeAlias = Annotated[Positive, Meaning("its size in metres")]


@dataclasses.dataclass(frozen=True, kw_only=True)
class SoilWheel:
    """A rigid wheel on soil: the y axis of its body is its axis.

    Attributes:
        body: index or name of the spindle.
        radius, width: [m].
        crown: radius of the tread across [m]; 0: it is flat.
        offset: of the wheel's centre from the body's centre of mass, body axes [m].
    """

    body: Carrier
    radius: Size
    width: Size
    crown: Passive = 0.0
    offset: Vector3 = (0.0, 0.0, 0.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SoilBox:
    """A box on soil: a belly, a plate, a rock.

    Attributes:
        body: index or name.
        half: half lengths [m].
        pose: of the box from the body's centre of mass, body axes.
    """

    body: Carrier
    half: Lengths
    pose: GivenPose = dataclasses.field(default_factory=pose)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SoilSphere:
    """A ball on soil, such as a foot.

    Attributes:
        body: index or name.
        radius: [m].
        offset: of its centre from the body's centre of mass, body axes [m].
    """

    body: Carrier
    radius: Size
    offset: Vector3 = (0.0, 0.0, 0.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SoilCapsule:
    """A segment along z of its pose, thickened by a radius.

    Attributes:
        body: index or name.
        radius, half_length: of its tube [m].
        pose: from the body's centre of mass, body axes.
    """

    body: Carrier
    radius: Size
    half_length: Passive
    pose: GivenPose = dataclasses.field(default_factory=pose)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SoilCylinder:
    """A cylinder about z of its pose: a wheel whose axis is not that of its body.

    Attributes:
        body: index or name.
        radius, half_length: [m].
        pose: from the body's centre of mass, body axes.
    """

    body: Carrier
    radius: Size
    half_length: Size
    pose: GivenPose = dataclasses.field(default_factory=pose)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SoilBlade:
    """A blade that cuts soil and pushes it ahead, as a bulldozer's.

    What stands above its edge where that has passed heaps up ahead of it, slides down by its angle of repose, and round
    its ends. The soil resists by the fundamental equation of earth moving (Reece 1965, McKyes 1985), with the heap as a
    surcharge; it presses on nothing but the face: an edge that should not sink in stands on other shapes.

    Attributes:
        body: index or name.
        width: of the edge [m].
        height: of the face [m]; says how far ahead soil slides.
        rake: angle of the face from the ground ahead [rad]; pi / 2: upright, less: it leans back.
        pose: of the middle of the edge from the body's centre of mass, body axes: x ahead, y along the edge, z up.
        friction_angle: between face and soil [rad].
        adhesion: between them [Pa].
        repose: angle that heaps slide down to [rad].
    """

    body: Carrier
    width: Size
    height: Size
    rake: Annotated[float, Ge(math.radians(20.0)), Angle(math.radians(130.0)), Meaning("radians")] = 0.5 * math.pi
    pose: GivenPose = dataclasses.field(default_factory=pose)
    friction_angle: Annotated[NotNegative, Angle(math.radians(45.0)), Meaning("radians")] = USUAL_FRICTION
    adhesion: Passive = 0.0
    repose: Annotated[float, Gt(0.05), Angle(math.radians(60.0)), Meaning("radians")] = USUAL_ANGLE

    @property
    def reach(self) -> float:
        """How far ahead and beyond the ends soil slides [m]: as far as a heap of the face's height does, and a half."""
        return 1.5 * self.height / math.tan(self.repose)


SoilShape: TypeAlias = SoilWheel | SoilBox | SoilSphere | SoilCapsule | SoilCylinder | SoilBlade


class _Row(NamedTuple):
    """A row of the tables of shapes that kernels read."""

    kind: int
    offset: Any
    radius: float
    half_width: float = 0.0
    crown: float = 0.0
    half: Any = (0.0, 0.0, 0.0)
    axis: Any = (0.0, 1.0, 0.0)
    side: Any = (1.0, 0.0, 0.0)
    width: float = 0.0
    """Of the narrowest part that should have two nodes [m]."""


def checked_shapes(shapes: Any) -> tuple[SoilShape, ...]:
    """Shapes as they were given, each of a kind that sinks in.

    Raises:
        ModelError: it is no list, or something else is among them.
    """
    names = f"of {', '.join(kind.__name__ for kind in _ROWS)}"
    listed = checked_instances("soil", "shapes", shapes, tuple(_ROWS), names, "wrap it in one of these")
    for shape in listed:
        held_fields(type(shape).__name__, type(shape), vars(shape))
    return listed


def _axis(pose: Pose, axis: Vec3) -> Any:
    return rotate(pose.rotation, np.array(axis))


def _wheel_row(s: SoilWheel) -> _Row:
    return _Row(int(WHEEL), s.offset, s.radius, 0.5 * s.width, s.crown, width=s.width)


def _box_row(s: SoilBox) -> _Row:
    up, side = _axis(s.pose, (0.0, 0.0, 1.0)), _axis(s.pose, (1.0, 0.0, 0.0))
    around = math.hypot(*s.half)
    width = 2.0 * sorted(s.half)[1]  # it may be as thin as it likes
    return _Row(int(BOX), s.pose.position, around, half=s.half, axis=up, side=side, width=width)


def _sphere_row(s: SoilSphere) -> _Row:
    return _Row(int(BALL), s.offset, s.radius, width=2.0 * s.radius)


def _capsule_row(s: SoilCapsule) -> _Row:
    axis = _axis(s.pose, (0.0, 0.0, 1.0))
    return _Row(int(CAPSULE), s.pose.position, s.radius, s.half_length, axis=axis, width=2.0 * s.radius)


def _cylinder_row(s: SoilCylinder) -> _Row:
    axis = _axis(s.pose, (0.0, 0.0, 1.0))
    width = 2.0 * min(s.radius, max(s.half_length, 0.5 * s.radius))
    return _Row(int(WHEEL), s.pose.position, s.radius, s.half_length, axis=axis, width=width)


def _blade_row(s: SoilBlade) -> _Row:
    up, ahead = _axis(s.pose, (0.0, 0.0, 1.0)), _axis(s.pose, (1.0, 0.0, 0.0))
    around = math.hypot(0.5 * s.width, s.height)
    return _Row(int(BLADE), s.pose.position, around, axis=up, side=ahead, width=s.width)


_ROWS: Final[dict[type, Callable[[Any], _Row]]] = {
    SoilWheel: _wheel_row, SoilBox: _box_row, SoilSphere: _sphere_row, SoilCapsule: _capsule_row,
    SoilCylinder: _cylinder_row, SoilBlade: _blade_row,
}  # fmt: skip


def _row(shape: SoilShape) -> _Row:
    return _ROWS[type(shape)](shape)


def narrowest_width(shapes: Sequence[SoilShape]) -> float:
    """The narrowest shape's width [m]; a plate's thickness does not count."""
    return min(_row(shape).width for shape in shapes)


def greatest_reach(shapes: Sequence[SoilShape]) -> float:
    """Farthest that a point of a shape may be from its centre, or more [m]."""
    return max(row.radius + row.half_width for row in map(_row, shapes))


def pages_at_a_time(shapes: Sequence[SoilShape], spacing: float) -> int:
    """Pages that all shapes may lie on together; wheels upright and sunk to their axles."""
    side = int(SIDE) * spacing
    total = 0
    for shape in shapes:
        row = _row(shape)
        long = wide = 2.0 * (row.radius + row.half_width)
        if row.kind == int(WHEEL):
            long, wide = 2.0 * row.radius, 2.0 * (row.half_width + spacing)
        # an interval meets one page more than it holds at most, and one of rounding
        total += (int(long / side) + 2) * (int(wide / side) + 2)
    return total


def body_of(model: Model, body: int | str) -> int:
    """Index of a body of a model, by index or name.

    Raises:
        ModelError: there is no such body.
    """
    if isinstance(body, str):
        return model.body(body)
    return whole_number(
        "soil", "body", body, 0, model.body_count - 1, "name it, or give its index; the world is ground"
    )


def carriers_of(model: Model, shapes: Sequence[SoilShape]) -> tuple[int, ...]:
    """Bodies that have shapes, in the order of their first one."""
    return tuple(dict.fromkeys(body_of(model, shape.body) for shape in shapes))


def shape_tables(model: Model, shapes: Sequence[SoilShape]) -> Any:
    """Shapes as the kernels take them.

    Raises:
        ModelError: a size or an offset breaks its rule, or a body does not exist.
    """
    device = model.device
    rows = [_row(shape) for shape in shapes]
    bodies = [body_of(model, shape.body) for shape in shapes]
    table: Any = ShapeTables()

    table.body = _ints(bodies, device)
    table.kind = _ints([row.kind for row in rows], device)
    share_bodies(table, model, shapes, [0] * len(carriers_of(model, shapes)))
    for name in ("radius", "half_width", "crown"):
        setattr(table, name, wp.array([getattr(row, name) for row in rows], dtype=float, device=device))
    for name, values in (
        ("offset_b", [row.offset for row in rows]),
        ("axis_b", [row.axis for row in rows]),
        ("side_b", [row.side for row in rows]),
        ("half", [row.half for row in rows]),
    ):
        rows_of = np.array(values, np.float32).reshape(-1, 3)
        setattr(table, name, wp.array(rows_of, dtype=wp.vec3, device=device))
    return table


def share_bodies(table: Any, model: Model, shapes: Sequence[SoilShape], adds: Sequence[int]) -> int:
    """Writes into the tables which bodies get several sums; returns how many they are.

    Args:
        table: of the shapes.
        model, shapes: those of the soil.
        adds: of each of `carriers_of`: 1 where an element before the soil writes its forces, 2 its blocks too.
    """
    bodies = [body_of(model, shape.body) for shape in shapes]
    of_body = {body: [k for k, other in enumerate(bodies) if other == body] for body in bodies}
    pushed = {body for body, shape in zip(bodies, shapes, strict=True) if isinstance(shape, SoilBlade)}
    several = {body for body in of_body if len(of_body[body]) > 1}
    shared = {body: add for body, add in zip(of_body, adds, strict=True) if add or body in several | pushed}
    members = [of_body[body] for body in shared]
    table.alone = _ints([body not in shared for body in bodies], model.device)
    table.shared, table.adds = _ints(list(shared), model.device), _ints(list(shared.values()), model.device)
    table.member_start = _ints(np.cumsum([0, *map(len, members)]), model.device)
    table.member = _ints([k for each in members for k in each], model.device)
    return len(shared)


def _ints(values: Any, device: Any) -> wp.array:
    return wp.array(np.array(values, np.int32), dtype=int, device=device)


def soil_shapes(model: Model, bodies: Sequence[int | str] | None = None) -> list[SoilShape]:
    """Collision shapes of bodies as shapes of a soil, in their order: a robot's feet, a chassis' belly.

    Args:
        model: of the worlds; where they differ in shapes, those of world 0 count.
        bodies: indices or names; None: all that have shapes.

    Raises:
        ModelError: a body has no shape, or one that is neither box, sphere, capsule nor cylinder.
    """
    where = model.topology.shape_body.numpy()
    wanted = sorted({int(b) for b in where if b >= 0}) if bodies is None else [body_of(model, b) for b in bodies]
    place, turn, size = (getattr(model.parameters, f"shape_{name}").numpy()[0] for name in ("x", "rot", "size"))
    found: list[SoilShape] = []
    for body in wanted:
        mine = np.flatnonzero(where == body)
        if not len(mine):
            name = model.body_names[body]
            raise ModelError(f"soil_shapes: body '{name}' must have a shape, got none; name bodies that touch the soil")
        for k in mine:
            at = pose(tuple(place[k]), tuple(turn[k]))
            found.append(_of_kind(model, int(k), body, at, tuple(float(each) for each in size[k])))
    return found


def _of_kind(model: Model, index: int, body: int, at: Pose, size: Vec3) -> SoilShape:
    match model.shape_types[index]:
        case ShapeType.BOX:
            return SoilBox(body=body, half=size, pose=at)
        case ShapeType.SPHERE:
            x, y, z = (float(value) for value in at.position)
            return SoilSphere(body=body, radius=size[0], offset=(x, y, z))
        case ShapeType.CAPSULE:
            return SoilCapsule(body=body, radius=size[0], half_length=size[1], pose=at)
        case ShapeType.CYLINDER:
            return SoilCylinder(body=body, radius=size[0], half_length=size[1], pose=at)
        case other:
            rule = "box, sphere, capsule or cylinder"
            raise ModelError(
                f"soil_shapes: shape '{model.shape_names[index]}' must be a {rule}, got {other.name.lower()}; "
                "leave its body out and give the soil a SoilBox or SoilSphere there"
            )
