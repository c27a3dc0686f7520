"""The files of a model before MuJoCo compiles it: which there are, where they lie, and tags that it compiles away."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from simwarp.core.types import ModelError
from simwarp.importers.report import ImportReport

ASSETS: Final = ("mesh", "texture", "hfield", "skin", "flexcomp", "composite")
"""Tags whose `file` attribute names an asset."""
SHORTCUTS: Final = ("muscle", "cylinder", "adhesion", "damper", "plugin", "composite", "flexcomp", "skin", "flex", "mocap")
"""Tags that are refused, and of which the compiled model does not always tell."""
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
    return list(_tags(path, path.parent, report, ()))


def _tags(path: Path, folder: Path, report: ImportReport, above: tuple[Path, ...]) -> Iterator[Tag]:
    if path in above or len(above) > DEEPEST:
        raise ModelError(f"{report.source}: {path.name} includes itself; take the include out")
    root = parsed(path, report.source)
    for node in root.iter():
        if not isinstance(node.tag, str):
            continue  # a comment
        attributes = {str(key): str(value) for key, value in node.attrib.items()}
        file = attributes.get("file")
        if file and (node.tag == "include" or node.tag in ASSETS):
            _tell_if_outside(node.tag, file, report)
        for key in ("meshdir", "texturedir", "assetdir"):
            if node.tag == "compiler" and attributes.get(key):
                _tell_if_outside(key, attributes[key], report)
        if node.tag == "include" and file:
            yield from _tags((folder / file), folder, report, (*above, path))
        else:
            inside = tuple(str(each.tag) for each in node.iterancestors())
            yield Tag(node.tag, attributes, inside, path)


def parsed(path: Path, source: str) -> Any:
    """Root of an XML file without entities and network.

    Raises:
        ModelError: the file is missing, is no XML, or declares a document type, which could hold entities.
    """
    from lxml import etree

    try:
        text = path.read_bytes()
    except OSError as error:
        raise ModelError(f"{source}: {path} cannot be read: {error.strerror or error}; check the path") from None
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise ModelError(f"{source}: {path.name} declares a document type; take <!DOCTYPE ...> out, it may hold entities")
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        return etree.fromstring(text, parser)
    except etree.XMLSyntaxError as error:
        raise ModelError(f"{source}: {path.name} is no XML: {error.msg}; repair the file") from None


def _tell_if_outside(what: str, file: str, report: ImportReport) -> None:
    """A note in the report where a path leaves the folder of the model."""
    path = Path(file)
    if path.is_absolute() or ".." in path.parts:
        report.approximate("file outside", file, f"{what} is read from outside the model's folder")
