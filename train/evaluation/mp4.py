"""Videos by ffmpeg, which the package imageio-ffmpeg brings along."""

from __future__ import annotations

import errno
import importlib
import os
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any

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
    encoder: Any = importlib.import_module("imageio_ffmpeg")
    command = [
        encoder.get_ffmpeg_exe(), "-y", "-v", "error", "-nostats",
        "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}", "-r", f"{rate:.6f}", "-i", "-", "-an",
        "-vcodec", "libx264", "-preset", "veryfast", "-pix_fmt", "yuv420p", "-crf", _QUALITY,
    ]  # fmt: skip
    with replacing(path) as draft:
        error = _encode([*command, "-f", "mp4", str(draft)], images)
        if error is not None:
            raise output_error(path, error, draft)


def _encode(command: list[str], images: Iterable[npt.NDArray[np.uint8]]) -> OSError | None:
    """Give all images to ffmpeg; return why it could not write them, if it could not."""
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stdin is not None
    try:
        try:
            for image in images:
                process.stdin.write(image.tobytes())
        except BrokenPipeError:
            pass  # it has ended; its last words say why
        said = process.communicate()[1].decode(errors="replace").strip()
    except BaseException:
        process.kill()
        process.communicate()
        raise
    if process.returncode == 0:
        return None
    if ended_by_file_size(process.returncode) or os.strerror(errno.EFBIG) in said:
        return OSError(errno.EFBIG, os.strerror(errno.EFBIG))
    if os.strerror(errno.ENOSPC) in said:
        return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    return OSError(errno.EIO, f"ffmpeg ended with code {process.returncode}: {said[-200:] or 'without a word'}")
