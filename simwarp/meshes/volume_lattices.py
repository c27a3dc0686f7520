"""Lattices: boxes of equal cells, and closed surfaces in a grid of hexahedra whose cut cells count by their share.

The share of a cell is exact, not sampled: triangles are cut along the planes of the grid, and each piece adds the
volume below it in its column of cells, with the sign of its normal (the divergence theorem for the field (0, 0, z)).
"""

from __future__ import annotations

import itertools
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from simwarp.core.types import FLOAT32_MAX, ModelError, Vec3, formatted, numbers
from simwarp.core.wording import shortened
from simwarp.meshes.lattices import box_of_hexahedra, box_of_tetrahedra
from simwarp.meshes.solid_elements import CORNERS
from simwarp.meshes.volume_files import Surface, closed_triangles
from simwarp.meshes.volume_mesh import EmbeddedSurface, Points, VolumeMesh

MOST_CELLS = 1_000_000
"""Of a grid; no step of a mesh of a thousandth of them would be fast."""
SNAP = 1e-9
"""Of a cell's side: what is nearer to a plane of the grid is on it."""
LIGHTEST = 1e-3
"""Least share of a cell that is there for a vertex alone: its nodes must have a mass."""
MOST_AWAY = 0.05
"""Of a surface's volume: by how much that of its lattice may differ."""
OVERLAP = 1e-6
"""Of a cell: by how much its share may leave 0 to 1 by rounding."""

Cells = npt.NDArray[np.int64]


def box(
    size: Vec3, cells: int | tuple[int, int, int], *, elements: Literal["hexahedra", "tetrahedra"] = "hexahedra"
) -> VolumeMesh:  # fmt: skip
    """A box around the origin, whose nodes are named by the sides they lie on: "x_min", "x_max", "y_min" and so on.

    Args:
        size: lengths of its sides [m].
        cells: number of cells along each of them, or one number for all three.
        elements: hexahedra, or five tetrahedra in each cell.

    Raises:
        ModelError: a length or a number is not positive, or there are no such elements.
    """
    sides = _positive("box", "size", size, (3,), "lengths of the sides [m]")
    along = numbers(cells)
    if along.shape not in ((), (3,)) or not ((along >= 1.0) & (along == np.round(along))).all():
        raise ModelError(
            f"box: cells must be one or three whole numbers above 0, got {formatted(cells)}; give those along x, y, z"
        )
    makers = {"hexahedra": box_of_hexahedra, "tetrahedra": box_of_tetrahedra}
    if elements not in makers:
        raise ModelError(f"box: elements must be hexahedra or tetrahedra, got {formatted(elements)}; name one of them")
    count = np.broadcast_to(along, 3)
    _check_count("box", float(count.prod()), "give fewer")
    x, y, z = count.astype(int).tolist()
    points, found = makers[elements]((x, y, z), (float(sides[0]), float(sides[1]), float(sides[2])))
    points -= sides / 2.0
    return VolumeMesh(points=points, elements=found, sets=_sides(points), name="box")


