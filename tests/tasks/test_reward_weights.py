"""Weights of rewards are fields of the configuration of every shipped task; a term is its weight times a quantity."""

import dataclasses
import math
from typing import Any

import pytest
import torch

from simwarp.cli.options import CommonOptions, parse_options, task_options
from simwarp.tasks import (
    InputError,
    RewardWeights,
    config_from_plain,
    config_to_plain,
    make,
    replace_fields,
    task_class,
    task_names,
)
from simwarp.tasks.arms.reaching import ReachConfig, ReachReward
from simwarp.tasks.driving.barrier_track import BarrierTrackConfig, BarrierTrackRewards
from simwarp.tasks.driving.convoy import ConvoyConfig, ConvoyRewards
from simwarp.tasks.driving.hallway import HallwayConfig, HallwayRewards
from simwarp.tasks.driving.obstacle_avoidance import ObstacleAvoidanceConfig, ObstacleAvoidanceRewards
from simwarp.tasks.driving.off_road import OffRoadConfig, OffRoadRewards
from simwarp.tasks.locomotion.ant import AntConfig, AntReward, AntRewards
from simwarp.tasks.locomotion.velocity import VelocityConfig

NAMES = [name for name in task_names() if task_class(name).__module__.startswith("simwarp.tasks")]
CASES = [
    *((name, {}) for name in NAMES),
    ("ant", {"reward": "code"}),
    ("ant", {"reward": "thesis"}),
    ("hexapod", {"reward": "code"}),
    ("racer3-reach", {"reward": "thesis"}),
]


def rolled(name, **changes):
    """Reward terms of some steps (steps, W, T) as float64, and the task."""
    config = task_class(name).config_type()
    if hasattr(config, "obs"):
        changes = {"obs": "state", **changes}
    task = make(name, 2, seed=1, config=replace_fields(config, changes))
    generator = torch.Generator().manual_seed(0)
    actions = 2.0 * torch.rand(5, *task.action.shape, generator=generator) - 1.0
    return torch.stack([task.step(action).reward_terms for action in actions]).double(), task


@pytest.mark.parametrize(("name", "variant"), CASES)
@pytest.mark.sweep
def test_terms_are_weights_times_quantities(name, variant):
    usual, task = rolled(name, **variant)
    weights = {term: weight for term, weight in task.config.reward_weights().items() if term in task.reward_terms}
    assert set(weights) == set(task.reward_terms)
    changed = {term: (0.0 if index % 3 == 0 else -2.5 * weight) for index, (term, weight) in enumerate(weights.items())}
    # Where a weight of 0 leaves the term away, it stays at some number
    changed = {term: weight or (1.0 if term in ("change", "speed") else 0.0) for term, weight in changed.items()}
    others, other = rolled(name, **variant, **{f"rewards.{term}": weight for term, weight in changed.items()})
    assert other.reward_terms == task.reward_terms
    for column, term in enumerate(task.reward_terms):
        expected = usual[..., column] * (changed[term] / weights[term])
        assert torch.allclose(others[..., column], expected, rtol=1e-6, atol=1e-12), term
    assert f"{task.reward_terms[0]} {changed[task.reward_terms[0]]:g}" in repr(other)


@pytest.mark.parametrize("name", NAMES)
def test_they_are_options_of_the_command_line_and_part_of_files(name):
    kind = task_class(name).config_type
    term = next(iter(kind().reward_weights()))
    option = f"--task.rewards.{term.replace('_', '-')}"
    config = parse_options(task_options("Options", CommonOptions, task=kind()), [option, "0.5"], "simwarp train").task
    assert config.reward_weights()[term] == 0.5
    plain = config_to_plain(config)
    assert plain["rewards"][term] == 0.5
    assert config_from_plain(kind, plain) == config
    del plain["rewards"]
    assert config_from_plain(kind, plain) == kind()  # of an older run


OLDER = [
    (HallwayConfig, {"progress_weight": 0.3, "lap_weight": 1.0, "failure_weight": 2.0}, HallwayRewards(0.3, 1.0, -2.0)),
    (HallwayConfig, {"failure_weight": 2.0}, HallwayRewards(failure=-2.0)),
    (BarrierTrackConfig, {"aside_weight": 0.1, "lap_weight": 3}, BarrierTrackRewards(aside=-0.1, lap=3.0)),
    (ObstacleAvoidanceConfig, {"bonus": 7.0, "progress_weight": 0.2}, ObstacleAvoidanceRewards(goal=7.0, progress=0.2)),
    (OffRoadConfig, {"goal_weight": 4.0, "change_weight": 0.5}, OffRoadRewards(goal=4.0, change=-0.5)),
    (ConvoyConfig, {"following_weight": 1.0, "speed_weight": 0.05}, ConvoyRewards(following=1.0, speed=-0.05)),
]


@pytest.mark.parametrize(("kind", "plain", "rewards"), OLDER)
def test_weights_of_older_files_are_read(kind, plain, rewards):
    assert config_from_plain(kind, plain).rewards == rewards
    with pytest.raises(InputError, match=r"rewards\.\w+ must be a number, got 'much'"):
        config_from_plain(kind, {next(iter(plain)): "much"})


def test_what_is_no_weight_is_refused_in_one_line():
    kind = task_class("quadruped-velocity").config_type
    with pytest.raises(InputError, match=r"^rewards\.spin: unknown key; known: speed, turn, lin_vel_z_l2"):
        config_from_plain(kind, {"rewards": {"spin": 1.0}})
    with pytest.raises(InputError, match=r"VelocityRewards has no field 'spin'; .*"):
        replace_fields(kind(), {"rewards.spin": 1.0})
    for value in (math.nan, math.inf, -math.inf):
        with pytest.raises(InputError, match=rf"turn of a VelocityRewards must be a finite number, got {value}"):
            replace_fields(kind(), {"rewards.turn": value})
    with pytest.raises(
        InputError, match=r"rewards\.heading: this variant .* has no such term; known: progress, alive, energy"
    ):
        AntConfig(reward=AntReward.CODE, rewards=AntRewards(heading=1.0))


def test_weights_of_a_variant_are_its_own_where_none_is_given():
    for reward in AntReward:
        weights = AntConfig(reward=reward, rewards=AntRewards(alive=3.0)).reward_weights()
        assert weights["alive"] == 3.0
        assert weights["energy"] == (-0.05 if reward is AntReward.WALK else -0.2)
    assert ReachConfig(reward=ReachReward.THESIS).reward_weights()["contact"] == -1000.0


def test_a_task_without_weights_prints_its_terms_alone():
    from tests.tasks.framework.samples import counter

    task = counter()
    assert task.config.reward_weights() == {}
    assert task.weighted_terms == task.reward_terms


def test_all_weights_are_frozen_fields_of_one_base():
    for name in NAMES:
        rewards: Any = vars(task_class(name).config_type())["rewards"]
        assert isinstance(rewards, RewardWeights)
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(rewards, dataclasses.fields(rewards)[0].name, 1.0)
    assert VelocityConfig().rewards.turn == 1.0
