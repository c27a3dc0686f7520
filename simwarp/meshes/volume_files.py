"""Volumes from files and surfaces of other programs: meshes by meshio, tetrahedra by fTetWild, closed surfaces."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import io
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.files import FileError, check_input
from simwarp.core.types import FLOAT32_MAX, ModelError, formatted, number, numbers
from simwarp.core.wording import shortened
from simwarp.meshes.mesh_parts import as_array, element_volumes
from simwarp.meshes.volume_mesh import Nodes, Points, VolumeMesh

READERS = {
    ".msh": "gmsh", ".vtk": "vtk", ".vtu": "vtu", ".inp": "abaqus", ".bdf": "nastran", ".nas": "nastran",
    ".fem": "nastran",
}  # fmt: skip
"""Modules of meshio by the ends of names."""
KINDS = {"tetra": 4, "hexahedron": 8}
"""Cells that are read, by meshio's names, and their numbers of nodes."""
REMEDIES = {
    "wedge": "mesh with tetrahedra or hexahedra alone", "pyramid": "mesh with tetrahedra or hexahedra alone",
    "polyhedron": "mesh with tetrahedra or hexahedra alone",
}  # fmt: skip
"""What to do about other cells; all else is of second order or above."""
MIRRORED = {4: (0, 2, 1, 3), 8: (0, 3, 2, 1, 4, 7, 6, 5)}
"""Nodes of a cell in the order of its mirror image."""
MOST_DEVIATION = 0.1
"""Of a boundary from its surface, in diagonals of that; more would lose the shape."""
TETRAHEDRALISE = (
    "import sys; import numpy as np; import pytetwild; surface = np.load('surface.npz'); "
    "points, elements = pytetwild.tetrahedralize(surface['vertices'], surface['triangles'], "
    "edge_length_abs=float(sys.argv[1]), epsilon=float(sys.argv[2]), coarsen=True); "
    "np.savez('mesh.npz', points=points, elements=elements)"
)
"""In a process and a folder of its own: fTetWild writes a file where it runs, and a crash would end the caller."""
LIBRARIES = {"meshio": "reading files", "pytetwild": "making tetrahedra"}
"""What the libraries of the extra `flex` are needed for."""


class TriangleMesh(Protocol):
    """An object with vertices (v, 3) and triangles (t, 3) of them, as a `trimesh.Trimesh` has."""

    vertices: Any
    faces: Any


Surface: TypeAlias = str | os.PathLike[str] | TriangleMesh | tuple[npt.ArrayLike, npt.ArrayLike]


