"""Model: everything that is constant during a run. Parameters may differ per world; the topology may not."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.arrays import writable_from
from simwarp.dynamics.topology import (
    Tables,
    build_tables,
    collect_tables,
    dof_joints,
    drive_mode,
    longest_path,
    row_paths,
)
from simwarp.elements import ELEMENTS
from simwarp.geometry import add_ground_assets, hull_assets
from simwarp.kernels.tables import Parameters, Topology
from simwarp.rotation import matrix_of
from simwarp.shapes import ShapeSpec, contact_limit, shape_pairs
from simwarp.types import WORLD, JointType, ModelError, PositionDrive, VelocityMotor

if TYPE_CHECKING:
    from simwarp.builder import ModelBuilder

CONTACTS_PER_BODY = 12
"""Default contact slots per body: a brick in a wall has eight to twelve."""

LISTED_PAIRS = 2000
"""Pairs of shapes up to which every step goes through a list of them; above, a grid finds the near ones."""

INFINITE = 1.0e30
"""Stands for "no limit" in float32 parameters."""


@dataclasses.dataclass(frozen=True)
class Parameter:
    """Dtype and meaning of a per-world parameter; its shape is (1 or W, n)."""

    dtype: Any
    text: str


PARAMETERS: dict[str, Parameter] = {
    "gravity": Parameter(wp.vec3, "(1 or W,) acceleration [m/s²], world frame"),
    "body_mass": Parameter(wp.float32, "(1 or W, B) [kg]"),
    "body_inertia_b": Parameter(wp.mat33, "(1 or W, B) about the centre of mass, body frame [kg·m²]"),
    "joint_anchor0": Parameter(wp.vec3d, "(1 or W, J) origin of frame 0 from the first body's centre, its frame [m]"),
    "joint_anchor1": Parameter(wp.vec3d, "(1 or W, J) origin of frame 1 from the second body's centre, its frame [m]"),
    "joint_frame0": Parameter(wp.mat33d, "(1 or W, J) axes of frame 0 in the first body"),
    "joint_frame1": Parameter(wp.mat33d, "(1 or W, J) axes of frame 1 in the second body"),
    "joint_offset": Parameter(wp.float64, "(1 or W, J) length of a rod [m]"),
    "joint_armature": Parameter(wp.float32, "(1 or W, dofs) [kg or kg·m²]"),
    "joint_stiffness": Parameter(wp.float32, "(1 or W, dofs) [N/m or N·m/rad]"),
    "joint_rest": Parameter(wp.float32, "(1 or W, dofs) [m or rad]"),
    "joint_damping": Parameter(wp.float32, "(1 or W, dofs) [N·s/m or N·m·s/rad]"),
    "joint_preload": Parameter(wp.float32, "(1 or W, dofs) [N or N·m]"),
    "joint_friction": Parameter(wp.float32, "(1 or W, dofs) dry friction [N or N·m]"),
    "joint_limit_lower": Parameter(wp.float32, "(1 or W, dofs) [m or rad]"),
    "joint_limit_upper": Parameter(wp.float32, "(1 or W, dofs) [m or rad]"),
    "drive_stiffness": Parameter(wp.float32, "(1 or W, dofs) [N/m or N·m/rad]"),
    "drive_damping": Parameter(wp.float32, "(1 or W, dofs) [N·s/m or N·m·s/rad]"),
    "drive_effort_limit": Parameter(wp.float32, "(1 or W, dofs) [N or N·m]"),
    "coupling_coefficient": Parameter(wp.float32, "(1 or W, couplings, terms)"),
    "coupling_offset": Parameter(wp.float64, "(1 or W, couplings)"),
    "coupling_damping": Parameter(wp.float32, "(1 or W, couplings) of a viscous coupling, 0: rigid [N·m·s/rad]"),
    "shape_x": Parameter(wp.vec3d, "(1 or W, S) origin from the body's centre of mass, body axes [m]"),
    "shape_rot": Parameter(wp.quat, "(1 or W, S) xyzw, shape axes to body axes"),
    "shape_size": Parameter(wp.vec3, "(1 or W, S) meaning by `ShapeType` [m]"),
    "shape_margin": Parameter(wp.float32, "(1 or W, S) thickness added to the surface [m]"),
    "shape_asset": Parameter(wp.int32, "(1 or W, S) asset that a hull, height field or mesh shows"),
    "shape_enabled": Parameter(wp.int32, "(1 or W, S) 0 takes the shape out"),
    "shape_friction": Parameter(wp.float32, "(1 or W, S)"),
    "shape_rolling_friction": Parameter(wp.float32, "(1 or W, S) [m]"),
    "shape_spinning_friction": Parameter(wp.float32, "(1 or W, S) [m]"),
    "shape_restitution": Parameter(wp.float32, "(1 or W, S)"),
    "shape_cohesion": Parameter(wp.float32, "(1 or W, S) [N]"),
    "shape_compliance": Parameter(wp.float32, "(1 or W, S) [m/N]"),
    "shape_damping": Parameter(wp.float32, "(1 or W, S) relaxation time of the compliance [s]"),
    "shape_young_modulus": Parameter(wp.float32, "(1 or W, S) of the smooth contact model [Pa]"),
    "shape_poisson_ratio": Parameter(wp.float32, "(1 or W, S) of the smooth contact model"),
}


class Model:
    """Constant data of `world_count` worlds on one device. Made by `ModelBuilder.finalize`.

    Every parameter of `PARAMETERS` is an attribute: an array of leading dimension 1 (shared by all worlds) or W
    (named in `finalize(per_world=...)`), read by the kernels as `array[world % array.shape[0]]`. Write into it
    between steps, never replace it.

    Attributes:
        world_count, body_count, joint_count, dof_count, shape_count: sizes of the arrays.
        body_names, joint_names, shape_names: in index order.
        contact_capacity: contact slots of every world.
        has_rolling_friction: whether contacts carry rolling and spinning friction.
        path_length: most slots between a link and the root of its tree.
        turn_count: terms of couplings that are rotations between two bodies.
        has_loops: whether joints close loops: rows that no compliance softens.
        mass_ratio: of the heaviest body to the lightest, as built.
        joint_dof_start: first coordinate of each joint, plus the total at the end.
    """

    gravity: wp.array
    body_mass: wp.array
    body_inertia_b: wp.array
    joint_stiffness: wp.array
    joint_damping: wp.array
    joint_friction: wp.array
    joint_armature: wp.array
    coupling_coefficient: wp.array
    coupling_offset: wp.array
    coupling_damping: wp.array
    drive_stiffness: wp.array
    drive_damping: wp.array
    shape_x: wp.array
    shape_rot: wp.array
    shape_size: wp.array
    shape_margin: wp.array
    shape_asset: wp.array
    shape_enabled: wp.array
    shape_friction: wp.array
    shape_rolling_friction: wp.array
    shape_spinning_friction: wp.array
    shape_restitution: wp.array
    shape_cohesion: wp.array
    shape_compliance: wp.array
    shape_damping: wp.array
    shape_young_modulus: wp.array
    shape_poisson_ratio: wp.array

    def __init__(
        self, world_count: int, device: Any, builder: ModelBuilder, tables: Tables, contact_capacity: int | None = None
    ) -> None:
        self.world_count = world_count
        self.device = device
        self.body_count = len(builder.bodies)
        self.joint_count = len(builder.joints)
        self.dof_count = builder.dof_count
        self.body_names = tuple(body.name for body in builder.bodies)
        self.joint_names = tuple(joint.name for joint in builder.joints)
        self.joint_dof_start = tuple(builder.dof_start(joint) for joint in range(self.joint_count + 1))
        self.bounded_count = len(tables.bounded)
        masses = [body.mass for body in builder.bodies] or [1.0]
        self.mass_ratio = max(masses) / min(masses)
        self.has_loops = any(dof < 0 for dof in tables.row_dof)
        self.shape_count = len(builder.shapes)
        self.shape_names = tuple(shape.name for shape in builder.shapes)
        self.has_rolling_friction = any(
            shape.material.rolling_friction > 0.0 or shape.material.spinning_friction > 0.0 for shape in builder.shapes
        )
        self.contact_capacity = default_capacity(builder) if contact_capacity is None else contact_capacity
        self.path_length = longest_path(tables)
        self.turn_count = len(turn_terms(builder))
        self.tables = tables
        self.initial = _initial_state(builder)
        self.topology = _device_topology(builder, tables, device)
        self.parameters = Parameters()
        self.assets = hull_assets(builder.hulls, device)
        # the assets hold their ids only
        self.meshes = add_ground_assets(self.assets, builder.height_fields, builder.meshes, device)

    @classmethod
    def from_builder(
        cls, builder: ModelBuilder, world_count: int, device: str | None, *, per_world: Iterable[str] = (),
        contact_capacity: int | None = None,
    ) -> Model:  # fmt: skip
        """See `ModelBuilder.finalize`."""
        if not isinstance(world_count, (int, np.integer)) or isinstance(world_count, bool) or world_count < 1:
            raise ModelError(f"finalize: world_count must be an integer >= 1, got {world_count!r}")
        if not builder.bodies and not builder.joints:
            raise ModelError("finalize: the builder has no body; call add_body first")
        model = cls(int(world_count), resolve_device(device), builder, build_tables(builder), contact_capacity)
        wanted = set(per_world)
        for name in wanted - PARAMETERS.keys():
            near = difflib.get_close_matches(name, PARAMETERS, n=1)
            raise ModelError(
                f"finalize: per_world names an unknown parameter '{name}'"
                + (f"; did you mean '{near[0]}'?" if near else f"; known: {', '.join(PARAMETERS)}")
            )
        for name, values in _parameter_values(builder).items():
            copies = model.world_count if name in wanted else 1
            data = np.repeat(values[None], copies, axis=0)
            array = writable_from(data, PARAMETERS[name].dtype, model.device)
            setattr(model, name, array)
            setattr(model.parameters, name, array)
        return model

    def body(self, name: str) -> int:
        """Index of a body by name."""
        return _index(name, self.body_names, "body")

    def joint(self, name: str) -> int:
        """Index of a joint by name."""
        return _index(name, self.joint_names, "joint")

    def dof(self, joint: str, local: int = 0) -> int:
        """Column of `joint_q` of a joint's coordinate."""
        return self.joint_dof_start[self.joint(joint)] + local


