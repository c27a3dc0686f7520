"""Recorded launches that native code makes over and over on a CPU.

A graph of Warp looks up the memory of every array of a launch whenever it is replayed: some 3 µs for a step, where the
step itself takes less than 2 µs in a small world. Here the arguments are packed once, and a kernel calls those of the
launches.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import warp as wp

from simwarp.kernels.core.launch_in_turn import launch_in_turn

WORLDS_BETWEEN_SIGNALS: Final = 2**16
"""Worlds times turns that native code goes through before Python may notice a Ctrl-C."""


class LaunchLoop:
    """Launches on a CPU, in turn.

    Args:
        launches: recorded. What is set in them afterwards has no effect.
        worlds: that they work on.
    """

    def __init__(self, launches: Sequence[wp.Launch], worlds: int) -> None:
        arguments = {id(launch): _packed(launch) for launch in launches}
        calls = [
            [
                ctypes.cast(launch.hooks.forward, ctypes.c_void_p).value,
                ctypes.addressof(launch.params[0]),
                ctypes.addressof(arguments[id(launch)]),
            ]
            for launch in launches
        ]
        table: wp.array = wp.array(np.array(calls, np.uint64), dtype=wp.uint64, device="cpu")
        command = wp.launch(launch_in_turn, 1, [table, 0], device="cpu", record_cmd=True)
        self._held = (tuple(launches), arguments, table, command)  # the calls have but their addresses
        self._arguments = _packed(command)
        self._code = command.hooks.forward
        self._given = (ctypes.byref(command.params[0]), ctypes.byref(self._arguments))
        self._most = max(1, WORLDS_BETWEEN_SIGNALS // worlds)

    def run(self, times: int) -> None:
        """Makes all launches, `times` over."""
        while times > 0:
            turns = min(times, self._most)
            self._arguments.argument_1 = turns
            self._code(*self._given)
            times -= turns


def _packed(launch: wp.Launch) -> Any:
    """The arguments of a launch behind its bounds, as kernels of a CPU take them: `argument_0`, `argument_1`, ..."""
    values = launch.params[1:]
    fields = [(f"argument_{index}", type(value)) for index, value in enumerate(values)]
    arguments = type("Arguments", (ctypes.Structure,), {"_fields_": fields})()
    for (name, _), value in zip(fields, values, strict=True):
        setattr(arguments, name, value)
    return arguments
