"""Mesh files (OBJ, STL, PLY, GLB), and meshes as sets of convex parts: the only file that imports trimesh."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import trimesh

from simwarp.types import ModelError

Vertices = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]

FORMATS: Final = (".obj", ".stl", ".ply", ".glb", ".gltf", ".off")


def load_mesh(path: str | Path) -> tuple[Vertices, Triangles]:
    """Vertices (V, 3), as the file has them (no change of unit or axes), and triangles (T, 3) of a mesh file.

    Parts of a scene are put where the scene has them and joined.

    Raises:
        ModelError: there is no such file, its format is unknown, or it holds no triangle.
    """
    file = Path(path)
    if not file.is_file():
        raise ModelError(f"mesh file: there must be a file, got '{file}'; check the path")
    if file.suffix.lower() not in FORMATS:
        raise ModelError(f"mesh file: the format must be one of {', '.join(FORMATS)}, got '{file.name}'; convert it")
    try:
        mesh = trimesh.load(file, force="mesh")
    except Exception as error:  # every format's reader raises its own kinds
        raise ModelError(f"mesh file: '{file.name}' must be readable, got {error!r}; export it again") from error
    vertices = np.asarray(getattr(mesh, "vertices", np.zeros((0, 3))), dtype=np.float64)
    triangles = np.asarray(getattr(mesh, "faces", np.zeros((0, 3))), dtype=np.int64)
    if not len(triangles):
        raise ModelError(f"mesh file: '{file.name}' must hold triangles, got none; export faces, not points or curves")
    return vertices, triangles


def convex_parts(vertices: npt.ArrayLike, triangles: npt.ArrayLike, **options: Any) -> list[Vertices]:
    """Vertices of convex parts that together are nearly the mesh, from coacd, or else vhacdx.

    Args:
        vertices: (V, 3).
        triangles: (T, 3).
        options: of `coacd.run_coacd` (Wei et al. 2022), or of `trimesh.decomposition.convex_decomposition`.

    Raises:
        ModelError: neither library is installed.
    """
    points, faces = np.asarray(vertices, dtype=np.float64), np.asarray(triangles, dtype=np.int64)
    if importlib.util.find_spec("coacd") is not None:
        coacd = importlib.import_module("coacd")
        parts = coacd.run_coacd(coacd.Mesh(points, faces), **options)
        return [np.asarray(part[0], dtype=np.float64) for part in parts]
    if importlib.util.find_spec("vhacdx") is not None:
        mesh = trimesh.Trimesh(points, faces, process=False)
        found = trimesh.decomposition.convex_decomposition(mesh, **options)
        return [np.asarray(part["vertices"], dtype=np.float64) for part in found]
    raise ModelError(
        "mesh: decompose=True needs a library for convex decomposition, found neither coacd nor vhacdx; "
        "run: pip install coacd"
    )
