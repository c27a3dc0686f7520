"""Spanning tree and level-ordered tables of a model: computed once on the host, shared by all worlds.

A maximum spanning tree over the joints, weighted by the rows that elimination saves, keeps the loop system small;
joints whose coordinates carry efforts or couplings are preferred, since a tree degree of freedom serves them for free.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from simwarp.core.types import (
    WORLD,
    BoxKind,
    JointType,
    ModelError,
    PrescribedPosition,
    PrescribedSpeed,
    Table,
)
from simwarp.meshes.mesh_columns import MeshColumns, mesh_columns
from simwarp.model.effort_routing import (
    EffortRoute,
    box_constraint_kinds,
    effort_route,
    has_effort,
    joint_routes,
)
from simwarp.model.joint_types import ELEMENTS, ROTATION_START, Row
from simwarp.model.specifications import CouplingSpec, JointSpec, Specification

NODE_DOFS = 3
"""Of a node of a mesh."""
AT_NODE = 1e-6
"""Most that the anchor of a joint may be off the node that it holds: no lever turns with a node [m]."""
POINT_JOINTS = (JointType.SPHERICAL, JointType.DISTANCE, JointType.POINT_ON_PLANE, JointType.POINT_ON_LINE)
"""Joints that a node of a mesh may have."""

IntArray = npt.NDArray[np.int32]


@dataclasses.dataclass(frozen=True)
class Link:
    """A node of the tree: a body or a shaft, with the joint that ties it to its parent link."""

    body: int
    parent: int
    joint: int
    type: JointType
    sign: float
    is_node: bool = False  # of a mesh


@dataclasses.dataclass(frozen=True)
class Tables:
    """The tables of `kernels.tables.Topology` as lists, before they go to a device. `loop_joint` are the joints with
    rows: those that close loops, and those of the tree whose efforts are rows; the last `rotation_rows` of each are
    those of a rotation's efforts.
    """

    links: list[Link]
    link_tree_dof: list[int]
    tree_dof_to_dof: list[int]
    tree_dof_link: list[int]
    dof_to_tree_dof: list[int]
    loop_joint: list[int]
    loop_row: list[int]
    rotation_rows: list[int]
    rows: list[Row]
    row_dof: list[int]
    paths: list[EffortRoute]
    distance_dof: list[tuple[int, int]]
    boxes: list[tuple[int, BoxKind]]
    meshes: MeshColumns | None = None

    @property
    def loop_dof(self) -> list[int]:
        """Coordinates on which `joint_force` acts as it is."""
        return [dof for dof, path in enumerate(self.paths) if path is EffortRoute.BODY_FORCE]

    @property
    def row_count(self) -> int:
        """Rows of loop joints, compliant rows included, couplings not."""
        return len(self.rows)

    @property
    def tree_row_count(self) -> int:
        """Rows that carry efforts of joints of the tree: they tie no coordinates."""
        in_tree = {link.joint for link in self.links}
        ends = zip(self.loop_joint, self.loop_row, self.loop_row[1:], strict=False)
        return sum(end - first for joint, first, end in ends if joint in in_tree)

    @property
    def silent_count(self) -> int:
        """Combinations without a row."""
        return sum(path is EffortRoute.TERMS for path in self.paths)


def row_paths(builder: Specification, tables: Tables) -> list[list[int]]:
    """Tree degrees of freedom between each row's bodies (or coordinates) and the roots: loop rows, then sums."""
    body_link = {link.body: index for index, link in enumerate(tables.links) if link.body >= 0}

    def above(link: int) -> set[int]:
        tree_dofs: set[int] = set()
        while link >= 0:
            tree_dofs.update(range(tables.link_tree_dof[link], tables.link_tree_dof[link + 1]))
            link = tables.links[link].parent
        return tree_dofs

    paths = []
    for index, joint in enumerate(tables.loop_joint):
        ends = (builder.joints[joint].parent, builder.joints[joint].child)
        tree_dofs = set().union(*(above(body_link[body]) for body in ends if body != WORLD))
        paths += [sorted(tree_dofs)] * (tables.loop_row[index + 1] - tables.loop_row[index])
    owner = dof_joints(builder)
    for coupling in all_sums(builder):
        links: list[int] = []
        for dof, _ in coupling.terms:
            spec = builder.joints[owner[dof]]
            if tables.dof_to_tree_dof[dof] >= 0:
                links.append(tables.tree_dof_link[tables.dof_to_tree_dof[dof]])
            else:
                links += [body_link[body] for body in (spec.parent, spec.child) if body != WORLD]
        paths.append(sorted(set().union(*(above(link) for link in links))))
    return paths


