"""Mesh files (OBJ, STL, PLY, GLB, DAE), their shapes and looks, and meshes as sets of convex parts: the only file that
imports trimesh.
"""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import logging
import os
import re
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import PIL.Image
import trimesh

from simwarp.core.files import FileError, check_input, declares_entities
from simwarp.core.types import ModelError, formatted
from simwarp.geometry.decomposition_cache import cached_parts
from simwarp.geometry.visual_mesh import VisualMesh, joined, linear_from_srgb

Vertices = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]
Image = npt.NDArray[np.uint8]

# missing bump maps and the like are told in tracebacks
logging.getLogger("trimesh").addHandler(logging.NullHandler())

FORMATS: Final = (".obj", ".stl", ".ply", ".glb", ".gltf", ".off", ".dae")


def load_mesh(path: str | Path) -> tuple[Vertices, Triangles]:
    """Vertices (V, 3), as the file has them (no change of unit or axes), and triangles (T, 3) of a mesh file. Only
    DAE files state their unit, and are converted to metres.

    Parts of a scene are put where the scene has them and joined.

    Raises:
        ModelError: there is no such file, its format is unknown, or it holds no triangle.
    """
    file = _checked_file(path)
    mesh = _loaded(file, "mesh")
    vertices = np.asarray(getattr(mesh, "vertices", np.zeros((0, 3))), dtype=np.float64)
    triangles = np.asarray(getattr(mesh, "faces", np.zeros((0, 3))), dtype=np.int64)
    if not len(triangles):
        raise ModelError(f"mesh file: '{file.name}' must hold triangles, got none; export faces, not points or curves")
    return vertices, triangles


def load_visual_mesh(path: str | Path) -> VisualMesh:
    """Triangles of a mesh file with their looks: vertex or face colours, colours of materials, textures and texture
    coordinates. Parts of a scene are put where the scene has them and joined.

    Colours of OBJ, STL and PLY files are taken as sRGB, those of GLB files as linear, as their format says.

    Raises:
        ModelError: as `load_mesh`; or a texture is missing, cannot be read, or has no texture coordinates.
    """
    file = _checked_file(path)
    if file.suffix.lower() == ".obj":
        _check_obj_textures(file)
    scene = _loaded(file, "scene")
    parts = [part for part in scene.dump() if len(getattr(part, "faces", ()))]
    if not parts:
        raise ModelError(f"mesh file: '{file.name}' must hold triangles, got none; export faces, not points or curves")
    linear = file.suffix.lower() in (".glb", ".gltf")
    return joined([_visual_part(file, part, linear) for part in parts])


@dataclasses.dataclass(frozen=True)
class MeshPart:
    """One placed part of a file of several.

    Attributes:
        name: of the part in the file.
        matrix: (4, 4) of its frame in the file's world.
        vertices: (V, 3) in its frame, equal ones merged.
        triangles: (T, 3) vertex indices.
        closed: the triangles enclose a volume, and face outwards.
        look: the same triangles with their colours.
    """

    name: str
    matrix: Vertices
    vertices: Vertices
    triangles: Triangles
    closed: bool
    look: VisualMesh

    def visible(self) -> VisualMesh:
        """What is seen of it."""
        return self.look


def closed_surface(vertices: Vertices, triangles: Triangles) -> tuple[Vertices, Triangles] | None:
    """The same surface with equal vertices merged, if it encloses a volume and faces outwards; None otherwise."""
    return _closed(trimesh.Trimesh(vertices, triangles, process=False))


def _closed(mesh: trimesh.Trimesh) -> tuple[Vertices, Triangles] | None:
    solid = mesh.copy()
    solid.merge_vertices(merge_tex=True, merge_norm=True)
    if not (solid.is_watertight and solid.is_winding_consistent and solid.volume > 0.0):
        return None
    return np.asarray(solid.vertices, np.float64), np.asarray(solid.faces, np.int64)


