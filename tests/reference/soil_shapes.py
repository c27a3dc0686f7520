"""Rigid bodies on soil, seen from below: lowest points over vertical columns, and shares of cells. Slow, float64.

A column is relative to the body's position. A rotation's columns are forward, left (a wheel's axis) and up.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from tests.reference.suspension_kinematics import exponential

Array = npt.NDArray[np.float64]


class Columns(NamedTuple):
    """Of k vertical columns: lowest point of the body (inf: none), and the share of the cell that it covers."""

    height: Array
    share: Array


class Shape(Protocol):
    """A rigid body on the soil."""

    @property
    def sweep(self) -> float:
        """How far from the middle a spin brings parts of it to the ground; 0 where it is about its axis."""

    def extent(self, rotation: Array) -> Array:
        """Half size of the box around it."""

    def columns(self, xy: Array, rotation: Array, spacing: Array | None) -> Columns:
        """Of columns at xy, relative to the body's position; shares are 1 without a spacing."""

    def sizes(self) -> tuple[float, float]:
        """Greatest length and width of a patch of contact."""

    def turns(self, rotation: Array) -> Array:
        """(3, 3) takes off a spin what leaves its surface where it is."""

    def smooth(self, xy: Array, rotation: Array) -> Array:
        """Lowest points over columns, of a surface that goes on beyond the body's sides where it has any."""


def strip_share(direction: Array, low: Any, high: Any, spacing: Array) -> Any:
    """Share of a rectangular cell about 0 where low <= p . direction <= high: exact.

    p . direction is the sum of two uniform variables, its distribution a second difference of squares.
    """
    a, b = np.abs(direction) * spacing
    a, b = max(a, b), min(a, b)

    def below(t: Any) -> Any:
        if b < 1e-6 * a:
            return np.clip(t / a + 0.5, 0.0, 1.0)
        t = np.clip(t, -(a + b), a + b)
        corners = ((a + b, 1), (a - b, -1), (b - a, -1), (-a - b, 1))
        return sum(sign * np.maximum(t + 0.5 * c, 0.0) ** 2 for c, sign in corners) / (2.0 * a * b)

    return np.maximum(below(np.asarray(high)) - below(np.asarray(low)), 0.0)


@dataclasses.dataclass(frozen=True)
class Wheel:
    """A rigid cylinder about its position; with a crown its radius is r - y^2/(2 crown)."""

    radius: float
    width: float
    crown: float | None = None

    @property
    def sweep(self) -> float:
        return 0.0

    def extent(self, rotation: Array) -> Array:
        a = rotation[:, 1]
        return self.radius * np.sqrt(np.maximum(1.0 - a * a, 0.0)) + 0.5 * self.width * np.abs(a)

    def sizes(self) -> tuple[float, float]:
        return 2.0 * self.radius, self.width

    def turns(self, rotation: Array) -> Array:
        return np.eye(3) - np.outer(rotation[:, 1], rotation[:, 1])

    def radius_at(self, y: Any) -> Any:
        return self.radius - (0.0 if self.crown is None else y * y / (2.0 * self.crown))

    def mantle(self, xy: Array, axis: Array) -> tuple[Array, Array]:
        """Lower hit of columns with the endless plain cylinder, and where along the axis; nan if there is none."""
        along = xy @ axis[:2]
        a = max(1.0 - axis[2] ** 2, 1e-300)
        c = np.einsum("ki,ki->k", xy, xy) - along**2 - self.radius**2
        root = (along * axis[2]) ** 2 - a * c
        z = (along * axis[2] - np.sqrt(np.where(root >= 0.0, root, np.nan))) / a
        return z, along + z * axis[2]

    def smooth(self, xy: Array, rotation: Array) -> Array:
        """The endless plain cylinder; crowns are left out."""
        return self.mantle(xy, rotation[:, 1])[0]

    def barrel(self, place: Array, axis: Array) -> float:
        """Lowest hit of one column with the crowned mantle within the width: roots of a quartic; inf if none."""
        assert self.crown is not None
        y = np.poly1d([float(axis[2]), float(place @ axis[:2])])
        square = np.poly1d([1.0, 0.0, float(place @ place)]) - y * y
        radius = np.poly1d([self.radius]) - y * y / (2.0 * self.crown)
        roots = np.roots((square - radius * radius).coeffs)
        z = roots.real[np.abs(roots.imag) < 1e-7]
        z = z[(np.abs(y(z)) <= 0.5 * self.width) & (radius(z) > 0.0)]
        return float(z.min()) if len(z) else np.inf

    def height(self, xy: Array, rotation: Array) -> Array:
        """Lowest point of the cylinder over columns at xy: on its mantle or one of its flat sides."""
        axis, half = rotation[:, 1], 0.5 * self.width
        if self.crown is None:
            z, y = self.mantle(xy, axis)
            lowest = np.where(np.abs(y) <= half, z, np.inf)
            lowest = np.where(np.isnan(z) | (1.0 - axis[2] ** 2 < 1e-18), np.inf, lowest)
        else:
            lowest = np.array([self.barrel(place, axis) for place in xy])
        if abs(axis[2]) < 1e-12:
            return np.asarray(lowest)
        for side in (-half, half):
            z = (side - xy @ axis[:2]) / axis[2]
            radial = np.einsum("ki,ki->k", xy, xy) + z * z - side * side
            lowest = np.where(radial <= self.radius_at(side) ** 2, np.minimum(lowest, z), lowest)
        return np.asarray(lowest)

    def columns(self, xy: Array, rotation: Array, spacing: Array | None) -> Columns:
        """With a spacing, a column beside the mantle counts as if moved along the axis to its edge, for the share of
        its cell within the width. Columns below a flat side, further out than half a cell, count in full.
        """
        if spacing is None:
            return Columns(self.height(xy, rotation), np.ones(len(xy)))
        axis, half = rotation[:, 1], 0.5 * self.width
        cosine = float(np.hypot(axis[0], axis[1]))
        flat = self.height(xy, rotation)
        if cosine < 1e-9:
            return Columns(flat, np.ones(len(xy)))
        level = axis[:2] / cosine
        _, y = self.mantle(xy, axis)
        y = np.where(np.isnan(y), np.inf, y)
        share = strip_share(level, (-half - y) * cosine, (half - y) * cosine, spacing)
        inside = (1.0 - 1e-12) * np.clip(y, -half, half)
        moved = xy + np.where(share > 0.0, (inside - y) * cosine, 0.0)[:, None] * level
        beside = self.height(moved, rotation)
        return Columns(np.where(share > 0.0, beside, flat), np.where(share > 0.0, share, 1.0))


