"""Symbolic analysis of a mesh's stiffness matrix, once per topology: order, supernodes, places of all blocks.

The matrix has a 3 by 3 block per pair of nodes that share an element. Nodes are eliminated in an order of minimum
degree. Columns of L with nearly the same rows form a supernode, which is one dense panel; what a supernode leaves to
its ancestors is a dense update matrix (multifrontal: Duff and Reid 1983, Liu 1992). `mesh_factor_kernels.py` holds the
numbers.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from simwarp.flex.mesh_factor_kernels import FactorTables

LANES = 8
"""Rows that a processor treats together; pitches are multiples of it."""
ZERO_SHARE = 0.2
"""A supernode joins its parent where at most this share of the joined panel is zero."""
SHARED = ("block_panel", "supernodes", "block_start", "row_start", "row", "target", "child_start", "child")
"""Tables that kernels read."""

Ints = NDArray[np.int32]


@dataclasses.dataclass(frozen=True)
class FactorPlan:
    """Tables of the factor L D Lᵀ of one mesh; nodes count in the order of elimination.

    Attributes:
        order: (N,) node of the mesh at each place of the elimination.
        place: (N,) the inverse.
        blocks: (B, 2) row and column of each stored block of the matrix, row ≥ column, supernode by supernode.
        block_panel: (B,) where the first number of a block goes in its supernode's panel.
        supernodes: (S, 7) first column, columns, rows below them (all in nodes), starts of panel and update matrix,
            pitches of both (in numbers).
        block_start: (S + 1,) blocks of each supernode.
        row_start: (S + 1,) rows below of each supernode.
        row: (R,) their nodes.
        target: (R,) their places in the front of the parent.
        child_start: (S + 1,) children of each supernode.
        child: (S - roots,) the children.
        panel_size: numbers of all panels.
        update_size: numbers of the update matrices that live at a time.
        widest: columns [numbers] of the widest supernode.
        work_size: numbers that a factor and substitutions need aside.
    """

    order: Ints
    place: Ints
    blocks: Ints
    block_panel: Ints
    supernodes: Ints
    block_start: Ints
    row_start: Ints
    row: Ints
    target: Ints
    child_start: Ints
    child: Ints
    panel_size: int
    update_size: int
    widest: int
    work_size: int

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return len(self.order)

    @property
    def multiplications(self) -> int:
        """Multiplications and additions of one factor, without padding."""
        total = 0
        for columns, below in 3 * self.supernodes[:, 1:3].astype(np.int64):
            heights = np.arange(below, below + columns, dtype=np.int64)
            total += int(np.sum(heights * (heights + 1) // 2))
        return total


@dataclasses.dataclass
class _Supernode:
    """Columns in the order of elimination, and the rows below them; nodes of the mesh."""

    columns: list[int]
    rows: set[int]
    parent: int = -1


def plan_factor(elements: NDArray[np.integer], node_count: int) -> FactorPlan:
    """Return the tables for a mesh.

    Args:
        elements: (E, n) nodes of each element.
        node_count: of the mesh.
    """
    neighbours: list[set[int]] = [set() for _ in range(node_count)]
    for element in elements.tolist():
        for node in element:
            neighbours[node].update(element)
    for node, others in enumerate(neighbours):
        others.discard(node)
    supernodes = _joined(_fundamental(_eliminated(neighbours)))
    return _tables(supernodes, neighbours)


def make_factor_tables(plan: FactorPlan, device: Any) -> Any:
    """Copy the tables of a plan to a device."""
    tables: Any = FactorTables()
    tables.supernode_count = len(plan.supernodes)
    tables.widest = plan.widest
    for name in SHARED:
        setattr(tables, name, wp.array(getattr(plan, name), dtype=int, device=device))
    return tables


def _eliminated(neighbours: Sequence[set[int]]) -> list[tuple[int, set[int]]]:
    """Eliminate nodes of minimum degree first; return each with its rows of L. Ties: the lower number."""
    graph = [set(others) for others in neighbours]
    left = set(range(len(graph)))
    found = []
    while left:
        node = min(left, key=lambda each: (len(graph[each]), each))
        rows = graph[node]
        for other in rows:
            graph[other] |= rows
            graph[other] -= {node, other}
        left.discard(node)
        found.append((node, rows))
    return found


def _fundamental(columns: Sequence[tuple[int, set[int]]]) -> list[_Supernode]:
    """Return a supernode per column with its parent in the elimination tree."""
    position = {node: index for index, (node, _) in enumerate(columns)}
    return [
        _Supernode([node], set(rows), min((position[row] for row in rows), default=-1)) for node, rows in columns
    ]  # fmt: skip


def _joined(supernodes: list[_Supernode]) -> list[_Supernode]:
    """Join supernodes with their parents where little zero is added; children come before parents in the result."""
    zeros = [0] * len(supernodes)
    children: list[list[int]] = [[] for _ in supernodes]
    for index, each in enumerate(supernodes):
        if each.parent >= 0:
            children[each.parent].append(index)
    for index, each in enumerate(supernodes):
        for child in sorted(children[index], key=lambda one: -len(supernodes[one].rows)):
            other = supernodes[child]
            width, height = len(other.columns), len(each.columns) + len(each.rows)
            added = zeros[child] + zeros[index] + width * (height - len(other.rows))
            columns = width + len(each.columns)
            if added <= ZERO_SHARE * columns * (len(each.rows) + 0.5 * columns):
                each.columns = other.columns + each.columns
                zeros[index] = added
                children[index].remove(child)
                children[index].extend(children[child])
                other.columns = []
    return _in_postorder(supernodes, children)


def _in_postorder(supernodes: list[_Supernode], children: list[list[int]]) -> list[_Supernode]:
    """Return the supernodes that are left, each after its children, with their parents' new numbers."""
    ordered: list[_Supernode] = []
    joined = {child for each in children for child in each}
    stack = [(index, False) for index, each in enumerate(supernodes) if each.columns and index not in joined][::-1]
    number: dict[int, int] = {}
    while stack:
        index, is_done = stack.pop()
        if is_done:
            number[index] = len(ordered)
            ordered.append(supernodes[index])
            for child in children[index]:
                supernodes[child].parent = number[index]
            supernodes[index].parent = -1
        else:
            stack.append((index, True))
            stack.extend((child, False) for child in children[index])
    return ordered


