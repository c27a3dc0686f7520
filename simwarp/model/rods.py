"""Rods: chains of bodies and elastic joints, laid along points.

A node is a body with the mass of half of each neighbouring element, an element an elastic joint with the stiffness of
its section (kernels/dynamics/elastic.py). Ends are ordinary joints.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import ReadableFields
from simwarp.core.rotation import frame_along, matrix_of, quat_from_matrix
from simwarp.core.types import (
    WORLD,
    Material,
    ModelError,
    Pose,
    Vec3,
    finite_vector,
    formatted,
    numbers,
    pose as make_pose,
)
from simwarp.core.wording import suggestion
from simwarp.model.checks import checked_name, whole_number
from simwarp.model.rod_sections import Rectangle, Round, Section, Tube
from simwarp.model.specifications import BodySpec, JointSpec, ShapeSpec

Array: TypeAlias = npt.NDArray[np.float64]

SHARPEST: Final = math.pi / 2.0
"""Largest angle between neighbouring elements at rest [rad]."""
MOST_ELEMENTS: Final = 10_000
"""Of a rod."""
SHORTEST: Final = 1.0e-9
"""An element [m]."""
Z_TO_X: Final = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
"""Rotation of a shape whose axis is z onto the x axis of a body."""
CLEAR: Final = 1.25
"""Nodes of a rod that are nearer to each other along it than so many times its thickness never touch."""


@runtime_checkable
class RodMaterial(Protocol):
    """What a rod is made of (`simwarp.flex.Elastic`)."""

    @property
    def young(self) -> float:
        """Young's modulus [Pa]."""

    @property
    def poisson(self) -> float:
        """Poisson's ratio."""

    @property
    def density(self) -> float:
        """[kg/m³]."""

    @property
    def damping_time(self) -> float:
        """Damping per stiffness [s]."""


@dataclasses.dataclass(frozen=True)
class Clamp(ReadableFields):
    """The end of a rod is fixed to a body, by its index or name, or to the WORLD."""

    body: int | str = WORLD


@dataclasses.dataclass(frozen=True)
class Hinge(ReadableFields):
    """The end of a rod turns about its last point on a body: a ball joint, or about `axis` alone (world frame)."""

    body: int | str = WORLD
    axis: Vec3 | None = None


RodEnd: TypeAlias = Clamp | Hinge | None


@dataclasses.dataclass(frozen=True)
class Rod(ReadableFields):
    """A rod of a builder and of its models.

    Attributes:
        name: of it; nodes are bodies `name_0`, `name_1` and on, elements joints `name:0` and on.
        bodies: indices of the nodes.
        joints: indices of the elements.
        ends: indices of the joints that hold its ends, -1: it is loose.
        lengths: of the elements at rest [m].
        section: areas and moments.
        shapes: of the nodes, none if it touches nothing.
    """

    name: str
    bodies: tuple[int, ...]
    joints: tuple[int, ...]
    ends: tuple[int, int]
    lengths: tuple[float, ...]
    section: Section
    shapes: tuple[int, ...]


class RodBuilder(Protocol):
    """What a rod needs of a `ModelBuilder`."""

    bodies: list[BodySpec]
    joints: list[JointSpec]
    shapes: list[ShapeSpec]
    excluded_bodies: set[tuple[int, int]]

    @property
    def add_body(self) -> Callable[..., int]:
        """`ModelBuilder.add_body`, and so on."""

    @property
    def add_joint_elastic(self) -> Callable[..., int]: ...  # noqa: D102

    @property
    def add_joint_fixed(self) -> Callable[..., int]: ...  # noqa: D102

    @property
    def add_joint_spherical(self) -> Callable[..., int]: ...  # noqa: D102

    @property
    def add_joint_revolute(self) -> Callable[..., int]: ...  # noqa: D102

    @property
    def add_shape_capsule(self) -> Callable[..., int]: ...  # noqa: D102

    @property
    def exclude_collision(self) -> Callable[[int, int], None]: ...  # noqa: D102


@dataclasses.dataclass(frozen=True)
class RodNode:
    """A body of a rod to be: pose, mass [kg], inertia about its axes [kg·m²], half lengths before and behind [m]."""

    pose: Pose
    mass: float
    inertia: Array
    before: float
    behind: float


@dataclasses.dataclass(frozen=True)
class RodElement:
    """An elastic joint of a rod to be: length [m], z axis of its section, stiffness (6,) and damping (6,)."""

    length: float
    up: Array
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]


