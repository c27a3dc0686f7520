"""``simwarp view``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from simwarp.cli import HELP, UsageError
from simwarp.cli.early.lighter_imports import few_collections
from simwarp.cli.options import parse_options, split_path
from simwarp.cli.view.view_options import ACTORS, TaskViewOptions, ViewOptions, announce, check_view_options
from simwarp.cli.view.view_target import ViewTarget, find_target

if TYPE_CHECKING:
    from simwarp.viewer.live.web_server import WebServer


def run(arguments: list[str]) -> int:
    """Show what the arguments say.

    The page opens before anything heavy is imported: the browser loads it while the worlds are built.
    """
    if HELP & set(arguments) and arguments[0].startswith("-"):
        parse_options(ViewOptions, arguments, "simwarp view TARGET")
    name, arguments = split_path(arguments, "view", "TARGET")
    target = find_target(str(name))
    server = _early_page(target, arguments)
    try:
        with few_collections():
            from simwarp.cli.view.view_session import show

            if target.kind == "task":
                import simwarp.cli.view.task_view  # noqa: F401  what a task needs beside it

        return show(target, arguments, server)
    finally:
        if server is not None:
            server.stop()


def _early_page(target: ViewTarget, arguments: list[str]) -> WebServer | None:
    """A page that waits for its worlds; None where the arguments may still turn out to be wrong."""
    if HELP & set(arguments) or "--record" in {word.partition("=")[0] for word in arguments}:
        return None
    kind = TaskViewOptions if target.kind == "task" else ViewOptions
    try:
        options = parse_options(kind, arguments, f"simwarp view {target.name}")
        check_view_options(options)
    except UsageError:
        return None  # options of the task's own configuration may be among them
    if not options.open:
        return None  # who waits for the address finds the scene there
    read = (
        [options.checkpoint, options.reload]
        if isinstance(options, TaskViewOptions)
        else [target.name if target.file else None]
    )
    if any(file is not None and file not in ACTORS and not Path(file).exists() for file in read):
        return None
    from simwarp.viewer.live.web_server import open_server

    server = open_server(options.host, options.port, target.title)
    announce(server, options)
    return server
