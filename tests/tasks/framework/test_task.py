"""The loop of the base class: episodes, their ends, what is reported of them, and the contract with a task author."""

import copy
import pickle

import pytest
import torch

import simwarp.tasks as tasks
from simwarp.tasks import InputError, Task, TaskConfig, TaskError, replace_fields
from tests.tasks.framework.samples import Counter, SampleConfig, counter


def idle(task):
    return torch.zeros(task.num_worlds, task.action_size)


def test_time_limit_truncates_and_resets_in_the_same_step():
    task = counter()
    for _ in range(4):
        result = task.step(idle(task))
        assert not (result.terminated | result.truncated).any()
    result = task.step(idle(task))
    assert result.truncated.all()
    assert not result.terminated.any()
    assert [task.end_reasons[index] for index in result.end_reason] == ["time_limit"] * 3
    assert result.success.all()
    assert result.final_observations["policy"].flatten().tolist() == [5.0] * 3
    assert result.observations["policy"].flatten().tolist() == [0.0] * 3
    assert result.final_observations["camera"].dtype == torch.uint8


def test_failure_terminates_one_world_and_leaves_the_others():
    task = counter()
    task.step(idle(task))
    task.fail[1] = True
    result = task.step(idle(task))
    assert result.terminated.tolist() == [False, True, False]
    assert not result.truncated.any()
    assert not result.success.any()
    assert result.end_reason.tolist() == [-1, task.end_reasons.index("failed"), -1]
    assert result.observations["policy"].flatten().tolist() == [2.0, 0.0, 2.0]
    assert task.episode_steps.tolist() == [2, 0, 2]
    assert task.episode_index.tolist() == [0, 1, 0]


def test_a_failure_at_the_time_limit_is_a_failure():
    task = counter(max_episode_steps=1)
    task.fail[0] = True
    result = task.step(idle(task))
    assert result.terminated.tolist() == [True, False, False]
    assert result.truncated.tolist() == [False, True, True]


def test_rewards_are_the_sum_of_named_terms_and_statistics_add_up():
    task = counter()
    result = task.step(idle(task))
    assert task.reward_terms == ["one", "count"]
    assert result.rewards.tolist() == [2.0] * 3
    for _ in range(4):
        task.step(idle(task))
    summary = task.drain_statistics()
    assert summary.episodes == 3
    assert summary.length_sum / summary.episodes == 5.0
    assert summary.terms == {"one": 15.0, "count": 45.0}
    assert summary.mean_return == 20.0
    assert summary.end_reasons == {"non_finite": 0, "failed": 0, "time_limit": 3}
    assert summary.successes == 3
    assert task.drain_statistics().episodes == 0


def test_actions_are_clipped():
    task = counter()
    task.step(torch.tensor([[3.0, -7.0], [0.25, -0.5], [1.0, -1.0]]))
    assert task.action.tolist() == [[1.0, -1.0], [0.25, -0.5], [1.0, -1.0]]


def test_action_rise_time_limits_the_change_per_step_and_starts_from_rest():
    task = counter(dt=0.1, decimation=2, action_rise_time=0.8, max_episode_steps=3)
    full = torch.ones(3, 2)
    task.step(full)
    assert task.action[0].tolist() == pytest.approx([0.25, 0.25])
    task.step(-full)
    assert task.action[0].tolist() == pytest.approx([0.0, 0.0])
    task.step(full)
    assert task.action[0].tolist() == [0.0, 0.0]  # the episode ended: the next begins at rest


class Fragile(Counter):
    """World 1 breaks in its second step; what a task computes from a broken world is NaN."""

    name = "fragile"

    def setup(self):
        super().setup()
        self._status = torch.zeros(self.num_worlds, dtype=torch.int32, device=self.device)  # as of a simulation

    def broken(self):
        return (self.count[:, 0] == 2.0) & (torch.arange(self.num_worlds, device=self.device) == 1)

    def fog(self):
        return torch.where(self.broken(), torch.nan, 0.0)

    def observations(self):
        self._status.copy_(self.broken())
        return {"policy": self.count + self.fog().unsqueeze(1)}

    def rewards(self):
        self._status.copy_(self.broken())
        return {"one": 1.0 + self.fog()}


def test_a_broken_world_is_reset_and_counted_and_its_nan_reaches_nobody():
    task = Fragile(SampleConfig(), 3)
    task.step(idle(task))
    result = task.step(idle(task))
    assert result.final_observations is not None
    assert result.terminated.tolist() == [False, True, False]
    assert result.end_reason.tolist() == [-1, task.end_reasons.index("non_finite"), -1]
    assert result.rewards.tolist() == [1.0, 0.0, 1.0]
    assert result.observations["policy"].flatten().tolist() == [2.0, 0.0, 2.0]
    assert result.final_observations["policy"].flatten().tolist() == [2.0, 0.0, 2.0]
    assert task.drain_statistics().end_reasons["non_finite"] == 1  # and no complaint about the task


