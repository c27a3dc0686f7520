"""Model: everything that is constant during a run. Parameters may differ per world; the topology may not."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from typing import Any, Final, NoReturn

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.arrays import writable_from
from simwarp.core.fields import Size
from simwarp.core.memory import MOST_ROWS, check_fits, check_layouts, item_bytes, layout_bytes
from simwarp.core.object_repr import Names, Row, bytes_text, plural
from simwarp.core.piecewise_linear import function_arrays
from simwarp.core.types import WORLD, ArrayLayout, FrictionRule, JointType, Material, ModelError, PairRule, formatted
from simwarp.core.warp_start import start_warp
from simwarp.core.wording import close_names
from simwarp.geometry.assets import add_ground_assets, hull_assets
from simwarp.geometry.sprocket_profiles import add_profile_assets
from simwarp.kernels.core.fields import ParameterFields, Parameters
from simwarp.kernels.core.layouts import run_layouts
from simwarp.kernels.core.tables import Topology
from simwarp.kernels.meshes.mesh_links import NODE
from simwarp.meshes.mesh_columns import MATERIAL_PARAMETERS, costs_of, device_meshes, mesh_topology, use_parameters
from simwarp.meshes.mesh_faces import face_topology
from simwarp.model.checks import checked_member, checked_names, whole_number
from simwarp.model.effort_routing import EffortModel, drive_mode
from simwarp.model.identity import model_identity
from simwarp.model.joint_types import ELEMENTS
from simwarp.model.limit_order import coordinate_titles, keep_in_order
from simwarp.model.parameters import PARAMETERS, parameter_domain, parameter_values
from simwarp.model.row_groups import RowGroups, group_rows, groups_meet
from simwarp.model.shape_pairs import check_room, default_capacity, pair_ways, shape_pairs
from simwarp.model.specifications import CouplingSpec, Specification, specification_rows
from simwarp.model.topology import (
    Tables,
    all_sums,
    build_tables,
    collect_tables,
    coupling_width,
    dof_joints,
    path_lengths,
    row_paths,
)

LISTED_PAIRS = 2000
"""Pairs of shapes up to which every step goes through a list of them; above, a grid finds the near ones."""
MANY_SHAPES: Final = 250
"""Shapes above which that limit grows with their number: a grid looks at each of them, however few its partners are."""

BYTES_PER_PAIR: Final = 40
"""Of the host, while it is found out which shapes can meet."""

MOST_LISTED: Final = 12
"""Names that an error lists."""

MADE_OF_BOTH: Final = [-1.0] * 7
"""`Topology.given_surface` of a pair without a surface of its own."""

FEWER: Final = "take fewer worlds or a smaller contact_capacity"


class Model(ParameterFields):
    """Constant data of `world_count` worlds on one device. Made by `ModelBuilder.finalize`.

    Every parameter (declared in `ParameterFields`) is an attribute: an array of leading dimension 1 (shared by all
    worlds) or W (named in `finalize(per_world=...)`). Write into it between steps, never replace it.

    Attributes:
        world_count, body_count, joint_count, dof_count, shape_count: sizes of the arrays.
        body_names, joint_names, shape_names: in index order.
        has_mass: (bodies,) False for the frames between joints that `add_massless_body` made.
        contact_capacity: contact slots of every world.
        has_rolling_friction: True if contacts carry rolling and spinning friction.
        every_contact_rolls: True if all of them do.
        path_length: most slots between a link and the root of its tree.
        coupling_count: couplings; what follows them in arrays of couplings are combinations.
        response_count: bilateral rows, and combinations without one.
        row_groups: trees that bilateral rows tie together.
        share_width: most bilateral rows that one block of the cone problem sees.
        unit_entries: most entries of a row of the cone problem that moves a unit and its like.
        entry_count: most entries of a row of the cone problem.
        unit_newton: units that no row ties and whose shapes may touch others: Newton steps can solve their contacts.
        relative_rotation_count: terms of couplings that are rotations between two bodies.
        face_bodies: (faces, 3) bodies of the corners of meshes' triangles that touch others; -1: a corner is fixed.
        builder: that it was made of.
        mesh_cost: of its flexible meshes, in each world.
        mass_ratio: of the heaviest body to the lightest, as built, nodes of rods left out: what is elastic carries
            any load.
        joint_dof_start: first coordinate of each joint, plus the total at the end.
        joint_types, shape_types: in index order.
        effort_models: parts of each coordinate's effort that are fixed.
        shapes_that_meet: shapes that may touch another one.
        identity: properties that a snapshot must have in common.
        as_built: name -> values of each parameter in one world when the model was made.
    """

    def __init__(
        self, world_count: int, device: Any, builder: Specification, tables: Tables, contact_capacity: int | None = None
    ) -> None:
        self.world_count = world_count
        self.device = device
        self.builder = builder
        self.body_count = len(builder.bodies)
        self.joint_count = len(builder.joints)
        self.dof_count = builder.dof_count
        self.body_names = tuple(body.name for body in builder.bodies)
        self.has_mass = np.array([not body.is_massless for body in builder.bodies], bool)
        self.joint_names = tuple(joint.name for joint in builder.joints)
        self.joint_dof_start = tuple(builder.dof_start(joint) for joint in range(self.joint_count + 1))
        self.box_count = len(tables.boxes)
        masses = [builder.bodies[body].mass for body in _weighty(builder)] or [1.0]
        self.mass_ratio = max(masses) / min(masses)
        self.shape_count = len(builder.shapes)
        self.shape_names = tuple(shape.name for shape in builder.shapes)
        surfaces = [shape.material for shape in builder.shapes]
        surfaces += [surface for surface in builder.given_pairs.values() if surface is not None]
        self.has_rolling_friction = any(
            surface.rolling_friction > 0.0 or surface.spinning_friction > 0.0 for surface in surfaces
        )
        self.every_contact_rolls = bool(surfaces) and all(
            surface.rolling_friction > 0.0 or surface.spinning_friction > 0.0 for surface in surfaces
        )
        candidates = self.shape_count * (self.shape_count - 1) // 2
        what = f"finalize: the {candidates} pairs of {self.shape_count} shapes"
        check_fits(what, BYTES_PER_PAIR * candidates, wp.get_device("cpu"), "use fewer shapes")
        pairs = shape_pairs(builder, never_meet(builder))
        check_room(builder, pairs)
        self.contact_capacity = default_capacity(builder, pairs) if contact_capacity is None else contact_capacity
        self.shapes_that_meet = np.isin(np.arange(self.shape_count), pairs)
        self.shape_types = tuple(shape.type for shape in builder.shapes)
        self.joint_types = tuple(joint.type for joint in builder.joints)
        dofs = [dof for joint in builder.joints for dof in joint.dofs]
        self.effort_models = tuple(map(EffortModel.of, dofs, tables.paths))
        self.path_length = max(path_lengths(tables), default=0)
        self.coupling_count = len(builder.couplings)
        paths = row_paths(builder, tables)
        self.response_count = len(paths)
        self.row_groups = group_rows(paths, tables)
        self.share_width = self.row_groups.share_width(groups_meet(builder, tables, self.row_groups, pairs))
        self.unit_entries = _unit_entries(builder, tables, self.row_groups)
        self.entry_count = max(self.unit_entries, default=0)
        self.unit_newton = _newton_units(builder, tables, self.row_groups, self.shapes_that_meet)
        self.relative_rotation_count = len(relative_rotation_terms(builder))
        self.tables = tables
        self.mesh_cost = costs_of(builder.flexible_meshes, tables.meshes)
        self.mesh_tables = device_meshes(builder.flexible_meshes, tables.meshes, device)
        self.initial = initial_state(builder)
        self.topology = _device_topology(builder, tables, self.row_groups, pairs, device)
        _unit_topology(self.topology, self, device)
        self.face_bodies = face_topology(self.topology, builder, [link.body for link in tables.links], device)
        self.parameters = Parameters()
        self.as_built: dict[str, npt.NDArray[Any]] = {}
        self.assets = hull_assets(builder.hulls, device)
        # the assets hold their ids only
        self.meshes = add_ground_assets(self.assets, builder.height_fields, builder.meshes, device)
        add_profile_assets(self.assets, builder.sprocket_profiles, device)
        self.identity = model_identity(builder, world_count, self.contact_capacity, self.has_rolling_friction)

    @classmethod
    def from_builder(
        cls, builder: Specification, world_count: int, device: str | None, *, per_world: Iterable[str] = (),
        contact_capacity: int | None = None,
    ) -> Model:  # fmt: skip
        """The Model of `world_count` worlds on `device`; arguments as for `ModelBuilder.finalize`.

        Raises:
            ModelError: the worlds, the device or the topology are not usable; says which and why.
        """
        worlds = whole_number("finalize", "world_count", world_count, 1, MOST_ROWS, "give the number of worlds")
        if contact_capacity is not None:
            contact_capacity = whole_number(
                "finalize", "contact_capacity", contact_capacity, 1, MOST_ROWS, "None chooses it"
            )
        wanted = checked_names("finalize", "per_world", per_world, PARAMETERS)
        # attributes, which anybody may have set
        builder.friction_rule = checked_member("finalize", "friction_rule", builder.friction_rule, FrictionRule)
        builder.pair_rule = checked_member("finalize", "pair_rule", builder.pair_rule, PairRule)
        if not builder.bodies and not builder.joints:
            raise ModelError("finalize: the builder has no body; call add_body first")
        values = parameter_values(builder)
        model = cls(worlds, resolve_device(device), builder, build_tables(builder), contact_capacity)
        layouts = {
            name: ArrayLayout((worlds if name in wanted else 1, *_lengths(array, name)), PARAMETERS[name].dtype)
            for name, array in values.items()
        }
        # of a CPU, worlds of a thread take the same scratch in turn
        scratch = model.mesh_cost.scratch_bytes * (worlds if model.device.is_cuda else 1)
        check_layouts(f"finalize: {worlds} worlds", layouts | run_layouts(model.sizes()), model.device, FEWER, scratch)
        for name, layout in layouts.items():
            shared = layout.shape[0] == 1 < worlds
            array = writable_from(
                np.repeat(values[name][None], layout.shape[0], axis=0), layout.dtype, model.device,
                label=f"model.{name}",
                domain=parameter_domain(builder, name),
                hint=f"all worlds share it: finalize(per_world=('{name}',)) gives each its own" if shared else "",
            )  # fmt: skip
            setattr(model, name, array)
            if PARAMETERS[name].of_kernels:
                setattr(model.parameters, name, array)
        if builder.flexible_meshes:
            use_parameters(model.mesh_tables, {name: getattr(model, name) for name in MATERIAL_PARAMETERS})
        model.as_built = values
        titles = coordinate_titles(model.joint_names, model.joint_dof_start)
        keep_in_order(model.joint_limit_lower, model.joint_limit_upper, titles)
        model._fix()
        return model

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "a Model cannot be pickled or copied: it refers to memory of a device; keep its ModelBuilder, which can, "
            "and finalize that again"
        )

    def _readable_title(self) -> str:
        return f": {plural(self.world_count, 'world')} on {self.device}"

    def _readable_rows(self) -> dict[str, Row]:
        own = [name for name in self.FIELDS if getattr(self, name).shape[0] > 1]
        sizes = [getattr(self, name).size * item_bytes(field.dtype) for name, field in self.FIELDS.items()]
        run = layout_bytes(run_layouts(self.sizes()).values())
        contacts = plural(self.contact_capacity, "contact")
        return {
            **specification_rows(self.builder),
            "coordinates": f"{self.dof_count} in joint_q",
            "contacts": f"up to {contacts} in a world" if self.contact_capacity else "",
            "meshes": self.mesh_cost.summary,
            "memory": f"{bytes_text(sum(sizes))} of parameters, {bytes_text(run)} of state in a Simulation",
            "per world": Names(len(own), own),
        }

    def sizes(
        self, *, elements: bool = False, implicit: bool = False, reactions: bool = False, accelerations: bool = False,
        worlds: int | None = None,
    ) -> dict[Size, int]:  # fmt: skip
        """Lengths of a Simulation's arrays, with or without (implicit) elements, joint reactions, accelerations."""
        worlds = self.world_count if worlds is None else worlds  # of a part of them
        return {
            Size.WORLDS: worlds,
            Size.ELEMENT_WORLDS: worlds if elements else 1,
            Size.IMPLICIT_WORLDS: worlds if implicit else 0,
            Size.REACTION_WORLDS: worlds if reactions else 0,
            Size.ACCELERATION_WORLDS: worlds if accelerations else 0,
            Size.BODIES: self.body_count,
            Size.TOUCHED_BODIES: self.body_count if self.shape_count else 0,
            Size.JOINTS: self.joint_count,
            Size.DOFS: self.dof_count,
            Size.BOX_CONSTRAINTS: self.box_count,
            Size.SHAPES: self.shape_count,
            Size.CONTACTS: self.contact_capacity,
            Size.FACE_CONTACTS: self.contact_capacity if self.topology.face_count else 0,
        }

    def body(self, name: str) -> int:
        """Index of a body by name.

        Raises:
            ModelError: there is no such body.
        """
        return _index(name, self.body_names, "body")

    def joint(self, name: str) -> int:
        """Index of a joint by name.

        Raises:
            ModelError: there is no such joint.
        """
        return _index(name, self.joint_names, "joint")

    def dof(self, joint: str, local: int = 0) -> int:
        """Column of `joint_q` of a joint's coordinate.

        Args:
            joint: its name.
            local: which of the joint's coordinates, from 0.

        Raises:
            ModelError: there is no such joint, or it has no such coordinate.
        """
        index = self.joint(joint)
        first, end = self.joint_dof_start[index : index + 2]
        if isinstance(local, bool) or not isinstance(local, (int, np.integer)) or not 0 <= local < end - first:
            raise ModelError(
                f"model: joint '{joint}' has {end - first} coordinates, got index {formatted(local)}; count from 0"
            )
        return first + int(local)


