"""What every reader of robots returns: the builder, indices by the names of the file, coordinates and a report."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import Names, Readable, ReadableFields, Row
from simwarp.core.rotation import quat_conjugate, quat_multiply, rotate
from simwarp.core.types import WORLD, Drive, ModelError, Pose, ShapeType, formatted, pose as make_pose
from simwarp.core.wording import suggestion
from simwarp.importers.coordinates import CoordinateMap
from simwarp.importers.report import Fate, ImportReport
from simwarp.model.builder import ModelBuilder
from simwarp.model.specifications import ShapeSpec

if TYPE_CHECKING:
    from simwarp.actuators import ActuatorSpec
    from simwarp.sensors.scene import Visuals
    from simwarp.simulation.state import State

Array = npt.NDArray[np.float64]

DOWN = np.array([0.0, 0.0, -1.0])


def lowest_point(builder: ModelBuilder, bodies: Iterable[int], places: npt.ArrayLike) -> float:
    """Height of the lowest point of the shapes on bodies; where they have none, of their centres of mass [m].

    Args:
        builder: that has the bodies.
        bodies: indices of those that count.
        places: (B, 7) positions and quaternions xyzw of all bodies, as a world of `State.body_q`.
    """
    poses = np.asarray(places, np.float64)
    counted = set(bodies) - {WORLD}
    heights = [_lowest(builder, shape, poses[shape.body]) for shape in builder.shapes if shape.body in counted]
    return min(heights or [float(poses[body, 2]) for body in counted])


def _lowest(builder: ModelBuilder, shape: ShapeSpec, place: Array) -> float:
    rotation = quat_multiply(place[3:], shape.pose.rotation)
    middle = place[:3] + rotate(place[3:], shape.pose.position)
    return float(middle[2]) - _reach(builder, shape, rotate(quat_conjugate(rotation), DOWN))


def _reach(builder: ModelBuilder, shape: ShapeSpec, way: Array) -> float:
    """How far a shape reaches from its origin along a unit vector in its axes [m]."""
    size, across, along = shape.size, math.hypot(way[0], way[1]), abs(float(way[2]))
    match shape.type:
        case ShapeType.SPHERE:
            return float(size[0])
        case ShapeType.CAPSULE:
            return float(size[0] + size[1] * along)
        case ShapeType.CYLINDER:
            return float(size[0] * across + size[1] * along)
        case ShapeType.CONE:
            return float(max(size[1] * way[2], size[0] * across - size[1] * way[2]))
        case ShapeType.BOX:
            return float(np.abs(size * way).sum())
        case ShapeType.ELLIPSOID:
            return float(np.linalg.norm(size * way))
        case ShapeType.HULL:
            return float((builder.hulls[shape.asset].vertices * size @ way).max())
        case ShapeType.MESH:
            return float((builder.meshes[shape.asset].vertices * size @ way).max())
    return 0.0


@dataclasses.dataclass(frozen=True)
class NamedFrame:
    """A frame of the file that is no body of ours: a site, or a body without joints, which is part of its parent.

    Attributes:
        body: that it is fixed to; `WORLD` where nothing moves it.
        pose: from the body's centre of mass, in body axes [m]; world axes for `WORLD`.
    """

    body: int = WORLD
    pose: Pose = dataclasses.field(default_factory=make_pose)


@dataclasses.dataclass(frozen=True)
class CameraPlace:
    """A camera of the file: looks along -z of its frame, y up, as in its source.

    Attributes:
        frame: where it is.
        field_of_view: vertical [rad].
    """

    frame: NamedFrame
    field_of_view: float


@dataclasses.dataclass(frozen=True)
class Keyframe(ReadableFields):
    """A stored state.

    Attributes:
        q: (dofs,) coordinates, as `State.joint_q`.
        qd: (dofs,) rates.
        ctrl: (actuators,) controls.
        time: [s].
    """

    q: Array
    qd: Array
    ctrl: Array
    time: float = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class SourceSensor:
    """A sensor of the file, by kind and place; those of `simwarp.sensors` are mounted there.

    Attributes:
        kind: in the words of the file's format, such as "gyro".
        frame: where it is; None for that of a joint.
        joint: that it measures; empty for that of a frame.
        noise: standard deviation, in the unit of what is measured.
        cutoff: bound of what is measured; 0 for none.
    """

    kind: str
    frame: NamedFrame | None = None
    joint: str = ""
    noise: float = 0.0
    cutoff: float = 0.0


@dataclasses.dataclass(repr=False)
class Imported(Readable):
    """A robot, or a scene, of a file.

    Poses, centres and axes are those of the file; bodies have its axes, with the origin in the centre of mass. The
    builder stands in the file's initial position. Names are those of the file behind the `prefix`.

    Attributes:
        builder: to go on with: add ground, then `finalize`.
        bodies: name -> body index. Bodies without joints are parts of their parents: see `frames`.
        dofs: name of a joint -> its first column of `State.joint_q`.
        shapes: name -> shape indices; a mesh that was decomposed has several.
        frames: name -> frame of a body that is a part of another one; the file's own frame of every body, where it
            has one.
        sites: name -> frame.
        cameras: name -> place.
        keyframes: name -> state.
        sensors: name -> kind and place.
        tendons: name -> column of its coordinate, where it has a law of its own.
        timestep: of the file [s]; None where it tells none.
        actuators: in the order of the file, for `simwarp.actuators.Actuators`.
        effort_limits: name of a joint -> largest effort of what drives it, where the file tells [N or N·m].
        velocity_limits: name of a joint -> highest speed of what drives it, where the file tells [m/s or rad/s].
        coordinates: of the file's joints.
        report: what became of every element.
    """

    builder: ModelBuilder
    bodies: Mapping[str, int]
    dofs: Mapping[str, int]
    shapes: Mapping[str, tuple[int, ...]]
    coordinates: CoordinateMap
    report: ImportReport
    frames: Mapping[str, NamedFrame] = dataclasses.field(default_factory=dict)
    sites: Mapping[str, NamedFrame] = dataclasses.field(default_factory=dict)
    cameras: Mapping[str, CameraPlace] = dataclasses.field(default_factory=dict)
    keyframes: Mapping[str, Keyframe] = dataclasses.field(default_factory=dict)
    sensors: Mapping[str, SourceSensor] = dataclasses.field(default_factory=dict)
    tendons: Mapping[str, int] = dataclasses.field(default_factory=dict)
    actuators: tuple[ActuatorSpec, ...] = ()
    timestep: float | None = None
    effort_limits: Mapping[str, float] = dataclasses.field(default_factory=dict)
    velocity_limits: Mapping[str, float] = dataclasses.field(default_factory=dict)
    show: Callable[[Visuals], None] | None = None
    """Adds what only shows; `add_visuals` calls it."""

    def _readable_title(self) -> str:
        return f" '{self.report.source}'"

    def _readable_rows(self) -> dict[str, Row]:
        named = ("bodies", "dofs", "shapes", "sites", "cameras", "keyframes", "sensors", "tendons")
        counts = ", ".join(f"{len(self.report.of(fate))} {fate.value}" for fate in Fate)
        return {
            **{name: Names(len(getattr(self, name)), getattr(self, name)) for name in named},
            "actuators": Names(len(self.actuators), (spec.name for spec in self.actuators)),
            "report": f"{counts}; print(report) lists them",
        }

    @property
    def mass(self) -> float:
        """Total mass of the bodies [kg]."""
        return float(sum(self.builder.bodies[body].mass for body in set(self.bodies.values())))

    def q_from(self, qpos: npt.ArrayLike) -> Array:
        """(..., dofs) coordinates, as `State.joint_q`, at positions (..., nq) in the file's order and form.

        Quaternions of the file are wxyz; ours are rotation vectors [rad].
        """
        return self.coordinates.q_from(qpos)

    def qpos_from(self, q: npt.ArrayLike) -> Array:
        """(..., nq) positions in the file's order and form at coordinates (..., dofs)."""
        return self.coordinates.positions_from(q)

    def qd_from(self, qvel: npt.ArrayLike, qpos: npt.ArrayLike | None = None) -> Array:
        """(..., dofs) rates, as `State.joint_qd`, of rates (..., nv) in the file's order and axes.

        Args:
            qvel: of the file. The angular velocity of a floating body or a ball is in the axes of the body.
            qpos: (..., nq) where the joints are; as built when None. Only balls and floating bodies need it.
        """
        return self.coordinates.qd_from(qvel, qpos)

    def qvel_from(self, qd: npt.ArrayLike, qpos: npt.ArrayLike | None = None) -> Array:
        """(..., nv) rates in the file's order and axes of our rates (..., dofs); `qpos` as in `qd_from`."""
        return self.coordinates.rates_from(qd, qpos)

    def set_drive(self, joint: str, drive: Drive | None) -> None:
        """Gives a hinge, a slide or a tendon another drive, or none.

        Actuators that push the same coordinate are left alone: leave those out of what you pass to `Actuators`.

        Args:
            joint: its name in `dofs` or `tendons`.
            drive: in the place of the one it has.

        Raises:
            ModelError: there is none of this name, it has several coordinates, or the drive is not usable.
        """
        columns = {**self.tendons, **self.dofs}
        if joint not in columns:
            hint = suggestion(joint, columns, f"known: {', '.join(list(columns)[:12])}")
            raise ModelError(f"{self.report.source}: no joint or tendon {formatted(joint)}; {hint}")
        index, local = self.builder.coordinate_of(columns[joint])
        count = len(self.builder.joints[index].dofs)
        if count > 1:
            raise ModelError(
                f"{self.report.source}: joint '{joint}' has {count} coordinates; use builder.set_drive for one of them"
            )
        self.builder.set_drive(index, drive, dof=local)

    def frame(self, name: str) -> NamedFrame:
        """A site, a body, or a body that is part of another one: what a sensor is mounted on.

        Raises:
            ModelError: there is none of this name.
        """
        if name in self.sites:
            return self.sites[name]
        if name in self.frames:
            return self.frames[name]
        if name in self.bodies:
            return NamedFrame(self.bodies[name])
        known = [*self.sites, *self.frames, *self.bodies]
        raise ModelError(f"{self.report.source}: no frame '{name}'; known: {', '.join(known[:12])}")

    def lowest_point(self, state: State, world: int = 0) -> float:
        """Height of the lowest point of the robot's shapes in one world [m], to put it on the ground.

        Args:
            state: of a model that the builder made.
            world: its index.
        """
        return lowest_point(self.builder, self.bodies.values(), state.body_q.numpy()[world])

    def add_visuals(self, visuals: Visuals) -> None:
        """Add what the file shows, and only shows: its visual meshes are read here for the first time."""
        if self.show is not None:
            self.show(visuals)
