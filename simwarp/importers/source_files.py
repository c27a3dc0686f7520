"""Foreign files: opened only where they are expected, XML without entities, libraries of extras with one clear line."""

from __future__ import annotations

import importlib
import importlib.util
import os
import shlex
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from simwarp.core import files
from simwarp.core.types import ModelError, formatted
from simwarp.core.wording import shortened


def check_installed(module: str, what: str, extra: str = "import") -> None:
    """Looks for a module of an extra without importing it.

    Raises:
        ModelError: it is not installed.
    """
    if importlib.util.find_spec(module) is None:
        raise ModelError(f"{what} needs the library {module}, which is not installed; run: {installation(extra)}")


def installation(extra: str) -> str:
    """What to run for an extra, of a released package and in a checkout."""
    return f"pip install 'simwarp[{extra}]', or in a checkout '.[{extra}]'"


def needed(module: str, what: str, extra: str = "import") -> ModuleType:
    """A module of an extra.

    Raises:
        ModelError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ModelError(
            f"{what} needs the library {module.split('.')[0]}, which cannot be imported ({error}); "
            f"run: {installation(extra)}"
        ) from None


def source_file(path: str | os.PathLike[str], what: str, suffixes: Sequence[str]) -> Path:
    """The file to read.

    Raises:
        ModelError: there is none, it has another kind of name, or it is larger than any description.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise ModelError(f"{what}: path must be the path of a file, got {formatted(path)}; pass 'robot{suffixes[0]}'")
    file = Path(path)
    if not os.path.isfile(file):  # false, too, for names that no file can have
        raise ModelError(f"{what}: there must be a file, got {formatted(str(file))}; check the path")
    if file.suffix.lower() not in suffixes:
        raise ModelError(
            f"{what}: the name must end in {' or '.join(suffixes)}, got '{shortened(file.name)}'; convert the file"
        )
    return file


def expansion_of(file: Path) -> str:
    """What to run to make a URDF of a .xacro file."""
    stem = file.name.removesuffix(".xacro").removesuffix(".urdf")
    words = shlex.join(["xacrodoc", str(file), "-o", str(file.with_name(f"{stem}.urdf"))])
    return f"pip install xacrodoc, then: {words}"


def bytes_of(file: Path) -> bytes:
    """All of a description.

    Raises:
        ModelError: it is too large, or cannot be read.
    """
    try:
        return files.check_input(file, largest=files.LARGEST_TEXT).read_bytes()
    except files.FileError as error:
        raise ModelError(f"{shortened(file)}: {error.reason or error}") from None
    except OSError as error:
        raise ModelError(f"{shortened(file)}: must be readable, got {error.strerror}; check its rights") from None


def parsed_xml(name: str, text: bytes) -> Any:
    """Root element (lxml) of an XML text, comments and processing instructions taken out.

    Raises:
        ModelError: it is no well-formed XML, or declares a document type or entities.
    """
    etree = needed("lxml.etree", f"{name}: reading XML")
    if files.declares_entities(text):
        raise ModelError(f"{name}: a document type or entities must not be declared; write the text out instead")
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, remove_comments=True,
        remove_pis=True,
    )  # fmt: skip
    try:
        return etree.fromstring(text, parser=parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        told = " ".join(str(getattr(error, "msg", error)).split())  # str names the line a second time
        raise ModelError(f"{name}: must be well-formed XML, got: {told}; the file may be cut off") from None


class FileFolders:
    """Folders in which the files of a description may lie: its own, packages that are named, and the package it is in.

    Args:
        file: the description.
        packages: folder of each package, by its name.
        folders: more of them, without names.

    Raises:
        ModelError: a package's folder does not exist.
    """

    def __init__(
        self,
        file: Path,
        packages: Mapping[str, str | os.PathLike[str]] | None = None,
        folders: Collection[str | os.PathLike[str]] = (),
    ) -> None:
        self.file = file
        self._remedy = "folders=[folder]" if packages is None else "packages={'any name': folder}"
        if packages is None:
            if isinstance(folders, (str, os.PathLike)):
                raise ModelError(f"{file.name}: folders must be a list, got {formatted(str(folders))}; write [folder]")
            packages = {str(number): folder for number, folder in enumerate(folders)}
            self._words = "folders[{}]"
        else:
            self._words = "packages['{}']"
        self.packages: dict[str, Path] = {}
        if not isinstance(packages, Mapping):
            raise ModelError(
                f"{file.name}: packages must map names to folders, got {formatted(packages)}; write "
                "{'robot_description': '/path/to/it'}"
            )
        for name, folder in packages.items():
            if not isinstance(folder, (str, os.PathLike)) or not os.path.isdir(folder):
                place = self._words.format(name)
                raise ModelError(f"{file.name}: {place} must be a folder, got {formatted(str(folder))}; check the path")
            self.packages[str(name)] = Path(folder).resolve()

    def resolve(self, reference: str) -> Path:
        """The file that a description means: `package://name/path`, or a path from the description's folder.

        Raises:
            ModelError: no folder of that package is known, the path leaves the folders, or there is no file.
        """
        if "\0" in reference or not reference.strip():
            raise ModelError(f"file {formatted(reference)}: must be a path, got none; name a mesh file")
        scheme, found, rest = reference.partition("://")
        if found and scheme == "package":
            name, _, rest = rest.partition("/")
            candidate = self._package(name, reference) / rest
        elif found and scheme == "file":
            candidate = Path(rest)
        elif found:
            raise ModelError(
                f"file {formatted(reference)}: must be a path, package:// or file://, got {scheme}://; copy it"
            )
        else:
            candidate = self.file.parent / reference
        return self._inside(candidate, reference)

    def _package(self, name: str, reference: str) -> Path:
        """A named folder; else the parent folder of that name that has a package.xml."""
        if name in self.packages:
            return self.packages[name]
        for parent in self.file.resolve().parents:
            if parent.name == name and (parent / "package.xml").is_file():
                return parent
        raise ModelError(
            f"file {formatted(reference)}: the folder of package '{name}' must be known: it is not in "
            f"packages={{...}}, "
            f"and no folder '{name}' with a package.xml is above the description; pass packages={{'{name}': folder}}"
        )

    def _inside(self, candidate: Path, reference: str) -> Path:
        try:
            resolved = candidate.resolve()
        except (OSError, RuntimeError):  # RuntimeError up to Python 3.12
            raise ModelError(
                f"file {formatted(reference)}: must be a file, got a link that leads to itself; link it to the file"
            ) from None
        own = self.file.resolve().parent
        around = [parent for parent in (own, *own.parents) if (parent / "package.xml").is_file()][:1]
        if not any(resolved.is_relative_to(folder) for folder in (own, *around, *self.packages.values())):
            raise ModelError(
                f"file {formatted(reference)}: leads out of the folders of the description to '{shortened(resolved)}'; "
                f"name the folder it is in: {self._remedy}"
            )
        if not os.path.isfile(resolved):
            where = shortened(resolved.parent)
            raise ModelError(f"file {formatted(reference)}: there must be a file of this name in '{where}'; add it")
        return resolved