def resolve_device(device: str | None) -> Any:
    """The Warp device of a name; when None that which Warp prefers, unless it is a GPU that torch has no tensors on.

    Raises:
        ModelError: there is no such device; lists those there are.
    """
    start_warp()
    try:
        found = wp.get_device(device)
    except Exception as error:  # warp raises several kinds for unknown names and absent drivers
        known = ", ".join(str(each) for each in wp.get_devices())
        raise ModelError(f"device {formatted(device)} is not available; use one of: {known}") from error
    return found if device is not None else _usable_by_torch(found)


def _usable_by_torch(device: Any) -> Any:
    """A device that nobody asked for, or the CPU where torch could not look at its arrays."""
    if not device.is_cuda:
        return device
    from simwarp.core.interop import missing_in_torch  # torch only where there is a GPU: it takes seconds to import

    missing = missing_in_torch(device)
    if not missing:
        return device
    warnings.warn(
        f"device: cpu, not {device}, which {missing}; name one, as device='{device}' where no tensors are needed",
        stacklevel=5,
    )
    return wp.get_device("cpu")


def _index(name: str, names: tuple[str, ...], kind: str) -> int:
    if not isinstance(name, str) or name not in names:
        near = close_names(name, names, 3)
        some = ", ".join(map(repr, near or names[:MOST_LISTED])) + (", ..." if len(names) > MOST_LISTED else "")
        raise ModelError(
            f"model has no {kind} {formatted(name)}; " + (f"did you mean {some}?" if some else "it has none")
        )
    return names.index(name)


