"""Closed sets, the value types of the builder, and the one error type of model construction."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from enum import IntEnum, IntFlag
from typing import Annotated, Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import Fraction, Ge, Le, Meaning, NotNegative
from simwarp.core.object_repr import Readable, ReadableFields

WORLD: Final = -1
"""The index of the fixed world, wherever a body index is asked for."""

FLOAT32_MAX: Final = float(np.finfo(np.float32).max)
"""Largest number that the arrays of a Model hold."""

FLOAT32_LEAST: Final = float(np.finfo(np.float32).tiny)
"""Smallest positive number that they hold with all its digits; below it, kernels may see zero."""

Vec3: TypeAlias = Sequence[float] | npt.NDArray[np.floating]
"""Three numbers: a sequence, or an array (3,)."""
Quat: TypeAlias = Sequence[float] | npt.NDArray[np.floating]


class ModelError(ValueError):
    """A model that cannot be built: names the thing, the rule, the value received and the remedy."""


class JointType(IntEnum):
    """Every element between two frames. Axes are those of DESIGN: a joint's own axis is z of its frames.

    The first group can be eliminated in articulated form; the second only adds rows between two bodies.
    """

    FREE = 0
    FIXED = 1
    REVOLUTE = 2
    PRISMATIC = 3
    SPHERICAL = 4
    CYLINDRICAL = 5
    UNIVERSAL = 6
    PLANAR = 7
    SHAFT = 8
    ELASTIC = 9
    # row-only elements
    POINT_ON_PLANE = 16
    POINT_ON_LINE = 17
    PARALLEL = 18
    PERPENDICULAR = 19
    OLDHAM = 20
    ROD = 21
    DISTANCE = 22
    REVOLUTE_SPHERICAL = 23
    REVOLUTE_TRANSLATIONAL = 24
    BUSHING = 25
    RELATIVE_ROTATION = 26
    COMBINATION = 27


class RowKind(IntEnum):
    """Geometry of one scalar row between frame 0 and frame 1 of an element (kernels/dynamics/bilateral_rows.py)."""

    POINT_AXIS0 = 0
    """(A1 - A0) . e_i of frame 0, both bodies taken at A1."""
    POINT_AXIS1 = 1
    """(A1 - A0) . e_i of frame 1, both bodies taken at A0."""
    DOT = 2
    """e_i of frame 0 . e_j of frame 1."""
    DISTANCE = 3
    """|A1 - A0|."""
    ANGLE0 = 4
    """Rotation about e_i of frame 0."""
    ANGLE1 = 5
    """Rotation about e_i of frame 1."""
    SHAFT = 6
    """The coordinate of a one-degree-of-freedom shaft; no body moves."""
    SUM = 7
    """A sum of coefficient x coordinate of other joints."""


class DriveMode(IntEnum):
    """Drive that acts on a degree of freedom besides its spring, damper, friction and `joint_force`."""

    NONE = 0
    POSITION = 1
    """Implicit PD: effort = stiffness (target_q - q) + damping (target_qd - qd), bounded by the effort limit."""
    VELOCITY = 2
    """Keeps target_qd with whatever effort it takes, up to the effort limit."""
    PRESCRIBED_POSITION = 3
    """q follows a table or `joint_target_q`, whatever the effort."""
    PRESCRIBED_SPEED = 4
    """qd follows a table or `joint_target_qd`, whatever the effort."""


class BoxKind(IntEnum):
    """Rows with a bounded impulse: solved by accelerated gradient on the joint-eliminated system."""

    LIMIT = 0
    FRICTION = 1
    MOTOR = 2
    DRIVE = 3


class BlockKind(IntEnum):
    """The convex set that a block of a cone problem's rows lives in."""

    BOX = 0
    """One row between a lower and an upper bound."""
    CONTACT = 1
    """Three rows n, t1, t2 with |t| <= friction n."""
    ROLLING = 2
    """Six rows n, t1, t2, r1, r2, s: beside friction |r| <= rolling n and |s| <= spinning n [m]."""


