"""Shift and the left button on a body: the hand takes hold of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from simwarp.core.types import WORLD
from simwarp.viewer.live.batches import Batch, body_positions, body_rotations, turned
from simwarp.viewer.live.hand import Hand
from simwarp.viewer.live.page import ROOT

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView

COLOR: Final = (255, 120, 20)


class Dragging:
    """Leads the drags of all pages to the one hand of a simulation: the first to take hold keeps it.

    Args:
        view: whose bodies may be dragged.
        hand: of its simulation.
    """

    def __init__(self, view: LiveView, hand: Hand) -> None:
        self._view, self._hand = view, hand
        self._owner: int | None = None
        self._line: Any = None
        self._row = 0
        view.page.on_instances.append(self._listen)

    def refresh(self, now: float) -> None:
        """Lets go where nobody is left to do it."""
        if self._owner is not None and self._owner not in self._view.server.viser.get_clients():
            self.release(self._owner)

    def start(self, client: int, world: int, body: int, grab: Any, pointer: Any) -> None:
        """Takes hold of a body at a place of the page.

        Args:
            client: who does.
            world, body: indices.
            grab, pointer: places on the page [m].
        """
        page = self._view.page
        rows = np.flatnonzero(page.worlds == world)
        if self._owner is not None or body == WORLD or not len(rows):
            return
        self._row, self._owner = int(rows[0]), client
        place, turn = self._pose(world, body)
        back = turn * np.array([-1.0, -1.0, -1.0, 1.0])
        self._hand.grab(world, body, turned(back, page.in_world(grab, self._row) - place), place)
        self._hand.move(page.in_world(pointer, self._row))
        page.overlays.append(self._draw)

    def move(self, client: int, pointer: Any) -> None:
        """Pulls elsewhere."""
        if client == self._owner:
            self._hand.move(self._view.page.in_world(pointer, self._row))

    def release(self, client: int) -> None:
        """Lets go."""
        if client != self._owner:
            return
        self._owner = None
        self._hand.release()
        overlays = self._view.page.overlays
        if self._draw in overlays:
            overlays.remove(self._draw)
        if self._line is not None:
            self._line.remove()
            self._line = None

    def _listen(self, batch: Batch, handle: Any) -> None:
        view, worlds = self._view, self._view.page.worlds
        bodies = view.page.seen.body

        # a coroutine: the messages of a drag stay in their order, which those of a pool of threads would not
        @handle.on_drag("left", modifier="shift")
        async def _(event: Any) -> None:
            client, index, phase = event.client_id, event.instance_index, event.phase
            grab, pointer = event.start_position, event.end_position
            if phase == "start" and index is not None and 0 <= index < len(batch.rows):
                world, body = int(worlds[batch.rows[index]]), int(bodies[batch.instances[index]])
                view.post(lambda: self.start(client, world, body, grab, pointer))
            elif phase == "update":
                view.post(lambda: self.move(client, pointer))
            elif phase == "end":
                view.post(lambda: self.release(client))

    def _pose(self, world: int, body: int) -> tuple[Any, Any]:
        state, worlds = self._view.subject.simulation.state, np.array([world])
        return body_positions(state, worlds)[0, body], body_rotations(state, worlds)[0, body]

    def _draw(self) -> None:
        """The line from the held point to the pointer."""
        hold = self._hand.hold
        if hold is None:
            return
        page = self._view.page
        pose = page.bodies.positions[self._row, hold.body], page.bodies.rotations[self._row, hold.body]
        ends = np.stack([self._hand.grabbed(*pose), self._hand.pointer])
        points = (ends + page.shifts[self._row])[None].astype(np.float32)
        if self._line is None:
            scene: Any = self._view.server.viser.scene
            self._line = scene.add_line_segments(
                f"{ROOT}/pull", points=points, colors=COLOR, thickness=4.0, thickness_units="screen"
            )
        else:
            self._line.points = points
