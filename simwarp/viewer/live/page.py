"""What a browser shows of a subject: its instances, ground, light and lines, kept as the state has them."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from importlib.resources import files
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD
from simwarp.sensors.scene import Scene
from simwarp.viewer.live.batches import TEXTURED, Batch, Batches, Ground, turned
from simwarp.viewer.live.body_readback import BodyReadback
from simwarp.viewer.live.page_light import DAY, NIGHT
from simwarp.viewer.live.page_meshes import linear_bytes, srgb_bytes
from simwarp.viewer.live.page_textures import skin_along
from simwarp.viewer.live.subject import Subject
from simwarp.viewer.live.web_server import WebServer, run_script
from simwarp.viewer.live.world_layout import Layout, offsets
from simwarp.viewer.studio import SIDE, Shot, about_vertical, headings

Array = npt.NDArray[np.float64]

ROOT: Final = "/world"
"""Of what is fixed: it moves under the camera where a body is followed."""
MOVING: Final = "/moving"
"""Of what moves by itself: sent as the camera sees it, so that a followed body does not tremble where a browser takes
the pose of a node later than those of instances.
"""
GRAIN: Final = 2.0**14
"""Steps per metre, and of quaternions, that recorded poses are rounded to: 0.06 mm. As powers of two they are short in
binary too: files are a tenth smaller than with 0.1 mm."""
FAR: Final = 400.0
"""Half side of a ground [m]."""


class Page:
    """The scene of a page.

    Args:
        server: that shows it.
        subject: what is seen.
        worlds: indices of the shown worlds.
        layout: how they lie beside each other.
    """

    def __init__(self, server: WebServer, subject: Subject, worlds: Sequence[int], layout: Layout) -> None:
        self.server, self.subject, self.layout = server, subject, layout
        self.scene: Any = server.viser.scene
        self.worlds = np.asarray(worlds, np.int64)
        self.seen = subject.scene
        """The scene whose instances are shown."""
        self.overlays: list[Callable[[], None]] = []
        """Called with every frame, to draw what lies over the scene."""
        self.on_instances: list[Callable[[Batch, Any], None]] = []
        """Called with every batch of moving instances that is sent anew, and its handle."""
        self.paths_shown = True
        self.following = False
        self.turning: Callable[[], float] | None = None
        """Returns the heading that is ahead on the page while something is followed [rad]; None: +X is."""
        self.recorded = 0
        """Recordings that run: poses are rounded for them, since numbers that are alike make small files."""
        self.chosen = 0
        """Row of the world that the camera and single panels are about."""
        self.bodies = BodyReadback(subject.simulation.state, self.worlds)
        self.batches = self._batches()
        self._sun_at = np.array([-4.0, -5.0, 10.0])
        self._handles: dict[Any, Any] = {}
        self._grounds: list[Any] = []
        self._lines: list[Any] = []
        self._origin = np.zeros(3)
        self._sent = -1
        self._turn, self._shift = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)
        """How the fixed scene lies under the camera: xyzw, and [m]."""
        self._rest = np.zeros(3)
        """Place of the followed body in the scene when following began."""
        self.offsets = np.zeros((len(self.worlds), 3))
        self._root = self.scene.add_frame(ROOT, show_axes=False)
        self.look(dark=False)
        self.arrange(layout)
        self.aim()

    def look(self, *, dark: bool) -> None:
        """Light, sky and colours of the panels."""
        self._light = NIGHT if dark else DAY
        self._sun = self._light.shine(self.server.viser)
        self._sun.position = tuple(self._sun_at)
        self._sent = -1  # grounds are seen in its light

    def arrange(self, layout: Layout) -> None:
        """Puts the shown worlds beside each other, upon each other, or shows one."""
        self.layout = layout
        self.batches = self._batches()
        self._sent = -1
        self.bodies.read()
        moving = self.batches.extent(self.bodies)
        whole = self.batches.extent(self.bodies, moving=False)
        self.offsets = offsets(layout, moving, whole)

    def show_worlds(self, worlds: Sequence[int]) -> None:
        """Others of the simulation's worlds instead of those that were shown."""
        self.worlds = np.asarray(worlds, np.int64)
        self.bodies = BodyReadback(self.subject.simulation.state, self.worlds)
        self.chosen = min(self.chosen, len(self.worlds) - 1)
        self.arrange(self.layout)

    def show_scene(self, scene: Scene) -> None:
        """Another scene of the same model, such as its collision shapes."""
        self.seen = scene
        self.batches = self._batches()
        self._sent = -1

    @property
    def world(self) -> int:
        """The chosen world of the simulation."""
        return int(self.worlds[self.chosen])

    @property
    def mask(self) -> npt.NDArray[np.bool_]:
        """(W,) true for the chosen world of the simulation."""
        return np.arange(self.subject.simulation.model.world_count) == self.world

    @property
    def shifts(self) -> Array:
        """(S, 3) from the coordinates of the shown worlds to those of `ROOT` [m]."""
        return self.offsets - self._origin

    def node(self, batch: Batch) -> str:
        """Name of a batch in the page's tree."""
        return f"{MOVING if batch.moving else ROOT + '/fixed'}/{_word(batch.key)}"

    def in_world(self, place: Any, row: int) -> Array:
        """A place of the page in coordinates of a shown world [m]."""
        back = self._turn * (-1.0, -1.0, -1.0, 1.0)
        return np.asarray(turned(back, np.asarray(place, np.float64) - self._shift) - self.shifts[row])

    def refresh(self) -> None:
        """Reads the scenery again, and sends what has changed of it."""
        self.batches.read_scenery()
        self._sent = -1

    def refresh_scenery(self) -> None:
        """Reads the scenery again; unchanged it is not sent."""
        self.batches.read_scenery()

    def frame(self, *, waits: bool = True) -> None:
        """Sends the present state; without waiting a GPU's newest that has arrived, and nothing where that was sent."""
        if waits:
            self.bodies.read()
        elif not self.bodies.read_on():
            return
        places, turns = self.batches.poses(self.bodies)
        places = places + (self.offsets - self._origin)[:, None]
        if self.following:
            self._move_under_camera()
        places, turns = self._as_seen(places, turns)
        wxyz = turns[..., [3, 0, 1, 2]]
        shapes = self._shapes(places, turns)
        if self.recorded:
            places, wxyz = np.round(places * GRAIN) / GRAIN, np.round(wxyz * GRAIN) / GRAIN
        with self.server.viser.atomic():
            if self._sent != self.batches.revision:
                self._send_all(places, wxyz, shapes)
            else:
                for batch in self.batches.batches:
                    if batch.moving and batch.key in self._handles:
                        handle = self._handles[batch.key]
                        if batch.surface >= 0:
                            if not np.array_equal(handle.vertices, shapes[batch.key]):
                                handle.vertices = shapes[batch.key]
                            continue
                        handle.batched_positions = places[batch.rows, batch.instances].astype(np.float32)
                        handle.batched_wxyzs = wxyz[batch.rows, batch.instances].astype(np.float32)
            self._root.wxyz, self._root.position = self._turn[[3, 0, 1, 2]], self._shift
            if self.following:
                self._sun.position = tuple(turned(self._turn, self._sun_at))
                self._move_grounds()
            self._draw_paths()

    def followed(self) -> Array:
        """Place of the body that the camera goes with, in the scene [m]."""
        if self.body() == WORLD:
            return np.zeros(3)
        return np.asarray(self._of_body(self.bodies.positions) + self.offsets[self.chosen] - self._origin)

    def velocity(self) -> Array:
        """Velocity of the body that the camera goes with [m/s]."""
        return np.zeros(3) if self.body() == WORLD else self._of_body(self.bodies.velocities)

    def _of_body(self, values: Array) -> Array:
        """What the body has that the camera goes with, in the chosen world."""
        return np.asarray(values[self.chosen, self.body()])

    def follow(self, on: bool) -> None:
        """Moves the scene under the camera, or lets it rest."""
        self.following = on
        self._rest = turned(self._turn, self.followed()) + self._shift

    def stand_beside(self, eye: Array, target: Array) -> None:
        """Cameras of all who look, and of those who come, from the place of the followed body [m]."""
        viser = self.server.viser
        cameras: list[Any] = [viser.initial_camera, *(client.camera for client in viser.get_clients().values())]
        for camera in cameras:
            camera.position, camera.look_at = tuple(self._rest + eye), tuple(self._rest + target)

    def under_camera(self, places: Array, turns: Array) -> tuple[Array, Array]:
        """Places (..., 3) and orientations (..., 4) xyzw of `ROOT` under the camera: for nodes of `MOVING`."""
        return turned(self._turn, places) + self._shift, turned_about_z(self._turn, turns)

    def heading(self, vectors: Array) -> Array:
        """Vectors (..., 3) of the world as they are under the camera."""
        return turned(self._turn, vectors)

    def greet(self, client: Any) -> None:
        """Fits the page of somebody who has come: on a narrow one the camera stands back, the panels are folded."""
        if client.client_id not in self.server.viser.get_clients():
            return  # and has gone already
        run_script(client, _narrow_page())
        camera = client.camera
        if 0.0 < camera.aspect < 1.0:
            away = np.asarray(camera.position) - np.asarray(camera.look_at)
            camera.position = tuple(np.asarray(camera.look_at) + away / camera.aspect)

    def _move_under_camera(self) -> None:
        angle = 0.0 if self.turning is None else -self.turning()
        self._turn = np.array([0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)])
        self._shift = self._rest - turned(self._turn, self.followed())

    def _as_seen(self, places: Array, turns: Array) -> tuple[Array, Array]:
        """Poses of moving instances under the camera; fixed ones are moved with their root."""
        if not self._turn[2] and not self._shift.any():
            return places, turns
        seen_places, seen_turns = places.copy(), turns.copy()
        for batch in self.batches.batches:
            if batch.moving:
                at = batch.rows, batch.instances
                seen_places[at], seen_turns[at] = self.under_camera(places[at], turns[at])
        return seen_places, seen_turns

    def _move_grounds(self) -> None:
        place = self.followed()
        for ground, handle in zip(self.batches.grounds, self._grounds, strict=False):
            if abs(ground.rotation[0]) + abs(ground.rotation[1]) < 1e-6:  # level: goes along, a section at a time
                section = 10.0 * ground.tile
                moved = ground.position - self._origin
                moved[:2] += section * np.round((place - moved)[:2] / section)
                if not np.allclose(handle.position, moved):
                    handle.position = moved

    def aim(self) -> None:
        """Camera of those who come: as the subject's shot has it, at one world or at all of them."""
        shot = self.subject.shot or Shot()
        extent = self.batches.extent(self.bodies) + self.offsets[:, None] - self._origin
        if self.layout is not Layout.GRID or len(self.worlds) == 1:
            extent = extent[self.chosen : self.chosen + 1]
        low, high = extent[:, 0].min(axis=0), extent[:, 1].max(axis=0)
        target = 0.5 * (low + high)
        size = max(float(np.linalg.norm(high - low)), 0.2)
        away = np.array(SIDE) / np.linalg.norm(SIDE) * (0.52 * size / math.tan(0.5 * 1.0))
        if shot.eye is not None and self.layout is not Layout.GRID:
            heading = self._heading() if shot.turns else 0.0
            away = about_vertical(np.array([shot.eye], np.float64), [heading])[0]
            if shot.target is not None:
                target = self.followed() + about_vertical(np.array([shot.target], np.float64), [heading])[0]
        camera = self.server.viser.initial_camera
        camera.position, camera.look_at = tuple(target + away), tuple(target)
        camera.near, camera.far = 0.01 if size < 5.0 else 0.05, 4000.0
        self._sun_at = target + np.array([-0.4, -0.5, 1.0]) * max(size, 5.0)
        self._sun.position = tuple(self._sun_at)

    def _batches(self) -> Batches:
        scenery = self.chosen if self.layout is Layout.OVERLAY else None
        return Batches(self.seen, self.worlds.tolist(), scenery)

    def body(self) -> int:
        """Index of the body that the camera goes with; `WORLD`: none."""
        shot, model = self.subject.shot or Shot(), self.subject.simulation.model
        if isinstance(shot.body, str):
            return model.body_names.index(shot.body)
        return int(shot.body) if model.body_count else WORLD

    def _heading(self) -> float:
        """Of the body that the camera goes with, in the chosen world [rad]."""
        body = self.body()
        return 0.0 if body == WORLD else float(headings([self.bodies.rotations[self.chosen, body]])[0])

    def _shapes(self, places: Array, turns: Array) -> dict[Any, Any]:
        """(V, 3) float32 vertices of every surface of a flexible mesh, as the page has them [m]."""
        found = {}
        vertices = self.batches.vertices(self.subject.simulation.state)
        for batch in self.batches.batches:
            if batch.surface >= 0:
                at = batch.rows[0], batch.instances[0]
                shape = places[at] + turned(turns[at], batch.scales[0] * vertices[batch.key].astype(np.float64))
                if self.recorded:
                    shape = np.round(shape * GRAIN) / GRAIN
                found[batch.key] = shape.astype(np.float32)
        return found

    def _send_all(self, places: Array, wxyz: Array, shapes: dict[Any, Any]) -> None:
        wanted = {batch.key for batch in self.batches.batches}
        for key in [key for key in self._handles if key not in wanted]:
            self._handles.pop(key).remove()
        for batch in self.batches.batches:
            handle = self._handles[batch.key] = self._add(batch, places, wxyz, shapes)
            for told in self.on_instances if batch.moving and batch.surface < 0 else ():
                told(batch, handle)
        for handle in self._grounds:
            handle.remove()
        self._grounds = [self._add_ground(index) for index in range(len(self.batches.grounds))]
        self._sent = self.batches.revision

    def _add(self, batch: Batch, places: Array, wxyz: Array, shapes: dict[Any, Any]) -> Any:
        if batch.surface >= 0:
            color = tuple(srgb_bytes(batch.colors[0] / 255.0).tolist())
            return self.scene.add_mesh_simple(
                self.node(batch), shapes[batch.key], batch.mesh.faces, color=color, flat_shading=True, side="double"
            )
        common = {
            "batched_positions": places[batch.rows, batch.instances].astype(np.float32),
            "batched_wxyzs": wxyz[batch.rows, batch.instances].astype(np.float32),
            "batched_scales": batch.scales.astype(np.float32), "lod": "off",
        }  # fmt: skip
        name = self.node(batch)
        if batch.mesh.skin is not None:
            from simwarp.geometry.mesh_files import textured_mesh

            skin = batch.mesh.skin
            tint = batch.key[4] if batch.key[5:6] == (TEXTURED,) else (1.0, 1.0, 1.0)
            mesh = textured_mesh(batch.mesh.vertices, batch.mesh.faces, skin.uv, skin.image, tint)
            return self.scene.add_batched_meshes_trimesh(name, mesh, **common)
        if batch.mesh.color is not None:
            from simwarp.geometry.mesh_files import painted_mesh

            shaded = np.concatenate(
                [linear_bytes(batch.mesh.color), np.full((len(batch.mesh.vertices), 1), 255, np.uint8)], axis=1
            )
            mesh = painted_mesh(batch.mesh.vertices, batch.mesh.faces, shaded)
            return self.scene.add_batched_meshes_trimesh(name, mesh, **common)
        return self.scene.add_batched_meshes_simple(
            name, batch.mesh.vertices, batch.mesh.faces, batched_colors=batch.colors,
            flat_shading=not batch.mesh.smooth, **common,
        )  # fmt: skip

    def _add_ground(self, index: int) -> Any:
        ground = self.batches.grounds[index]
        if ground.texture is not None:
            return self._add_textured_ground(index, ground)
        color = self._light.shaded(ground.color)
        darker = tuple(int(0.86 * value) for value in color)
        turn = ground.rotation[[3, 0, 1, 2]]
        return self.scene.add_grid(
            f"{ROOT}/ground_{index}", width=2.0 * FAR, height=2.0 * FAR, cell_size=ground.tile,
            section_size=10.0 * ground.tile, cell_color=darker, section_color=tuple(int(0.7 * v) for v in color),
            infinite_grid=False, fade_distance=120.0 * ground.tile, plane_color=color, plane_opacity=1.0,
            shadow_opacity=0.35, position=tuple(ground.position - self._origin), wxyz=tuple(turn),
        )  # fmt: skip

    def _add_textured_ground(self, index: int, ground: Ground) -> Any:
        """A square of two triangles under the ground's picture."""
        from simwarp.geometry.mesh_files import textured_mesh

        assert ground.texture is not None
        side = 10.0 * ground.tile * max(1, round(FAR / (10.0 * ground.tile)))  # whole sections: `_move_grounds`
        corners = side * np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)])
        skin = skin_along(ground.texture, corners)
        assert skin is not None
        mesh = textured_mesh(corners, [(0, 1, 2), (0, 2, 3)], skin.uv, skin.image, ground.tint)
        return self.scene.add_mesh_trimesh(
            f"{ROOT}/ground_{index}", mesh, cast_shadow=False, position=tuple(ground.position - self._origin),
            wxyz=tuple(ground.rotation[[3, 0, 1, 2]]),
        )  # fmt: skip

    def _draw_paths(self) -> None:
        if self.subject.paths is None:
            return
        paths = list(self.subject.paths()) if self.paths_shown else []
        while len(self._lines) > len(paths):
            self._lines.pop().remove()
        for index, path in enumerate(paths):
            points = np.asarray(path.points, np.float64)[self.worlds] + (self.offsets - self._origin)[:, None]
            segments = np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 3).astype(np.float32)
            if index < len(self._lines) and self._lines[index].points.shape == segments.shape:
                if not np.array_equal(self._lines[index].points, segments):
                    self._lines[index].points = segments
                continue
            handle = self.scene.add_line_segments(
                f"{ROOT}/paths/{index}", points=segments, colors=path.color, thickness=path.width,
                thickness_units="screen",
            )  # fmt: skip
            self._lines[index : index + 1] = [handle]


@functools.cache
def _narrow_page() -> str:
    return (files("simwarp.viewer.live") / "narrow_page.js").read_text(encoding="utf-8")


def turned_about_z(turn: Array, q: Array) -> Array:
    """Orientations (..., 4) xyzw after a turn (0, 0, z, w)."""
    z, w = turn[2], turn[3]
    x0, y0, z0, w0 = np.moveaxis(q, -1, 0)
    return np.stack([w * x0 - z * y0, w * y0 + z * x0, w * z0 + z * w0, w * w0 - z * z0], axis=-1)


def _word(key: Sequence[Any]) -> str:
    """A key as the name of a node."""
    return "_".join(str(part).replace("/", "-").replace(" ", "") for part in (int(key[0]), *key[1:]))
