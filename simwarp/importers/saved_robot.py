"""Imported robots in files: the model, and beside it names, actuators, coordinates, keyframes and the report.

    robot = sw.importers.load_mjcf("robot.xml")
    sw.importers.save_robot(robot, "robot.json")
    robot = sw.importers.load_robot("robot.json")

One file holds all that is simulated, meshes of contact included. What only shows is left out: a saved robot is seen as
its shapes of contact.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from typing import Annotated, Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.actuators import Activation, ActuatorSpec, Law, SitePull, Target
from simwarp.core.constraints import MaxLen
from simwarp.core.schema import Place
from simwarp.core.types import WORLD, Pose, formatted
from simwarp.importers.coordinates import CoordinateKind, CoordinateMap, JointCoordinates
from simwarp.importers.imported import CameraPlace, Imported, Keyframe, NamedFrame, SourceSensor
from simwarp.importers.report import Fate, ImportReport, ReportLine
from simwarp.model.builder import ModelBuilder
from simwarp.model.model_files import model_text, read_model, write_model
from simwarp.model.model_format import (
    MODELS,
    MOST_THINGS,
    UNTURNED,
    ZERO,
    Numbers3,
    Numbers4,
    Side,
    floats,
    limit_of,
    plain,
    sides,
)
from simwarp.model.rules import name_in, word_of

Array = npt.NDArray[np.float64]
Indices: TypeAlias = Mapping[str, int]
Column: TypeAlias = tuple[float, ...]
ROUNDING: Final = 1e-6


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlaceEntry:
    """A `NamedFrame`."""

    body: int = WORLD
    position: Numbers3 = ZERO
    rotation: Numbers4 = UNTURNED


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraEntry:
    """A `CameraPlace`."""

    frame: PlaceEntry
    field_of_view: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class KeyframeEntry:
    """A `Keyframe`."""

    q: Column
    qd: Column
    ctrl: Column
    time: float = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class SensorEntry:
    """A `SourceSensor`."""

    kind: str
    frame: PlaceEntry | None = None
    joint: str = ""
    noise: float = 0.0
    cutoff: float = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class PullEntry:
    """A `SitePull`."""

    frame: PlaceEntry
    gear: tuple[float, float, float, float, float, float]
    reference: PlaceEntry | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class ActuatorEntry:
    """An `ActuatorSpec`; members of its closed sets by name."""

    name: str
    terms: tuple[tuple[int, float], ...] = ()
    site: PullEntry | None = None
    length_offset: float = 0.0
    law: Annotated[str, name_in(Law)] = "effort"
    target: Annotated[str, name_in(Target)] = "position"
    gain: Numbers3 = (1.0, 0.0, 0.0)
    bias: Numbers3 = ZERO
    ctrl_range: tuple[Side, Side] | None = None
    force_range: tuple[Side, Side] | None = None
    activation: Annotated[str, name_in(Activation)] = "none"
    early: bool = False
    time_constant: float = 0.0
    activation_range: tuple[Side, Side] | None = None
    delay: float = 0.0
    torque_speed: tuple[float, float] | None = None
    corner_speed: float = 0.0


RANGES: Final = ("ctrl_range", "force_range", "activation_range")
SETS: Final[dict[str, Any]] = {"law": Law, "target": Target, "activation": Activation}


@dataclasses.dataclass(frozen=True, kw_only=True)
class CoordinateEntry:
    """A `JointCoordinates`."""

    name: str
    kind: Annotated[str, name_in(CoordinateKind)]
    position: int
    rate: int
    dof: int
    offset: float = 0.0
    rotation: Numbers4 = UNTURNED


@dataclasses.dataclass(frozen=True, kw_only=True)
class LineEntry:
    """A `ReportLine`."""

    fate: Annotated[str, word_of(*Fate)]
    element: str
    name: str = ""
    reason: str = ""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RobotEntry:
    """An `Imported` without its builder."""

    source: str
    bodies: Indices
    dofs: Indices
    shapes: Mapping[str, tuple[int, ...]]
    joints: Annotated[tuple[CoordinateEntry, ...], MaxLen(MOST_THINGS)]
    position_count: int
    rate_count: int
    dof_count: int
    initial: Column
    frames: Mapping[str, PlaceEntry] = dataclasses.field(default_factory=dict)
    sites: Mapping[str, PlaceEntry] = dataclasses.field(default_factory=dict)
    cameras: Mapping[str, CameraEntry] = dataclasses.field(default_factory=dict)
    keyframes: Mapping[str, KeyframeEntry] = dataclasses.field(default_factory=dict)
    sensors: Mapping[str, SensorEntry] = dataclasses.field(default_factory=dict)
    tendons: Indices = dataclasses.field(default_factory=dict)
    actuators: Annotated[tuple[ActuatorEntry, ...], MaxLen(MOST_THINGS)] = ()
    timestep: float | None = None
    effort_limits: Mapping[str, float] = dataclasses.field(default_factory=dict)
    velocity_limits: Mapping[str, float] = dataclasses.field(default_factory=dict)
    report: tuple[LineEntry, ...] = ()


def save_robot(robot: Imported, path: str | os.PathLike[str]) -> None:
    """Write a robot to a JSON file: its model, and all names, actuators, coordinates, keyframes and the report.

    What only shows is left out.

    Raises:
        ModelError: it would be larger than `load_robot` reads.
    """
    write_model(robot.builder, path, plain(_robot_entry(robot)))


def robot_text(robot: Imported) -> str:
    """The text of a file of `save_robot`."""
    return model_text(robot.builder, plain(_robot_entry(robot)))


def load_robot(path: str | os.PathLike[str]) -> Imported:
    """A robot of a file that `save_robot` wrote, in a builder of its own.

    All that is simulated is the same bit by bit; what only shows is not there: `add_visuals` adds nothing.

    Raises:
        ModelError: the file cannot be read, has a model but no robot, or breaks a rule: names file, key and rule.
    """
    builder, found, place = read_model(path)
    if found is None:
        raise place.error("missing: this file has a model alone; take load_model, or write it with save_robot")
    entry: RobotEntry = MODELS.load(
        RobotEntry, found, lambda fault: place.line(fault._replace(keys=(*place.keys, *fault.keys)))
    )
    return _Reader(builder, entry, place).robot()


# ---- to entries ------------------------------------------------------------------------------------------------------


def _robot_entry(robot: Imported) -> RobotEntry:
    coordinates = robot.coordinates
    return RobotEntry(
        source=robot.report.source,
        bodies=robot.bodies, dofs=robot.dofs, shapes=robot.shapes, tendons=robot.tendons,
        joints=tuple(
            CoordinateEntry(
                name=joint.name, kind=joint.kind.name.lower(), position=joint.position, rate=joint.rate, dof=joint.dof,
                offset=float(joint.offset), rotation=floats(joint.rotation),
            )
            for joint in coordinates.joints
        ),
        position_count=coordinates.position_count, rate_count=coordinates.rate_count,
        dof_count=coordinates.dof_count, initial=floats(coordinates.initial),
        frames={name: _place_entry(frame) for name, frame in robot.frames.items()},
        sites={name: _place_entry(frame) for name, frame in robot.sites.items()},
        cameras={
            name: CameraEntry(frame=_place_entry(camera.frame), field_of_view=float(camera.field_of_view))
            for name, camera in robot.cameras.items()
        },
        keyframes={
            name: KeyframeEntry(q=floats(key.q), qd=floats(key.qd), ctrl=floats(key.ctrl), time=float(key.time))
            for name, key in robot.keyframes.items()
        },
        sensors={
            name: SensorEntry(
                kind=sensor.kind, frame=None if sensor.frame is None else _place_entry(sensor.frame),
                joint=sensor.joint, noise=float(sensor.noise), cutoff=float(sensor.cutoff),
            )
            for name, sensor in robot.sensors.items()
        },
        actuators=tuple(_actuator_entry(spec) for spec in robot.actuators),
        timestep=None if robot.timestep is None else float(robot.timestep),
        effort_limits={name: float(limit) for name, limit in robot.effort_limits.items()},
        velocity_limits={name: float(limit) for name, limit in robot.velocity_limits.items()},
        report=tuple(
            LineEntry(fate=line.fate.value, element=line.element, name=line.name, reason=line.reason)
            for line in robot.report.lines
        ),
    )  # fmt: skip


def _place_entry(frame: NamedFrame) -> PlaceEntry:
    return _at(frame.body, frame.pose)


def _at(body: int, pose: Pose) -> PlaceEntry:
    return PlaceEntry(body=int(body), position=floats(pose.position), rotation=floats(pose.rotation))


def _actuator_entry(spec: ActuatorSpec) -> ActuatorEntry:
    values = {field.name: getattr(spec, field.name) for field in dataclasses.fields(ActuatorSpec)}
    values |= {name: sides(values[name]) for name in RANGES} | {name: values[name].name.lower() for name in SETS}
    values |= {name: floats(values[name]) for name in ("gain", "bias")}
    values |= {name: float(values[name]) for name in ("length_offset", "time_constant", "delay", "corner_speed")}
    values["terms"] = tuple((int(column), float(factor)) for column, factor in spec.terms)
    values["torque_speed"] = None if spec.torque_speed is None else floats(spec.torque_speed)
    pull = spec.site
    if pull is not None:
        reference = None if pull.reference is None else _at(pull.reference, pull.reference_pose)
        values["site"] = PullEntry(frame=_at(pull.body, pull.pose), gear=floats(pull.gear), reference=reference)
    return ActuatorEntry(**values)


# ---- from entries ----------------------------------------------------------------------------------------------------


class _Reader:
    """The robot of an entry.

    Args:
        builder: with its model.
        entry: its names.
        place: where the entry stands, for errors.
    """

    def __init__(self, builder: ModelBuilder, entry: RobotEntry, place: Place) -> None:
        self.builder, self.entry, self.place = builder, entry, place

    def robot(self) -> Imported:
        """The robot, each index held to be one of the model."""
        entry, builder = self.entry, self.builder
        bodies, columns, shapes = len(builder.bodies), builder.dof_count, len(builder.shapes)
        self._within(entry.bodies, bodies, "bodies")
        self._within(entry.dofs, columns, "dofs")
        self._within(entry.tendons, columns, "tendons")
        for name, indices in entry.shapes.items():
            self._within(dict(enumerate(indices)), shapes, "shapes", name)
        return Imported(
            builder=builder, bodies=dict(entry.bodies), dofs=dict(entry.dofs), shapes=dict(entry.shapes),
            coordinates=self._coordinates(), report=self._report(), tendons=dict(entry.tendons),
            frames={name: self._frame(part, "frames", name) for name, part in entry.frames.items()},
            sites={name: self._frame(part, "sites", name) for name, part in entry.sites.items()},
            cameras={
                name: CameraPlace(self._frame(part.frame, "cameras", name, "frame"), part.field_of_view)
                for name, part in entry.cameras.items()
            },
            keyframes={name: self._keyframe(part, name) for name, part in entry.keyframes.items()},
            sensors={name: self._sensor(part, name) for name, part in entry.sensors.items()},
            actuators=tuple(self._actuator(part, index) for index, part in enumerate(entry.actuators)),
            timestep=entry.timestep, effort_limits=dict(entry.effort_limits),
            velocity_limits=dict(entry.velocity_limits),
        )  # fmt: skip

    def _within(self, indices: Mapping[Any, int], count: int, *keys: str | int) -> None:
        for key, index in indices.items():
            if not 0 <= index < count:
                raise self.place.at(*keys, key).error(f"must be in 0..{count - 1}, got {index}; save the robot anew")

    def _want(self, found: int, wanted: int, *keys: str) -> None:
        if found != wanted:
            raise self.place.at(*keys).error(f"must have {wanted} numbers, got {found}; save the robot anew")

    def _pose(self, entry: PlaceEntry, *keys: str | int) -> Pose:
        """A pose as it is: to normalise its quaternion again would change the last bits."""
        rotation = np.array(entry.rotation, np.float64)
        if not abs(float(np.linalg.norm(rotation)) - 1.0) <= ROUNDING:
            place = self.place.at(*keys, "rotation")
            raise place.error(f"must be a unit quaternion (xyzw), got {formatted(rotation)}; divide by its length")
        if not WORLD <= entry.body < len(self.builder.bodies):
            most = len(self.builder.bodies) - 1
            raise self.place.at(*keys, "body").error(f"must be in -1..{most}, got {entry.body}; -1 is the world")
        return Pose(np.array(entry.position, np.float64), rotation)

    def _frame(self, entry: PlaceEntry, *keys: str | int) -> NamedFrame:
        return NamedFrame(entry.body, self._pose(entry, *keys))

    def _keyframe(self, entry: KeyframeEntry, name: str) -> Keyframe:
        for field, wanted in (("q", self.entry.dof_count), ("qd", self.entry.dof_count)):
            self._want(len(getattr(entry, field)), wanted, "keyframes", name, field)
        return Keyframe(q=np.array(entry.q), qd=np.array(entry.qd), ctrl=np.array(entry.ctrl), time=entry.time)

    def _sensor(self, entry: SensorEntry, name: str) -> SourceSensor:
        frame = None if entry.frame is None else self._frame(entry.frame, "sensors", name, "frame")
        return SourceSensor(kind=entry.kind, frame=frame, joint=entry.joint, noise=entry.noise, cutoff=entry.cutoff)

    def _actuator(self, entry: ActuatorEntry, index: int) -> ActuatorSpec:
        """Its numbers are checked when it is put into `Actuators`, against the finished model."""
        keys = ("actuators", index)
        values = {field.name: getattr(entry, field.name) for field in dataclasses.fields(entry)}
        values |= {name: limit_of(values[name]) for name in RANGES}
        values |= {name: kind[values[name].upper()] for name, kind in SETS.items()}
        if entry.site is not None:
            pull = {"body": entry.site.frame.body, "pose": self._pose(entry.site.frame, *keys, "site", "frame")}
            if (other := entry.site.reference) is not None:
                pull |= {"reference": other.body, "reference_pose": self._pose(other, *keys, "site", "reference")}
            values["site"] = SitePull(gear=entry.site.gear, **pull)  # type: ignore[arg-type]
        return ActuatorSpec(**values)

    def _coordinates(self) -> CoordinateMap:
        entry = self.entry
        self._want(len(entry.initial), entry.position_count, "initial")
        joints = []
        for index, part in enumerate(entry.joints):
            kind = CoordinateKind[part.kind.upper()]
            for field, count, total in (
                ("position", kind.positions, entry.position_count),
                ("rate", kind.rates, entry.rate_count),
                ("dof", kind.rates, min(entry.dof_count, self.builder.dof_count)),
            ):
                self._within({field: getattr(part, field)}, total - count + 1, "joints", index)
            joints.append(
                JointCoordinates(part.name, kind, part.position, part.rate, part.dof, part.offset, part.rotation)
            )
        return CoordinateMap(
            tuple(joints), entry.position_count, entry.rate_count, entry.dof_count, np.array(entry.initial)
        )

    def _report(self) -> ImportReport:
        report = ImportReport(self.entry.source, {})
        report.lines += [
            ReportLine(Fate(line.fate), line.element, line.name, line.reason) for line in self.entry.report
        ]
        return report
