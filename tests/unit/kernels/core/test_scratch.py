# mypy: disable-error-code="operator, arg-type, no-untyped-def"
"""Scratch that is declared once: its layout, its structs, and the function that finds a slot's arrays."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.kernels.cones.problem import OF_LANES
from simwarp.kernels.core import scratch
from simwarp.kernels.core.scratch import (
    LINES,
    ScratchGroup,
    make_memory,
    memory_layouts,
    memory_struct,
    scratch_array,
    scratch_number,
    slot_function,
)


class PairScratch(ScratchGroup, prefix="pair_"):
    """Two rooms that share an array, one alone, and a number."""

    count = scratch_number(int)
    first = scratch_array(wp.float32, "things")
    second = scratch_array(wp.float32, "things")
    table = scratch_array(wp.vec3, 2, "things")


Pair = PairScratch.struct("Pair", __name__)
Memory = memory_struct("Memory", __name__, (PairScratch,))
pack_pair = slot_function("pack_pair", __name__, PairScratch, Pair, Memory)


@dataclasses.dataclass(frozen=True)
class Things:
    things: int


@wp.kernel(enable_backward=False)
def fill(memory: Memory):  # type: ignore[valid-type]
    slot = wp.tid()
    pair = pack_pair(memory, slot)
    for k in range(pair.first.shape[0]):
        pair.first[k] = float(100 * slot + k)
        pair.second[k] = float(100 * slot + k) + 0.5
        pair.table[1, k] = wp.vec3(float(slot), float(k), 1.0)


def test_a_slot_has_arrays_of_its_own() -> None:
    layouts = memory_layouts((PairScratch,), 3, Things(4))
    assert {name: layout.shape for name, layout in layouts.items()} == {
        "pair_things_float32": (3, 2, 4), "pair_table": (3, 2, 4),
    }  # fmt: skip
    memory = make_memory(Memory, layouts, "cpu")
    wp.launch(fill, dim=3, inputs=[memory], device="cpu")
    numbers = 100.0 * np.arange(3)[:, None] + np.arange(4)
    np.testing.assert_array_equal(memory.pair_things_float32.numpy(), np.stack([numbers, numbers + 0.5], axis=1))
    table = memory.pair_table.numpy()
    assert not table[:, 0].any()
    np.testing.assert_array_equal(table[2, 1, :, 0], [2.0] * 4)


@pytest.mark.cuda
def test_slots_of_a_gpu_are_innermost() -> None:
    """Lanes of a warp step a world each: what they read at a time must lie side by side."""
    layouts = memory_layouts((PairScratch,), 3, Things(4))
    memory = make_memory(Memory, layouts, "cuda:0")
    assert memory.pair_things_float32.strides == (4, 3 * 4 * 4, 3 * 4)
    assert memory.pair_table.strides == (12, 3 * 4 * 12, 3 * 12)
    assert memory.pair_table.numpy().shape == (3, 2, 4, 3)
    shared = make_memory(Memory, layouts, "cuda:0", of_lanes={"pair_table"})
    assert shared.pair_things_float32.strides == memory.pair_things_float32.strides
    assert shared.pair_table.strides == (LINES * math.ceil(2 * 4 * 12 / LINES), 4 * 12, 12)
    on_cpu = make_memory(Memory, layouts, "cpu")
    for each, device in ((memory, "cuda:0"), (shared, "cuda:0"), (on_cpu, "cpu")):
        wp.launch(fill, dim=3, inputs=[each], device=device)
    for name in layouts:
        for each in (memory, shared):
            np.testing.assert_array_equal(getattr(each, name).numpy(), getattr(on_cpu, name).numpy())


@pytest.mark.cuda
def test_slots_that_lanes_share_are_contiguous() -> None:
    """They read neighbours in it: an ant's eight lanes read a sector where they would read eight."""
    sim = sw.Simulation(scenes.ant().finalize(9, "cuda:0"), 5e-3)
    memory: Any = sim._scratch
    assert memory.cone_s.strides[2] == 4 < memory.cone_s.strides[0]
    assert memory.cone_vectors.strides[2] == 4 < memory.cone_vectors.strides[0]
    assert memory.cone_y.strides[0] == 4 < memory.cone_y.strides[2]  # filled by one thread of each world
    assert all(hasattr(memory, name) for name in OF_LANES)
    alone = sw.Simulation(scenes.pendulum().finalize(9, "cuda:0"), 5e-3)
    memory = alone._scratch
    assert memory.cone_vectors.strides[0] == 4 < memory.cone_vectors.strides[2]


def test_slots_that_would_lie_too_far_apart_lie_one_by_one(monkeypatch) -> None:
    """Strides of 32 bits would wrap around without a word, and worlds write into each other."""
    near = scratch._slots_innermost((3, 2, 4), dtype=wp.vec3, device="cpu")
    assert near.strides == (12, 3 * 4 * 12, 3 * 12)
    monkeypatch.setattr(scratch, "LONGEST_STRIDE", 3 * 4 * 12 - 1)
    far = scratch._slots_innermost((3, 2, 4), dtype=wp.vec3, device="cpu")
    assert far.strides == (2 * 4 * 12, 4 * 12, 12)


def test_rooms_without_length_keep_an_element_per_axis() -> None:
    layouts = memory_layouts((PairScratch,), 1, Things(0))
    assert layouts["pair_table"].shape == (1, 2, 1)


def test_arrays_of_one_name_are_refused() -> None:
    class Again(ScratchGroup, prefix="pair_"):
        table = scratch_array(wp.float32, "things")

    with pytest.raises(ValueError, match="Again: another group has an array 'pair_table'; give one of them a prefix"):
        memory_struct("Both", __name__, (PairScratch, Again))


def test_slots_of_a_cpu_share_no_cache_line():
    """Threads write them side by side: a line of two slots would go back and forth between their processors."""
    sim = sw.Simulation(scenes.ant().finalize(9, "cpu"), 5e-3, threads=2)
    for part in (sim._scratch, sim._collision_scratch):
        memory: Any = part
        for name in memory._cls.vars:
            array = getattr(memory, name)
            assert array.shape[0] == 8
            assert array.ptr % LINES == array.strides[0] % LINES == 0
