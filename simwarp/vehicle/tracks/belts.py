"""Tracks by belt at work: their tensions, and the ground's forces on them, in every world of a model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.arrays import writable, writable_from
from simwarp.core.object_repr import Names, Row, plural
from simwarp.core.types import ModelError
from simwarp.model.model import Model
from simwarp.simulation.attachments import ForceElement, StepContext
from simwarp.soil.soil_parameters import SoilSpec, soils_of
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.track_parts import SinglePinShoe, pad_around
from simwarp.vehicle.tires.ground_kernels import TerrainTables
from simwarp.vehicle.tires.tires import ground as plane, ground_rows
from simwarp.vehicle.tracks.belt_construction import BeltTrackParts
from simwarp.vehicle.tracks.belt_losses import gap_loss
from simwarp.vehicle.tracks.belt_path import running_radius
from simwarp.vehicle.tracks.belt_tables_kernels import (
    COLUMNS,
    WHEEL_COLUMNS,
    BeltMemory,
    BeltParameter,
    BeltReports,
    BeltTables,
    BeltWork,
    PointKind,
    WheelColumn,
)
from simwarp.vehicle.tracks.belts_kernels import run_belts, sum_belts

Array = npt.NDArray[np.float64]

ARC_SHARES: Final = (2.0 / 3.0, 1.0 / 3.0)
"""Of the turn from the lower span to straight ahead, of the points before sprocket and behind idler."""


class Belts(ForceElement):
    """All tracks by belt of a model, in every world: one `ForceElement`.

    It writes the arms' entries of `control.element_joint_force`. To those of the chassis in `element_force` and
    `element_torque`, and to the shafts', it adds, so that it stands behind an element that drives the sprockets;
    alone, it writes these too.

    Args:
        parts: of the tracks, in the order of the reports.
        model: of the vehicles.
        ground: surface under the belts (`vehicle.ground`); the plane z = 0 when None.
        friction: coefficient of the ground, for all worlds until `ground_friction` is written.
        soil: deformable ground: a `SoilSpec` or the name of a preset; None: it is hard.
        alone: no other element writes the entries of chassis and shafts.
        randomised: True if every world has rows of its own in `parameter`, `soil` and `ground_friction`.

    Attributes:
        parts: of the tracks.
        parameter: (1 or W, belts, P), columns are those of `BeltParameter`.
        soil: (1 or W, 1, 8), columns are those of `SoilParameter`; zeros on hard ground.
        ground_friction: (1 or W,).
        terrain: the ground.
        tension: (W, belts) at the idler [N].
        speed: (W, belts) of the belt around its wheels, positive forwards [m/s].
        traction: (W, belts) of the ground, forwards [N].
        resistance: (W, belts) of the belt to its own motion, positive forwards [N].
        load: (W, belts, wheels) of the ground on road wheels, from the sprocket's end on [N].
        force, torque: (W, belts) vec3 of the ground, about the chassis' centre of mass, world axes [N, N·m].
        point_force: (W, belts, points) vec3 [N].
        point_arm: (W, belts, points) vec3 from the chassis' centre of mass, world axes [m].
        idler: (W, belts) along the slide, positive as the slide's axis [m].

    Raises:
        ModelError: there is no track, or two are one.
        SpecError: more than one soil.
    """

    def __init__(
        self, parts: Sequence[BeltTrackParts], model: Model, *, ground: TerrainTables | None = None,
        friction: float = 0.9, soil: SoilSpec | str | None = None, alone: bool = False, randomised: bool = False,
    ) -> None:  # fmt: skip
        self.parts, self.model = tuple(parts), model
        shafts = [each.sprocket for each in self.parts]
        if not shafts or len(set(shafts)) < len(shafts):
            raise ModelError(f"Belts: parts must be one track or more, each once, got sprockets {shafts}; list others")
        device, copies = model.device, model.world_count if randomised else 1
        self.terrain = plane(device) if ground is None else ground
        vectors = np.stack([_parameters(each) for each in self.parts])
        self.parameter = writable_from(np.tile(vectors, (copies, 1, 1)), wp.float32, device, label="parameter")
        self.ground_friction = writable_from(np.full(copies, friction), wp.float32, device, label="ground_friction")
        law = _soil_values(soil)
        self.soil = writable_from(np.tile(law, (copies, 1, 1)), wp.float32, device, label="soil")
        self._tables = _tables(self.parts, model, soft=soil is not None, add=not alone)
        shape = (model.world_count, len(self.parts))
        wheels = max(len(each.arms) for each in self.parts)
        points = int(self._tables.kind.shape[1])
        self._memory: Any = _zeros(BeltMemory(), shape, {"lift": points, "shear": points, "sinkage": points}, device)
        self._memory.idler.assign(np.tile([each.resting.idler for each in self.parts], (model.world_count, 1)))
        on_points = dict.fromkeys(("place", "ground", "normal", "press", "area", "pull"), points)
        work: Any = BeltWork()
        on_circles = {name: wheels + 2 for name in work._cls.vars if name not in on_points}
        self._work: Any = _zeros(work, shape, on_points | on_circles, device)
        lengths = {"load": wheels, "point_force": points, "point_arm": points}
        self._reports: Any = _zeros(BeltReports(), shape, lengths, device)
        self.tension: wp.array = self._reports.tension
        self.speed: wp.array = self._reports.speed
        self.traction: wp.array = self._reports.traction
        self.resistance: wp.array = self._reports.resistance
        self.load: wp.array = self._reports.load
        self.force: wp.array = self._reports.force
        self.torque: wp.array = self._reports.torque
        self.point_force: wp.array = self._reports.point_force
        self.point_arm: wp.array = self._reports.point_arm
        self.idler: wp.array = self._memory.idler

    def _readable_title(self) -> str:
        worlds = plural(self.model.world_count, "world")
        return f": {len(self.parts)} in each of {worlds} on {self.model.device}"

    def _readable_rows(self) -> dict[str, Row]:
        names = [self.model.builder.joints[each.sprocket].name for each in self.parts]
        return {"sprockets": Names(len(names), iter(names))}

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that a reset restores and a snapshot keeps."""
        return {name: getattr(self._memory, name) for name in self._memory._cls.vars}

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """Numbers of the belts and of the ground."""
        own = {"parameter": self.parameter, "soil": self.soil, "ground_friction": self.ground_friction}
        return own | ground_rows(self.terrain)

    @property
    def assigned_bodies(self) -> tuple[int, ...]:
        """Chassis, if no other element writes their forces."""
        return tuple(sorted({each.chassis for each in self.parts})) if self._tables.add == 0 else ()

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """Launches of one sub-step: each belt, then the sums on chassis."""
        model, control = simulation.model, simulation.control.arrays
        belts = simulation.shares.record(
            run_belts, len(self.parts),
            inputs=[
                dt, self._tables, self.parameter, self.soil, self.ground_friction, self.terrain, model.assets,
                simulation.state.arrays, self._memory, self._work,
            ],
            outputs=[self._reports, control.element_joint_force],
        )  # fmt: skip
        sums = simulation.shares.record(
            sum_belts, inputs=[self._tables, self._reports],
            outputs=[control.element_force, control.element_torque],
        )  # fmt: skip
        return [belts, sums]