def read(path: str | os.PathLike[str], *, scale: float = 1.0) -> VolumeMesh:
    """A volume mesh from another program: Gmsh (.msh), VTK (.vtk, .vtu), Abaqus (.inp), Nastran (.bdf, .nas, .fem).

    Cells must be all tetrahedra or all hexahedra of first order. Physical groups (Gmsh), and sets of nodes and elements
    (Abaqus), become sets of nodes; surfaces and lines count for these alone. Nodes of no cell are left out, and cells
    that are written as mirror images are turned. Needs meshio: `pip install 'simwarp[flex]'`.

    Args:
        path: of the file.
        scale: metres per unit of the file, 0.001 for one in millimetres.

    Raises:
        ModelError: there is no such file, it cannot be read, it has other cells or none, or meshio is missing.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise ModelError(f"mesh file: path must be the path of a file, got {formatted(path)}; pass 'finger.msh'")
    file = Path(path)
    label = f"mesh file '{shortened(file.name)}'"
    if file.suffix.lower() not in READERS:
        raise ModelError(f"{label}: the format must be one of {', '.join(READERS)}, got another; convert it")
    factor = _scale(label, scale)
    try:
        check_input(file)
    except FileError as error:
        raise ModelError(f"{label}: there must be a readable file, got: {error.reason}; check the path") from None
    try:
        reader = importlib.import_module(f"meshio.{READERS[file.suffix.lower()]}")
    except ImportError as error:
        raise _missing("meshio", label, " ".join(str(error).split())) from None
    with _silent():
        try:
            content = reader.read(os.fspath(file))
        except (Exception, SystemExit) as error:  # every format's reader raises its own kinds
            told = " ".join(f"{type(error).__name__}: {error}".split())
            raise ModelError(f"{label}: must be readable, got {told[:200]}; export it again") from error
    cells = _cells(label, content)
    nodes, elements = np.unique(cells, return_inverse=True)
    sets = {}
    for name, found in _groups(content):
        inside = np.flatnonzero(np.isin(nodes, found))
        if len(inside):
            sets[name] = inside
    points = numbers(content.points)
    if points.ndim != 2 or points.shape[1] != 3 or nodes[-1] >= len(points):
        raise ModelError(f"{label}: cells must be of points in space, got an array {points.shape}; export it again")
    return _mesh(file.name, points[nodes] * factor, elements.reshape(cells.shape), sets)


def tetrahedra(surface: Surface, *, edge: float, deviation: float = 1e-3, scale: float = 1.0) -> VolumeMesh:
    """The inside of a closed surface in tetrahedra, by fTetWild (Hu et al. 2020, ACM TOG 39:117).

    Its boundary has other triangles than the surface. Edges become about a third longer than aimed at, shorter where
    the surface asks for it. fTetWild finds another mesh at each call: keep one (it can be pickled) where results are to
    be repeated. Bending needs six or more tetrahedra through the thickness, hexahedra of `lattice` one or two. Needs
    pytetwild: `pip install 'simwarp[flex]'`.

    Args:
        surface: path of an OBJ, STL, PLY or other mesh file, a `trimesh.Trimesh`, or vertices (v, 3) [m] and triangles
            (t, 3), counter-clockwise seen from outside.
        edge: length of edges that is aimed at [m].
        deviation: how far the boundary may be from the surface, as a share of the diagonal of its extent; more lets it
            have fewer nodes.
        scale: metres per unit of the surface, 0.001 for one in millimetres.

    Raises:
        ModelError: the surface is not closed or faces inwards, a number breaks its rule, no tetrahedra were found, or
            pytetwild is missing.
    """
    name, vertices, triangles, solid = closed_triangles("tetrahedra", surface, scale)
    label = f"tetrahedra of '{shortened(name)}'" if name else "tetrahedra"
    length, size = number(edge), float(np.linalg.norm(np.ptp(solid.reshape(-1, 3), axis=0)))
    if not 0.0 < length <= size:
        raise ModelError(
            f"{label}: edge must be positive and at most the surface's diagonal of {size:.4g} m, got "
            f"{formatted(edge)}; give metres"
        )
    share = number(deviation)
    if not 0.0 < share <= MOST_DEVIATION:
        raise ModelError(
            f"{label}: deviation must be above 0 and at most {MOST_DEVIATION}, got {formatted(deviation)}; it is a "
            "share of the diagonal, 0.001 is usual"
        )
    points, elements = _tetrahedralised(label, vertices, triangles, length, share)
    if not len(elements):
        raise ModelError(f"{label}: the surface must enclose a volume, got no tetrahedra; use a smaller edge")
    nodes, numbered = np.unique(elements, return_inverse=True)
    return _mesh(name or "tetrahedra", np.asarray(points, float)[nodes], numbered.reshape(-1, 4), {})


def closed_triangles(thing: str, surface: Any, scale: Any) -> tuple[str, Points, Nodes, Points]:
    """Name of the file, or nothing; vertices (v, 3) [m] and triangles (t, 3); the closed triangles (t, 3, 3) [m].

    Raises:
        ModelError: there is no such file, it is no surface, or it is not closed or faces inwards.
    """
    from simwarp.geometry.mesh_files import closed_surface, load_mesh  # trimesh takes a while to import

    name, label = "", thing
    if isinstance(surface, (str, os.PathLike)):
        name = Path(surface).name
        label = f"{thing} of '{shortened(name)}'"
        vertices, triangles = load_mesh(os.fspath(surface))
    elif hasattr(surface, "vertices") and hasattr(surface, "faces"):
        vertices, triangles = numbers(surface.vertices), as_array(surface.faces)
    elif isinstance(surface, (tuple, list)) and len(surface) == 2:
        vertices, triangles = numbers(surface[0]), as_array(surface[1])
    else:
        raise ModelError(
            f"{label}: surface must be a path, a trimesh.Trimesh or (vertices, triangles), got {formatted(surface)}; "
            "pass 'finger.obj'"
        )
    factor = _scale(label, scale)
    if vertices.ndim != 2 or vertices.shape[1:] != (3,) or not (np.abs(vertices) <= FLOAT32_MAX).all():
        raise ModelError(
            f"{label}: vertices must be finite and of shape (v, 3), got {formatted(vertices)}; give x, y, z of each"
        )
    whole = triangles.ndim == 2 and triangles.shape[1:] == (3,) and len(triangles) and triangles.dtype.kind in "iu"
    if not whole or triangles.min() < 0 or triangles.max() >= len(vertices):
        raise ModelError(
            f"{label}: triangles must be of shape (t, 3) and of vertices 0 to {len(vertices) - 1}, got "
            f"{formatted(triangles)}; number vertices from 0"
        )
    used, triangles = np.unique(triangles, return_inverse=True)
    vertices, triangles = vertices[used] * factor, triangles.reshape(-1, 3)
    closed = closed_surface(vertices, triangles)
    if closed is None:
        raise ModelError(
            f"{label}: the surface must enclose a volume and face outwards, got {len(triangles)} triangles that do "
            "not; close holes, or turn triangles over (trimesh.repair has fill_holes and fix_normals)"
        )
    return name, vertices, triangles.astype(np.int32), closed[0][closed[1]]


def _cells(label: str, content: Any) -> npt.NDArray[np.int64]:
    """Cells (m, 4) or (m, 8) of what meshio has read."""
    solid = [block for block in content.cells if block.dim == 3 and len(block)]
    for block in solid:
        if block.type not in KINDS:
            known = next((text for start, text in REMEDIES.items() if block.type == start), None)
            raise ModelError(
                f"{label}: cells must be tetrahedra or hexahedra of first order, got {len(block)} of kind "
                f"{block.type}; {known or 'export a mesh of first order'}"
            )
    kinds = sorted({block.type for block in solid})
    if not kinds:
        has = ", ".join(sorted({block.type for block in content.cells})) or "none"
        raise ModelError(
            f"{label}: there must be cells with a volume, got {has}; fill a closed surface with sw.flex.lattice or "
            "sw.flex.tetrahedra"
        )
    if len(kinds) > 1:
        raise ModelError(
            f"{label}: cells must be of one kind, got {' and '.join(kinds)}; mesh with one of them, or split it"
        )
    return np.concatenate([np.asarray(block.data, np.int64) for block in solid])


def _groups(content: Any) -> Iterator[tuple[str, npt.NDArray[np.int64]]]:
    """Names and nodes of groups and sets; those of one name are one."""
    found: dict[str, list[Any]] = {}
    for name, nodes in (content.point_sets or {}).items():
        found.setdefault(str(name), []).append(nodes)
    for name, members in (content.cell_sets or {}).items():
        if not str(name).startswith("gmsh:"):
            blocks = [
                block.data[members_of_block]
                for block, members_of_block in zip(content.cells, members, strict=True)
                if members_of_block is not None
            ]
            found.setdefault(str(name), []).extend(blocks)
    tags = content.cell_data.get("gmsh:physical", [None] * len(content.cells))
    for name, value in content.field_data.items():
        tag, dimension = (int(part) for part in np.asarray(value).reshape(-1)[:2])
        for block, group in zip(content.cells, tags, strict=True):
            if group is not None and block.dim == dimension:
                found.setdefault(str(name), []).append(block.data[np.asarray(group) == tag])
    for name, parts in found.items():
        yield name, np.unique(np.concatenate([np.asarray(part, np.int64).reshape(-1) for part in parts]))


def _mesh(name: str, points: Points, elements: npt.NDArray[Any], sets: dict[str, Any]) -> VolumeMesh:
    """The mesh, whose cells are turned where they are written as mirror images."""
    mirrored = element_volumes(points, elements) < 0.0
    elements[mirrored] = elements[mirrored][:, MIRRORED[elements.shape[1]]]
    return VolumeMesh(points=points, elements=elements, sets=sets, name=name)


def _tetrahedralised(
    label: str, vertices: Points, triangles: Nodes, edge: float, deviation: float
) -> tuple[Points, npt.NDArray[Any]]:
    """Points and tetrahedra inside a surface, of a process of its own."""
    if importlib.util.find_spec("pytetwild") is None:
        raise _missing("pytetwild", label, "it is not installed")
    with tempfile.TemporaryDirectory() as folder:
        np.savez(os.path.join(folder, "surface.npz"), vertices=vertices, triangles=triangles)
        command = [sys.executable, "-P", "-c", TETRAHEDRALISE, repr(edge), repr(deviation)]
        done = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", cwd=folder, check=False)
        if done.returncode == 0:
            with np.load(os.path.join(folder, "mesh.npz")) as found:
                return np.asarray(found["points"], np.float64), found["elements"]
    told = done.stderr.strip().rpartition("\n")[2] or f"code {done.returncode}"
    if "ModuleNotFoundError" in told or "ImportError" in told:
        raise _missing("pytetwild", label, told)
    raise ModelError(
        f"{label}: pytetwild must find tetrahedra, got: {told[:200]}; use another edge, or sw.flex.lattice"
    )


def _scale(label: str, scale: Any) -> float:
    factor = number(scale)
    if not 0.0 < factor <= FLOAT32_MAX:
        raise ModelError(f"{label}: scale must be positive, got {formatted(scale)}; give metres per unit of the file")
    return factor


def _missing(name: str, label: str, told: str) -> ModelError:
    """An error about a library of the extra `flex`."""
    return ModelError(
        f"{label}: the library {name} must be there for {LIBRARIES[name]}, got: {told}; run: "
        "pip install 'simwarp[flex]'"
    )


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Libraries print what their errors say, too."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield
