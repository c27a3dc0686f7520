"""Closed tracks of straights and arcs: random ones for corridors and for races, with centre line and borders."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Annotated, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import Count, Meaning
from simwarp.core.types import ModelError
from simwarp.model.rules import POLYGON, RULES, Metres, word_of
from simwarp.scenery.solids import stream
from simwarp.vehicle.driving.paths import Path

Array = npt.NDArray[np.float64]
Where: TypeAlias = Literal["turn", "straight", "anywhere"]


@dataclasses.dataclass(frozen=True, eq=False)
class Track:
    """A closed lane. Arrays run along the centre line; the last point is the first one again.

    Attributes:
        path: centre line.
        width: of the lane [m].
        curvature: (n,) of the arcs, positive to the left, 0 on straights [1/m].
        section: (n,) which side of the polygon `corners` a point belongs to.
        corners: (sides, 2) of the polygon that was rounded; side k ends at corner k [m].
    """

    path: Path
    width: float
    curvature: Array
    section: npt.NDArray[np.int64]
    corners: Array

    @property
    def points(self) -> Array:
        """(n, 2) centre line [m]."""
        return self.path.points

    @property
    def arc(self) -> Array:
        """(n,) length from the start [m]."""
        return self.path.arc

    @property
    def length(self) -> float:
        """Length of a lap [m]."""
        return self.path.length

    @property
    def heading(self) -> Array:
        """(n,) direction of the centre line, without jumps [rad]."""
        tangent = self.path.tangents()
        return np.asarray(np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0])))

    def border(self, side: float, width: float | None = None) -> Array:
        """(n, 2) the left (side 1) or right (-1) border of the lane, or of one that is `width` wide [m]."""
        tangent = self.path.tangents()
        across = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        return np.asarray(self.points + 0.5 * side * (self.width if width is None else width) * across)

    @RULES.arguments("track")
    def starts(
        self, where: Annotated[Where, word_of("turn", "straight", "anywhere")] = "anywhere"
    ) -> npt.NDArray[np.int64]:
        """(k,) indices of the points at which a vehicle may start: those in turns, on straights, or all.

        Raises:
            ModelError: `where` is none of "turn", "straight" and "anywhere".
        """
        bent = self.curvature[:-1] != 0.0
        chosen = {"turn": bent, "straight": ~bent, "anywhere": np.ones_like(bent)}[where]
        return np.flatnonzero(chosen)

    def at(self, arc: npt.ArrayLike) -> Array:
        """(..., 3) x, y [m] and heading [rad] at lengths along the centre line, over as many laps as they are."""
        s = np.asarray(arc, dtype=np.float64)
        inside = np.mod(s, self.length)
        values = [np.interp(inside, self.arc, column) for column in (*self.points.T, self.heading)]
        return np.stack(values, axis=-1)

    @RULES.arguments("track")
    def marks(self, every: Metres, side: float, width: float | None = None) -> Array:
        """(m, 3) x, y [m] and heading [rad] of marks on a border.

        Args:
            every: length of the centre line between two marks, or a little less [m].
            side: 1: the left border, -1: the right one.
            width: of the lane [m]; None: that of the track.

        Raises:
            ModelError: `every` is not positive.
        """
        places = self.at(np.arange(0.0, self.length - 1e-9, self.length / math.ceil(self.length / every)))
        away = 0.5 * side * (self.width if width is None else width)
        places[:, 0] -= away * np.sin(places[:, 2])
        places[:, 1] += away * np.cos(places[:, 2])
        return places


@RULES.arguments("track")
def rounded(
    corners: Annotated[npt.ArrayLike, POLYGON], radii: float | Sequence[float] | Array, *, width: Metres,
    spacing: Metres = 0.1,
) -> Track:  # fmt: skip
    """A polygon whose corners are arcs.

    Args:
        corners: (k, 2) [m], k >= 3; straight on at a corner is not allowed.
        radii: of the arcs, one for all or one each [m].
        width: of the lane [m].
        spacing: at most, between points [m].

    Raises:
        ModelError: arcs overlap, or the lane is wider than twice a radius.
    """
    polygon = np.asarray(corners, dtype=np.float64)
    radius = np.broadcast_to(np.asarray(radii, dtype=np.float64), len(polygon))
    if not (radius > 0.5 * width).all():
        raise ModelError(
            f"track: radii must exceed half the width ({0.5 * width:g} m), got {radius.min():g} m; raise it"
        )
    into, size, turn = _sides(polygon)
    tangent = radius * np.tan(0.5 * np.abs(turn))
    free = size - tangent - np.roll(tangent, 1)
    if free.min() < -1e-9:
        short = int(free.argmin())
        raise ModelError(
            f"track: arcs must fit on the sides, but side {short} is {-free[short]:.3g} m too short; "
            "use smaller radii or longer sides"
        )
    points, curvature, section = [], [], []
    for k, corner in enumerate(polygon):
        # the straight before the corner, then its arc, both without their last point
        start = corner - (size[k] - tangent[k - 1]) * into[k]
        count = math.ceil(max(free[k], 0.0) / spacing - 1e-9)
        if free[k] > 1e-6:
            share = np.arange(count) / count
            points.append(start + share[:, None] * free[k] * into[k])
            curvature.append(np.zeros(count))
            section.append(np.full(count, k))
        sign = math.copysign(1.0, turn[k])
        left = np.array([-into[k, 1], into[k, 0]]) * sign
        center = corner - tangent[k] * into[k] + radius[k] * left
        count = max(4, math.ceil(radius[k] * abs(turn[k]) / spacing))
        angle = np.arange(count) / count * abs(turn[k])
        points.append(center + radius[k] * (np.sin(angle)[:, None] * into[k] - np.cos(angle)[:, None] * left))
        curvature.append(np.full(count, sign / radius[k]))
        section.append(np.where(angle < 0.5 * abs(turn[k]), k, (k + 1) % len(polygon)))
    closed = [np.concatenate([*values, values[0][:1]]) for values in (points, curvature, section)]
    return Track(Path(closed[0], closed=True), float(width), closed[1], closed[2], polygon)


def _sides(polygon: Array) -> tuple[Array, Array, Array]:
    """Unit direction and length of the side that ends at each corner, and the turn there [rad]."""
    side = polygon - np.roll(polygon, 1, axis=0)
    size = np.linalg.norm(side, axis=1)
    into = side / size[:, None]
    out = np.roll(into, -1, axis=0)
    turn = np.arctan2(into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], (into * out).sum(axis=1))
    return into, size, turn


@RULES.arguments("indoor_track")
def indoor_track(
    seed: int = 0, *, blocks: Annotated[Count, Meaning("whole blocks; more give more turns")] = 5,
    pitch: float = 3.0, min_radius: float = 0.8, width: float = 1.1,
    spacing: float = 0.05,
) -> Track:  # fmt: skip
    """A random track of right-angled turns, as corridors around blocks of rooms are.

    Args:
        seed: of its form; about half of them run clockwise.
        blocks: of rooms that it goes round; more of them give more turns.
        pitch: of the blocks, at least [m]: corridors that are narrower do not meet.
        min_radius: of the turns [m], at most half the pitch.
        width: of the lane [m].
        spacing: of its points [m].

    Raises:
        ModelError: `blocks` is not a positive integer, or the turns do not fit the width and the pitch.
    """
    if not 0.5 * width < min_radius <= 0.5 * pitch:
        raise ModelError(
            f"indoor_track: half the width < min_radius <= half the pitch must hold, got width={width!r}, "
            f"min_radius={min_radius!r}, pitch={pitch!r} m; raise the pitch"
        )
    rng = stream("indoor track", seed)
    corners = _outline(_blocks(blocks, rng))
    columns, rows = np.unique(corners[:, 0]), np.unique(corners[:, 1])
    lines = [np.arange(values[0], values[-1] + 1) for values in (columns, rows)]
    places = [np.cumsum(pitch * rng.uniform(1.0, 1.7, len(line))) for line in lines]
    polygon = np.stack([np.interp(corners[:, k], lines[k], places[k]) for k in range(2)], axis=1)
    polygon -= 0.5 * (polygon.min(axis=0) + polygon.max(axis=0))
    radii = rng.uniform(min_radius, 0.5 * pitch, len(polygon))
    if rng.random() < 0.5:
        polygon, radii = polygon[::-1], radii[::-1]
    return rounded(polygon, radii, width=width, spacing=spacing)


_AROUND = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))


def _blocks(count: int, rng: np.random.Generator) -> set[tuple[int, int]]:
    """Cells in one piece without holes, of which no two touch only at a corner."""
    cells = {(0, 0)}
    while len(cells) < count:
        free = []
        for x, y in sorted({(a + dx, b + dy) for a, b in cells for dx, dy in _AROUND[::2]} - cells):
            taken = [(x + dx, y + dy) in cells for dx, dy in _AROUND]
            runs = sum(taken[k] and not taken[k - 1] for k in range(8))
            if runs == 1:
                free.append((x, y))
        cells.add(free[rng.integers(len(free))])
    return cells


def _outline(cells: set[tuple[int, int]]) -> Array:
    """Corners of the outline of cells, counter-clockwise."""
    follow = {}
    for x, y in cells:
        square = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)]
        for k, (dx, dy) in enumerate(((0, -1), (1, 0), (0, 1), (-1, 0))):
            if (x + dx, y + dy) not in cells:
                follow[square[k]] = square[(k + 1) % 4]
    loop = [min(follow)]
    while follow[loop[-1]] != loop[0]:
        loop.append(follow[loop[-1]])
    points = np.array(loop, dtype=np.float64)
    bend = np.abs(_sides(points)[2]) > 0.1
    return points[bend]


def race_track(
    seed: int = 0, *, size: float = 100.0, width: float = 12.5, min_radius: float = 12.0, turns: int = 9,
    spacing: float = 0.5,
) -> Track:  # fmt: skip
    """A random track of fast and slow turns about the origin.

    Args:
        seed: of its form; about half of them run clockwise.
        size: diameter of the circle that holds the corners of its polygon [m].
        width: of the lane [m].
        min_radius: of the turns [m].
        turns: corners of its polygon.
        spacing: of its points [m].

    Raises:
        ModelError: no such track was found; there is too little room.
    """
    rng = stream("race track", seed)
    if min_radius <= 0.5 * width:
        raise ModelError(
            f"race_track: min_radius must exceed half the width, got {min_radius!r} m and {width!r} m; raise it"
        )
    for _ in range(500):
        angle = 2.0 * math.pi * (np.arange(turns) + rng.uniform(-0.3, 0.3, turns)) / turns
        reach = 0.5 * size * rng.uniform(0.45, 1.0, turns)
        polygon = reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        if rng.random() < 0.5:
            polygon = polygon[::-1]
        _, lengths, turn = _sides(polygon)
        if np.abs(turn).min() < 0.05:
            continue
        room = 0.5 * np.minimum(lengths, np.roll(lengths, -1)) / np.tan(0.5 * np.abs(turn))
        if room.min() < min_radius:
            continue
        track = rounded(polygon, min_radius + rng.uniform(0.5, 1.0, turns) * (np.minimum(room, size) - min_radius),
                        width=width, spacing=spacing)  # fmt: skip
        if _clearance(track, math.pi * min_radius) > 1.3 * width:
            return track
    raise ModelError(
        f"race_track: {turns} turns of radius >= {min_radius:g} m, {width:g} m wide, must fit into {size:g} m; "
        "raise size, or lower turns or min_radius"
    )


def _clearance(track: Track, apart: float) -> float:
    """Least distance of points of the centre line that are more than `apart` along it from each other [m]."""
    step = max(1, len(track.points) // 300)
    points, arc = track.points[:-1:step], track.arc[:-1:step]
    along = np.abs(arc[:, None] - arc[None])
    along = np.minimum(along, track.length - along)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    far = along > apart
    return float(distance[far].min()) if far.any() else math.inf


def offset_line(points: npt.ArrayLike, distance: float) -> Array:
    """(n, 2) the closed line that lies `distance` to the left of a closed line [m], its corners mitred.

    Raises:
        ModelError: a side turns round: the line is too narrow for that.
    """
    line = np.asarray(points, dtype=np.float64)
    into, _, turn = _sides(line)
    normal = np.stack([-into[:, 1], into[:, 0]], axis=1)
    both = normal + np.roll(normal, -1, axis=0)
    moved = line + distance * both / (1.0 + np.cos(turn))[:, None]
    if ((moved - np.roll(moved, 1, axis=0)) * into).sum(axis=1).min() <= 0.0:
        raise ModelError(f"line: there must be room {distance:g} m beside it, but a side vanishes; make it narrower")
    return np.asarray(moved)
