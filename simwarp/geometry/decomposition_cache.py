"""Convex decompositions kept on disk by content: they take seconds to minutes, and are the same every time."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Vertices = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]

UNREADABLE: Final = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error)


def cache_folder() -> Path:
    """Where decompositions are kept: in $SIMWARP_CACHE, or in simwarp of $XDG_CACHE_HOME or ~/.cache."""
    own, base = os.environ.get("SIMWARP_CACHE"), os.environ.get("XDG_CACHE_HOME")
    root = Path(own) if own else (Path(base) if base else Path.home() / ".cache") / "simwarp"
    return root / "decompositions"


def cached_parts(
    library: str, vertices: Vertices, triangles: Triangles, options: Mapping[str, Any],
    compute: Callable[[], list[Vertices]],
) -> list[Vertices]:  # fmt: skip
    """Vertices of convex parts, from the cache for the same mesh, options and library, else from `compute`.

    Args:
        library: its name and version.
        vertices: (V, 3).
        triangles: (T, 3).
        options: of the library.
        compute: decomposes the mesh.

    Returns:
        (N, 3) vertices of each part.
    """
    file = cache_folder() / f"{_key(library, vertices, triangles, options)}.npz"
    with contextlib.suppress(*UNREADABLE):  # missing or damaged: it is made again
        with np.load(file, allow_pickle=False) as kept:
            ends, points = kept["ends"], kept["points"]
        if len(ends) and ends[-1] == len(points) and np.isfinite(points).all() and (np.diff(ends, prepend=0) > 3).all():
            return [np.asarray(part, np.float64) for part in np.split(points, ends[:-1])]
    parts = compute()
    with contextlib.suppress(OSError):  # a folder that cannot be written is no reason to fail
        _write(file, parts)
    return parts


def _key(library: str, vertices: Vertices, triangles: Triangles, options: Mapping[str, Any]) -> str:
    digest = hashlib.sha256(json.dumps([library, dict(options)], sort_keys=True, default=repr).encode())
    for array in (vertices, triangles):
        digest.update(repr(array.shape).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _write(file: Path, parts: list[Vertices]) -> None:
    """All or nothing: others may read it meanwhile."""
    if not parts:
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=file.parent, suffix=".tmp", delete=False) as target:
        np.savez_compressed(target, ends=np.cumsum([len(part) for part in parts]), points=np.concatenate(parts))
    os.replace(target.name, file)
