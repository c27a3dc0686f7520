"""What commands refuse before they import what they compute with.

Torch, Warp and the kernels take seconds to import. Arguments that are wrong whatever these hold are answered in tenths
of a second: a task, a format, a file that is not there. The rules are those that the commands hold to afterwards; what
only their imports know, such as tasks of other packages and the options of a task, is left to them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from simwarp.cli import UsageError
from simwarp.cli.options import TASK_FILE, is_run, option_value, parse_own, split_path, split_subject
from simwarp.task_names import built_in_tasks, known_tasks, unknown_task


def refuse_early(command: str, arguments: list[str]) -> None:
    """Refuse arguments of a command that are wrong, as far as they can be known yet.

    Raises:
        UsageError, InputError, FileError, ModelError: they are.
    """
    if command in _REFUSALS:
        _REFUSALS[command](arguments)


def _split_task(arguments: list[str]) -> tuple[str | None, list[str]]:
    """Split the task off the arguments; None: it is of a file, of another package or a run.

    Where none is found, the task may be any word among the others, and nothing is left to be looked at.
    """
    names = built_in_tasks()
    word, rest = split_subject(arguments, lambda word: word in names or TASK_FILE in word)
    if word is None or word in names:
        return word, [] if word is None else rest
    known = None if ":" in word or word.endswith(".py") or is_run(word) else known_tasks()
    if known is not None:
        raise unknown_task(word, known)
    return None, rest


def _of_task(arguments: list[str]) -> None:
    _split_task(arguments)


def _recording(arguments: list[str]) -> None:
    """Of commands that take no other records than messages."""
    record = option_value(arguments, "--record")
    if record is not None:
        from simwarp.mcap.mcap_extra import check_mcap_path

        check_mcap_path(record)


def _recording_of_task(arguments: list[str]) -> None:
    _of_task(arguments)
    _recording(arguments)


def _view(arguments: list[str]) -> None:
    from simwarp.cli.view.view_target import find_target
    from simwarp.mcap.mcap_extra import SUFFIX

    find_target(str(split_path(arguments, "view", "TARGET")[0]))
    if Path(option_value(arguments, "--record") or "").suffix.lower() == SUFFIX:
        _recording(arguments)


def _record(arguments: list[str]) -> None:
    from simwarp.cli.imitation.dataset_options import RecordOptions

    name, arguments = _split_task(arguments)
    parse_own(RecordOptions, arguments, "simwarp record").check_record(name)


def _clone(arguments: list[str]) -> None:
    from simwarp.cli.imitation.dataset_options import CloneOptions
    from simwarp.train.datasets.dataset_kinds import check_source

    name, arguments = _split_task(arguments)
    options = parse_own(CloneOptions, arguments, "simwarp clone")
    if options.data is not None:
        check_source(options.data, name or "TASK")
    elif name is not None:
        raise UsageError(f"which trajectories? usage: simwarp clone {name} --data FILE_OR_FOLDER")
    options.check(options.data, output=options.output)


def _ros2(arguments: list[str]) -> None:
    from simwarp.cli.ros.ros2_options import Ros2Options, split_ros
    from simwarp.cli.view.view_target import find_target
    from simwarp.ros2.rclpy_node import check_rclpy

    name, arguments = split_path(arguments, "ros2", "TARGET")
    kind = find_target(str(name)).kind
    parse_own(Ros2Options, split_ros(arguments)[0], f"simwarp ros2 {name}").check_bridge(kind)
    check_rclpy()


_REFUSALS: Final[Mapping[str, Callable[[list[str]], None]]] = {
    "train": _of_task, "sweep": _of_task, "distill": _of_task, "play": _recording_of_task, "eval": _recording_of_task,
    "record": _record, "clone": _clone, "drive": _recording, "view": _view, "ros2": _ros2,
}  # fmt: skip
