"""Configurations as plain values, as JSON and checkpoints keep them, and back: every value held to its field's type."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping
from typing import Any, ClassVar, Final, TypeVar, cast

from simwarp.core.file_keys import with_reward_weights
from simwarp.core.object_repr import ReadableFields
from simwarp.core.schema import Fault, FreeKey, Keys, Schema, field_hints, peeled
from simwarp.core.wording import option_word

from .errors import InputError

KindT = TypeVar("KindT")

LONGEST_TEXT: Final = 1000
"""Letters of the longest text of a configuration."""


def _path(keys: Keys) -> str:
    """A key path in the words of the command line: `ppo.clip-value-loss`, `randomise 'body_mass'.low`."""
    text = ""
    for key in keys:
        if isinstance(key, FreeKey):
            text += f" {str(key)!r}"
        elif isinstance(key, int):
            text += f"[{key}]"
        else:
            text += ("." if text else "") + option_word(key)
    return text


def _fault_line(fault: Fault) -> str:
    path = _path(fault.keys)
    return f"{path}{' ' if fault.kind == 'value' else ': ' if path else ''}{fault.what}"


def _fault_text_of(fault: Fault, kind: type) -> str:
    """A fault in a configuration that is made in Python."""
    owner = f" of a {kind.__name__}" if getattr(kind, "NAMED", False) else ""
    return _fault_line(fault) if fault.kind != "value" else f"{_path(fault.keys)}{owner} {fault.what}"


CONFIGS: Final = Schema(InputError, longest=LONGEST_TEXT, describe=_fault_text_of)
"""Reads configurations of tasks and of trainings."""


class Settings(ReadableFields):
    """Base of configurations: frozen dataclasses whose fields are held to their types."""

    NAMED: ClassVar[bool] = False
    """Whether errors name the class: of settings that stand within others."""

    def __post_init__(self) -> None:
        CONFIGS.hold(self)
        self.validate()

    def validate(self) -> None:
        """Check rules between the fields with :func:`require`; called after the fields are held to their types."""


def config_to_plain(config: Any) -> dict[str, Any]:
    """Return a configuration as JSON-ready values; enums become their values."""
    return {key: plain_value(value) for key, value in dataclasses.asdict(config).items()}


def plain_value(value: Any) -> Any:
    """Return a value as JSON has it: enums as their values, tuples as lists."""
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, Mapping):
        return {key: plain_value(item) for key, item in value.items()}
    return [plain_value(item) for item in value] if isinstance(value, list | tuple) else value


def config_from_plain(kind: type[KindT], plain: object, where: str = "") -> KindT:
    """Return the configuration that :func:`config_to_plain` wrote; fields that are left away keep their default.

    Args:
        kind: a dataclass; the annotations of its fields say what is allowed.
        plain: what was read: it may hold anything.
        where: where it stood: the errors begin with it.

    Raises:
        InputError: a name is unknown, or a value is of a wrong type or breaks its field's rule.
    """

    def describe(fault: Fault) -> str:
        line = _fault_line(fault) if fault.keys or fault.kind == "check" else f"{kind.__name__}{_fault_line(fault)}"
        return f"{where}: {line}" if where else line

    return cast(KindT, CONFIGS.load(kind, _with_defaults(kind, plain), describe))


def _with_defaults(kind: Any, plain: object) -> object:
    """Return an object in which nested ones have the values of their owner's default where they leave some away.

    A variant that it names sets the fields that it leaves away.
    """
    if not isinstance(plain, Mapping):
        return plain
    fields = dataclasses.fields(kind)
    whole = with_reward_weights(plain, [field.name for field in fields])
    varied = kind.fields_of(str(whole.get("variant", ""))) if hasattr(kind, "fields_of") else {}
    for field in fields:
        default = varied.get(field.name, field.default)
        inner, given = peeled(field_hints(kind).get(field.name))[0], whole.get(field.name)
        if isinstance(given, Mapping) and dataclasses.is_dataclass(inner):
            like = (
                {item.name: getattr(default, item.name) for item in dataclasses.fields(inner)}
                if isinstance(default, cast(type, inner))
                else {}
            )
            whole[field.name] = {**like, **cast(dict[str, Any], _with_defaults(inner, given))}
    return {**varied, **whole}


def typed(hint: Any, value: object, name: str) -> Any:
    """Return a plain value as the type that an annotation names.

    Args:
        hint: numbers, text, enumerations, dataclasses, lists, tuples, mappings and choices of these; a value of any
            other class must be an instance of it.
        value: what was read.
        name: what the errors call it.

    Raises:
        InputError: it is not of that type.
    """
    return CONFIGS.load(hint, value, lambda fault: f"{name}{'.' if fault.keys else ''}{_fault_line(fault)}")
