"""Episodes as they end, and in memory."""

from typing import Any

import numpy as np
import pytest
import torch

from simwarp.core.stopping import StopRequest
from simwarp.tasks import make
from simwarp.train.algorithm.learner import TrainingError
from simwarp.train.datasets.episodes import episodes_of, record
from tests.train.datasets.recorded_task import by_noise, recorded_task

__all__ = ["recorded_task"]


def test_they_come_as_they_end_and_are_the_same_that_are_recorded(recorded_task):
    found = list(episodes_of(make(recorded_task, 4), by_noise, 11, 3))
    data = record(make(recorded_task, 4), by_noise, 11, 3, {})
    places = [(one.world, one.number) for one in found]
    assert sorted(places) == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (2, 2), (3, 0), (3, 1)]
    assert places != sorted(places)  # a short second episode ends before a long first one
    for index, (world, number) in enumerate(sorted(places)):
        one, rows = found[places.index((world, number))], data.episode == index
        assert one.steps == rows.sum()
        for group, values in one.observations.items():
            assert np.array_equal(values, data.observations[group][rows]), group
            assert values.dtype == data.observations[group].dtype
        for name in ("actions", "rewards", "terminated", "truncated"):
            assert np.array_equal(getattr(one, name), getattr(data, name)[rows]), name
        assert one.observations["policy"][:, 0].tolist() == list(range(one.steps))  # it counts its steps
        assert not (one.terminated | one.truncated)[:-1].any()
        assert (one.terminated ^ one.truncated)[-1]


def test_the_last_observation_is_that_before_the_reset(recorded_task):
    for one in episodes_of(make(recorded_task, 3), by_noise, 6, 1, last=True):
        assert one.last["policy"][0] == one.steps
        assert one.last.keys() == one.observations.keys()
        assert all(one.last[name].shape == group.shape[1:] for name, group in one.observations.items())


def test_what_is_held_are_the_steps_since_the_oldest_running_episode_began(recorded_task):
    source: Any = episodes_of(make(recorded_task, 4), by_noise, 40, 3)
    held, steps = [], 0
    for one in source:
        held.append(len(source.gi_frame.f_locals["rows"]))
        steps += one.steps
    # Each of four worlds plays ten episodes of at most 11 steps, of which only what runs is held
    assert steps > 4 * 11
    assert max(held) <= 11


def test_it_leaves_with_what_has_ended(recorded_task):
    stop, found = StopRequest(), []
    for one in episodes_of(make(recorded_task, 4), by_noise, 100, 3, stop):
        found.append(one)
        if len(found) == 3:
            stop.ask()
    whole = list(episodes_of(make(recorded_task, 4), by_noise, 100, 3))
    assert 3 <= len(found) < 8  # those that end in the same step are still handed out
    assert [(one.world, one.number) for one in found] == [(one.world, one.number) for one in whole[: len(found)]]


def test_a_policy_without_numbers_is_refused_and_the_error_says_what_was_kept(recorded_task):
    def sick(observations):
        actions = by_noise(observations)
        return torch.where(observations["policy"][:, :1] > 4.0, torch.nan, actions)

    with pytest.raises(TrainingError, match=r"NaN or infinity in \d+ of \d+ actions; the rest is in x"):
        list(episodes_of(make(recorded_task, 4), sick, 40, 3, kept="the rest is in x"))
