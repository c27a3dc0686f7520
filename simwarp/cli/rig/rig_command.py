"""``simwarp rig tire|suspension|steering|full-car NAME or FILE``."""

from __future__ import annotations

import importlib
from typing import Final

from simwarp.cli import HELP, UsageError, shortened
from simwarp.core.wording import suggestions

RIGS: Final = {
    "tire": ("forces of tires over slip, slip angle, inclination and load", "tire_command"),
    "suspension": ("wheel angles, levers and rates of an axle over its travel", "axle_commands"),
    "steering": ("wheel angles over the handwheel, Ackermann, turning circle", "axle_commands"),
    "full-car": ("a vehicle on four posts or a tilt table", "full_car_command"),
}
USAGE: Final = "usage: simwarp rig tire|suspension|steering|full-car NAME|FILE [options]"


def run(arguments: list[str]) -> int:
    """Run the rig that the first argument names."""
    if not arguments or arguments[0] in HELP:
        if not arguments:
            raise UsageError(f"which rig? {USAGE}")
        width = max(map(len, RIGS))
        print(USAGE, *(f"  {name:<{width}}  {text}" for name, (text, _) in RIGS.items()), sep="\n")
        print("\n`simwarp rig tire --help` lists the options of a rig.")
        return 0
    rig, *rest = arguments
    if rig not in RIGS:
        hint = suggestions(rig, RIGS, f"rigs: {', '.join(RIGS)}")
        raise UsageError(f"unknown rig '{shortened(rig)}'; {hint}")
    module = importlib.import_module(f"simwarp.cli.rig.{RIGS[rig][1]}")
    if HELP & set(rest):
        return int(getattr(module, f"run_{rig.replace('-', '_')}")("", ["--help"]))
    if not rest or rest[0].startswith("-"):
        raise UsageError(f"which vehicle? usage: simwarp rig {rig} NAME|FILE [options]; `simwarp list` shows them")
    return int(getattr(module, f"run_{rig.replace('-', '_')}")(rest[0], rest[1:]))