def resolve_device(device: str | None) -> Any:
    """The Warp device of a name; the preferred one when None.

    Raises:
        ModelError: there is no such device; lists those there are.
    """
    try:
        return wp.get_device(device)
    except Exception as error:  # warp raises several kinds for unknown names and absent drivers
        known = ", ".join(str(each) for each in wp.get_devices())
        raise ModelError(f"device '{device}' is not available; use one of: {known}") from error


def _index(name: str, names: tuple[str, ...], kind: str) -> int:
    if name not in names:
        near = difflib.get_close_matches(name, names, n=3) or list(names)
        raise ModelError(f"model has no {kind} '{name}'; did you mean {', '.join(map(repr, near))}?")
    return names.index(name)


def _initial_state(builder: ModelBuilder) -> dict[str, npt.NDArray[Any]]:
    """Poses and velocities of one world as built; coordinates are measured on the device."""
    bodies = builder.bodies
    joint_x, joint_qd = [], []
    for joint in builder.joints:
        count = len(ELEMENTS[joint.type].dofs)
        joint_x += [joint.initial_q] * count
        joint_qd += [joint.initial_qd] * count
    return {
        "body_x": np.array([body.pose.position for body in bodies], np.float64).reshape(-1, 3),
        "body_rot": np.array([body.pose.rotation for body in bodies], np.float64).reshape(-1, 4),
        "body_v": np.array([body.velocity for body in bodies], np.float32).reshape(-1, 3),
        "body_omega": np.array([body.omega for body in bodies], np.float32).reshape(-1, 3),
        "body_omega_last": np.array([body.omega for body in bodies], np.float32).reshape(-1, 3),
        "joint_x": np.array(joint_x, np.float64),
        "joint_qd": np.array(joint_qd, np.float32),
    }


