"""The ``simwarp`` command: a table of sub-commands, each loaded only when it is called.

Exit codes: 0 done; 1 it ran and fell short; 2 wrong input, one line on standard error (``--debug`` shows the
traceback); 130 interrupted.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import importlib.util
import os
import sys
from collections.abc import Callable, Sequence

from simwarp.cli.early.lighter_imports import FULL, few_collections, leave_unused_out, run_in_full, stand_ins
from simwarp.cli.process import leave, leave_at_once, prepare_streams, silence_output
from simwarp.core.stopping import exit_at_signals, interrupted_by_signals
from simwarp.core.wording import suggestions

DONE, FELL_SHORT, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130
HELP = frozenset({"-h", "--help"})


@dataclasses.dataclass(frozen=True)
class Command:
    """One sub-command.

    Attributes:
        name: word that the user types.
        usage: its arguments, for the overview.
        summary: one line.
        target: ``module:function`` that takes the remaining arguments and returns an exit code.
        reads_only: it prints what classes say of themselves, and simulates nothing.
    """

    name: str
    usage: str
    summary: str
    target: str
    reads_only: bool = False

    def load(self) -> Callable[[list[str]], int]:
        """Import the function that runs the command."""
        module, _, function = self.target.partition(":")
        if importlib.util.find_spec(module) is None:
            raise UsageError(f"command '{self.name}' is not part of this installation (no module {module})")
        loaded: Callable[[list[str]], int] = getattr(importlib.import_module(module), function)
        return loaded


COMMANDS = {
    command.name: command
    for command in (
        Command("list", "", "tasks, vehicles, sensors and scenes, one line each", "simwarp.cli.listing:run", True),
        Command("train", "TASK", "train a policy, with live progress and a run folder", "simwarp.cli.training:run"),
        Command("sweep", "TASK", "trainings over seeds and settings, compared", "simwarp.cli.training_sweep:run"),
        Command("play", "TASK", "a picture or a short video of a policy at work", "simwarp.cli.playing:run"),
        Command("view", "TARGET", "a page in the browser that shows it move", "simwarp.cli.view.view_command:run"),
        Command("ros2", "TARGET", "topics, clock and commands of ROS 2", "simwarp.cli.ros.ros2_command:run"),
        Command("eval", "TASK", "statistics of a policy over fresh worlds", "simwarp.cli.evaluation.evaluating:run"),
        Command("export", "RUN", "a policy as an ONNX or TorchScript file, checked", "simwarp.cli.export:run"),
        Command("record", "TASK", "episodes of a policy as a file of trajectories", "simwarp.cli.imitation.record:run"),
        Command("clone", "TASK", "a policy that imitates recorded trajectories", "simwarp.cli.imitation.clone:run"),
        Command(
            "distill", "TASK", "a student learns from a teacher that sees more", "simwarp.cli.imitation.distill:run"
        ),
        Command("import", "FILE", "a robot from MJCF, URDF, USD, STEP, SolidWorks", "simwarp.cli.robots.importing:run"),
        Command("new-task", "NAME", "a package with a task of your own, ready to change", "simwarp.cli.new_task:run"),
        Command("replay", "FILE", "the steps before a world broke down, once more", "simwarp.cli.replay:run"),
        Command("bench", "SCENE", "speed of a scene, a vehicle or a task", "simwarp.cli.benching:run"),
        Command(
            "drive", "VEHICLE", "a manoeuvre with a vehicle: results, CSV, plots", "simwarp.cli.drive.drive_command:run"
        ),
        Command("export-fmu", "VEHICLE", "a vehicle as an FMU for other simulators", "simwarp.cli.fmu_command:run"),
        Command("fit", "CONFIG", "parameters of a model from recorded runs", "simwarp.cli.fit_command:run"),
        Command("trim", "VEHICLE", "how a vehicle stands; springs and tie rods for it", "simwarp.cli.trim_command:run"),
        Command(
            "reduce",
            "VEHICLE",
            "a vehicle of fourteen degrees of freedom that moves alike",
            "simwarp.cli.reduce_command:run",
        ),
        Command(
            "rig",
            "RIG NAME",
            "a rig: tires, suspensions, steerings, posts, tilt table",
            "simwarp.cli.rig.rig_command:run",
        ),
        Command("sensor-demo", "", "one picture of what all kinds of sensors see", "simwarp.cli.sensor_demo:run"),
        Command("verify", "[SCENE ...]", "physics against known answers", "simwarp.cli.verifying:run"),
        Command("doctor", "", "device, versions, driver, kernel cache, and what is wrong", "simwarp.cli.doctor:run"),
        Command("completions", "SHELL", "completion of words for bash, zsh, fish", "simwarp.cli.completions:run", True),
    )
}


class UsageError(ValueError):
    """The command line itself is wrong; the message is one line."""


class ShortfallError(RuntimeError):
    """The command ran and could not be brought to its end; the message is one line."""


def overview() -> str:
    """Return the help text of ``simwarp`` alone."""
    width = max(len(f"{command.name} {command.usage}") for command in COMMANDS.values())
    lines = [f"  {f'{command.name} {command.usage}':<{width}}  {command.summary}" for command in COMMANDS.values()]
    return "\n".join(
        [
            "usage: simwarp COMMAND ...",
            "",
            *lines,
            "",
            "`simwarp COMMAND --help` lists the options of a command. All take --debug (show tracebacks).",
        ]
    )


def input_errors() -> tuple[type[Exception], ...]:
    """Return the exceptions that mean wrong input.

    Looked up among the loaded modules: one that was never imported cannot have been raised, and importing the task
    layer only to name its error would cost seconds.
    """
    kinds: list[type[Exception]] = [UsageError]
    for module, names in (
        ("simwarp.core.types", ("ModelError",)),
        ("simwarp.core.files", ("FileError",)),
        ("simwarp.core.wording", ("InputError",)),
        ("simwarp.vehicle.spec.parts", ("SpecError",)),
        ("simwarp.identify.fit_error", ("FitError",)),
        ("simwarp.tasks.framework.errors", ("TaskError",)),
    ):
        loaded = sys.modules.get(module)
        kinds += [getattr(loaded, name) for name in names if hasattr(loaded, name)]
    return tuple(kinds)


def exit_code_of(error: BaseException) -> int | None:
    """Return the exit code that goes with one line about an error; None for a mistake of ours."""
    if _is_shortfall(error):
        return FELL_SHORT
    if isinstance(error, input_errors()) or _is_out_of_memory(error):
        return WRONG_INPUT
    # Whatever the operating system refuses is no mistake of ours either: a full disk, a stream that ended
    return FELL_SHORT if isinstance(error, OSError) else None


def _is_shortfall(error: BaseException) -> bool:
    """Return True if the work began and could not be brought to its end: learning diverged, a disk is full, a task
    broke its contract in a step.
    """
    kinds = (
        ("simwarp.train.algorithm.learner", "TrainingError"),
        ("simwarp.core.files", "OutputError"),
        ("simwarp.tasks.framework.errors", "TaskStepError"),
        (__name__, "ShortfallError"),
    )
    return any(name in sys.modules and isinstance(error, getattr(sys.modules[name], kind)) for name, kind in kinds)


def _is_out_of_memory(error: BaseException) -> bool:
    """Return True if an allocation failed; Warp and torch report it as text."""
    words = ("Failed to allocate", "can't allocate memory", "out of memory")
    return isinstance(error, MemoryError) or (
        isinstance(error, RuntimeError) and any(word in str(error) for word in words)
    )


LONGEST_MESSAGE = 2000
"""Characters of an error that are printed: a file may hold a key of a megabyte."""


def one_line(text: str) -> str:
    """Return a message without line breaks and control characters, and not longer than people read."""
    words = " ".join(text[: 4 * LONGEST_MESSAGE].split())
    line = "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in words)
    return line if len(line) <= LONGEST_MESSAGE else f"{line[:LONGEST_MESSAGE]} ..."


def explanation(error: BaseException) -> str:
    """Return one line about an error that has an exit code."""
    if _is_out_of_memory(error):
        return f"not enough memory: {one_line(str(error)) or 'an allocation failed'}; use fewer worlds or less data"
    if isinstance(error, OSError) and error.strerror and not isinstance(error, input_errors()):
        place = "standard output" if error.filename is None else f"'{error.filename}'"
        return f"cannot write or read {place}: {error.strerror}"
    return one_line(str(error))


def _find(name: str) -> Command:
    if name in COMMANDS:
        return COMMANDS[name]
    # short words are near to many others: half of their letters in common is no likeness
    hint = suggestions(name, COMMANDS, f"commands: {', '.join(COMMANDS)}", cutoff=0.7)
    raise UsageError(f"unknown command '{shortened(name)}'; {hint}")


def shortened(text: str) -> str:
    """Return a received text as an error shows it."""
    return text if len(text) <= LONGEST_SHOWN else f"{text[:40]}... ({len(text)} characters)"


LONGEST_SHOWN = 100


def check_words(arguments: Sequence[str]) -> None:
    """Refuse arguments that are no text: empty ones, and those that no file name or number could be.

    Raises:
        UsageError: names the argument.
    """
    for index, word in enumerate(arguments):
        before = arguments[index - 1] if index else ""
        place = f"argument {index + 1}" + (f", after '{shortened(before)}'," if before else "")
        option = shortened(before) if before.startswith("--") else place
        if word.startswith("--") and word.endswith("=") and word.count("=") == 1:
            option, word = shortened(word[:-1]), ""
        if not word:
            raise UsageError(f"{option} must not be empty; give a value, or leave it away")
        if "\0" in word:
            raise UsageError(f"{option} must not hold a NUL byte, got {shortened(word)!r}")
        try:
            word.encode()
        except UnicodeEncodeError:
            raise UsageError(f"{option} must be UTF-8 text, got {shortened(word)!r}") from None


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    Args:
        argv: its words; those of this process by default.
    """
    alone = argv is None
    if alone:
        prepare_streams()
    with interrupted_by_signals() as requested:
        try:
            return _explained(list(sys.argv[1:] if argv is None else argv), alone=alone)
        except (KeyboardInterrupt, Exception) as error:
            if not isinstance(error, KeyboardInterrupt) and not requested():
                raise
            if alone:
                exit_at_signals(INTERRUPTED)
            code = _report_failure("interrupted", INTERRUPTED)
            if alone:
                leave_at_once(code)
            return code