@dataclasses.dataclass(frozen=True)
class Plate:
    """A flat rectangle, length along the first and width along the second axis, its position in the middle."""

    length: float
    width: float

    @property
    def sweep(self) -> float:
        return 0.5 * float(np.hypot(self.length, self.width))

    def extent(self, rotation: Array) -> Array:
        return 0.5 * (self.length * np.abs(rotation[:, 0]) + self.width * np.abs(rotation[:, 1]))

    def sizes(self) -> tuple[float, float]:
        return self.length, self.width

    def turns(self, rotation: Array) -> Array:
        return np.eye(3)

    def smooth(self, xy: Array, rotation: Array) -> Array:
        return np.asarray(-(xy @ rotation[:2, 2]) / rotation[2, 2])

    def columns(self, xy: Array, rotation: Array, spacing: Array | None) -> Columns:
        normal = rotation[:, 2]
        height = -(xy @ normal[:2]) / normal[2]
        share = np.ones(len(xy))
        for axis, half in ((rotation[:, 0], 0.5 * self.length), (rotation[:, 1], 0.5 * self.width)):
            u = xy @ axis[:2] + height * axis[2]
            level = float(np.hypot(axis[0], axis[1]))
            if spacing is None:
                share = share * (np.abs(u) <= half)
            else:
                share = share * strip_share(axis[:2] / level, (-half - u) * level, (half - u) * level, spacing)
        return Columns(np.where(share > 0.0, height, np.inf), share)


