"""Frames of environments: what Gymnasium's interface, checkers and film makers ask of them."""

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.wrappers import RecordVideo
from gymnasium.wrappers.vector import RecordVideo as VectorRecordVideo

from simwarp.tasks import InputError, TaskEnv, TaskVectorEnv
from simwarp.tasks.locomotion.ant import AntTask
from tests.tasks.framework.samples import counter

SIZE = (96, 64)
ANT, OFF_ROAD = "simwarp/Ant-v0", "simwarp/OffRoad-v0"


def single(name=ANT, **options):
    return gym.make(name, render_mode="rgb_array", render_size=SIZE, **options)


def vector(name=OFF_ROAD, worlds=3, **options):
    return gym.make_vec(name, num_envs=worlds, render_mode="rgb_array", render_size=SIZE, **options)


def visuals_of_links(env) -> Any:
    """What an environment renders: Gymnasium's types allow for text and nothing too."""
    return env.render()


def far_apart(one, other):
    """Share of the pixels in which two frames differ by more than a shade."""
    return (np.abs(one.astype(int) - other.astype(int)).max(axis=-1) > 30).mean()


@pytest.mark.parametrize("name", [ANT, pytest.param(OFF_ROAD, marks=pytest.mark.slow)])
def test_gymnasiums_checker_passes_with_its_render_check(name):
    with warnings.catch_warnings():
        warnings.filterwarnings("error", category=UserWarning)
        warnings.filterwarnings("ignore", message=".*Box observation space (min|max)imum value is.*infinity.*")
        check_env(gym.make(name).unwrapped)
        check_env(single(name).unwrapped)


@pytest.mark.parametrize(("name", "rate"), [(ANT, 50), (OFF_ROAD, 10), ("simwarp/Irb120Reach-v0", 50)])
def test_frames_of_one_world(name, rate):
    # 2 x 10 ms, 40 x 2.5 ms and 20 x 1 ms for an action
    env = gym.make(name, render_mode="rgb_array")
    env.reset(seed=0)
    frame = visuals_of_links(env)
    assert (frame.shape, frame.dtype) == ((320, 480, 3), np.uint8)
    assert env.metadata["render_fps"] == rate
    assert env.metadata["render_modes"] == ["rgb_array"]
    assert env.render_mode == "rgb_array"
    assert len(np.unique(frame.reshape(-1, 3), axis=0)) > 100  # a picture, no plain colour
    env.close()


@pytest.mark.parametrize(("name", "rate"), [(ANT, 50), (OFF_ROAD, 10)])
def test_frames_of_a_vector(name, rate):
    env = vector(name)
    env.reset(seed=0)
    frames = visuals_of_links(env)
    assert isinstance(frames, tuple)
    assert [(frame.shape, frame.dtype) for frame in frames] == [((64, 96, 3), np.uint8)] * 3
    assert (env.metadata["render_fps"], env.metadata["render_modes"]) == (rate, ["rgb_array"])
    # Headings or grounds differ from world to world
    assert far_apart(frames[0], frames[1]) > 0.01
    kept = frames[0].copy()
    env.step(np.ones(env.action_space.shape, np.float32))
    later = visuals_of_links(env)
    np.testing.assert_array_equal(frames[0], kept)
    assert (later[0] != kept).any()


def test_a_rate_that_is_no_whole_number_stays_what_it_is():
    assert TaskEnv("ant", decimation=3).metadata["render_fps"] == pytest.approx(100.0 / 3.0)


def test_nothing_is_built_before_the_first_frame(monkeypatch):
    built = []
    scene = AntTask.scene

    def watched(task):
        built.append(task)
        return scene(task)

    monkeypatch.setattr(AntTask, "scene", watched)
    for env in (single(), vector(ANT)):
        env.reset(seed=0)
        env.step(env.action_space.sample())
        assert built == []
        for _ in range(2):
            visuals_of_links(env)
            env.step(env.action_space.sample())
        assert built == [env.unwrapped.task]
        built.clear()


@pytest.mark.parametrize("name", [ANT, OFF_ROAD])
def test_frames_change_nothing(name):
    plain, filmed = vector(name, max_episode_steps=4), vector(name, max_episode_steps=4)
    assert data_equivalence(plain.reset(seed=3), filmed.reset(seed=3), exact=True)
    plain.action_space.seed(0)
    for step in range(9):
        action = plain.action_space.sample()
        left, right = plain.step(action), filmed.step(action)
        assert data_equivalence(left, right, exact=True)
        if step != 1:  # the first frame comes in the middle of an episode
            visuals_of_links(filmed)


def test_a_reset_shows_the_same_start_again():
    env = single()
    env.reset(seed=5)
    start = visuals_of_links(env)
    for _ in range(20):
        env.step(np.ones(8, np.float32))
    assert far_apart(visuals_of_links(env), start) > 0.01
    env.reset(seed=5)
    np.testing.assert_array_equal(visuals_of_links(env), start)


