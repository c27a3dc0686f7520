"""Every tag and attribute of a URDF file, looked at once before its values are read: what is known, what is left out,
and what is wrong.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

from simwarp.core.types import FLOAT32_MAX, ModelError, formatted
from simwarp.core.wording import nearest
from simwarp.importers.report import ImportReport

MASSLESS: Final = (
    "it moves without mass or inertia, and is no bare frame with mass below; give it an <inertial>, {}or weld its "
    "joint (type fixed)"
)
"""Why a link is refused; another remedy may stand in the middle."""

REFUSABLE: Final = {
    "geometry": "no shape of ours has this geometry",
    "origin": "only xyz and rpy say where something is",
    "massless link": MASSLESS.format(""),
    "mesh": "its file cannot be used",
    "size": "a length of its shape or a factor of its mesh is 0; give it a size",
    "mimic": "it must name a joint of the file",
    "repeated element": "only one may stand there; keep one",
    "transmission": "only one joint and one actuator each, of type SimpleTransmission",
}
"""Kinds of elements that are refused, with the reason."""

GEOMETRIES: Final = ("box", "cylinder", "sphere", "capsule", "mesh")

JOINT_TYPES: Final = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


class Value(NamedTuple):
    """An attribute: how many numbers it has (0: it is a text; -1: one or three), and whether it must be there."""

    numbers: int
    required: bool = False


class Tag(NamedTuple):
    """An element: its attributes, and the elements in it, those that may be there more than once in `many`."""

    attributes: dict[str, Value]
    once: tuple[str, ...] = ()
    many: tuple[str, ...] = ()
    required: tuple[str, ...] = ()


TEXT, NAME, NUMBER, GIVEN = Value(0), Value(0, True), Value(1), Value(1, True)
PART: Final = ("origin", "geometry", "material")

TAGS: Final = {
    "robot": Tag({"name": NAME, "version": TEXT}, many=("link", "joint", "material", "transmission", "gazebo")),
    "link": Tag({"name": NAME}, ("inertial",), ("visual", "collision")),
    "inertial": Tag({}, ("origin", "mass", "inertia"), required=("mass", "inertia")),
    "origin": Tag({"xyz": Value(3), "rpy": Value(3)}),
    "mass": Tag({"value": GIVEN}),
    "inertia": Tag({"ixx": GIVEN, "iyy": GIVEN, "izz": GIVEN, "ixy": NUMBER, "ixz": NUMBER, "iyz": NUMBER}),
    "visual": Tag({"name": TEXT}, PART, required=("geometry",)),
    "collision": Tag({"name": TEXT}, PART, required=("geometry",)),
    "geometry": Tag({}, GEOMETRIES),
    "box": Tag({"size": Value(3, True)}),
    "cylinder": Tag({"radius": GIVEN, "length": GIVEN}),
    "capsule": Tag({"radius": GIVEN, "length": GIVEN}),
    "sphere": Tag({"radius": GIVEN}),
    "mesh": Tag({"filename": NAME, "scale": Value(-1)}),
    "material": Tag({"name": TEXT}, ("color", "texture")),
    "color": Tag({"rgba": Value(4, True)}),
    "texture": Tag({"filename": NAME}),
    "joint": Tag(
        {"name": NAME, "type": NAME},
        ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "safety_controller", "calibration"),
        required=("parent", "child"),
    ),
    "parent": Tag({"link": NAME}),
    "child": Tag({"link": NAME}),
    "axis": Tag({"xyz": Value(3, True)}),
    "limit": Tag({"effort": NUMBER, "velocity": NUMBER, "lower": NUMBER, "upper": NUMBER}),
    "dynamics": Tag({"damping": NUMBER, "friction": NUMBER}),
    "mimic": Tag({"joint": NAME, "multiplier": NUMBER, "offset": NUMBER}),
}  # fmt: skip

LEFT_OUT: Final = {
    "gazebo": "instructions to another simulator; left out",
    "safety_controller": "its soft limits are those of a controller; left out",
    "calibration": "reference positions of encoders; left out",
    "texture": "a texture of a link; it is shown in its colour",
}
"""Elements whose equations are not there."""

NOT_NEGATIVE: Final = ("mass", "cylinder", "capsule", "sphere", "box", "dynamics")


def list_elements(root: Any, source: str, report: ImportReport) -> None:
    """Looks at every tag and attribute below `robot`; what is refused is taken out of the tree.

    Raises:
        ModelError: something is wrong with the file, or it is unexpanded xacro.
    """
    _check_expanded(root, source)
    if root.tag != "robot":
        raise ModelError(f"{source}: the root element must be <robot>, got <{_plain(root)}>; this is no URDF")
    _list(root, "", source, report)


def _check_expanded(root: Any, source: str) -> None:
    """A file that is xacro still is refused: its values are programs."""
    for element in root.iter():
        told = element.tag if isinstance(element.tag, str) and "xacro" in element.tag else ""
        texts = [told, *element.attrib.values(), element.text or ""]
        for text in texts:
            if text and (text == told or "$(" in text or "${" in text):
                raise ModelError(
                    f"{source}: values must be written out, got unexpanded xacro {formatted(text.strip())} in "
                    f"<{_plain(element)}>; run: pip install xacrodoc, then: xacrodoc robot.urdf.xacro -o robot.urdf"
                )


def _plain(element: Any) -> str:
    """Tag without its namespace."""
    return str(element.tag).rpartition("}")[2]


def _list(element: Any, owner: str, source: str, report: ImportReport) -> None:
    tag = TAGS[element.tag]
    if element.tag in ("robot", "link", "joint", "material"):
        owner = element.get("name", "") or owner
    where = f"{source}: <{element.tag}>" + (f" of '{owner}'" if owner else "")
    _check_attributes(element, tag, where, owner, report)
    seen: set[str] = set()
    for child in list(element):
        name = child.tag
        known = name in tag.once or name in tag.many
        if name in tag.once and (name in seen or (element.tag == "geometry" and seen)):
            where_else = f"second <{name}>" if name in seen else f"<{name}> beside another shape"
            report.refuse("repeated element", owner, f"a {where_else} in <{element.tag}>; keep one")
            element.remove(child)
            continue
        seen.add(name)
        if name in LEFT_OUT:
            report.approximate(name, _named(child, owner), LEFT_OUT[name])
        elif not known and element.tag == "geometry":
            report.refuse("geometry", owner, f"no shape of ours is a <{_plain(child)}>")
            element.getparent().getparent().remove(element.getparent())
            return
        elif not known:
            hint = nearest(_plain(child), (*tag.once, *tag.many))
            report.approximate(f"tag {_plain(child)}", _named(child, owner), f"unknown to URDF{hint}; left out")
        elif name != "transmission":
            _list(child, owner, source, report)
    for name in tag.required:
        if name not in seen:
            raise ModelError(f"{where}: must have a <{name}>, got none; add it")
    if element.tag == "geometry" and len(seen) != 1:
        raise ModelError(f"{where}: must have one of {', '.join(GEOMETRIES)}, got {len(seen)} of them; write one")


def _named(element: Any, owner: str) -> str:
    return str(element.get("name") or element.get("reference") or owner)


def _check_attributes(element: Any, tag: Tag, where: str, owner: str, report: ImportReport) -> None:
    for name, text in element.attrib.items():
        if name not in tag.attributes:
            plain = str(name).rpartition("}")[2]
            if element.tag == "origin":
                report.refuse("origin", owner, f"attribute {plain} is none of xyz and rpy")
            else:
                reason = f"unknown to URDF{nearest(plain, tag.attributes)}; left out"
                report.approximate(f"attribute {element.tag} {plain}", owner, reason)
            continue
        value = tag.attributes[name]
        if value.numbers != 0:
            _check_numbers(where, name, text, value.numbers, element.tag in NOT_NEGATIVE)
        elif value.required and not text.strip():
            raise ModelError(f"{where}: {name} must not be empty; write a name")
    for name, value in tag.attributes.items():
        if value.required and element.get(name) is None:
            raise ModelError(f"{where}: must have the attribute {name}, got none; add it")


def _check_numbers(where: str, name: str, text: str, count: int, not_negative: bool) -> None:
    """The right count of finite numbers."""
    words = text.split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    counts = (1, 3) if count == -1 else (count,)
    if len(values) not in counts or not all(math.isfinite(value) and abs(value) <= FLOAT32_MAX for value in values):
        wanted = "one or three finite numbers" if count == -1 else f"{count} finite number{'s' * (count > 1)}"
        raise ModelError(f"{where}: {name} must be {wanted}, got {formatted(text)}; write numbers with spaces between")
    if not_negative and min(values) < 0.0:
        raise ModelError(f"{where}: {name} must not be negative, got {formatted(text)}; check its sign")
