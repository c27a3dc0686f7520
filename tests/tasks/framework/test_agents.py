"""Several agents in a world: endings of each, rest, resets, statistics, random numbers, checkpoints, learning."""

import copy
import dataclasses
from pathlib import Path
from typing import Any

import pytest
import torch

from simwarp.tasks import InputError, Task, TaskConfig, TaskError, make, replace_fields
from simwarp.tasks.framework import registry
from simwarp.tasks.framework.agent_rows import Rows
from simwarp.tasks.framework.replay import replay
from simwarp.tasks.framework.step_check import check_step
from simwarp.train import TrainConfig
from simwarp.train.algorithm.acting_rows import ActingRows
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import NetworkKind
from simwarp.train.evaluation.driven_paths import PathRecorder
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.policies import random_policy, zero_policy
from tests.tasks.framework.pair_task import PairConfig, PairTask, pair

PAIR = Path(__file__).with_name("pair_task.py")


def pushed(task, agent, value, worlds=slice(None)):
    """Actions that push one agent's cart in some worlds and leave all else."""
    action = torch.zeros_like(task.action)
    action[worlds, agent] = value
    return action


def until_over(task, agent, value=1.0, worlds=slice(None)):
    """Push an agent until its episode is over; return the last result."""
    for _ in range(60):
        result = task.step(pushed(task, agent, value, worlds))
        if (result.terminated | result.truncated)[worlds, agent].any():
            return result
    raise AssertionError("the agent's episode did not end")


def test_shapes_have_an_axis_of_agents():
    task = pair()
    result = task.step(torch.zeros(3, 2, 1))
    assert task.action.shape == (3, 2, 1)
    assert task.observation_shapes == {"policy": (4,)}
    assert result.observations["policy"].shape == (3, 2, 4)
    assert result.rewards.shape == result.terminated.shape == result.acting.shape == (3, 2)
    assert result.reward_terms.shape == (3, 2, 1)
    assert result.metrics["place"].shape == (3, 2)
    assert result.acting.all()


def test_an_agent_that_is_done_rests_and_is_paid_nothing_until_its_world_is():
    task = pair(start=0.0)
    result = until_over(task, 1, worlds=[0])
    assert result.terminated.tolist() == [[False, True], [False, False], [False, False]]
    assert task.end_reasons[result.end_reason[0, 1]] == "fell"
    assert result.rewards[0].tolist() == [1.0, 1.0]
    steps = int(task.episode_steps[0])
    result = task.step(torch.full((3, 2, 1), 0.25))
    assert task.action[0].flatten().tolist() == [0.25, -1.0], "what a policy asks for is not done, the rest is"
    assert result.acting.tolist() == [[True, False], [True, True], [True, True]]
    assert result.rewards[0].tolist() == [1.0, 0.0]
    assert result.end_reason[0].tolist() == [-1, -1]
    assert not result.terminated.any()
    assert task.episode_steps.tolist() == [steps + 1] * 3, "the world has not begun anew"
    assert task.episode_index.tolist() == [0, 0, 0]


def test_a_world_begins_anew_once_all_of_its_agents_are_done():
    task = pair(start=0.0)
    until_over(task, 1, worlds=[0])
    result = until_over(task, 0, worlds=[0])
    assert result.terminated[0].tolist() == [True, False]
    assert task.episode_index.tolist() == [1, 0, 0]
    assert task.episode_steps[0] == 0
    assert result.observations["policy"][0].abs().max() == 0.0
    assert result.final_observations["policy"][0, 0].abs().max() > 0.3
    assert task.step(torch.zeros(3, 2, 1)).acting.all()


def test_agents_end_together_at_the_time_limit_but_for_those_that_are_done():
    task = pair(start=0.0, max_episode_steps=40)
    until_over(task, 0, worlds=[1])
    while True:
        result = task.step(torch.zeros(3, 2, 1))
        if result.truncated.any():
            break
    assert result.truncated.tolist() == [[True, True], [False, True], [True, True]]
    summary = task.drain_statistics()
    assert summary.end_reasons == {"non_finite": 0, "fell": 1, "off_track": 0, "time_limit": 5}
    assert summary.episodes == 6
    assert summary.terms["alive"] == summary.length_sum, "a resting agent has no step and no reward"
    assert summary.length_sum < 6 * 40


def test_a_push_on_agent_1_leaves_agent_0_and_other_worlds_bit_for_bit():
    ours, theirs = pair(start=0.02), pair(start=0.02)
    for step in range(50):
        free = ours.step(torch.zeros(3, 2, 1))
        push = theirs.step(pushed(theirs, 1, 1.0 if step % 9 else -1.0, worlds=[0, 2]))
        assert torch.equal(free.observations["policy"][:, 0], push.observations["policy"][:, 0])
        assert torch.equal(free.observations["policy"][1], push.observations["policy"][1])
        assert torch.equal(free.rewards[:, 0], push.rewards[:, 0])
    assert not torch.equal(free.observations["policy"][0, 1], push.observations["policy"][0, 1])


