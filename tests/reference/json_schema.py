"""A validator of the part of JSON Schema (draft 2020-12) that the shipped schemas use."""

from typing import Any

TYPES: dict[str, Any] = {
    "object": dict, "array": list, "string": str, "boolean": bool, "null": type(None), "integer": int,
    "number": (int, float),
}  # fmt: skip
KNOWN = {
    "$defs", "$ref", "$schema", "additionalProperties", "anyOf", "const", "default", "description", "discriminator",
    "enum", "exclusiveMaximum", "exclusiveMinimum", "items", "maxItems", "maximum", "minItems", "minLength",
    "minimum", "oneOf", "prefixItems", "properties", "required", "title", "type", "uniqueItems",
}  # fmt: skip


def fits(value: Any, schema: dict[str, Any], root: dict[str, Any]) -> bool:
    """Whether a value is what a schema wants; `root` holds the definitions."""
    assert schema.keys() <= KNOWN, schema.keys() - KNOWN
    if "$ref" in schema and not fits(value, root["$defs"][schema["$ref"].removeprefix("#/$defs/")], root):
        return False
    if "anyOf" in schema and not any(fits(value, option, root) for option in schema["anyOf"]):
        return False
    if "oneOf" in schema and sum(fits(value, option, root) for option in schema["oneOf"]) != 1:
        return False
    if "const" in schema and value != schema["const"]:
        return False
    if "enum" in schema and value not in schema["enum"]:
        return False
    kind = schema.get("type")
    if kind and (not isinstance(value, TYPES[kind]) or (isinstance(value, bool) and kind != "boolean")):
        return False
    if isinstance(value, dict):
        return _members_fit(value, schema, root)
    if isinstance(value, list):
        return _items_fit(value, schema, root)
    return isinstance(value, (str, bool)) or value is None or _in_bounds(value, schema)


def _members_fit(value: dict[str, Any], schema: dict[str, Any], root: dict[str, Any]) -> bool:
    known, rest = schema.get("properties", {}), schema.get("additionalProperties", True)
    if not set(schema.get("required", ())) <= value.keys():
        return False
    return all(fits(item, known[key], root) if key in known else rest is not False for key, item in value.items())


def _items_fit(value: list[Any], schema: dict[str, Any], root: dict[str, Any]) -> bool:
    if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
        return False
    if schema.get("uniqueItems") and any(item in value[:place] for place, item in enumerate(value)):
        return False
    hints = schema.get("prefixItems") or [schema.get("items", {})] * len(value)
    return all(fits(item, hint, root) for item, hint in zip(value, hints, strict=False))


def _in_bounds(value: float, schema: dict[str, Any]) -> bool:
    if not schema.get("minimum", value) <= value <= schema.get("maximum", value):
        return False
    return value > schema.get("exclusiveMinimum", value - 1.0) and value < schema.get("exclusiveMaximum", value + 1.0)
