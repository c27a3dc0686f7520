"""Textures of surfaces, and the tables in which kernels find them: one atlas that all worlds share."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.constraints import Ge, Le, Meaning, Parsed, Positive, RuleError
from simwarp.core.types import ModelError, Vec3, formatted
from simwarp.geometry.visual_mesh import Image, VisualMesh, linear_from_srgb
from simwarp.model.rules import held_fields
from simwarp.sensors.cameras.appearance_kernels import AppearanceArrays, TextureKind

Metres: TypeAlias = Annotated[Positive, Meaning("the metres that one repeat covers")]
LightShare: TypeAlias = Annotated[float, Ge(0.0), Le(1.0), Meaning("0 for none to 1 for all light, as linear albedos")]
Albedo: TypeAlias = tuple[LightShare, LightShare, LightShare]


def _image(source: Any) -> Image:
    """(height, width, 3) uint8."""
    if isinstance(source, (str, Path)):
        from simwarp.geometry.mesh_files import read_image  # imports trimesh, which takes a while

        return read_image(source)
    image = np.asarray(source)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
        raise RuleError("(height, width, 3) uint8 or a path", "scale values to 0..255", f"{image.dtype}{image.shape}")
    return image


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ImageTexture:
    """A picture on a surface, repeated; sampled bilinearly.

    Attributes:
        image: (height, width, 3) uint8 sRGB with the top row first, or the path of an image file.
        metres: extent of one repeat along x and y of the instance's frame, seen along its z: for grounds, height
            fields and boxes. None: the picture goes by the texture coordinates of the mesh.
    """

    image: Annotated[npt.NDArray[np.uint8] | str | Path, Parsed(_image)]
    metres: Metres | tuple[Metres, Metres] | None = None


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class CheckerTexture:
    """Squares of two colours over x and y of the instance's frame; far squares blend into their mean.

    Attributes:
        colors: linear, of the square from the origin towards +x, +y and of its neighbours.
        metres: side of a square [m].
    """

    colors: tuple[Albedo, Albedo] = ((0.32, 0.34, 0.36), (0.46, 0.48, 0.5))
    metres: Metres = 1.0


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class NoiseTexture:
    """Smooth random patches between two colours over x and y of the instance's frame: soil, grass, asphalt.

    Attributes:
        colors: linear.
        metres: side of the largest patches [m].
    """

    colors: tuple[Albedo, Albedo] = ((0.1, 0.16, 0.05), (0.3, 0.34, 0.16))
    metres: Metres = 1.0


Texture: TypeAlias = ImageTexture | CheckerTexture | NoiseTexture


@dataclasses.dataclass(frozen=True)
class _Entry:
    """A texture as the tables have it."""

    kind: TextureKind
    image: Image | None
    metres: tuple[float, float]
    colors: tuple[Vec3, Vec3]


class AppearanceList:
    """Textures and visuals of meshes, collected before `tables`."""

    def __init__(self) -> None:
        self._textures: list[_Entry] = []
        self._given: dict[Texture, int] = {}

    @property
    def textures(self) -> tuple[Texture, ...]:
        """All of them, by number."""
        return tuple(self._given)

    def add(self, texture: Texture) -> int:
        """Number of a texture, for `Appearance.texture` and `Scene.texture`. The same object has one number.

        Raises:
            ModelError: it is no texture, its image cannot be read, or a size or colour is not usable.
        """
        known = isinstance(texture, (ImageTexture, CheckerTexture, NoiseTexture))
        if not known:
            raise ModelError(
                "texture: must be an ImageTexture, CheckerTexture or NoiseTexture, "
                f"got {formatted(texture)}; make one of them"
            )
        if texture not in self._given:
            self._given[texture] = len(self._textures)
            self._textures.append(_entry(texture))
        return self._given[texture]

    def check(self, thing: str, texture: int, visual: VisualMesh | None) -> None:
        """An instance's texture has to exist, and to have a mapping onto the surface.

        Raises:
            ModelError: there is no such texture, or it is an image and neither it nor the mesh says where.
        """
        if not -1 <= texture < len(self._textures):
            raise ModelError(
                f"{thing}: texture must be -1 or below {len(self._textures)}, got {texture}; "
                "pass what Visuals.texture returned"
            )
        if texture < 0:
            return
        entry = self._textures[texture]
        if entry.kind == TextureKind.IMAGE and entry.metres[0] == 0.0 and (visual is None or visual.uv is None):
            raise ModelError(
                f"{thing}: an image needs texture coordinates (UVs), got geometry without; unwrap the mesh, "
                "or give ImageTexture(metres=...) to lay it along x and y"
            )

    def tables(self, visuals: Sequence[VisualMesh | None], device: Any) -> AppearanceArrays:
        """Everything on a device.

        Args:
            visuals: per tree of the scene; None: it has none.
            device: Warp device.
        """
        textures = list(self._textures)
        tree_visual, colors, uvs, triangle_texture = [-1] * len(visuals), [], [], []
        rows = 0
        for tree, visual in enumerate(visuals):
            if visual is None or (visual.color is None and visual.uv is None):
                continue
            count = len(visual.triangles)
            tree_visual[tree] = rows
            rows += count
            colors.append(np.ones((count, 3, 3), np.float32) if visual.color is None else visual.color)
            uvs.append(np.zeros((count, 3, 2), np.float32) if visual.uv is None else visual.uv)
            own = np.full(count, -1, np.int32) if visual.texture is None else visual.texture
            triangle_texture.append(np.where(own >= 0, own + len(textures), -1))
            textures += [
                _Entry(TextureKind.IMAGE, image, (0.0, 0.0), ((1, 1, 1), (1, 1, 1))) for image in visual.images
            ]
        made = AppearanceArrays()
        _texture_tables(made, textures, device)
        made.tree_visual = _array(tree_visual, np.int32, wp.int32, (), device)
        made.corner_color = _array([c.reshape(-1, 3) for c in colors], np.float32, wp.vec3, (3,), device, join=True)
        made.corner_uv = _array([c.reshape(-1, 2) for c in uvs], np.float32, wp.vec2, (2,), device, join=True)
        made.triangle_texture = _array(triangle_texture, np.int32, wp.int32, (), device, join=True)
        return made


def _array(values: Any, dtype: Any, kind: Any, tail: tuple[int, ...], device: Any, join: bool = False) -> wp.array:
    data = np.concatenate([np.zeros((0, *tail), dtype), *values]) if join else np.asarray(values, dtype)
    return wp.array(data.astype(dtype).reshape(-1, *tail), dtype=kind, device=device)


def _texture_tables(made: AppearanceArrays, textures: list[_Entry], device: Any) -> None:
    sizes = [(0, 0) if t.image is None else (t.image.shape[1], t.image.shape[0]) for t in textures]
    starts = np.cumsum([0] + [width * height for width, height in sizes])
    packed = []
    for texture in textures:
        if texture.image is not None:
            levels = texture.image.reshape(-1, 3).astype(np.uint32)
            packed.append(levels[:, 0] | levels[:, 1] << 8 | levels[:, 2] << 16)
    made.texture_kind = _array([int(t.kind) for t in textures], np.int32, wp.int32, (), device)
    made.texture_start = _array(starts[: len(textures)], np.int32, wp.int32, (), device)
    made.texture_pixels = _array(sizes, np.int32, wp.vec2i, (2,), device)
    made.texture_metres = _array([t.metres for t in textures], np.float32, wp.vec2, (2,), device)
    for index, name in enumerate(("texture_color0", "texture_color1")):
        setattr(made, name, _array([t.colors[index] for t in textures], np.float32, wp.vec3, (3,), device))
    made.texel = _array(packed, np.uint32, wp.uint32, (), device, join=True)
    made.decode = _array(linear_from_srgb(np.arange(256) / 255.0), np.float32, wp.float32, (), device)


def _entry(texture: Texture) -> _Entry:
    held = held_fields(type(texture).__name__, type(texture), vars(texture))
    extent = held["metres"] if isinstance(held["metres"], tuple) else (held["metres"] or 0.0,) * 2
    if isinstance(texture, ImageTexture):
        return _Entry(TextureKind.IMAGE, held["image"], extent, ((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)))
    kind = TextureKind.CHECKER if isinstance(texture, CheckerTexture) else TextureKind.NOISE
    return _Entry(kind, None, extent, held["colors"])
