"""Motion functions as a tape of instructions and numbers (`motions_kernels.py`), and their values at given times."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.types import ModelError, formatted, numbers as as_numbers
from simwarp.motions.motions_kernels import (
    ADD,
    END,
    JUMP,
    LEAVE,
    MULTIPLY,
    REPEAT,
    SEQUENCE,
    MotionTape,
    evaluate_times,
)

Array: TypeAlias = npt.NDArray[np.float64]
Numbers: TypeAlias = float | Sequence[float] | Array
"""One number, or (W,) one for each world."""


class MotionValues(NamedTuple):
    """A function and its first two derivatives over time [unit of the function, per s, per s²]."""

    value: Array
    rate: Array
    acceleration: Array


class TapeWriter:
    """Writes functions one after the other.

    Args:
        worlds: rows of numbers that differ per world; None: as many as the first of them has.

    Attributes:
        names: of the numbers, empty for those that are computed from others.
    """

    def __init__(self, worlds: int | None = None) -> None:
        self._worlds = worlds
        self._code: list[list[int]] = []
        self._columns: list[Array] = []
        self.names: list[str] = []
        self._height, self._deepest = 0, 0

    def function(self, write: Callable[[TapeWriter], None]) -> int:
        """A whole function; returns its first instruction."""
        start = len(self._code)
        self._height = 0
        write(self)
        self._instruction(END)
        return start

    def leaf(self, operation: int, count: int, given: Iterable[tuple[str, Numbers]]) -> None:
        """A function without parts, with its numbers by name."""
        first = len(self._columns)
        for name, value in given:
            self._number(name, value)
        self._instruction(operation, first, count)
        self._push()

    def add(self) -> None:
        """Replaces the last two functions by their sum."""
        self._instruction(ADD)
        self._height -= 1

    def multiply(self) -> None:
        """Replaces the last two functions by their product."""
        self._instruction(MULTIPLY)
        self._height -= 1

    def repeat(self, name: str, period: Numbers, part: Callable[[TapeWriter], None]) -> None:
        """A part again and again."""
        self._number(name, period)
        self._instruction(REPEAT, len(self._columns) - 1)
        self._part(part)
        self._code[-1][2] = len(self._code)

    def sequence(self, parts: Iterable[tuple[str, Numbers, Callable[[TapeWriter], None]]]) -> None:
        """Parts one after the other, with the names of their durations."""
        listed = tuple(parts)
        first = len(self._columns)
        for name, duration, _ in listed:
            self._number(name, duration)
        self._instruction(SEQUENCE, first, len(listed))
        jumps = len(self._code)
        for _ in listed:
            self._instruction(JUMP)
        ends = []
        for k, (_, _, part) in enumerate(listed):
            self._code[jumps + k][2] = len(self._code)
            self._part(part)
            ends.append(len(self._code) - 1)
            self._height -= 1
        for end in ends:
            self._code[end][2] = len(self._code)
        self._height += 1

    def tape(self, device: Any, stacks: int, *, rows: int | None = None) -> Any:
        """The tape on a device.

        Args:
            device: where its arrays are.
            stacks: functions that are evaluated at a time.
            rows: of numbers; None: one where no number differs per world.
        """
        rows = rows or self.rows
        table = np.array([np.broadcast_to(column, (rows,)) for column in self._columns]).reshape(-1, rows)
        tape: Any = MotionTape()
        tape.code = wp.array(np.array(self._code, np.int32).reshape(-1, 3), dtype=wp.int32, device=device)
        tape.numbers = wp.array(np.ascontiguousarray(table.T), dtype=wp.float64, device=device)
        tape.stack = wp.zeros((stacks, max(self._deepest, 1)), dtype=wp.vec3d, device=device)
        return tape

    @property
    def rows(self) -> int:
        """Rows of numbers: one where none of them differs per world."""
        return max((column.size for column in self._columns), default=1)

    def _part(self, write: Callable[[TapeWriter], None]) -> None:
        """A part with a time of its own, which lies on the stack below it."""
        self._push()
        write(self)
        self._instruction(LEAVE)
        self._height -= 1

    def _push(self) -> None:
        self._height += 1
        self._deepest = max(self._deepest, self._height)

    def _instruction(self, operation: int, first: int = 0, other: int = 0) -> None:
        self._code.append([operation, first, other])

    def _number(self, name: str, value: Numbers) -> None:
        column = np.asarray(value, np.float64)
        if column.ndim:
            self._worlds = self._worlds or len(column)
            if len(column) != self._worlds:
                raise ModelError(
                    f"{name or 'function'}: must have one number, or {self._worlds}, one for each world, "
                    f"got {len(column)}; leave some out, or give more"
                )
        self._columns.append(column)
        self.names.append(name)


def evaluated(write: Callable[[TapeWriter], None], times: Any) -> MotionValues:
    """Values of a function and its derivatives, from the kernel's own code, on the CPU.

    Args:
        write: writes the function.
        times: (), (n,) for all worlds, or (W, n) [s].

    Returns:
        Arrays of the shape of `times`, with a first axis of worlds where numbers differ per world.

    Raises:
        ModelError: the times are no finite numbers.
    """
    given = as_numbers(times)
    if given.ndim > 2 or not np.isfinite(given).all():
        raise ModelError(f"evaluate: times must be finite numbers (n,) [s], got {formatted(times)}; pass a list")
    writer = TapeWriter()
    start = writer.function(write)
    table = np.ascontiguousarray(given.reshape(-1, given.shape[-1] if given.ndim else 1))
    rows = max(writer.rows, len(table))
    if len({rows, writer.rows, len(table)} - {1}) > 1:
        raise ModelError(
            f"evaluate: times must be those of all worlds, or of {writer.rows} worlds, got {len(table)} rows; "
            "pass times (n,)"
        )
    values = wp.zeros((rows, table.shape[1]), dtype=wp.vec3d, device="cpu")
    tape = writer.tape("cpu", rows * table.shape[1])
    at: Any = wp.array(table, dtype=wp.float64, device="cpu")
    wp.launch(evaluate_times, dim=values.shape, device="cpu", inputs=[start, at, tape], outputs=[values])
    found: Array = values.numpy()
    found = found.reshape(*(() if rows == 1 and given.ndim < 2 else (rows,)), *given.shape[-1:], 3)
    return MotionValues(found[..., 0], found[..., 1], found[..., 2])