def _zeros(instance: Any, shape: tuple[int, int], lengths: Mapping[str, int], device: Any) -> Any:
    """The instance of a struct whose arrays are (W, belts), those in `lengths` with a third axis."""
    for name, member in instance._cls.vars.items():
        full = (*shape, lengths[name]) if name in lengths else shape
        setattr(instance, name, writable(full, member.type.dtype, device, label=name))
    return instance


def _soil_values(soil: SoilSpec | str | None) -> Array:
    """(8,) of the one soil; zeros of none."""
    if soil is None:
        return np.zeros(8)
    listed = soils_of(soil)
    if len(listed) != 1:
        raise SpecError(f"soil: must be one for belts, got {len(listed)}; make one Belts for each")
    return np.array(listed[0].values())


def _parameters(parts: BeltTrackParts) -> Array:
    """(P,) of a belt, in the order of `BeltParameter`."""
    track, resting = parts.spec, parts.resting
    shoe, law, tensioner = track.shoe, track.belt, track.idler.tensioner
    assert isinstance(shoe, SinglePinShoe)  # of BeltTrack.check
    depth = 0.5 * shoe.ground_pad.size[2] - shoe.ground_pad.center[2]
    built = resting.centers[-1] - resting.idler * resting.slide
    sign = math.copysign(1.0, tensioner.chassis_point[0] - tensioner.carrier_point[0])
    column = BeltParameter
    values = {
        column.FRICTION: shoe.friction if law.friction is None else law.friction,
        **_soil_pads(shoe, law.width),
        column.DEPTH: depth,
        column.GROUND_STIFFNESS: law.ground_stiffness,
        column.GROUND_DAMPING: law.ground_damping_time,
        column.SHEAR_LENGTH: law.shear_length,
        column.SHEAR_DAMPING: law.shear_damping_time,
        column.WHEEL_SINK: law.wheel_sink,
        column.LENGTH: resting.length,
        column.STRETCH: resting.stretch,
        column.SPROCKET_RADIUS: resting.radii[0],
        column.IDLER_RADIUS: resting.radii[-1],
        column.PITCH_RADIUS: running_radius(track, resting),
        column.IDLER_X: built[0],
        column.IDLER_Z: built[1],
        column.SLIDE_X: resting.slide[0],
        column.SLIDE_Z: resting.slide[1],
        column.TENSIONER_FORCE: sign * tensioner.force,
        column.TENSIONER_STIFFNESS: tensioner.stiffness,
        column.TENSIONER_DAMPING: tensioner.damping,
        column.LOSS_DRY: law.dry_loss,
        column.LOSS_LINEAR: law.linear_loss,
        column.LOSS_SQUARE: law.square_loss,
        column.LOSS_WAY: law.loss_length,
        column.LOSS_SPROCKET: gap_loss(track, resting) if law.sprocket_loss is None else law.sprocket_loss,
        column.LOSS_ROLLING: law.rolling_loss,
    }
    assert len(values) == COLUMNS
    return np.array([values[name] for name in column])


