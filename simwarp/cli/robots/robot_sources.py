"""Files of robots for commands: which reader a file is for, and what of the command line it takes."""

from __future__ import annotations

import dataclasses
import re
import shlex
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal

import simwarp.importers
from simwarp.cli import UsageError, shortened
from simwarp.core.types import ModelError
from simwarp.importers.imported import Imported
from simwarp.importers.report import ImportedWarning
from simwarp.importers.source_files import bytes_of, expansion_of, parsed_xml, source_file

Base = Literal["fixed", "floating"]


@dataclasses.dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes:
        title: for people.
        suffixes: of its files.
        reader: name of the function in `simwarp.importers`.
        options: of the command line that the reader takes.
        root: of an XML file.
    """

    title: str
    suffixes: tuple[str, ...]
    reader: str
    options: tuple[str, ...] = ()
    root: str = ""


FORMATS: Final = (
    Format("MJCF", (".xml", ".mjcf"), "load_mjcf", ("allow", "self_collision"), "mujoco"),
    Format("URDF", (".urdf", ".xml"), "load_urdf", ("allow", "base", "packages", "density", "self_collision"), "robot"),
    Format("USD", (".usd", ".usda", ".usdc", ".usdz"), "load_usd", ("allow", "self_collision")),
    Format("STEP", (".step", ".stp"), "load_step", ("allow", "density", "self_collision")),
    Format("SolidWorks", (".py",), "load_solidworks", ("allow", "up", "self_collision")),
    Format("saved robot", (".json",), "load_robot"),
)


SelfCollisionWord = Literal["on", "off", "adjacent-off", "overlapping-off"]
"""What the command line says for `self_collision` of the readers."""
SWITCHES: Final[Mapping[str | None, bool]] = MappingProxyType({"on": True, "off": False})


@dataclasses.dataclass(frozen=True)
class RobotOptions:
    """What the command line says about a file; None and empty: nothing."""

    base: Base | None = None
    allow: Sequence[str] = ()
    packages: Sequence[str] = ()
    density: float | None = None
    up: str | None = None
    self_collision: str | None = None


def format_of(path: Path) -> Format:
    """The kind of a file, by its name and, of XML, its content.

    Raises:
        UsageError: no reader is for it.
        ModelError: it cannot be read.
    """
    suffix = path.suffix.lower()
    found = [kind for kind in FORMATS if suffix in kind.suffixes]
    if not found:
        known = ", ".join(dict.fromkeys(suffix for kind in FORMATS for suffix in kind.suffixes))
        hint = f"; expand it: {expansion_of(path)}" if suffix == ".xacro" else f"; files end in {known}"
        raise UsageError(f"no reader is for '{shortened(str(path))}'{hint}")
    file = source_file(path, "robot", (suffix,))
    if len(found) == 1:
        return found[0]
    root = parsed_xml(file.name, bytes_of(file)).tag
    for kind in found:
        if kind.root == root:
            return kind
    roots = " or ".join(f"<{kind.root}> ({kind.title})" for kind in found)
    raise UsageError(f"{file.name}: its first element must be {roots}, got <{shortened(str(root))}>; pass another file")


def load_file(path: Path, options: RobotOptions) -> tuple[Format, Imported]:
    """The robot of a file; what it is not the same as goes into its report, not into warnings.

    Raises:
        UsageError: the file's reader is not part of this installation, does not take an option, or needs one.
        ModelError: the file cannot be imported: one line that names all that is refused.
    """
    kind = format_of(path)
    reader: Callable[..., Imported] | None = getattr(simwarp.importers, kind.reader, None)
    if reader is None:
        raise UsageError(f"{path.name}: reading {kind.title} is not part of this installation of simwarp")
    given = {name: value for name, value in vars(options).items() if value}
    for name in given:
        if name not in kind.options:
            takers = ", ".join(other.title for other in FORMATS if name in other.options)
            raise UsageError(
                f"--{name.replace('_', '-')} is for {takers}, '{path.name}' is {kind.title}; leave it away"
            )
    if "base" in kind.options and options.base is None:
        raise UsageError(
            f"{path.name}: a {kind.title} file does not tell whether its root is welded to the world; "
            "add --base fixed or --base floating"
        )
    if "packages" in given:
        given["packages"] = _folders(options.packages)
    if options.self_collision in SWITCHES:
        given["self_collision"] = SWITCHES[options.self_collision]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ImportedWarning)
            return kind, reader(path, **given)
    except ModelError as error:
        raise ModelError(_for_command(str(error))) from error


def _folders(words: Sequence[str]) -> Mapping[str, Path]:
    """Packages of NAME=FOLDER words."""
    found = {}
    for word in words:
        name, equals, folder = word.partition("=")
        if not (name and equals and folder):
            raise UsageError(f"--packages must be NAME=FOLDER, got '{shortened(word)}'")
        found[name] = Path(folder)
    return found


def _for_command(text: str) -> str:
    """An error with its remedy as a word of the command line."""

    def words(match: re.Match[str]) -> str:
        return "--allow " + " ".join(
            f"'{kind}'" if " " in kind else kind for kind in re.findall(r"'([^']*)'", match[1])
        )

    text = re.sub(r"allow=\[([^\]]*)\]", words, text)
    text = re.sub(r"packages=\{'([^']*)': folder\}", lambda match: f"--packages {shlex.quote(match[1])}=FOLDER", text)
    text = text.replace("load with density=1000 (kg/m³)", "add --density 1000 (kg/m³)")
    return text.replace("packages={...}", "--packages")
