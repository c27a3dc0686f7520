"""The level of a curriculum outside of `simwarp train`: in evaluations, and in environments of other libraries."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from simwarp import cli
from simwarp.tasks import Curriculum, Driver, InputError, TaskVectorEnv, make
from simwarp.tasks.adapters.gym_env import TaskEnv
from tests.tasks.adapters.graded_task import GradedTask

EPISODES = 400


@pytest.fixture
def evaluated(tmp_path, monkeypatch, capsys):
    """Evaluate the graded task: exit code, standard output, standard error, what the JSON holds."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments, task="graded", checkpoint="zero"):
        words = ["eval", task, "--no-baselines", "--device", "cpu", "--json", "out.json"]
        code = cli.main([*words, "--episodes", str(EPISODES), "--checkpoint", checkpoint, *arguments])
        out, err = capsys.readouterr()
        path = tmp_path / "out.json"
        return code, out, err, json.loads(path.read_text()) if path.is_file() else None

    return run


def within(rate, level):
    """Five standard deviations of a binomial share: one test in two million fails by chance."""
    return abs(rate - (1.0 - level)) <= 5.0 * math.sqrt(level * (1.0 - level) / EPISODES)


@pytest.mark.parametrize("level", [0.0, 0.2, 0.7, 1.0])
def test_an_evaluation_runs_at_the_level_that_is_asked_for_and_says_so(evaluated, level):
    """Fails where each evaluation is at level 1, and does not say it."""
    code, out, _, content = evaluated("--level", str(level))
    assert code == 0
    assert f"graded, {EPISODES} episodes at level {level:g}" in out
    assert content["level"] == level
    assert within(content["success_rate"], level)


def test_an_evaluation_is_at_level_1_and_prints_it(evaluated):
    _, out, _, content = evaluated()
    assert "episodes at level 1" in out
    assert content["level"] == 1.0
    assert content["success_rate"] == 0.0


def test_a_task_without_a_curriculum_does_not_speak_of_levels(evaluated):
    _, out, _, content = evaluated("--num-envs", "50", "--task.max-episode-steps", "2", task="fast")
    assert "level" not in out
    assert content["level"] == 1.0


def test_levels_are_a_key_of_grids(evaluated):
    code, _, _, content = evaluated("--grid", "level=0,0.5,1", "--plot", "plots")
    assert code == 0
    assert content["keys"] == {"level": [0.0, 0.5, 1.0]}
    assert [point["level"] for point in content["grid"]] == [0.0, 0.5, 1.0]
    assert all(within(point["success_rate"], point["level"]) for point in content["grid"])


def test_levels_stand_in_a_grid_where_they_were_named(evaluated):
    _, _, _, content = evaluated(
        "--grid", "dt=0.01,0.02", "--grid", "level=0,1", "--plot", "plots"
    )  # fmt: skip
    places = [(point["dt"], point["level"]) for point in content["grid"]]
    assert places == [(0.01, 0.0), (0.01, 1.0), (0.02, 0.0), (0.02, 1.0)]
    assert list(content["keys"]) == ["dt", "level"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--level", "1.5"], "--level must be a number in [0, 1], got 1.5"),
        (["--level", "nan"], "--level must be a finite number"),
        (["--grid", "level=0,-1"], "--grid level must be a number in [0, 1], got -1.0"),
        (["--grid", "level=0,hard"], "--grid level must be a number in [0, 1], got 'hard'"),
        (["--grid", "level=0.5,0.50"], "--grid level has the value 0.5 twice"),
    ],
)
def test_levels_that_are_none_are_refused(evaluated, words, told):
    code, _, err, content = evaluated(*words)
    assert code == 2
    assert told in err
    assert err.count("\n") == 1
    assert content is None


def test_the_end_of_a_training_below_the_level_of_the_evaluation_is_told(evaluated):
    words = ["--num-envs", "8", "--steps-per-iteration", "4", "--device", "cpu", "--logger", "csv"]
    assert cli.main(["train", "graded", "--iterations", "4", *words]) == 0
    run = str(next(Path("runs", "graded").iterdir()))
    _, out, _, content = evaluated(checkpoint=run)
    assert content["level"] == 1.0
    assert "training ended at a mean level of 0.3; --level 0.3 evaluates there" in out  # iteration 3 of 10
    _, out, _, _ = evaluated("--level", "0.3", checkpoint=run)
    assert "training ended" not in out


# ---- environments ----------------------------------------------------------------------------------------------------


def levels(env):
    return env.task.drawn_level.tolist()


