"""A picture or a short video of worlds in which a policy acts: rendered, or line drawings of what has no shape."""

from __future__ import annotations

import dataclasses
import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from simwarp.core.files import check_output, write_file
from simwarp.tasks import Drawing, InputError, Task

from .filming import Film, film_still, film_strip
from .mp4 import check_encoder, write_mp4
from .policies import Policy, bad_actions, forget, refuse_bad_actions

PICTURE_SUFFIXES = (".png",)
VIDEO_SUFFIXES = (".gif", ".mp4")
_FRAMES_PER_SECOND = 25
_GHOSTS = 8
_PALETTE_FRAMES = 8
_LONGEST = 3600.0
"""Time that is shown at most [s]: all images are kept until they are written."""


@dataclasses.dataclass(frozen=True)
class Frame:
    """What one moment looks like.

    Attributes:
        lines: per line of the drawing, (W, P, 2) projected points [m].
        time: since the start [s].
        images: (W, height, width, 3) uint8, rendered; None where none was taken.
    """

    lines: tuple[npt.NDArray[np.float32], ...]
    time: float
    images: npt.NDArray[np.uint8] | None = None


def check_video_path(path: Path) -> None:
    """Refuse what cannot be written, before any work is done.

    Raises:
        InputError: unknown kind of file, or an encoder that is not installed.
        FileError: it cannot be written to.
    """
    suffix = path.suffix.lower()
    if suffix not in PICTURE_SUFFIXES + VIDEO_SUFFIXES:
        raise InputError(f"cannot write '{path}': the name must end in .png, .gif or .mp4")
    check_output(path, "--video")
    if suffix == ".mp4":
        check_encoder()


def _frame(drawing: Drawing, time: float, images: npt.NDArray[np.uint8] | None) -> Frame:
    across, up = drawing.view.value
    return Frame(tuple(line.points[..., [across, up]].cpu().numpy().copy() for line in drawing.lines), time, images)


