"""``simwarp play``."""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simwarp.cli import DONE, UsageError
from simwarp.cli.evaluation.evaluating import policy_defaults
from simwarp.cli.options import CommonOptions, expand_shorthands, parse_options, take_task_or_run, task_options
from simwarp.core.warp_start import told_compiling
from simwarp.tasks import make, resolve_device, task_class, task_names

if TYPE_CHECKING:
    from simwarp.cli.view.films import HtmlFilm


@dataclasses.dataclass(frozen=True)
class PlayOptions(CommonOptions):
    """Show a policy at work: a picture, or a video where --video names one."""

    video: Path | None = None
    """File to write: .gif, .mp4 (needs imageio-ffmpeg) or .png; by default TASK.png in the working folder."""
    html: Path | None = None
    """File to write in place of a picture or video: .html, a recording that opens in a browser, or .viser."""
    checkpoint: Path | None = None
    """Checkpoint file or run folder, or `shipped`; by default the newest run of the task, else the shipped policy."""
    num_envs: int = 4
    """Worlds shown, at most 64."""
    seconds: float = 5.0
    """Time shown [s]."""
    seed: int = 1_000_003
    """Seed of the worlds."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""
    capture: bool = True
    """Capture each control step into a CUDA graph; of no effect on a CPU."""
    runs: Path = Path("runs")
    """Folder of the run folders."""


def run(arguments: list[str]) -> int:
    """Play as the arguments say."""
    word, arguments = take_task_or_run(arguments, "play", task_names())
    cls = task_class(word)
    name = cls.name
    arguments = expand_shorthands(arguments, name, cls.config_type())
    import torch

    from simwarp.train.config import task_config_from_plain
    from simwarp.train.evaluation.filming import Film
    from simwarp.train.evaluation.play import VIDEO_SUFFIXES, record, write_picture, write_video
    from simwarp.train.networks.policies import find_policy, network_policy
    from simwarp.train.runs.progress import LiveLine

    torch.set_num_threads(1)
    source, config = policy_defaults(name, arguments, find_policy, task_config_from_plain)
    options: Any = parse_options(
        task_options("PlayCommand", PlayOptions, task=config or cls.config_type()), arguments, f"simwarp play {word}"
    )
    target = _target(name, options, source.path)
    if not 1 <= options.num_envs <= 64:
        raise UsageError(f"num-envs must be from 1 to 64, got {options.num_envs}")
    console = options.console()
    console.print(f"building worlds of '{name}' ...", highlight=False)
    with told_compiling(partial(console.print, highlight=False)):
        task = make(
            name, options.num_envs, device=resolve_device(options.device), seed=options.seed, config=options.task,
            capture=options.capture,
        )  # fmt: skip
    video = target.suffix.lower() in VIDEO_SUFFIXES
    policy = network_policy(source.content, task)
    film = _html_film(task, target) if options.html is not None else Film(task, video)
    with told_compiling(partial(console.print, highlight=False)), LiveLine(console, 1.0, head="playing") as line:

        def show(step: int, steps: int) -> None:
            line.show("playing", f"{step}/{steps} steps", step / steps)

        frames, total = record(task, policy, options.seconds, options.seed, film, show)
    console.print(f"writing {target} ...", highlight=False, soft_wrap=True)
    if isinstance(film, Film):
        (write_video if video else write_picture)(target, frames, name)
    else:
        film.write()
        film.close()
    console.print(f"policy: {source.origin}", highlight=False, soft_wrap=True)
    console.print(f"mean return over {frames[-1].time:.1f} s: {total:.1f}", highlight=False)
    console.print(f"wrote {target}", highlight=False, soft_wrap=True)
    options.emit({"task": name, "video": str(target), "return": total, "checkpoint": str(source.path)})
    return DONE


def _target(name: str, options: Any, checkpoint: Path) -> Path:
    """File to write, refused before any work is done where that cannot be."""
    from simwarp.train.evaluation.play import check_video_path

    if options.html is None:
        target: Path = options.video or Path(f"{name}.png")
        check_video_path(target)
        options.check(checkpoint, video=target)
        return target
    if options.video is not None:
        raise UsageError("--html takes the place of --video: give one of them")
    from simwarp.viewer.live.recording import check_recording_path

    check_recording_path(options.html, "--html")
    options.check(checkpoint, html=options.html)
    return Path(options.html)


def _html_film(task: Any, path: Path) -> HtmlFilm:
    from simwarp.cli.view.films import HtmlFilm

    return HtmlFilm(task, path)
