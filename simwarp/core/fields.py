"""Arrays declared once: name, type, shape in named sizes, unit and meaning.

A class of fields (`kernels/core/fields.py` has them all) is the one place that says which arrays there are. From it are
made the Warp struct that kernels take, the allocation, what a snapshot holds, what may differ per world, and the tables
of docs/conventions.md. Imports nothing of simwarp but types and writable arrays: kernels and host share it.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping
from typing import Any, ClassVar, Final

import warp as wp

from simwarp.core import file_keys
from simwarp.core.arrays import ANY, Domain, FixedAttributes, writable
from simwarp.core.object_repr import Readable, Row, plural
from simwarp.core.types import ArrayLayout


class Size(enum.Enum):
    """Lengths that arrays have: what documentation calls them, and when they are shorter."""

    WORLDS = ("W", "")
    PARAMETER_WORLDS = ("1 or W", "1: all worlds share it")
    ELEMENT_WORLDS = ("1 or W", "1 without force elements")
    IMPLICIT_WORLDS = ("W", "0 unless a force element is implicit")
    REACTION_WORLDS = ("W", "0 unless the Simulation records joint reactions")
    ACCELERATION_WORLDS = ("W", "0 unless the Simulation records joint accelerations")
    BODIES = ("B", "")
    TOUCHED_BODIES = ("B", "0 without shapes")
    JOINTS = ("J", "")
    DOFS = ("dofs", "")
    BOX_CONSTRAINTS = ("box constraints", "")
    COUPLINGS = ("couplings", "")
    TERMS = ("terms", "")
    SHAPES = ("S", "")
    CONTACTS = ("C", "")
    FACE_CONTACTS = ("C or 0", "0 unless faces of meshes touch")
    MESH_PARTS = ("parts", "0 without flexible meshes")

    def noun(self, length: int) -> str:
        """What so many of them are called: `worlds`, `1 body` without the number."""
        words = self.name.lower().replace("_", " ")
        kind = next((kind for kind in ("worlds", "bodies") if words.endswith(kind)), words)
        return kind if length != 1 else {"bodies": "body"}.get(kind, kind.removesuffix("s"))


@dataclasses.dataclass(frozen=True)
class Field:
    """One array.

    Attributes:
        dtype: of Warp.
        sizes: its shape.
        text: unit, frame and meaning.
        domain: allowed values; None: anything.
        writable: True if users assign slices of it.
        of_kernels: True if kernels take it in the struct of its class.
        transient: True if every step writes it before it reads it: snapshots and files do without.
    """

    dtype: Any
    sizes: tuple[Size, ...]
    text: str
    domain: Domain | None = None
    writable: bool = False
    of_kernels: bool = True
    source: str = ""
    transient: bool = False

    @property
    def shape_text(self) -> str:
        """The shape as documentation writes it: `(W, B)`, `(W,)`."""
        names = [size.value[0] for size in self.sizes]
        return f"({names[0]},)" if len(names) == 1 else f"({', '.join(names)})"

    @property
    def kind_text(self) -> str:
        """Shape and type as documentation writes them: `(W, B) vec3`."""
        return f"{self.shape_text} {type_name(self.dtype)}"

    @property
    def per_world(self) -> bool:
        """True if it may differ per world; otherwise all worlds share it."""
        return self.sizes[0] is Size.PARAMETER_WORLDS


def field(
    dtype: Any, *sizes: Size, text: str, domain: Domain | None = None, writable: bool = False, of_kernels: bool = True,
    transient: bool = False,
) -> Any:  # fmt: skip
    """Declare an array as an attribute of a `FieldGroup`; see `Field`."""
    return Field(dtype, sizes, text, domain, writable, of_kernels, transient=transient)


def parameter(
    dtype: Any, *sizes: Size, text: str, domain: Domain = ANY, source: str = "", of_kernels: bool = True
) -> Any:
    """Declare a parameter: all worlds share it, or each has its own; users write into it."""
    sizes = (Size.PARAMETER_WORLDS, *sizes)
    return Field(dtype, sizes, text, domain, writable=True, source=source, of_kernels=of_kernels)


LEFT_OUT: Final = frozenset({Size.FACE_CONTACTS})
"""Sizes whose arrays files leave out where a model has none: files are older than these arrays."""


class FieldGroup(Readable, FixedAttributes):
    """Base of classes whose attributes are arrays; the declarations stand as class attributes.

    Attributes:
        FIELDS: by name, in the order of declaration.
        NAMES: of those that kernels take and snapshots hold.
    """

    FIELDS: ClassVar[dict[str, Field]] = {}
    NAMES: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        own = {name: value for name, value in vars(cls).items() if isinstance(value, Field)}
        cls.FIELDS = {**cls.FIELDS, **own}
        cls.NAMES = tuple(name for name, each in cls.FIELDS.items() if each.of_kernels and not each.transient)
        for name in own:
            delattr(cls, name)
        if cls.FIELDS:
            rows = "\n".join(
                f"        {name}: {each.shape_text} {type_name(each.dtype)}, {each.text}"
                for name, each in cls.FIELDS.items()
            )
            cls.__doc__ = f"{(cls.__doc__ or '').rstrip()}\n\n    Arrays:\n{rows}\n"

    def _readable_title(self) -> str:
        first: Any = next(getattr(self, name) for name, each in self.FIELDS.items() if each.sizes[0] is Size.WORLDS)
        return f": {plural(first.shape[0], 'world')} on {first.device}"

    def _readable_rows(self) -> dict[str, Row]:
        """Names and types of the arrays of each shape."""
        rows: dict[str, list[str]] = {}
        for name, each in self.FIELDS.items():
            if each.transient and not getattr(self, name).size:
                continue
            lengths = [
                f"{length} {size.noun(length)}"
                for length, size in zip(getattr(self, name).shape, each.sizes, strict=True)
            ]
            rows.setdefault(f"({', '.join(lengths)})", []).append(f"{name} {type_name(each.dtype)}")
        return {lengths: ", ".join(arrays) for lengths, arrays in rows.items()}

    @classmethod
    def layouts(cls, sizes: Mapping[Size, int]) -> dict[str, ArrayLayout]:
        """Return shape and type of every array for given sizes."""
        return {
            name: ArrayLayout(tuple(sizes[size] for size in each.sizes), each.dtype)
            for name, each in cls.FIELDS.items()
        }

    def in_files(self) -> dict[str, wp.array]:
        """Return the arrays that kernels take, (1 or W, ...), by the names that files have for them; without those of
        `LEFT_OUT` that are empty.
        """
        return {
            file_keys.ARRAYS.get(name, name): getattr(self, name)
            for name in self.NAMES
            if getattr(self, name).size or LEFT_OUT.isdisjoint(self.FIELDS[name].sizes)
        }

    def allocate(self, sizes: Mapping[Size, int], device: Any, label: str, struct: Any) -> None:
        """Make all arrays, zero, as attributes of this object and of the struct that kernels take."""
        for name, layout in self.layouts(sizes).items():
            each = self.FIELDS[name]
            array: wp.array
            if each.writable:
                array = writable(layout.shape, layout.dtype, device, label=f"{label}.{name}", domain=each.domain)
            else:
                array = wp.zeros(layout.shape, dtype=layout.dtype, device=device)
            setattr(self, name, array)
            if each.of_kernels:
                setattr(struct, name, array)
        self._fix()


def struct_of(group: type[FieldGroup], name: str, module: str) -> Any:
    """Return the Warp struct of a group's arrays.

    Args:
        group: with the declarations.
        name: of the struct.
        module: that kernels know it by.
    """
    annotations: dict[str, Any] = {
        key: wp.array(dtype=each.dtype, ndim=len(each.sizes)) for key, each in group.FIELDS.items() if each.of_kernels
    }
    return wp.struct(type(name, (), {"__annotations__": annotations, "__module__": module, "__doc__": group.__doc__}))


def type_name(dtype: Any) -> str:
    """Return a type's name in documentation: `float32`, `vec3`, `mat33d`."""
    known = {wp.vec3: "vec3", wp.vec3d: "vec3d", wp.quat: "quat", wp.quatd: "quatd", wp.mat33: "mat33",
             wp.mat33d: "mat33d", wp.transform: "transform"}  # fmt: skip
    return known.get(dtype, dtype.__name__)
