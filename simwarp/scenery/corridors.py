"""Indoor corridors along closed tracks: walls with skirting, doors, pictures, radiators; floor, ceiling, lamps."""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np

from simwarp.core.types import ModelError, ShapeType
from simwarp.geometry.visual_mesh import VisualMesh, joined
from simwarp.model.rules import RULES, Metres
from simwarp.scenery.solids import Array, box, closed_loft, moved, ribbon, stream, tone, varied, volume
from simwarp.scenery.tracks import Track, offset_line
from simwarp.scenery.visual import Label, Proxy, Visual

THICKNESS: Final = 0.12
"""Of the walls [m]."""
_PAINT: Final = tuple(tone(code) for code in ("3f7fb5", "c98a2d", "5d9a57", "b5524a", "7e63a8", "2f8f8f", "a8a04a"))
_WALL, _SKIRTING, _OUTSIDE = tone("e9e4d8"), tone("4c4640"), tone("8d8a84")


@dataclasses.dataclass(frozen=True, eq=False)
class Corridor:
    """A corridor in the frame of its track.

    Attributes:
        track: along its middle.
        width: between its walls [m].
        height: of its walls [m].
        walls: with all that hangs on them; contact sees the two walls as two MESHes.
        floor: at z = 0, one side upwards, with texture coordinates of its own metres left to `ImageTexture.metres`.
        ceiling: at the height of the walls, one side downwards.
        lamps: (m, 3) places for lamps under the ceiling, about 3 m apart [m].
    """

    track: Track
    width: float
    height: float
    walls: Visual
    floor: VisualMesh
    ceiling: VisualMesh
    lamps: Array


@RULES.arguments("corridor")
def corridor(
    track: Track, *, width: Metres = 2.0, height: Metres = 2.4, square: bool = True, seed: int = 0,
    furnished: bool = True,
) -> Corridor:  # fmt: skip
    """Walls on both sides of a track.

    Every stretch of the corridor has a colour of its own on the lower part of its walls, stronger on the outer wall, so
    that a picture tells where it was taken and which way the camera looked.

    Args:
        track: along the middle.
        width: between the walls [m].
        height: of the walls [m].
        square: walls meet at right angles, or whatever the polygon of the track has; otherwise they follow the arcs.
        seed: of colours, doors, pictures and radiators.
        furnished: with doors, pictures and radiators.

    Raises:
        ModelError: the track has no room for its walls.
    """
    if width < track.width:
        raise ModelError(f"corridor: width must be at least that of the track, {track.width:g} m, got {width!r}")
    line = track.corners if square else track.points[:-1]
    # side k of the line ends at its point k; of the rounded line it begins there
    section = np.arange(len(line)) if square else np.roll(track.section[:-1], 1)
    rng = stream("corridor", seed)
    paint = np.array(_PAINT)[rng.permutation(len(_PAINT))]
    clockwise = _area(line) < 0.0
    pieces, proxies = [], []
    for side in (1.0, -1.0):
        outer = (side > 0.0) == clockwise
        lower = paint[section % len(paint)] * (1.0 if outer else 0.75)
        wall = _wall(line, side, width, height, lower)
        pieces.append(wall)
        proxies.append(Proxy(kind=ShapeType.MESH, points=wall.vertices, triangles=wall.triangles))
        if furnished:
            pieces += _furniture(offset_line(line, 0.5 * side * width), side, height, rng)
    borders = np.stack([_closed(offset_line(line, 0.5 * side * width)) for side in (-1.0, 1.0)])
    count = math.ceil(track.length / 3.0)
    lamps = track.at((np.arange(count) + 0.5) * track.length / count)
    lamps[:, 2] = height - 0.15
    walls = Visual(name="corridor", mesh=joined(pieces), proxies=tuple(proxies), label=Label.WALL)
    return Corridor(
        track, width, height, walls, ribbon(borders, tone("9a968e")),
        ribbon(borders, tone("f0efe9"), height, upwards=False), lamps,
    )  # fmt: skip


