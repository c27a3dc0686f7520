"""``simwarp play``."""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias

from rich.console import Console

from simwarp.cli import DONE, UsageError
from simwarp.cli.evaluation.grids import level_of
from simwarp.cli.options import CommonOptions
from simwarp.cli.policy_command import policy_command
from simwarp.core.warp_start import report_compiling
from simwarp.tasks import InputError, Task, make, resolve_device
from simwarp.train.evaluation.filming import Film, FilmOptions, View
from simwarp.train.evaluation.mp4 import check_encoder
from simwarp.train.evaluation.play import (
    VIDEO_SUFFIXES,
    Frame,
    check_video_path,
    record,
    write_picture,
    write_video,
)
from simwarp.train.runs.progress_display import LiveLine

if TYPE_CHECKING:
    from simwarp.cli.evaluation.task_record import TaskRecord
    from simwarp.cli.view.films import HtmlFilm
    from simwarp.cli.view.scene_film import TaskSceneFilm

    AnyFilm: TypeAlias = Film | HtmlFilm | TaskSceneFilm | TaskRecord


@dataclasses.dataclass(frozen=True)
class PlayOptions(CommonOptions):
    """Show a policy at work: a video, or a picture of some moments where --video names one."""

    video: Path | None = None
    """File to write: .mp4, .gif, .png or .jpg; by default TASK.mp4 in the working folder."""
    html: Path | None = None
    """File to write in place of a picture or video: .html, a recording that opens in a browser, or .viser."""
    export_scene: Path | None = None
    """File to write in place of a picture or video, for other programs: .glb, the scene of one world with its motion
    (glTF 2.0), or .pov, the same for POV-Ray."""
    record: Path | None = None
    """File to write in place of a picture or video, for tools of ROS 2: .mcap, one world, its sensors and actions."""
    checkpoint: Path | None = None
    """Checkpoint file or run folder, or `shipped`, the name of a shipped one, `zero`, `random`; by default the newest
    run, else the shipped."""
    num_envs: int = 1
    """Worlds that are played, at most 64."""
    worlds: tuple[int, ...] = ()
    """Those that are shown, by their numbers from 0; by default all that are played."""
    seconds: float = 5.0
    """Time shown [s]."""
    size: tuple[int, int] | None = None
    """Width and height of one world's image [pixels], even; by default 720 by 480 for one world, less for more."""
    camera: Literal["task", "behind", "side", "front", "above"] = "task"
    """Where the camera is: as the task has it, or beside the body; from behind it turns with the body."""
    zoom: float = 1.0
    """How many times larger things are than by default, 0.1 to 20."""
    follow: bool = True
    """The camera goes along with the body; off: it stays where it is at the start."""
    trail: bool = True
    """Draw a line along which the body went."""
    marks: bool = True
    """Draw crosses on the ground at whole metres, larger ones every five."""
    seed: int = 1_000_003
    """Seed of the worlds."""
    level: float = 1.0
    """Level of the curriculum in [0, 1], held throughout: 1 is the whole difficulty."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""
    capture: bool = True
    """Capture each control step into a CUDA graph; of no effect on a CPU."""
    runs: Path = Path("runs")
    """Folder of the run folders."""


MOST_PIXELS: Final = 4096
"""Along a side of one world's image."""
MOST_BYTES: Final = 8_000_000_000
"""Of all images of a film, which are kept until they are written."""


def run(arguments: list[str]) -> int:
    """Play as the arguments say."""
    command = policy_command("play", arguments, PlayOptions)
    name, options, source = command.name, command.options(), command.source
    assert source is not None  # options() has ended the process where help was asked for
    console = options.console()
    options = _with_models(options, console)
    _check(options)
    level = level_of("--level", options.level)
    target = _target(name, options, source.path, console)
    console.print(f"building worlds of '{name}' ...", highlight=False)
    with report_compiling(partial(console.print, highlight=False)):
        task = make(
            name, options.num_envs, device=resolve_device(options.device), seed=options.seed, config=options.task,
            capture=options.capture,
        )  # fmt: skip
    task.set_level(level)
    policy = source.policy(task)
    film = _film(task, target, options)
    if options.record is not None:
        recording: Any = film
        policy = recording.beside(task, policy)
    frames: list[Frame] = []
    try:
        total = _record(task, policy, options, film, frames, console)
    except KeyboardInterrupt:
        if frames and (not isinstance(film, Film) or any(frame.images is not None for frame in frames)):
            _write(film, target, frames, name, console)
            console.print(f"interrupted; wrote the {frames[-1].time:.1f} s so far to {target}", soft_wrap=True)
        raise
    _write(film, target, frames, name, console)
    console.print(f"policy: {source.origin}", highlight=False, soft_wrap=True)
    console.print(f"mean return over {frames[-1].time:.1f} s: {total:.1f}", highlight=False)
    console.print(f"wrote {target}", highlight=False, soft_wrap=True)
    written = "video" if options.export_scene is None and options.record is None else "file"
    options.emit({"task": name, written: str(target), "return": total, "checkpoint": str(source.path)})
    return DONE


def _record(task: Task[Any], policy: Any, options: Any, film: AnyFilm, frames: list[Frame], console: Console) -> float:
    """Play, and return the mean return; the frames are kept as they come."""
    with report_compiling(partial(console.print, highlight=False)), LiveLine(console, 1.0, head="playing") as line:

        def show(step: int, steps: int) -> None:
            line.show("playing", f"{step}/{steps} steps", step / steps)

        return record(task, policy, options.seconds, options.seed, film, show, frames)[1]


