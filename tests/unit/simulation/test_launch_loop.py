"""Launches that native code makes: in turn, as often as asked for, with the arguments that they were recorded with."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from simwarp.core.array_devices import refuse_strided_arguments
from simwarp.core.types import ModelError
from simwarp.kernels.core.world_range import WorldRange
from simwarp.simulation import launch_loop
from simwarp.simulation.world_launches import WorldProgram, WorldShares


@wp.kernel(enable_backward=False)
def double_it(worlds: WorldRange, value: wp.array[wp.int64]):
    world = worlds.first + wp.tid()  # type: ignore[operator]
    value[world] = wp.int64(2) * value[world]  # type: ignore[index]


@wp.kernel(enable_backward=False)
def add_to_it(worlds: WorldRange, amount: int, value: wp.array[wp.int64]):
    world = worlds.first + wp.tid()  # type: ignore[operator]
    value[world] = value[world] + wp.int64(amount)  # type: ignore[index]


def run(threads: int, times: int, blocks: list[tuple[str, int]]) -> np.ndarray:
    """Five worlds after `times` turns of blocks such as ("da", 2): double, add, double, add."""
    device = wp.get_device("cpu")
    value: wp.array = wp.array(np.arange(5), dtype=wp.int64, device=device)
    shares = WorldShares(5, threads, device)
    kinds = {
        "d": shares.record(double_it, inputs=[value]), "a": shares.record(add_to_it, inputs=[1, value]),
        "b": shares.record(add_to_it, inputs=[7, value]),
    }  # fmt: skip
    program = WorldProgram(shares, [(tuple(kinds[letter] for letter in text), turns) for text, turns in blocks])
    program.run(times)
    assert shares.launches == times * sum(len(text) * turns for text, turns in blocks)
    return value.numpy()


def expected(times: int, blocks: list[tuple[str, int]]) -> np.ndarray:
    value = np.arange(5)
    for letter in "".join(text * turns for text, turns in blocks) * times:
        value = 2 * value if letter == "d" else value + {"a": 1, "b": 7}[letter]
    return value


@pytest.mark.parametrize("blocks", [[("d", 1)], [("da", 2)], [("dab", 1), ("bd", 3), ("dab", 1)]])
@pytest.mark.parametrize("threads", [1, 2, 7])
@pytest.mark.parametrize("times", [0, 1, 3])
def test_launches_come_in_turn(blocks, threads, times):
    assert run(threads, times, blocks).tolist() == expected(times, blocks).tolist()


def test_python_may_notice_a_signal_in_between(monkeypatch):
    """A call of native code has a bounded number of turns: here one, of the five worlds."""
    monkeypatch.setattr(launch_loop, "WORLDS_BETWEEN_SIGNALS", 5)
    assert run(1, 4, [("da", 1)]).tolist() == expected(4, [("da", 1)]).tolist()


def test_other_launches_keep_their_arguments():
    """Two launches of one kernel have arguments of their own; what one is given later changes neither."""
    device = wp.get_device("cpu")
    first, second = (wp.zeros(3, dtype=wp.int64, device=device) for _ in range(2))
    shares = WorldShares(3, 1, device)
    commands = tuple(shares.record(add_to_it, inputs=[amount, array]) for amount, array in ((1, first), (10, second)))
    program = WorldProgram(shares, [(commands, 1)])
    program.run(2)
    commands[0].use(1, second)
    program.run(1)
    assert first.numpy().tolist() == [3, 3, 3]
    assert second.numpy().tolist() == [30, 30, 30]


def test_arrays_with_steps_are_refused():
    """The fused kernels do not multiply an index of the last axis by its stride."""
    value = wp.zeros((3, 4), dtype=wp.int64, device="cpu")
    refuse_strided_arguments(add_to_it, [None, 1, value[:, 0:2]])
    with pytest.raises(ModelError, match="add_to_it: value must be contiguous along its last axis, got strides"):
        refuse_strided_arguments(add_to_it, [None, 1, value[:, 0]])