def _parameter_values(builder: ModelBuilder) -> dict[str, npt.NDArray[Any]]:
    """One world's parameters, in the order of `PARAMETERS`."""
    joints, dofs = builder.joints, [dof for joint in builder.joints for dof in joint.dofs]
    drives = [dof.drive for dof in dofs]
    pd = [drive if isinstance(drive, PositionDrive) else PositionDrive(stiffness=0.0) for drive in drives]
    efforts = [drive.effort_limit if isinstance(drive, PositionDrive | VelocityMotor) else INFINITE for drive in drives]
    limits = [dof.limit if dof.limit is not None else (-INFINITE, INFINITE) for dof in dofs]
    coefficients = np.zeros((len(builder.couplings), coupling_width(builder)))
    for row, coupling in enumerate(builder.couplings):
        coefficients[row, : len(coupling.terms)] = [value for _, value in coupling.terms]
    initial = _initial_coordinates(builder)
    offsets = [
        sum(value * initial[dof] for dof, value in coupling.terms) if coupling.offset is None else coupling.offset
        for coupling in builder.couplings
    ]
    return {
        "gravity": builder.gravity,
        "body_mass": np.array([body.mass for body in builder.bodies]),
        "body_inertia_b": np.array([body.inertia for body in builder.bodies]).reshape(-1, 3, 3),
        "joint_anchor0": np.array([joint.frame0.position for joint in joints]).reshape(-1, 3),
        "joint_anchor1": np.array([joint.frame1.position for joint in joints]).reshape(-1, 3),
        "joint_frame0": np.array([matrix_of(joint.frame0.rotation) for joint in joints]).reshape(-1, 3, 3),
        "joint_frame1": np.array([matrix_of(joint.frame1.rotation) for joint in joints]).reshape(-1, 3, 3),
        "joint_offset": np.array([joint.offset for joint in joints]),
        "joint_armature": np.array([dof.armature for dof in dofs])
        + np.array([joint.inertia for joint in joints for _ in joint.dofs]),
        "joint_stiffness": np.array([dof.stiffness for dof in dofs]),
        "joint_rest": np.array([dof.rest for dof in dofs]),
        "joint_damping": np.array([dof.damping for dof in dofs]),
        "joint_preload": np.array([dof.preload for dof in dofs]),
        "joint_friction": np.array([dof.friction for dof in dofs]),
        "joint_limit_lower": np.maximum([limit[0] for limit in limits], -INFINITE),
        "joint_limit_upper": np.minimum([limit[1] for limit in limits], INFINITE),
        "drive_stiffness": np.array([drive.stiffness for drive in pd]),
        "drive_damping": np.array([drive.damping for drive in pd]),
        "drive_effort_limit": np.minimum(efforts, INFINITE),
        "coupling_coefficient": coefficients,
        "coupling_offset": np.array(offsets),
        "coupling_damping": np.array([coupling.damping for coupling in builder.couplings]),
        **_shape_values(builder.shapes),
    }