class Upright(Fragile):
    """One whose success is that nothing went wrong, which NaN does not contradict."""

    name = "upright"

    def metrics(self):
        return {"success": ~(self.count[:, 0] + self.fog() > 100.0)}


def test_a_broken_world_is_no_success_whatever_its_measure_says():
    task = Upright(SampleConfig(), 3)
    task.step(idle(task))
    result = task.step(idle(task))
    assert result.non_finite.tolist() == [False, True, False]
    assert not result.success.any()
    assert task.drain_statistics().successes == 0


class Fickle(Counter):
    """A task that returns other terms when it is told to."""

    name = "fickle"
    more: bool = False

    def rewards(self):
        return super().rewards() | ({"late": torch.ones(self.num_worlds, device=self.device)} if self.more else {})


class Swapped(Counter):
    name = "swapped"
    more: bool = False

    def terminations(self):
        flags = {"a": self.fail, "b": torch.zeros_like(self.fail)}
        return dict(reversed(flags.items())) if self.more else flags


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Fickle, r"the reward terms must stay \['one', 'count'\], got \['one', 'count', 'late'\]: return all of them"),
        (Swapped, r"the reasons to end must stay \['a', 'b'\], got \['b', 'a'\]: return all of them"),
    ],
)
def test_terms_that_change_after_the_build_are_named(kind, message):
    task = kind(SampleConfig(), 2)
    task.step(idle(task))
    task.more = True
    with pytest.raises(TaskError, match=message):
        task.step(idle(task))


@pytest.mark.parametrize(
    ("members", "message"),
    [
        (
            {"metrics": lambda self: {"success": torch.ones(self.num_worlds, device=self.device)}},
            "metric 'success' must be bool, got torch.fl",
        ),
        ({"success_reasons": ["time_limit"]}, r"success_reasons must be a set of names, got \['time_limit'\]"),
        ({"success_reasons": "time_limit"}, "success_reasons must be a set of names, got 'time_limit'"),
    ],
)
def test_what_tells_a_success_is_checked(members, message):
    with pytest.raises(TaskError, match=message):
        type("Odd", (Counter,), {"name": "odd", **members})(SampleConfig(), 2)


class Breaking(Counter):
    """A reward that is NaN in world 1 from the second step on."""

    name = "breaking"

    def rewards(self):
        bad = (self.count[:, 0] > 1.0) & (torch.arange(self.num_worlds, device=self.device) == 1)
        return {"one": torch.where(bad, torch.nan, 1.0)}


def test_nan_reward_is_kept_from_the_learner_and_named():
    task = Breaking(SampleConfig(), 3)
    task.step(idle(task))
    result = task.step(idle(task))
    assert result.rewards.tolist() == [1.0, 0.0, 1.0]
    with pytest.raises(TaskError, match="task 'breaking': reward 'one' was NaN"):
        task.drain_statistics()


class NanObservation(Counter):
    name = "foggy"

    def observations(self):
        return {"policy": torch.where(self.count > 1.0, torch.nan, self.count)}


def test_nan_observation_is_named():
    task = NanObservation(SampleConfig(), 2)
    for _ in range(2):
        task.step(idle(task))
    with pytest.raises(TaskError, match="task 'foggy': observation 'policy'"):
        task.drain_statistics()


def returning(method, value):
    return type("Odd", (Counter,), {"name": "odd", method: lambda self: value(self)})


@pytest.mark.parametrize(
    ("method", "value", "message"),
    [
        ("observations", lambda t: {}, "no group"),
        ("observations", lambda t: t.count, "dict of named tensors"),
        ("observations", lambda t: {"policy": t.count[:1]}, "observation 'policy'.*3 worlds"),
        ("observations", lambda t: {"policy": t.count.double()}, "'policy' is float64"),
        ("observations", lambda t: {"policy": t.count[:, 0]}, "'policy' must be"),
        ("rewards", lambda t: {"lean": t.count}, "reward 'lean' must be"),
        ("rewards", lambda t: {"lean": t.count[:, 0].long()}, "reward 'lean' must be float32"),
        ("rewards", lambda t: {"lean": 1.0}, "reward 'lean' must be a torch tensor"),
        ("terminations", lambda t: {"fell": t.count[:, 0]}, "termination 'fell' must be .* bool"),
        ("terminations", lambda t: {"time_limit": t.fail}, "different names"),
        ("truncations", lambda t: {"gone": t.count[:, 0]}, "truncation 'gone'"),
    ],
)
def test_a_broken_contract_is_named_when_the_task_is_built(method, value, message):
    with pytest.raises(TaskError, match=message):
        returning(method, value)(SampleConfig(), 3)


