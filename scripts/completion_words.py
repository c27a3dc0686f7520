"""Words that shells complete, made of the commands' own options: `python -m scripts.completion_words` writes them.

`simwarp completions` prints from this file, so that it imports no task, no torch and no Warp.
"""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any, Final, NoReturn
from unittest import mock

import tyro

from simwarp.cli import COMMANDS
from simwarp.cli.listing import catalogue
from simwarp.cli.options import option_names
from simwarp.tasks import task_class, task_names

FILE: Final = Path(__file__).resolve().parents[1] / "simwarp" / "data" / "completions.json"
TARGETS: Final[dict[str, tuple[str, ...]]] = {
    "train": ("tasks",),
    "sweep": ("tasks",),
    "play": ("tasks",),
    "eval": ("tasks",),
    "record": ("tasks",),
    "clone": ("tasks",),
    "distill": ("tasks",),
    "view": ("tasks", "vehicles", "scenes"),
    "bench": ("scenes", "vehicles", "tasks"),
    "drive": ("vehicles",),
    "trim": ("vehicles",),
    "export-fmu": ("vehicles",),
    "reduce": ("vehicles",),
    "rig": ("rigs",),
    "completions": ("shells",),
}
"""Command -> kinds of words that may follow it; files follow all others."""
UNREAD: Final = {"fit": ["config.json"]}
"""Command -> file without which it takes other options; it is not read."""
RIGS: Final = ("tire", "suspension", "steering", "full-car")
SHELLS: Final = ("bash", "zsh", "fish")
OF_TASK: Final = "--task."


def options_of(words: list[str]) -> list[str]:
    """Return the options that a command takes after some words, sorted."""
    found: list[Any] = []

    def listen(kind: type[Any], **_: object) -> NoReturn:
        found.append(kind)
        raise SystemExit(0)

    quiet = contextlib.redirect_stdout(io.StringIO())
    with mock.patch.object(tyro, "cli", listen), quiet, contextlib.suppress(SystemExit):
        COMMANDS[words[0]].load()([*words[1:], "--help"])
    return sorted({"--help", *(name for kind in found for name in option_names(kind))})


def listed_words() -> dict[str, list[str]]:
    """Return the words of each kind."""
    tasks = sorted(kind.name for kind in map(task_class, task_names()) if kind.listed)
    vehicles = sorted(catalogue("simwarp.vehicle.spec.catalogue"))
    return {
        "tasks": tasks, "vehicles": vehicles, "scenes": sorted(catalogue("simwarp.scenes")), "rigs": list(RIGS),
        "shells": list(SHELLS),
    }  # fmt: skip


def completions() -> dict[str, Any]:
    """Return the content of the file."""
    words = listed_words()
    commands, of_task = {}, {}
    for name in COMMANDS:
        kinds = TARGETS.get(name, ())
        first = [words[kinds[0]][0]] if kinds and kinds != ("shells",) else UNREAD.get(name, [])
        found = options_of([name, *first])
        commands[name] = {"words": kinds, "options": [option for option in found if not option.startswith(OF_TASK)]}
    for task in words["tasks"]:
        of_task[task] = [option for option in options_of(["train", task]) if option.startswith(OF_TASK)]
    return {"words": words, "commands": commands, "tasks": of_task}


def text(content: dict[str, Any]) -> str:
    """Return JSON with a line for each entry, for people who compare."""
    sections = []
    for section, entries in content.items():
        rows = ",\n".join(f"  {json.dumps(name)}: {json.dumps(entry)}" for name, entry in entries.items())
        sections.append(f" {json.dumps(section)}: {{\n{rows}\n }}")
    return "{\n" + ",\n".join(sections) + "\n}\n"


def main() -> None:
    """Write the file."""
    FILE.write_text(text(completions()), encoding="utf-8")
    print(f"wrote {FILE.relative_to(FILE.parents[2])}")


if __name__ == "__main__":
    main()