def test_the_last_frame_shows_the_end_of_the_episode():
    """The step that ends an episode resets the world too: the frame is from between."""
    long = TaskEnv("ant", render_mode="rgb_array", render_size=SIZE)
    short = TaskEnv("ant", max_episode_steps=15, render_mode="rgb_array", render_size=SIZE)
    frames = []
    for env in (long, short):
        env.reset(seed=2)
        frames.append([visuals_of_links(env)])
        for _ in range(15):
            *_, truncated, _ = env.step(np.ones(8, np.float32))
            frames[-1].append(visuals_of_links(env))
    assert truncated
    np.testing.assert_array_equal(frames[1][-1], visuals_of_links(env))  # asked again
    # The camera is where it was, the ant too
    np.testing.assert_array_equal(np.stack(frames[0]), np.stack(frames[1]))
    env.reset(seed=2)
    np.testing.assert_array_equal(visuals_of_links(env), frames[1][0])


def test_a_list_of_frames_is_gymnasiums_to_make():
    env = gym.make(ANT, render_mode="rgb_array_list", render_size=SIZE)
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
    assert [frame.shape for frame in visuals_of_links(env)] == [(64, 96, 3)] * 4


@pytest.mark.parametrize("make", [gym.make, lambda name, **options: gym.make_vec(name, num_envs=2, **options)])
@pytest.mark.filterwarnings("ignore:.*render_mode='depth_array'.*")
def test_another_mode_is_refused_in_one_line(make):
    with pytest.raises(
        InputError, match=r"render_mode must be rgb_array, or None for no frames, got 'depth_array'"
    ) as e:
        make("simwarp/Fast-v0", render_mode="depth_array")
    assert "\n" not in str(e.value)


@pytest.mark.parametrize("size", [(95, 64), (96,), (0, 64), (96.0, 64), "96x64", (96, 8192)])
def test_a_size_that_no_film_has_is_refused(size):
    with pytest.raises(InputError, match=r"render_size must be width and height, each even and from 16 to 4096 pixels"):
        TaskVectorEnv("fast", 1, render_mode="rgb_array", render_size=size)


@pytest.mark.parametrize("env", [TaskEnv("fast"), TaskVectorEnv("fast", 2)], ids=["single", "vector"])
def test_without_a_mode_there_is_no_frame_and_a_warning(env):
    env.reset()
    with pytest.warns(UserWarning, match="render\\(\\) was called without a render mode"):
        assert visuals_of_links(env) is None


def test_a_task_of_lines_renders_and_one_of_nothing_is_refused():
    env = TaskEnv("fast", render_mode="rgb_array", render_size=SIZE)
    env.reset(seed=0)
    assert len(np.unique(visuals_of_links(env).reshape(-1, 3), axis=0)) > 10
    unseen = TaskVectorEnv(counter(), render_mode="rgb_array")
    with pytest.raises(InputError, match="has nothing to draw"):
        visuals_of_links(unseen)


def film(path):
    """(frames, height, width, 3) of a film, and its frames per second."""
    reader = pytest.importorskip("imageio_ffmpeg").read_frames(str(path))
    about = next(reader)
    width, height = about["size"]
    return np.stack([np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader]), about["fps"]


def test_record_video_writes_a_film_of_an_episode(tmp_path):
    pytest.importorskip("moviepy")
    env = RecordVideo(single(max_episode_steps=6), str(tmp_path), episode_trigger=lambda episode: True)
    env.reset(seed=0)
    shown = [visuals_of_links(env)]
    for _ in range(6):
        *_, truncated, _ = env.step(np.ones(8, np.float32))
        shown.append(visuals_of_links(env))
    env.close()
    assert truncated
    frames, rate = film(tmp_path / "rl-video-episode-0.mp4")
    assert rate == 50
    # The start and six steps; moviepy writes the last frame twice where the film's length is rounded up
    assert len(frames) in (7, 8)
    assert frames.shape[1:] == (64, 96, 3)
    # H.264 blurs small frames by 4 to 5 of 255; the first and the last one differ by 9
    off = np.abs(frames[:7].astype(int) - np.stack(shown).astype(int)).mean(axis=(1, 2, 3))
    assert off.max() < 6.0


def test_vector_record_video_writes_a_film_of_all_worlds(tmp_path):
    pytest.importorskip("moviepy")
    env = VectorRecordVideo(
        vector(worlds=4), str(tmp_path), video_aspect_ratio=(3, 2), step_trigger=lambda step: step == 0, video_length=5
    )
    env.reset(seed=0)
    for _ in range(8):
        env.step(env.action_space.sample())
    env.close()
    (path,) = tmp_path.glob("*.mp4")
    frames, rate = film(path)
    assert rate == 10
    # Gymnasium stops once there are more frames than asked for; moviepy may write the last one twice
    assert len(frames) in (6, 7)
    assert frames.shape[1:] == (128, 192, 3)  # two by two
    assert far_apart(frames[0][:64, :96], frames[0][64:, 96:]) > 0.01
