"""Roads outdoors: a race track between barriers, convoy paths, and what stands beside them."""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import Count
from simwarp.core.types import ModelError
from simwarp.geometry.visual_mesh import VisualMesh
from simwarp.model.rules import RULES, Metres
from simwarp.scenery.roadside import barrier_chain
from simwarp.scenery.solids import Array, ribbon, stream, tone, varied
from simwarp.scenery.tracks import Track
from simwarp.scenery.visual import Visual
from simwarp.vehicle.driving.paths import Path, smooth

ROAD_HEIGHT: Final = 0.005
"""Of painted roads above the ground, so that one lies on the other [m]."""


@dataclasses.dataclass(frozen=True, eq=False)
class Course:
    """A race track between barriers, in the frame of the track.

    Attributes:
        track: its lane.
        road: asphalt with white borders and a broken middle line, one side upwards.
        left: barriers on the left border, one MESH.
        right: the same on the right border.
    """

    track: Track
    road: VisualMesh
    left: Visual
    right: Visual


@RULES.arguments("race_course")
def race_course(track: Track, *, barrier_length: float = 2.0, barrier_height: Metres = 1.0) -> Course:
    """Red and white barriers on both borders of a track, and the road between them.

    Args:
        track: lane between the feet of the barriers.
        barrier_length: of one barrier [m].
        barrier_height: [m]; the feet are three quarters as wide.
    """
    foot = 0.375 * barrier_height
    left, right = (
        barrier_chain(track.border(side, track.width + 2.0 * foot)[:-1], closed=True, length=barrier_length,
                      height=barrier_height)
        for side in (1.0, -1.0)
    )  # fmt: skip
    return Course(track, road(track.path, width=track.width), left, right)


@RULES.arguments("road")
def road(path: Path, *, width: Metres, dash: float = 3.0, seed: int = 0) -> VisualMesh:
    """Asphalt along a path with white borders and a broken middle line, one side upwards, `ROAD_HEIGHT` high.

    Args:
        path: its middle.
        width: [m].
        dash: length of the dashes and of the gaps between them [m].
        seed: of the shades of the asphalt.
    """
    tangent = path.tangents()
    across = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    line = min(0.15, 0.05 * width)
    offsets = np.array([-0.5 * width, -0.5 * width + line, -0.25 * width, -0.5 * line])
    offsets = np.concatenate([offsets, -offsets[::-1]])
    count = len(path.points) - 1
    middle = 0.5 * (path.arc[1:] + path.arc[:-1])
    rng = stream("road", seed)
    asphalt, white = tone("55565a"), tone("e8e8e4")
    colors = varied(asphalt, 7 * count, rng, 0.06).reshape(7, count, 3)
    colors[[0, 6]] = white
    colors[3] = np.where((np.floor(middle / dash) % 2 == 0)[:, None], white, asphalt)
    return ribbon(path.points[None] + offsets[:, None, None] * across[None], colors, ROAD_HEIGHT)


CONVOY_PATHS: Final = 16
"""Two families, two flips, four quarter turns."""


