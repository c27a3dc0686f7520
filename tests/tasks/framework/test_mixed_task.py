"""A task over several models: each has the rows of its batch alone, and the whole is a task as any other."""

from typing import Any

import numpy as np
import pytest
import torch

from simwarp.core.threads import default_threads
from simwarp.tasks import Curriculum, Driver, InputError, Range, Sensing, TaskVectorEnv, check_step, make
from simwarp.tasks.framework import registry
from simwarp.tasks.framework.mixing import worlds_of_models
from simwarp.tasks.framework.replay import replay
from tests.tasks.framework.chain_task import ChainTask
from tests.tasks.framework.graph_emulation import Emulator
from tests.tasks.framework.test_capture import copied, roll, same
from tests.tasks.framework.test_task_threads import bits, different

WORLDS = 7
MIX: dict[str, Any] = {"mix": "links=1,2,3"}
UNCERTAIN: dict[str, Any] = {
    "action_delay": (0, 2),
    "action_rise_time": 0.1,
    "randomise": {"body_mass": Range(0.8, 1.2)},
    "sensing": {"policy": Sensing(noise=0.01, bias=0.1, delay=(0, 2))},
    "curriculum": Curriculum(driver=Driver.PROGRESS),
}
CASES: dict[str, dict[str, Any]] = {"plain": {}, "uncertain": UNCERTAIN}


@pytest.fixture(autouse=True)
def chain():
    registry.register("chain")(ChainTask)
    yield
    registry._tasks.pop("chain", None)


def mixed(worlds=WORLDS, **options):
    return make("chain", worlds, seed=3, **MIX, **options)


def alone(group, **options):
    """The task of a group's model, made for itself as the rule says."""
    return make("chain", group.count, seed=3, links=int(group.name), first_world=group.rows.start, **options)


def part(value, rows):
    if isinstance(value, dict):
        return {name: part(each, rows) for name, each in value.items()}
    return value if value is None else value[rows]


# ---- rows are those of each model alone -----------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES)
def test_rows_are_those_of_each_model_alone(case):
    task = mixed(**CASES[case])
    task.contract.on_iteration(0)
    steps = roll(task, 12)
    again = copied(task.restart(seed=9))
    assert int(task.episode_index.min()) == 0
    for group in task.model_groups:
        single = alone(group, **CASES[case])
        single.contract.on_iteration(0)
        generator = torch.Generator().manual_seed(0)
        for step in steps:
            action = 2.0 * torch.rand(WORLDS, 1, generator=generator) - 1.0
            result = single.step(action[group.rows])
            found = {name: part(value, group.rows) for name, value in step.items()}
            assert different(bits(vars(result)), bits(found)) == []
        assert different(bits(single.restart(seed=9)), bits(part(again, group.rows))) == []


def test_draws_of_the_whole_are_those_of_the_models():
    task = mixed()
    whole = task.random.uniform("any", 0.0, 1.0, 2, per_step=True)
    for group in task.model_groups:
        assert torch.equal(whole[group.rows], group.task.random.uniform("any", 0.0, 1.0, 2, per_step=True))
    assert len(whole.unique()) == 2 * WORLDS  # worlds are numbered through: none has the draws of another


def test_clocks_levels_and_actions_are_one_memory():
    task = mixed()
    for name in ("episode_index", "episode_steps", "episode_clock", "level", "action"):
        for group in task.model_groups:
            rows = getattr(task, name)[group.rows]
            assert rows.data_ptr() == getattr(group.task, name).data_ptr(), name
    task.set_level(torch.linspace(0.0, 1.0, WORLDS))
    assert torch.equal(torch.cat([group.task.level for group in task.model_groups]), torch.linspace(0.0, 1.0, WORLDS))


def test_a_disturbed_world_changes_no_other():
    tasks = [mixed(**UNCERTAIN) for _ in range(2)]
    disturbed = 3  # of the second model
    group = tasks[1].model_groups[1]
    group.task.simulation.set_joint_state(torch.arange(group.count) == disturbed - group.rows.start, None, 2.0)
    first, second = (roll(task, 4) for task in tasks)
    others = [world for world in range(WORLDS) if world != disturbed]
    for one, two in zip(first, second, strict=True):
        assert same(part(one, others), part(two, others))
    late = [steps[-1]["observations"]["policy"][disturbed] for steps in (first, second)]
    assert not torch.equal(*late)


