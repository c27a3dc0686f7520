"""Evaluation and pictures: exact counts without bias, known intervals, files that are what they say."""

import dataclasses
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image
from rich.console import Console

from scripts.ship_policy import ship
from simwarp.core.files import FileError
from simwarp.tasks import InputError, Task, make, replace_fields, task_class
from simwarp.tasks.framework import registry
from simwarp.train.config import default_config
from simwarp.train.evaluation.evaluation import (
    evaluate,
    evaluate_policies,
)
from simwarp.train.evaluation.filming import Film
from simwarp.train.evaluation.play import check_video_path, record, write_picture, write_video
from simwarp.train.networks import policies
from simwarp.train.networks.policies import find_policy, network_policy, random_policy, zero_policy
from simwarp.train.runs.checkpoint import inference_only, load_checkpoint, save_checkpoint
from simwarp.train.runs.training import train
from tests.tasks.framework.samples import Counter, SampleConfig


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    root = tmp_path_factory.mktemp("runs")
    config = replace_fields(default_config(task_class("fast")), {"device": "cpu", "iterations": 12})
    train("fast", config, task_class("fast").config_type(), root=root, console=Console(quiet=True))
    return root


class Uneven(Counter):
    """World k fails after k + 1 steps, every time."""

    name = "uneven"

    def terminations(self):
        return {"failed": self.count[:, 0] > torch.arange(self.num_worlds)}


@pytest.mark.parametrize("episodes", [1, 3, 4, 7, 10])
def test_exactly_the_first_episodes_of_each_world_count(episodes):
    task = Uneven(SampleConfig(max_episode_steps=50), 4)
    result = evaluate(task, zero_policy(task), episodes, seed=0)
    worlds = [index % 4 for index in range(episodes)]
    assert result.episodes == episodes
    # Counting whichever episodes end first would count world 0 far more often than world 3
    assert result.mean_episode_length == pytest.approx(sum(k + 1 for k in worlds) / episodes)
    assert result.min_episode_length == 1
    assert result.end_reasons == {"failed": episodes}
    assert result.success_rate == 0.0


@dataclasses.dataclass(frozen=True)
class TeamConfig(SampleConfig):
    max_episode_steps: int = 100
    members: int = 3


class Team(Task):
    """Agent a of world k is done after 1 + k + 10 a steps, every time; their number is a choice, as a convoy's is."""

    name = "team"
    config_type = TeamConfig
    action_size, physics = 1, False

    @property
    def agents(self) -> int:  # type: ignore[override]
        return self.config.members

    def apply(self, action):
        pass

    def observations(self):
        return {"policy": torch.zeros(self.num_worlds, self.agents, 1)}

    def rewards(self):
        return {"one": torch.ones(self.num_worlds, self.agents)}

    def terminations(self):
        last = 1 + torch.arange(self.num_worlds)[:, None] + 10 * torch.arange(self.agents)
        return {"failed": self.episode_steps[:, None] >= last}

    def reset(self, world_mask):
        pass


class Played(Team):
    """Team as another class plays it, which alone knows how many agents there are."""

    agents = 1
    config_type = TeamConfig

    @classmethod
    def played_by(cls, config):
        return f"{__name__}:Team"


@pytest.fixture
def team(monkeypatch):
    monkeypatch.setattr(registry, "_tasks", {**registry._tasks, "team": Team, "played": Played})


