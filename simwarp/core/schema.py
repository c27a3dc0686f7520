"""The one loader: plain values, as JSON has them, become typed configurations; the same rules hold in Python.

Types and constraints of the fields (`simwarp.core.constraints`) are the schema. pydantic holds values to them; what is
wrong becomes one line of the room's own error class that names the key path, the rule, the value and the remedy::

    SPECS = Schema(SpecError, largest=1e15)

    @dataclass(frozen=True)
    class Brake:
        max_torque: NotNegative

        def __post_init__(self) -> None:
            SPECS.hold(self)

    SPECS.load(Brake, {"max_torque": -1})  # SpecError: max_torque: must be zero or positive, got -1
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import inspect
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, NamedTuple, ParamSpec, TypeAlias, TypeVar, cast

import numpy as np
import typing_extensions

from simwarp.core.constraints import Ge, Gt, Le, Lt, Meaning, Read, RuleError, Tagged
from simwarp.core.file_keys import old_keys, with_current_keys
from simwarp.core.types import FLOAT32_MAX, formatted
from simwarp.core.wording import nearest, shortened

if TYPE_CHECKING:
    from pydantic_core import SchemaValidator

Keys: TypeAlias = tuple[str | int, ...]
P = ParamSpec("P")
R = TypeVar("R")

WHOLE: Final = 2**63
"""Whole numbers are below it, and not below its negative."""


LARGEST_TOLD: Final = 16_384
"""A range of whole numbers is told whole up to here, beyond it by the end that matters."""


class FreeKey(str):
    """A key of a mapping, which may be any."""


class Fault(NamedTuple):
    """What is wrong with a value.

    Attributes:
        keys: its key path.
        what: the rule, the value and the remedy.
        kind: "value", "missing" or "unknown" (keys); "check": a rule between fields, whose error names its field.
    """

    keys: Keys
    what: str
    kind: str = "value"


def dotted(keys: Keys) -> str:
    """A key path as errors have it: `axles[0].suspension.camber`."""
    text = ""
    for key in keys:
        text += f"[{key}]" if isinstance(key, int) else f"{'.' if text else ''}{shortened(key)}"
    return text


def fault_text(fault: Fault) -> str:
    """A fault in one line."""
    path = dotted(fault.keys)
    if fault.kind == "check" and path:
        return f"{path}.{fault.what}"
    return f"{path}: {fault.what}" if path else fault.what


def argument_text(fault: Fault, thing: str, given: Mapping[str, Any]) -> str:
    """A fault of an argument in one line; `thing` begins it and may name others: "body '{name}'"."""
    if fault.keys[:1] == ("name",):  # a name that is none
        thing = thing.partition(" '{name")[0]
    what = f" {fault.what}" if fault.kind == "value" else f": {fault.what}"
    return f"{thing.format_map(given)}: {dotted(fault.keys)}{what}"


class Place(NamedTuple):
    """Where a value stands, for errors: the name of its file, its key path in there, and their class."""

    file: str
    failure: type[ValueError]
    keys: Keys = ()

    def at(self, *keys: str | int) -> Place:
        """The place of a member or an item of the value."""
        return self._replace(keys=(*self.keys, *keys))

    def error(self, what: str) -> ValueError:
        """One line: file, key path, fault."""
        return self.failure(self.line(Fault(self.keys, what)))

    def line(self, fault: Fault) -> str:
        """A fault of a value in the file."""
        return f"{self.file}: {fault_text(fault)}"


class Schema:
    """The loader of a room.

    Args:
        error: the class of its errors; those that configurations raise themselves are of it too.
        largest: size of the largest number.
        least: the smallest positive number.
        longest: letters of the longest text.
        unit: unit of a number by its key, for what is wanted.
        describe: makes the line of a fault in a configuration of a class.
    """

    def __init__(
        self, error: type[ValueError], *, largest: float = FLOAT32_MAX, least: float = 0.0, longest: int = 10**6,
        unit: Callable[[str], str] = lambda key: "",
        describe: Callable[[Fault, type], str] = lambda fault, kind: fault_text(fault),
    ) -> None:  # fmt: skip
        self.error, self.unit, self.describe = error, unit, describe
        self.largest, self.least, self.longest = largest, least, longest
        self._validators: dict[Any, SchemaValidator] = {}

    def load(self, hint: Any, value: Any, describe: Callable[[Fault], str] = fault_text) -> Any:
        """The value as a type hint wants it: a class of configurations, or anything that a field may be.

        Raises:
            ValueError: of the room's class; it does not fit.
        """
        from pydantic_core import ValidationError

        try:
            return self._validator(hint).validate_python((value,))[0]
        except ValidationError as found:
            errors = _errors(found)
        raise self.error(describe(self._fault(hint, value, errors))) from None

    def hold(self, config: Any) -> None:
        """Hold the fields of a frozen configuration to their types, in `__post_init__`; lists become tuples.

        Raises:
            ValueError: of the room's class; it names the field.
        """
        kind: Any = type(config)
        given = {name: getattr(config, name) for name in field_hints(kind)}
        vars(config).update(self.fields(kind, given, lambda fault: self.describe(fault, kind)))

    def fields(self, kind: Any, values: Mapping[str, Any], describe: Callable[[Fault], str]) -> dict[str, Any]:
        """Values by name as the fields of a class or of a `TypedDict` want them; `describe` makes the error's line.

        Raises:
            ValueError: of the room's class; one does not fit, or none has its name.
        """
        from pydantic_core import ValidationError

        given = {name: _plain(value) for name, value in values.items()}
        try:
            return cast(dict[str, Any], self._validator(kind, fields=True).validate_python((given,))[0])
        except ValidationError as found:
            errors = _errors(found)
        raise self.error(describe(self._fault(kind, given, errors, python=True))) from None

    def arguments(self, thing: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
        """Decorator of a function whose arguments are held to the types and constraints of its signature.

        Args:
            thing: what errors begin with; it may name arguments: "body '{name}'".
        """

        def decorate(function: Callable[P, R]) -> Callable[P, R]:
            names = tuple(inspect.signature(function).parameters)

            @functools.wraps(function)
            def held(*args: P.args, **kwargs: P.kwargs) -> R:
                kind = _arguments_of(function)
                known = field_hints(kind)
                given = dict(zip(names, args, strict=False)) | kwargs
                values = {name: value for name, value in given.items() if name in known}
                checked = self.fields(kind, values, lambda fault: argument_text(fault, thing, given))
                positional: Any = [checked.get(name, value) for name, value in zip(names, args, strict=False)]
                keywords: Any = {**kwargs, **{name: checked[name] for name in kwargs if name in checked}}
                return function(*positional, *cast(Any, args[len(names) :]), **keywords)

            return held

        return decorate

    def _validator(self, hint: Any, fields: bool = False) -> SchemaValidator:
        """What holds a tuple of one value to a hint, or of one dictionary to a class's fields; made when needed."""
        made = self._validators.get((hint, fields))
        if made is None:
            from pydantic_core import SchemaValidator

            made = SchemaValidator(self._strict(_adapter(_fields_of(hint) if fields else hint).core_schema))
            self._validators[hint, fields] = made
        return made

    def _strict(self, node: Any) -> Any:
        """A core schema in which truth values are no numbers and numbers are no texts, all within the room's limits."""
        if isinstance(node, list | tuple):
            return type(node)(map(self._strict, node))
        if not isinstance(node, dict):
            return node
        held = {key: item if key == "metadata" else self._strict(item) for key, item in node.items()}
        kind = held.get("type")
        if kind == "float":
            held = {"allow_inf_nan": False, **held, "strict": True}
            if held.get("gt") == 0.0 and self.least:
                del held["gt"]
                held["ge"] = self.least
            if not held["allow_inf_nan"]:
                self._bound(held, -self.largest, self.largest)
        elif kind == "int":
            held["strict"] = True
            self._bound(held, -int(min(self.largest, WHOLE)), int(min(self.largest, WHOLE - 1)))
        elif kind == "str":
            held = {"max_length": self.longest, **held, "strict": True}
        elif kind == "bool":
            held["strict"] = True
        elif kind == "dataclass" and (keys := old_keys(held["cls"])):
            return _with_current_keys(held, keys)
        return held

    def _bound(self, node: dict[str, Any], least: float, most: float) -> None:
        if "ge" not in node and "gt" not in node:
            node["ge"] = least
        if "le" not in node and "lt" not in node:
            node["le"] = most

    # ---- what is wrong, in words -----------------------------------------------------------------------------------

    def _fault(self, hint: Any, value: Any, errors: Sequence[Mapping[str, Any]], python: bool = False) -> Fault:
        """The fault that counts: unknown keys before wrong values, and these before missing ones."""

        def rank(error: Mapping[str, Any]) -> int:
            if error["type"] == "missing":
                return 3
            if error["type"] == "too_short":  # a list is short of items that are wrong
                return 4
            if error["type"] in ("unexpected_keyword_argument", "extra_forbidden"):
                return 0
            return 2 if _within(hint, error["loc"]).union and _is_of_type(error["type"]) else 1

        return self._described(hint, value, min(errors, key=rank), python)

    def _described(self, hint: Any, root: Any, error: Mapping[str, Any], python: bool) -> Fault:
        kind, value, context = error["type"], error["input"], error.get("ctx", {})
        place = _within(hint, error["loc"])
        if kind == "missing" and isinstance(error["loc"][-1], int):  # an item of a list of fixed length
            place, kind = _within(hint, error["loc"][:-1]), "too_short"
        item = value
        if place.union:
            kind = "type" if _is_of_type(kind) else kind
            value = functools.reduce(lambda found, key: found[key], place.keys, root)
        keys, inner = place.keys, peeled(place.hint)[0]
        name = next((key for key in reversed(keys) if isinstance(key, str)), "")
        wanted = self.wanted(place.hint, name, python)
        arms = typing.get_args(inner) if _is_union(inner) else (place.hint,)
        meaning = next(
            (f"; give {note}" for arm in arms if peeled(arm)[0] in (int, float) and (note := _meaning(arm))), ""
        )
        match kind:
            case "missing":
                return Fault(keys, f"missing; give {_meaning(place.hint) or wanted}", "missing")
            case "unexpected_keyword_argument" | "extra_forbidden":
                known = field_hints(place.owner)
                return Fault(keys, f"unknown key{nearest(keys[-1], known)}; known: {', '.join(known)}", "unknown")
            case "union_tag_not_found" | "union_tag_invalid" | "model_attributes_type":
                return _tag_fault(keys, place.hint, value)
            case "value_error" if isinstance(context["error"], RuleError):
                broken = context["error"]
                remedy = f"; {broken.remedy}" if broken.remedy else ""
                return Fault(keys, f"must be {broken.rule}, got {broken.got or formatted(value)}{remedy}")
            case "value_error":
                return Fault(keys, str(context["error"]), "check")
            case "finite_number":
                return Fault(keys, f"must be a finite number, got {formatted(value)}{meaning}")
            case "greater_than" | "greater_than_equal" | "less_than" | "less_than_equal":
                return Fault(
                    keys, f"must be {self._bounds(place.hint, context, item)}, got {formatted(value)}{meaning}"
                )
            case "too_short" | "too_long" if "min_length" in context or "max_length" in context:
                return Fault(keys, f"must be {_count(inner, context, wanted)}, got {formatted(value)}")
            case "string_too_long":
                return Fault(keys, f"must be a text of at most {context['max_length']} letters, got {formatted(value)}")
            case "literal_error" | "enum":
                near = nearest(value, choices(inner))
                return Fault(keys, f"must be {wanted}, got {formatted(value)}{near}")
        return Fault(keys, f"must be {wanted}, got {formatted(value)}{meaning}")

    def _bounds(self, hint: Any, context: Mapping[str, Any], value: Any) -> str:
        """The bounds of a number in words."""
        if {abs(context.get("ge", 0.0)), abs(context.get("le", 0.0))} & {self.largest, WHOLE, WHOLE - 1}:
            return f"below {self.largest:g}" if self.largest < FLOAT32_MAX else self.wanted(hint, "")
        if self.least and context.get("ge") == self.least:
            return "positive" if value <= 0.0 else f"at least {self.least:.2g} (float32)"
        inner, notes = peeled(hint)
        if _is_union(inner):
            notes = next((found for arm in typing.get_args(inner) if (found := peeled(arm)[1])), ())
        low = next((note for note in notes if isinstance(note, Gt | Ge)), None)
        high = next((note for note in notes if isinstance(note, Lt | Le)), None)
        if low is None and high is None:
            made: Mapping[str, Any] = {"gt": Gt, "ge": Ge, "lt": Lt, "le": Le}
            note = next(made[key](bound) for key, bound in context.items())
            low, high = (note, None) if isinstance(note, Gt | Ge) else (None, note)
        if low and high and int(number_of(high)) > LARGEST_TOLD and isinstance(value, int):
            low, high = (low, None) if value <= number_of(low) else (None, high)
        return bounds(low, high)

    def wanted(self, hint: Any, key: str, python: bool = False) -> str:
        """What a field wants, in words with its unit; of an object in a file, or of its class in Python."""
        inner, notes = peeled(hint)
        arguments = typing.get_args(inner)
        if (meaning := _meaning(hint)) and inner not in (int, float):
            return meaning
        if python and typing.get_origin(hint) is Annotated:
            hint = next((note.kind for note in hint.__metadata__ if isinstance(note, Read) and note.kind), hint)
            inner = hint if isinstance(hint, type) else inner
        if inner is float:
            unit = self.unit(key)
            return f"a number [{unit}]" if unit else "a number"
        if tag := _tag_of(notes):
            return f"an object with a {tag}: {', '.join(_classes(hint))}"
        if _is_union(inner):
            return " or ".join(dict.fromkeys(self.wanted(argument, key, python) for argument in arguments))
        if isinstance(inner, type) and issubclass(inner, enum.Enum):
            return f"one of {', '.join(map(str, choices(inner)))}"
        if typing.get_origin(inner) is Literal:
            return f"one of {', '.join(map(repr, choices(inner)))}"
        if dataclasses.is_dataclass(inner):
            kind: Any = inner
            article = "an" if kind.__name__[0] in "AEIO" else "a"
            return f"{article if python else 'an object with the keys of'} {kind.__name__}"
        plain = typing.get_origin(inner) or inner
        if plain is tuple and arguments and arguments[-1] is not Ellipsis:
            return f"a list of {len(arguments)} items"
        if isinstance(plain, type) and issubclass(plain, Mapping):
            return "an object"
        if isinstance(plain, type) and issubclass(plain, Sequence) and plain is not str:
            return "a list"
        words = {int: "a whole number", str: "a text", bool: "true or false", type(None): "null"}
        return words.get(plain, f"a {getattr(plain, '__name__', 'value')}")

    def json_schema(self, hint: Any, **head: Any) -> dict[str, Any]:
        """The JSON Schema of a hint, with the docstrings of the fields; `head` comes first."""
        whole = _adapter(hint, use_attribute_docstrings=True).json_schema()
        return {**head, **whole["prefixItems"][0], "$defs": whole.get("$defs", {})}