class ConeSolver(IntEnum):
    """Solvers of the cone problem (docs/theory.md)."""

    APGD = 0
    PSOR = 1
    SPG = 2
    PADMM = 3
    INTERIOR_POINT = 4


class FrictionLaw(IntEnum):
    """Coulomb's law as it is, or its convex relaxation, which lets sliding contacts separate."""

    EXACT = 0
    CONVEX = 1


class FrictionRule(IntEnum):
    """What the friction coefficients of two surfaces make of their contact, where no `Material.priority` decides."""

    MIN = 0
    """The smaller one."""
    MAX = 1
    """The larger one, as in MuJoCo."""
    MEAN = 2
    PRODUCT = 3
    """The product; of the levers of rolling and spinning, whose product is no length, the smaller one."""


class PairRule(IntEnum):
    """Which shapes may meet, by their groups and masks."""

    BOTH = 0
    """Each one's group is in the other's mask."""
    EITHER = 1
    """The group of one of them is in the other's mask, as in MuJoCo."""


class ContactModel(IntEnum):
    """Contact law: unilateral rows, or penalty forces with the normal law of Hertz or Hooke."""

    RIGID = 0
    SMOOTH = 1
    SMOOTH_HOOKE = 2


class ShapeType(IntEnum):
    """Geometry of a shape and the meaning of its size; the axis of round shapes is z."""

    PLANE = 0
    """Half-space below z = 0; no size."""
    SPHERE = 1
    """size[0]: radius [m]."""
    CAPSULE = 2
    """size[0]: radius, size[1]: half length of the segment between the caps' centres [m]."""
    CYLINDER = 3
    """size[0]: radius, size[1]: half length [m]."""
    BOX = 4
    """Half lengths [m]."""
    ELLIPSOID = 5
    """Half axes [m]."""
    CONE = 6
    """size[0]: radius of the base at z = -size[1]; the tip is at z = size[1] [m]."""
    HULL = 7
    """An asset's convex hull, scaled by size."""
    HEIGHT_FIELD = 8
    """An asset's grid of heights, scaled by size."""
    MESH = 9
    """An asset's triangles, scaled by size."""
    SPROCKET = 10
    """An asset's profile of concave arcs; size[0]: radius of the teeth's tips, size[1]: half width [m]. Meets spheres,
    whose centres count as in its middle plane."""
    GROOVE = 11
    """The room between two discs; size[0]: their radius, size[1]: half of their distance [m]. Meets spheres in it."""


class WorldStatus(IntFlag):
    """Bits of `State.world_status`."""

    OK = 0
    NON_FINITE = 1
    """A value of this world became NaN or infinite: the world is frozen until it is reset."""
    NOT_ASSEMBLED = 2
    """The closed loops could not be assembled for the coordinates that were set."""
    SINGULAR = 4
    """Axes of joints with no mass between them became parallel; for a step, the rate of one of them was held."""


class Pose(NamedTuple):
    """Position [m] and orientation (xyzw quaternion), both float64: kilometres keep their micrometres."""

    position: npt.NDArray[np.float64]
    rotation: npt.NDArray[np.float64]


def pose(position: Vec3 = (0.0, 0.0, 0.0), rotation: Quat = (0.0, 0.0, 0.0, 1.0)) -> Pose:
    """Pose from a position [m] and an xyzw quaternion (normalised here).

    Raises:
        ModelError: the quaternion has zero length or a component is not finite.
    """
    return Pose(finite_vector("pose", "position", position, 3), checked_rotation("pose", "rotation", rotation))


def checked_rotation(thing: str, field: str, rotation: Quat) -> npt.NDArray[np.float64]:
    """`rotation` as a unit quaternion (xyzw), or a ModelError."""
    q = finite_vector(thing, field, rotation, 4)
    norm = float(np.linalg.norm(q))
    if norm < 1e-12:
        raise ModelError(
            f"{thing}: {field} must be a quaternion of non-zero length (xyzw), got zeros; use (0, 0, 0, 1)"
        )
    unit: npt.NDArray[np.float64] = q / norm
    return unit


class ArrayLayout(NamedTuple):
    """Shape and Warp dtype of an array that is still to be made."""

    shape: tuple[int, ...]
    dtype: Any