def _tables(supernodes: list[_Supernode], neighbours: Sequence[set[int]]) -> FactorPlan:
    """Number everything."""
    order = np.array([node for each in supernodes for node in each.columns], dtype=np.int32)
    place = np.argsort(order).astype(np.int32)
    rows = [sorted(place[list(each.rows)].tolist()) for each in supernodes]
    table = np.zeros((len(supernodes), 7), dtype=np.int32)
    children: list[list[int]] = [[] for _ in supernodes]
    blocks: list[tuple[int, int]] = []
    block_panel: list[int] = []
    block_counts: list[int] = []
    target: list[int] = []
    column = panel = 0
    for index, each in enumerate(supernodes):
        width, below = len(each.columns), len(rows[index])
        update_pitch = _padded(3 * below)
        pitch = _padded(3 * width + update_pitch)
        table[index] = column, width, below, panel, 0, pitch, update_pitch
        front = {node: local for local, node in enumerate([*range(column, column + width), *rows[index]])}
        block_counts.append(len(blocks))
        for local, node in enumerate(each.columns):
            mine = [column + local, *(place[other] for other in neighbours[node] if place[other] > column + local)]
            for row in sorted(map(int, mine)):
                blocks.append((row, column + local))
                block_panel.append(3 * local * pitch + 3 * front[row])
        column += width
        panel += 3 * width * pitch
        if each.parent >= 0:
            children[each.parent].append(index)
    for index, each in enumerate(supernodes):
        if each.parent >= 0:
            first, width = table[each.parent, :2]
            above = [*range(first, first + width), *rows[each.parent]]
            front = {node: local for local, node in enumerate(above)}
            target.extend(front[row] for row in rows[index])
    update_size, widest = _place_updates(table, children), 3 * int(table[:, 1].max())
    return FactorPlan(
        order=order, place=place, blocks=np.array(blocks, dtype=np.int32),
        block_panel=np.array(block_panel, dtype=np.int32),
        supernodes=table, block_start=np.array([*block_counts, len(blocks)], dtype=np.int32),
        row_start=_starts(map(len, rows)), row=np.array([*itertools.chain(*rows)], dtype=np.int32),
        target=np.array(target, dtype=np.int32), child_start=_starts(map(len, children)),
        child=np.array([*itertools.chain(*children)], dtype=np.int32), panel_size=panel, update_size=update_size,
        widest=widest, work_size=max(4 * widest, int(table[:, 5].max())),
    )  # fmt: skip


def _place_updates(table: Ints, children: Sequence[Sequence[int]]) -> int:
    """Place each update matrix where none is that lives at its time; return the size of all."""
    live: dict[int, tuple[int, int]] = {}
    size = 0
    for index in range(len(table)):
        need, start = 3 * int(table[index, 2]) * int(table[index, 6]), 0
        for begin, end in sorted(live.values()):
            if start + need <= begin:
                break
            start = max(start, end)
        table[index, 4] = start
        size = max(size, start + need)
        for child in children[index]:
            live.pop(child, None)
        if need:
            live[index] = (start, start + need)
    return size


def _starts(counts: Iterable[int]) -> Ints:
    """Cumulated counts, from 0."""
    return np.array([0, *itertools.accumulate(counts)], dtype=np.int32)


def _padded(count: int) -> int:
    """The next multiple of `LANES`."""
    return (count + LANES - 1) // LANES * LANES
