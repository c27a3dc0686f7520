"""What factoring a mesh's matrix needs and its numbers do not change: an order of its nodes, where its factor has
blocks, where each update goes, which elements add to which block. Found once for each mesh.

The matrix is symmetric and positive definite, with blocks of 3 x 3, one for each pair of nodes that share an element.
"""

from __future__ import annotations

import dataclasses
import heapq
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int32]


@dataclasses.dataclass(frozen=True)
class BlockStructure:
    """The factor of a mesh's matrix: L with A = L Lᵀ, nodes in the order of elimination, which are called columns.

    Blocks are numbered: first those on the diagonal, then those below it, column by column, rows ascending.

    Attributes:
        order: (n,) node of each column.
        parent: (n,) elimination tree: the column that each one updates first; -1 for a root.
        column_start: (n + 1,) where each column begins among the blocks below the diagonal.
        block_row: (m,) row of each block below the diagonal.
        target_start: (n + 1,) where the updates of each column begin.
        target: (u,) block that an update goes to: for each block of a column, those of its rows and of all below.
        term_start: (n + m + 1,) where the terms of each block begin.
        term: (t,) place among all elements' blocks (`element_blocks`) times 2, and 1 where it is added transposed.
        share_start: (n + 1,) where the shares of each column's vector begin.
        share: (s,) place among all elements' nodes.
    """

    order: Ints
    parent: Ints
    column_start: Ints
    block_row: Ints
    target_start: Ints
    target: Ints
    term_start: Ints
    term: Ints
    share_start: Ints
    share: Ints

    @property
    def node_count(self) -> int:
        """Number of nodes, which are columns."""
        return len(self.order)

    @property
    def block_count(self) -> int:
        """Number of blocks of the factor, the diagonal included."""
        return len(self.order) + len(self.block_row)

    @property
    def multiplications(self) -> int:
        """Multiplications and additions of one factorisation, an update of 3 x 3 counted as 27."""
        return 27 * len(self.target) + 18 * len(self.block_row) + 10 * len(self.order)

    @property
    def depth(self) -> int:
        """Columns of the longest way to a root of the elimination tree."""
        depth = np.zeros(self.node_count, dtype=int)
        for column in reversed(range(self.node_count)):
            if self.parent[column] >= 0:
                depth[column] = depth[self.parent[column]] + 1
        return int(depth.max(initial=-1)) + 1


def element_blocks(nodes: int) -> list[tuple[int, int]]:
    """Pairs (row, column) of an element's nodes, row not below column, in the order in which its blocks are stored."""
    return [(row, column) for row in range(nodes) for column in range(row + 1)]