def load_mesh_parts(path: str | Path) -> list[MeshPart]:
    """The parts of a GLB file where it places them, in the order of their names there.

    Raises:
        ModelError: as `load_mesh`.
    """
    file = _checked_file(path)
    scene = _loaded(file, "scene")
    parts = []
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not len(getattr(mesh, "faces", ())):
            continue
        look = _visual_part(file, mesh, linear=True)
        closed = _closed(mesh)
        solid = mesh.copy()
        solid.merge_vertices(merge_tex=True, merge_norm=True)
        vertices, triangles = np.asarray(solid.vertices, np.float64), np.asarray(solid.faces, np.int64)
        parts.append(MeshPart(name, np.asarray(matrix, np.float64), vertices, triangles, closed is not None, look))
    return sorted(parts, key=lambda part: part.name)


def _checked_file(path: str | Path) -> Path:
    file = Path(path)
    if not os.path.isfile(file):  # false, too, for names that no file can have
        raise ModelError(f"mesh file: there must be a file, got {formatted(str(file))}; check the path")
    if file.suffix.lower() not in FORMATS:
        raise ModelError(f"mesh file: the format must be one of {', '.join(FORMATS)}, got '{file.name}'; convert it")
    return file


class _RegularFiles(trimesh.resolvers.FilePathResolver):
    """Files that a mesh names beside itself: to open a FIFO or a device would wait without end."""

    def get(self, name: str) -> bytes:
        """All of a file."""
        check_regular(os.path.join(self.parent, name.strip()), f"mesh file '{self.file_name}'")
        return bytes(super().get(name))

    def namespaced(self, namespace: str) -> _RegularFiles:
        """The same of a folder below."""
        return _RegularFiles(os.path.join(self.parent, namespace), allow_anywhere=self.allow_anywhere)


def check_regular(path: str | Path, thing: str) -> None:
    """Refuses what is there and is no regular file; what is not there is for others to tell of.

    Raises:
        ModelError: it is a folder, a FIFO, a device or a link that leads to itself.
    """
    if os.path.lexists(path):
        try:
            check_input(path)
        except FileError as error:
            raise ModelError(
                f"{thing}: file '{os.path.basename(path)}' must be readable, got: {error.reason}"
            ) from None


def _loaded(file: Path, force: str) -> Any:
    collada = file.suffix.lower() == ".dae"
    text = file.read_bytes() if collada else b""
    if declares_entities(text):
        raise ModelError(f"mesh file: '{file.name}' must not declare a document type or entities; export it again")
    try:
        loaded = trimesh.load(file, force=force, resolver=_RegularFiles(str(file)))
        if collada:
            loaded.apply_scale(_collada_unit(text))
        return loaded
    except ModelError:
        raise
    except Exception as error:  # every format's reader raises its own kinds
        raise ModelError(f"mesh file: '{file.name}' must be readable, got {error!r}; export it again") from error


def _collada_unit(text: bytes) -> float:
    """Metres per unit of a COLLADA file, which its readers leave to others; its `up_axis` is left alone, as in ROS."""
    found = re.search(rb"""<unit\b[^>]*\bmeter\s*=\s*["']([^"']+)["']""", text)
    return float(found.group(1)) if found else 1.0


def _check_obj_textures(file: Path) -> None:
    """An OBJ file whose textures cannot be read is refused: trimesh would leave them out."""
    for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
        keyword, _, name = line.strip().partition(" ")
        library = file.parent / name.strip()
        if keyword.lower() != "mtllib" or not os.path.lexists(library):
            continue
        check_regular(library, f"mesh file '{file.name}'")
        for entry in library.read_text(encoding="utf-8", errors="replace").splitlines():
            keyword, _, image = entry.strip().partition(" ")
            if keyword.lower() == "map_kd":
                read_image(file.parent / image.strip(), f"mesh file '{file.name}'")