def rod_points(thing: str, points: Any, elements: int | None) -> Array:
    """(nodes, 3) nodes along a line [m]: the points themselves, or so many equal elements along it.

    Raises:
        ModelError: there are fewer than two, two follow each other at one place, or the line has a kink.
    """
    given = numbers(points)
    if given.ndim != 2 or given.shape[1] != 3 or len(given) < 2 or not np.isfinite(given).all():
        raise ModelError(
            f"{thing}: points must be two or more of three finite numbers [m], got {formatted(points)}; give x, y, "
            "z of each"
        )
    if elements is not None:
        count = whole_number(thing, "elements", elements, 1, MOST_ELEMENTS, "None takes the points as they are")
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(given, axis=0), axis=1))])
        at = np.linspace(0.0, along[-1], count + 1)
        given = np.stack([np.interp(at, along, given[:, axis]) for axis in range(3)], axis=1)
    chords = np.diff(given, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    if lengths.min() < SHORTEST:
        index = int(np.argmin(lengths))
        raise ModelError(
            f"{thing}: points that follow each other must be apart, got {given[index].tolist()} twice, "
            f"points {index} and {index + 1}; leave one out"
        )
    directions = chords / lengths[:, None]
    cosines = np.einsum("ij,ij->i", directions[1:], directions[:-1])
    if len(cosines) and cosines.min() < math.cos(SHARPEST):
        index = int(np.argmin(cosines)) + 1
        angle = math.degrees(math.acos(max(-1.0, float(cosines[index - 1]))))
        raise ModelError(
            f"{thing}: neighbouring elements must meet at less than 90 degrees, got {angle:.0f} at point {index}; "
            "take more points, or join two rods"
        )
    return given


def section_frames(thing: str, points: Array, up: Vec3 | None, twist: float) -> Array:
    """(elements, 3, 3) axes of the elements as columns, x along them; the others are carried along the line by the
    smallest rotation (Bishop 1975), and turned by up to `twist` [rad] about it on the way.
    """
    chords = np.diff(points, axis=0)
    directions = chords / np.linalg.norm(chords, axis=1)[:, None]
    frames = [matrix_of(frame_along(thing, tuple(chords[0]), up))]
    for before, after in itertools.pairwise(directions):
        frames.append(_smallest_rotation(before, after) @ frames[-1])
    middle = np.concatenate([[0.0], np.cumsum(np.linalg.norm(chords, axis=1))])
    share = 0.5 * (middle[1:] + middle[:-1]) / middle[-1]
    return np.stack([frame @ _about_x(twist * part) for frame, part in zip(frames, share, strict=True)])


def lay_rod(
    thing: str, points: Array, frames: Array, section: Section, material: RodMaterial
) -> tuple[list[RodNode], list[RodElement]]:
    """Nodes and elements along points whose elements have these frames."""
    shear = material.young / (2.0 * (1.0 + material.poisson))
    area = np.array(
        [
            material.young * section.area, section.shear_y * shear * section.area,
            section.shear_z * shear * section.area, shear * section.torsion, material.young * section.inertia_y,
            material.young * section.inertia_z,
        ]
    )  # fmt: skip
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    elements = [
        RodElement(
            float(length), frame[:, 2], tuple((area / length).tolist()),
            tuple((material.damping_time * area / length).tolist()),
        )
        for length, frame in zip(lengths, frames, strict=True)
    ]  # fmt: skip
    second = np.array([section.inertia_y + section.inertia_z, section.inertia_y, section.inertia_z])
    nodes = []
    for index, place in enumerate(points):
        before = 0.5 * float(lengths[index - 1]) if index > 0 else 0.0
        behind = 0.5 * float(lengths[index]) if index < len(lengths) else 0.0
        share = before + behind
        turn = quat_from_matrix(_between(frames[max(index - 1, 0)], frames[min(index, len(frames) - 1)]))
        nodes.append(
            RodNode(
                Pose(place, turn), material.density * section.area * share, material.density * second * share,
                before, behind,
            )
        )  # fmt: skip
    return nodes, elements


def build_rod(
    builder: RodBuilder, name: str, points: Any, section: Any, material: Any, up: Vec3 | None, twist: float,
    elements: int | None, ends: tuple[Any, Any], radius: float | None, surface: Material | None,
) -> Rod:  # fmt: skip
    """Add a rod to a builder, or nothing where something is wrong; arguments as for `ModelBuilder.add_rod`.

    Raises:
        ModelError: an argument cannot be used.
    """
    thing = checked_name("rod", name)
    numbers_of, stuff, turn = checked_rod(thing, section, material, twist)
    places = rod_points(thing, points, elements)
    nodes, parts = lay_rod(thing, places, section_frames(thing, places, up, turn), numbers_of, stuff)
    counts = len(builder.bodies), len(builder.joints), len(builder.shapes)
    apart = set(builder.excluded_bodies)
    try:
        bodies = tuple(
            builder.add_body(f"{name}_{i}", mass=node.mass, inertia=node.inertia, pose=node.pose, strict=False)
            for i, node in enumerate(nodes)
        )
        joints = tuple(
            builder.add_joint_elastic(
                f"{name}:{i}", bodies[i], bodies[i + 1], anchor0=places[i], anchor1=places[i + 1], up=part.up,
                stiffness=part.stiffness, damping=part.damping,
            )
            for i, part in enumerate(parts)
        )  # fmt: skip
        first = _hold_end(builder, thing, f"{name}:start", ends[0], bodies[0], places[0])
        last = _hold_end(builder, thing, f"{name}:end", ends[1], bodies[-1], places[-1])
        lengths = tuple(part.length for part in parts)
        shapes: tuple[int, ...] = ()
        if radius is not None or surface is not None:
            thick = max(numbers_of.reach_y, numbers_of.reach_z) if radius is None else radius
            shapes = tuple(
                builder.add_shape_capsule(
                    body, radius=thick, half_length=0.5 * (node.before + node.behind),
                    material=Material() if surface is None else surface,
                    pose=make_pose((0.5 * (node.behind - node.before), 0.0, 0.0), Z_TO_X),
                )
                for body, node in zip(bodies, nodes, strict=True)
            )  # fmt: skip
            for one, other in apart_along(lengths, 2.0 * thick):
                builder.exclude_collision(bodies[one], bodies[other])
    except ModelError:
        del builder.bodies[counts[0] :], builder.joints[counts[1] :], builder.shapes[counts[2] :]
        builder.excluded_bodies &= apart
        raise
    return Rod(name, bodies, joints, (first, last), lengths, numbers_of, shapes)


def _hold_end(builder: RodBuilder, thing: str, name: str, end: Any, body: int, place: Array) -> int:
    """The joint that holds the end of a rod, -1: it is loose."""
    if end is None:
        return -1
    if not isinstance(end, (Clamp, Hinge)):
        raise ModelError(f"{thing}: an end must be a Clamp or Hinge, got {formatted(end)}; None leaves it loose")
    holder = end.body
    if isinstance(holder, str):
        names = [each.name for each in builder.bodies]
        if holder not in names:
            raise ModelError(
                f"{thing}: an end must be held by a body that was added, got {formatted(holder)}; "
                + suggestion(holder, names, "add it before the rod, or give WORLD")
            )
        holder = names.index(holder)
    if isinstance(end, Clamp):
        return builder.add_joint_fixed(name, holder, body, anchor=place)
    if end.axis is None:
        return builder.add_joint_spherical(name, holder, body, anchor=place)
    return builder.add_joint_revolute(name, holder, body, anchor=place, axis=end.axis)


def checked_rod(thing: str, section: Any, material: Any, twist: Any) -> tuple[Section, RodMaterial, float]:
    """Section, material and twist of a rod.

    Raises:
        ModelError: one of them is of another kind.
    """
    if not isinstance(section, (Section, Round, Tube, Rectangle)):
        raise ModelError(
            f"{thing}: section must be a Round, Tube, Rectangle or Section, got {formatted(section)}; "
            "write sw.flex.Round(diameter=0.02)"
        )
    if not isinstance(material, RodMaterial):
        raise ModelError(
            f"{thing}: material must have young, poisson, density and damping_time, got {formatted(material)}; "
            "write sw.flex.Elastic(...)"
        )
    return section.numbers, material, float(finite_vector(thing, "twist", (twist,), 1)[0])


def apart_along(lengths: Sequence[float], thickness: float) -> list[tuple[int, int]]:
    """Pairs of nodes, beyond neighbours, whose places along a rod are too near for their shapes to be apart."""
    place = np.concatenate([[0.0], np.cumsum(lengths)])
    reach = CLEAR * thickness + np.concatenate([[0.0], lengths]) / 2.0 + np.concatenate([lengths, [0.0]]) / 2.0
    pairs, farthest = [], float(reach.max())
    for first in range(len(place)):
        for second in range(first + 2, len(place)):
            apart = place[second] - place[first]
            if apart >= 0.5 * (reach[first] + farthest):
                break  # and so are all that follow
            if apart < 0.5 * (reach[first] + reach[second]):
                pairs.append((first, second))
    return pairs


def _smallest_rotation(a: Array, b: Array) -> Array:
    """That turns the unit vector a to b."""
    axis = np.cross(a, b)
    cosine = float(a @ b)
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.eye(3) + skew + skew @ skew / (1.0 + cosine)


def _about_x(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _between(a: Array, b: Array) -> Array:
    """The rotation halfway between two that are less than half a turn apart."""
    u, _, v = np.linalg.svd(a + b)
    middle: Array = u @ v
    return middle