def _weighty(builder: Specification) -> list[int]:
    """Bodies with mass, but for those between elastic joints, if there are others."""
    nodes = {end for joint in builder.joints if joint.type is JointType.ELASTIC for end in (joint.parent, joint.child)}
    nodes |= {mesh.bodies[node] for mesh in builder.flexible_meshes for node in mesh.nodes}
    massive = [index for index, body in enumerate(builder.bodies) if not body.is_massless]
    return [body for body in massive if body not in nodes] or massive[:1]


def _lengths(values: npt.NDArray[Any], name: str) -> tuple[int, ...]:
    """Axes of one world's parameter without those of its vectors and matrices."""
    return values.shape[: values.ndim - len(getattr(PARAMETERS[name].dtype, "_shape_", ()))]


def initial_state(builder: Specification) -> dict[str, npt.NDArray[Any]]:
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


def _pair_topology(
    t: Topology, builder: Specification, pairs: npt.NDArray[np.int32], ints: Callable[[Any], Any], device: Any
) -> None:
    """Shapes, and which of them can meet."""
    shapes = builder.shapes
    t.shape_count, t.pair_count = len(shapes), len(pairs)
    t.formula_pairs, t.searched_pairs, t.ground_pairs = pair_ways([shape.type for shape in shapes], pairs)
    most_listed = LISTED_PAIRS * max(1.0, len(shapes) / MANY_SHAPES)
    t.grid_buckets = 1 << (2 * len(shapes)).bit_length() if len(pairs) > most_listed else 0
    t.shape_body = ints([shape.body for shape in shapes])
    t.shape_type = ints([shape.type for shape in shapes])
    t.shape_group = ints([shape.group for shape in shapes])
    t.shape_mask = ints([shape.mask for shape in shapes])
    listed = pairs if t.grid_buckets == 0 else pairs[:0]
    t.pair_start = ints(np.searchsorted(listed[:, 0], np.arange(len(shapes) + 1)))
    t.pair_other = ints(listed[:, 1])
    apart: list[list[int]] = [[] for _ in range(len(builder.bodies) + 1)]
    for low, high in sorted(never_meet(builder)):
        apart[low + 1].append(high)
    t.excluded_start, t.excluded_body = _csr(apart, ints)
    t.pair_rule, t.friction_rule = int(builder.pair_rule), int(builder.friction_rule)
    t.shape_priority = ints([shape.material.priority for shape in shapes])
    t.apart_start, t.apart_shape = _csr(_by_first(builder.excluded_shapes, len(shapes)), ints)
    t.given_count = len(builder.given_pairs)
    t.given_start, t.given_shape = _csr(_by_first(builder.given_pairs, len(shapes)), ints)
    surfaces: Any = [_surface_entries(builder.given_pairs[pair]) for pair in sorted(builder.given_pairs)]
    t.given_surface = wp.array2d(surfaces or [MADE_OF_BOTH], dtype=float, device=device)


