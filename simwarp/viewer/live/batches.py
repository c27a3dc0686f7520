"""Instances of a scene in the worlds that are shown, grouped by geometry: one message per geometry and frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ShapeType
from simwarp.sensors.cameras.appearance import ImageTexture
from simwarp.sensors.scene import Scene
from simwarp.simulation.state import State
from simwarp.viewer.live import page_meshes
from simwarp.viewer.live.body_readback import BodyReadback
from simwarp.viewer.live.page_meshes import Triangles

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Key: TypeAlias = tuple[Any, ...]

HIDDEN: Final = 1e-6
"""Scale of what is disabled: an instance cannot be left out of a batch."""
GROUNDS: Final = (ShapeType.PLANE,)
TEXTURED: Final = "texture"


@dataclasses.dataclass(frozen=True, eq=False)
class Batch:
    """All instances of one geometry. The surface of a flexible mesh is one in each world.

    Attributes:
        key: what they have in common.
        mesh: their triangles.
        rows: (N,) which of the shown worlds each is in.
        instances: (N,) which instance of the scene each is.
        moving: whether bodies carry them.
        scales: (N, 3).
        colors: (N, 3) uint8 linear: what the page takes of instances.
        surface: place among the surfaces of the scene, whose vertices change; -1: it is none of them.
    """

    key: Key
    mesh: Triangles
    rows: Ints
    instances: Ints
    moving: bool
    scales: Array
    colors: npt.NDArray[np.uint8]
    surface: int = -1


@dataclasses.dataclass(frozen=True, eq=False)
class Ground:
    """An endless plane, once for all worlds: z = 0 of its frame, its colour, and the side of its squares [m]; the image
    texture on it, and by what that is multiplied, where it has one that is laid along it.
    """

    position: Array
    rotation: Array
    color: npt.NDArray[np.uint8]
    tile: float
    texture: ImageTexture | None = None
    tint: tuple[float, ...] = (1.0, 1.0, 1.0)


class Batches:
    """Batches of some worlds of a scene, and their poses.

    Args:
        scene: its instances.
        worlds: indices of the shown worlds.
        scenery: row of the one world whose fixed things are shown; None: those of all.

    Attributes:
        batches: as of the last `read_scenery`.
        grounds: endless planes.
        revision: counts the times that the batches changed.
    """

    def __init__(self, scene: Scene, worlds: Sequence[int], scenery: int | None = None) -> None:
        self.scene, self.worlds = scene, np.asarray(worlds, np.int64)
        self._scenery = scenery
        self.batches: list[Batch] = []
        self.grounds: list[Ground] = []
        self.revision = 0
        self._meshes: dict[Key, Triangles] = {}
        self._kinds = [instance.kind for instance in scene.visuals.instances]
        self.read_scenery()

    def read_scenery(self) -> bool:
        """Reads placement, size and colour of all instances in the shown worlds; True where batches changed.

        To be called after resets: between them only bodies move.
        """
        self._read_arrays()
        found = self._assigned()
        if self.revision and len(found) == len(self.batches) and all(map(_equal, found, self.batches)):
            return False
        self.batches, self.grounds = found, self._grounds()
        self.revision += 1
        return True

    def poses(self, bodies: BodyReadback) -> tuple[Array, Array]:
        """Positions (S, I, 3) [m] and orientations (S, I, 4) xyzw of all instances in world axes."""
        places = np.concatenate([bodies.positions, np.zeros((len(self.worlds), 1, 3))], axis=1)
        turns = np.concatenate([bodies.rotations, np.tile((0.0, 0.0, 0.0, 1.0), (len(self.worlds), 1, 1))], axis=1)
        body = self.scene.body  # -1, of the world, is the last row
        carrier = turns[:, body]
        return places[:, body] + turned(carrier, self._x), multiplied(carrier, self._rot)

    def vertices(self, state: State) -> dict[Key, npt.NDArray[np.float32]]:
        """(V, 3) vertices of every batch that is a surface, as they are now, from the place of its instance [m]."""
        surfaces = self.scene.surfaces
        batches = [batch for batch in self.batches if batch.surface >= 0]
        if surfaces is None or not batches:
            return {}
        every = surfaces.vertices(state, self.worlds)
        ends = surfaces.vertex_start
        return {
            batch.key: every[int(batch.rows[0]), ends[batch.surface] : ends[batch.surface + 1]] for batch in batches
        }

    def extent(self, shown: BodyReadback, *, moving: bool = True) -> Array:
        """(S, 2, 3) corners of what bodies carry, or of all but endless planes [m]; of bodies where nothing is seen."""
        places, _ = self.poses(shown)
        reach = np.abs(self._size).max(axis=-1)
        for index, kind in enumerate(self._kinds):
            if kind in (ShapeType.HULL, ShapeType.MESH, ShapeType.HEIGHT_FIELD):
                mesh = self._mesh(self._key(0, index))
                factor = 1.0 if kind == ShapeType.HEIGHT_FIELD else np.abs(self._size[:, index]).max(axis=-1)
                reach[:, index] = factor * float(np.linalg.norm(mesh.vertices, axis=1).max(initial=0.0))
        counted = np.array([kind not in GROUNDS for kind in self._kinds], bool) & (
            (self.scene.body >= 0) | (not moving)
        )
        counted = counted[None] & (self._enabled > 0)
        low = np.where(counted[..., None], places - reach[..., None], np.inf).min(axis=1, initial=np.inf)
        high = np.where(counted[..., None], places + reach[..., None], -np.inf).max(axis=1, initial=-np.inf)
        bodies = shown.positions
        empty = ~np.isfinite(low).all(axis=-1, keepdims=True)
        if bodies.shape[1]:
            low = np.where(empty, bodies.min(axis=1), low)
            high = np.where(empty, bodies.max(axis=1), high)
        return np.stack([np.where(np.isfinite(low), low, -1.0), np.where(np.isfinite(high), high, 1.0)], axis=1)

    def _read_arrays(self) -> None:
        scene, model = self.scene, self.scene.model

        def rows(array: Any) -> Any:
            values = array.numpy()
            return values[self.worlds] if len(values) > 1 else np.repeat(values[:1], len(self.worlds), axis=0)

        values = {
            name: rows(getattr(scene, name)) for name in ("x", "rot", "size", "asset", "enabled", "color", "texture")
        }
        shaped = scene.shape >= 0
        if shaped.any():
            shapes = scene.shape[shaped]
            for name in ("x", "rot", "size", "asset"):
                values[name] = values[name].copy()
                values[name][:, shaped] = rows(getattr(model, f"shape_{name}"))[:, shapes]
            values["enabled"] = values["enabled"].copy()
            values["enabled"][:, shaped] *= rows(model.shape_enabled)[:, shapes] > 0
        self._x, self._rot = values["x"].astype(np.float64), values["rot"].astype(np.float64)
        self._size, self._asset, self._enabled = values["size"].astype(np.float64), values["asset"], values["enabled"]
        self._color, self._texture = values["color"], values["texture"]

    def _key(self, row: int, instance: int) -> Key:
        kind, moving = self._kinds[instance], bool(self.scene.body[instance] >= 0)
        if self.scene.flexible[instance] >= 0:
            return (kind, moving, "flexible", int(self.scene.flexible[instance]), row)
        own = bool(self.scene.shape[instance] >= 0)
        if kind == ShapeType.CAPSULE:
            radius, half, _ = self._size[row, instance]
            return (kind, moving, round(float(half / max(radius, 1e-9)), 2))
        if self._is_textured(row, instance):
            asset, texture = int(self._asset[row, instance]), int(self._texture[row, instance])
            color = tuple(np.round(self._color[row, instance], 3).tolist())
            return (kind, moving, asset, own, color, TEXTURED, texture)
        if kind in (ShapeType.HULL, ShapeType.HEIGHT_FIELD):
            return (kind, moving, int(self._asset[row, instance]))
        if kind == ShapeType.MESH:
            asset = int(self._asset[row, instance])
            if not own and self._has_color(asset):
                color = tuple(np.round(self._color[row, instance], 3).tolist())
                return (kind, moving, asset, own, color)
            return (kind, moving, asset, own)
        return (ShapeType.SPHERE if kind in page_meshes.ROUNDED else kind, moving)

    def _is_textured(self, row: int, instance: int) -> bool:
        """Whether it is a height field or mesh, as large as it was made, under a texture of its own."""
        kind, size = self._kinds[instance], self._size[row, instance]
        if self._texture[row, instance] < 0 or kind not in (ShapeType.HEIGHT_FIELD, ShapeType.MESH):
            return False
        plain = kind == ShapeType.HEIGHT_FIELD or bool(np.isin(size, (0.0, 1.0)).all())
        return plain and (kind == ShapeType.HEIGHT_FIELD or not self.scene.shape[instance] >= 0)

    def _has_color(self, asset: int) -> bool:
        look = self.scene.visuals.mesh_visuals[asset]
        return look is not None and (look.color is not None or look.texture is not None)

    def _mesh(self, key: Key) -> Triangles:
        if key not in self._meshes:
            made = self._made(key)
            if key[5:6] == (TEXTURED,):
                visuals, asset = self.scene.visuals, key[2]
                mesh = key[0] == ShapeType.MESH
                made = page_meshes.with_texture(
                    made, visuals.textures.textures[key[6]], visuals.meshes[asset] if mesh else None,
                    visuals.mesh_visuals[asset] if mesh else None,
                )  # fmt: skip
            self._meshes[key] = made
        return self._meshes[key]

    def _made(self, key: Key) -> Triangles:
        visuals, kind = self.scene.visuals, key[0]
        if key[2:3] == ("flexible",):
            return page_meshes.of_surface(visuals.builder.flexible_meshes[key[3]])
        plain = {
            ShapeType.SPHERE: page_meshes.ball, ShapeType.BOX: page_meshes.cube,
            ShapeType.CYLINDER: page_meshes.cylinder, ShapeType.CONE: page_meshes.cone,
        }  # fmt: skip
        if kind in plain:
            return plain[kind]()
        if kind == ShapeType.CAPSULE:
            return page_meshes.capsule(key[2])
        if kind == ShapeType.HULL:
            return page_meshes.of_hull(visuals.builder.hulls[key[2]])
        if kind == ShapeType.HEIGHT_FIELD:
            return page_meshes.of_height_field(visuals.builder.height_fields[key[2]])
        if key[3]:
            given = visuals.builder.meshes[key[2]]
            plainly = Triangles(np.asarray(given.vertices, np.float32), np.asarray(given.triangles, np.uint32))
            return page_meshes.simplified(plainly)
        mesh = page_meshes.of_mesh(visuals, key[2])
        if mesh.color is not None:
            mesh = dataclasses.replace(mesh, color=mesh.color * np.asarray(key[4], np.float32))
        return mesh

    def _assigned(self) -> list[Batch]:
        groups: dict[Key, list[tuple[int, int]]] = {}
        for instance, kind in enumerate(self._kinds):
            if kind in GROUNDS:
                continue
            rows: Sequence[int] = range(len(self.worlds))
            if self._scenery is not None and self.scene.body[instance] < 0:
                rows = (self._scenery,)
            if self.scene.flexible[instance] >= 0:
                for row in range(len(self.worlds)):
                    groups[self._key(row, instance)] = [(row, instance)]
                continue
            alike = kind not in (ShapeType.CAPSULE, *_ASSETS) or (
                np.ptp(self._asset[:, instance]) == 0 and np.ptp(self._size[:, instance], axis=0).max() == 0.0
                and np.ptp(self._color[:, instance], axis=0).max() == 0.0 and np.ptp(self._texture[:, instance]) == 0
            )  # fmt: skip
            if alike:
                groups.setdefault(self._key(0, instance), []).extend((row, instance) for row in rows)
            else:
                for row in rows:
                    groups.setdefault(self._key(row, instance), []).append((row, instance))
        return [self._batch(key, np.array(members, np.int64)) for key, members in groups.items()]

    def _batch(self, key: Key, members: Ints) -> Batch:
        rows, instances = members[:, 0], members[:, 1]
        size = self._size[rows, instances].copy()
        if key[0] in (ShapeType.CYLINDER, ShapeType.CONE):
            size = size[:, [0, 2, 1]]  # radius, half length, radius
        elif key[0] == ShapeType.CAPSULE:
            size[:] = size[:, :1]
        elif key[0] in (ShapeType.HULL, ShapeType.HEIGHT_FIELD) or (key[0] == ShapeType.MESH and key[3]):
            size = np.where(size == 0.0, 1.0, size)
        size[self._enabled[rows, instances] == 0] = HIDDEN
        colors = page_meshes.linear_bytes(self._colors(rows, instances))
        flexible = self.scene.flexible
        surface = int((flexible[: instances[0]] >= 0).sum()) if flexible[instances[0]] >= 0 else -1
        return Batch(key, self._mesh(key), rows, instances, key[1], size, colors, surface)

    def _colors(self, rows: Ints, instances: Ints) -> Array:
        """(N, 3) linear albedos."""
        color = self._color[rows, instances].astype(np.float64).copy()
        textures = self._texture[rows, instances]
        for texture in np.unique(textures[textures >= 0]):
            color[textures == texture] *= mean_color(self.scene.visuals.textures.textures[int(texture)])
        return color

    def _grounds(self) -> list[Ground]:
        """Planes of the first shown world that are not the same as an earlier one."""
        found: dict[tuple[float, ...], Ground] = {}
        for instance, kind in enumerate(self._kinds):
            if kind in GROUNDS and self._enabled[0, instance] and self.scene.body[instance] < 0:
                place, turn = self._x[0, instance], self._rot[0, instance]
                texture = int(self._texture[0, instance])
                look = self.scene.visuals.textures.textures[texture] if texture >= 0 else None
                color = page_meshes.srgb_bytes(self._colors(np.zeros(1, np.int64), np.array([instance]))[0])
                tile = float(np.max(getattr(look, "metres", None) or 1.0))
                image = look if isinstance(look, ImageTexture) and look.metres is not None else None
                if image is not None and np.ptp(np.asarray(image.metres)) > 0.0:
                    image = None  # it goes along with the camera by sections, which must be whole pictures
                tint = tuple(self._color[0, instance].tolist())
                ground = Ground(place, turn, color, tile, image, tint)
                found.setdefault((*np.round(place, 6), *np.round(turn, 6)), ground)
        return list(found.values())


_ASSETS: Final = (ShapeType.HULL, ShapeType.MESH, ShapeType.HEIGHT_FIELD)


def mean_color(texture: Any) -> Array:
    """Linear colour of a texture seen from afar."""
    if hasattr(texture, "colors"):
        return np.asarray(texture.colors, np.float64).mean(axis=0)
    image = texture.image
    if not isinstance(image, np.ndarray):
        from PIL import Image

        with Image.open(image) as file:
            image = np.asarray(file.convert("RGB").resize((8, 8)))
    return np.asarray(page_meshes.linear(image.reshape(-1, 3) / 255.0).mean(axis=0))


def body_positions(state: State, worlds: Ints) -> Array:
    """(S, B, 3) centres of mass in these worlds [m]."""
    return rows_on_host(state.body_x, worlds)


def body_rotations(state: State, worlds: Ints) -> Array:
    """(S, B, 4) orientations of the bodies in these worlds, xyzw."""
    return rows_on_host(state.body_rot, worlds)


def rows_on_host(array: Any, worlds: Ints) -> Array:
    """Rows of an array of all worlds; from a GPU only those are copied."""
    if array.device.is_cpu:
        return np.asarray(array.numpy()[worlds], np.float64)
    from simwarp.core.interop import to_torch  # torch only where there is a GPU: it takes seconds to import

    return np.asarray(to_torch(array)[worlds.tolist()].cpu().numpy(), np.float64)


def turned(q: Array, v: Array) -> Array:
    """Vectors (..., 3) turned by quaternions (..., 4) xyzw."""
    across = 2.0 * np.cross(q[..., :3], v)
    return v + q[..., 3:] * across + np.cross(q[..., :3], across)


def multiplied(a: Array, b: Array) -> Array:
    """Products (..., 4) of quaternions xyzw."""
    vector = a[..., 3:] * b[..., :3] + b[..., 3:] * a[..., :3] + np.cross(a[..., :3], b[..., :3])
    scalar = a[..., 3:] * b[..., 3:] - (a[..., :3] * b[..., :3]).sum(axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


def _equal(one: Batch, other: Batch) -> bool:
    return one.key == other.key and all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("rows", "instances", "scales", "colors")
    )