def _soil_pads(shoe: SinglePinShoe, width: float | None) -> dict[BeltParameter, float]:
    """What of a shoe presses soil: its pad, and the rectangle around its side pads beside it, as `soil_under_tracks`
    has it; or a closed band of a width.
    """
    column = BeltParameter
    if width is not None:
        return {column.WIDTH: width, column.PATCH: width, column.SIDE_WIDTH: 0.0, column.SIDE_HEIGHT: 0.0}
    pad = shoe.ground_pad
    x, y, _ = pad.size
    values = {column.WIDTH: x * y / shoe.pitch, column.PATCH: x * y / (x + y)}
    if not shoe.side_pads:
        return values | {column.SIDE_WIDTH: 0.0, column.SIDE_HEIGHT: 0.0}
    sides = pad_around(shoe.side_pads)
    length, width, _ = sides.size
    return values | {
        column.SIDE_WIDTH: max(length * width - x * y, 0.0) / shoe.pitch,
        column.SIDE_HEIGHT: max(sides.bottom - pad.bottom, 0.0),
    }


def _points(wheels: int, span: int, ramp: int) -> list[tuple[PointKind, int, float]]:
    """Kind, place and share of a belt's points, from the sprocket to the idler."""
    found = [(PointKind.SPROCKET, 0, share) for share in ARC_SHARES]
    found += [(PointKind.SPAN, 0, k / ramp) for k in range(ramp)]
    for wheel in range(1, wheels + 1):
        found.append((PointKind.WHEEL, wheel, 0.0))
        if wheel < wheels:
            found += [(PointKind.SPAN, wheel, (k + 1.0) / (span + 1.0)) for k in range(span)]
    found += [(PointKind.SPAN, wheels, (k + 1.0) / ramp) for k in range(ramp)]
    return found + [(PointKind.IDLER, wheels + 1, share) for share in reversed(ARC_SHARES)]


def _tables(parts: Sequence[BeltTrackParts], model: Model, *, soft: bool, add: bool) -> Any:
    device, builder = model.device, model.builder
    lists = [_points(len(each.arms), each.spec.belt.span_points, each.spec.belt.ramp_points) for each in parts]
    most, wheels = max(map(len, lists)), max(len(each.arms) for each in parts)
    points = np.zeros((3, len(parts), most))
    arms = np.zeros((len(parts), wheels), int)
    wheel = np.zeros((len(parts), wheels, WHEEL_COLUMNS))
    for belt, (each, listed) in enumerate(zip(parts, lists, strict=True)):
        points[:, belt, : len(listed)] = np.array(listed).T
        order = range(len(each.arms)) if each.resting.forward > 0.0 else range(len(each.arms) - 1, -1, -1)
        for place, index in enumerate(order):
            arms[belt, place] = builder.dof_start(each.arms[index])
            wheel[belt, place] = _wheel(each, index, place + 1)
    table: Any = BeltTables()
    table.chassis = wp.array([each.chassis for each in parts], dtype=int, device=device)
    table.shaft = wp.array([builder.dof_start(each.sprocket) for each in parts], dtype=int, device=device)
    table.arm = wp.array(arms, dtype=int, device=device)
    table.wheels = wp.array([len(each.arms) for each in parts], dtype=int, device=device)
    table.points = wp.array([len(listed) for listed in lists], dtype=int, device=device)
    table.origin_b = wp.array(np.array([each.origin for each in parts]), dtype=wp.vec3, device=device)
    table.forward = wp.array([each.resting.forward for each in parts], dtype=float, device=device)
    table.wheel = wp.array(wheel, dtype=float, device=device)
    table.kind = wp.array(points[0], dtype=int, device=device)
    table.place = wp.array(points[1], dtype=int, device=device)
    table.share = wp.array(points[2], dtype=float, device=device)
    table.add, table.soft = int(add), int(soft)
    return table


def _wheel(parts: BeltTrackParts, index: int, circle: int) -> Array:
    """(WheelColumn,) of the road wheel of an index in the description."""
    track, resting = parts.spec, parts.resting
    mount = track.road_wheels[index]
    suspension = mount.suspension
    to_plane = np.array([resting.forward, 1.0])
    hinge = np.array([suspension.hinge[0], suspension.hinge[2]]) * to_plane
    trailing = math.copysign(1.0, suspension.hinge[0] - suspension.wheel_joint[0])
    values = np.zeros(WHEEL_COLUMNS)
    values[[WheelColumn.HINGE_X, WheelColumn.HINGE_Z]] = resting.centers[circle] + hinge
    values[[WheelColumn.ARM_X, WheelColumn.ARM_Z]] = -hinge
    values[WheelColumn.RADIUS] = resting.radii[circle]
    values[WheelColumn.SENSE] = trailing * resting.forward
    return values