@pytest.mark.parametrize("action", [torch.zeros(3, 1), torch.zeros(2, 2), torch.zeros(3, 2, dtype=torch.int64)])
def test_an_action_of_the_wrong_shape_or_dtype_is_refused(action):
    with pytest.raises(TaskError, match="action must be"):
        counter().step(action)


def test_same_seed_same_episodes_and_world_k_does_not_depend_on_how_many_worlds_there_are():
    def roll(worlds, seed):
        task = tasks.make("fast", worlds, seed=seed, max_episode_steps=7)
        steps = []
        for step in range(20):
            action = torch.sin(torch.arange(worlds).unsqueeze(1) + torch.tensor([[1.0, 2.0]]) * step)
            steps.append(task.step(action).observations["policy"].clone())
        return torch.stack(steps)

    assert torch.equal(roll(5, 3), roll(5, 3))
    assert torch.equal(roll(5, 3)[:, :2], roll(2, 3))
    assert not torch.equal(roll(5, 3), roll(5, 4))


def test_restart_with_a_seed_repeats_and_without_goes_on():
    task = tasks.make("fast", 4, seed=0)
    first = task.restart(seed=11)["policy"].clone()
    second = task.restart()["policy"].clone()
    assert not torch.equal(first, second)
    assert torch.equal(task.restart(seed=11)["policy"], first)


def test_buffers_survive_inference_mode():
    task = counter()
    with torch.inference_mode():
        for _ in range(6):
            task.step(idle(task))
        task.restart()
    task.count += 1.0
    task.step(idle(task))
    assert not task.episode_steps.is_inference()


def test_state_dict_continues_exactly():
    task = tasks.make("fast", 6, seed=2, max_episode_steps=9)
    generator = torch.Generator().manual_seed(0)
    actions = torch.rand(30, 6, 2, generator=generator) * 2 - 1
    for action in actions[:13]:
        task.step(action)
    state = task.state_dict()
    expected = [task.step(action).observations["policy"].clone() for action in actions[13:]]
    other = tasks.make("fast", 6, seed=77, max_episode_steps=9)
    other.load_state_dict(state)
    got = [other.step(action).observations["policy"].clone() for action in actions[13:]]
    assert all(torch.equal(a, b) for a, b in zip(expected, got, strict=True))


def test_state_of_another_number_of_worlds_is_refused():
    with pytest.raises(InputError, match="2 worlds, the task has 3"):
        counter(3).load_state_dict(counter(2).state_dict())


@pytest.mark.parametrize("field", ["dt", "decimation", "max_episode_steps", "substeps"])
def test_configuration_is_validated_by_name(field):
    with pytest.raises(InputError, match=f"{field.replace('_', '-')} must be"):
        replace_fields(TaskConfig(), {field: 0})


def test_nan_in_a_configuration_is_refused():
    with pytest.raises(InputError, match="dt must be a finite number"):
        TaskConfig(dt=float("nan"))


def test_registry_names_what_is_near():
    assert {"fast", "pendulum"} <= set(tasks.task_names())
    with pytest.raises(InputError, match="unknown task 'pendulm'; did you mean pendulum"):
        tasks.task_class("pendulm")
    with pytest.raises(InputError, match="has no field 'gian'; did you mean gain"):
        tasks.make("fast", gian=1.0)
    with pytest.raises(InputError, match="at least 1, got 0"):
        tasks.make("fast", 0)
    with pytest.raises(InputError, match="unknown device 'tpu'"):
        tasks.make("fast", device="tpu")


def test_two_tasks_cannot_share_a_name():
    with pytest.raises(InputError, match="two tasks want the name 'fast'"):
        tasks.register("fast")(type("Other", (Counter,), {}))
    with pytest.raises(InputError, match="lower-case"):
        tasks.register("Bad Name")


def test_a_task_must_write_its_methods():
    class Empty(Task):
        pass

    with pytest.raises(TypeError, match="abstract"):
        Empty(TaskConfig(), 1)  # type: ignore[abstract]


@pytest.mark.parametrize("name", ["fast", "pendulum"])
@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_copy_of_a_task_says_what_to_do(name, copied):
    task = tasks.make(name, 2)
    simulations = [] if task.simulation is None else [task.simulation]
    for owner in (task, tasks.TaskVectorEnv(task) if copied is not copy.copy else task, *simulations):
        with pytest.raises(TypeError) as caught:
            copied(owner)
        text = str(caught.value)
        assert "cannot be pickled or copied: it refers to memory of a device" in text
        assert "\n" not in text
        assert "state over" in text
