"""Pause, step, reset, speed, which worlds are seen, and what the camera follows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

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
            self._layout = gui.add_dropdown(
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

        @reset.on_click
        def _(event: Any) -> None:
            which = event.target.value
            view.post(lambda: self.reset(which == "all"))

        @self._speed.on_update
        def _(_: Any) -> None:
            speed = SPEEDS[self._speed.value]
            view.post(lambda: setattr(view, "speed", speed))

        @self._world.on_update
        def _(event: Any) -> None:
            if event.client is not None:
                world = int(self._world.value)
                view.post(lambda: self.choose(world))

        @pick.on_click
        def _(event: Any) -> None:
            which = event.target.value
            view.post(lambda: self.pick(which))

        @self._layout.on_update
        def _(_: Any) -> None:
            layout = Layout(self._layout.value)
            view.post(lambda: self.arrange(layout))

        @self._follow.on_update
        def _(event: Any) -> None:
            if event.client is not None:
                on = bool(self._follow.value)
                view.post(lambda: view.page.follow(on))

        @dark.on_update
        def _(_: Any) -> None:
            on = bool(dark.value)
            view.post(lambda: view.page.look(dark=on))

        gui.add_command("Pause or go on", hotkey="space").on_trigger(lambda _: view.post(self.toggle))
        gui.add_command("One step", hotkey="N").on_trigger(lambda _: view.post(self.step))
        gui.add_command("Reset the world", hotkey="R").on_trigger(lambda _: view.post(self.reset))

    def toggle(self) -> None:
        """Pauses, or goes on."""
        self._view.paused = not self._view.paused
        self._show_paused()

    def _show_paused(self) -> None:
        label = "Go on" if self._view.paused else "Pause"
        if self._pause.label != label:
            self._pause.label = label

    def step(self) -> None:
        """One step while paused."""
        if self._view.paused:
            self._view.advance()

    def reset(self, every: bool = False) -> None:
        """Begins again, in the chosen world or in all."""
        view = self._view
        mask = None
        if not every:
            mask = np.zeros(view.subject.simulation.model.world_count, bool)
            mask[view.page.worlds[view.page.chosen]] = True
        view.reset(mask)

    def arrange(self, layout: Layout) -> None:
        """Another layout."""
        page = self._view.page
        following = page.following
        if layout is Layout.ONE:
            page.show_worlds([int(page.worlds[page.chosen])])
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
        count, now = view.subject.simulation.model.world_count, int(view.page.worlds[view.page.chosen])
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
        world = int(view.page.worlds[view.page.chosen])
        time = float(view.subject.simulation.state.world_time.numpy()[world])
        wanted = view.speed
        slow = wanted > 0.0 and not view.paused and view.factor < 0.95 * wanted
        factor = f"{view.factor:.2f}× real time" if not view.paused else "paused"
        if slow:
            factor = f'<span style="color:#d33">{factor}</span>'
        line = f"**{time:.2f} s** &nbsp; {factor}"
        if view.subject.returns is not None:
            line += f" &nbsp; return {float(view.subject.returns()[world]):.1f}"
        if self._clock.content != line:
            self._clock.content = line
        if self._follow.value != view.page.following:  # a driver's camera follows, too
            follow: Any = self._follow
            follow.value = view.page.following
