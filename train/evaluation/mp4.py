"""Videos by ffmpeg, which the package imageio-ffmpeg brings along."""

from __future__ import annotations

import errno
import importlib
import os
import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from simwarp.core.files import output_error, replacing
from simwarp.core.operating_system import ended_by_file_size
from simwarp.tasks import InputError

_QUALITY = "25"
"""Of H.264: 0 keeps all, 51 is worst."""


def check_encoder() -> None:
    """Refuse to write videos where there is no ffmpeg.

    Raises:
        InputError: the package is not installed, or has none.
    """
    try:
        importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe()
    except ImportError:
        raise InputError(
            "mp4 needs the package imageio-ffmpeg: pip install imageio-ffmpeg, or give a .gif instead"
        ) from None
    except RuntimeError as error:
        raise InputError(f"mp4 needs ffmpeg: {error} Or give a .gif instead") from None


class Encoder:
    """A running ffmpeg that encodes H.264 from images as they come; a context manager that ends it in any case.

    Requests to stop that a terminal sends to all of its processes do not reach it: what was given to it is kept.

    Args:
        path: of the file, in a folder that exists; it is complete after :meth:`finish`.
        size: width and height [pixels].
        rate: images per second, as a number or a fraction ``100/3``.
        options: of ffmpeg for the output: encoder, quality.
    """

    def __init__(self, path: Path, size: tuple[int, int], rate: float | str, options: Sequence[str]) -> None:
        program: Any = importlib.import_module("imageio_ffmpeg")
        shown = rate if isinstance(rate, str) else f"{rate:.6f}"
        command = [
            program.get_ffmpeg_exe(), "-y", "-v", "error", "-nostats",
            "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}", "-r", shown, "-i", "-", "-an",
            *options, "-f", "mp4", str(path),
        ]  # fmt: skip
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def add(self, image: npt.NDArray[np.uint8]) -> bool:
        """Give it one image (height, width, 3), or several; False: it has ended, and :meth:`finish` says why."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(image.tobytes())
        except BrokenPipeError:
            return False
        return True

    def finish(self) -> OSError | None:
        """Wait until the file is complete; return why it could not be written, if it could not."""
        said = self._process.communicate()[1].decode(errors="replace").strip()
        code = self._process.returncode
        if code == 0:
            return None
        if ended_by_file_size(code) or os.strerror(errno.EFBIG) in said:
            return OSError(errno.EFBIG, os.strerror(errno.EFBIG))
        if os.strerror(errno.ENOSPC) in said:
            return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return OSError(errno.EIO, f"ffmpeg ended with code {code}: {said[-200:] or 'without a word'}")

    def end(self) -> None:
        """End it, if it still runs: the file is of no use then."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.communicate()


def write_mp4(path: Path, images: Iterable[npt.NDArray[np.uint8]], size: tuple[int, int], rate: float) -> None:
    """Write a video, whole or not at all.

    Args:
        path: of the file.
        images: (height, width, 3) each.
        size: width and height [pixels], even.
        rate: images per second.

    Raises:
        FileError: ``path`` cannot be written to.
        OutputError: the disk did not take it.
    """
    options = ["-vcodec", "libx264", "-preset", "veryfast", "-pix_fmt", "yuv420p", "-crf", _QUALITY]
    with replacing(path) as draft, Encoder(draft, size, rate, options) as encoder:
        for image in images:
            if not encoder.add(image):
                break
        error = encoder.finish()
        if error is not None:
            raise output_error(path, error, draft)
