"""Gymnasium's vector wrappers, one by one: each does what it is for, or refuses in the words that the page quotes."""

import copy
import importlib.util
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.wrappers import vector as wrappers

from simwarp.tasks import TaskVectorEnv

PAGE = Path(__file__).parents[3] / "docs" / "training.md"
WORLDS, STEPS = 3, 8


def fast(**options):
    env = TaskVectorEnv("fast", WORLDS, max_episode_steps=3, **options)
    env.action_space.seed(0)
    return env


def plain():
    """Observations, rewards and ends of the task itself, over steps that end episodes."""
    env = fast()
    actions = [env.action_space.sample() for _ in range(STEPS)]
    return actions, [env.reset(seed=0), *(env.step(action) for action in actions)]


def run(env, actions):
    # Copies: some wrappers write into what they are given
    return [env.reset(seed=0), *(env.step(copy.deepcopy(action)) for action in actions)]


def rewards(steps):
    return np.array([step[1] for step in steps[1:]])


def acts_as(make, through):
    """Actions that a wrapper changes are those that it hands on."""
    actions, _ = plain()
    got = run(make(fast()), actions)
    expected = run(fast(), [through(action) for action in actions])
    np.testing.assert_array_equal(got[-1][0], expected[-1][0])


def pays(make, through):
    """Rewards that a wrapper changes are those of the task, changed."""
    actions, expected = plain()
    np.testing.assert_allclose(rewards(run(make(fast()), actions)), through(rewards(expected)), rtol=1e-6)


def dict_info_to_list():
    actions, expected = plain()
    steps = run(wrappers.DictInfoToList(fast()), actions)
    assert all(len(step[-1]) == WORLDS for step in steps[1:])
    ended = np.array([[bool(step[2][world] | step[3][world]) for world in range(WORLDS)] for step in expected[1:]])
    told = np.array([["final_obs" in info for info in step[-1]] for step in steps[1:]])
    np.testing.assert_array_equal(told, ended)


def record_episode_statistics():
    actions, expected = plain()
    steps = run(wrappers.RecordEpisodeStatistics(fast()), actions)
    lengths = [step[-1]["episode"]["l"].tolist() for step in steps[1:] if "episode" in step[-1]]
    assert lengths == [[3] * WORLDS, [3] * WORLDS]
    returns = [step[-1]["episode"]["r"] for step in steps[1:] if "episode" in step[-1]]
    np.testing.assert_allclose(returns[0], rewards(expected)[:3].sum(axis=0), rtol=1e-5)


def normalize_reward():
    actions, _ = plain()
    got = rewards(run(wrappers.NormalizeReward(fast()), actions))
    assert np.isfinite(got).all()
    assert got.std() > 0.0


def record_video(folder):
    env = wrappers.RecordVideo(
        fast(render_mode="rgb_array", render_size=(64, 48)), str(folder), episode_trigger=lambda episode: episode == 0
    )
    actions, _ = plain()
    run(env, actions)
    env.close()
    assert [path.suffix for path in folder.iterdir()] == [".mp4"]


def tensors(make):
    actions, expected = plain()
    got = run(make(fast()), [torch.as_tensor(action) for action in actions])
    assert isinstance(got[-1][0], torch.Tensor)
    np.testing.assert_array_equal(got[-1][0].numpy(), expected[-1][0])
    np.testing.assert_allclose([step[1].numpy() for step in got[1:]], rewards(expected))


