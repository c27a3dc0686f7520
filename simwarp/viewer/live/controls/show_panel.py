"""What is drawn beside the bodies' pictures: collision shapes, contacts, joints, frames, names, trails, lines."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from simwarp.sensors.scene import Scene, Visuals
from simwarp.viewer.live.controls.overlays import (
    CentreOverlay,
    ContactOverlay,
    FrameOverlay,
    JointOverlay,
    NameOverlay,
    Overlay,
    TrailOverlay,
)
from simwarp.viewer.live.page_controls import post_value

if TYPE_CHECKING:
    from simwarp.model.builder import ModelBuilder
    from simwarp.viewer.live.live_view import LiveView

SHAPE_COLORS = ((0.75, 0.32, 0.12), (0.13, 0.42, 0.72), (0.18, 0.52, 0.27), (0.55, 0.22, 0.55), (0.7, 0.55, 0.1))
"""Linear albedos of collision shapes, of one body after the other."""


class ShowPanel:
    """Switches of the overlays. What is off costs nothing."""

    def __init__(self, view: LiveView) -> None:
        self._view = view
        self._on: dict[str, Overlay] = {}
        self._shapes: Scene | None = None
        subject, page = view.subject, view.page
        model = subject.simulation.model
        gui = view.server.viser.gui
        weight = float(np.asarray(model.body_mass.numpy()[0]).sum()) * 9.81
        with gui.add_folder("Show", expand_by_default=False):
            if model.shape_count:
                self._switch("Collision shapes", self.show_shapes)
                self._switch("Contact points", lambda on: self.show("contacts", on))
                self._switch("Contact forces", lambda on: self.show("forces", on))
                self._scale = gui.add_number(
                    "Newtons per metre", float(f"{max(weight, 1.0):.2g}"), min=1e-3, hint="of the arrows of forces"
                )
                post_value(view, self._scale.on_update, self._rescale)
            if model.joint_count:
                self._switch("Joint axes", lambda on: self.show("joints", on))
            self._switch("Body frames", lambda on: self.show("frames", on))
            self._switch("Centres of mass", lambda on: self.show("centres", on))
            self._switch("Names", lambda on: self.show("names", on))
            if subject.trail is not None:
                self._switch("Trail", lambda on: self.show("trail", on))
            if subject.paths is not None:
                self._switch("Lines", lambda on: setattr(page, "paths_shown", on), initial=True)

    def refresh(self, now: float) -> None:
        """Nothing: overlays are drawn with the frames."""

    def show(self, name: str, on: bool) -> None:
        """Switches an overlay."""
        page = self._view.page
        old = self._on.pop(name, None)
        if old is not None:
            if old.draw in page.overlays:
                page.overlays.remove(old.draw)
            old.remove()
        if not on:
            return
        makers: dict[str, Callable[[], Overlay]] = {
            "contacts": lambda: ContactOverlay(page, 1.0, forces=False),
            "forces": lambda: ContactOverlay(page, float(self._scale.value), forces=True),
            "joints": lambda: JointOverlay(page), "frames": lambda: FrameOverlay(page),
            "centres": lambda: CentreOverlay(page), "names": lambda: NameOverlay(page),
            "trail": lambda: TrailOverlay(page),
        }  # fmt: skip
        overlay = self._on[name] = makers[name]()
        page.overlays.append(overlay.draw)

    def show_shapes(self, on: bool) -> None:
        """Collision shapes in place of the pictures, or these again."""
        view = self._view
        if on and self._shapes is None:
            self._shapes = shapes_scene(view.subject.simulation.model)
        view.page.show_scene(self._shapes if on and self._shapes is not None else view.subject.scene)

    def _switch(self, label: str, act: Callable[[bool], Any], *, initial: bool = False) -> None:
        box = self._view.server.viser.gui.add_checkbox(label, initial_value=initial)
        post_value(self._view, box.on_update, act)

    def _rescale(self, scale: float) -> None:
        overlay = self._on.get("forces")
        if isinstance(overlay, ContactOverlay):
            overlay.scale = max(float(scale), 1e-3)


def shapes_scene(model: Any) -> Scene:
    """The shapes of a model alone, those of a body in one colour."""
    visuals = Visuals(cast("ModelBuilder", model.builder), spheres=True)
    for instance in list(visuals.instances):
        if instance.body >= 0:
            visuals.show(instance.shape, color=SHAPE_COLORS[instance.body % len(SHAPE_COLORS)])
    return visuals.finalize(model)
