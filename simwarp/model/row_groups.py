"""Groups of trees that bilateral rows tie together: each is a system of equations of its own.

Vehicles that stand in one world share no joint. Their rows are ordered group by group, so that kernels factorise and
solve one block after the other, and everything grows by the number of vehicles instead of its square or cube. Groups,
and trees that no row reaches, are the units that contacts join to islands (`simwarp/kernels/cones/islands.py`).
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from simwarp.core.types import JointType
from simwarp.kernels.dynamics.dense_rows import padded
from simwarp.model.specifications import Specification
from simwarp.model.topology import Tables, dof_joints, root_of


@dataclasses.dataclass(frozen=True)
class RowGroups:
    """Rows in the order in which kernels keep them, and the group of each link.

    A row is told by its place among all responses as `row_paths` gives them: rows of loop joints, then sums. A world
    with one group keeps that order.

    Attributes:
        place: of every response, in the new order. Those without a row (combinations without a law) stay at the end.
        row_start: CSR over groups, of rows.
        factor_start: CSR over groups, where the factor of each stands.
        columns: tree degrees of freedom of each group.
        link_group: group of each link, -1 where no row reaches.
        link_column: of each link, its first tree degree of freedom minus that among those of its group.
        link_unit: of each link, the trees that rows tie to its own, in the order of their first links; a tree that no
            row reaches is a unit of its own. -1: it cannot move.
    """

    place: list[int]
    row_start: list[int]
    factor_start: list[int]
    columns: list[int]
    link_group: list[int]
    link_column: list[int]
    link_unit: list[int]

    @property
    def unit_count(self) -> int:
        """Parts of a world that move on their own until a contact joins them."""
        return max(self.link_unit, default=-1) + 1

    @property
    def row_counts(self) -> list[int]:
        """Rows of each group."""
        return [end - first for first, end in zip(self.row_start, self.row_start[1:], strict=False)]

    @property
    def max_columns(self) -> int:
        """Tree degrees of freedom of the largest group."""
        return max(self.columns, default=0)

    @property
    def response_room(self) -> int:
        """Numbers that the responses of one group take, column by column."""
        pairs = zip(self.columns, self.row_counts, strict=True)
        return max((columns * padded(rows) for columns, rows in pairs), default=0)

    def share_width(self, meet: bool) -> int:
        """Most bilateral rows that one block of the cone problem sees.

        Args:
            meet: whether a block can act on two groups, as a contact between them does.
        """
        return sum(sorted(self.row_counts, reverse=True)[: 2 if meet else 1])


def group_rows(paths: list[list[int]], tables: Tables) -> RowGroups:
    """Group the rows of a model.

    Args:
        paths: tree degrees of freedom that each response moves (`row_paths`).
        tables: of the model.
    """
    row_count = len(paths) - tables.silent_count
    roots = _moving_roots(tables)
    merged = list(range(len(tables.links)))
    touched = [sorted({roots[tables.tree_dof_link[dof]] for dof in path}) for path in paths]
    for trees in touched:
        for other in trees[1:]:
            merged[root_of(merged, other)] = root_of(merged, trees[0])
    number: dict[int, int] = {}
    found = [number.setdefault(root_of(merged, trees[0]), len(number)) if trees else -1 for trees in touched]
    response_group = _with_motionless(found)
    count = max(len(number), 1) if paths else 0
    order = sorted(range(row_count), key=lambda row: response_group[row])  # keeps the order within a group
    place = list(range(len(paths)))
    for position, row in enumerate(order):
        place[row] = position
    sizes = [response_group[:row_count].count(group) for group in range(count)]
    link_group = [number.get(root_of(merged, root), -1) if root >= 0 else -1 for root in roots]
    columns = [0] * count
    link_column = [0] * len(roots)
    for link, group in enumerate(link_group):
        if group >= 0:
            first, end = tables.link_tree_dof[link], tables.link_tree_dof[link + 1]
            link_column[link] = first - columns[group]
            columns[group] += end - first
    unit: dict[int, int] = {}
    link_unit = [unit.setdefault(root_of(merged, root), len(unit)) if root >= 0 else -1 for root in roots]
    factor_start = _sums([size * padded(size) for size in sizes])
    return RowGroups(place, _sums(sizes), factor_start, columns, link_group, link_column, link_unit)


def groups_meet(builder: Specification, tables: Tables, groups: RowGroups, pairs: npt.NDArray[np.int32]) -> bool:
    """Whether a block of the cone problem can act on two groups: a contact, or the bounds of a loop joint.

    Args:
        builder: of the model.
        tables: of the model.
        groups: of its rows.
        pairs: (n, 2), shapes that may touch.
    """
    if len(groups.columns) < 2:
        return False
    of_body = np.full(len(builder.bodies) + 1, -1)  # the last is the world (-1)
    for index, link in enumerate(tables.links):
        if link.body >= 0:
            of_body[link.body] = groups.link_group[index]
    owner = dof_joints(builder)
    bounded = [builder.joints[owner[dof]] for dof, _ in tables.boxes if tables.dof_to_tree_dof[dof] < 0]
    ends = [(joint.parent, joint.child) for joint in bounded if joint.type != JointType.COMBINATION]
    shapes = np.array([shape.body for shape in builder.shapes], int)
    of_ends = of_body[np.vstack([shapes[pairs].reshape(-1, 2), np.array(ends, int).reshape(-1, 2)])]
    return bool(np.any((of_ends[:, 0] != of_ends[:, 1]) & (of_ends >= 0).all(axis=1)))


def _moving_roots(tables: Tables) -> list[int]:
    """Of each link, the first link with a degree of freedom on the way from the world to it; -1: it cannot move."""
    roots: list[int] = []
    for index, link in enumerate(tables.links):
        above = roots[link.parent] if link.parent >= 0 else -1
        moves = tables.link_tree_dof[index + 1] > tables.link_tree_dof[index]
        roots.append(above if above >= 0 else index if moves else -1)
    return roots


def _with_motionless(groups: list[int]) -> list[int]:
    """Groups of responses, where those that nothing moves (-1) join what stands before them, or the first."""
    filled: list[int] = []
    for group in groups:
        filled.append(group if group >= 0 else filled[-1] if filled else 0)
    return filled


def _sums(sizes: list[int]) -> list[int]:
    """Start of each part, and the end."""
    starts = [0]
    for size in sizes:
        starts.append(starts[-1] + size)
    return starts