def dof_joints(builder: Specification) -> list[int]:
    """The joint of every degree of freedom."""
    return [joint for joint, spec in enumerate(builder.joints) for _ in spec.dofs]


def path_lengths(tables: Tables) -> list[int]:
    """Tree degrees of freedom between each link and the root of its tree."""
    lengths: list[int] = []
    for index, link in enumerate(tables.links):
        above = lengths[link.parent] if link.parent >= 0 else 0
        lengths.append(above + tables.link_tree_dof[index + 1] - tables.link_tree_dof[index])
    return lengths


def coupling_width(builder: Specification) -> int:
    """Terms of the longest sum."""
    return max((len(coupling.terms) for coupling in all_sums(builder)), default=1)


def all_sums(builder: Specification) -> list[CouplingSpec]:
    """Sums of coordinates: couplings, then combinations with a row of their own, then those without."""
    with_row: list[CouplingSpec] = []
    without: list[CouplingSpec] = []
    for joint, spec in enumerate(builder.joints):
        if spec.type == JointType.COMBINATION:
            path = effort_route(spec.type, spec.dofs[0], in_tree=False, along_tree_dof=False)
            same = CouplingSpec(spec.name, spec.terms, 0.0, dof=builder.dof_start(joint))
            (with_row if path is EffortRoute.ROW else without).append(same)
    return [*builder.couplings, *with_row, *without]


def build_tables(builder: Specification) -> Tables:
    """Tables of the builder's model."""
    _check_posed(builder)
    dof_start = _dof_starts(builder)
    coupled = {dof for coupling in all_sums(builder) for dof, _ in coupling.terms}
    tree = _spanning_tree(builder, dof_start, coupled)
    _check_elastic(builder, tree)
    _check_node_joints(builder)
    meshes = mesh_columns(builder.flexible_meshes)
    links = _ordered_links(builder, tree, meshes)
    _check_massless(builder, links)
    link_tree_dof: list[int] = [0]
    tree_dof_to_dof: list[int] = []
    tree_dof_link: list[int] = []
    dof_to_tree_dof = [-1] * builder.dof_count
    for index, link in enumerate(links):
        count = NODE_DOFS if link.is_node else len(ELEMENTS[link.type].dofs)
        for local in range(count):
            dof = -1 if link.joint < 0 else dof_start[link.joint] + local
            if dof >= 0:
                dof_to_tree_dof[dof] = len(tree_dof_to_dof)
            tree_dof_to_dof.append(dof)
            tree_dof_link.append(index)
        link_tree_dof.append(len(tree_dof_to_dof))
    _check_couplings(builder, dof_to_tree_dof, dof_start)
    in_tree = {link.joint for link in links}
    loop_joint: list[int] = []
    loop_row: list[int] = [0]
    rows: list[Row] = []
    row_dof: list[int] = []
    paths: list[EffortRoute] = []
    distance_dof: list[tuple[int, int]] = []
    rotation_rows: list[int] = []
    single = _single_tree_dofs(links, link_tree_dof)
    for joint, spec in enumerate(builder.joints):
        along = single.get(frozenset((spec.parent, spec.child)))
        here = joint_routes(spec.type, spec.dofs, in_tree=joint in in_tree, along_tree_dof=along is not None)
        paths += here
        if spec.type == JointType.COMBINATION:
            continue  # its rows are those of its sum
        if along is not None and EffortRoute.DISTANCE in here:
            distance_dof.append((dof_start[joint], along))
        elif joint not in in_tree or EffortRoute.ROW in here:
            fixed = () if joint in in_tree else ELEMENTS[spec.type].rows
            soft = [local for local, path in enumerate(here) if path is EffortRoute.ROW]
            rows += [*fixed, *(ELEMENTS[spec.type].dofs[local] for local in soft)]
            row_dof += [-1] * len(fixed) + [dof_start[joint] + local for local in soft]
            if fixed or soft:
                start = ROTATION_START.get(spec.type, len(spec.dofs))
                loop_joint.append(joint)
                loop_row.append(len(rows))
                rotation_rows.append(sum(local >= start for local in soft))
    dofs = [dof for spec in builder.joints for dof in spec.dofs]
    boxes = [(index, kind) for index, dof in enumerate(dofs) for kind in box_constraint_kinds(dof)]
    return Tables(
        links, link_tree_dof, tree_dof_to_dof, tree_dof_link, dof_to_tree_dof, loop_joint, loop_row,
        rotation_rows, rows, row_dof, paths, distance_dof, boxes, meshes,
    )  # fmt: skip


