"""``simwarp replay``."""

from __future__ import annotations

import dataclasses
from typing import Any

from simwarp.cli import DONE, FELL_SHORT
from simwarp.cli.options import CommonOptions, parse_options, split_path


@dataclasses.dataclass(frozen=True)
class ReplayOptions(CommonOptions):
    """Repeat the steps before the physics of a world broke down, from the file that its run kept.

    Exit code 1 where it does not break down again.
    """

    device: str = "cpu"
    """cpu, cuda, cuda:N or auto."""


def run(arguments: list[str]) -> int:
    """Replay as the arguments say."""
    path, arguments = split_path(arguments, "replay", "FILE")
    options = parse_options(ReplayOptions, arguments, "simwarp replay FILE")
    options.check(path)
    from simwarp.tasks.framework.replay import replay

    report: dict[str, Any] = dataclasses.asdict(replay(path, device=options.device))
    console = options.console()
    for name, value in report.items():
        words = ", ".join(map(str, value)) or "none" if isinstance(value, list) else value
        console.print(f"{name.replace('_', ' '):<20} {words}", highlight=False, markup=False, soft_wrap=True)
    options.emit(report)
    return DONE if report["reproduced"] else FELL_SHORT