WORK = {
    "TransformAction": lambda _: acts_as(lambda env: wrappers.TransformAction(env, lambda a: -a), lambda a: -a),
    "VectorizeTransformAction": lambda _: acts_as(
        lambda env: wrappers.VectorizeTransformAction(
            env, gym.wrappers.TransformAction, func=lambda a: -a, action_space=env.single_action_space
        ),
        lambda a: -a,
    ),
    "ClipAction": lambda _: acts_as(wrappers.ClipAction, lambda a: a),
    "RescaleAction": lambda _: acts_as(lambda env: wrappers.RescaleAction(env, -2.0, 2.0), lambda a: 0.5 * a),
    "TransformReward": lambda _: pays(lambda env: wrappers.TransformReward(env, lambda r: 2.0 * r), lambda r: 2.0 * r),
    "VectorizeTransformReward": lambda _: pays(
        lambda env: wrappers.VectorizeTransformReward(env, gym.wrappers.TransformReward, func=lambda r: 2.0 * r),
        lambda r: 2.0 * r,
    ),
    "ClipReward": lambda _: pays(lambda env: wrappers.ClipReward(env, 0.2, 0.4), lambda r: r.clip(0.2, 0.4)),
    "NormalizeReward": lambda _: normalize_reward(),
    "DictInfoToList": lambda _: dict_info_to_list(),
    "RecordEpisodeStatistics": lambda _: record_episode_statistics(),
    "RecordVideo": record_video,
    "NumpyToTorch": lambda _: tensors(wrappers.NumpyToTorch),
    "ArrayConversion": lambda _: tensors(lambda env: wrappers.ArrayConversion(env, env_xp=np, target_xp=torch)),
}
"""Wrappers that work, and what shows it."""
IDENTITY = {"func": lambda observation: observation}
REFUSED: dict[str, dict[str, Any]] = {
    "TransformObservation": IDENTITY,
    "VectorizeTransformObservation": {
        "wrapper": gym.wrappers.TransformObservation,
        **IDENTITY,
        "observation_space": gym.spaces.Box(-9.0, 9.0, (2,)),
    },
    "FilterObservation": {"filter_keys": ["policy"]},
    "FlattenObservation": {},
    "GrayscaleObservation": {},
    "ResizeObservation": {"shape": (8, 8)},
    "ReshapeObservation": {"shape": (2, 1)},
    "RescaleObservation": {"min_obs": -1.0, "max_obs": 1.0},
    "DtypeObservation": {"dtype": np.float64},
    "NormalizeObservation": {},
}
"""Wrappers of observations, and arguments: Gymnasium refuses them wherever episodes begin in the step that ends one."""
NEEDED = {"RecordVideo": "moviepy", "ArrayConversion": "array_api_compat", "NumpyToTorch": "array_api_compat"}
"""Packages that a wrapper needs beside Gymnasium."""
OTHERS = {"JaxToNumpy", "JaxToTorch", "HumanRendering"}
"""Wrappers around environments of JAX, and one that opens a window."""


def test_every_wrapper_is_known_here_and_on_the_page():
    """A new one of Gymnasium fails here: it works, or the page says why not."""
    names = set(wrappers.__all__)
    assert names == {*WORK, *REFUSED, *OTHERS}
    page = PAGE.read_text(encoding="utf-8")
    table = page[page.index("| vector wrapper |") :].partition("\n\n")[0]
    assert {name for name in names if f"`{name}`" in table} == names


@pytest.mark.parametrize("name", WORK)
def test_a_wrapper_does_what_it_is_for(name, tmp_path):
    if name in NEEDED:
        pytest.importorskip(NEEDED[name])
    check = WORK[name]
    check(tmp_path)


@pytest.mark.parametrize("name", REFUSED)
def test_wrappers_of_observations_refuse_episodes_that_begin_in_the_same_step(name):
    """They would leave the last observations in the infos unchanged; the error is Gymnasium's own, of any such env."""
    with pytest.raises(ValueError, match="SAME_STEP"):
        getattr(wrappers, name)(fast(), **REFUSED[name])


def test_a_picture_in_a_window_needs_frames_of_the_environment():
    if importlib.util.find_spec("pygame") is None:
        with pytest.raises(ValueError, match="render_mode"):
            wrappers.HumanRendering(fast())
    assert wrappers.HumanRendering(fast(render_mode="rgb_array")).render_mode == "human"