def _shape_values(shapes: list[ShapeSpec]) -> dict[str, npt.NDArray[Any]]:
    """One world's parameters of the shapes."""

    def material(field: str) -> npt.NDArray[Any]:
        return np.array([getattr(shape.material, field) for shape in shapes])

    return {
        "shape_x": np.array([shape.pose.position for shape in shapes]).reshape(-1, 3),
        "shape_rot": np.array([shape.pose.rotation for shape in shapes]).reshape(-1, 4),
        "shape_size": np.array([shape.size for shape in shapes]).reshape(-1, 3),
        "shape_margin": np.array([shape.margin for shape in shapes]),
        "shape_asset": np.array([shape.asset for shape in shapes], np.int32),
        "shape_enabled": np.ones(len(shapes), np.int32),
        "shape_friction": material("friction"),
        "shape_rolling_friction": material("rolling_friction"),
        "shape_spinning_friction": material("spinning_friction"),
        "shape_restitution": material("restitution"),
        "shape_cohesion": material("cohesion"),
        "shape_compliance": material("compliance"),
        "shape_damping": material("damping"),
        "shape_young_modulus": material("young_modulus"),
        "shape_poisson_ratio": material("poisson_ratio"),
    }


def _pair_topology(t: Topology, builder: ModelBuilder, ints: Callable[[Any], Any]) -> None:
    """Shapes, and which of them can meet."""
    shapes, pairs = builder.shapes, pairs_of(builder)
    t.shape_count, t.pair_count = len(shapes), len(pairs)
    t.grid_buckets = 1 << (2 * len(shapes)).bit_length() if len(pairs) > LISTED_PAIRS else 0
    t.shape_body = ints([shape.body for shape in shapes])
    t.shape_type = ints([shape.type for shape in shapes])
    t.shape_group = ints([shape.group for shape in shapes])
    t.shape_mask = ints([shape.mask for shape in shapes])
    listed = pairs if t.grid_buckets == 0 else pairs[:0]
    t.pair_start = ints(np.searchsorted(listed[:, 0], np.arange(len(shapes) + 1)))
    t.pair_other = ints(listed[:, 1])
    apart: list[list[int]] = [[] for _ in range(len(builder.bodies) + 1)]
    for low, high in sorted(_never_meet(builder)):
        apart[low + 1].append(high)
    t.excluded_start, t.excluded_body = _csr(apart, ints)


