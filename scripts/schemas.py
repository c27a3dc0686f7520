"""JSON Schemas of the files of vehicles and sensors, made of their types: `python -m scripts.schemas` writes them."""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import json
import textwrap
from pathlib import Path
from typing import Any

from simwarp.model.rules import RULES
from simwarp.sensors.presets import FOR_PEOPLE, KINDS
from simwarp.vehicle.spec.parts import SPECS, Spec
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec

DATA = Path(__file__).resolve().parents[1] / "simwarp" / "data"
DIALECT = "https://json-schema.org/draft/2020-12/schema"
FILE: dict[str, Any] = {
    "type": "object", "properties": {"file": {"type": "string"}}, "required": ["file"], "additionalProperties": False,
    "description": "what stands in another file, relative to this one",
}  # fmt: skip
TAGS = ("template", "kind")
"""Keys that choose one of several classes: files have to give them."""


def schemas() -> dict[Path, str]:
    """Text of every schema by its file."""
    made = {
        "vehicle": vehicle_schema(VehicleSpec, "A vehicle of simwarp"),
        "tracked_vehicle": vehicle_schema(TrackedVehicleSpec, "A tracked vehicle of simwarp"),
        "sensor": sensor_schema(),
    }
    return {DATA / f"{name}.schema.json": _text(schema) for name, schema in made.items()}


def _text(schema: dict[str, Any]) -> str:
    """JSON with one line for each definition."""
    classes = ",\n".join(f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in schema["$defs"].items())
    head = ",\n".join(f" {json.dumps(key)}: {json.dumps(value)}" for key, value in schema.items() if key != "$defs")
    return f'{{\n{head},\n "$defs": {{\n{classes}\n }}\n}}\n'


def vehicle_schema(cls: type[Spec], title: str) -> dict[str, Any]:
    """That of a vehicle on wheels or tracks: any value in it may be `{"file": ...}`."""
    whole = SPECS.json_schema(cls)
    classes = whole["$defs"]
    kinds = {kind.__name__: kind for kind in _kinds_of(Spec)}
    for name, schema in classes.items():
        _describe_inherited(schema, kinds.get(name))
        _tidy(schema)
        for key, value in schema["properties"].items():
            if "items" in value:
                value["items"] = _or_file(value["items"])
            if key not in TAGS:
                schema["properties"][key] = _or_file(value)
    classes[cls.__name__]["properties"]["$schema"] = {"type": "string"}
    return {"$schema": DIALECT, "title": title, **whole, "$defs": {**classes, "File": FILE}}


def _kinds_of(cls: type[Spec]) -> list[type[Spec]]:
    """A class and all that inherit from it."""
    return [cls, *(each for below in cls.__subclasses__() for each in _kinds_of(below))]


def _describe_inherited(schema: dict[str, Any], cls: type[Spec] | None) -> None:
    """Add the docstrings of fields that a class inherits: the schema has only those of its own."""
    for base in () if cls is None else cls.__mro__[1:]:
        if dataclasses.is_dataclass(base):
            for key, text in _field_texts(base).items():
                schema["properties"].get(key, {}).setdefault("description", text)


@functools.cache
def _field_texts(cls: type) -> dict[str, str]:
    """Docstrings of the fields that stand in a class."""
    (node,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    assert isinstance(node, ast.ClassDef)
    found = {}
    for line, after in zip(node.body, node.body[1:], strict=False):
        if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name) and isinstance(after, ast.Expr):
            text = ast.literal_eval(after.value)
            found[line.target.id] = inspect.cleandoc(text)
    return found


def sensor_schema() -> dict[str, Any]:
    """That of a sensor: one of all sorts by the key "sensor"."""
    classes: dict[str, Any] = {}
    for kind in KINDS.values():
        classes |= RULES.json_schema(kind.config)["$defs"]
    sorts = [{"$ref": f"#/$defs/{kind.config.__name__}"} for kind in KINDS.values()]
    for schema in classes.values():
        _tidy(schema)
    for sort, kind in KINDS.items():
        schema = classes[kind.config.__name__]
        texts = {key: {"type": "string"} for key in FOR_PEOPLE}
        schema["properties"] = {"sensor": {"const": sort}, **texts, **schema["properties"]}
        schema["required"] = ["sensor", *schema.get("required", [])]
    return {"$schema": DIALECT, "title": "A sensor of simwarp", "oneOf": sorts, "$defs": classes}


def _tidy(schema: dict[str, Any]) -> None:
    """Leave out titles that repeat the keys, add units, and ask for the keys that choose a class."""
    for key, value in schema["properties"].items():
        value.pop("title", None)
        unit = SPECS.unit(key)
        if value.get("type") == "number" and unit and "[" not in value.get("description", ""):
            value["description"] = f"{value.get('description', '')} [{unit}]".strip()
        if key in TAGS and "const" in value:
            schema["required"] = [key, *schema.get("required", [])]


def _or_file(value: dict[str, Any]) -> dict[str, Any]:
    head: dict[str, Any] = {key: value[key] for key in ("description", "default") if key in value}
    rest = {key: item for key, item in value.items() if key not in head}
    return {**head, "anyOf": [*(rest["anyOf"] if list(rest) == ["anyOf"] else [rest]), {"$ref": "#/$defs/File"}]}


def main() -> None:
    """Write the files."""
    for path, text in schemas().items():
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