def record(
    task: Task[Any], policy: Policy, seconds: float, seed: int, film: Film | None = None,
    watch: Callable[[int, int], None] | None = None,
) -> tuple[list[Frame], Drawing, float]:  # fmt: skip
    """Let a policy act and keep frames.

    Args:
        task: what is played.
        policy: what acts.
        seconds: time shown [s].
        seed: of the worlds.
        film: takes rendered images of the frames it wants.
        watch: hears how many control steps are done, and of how many.

    Returns:
        Frames some 25 per second apart, the drawing they follow, and the mean return of the first episodes so far.

    Raises:
        TrainingError: the policy returned NaN or infinity.
    """
    if not 0.0 < seconds <= _LONGEST:
        raise InputError(f"seconds must be positive and at most {_LONGEST:g}, got {seconds:g}")
    task.keep_final_observations = False
    observations = task.restart(seed=seed)
    forget(policy)
    every = max(1, round(1.0 / (_FRAMES_PER_SECOND * task.config.control_dt)))
    steps = max(1, round(seconds / task.config.control_dt))
    drawing = task.drawing()
    count = steps // every + 1

    def image(index: int, time: float) -> npt.NDArray[np.uint8] | None:
        return None if film is None else film.take(index, count, time)

    frames = [_frame(drawing, 0.0, image(0, 0.0))]
    total = torch.zeros(task.num_worlds, dtype=torch.float64, device=task.device)
    running = torch.ones(task.num_worlds, dtype=torch.bool, device=task.device)
    bad = torch.zeros((), dtype=torch.int64, device=task.device)
    for step in range(1, steps + 1):
        actions = policy(observations)
        bad += bad_actions(actions)
        result = task.step(actions)
        observations = result.observations
        total += torch.where(running, result.rewards, 0.0)
        ended = result.terminated | result.truncated
        running &= ~ended
        forget(policy, ended)
        if step % every == 0:
            time = step * task.config.control_dt
            frames.append(_frame(task.drawing(), time, image(step // every, time)))
        if watch is not None:
            watch(step, steps)
    refuse_bad_actions(bad, steps * task.num_worlds)
    return frames, drawing, float(total.mean())


def _window(drawing: Drawing, frames: list[Frame]) -> tuple[tuple[float, float], tuple[float, float]]:
    if drawing.window is not None:
        return drawing.window
    points = np.concatenate([line.reshape(-1, 2) for frame in frames for line in frame.lines])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float(max(high - low)) + 0.05
    return (float(low[0]) - margin, float(high[0]) + margin), (float(low[1]) - margin, float(high[1]) + margin)


class _Canvas:
    """A grid of one panel per world, redrawn for each image."""

    def __init__(self, task: Task[Any], drawing: Drawing, frames: list[Frame], title: str) -> None:
        (left, right), (bottom, top) = _window(drawing, frames)
        columns = math.ceil(math.sqrt(task.num_worlds))
        rows = math.ceil(task.num_worlds / columns)
        panel = drawing.panel
        height = max(1.0, panel * min(2.0, (top - bottom) / (right - left)))
        # Even numbers of pixels: video encoders want them
        size = (round(panel * columns * 50) / 50, round((height * rows + 0.5) * 50) / 50)
        self._figure = Figure(figsize=size, dpi=100, layout="constrained")
        self._canvas = FigureCanvasAgg(self._figure)
        self._styles = [(line.colour, line.width) for line in drawing.lines]
        self._panels = []
        for world in range(task.num_worlds):
            axes = self._figure.add_subplot(rows, columns, world + 1)
            axes.set_xlim(left, right)
            axes.set_ylim(bottom, top)
            axes.set_aspect("equal")
            axes.tick_params(labelsize=6)
            axes.set_title(f"world {world}", fontsize=7, pad=2)
            artists = [axes.plot([], [], color=colour, linewidth=width)[0] for colour, width in self._styles]
            self._panels.append((axes, artists))
        self._title = title
        self._caption = self._figure.suptitle(f"{title}   t = {frames[-1].time:5.2f} s", fontsize=9)
        self._canvas.draw()
        # What moves is drawn over a kept background: drawing frames and ticks again would take most of the time
        self._figure.set_layout_engine("none")
        self._moving: list[Artist] = [self._caption, *(line for _, lines in self._panels for line in lines)]
        for moving in self._moving:
            moving.set_animated(True)
        self._keep_background()

    def _keep_background(self) -> None:
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(self._figure.bbox)

    def draw(self, frame: Frame) -> npt.NDArray[np.uint8]:
        """Return (height, width, 3) uint8 of one moment."""
        self._caption.set_text(f"{self._title}   t = {frame.time:5.2f} s")
        for world, (_, artists) in enumerate(self._panels):
            for artist, points in zip(artists, frame.lines, strict=True):
                artist.set_data(points[world, :, 0], points[world, :, 1])
        self._canvas.restore_region(self._background)
        for moving in self._moving:
            self._figure.draw_artist(moving)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def draw_path(self, frames: list[Frame]) -> npt.NDArray[np.uint8]:
        """Return the last moment with pale earlier ones behind it."""
        chosen = [frames[round(index)] for index in np.linspace(0, len(frames) - 1, min(_GHOSTS, len(frames)))]
        for position, frame in enumerate(chosen[:-1]):
            fade = 0.08 + 0.3 * position / max(1, len(chosen) - 1)
            for world, (axes, _) in enumerate(self._panels):
                for (colour, width), points in zip(self._styles, frame.lines, strict=True):
                    axes.plot(points[world, :, 0], points[world, :, 1], color=colour, linewidth=width, alpha=fade)
        self._keep_background()
        return self.draw(chosen[-1])


def write_picture(path: Path, task: Task[Any], drawing: Drawing, frames: list[Frame], title: str) -> None:
    """Write a PNG: rendered moments of every world, or lines of the last one with earlier ones pale behind it.

    Raises:
        OutputError: the disk did not take it.
    """
    taken = [(frame.time, frame.images) for frame in frames if frame.images is not None]
    image = film_strip(taken, title) if taken else _Canvas(task, drawing, frames, title).draw_path(frames)
    picture = io.BytesIO()
    Image.fromarray(image).save(picture, format="png")
    write_file(path, picture.getvalue())


def write_video(path: Path, task: Task[Any], drawing: Drawing, frames: list[Frame], title: str) -> None:
    """Write a GIF or an MP4.

    Raises:
        OutputError: the disk did not take it.
    """
    canvas = _Canvas(task, drawing, frames, title)
    rate = (len(frames) - 1) / frames[-1].time if len(frames) > 1 else _FRAMES_PER_SECOND

    def image_of(frame: Frame) -> npt.NDArray[np.uint8]:
        return canvas.draw(frame) if frame.images is None else film_still(frame.images, frame.time, title)

    if path.suffix.lower() == ".mp4":
        height, width, _ = image_of(frames[0]).shape
        write_mp4(path, map(image_of, frames), (width, height), rate)
        return
    # One palette for all images keeps a GIF of flat colours small; what comes into sight later has its colours in it
    some = np.unique(np.linspace(0, len(frames) - 1, _PALETTE_FRAMES).round().astype(int))
    sample = Image.fromarray(np.concatenate([image_of(frames[index]) for index in some]))
    palette = sample.quantize(64 if frames[0].images is None else 256)
    first, *rest = [
        Image.fromarray(image_of(frame)).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames
    ]
    video = io.BytesIO()
    first.save(video, format="gif", save_all=True, append_images=rest, duration=round(1000.0 / rate), loop=0)
    write_file(path, video.getvalue())
