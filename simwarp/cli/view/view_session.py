"""What ``simwarp view`` shows: builds it, and runs it until it is ended."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from simwarp.cli import DONE, INTERRUPTED, UsageError
from simwarp.cli.options import parse_options
from simwarp.cli.view.subject_page import open_view, say
from simwarp.cli.view.view_options import ViewOptions, announce, check_view_options
from simwarp.cli.view.view_record import view_recorder
from simwarp.cli.view.view_target import ViewTarget
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.web_server import WebServer


def show(target: ViewTarget, arguments: list[str], server: WebServer | None) -> int:
    """Shows what the arguments say, on a page that is open already or on one of its own; returns the exit code."""
    options: Any
    if target.kind == "task":
        from simwarp.cli.view.task_view import task_view

        options, view = task_view(target.name, arguments, server)
    else:
        options = parse_options(ViewOptions, arguments, f"simwarp view {target.name}")
        view = _plain_view(target, options, server)
    if server is None and (options.record is None or options.seconds is None):
        announce(view.server, options)
    return _serve(view, options)


def _plain_view(target: ViewTarget, options: ViewOptions, server: WebServer | None) -> LiveView:
    check_view_options(options)
    if options.road is not None and target.kind != "vehicle":
        raise UsageError(f"--road: is below vehicles, got the {target.kind} '{target.name}'; leave it out")
    say(options, f"building '{target.name}' ...")
    worlds, device = options.worlds, options.device
    if target.kind == "vehicle":
        from simwarp.cli.view.vehicle_subject import vehicle_subject

        subject = vehicle_subject(target.name, worlds or 1, device, road=options.road)
    elif target.kind == "scene":
        from simwarp.cli.view.model_subjects import scene_subject

        subject = scene_subject(target.name, worlds or 16, device)
    elif target.kind == "dump":
        from simwarp.cli.view.dump_subject import dump_subject
        from simwarp.tasks import resolve_device

        subject = dump_subject(target.name, resolve_device(device))
    else:
        from simwarp.cli.robots.robot_sources import RobotOptions
        from simwarp.cli.view.model_subjects import model_subject

        given = RobotOptions(options.base, options.allow, options.packages, options.density)
        subject = model_subject(target.name, worlds or 1, device, given)
    return open_view(subject, options, server)


def _serve(view: LiveView, options: ViewOptions) -> int:
    if options.record is not None and options.seconds is not None:
        return _record_seconds(view, options, options.seconds)
    console = options.console()
    if options.record is not None:
        view_recorder(view, options.record)
    end = None if options.seconds is None else time.perf_counter() + options.seconds
    try:
        view.run(None if end is None else lambda: time.perf_counter() >= end)
    except KeyboardInterrupt:
        return INTERRUPTED
    finally:
        view.stop()
        if options.record is not None:
            console.print(f"wrote {options.record}", highlight=False, soft_wrap=True)
    options.emit({"url": view.url, "target": view.subject.name, "recording": _text(options.record)})
    return DONE


def _record_seconds(view: LiveView, options: ViewOptions, seconds: float) -> int:
    """Records simulated seconds as fast as they go; what there is when it is interrupted."""
    from simwarp.core.stopping import stop_on_signals
    from simwarp.train.runs.progress_display import LiveLine

    assert options.record is not None
    recorder, console = view_recorder(view, options.record), options.console()
    try:
        with stop_on_signals() as stop, LiveLine(console, 1.0, head="recording") as line:
            while recorder.elapsed < seconds - 1e-6 and not recorder.written and not stop.requested:
                view.subject.advance()
                for listener in view.listeners:
                    listener()
                view.step()
                done = min(recorder.elapsed / seconds, 1.0)
                line.show("recording", f"{recorder.elapsed:.1f}/{seconds:g} s, {recorder.size / 1e6:.1f} MB", done)
    finally:
        view.stop()
    console.print(f"wrote {recorder.path}: {recorder.elapsed:.1f} s", highlight=False, soft_wrap=True)
    options.emit({"target": view.subject.name, "recording": str(recorder.path), "seconds": recorder.elapsed})
    return INTERRUPTED if stop.requested else DONE


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)