@dataclasses.dataclass(frozen=True)
class Box:
    """Half lengths along its axes."""

    half: tuple[float, float, float]

    @property
    def sweep(self) -> float:
        return float(np.linalg.norm(self.half))

    def extent(self, rotation: Array) -> Array:
        return np.asarray(np.abs(rotation) @ np.asarray(self.half))

    def lowest(self, rotation: Array) -> int:
        """Axis of the face that points down most."""
        return int(np.argmax(np.abs(rotation[2])))

    def sizes(self) -> tuple[float, float]:
        return 2.0 * self.half[0], 2.0 * self.half[1]

    def turns(self, rotation: Array) -> Array:
        return np.eye(3)

    def face(self, xy: Array, rotation: Array, k: int, side: float) -> Array:
        """Where columns meet one of the six faces; inf where they miss it."""
        n = rotation[:, k]
        if abs(n[2]) < 1e-12:
            return np.full(len(xy), np.inf)
        z = (side * self.half[k] - xy @ n[:2]) / n[2]
        points = np.column_stack([xy, z]) @ rotation
        others = [j for j in range(3) if j != k]
        inside = (np.abs(points[:, others]) <= np.asarray(self.half)[others]).all(axis=1)
        return np.where(inside, z, np.inf)

    def smooth(self, xy: Array, rotation: Array) -> Array:
        """The planes of the faces that columns meet first; of the lowest face beside the box and below steep faces."""
        faces = [(k, side) for k in range(3) for side in (-1.0, 1.0) if -side * rotation[2, k] > 0.2]
        heights = np.array([self.face(xy, rotation, k, side) for k, side in faces])
        low = self.lowest(rotation)
        found = []
        for place, column in zip(xy, heights.T, strict=True):
            k, side = faces[int(np.argmin(column))] if np.isfinite(column.min()) else (low, -np.sign(rotation[2, low]))
            found.append((side * self.half[k] - place @ rotation[:2, k]) / rotation[2, k])
        return np.array(found)

    def columns(self, xy: Array, rotation: Array, spacing: Array | None) -> Columns:
        """With a spacing, a cell that lies partly below the lowest face counts for that part, at the face's point
        nearest to the node in the face's own coordinates. Edges beyond which a face of less than 78 degrees goes on
        cut off nothing; nodes below such faces count in full, those below steeper ones not at all.
        """
        height = np.min([self.face(xy, rotation, k, side) for k in range(3) for side in (-1.0, 1.0)], axis=0)
        share = np.ones(len(xy))
        if spacing is None:
            return Columns(height, share)
        k = self.lowest(rotation)
        if abs(rotation[2, k]) < 1e-6:
            return Columns(height, share)
        sides = [(k + 1) % 3, (k + 2) % 3]
        middle = -np.sign(rotation[2, k]) * self.half[k] * rotation[:, k]
        limits = np.asarray(self.half)[sides]
        # coordinates on the face, whose plan is a parallelogram
        place = np.linalg.solve(rotation[:2, sides], (xy - middle[:2]).T).T
        goes_on = np.zeros(len(xy), bool)
        for one, other in ((0, 1), (1, 0)):
            edge = rotation[:2, sides[other]]
            across = np.array([edge[1], -edge[0]]) / np.linalg.norm(edge)
            across *= np.sign(across @ rotation[:2, sides[one]])
            half = float(across @ rotation[:2, sides[one]]) * limits[one]
            t = (xy - middle[:2]) @ across
            # down: how much the outward normals of the faces beyond both edges point downwards
            down = rotation[2, sides[one]]
            low, high = (-np.inf if down > 0.2 else -half), (np.inf if -down > 0.2 else half)
            share = share * strip_share(across, np.clip(low - t, -9, 9), np.clip(high - t, -9, 9), spacing)
            goes_on |= ((down > 0.2) & (t < -half)) | ((-down > 0.2) & (t > half))
        edge_height = np.clip(place, -limits, limits) @ rotation[2, sides] + middle[2]
        edge_height = np.where(share > 0.0, edge_height, np.inf)
        return Columns(np.where(goes_on, height, edge_height), np.where(goes_on | (share <= 0.0), 1.0, share))


@dataclasses.dataclass(frozen=True)
class Capsule:
    """A segment along its third axis, thickened; a ball where it has no length."""

    radius: float
    half_length: float = 0.0

    @property
    def sweep(self) -> float:
        return self.radius + self.half_length

    def extent(self, rotation: Array) -> Array:
        return self.radius + self.half_length * np.abs(rotation[:, 2])

    def sizes(self) -> tuple[float, float]:
        return 2.0 * self.radius, 2.0 * (self.radius + self.half_length)

    def turns(self, rotation: Array) -> Array:
        if self.half_length == 0.0:
            return np.zeros((3, 3))
        return np.eye(3) - np.outer(rotation[:, 2], rotation[:, 2])

    def smooth(self, xy: Array, rotation: Array) -> Array:
        return self.columns(xy, rotation, None).height

    def columns(self, xy: Array, rotation: Array, spacing: Array | None) -> Columns:
        """The lowest of the balls along the segment: so many that what is left out is far below a micrometre."""
        axis = rotation[:, 2]
        along = np.linspace(-self.half_length, self.half_length, 20001 if self.half_length else 1)
        height = np.empty(len(xy))
        for k, place in enumerate(xy):
            square = self.radius**2 - ((place - np.outer(along, axis[:2])) ** 2).sum(axis=1)
            z = np.where(square > 0.0, along * axis[2] - np.sqrt(np.maximum(square, 0.0)), np.inf)
            height[k] = z.min()
        return Columns(height, np.ones(len(xy)))


@dataclasses.dataclass
class Body:
    """A shape, where it is and how it moves."""

    shape: Shape
    position: Array
    rotation: Array = dataclasses.field(default_factory=lambda: np.eye(3))
    velocity: Array = dataclasses.field(default_factory=lambda: np.zeros(3))
    spin: Array = dataclasses.field(default_factory=lambda: np.zeros(3))

    def moved(self, dt: float) -> Body:
        """The pose moved by the velocity."""
        turn = exponential(dt * self.spin)
        return dataclasses.replace(self, position=self.position + dt * self.velocity, rotation=turn @ self.rotation)