def lattice(
    surface: Surface, *, spacing: float | Vec3, scale: float = 1.0, least_fill: float = 0.05
) -> VolumeMesh:  # fmt: skip
    """A closed surface in a grid of hexahedra: cells inside it are full, those that it cuts count by their share.

    Mass and stiffness of a cut cell are the full cell's times that share, which is that of the triangles to rounding.
    Vertices of the surface are carried by the cells they lie in, whose nodes' displacements they interpolate. The grid
    is centred on the surface. Nodes at its ends are named: "x_min", "x_max", "y_min" and so on. Where two parts are
    nearer than a cell they may share nodes, and then hold together.

    Args:
        surface: path of an OBJ, STL, PLY or other mesh file, a `trimesh.Trimesh`, or vertices (v, 3) [m] and triangles
            (t, 3), counter-clockwise seen from outside.
        spacing: side of the cells [m], or three of them along x, y and z.
        scale: metres per unit of the surface, 0.001 for one in millimetres.
        least_fill: share of a cell below which it is left out, where no vertex needs it and its neighbours hold
            together without it. The mass that is lost so is below this share of the cells that are left out.

    Raises:
        ModelError: the surface is not closed, faces inwards or overlaps itself, a number breaks its rule, or the cells
            are so large that the mass is wrong by more than 5 %.
    """
    name, vertices, triangles, solid = closed_triangles("lattice", surface, scale)
    label = f"lattice of '{shortened(name)}'" if name else "lattice"
    sides = _positive(label, "spacing", spacing, ((), (3,)), "the side of the cells [m]")
    least = numbers(least_fill)
    if least.shape != () or not 0.0 <= float(least) < 1.0:
        raise ModelError(f"{label}: least_fill must be 0 or above and below 1, got {formatted(least_fill)}; give 0.05")
    grid = _grid(label, solid, np.broadcast_to(sides, 3))
    shares = grid_shares(grid.within(solid), grid.counts)
    if shares.min() < -OVERLAP or shares.max() > 1.0 + OVERLAP:
        raise ModelError(
            f"{label}: parts of a surface must not overlap or face inwards, got a cell that they fill "
            f"{shares.max() if shares.max() > 1.0 + OVERLAP else shares.min():.3g} times; unite them in a CAD program"
        )
    shares = np.where(np.abs(shares - 1.0) < SNAP, 1.0, shares)
    places = grid.within(vertices)
    homes = _homes(places, shares)
    kept, fill = _kept(shares, homes, float(least))
    used = np.flatnonzero(kept)
    points, every = box_of_hexahedra(grid.counts, (grid.size[0], grid.size[1], grid.size[2]))
    nodes, numbered = np.unique(every[used], return_inverse=True)
    elements: Any = numbered.reshape(-1, 8).astype(np.int32)
    points = points[nodes] + grid.origin
    found = VolumeMesh(
        points=points, elements=elements, fill=fill.reshape(-1)[used], sets=_sides(points),
        surface=EmbeddedSurface(
            cells=np.searchsorted(used, np.ravel_multi_index(tuple(homes.T), grid.counts)).astype(np.int32),
            weights=np.prod(1.0 + CORNERS * (2.0 * (places - homes) - 1.0)[:, None], axis=2) / 8.0, triangles=triangles,
        ),
        name=name or "lattice",
    )  # fmt: skip
    wanted = _volume(solid)
    if abs(found.volume - wanted) > MOST_AWAY * wanted:
        raise ModelError(
            f"{label}: the volume must be within {MOST_AWAY:.0%} of {wanted:.4g} m³, got {found.volume:.4g}; use a "
            "smaller spacing or a smaller least_fill"
        )
    return found


class _Grid(NamedTuple):
    """A grid of cells: its corner [m], its size [m], and its numbers of cells."""

    origin: Points
    size: Points
    counts: tuple[int, int, int]

    def within(self, points: Points) -> Points:
        """Points in cells from the corner, those near a plane of the grid on it."""
        places = (points - self.origin) / (self.size / np.array(self.counts))
        flat = np.round(places)
        return np.clip(np.where(np.abs(places - flat) < SNAP, flat, places), 0.0, np.array(self.counts, dtype=float))


def _grid(label: str, solid: Points, spacing: Points) -> _Grid:
    """The grid around triangles (t, 3, 3), centred on them; an extent of a whole number of cells fits exactly."""
    low, high = solid.min(axis=(0, 1)), solid.max(axis=(0, 1))
    counts = np.maximum(1.0, np.ceil((high - low) / spacing - 1e-6))
    _check_count(label, float(counts.prod()), "use a larger spacing, or scale=0.001 where the surface is in mm")
    size = np.maximum(counts * spacing, high - low)
    x, y, z = counts.astype(int).tolist()
    return _Grid((low + high - size) / 2.0, size, (x, y, z))


def grid_shares(triangles: Points, counts: tuple[int, int, int]) -> Points:
    """(nx, ny, nz) share of each cell that is inside closed triangles (t, 3, 3), in cells from the grid's corner."""
    pieces = _pieces(triangles)
    edges = pieces[:, 1:, :2] - pieces[:, :1, :2]
    area = (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]) / 2.0
    centre = pieces.mean(axis=1)
    cell = np.clip(np.floor(centre).astype(np.int64), 0, np.array(counts) - 1)
    place = np.ravel_multi_index(tuple(cell.T), counts)
    number = int(np.prod(counts))
    below = np.bincount(place, weights=area, minlength=number).reshape(counts)
    own = np.bincount(place, weights=area * (centre[:, 2] - cell[:, 2]), minlength=number).reshape(counts)
    from_above = np.flip(np.cumsum(np.flip(below, axis=2), axis=2), axis=2) - below
    return np.asarray(own + from_above)


