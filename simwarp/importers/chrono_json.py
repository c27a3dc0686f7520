"""One object of a Chrono JSON file: values by key, errors that name file and key, and a note of keys nobody read."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar, cast

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import Meaning
from simwarp.core.schema import Place
from simwarp.core.types import formatted
from simwarp.core.wording import nearest
from simwarp.vehicle.spec.parts import SPECS
from simwarp.vehicle.spec.vehicle_files import parse_json, read_text
from simwarp.vehicle.spec.vehicle_spec import ZERO, Points, RigidPart, Spec, SpecError, Vec3

S = TypeVar("S", bound=Spec)

OBJECTS: Final = Annotated[list[Any], Meaning("a list of objects")]
PAIRS: Final = Annotated[list[tuple[float, float]], Meaning("a list of [x, y] pairs")]

# What only pictures, reports and the driver's view use. A radius or width that matters is read before this list counts.
VISUAL = frozenset(
    {
        "Name", "Type", "Template", "Visualization", "Radius", "Width", "Length", "Output", "Driver Position",
        "Rear Connector Location", "Front Connector Location", "Description",
    }
)  # fmt: skip

STRING_OR_COMMENT = re.compile(r'"(?:\\.|[^"\\])*(?:"|\Z)|//[^\n]*|/\*.*?(?:\*/|\Z)', re.DOTALL)
"""An unterminated string or comment ends with the text: a search for its end from every place takes quadratic time."""


def without_comments(text: str) -> str:
    """The text with comments blanked out, so that lines and columns stay."""

    def blank(match: re.Match[str]) -> str:
        found = match.group()
        return found if found.startswith('"') else re.sub(r"[^\n]", " ", found)

    return STRING_OR_COMMENT.sub(blank, text)


def vehicle_template(path: Path) -> str | None:
    """The template of a file that declares itself a vehicle of Chrono's; None of others and unreadable ones."""
    if path.suffix != ".json":
        return None
    try:
        content = parse_json(without_comments(read_text(path)), path.name)
    except SpecError:
        return None
    found = isinstance(content, dict) and content.get("Type") == "Vehicle"
    return str(content.get("Template")) if found else None


