"""The number of threads: what is asked for, the environment, the processors that a process may use."""

from __future__ import annotations

import os

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.core.threads import MOST_THREADS, VARIABLE, thread_count
from simwarp.simulation.world_launches import BLOCK_VARIABLE, block_threads


@pytest.fixture
def processors(monkeypatch: pytest.MonkeyPatch) -> int:
    """A process that may use three processors of a larger machine, and no variable."""
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {1, 4, 6}, raising=False)
    return 3


def test_by_default_all_processors_that_the_process_may_use(processors: int) -> None:
    assert thread_count() == processors


def test_processes_on_one_machine_share_its_processors(processors: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert [thread_count(processes=count) for count in (1, 2, 3, 4)] == [3, 1, 1, 1]
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(16)))
    assert thread_count(processes=8) == 2
    assert thread_count(5, processes=8) == 5
    monkeypatch.setenv(VARIABLE, "7")
    assert thread_count(processes=8) == 7


def test_where_a_system_does_not_tell_them_those_of_the_machine(
    processors: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 5)
    assert thread_count() == 5
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert thread_count() == 1


def test_more_processors_than_threads_can_be_asked_for(processors: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(4096)))
    assert thread_count() == MOST_THREADS


def test_the_variable_comes_before_the_processors_and_the_argument_before_both(
    processors: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "7")
    assert thread_count() == 7
    assert thread_count(2) == 2
    assert thread_count(np.int64(2)) == 2  # type: ignore[arg-type]
    monkeypatch.setenv(VARIABLE, "")
    assert thread_count() == processors


@pytest.mark.parametrize("threads", [0, -1, 1025, 10**400, True, 2.0, "2", float("nan"), (1,)])
def test_numbers_that_are_refused(threads: object) -> None:
    with pytest.raises(sw.ModelError, match=r"^threads must be a whole number from 1 to 1024, got .*; leave it away"):
        thread_count(threads)  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["0", "-1", "1025", "two", "2.0", " 2", "9" * 5000, "²"])
def test_values_of_the_variable_that_are_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, text)
    with pytest.raises(sw.ModelError, match=r"^SIMWARP_THREADS must be a whole number from 1 to 1024, got ") as caught:
        thread_count()
    assert str(caught.value).isprintable()
    assert str(caught.value).endswith("; unset it for as many as there are processors")
    assert thread_count(1) == 1


@pytest.mark.parametrize("text", ["0", "-32", "1025", "wide", "32.0", " 64", "9" * 5000, "²"])
def test_sizes_of_blocks_that_are_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(BLOCK_VARIABLE, text)
    model = scenes.pendulum().finalize(1, "cpu")
    with pytest.raises(
        sw.ModelError, match=r"^SIMWARP_BLOCK_DIM must be a whole number from 1 to 1024, got "
    ) as caught:
        sw.Simulation(model, 1e-3)
    assert str(caught.value).isprintable()
    assert str(caught.value).endswith("; unset it for 32")


@pytest.mark.parametrize("text", ["1", "16", "48", "1000"])
def test_blocks_are_whole_warps(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lanes that share a world would be in two warps, or wait for lanes that are not there."""
    monkeypatch.setenv(BLOCK_VARIABLE, text)
    with pytest.raises(sw.ModelError, match=f"^SIMWARP_BLOCK_DIM must be a multiple of 32, whole warps, got {text}; "):
        sw.Simulation(scenes.pendulum().finalize(1, "cpu"), 1e-3)


@pytest.mark.parametrize(("text", "threads"), [(None, 32), ("", 32), ("32", 32), ("128", 128), ("1024", 1024)])
def test_sizes_of_blocks(text: str | None, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(BLOCK_VARIABLE, raising=False)
    if text is not None:
        monkeypatch.setenv(BLOCK_VARIABLE, text)
    assert block_threads() == threads
