"""Scratch of kernels, declared once: named arrays of one world, kept in slots that worlds take in turn.

A `ScratchGroup` says which arrays there are. From it are made the struct that device functions take (one slot's arrays
by name), the struct of memory that kernels take, its layout, and the function that finds a slot's arrays in it. Arrays
of one type and length share a block of memory: kernels have a limit for the bytes of their arguments.
"""

from __future__ import annotations

import dataclasses
import linecache
import math
from collections.abc import Sequence, Set
from typing import Any, ClassVar

import warp as wp

from simwarp.core.fields import type_name
from simwarp.core.types import ArrayLayout

LINES = 128
"""Bytes of a pair of cache lines."""
LONGEST_STRIDE = 2**31 - 1
"""Bytes that an array of Warp can move by along an axis."""


@dataclasses.dataclass(frozen=True)
class ScratchArray:
    """One array of a slot, or one number of its struct.

    Attributes:
        dtype: of Warp.
        lengths: of its axes: an attribute of the sizes, or a number. Without axes it is a number, and takes no memory.
    """

    dtype: Any
    lengths: tuple[str | int, ...]


def scratch_array(dtype: Any, *lengths: str | int) -> Any:
    """Declare an array of a slot as an attribute of a `ScratchGroup`; see `ScratchArray`."""
    return ScratchArray(dtype, lengths)


def scratch_number(dtype: Any) -> Any:
    """Declare a number of a slot's struct."""
    return ScratchArray(dtype, ())


@dataclasses.dataclass(frozen=True)
class Block:
    """Scratch arrays that share one array of memory: (slots, arrays, ...), or (slots, ...) if there is one."""

    dtype: Any
    lengths: tuple[str | int, ...]
    arrays: tuple[str, ...]

    @property
    def axes(self) -> int:
        """Number of axes of the array."""
        return 1 + (len(self.arrays) > 1) + len(self.lengths)

    def shape(self, sizes: Any) -> tuple[int, ...]:
        """Return the shape of one slot; kernels take views, which need an element per axis."""
        lengths = [getattr(sizes, each) if isinstance(each, str) else each for each in self.lengths]
        return (*([len(self.arrays)] if len(self.arrays) > 1 else []), *(max(length, 1) for length in lengths))


class ScratchGroup:
    """Base of classes whose attributes are scratch arrays.

    Args:
        packed: whether arrays of one type and length share one; else each has its own, of its name.
        prefix: of the names of arrays, where several groups have arrays of one name.

    Attributes:
        ROOMS: by name, in the order of declaration.
    """

    ARRAYS: ClassVar[dict[str, ScratchArray]] = {}
    PACKED: ClassVar[bool] = True
    PREFIX: ClassVar[str] = ""

    def __init_subclass__(cls, *, packed: bool = True, prefix: str = "") -> None:
        cls.PACKED, cls.PREFIX = packed, prefix
        cls.ARRAYS = {name: value for name, value in vars(cls).items() if isinstance(value, ScratchArray)}

    @classmethod
    def blocks(cls) -> dict[str, Block]:
        """Return the arrays of memory by name."""
        alike: dict[tuple[Any, ...], list[str]] = {}
        for name, each in cls.ARRAYS.items():
            if each.lengths:
                alike.setdefault((each.dtype, each.lengths, "" if cls.PACKED else name), []).append(name)
        found = {}
        for (dtype, lengths, _), names in alike.items():
            name = names[0] if len(names) == 1 else "_".join([*map(str, lengths), type_name(dtype)])
            found[cls.PREFIX + name] = Block(dtype, lengths, tuple(names))
        return found

    @classmethod
    def struct(cls, name: str, module: str) -> Any:
        """Return the Warp struct of one slot's arrays and numbers."""
        kinds = {
            key: wp.array(dtype=each.dtype, ndim=len(each.lengths)) if each.lengths else each.dtype
            for key, each in cls.ARRAYS.items()
        }
        return wp.struct(type(name, (), {"__annotations__": kinds, "__module__": module, "__doc__": cls.__doc__}))


def memory_blocks(groups: Sequence[type[ScratchGroup]]) -> dict[str, Block]:
    """Return the arrays of some groups.

    Raises:
        ValueError: two groups have an array of one name; give one of them a prefix.
    """
    found: dict[str, Block] = {}
    for group in groups:
        for name, block in group.blocks().items():
            if name in found:
                raise ValueError(f"{group.__name__}: another group has an array '{name}'; give one of them a prefix")
            found[name] = block
    return found


def memory_struct(name: str, module: str, groups: Sequence[type[ScratchGroup]]) -> Any:
    """Return the Warp struct of the memory of some groups: first axis the slot."""
    kinds = {key: wp.array(dtype=block.dtype, ndim=block.axes) for key, block in memory_blocks(groups).items()}
    text = f"Memory of {', '.join(group.__name__ for group in groups)}; first axis the slot."
    return wp.struct(type(name, (), {"__annotations__": kinds, "__module__": module, "__doc__": text}))


