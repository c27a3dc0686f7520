"""Surfaces of flexible meshes in a scene: trees of their triangles in every world, refitted when somebody looks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.geometry.triangle_tree import LEAF_WORDS, NODE_WORDS, WIDTH, WideTree, build_tree
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.rays.wide_tree import Trees
from simwarp.meshes.mesh_specification import FlexibleMesh
from simwarp.model.model import Model
from simwarp.sensors.deforming_surfaces_kernels import (
    SurfaceTables,
    place_vertices,
    refit_leaves,
    refit_nodes,
)
from simwarp.simulation.attachments import StepContext
from simwarp.simulation.state import State

Ints: TypeAlias = npt.NDArray[np.int32]


class DeformingSurfaces:
    """Surfaces of some flexible meshes of a model, each with a tree per world behind those that a scene has.

    Args:
        model: with its meshes.
        meshes: numbers of those that are seen.
        trees: of the scene's other meshes.

    Attributes:
        trees: those, then of each surface in turn one per world.
        first_tree: number of the first surface's tree in world 0.
        vertex_start: (S + 1,) where the vertices of each begin among those of all.
    """

    def __init__(self, model: Model, meshes: Sequence[int], trees: Trees) -> None:
        self._model = model
        every = model.builder.flexible_meshes
        chosen = [every[number] for number in meshes]
        made = [
            build_tree(mesh.surface.vertices(mesh.points) - mesh.points[mesh.nodes[0]], mesh.surface.triangles)
            for mesh in chosen
        ]
        self.first_tree = trees.node_start.shape[0] - 1
        self.trees = _extended(trees, made, model.world_count, model.device)
        first_node = np.cumsum([0, *(len(mesh.points) for mesh in every)])
        self._tables = _surface_tables(chosen, [int(first_node[number]) for number in meshes], made, model.device)
        self._tables.first_tree, self._tables.worlds = self.first_tree, model.world_count
        counts = [len(mesh.surface.nodes) for mesh in chosen]
        self.vertex_start = np.cumsum([0, *counts])
        self._vertex: Any = wp.zeros((model.world_count, sum(counts)), dtype=wp.vec3, device=model.device)
        # a launch on a CPU is serial: a world that is not due costs one thread
        every_one = sum(counts), self._tables.leaf_surface.shape[0], len(chosen)
        self._threads = every_one if model.device.is_cuda else (1, 1, 1)

    def tree(self, surface: int) -> int:
        """Number of a surface's tree in world 0, by its place among those that are seen; other worlds' follow."""
        return self.first_tree + surface * self._model.world_count

    def record(self, simulation: StepContext, due: wp.array) -> list[Any]:
        """Recorded launches that bring the surfaces to the present state in the worlds that are due, (W,) int32."""
        return [
            simulation.shares.record(kernel, threads, inputs=inputs, outputs=[output])
            for kernel, threads, inputs, output in self._launches(simulation.state, due)
        ]

    def follow(self, state: State, due: wp.array) -> None:
        """Brings the surfaces to a state in the worlds that are due, (W,) int32."""
        for command in self._launches(state, due):
            self._launch(command)

    def vertices(self, state: State, worlds: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
        """(S, V, 3) vertices of all surfaces in these worlds, from the body that carries each, as they are now [m].

        Those of a surface begin at its `vertex_start`.
        """
        device, count = self._model.device, self._model.world_count
        due: wp.array = wp.array(np.isin(np.arange(count), worlds).astype(np.int32), dtype=int, device=device)
        self._launch(self._launches(state, due)[0])
        rows: list[Any] = [wp.array(worlds.astype(np.int32), dtype=int, device=device), None]
        found: npt.NDArray[np.float32] = wp.indexedarray(self._vertex, rows).contiguous().numpy()
        return found

    def _launch(self, command: tuple[Any, int, list[Any], Any]) -> None:
        kernel, threads, inputs, output = command
        model = self._model
        wp.launch(
            kernel, dim=(model.world_count, threads), device=model.device, inputs=[WorldRange(), *inputs],
            outputs=[output],
        )  # fmt: skip

    def _launches(self, state: State, due: wp.array) -> list[tuple[Any, int, list[Any], Any]]:
        """Kernels, threads of a world, inputs after the range of worlds, output."""
        tables, glue = self._tables, self._model.mesh_tables.glue
        vertices, leaves, trees = self._threads
        return [
            (place_vertices, vertices, [vertices, due, tables, glue, state.arrays], self._vertex),
            (refit_leaves, leaves, [leaves, due, tables, self._vertex], self.trees),
            (refit_nodes, trees, [trees, due, tables], self.trees),
        ]


def _extended(trees: Trees, made: Sequence[WideTree], worlds: int, device: Any) -> Trees:
    """Trees, and behind them those of surfaces, of each one per world: as at rest."""
    found = Trees()
    for name, width, start in (("node", NODE_WORDS, "node_start"), ("leaf", LEAF_WORDS, "leaf_start")):
        before = getattr(trees, name)
        blocks = [tree.nodes if name == "node" else tree.leaves for tree in made]
        rows = np.repeat([len(block) for block in blocks], worlds)
        given = getattr(trees, start).numpy()
        starts = np.concatenate([given, given[-1] + np.cumsum(rows)]).astype(np.int32)
        words: Any = wp.zeros(int(starts[-1]) * width, dtype=float, device=device)
        wp.copy(words, before, count=before.size)
        place = before.size
        for block in blocks:
            words_of: Any = wp.array(block.reshape(-1), dtype=float, device=device)
            for _ in range(worlds):
                wp.copy(words, words_of, dest_offset=place)
                place += block.size
        setattr(found, name, words)
        setattr(found, start, wp.array(starts, dtype=int, device=device))
    for name in ("lower", "upper"):
        rows = np.repeat(np.array([getattr(tree, name) for tree in made], np.float32), worlds, axis=0)
        bounds = np.concatenate([getattr(trees, name).numpy().reshape(-1, 3), rows])
        setattr(found, name, wp.array(bounds, dtype=wp.vec3, device=device))
    return found


def _surface_tables(
    meshes: Sequence[FlexibleMesh], first_node: Sequence[int], made: Sequence[WideTree], device: Any
) -> SurfaceTables:
    """What the kernels need of surfaces and their trees."""
    tables: Any = SurfaceTables()

    def array(values: Any, dtype: Any = int) -> Any:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)

    surfaces = [mesh.surface for mesh in meshes]
    counts = [len(surface.nodes) for surface in surfaces]
    width = max(surface.nodes.shape[1] for surface in surfaces)
    node = np.zeros((sum(counts), width), np.int32)
    weight = np.zeros((sum(counts), width))
    corners: list[Ints] = []
    leaf_slots: list[Ints] = []
    node_slots: list[Ints] = []
    start = 0
    for surface, first, tree in zip(surfaces, first_node, made, strict=True):
        rows = slice(start, start + len(surface.nodes))
        node[rows, : surface.nodes.shape[1]] = surface.nodes + first
        weight[rows, : surface.nodes.shape[1]] = surface.weights
        corners.append(_corners(tree, surface.triangles, start))
        for slots, found in zip((node_slots, leaf_slots), _slots(tree), strict=True):
            slots.append(found)
        start = rows.stop
    tables.carrier = array([mesh.bodies[mesh.nodes[0]] for mesh in meshes])
    tables.size = array([np.ptp(mesh.points, axis=0).max() for mesh in meshes], float)
    tables.vertex_node, tables.vertex_weight = array(node), array(weight, wp.float64)
    tables.vertex_surface = array(np.repeat(np.arange(len(meshes)), counts))
    tables.leaf_corner = array(np.concatenate(corners))
    tables.leaf_surface = array(np.repeat(np.arange(len(meshes)), [len(each) for each in leaf_slots]))
    tables.leaf_start = array(np.cumsum([0, *(len(each) for each in leaf_slots)]))
    tables.node_start = array(np.cumsum([0, *(len(each) for each in node_slots)]))
    tables.leaf_slot, tables.node_slot = array(np.concatenate(leaf_slots)), array(np.concatenate(node_slots))
    found_tables: SurfaceTables = tables
    return found_tables


def _corners(tree: WideTree, triangles: Ints, first: int) -> Ints:
    """(L, 24) vertices of the triangles of leaves, counted from `first`; -1 in empty places."""
    words = tree.leaves.reshape(-1, 10, WIDTH)
    used = (words[:, 3:9] != 0.0).any(axis=1)
    corners = triangles[np.ascontiguousarray(words[:, 9]).view(np.int32)] + first
    return np.where(used[:, None], corners.transpose(0, 2, 1), -1).reshape(-1, 3 * WIDTH).astype(np.int32)


def _slots(tree: WideTree) -> tuple[Ints, Ints]:
    """Where the boxes of nodes, and of leaves, are: 8 x node + place; -1 for the root."""
    words = tree.nodes.reshape(-1, 7, WIDTH)
    there = np.isfinite(words[:, 0])
    child = np.ascontiguousarray(words[:, 6]).view(np.int32)
    place = np.arange(child.size, dtype=np.int32).reshape(child.shape)
    nodes, leaves = np.full(len(tree.nodes), -1, np.int32), np.full(len(tree.leaves), -1, np.int32)
    inner = there & (child >= 0)
    nodes[child[inner]] = place[inner]
    leaves[-1 - child[there & (child < 0)]] = place[there & (child < 0)]
    return nodes, leaves
