"""From command-line arguments to typed options, with one clear line for whatever is wrong."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import itertools
import json
import math
import os
import shlex
import sys
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeVar

import tyro
from rich.console import Console

from simwarp.cli import HELP, UsageError, one_line, shortened
from simwarp.cli.values import check_option, is_flag, may_repeat
from simwarp.core.files import check_output, is_special, read_json, write_file
from simwarp.core.wording import close_names, option_word

if TYPE_CHECKING:
    from simwarp.tasks import Task

OptionsT = TypeVar("OptionsT")

TASK_FILE = ".py:"
"""In ``path/to/file.py:TaskClass``, a task that is not installed."""
VARIANT = "--task.variant"
RUN_CONFIG = "config.json"
"""File by which the folder of a run is known."""

WHOLE: Final = 1000
"""Columns of what is no terminal: tables in pipes and files are not cut."""
FLAT_PREFIX = "flat-"
"""Beginning of the names of such fields, as tyro calls them."""
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
        """Return the console for people; names in brackets or between colons are printed as they are."""
        return Console(stderr=self.json == "-", markup=False, emoji=False)

    def table_console(self) -> Console:
        """Return the console for people, of which only a terminal bounds the width of tables."""
        console = self.console()
        if not console.is_terminal:
            console.width = WHOLE
        return console

    def check(self, *inputs: str | Path | None, **outputs: str | Path | None) -> None:
        """Refuse files that cannot be written, before any work is done.

        Args:
            inputs: files that are read: none of them may be written over.
            outputs: option -> file to be written, beside that of ``--json``; each needs a file of its own.

        Raises:
            FileError: one cannot be written.
            UsageError: two are the same, one is read, or rows go to a file that is no .csv.
        """
        if self.json == "-" and sys.stdout is None:
            raise UsageError("--json - writes to standard output, which is closed; name a file")
        taken = {os.path.realpath(path): "an input" for path in inputs if path is not None}
        files = {"json": None if self.json == "-" else self.json} | outputs
        for name, path in files.items():
            option = f"--{name.replace('_', '-')}"
            if path is None or is_special(check_output(path, option)):
                continue
            other = taken.setdefault(os.path.realpath(path), option)
            if other != option:
                raise UsageError(f"{option} would overwrite '{path}', which is {other} too; give it another name")
        rows = outputs.get("csv")
        if rows is not None and Path(rows).suffix.lower() != ".csv" and not is_special(Path(rows)):
            raise UsageError(f"--csv must end in .csv, got '{rows}'")

    def emit(self, content: Mapping[str, Any]) -> None:
        """Write the results where ``--json`` asks for them.

        Raises:
            OutputError: the disk did not take them.
        """
        if self.json is None:
            return
        text = json.dumps(finite(content), indent=2) + "\n"
        if self.json != "-":
            write_file(self.json, text)
        elif sys.stdout is not None:
            sys.stdout.write(text)
            sys.stdout.flush()


def finite(value: Any) -> Any:
    """Return ``value`` with NaN and infinity as null: JSON has no words for them."""
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
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


def split_task(
    arguments: list[str], command: str, known: Iterable[str], *, run: str | None = None
) -> tuple[str, list[str]]:
    """Split the TASK off the arguments: the first one, or the first that names a known task or the file of one.

    Args:
        arguments: after the command.
        command: its name.
        known: names of tasks.
        run: folder of a run whose task is meant where no other is named.

    Returns:
        A word for :func:`simwarp.tasks.task_class`, and the other arguments.

    Raises:
        UsageError: there is none.
    """
    names, usage = list(known), f"usage: simwarp {command} TASK [options]"
    tasks = f"tasks: {', '.join(names)}"
    overview = f"{usage}\n\n{tasks}\n\n`simwarp {command} TASK --help` lists the options, which depend on the task."
    word, rest = split_subject(arguments, lambda word: word in names or TASK_FILE in word)
    if word is None and run is not None and is_run(run):
        return task_of_run(run), arguments
    return require_subject(word, arguments, overview, f"which task? {usage}; {tasks}"), rest


def split_subject(arguments: list[str], is_known: Callable[[str], bool]) -> tuple[str | None, list[str]]:
    """Split off the first argument, or the first known word where that is an option; None: there is none."""
    named = bool(arguments) and not arguments[0].startswith("-")
    index = 0 if named else next((index for index, word in enumerate(arguments) if is_known(word)), None)
    return (None, arguments) if index is None else (arguments[index], arguments[:index] + arguments[index + 1 :])


def require_subject(word: str | None, arguments: list[str], overview: str, missing: str) -> str:
    """Return a word that a command needs.

    Args:
        word: None: it is missing.
        arguments: of the command.
        overview: is printed where they ask for help without the word.
        missing: of the error.

    Raises:
        UsageError: it is missing.
        SystemExit: the overview was printed.
    """
    if word is not None:
        return word
    if HELP & set(arguments):
        print(overview)
        raise SystemExit(0)
    raise UsageError(missing)


def split_task_or_run(arguments: list[str], command: str, known: Iterable[str]) -> tuple[str, list[str]]:
    """Split TASK or the folder of a RUN off the arguments; a run is its task with ``--checkpoint RUN``.

    Raises:
        UsageError: there is none, or two policies are named.
    """
    known = list(known)
    word, arguments = split_task(arguments, command, known)
    if word in known or not is_run(word):
        return word, arguments
    if option_value(arguments, "--checkpoint") is not None:
        raise UsageError(f"run '{word}' has a policy of its own: leave --checkpoint away, or name the task")
    return task_of_run(word), [*arguments, "--checkpoint", word]


def in_shell(name: str) -> str:
    """Return a task as commands take it: its name, or file and class of one that is not installed."""
    from simwarp.tasks.framework.registry import task_word

    return shlex.quote(task_word(name))


def is_run(word: str) -> bool:
    """Return True if a word is the folder of a training run."""
    return os.path.isfile(os.path.join(word, RUN_CONFIG))


def task_of_run(folder: str) -> str:
    """Return the name of a run's task, from the file that the run remembers if it is not installed.

    Raises:
        FileError: the run's configuration cannot be read.
        InputError: its task is not there.
    """
    from simwarp.tasks.framework.registry import task_class_of

    where = os.path.join(folder, RUN_CONFIG)
    saved = read_json(where, RUN_CONFIG)
    if not isinstance(saved, dict) or not isinstance(saved.get("task"), str):
        raise UsageError(f"'{where}' is not the configuration of a run: it names no task")
    return task_class_of(saved, f"run {folder}").name


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


def check_obs(task: str, config: Any, wanted: str, option: str = "--obs") -> None:
    """Refuse observations that a task does not have.

    Raises:
        UsageError: the task has no choice, or not this one.
    """
    if not hasattr(config, "obs"):
        raise UsageError(f"task '{task}' has no choice of observations: leave {option} away")
    choices = [kind.value for kind in type(config.obs)]
    if wanted not in choices:
        raise UsageError(f"{option} of task '{task}' must be {' or '.join(choices)}, got '{wanted}'")


def _expand_full(arguments: list[str], task: str, config: Any) -> list[str]:
    flags = ("--full", "--no-full")
    used = next((word for word in arguments if word in flags), None)
    if used is not None and not hasattr(config, "full"):
        raise UsageError(f"task '{task}' has only one model of what it drives: leave {used} away")
    if used == "--full":
        from simwarp.tasks import task_class

        kind: Any = task_class(task)
        own = option_value(arguments, "--task.vehicle") is None
        # A task of another kind has neither
        if own and getattr(kind, "full_name", "") == getattr(kind, "vehicle_name", None):
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


def chosen_variant(arguments: list[str]) -> str | None:
    """Return the variant of the task that arguments choose; None if they leave it to the task."""
    return option_value(arguments, VARIANT)


def check_variant(task: str, config: Any, wanted: str | None) -> None:
    """Refuse a variant that a task does not have.

    Raises:
        UsageError: the task has no variants, or not this one.
    """
    if wanted is None:
        return
    if not hasattr(config, "variant"):
        raise UsageError(f"task '{task}' has no variants: leave {VARIANT} away")
    known = [kind.value for kind in type(config.variant)]
    if wanted not in known:
        raise UsageError(f"{VARIANT} of task '{task}' must be {' or '.join(known)}, got '{shortened(wanted)}'")


def config_of_variant(arguments: list[str], task: type[Task[Any]]) -> Any:
    """Return a task's configuration in the variant that arguments choose, else the default one.

    Raises:
        UsageError: the task has no such variant.
    """
    from simwarp.tasks import replace_fields

    config, wanted = task.config_type(), chosen_variant(arguments)
    check_variant(task.name, config, wanted)
    return config if wanted is None else replace_fields(config, {"variant": wanted})


def split_path(arguments: list[str], command: str, what: str) -> tuple[Path, list[str]]:
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
        UsageError: an option is unknown or given twice, or its value is wrong.
        SystemExit: help was asked for and printed.
    """
    if HELP & set(arguments):
        arguments = ["--help"]
    else:
        _check_words(dict(_options(kind)), arguments)
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