def _explained(arguments: list[str], *, alone: bool) -> int:
    """Run the command that the arguments name; an error that has an exit code is one line."""
    try:
        code = _run(arguments, alone=alone)
        if sys.stdout is not None:
            sys.stdout.flush()
        if alone:
            exit_at_signals(code)
            leave(code)
        return code
    except SystemExit as stop:
        # Argument parsers leave this way, their message is out already; and rich, when the reader of a pipe went away
        if isinstance(stop.__context__, BrokenPipeError):
            return DONE
        left = _left_by_task(stop)
        if left:
            return _report_failure(left, FELL_SHORT)
        if isinstance(stop.code, str):
            return _report_failure(stop.code, WRONG_INPUT)
        return stop.code or DONE
    except BrokenPipeError:
        # The reader of a pipe went away, as `simwarp list | head` does
        silence_output()
        return DONE
    except Exception as error:
        code_of = exit_code_of(error)
        if code_of is None or "--debug" in arguments:
            raise
        return _report_failure(explanation(error), code_of)


def _left_by_task(stop: SystemExit) -> str:
    """Return the message on a task whose method ends the process; empty where none did."""
    escapes = sys.modules.get("simwarp.tasks.framework.escapes")
    named = None if escapes is None else escapes.escape_of(stop)
    return "" if named is None else str(named)