@pytest.mark.parametrize("name", ["team", "played"])
@pytest.mark.parametrize(("episodes", "num_envs", "worlds"), [(10, None, 4), (3, None, 1), (1, None, 1), (10, 2, 2)])
def test_several_agents_are_evaluated_in_as_many_worlds_as_their_episodes_fill(team, name, episodes, num_envs, worlds):
    built: list[Any] = []

    def idle(task):
        built.append(task)
        return zero_policy(task)

    ((_, result),) = evaluate_policies(
        name, idle, config=TeamConfig(), episodes=episodes, seed=0, num_envs=num_envs, baselines=False
    )
    assert [task.num_worlds for task in built] == [worlds]
    # Row by row, agents of a world beside each other: the first episode of each, then the second
    lengths = [1 + row // 3 + 10 * (row % 3) for row in (number % (3 * worlds) for number in range(episodes))]
    assert (result.episodes, result.end_reasons) == (episodes, {"failed": episodes})
    assert result.mean_episode_length == pytest.approx(sum(lengths) / episodes)
    assert result.min_episode_length == min(lengths)
    if num_envs is None:  # worlds that do not count change nothing
        more = make(name, episodes, config=TeamConfig())
        assert evaluate(more, zero_policy(more), episodes, 0) == result


def test_the_trained_policy_beats_both_baselines(trained):
    source = find_policy("fast", None, trained)
    found = evaluate_policies(
        "fast", lambda task: network_policy(source.content, task), config=task_class("fast").config_type(),
        episodes=64, seed=5,
    )  # fmt: skip
    results = dict(found)
    assert set(results) == {"policy", "zero", "random"}
    assert results["policy"].mean_return > results["zero"].mean_return + 10.0
    assert results["policy"].metrics["final_distance"] < results["random"].metrics["final_distance"]
    plain = results["policy"].as_json()
    assert {"episodes", "mean_return", "mean_episode_length", "success_rate", "success_ci95", "end_reasons"} <= set(
        plain
    )
    assert plain["final_distance"] == results["policy"].metrics["final_distance"]


def test_an_evaluation_repeats(trained):
    source = find_policy("fast", None, trained)

    def once(worlds):
        task = make("fast", worlds)
        return evaluate(task, network_policy(source.content, task), 8, seed=3)

    assert once(8) == once(8)
    task = make("fast", 8)
    assert evaluate(task, random_policy(task), 8, seed=3) == evaluate(task, random_policy(task), 8, seed=3)


def test_a_slim_checkpoint_plays_but_cannot_be_resumed(trained, tmp_path):
    content = load_checkpoint(find_policy("fast", None, trained).path)
    path = tmp_path / "slim.pt"
    save_checkpoint(path, inference_only(content))
    assert path.stat().st_size < find_policy("fast", None, trained).path.stat().st_size / 2
    task = make("fast", 4)
    full, small = (network_policy(c, task) for c in (content, load_checkpoint(path)))
    assert torch.equal(full(task.observations()), small(task.observations()))


@pytest.mark.parametrize("name", ["zero", "random"])
def test_policies_without_a_network_are_found_by_name(name, tmp_path):
    source = find_policy("fast", Path(name), tmp_path)
    task = make("fast", 4, seed=3)
    actions = source.policy(task)(task.observations())
    assert actions.shape == (4, task.action_size)
    assert bool(actions.any()) == (name == "random")
    assert repr(source).startswith(f"PolicySource: {name} actions")


def test_which_policy_is_taken(trained, tmp_path, monkeypatch):
    newest = find_policy("fast", None, trained)
    run = newest.path.parents[1]
    assert find_policy("fast", run).path == newest.path
    assert find_policy("fast", newest.path).path == newest.path
    monkeypatch.setattr(policies, "SHIPPED", tmp_path)
    with pytest.raises(InputError, match=r"no policy for task 'fast' in folder '.*': train one with .* --runs"):
        find_policy("fast", None, tmp_path)
    save_checkpoint(tmp_path / "fast.pt", inference_only(newest.content))
    assert find_policy("fast", None, tmp_path).path == tmp_path / "fast.pt"
    with pytest.raises(InputError, match="is of task 'fast', not 'pendulum'"):
        find_policy("pendulum", newest.path)
    save_checkpoint(tmp_path / "fast.ice.pt", inference_only(newest.content))
    assert find_policy("fast", Path("fast.ice")).path == tmp_path / "fast.ice.pt"
    with pytest.raises(InputError, match=r"fast\.mud"):
        find_policy("fast", Path("fast.mud"))
    monkeypatch.chdir(trained)
    shutil.copytree(run, trained / "fast.ice")  # what lies here comes first
    assert find_policy("fast", Path("fast.ice")).path.is_relative_to("fast.ice")
    shutil.rmtree(trained / "fast.ice")


def test_a_network_for_other_observations_is_refused(trained):
    content = find_policy("fast", None, trained).content
    task = Counter(SampleConfig(), 2)
    with pytest.raises(InputError, match="does not fit task 'Flat'"):
        network_policy(content, type("Flat", (Counter,), {"observations": lambda self: {"policy": self.count}})(
            task.config, 2
        ))  # fmt: skip


def test_picture_and_video_show_every_moment(tmp_path):
    task = make("fast", 3)
    frames, total = record(task, zero_policy(task), seconds=0.6, seed=1, film=Film(task, video=False))
    assert len(frames) == 1 + 60 // 4
    assert frames[-1].time == pytest.approx(0.6)
    expected = (1.0 - task.restart(seed=1)["policy"].norm(dim=1)).mean() * 60
    assert total == pytest.approx(float(expected), rel=1e-4)
    write_picture(tmp_path / "a.png", frames, "fast")
    with Image.open(tmp_path / "a.png") as image:
        assert image.format == "PNG"
        assert len(image.getcolors(maxcolors=1 << 20) or []) > 10
    moving, _ = record(task, random_policy(task), seconds=0.2, seed=1, film=Film(task, video=True))
    write_video(tmp_path / "a.gif", moving, "fast")
    with Image.open(tmp_path / "a.gif") as image:
        assert getattr(image, "n_frames", 1) == len(moving)


def test_files_that_cannot_be_written_are_refused_first(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    for path, message in (
        (tmp_path / "a.avi", "must end in"),
        (tmp_path / "no" / "a.gif", "does not exist"),
        (tmp_path / "a.mp4", "pip install imageio-ffmpeg"),
    ):
        with pytest.raises((InputError, FileError), match=message):
            check_video_path(path)


def test_the_shipped_pendulum_policy_solves_the_pendulum(tmp_path):
    source = find_policy("pendulum", None, tmp_path)
    assert source.path == policies.shipped_policy("pendulum")
    config = task_class("pendulum").config_type()
    found = evaluate_policies(
        "pendulum", lambda task: network_policy(source.content, task), config=config, episodes=64, seed=17
    )
    results = dict(found)
    assert results["policy"].mean_episode_length >= 990.0
    assert results["policy"].success_rate > 0.95
    assert results["zero"].mean_episode_length < 200.0
    assert results["random"].mean_episode_length < 200.0


def test_shipping_in_nominal_worlds_but_for_what_the_policy_knows(tmp_path):
    usual = task_class("fast").config_type()
    config = replace_fields(default_config(task_class("fast")), {"device": "cpu", "iterations": 1, "num_envs": 4})
    worlds = replace_fields(usual, {"max_episode_steps": 7, "action_delay": (1, 1)})
    train("fast", config, worlds, root=tmp_path / "runs", console=Console(quiet=True))
    run = find_policy("fast", None, tmp_path / "runs").path.parents[1]
    with pytest.raises(InputError, match=r"--keep steps: no field of the configuration of task 'fast'"):
        ship(run, tmp_path, nominal=True, keep=("steps",))
    shipped = {}
    for keep in ((), ("max_episode_steps",)):
        record = ship(run, tmp_path, nominal=True, keep=keep)
        saved = load_checkpoint(tmp_path / "fast.pt")["task_config"]
        shipped[keep] = (saved["max_episode_steps"], tuple(saved["action_delay"]))
        assert record["trained_on"] == {"max_episode_steps": 7, "action_delay": [1, 1]}
    assert shipped == {(): (usual.max_episode_steps, (0, 0)), ("max_episode_steps",): (7, (0, 0))}


def test_shipping_writes_the_actor_and_where_it_came_from(trained, tmp_path):
    run = find_policy("fast", None, trained).path.parents[1]
    record = ship(run, tmp_path)
    assert {"command", "git", "versions", "evaluation", "iterations"} <= set(record)
    content = load_checkpoint(tmp_path / "fast.pt")
    assert "optimizer_state_dict" not in content
    assert "worlds" not in content
    assert record["evaluation"]["policy"]["episodes"] == 256