def parse_own(kind: type[OptionsT], arguments: list[str], program: str) -> OptionsT:
    """Parse the options of a dataclass among those of another one, before that one is known.

    Raises:
        UsageError: one is given twice, or its value is wrong.
    """
    known = dict(_options(kind))
    words: list[str] = []
    for option in _split_options(arguments):
        name = option[0].partition("=")[0].replace("_", "-")
        words += option if name in known or _positive(name) in known else []
    return parse_options(kind, words, program)


def _split_options(arguments: list[str]) -> Iterator[list[str]]:
    """Yield each option with the words that follow it."""
    starts = [index for index, word in enumerate(arguments) if word.startswith("--")]
    for start, end in itertools.pairwise([*starts, len(arguments)]):
        yield arguments[start:end]


def _check_words(known: Mapping[str, Any], arguments: list[str]) -> None:
    """Refuse options that are unknown or given twice, and words that no value of their type can be.

    Of flags, the last one counts: ``--full ... --no-full`` turns off what a script turned on.

    Raises:
        UsageError: names the option, the rule and the word.
    """
    seen: set[str] = set()
    for first, *rest in _split_options(arguments):
        name, equals, value = first.partition("=")
        option = name.replace("_", "-")
        negative = option not in known and _positive(option) in known
        if equals and (negative or is_flag(known.get(option))):
            raise UsageError(f"{option} takes no value, got '{one_line(shortened(value))}'; write {option} alone")
        if negative:
            continue
        if option not in known:
            raise UsageError(unknown_option(name, known))
        if option in seen and not may_repeat(known[option]):
            raise UsageError(f"{option} is given twice; give it once")
        seen.add(option)
        check_option(option, known[option], [value] if equals else rest)


