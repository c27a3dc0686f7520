"""Pause, step, reset, speed, which worlds are seen, and what the camera follows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from simwarp.viewer.live.page_controls import post_value, set_changed
from simwarp.viewer.live.world_layout import Layout

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView

SPEEDS: Final = {"1/16": 1 / 16, "1/8": 1 / 8, "1/4": 1 / 4, "1/2": 1 / 2, "1": 1.0, "2": 2.0, "4": 4.0, "max": 0.0}


class RunPanel:
    """The first panel of every page."""

    def __init__(self, view: LiveView) -> None:
        self._view = view
        gui = view.server.viser.gui
        with gui.add_folder("Run"):
            self._clock = gui.add_markdown("")
            self._pause = gui.add_button("Pause", hint="Space")
            step = gui.add_button("Step", hint="N, while paused")
            reset = gui.add_button_group("Reset", ("world", "all"))
            self._speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1", hint="times real time")
            self._world = gui.add_number("World", 0, min=0, max=view.subject.simulation.model.world_count - 1, step=1)
            pick = gui.add_button_group("Choose", ("next", "random", "worst", "failed"))
            layout = gui.add_dropdown(
                "Layout", tuple(kind.value for kind in Layout), initial_value=view.page.layout.value
            )
            self._follow = gui.add_checkbox(
                "Follow", initial_value=view.page.following, hint="the scene moves under the camera"
            )
            dark = gui.add_checkbox("Dark", initial_value=False)

        @self._pause.on_click
        def _(_: Any) -> None:
            view.post(self.toggle)

        @step.on_click
        def _(_: Any) -> None:
            view.post(self.step)

        post_value(view, reset.on_click, lambda which: self.reset(which == "all"))
        post_value(view, self._speed.on_update, lambda speed: setattr(view, "speed", SPEEDS[speed]))
        post_value(view, self._world.on_update, lambda world: self.choose(int(world)), by_person=True)
        post_value(view, pick.on_click, self.pick)
        post_value(view, layout.on_update, lambda layout: self.arrange(Layout(layout)))
        post_value(view, self._follow.on_update, view.page.follow, by_person=True)
        post_value(view, dark.on_update, lambda on: view.page.look(dark=on))
        gui.add_command("Pause or go on", hotkey="space").on_trigger(lambda _: view.post(self.toggle))
        gui.add_command("One step", hotkey="N").on_trigger(lambda _: view.post(self.step))
        gui.add_command("Reset the world", hotkey="R").on_trigger(lambda _: view.post(self.reset))

    def toggle(self) -> None:
        """Pauses, or goes on."""
        self._view.paused = not self._view.paused
        self._show_paused()

    def _show_paused(self) -> None:
        set_changed(self._pause, label="Go on" if self._view.paused else "Pause")

    def step(self) -> None:
        """One step while paused."""
        if self._view.paused:
            self._view.advance()

    def reset(self, every: bool = False) -> None:
        """Begins again, in the chosen world or in all."""
        view = self._view
        view.reset(None if every else view.page.mask)

    def arrange(self, layout: Layout) -> None:
        """Another layout."""
        page = self._view.page
        following = page.following
        if layout is Layout.ONE:
            page.show_worlds([page.world])
        elif len(page.worlds) == 1:
            count = min(self._view.subject.simulation.model.world_count, self._view.shown)
            page.show_worlds(range(count))
        page.arrange(layout)
        page.follow(following)

    def choose(self, world: int) -> None:
        """The world that single panels are about; shown, if it was not."""
        page = self._view.page
        if world in page.worlds:
            page.chosen = int(np.flatnonzero(page.worlds == world)[0])
        else:
            shown = page.worlds.copy()
            shown[page.chosen] = world
            page.show_worlds(shown.tolist())
        page.follow(page.following)
        number: Any = self._world
        number.value = world

    def pick(self, which: str) -> None:
        """The next world, any, that with the lowest return, or one whose episode has just ended."""
        view = self._view
        count, now = view.subject.simulation.model.world_count, view.page.world
        world: int | None = (now + 1) % count
        if which == "random":
            world = int(np.random.default_rng().integers(count))
        elif which == "worst":
            world = int(np.argmin(view.subject.returns())) if view.subject.returns is not None else None
        elif which == "failed":
            world = view.last_failed
        if world is not None:
            self.choose(world)

    def refresh(self, now: float) -> None:
        """The clock."""
        view = self._view
        self._show_paused()  # an error pauses, and so does --paused
        world = view.page.world
        time = float(view.subject.simulation.state.world_time.numpy()[world])
        wanted = view.speed
        slow = wanted > 0.0 and not view.paused and view.factor < 0.95 * wanted
        factor = f"{view.factor:.2f}× real time" if not view.paused else "paused"
        if slow:
            factor = f'<span style="color:#d33">{factor}</span>'
        line = f"**{time:.2f} s** &nbsp; {factor}"
        if view.subject.returns is not None:
            line += f" &nbsp; return {float(view.subject.returns()[world]):.1f}"
        set_changed(self._clock, content=line)
        set_changed(self._follow, value=view.page.following)  # a driver's camera follows, too