def analyse(
    node_count: int, elements: Sequence[Sequence[int]], last: Sequence[int] = (),
    pairs: Sequence[tuple[int, int]] = (),
) -> BlockStructure:  # fmt: skip
    """Find the structure of a mesh's matrix and of its factor.

    Args:
        node_count: nodes that are unknowns.
        elements: nodes of each element; negative for what is no unknown. Their blocks and shares come in this order.
        last: nodes that are eliminated after all others, in this order, or not at all.
        pairs: of nodes that have further blocks, whose places follow those of the elements: the row, which is one of
            `last`, and the column, which is another one or comes before it.
    """
    neighbours = _neighbours(node_count, [*elements, *pairs])
    order, rows = _minimum_degree(neighbours, last)
    order, rows = _postordered(order, rows, set(last))
    place = np.empty(node_count, dtype=np.int64)
    place[order] = np.arange(node_count)
    columns = [sorted(int(place[node]) for node in each) for each in rows]
    column_start = np.cumsum([0, *(len(each) for each in columns)])
    block_of = {(column, column): column for column in range(node_count)}
    for column, each in enumerate(columns):
        block_of.update({(row, column): node_count + column_start[column] + k for k, row in enumerate(each)})
    targets = _targets(columns, node_count + column_start)
    target_start = np.cumsum([0, *(len(each) * (len(each) + 1) // 2 for each in columns)])
    terms, shares = _terms(elements, place, block_of)
    first = sum(len(each) * (len(each) + 1) // 2 for each in elements)
    for index, (row, column) in enumerate(pairs):
        terms[block_of[int(place[row]), int(place[column])]].append(2 * (first + index))
    numbers = (
        order, [each[0] if each else -1 for each in columns], column_start, [row for each in columns for row in each],
        target_start, targets, *_joined(terms), *_joined(shares),
    )  # fmt: skip
    return BlockStructure(*(np.asarray(each, dtype=np.int32) for each in numbers))


def _targets(columns: Sequence[Sequence[int]], first_block: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Blocks that each column updates: of the rows of its own blocks, all pairs, column by column."""
    rows = [np.asarray(each, dtype=np.int64) for each in columns]
    found = [np.zeros(0, dtype=np.int64)]
    for each in rows:
        for k, column in enumerate(each.tolist()):
            # rows of a column are among those of the columns that it updates
            found += [each[k : k + 1], first_block[column] + np.searchsorted(rows[column], each[k + 1 :])]
    return np.concatenate(found)


def _neighbours(node_count: int, elements: Sequence[Sequence[int]]) -> list[set[int]]:
    """Nodes that share an element with each node."""
    found: list[set[int]] = [set() for _ in range(node_count)]
    for element in elements:
        members = [node for node in element if node >= 0]
        for node in members:
            found[node].update(members)
    for node, each in enumerate(found):
        each.discard(node)
    return found


def _minimum_degree(neighbours: list[set[int]], last: Sequence[int]) -> tuple[list[int], list[set[int]]]:
    """Order of elimination, and for each node of it those of which it has a block below the diagonal.

    The node with fewest neighbours goes first (Tinney and Walker 1967); these then are neighbours of one another.
    """
    graph = [set(each) for each in neighbours]
    waits = {node: len(graph) + k for k, node in enumerate(last)}
    queue = [(waits.get(node, 0), len(each), node) for node, each in enumerate(graph)]
    heapq.heapify(queue)
    order: list[int] = []
    rows: list[set[int]] = []
    done = [False] * len(graph)
    while queue:
        _, degree, node = heapq.heappop(queue)
        if done[node] or degree != len(graph[node]):
            continue
        done[node] = True
        order.append(node)
        rows.append(graph[node])
        for other in graph[node]:
            graph[other] |= graph[node]
            graph[other] -= {other, node}
            heapq.heappush(queue, (waits.get(other, 0), len(graph[other]), other))
    return order, rows


def _postordered(order: list[int], rows: list[set[int]], last: set[int]) -> tuple[list[int], list[set[int]]]:
    """The same elimination with every subtree in a row, so that what a column updates was written shortly before; the
    `last` ones stay behind all others.
    """
    place = {node: k for k, node in enumerate(order)}
    parent = [min((place[node] for node in each), default=-1) for each in rows]
    children: list[list[int]] = [[] for _ in order]
    roots: list[int] = []
    for column, above in enumerate(parent):
        (roots if above < 0 else children[above]).append(column)
    sequence: list[int] = []
    stack = roots
    while stack:
        column = stack.pop()
        sequence.append(column)
        stack.extend(children[column])
    sequence.reverse()
    sequence = [c for c in sequence if order[c] not in last] + [c for c in range(len(order)) if order[c] in last]
    return [order[column] for column in sequence], [rows[column] for column in sequence]


def _terms(
    elements: Sequence[Sequence[int]], place: npt.NDArray[np.int64], block_of: dict[tuple[int, int], int]
) -> tuple[list[list[int]], list[list[int]]]:
    """Terms of each block and shares of each column, in the order of elements: sums come out the same everywhere."""
    terms: list[list[int]] = [[] for _ in block_of]
    shares: list[list[int]] = [[] for _ in place]
    term = share = 0
    for element in elements:
        columns = [int(place[node]) if node >= 0 else -1 for node in element]
        for a, b in element_blocks(len(element)):
            if columns[a] >= 0 and columns[b] >= 0:
                block = block_of[max(columns[a], columns[b]), min(columns[a], columns[b])]
                terms[block].append(2 * term + int(columns[a] < columns[b]))
            term += 1
        for column in columns:
            if column >= 0:
                shares[column].append(share)
            share += 1
    return terms, shares


def _joined(lists: list[list[int]]) -> tuple[list[int], list[int]]:
    """Where each list begins, and all of them one after the other."""
    starts = [0]
    for each in lists:
        starts.append(starts[-1] + len(each))
    return starts, [value for each in lists for value in each]