def _report_failure(text: str, code: int) -> int:
    """Print the one line of a command that did not do what was asked, and return its exit code."""
    with contextlib.suppress(OSError):
        print(f"simwarp: {one_line(text)}", file=sys.stderr, flush=True)
    silence_output()
    return code


def _run(arguments: list[str], *, alone: bool) -> int:
    """Run the command that the arguments name; `alone`: the process is there for nothing else."""
    if not arguments or arguments[0] in HELP:
        print(overview())
        return DONE if arguments else WRONG_INPUT
    if HELP & set(arguments):
        return _read(lambda: _help(_find(arguments[0]).load(), arguments[1:]), arguments, alone=alone)
    check_words(arguments)
    if arguments[0] == "--version":
        from importlib.metadata import version

        print(f"simwarp {version('simwarp')}")
        return DONE
    command = _find(arguments[0])
    if command.reads_only:
        return _read(lambda: command.load()(arguments[1:]), arguments, alone=alone)
    importlib.import_module("simwarp.cli.early.early_refusals").refuse_early(command.name, arguments[1:])
    if alone:
        leave_unused_out()
    with few_collections():
        run = command.load()
        # Warp takes a while to import: help texts do without
        from simwarp.core.warp_start import cache_trouble, start_warp

        try:
            start_warp()
        except OSError as error:
            raise ShortfallError(cache_trouble(error)) from error
    return run(arguments[1:])


def _read(run: Callable[[], int], arguments: list[str], *, alone: bool) -> int:
    """Run what only prints what classes say, without the packages that they compute with if that is possible."""
    if not alone or os.environ.get(FULL):
        return run()
    with stand_ins():
        try:
            return run()
        except Exception as error:  # a module did more with a stand-in than it can bear, or has a fault of its own
            if exit_code_of(error) is not None and type(error).__name__ != "TaskFileError":
                raise
            return run_in_full(arguments)


def _help(run: Callable[[list[str]], int], words: list[str]) -> int:
    """Print the help of a command. Its defaults may depend on other words, which are left out where they are wrong."""
    try:
        return run(words)
    except input_errors():
        subject = [word for word in words[:1] if not word.startswith("-")]
        return run([*subject, "--help"])
