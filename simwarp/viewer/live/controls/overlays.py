"""What may be drawn over the scene of a page: contacts, joints, frames, centres of mass, names, trails.

Each overlay is made when it is switched on, drawn with every frame, and gone when it is switched off.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD, RowKind
from simwarp.model.joint_types import ELEMENTS
from simwarp.model.model import Model
from simwarp.viewer.live.batches import rows_on_host, turned
from simwarp.viewer.live.page import MOVING, ROOT, Page

Array = npt.NDArray[np.float64]

MOST_NAMES: Final = 40
TRAIL: Final = 10.0
"""Length of a trail [s]."""
TRAIL_STEP: Final = 0.1
"""Between two of its points [s]."""
JUMP: Final = 2.0
"""A trail is cut where its agent moves further between two points [m]."""
BLUE: Final = (40, 120, 230)
RED: Final = (225, 60, 40)
GREEN: Final = (30, 150, 70)


def body_poses(page: Page) -> tuple[Array, Array]:
    """Positions (S, B + 1, 3) [m] and rotations (S, B + 1, 4) of the bodies under the camera; the world is last."""
    count = len(page.worlds)
    places = np.concatenate([page.bodies.positions, np.zeros((count, 1, 3))], axis=1) + page.shifts[:, None]
    turns = np.concatenate([page.bodies.rotations, np.tile((0.0, 0.0, 0.0, 1.0), (count, 1, 1))], axis=1)
    return page.under_camera(places, turns)


def typical_size(page: Page) -> float:
    """Of what moves in a world [m]: for lengths of axes and widths of arrows."""
    extent = page.batches.extent(page.bodies)
    return float(np.clip(np.ptp(extent[0], axis=0).max(), 0.05, 10.0))


class Overlay:
    """Something that is drawn over the scene.

    Args:
        page: over whose scene.

    Attributes:
        name: of its nodes.
    """

    ROOM: ClassVar[str] = MOVING
    """What it goes with on the page."""

    def __init__(self, page: Page) -> None:
        self.page, self.name = page, type(self).__name__
        self.scene: Any = page.server.viser.scene
        self.size = typical_size(page)
        self._handles: dict[str, Any] = {}
        self._shown: dict[str, bool] = {}

    def draw(self) -> None:
        """Brings it to the present state."""
        raise NotImplementedError

    def remove(self) -> None:
        """Takes it away."""
        for handle in self._handles.values():
            handle.remove()
        self._handles.clear()

    def put(self, name: str, make: Callable[[str], Any], **arrays: npt.NDArray[np.float32]) -> None:
        """Adds a node, or gives it other arrays; one without entries is hidden."""
        handle, full = self._handles.get(name), all(len(array) for array in arrays.values())
        if handle is None:
            if full:
                self._handles[name] = make(f"{self.ROOM}/over/{self.name}/{name}")
                self._shown[name] = True
            return
        if full:
            for key, array in arrays.items():
                setattr(handle, key, array)
        if self._shown[name] != full:
            handle.visible = self._shown[name] = full

    def put_lines(self, name: str, lines: npt.NDArray[np.float32], color: tuple[int, int, int]) -> None:
        """Adds line segments (N, 2, 3) [m], or moves them."""
        self.put(
            name,
            lambda node: self.scene.add_line_segments(
                node, points=lines, colors=color, thickness=3.0, thickness_units="screen"
            ),
            points=lines,
        )  # fmt: skip


class ContactOverlay(Overlay):
    """Where shapes touch, and the forces on the second shape of each pair.

    Args:
        page: over whose scene.
        scale: newtons that an arrow of a metre stands for.
        forces: with arrows.
    """

    def __init__(self, page: Page, scale: float, *, forces: bool) -> None:
        super().__init__(page)
        self.scale, self.forces = scale, forces
        self.name = "forces" if forces else "points"
        model = page.subject.simulation.model
        self._body = np.array([shape.body for shape in model.builder.shapes], np.int64)

    def touching(self) -> tuple[Array, Array]:
        """(N, 3) points of all shown worlds on the page [m], and (N, 3) forces there [N]."""
        page, contacts = self.page, self.page.subject.simulation.contacts
        counts = rows_on_host(contacts.contact_count, page.worlds).astype(np.int64)
        most = int(counts.max(initial=0))
        if not most:
            return np.zeros((0, 3)), np.zeros((0, 3))
        used = np.arange(most) < counts[:, None]
        shape = rows_on_host(contacts.contact_shape1, page.worlds)[:, :most].astype(np.int64)
        arm = rows_on_host(contacts.contact_arm1, page.worlds)[:, :most]
        force = rows_on_host(contacts.contact_force_w, page.worlds)[:, :most]
        places, _ = body_poses(page)
        rows = np.arange(len(page.worlds))[:, None]
        body = self._body[np.where(used, shape, 0)]
        return (places[rows, body] + page.heading(arm.astype(np.float64)))[used], page.heading(force[used])

    def draw(self) -> None:
        """Points, and arrows of the forces that can be seen."""
        points, forces = self.touching()
        spots = points.astype(np.float32)
        self.put(
            "contacts",
            lambda name: self.scene.add_point_cloud(
                name, spots, RED, point_size=0.012 * self.size + 0.004, point_shape="circle", precision="float32"
            ),
            points=spots,
        )
        if not self.forces:
            return
        lengths = forces / self.scale
        seen = np.linalg.norm(lengths, axis=1) > 1e-3 * self.size
        arrows = np.stack([points, points + lengths], axis=1)[seen].astype(np.float32)
        thin = 0.008 * self.size
        self.put(
            "forces",
            lambda name: self.scene.add_arrows(
                name, arrows, GREEN, shaft_radius=thin, head_radius=2.2 * thin, head_length=4.0 * thin
            ),
            points=arrows,
        )


class JointOverlay(Overlay):
    """Axes of the joints' coordinates: lines through the joint, along a slide or about a hinge."""

    def __init__(self, page: Page) -> None:
        super().__init__(page)
        self._body, self._local, self._axis = joint_axes(page.subject.simulation.model)

    def draw(self) -> None:
        """Lines of all shown worlds."""
        places, turns = body_poses(self.page)
        middle = places[:, self._body] + turned(turns[:, self._body], self._local)
        reach = 0.12 * self.size * turned(turns[:, self._body], self._axis)
        lines = np.stack([middle - reach, middle + reach], axis=2).reshape(-1, 2, 3).astype(np.float32)
        self.put_lines("joints", lines, BLUE)


