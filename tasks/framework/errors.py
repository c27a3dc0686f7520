"""Errors of the task and training layers."""

from __future__ import annotations

from typing import Any

from simwarp.core.object_repr import plural
from simwarp.core.wording import InputError as InputError, near_names as near_names


class TaskFileError(InputError):
    """A task that is not installed cannot be had from its file."""


class TaskError(RuntimeError):
    """A task broke its contract (shape, dtype, NaN); the message names the task and the term."""


class TaskStepError(TaskError):
    """A task that was built broke its contract later on; the message names method, worlds, step, expected and got.

    The command line exits with code 1: the work began, and could not be brought to its end.
    """


def broken(task: Any, method: str, what: str) -> TaskStepError:
    """Return the error of a method that broke the contract.

    Args:
        task: whose it is; it may not be built yet.
        method: its name.
        what: it did.
    """
    contract = getattr(task, "contract", None)
    step = 0 if contract is None else contract.step
    when = f"in control step {step}" if step else "before the first control step"
    call = method if "(" in method else f"{method}()"
    return TaskStepError(f"task '{task.name}': {call} {when} of {plural(task.num_worlds, 'world')}: {what}")
