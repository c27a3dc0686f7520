"""From command-line arguments to typed options, with one clear line for whatever is wrong."""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
import io
import json
import math
import re
import sys
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro
from rich.console import Console

from simwarp.cli import UsageError, one_line

OptionsT = TypeVar("OptionsT")

HELP = frozenset({"-h", "--help"})
FLAT = tyro.conf.arg(name="")
"""Marks a nested dataclass whose fields are options without a prefix."""


@dataclasses.dataclass(frozen=True)
class CommonOptions:
    """Options that every command has."""

    json: str | None = None
    """Write machine-readable results to this file; - is standard output, and text then goes to standard error."""
    debug: tyro.conf.FlagCreatePairsOff[bool] = False
    """Show tracebacks of errors."""

    def console(self) -> Console:
        """Return where text for people goes."""
        return Console(stderr=self.json == "-")

    def check(self) -> None:
        """Refuse a JSON file that cannot be written, before any work is done."""
        if self.json not in (None, "-"):
            folder = Path(str(self.json)).parent
            if not folder.is_dir():
                raise UsageError(f"cannot write '{self.json}': folder {folder} does not exist")

    def emit(self, content: Mapping[str, Any]) -> None:
        """Write the results where ``--json`` asks for them."""
        if self.json is None:
            return
        text = json.dumps(_finite(content), indent=2) + "\n"
        if self.json == "-":
            sys.stdout.write(text)
            sys.stdout.flush()
            return
        try:
            Path(self.json).write_text(text, encoding="utf-8")
        except OSError as error:
            raise UsageError(f"cannot write '{self.json}': {error.strerror}") from error


def _finite(value: Any) -> Any:
    """Return ``value`` with NaN and infinity as null: JSON has no words for them."""
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def task_options(name: str, base: type[Any], **nested: Any) -> type[Any]:
    """Return ``base`` with further fields whose defaults are configurations.

    Args:
        name: name of the new dataclass.
        base: a frozen dataclass with defaults.
        nested: field -> default configuration; a name that starts with ``flat_`` gets no option prefix.
    """
    fields: list[tuple[str, Any, Any]] = []
    for field, default in nested.items():
        kind: Any = type(default)
        fields.append((field, Annotated[kind, FLAT] if field.startswith("flat_") else kind, _default(default)))
    return dataclasses.make_dataclass(name, fields, bases=(base,), frozen=True)


def _default(value: Any) -> Any:
    return dataclasses.field(default=value)


def take_task(arguments: list[str], command: str, known: Iterable[str]) -> tuple[str, list[str]]:
    """Split the TASK off the arguments: the first one, or the first that names a known task.

    Raises:
        UsageError: there is none.
    """
    known = list(known)
    if arguments and not arguments[0].startswith("-"):
        return arguments[0], arguments[1:]
    for index, argument in enumerate(arguments):
        if argument in known:
            return argument, arguments[:index] + arguments[index + 1 :]
    if HELP & set(arguments):
        print(f"usage: simwarp {command} TASK [options]\n\ntasks: {', '.join(known)}")
        print(f"\n`simwarp {command} TASK --help` lists the options, which depend on the task.")
        raise SystemExit(0)
    raise UsageError(f"which task? usage: simwarp {command} TASK [options]; tasks: {', '.join(known)}")


def expand_shorthands(arguments: list[str], task: str, config: Any) -> list[str]:
    """Write ``--obs X``, ``--full`` and ``--no-full`` as the options of the task's configuration they stand for.

    Raises:
        UsageError: the task has no choice of observations or not this one, or no full model.
    """
    return _expand_full(_expand_obs(arguments, task, config), task, config)


def _expand_obs(arguments: list[str], task: str, config: Any) -> list[str]:
    wanted = option_value(arguments, "--obs")
    if wanted is None:
        return arguments
    check_obs(task, config, wanted)
    return [f"--task.{word[2:]}" if word == "--obs" or word.startswith("--obs=") else word for word in arguments]


def check_obs(task: str, config: Any, wanted: str) -> None:
    """Refuse observations that a task does not have.

    Raises:
        UsageError: the task has no choice, or not this one.
    """
    if not hasattr(config, "obs"):
        raise UsageError(f"task '{task}' has no choice of observations: leave --obs away")
    choices = [kind.value for kind in type(config.obs)]
    if wanted not in choices:
        raise UsageError(f"--obs of task '{task}' must be {' or '.join(choices)}, got '{wanted}'")


def _expand_full(arguments: list[str], task: str, config: Any) -> list[str]:
    flags = ("--full", "--no-full")
    used = next((word for word in arguments if word in flags), None)
    if used is not None and not hasattr(config, "full"):
        raise UsageError(f"task '{task}' has only one model of what it drives: leave {used} away")
    if used == "--full":
        from simwarp.tasks import task_class

        kind: Any = task_class(task)
        if getattr(kind, "full_name", "") == getattr(kind, "vehicle_name", None):  # a task of another kind has neither
            print(f"simwarp: there is one model of the {kind.vehicle_name}: --full changes nothing", file=sys.stderr)
    return [f"--task.{word[2:]}" if word in flags else word for word in arguments]