def _single_tree_dofs(links: list[Link], link_tree_dof: list[int]) -> dict[frozenset[int], int]:
    """Pairs of bodies that a tree joint of one degree of freedom ties, and its tree degree of freedom."""
    tree_dofs = {}
    for index, link in enumerate(links):
        if link.body >= 0 and link.joint >= 0 and link_tree_dof[index + 1] - link_tree_dof[index] == 1:
            parent = WORLD if link.parent < 0 else links[link.parent].body
            tree_dofs[frozenset((link.body, parent))] = link_tree_dof[index]
    return tree_dofs


def collect_tables(builder: Specification) -> tuple[list[Table], IntArray]:
    """All tables of the model, and their indices per degree of freedom (dofs, 4): spring, damper, motion, and that of
    a damper map, which gives for each coordinate the index of its own table of forces over rates.
    """
    tables: list[Table] = []
    index = np.full((builder.dof_count, 4), -1, np.int32)
    dofs = [dof for joint in builder.joints for dof in joint.dofs]
    for row, dof in enumerate(dofs):
        motion = dof.drive.table if isinstance(dof.drive, PrescribedPosition | PrescribedSpeed) else None
        for column, table in enumerate((dof.spring_table, dof.damper_table, motion)):
            if table is not None:
                index[row, column] = len(tables)
                tables.append(table)
        if dof.damper_map is not None:
            places, rates, forces = dof.damper_map
            columns = [(rates, [forces_at[place] for forces_at in forces]) for place in range(len(places))]
            index[row, 3] = len(tables)
            tables.append((places, [len(tables) + 1.0 + place for place in range(len(places))]))
            tables += columns
    return tables, index


def _dof_starts(builder: Specification) -> list[int]:
    starts, total = [], 0
    for joint in builder.joints:
        starts.append(total)
        total += len(ELEMENTS[joint.type].dofs)
    return starts


def root_of(parents: list[int], node: int) -> int:
    """The root of a node in a forest of disjoint sets, a parent for each node; the way there is halved (Tarjan)."""
    while parents[node] != node:
        parents[node] = parents[parents[node]]
        node = parents[node]
    return node


