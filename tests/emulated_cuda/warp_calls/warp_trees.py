"""Stand-ins for Warp's meshes and bounding volume hierarchies: the host builds them, kernels read them there."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Iterable, Iterator
from typing import Any

from tests.emulated_cuda.device import Device, is_device

DESCRIPTOR = 56
"""Bytes of Warp's array descriptor."""
TREE = "<5Q4iQ3Q3i"
"""Layout of Warp's BVH: five arrays, four counts, root, two arrays of bounds and the groups, three counts."""


class WarpTrees:
    """Functions of meshes and trees, named as in Warp's library without `wp_`."""

    def __init__(self, device: Device, real: Any) -> None:
        self.device, self.real = device, real
        self._ranges: dict[int, list[int]] = {}

    def _allow(self, owner: int, ranges: Iterable[tuple[int, int]]) -> None:
        """Let device code read ranges of the host's memory, for as long as their owner lives."""
        self._forget(owner)
        self._ranges[owner] = []
        for address, size in ranges:
            if address and size:
                self.device.runtime.emu_allow(ctypes.c_void_p(address), ctypes.c_uint64(size))
                self._ranges[owner].append(address)

    def _forget(self, owner: int) -> None:
        for address in self._ranges.pop(owner, []):
            self.device.runtime.emu_disallow(ctypes.c_void_p(address))

    def _tree_ranges(self, address: int) -> Iterator[tuple[int, int]]:
        fields = struct.unpack(TREE, ctypes.string_at(address, struct.calcsize(TREE)))
        lowers, uppers, parents, counts, primitives, _, nodes, _, _, root, low, up, _, items = fields[:14]
        yield from ((lowers, 16 * nodes), (uppers, 16 * nodes), (parents, 4 * nodes), (counts, 4 * nodes))
        yield from ((primitives, 4 * items), (root, 4))
        yield from ((extra, 12 * items) for extra in (low, up) if not is_device(extra))

    def _before(self) -> None:
        """What the host builds reads what the current stream was asked for until now."""
        self.device.streams.finish_stream(self.device.streams.current)

    def mesh_create_device(
        self, context: Any, points: Any, velocities: Any, indices: Any, point_count: Any, triangle_count: Any,
        support: Any, constructor: Any, groups: Any, leaf: Any,
    ) -> int:  # fmt: skip
        """A mesh with its tree."""
        self._before()
        constructor = constructor if constructor in (0, 1) else 0
        with self.device.open_to_host():
            address: int = self.real.wp_mesh_create_host(
                points, velocities, indices, point_count, triangle_count, support, constructor, groups, leaf
            )
        lowers, uppers, solid = struct.unpack("<3Q", ctypes.string_at(address + 3 * DESCRIPTOR, 24))
        triangles = struct.unpack("<2i", ctypes.string_at(address + 3 * DESCRIPTOR + 24, 8))[1]
        own = [(address, 512), (lowers, 12 * triangles), (uppers, 12 * triangles), (solid, 64 * (2 * triangles + 16))]
        self._allow(address, [*own, *self._tree_ranges(address + 3 * DESCRIPTOR + 32)])
        self.device.faults.counts["meshes"] += 1
        return address

    def mesh_destroy_device(self, address: int) -> None:
        """Give a mesh back."""
        if not self.device.streams.captures:
            self.device.streams.finish_all()
        self._forget(address)
        with self.device.open_to_host():
            self.real.wp_mesh_destroy_host(address)

    def mesh_refit_device(self, address: int) -> int:
        """Fit a mesh's tree to its points."""

        def run() -> None:
            with self.device.open_to_host():
                self.real.wp_mesh_refit_host(address)

        return int(self.device.streams.submit(self.device.streams.current, run, "wp_mesh_refit_device"))

    def bvh_create_device(
        self, context: Any, lowers: Any, uppers: Any, count: Any, constructor: Any, groups: Any, leaf: Any
    ) -> int:
        """A tree of boxes."""
        self._before()
        constructor = constructor if constructor in (0, 1) else 0
        with self.device.open_to_host():
            address: int = self.real.wp_bvh_create_host(lowers, uppers, count, constructor, groups, leaf)
        self._allow(address, [(address, 128), *self._tree_ranges(address)])
        return address

    def bvh_destroy_device(self, address: int) -> None:
        """Give a tree back."""
        if not self.device.streams.captures:
            self.device.streams.finish_all()
        self._forget(address)
        with self.device.open_to_host():
            self.real.wp_bvh_destroy_host(address)

    def bvh_refit_device(self, address: int) -> None:
        """Fit a tree to its boxes."""

        def run() -> None:
            with self.device.open_to_host():
                self.real.wp_bvh_refit_host(address)

        self.device.streams.submit(self.device.streams.current, run, "wp_bvh_refit_device")
