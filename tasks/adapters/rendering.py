"""Frames of a task for environments: checked at the start, built at the first frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from gymnasium import logger

from simwarp.core.types import formatted

from ..framework.errors import InputError
from ..framework.task import Task

if TYPE_CHECKING:
    from ..framework.task_rendering import TaskCamera

Frames = npt.NDArray[np.uint8]

RENDER_MODES: Final = ("rgb_array",)
"""Gymnasium makes ``rgb_array_list`` and ``human`` of it."""
RENDER_SIZE: Final = (480, 320)
"""Width and height of a frame [pixels]."""
_SMALLEST, _LARGEST = 16, 4096
_SAMPLES = 2
"""Rays per pixel along each side."""


def frame_rate(task: Task[Any]) -> int | float:
    """Return the frames per second that show a task at its own speed, one for each control step."""
    rate = 1.0 / task.config.control_dt
    return round(rate) if abs(rate - round(rate)) < 1e-6 * rate else rate


def metadata_of(task: Task[Any]) -> dict[str, Any]:
    """Return what Gymnasium asks to know about the frames of a task."""
    return {"render_modes": list(RENDER_MODES), "render_fps": frame_rate(task)}


def check_rendering(mode: str | None, size: tuple[int, int]) -> None:
    """Refuse frames that there are none of, before any world is built.

    Args:
        mode: render mode; None: no frames.
        size: width and height of a frame [pixels].

    Raises:
        InputError: an unknown mode, or a size that is no film's.
    """
    if mode is not None and mode not in RENDER_MODES:
        raise InputError(
            f"render_mode must be {' or '.join(RENDER_MODES)}, or None for no frames, got {formatted(mode)}"
        )
    whole = isinstance(size, tuple | list) and len(size) == 2 and all(type(side) is int for side in size)
    # Even, as films want their frames
    if not whole or not all(_SMALLEST <= side <= _LARGEST and side % 2 == 0 for side in size):
        rule = f"width and height, each even and from {_SMALLEST} to {_LARGEST} pixels, such as {RENDER_SIZE}"
        raise InputError(f"render_size must be {rule}, got {formatted(size)}")


class TaskRenderer:
    """Frames of all worlds of a task; nothing is built before the first one.

    Args:
        task: that is shown.
        mode: render mode; None: no frames.
        size: width and height of a frame [pixels].
    """

    def __init__(self, task: Task[Any], mode: str | None, size: tuple[int, int]) -> None:
        self._task, self._mode, self._size = task, mode, size
        self._camera: TaskCamera | None = None
        self._time = 0.0

    def advance(self) -> None:
        """Note that a control step is over."""
        self._time += self._task.config.control_dt

    def restart(self) -> None:
        """Note that all worlds begin new episodes."""
        if self._camera is not None:
            self._camera.cut()

    def frames(self, env_id: str) -> Frames | None:
        """(W, height, width, 3) uint8 sRGB of the present state; without a render mode None, and a warning.

        Raises:
            InputError: the task has neither bodies nor a drawing.
        """
        if self._mode is None:
            logger.warn(
                "render() was called without a render mode: pass one when the environment is made, such as"
                f' gymnasium.make("{env_id}", render_mode="{RENDER_MODES[0]}")'
            )
            return None
        if self._camera is None:
            # Lights, meshes and kernels of pictures take seconds that an environment without pictures has no use for
            from ..framework.task_rendering import TaskCamera

            width, height = self._size
            self._camera = TaskCamera(self._task, width=width, height=height, samples=_SAMPLES)
        return self._camera.render(self._time)
