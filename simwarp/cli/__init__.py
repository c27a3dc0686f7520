"""The ``simwarp`` command: a table of sub-commands, each loaded only when it is called.

Exit codes: 0 done; 1 it ran and fell short; 2 wrong input, one line on standard error (``--debug`` shows the
traceback); 130 interrupted.
"""

from __future__ import annotations

import dataclasses
import difflib
import importlib
import importlib.util
import os
import sys
from collections.abc import Callable, Sequence

from simwarp.cli.quiet import start_warp

DONE, FELL_SHORT, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130


@dataclasses.dataclass(frozen=True)
class Command:
    """One sub-command.

    Attributes:
        name: what the user types.
        usage: its arguments, for the overview.
        summary: one line.
        target: ``module:function`` that takes the remaining arguments and returns an exit code.
    """

    name: str
    usage: str
    summary: str
    target: str

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
        Command("list", "", "tasks, vehicles, sensors and scenes, one line each", "simwarp.cli.listing:run"),
        Command("train", "TASK", "train a policy, with live progress and a run folder", "simwarp.cli.training:run"),
        Command("play", "TASK", "a picture or a short video of a policy at work", "simwarp.cli.playing:run"),
        Command("eval", "TASK", "statistics of a policy over fresh worlds", "simwarp.cli.evaluating:run"),
        Command("export", "RUN", "a policy as an ONNX or TorchScript file, checked", "simwarp.cli.export:run"),
        Command("record", "TASK", "episodes of a policy as a file of trajectories", "simwarp.cli.record:run"),
        Command("clone", "TASK", "a policy that imitates recorded trajectories", "simwarp.cli.clone:run"),
        Command("new-task", "NAME", "a package with a task of your own, ready to change", "simwarp.cli.new_task:run"),
        Command("replay", "FILE", "the steps before a world broke down, once more", "simwarp.cli.replay:run"),
        Command("bench", "SCENE", "speed of a scene, a vehicle or a task", "simwarp.cli.bench:main"),
        Command("drive", "VEHICLE", "a manoeuvre with a vehicle: results, CSV, plots", "simwarp.cli.drive:run"),
        Command("sensor-demo", "", "one picture of what all kinds of sensors see", "simwarp.cli.sensor_demo:run"),
        Command("verify", "[SCENE ...]", "physics against known answers", "simwarp.cli.verify:main"),
        Command("doctor", "", "device, versions, driver, kernel cache, and what is wrong", "simwarp.cli.doctor:run"),
    )
}


class UsageError(ValueError):
    """The command line itself is wrong; the message is one line."""


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
        ("simwarp.types", ("ModelError",)),
        ("simwarp.files", ("FileError",)),
        ("simwarp.vehicle.spec_parts", ("SpecError",)),
        ("simwarp.tasks.errors", ("InputError", "TaskError")),
    ):
        loaded = sys.modules.get(module)
        kinds += [getattr(loaded, name) for name in names if hasattr(loaded, name)]
    return tuple(kinds)


def _is_shortfall(error: Exception) -> bool:
    """Return whether the work began and could not be brought to its end: learning diverged, or a disk is full."""
    kinds = (("simwarp.train.trainer", "TrainingError"), ("simwarp.files", "OutputError"))
    return any(name in sys.modules and isinstance(error, getattr(sys.modules[name], kind)) for name, kind in kinds)


def one_line(text: str) -> str:
    """Return a message without line breaks."""
    return " ".join(text.split())


def _find(name: str) -> Command:
    if name in COMMANDS:
        return COMMANDS[name]
    close = difflib.get_close_matches(name, COMMANDS, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(close)}?" if close else f"commands: {', '.join(COMMANDS)}"
    raise UsageError(f"unknown command '{name}'; {hint}")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in arguments
    try:
        if not arguments or arguments[0] in ("-h", "--help"):
            print(overview())
            return DONE if arguments else WRONG_INPUT
        if arguments[0] == "--version":
            from importlib.metadata import version

            print(f"simwarp {version('simwarp')}")
            return DONE
        run = _find(arguments[0]).load()
        if not {"-h", "--help"} & set(arguments):
            start_warp()
        return run(arguments[1:])
    except SystemExit as stop:
        # Argument parsers leave this way; their message is out already
        if isinstance(stop.code, str):
            print(f"simwarp: {one_line(stop.code)}", file=sys.stderr)
            return WRONG_INPUT
        return stop.code or DONE
    except KeyboardInterrupt:
        print("simwarp: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of a pipe went away, as `simwarp list | head` does; Python would complain while it exits
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except Exception as error:
        wrong_input = isinstance(error, input_errors())
        if debug or not (wrong_input or _is_shortfall(error)):
            raise
        print(f"simwarp: {one_line(str(error))}", file=sys.stderr)
        return WRONG_INPUT if wrong_input else FELL_SHORT
