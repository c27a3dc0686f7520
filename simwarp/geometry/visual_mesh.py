"""Appearance of a mesh: colours and texture coordinates at the corners of its triangles, and images."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ModelError

Array = npt.NDArray[np.float64]
Floats = npt.NDArray[np.float32]
Image = npt.NDArray[np.uint8]


@dataclasses.dataclass(frozen=True, kw_only=True)
class VisualMesh:
    """Triangles and their looks. Corners have data of their own, so that seams of colours and textures stay sharp.

    Attributes:
        vertices: (V, 3) [m].
        triangles: (T, 3) vertex indices.
        color: (T, 3, 3) linear albedo of the corners, by which that of the instance is multiplied; None: 1.
        uv: (T, 3, 2) texture coordinates of the corners, u to the right, v upwards, 0 to 1 across the image; None: the
            mesh has none.
        texture: (T,) index into `images`, -1: none; None: no triangle has one.
        images: (height, width, 3) uint8 sRGB, top row first.

    Raises:
        ModelError: an array has another shape or is not finite, or a texture has no texture coordinates.
    """

    vertices: Array
    triangles: npt.NDArray[np.int64]
    color: Floats | None = None
    uv: Floats | None = None
    texture: npt.NDArray[np.int32] | None = None
    images: tuple[Image, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.triangles)
        for name, wanted in (("color", (count, 3, 3)), ("uv", (count, 3, 2)), ("texture", (count,))):
            values: Any = getattr(self, name)
            if values is not None and values.shape != wanted:
                raise ModelError(f"visual mesh: {name} must have shape {wanted}, got {values.shape}; one per corner")
            if values is not None and not np.isfinite(values).all():
                raise ModelError(f"visual mesh: {name} must be finite, got NaN or infinity; check the file")
        if self.texture is not None and self.uv is None and (self.texture >= 0).any():
            raise ModelError(
                "visual mesh: a texture needs texture coordinates (UVs), got a mesh without; unwrap it and export again"
            )


def joined(parts: Sequence[VisualMesh]) -> VisualMesh:
    """All triangles as one mesh. What some have and others lack becomes white, (0, 0) and no texture."""
    meshes = list(parts)
    vertex_start = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    image_start = np.cumsum([0] + [len(mesh.images) for mesh in meshes])
    counts = [len(mesh.triangles) for mesh in meshes]

    def collect(name: str, blank: Any, shape: tuple[int, ...], dtype: Any) -> Any:
        found = [getattr(mesh, name) for mesh in meshes]
        if all(values is None for values in found):
            return None
        return np.concatenate([
            np.full((count, *shape), blank, dtype) if values is None else values
            for values, count in zip(found, counts, strict=True)
        ])  # fmt: skip

    for index, mesh in enumerate(meshes):
        if mesh.texture is not None:
            moved = np.where(mesh.texture >= 0, mesh.texture + image_start[index], -1).astype(np.int32)
            meshes[index] = dataclasses.replace(mesh, texture=moved)
    return VisualMesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        triangles=np.concatenate([m.triangles + first for m, first in zip(meshes, vertex_start, strict=False)]),
        color=collect("color", 1.0, (3, 3), np.float32),
        uv=collect("uv", 0.0, (3, 2), np.float32),
        texture=collect("texture", -1, (), np.int32),
        images=tuple(image for mesh in meshes for image in mesh.images),
    )


def linear_from_srgb(values: npt.ArrayLike) -> Array:
    """Linear light of sRGB values, both 0 to 1 (IEC 61966-2-1)."""
    x = np.asarray(values, dtype=np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((np.maximum(x, 0.04045) + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(values: npt.ArrayLike) -> Array:
    """The inverse of `linear_from_srgb`."""
    x = np.asarray(values, dtype=np.float64)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1.0 / 2.4) - 0.055)
