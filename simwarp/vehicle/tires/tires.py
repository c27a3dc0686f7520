"""The tires of a vehicle: the arrays that the tire kernel works on, and its launch.

    vector = tire_vector(axle.tire)                          # checked parameters; SpecError names the key
    tires = Tires([Mount(vector, body, (0.0, offset, 0.0), "left"), ...], world_count, body_count, device)
    tires.apply(dt, state.arrays, model.assets)           # before each step: fills tires.force, tires.torque

What it holds may be read and written between steps: `parameter` (1 or W, wheels, P), `ground_friction` (1 or W,),
`terrain`. `state` (W, wheels, S) belongs into snapshots; `reset(mask)` zeroes it for worlds that start anew. The
reports are (W, wheels): `load`, `slip_ratio`, `slip_angle`, `camber`, `deflection`, `force_w`, `torque_w`
(tires_kernels.py has units and signs). `force` and `torque` are (W, B), world axes, at the centre of
mass.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import warp as wp

from simwarp.core.array_devices import refuse_arguments_elsewhere, refuse_elsewhere
from simwarp.core.arrays import WritableArray, writable, writable_from
from simwarp.core.object_repr import Readable, plural
from simwarp.core.rotation import matrix_of
from simwarp.core.types import ShapeType
from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange
from simwarp.model.model import Model
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.vehicle.tires.ground_kernels import TerrainTables
from simwarp.vehicle.tires.parameter_vector import ParameterVector, tire_vector
from simwarp.vehicle.tires.parameter_vector_kernels import TireContact
from simwarp.vehicle.tires.tire_obstacles import TireObstacles, make_envelopes, shape_on_world
from simwarp.vehicle.tires.tire_obstacles_kernels import find_envelopes
from simwarp.vehicle.tires.tires_kernels import TireReports, TireTables, apply_tires, reset_tires
from simwarp.vehicle.tires.wheel_reports import REPORTED

__all__ = ["Mount", "ParameterVector", "Tires", "ground", "ground_of", "tire_vector"]


class Mount(NamedTuple):
    """A tire on its spindle, whose own y axis is the wheel's.

    Attributes:
        vector: of `tire_vector`.
        body: the spindle.
        offset: of the wheel's centre from the body's centre of mass, body axes [m].
        side: of the vehicle; matters to asymmetric tires only.
    """

    vector: ParameterVector
    body: int
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    side: Literal["left", "right"] = "left"


def ground_rows(terrain: TerrainTables) -> dict[str, wp.array]:
    """The arrays of a ground that may differ by world, (1 or W, ...), by name."""
    tables: Any = terrain
    return {f"ground_{name}": getattr(tables, name) for name in ("x", "rot", "scale", "asset")}


def ground(
    device: wp.DeviceLike = None,
    *,
    kind: ShapeType = ShapeType.PLANE,
    asset: int | Sequence[int] = 0,
    x: object = (0.0, 0.0, 0.0),
    rotation: object = (0.0, 0.0, 0.0, 1.0),
    scale: object = (1.0, 1.0, 1.0),
    friction_map: object = None,
    friction_origin: tuple[float, float] = (0.0, 0.0),
    friction_cell: tuple[float, float] = (1.0, 1.0),
) -> TerrainTables:
    """Terrain for tires: a plane, or a height field or mesh of the model's assets.

    Args:
        device: of the arrays.
        kind: PLANE, HEIGHT_FIELD or MESH.
        asset: index among the model's height fields or meshes; one, or one for each world.
        x: origin [m], (3,) or (W, 3).
        rotation: quaternion xyzw, (4,) or (W, 4); height fields may turn about the vertical only.
        scale: (3,) or (W, 3) factors of the asset along its axes.
        friction_map: (rows along y, columns along x) factors of the friction; None: 1 everywhere.
        friction_origin: corner of its first cell [m].
        friction_cell: size of its cells [m].

    Raises:
        SpecError: `kind` is none of the three, or a height field is not upright.
    """
    if kind not in (ShapeType.PLANE, ShapeType.HEIGHT_FIELD, ShapeType.MESH):
        raise SpecError(f"terrain: must be a plane, a height field or a mesh, got {kind!r}")
    quaternions = np.atleast_2d(np.asarray(rotation, dtype=float))
    table: Any = TerrainTables()
    table.kind = int(kind)
    table.x = wp.array(np.atleast_2d(np.asarray(x, dtype=float)), dtype=wp.vec3d, device=device)
    axes = np.stack([matrix_of(q / np.linalg.norm(q)) for q in quaternions])
    if kind == ShapeType.HEIGHT_FIELD and np.any(np.abs(axes[:, 2, 2] - 1.0) > 1.0e-6):
        raise SpecError(f"terrain: a height field must turn about the vertical only, got the rotation {rotation!r}")
    table.rot = wp.array(axes, dtype=wp.mat33, device=device)
    table.scale = wp.array(np.atleast_2d(np.asarray(scale, dtype=float)), dtype=wp.vec3, device=device)
    table.asset = wp.array(np.atleast_1d(np.asarray(asset)), dtype=int, device=device)
    factors = np.zeros((0, 0)) if friction_map is None else np.asarray(friction_map, dtype=float)
    table.friction_map = wp.array(factors, dtype=float, ndim=2, device=device)
    table.friction_origin = wp.vec2d(*friction_origin)
    table.friction_cell = wp.vec2d(*friction_cell)
    terrain: TerrainTables = table
    return terrain


def ground_of(
    model: Model,
    shape: int | str,
    *,
    friction_map: object = None,
    friction_origin: tuple[float, float] = (0.0, 0.0),
    friction_cell: tuple[float, float] = (1.0, 1.0),
) -> TerrainTables:
    """Terrain for tires that is a shape of the model: the plane, height field or mesh that bodies and sensors meet.

    It reads the model's own arrays. What is written to `shape_asset`, `shape_size` and `shape_x` of the shape, in every
    world and at any time, counts for tires from the next step on: another height field in each episode, say, with
    ``finalize(..., per_world=["shape_asset"])``. How the shape is turned counts as it is now.

    Args:
        model: finished.
        shape: index or name of a shape on WORLD.
        friction_map, friction_origin, friction_cell: as of `ground`.

    Raises:
        SpecError: there is no such shape, it is none of the three or on a body, or a height field is not upright.
    """
    index = shape_on_world(model, shape)
    table: Any = ground(
        model.device, kind=model.shape_types[index], rotation=model.shape_rot.numpy()[:, index],
        friction_map=friction_map, friction_origin=friction_origin, friction_cell=friction_cell,
    )  # fmt: skip
    table.x, table.asset = model.shape_x[:, index], model.shape_asset[:, index]
    if table.kind != ShapeType.PLANE:  # which has no factors
        table.scale = model.shape_size[:, index]
    terrain: TerrainTables = table
    return terrain


class Tires(Readable):
    """All force-element tires of a model: at most one on a body.

    Args:
        mounts: the tires, in the order of the reports.
        world_count: number of worlds W.
        body_count: number of bodies B.
        device: of the arrays.
        friction: coefficient of the road, for all worlds until `ground_friction` is written.
        terrain: of `ground`; None: the plane z = 0.
        obstacles: static shapes that the tires meet beside it; None: none is searched for, and nothing is spent on it.
        randomised: True if every world has vectors of its own in `parameter` and an entry in `ground_friction`.

    Raises:
        SpecError: two tires are on one body, or there is no such body.
    """

    def __init__(
        self,
        mounts: Sequence[Mount],
        world_count: int,
        body_count: int,
        device: wp.DeviceLike = None,
        *,
        friction: float = 0.9,
        terrain: TerrainTables | None = None,
        obstacles: TireObstacles | None = None,
        randomised: bool = False,
    ) -> None:
        bodies = [mount.body for mount in mounts]
        if len(set(bodies)) < len(bodies) or not all(0 <= body < body_count for body in bodies):
            raise SpecError(f"tires: must stand on different bodies below {body_count}, got {bodies}")
        self.mounts = tuple(mounts)
        self.device = wp.get_device(device)
        self.shape = (world_count, len(mounts))
        vectors = np.zeros((world_count if randomised else 1, len(mounts), max(len(m.vector.values) for m in mounts)))
        for wheel, mount in enumerate(mounts):
            vectors[:, wheel, : len(mount.vector.values)] = mount.vector.values
        self.parameter = writable_from(vectors, wp.float32, self.device)
        self.ground_friction = writable_from(np.full(len(vectors), friction), wp.float32, self.device)
        self.terrain = ground(self.device) if terrain is None else terrain
        self.obstacles = obstacles
        self.tables = self._make_tables()
        self.envelopes = make_envelopes((0, 0) if obstacles is None else self.shape, self.device)
        self.obstacle_tables = None if obstacles is None else obstacles.tables(len(mounts))
        self.state = writable((*self.shape, max(m.vector.state_size for m in mounts)), wp.float32, self.device)
        self.load = self._report(wp.float32)
        self.slip_ratio = self._report(wp.float32)
        self.slip_angle = self._report(wp.float32)
        self.camber = self._report(wp.float32)
        self.deflection = self._report(wp.float32)
        self.force_w = self._report(wp.vec3)
        self.torque_w = self._report(wp.vec3)
        self.reports = self._make_reports()
        self.force = writable((world_count, body_count), wp.vec3, self.device)
        self.torque = writable((world_count, body_count), wp.vec3, self.device)

    def _readable_title(self) -> str:
        return f": {self.shape[1]} in each of {plural(self.shape[0], 'world')} on {self.device}"

    def _report(self, dtype: type) -> WritableArray:
        return writable(self.shape, dtype, self.device)

    @property
    def world_parameters(self) -> dict[str, wp.array]:
        """What may differ by world, (1 or W, ...): numbers of the tires and of the ground."""
        own = {"tire_parameter": self.parameter, "ground_friction": self.ground_friction}
        return own | ground_rows(self.terrain)

    def of(self, first: int, count: int) -> Tires:
        """`count` wheels of these from number `first` on: views of the same memory."""
        part, wheels = copy.copy(self), slice(first, first + count)
        part.mounts, part.shape = self.mounts[wheels], (self.shape[0], count)
        for name in ("parameter", "state", *REPORTED):
            setattr(part, name, getattr(self, name)[:, wheels])
        part.tables, part.reports = part._make_tables(), part._make_reports()
        return part

    def _make_reports(self) -> TireReports:
        reports = TireReports()
        for name in REPORTED:
            setattr(reports, name, getattr(self, name))
        return reports

    def _make_tables(self) -> TireTables:
        mounts = self.mounts
        tables = TireTables()
        tables.body = wp.array([m.body for m in mounts], dtype=int, device=self.device)
        tables.model = wp.array([int(m.vector.model) for m in mounts], dtype=int, device=self.device)
        contacts = [m.vector.contact if self.obstacles is None else TireContact.SHAPES for m in mounts]
        tables.contact = wp.array([int(contact) for contact in contacts], dtype=int, device=self.device)
        mirrored = [int(m.vector.measured_side not in (None, m.side)) for m in mounts]
        tables.mirrored = wp.array(mirrored, dtype=int, device=self.device)
        tables.offset_b = wp.array(np.array([m.offset for m in mounts]), dtype=wp.vec3, device=self.device)
        return tables

    def inputs(self, dt: float, state: StateArrays, assets: Assets) -> list[Any]:
        """Arguments of `apply_tires` between the worlds and its outputs, for a step of `dt` [s]."""
        return [
            dt, self.tables, self.parameter, self.ground_friction, self.terrain, self.envelopes, assets, state,
            self.state, self.reports,
        ]  # fmt: skip

    def envelope_inputs(self, state: StateArrays) -> list[Any]:
        """Arguments of `find_envelopes` after the worlds; only where there are obstacles."""
        assert self.obstacles is not None
        model = self.obstacles.model
        return [
            self.tables, self.parameter, self.terrain, self.obstacle_tables, model.parameters, model.assets, state,
            self.envelopes,
        ]  # fmt: skip

    def apply(
        self,
        dt: float,
        state: StateArrays,
        assets: Assets | None = None,
        *,
        force: wp.array | None = None,
        torque: wp.array | None = None,
    ) -> None:
        """Find all forces for a step of `dt` [s]; may be captured in a graph.

        Args:
            dt: the step [s].
            state: of the bodies (`State.arrays`).
            assets: of the model; None on a plane.
            force: (W, B) vec3 that receives the forces instead of `self.force`; entries of other bodies stay.
            torque: the same for the torques.

        Raises:
            ModelError: an array lies on another device than the tires.
        """
        inputs = [WorldRange(), *self.inputs(dt, state, Assets() if assets is None else assets)]
        outputs = [self.force if force is None else force, self.torque if torque is None else torque]
        refuse_arguments_elsewhere(apply_tires, [*inputs, *outputs], self.device)
        if self.obstacles is not None:
            around = [WorldRange(), *self.envelope_inputs(state)]
            wp.launch(find_envelopes, self.shape, inputs=around, device=self.device)
        wp.launch(apply_tires, self.shape, inputs=inputs, outputs=outputs, device=self.device)

    def reset(self, world_mask: wp.array) -> None:
        """Zero the state of the worlds in a (W,) bool mask on the tires' device.

        Raises:
            ModelError: it lies on another one.
        """
        refuse_elsewhere("Tires.reset: world_mask must", world_mask, self.device)
        wp.launch(reset_tires, self.shape, inputs=[world_mask, self.state], device=self.device)
