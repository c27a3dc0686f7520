"""``simwarp view``."""

from __future__ import annotations

import dataclasses
import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from simwarp.cli import DONE, HELP, INTERRUPTED, UsageError
from simwarp.cli.options import CommonOptions, expand_shorthands, parse_options, take_path, task_options
from simwarp.tasks import make, resolve_device, task_class, task_names
from simwarp.viewer.live.hand import with_hand
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.recording import Recorder, check_recording_path
from simwarp.viewer.live.wheel.drive_panel import DrivePanel
from simwarp.viewer.live.wheel.human_driver import Keys

LONGEST = 86_400.0
"""Of --seconds."""

if TYPE_CHECKING:
    from simwarp.cli.view.human_in_task import HumanInTask


@dataclasses.dataclass(frozen=True)
class ViewOptions(CommonOptions):
    """Open a page that shows a task, a vehicle, a scene, a model file or the dump of a broken world as it moves."""

    worlds: int | None = None
    """Worlds that are simulated and shown; by default 16 of a task or scene, 1 of a vehicle or model file."""
    layout: Literal["grid", "overlay", "one"] | None = None
    """Worlds side by side, all in the scenery of one, or one alone; by default what suits their size."""
    port: int = 8080
    """Of the page; the next free one is taken."""
    host: str = "127.0.0.1"
    """Address to serve on; others than this machine's own need the token that is printed."""
    speed: float = 1.0
    """Times real time; 0: as fast as it goes."""
    paused: bool = False
    """Begin paused."""
    open: bool = True
    """Open a browser."""
    seconds: float | None = None
    """End after this much time by the clock [s]; with --record of simulated time, at full speed, without a browser."""
    record: Path | None = None
    """Record to this file from the start: .html, which plays in any browser, or .viser."""
    drive: bool = False
    """Drive by hand at once: the page's keys and gamepad, the camera behind the vehicle."""
    keys: Literal["smooth", "chrono"] = "smooth"
    """Of driving: a held key moves its input to the end, or steps its target as Chrono's driver does."""
    base: Literal["fixed", "floating"] | None = None
    """Of a URDF: its root link is welded to the world, or floats."""
    allow: tuple[str, ...] = ()
    """Kinds of refused elements of a model file to drop."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""


@dataclasses.dataclass(frozen=True)
class TaskViewOptions(ViewOptions):
    """Open a page that shows a task under a policy."""

    checkpoint: str | None = None
    """Checkpoint file or run folder, `shipped`, `zero` or `random`; by default the newest run, else the shipped one."""
    reload: Path | None = None
    """Run folder, of a training that may still go on: its newest checkpoint acts, and newer ones as they come."""
    seed: int = 1_000_003
    """Seed of the worlds."""
    runs: Path = Path("runs")
    """Folder of the run folders."""
    record_trajectories: Path | None = None
    """Write what is driven by hand to this .npz file, which `simwarp clone` reads."""


def run(arguments: list[str]) -> int:
    """Show what the arguments say."""
    if HELP & set(arguments) and arguments[0].startswith("-"):
        parse_options(ViewOptions, arguments, "simwarp view TARGET")
    name, arguments = take_path(arguments, "view", "TARGET")
    from simwarp.cli.view.targets import find_target

    target = find_target(str(name), task_names)
    options: Any
    if target.kind == "task":
        options, view = _task_view(target.name, arguments)
    else:
        options = parse_options(ViewOptions, arguments, f"simwarp view {target.name}")
        view = _plain_view(target.kind, target.name, options)
    return _serve(view, options)


def _task_view(name: str, arguments: list[str]) -> tuple[Any, LiveView]:
    import torch

    from simwarp.cli.view.actors import find_actor
    from simwarp.cli.view.human_in_task import HumanInTask
    from simwarp.cli.view.reloading import PolicyReload
    from simwarp.cli.view.task_subject import task_subject
    from simwarp.train.runs.run_folder import RunFolder
    from simwarp.viewer.live.wheel.driving import WHEEL

    torch.set_num_threads(1)
    cls = task_class(name)
    arguments = expand_shorthands(arguments, name, cls.config_type())
    actor = find_actor(name, arguments)
    options: Any = parse_options(
        task_options("ViewCommand", TaskViewOptions, task=actor.config or cls.config_type()), arguments,
        f"simwarp view {name}",
    )  # fmt: skip
    _check(options, record_trajectories=options.record_trajectories)
    _check_record(options.record_trajectories)
    _say(options, f"building worlds of '{name}' ...")
    task = make(
        name, options.worlds or 16, device=resolve_device(options.device), seed=options.seed, config=options.task,
        elements=with_hand,
    )  # fmt: skip
    subject, loop = task_subject(task, actor.policy(task), options.seed)
    human = HumanInTask(loop, options.seed)
    subject.details[WHEEL] = human.wheel()
    if actor.run is not None:
        iteration = None if actor.content is None else actor.content["iteration"]
        subject.details["training"] = PolicyReload(
            RunFolder(actor.run), loop, using=actor.path, iteration=iteration, on=options.reload is not None
        )
    _say(options, f"policy: {actor.origin}")
    if options.record_trajectories is not None and human.wheel() is None:
        raise UsageError(f"--record-trajectories: nobody can drive in task '{name}'; driving tasks have a vehicle")
    view = _view(subject, options)
    if options.record_trajectories is not None:
        _record(view, human, options)
    return options, view


def _record(view: LiveView, human: HumanInTask, options: Any) -> None:
    """Keeps the steps while somebody is at the wheel; the file is written when the page ends."""
    path = options.record_trajectories
    human.recording = lambda: view.wheel.taken
    view.listeners.append(human.after_step)

    def save() -> None:
        steps = human.save(path)
        _say(options, f"wrote {path}: {steps:,} steps driven by hand" if steps else f"nobody drove; no {path} written")

    view.closers.append(save)


def _check_record(path: Path | None) -> None:
    if path is not None and path.suffix != ".npz":
        raise UsageError(f"--record-trajectories must end in .npz, got '{path}'")


def _plain_view(kind: str, name: str, options: ViewOptions) -> LiveView:
    from simwarp.cli.view import targets

    _check(options)
    _say(options, f"building '{name}' ...")
    if kind == "vehicle":
        from simwarp.cli.view.vehicle_subject import vehicle_subject

        return _view(vehicle_subject(name, options.worlds or 1, options.device), options)
    if kind == "scene":
        return _view(targets.scene_subject(name, options.worlds or 16, options.device), options)
    if kind == "dump":
        from simwarp.cli.view.dump_subject import dump_subject

        return _view(dump_subject(name, resolve_device(options.device)), options)
    subject = targets.model_subject(name, options.worlds or 1, options.device, base=options.base, allow=options.allow)
    return _view(subject, options)


def _check(options: ViewOptions, **outputs: Path | None) -> None:
    if options.record is not None:
        check_recording_path(options.record)
    options.check(record=options.record, **outputs)
    if options.seconds is not None and not 0.0 < options.seconds <= LONGEST:
        raise UsageError(f"seconds must be positive and at most {LONGEST:g}, got {options.seconds:g}")
    if options.worlds is not None and not 1 <= options.worlds <= 65536:
        raise UsageError(f"worlds must be from 1 to 65536, got {options.worlds}")
    if not 0.0 <= options.speed <= 1000.0:
        raise UsageError(f"speed must be from 0 (as fast as it goes) to 1000, got {options.speed:g}")


def _say(options: ViewOptions, text: str) -> None:
    options.console().print(text, highlight=False, soft_wrap=True)


def _view(subject: Any, options: ViewOptions) -> LiveView:
    from simwarp.viewer.live.page_panels import add_panels

    shown = min(subject.simulation.model.world_count, 64)
    view = LiveView(subject, worlds=shown, layout=options.layout, host=options.host, port=options.port)
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
    panel = next((panel for panel in view.panels if isinstance(panel, DrivePanel)), None)
    if panel is None:
        view.stop()
        raise UsageError(f"--drive: '{view.subject.name}' has no vehicle to drive; `simwarp list` shows vehicles")
    panel.switch(True, keys)


def _serve(view: LiveView, options: ViewOptions) -> int:
    import time

    if options.record is not None and options.seconds is not None:
        return _record_seconds(view, options, options.seconds)
    if view.server.token in view.url:
        print(f"warning: view: everybody who can reach {options.host} and has this address can look", file=sys.stderr)
    console = options.console()
    console.print(f"view  {view.url}", highlight=False, soft_wrap=True)
    if options.open:
        webbrowser.open(view.url)
    if options.record is not None:
        Recorder(view, options.record)
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
    from simwarp.train.runs.progress import LiveLine
    from simwarp.train.runs.stopping import stop_on_signals

    recorder, console = Recorder(view, str(options.record)), options.console()
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