@pytest.mark.parametrize("threads", [2, 3])
def test_the_same_bits_for_any_number_of_threads(threads):
    found = []
    for count in (1, threads):
        with default_threads(count):
            task = mixed(**UNCERTAIN)
        found.append({"steps": bits(dict(enumerate(roll(task, 7)))), "state": bits(task.state_dict())})
    assert different(found[0], found[1]) == []


def test_steps_from_graphs_equal_eager_ones():
    eager, captured = mixed(guard_steps=6), mixed(guard_steps=6)
    emulators = []
    for group in captured.model_groups:
        emulators.append(Emulator())
        group.task._captured._record, group.task._captured.reason = emulators[-1].record, ""
    assert same(roll(eager, 9), roll(captured, 9))
    assert [(each.recorded, each.replayed) for each in emulators] == [(1, 7)] * 3
    assert captured.not_captured == ""
    captured.capture = False
    assert captured.not_captured == "it is switched off"


def test_a_resumed_batch_goes_on_exactly():
    task, other = mixed(**UNCERTAIN), mixed(**UNCERTAIN)
    task.contract.on_iteration(0)
    roll(task, 6)
    state = task.state_dict()
    expected = roll(task, 8, seed=1)
    roll(other, 3, seed=5)
    other.load_state_dict(state)
    assert same(expected, roll(other, 8, seed=1))
    assert different(bits(task.state_dict()), bits(other.state_dict())) == []


# ---- a task as any other --------------------------------------------------------------------------------------------


def test_statistics_are_sums_of_the_models():
    task = mixed()
    roll(task, 11)
    summary = task.drain_statistics()
    assert [*summary.by_model] == ["1", "2", "3"]
    assert summary.episodes == sum(each.episodes for each in summary.by_model.values()) >= WORLDS
    assert summary.return_sum == pytest.approx(sum(each.return_sum for each in summary.by_model.values()), rel=1e-12)
    assert sum(summary.end_reasons.values()) == summary.episodes
    assert summary.terms.keys() == {"rate", "angle"}
    assert task.drain_statistics().episodes == 0


def test_what_looks_on_before_a_reset_sees_all_models_where_they_ended():
    task = mixed()
    task.episode_clock.fill_(4)  # of 5: all end in the next step
    seen = []
    task.before_reset = lambda: seen.append(copied(task.contract.map_position()))
    task.step(torch.zeros(WORLDS, 1))
    ended = seen[0]
    task.before_reset = None
    begun = copied(task.contract.map_position())
    assert len(seen) == 1
    assert not torch.isclose(ended, begun).all(dim=1).any()
    task.step(torch.zeros(WORLDS, 1))
    assert len(seen) == 1
    assert task.before_reset is None


def test_gymnasium_takes_it():
    env = TaskVectorEnv(mixed())
    first, _ = env.reset(seed=5)
    assert env.observation_space.contains(first)
    assert env.single_action_space.shape == (1,)
    rows = [env.step(np.full((WORLDS, 1), 0.5, np.float32)) for _ in range(6)]
    assert any("final_info" in row[4] for row in rows)
    again, _ = env.reset(seed=5)
    assert np.array_equal(first, again)


def test_stable_baselines_takes_it():
    pytest.importorskip("stable_baselines3", reason="the extra sb3 is not installed")
    from simwarp.tasks.adapters.sb3_adapter import SB3VecEnv

    env = SB3VecEnv(mixed())
    assert env.observation_space.contains(env.reset()[0])
    ends = [env.step(np.zeros((WORLDS, 1), np.float32))[3] for _ in range(5)]
    assert all("episode" in info for info in ends[-1])  # all worlds had their time


def test_skrl_takes_it():
    pytest.importorskip("skrl", reason="the extra skrl is not installed")
    from skrl.envs.wrappers.torch import wrap_env

    env = wrap_env(TaskVectorEnv(mixed()))
    observations, _ = env.reset()
    assert observations.shape == (WORLDS, 3)
    assert env.step(torch.zeros(WORLDS, 1))[1].shape == (WORLDS, 1)


def test_a_step_keeps_the_rules_of_captured_ones():
    assert check_step(mixed()).problems() == []