LONGEST_VALUE: Final = 100
DEEPEST_VALUE: Final = 4


def formatted(value: Any) -> str:
    """A received value in one short line, for errors: NumPy's numbers as numbers, arrays by shape, objects by class."""
    try:
        return _formatted(value, DEEPEST_VALUE)
    except (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError):
        # whatever the value's own repr raises: integers of 5000 digits, lists in themselves
        return _classed(value)


def _formatted(value: Any, depth: int) -> str:
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, type):
        return f"the class {value.__name__}"
    kind = type(value)
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        small = isinstance(value, np.ndarray) and value.size <= 6 and value.dtype.kind in "iufb"
        return repr(value.tolist()) if small else f"an array of shape {tuple(value.shape)}"
    if kind in (tuple, list) and len(value) <= 12 and depth > 0:
        parts = [_formatted(part, depth - 1) for part in value]
        text = f"[{', '.join(parts)}]" if kind is list else f"({', '.join(parts)}{',' * (len(parts) == 1)})"
    elif kind in (tuple, list, dict, set, frozenset) and (depth == 0 or len(value) > LONGEST_VALUE):
        return f"{_classed(value)} of {len(value)}"
    elif kind is int and value.bit_length() > 4 * LONGEST_VALUE:
        return f"a number of {int(value.bit_length() * math.log10(2.0)) + 1} digits"
    elif kind in (str, bytes) and len(value) > LONGEST_VALUE:
        text = repr(value[:LONGEST_VALUE]) + " ..."
    elif kind.__repr__ is object.__repr__ or issubclass(kind, Readable):
        return _classed(value)
    else:
        text = " ".join(repr(value).split())
    if len(text) <= LONGEST_VALUE:
        return text
    return f"{text[: LONGEST_VALUE - 4]} ..." if kind.__module__ == "builtins" else _classed(value)


def _classed(value: Any) -> str:
    name = type(value).__name__
    return f"{'an' if name[:1].upper() in tuple('AEIO') else 'a'} {name}"


def number(value: Any) -> float:
    """`value` as a float: NaN where it is no number (text, a truth value, an array), infinite beyond float64."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, (bool, str)) or getattr(value, "ndim", None):
        return math.nan
    if isinstance(value, np.generic) and value.dtype.kind not in "iuf":
        return math.nan
    if not (hasattr(type(value), "__float__") or hasattr(type(value), "__index__")):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf
    except (TypeError, ValueError, ArithmeticError, RuntimeError):
        return math.nan


def host_values(value: Any) -> Any:
    """A tensor or Warp array of whatever device, which is waited for, as NumPy can read it; anything else as it is."""
    if hasattr(value, "data_ptr"):
        return value.detach().cpu()
    if hasattr(value, "numpy") and not hasattr(value, "__array_interface__"):
        return value.numpy()
    return value


def numbers(value: Any) -> npt.NDArray[np.float64]:
    """`value` as an array of float64: NaN where something is no number, a single NaN where it is no array."""
    try:
        given = np.asarray(host_values(value))
        if given.dtype.kind in "iuf":
            with np.errstate(over="ignore"):
                return given.astype(np.float64)
        if given.dtype.kind == "O":  # of integers beyond 64 bits, of fractions, or of anything else
            return np.array([number(part) for part in given.reshape(-1)], np.float64).reshape(given.shape)
    except (TypeError, ValueError, ArithmeticError, RuntimeError, RecursionError):
        pass
    return np.full((), np.nan)


def finite_vector(thing: str, field: str, value: Vec3 | Quat, length: int) -> npt.NDArray[np.float64]:
    """`value` as float64 of the given length within float32, or a ModelError that names it."""
    array = numbers(value)
    if array.shape == (length,) and bool((np.abs(array) <= FLOAT32_MAX).all()):
        return array
    beyond = " of at most 3.4e38" if np.isfinite(array).all() else ""
    raise ModelError(
        f"{thing}: {field} must be {length} finite numbers{beyond}, got {formatted(value)}; pass a sequence"
    )


Table: TypeAlias = tuple[Sequence[float], Sequence[float]]
"""Abscissae (increasing) and values of a piecewise linear function, extrapolated with its end slopes."""


DamperMap: TypeAlias = tuple[Sequence[float], Sequence[float], Sequence[Sequence[float]]]
"""Coordinates, rates (both increasing) and forces[rate][coordinate]: bilinear, held beyond the coordinates' ends,
extrapolated beyond the rates'.
"""


EffortLimit: TypeAlias = float | tuple[float, float]
"""Largest effort either way, or (lower, upper) with lower <= 0 <= upper, infinite for a side without a limit."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PositionDrive:
    """PD drive, integrated implicitly [N/m or N·m/rad, N·s/m or N·m·s/rad, N or N·m]; see `EffortLimit`."""

    stiffness: float
    damping: float = 0.0
    effort_limit: EffortLimit = float("inf")