def number_of(note: Gt | Ge | Lt | Le | None) -> Any:
    """The number of a bound."""
    return None if note is None else next(iter(dataclasses.asdict(note).values()))


def bounds(low: Gt | Ge | None, high: Lt | Le | None) -> str:
    """Bounds of a number in words."""
    least, most = number_of(low), number_of(high)
    if low is not None and high is not None:
        if isinstance(least, int) and isinstance(most, int) and isinstance(low, Ge) and isinstance(high, Le):
            return f"from {least} to {most}"
        return f"in {'[' if isinstance(low, Ge) else '('}{least:g}, {most:g}{']' if isinstance(high, Le) else ')'}"
    if high is not None:
        return f"{'at most' if isinstance(high, Le) else 'below'} {most if isinstance(most, int) else f'{most:g}'}"
    if least == 0:
        return "zero or positive" if isinstance(low, Ge) else "positive"
    return f"{'at least' if isinstance(low, Ge) else 'above'} {least if isinstance(least, int) else f'{least:g}'}"


def _count(hint: Any, context: Mapping[str, Any], wanted: str) -> str:
    """How many items a list wants, in words."""
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) is tuple and arguments and arguments[-1] is not Ellipsis:
        return wanted
    numbers = "numbers" if arguments and peeled(arguments[0])[0] in (int, float) else ""
    if "min_length" in context:
        least = context["min_length"]
        return f"{'one' if least == 1 else least} or more {numbers}".strip()
    return f"at most {context['max_length']} {numbers or 'items'}"