def _spanning_tree(builder: Specification, dof_start: list[int], coupled: set[int]) -> set[int]:
    """Joints of a maximum spanning forest (Kruskal); ties keep the order in which joints were added."""

    def weight(joint: int) -> tuple[int, int]:
        spec = builder.joints[joint]
        count = len(spec.dofs)
        is_coupled = any(dof_start[joint] + local in coupled for local in range(count))
        efforts = sum(has_effort(dof) for dof in spec.dofs)
        ends = [builder.bodies[body] for body in (spec.parent, spec.child) if body != WORLD]
        whole = spec.type is JointType.ELASTIC  # there is no row for it
        needed = any(body.is_massless for body in ends)  # such a body only has the inertia of what hangs on it
        return (100_000 * whole + 10_000 * needed + 100 * is_coupled + len(ELEMENTS[spec.type].rows) + efforts, -joint)

    group = list(range(len(builder.bodies) + 1))  # the last is the world

    nodes = _mesh_nodes(builder)
    eligible = [
        j
        for j, spec in enumerate(builder.joints)
        if ELEMENTS[spec.type].tree and spec.type != JointType.SHAFT and not spec.closes_loop
        and not nodes & {spec.parent, spec.child}
    ]  # fmt: skip
    tree: set[int] = set()
    for joint in sorted(eligible, key=weight, reverse=True):
        a, b = root_of(group, builder.joints[joint].parent), root_of(group, builder.joints[joint].child)
        if a != b:
            group[a] = b
            tree.add(joint)
    return tree


def _mesh_nodes(builder: Specification) -> set[int]:
    """Bodies that are nodes of meshes."""
    return {mesh.bodies[node] for mesh in builder.flexible_meshes for node in mesh.nodes}


def _ordered_links(builder: Specification, tree: set[int], meshes: MeshColumns | None) -> list[Link]:
    """Links in breadth-first order from the world, then from the heaviest body of every floating tree, then shafts,
    then nodes of meshes in the reverse of the order of their elimination.
    """
    nodes = _mesh_nodes(builder)
    neighbours: dict[int, list[tuple[int, int, float]]] = {body: [] for body in range(-1, len(builder.bodies))}
    for joint in sorted(tree):
        spec = builder.joints[joint]
        neighbours[spec.parent].append((joint, spec.child, 1.0))
        neighbours[spec.child].append((joint, spec.parent, -1.0))
    links: list[Link] = []
    placed: dict[int, int] = {WORLD: -1}

    def grow(frontier: list[int]) -> None:
        while frontier:
            following = []
            for body in frontier:
                for joint, other, sign in neighbours[body]:
                    if other not in placed:
                        placed[other] = len(links)
                        links.append(Link(other, placed[body], joint, builder.joints[joint].type, sign))
                        following.append(other)
            frontier = following

    grow([WORLD])
    for body in sorted(range(len(builder.bodies)), key=lambda index: (-builder.bodies[index].mass, index)):
        if body not in placed and body not in nodes and not builder.bodies[body].posed:
            placed[body] = len(links)
            links.append(Link(body, -1, -1, JointType.FREE, 1.0))
            grow([body])
    for joint, spec in enumerate(builder.joints):
        if spec.type == JointType.SHAFT:
            links.append(Link(-1, -1, joint, JointType.SHAFT, 1.0))
    if meshes is not None:
        parents = meshes.parents(len(links), placed)
        links += [
            Link(body, parent, -1, JointType.FREE, 1.0, is_node=True)
            for body, parent in zip(meshes.link_bodies(), parents, strict=True)
        ]
    return links


def _check_elastic(builder: Specification, tree: set[int]) -> None:
    """Elastic joints are parts of the tree: there are no rows for them."""
    for joint, spec in enumerate(builder.joints):
        if spec.type is JointType.ELASTIC and joint not in tree:
            raise ModelError(
                f"joint '{spec.name}': is ELASTIC and closes a ring of elastic joints, which needs a row; split a body "
                "of the ring in two halves and fix them to each other (add_joint_fixed)"
            )


