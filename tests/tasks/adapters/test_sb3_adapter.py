"""Stable-Baselines3 over a task: copies, true final observations, and time-outs told from failures."""

import numpy as np
import pytest
import torch

from simwarp.tasks import InputError
from tests.tasks.framework.samples import counter

pytest.importorskip("stable_baselines3", reason="the extra sb3 is not installed")

from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize, VecVideoRecorder

from simwarp.tasks.adapters.sb3_adapter import SB3VecEnv


def still(env):
    return np.zeros((env.num_envs, *env.action_space.shape), np.float32)


def test_a_time_out_and_a_failure_in_one_step():
    env = SB3VecEnv("fast", 3, max_episode_steps=2)
    env.seed(4)
    start = env.reset()
    env.step(still(env))
    env.task.load_extra_state({"position": torch.tensor([[0.5, 0.0], [4.0, 4.0], [0.25, 0.0]])})
    env.task.episode_clock[2] = 0
    after, rewards, dones, infos = env.step(still(env))
    assert dones.tolist() == [True, True, False]
    assert infos[2] == {}
    assert infos[0]["TimeLimit.truncated"]
    assert not infos[1]["TimeLimit.truncated"]
    assert infos[0]["terminal_observation"].tolist() == [0.5, 0.0]
    assert infos[1]["terminal_observation"].tolist() == [4.0, 4.0]
    assert (infos[0]["end_reason"], infos[1]["end_reason"]) == ("time_limit", "out_of_bounds")
    assert not np.array_equal(after[0], infos[0]["terminal_observation"])
    assert infos[0]["episode"]["l"] == 2
    assert infos[0]["episode"]["r"] == pytest.approx(1.0 - np.linalg.norm(start[0]) + rewards[0], rel=1e-5)
    # The same seed, the same start; without one, another
    env.seed(4)
    np.testing.assert_array_equal(env.reset(), start)
    assert not np.array_equal(env.reset(), start)


def test_ppo_bootstraps_with_the_true_final_observation(monkeypatch):
    """The value that Stable-Baselines3 adds to the reward of a time-out is that of the state cut off."""
    env = SB3VecEnv("fast", 2, max_episode_steps=3, start_radius=1.0)
    model = PPO("MlpPolicy", env, n_steps=6, batch_size=12, n_epochs=1, seed=0, device="cpu")
    asked: list = []
    values = model.policy.predict_values

    def remember(observation):
        asked.append(observation.clone())
        return values(observation)

    monkeypatch.setattr(model.policy, "predict_values", remember)
    handed: list = []
    step_wait = env.step_wait

    def watch():
        observations, rewards, dones, infos = step_wait()
        handed.extend(info["terminal_observation"] for info in infos if "terminal_observation" in info)
        return observations, rewards, dones, infos

    monkeypatch.setattr(env, "step_wait", watch)
    model.learn(12)
    # Two worlds, time-outs after steps 3 and 6; the last call values the batch after the rollout
    assert len(handed) == 4
    assert len(asked) == 5
    np.testing.assert_array_equal(torch.cat(asked[:4]).numpy(), np.stack(handed))


def test_several_groups_are_a_dict_and_final_ones_too():
    env = SB3VecEnv(counter())
    first = env.reset()
    assert {name: group.dtype for name, group in first.items()} == {"policy": np.float32, "camera": np.uint8}
    for _ in range(5):
        after, _, dones, infos = env.step(still(env))
    assert dones.all()
    assert infos[1]["terminal_observation"]["policy"].tolist() == [5.0]
    assert infos[1]["terminal_observation"]["camera"].max() == 5
    assert after["policy"].max() == 0.0
    assert first["camera"].max() == 0


def test_it_is_a_vec_env_that_wrappers_take():
    env = SB3VecEnv("fast", 4)
    assert isinstance(env, VecEnv)
    assert env.get_attr("num_envs", [0, 2]) == [4, 4]
    assert env.env_is_wrapped(VecMonitor) == [False] * 4
    assert env.env_method("drain_statistics", indices=1)[0].episodes == 0
    with pytest.raises(InputError, match="no attribute 'gain' of their own"):
        env.set_attr("gain", 1.0)
    normalised = VecNormalize(env)
    assert normalised.reset().shape == (4, 2)
    assert normalised.step(still(env))[0].shape == (4, 2)


@pytest.mark.slow
def test_ppo_learns():
    env = SB3VecEnv("fast", 32)
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=128, learning_rate=1e-3, seed=0, device="cpu")
    model.learn(512)
    before = np.mean([episode["r"] for episode in model.ep_info_buffer]) if model.ep_info_buffer else 0.0
    model.learn(20_000, reset_num_timesteps=False)
    assert np.mean([episode["r"] for episode in model.ep_info_buffer]) > before + 15.0


def test_frames_of_all_worlds_and_one_picture_of_them():
    """Fails where `get_images` is not there."""
    env = SB3VecEnv("fast", 3, render_mode="rgb_array", render_size=(64, 48))
    env.reset()
    images = [image for image in env.get_images() if image is not None]
    assert len(images) == 3
    assert all(image.shape == (48, 64, 3) and image.dtype == np.uint8 for image in images)
    assert not np.array_equal(images[0], images[1])  # each shows its own point
    assert env.render_mode == "rgb_array"
    picture = env.render()
    assert picture.shape == (96, 128, 3)  # a square of four, the last of which is empty
    np.testing.assert_array_equal(picture[:48, :64], images[0])
    assert env.metadata["render_fps"] == env.batch.metadata["render_fps"]


def test_without_a_render_mode_there_are_no_frames():
    env = SB3VecEnv("fast", 2)
    env.reset()
    with pytest.warns(UserWarning, match="render"):
        assert list(env.get_images()) == [None, None]


def test_stable_baselines_films_the_worlds(tmp_path):
    pytest.importorskip("moviepy", reason="Stable-Baselines3 makes films with it")
    env = SB3VecEnv("fast", 2, render_mode="rgb_array", render_size=(64, 48))
    filmed = VecVideoRecorder(env, str(tmp_path), lambda step: step == 0, video_length=4)
    filmed.reset()
    for _ in range(5):
        filmed.step(still(env))
    filmed.close()
    assert [path.suffix for path in tmp_path.iterdir()] == [".mp4"]
