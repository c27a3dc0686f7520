"""Recorded scenes as files, by the end of their names."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from simwarp.core.files import check_output
from simwarp.core.types import ModelError, formatted
from simwarp.exporters.scene_recording import SceneRecording

SUFFIXES: Final = (".glb", ".pov")


def check_scene_path(path: str | Path, option: str = "--export-scene") -> None:
    """Refuses what cannot be written, before any work is done.

    Raises:
        ModelError: the file is of another kind.
        FileError: it cannot be written to.
    """
    if Path(path).suffix.lower() not in SUFFIXES:
        raise ModelError(
            f"{option}: the name must end in .glb or .pov, got {formatted(str(path))}; give it one of these"
        )
    check_output(path, option)


def save_scene(recording: SceneRecording, path: str | Path) -> list[Path]:
    """Writes what was recorded, in metres.

    Args:
        recording: with one frame or more.
        path: .glb: one file of glTF 2.0, y up, with an animation and its camera; .pov: a scene for POV-Ray, with a
            file of the frames' poses (-frames.inc) and one of the animation's settings (.ini) beside it.

    Returns:
        The files.

    Raises:
        ModelError: the file is of another kind, or nothing was recorded.
        OutputError: the disk did not take it.
    """
    check_scene_path(path, "save_scene")
    if not recording.times:
        raise ModelError("save_scene: there must be a frame, got none; call recording.add(time) first")
    if Path(path).suffix.lower() == ".glb":
        from simwarp.exporters.gltf_writer import write_gltf  # imports trimesh, which takes a while

        return write_gltf(recording, Path(path))
    from simwarp.exporters.povray_writer import write_povray

    return write_povray(recording, Path(path))