class FrameOverlay(Overlay):
    """Axes of the bodies at their centres of mass: x red, y green, z blue."""

    def draw(self) -> None:
        """Axes of all shown worlds."""
        places, turns = body_poses(self.page)
        spots = places[:, :-1].reshape(-1, 3).astype(np.float32)
        wxyz = turns[:, :-1][..., [3, 0, 1, 2]].reshape(-1, 4).astype(np.float32)
        self.put(
            "frames",
            lambda name: self.scene.add_batched_axes(
                name, wxyz, spots, axes_length=0.15 * self.size, axes_radius=0.006 * self.size
            ),
            batched_positions=spots, batched_wxyzs=wxyz,
        )  # fmt: skip


class CentreOverlay(Overlay):
    """Centres of mass of the bodies, and that of all of them, larger."""

    def __init__(self, page: Page) -> None:
        super().__init__(page)
        self._mass = page.subject.simulation.model.body_mass

    def draw(self) -> None:
        """Points of all shown worlds."""
        places = body_poses(self.page)[0][:, :-1]
        own = len(self._mass) > 1
        mass = rows_on_host(self._mass, self.page.worlds if own else np.zeros(1, np.int64))[..., None]
        whole = (mass * places).sum(axis=1) / np.maximum(mass.sum(axis=1), 1e-12)
        for name, points, wide, color in (
            ("centres", places.reshape(-1, 3), 0.02, (250, 200, 20)), ("centre of all", whole, 0.05, (200, 40, 160)),
        ):  # fmt: skip
            spots = points.astype(np.float32)
            self.put(
                name,
                lambda node, spots=spots, wide=wide, color=color: self.scene.add_point_cloud(  # type: ignore[misc]
                    node, spots, color, point_size=wide * self.size, point_shape="circle", precision="float32"
                ),
                points=spots,
            )


class NameOverlay(Overlay):
    """Names of the bodies of the chosen world, of the first forty."""

    def draw(self) -> None:
        """Labels."""
        names = self.page.subject.simulation.model.body_names[:MOST_NAMES]
        places = body_poses(self.page)[0][self.page.chosen]
        for index, name in enumerate(names):
            handle = self._handles.get(name)
            if handle is None:
                self._handles[name] = self.scene.add_label(
                    f"{MOVING}/over/names/{index}", name, position=tuple(places[index]), anchor="bottom-center",
                    font_screen_scale=0.8,
                )  # fmt: skip
            else:
                handle.position = tuple(places[index])


class TrailOverlay(Overlay):
    """Where the agents were in the last ten seconds."""

    ROOM = ROOT  # it lies on the ground

    def __init__(self, page: Page) -> None:
        super().__init__(page)
        self._past: deque[tuple[float, Array]] = deque()

    def draw(self) -> None:
        """Adds the present places, if a tenth of a second has gone by, and draws the lines."""
        page, subject = self.page, self.page.subject
        assert subject.trail is not None
        chosen = page.worlds[page.chosen : page.chosen + 1]
        time = float(rows_on_host(subject.simulation.state.world_time, chosen)[0])
        if self._past and time < self._past[-1][0]:
            self._past.clear()  # it began again
        if self._past and time < self._past[-1][0] + TRAIL_STEP:
            return
        self._past.append((time, np.asarray(subject.trail(), np.float64)))
        while self._past[0][0] < time - TRAIL:
            self._past.popleft()
        points = np.stack([places[page.worlds] for _, places in self._past], axis=1) + page.shifts[:, None]
        lines = np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 3)
        lines = lines[np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) < JUMP].astype(np.float32)
        self.put_lines("trail", lines, RED)


def joint_axes(model: Model) -> tuple[npt.NDArray[np.int64], Array, Array]:
    """Body (N,), point (N, 3) from its centre [m] and unit axis (N, 3) in its axes of each coordinate that has one."""
    found = []
    unit = np.eye(3)
    for joint in model.builder.joints:
        if joint.parent == WORLD and joint.child == WORLD:
            continue  # a sum of coordinates
        for row in ELEMENTS[joint.type].dofs:
            if row.kind is RowKind.ANGLE1:
                body, frame, axis = joint.child, joint.frame1, unit[row.axis1]
            elif row.kind in (RowKind.ANGLE0, RowKind.POINT_AXIS0):
                body, frame, axis = joint.parent, joint.frame0, unit[row.axis0]
            else:
                continue
            found.append((body, frame.position, turned(np.asarray(frame.rotation, np.float64), axis)))
    bodies = np.array([body for body, _, _ in found], np.int64)
    points = np.array([point for _, point, _ in found], np.float64).reshape(-1, 3)
    return bodies, points, np.array([axis for _, _, axis in found], np.float64).reshape(-1, 3)