def read_image(path: str | Path, thing: str = "texture") -> Image:
    """(height, width, 3) uint8 sRGB of an image file.

    Raises:
        ModelError: there is no such file, or it is no image.
    """
    try:
        with PIL.Image.open(check_input(path)) as image:
            return _pixels(image)
    except (OSError, ValueError, SyntaxError) as error:
        raise ModelError(
            f"{thing}: the texture '{path}' must be a readable image, got {error!r}; check the path, or export it "
            "as PNG or JPEG"
        ) from error


def _pixels(image: Any) -> Image:
    """Transparent parts keep the colour beneath."""
    return np.asarray(image.convert("RGB"), dtype=np.uint8).copy()


def _visual_part(file: Path, part: Any, linear: bool) -> VisualMesh:
    """One part of a scene; `linear`: how its colours are meant."""
    triangles = np.asarray(part.faces, dtype=np.int64)
    look = part.visual
    color: Any = None
    uv: Any = None
    image: Any = None
    if look.kind == "vertex":
        color = np.asarray(look.vertex_colors)[triangles]
    elif look.kind == "face":
        color = np.repeat(np.asarray(look.face_colors)[:, None], 3, axis=1)
    elif look.kind == "texture":
        material = look.material
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        base = getattr(material, "baseColorFactor", None)
        if base is None and image is None:
            base = getattr(material, "diffuse", None)
        if base is not None:
            color = np.broadcast_to(np.asarray(base), (len(triangles), 3, np.size(base)))
        if look.uv is not None:
            uv = np.asarray(look.uv, dtype=np.float32)[triangles]
    if image is not None and uv is None:
        raise ModelError(
            f"mesh file: '{file.name}' has a texture, whose mesh must have texture coordinates (UVs), got none; "
            "unwrap it and export again"
        )
    if color is not None:
        values = np.asarray(color[..., :3], dtype=np.float64)
        values = values / 255.0 if np.issubdtype(np.asarray(color).dtype, np.integer) else values
        color = (values if linear else linear_from_srgb(values)).astype(np.float32)
    return VisualMesh(
        vertices=np.asarray(part.vertices, dtype=np.float64), triangles=triangles, color=color, uv=uv,
        texture=None if image is None else np.zeros(len(triangles), np.int32),
        images=() if image is None else (_pixels(image),),
    )  # fmt: skip