def _area(line: Array) -> float:
    x, y = line.T
    return float(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def _closed(line: Array) -> Array:
    return np.concatenate([line, line[:1]])


def _wall(line: Array, side: float, width: float, height: float, lower: Array) -> VisualMesh:
    """One wall as a closed ring; `lower` (n, 3): colours below the middle of the stretches that end at the points."""
    dado = min(1.0, 0.45 * height)
    # distance from the inner face, height; then the colours up to the next point
    outline = [(-0.02, 0.0), (-0.02, 0.09), (0.0, 0.1), (0.0, dado), (0.0, height), (THICKNESS, height),
               (THICKNESS, 0.0)]  # fmt: skip
    rings = np.stack([
        np.concatenate([offset_line(line, side * (0.5 * width + away)), np.full((len(line), 1), z)], axis=1)
        for away, z in outline
    ], axis=1)  # fmt: skip
    # cells run from a point to the next one: the stretch that ends there
    ahead = np.roll(lower, -1, axis=0)
    plain = np.broadcast_to(np.stack([_SKIRTING, _SKIRTING, _WALL, _WALL, _OUTSIDE, _OUTSIDE, _OUTSIDE]), rings.shape)
    colors = plain.copy()
    colors[:, 2] = ahead
    colors[:, 3] = 0.75 * _WALL + 0.25 * ahead
    wall = closed_loft(
        rings if side < 0.0 else rings[:, ::-1], colors if side < 0.0 else np.roll(colors[:, ::-1], -1, 1)
    )
    assert volume(wall) > 0.0
    return wall


def _furniture(line: Array, side: float, height: float, rng: np.random.Generator) -> list[VisualMesh]:
    """Doors, pictures and radiators on the inner face of a wall."""
    parts: list[VisualMesh] = []
    for start, end in zip(np.roll(line, 1, axis=0), line, strict=True):
        length = float(np.linalg.norm(end - start))
        along = (end - start) / max(length, 1e-9)
        yaw = math.atan2(along[1], along[0])
        at = 0.45 + rng.uniform(0.0, 0.5)
        while True:
            kind = ("door", "picture", "radiator")[rng.integers(3)]
            width = {"door": 0.95, "picture": rng.uniform(0.5, 1.0), "radiator": 0.9}[kind]
            if at + width > length - 0.4:
                break
            place = start + (at + 0.5 * width) * along
            # in its own frame a thing hangs on the plane y = 0 and looks towards -y: the right of the line
            turn = yaw if side > 0.0 else yaw + math.pi
            parts += [moved(part, (*place, 0.0), yaw=turn) for part in _thing(kind, width, height, rng)]
            at += width + rng.uniform(0.5, 1.6)
    return parts


def _thing(kind: str, width: float, height: float, rng: np.random.Generator) -> list[VisualMesh]:
    half = 0.5 * width
    if kind == "door":
        tall = min(2.05, 0.9 * height)
        color = (tone("7a4f2a"), tone("8c8f94"), tone("2f4f6f"), tone("c9c2b0"))[rng.integers(4)]
        frame = box((half, 0.03, 0.5 * tall), tone("d9d4c7"), (0.0, 0.0, 0.5 * tall))
        leaf = box((half - 0.07, 0.03, 0.5 * tall - 0.04), color, (0.0, -0.015, 0.5 * tall - 0.04))
        window = box((0.1, 0.03, 0.25), tone("2b3640"), (0.18, -0.025, 0.75 * tall))
        handle = box((0.06, 0.03, 0.015), tone("d0b060"), (-half + 0.15, -0.05, 0.5 * tall))
        return [frame, leaf, window, handle]
    if kind == "radiator":
        ribs = [
            box((0.4 * half / 4.0, 0.05, 0.26), tone("f2f2ee"), ((k - 3.5) * half / 4.0, -0.05, 0.42)) for k in range(8)
        ]
        return [box((half, 0.03, 0.22), tone("cfcfc9"), (0.0, -0.03, 0.42)), *ribs]
    tall = rng.uniform(0.4, 0.7)
    middle = rng.uniform(0.85, min(1.5, height - 0.5 * tall - 0.1))
    frame = box((half, 0.02, 0.5 * tall), (tone("2a211a"), tone("b08d3a"), tone("f4f4f4"))[rng.integers(3)],
                (0.0, 0.0, middle))  # fmt: skip
    parts = [frame]
    for row in range(2):
        for column in range(2):
            color = varied(_PAINT[rng.integers(len(_PAINT))], 1, rng, 0.5)[0]
            inner, upper = 0.5 * (half - 0.04), 0.25 * (tall - 0.08)
            at = ((2 * column - 1) * inner, -0.01, middle + (2 * row - 1) * upper)
            parts.append(box((inner, 0.02, upper), color, at))
    return parts
