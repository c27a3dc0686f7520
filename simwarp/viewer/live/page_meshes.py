"""Triangles of what a scene shows, in units that a scale per instance stretches into place."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ShapeType
from simwarp.geometry.assets import HeightField, Hull
from simwarp.geometry.primitive_meshes import primitive_mesh
from simwarp.geometry.visual_mesh import VisualMesh
from simwarp.meshes.mesh_specification import FlexibleMesh
from simwarp.sensors.cameras.appearance import ImageTexture, Texture
from simwarp.sensors.scene import Visuals
from simwarp.viewer.live.page_textures import Skin, picture_of, skin_along

Array = npt.NDArray[np.float64]
Floats = npt.NDArray[np.float32]

MOST_TRIANGLES: Final = 20_000
"""Of one mesh on the page: larger ones are simplified."""
MOST_PAINTED: Final = 200_000
"""Of one with colours or pictures of its own, as roads and buildings have: fewer triangles would blur its lines."""
ROUNDED: Final = (ShapeType.SPHERE, ShapeType.ELLIPSOID)


@dataclasses.dataclass(frozen=True, eq=False)
class Triangles:
    """A mesh for the page.

    Attributes:
        vertices: (V, 3) float32 [m, or parts of a scale].
        faces: (T, 3) uint32, counter-clockwise seen from outside.
        color: (V, 3) linear albedo by vertex, by which that of an instance is multiplied; None: 1.
        smooth: whether its normals are those of a rounded surface.
        skin: a picture on it, in place of these colours; its own colour is that of the instance.
    """

    vertices: Floats
    faces: npt.NDArray[np.uint32]
    color: Floats | None = None
    smooth: bool = False
    skin: Skin | None = None


@functools.cache
def ball() -> Triangles:
    """Unit sphere."""
    return _primitive("sphere", smooth=True, radius=1.0)


@functools.cache
def cube() -> Triangles:
    """Box of half lengths 1."""
    return _primitive("cube", size=2.0)


@functools.cache
def cylinder() -> Triangles:
    """Radius 1 about z, from -1 to 1."""
    return _primitive("cylinder", radius=1.0, height=2.0)


@functools.cache
def cone() -> Triangles:
    """Base of radius 1 at z = -1, tip at 1."""
    return _primitive("cone", radius=1.0, height=2.0)


@functools.lru_cache(maxsize=256)
def capsule(slenderness: float) -> Triangles:
    """Radius 1 about a segment of z from -slenderness to slenderness."""
    return _primitive("capsule", smooth=True, radius=1.0, height=2.0 * slenderness)


def _primitive(kind: str, *, smooth: bool = False, **sizes: float) -> Triangles:
    return _made(*primitive_mesh(kind, sizes, coarse=True), smooth=smooth)


def of_hull(hull: Hull) -> Triangles:
    """Faces as fans."""
    fans = [(face[0], face[k], face[k + 1]) for face in hull.faces for k in range(1, len(face) - 1)]
    return _made(hull.vertices, np.array(fans))


def of_height_field(field: HeightField) -> Triangles:
    """Two triangles for each cell of the grid, or of every second, third ... row where those are too many."""
    heights = field.heights
    step = max(1, math.ceil(math.sqrt(2.0 * heights.size / (4.0 * MOST_TRIANGLES))))
    rows = np.unique(np.append(np.arange(0, heights.shape[0], step), heights.shape[0] - 1))
    columns = np.unique(np.append(np.arange(0, heights.shape[1], step), heights.shape[1] - 1))
    x = (columns - 0.5 * (heights.shape[1] - 1)) * field.spacing[0]
    y = (rows - 0.5 * (heights.shape[0] - 1)) * field.spacing[1]
    grid = np.stack([*np.meshgrid(x, y), heights[np.ix_(rows, columns)]], axis=-1).reshape(-1, 3)
    corner = (np.arange(len(rows) - 1)[:, None] * len(columns) + np.arange(len(columns) - 1)).reshape(-1)
    up = corner + len(columns)
    faces = np.concatenate([np.stack([corner, corner + 1, up + 1], 1), np.stack([corner, up + 1, up], 1)])
    return _made(grid, faces, smooth=True)


def of_surface(mesh: FlexibleMesh) -> Triangles:
    """The surface of a flexible mesh at rest, from its first node that moves by itself."""
    return _made(mesh.surface.vertices(mesh.points) - mesh.points[mesh.nodes[0]], mesh.surface.triangles)


def of_mesh(visuals: Visuals, asset: int) -> Triangles:
    """A mesh of `Visuals.add_mesh_asset` with the colours of its corners; textures as their mean colour, and as its
    skin where there is but one.
    """
    mesh, look = visuals.meshes[asset], visuals.mesh_visuals[asset]
    if look is None or (look.color is None and look.texture is None):
        return simplified(_made(mesh.vertices, mesh.triangles))
    one_picture = look.uv is not None and len(look.images) == 1 and bool(np.all(look.texture == 0))
    if look.color is None and one_picture and len(mesh.triangles) <= MOST_PAINTED:
        return with_coordinates(mesh, look.uv, look.images[0])
    color = np.ones((len(mesh.triangles), 3, 3), np.float32) if look.color is None else look.color.copy()
    if look.texture is not None:
        for index, image in enumerate(look.images):
            color[look.texture == index] *= linear(image.reshape(-1, 3).mean(axis=0) / 255.0)
    # corners have colours of their own: vertices are split where these differ
    corners = np.concatenate([np.asarray(mesh.vertices)[mesh.triangles], color], axis=-1).reshape(-1, 6)
    unique, places = np.unique(corners.astype(np.float32), axis=0, return_inverse=True)
    if len(mesh.triangles) > MOST_PAINTED:
        return _painted_as(unique, simplified(_made(mesh.vertices, mesh.triangles)))
    made = _made(unique[:, :3], places.reshape(-1, 3))
    return dataclasses.replace(made, color=np.ascontiguousarray(unique[:, 3:], np.float32))


def with_coordinates(mesh: Any, uv: Any, image: npt.NDArray[np.uint8]) -> Triangles:
    """A mesh under a picture that goes by the texture coordinates (T, 3, 2) of its corners."""
    corners = np.asarray(mesh.vertices)[mesh.triangles].reshape(-1, 3)
    made = _made(corners, np.arange(len(corners)).reshape(-1, 3))
    mean = np.asarray(linear(image.reshape(-1, 3).mean(axis=0) / 255.0), np.float32)
    skin = Skin(image, np.asarray(uv, np.float32).reshape(-1, 2))
    return dataclasses.replace(made, color=np.tile(mean, (len(corners), 1)), skin=skin)


def with_texture(made: Triangles, texture: Texture, mesh: Any, look: VisualMesh | None) -> Triangles:
    """Triangles under the texture of their instance; as they are where it does not say how it lies."""
    skin = skin_along(texture, made.vertices.astype(np.float64))
    if skin is not None:
        return dataclasses.replace(made, skin=skin)
    if isinstance(texture, ImageTexture) and look is not None and look.uv is not None:
        return dataclasses.replace(with_coordinates(mesh, look.uv, picture_of(texture)), color=None)
    return made


def _painted_as(points: Any, mesh: Triangles) -> Triangles:
    """A mesh in the colours of the nearest of coloured points (N, 6)."""
    from scipy.spatial import KDTree

    _, nearest = KDTree(points[:, :3]).query(mesh.vertices)
    return dataclasses.replace(mesh, color=np.ascontiguousarray(points[nearest, 3:], np.float32))


def simplified(mesh: Triangles) -> Triangles:
    """The same with at most `MOST_TRIANGLES`, where the library that does it is there."""
    from simwarp.geometry.mesh_files import with_fewer_triangles

    return _made(*with_fewer_triangles(mesh.vertices, mesh.faces, MOST_TRIANGLES), smooth=mesh.smooth)


def linear(srgb: Any) -> Array:
    """Linear light of sRGB values from 0 to 1."""
    values = np.asarray(srgb, np.float64)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def linear_bytes(color: Any) -> npt.NDArray[np.uint8]:
    """Linear values as 0 to 255."""
    return np.round(255.0 * np.clip(np.asarray(color, np.float64), 0.0, 1.0)).astype(np.uint8)


def srgb_bytes(color: Any) -> npt.NDArray[np.uint8]:
    """SRGB from 0 to 255 of linear values."""
    values = np.clip(np.asarray(color, np.float64), 0.0, 1.0)
    coded = np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1.0 / 2.4) - 0.055)
    return np.round(255.0 * coded).astype(np.uint8)


def _made(vertices: Any, faces: Any, *, smooth: bool = False) -> Triangles:
    return Triangles(np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.uint32), smooth=smooth)
