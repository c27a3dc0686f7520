"""Mates between two parts, summed: their locked axes leave a motion, and that is the joint."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import frame_from_axis, matrix_of
from simwarp.core.types import JointType, ModelError
from simwarp.importers.solidworks.exported_script import Record

Array = npt.NDArray[np.float64]

FREE_MOTION: Final = 1.0e-5
"""Singular values of locked axes below it are noise of exported digits: the motion is free."""

KINDS: Final = {
    "ChLinkMateParallel": "parallel", "ChLinkMateOrthogonal": "orthogonal", "ChLinkMateXdistance": "distance",
    "ChLinkMateDistanceZ": "distance", "ChLinkMateSpherical": "spherical", "ChLinkMateCoaxial": "coaxial",
    "ChLinkMateCylindrical": "coaxial", "ChLinkMatePlane": "plane", "ChLinkMatePlanar": "plane",
    "ChLinkMateFix": "fixed", "ChLinkMateGeneric": "generic", "ChLinkMateRevolute": "revolute",
    "ChLinkMatePrismatic": "prismatic",
}  # fmt: skip

SETTINGS: Final = ("SetFlipped", "SetName", "SetConstrainedCoords", "Initialize", "SetDistance", "SetDisabled")


@dataclasses.dataclass(frozen=True)
class Mate:
    """What one link locks between two parts.

    Attributes:
        name: of the mate.
        first, second: the parts.
        rows: (n, 6) coefficients of the relative velocity at the world's origin [m/s] and of the relative angular
            velocity [rad/s] that must be 0.
        point: of the first part [m].
        direction: of the mate; None where it has none.
    """

    name: str
    first: Record
    second: Record
    rows: Array
    point: Array
    direction: Array | None


@dataclasses.dataclass(frozen=True)
class Rest:
    """The motion that mates leave.

    Attributes:
        kind: joint with this motion; None where there is none.
        freedom: independent motions that are left.
        anchor: a point of the joint [m].
        axis: its direction; None of joints without.
    """

    kind: JointType | None
    freedom: int
    anchor: Array
    axis: Array | None = None


def read_mate(link: Record, name: str, old: bool) -> Mate:
    """The locked axes of a link.

    Raises:
        ModelError: its values are not those that the exporter writes.
    """
    kind = KINDS[link.kind]
    start = link.last("Initialize")
    if start is None or len(start.values) < 2 or not all(isinstance(body, Record) for body in start.values[:2]):
        raise ModelError(f"mate '{name}' (line {link.line}): Initialize must name two parts; export the script again")
    first, second, *rest = start.values
    vectors = [value for value in rest if isinstance(value, np.ndarray) and value.shape == (3,)]
    needed = {"fixed": 0, "spherical": 2, "distance": 3}.get(kind, 4)
    if any(value is True for value in rest) or len(vectors) < needed:
        raise ModelError(
            f"mate '{name}' (line {start.line}): Initialize must have {needed} vectors in world axes, "
            f"got {len(vectors)}; export the script again"
        )
    point = vectors[0] if vectors else np.zeros(3)
    directions = [vector for vector in reversed(vectors[2:]) if np.linalg.norm(vector) > 0.5]
    direction = directions[0] / np.linalg.norm(directions[0]) if directions else None
    if direction is None and kind not in ("fixed", "spherical"):
        raise ModelError(
            f"mate '{name}' (line {start.line}): must have a direction, got zeros; export the script again"
        )
    rows = _rows(kind, name, link, old, point, direction, vectors)
    told = directions[-1] / np.linalg.norm(directions[-1]) if directions else None
    return Mate(name, first, second, rows, point, told)


def _rows(
    kind: str, name: str, link: Record, old: bool, point: Array, direction: Array | None, vectors: Sequence[Array]
) -> Array:
    places, turns = [True] * 3, [True] * 3
    frame = np.eye(3) if direction is None else matrix_of(frame_from_axis(f"mate '{name}'", direction))
    if kind == "orthogonal":
        across = np.cross(vectors[2], vectors[3])
        return np.concatenate([np.zeros(3), across / max(float(np.linalg.norm(across)), 1e-12)])[None]
    if kind == "generic":
        mask = link.last("SetConstrainedCoords")
        if mask is None or len(mask.values) != 6 or not all(isinstance(value, bool) for value in mask.values):
            raise ModelError(f"mate '{name}' (line {link.line}): SetConstrainedCoords must have six truth values")
        places, turns = mask.values[:3], mask.values[3:]
        if old:  # the axis is x there: in our frame it is z
            places, turns = [*places[1:], places[0]], [*turns[1:], turns[0]]
        if places[0] != places[1] or turns[0] != turns[1]:
            raise ModelError(
                f"mate '{name}' (line {link.line}): what it locks across its axis must not depend on the direction, "
                f"got {mask.values}; use a mate of SolidWorks"
            )
    else:
        locked = {
            "parallel": (0, 0, 1, 0), "distance": (0, 1, 0, 0), "spherical": (1, 1, 0, 0), "coaxial": (1, 0, 1, 0),
            "plane": (0, 1, 1, 0), "fixed": (1, 1, 1, 1), "revolute": (1, 1, 1, 0), "prismatic": (1, 0, 1, 1),
        }[kind]  # fmt: skip
        sideways, along, tilt, spin = (bool(value) for value in locked)
        places, turns = [sideways, sideways, along], [tilt, tilt, spin]
    rows = [np.concatenate([frame[:, k], np.cross(point, frame[:, k])]) for k in range(3) if places[k]]
    rows += [np.concatenate([np.zeros(3), frame[:, k]]) for k in range(3) if turns[k]]
    return np.array(rows).reshape(-1, 6)


def rest_of(mates: Sequence[Mate]) -> Rest:
    """The motion that all mates between two parts leave."""
    points = np.array([mate.point for mate in mates])
    centre = points.mean(axis=0)
    size = float(np.linalg.norm(points - centre, axis=1).max())
    size = size if size > 1e-6 else 1.0
    rows = np.concatenate([mate.rows for mate in mates])
    # velocity at the centre, and angular velocity times a length of the mates: all in m/s
    about = rows[:, 3:] - np.cross(centre, rows[:, :3])
    locked = np.concatenate([rows[:, :3], about / size], axis=1)
    length = np.linalg.norm(locked, axis=1, keepdims=True)
    _, values, basis = np.linalg.svd(locked / length, full_matrices=True)
    rank = int((values > FREE_MOTION).sum())
    motions = basis[rank:]
    return _classified(motions[:, :3], motions[:, 3:] / size, centre, mates)


def _classified(slides: Array, turns: Array, centre: Array, mates: Sequence[Mate]) -> Rest:
    """Slides of the centre and turns (k, 3) of k independent motions, as a joint."""
    freedom = len(slides)
    if freedom == 0:
        return Rest(JointType.FIXED, 0, centre)
    scale = float(np.linalg.norm(turns, axis=1).max(initial=0.0))
    _, values, right = np.linalg.svd(turns / max(scale, 1e-12))
    left = np.linalg.svd((turns / max(scale, 1e-12)).T)[2]
    turning = 0 if scale < FREE_MOTION else int((values > FREE_MOTION).sum())
    axis = right[0]
    if turning == 0:
        if freedom == 1:
            return Rest(JointType.PRISMATIC, 1, mates[0].point, _directed(slides[0], mates))
        return Rest(None, freedom, centre)
    # combinations of motions: the first ones turn, the others only slide
    slides, turns = left @ slides, left @ turns
    anchor, pitch = _on_axis(slides[0], turns[0], centre, axis, slides[turning:])
    if turning == 1 and freedom == 1 and pitch < FREE_MOTION:
        return Rest(JointType.REVOLUTE, 1, _near(anchor, axis, mates), _directed(axis, mates))
    if turning == 1 and freedom == 2 and np.linalg.norm(np.cross(_unit(slides[1]), axis)) < 10 * FREE_MOTION:
        return Rest(JointType.CYLINDRICAL, 2, _near(anchor, axis, mates), _directed(axis, mates))
    if turning == 1 and freedom == 3 and np.abs(slides[1:] @ axis).max() < 10 * FREE_MOTION:
        return Rest(JointType.PLANAR, 3, mates[0].point, _directed(axis, mates))
    if turning == 3 and freedom == 3:
        # v + w x (p - centre) = 0 for all motions
        crossed = np.concatenate([np.cross(turn, np.eye(3)).T for turn in turns])
        offset, *_ = np.linalg.lstsq(crossed, -slides.reshape(-1), rcond=None)
        if np.abs(crossed @ offset + slides.reshape(-1)).max() < FREE_MOTION * max(float(np.abs(slides).max()), 1e-3):
            return Rest(JointType.SPHERICAL, 3, centre + offset)
    return Rest(None, freedom, centre)


def _on_axis(slide: Array, turn: Array, centre: Array, axis: Array, others: Array) -> tuple[Array, float]:
    """A point of the axis of a turn, and how much it slides along it per radius of the mates."""
    square = float(turn @ turn)
    free = slide - sum((_unit(other) * (slide @ _unit(other)) for other in others), np.zeros(3))
    return centre + np.cross(turn, free) / square, abs(float(free @ axis)) / np.sqrt(square)


def _unit(vector: Array) -> Array:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)


def _directed(axis: Array, mates: Sequence[Mate]) -> Array:
    """The axis in the sense of the first mate that has one along it, or from the first mate to one further along it.

    The sense in which a factorisation gives it hangs on the processor.
    """
    unit = _unit(axis)
    for mate in mates:
        if mate.direction is not None and abs(float(mate.direction @ unit)) > 0.5:
            return unit * float(np.sign(mate.direction @ unit))
    for mate in mates[1:]:
        way = mate.point - mates[0].point
        if abs(float(way @ unit)) > 0.5 * float(np.linalg.norm(way)):
            return unit * float(np.sign(way @ unit))
    return unit * float(np.sign(unit[np.abs(unit).argmax()]))


def _near(anchor: Array, axis: Array, mates: Sequence[Mate]) -> Array:
    """The point of the axis that is nearest to that of the first mate."""
    unit = _unit(axis)
    return anchor + unit * float((mates[0].point - anchor) @ unit)


def between(mates: Sequence[Mate]) -> dict[tuple[int, int], list[Mate]]:
    """Mates by the pair of parts (identities of their records) that they tie."""
    pairs: dict[tuple[int, int], list[Mate]] = {}
    for mate in mates:
        first, second = sorted((id(mate.first), id(mate.second)))
        pairs.setdefault((first, second), []).append(mate)
    return pairs


def mate_name(link: Record) -> str:
    """Name of a link, or its line."""
    named = link.last("SetName")
    value: Any = named.values[0] if named is not None and named.values else ""
    return value if isinstance(value, str) and value else f"line {link.line}"