def memory_layouts(groups: Sequence[type[ScratchGroup]], slots: int, sizes: Any) -> dict[str, ArrayLayout]:
    """Return the arrays of a `memory_struct`.

    Args:
        groups: of the struct.
        slots: how many worlds use it at a time.
        sizes: its attributes are the lengths that arrays name.
    """
    blocks = memory_blocks(groups)
    return {name: ArrayLayout((slots, *block.shape(sizes)), block.dtype) for name, block in blocks.items()}


def make_memory(struct: Any, layouts: dict[str, ArrayLayout], device: Any, *, of_lanes: Set[str] = frozenset()) -> Any:
    """Allocate a `memory_struct`, zero.

    On a GPU the slot is the innermost axis in memory: the lanes of a warp, a world each, read neighbours. Slots of a
    CPU, which threads write side by side, are contiguous and share no cache line; so are those of a GPU where several
    lanes have a slot together, and read neighbours in it.

    Args:
        struct: the `memory_struct`.
        layouts: of its arrays, by name.
        device: where it lies.
        of_lanes: names of the arrays of which lanes share a slot.
    """
    memory = struct()
    on_gpu = wp.get_device(device).is_cuda
    for name, layout in layouts.items():
        make: Any = wp.zeros
        if layout.shape[0] > 1:
            make = _slots_innermost if on_gpu and name not in of_lanes else _slots_apart
        setattr(memory, name, make(layout.shape, dtype=layout.dtype, device=device))
    return memory


def _slots_innermost(shape: tuple[int, ...], *, dtype: Any, device: Any) -> Any:
    """Zeros whose first axis is the fastest in memory, the others in their order.

    Strides of Warp are of 32 bits: what would need longer ones lies slot by slot, which native functions walk too.
    """
    size = int(wp.types.type_size_in_bytes(dtype))
    lengths = shape[1:]
    strides = [size * shape[0] * math.prod(lengths[axis + 1 :]) for axis in range(len(lengths))]
    memory = wp.zeros(shape, dtype=dtype, device=device)
    if max(strides, default=0) > LONGEST_STRIDE:
        return memory
    return _view(memory, int(memory.ptr), shape, (size, *strides), dtype, device)


def _slots_apart(shape: tuple[int, ...], *, dtype: Any, device: Any) -> Any:
    """Zeros whose first axis moves by whole pairs of cache lines, as processors fetch them."""
    size = int(wp.types.type_size_in_bytes(dtype))
    lengths = list(shape[1:])
    strides = [size * math.prod(lengths[axis + 1 :]) for axis in range(len(lengths))]
    pitch = -(-size * math.prod(lengths) // LINES) * LINES
    memory = wp.zeros((shape[0] + 1) * pitch, dtype=wp.uint8, device=device)
    start = -(-int(memory.ptr) // LINES) * LINES
    return _view(memory, start, shape, (pitch, *strides), dtype, device)


def _view(memory: Any, start: int, shape: tuple[int, ...], strides: tuple[int, ...], dtype: Any, device: Any) -> Any:
    """Return an array over `memory`, which lives as long as it."""
    slots: Any = wp.array(
        ptr=start, dtype=dtype, shape=shape, strides=strides, capacity=memory.capacity, device=device
    )  # fmt: skip
    slots.memory = memory
    return slots


def slot_function(
    name: str, module: str, group: type[ScratchGroup], struct: Any, memory: Any, *, only: Set[str] | None = None,
    inline: bool | None = None,
) -> Any:  # fmt: skip
    """Return the device function `name(scratch, slot)` that finds the arrays of one slot.

    Its text is written from the declarations: Warp compiles functions from their source.

    Args:
        name: of the function.
        module: that it belongs to.
        group: the declarations.
        struct: what it returns, `group.struct(...)`.
        memory: what it takes, a `memory_struct` with that group.
        only: names of the arrays that it finds, others stay empty; None: all.
        inline: into its callers, as of `wp.func`.
    """
    lines = [f"def {name}(scratch: Memory, slot: int) -> Slot:", "    found = Slot()"]
    for key, block in group.blocks().items():
        for index, each in enumerate(block.arrays):
            place = "slot" if len(block.arrays) == 1 else f"slot, {index}"
            if only is None or each in only:
                lines.append(f"    found.{each} = scratch.{key}[{place}]")
    source = "\n".join([*lines, "    return found", ""])
    file = f"<{module}.{name}>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    names = {"Memory": memory, "Slot": struct, "__name__": module}
    exec(compile(source, file, "exec"), names)
    return wp.func(names[name], inline=inline)