def _by_first(pairs: Iterable[tuple[int, int]], count: int) -> list[list[int]]:
    """For each of `count` shapes the others that it is in a pair with and first of, in order."""
    others: list[list[int]] = [[] for _ in range(count)]
    for first, second in sorted(pairs):
        others[first].append(second)
    return others


def _surface_entries(surface: Material | None) -> list[float]:
    """`Topology.given_surface` of a pair."""
    if surface is None:
        return MADE_OF_BOTH
    return [
        surface.friction, surface.rolling_friction, surface.spinning_friction, surface.restitution, surface.cohesion,
        surface.compliance, surface.damping,
    ]  # fmt: skip


def meeting_pairs(builder: Specification) -> set[tuple[int, int]]:
    """Pairs of shapes that can meet, the smaller index first."""
    return {(int(low), int(high)) for low, high in shape_pairs(builder, never_meet(builder))}


def never_meet(builder: Specification) -> set[tuple[int, int]]:
    """Pairs of bodies whose shapes never meet: excluded, or tied by a joint, or by several through massless bodies."""
    joints = [
        joint
        for joint in builder.joints
        if joint.type != JointType.SHAFT and WORLD not in (joint.parent, joint.child) and not joint.closes_loop
    ]
    tied = {(min(j.parent, j.child), max(j.parent, j.child)) for j in joints}
    for body, spec in enumerate(builder.bodies):
        if spec.is_massless:
            around = sorted({a + b - body for a, b in tied if body in (a, b)})
            tied |= {(low, high) for low in around for high in around if low < high}
    return builder.excluded_bodies | tied