def _never_meet(builder: ModelBuilder) -> set[tuple[int, int]]:
    """Pairs of bodies whose shapes never meet: excluded, or tied by a joint."""
    joints = [
        joint for joint in builder.joints if joint.type != JointType.SHAFT and WORLD not in (joint.parent, joint.child)
    ]
    return builder.excluded_bodies | {(min(j.parent, j.child), max(j.parent, j.child)) for j in joints}


def pairs_of(builder: ModelBuilder) -> npt.NDArray[np.int32]:
    """(pairs, 2) shapes that can meet."""
    return shape_pairs(builder.shapes, _never_meet(builder))


def default_capacity(builder: ModelBuilder) -> int:
    """Contact slots of a world: all that its pairs can have, at most `CONTACTS_PER_BODY` per body and 24 at least."""
    shapes = builder.shapes
    total = sum(contact_limit(shapes[a].type, shapes[b].type) for a, b in pairs_of(builder))
    return min(total, max(24, CONTACTS_PER_BODY * len(builder.bodies)))


def _initial_coordinates(builder: ModelBuilder) -> list[float]:
    """Joint coordinates as built: zero but for shafts (only couplable joints matter here)."""
    return [joint.initial_q for joint in builder.joints for _ in joint.dofs]


def coupling_width(builder: ModelBuilder) -> int:
    """Terms of the longest coupling."""
    return max((len(coupling.terms) for coupling in builder.couplings), default=1)


def turn_terms(builder: ModelBuilder) -> list[tuple[int, int]]:
    """(coupling, term) of every coupling term on the rotation between two bodies."""
    owner = dof_joints(builder)
    return [
        (row, term)
        for row, coupling in enumerate(builder.couplings)
        for term, (dof, _) in enumerate(coupling.terms)
        if builder.joints[owner[dof]].type == JointType.TURN
    ]


def _csr(lists: list[list[int]], ints: Callable[[Any], Any]) -> tuple[Any, Any]:
    """Start indices and concatenated entries."""
    return ints(np.cumsum([0] + [len(entries) for entries in lists])), ints([e for entries in lists for e in entries])


