"""Exceptions that mean something else outside of a task's method, and would end a program or a loop without a word.

``SystemExit`` ends the process in silence, ``StopIteration`` and ``GeneratorExit`` end a loop that knows nothing of
the task. ``KeyboardInterrupt`` stays what it is.
"""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, Final

from .errors import TaskStepError, broken

ESCAPES: Final = (SystemExit, GeneratorExit, StopIteration, StopAsyncIteration)
HOOKS: Final = (
    "apply", "observations", "rewards", "terminations", "truncations", "metrics", "reset", "begin_step",
    "after_physics", "on_iteration", "privileged", "observations_of", "extra_state", "load_extra_state", "step_limit",
    "map_position", "drawing", "mirror", "commands", "setup", "build", "attach", "solver_options", "visuals", "scene",
    "shot", "lighting",
)  # fmt: skip
"""Methods that a task's author writes."""


def escape_of(error: BaseException) -> TaskStepError | None:
    """Return the error of a task whose method let one of ``ESCAPES`` out; None where no method of a task did.

    What a handler of a signal raises while a method runs is the program's own.
    """
    handlers, found = _handlers(), None
    trace = error.__traceback__
    while trace is not None:
        frame = trace.tb_frame
        if frame.f_code in handlers:
            return None
        if found is None:
            task, method = _hook(frame)
            if method:
                found = task, method, f"{Path(frame.f_code.co_filename).name}, line {trace.tb_lineno}"
        trace = trace.tb_next
    if found is None:
        return None
    task, method, place = found
    raised = f"{type(error).__name__}({', '.join(map(repr, error.args))})"
    return broken(
        task, method, f"raised {raised} ({place}), a task must not; raise another exception, such as ValueError"
    )


def raise_named(error: BaseException) -> None:
    """Raise the error of the task whose method let ``error`` out; return where none did.

    Raises:
        TaskStepError: names the method.
    """
    named = escape_of(error)
    if named is not None:
        raise named  # without a cause: contextlib takes an error caused by StopIteration for that itself


@contextlib.contextmanager
def named_escapes() -> Iterator[None]:
    """Context in which a method of a task is called: what it lets out is named."""
    try:
        yield
    except ESCAPES as error:
        raise_named(error)
        raise


def _hook(frame: FrameType) -> tuple[Any, str]:
    """Return task and name of the method that a frame runs; no name where it is none of a task."""
    first = frame.f_code.co_varnames[:1]
    owner = frame.f_locals.get(first[0]) if first else None
    if not hasattr(type(owner), "task_file"):  # only classes of tasks have it
        return None, ""
    return owner, next((name for name in HOOKS if _code(getattr(type(owner), name, None)) is frame.f_code), "")


def _code(function: Any) -> CodeType | None:
    code: CodeType | None = getattr(getattr(function, "__func__", function), "__code__", None)
    return code


def _handlers() -> set[CodeType]:
    found = {_code(signal.getsignal(number)) for number in signal.valid_signals()}
    return {code for code in found if code is not None}