def _tag_fault(keys: Keys, hint: Any, value: Any) -> Fault:
    """A choice of classes that is not made, or of one that is not there."""
    tag, classes = _tag_of(peeled(hint)[1]), list(_classes(hint))
    if not isinstance(value, Mapping):
        return Fault(keys, f"must be an object with a {tag}, got {formatted(value)}; {tag}s: {', '.join(classes)}")
    if tag not in value:
        return Fault((*keys, tag), f"missing; give one of {', '.join(classes)}", "missing")
    chosen = value[tag]
    return Fault(
        (*keys, tag), f"must be one of {', '.join(classes)}, got {formatted(chosen)}{nearest(chosen, classes)}"
    )


# ---- type hints ------------------------------------------------------------------------------------------------------


class _Place(NamedTuple):
    """Where an error stands: key path, hint, the class that has the field, and whether it is in a choice of types."""

    keys: Keys
    hint: Any
    owner: Any
    union: bool = False


def _within(hint: Any, steps: Sequence[str | int]) -> _Place:
    """Follow the steps of pydantic, some of which name classes of a choice, through type hints."""
    keys: Keys = ()
    owner: Any = None
    for step in steps:
        inner, notes = peeled(hint)
        if step == "[key]":  # what is wrong is the key itself
            hint = str
        elif dataclasses.is_dataclass(inner) or typing_extensions.is_typeddict(inner):
            owner, keys = inner, (*keys, step)
            hint = field_hints(owner).get(str(step), Any)
        elif _tag_of(notes):
            hint = _classes(hint)[str(step)]
        elif _is_union(inner):
            return _Place(keys, hint, owner, union=True)
        elif (arguments := typing.get_args(inner)) and issubclass(typing.get_origin(inner), Mapping):
            hint, keys = arguments[1], (*keys, FreeKey(step))
        elif arguments and isinstance(step, int):
            fixed = typing.get_origin(inner) is tuple and arguments[-1] is not Ellipsis
            hint, keys = arguments[min(step, len(arguments) - 1) if fixed else 0], (*keys, step)
    return _Place(keys, hint, owner)