def _positive(option: str) -> str:
    """Return the flag that ``--task.no-full`` turns off."""
    owner, dot, field = option.removeprefix("--").rpartition(".")
    return f"--{owner}{dot}{field.removeprefix('no-')}"


def unknown_option(name: str, known: Iterable[str]) -> str:
    """Return the error text for an unknown option."""
    # dashes, which all have, would make short names near to any
    bare = {option.lstrip("-"): option for option in known}
    close = [bare[each] for each in close_names(name.lstrip("-"), bare, 3)]
    hint = f"did you mean {' or '.join(close)}?" if close else "see --help"
    return f"unknown option {shortened(name)}; {hint}"


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
    where = head.removeprefix("Error parsing ")
    if where != head:
        if where.startswith("--"):
            return f"{where}: {rest.strip()}"
        owners = [owner for owner in where.split(".") if not owner.startswith(FLAT_PREFIX)]
        return f"--{'.'.join([*owners, rest.strip()])}"
    if not head.lower().startswith("unrecognized"):
        return message
    words = [word.strip(",") for word in rest.split()]
    unknown = [word.partition("=")[0] for word in words if word.startswith("-")]
    if unknown:
        return unknown_option(unknown[0], option_names(kind))
    return f"unexpected argument '{shortened(words[0] if words else rest)}'; see --help"


def option_names(kind: type[Any]) -> list[str]:
    """Return the options a dataclass has on the command line."""
    return [name for name, _ in _options(kind)]


def _options(kind: type[Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Return the options with their type hints."""
    hints = typing.get_type_hints(kind, include_extras=True)
    nested = {name: (word, inner, flat) for name, word, inner, flat in _nested(kind)}
    found: list[tuple[str, Any]] = []
    for field in dataclasses.fields(kind):
        if field.name in nested:
            word, inner, flat = nested[field.name]
            found += _options(inner, prefix if flat else f"{prefix}{word}.")
        else:
            found.append((f"--{prefix}{option_word(field.name)}", hints[field.name]))
    return found


def _nested(kind: type[Any]) -> Iterator[tuple[str, str, type[Any], bool]]:
    """Yield fields that are dataclasses: the field, its prefix, its class, whether its options have no prefix."""
    for name, hint in typing.get_type_hints(kind, include_extras=True).items():
        inner = typing.get_args(hint)[0] if hasattr(hint, "__metadata__") else hint
        if dataclasses.is_dataclass(inner) and isinstance(inner, type):
            yield name, option_word(name), inner, FLAT in getattr(hint, "__metadata__", ())