def relative_rotation_terms(builder: Specification) -> list[tuple[int, int]]:
    """(coupling, term) of every coupling term on the rotation between two bodies."""
    owner = dof_joints(builder)
    return [
        (row, term)
        for row, coupling in enumerate(builder.couplings)
        for term, (dof, _) in enumerate(coupling.terms)
        if builder.joints[owner[dof]].type == JointType.RELATIVE_ROTATION
    ]


def _sum_paths(builder: Specification, paths: list[list[int]]) -> list[tuple[CouplingSpec, list[int]]]:
    """Sums of coordinates with the tree degrees of freedom that they move."""
    sums = all_sums(builder)
    return list(zip(sums, paths[len(paths) - len(sums) :], strict=True))


def _unit_entries(builder: Specification, tables: Tables, groups: RowGroups) -> list[int]:
    """Most entries of a row of the cone problem that moves a unit and its like."""
    entries = [0] * groups.unit_count
    for unit, length in zip(groups.link_unit, path_lengths(tables), strict=True):
        if unit >= 0:
            entries[unit] = max(entries[unit], 2 * length)
    bounded = {dof for dof, _ in tables.boxes}
    for combination, path in _sum_paths(builder, row_paths(builder, tables)):
        if combination.dof in bounded and path:
            unit = groups.link_unit[tables.tree_dof_link[path[0]]]  # sums tie all that they move
            entries[unit] = max(entries[unit], len(path))
    return entries