def peeled(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """A hint without its annotations and without None, and the annotations."""
    notes: tuple[Any, ...] = ()
    while True:
        if typing.get_origin(hint) is Annotated:
            notes, hint = (*notes, *hint.__metadata__), typing.get_args(hint)[0]
        elif _is_union(hint) and type(None) in typing.get_args(hint) and len(typing.get_args(hint)) == 2:
            hint = next(option for option in typing.get_args(hint) if option is not type(None))
        elif read := next((note for note in notes if isinstance(note, Read)), None):
            hint, notes = read.plain, tuple(note for note in notes if note is not read)
        else:
            return hint, notes


def _is_of_type(kind: str) -> bool:
    """Whether an error says that a value is of another type."""
    return kind in ("missing", "too_short", "too_long") or kind.endswith(("_type", "_parsing"))


def _meaning(hint: Any) -> str:
    return next((note.words for note in peeled(hint)[1] if isinstance(note, Meaning)), "")


def _is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in (typing.Union, types.UnionType)


def _tag_of(notes: Iterable[Any]) -> str:
    return next((note.key for note in notes if isinstance(note, Tagged)), "")


def _classes(hint: Any) -> dict[str, Any]:
    """The classes of a choice by what chooses them."""
    inner, notes = peeled(hint)
    tag = _tag_of(notes)
    return {str(choices(field_hints(option)[tag])[0]): option for option in typing.get_args(inner)}


def choices(hint: Any) -> list[Any]:
    """The values of a Literal or an enumeration, as files have them."""
    inner = peeled(hint)[0]
    if isinstance(inner, type) and issubclass(inner, enum.Enum):
        return [member.value for member in inner]
    return list(typing.get_args(inner))


@functools.cache
def field_hints(kind: Any) -> dict[str, Any]:
    """Resolved type of every field of a dataclass or `TypedDict`, with its constraints.

    A field that a subclass declares again with the plain type, to give it another default, keeps those of its base.
    """
    hints, plain = typing.get_type_hints(kind, include_extras=True), typing.get_type_hints(kind)
    if typing_extensions.is_typeddict(kind):
        return hints
    bases: list[Any] = [base for base in kind.__mro__[1:] if dataclasses.is_dataclass(base)]
    for base in bases:
        declared = typing.get_type_hints(base)
        for name, hint in field_hints(base).items():
            if hints[name] == plain[name] == declared[name]:
                hints[name] = hint
    return {field.name: hints[field.name] for field in dataclasses.fields(kind) if field.init}


# ---- pydantic --------------------------------------------------------------------------------------------------------


def _adapter(hint: Any, **config: Any) -> Any:
    """Pydantic's reading of a tuple of one value: settings are given to what is no class of pydantic's own."""
    from pydantic import ConfigDict, TypeAdapter

    settings = ConfigDict(extra="forbid", arbitrary_types_allowed=True)
    return TypeAdapter(tuple[hint], config=cast(ConfigDict, {**settings, **config}))


def _with_current_keys(node: Any, keys: Mapping[str, str]) -> Any:
    """A core schema of a class whose fields had other keys in files: objects may have these."""
    from pydantic_core import core_schema

    def read(value: Any) -> Any:
        return with_current_keys(value, keys) if isinstance(value, Mapping) else value

    return core_schema.no_info_before_validator_function(read, node)


def _fields_of(kind: Any) -> Any:
    """A type of dictionaries of a dataclass's fields; those of a `TypedDict` may be left out."""
    make: Any = typing_extensions.TypedDict
    return make(kind.__name__, field_hints(kind), total=bool(dataclasses.is_dataclass(kind)))


def _is_constrained(hint: Any) -> bool:
    """Whether a hint, or one inside of it, has annotations."""
    return typing.get_origin(hint) is Annotated or any(map(_is_constrained, typing.get_args(hint)))


@functools.cache
def _arguments_of(function: Any) -> Any:
    """A type of dictionaries of a function's arguments: those with constraints, and truth values."""
    make: Any = typing_extensions.TypedDict
    hints = typing.get_type_hints(inspect.unwrap(function), include_extras=True)
    held = {name: hint for name, hint in hints.items() if name != "return" and (hint is bool or _is_constrained(hint))}
    return make(function.__name__, held, total=False)


def _errors(found: Any) -> list[dict[str, Any]]:
    return [{**error, "loc": error["loc"][1:]} for error in found.errors(include_url=False)]


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays as Python's."""
    if isinstance(value, np.generic) or (
        isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "iuf"
    ):
        return value.item()
    return tuple(value.tolist()) if isinstance(value, np.ndarray) and value.ndim == 1 else value