def test_a_vector_is_at_level_1_until_another_is_set():
    env = TaskVectorEnv("graded", 3)
    assert env.reset(seed=0)[0].flatten().tolist() == [1.0] * 3
    env.set_level(0.25)
    assert env.reset()[0].flatten().tolist() == [0.25] * 3
    env.set_level(np.array([0.0, 0.5, 1.0]))
    observations, *_ = env.step(np.zeros((3, 1)))
    assert observations.flatten().tolist() == [0.0, 0.5, 1.0]
    assert env.reset(options={"level": 0.75})[0].flatten().tolist() == [0.75] * 3
    assert TaskVectorEnv("graded", 2, level=0.5).reset()[0].flatten().tolist() == [0.5] * 2


def test_a_single_world_has_levels_too():
    env = TaskEnv("graded", level=0.5)
    assert env.reset(seed=0)[0].tolist() == [0.5]
    env.set_level(0.25)
    assert env.reset()[0].tolist() == [0.25]
    assert env.reset(options={"level": 0.75})[0].tolist() == [0.75]


def test_iterations_of_so_many_steps_move_the_level_as_in_a_training():
    env = TaskVectorEnv("graded", 2, steps_per_iteration=4)
    env.reset(seed=0)
    seen = [float(env.step(np.zeros((2, 1)))[0][0, 0]) for _ in range(14)]
    # Iteration i has level i / 10; each step begins an episode after it
    assert seen == pytest.approx([0.0] * 4 + [0.1] * 4 + [0.2] * 4 + [0.3] * 2)
    env.set_level(0.9)
    assert env.reset()[0].flatten().tolist() == pytest.approx([0.9] * 2)
    for _ in range(9):
        env.step(np.zeros((2, 1)))
    assert levels(env) == pytest.approx([0.9] * 2)  # held


def test_successes_move_a_level_by_progress_once_iterations_begin():
    curriculum = Curriculum(Driver.PROGRESS, up=0.05, down=0.025)
    still = TaskVectorEnv("graded", 4, curriculum=curriculum)
    moving = TaskVectorEnv("graded", 4, curriculum=curriculum, steps_per_iteration=8)
    for env in (still, moving):
        env.reset(seed=0)
        for _ in range(10):
            env.step(np.zeros((4, 1)))
    assert still.task.level.tolist() == [1.0] * 4
    assert torch.all((moving.task.level > 0.0) & (moving.task.level < 1.0))


@pytest.mark.parametrize("level", [1.5, -0.1, float("nan"), "hard", None, True, [0.5], [0.1, 0.2, 2.0]])
def test_a_level_that_is_none_is_refused_and_changes_nothing(level):
    env = TaskVectorEnv("graded", 3, level=0.5)
    with pytest.raises(InputError, match=r"level must be a number in \[0, 1\], or 3 of them, got"):
        env.set_level(level)
    assert env.task.level.tolist() == [0.5] * 3


def test_a_level_cannot_be_held_and_moved_at_once():
    with pytest.raises(InputError, match="give one of them"):
        TaskVectorEnv("graded", 1, level=0.5, steps_per_iteration=8)
    with pytest.raises(InputError, match="steps_per_iteration must be at least 1, got 0"):
        TaskVectorEnv("graded", 1, steps_per_iteration=0)


def test_a_level_that_is_held_is_that_of_a_task_in_a_program():
    task = make("graded", 3)
    assert isinstance(task, GradedTask)
    task.on_iteration(5)
    assert task.level.tolist() == [0.5] * 3
    task.set_level(torch.tensor([0.0, 0.25, 1.0]))
    assert task.restart()["policy"].flatten().tolist() == [0.0, 0.25, 1.0]


def test_stable_baselines_has_levels():
    pytest.importorskip("stable_baselines3", reason="the extra sb3 is not installed")
    from simwarp.tasks.adapters.sb3_adapter import SB3VecEnv

    env = SB3VecEnv("graded", 2, level=0.5)
    assert env.reset().flatten().tolist() == [0.5] * 2
    env.set_level(0.25)
    assert env.reset().flatten().tolist() == [0.25] * 2
    moving = SB3VecEnv("graded", 2, steps_per_iteration=1)
    moving.reset()
    for _ in range(4):
        observations, *_ = moving.step(np.zeros((2, 1), np.float32))
    assert observations.flatten().tolist() == pytest.approx([0.3] * 2)


def test_skrl_has_levels_through_the_environment_that_it_wraps():
    pytest.importorskip("skrl", reason="the extra skrl is not installed")
    from skrl.envs.wrappers.torch import wrap_env

    env = TaskVectorEnv("graded", 2, level=0.5)
    wrapped = wrap_env(env, verbose=False)
    assert wrapped.reset()[0].flatten().tolist() == [0.5] * 2
    env.set_level(0.25)
    observations, *_ = wrapped.step(torch.zeros(2, 1))
    assert observations.flatten().tolist() == [0.25] * 2