def _pieces(triangles: Points) -> Points:
    """The same surface in triangles (p, 3, 3) that each lie between neighbouring planes of whole coordinates."""
    for axis in range(3):
        done = []
        while len(triangles):
            along = triangles[:, :, axis]
            low, high = np.floor(along.min(axis=1)), np.ceil(along.max(axis=1))
            wide = high - low > 1.0
            done.append(triangles[~wide])
            triangles = _cut(triangles[wide], axis, np.floor((low + high) / 2.0)[wide])
        triangles = np.concatenate(done)
    return triangles


def _cut(triangles: Points, axis: int, planes: Points) -> Points:
    """Triangles that a plane across an axis cuts, one each, in three pieces each, which keep their orientation."""
    above = triangles[:, :, axis] >= planes[:, None]
    lone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    a, b, c = (triangles[np.arange(len(triangles)), (lone + turn) % 3] for turn in range(3))
    heights = [corner[:, axis] - planes for corner in (a, b, c)]
    ends = []
    for corner, height in ((b, heights[1]), (c, heights[2])):
        end = a + (heights[0] / (heights[0] - height))[:, None] * (corner - a)
        end[:, axis] = planes
        ends.append(end)
    p, q = ends
    return np.concatenate([np.stack(piece, axis=1) for piece in ((a, p, q), (p, b, c), (p, c, q))])


def _homes(places: Points, shares: Points) -> Cells:
    """(v, 3) cell that carries each vertex: of those it touches, the one with most material."""
    counts = np.array(shares.shape)
    best = np.full(len(places), -np.inf)
    homes = np.zeros(places.shape, dtype=np.int64)
    for sides in itertools.product((0, 1), repeat=3):
        # A vertex on a plane of the grid touches the cells on either side of it
        cell = np.where(np.array(sides) == 1, np.ceil(places) - 1.0, np.floor(places)).astype(np.int64)
        cell = np.clip(cell, 0, counts - 1)
        share = shares[tuple(cell.T)]
        better = share > best
        best[better], homes[better] = share[better], cell[better]
    return homes


def _kept(shares: Points, homes: Cells, least: float) -> tuple[npt.NDArray[np.bool_], Points]:
    """Which cells are there, and their shares: those with material or a vertex, without the small ones that nothing
    needs.
    """
    from scipy import ndimage

    needed = np.zeros(shares.shape, dtype=bool)
    needed[tuple(homes.T)] = True
    kept = np.pad((shares > SNAP) | needed, 1)
    fill = np.clip(shares, LIGHTEST, 1.0)
    small = np.argwhere(kept[1:-1, 1:-1, 1:-1] & (shares < least) & ~needed)
    around = np.pad(shares, 1)
    faces = ((0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2))
    for cell in small[np.argsort(shares[tuple(small.T)], kind="stable")]:
        window = tuple(slice(at, at + 3) for at in cell.tolist())
        there, share = kept[window].copy(), around[window]
        there[1, 1, 1] = False
        parts, _ = ndimage.label(there)
        beside = [face for face in faces if there[face]]
        # Its neighbours hold together without it, and one of them has material enough
        if len({parts[face] for face in beside}) == 1 and max(share[face] for face in beside) >= least:
            kept[window][1, 1, 1] = False
    return kept[1:-1, 1:-1, 1:-1], fill


def _sides(points: Points) -> dict[str, Any]:
    """Nodes at the least and largest x, y and z."""
    low, high = points.min(axis=0), points.max(axis=0)
    near = 1e-6 * (high - low)
    found = {}
    for axis, letter in enumerate("xyz"):
        found[f"{letter}_min"] = np.flatnonzero(points[:, axis] <= low[axis] + near[axis])
        found[f"{letter}_max"] = np.flatnonzero(points[:, axis] >= high[axis] - near[axis])
    return found


def _volume(triangles: Points) -> float:
    """Volume inside closed triangles (t, 3, 3), about their middle."""
    return float(np.linalg.det(triangles - triangles.mean(axis=(0, 1))).sum() / 6.0)


def _check_count(label: str, count: float, remedy: str) -> None:
    if count > MOST_CELLS:
        raise ModelError(f"{label}: there must be at most {MOST_CELLS:,} cells, got {count:,.0f}; {remedy}")


def _positive(label: str, field: str, value: Any, shapes: Any, what: str) -> Points:
    """Positive lengths of one of some shapes."""
    given = numbers(value)
    known = shapes if shapes and isinstance(shapes[0], tuple) else (shapes,)
    if given.shape not in known or not ((given > 0.0) & (given <= FLOAT32_MAX)).all():
        many = " or ".join("three positive numbers" if shape else "a positive number" for shape in known)
        raise ModelError(f"{label}: {field} must be {many}, got {formatted(value)}; give {what}")
    return given
