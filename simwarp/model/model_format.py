"""The format of model files: what a builder holds, as plain values of JSON.

Numbers are written so that they read back bit by bit. A side of a limit that has no stop is null, as is an effort
without limit; arrays of geometries are packed as base64. What holds its default is left out.
"""

from __future__ import annotations

import base64
import binascii
import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import MaxLen, Meaning, Positive, Tagged, Whole
from simwarp.core.files import LARGEST_TEXT
from simwarp.core.schema import Schema
from simwarp.core.types import (
    FLOAT32_LEAST,
    FLOAT32_MAX,
    DamperMap,
    Dof,
    Drive,
    EffortLimit,
    Material,
    ModelError,
    PositionDrive,
    PrescribedPosition,
    PrescribedSpeed,
    Table,
    VelocityMotor,
    formatted,
)
from simwarp.model.rules import ALL_GROUPS, GroupBits, Margin, Passive

FORMAT: Final = "simwarp model"
VERSION: Final = 1
MOST_THINGS: Final = 2**16
"""Bodies, joints, couplings or shapes of one file."""
MOST_PAIRS: Final = 2**20

MODELS: Final = Schema(ModelError, least=FLOAT32_LEAST, longest=LARGEST_TEXT)
"""The loader of model files, and of what others keep in them."""

