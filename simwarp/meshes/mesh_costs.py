"""What meshes cost, told before anything is made: numbers of their factor, memory, and the time of a step.

The time is that of multiplications, each with an addition: of the factor they are counted, of elements and nodes they
are what the scenes of `simwarp bench` took beside it, contacts included (docs/flexible.md, "Speed").
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import numpy as np

from simwarp.core.object_repr import Readable, Row, bytes_text
from simwarp.core.types import ModelError
from simwarp.kernels.meshes.block_factor import BLOCK
from simwarp.meshes.block_structure import BlockStructure
from simwarp.meshes.mesh_parts import MeshPart

MOST_NODES: Final = 1500
"""Of a mesh, that move by themselves: a factor of more takes tens of milliseconds for each step of each world."""
CORE_SPEED: Final = 1e10
"""Multiplications, each with an addition, that a core makes of a factor in a second."""
ELEMENT_WORK: Final[Mapping[str, float]] = MappingProxyType(
    {"tetrahedra": 5.6e3, "hexahedra": 2.7e4, "triangles": 1.0e4}
)
"""Multiplications of a core's time that strains, forces and matrix of an element take."""
NODE_WORK: Final = 6e3
"""Likewise what a node takes beside: the tree, contacts, its state."""
SCRATCH_BYTES: Final[Mapping[str, int]] = MappingProxyType(
    {
        "mesh_columns": 40, "mesh_factor": 4, "mesh_vector": 4, "mesh_factor_double": 8, "mesh_vector_double": 8,
        "mesh_shares": 12, "mesh_element_blocks": 36, "mesh_points": 36,
    }
)  # fmt: skip
"""Bytes for each of the lengths that meshes add to the scratch of a world (`ScratchSizes`)."""


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class MeshCost(Readable):
    """What meshes of a model cost in each world.

    Attributes:
        nodes: that move by themselves.
        elements: number of each kind, "tetrahedra", "hexahedra" or "triangles".
        factor_numbers: of the factor's lower triangle that are not zero.
        multiplications: of a factorisation, each with an addition.
        scratch_bytes: that a step works in, of each world of a GPU and of each thread of a CPU.
    """

    nodes: int
    elements: Mapping[str, int]
    factor_numbers: int
    multiplications: int
    scratch_bytes: int

    @property
    def milliseconds(self) -> float:
        """Time of a core for a step of one world, by count of operations: right within a factor of two [ms]."""
        return milliseconds_of(self.multiplications, self.nodes, self.elements)

    @property
    def summary(self) -> str:
        """Number of nodes and time of a step in words; empty without nodes."""
        if not self.nodes:
            return ""
        return f"{self.nodes} nodes, some {self.milliseconds:.2g} ms of a core for a step of a world"

    def _readable_title(self) -> str:
        return f": some {self.milliseconds:.2g} ms of a core for a step of a world"

    def _readable_rows(self) -> Mapping[str, Row]:
        return {
            "nodes": f"{self.nodes:,} that move",
            "elements": ", ".join(f"{count:,} {kind}" for kind, count in self.elements.items()),
            "factor": f"{self.factor_numbers:,} numbers, {self.multiplications / 1e6:.2g} million multiplications",
            "memory": f"{bytes_text(self.scratch_bytes)} for a world",
        }


def milliseconds_of(multiplications: float, nodes: int, elements: Mapping[str, int]) -> float:
    """Time of a core for a step of a world whose factor takes so many multiplications [ms]."""
    work = multiplications + NODE_WORK * nodes + sum(ELEMENT_WORK[kind] * count for kind, count in elements.items())
    return 1e3 * work / CORE_SPEED


def counted_elements(parts: Sequence[MeshPart]) -> dict[str, int]:
    """Number of elements of each kind."""
    found: dict[str, int] = {}
    for part in parts:
        found[part.kind] = found.get(part.kind, 0) + len(part.elements)
    return found


def cost_of(structure: BlockStructure, nodes: int, parts: Sequence[MeshPart], sizes: Mapping[str, int]) -> MeshCost:
    """The cost of meshes whose matrix has this structure.

    Args:
        structure: of the matrix, with columns of the bodies that nodes are glued to.
        nodes: that move by themselves.
        parts: elements.
        sizes: lengths of their scratch, by the names of `SCRATCH_BYTES`.
    """
    return MeshCost(
        nodes=nodes, elements=MappingProxyType(counted_elements(parts)),
        factor_numbers=6 * structure.node_count + 9 * len(structure.block_row),
        multiplications=structure.multiplications,
        scratch_bytes=sum(SCRATCH_BYTES[name] * length for name, length in sizes.items()),
    )  # fmt: skip


def check_cost(label: str, nodes: int, parts: Sequence[MeshPart]) -> None:
    """Refuse what no factor serves; its cost grows as that of cubes of hexahedra and of square sheets was counted.

    Raises:
        ModelError: too many nodes move.
    """
    if nodes <= MOST_NODES:
        return
    elements = counted_elements(parts)
    is_solid = set(elements) != {"triangles"}
    multiplications, blocks = estimated_factor(nodes, is_solid)
    milliseconds, size = milliseconds_of(multiplications, nodes, elements), 4.0 * BLOCK * blocks / 2**20
    raise ModelError(
        f"{label}: nodes that move must be at most {MOST_NODES}, got {nodes}: a step of a world would take some "
        f"{milliseconds:.0f} ms of a core, its factor {size:.0f} MiB; use a coarser mesh"
    )


def estimated_factor(nodes: int, is_solid: bool) -> tuple[float, float]:
    """Multiplications of a factorisation and blocks of the factor of some thousand nodes, not counted."""
    if is_solid:
        return 175.0 * nodes**2, 2.85 * nodes**1.5
    return 1200.0 * nodes**1.5, 4.8 * nodes * float(np.log2(nodes))