def test_frames_show_each_model_in_its_place():
    task = make("chain", 4, seed=3, mix="links=1,3")
    env = TaskVectorEnv(task, render_mode="rgb_array", render_size=(32, 24))
    env.reset(seed=1)
    frames = env.render()
    assert frames is not None
    assert len(frames) == 4
    for group in task.model_groups:
        single = TaskVectorEnv(alone(group), render_mode="rgb_array", render_size=(32, 24))
        single.reset(seed=1)
        seen = single.render()
        assert seen is not None
        assert np.array_equal(np.array(frames[group.rows]), np.array(seen))


def test_a_break_is_kept_and_replayed(tmp_path):
    task = mixed(guard_steps=6)
    for group in task.model_groups:
        group.task.guard.path = tmp_path / "broken.npz"
    roll(task, 3)
    task.model_groups[2].task.views.joint_qd[1] = torch.nan
    result = task.step(torch.zeros(WORLDS, 1))
    world = task.model_groups[2].rows.start + 1
    assert result.non_finite.nonzero().flatten().tolist() == [world]
    task.drain_statistics()
    assert replay(tmp_path / "broken.npz").world == world


def test_it_says_what_it_is():
    assert "models" in str(mixed())
    assert "3 3 worlds" not in str(mixed())
    task = mixed()
    assert (task.name, task.action_names, task.end_reasons[1]) == ("chain", ("torque",), "turned")
    assert task.config.mix == "links=1,2,3"
    assert task.model_groups[1].task.config.links == 2


# ---- worlds of each model -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shares", "worlds", "counts"),
    [
        ((), 7, [3, 2, 2]),
        ((2.0, 1.0, 1.0), 8, [4, 2, 2]),
        ((90.0, 9.0, 1.0), 100, [90, 9, 1]),
        ((1.0, 1.0, 1000.0), 3, [1, 1, 1]),
        ((1.0, 1.0, 1000.0), 10, [1, 1, 8]),
    ],
)
def test_shares_of_the_worlds(shares, worlds, counts):
    assert worlds_of_models("abc", shares, worlds, "chain") == counts


def test_shares_of_a_task():
    assert [group.count for group in mixed(8, mix_shares=(2.0, 1.0, 1.0)).model_groups] == [4, 2, 2]


# ---- errors ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"mix": "links"}, "mix must be a field and at least two different values, such as vehicle=hmmwv,gator, got"),
        ({"mix": "links=2,2"}, "at least two different values"),
        ({"mix": "links=2"}, "at least two different values"),
        ({"mix": "arms=1,2"}, "ChainConfig has no field 'arms'"),
        ({"mix": "links=1,9"}, "links must be from 1 to 4, got 9"),
        ({"mix": "links=1,long"}, "links must be"),
        ({"mix": "links=1,2", "mix_shares": (1.0,)}, "mix-shares must be 2 numbers, one for each of 1, 2, got [1.0]"),
        ({"mix": "links=1,2", "mix_shares": (1.0, 0.0)}, "mix-shares"),
        ({"mix": "links=1,2", "told_of_all": True}, "models '1' and '2' must have the same observations, got"),
        ({"mix": "dt=0.01,0.02"}, "must have the same time of a control step, got 0.01 and 0.02"),
        ({"mix": "max_episode_steps=5,6"}, "must have the same control steps of an episode, got 5 and 6"),
    ],
)  # fmt: skip
def test_what_cannot_be_mixed_is_said_in_one_line(options, text):
    with pytest.raises(InputError) as error:
        make("chain", 4, **options)
    assert text in str(error.value)
    assert "\n" not in str(error.value)


def test_a_model_without_a_world_is_refused():
    with pytest.raises(InputError, match=r"'chain': 3 models \(1, 2, 3\) need a world each, got 2; take at least 3"):
        mixed(2)


def test_the_state_of_other_models_is_refused():
    state = make("chain", 4, mix="links=1,2").state_dict()
    with pytest.raises(InputError, match="saved state has the models 1, 2, the task has 1, 3"):
        make("chain", 4, mix="links=1,3").load_state_dict(state)
    with pytest.raises(InputError, match="has the models none"):
        make("chain", 4, mix="links=1,3").load_state_dict(make("chain", 4).state_dict())