def _newton_units(
    builder: Specification, tables: Tables, groups: RowGroups, meets: npt.NDArray[np.bool_]
) -> list[bool]:
    """See `Model.unit_newton`."""
    touching = {shape.body for shape, may in zip(builder.shapes, meets, strict=True) if may}
    found, tied = [False] * groups.unit_count, [False] * groups.unit_count
    counts = groups.row_counts
    for link, unit, group in zip(tables.links, groups.link_unit, groups.link_group, strict=True):
        if unit >= 0:
            found[unit] |= link.body >= 0 and link.body in touching
            tied[unit] |= group >= 0 and counts[group] > 0
    return [touches and not held for touches, held in zip(found, tied, strict=True)]


def _unit_topology(t: Topology, model: Model, device: Any) -> None:
    """Tables of what contacts join to islands."""

    def ints(values: Iterable[Any]) -> Any:
        return wp.array([*map(int, values)] or [-1], dtype=int, device=device)

    t.unit_count = model.row_groups.unit_count
    t.unit_entries, t.unit_newton = ints(model.unit_entries), ints(model.unit_newton)
    t.tree_dof_unit = ints(model.row_groups.link_unit[link] for link in model.tables.tree_dof_link)


def _csr(lists: list[list[int]], ints: Callable[[Any], Any]) -> tuple[Any, Any]:
    """Start indices and concatenated entries."""
    return ints(np.cumsum([0] + [len(entries) for entries in lists])), ints([e for entries in lists for e in entries])


def _row_topology(
    t: Topology, builder: Specification, tables: Tables, groups: RowGroups, ints: Callable[[Any], Any]
) -> None:
    """Tables of the bilateral rows, group by group."""
    place, joint_rows, row_count = groups.place, tables.row_count, groups.row_start[-1]
    first = np.array([place[row] for row in tables.loop_row[:-1]], np.int32)
    end = first + np.diff(tables.loop_row).astype(np.int32)
    t.loop_joint, t.loop_row = (
        ints(tables.loop_joint),
        ints(np.stack([first, end - np.array(tables.rotation_rows, np.int32), end], axis=1)),
    )
    t.loop_rotation_count = sum(rows > 0 for rows in tables.rotation_rows)
    ends = [max(row.axis1, row.axis0) if dof >= 0 else row.axis1
            for row, dof in zip(tables.rows, tables.row_dof, strict=True)]  # fmt: skip
    columns = ([row.kind for row in tables.rows], [row.axis0 for row in tables.rows], ends, tables.row_dof)
    table = np.full((4, row_count), -1, np.int32)
    table[:, place[:joint_rows]] = np.array(columns, np.int32).reshape(4, joint_rows)
    t.row_kind, t.row_axis0, t.row_axis1, t.row_dof = map(ints, table)
    t.coupling_row = ints(place[joint_rows:])
    paths: list[list[int]] = [[]] * len(place)
    for row, path in enumerate(row_paths(builder, tables)):
        paths[place[row]] = path
    t.row_path, t.path_tree_dof = _csr(paths, ints)
    column = [dof - groups.link_column[link] for dof, link in enumerate(tables.tree_dof_link)]
    t.path_column = ints([column[dof] for path in paths for dof in path])
    t.group_count, t.group_columns = len(groups.columns), ints(groups.columns)
    t.group_row, t.group_factor = ints(groups.row_start), ints(groups.factor_start)
    t.row_group = ints([group for group, count in enumerate(groups.row_counts) for _ in range(count)])
    t.link_group, t.link_column = ints(groups.link_group), ints(groups.link_column)