def _write(film: AnyFilm, target: Path, frames: list[Frame], name: str, console: Console) -> None:
    """Write what was filmed."""
    console.print(f"writing {target} ...", highlight=False, soft_wrap=True)
    if not isinstance(film, Film):
        film.write()
        film.close()
    elif target.suffix.lower() in VIDEO_SUFFIXES:
        with LiveLine(console, 1.0, head="writing") as line:

            def show(frame: int, count: int) -> None:
                line.show("writing", f"{frame}/{count} images", frame / count)

            write_video(target, frames, name, film.worlds, show)
    else:
        write_picture(target, frames, name, film.worlds)


def _with_models(options: Any, console: Console) -> Any:
    """The options with a world of each model of a mixed batch; with the first model where a file has one simulation."""
    if options.html is None and options.export_scene is None and options.record is None:
        return dataclasses.replace(options, num_envs=max(options.num_envs, len(options.task.by_model())))
    from simwarp.cli.view.shown_model import shown_config

    say = partial(console.print, highlight=False, soft_wrap=True)
    return dataclasses.replace(options, task=shown_config(options.task, say))


def _check(options: Any) -> None:
    """Refuse options that do not go together, before any work is done."""
    count = options.num_envs
    if not 1 <= count <= 64:
        raise UsageError(f"num-envs must be from 1 to 64, got {count}")
    wrong = [world for world in options.worlds if not 0 <= world < count]
    if wrong:
        raise UsageError(f"worlds must be from 0 to {count - 1}, got {wrong[0]}; --num-envs plays more of them")
    if len(set(options.worlds)) < len(options.worlds):
        raise UsageError(f"worlds must be different ones, got {' '.join(map(str, options.worlds))}")
    alone = [name for name in ("export_scene", "record") if getattr(options, name) is not None]
    if alone and len(options.worlds) > 1:
        shown = " ".join(map(str, options.worlds))
        raise UsageError(f"--{alone[0].replace('_', '-')} shows one world, got --worlds {shown}; name one of them")
    if not 0.1 <= options.zoom <= 20.0:
        raise UsageError(f"zoom must be from 0.1 to 20, got {options.zoom:g}")
    if options.size is None:
        return
    for side in options.size:
        if side % 2 or not 16 <= side <= MOST_PIXELS:
            raise UsageError(f"size must be two even numbers from 16 to {MOST_PIXELS} pixels, got {side}")
    frames = 25.0 * options.seconds + 1.0
    needed = 3.0 * options.size[0] * options.size[1] * (len(options.worlds) or count) * frames
    if needed > MOST_BYTES:
        raise UsageError(
            f"seconds, size and worlds must together make at most {MOST_BYTES / 1e9:g} GB of images, got "
            f"{needed / 1e9:.0f} GB; show less of them"
        )


def _film_options(options: Any) -> FilmOptions:
    return FilmOptions(
        worlds=tuple(options.worlds), size=options.size, view=View(options.camera), zoom=options.zoom,
        follow=options.follow, trail=options.trail, marks=options.marks,
    )  # fmt: skip


def _target(name: str, options: Any, checkpoint: Path, console: Console) -> Path:
    """File to write, refused before any work is done where that cannot be."""
    targets = {
        "--video": options.video, "--html": options.html, "--export-scene": options.export_scene,
        "--record": options.record,
    }  # fmt: skip
    given = [option for option, path in targets.items() if path is not None]
    if len(given) > 1:
        raise UsageError(f"{given[1]} takes the place of {given[0]}: give one of them")
    if options.record is not None:
        from simwarp.mcap.mcap_extra import check_mcap_path

        options.check(checkpoint, record=check_mcap_path(options.record))
        return Path(options.record)
    if options.export_scene is not None:
        from simwarp.exporters.scene_files import check_scene_path

        check_scene_path(options.export_scene)
        options.check(checkpoint, **{"export-scene": options.export_scene})
        return Path(options.export_scene)
    if options.html is None:
        target: Path = options.video or _default_video(name, console)
        check_video_path(target)
        options.check(checkpoint, video=target)
        return target
    from simwarp.viewer.live.recording import check_recording_path

    check_recording_path(options.html, "--html")
    options.check(checkpoint, html=options.html)
    return Path(options.html)


def _default_video(name: str, console: Console) -> Path:
    """An MP4, or a GIF where there is no encoder."""
    try:
        check_encoder()
    except InputError:
        words = f"no encoder for mp4 (pip install imageio-ffmpeg): writing {name}.gif, smaller and coarser"
        console.print(words, highlight=False, soft_wrap=True)
        return Path(f"{name}.gif")
    return Path(f"{name}.mp4")


def _film(task: Any, target: Path, options: Any) -> AnyFilm:
    """What takes the frames, as the options ask for it."""
    if options.record is not None:
        from simwarp.cli.evaluation.task_record import TaskRecord

        return TaskRecord(target, (options.worlds or (0,))[0])
    if options.html is not None:
        from simwarp.cli.view.films import HtmlFilm

        return HtmlFilm(task, target)
    if options.export_scene is not None:
        from simwarp.cli.view.scene_film import TaskSceneFilm

        return TaskSceneFilm(task, target, _film_options(options))
    return Film(task, target.suffix.lower() in VIDEO_SUFFIXES, _film_options(options))