Numbers3: TypeAlias = tuple[float, float, float]
Numbers4: TypeAlias = tuple[float, float, float, float]
Side: TypeAlias = float | None
Spacing: TypeAlias = Annotated[Positive, Meaning("metres along x and along y")]
ZERO: Final = (0.0, 0.0, 0.0)
USUAL_SURFACE: Final = Material()
UNTURNED: Final = (0.0, 0.0, 0.0, 1.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PackedArray:
    """Numbers of an array, little-endian, row by row, as base64."""

    dtype: Literal["float64", "float32", "int32"]
    shape: Annotated[tuple[Whole, ...], MaxLen(3)]
    base64: str

    @classmethod
    def of(cls, array: npt.NDArray[Any]) -> PackedArray:
        """That of an array."""
        name: Any = array.dtype.name
        content = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes()
        return cls(dtype=name, shape=tuple(map(int, array.shape)), base64=base64.b64encode(content).decode("ascii"))

    def unpacked(self, what: str, dtype: str, *columns: int) -> npt.NDArray[Any]:
        """The array, of the type and, behind the first axis, the lengths that it must have; numbers are finite.

        Raises:
            ModelError: it has not, or its text is not that of so many numbers.
        """
        wanted = np.dtype(dtype).newbyteorder("<")
        if self.dtype != dtype or (columns and self.shape[1:] != columns):
            told = f"{dtype} of shape (N, {', '.join(map(str, columns))})" if columns else dtype
            raise ModelError(f"{what} must be {told}, got {self.dtype} of shape {formatted(self.shape)}; save it anew")
        try:
            content = base64.b64decode(self.base64, validate=True)
        except (binascii.Error, ValueError):
            raise ModelError(f"{what}.base64 must be base64, got {formatted(self.base64)}; save it anew") from None
        if len(content) != math.prod(self.shape) * wanted.itemsize:
            raise ModelError(
                f"{what} must have {math.prod(self.shape)} numbers, as its shape tells, got {len(content)} bytes; "
                "the file may be cut off"
            )
        array = np.frombuffer(content, wanted).reshape(self.shape).astype(dtype)
        if not bool((np.abs(array) <= FLOAT32_MAX).all()):
            raise ModelError(f"{what} must hold finite numbers of at most 3.4e38, got others; save it anew")
        return array


@dataclasses.dataclass(frozen=True, kw_only=True)
class PositionDriveEntry:
    """A `PositionDrive`."""

    stiffness: float
    damping: float = 0.0
    effort_limit: float | tuple[Side, Side] | None = None
    kind: Literal["position"] = "position"


@dataclasses.dataclass(frozen=True, kw_only=True)
class VelocityMotorEntry:
    """A `VelocityMotor`."""

    effort_limit: float | tuple[Side, Side]
    kind: Literal["velocity"] = "velocity"


@dataclasses.dataclass(frozen=True, kw_only=True)
class PrescribedPositionEntry:
    """A `PrescribedPosition`."""

    table: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    kind: Literal["prescribed position"] = "prescribed position"


@dataclasses.dataclass(frozen=True, kw_only=True)
class PrescribedSpeedEntry:
    """A `PrescribedSpeed`."""

    table: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    kind: Literal["prescribed speed"] = "prescribed speed"


DriveEntry: TypeAlias = Annotated[
    PositionDriveEntry | VelocityMotorEntry | PrescribedPositionEntry | PrescribedSpeedEntry, Tagged("kind")
]


@dataclasses.dataclass(frozen=True, kw_only=True)
class DofEntry:
    """A `Dof`."""

    limit: tuple[Side, Side] | None = None
    armature: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    preload: float = 0.0
    friction: float = 0.0
    spring_table: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    damper_table: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    damper_map: tuple[tuple[float, ...], tuple[float, ...], tuple[tuple[float, ...], ...]] | None = None
    drive: DriveEntry | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class BodyEntry:
    """A `BodySpec`: without mass a frame between joints; inertia as its diagonal where the rest is zero."""

    name: str
    mass: float
    inertia: Numbers3 | tuple[Numbers3, Numbers3, Numbers3] = ZERO
    position: Numbers3 = ZERO
    rotation: Numbers4 = UNTURNED
    velocity: Numbers3 = ZERO
    omega: Numbers3 = ZERO
    posed: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class FrameEntry:
    """A `Frame`."""

    position: Numbers3 = ZERO
    rotation: Numbers4 = UNTURNED


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointEntry:
    """A `JointSpec`; its type by name, its terms by columns of `joint_q`."""

    name: str
    type: str
    parent: int = -1
    child: int = -1
    frame0: FrameEntry = FrameEntry()
    frame1: FrameEntry = FrameEntry()
    dofs: Annotated[tuple[DofEntry, ...], MaxLen(6)] = ()
    offset: float = 0.0
    inertia: float = 0.0
    initial_q: float = 0.0
    initial_qd: float = 0.0
    closes_loop: bool = False
    terms: tuple[tuple[Whole, float], ...] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class CouplingEntry:
    """A `CouplingSpec`."""

    name: str
    terms: tuple[tuple[Whole, float], ...]
    offset: float | None = None
    damping: Passive = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class ShapeEntry:
    """A `ShapeSpec`; its type by name, its asset by index in the list of that type."""

    name: str
    type: str
    body: int = -1
    size: Numbers3 = ZERO
    position: Numbers3 = ZERO
    rotation: Numbers4 = UNTURNED
    material: Material = USUAL_SURFACE
    margin: Margin = 0.0
    group: GroupBits = 1
    mask: GroupBits = ALL_GROUPS
    asset: int = -1


@dataclasses.dataclass(frozen=True, kw_only=True)
class HullEntry:
    """A `Hull`."""

    vertices: PackedArray
    faces: tuple[tuple[Whole, ...], ...]
    normals: PackedArray
    edges: PackedArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeightFieldEntry:
    """A `HeightField`."""

    heights: PackedArray
    spacing: tuple[Spacing, Spacing]


@dataclasses.dataclass(frozen=True, kw_only=True)
class MeshEntry:
    """A `TriangleMesh`."""

    vertices: PackedArray
    triangles: PackedArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class SprocketProfileEntry:
    """A `SprocketProfile`."""

    teeth: Whole
    arc_center_radius: Positive
    arc_radius: Positive
    arc_offset: float = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlexibleMaterialEntry:
    """An `Elastic` or a `Rubber` of `sw.flex`."""

    kind: Literal["elastic", "rubber"]
    young: float
    poisson: float
    density: float
    damping_time: float = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class MeshPartEntry:
    """A `MeshPart`."""

    elements: PackedArray
    material: FlexibleMaterialEntry
    thickness: float | None = None
    pressure: float = 0.0
    fill: PackedArray | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class MeshSurfaceEntry:
    """A `MeshSurface` whose vertices several nodes carry."""

    nodes: PackedArray
    weights: PackedArray
    triangles: PackedArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlexibleMeshEntry:
    """A `FlexibleMesh`: of each node its body (-1: fixed), and which nodes are glued to theirs. Without a surface, that
    of its elements is seen.
    """

    name: str
    points: PackedArray
    places: PackedArray
    parts: tuple[MeshPartEntry, ...]
    bodies: PackedArray
    glued: tuple[Whole, ...] = ()
    double: bool = False
    shapes: tuple[Whole, ...] = ()
    surface: MeshSurfaceEntry | None = None
    contact: Literal["nodes", "faces"] = "nodes"


@dataclasses.dataclass(frozen=True, kw_only=True)
class GivenPairEntry:
    """A pair of shapes that may meet in any case, and the surface of their contact."""

    shapes: tuple[int, int]
    material: Material | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class ModelEntry:
    """A whole file; `robot` is what a reader of robots keeps beside the model (`simwarp.importers`)."""

    format: Literal["simwarp model"] = "simwarp model"
    version: Literal[1] = 1
    gravity: Numbers3 = ZERO
    friction_rule: str = "min"
    pair_rule: str = "both"
    bodies: tuple[BodyEntry, ...] = ()
    joints: tuple[JointEntry, ...] = ()
    couplings: tuple[CouplingEntry, ...] = ()
    shapes: tuple[ShapeEntry, ...] = ()
    hulls: tuple[HullEntry, ...] = ()
    height_fields: tuple[HeightFieldEntry, ...] = ()
    meshes: tuple[MeshEntry, ...] = ()
    sprocket_profiles: tuple[SprocketProfileEntry, ...] = ()
    flexible_meshes: tuple[FlexibleMeshEntry, ...] = ()
    excluded_bodies: tuple[tuple[int, int], ...] = ()
    excluded_shapes: tuple[tuple[int, int], ...] = ()
    given_pairs: tuple[GivenPairEntry, ...] = ()
    robot: Mapping[str, Any] | None = None


ALWAYS: Final = ("format", "version", "kind", "gravity")
"""Fields that are written whatever they hold."""


def plain(entry: Any) -> Any:
    """Dictionaries and lists of an entry, without the fields that hold their default."""
    if dataclasses.is_dataclass(entry) and not isinstance(entry, type):
        members = {}
        for field in dataclasses.fields(entry):
            item = getattr(entry, field.name)
            # by their words: -0.0 is no 0.0
            if field.name in ALWAYS or field.default is dataclasses.MISSING or repr(item) != repr(field.default):
                members[field.name] = plain(item)
        return members
    if isinstance(entry, Mapping):
        return {str(key): plain(item) for key, item in entry.items()}
    if isinstance(entry, (tuple, list)):
        return [plain(item) for item in entry]
    return entry


# ---- values of a builder <-> entries ---------------------------------------------------------------------------------


def floats(values: Iterable[Any]) -> Any:
    """A tuple of Python's numbers."""
    return tuple(float(value) for value in values)


def side(value: float) -> Side:
    """One side of a limit: None where no number of the arrays is as large."""
    return float(value) if abs(value) <= FLOAT32_MAX else None


def sides(limit: Sequence[float] | None) -> tuple[Side, Side] | None:
    """Both sides of a limit."""
    return None if limit is None else (side(limit[0]), side(limit[1]))


def limit_of(found: tuple[Side, Side] | None) -> tuple[float, float] | None:
    """The limit of its two sides."""
    if found is None:
        return None
    return -math.inf if found[0] is None else found[0], math.inf if found[1] is None else found[1]


def dof_entry(dof: Dof) -> DofEntry:
    """That of a degree of freedom."""
    plain_names = [field.name for field in dataclasses.fields(Dof) if field.default == 0.0]
    return DofEntry(
        limit=sides(dof.limit), spring_table=_table_entry(dof.spring_table),
        damper_table=_table_entry(dof.damper_table), damper_map=_map_entry(dof.damper_map),
        drive=None if dof.drive is None else _drive_entry(dof.drive),
        **{name: float(getattr(dof, name)) for name in plain_names},
    )  # fmt: skip


def dof_of(entry: DofEntry) -> Dof:
    """The degree of freedom of an entry."""
    values = {field.name: getattr(entry, field.name) for field in dataclasses.fields(entry)}
    drive = None if entry.drive is None else _drive_of(entry.drive)
    return Dof(**{**values, "limit": limit_of(entry.limit), "drive": drive})


def _table_entry(table: Table | None) -> Any:
    return None if table is None else tuple(floats(part) for part in table)


def _map_entry(table: DamperMap | None) -> Any:
    if table is None:
        return None
    places, rates, forces = table
    return floats(places), floats(rates), tuple(floats(row) for row in forces)


def _effort_entry(limit: EffortLimit) -> Any:
    return side(limit) if np.ndim(limit) == 0 else sides(limit)  # type: ignore[arg-type]


def _effort_of(entry: float | tuple[Side, Side] | None) -> EffortLimit:
    if isinstance(entry, tuple):
        return limit_of(entry) or math.inf
    return math.inf if entry is None else entry


DRIVE_ENTRIES: Final[dict[type, Any]] = {
    PositionDrive: PositionDriveEntry, VelocityMotor: VelocityMotorEntry, PrescribedPosition: PrescribedPositionEntry,
    PrescribedSpeed: PrescribedSpeedEntry,
}  # fmt: skip


def _drive_entry(drive: Drive) -> Any:
    made: dict[str, Any] = {"effort_limit": _effort_entry, "table": _table_entry}
    return DRIVE_ENTRIES[type(drive)](**{name: made.get(name, float)(value) for name, value in vars(drive).items()})


def _drive_of(entry: DriveEntry) -> Any:
    kind = next(kind for kind, own in DRIVE_ENTRIES.items() if isinstance(entry, own))
    values = {name: value for name, value in vars(entry).items() if name != "kind"}
    return kind(**{name: _effort_of(value) if name == "effort_limit" else value for name, value in values.items()})


def material_entry(material: Material) -> Material:
    """A surface with Python's numbers."""
    values = {field.name: float(getattr(material, field.name)) for field in dataclasses.fields(Material)}
    return Material(**{**values, "priority": int(material.priority)})  # type: ignore[arg-type]
