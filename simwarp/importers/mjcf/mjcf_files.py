"""The files of a model before MuJoCo compiles it: which there are, where they lie, and tags that it compiles away."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from simwarp.core.types import ModelError
from simwarp.importers.report import ImportReport
from simwarp.importers.source_files import bytes_of, parsed_xml, source_file

FILES: Final = (
    "file", "fileup", "filedown", "fileleft", "fileright", "filefront", "fileback",
)  # fmt: skip
"""Attributes that name a file to be opened."""
FOLDERS: Final = ("meshdir", "texturedir", "assetdir")
"""Attributes of the compiler that name folders of files."""
ASSETS: Final = ("mesh", "texture", "hfield", "skin", "flexcomp", "composite")
"""Tags whose `file` attribute names an asset."""
DEEPEST: Final = 32
"""Includes in includes; MuJoCo refuses cycles only later."""


@dataclasses.dataclass(frozen=True)
class Tag:
    """An element of the source: its tag, attributes, the tags that it stands in, and its file."""

    tag: str
    attributes: dict[str, str]
    inside: tuple[str, ...]
    path: Path


def list_tags(path: Path, report: ImportReport) -> list[Tag]:
    """All elements of a file and of those that it includes; names of files beyond its folder go into the report.

    Raises:
        ModelError: a file is missing, is no XML, declares entities, or includes itself.
    """
    tags = list(_tags(path, path.parent, report, ()))
    _check_regular(tags, path.parent, report, (path,))
    return tags


def _tags(path: Path, folder: Path, report: ImportReport, above: tuple[Path, ...]) -> Iterator[Tag]:
    if path in above or len(above) > DEEPEST:
        raise ModelError(f"{report.source}: {path.name} includes itself; take the include out")
    root = parsed_xml(path.name, bytes_of(source_file(path, report.source, (".xml", ".mjcf"))))
    if root.tag not in ("mujoco", "mujocoinclude"):
        hint = "read URDF with load_urdf" if root.tag == "robot" else "it is no MJCF file"
        raise ModelError(f"{report.source}: {path.name}: the root must be <mujoco>, got <{root.tag}>; {hint}")
    for node in root.iter():
        if not isinstance(node.tag, str):
            continue  # a comment
        attributes = {str(key): str(value) for key, value in node.attrib.items()}
        file = attributes.get("file")
        if file and (node.tag == "include" or node.tag in ASSETS):
            _note_if_outside(node.tag, file, report)
        for key in FOLDERS:
            if node.tag == "compiler" and attributes.get(key):
                _note_if_outside(key, attributes[key], report)
        if node.tag == "include" and file:
            yield from _tags((folder / file), folder, report, (*above, path))
        else:
            inside = tuple(str(each.tag) for each in node.iterancestors())
            yield Tag(node.tag, attributes, inside, path)


def _check_regular(tags: Sequence[Tag], folder: Path, report: ImportReport, above: tuple[Path, ...]) -> None:
    """Refuses files of a model, and of the models that it attaches, that are there and no regular files: MuJoCo would
    wait for a FIFO without end. What is not there is for MuJoCo to tell of, which knows where it looked.
    """
    named = [tag.attributes[key] for tag in tags if tag.tag == "compiler" for key in FOLDERS if key in tag.attributes]
    places = [folder, *(folder / name for name in named)]
    for tag in tags:
        for reference in (tag.attributes[key] for key in FILES if tag.attributes.get(key)):
            for candidate in dict.fromkeys(
                place / name for place in places for name in (reference, Path(reference).name)
            ):
                if candidate.exists() and not candidate.is_file():
                    raise ModelError(
                        f"{report.source}: <{tag.tag}>: file '{reference}' must be a regular file, got a folder, a "
                        "device or a FIFO; name a file"
                    )
                if tag.tag == "model" and candidate.is_file() and candidate not in above and len(above) < DEEPEST:
                    below = list(_tags(candidate, candidate.parent, report, ()))
                    _check_regular(below, candidate.parent, report, (*above, candidate))


def _note_if_outside(what: str, file: str, report: ImportReport) -> None:
    """A note in the report where a path leaves the folder of the model."""
    path = Path(file)
    if path.is_absolute() or ".." in path.parts:
        report.approximate("file outside", file, f"{what} is read from outside the model's folder")