def test_a_broken_world_ends_for_all_of_its_agents():
    task = pair()
    until_over(task, 1, worlds=[1])
    task.views.joint_qd[1] = torch.nan
    result = task.step(torch.zeros(3, 2, 1))
    assert result.non_finite.tolist() == [[False, False], [True, False], [False, False]]
    assert result.terminated[1].tolist() == [True, False], "the other one was done before"
    assert result.final_observations["policy"].isfinite().all()
    assert task.episode_index.tolist() == [0, 1, 0]


def test_random_numbers_are_of_world_agent_episode_and_purpose():
    task, more = pair(worlds=2, seed=5), pair(worlds=4, seed=5)
    drawn, same = (each.random.uniform("start", size=4).view(-1, 2, 2) for each in (task, more))
    assert torch.equal(drawn, same[:2]), "worlds beside change nothing"
    assert len(drawn.flatten().unique()) == drawn.numel()
    assert not torch.equal(drawn, task.random.uniform("other", size=4).view(-1, 2, 2))


def test_delays_and_noise_are_of_each_agent():
    sensing = {"policy": {"delay": (0, 3), "noise": 0.1}}
    task = PairTask(replace_fields(PairConfig(action_delay=(0, 3)), {"sensing": sensing}), 40, seed=1)
    delays = task._sensors._lines["policy"].delay.view(40, 2)
    assert task._path._line is not None
    actions = task._path._line.delay.view(40, 2)
    assert (delays[:, 0] != delays[:, 1]).any()
    assert (actions[:, 0] != actions[:, 1]).any()
    asked = torch.ones(40, 2, 1)
    for step in range(5):
        task.step(asked)
        assert torch.equal(task.action[..., 0] > 0.5, actions <= step), "each action comes as late as its delay"
    noise = task.observe()["policy"] - task._sensors._lines["policy"].read()
    assert noise.abs().max() > 0.1
    assert len(noise.flatten().unique()) > 0.9 * noise.numel()


def test_a_saved_task_goes_on_exactly_with_the_same_agents_done():
    task = pair(start=0.02)
    until_over(task, 1, worlds=[0])
    saved = task.state_dict()
    ahead = [copy.deepcopy(task.step(torch.full((3, 2, 1), 0.1))) for _ in range(30)]  # a graph overwrites results
    other = pair(start=0.02, seed=9)
    other.load_state_dict(saved)
    for wanted in ahead:
        got = other.step(torch.full((3, 2, 1), 0.1))
        assert torch.equal(got.observations["policy"], wanted.observations["policy"])
        assert torch.equal(got.acting, wanted.acting)
        assert torch.equal(got.rewards, wanted.rewards)
        assert torch.equal(got.end_reason, wanted.end_reason)


def test_a_dump_of_a_broken_world_repeats_what_its_agents_did(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "_tasks", dict(registry._tasks))
    task = make(f"{PAIR}:PairTask", 3, seed=2, guard_steps=50)
    until_over(task, 1, worlds=[1])
    for _ in range(4):
        task.step(torch.full((3, 2, 1), 0.3))
    task.views.joint_qd[1] = torch.nan
    task.step(torch.zeros(3, 2, 1))
    assert task.guard is not None
    task.guard.notice()
    report = replay(task.guard.write(tmp_path / "dump.npz"))
    assert report.steps > 5
    assert report.largest_difference == 0.0, "bit for bit, the rest of agent 1 included, until the state was broken"


def test_a_control_step_of_agents_fits_into_one_graph():
    assert check_step(pair()).problems() == []


def test_a_task_prints_its_axis_of_agents():
    text = repr(pair())
    assert "policy (3, 2, 4) float32" in text
    assert "(3, 2, 1)" in text


def test_rows_are_those_of_worlds_agent_by_agent():
    task, other = pair(), pair()
    rows = Rows(task)
    actions = torch.linspace(-1.0, 1.0, 6).view(6, 1)
    flat, whole = rows.step(actions), other.step(actions.view(3, 2, 1))
    assert torch.equal(flat.observations["policy"], whole.observations["policy"].view(6, 4))
    assert flat.acting is not None
    assert whole.acting is not None
    assert torch.equal(flat.acting, whole.acting.flatten())
    with pytest.raises(TaskError, match=r"rows of actions must be \(6, 1\), got \(3, 1\)"):
        rows.step(actions[:3])


def test_evaluation_counts_the_first_episodes_of_each_agent():
    task = pair(worlds=4)
    evaluation = evaluate(task, zero_policy(task), 16, 3)
    assert evaluation.episodes == 16
    assert sum(evaluation.end_reasons.values()) == 16
    assert evaluation.mean_return == evaluation.mean_episode_length, "a step pays one, and rest is no step"
    assert 1 <= evaluation.min_episode_length < 60
    assert evaluate(task, random_policy(task), 8, 3).episodes == 8


