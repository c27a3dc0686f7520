"""The page of a subject, before it runs."""

from __future__ import annotations

from typing import Any

from simwarp.cli import UsageError
from simwarp.cli.view.view_options import ViewOptions
from simwarp.viewer.live.driving.human_driver import Keys
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.page_panels import add_panels
from simwarp.viewer.live.web_server import WebServer
from simwarp.viewer.live.world_layout import Layout


def say(options: ViewOptions, text: str) -> None:
    """Prints a line where text goes."""
    options.console().print(text, highlight=False, soft_wrap=True)


def open_view(subject: Any, options: ViewOptions, server: WebServer | None) -> LiveView:
    """A page with all panels of a subject, not yet running."""
    shown = min(subject.simulation.model.world_count, 64)
    view = LiveView(subject, worlds=shown, layout=options.layout, host=options.host, port=options.port, server=server)
    if shown > 1 and options.layout is None and view.page.layout is Layout.ONE:
        say(options, f"showing one of {shown} worlds, which are large; --layout grid or overlay shows all")
    view.speed, view.paused = options.speed, options.paused
    add_panels(view)
    training = subject.details.get("training")
    if training is not None:
        training.start(view.post)
        view.closers.append(training.close)
    if options.drive:
        _drive(view, Keys(options.keys))
    return view


def _drive(view: LiveView, keys: Keys) -> None:
    from simwarp.viewer.live.driving.drive_panel import DrivePanel  # imports all of a vehicle

    panel = next((panel for panel in view.panels if isinstance(panel, DrivePanel)), None)
    if panel is None:
        view.stop()
        raise UsageError(f"--drive: '{view.subject.name}' has no vehicle to drive; `simwarp list` shows vehicles")
    panel.switch(True, keys)