def convex_parts(vertices: npt.ArrayLike, triangles: npt.ArrayLike, **options: Any) -> list[Vertices]:
    """Vertices of convex parts that together are nearly the mesh, from coacd, or else vhacdx; kept on disk by content.

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

        def by_coacd() -> list[Vertices]:
            parts = coacd.run_coacd(coacd.Mesh(points, faces), **options)
            return [np.asarray(part[0], dtype=np.float64) for part in parts]

        return cached_parts(_release("coacd"), points, faces, options, by_coacd)
    if importlib.util.find_spec("vhacdx") is not None:

        def by_vhacd() -> list[Vertices]:
            mesh = trimesh.Trimesh(points, faces, process=False)
            found = trimesh.decomposition.convex_decomposition(mesh, **options)
            return [np.asarray(part["vertices"], dtype=np.float64) for part in found]

        return cached_parts(_release("vhacdx"), points, faces, options, by_vhacd)
    raise ModelError(
        "mesh: decompose=True needs a library for convex decomposition, found neither coacd nor vhacdx; "
        "run: pip install coacd"
    )


def _release(library: str) -> str:
    """Name and version."""
    try:
        return f"{library} {version(library)}"
    except PackageNotFoundError:
        return library


def with_fewer_triangles(vertices: npt.ArrayLike, triangles: npt.ArrayLike, most: int) -> tuple[Vertices, Triangles]:
    """Nearly the same mesh with at most so many triangles; as it is where the library that reduces it is missing."""
    points, faces = np.asarray(vertices, dtype=np.float64), np.asarray(triangles, dtype=np.int64)
    if len(faces) <= most:
        return points, faces
    try:
        small = trimesh.Trimesh(points, faces).simplify_quadric_decimation(face_count=most)
    except ImportError:
        return points, faces
    return np.asarray(small.vertices, dtype=np.float64), np.asarray(small.faces, dtype=np.int64)


def painted_mesh(vertices: npt.ArrayLike, triangles: npt.ArrayLike, colors: npt.ArrayLike) -> trimesh.Trimesh:
    """A mesh for libraries that take those of trimesh, with colours (V, 4) uint8 of its vertices, linear."""
    return trimesh.Trimesh(vertices, triangles, vertex_colors=colors, process=False)


def textured_mesh(
    vertices: npt.ArrayLike, triangles: npt.ArrayLike, uv: npt.ArrayLike, image: Image, color: Sequence[float]
) -> trimesh.Trimesh:
    """A mesh for libraries that take those of trimesh, with a picture that repeats.

    Args:
        vertices: (V, 3).
        triangles: (T, 3).
        uv: (V, 2) texture coordinates, v upwards.
        image: (height, width, 3) uint8 sRGB, top row first.
        color: linear, by which that of the picture is multiplied.
    """
    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=PIL.Image.fromarray(image), metallicFactor=0.0, roughnessFactor=1.0,
        baseColorFactor=np.round(255.0 * np.append(np.clip(color, 0.0, 1.0), 1.0)).astype(np.uint8),
    )  # fmt: skip
    look = trimesh.visual.TextureVisuals(uv=np.asarray(uv, np.float64), material=material)
    return trimesh.Trimesh(vertices, triangles, visual=look, process=False)


@dataclasses.dataclass(frozen=True, eq=False)
class GlbMesh:
    """A mesh to be written.

    Attributes:
        name: unique.
        vertices: (V, 3) [m].
        triangles: (T, 3).
        vertex_color: (V, 3) linear, by which the colour is multiplied; None: 1.
        color: linear albedo.
        smooth: with normals of a rounded surface, otherwise those of the triangles.
    """

    name: str
    vertices: npt.NDArray[Any]
    triangles: npt.NDArray[Any]
    vertex_color: npt.NDArray[Any] | None
    color: tuple[float, ...]
    smooth: bool


@dataclasses.dataclass(frozen=True, eq=False)
class GlbNode:
    """A node to be written, of a mesh by its name or of none, in the axes of its parent."""

    name: str
    matrix: Vertices
    parent: str | None = None
    mesh: str | None = None


def glb_bytes(
    meshes: Sequence[GlbMesh], nodes: Sequence[GlbNode], finish: Callable[[dict[Any, bytes], dict[str, Any]], None]
) -> bytes:
    """A GLB file (glTF 2.0).

    Args:
        meshes: that nodes show.
        nodes: parents before their children.
        finish: changes buffers and the tree of glTF before they are written, such as to add an animation.
    """
    scene = trimesh.Scene()
    for mesh in meshes:
        made = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
        if not mesh.smooth:
            made.unmerge_vertices()
        material = trimesh.visual.material.PBRMaterial(
            baseColorFactor=[*mesh.color, 1.0], metallicFactor=0.0, roughnessFactor=0.8, doubleSided=True
        )
        made.visual = trimesh.visual.TextureVisuals(material=material)
        if mesh.vertex_color is not None:
            corners = mesh.vertex_color if mesh.smooth else mesh.vertex_color[np.asarray(mesh.triangles).reshape(-1)]
            bytes_of = np.round(255.0 * np.clip(corners, 0.0, 1.0)).astype(np.uint8)
            opaque = np.full((len(bytes_of), 1), 255, np.uint8)
            made.visual.vertex_attributes["color"] = np.concatenate([bytes_of, opaque], axis=1)
        scene.geometry[mesh.name] = made
    for node in nodes:
        scene.graph.update(
            frame_to=node.name, frame_from=node.parent or scene.graph.base_frame, matrix=node.matrix, geometry=node.mesh
        )
    return bytes(trimesh.exchange.gltf.export_glb(scene, include_normals=True, buffer_postprocessor=finish))