def _device_topology(builder: ModelBuilder, tables: Tables, device: Any) -> Topology:
    def ints(values: Any) -> Any:
        data = np.asarray(values, np.int32)
        return wp.array(data if data.size else np.full((1, *data.shape[1:]), -1, np.int32), dtype=int, device=device)

    links, joints = tables.links, builder.joints
    body_link = np.full(max(len(builder.bodies), 1), -1, np.int32)
    for index, link in enumerate(links):
        if link.body >= 0:
            body_link[link.body] = index
    dof_rows = [(joint, row, dof) for joint, spec in enumerate(joints)
                for row, dof in zip(ELEMENTS[spec.type].dofs, spec.dofs, strict=True)]  # fmt: skip
    coupling_dof = np.full((len(builder.couplings), coupling_width(builder)), -1, np.int32)
    for row, coupling in enumerate(builder.couplings):
        coupling_dof[row, : len(coupling.terms)] = [dof for dof, _ in coupling.terms]
    wrench = np.full_like(coupling_dof, -1)
    for entry, (row, term) in enumerate(turn_terms(builder)):
        wrench[row, term] = tables.row_count + len(builder.couplings) + entry
    curves, dof_table = collect_tables(builder)
    starts = np.cumsum([0] + [len(x) for x, _ in curves])
    t = Topology()
    t.link_count, t.slot_count, t.dof_count = len(links), len(tables.slot_dof), builder.dof_count
    t.joint_count, t.loop_joint_count = len(joints), len(tables.loop_joint)
    t.joint_row_count, t.row_count = tables.row_count, tables.row_count + len(builder.couplings)
    t.bounded_count, t.loop_dof_count = len(tables.bounded), len(tables.loop_dof)
    t.slot_line_count = len(tables.slot_line)
    t.link_body = ints([link.body for link in links])
    t.link_parent = ints([link.parent for link in links])
    t.link_joint = ints([link.joint for link in links])
    t.link_type = ints([link.type for link in links])
    t.link_sign = wp.array([link.sign for link in links] or [1.0], dtype=float, device=device)
    touched = {body for joint in joints for body in (joint.parent, joint.child)}
    t.link_alone = ints([link.body >= 0 and link.body not in touched for link in links])
    t.link_slot, t.slot_dof, t.slot_link = ints(tables.link_slot), ints(tables.slot_dof), ints(tables.slot_link)
    t.body_link = ints(body_link)
    t.joint_type = ints([joint.type for joint in joints])
    t.joint_body0 = ints([joint.parent for joint in joints])
    t.joint_body1 = ints([joint.child for joint in joints])
    t.joint_dof = ints([builder.dof_start(joint) for joint in range(len(joints) + 1)])
    t.dof_joint = ints([joint for joint, _, _ in dof_rows])
    t.dof_slot = ints(tables.dof_slot)
    t.dof_kind = ints([row.kind for _, row, _ in dof_rows])
    t.dof_axis = ints([max(row.axis0, row.axis1) for _, row, _ in dof_rows])
    t.dof_drive = ints([drive_mode(dof) for _, _, dof in dof_rows])
    coupled = {dof for coupling in builder.couplings for dof, _ in coupling.terms}
    t.dof_coupled = ints([dof in coupled for dof in range(builder.dof_count)])
    t.dof_table = ints(dof_table)
    t.table_start = ints(starts)
    t.table_x = wp.array(
        np.concatenate([[0.0], *(x for x, _ in curves)])[bool(curves) :], dtype=wp.float64, device=device
    )
    t.table_y = wp.array(
        np.concatenate([[0.0], *(y for _, y in curves)])[bool(curves) :], dtype=wp.float64, device=device
    )
    t.loop_joint, t.loop_row = ints(tables.loop_joint), ints(tables.loop_row)
    t.row_kind = ints([row.kind for row in tables.rows])
    t.row_axis0 = ints([row.axis0 for row in tables.rows])
    t.row_axis1 = ints([max(row.axis1, row.axis0) if dof >= 0 else row.axis1
                        for row, dof in zip(tables.rows, tables.row_dof, strict=True)])  # fmt: skip
    t.row_dof = ints(tables.row_dof)
    t.coupling_dof, t.coupling_wrench = ints(coupling_dof), ints(wrench)
    paths = row_paths(builder, tables)
    t.row_path, t.path_slot = _csr(paths, ints)
    t.loop_dof = ints(tables.loop_dof)
    t.slot_line = ints(np.array(tables.slot_line, np.int32).reshape(-1, 2))
    t.bounded_dof = ints([dof for dof, _ in tables.bounded])
    t.bounded_kind = ints([kind for _, kind in tables.bounded])
    _pair_topology(t, builder, ints)
    return t