class Staggered(Task):
    """In world k agent 0 is done after 2 + 10 k steps, agent 1 one later; a step is a metre to the right."""

    name = "staggered"
    config_type = TaskConfig
    agents, action_size, physics = 2, 1, False

    def setup(self):
        self.place = torch.zeros(self.num_worlds, 3, device=self.device)

    def begin_step(self):
        self.place[:, 0] += 1.0

    def apply(self, action):
        pass

    def observations(self):
        return {"policy": self.place[:, None, :].expand(-1, 2, -1).contiguous()}

    def rewards(self):
        return {"one": torch.ones(self.num_worlds, 2, device=self.device)}

    def terminations(self):
        end = 2 + 10 * torch.arange(self.num_worlds, device=self.device)[:, None] + torch.arange(2, device=self.device)
        late = self.episode_steps[:, None] >= end
        first = torch.arange(2, device=self.device) == 0
        return {"first": late & first, "second": late & ~first}

    def map_position(self):
        return self.place

    def reset(self, world_mask):
        self.place.masked_fill_(world_mask[:, None], 0.0)


@pytest.mark.parametrize(("episodes", "lengths"), [(8, [3, 13, 23, 33]), (4, [3, 13])])
def test_paths_of_an_evaluation_end_with_the_last_agent_of_their_world(episodes, lengths):
    task, recorder = Staggered(TaskConfig(), 4), PathRecorder()
    evaluate(task, zero_policy(task), episodes, 0, watcher=recorder)
    found: Any = recorder.paths_driven
    assert [len(path) - 1 for path in found.paths] == lengths
    assert [path[-1, 0] for path in found.paths] == lengths
    assert found.reasons == ("second",) * len(lengths)


def train(steps=32, **options):
    task = pair(worlds=16, seed=1)
    return Trainer(task, TrainConfig(num_envs=16, iterations=2, steps_per_iteration=steps, seed=1, **options))


def test_samples_of_agents_that_rest_are_not_learned_from():
    """With a whole rollout of nonsense in the rows of resting agents, learning comes out the same, bit for bit."""
    weights = []
    for nonsense in (False, True):
        trainer = train(steps=64, threads=1)
        trainer.collect()
        acting, storage = trainer._acting, trainer.storage
        rest = ~acting._acting
        assert 0 < int(rest.sum()) < rest.numel() / 2
        if nonsense:
            storage.returns[rest] = 1e6
            storage.values[rest] = -1e6
            storage.actions_log_prob[rest] = 50.0
            storage.observations["policy"][rest] = 1e4
        before = storage.advantages[~rest].clone()
        with trainer._of_acting_agents():
            part = trainer.storage
            assert part.num_envs == int((~rest).sum())
            gains = part.advantages.flatten()
            assert abs(float(gains.mean())) < 1e-5
            assert abs(float(gains.std()) - 1.0) < 1e-4
            # one line of the old ones: only mean and deviation are new
            slope = torch.corrcoef(torch.stack([gains, before.flatten()]))[0, 1]
            assert float(slope) == pytest.approx(1.0, abs=1e-5)
            trainer.algorithm.update()
        assert trainer.storage is storage
        assert storage.step == 0
        weights.append(torch.cat([value.flatten() for value in trainer.algorithm.get_policy().state_dict().values()]))
    assert torch.equal(*weights)


def test_learning_of_two_agents_improves_and_resumes_exactly():
    trainer = train()
    reports = [trainer.iterate() for _ in range(12)]
    assert reports[0].env_steps == 512
    first, last = reports[1].mean_episode_length, reports[-1].mean_episode_length
    saved = copy.deepcopy(trainer.checkpoint())
    ahead = trainer.iterate().values["loss/surrogate"]
    other = train()
    assert other.load(saved)
    assert other.iterate().values["loss/surrogate"] == ahead
    assert last > 1.2 * first, "poles stay up longer after 12 iterations"


def test_recurrent_networks_are_refused_in_one_line():
    with pytest.raises(InputError, match=r"--network.kind recurrent: task 'pair' has 2 agents"):
        train(network=dataclasses.replace(TrainConfig().network, kind=NetworkKind.RECURRENT))


def test_wrong_shapes_numbers_and_rest_are_one_line():
    task = pair()
    with pytest.raises(TaskError, match=r"action must be \(3, 2, 1\) floating point, got \(3, 1\)"):
        task.step(torch.zeros(3, 1))

    class Flat(PairTask):
        def rewards(self):
            return {"alive": torch.ones(self.num_worlds, device=self.device)}

    with pytest.raises(TaskError, match="must have 3 worlds and 2 agents in front, got shape"):
        Flat(PairConfig(), 3)

    class Restless(PairTask):
        resting_action: Any = (0.0, 2.0)

    with pytest.raises(InputError, match="resting_action must be 1 numbers"):
        Restless(PairConfig(), 3)

    class Crowd(PairTask):
        agents = 1000

    with pytest.raises(InputError, match="agents"):
        Crowd(PairConfig(), 3)


def test_acting_rows_know_their_share():
    rows = ActingRows(2, 4, "cpu")
    rows.record(1, torch.tensor([True, False, False, True]))
    assert rows.share == 0.75