def _device_topology(
    builder: Specification, tables: Tables, groups: RowGroups, pairs: npt.NDArray[np.int32], device: Any
) -> Topology:
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
    sums = all_sums(builder)
    coupling_dof = np.full((len(sums), coupling_width(builder)), -1, np.int32)
    dof_sum = np.full(builder.dof_count, -1, np.int32)
    for row, coupling in enumerate(sums):
        coupling_dof[row, : len(coupling.terms)] = [dof for dof, _ in coupling.terms]
        if coupling.dof >= 0:
            dof_sum[coupling.dof] = row
    row_count = groups.row_start[-1]
    wrench = np.full_like(coupling_dof, -1)
    for entry, (row, term) in enumerate(relative_rotation_terms(builder)):
        wrench[row, term] = row_count + entry
    curves, dof_table = collect_tables(builder)
    t = Topology()
    t.link_count, t.tree_dof_count, t.dof_count = len(links), len(tables.tree_dof_to_dof), builder.dof_count
    t.joint_count, t.loop_joint_count = len(joints), len(tables.loop_joint)
    t.joint_row_count, t.row_count, t.response_count = tables.row_count, row_count, len(groups.place)
    t.box_count, t.loop_dof_count = len(tables.boxes), len(tables.loop_dof)
    t.distance_count = len(tables.distance_dof)
    t.link_body = ints([link.body for link in links])
    t.link_parent = ints([link.parent for link in links])
    t.link_joint = ints([link.joint for link in links])
    t.link_type = ints([int(NODE) if link.is_node else link.type for link in links])
    mesh_topology(t, builder.flexible_meshes, tables.meshes, [link.body for link in links], ints)
    t.link_sign = wp.array([link.sign for link in links] or [1.0], dtype=float, device=device)
    touched = {body for joint in joints for body in (joint.parent, joint.child)}
    massless = [link.body >= 0 and builder.bodies[link.body].is_massless for link in links]
    t.link_massless, t.massless_count = ints(massless), sum(massless)
    with_rows = set(tables.loop_joint)
    t.link_sprung = ints([link.joint in with_rows for link in links])
    elastic = [link.type is JointType.ELASTIC for link in links]
    t.link_elastic = ints(np.where(elastic, np.cumsum(elastic) - 1, -1))
    t.elastic_count = sum(elastic)
    t.link_alone = ints([link.body >= 0 and link.body not in touched for link in links])
    t.link_tree_dof, t.tree_dof_to_dof, t.tree_dof_link = (
        ints(tables.link_tree_dof),
        ints(tables.tree_dof_to_dof),
        ints(tables.tree_dof_link),
    )
    t.body_link = ints(body_link)
    t.joint_type = ints([joint.type for joint in joints])
    t.joint_body0 = ints([joint.parent for joint in joints])
    t.joint_body1 = ints([joint.child for joint in joints])
    t.joint_dof = ints([builder.dof_start(joint) for joint in range(len(joints) + 1)])
    t.dof_joint = ints([joint for joint, _, _ in dof_rows])
    t.dof_to_tree_dof = ints(tables.dof_to_tree_dof)
    t.dof_kind = ints([row.kind for _, row, _ in dof_rows])
    t.dof_axis = ints([max(row.axis0, row.axis1) for _, row, _ in dof_rows])
    t.dof_drive = ints([drive_mode(dof) for _, _, dof in dof_rows])
    coupled = {dof for coupling in sums for dof, _ in coupling.terms}
    t.dof_coupled = ints([dof in coupled for dof in range(builder.dof_count)])
    t.dof_table = ints(dof_table)
    t.table_start, t.table_x, t.table_y = function_arrays(
        [zip(x, y, strict=True) for x, y in curves], wp.float64, device
    )
    _row_topology(t, builder, tables, groups, ints)
    t.coupling_dof, t.coupling_wrench = ints(coupling_dof), ints(wrench)
    t.coupling_law, t.dof_sum = ints([each.dof for each in sums]), ints(dof_sum)
    t.loop_dof = ints(tables.loop_dof)
    t.distance_dof = ints(np.array(tables.distance_dof, np.int32).reshape(-1, 2))
    t.box_dof = ints([dof for dof, _ in tables.boxes])
    t.box_kind = ints([kind for _, kind in tables.boxes])
    _pair_topology(t, builder, pairs, ints, device)
    return t