def _check_node_joints(builder: Specification) -> None:
    """Joints at nodes of meshes hold points: a node has no rotation."""
    nodes = _mesh_nodes(builder)
    for spec in builder.joints:
        if nodes & {spec.parent, spec.child} and (
            spec.type not in POINT_JOINTS or any(has_effort(dof) for dof in spec.dofs if spec.type in ROTATION_START)
        ):
            raise ModelError(
                f"joint '{spec.name}': ties a node of a mesh, which has no rotation, got {spec.type.name}; use "
                "SPHERICAL or DISTANCE without efforts on rotations, or glue the mesh"
            )
        for body, frame in ((spec.parent, spec.frame0), (spec.child, spec.frame1)):
            away = float(np.linalg.norm(frame.position))
            if body in nodes and away > AT_NODE:
                raise ModelError(
                    f"joint '{spec.name}': its anchor must be at the node of a mesh that it holds, got {away:.3g} m "
                    f"away; put it where body '{builder.bodies[body].name}' is"
                )


def _check_massless(builder: Specification, links: list[Link]) -> None:
    """Massless bodies are carried by joints of the tree and carry a body with mass; nothing else touches them."""
    in_tree, carrying = {link.joint for link in links}, {link.parent for link in links}
    remedy = "give it mass, or tie the bodies directly"
    for index, link in enumerate(links):
        if link.body < 0 or not builder.bodies[link.body].is_massless:
            continue
        thing = f"body '{builder.bodies[link.body].name}'"
        if link.joint < 0 or link.type == JointType.FREE or index not in carrying:
            raise ModelError(
                f"{thing}: a massless body must hang on a joint and carry a body with mass, "
                f"but it {'floats' if link.type == JointType.FREE else 'carries none'}; {remedy}"
            )
        for joint, spec in enumerate(builder.joints):
            if link.body in (spec.parent, spec.child) and joint not in in_tree:
                raise ModelError(f"{thing}: is massless, but joint '{spec.name}' closes a loop at it; {remedy}")
        if any(shape.body == link.body for shape in builder.shapes):
            raise ModelError(f"{thing}: a massless body must have no shape; put it on a body with mass")


def _check_posed(builder: Specification) -> None:
    """Bodies that are posed are touched by nothing: the step has no link for them."""
    posed = {index for index, body in enumerate(builder.bodies) if body.posed}
    touching = [(f"joint '{each.name}'", {each.parent, each.child}) for each in builder.joints]
    touching += [(f"shape '{each.name}'", {each.body}) for each in builder.shapes]
    touching += [(f"mesh '{each.name}'", set(each.bodies)) for each in builder.flexible_meshes]
    for thing, bodies in touching:
        for body in posed & bodies:
            raise ModelError(
                f"{thing}: its bodies must be moved by the step, but '{builder.bodies[body].name}' is posed; "
                "add it without posed=True"
            )


def _check_couplings(builder: Specification, dof_to_tree_dof: list[int], dof_start: list[int]) -> None:
    owner = dof_joints(builder)
    for coupling in all_sums(builder):
        thing = f"{'coupling' if coupling.dof < 0 else 'combination'} '{coupling.name}'"
        for dof, _ in coupling.terms:
            spec: JointSpec = builder.joints[owner[dof]]
            if spec.type is JointType.ELASTIC:
                raise ModelError(
                    f"{thing}: joint '{spec.name}' is ELASTIC, whose coordinates are strains; couple joints at the ends"
                )
            if spec.type in ROTATION_START:
                raise ModelError(
                    f"{thing}: joint '{spec.name}' is {spec.type.name}, whose angles are no "
                    "integrable coordinates; couple revolute, prismatic, cylindrical, universal or planar joints"
                )
            if coupling.dof >= 0 and spec.type == JointType.RELATIVE_ROTATION:
                raise ModelError(
                    f"{thing}: joint '{spec.name}' is a RELATIVE_ROTATION, which only couplings take; "
                    "name the joints between its bodies"
                )
            if dof_to_tree_dof[dof] < 0 and spec.type != JointType.RELATIVE_ROTATION:
                raise ModelError(
                    f"{thing}: joint '{spec.name}' closes a loop of coupled joints; couple another joint of that loop"
                )