@dataclasses.dataclass(frozen=True, kw_only=True)
class VelocityMotor:
    """Holds `joint_target_qd` with at most `effort_limit` [N or N·m]; see `EffortLimit`."""

    effort_limit: EffortLimit


@dataclasses.dataclass(frozen=True, kw_only=True)
class PrescribedPosition:
    """q(t): a table over time [s], or `joint_target_q` (and `joint_target_qd` as its rate) when None."""

    table: Table | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class PrescribedSpeed:
    """qd(t): a table over time [s], or `joint_target_qd` when None."""

    table: Table | None = None


_NONE: Final = Meaning("0 for none")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Material(ReadableFields):
    """Surface of a shape. Two of them meet with the smaller restitution, cohesion and damping, the sum of their
    compliances, and friction (of all three kinds) by the builder's `friction_rule`: the smaller one unless it is
    set. The surface of higher priority decides alone on friction (docs/theory.md).

    Attributes:
        friction: Coulomb's coefficient.
        rolling_friction, spinning_friction: largest torque per normal force across and about the normal [m].
        restitution: Newton's coefficient, 0 to 1.
        cohesion: normal force that the contact can pull with [N].
        compliance: of a contact point [m/N]; 0 is rigid.
        damping: relaxation time of the compliance [s].
        young_modulus: [Pa], of the smooth contact model.
        poisson_ratio: the same.
        priority: whole number of any sign.
    """

    friction: Annotated[NotNegative, _NONE] = 0.6
    rolling_friction: Annotated[NotNegative, _NONE] = 0.0
    spinning_friction: Annotated[NotNegative, _NONE] = 0.0
    restitution: Annotated[Fraction, Meaning("a coefficient, 0 for none")] = 0.0
    cohesion: Annotated[NotNegative, _NONE] = 0.0
    compliance: Annotated[NotNegative, _NONE] = 0.0
    damping: Annotated[NotNegative, _NONE] = 0.0
    young_modulus: Annotated[NotNegative, Meaning("pascals")] = 2.0e5
    poisson_ratio: Annotated[float, Ge(0.0), Le(0.5), Meaning("a ratio; 0.3 is usual")] = 0.3
    priority: Annotated[int, Ge(1 - 2**31), Le(2**31 - 1), Meaning("a whole number; 0 is usual")] = 0


Drive: TypeAlias = PositionDrive | VelocityMotor | PrescribedPosition | PrescribedSpeed


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dof(ReadableFields):
    """Limit, passive effort, friction and drive of one degree of freedom. Units: N and m, or N·m and rad.

    The passive effort is preload - stiffness (q - rest) - damping qd, taken implicitly; a table replaces
    the linear law: -spring_table(q - rest), -damper_table(qd), or -damper_map(q, qd), linearised every step;
    `joint_stiffness` and `joint_damping` of the model are then factors of the table, 1 as built. Where a
    law falls, its force is that at the step's start: steps must resolve it.
    """

    limit: tuple[float, float] | None = None
    armature: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    preload: float = 0.0
    friction: float = 0.0
    spring_table: Table | None = None
    damper_table: Table | None = None
    damper_map: DamperMap | None = None
    drive: Drive | None = None