class Node:
    """An object of a file. Reading a key marks it; `finish` refuses keys that are neither marked nor visual."""

    def __init__(self, value: Any, place: Place) -> None:
        if not isinstance(value, dict):
            raise place.error(f"must be an object, got {formatted(value)}")
        self.value: dict[str, Any] = value
        self.place = place
        self.known: set[str] = set()
        self.children: dict[tuple[str, int], Node] = {}

    @classmethod
    def of_file(cls, path: Path) -> Node:
        """The object of a file, comments allowed."""
        return cls(parse_json(without_comments(read_text(path)), path.name), Place(path.name, SpecError))

    def __contains__(self, key: str) -> bool:
        self.known.add(key)
        return key in self.value

    def get(self, key: str, wanted: str) -> Any:
        """The value of a key that must be there."""
        if key not in self:
            raise self.place.at(key).error(f"missing{nearest(key, self.value)}; give {wanted}")
        return self.value[key]

    def skip(self, *keys: str) -> None:
        """Mark keys that have no counterpart; the caller says why."""
        self.known.update(keys)

    def child(self, key: str) -> Node:
        """An object within this one."""
        if (key, -1) not in self.children:
            self.children[key, -1] = Node(self.get(key, "an object"), self.place.at(key))
        return self.children[key, -1]

    def each(self, key: str) -> Iterator[Node]:
        """The objects of a list."""
        for index, item in enumerate(self._held(key, OBJECTS, "a list of objects")):
            if (key, index) not in self.children:
                self.children[key, index] = Node(item, self.place.at(key).at(index))
            yield self.children[key, index]

    def text(self, key: str) -> str:
        """A text."""
        return cast(str, self._held(key, str, "a text"))

    def choice(self, key: str, known: Collection[str]) -> str:
        """One of some texts."""
        text = self.text(key)
        if text not in known:
            rule = f"must be one of {', '.join(known)}, got {formatted(text)}"
            raise self.place.at(key).error(f"{rule}{nearest(text, known)}")
        return text

    def flag(self, key: str, default: bool = False) -> bool:
        """True or false."""
        return cast(bool, self._held(key, bool, "true or false")) if key in self else default

    def number(self, key: str, unit: str = "", default: float | None = None) -> float:
        """A finite number."""
        wanted = f"a number [{unit}]" if unit else "a number"
        if default is not None and key not in self:
            return default
        value = self.get(key, wanted)
        return finite(value, wanted, self.place.at(key))

    def whole(self, key: str) -> int:
        """A whole number."""
        return cast(int, self._held(key, int, "a whole number"))

    def angle(self, key: str) -> float:
        """An angle in degrees, in radians; 0 where none is given."""
        return math.radians(self.number(key, "°", 0.0))

    def numbers(self, key: str, count: int | None = None, unit: str = "") -> tuple[float, ...]:
        """A list of numbers."""
        wanted = f"a list of {count or 'the'} numbers" + (f" [{unit}]" if unit else "")
        value = self.get(key, wanted)
        if not isinstance(value, list) or (count is not None and len(value) != count):
            raise self.place.at(key).error(f"must be {wanted}, got {formatted(value)}")
        return tuple(finite(v, "a number", self.place.at(key).at(index)) for index, v in enumerate(value))

    def vector(self, key: str, unit: str = "m") -> Vec3:
        """Three numbers."""
        x, y, z = self.numbers(key, 3, unit)
        return x, y, z

    def quaternion(self, key: str) -> tuple[float, float, float, float]:
        """A rotation, scalar first in the file, scalar last here, of length 1."""
        w, x, y, z = self.numbers(key, 4)
        length = math.sqrt(w * w + x * x + y * y + z * z)
        if not abs(length - 1.0) < 1e-3:
            raise self.place.at(key).error(f"must be a unit quaternion (w, x, y, z), got {[w, x, y, z]}")
        return x / length, y / length, z / length, w / length

    def pairs(self, key: str, scale: float = 1.0) -> Points:
        """(x, y) pairs; `scale` converts the unit of x."""
        return tuple((scale * x, y) for x, y in self._held(key, PAIRS, "a list of [x, y] pairs"))

    def _held(self, key: str, hint: Any, wanted: str) -> Any:
        """The value of a key that must be there, as a type hint wants it."""
        value, keys = self.get(key, wanted), (*self.place.keys, key)
        return SPECS.load(hint, value, lambda fault: self.place.line(fault._replace(keys=(*keys, *fault.keys))))

    def part(self, com: Vec3 | None = None) -> RigidPart:
        """Mass, centre of mass and inertia of this object; `com` where the file gives none."""
        split = "Moments of Inertia" in self
        key = "Moments of Inertia" if split else "Inertia"
        return self.make(
            RigidPart,
            mass=self.number("Mass", "kg"),
            com=self.vector("COM") if com is None else com,
            inertia=self._inertia(key),
            products=self.vector("Products of Inertia", "kg·m²") if split and "Products of Inertia" in self else ZERO,
        )

    def _inertia(self, key: str) -> Vec3:
        """Moments of inertia; one of 0 beside others, which no body has, is raised to half of the largest, with a
        warning: so that the largest is no more than the sum of the others.
        """
        moments = self.vector(key, "kg·m²")
        least = 0.5 * max(moments)
        if min(moments) != 0.0 or least <= 0.0:
            return moments
        place = ".".join((*map(str, self.place.keys), key))
        text = f"{self.place.file}: {place}: a moment of 0 is no body's; it is raised to {least:.4g} kg·m²"
        warnings.warn(text, stacklevel=4)
        x, y, z = (moment or least for moment in moments)
        return x, y, z

    def make(self, cls: type[S], **fields: Any) -> S:
        """A description; its errors name this object."""
        try:
            return cls(**fields)
        except SpecError as error:
            key, _, rule = str(error).partition(": ")
            raise self.place.at(key).error(rule) from None

    def finish(self) -> None:
        """Refuse keys that nobody read, here and within."""
        for key in self.value:
            if key not in self.known and key not in VISUAL:
                known = ", ".join(sorted(self.known)) or "none"
                raise self.place.at(key).error(f"unknown key{nearest(key, self.known)}; known: {known}")
        for node in self.children.values():
            node.finish()


def of_matrix(node: Node, mass: float, com: npt.NDArray[np.float64], inertia: npt.NDArray[np.float64]) -> RigidPart:
    """A part from its matrix of inertia."""
    x, y, z = (float(v) for v in com)
    return node.make(
        RigidPart,
        mass=float(mass),
        com=(x, y, z),
        inertia=(float(inertia[0, 0]), float(inertia[1, 1]), float(inertia[2, 2])),
        products=(float(inertia[0, 1]), float(inertia[0, 2]), float(inertia[1, 2])),
    )


def finite(value: Any, wanted: str, place: Place) -> float:
    """A number that is one."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise place.error(f"must be {wanted}, got {formatted(value)}")
    return float(value)