def chosen_obs(arguments: list[str]) -> str | None:
    """Return the observations that expanded arguments choose; None if they leave it to the task."""
    return option_value(arguments, "--task.obs")


def with_chosen_obs(arguments: list[str], config: Any) -> Any:
    """Return a task's configuration with the observations that arguments choose, if that is one of its values."""
    obs = chosen_obs(arguments)
    kinds = type(config.obs) if obs is not None and hasattr(config, "obs") else ()
    chosen = next((kind for kind in kinds if kind.value == obs), None)
    return config if chosen is None else dataclasses.replace(config, obs=chosen)


def take_path(arguments: list[str], command: str, what: str) -> tuple[Path, list[str]]:
    """Split the first argument, a path, off the others; help does not need one.

    Raises:
        UsageError: there is none.
    """
    if arguments and not arguments[0].startswith("-"):
        return Path(arguments[0]), arguments[1:]
    if HELP & set(arguments):
        return Path(), arguments
    raise UsageError(f"usage: simwarp {command} {what} [options]")


def option_value(arguments: list[str], name: str) -> str | None:
    """Return the value of one option before the others are parsed, since their defaults depend on it."""
    for index, argument in enumerate(arguments):
        if argument == name and index + 1 < len(arguments):
            return arguments[index + 1]
        if argument.startswith(f"{name}="):
            return argument.partition("=")[2]
    return None


def parse_options(kind: type[OptionsT], arguments: list[str], program: str) -> OptionsT:
    """Parse arguments into a dataclass.

    Raises:
        UsageError: an option is unknown, or its value is wrong.
        SystemExit: help was asked for and printed.
    """
    errors = io.StringIO()
    try:
        with contextlib.redirect_stderr(errors):
            return tyro.cli(
                kind, prog=program, args=arguments, config=(tyro.conf.EnumChoicesFromValues,), compact_help=False
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        raise UsageError(_explain(_message(errors.getvalue()), kind)) from None


def _message(box: str) -> str:
    """Return the first paragraph of tyro's framed error in one line."""
    lines = []
    for line in box.splitlines():
        text = line.strip().strip("│╭╮╰╯").strip()
        if not text or line.lstrip().startswith(("╭", "╰")):
            continue
        if set(text) <= {"─", "-"}:
            break
        lines.append(text)
    return one_line(" ".join(lines)) or "wrong options"


def _explain(message: str, kind: type[Any]) -> str:
    """Return tyro's message; our own for an unknown option, with the names that come near, and for no number."""
    head, _, rest = message.partition(":")
    if head == "Error parsing task":
        return f"--task.{rest.strip()}"
    if head.startswith("Error parsing --"):
        return _explain_value(head.removeprefix("Error parsing "), rest, kind) or message
    if not head.lower().startswith("unrecognized"):
        return message
    words = [word.strip(",") for word in rest.split()]
    unknown = [word.partition("=")[0] for word in words if word.startswith("-")]
    if not unknown:
        return f"unexpected argument '{words[0] if words else rest}'; see --help"
    close = difflib.get_close_matches(unknown[0], option_names(kind), n=3)
    hint = f"did you mean {' or '.join(close)}?" if close else "see --help"
    return f"unknown option {unknown[0]}; {hint}"


def _explain_value(option: str, reason: str, kind: type[Any]) -> str:
    """Return which number an option wants and what it got; nothing for other options."""
    hint = dict(_options(kind)).get(option)
    inner = typing.get_args(hint)[0] if hasattr(hint, "__metadata__") else hint
    wanted = [word for number, word in NUMBERS.items() if number is inner or number in typing.get_args(inner)]
    got = re.search(r"from \['(.*?)'\]|(?:float|base 10): '(.*)'", reason)
    if len(wanted) != 1 or got is None:
        return ""
    metavars = [getattr(item, "metavar", None) for item in getattr(hint, "__metadata__", ())]
    unit = "".join(f" [{metavar}]" for metavar in metavars if metavar)
    return f"{option} must be {wanted[0]}{unit}, got '{got[1] or got[2] or ''}'"


NUMBERS = {float: "a number", int: "a whole number"}


def option_names(kind: type[Any]) -> list[str]:
    """Return the options a dataclass has on the command line."""
    return [name for name, _ in _options(kind)]


def _options(kind: type[Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Return the options with their type hints."""
    found: list[tuple[str, Any]] = []
    hints = typing.get_type_hints(kind, include_extras=True)
    for field in dataclasses.fields(kind):
        hint = hints[field.name]
        flat = FLAT in getattr(hint, "__metadata__", ())
        inner = typing.get_args(hint)[0] if hasattr(hint, "__metadata__") else hint
        word = field.name.replace("_", "-")
        if dataclasses.is_dataclass(inner) and isinstance(inner, type):
            found += _options(inner, prefix if flat else f"{prefix}{word}.")
        else:
            found.append((f"--{prefix}{word}", hint))
    return found
