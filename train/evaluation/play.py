"""A rendered picture or a short video of worlds in which a policy acts."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import torch

from simwarp.core.files import check_output, write_file
from simwarp.tasks import InputError, Task
from simwarp.tasks.framework.agent_rows import Rows
from simwarp.viewer.sheets import write_image

from ..networks.policies import Policy, bad_actions, refuse_bad_actions, reset_memory
from .filming import film_still, film_strip
from .gif import gif_of
from .mp4 import check_encoder, write_mp4

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")
VIDEO_SUFFIXES = (".gif", ".mp4")
_FRAMES_PER_SECOND = 25
_LONGEST = 3600.0
"""Time that is shown at most [s]: all images are kept until they are written."""


@dataclasses.dataclass(frozen=True)
class Frame:
    """Picture data of one moment.

    Attributes:
        time: since the start [s].
        images: (W, height, width, 3) uint8, rendered; None where none was taken.
    """

    time: float
    images: npt.NDArray[np.uint8] | None = None


class FrameRecorder(Protocol):
    """Frames of a task while it is played."""

    def render(self, index: int, count: int, time: float) -> npt.NDArray[np.uint8] | None:
        """Render frame ``index`` of ``count`` of the present state; return images of it, or None."""


def check_video_path(path: Path) -> None:
    """Refuse what cannot be written, before any work is done.

    Raises:
        InputError: unknown kind of file, or an encoder that is not installed.
        FileError: it cannot be written to.
    """
    suffix = path.suffix.lower()
    if suffix not in PICTURE_SUFFIXES + VIDEO_SUFFIXES:
        raise InputError(f"cannot write '{path}': the name must end in .mp4, .gif, .png or .jpg")
    check_output(path, "--video")
    if suffix == ".mp4":
        check_encoder()


def record(
    task: Task[Any], policy: Policy, seconds: float, seed: int, film: FrameRecorder,
    watch: Callable[[int, int], None] | None = None, frames: list[Frame] | None = None,
) -> tuple[list[Frame], float]:  # fmt: skip
    """Let a policy act and keep frames.

    Args:
        task: task to play.
        policy: policy that acts.
        seconds: time shown [s].
        seed: of the worlds.
        film: of the task; takes images of the frames it wants.
        watch: hears how many control steps are done, and of how many.
        frames: list that they are kept in, so that an interruption loses none; None: one of its own.

    Returns:
        Frames some 25 per second apart, and the mean return of the first episodes so far.

    Raises:
        TrainingError: the policy returned NaN or infinity.
    """
    if not 0.0 < seconds <= _LONGEST:
        raise InputError(f"seconds must be positive and at most {_LONGEST:g}, got {seconds:g}")
    task.keep_final_observations = False
    rows = Rows(task)
    observations = rows.restart(seed)
    reset_memory(policy)
    every = max(1, round(1.0 / (_FRAMES_PER_SECOND * task.config.control_dt)))
    steps = max(1, round(seconds / task.config.control_dt))
    count = steps // every + 1
    frames = [] if frames is None else frames
    frames.append(Frame(0.0, film.render(0, count, 0.0)))
    total = torch.zeros(rows.count, dtype=torch.float64, device=task.device)
    running = torch.ones(rows.count, dtype=torch.bool, device=task.device)
    bad = torch.zeros((), dtype=torch.int64, device=task.device)
    for step in range(1, steps + 1):
        actions = policy(observations)
        bad += bad_actions(actions)
        result = rows.step(actions)
        observations = result.observations
        total += torch.where(running, result.rewards, 0.0)
        ended = result.terminated | result.truncated
        running &= ~ended
        reset_memory(policy, ended)
        if step % every == 0:
            time = step * task.config.control_dt
            frames.append(Frame(time, film.render(step // every, count, time)))
        if watch is not None:
            watch(step, steps)
    refuse_bad_actions(bad, steps * rows.count)
    return frames, float(total.mean())


def write_picture(path: Path, frames: list[Frame], title: str, worlds: Sequence[int] = ()) -> None:
    """Write a PNG or JPEG: rendered moments of every world shown.

    Raises:
        OutputError: the disk did not take it.
    """
    taken = [(frame.time, frame.images) for frame in frames if frame.images is not None]
    write_image(path, film_strip(taken, title, worlds))


def write_video(
    path: Path, frames: list[Frame], title: str, worlds: Sequence[int] = (),
    watch: Callable[[int, int], None] | None = None,
) -> None:  # fmt: skip
    """Write a GIF or an MP4 of frames that all have images.

    Args:
        path: of the file.
        frames: of the film.
        title: above the images.
        worlds: names of those that are shown; empty: the first ones.
        watch: hears how many frames of an MP4 are written, and of how many.

    Raises:
        OutputError: the disk did not take it.
    """
    rate = (len(frames) - 1) / frames[-1].time if len(frames) > 1 else _FRAMES_PER_SECOND
    shown = [(frame.time, frame.images) for frame in frames if frame.images is not None]

    def stills() -> Iterator[npt.NDArray[np.uint8]]:
        for index, (time, images) in enumerate(shown):
            if watch is not None:
                watch(index, len(shown))
            yield film_still(images, time, title, worlds)

    if path.suffix.lower() == ".mp4":
        height, width, _ = film_still(shown[0][1], 0.0, title, worlds).shape
        write_mp4(path, stills(), (width, height), rate)
    else:
        write_file(path, gif_of(list(stills()), rate))