def convoy_path(
    index: int, *, half_x: float = 90.0, half_y: float = 40.0, spacing: float = 0.5
) -> Path:  # fmt: skip
    """One of 16 smooth paths through six points: an S with four right-angled turns, or a C.

    Args:
        index: 0 to 15: family (0 S, 1 C) + 2 · flip (y mirrored) + 4 · quarter turns to the right.
        half_x, half_y: half extents before the quarter turns [m].
        spacing: of its points, about [m].

    Raises:
        ModelError: `index` is not in 0 to 15.
    """
    if isinstance(index, bool) or not isinstance(index, (int, np.integer)) or not 0 <= index < CONVOY_PATHS:
        raise ModelError(f"convoy_path: index must be in 0..{CONVOY_PATHS - 1}, got {index!r}; draw one of them")
    if index % 2 == 0:
        step = np.arange(6)
        nodes = np.stack([-1.0 + (2.0 / 3.0) * ((step + 1) // 2), -1.0 + (step // 2)], axis=1)
    else:
        nodes = np.stack([
            [-1.0, 0.0, 1.0 / 3.0, 1.0 / 3.0, 0.0, -1.0], [1.0, 0.8, 0.5, -0.5, -0.8, -1.0],
        ], axis=1)  # fmt: skip
    nodes = nodes * np.array([half_x, half_y if (index // 2) % 2 == 0 else -half_y])
    for _ in range(index // 4):
        nodes = np.stack([nodes[:, 1], -nodes[:, 0]], axis=1)
    return smooth(nodes, spacing=spacing)


@dataclasses.dataclass(frozen=True, eq=False)
class Detour:
    """A way past large obstacles that stand on the straight line from its start to its end.

    Attributes:
        path: from (-length / 2, 0) to (length / 2, 0).
        obstacles: (k, 3) x, y and radius of the obstacles [m].
        clear: least distance of the path from an obstacle's edge [m].
    """

    path: Path
    obstacles: Array
    clear: float


@RULES.arguments("detour")
def detour(
    seed: int = 0, *, length: Metres = 200.0, count: Count = 4, radius: tuple[Metres, Metres] = (3.0, 6.0),
    clear: Metres = 4.0, spacing: float = 0.5,
) -> Detour:  # fmt: skip
    """A smooth path around large obstacles, each passed on a side at random: for tests of what was trained on
    `convoy_path`.

    Args:
        seed: of places and sizes of the obstacles, and of the sides.
        length: of the straight line [m].
        count: of the obstacles.
        radius: least and greatest, of the obstacles [m].
        clear: least distance of the path from an obstacle's edge [m]: half a vehicle's width and more.
        spacing: of the points of the path, about [m].

    Raises:
        ModelError: there is too little room between the obstacles.
    """
    low, high = radius
    pitch = length / (count + 1)
    if low > high or pitch < 3.0 * (high + clear):
        raise ModelError(
            f"detour: least <= greatest radius and 3 (radius + clear) <= length / (count + 1) must hold, "
            f"got count={count!r}, radius={radius!r}, clear={clear:g}, length={length:g} m; make it longer"
        )
    rng = stream("detour", seed)
    sizes = rng.uniform(low, high, count)
    along = -0.5 * length + pitch * (np.arange(count) + 1.0 + rng.uniform(-0.1, 0.1, count))
    aside = rng.uniform(-0.3, 0.3, count) * sizes
    sides = rng.choice([-1.0, 1.0], count)
    obstacles = np.stack([along, aside, sizes], axis=1)
    past = aside + sides * (sizes + clear)
    for _ in range(30):
        nodes = np.stack([np.concatenate([[-0.5 * length], along, [0.5 * length]]), np.pad(past, 1)], axis=1)
        path = smooth(nodes, spacing=spacing)
        away = np.linalg.norm(path.points[:, None] - obstacles[None, :, :2], axis=2).min(axis=0)
        short = sizes + clear - away
        if short.max() <= 0.0:
            return Detour(path, obstacles, clear)
        past += sides * np.maximum(1.1 * short, 0.0)
    raise ModelError(f"detour: a path must stay {clear:g} m clear, but none did with seed {seed}; make it longer")


@RULES.arguments("beside")
def beside(
    path: Path, count: int, seed: int = 0, *, distance: tuple[Metres, Metres] = (4.0, 8.0), clear: float = 0.0
) -> Array:  # fmt: skip
    """(count, 3) x, y [m] and yaw [rad] of things along a path, at equal steps of its length.

    Sides and distances are random.

    Args:
        path: to stay clear of.
        count: of the things.
        seed: of sides, distances and yaws.
        distance: least and greatest, from the middle of the path [m].
        clear: least distance from all other parts of the path [m]; the greatest `distance` is the most that is
            tried.

    Raises:
        ModelError: a distance is not positive, or the least is above the greatest.
    """
    near, far = distance
    if near > far:
        raise ModelError(f"beside: distance must be the least, then the greatest, got {distance!r}; swap them")
    rng = stream("beside", seed)
    tangent = path.tangents()
    places = np.zeros((count, 3))
    for k, arc in enumerate(path.length * (np.arange(count) + 1.0) / (count + 1.0)):
        at = np.array([np.interp(arc, path.arc, path.points[:, axis]) for axis in range(2)])
        ahead = np.array([np.interp(arc, path.arc, tangent[:, axis]) for axis in range(2)])
        left = np.array([-ahead[1], ahead[0]]) / np.linalg.norm(ahead)
        best, room = at, -1.0
        for side in rng.permutation([1.0, -1.0]):
            away = at + side * rng.uniform(near, far) * left
            space = float(np.linalg.norm(path.points - away, axis=1).min())
            if space >= max(near, clear) - 1e-6:
                best, room = away, math.inf
                break
            if space > room:
                best, room = away, space
        places[k] = (*best, rng.uniform(-math.pi, math.pi))
    return places


def scattered(
    count: int, seed: int = 0, *, half: float = 40.0, apart: float = 4.0, keep_clear: npt.ArrayLike = ()
) -> Array:  # fmt: skip
    """(count, 3) x, y [m] and yaw [rad] of things strewn over a square about the origin, none too near to another.

    Args:
        count: of the things.
        seed: of the places.
        half: length of half a side [m].
        apart: least distance between two [m].
        keep_clear: (k, 3) discs x, y, radius that stay free [m].

    Raises:
        ModelError: there is not enough room.
    """
    rng = stream("scattered", seed)
    discs = np.asarray(keep_clear, dtype=np.float64).reshape(-1, 3)
    found = np.zeros((0, 2))
    for _ in range(200 * max(count, 1)):
        if len(found) == count:
            break
        at = rng.uniform(-half, half, 2)
        free = (np.linalg.norm(discs[:, :2] - at, axis=1) >= discs[:, 2]).all()
        if free and (np.linalg.norm(found - at, axis=1) >= apart).all():
            found = np.concatenate([found, at[None]])
    if len(found) < count:
        raise ModelError(
            f"scattered: {count} things {apart:g} m apart must fit into a square of {2.0 * half:g} m, found room for "
            f"{len(found)}; bring them nearer or take fewer"
        )
    return np.concatenate([found, rng.uniform(-math.pi, math.pi, (count, 1))], axis=1)
