"""The wheels that simwarp needs on another machine: which they are, and getting those that are not there yet.

pip resolves for the interpreter it runs in, whatever version it is told to download for: it reads markers such as
`python_version >= "3.12"` with its own version. All versions are pinned anyway, so the requirements are walked here,
with the markers of the other machine, and pip only fetches single wheels by name and version.
"""

import email.parser
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name, parse_wheel_filename
from packaging.version import Version

from scripts.pip_calls import pip_environment, pip_reason
from scripts.torch_build import CONSTRAINTS

OLD_MANYLINUX = {17: "manylinux2014", 12: "manylinux2010", 5: "manylinux1"}


class WheelError(Exception):
    """The wheels cannot be had; the text is one line."""


@dataclass(frozen=True)
class Target:
    """Another machine: its Python (`3.12`) and its platform as wheels name it (`manylinux_2_28_x86_64`)."""

    python: str
    platform: str

    @property
    def linux(self) -> bool:
        """True if it runs Linux; otherwise it is a Mac."""
        return self.platform.startswith("manylinux")

    @property
    def machine(self) -> str:
        """Its processor, e.g. `x86_64`."""
        return re.sub(r"^[a-z]+_\d+_\d+_", "", self.platform)

    def markers(self) -> dict[str, str]:
        """Values of the environment markers of requirements."""
        system, name = ("Linux", "linux") if self.linux else ("Darwin", "darwin")
        return {str(key): str(value) for key, value in default_environment().items()} | {
            "implementation_name": "cpython",
            "implementation_version": f"{self.python}.0",
            "os_name": "posix",
            "platform_machine": self.machine,
            "platform_python_implementation": "CPython",
            "platform_release": "",
            "platform_system": system,
            "platform_version": "",
            "python_full_version": f"{self.python}.0",
            "python_version": self.python,
            "sys_platform": name,
        }

    def pip_flags(self) -> list[str]:
        """Flags with which pip looks for this machine's wheels instead of its own."""
        platforms = [self.platform]
        match = re.fullmatch(r"manylinux_2_(\d+)_(\w+)", self.platform)
        if match:
            # pip takes the tags as they are: each older C library has to be named.
            for minor in range(int(match[1]), 4, -1):
                names = [f"manylinux_2_{minor}", *([OLD_MANYLINUX[minor]] if minor in OLD_MANYLINUX else [])]
                platforms += [f"{name}_{match[2]}" for name in names]
            platforms.append(f"linux_{match[2]}")
        flags = ["--python-version", self.python, "--implementation", "cp"]
        return [*flags, *(part for tag in dict.fromkeys(platforms) for part in ("--platform", tag))]


def pins() -> dict[str, str]:
    """The tested version of every package, from constraints.txt."""
    lines = CONSTRAINTS.read_text(encoding="utf-8").splitlines()
    pairs = (line.split("==", 1) for line in lines if "==" in line and not line.startswith("#"))
    return {canonicalize_name(name): version.strip() for name, version in pairs}


def requirements(wheel: Path, extras: Sequence[str], markers: dict[str, str]) -> Iterator[Requirement]:
    """Requirements of a wheel on the machine that the markers describe."""
    with zipfile.ZipFile(wheel) as archive:
        name = next(name for name in archive.namelist() if re.fullmatch(r"[^/]+\.dist-info/METADATA", name))
        metadata = email.parser.Parser().parsestr(archive.read(name).decode("utf-8"))
    for text in metadata.get_all("Requires-Dist") or []:
        requirement = Requirement(text)
        if requirement.marker is None or any(
            requirement.marker.evaluate(markers | {"extra": e}) for e in ("", *extras)
        ):
            yield requirement


@dataclass
class Shelf:
    """A folder of wheels for one target, kept between runs, from which the needed ones are picked.

    Attributes:
        folder: Folder of the wheels.
        target: The machine they are for.
        pinned: Exact versions by canonical name.
        without: Names of packages that the machine has itself.
        indexes: Arguments for pip by the name of the package that needs them.
        asked: Requirements of each package so far.
        left_out: Names of `without` that were met.
    """

    folder: Path
    target: Target
    pinned: dict[str, str]
    without: frozenset[str] = frozenset()
    indexes: dict[str, tuple[str, ...]] = field(default_factory=dict)
    asked: dict[str, SpecifierSet] = field(default_factory=dict)
    left_out: set[str] = field(default_factory=set)

    def pick(self, name: str) -> Path | None:
        """The newest wheel on the shelf that does for all that has been required of the package."""
        found = []
        for path in self.folder.glob("*.whl"):
            wheel, version, _, _ = parse_wheel_filename(path.name)
            exact = name not in self.pinned or version == Version(self.pinned[name])
            if wheel == name and exact and self.asked[name].contains(version, prereleases=True):
                found.append((version, path))
        return max(found)[1] if found else None

    def walk(self, roots: Sequence[Requirement]) -> tuple[dict[str, Path], set[str]]:
        """The wheels that the roots need, by name, and the names of those that are not on the shelf."""
        wheels: dict[str, Path] = {}
        missing: set[str] = set()
        waiting, seen = list(roots), set()
        while waiting:
            requirement = waiting.pop()
            name = canonicalize_name(requirement.name)
            if name in self.without:
                self.left_out.add(name)
                continue
            self.asked[name] = self.asked.get(name, SpecifierSet()) & requirement.specifier
            wheel = self.pick(name)
            if wheel is None:
                missing.add(name)
                continue
            wheels[name] = wheel
            extras = tuple(sorted(requirement.extras))
            if (name, extras) not in seen:
                seen.add((name, extras))
                waiting += requirements(wheel, extras, self.target.markers())
        return wheels, missing

    def fetch(self, names: set[str]) -> None:
        """Let pip download the newest wheels that do; they reach the shelf whole or not at all.

        Raises:
            WheelError: If pip fails.
        """
        exact = {name: f"==={self.pinned[name]}" if name in self.pinned else str(self.asked[name]) for name in names}
        wanted = [f"{name}{exact[name]}" for name in sorted(names)]
        indexes = [argument for name in sorted(names) for argument in self.indexes.get(name, ())]
        with tempfile.TemporaryDirectory(prefix=".draft-", dir=self.folder) as draft:
            command = [
                sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--only-binary=:all:", "--dest", draft,
                *self.target.pip_flags(), *indexes, *wanted,
            ]  # fmt: skip
            done = subprocess.run(
                command, env=pip_environment(), capture_output=True, encoding="utf-8", errors="replace", check=False
            )
            if done.returncode:
                raise WheelError(f"Python {self.target.python} on {self.target.platform}: {pip_reason(done.stderr)}")
            for wheel in Path(draft).glob("*.whl"):
                os.replace(wheel, self.folder / wheel.name)

    def fill(self, roots: Sequence[Requirement]) -> dict[str, Path]:
        """Download until nothing is missing; the needed wheels by name.

        Raises:
            WheelError: If a wheel cannot be had.
        """
        fetched: set[tuple[str, str]] = set()
        while True:
            before = dict(self.asked)
            wheels, missing = self.walk(roots)
            if not missing and before == self.asked:
                return wheels
            for name in sorted(missing):
                request = (name, str(self.asked[name]))
                if request in fetched:
                    version = self.pinned.get(name, "any")
                    raise WheelError(f"{name} is needed as {request[1]}, but constraints.txt allows {version} only")
                fetched.add(request)
            if missing:
                self.fetch(missing)
