"""A world whose physics breaks down: reset, counted, kept with what led there, and repeated from the file."""

import json

import numpy as np
import pytest
import torch

from simwarp.core.files import FileError
from simwarp.tasks import Curriculum, Driver, InputError, Range, make
from simwarp.tasks.framework.errors import TaskStepError
from simwarp.tasks.framework.replay import replay
from simwarp.tasks.pendulum import PendulumTask


def guard_of(task):
    assert task.guard is not None
    return task.guard


def break_world(task, world, step, steps):
    """Act at random; one world gets a NaN action in one step."""
    generator = torch.Generator().manual_seed(0)
    for index in range(steps):
        action = torch.rand(task.num_worlds, task.action_size, generator=generator) * 0.2 - 0.1
        if index == step:
            action[world] = torch.nan
        result = task.step(action)
        if index == step:
            assert result.non_finite.tolist() == [number == world for number in range(task.num_worlds)]


@pytest.mark.parametrize(
    ("step", "limit", "from_reset"),
    [(3, 1000, True), (75, 1000, False), (75, 60, True), (0, 1000, True), (20, 1000, False)],
)
@pytest.mark.sweep
def test_a_break_is_kept_and_repeated(tmp_path, step, limit, from_reset):
    task = make("pendulum", 4, seed=5, guard_steps=20, max_angle=1e6, max_position=1e6, max_episode_steps=limit,
                first_world=8, decimation=2, action_rise_time=0.2, action_delay=(0, 0),
                randomise={"body_mass": Range(0.8, 1.2)})  # fmt: skip
    guard_of(task).path = tmp_path / "broken.npz"
    break_world(task, 2, step, step + 15)
    task.drain_statistics()
    report = replay(guard_of(task).path)
    assert report.reproduced
    assert (report.task, report.world, report.seed) == ("pendulum", 10, 5)
    assert report.from_reset is from_reset
    assert report.episode_step == step % limit + 1
    assert report.largest_difference == 0.0
    assert np.isnan(report.largest_action)
    assert report.problems
    with np.load(guard_of(task).path) as file:
        meta = json.loads(str(file["meta"]))
        assert meta["config"]["randomise"]["body_mass"]["low"] == 0.8
        assert {"actions", "joint_q", "joint_qd", "start/state/body_x", "start/control/joint_force"} <= set(file.files)
        assert 0.8 * 0.1 <= file["model/body_mass"][0] <= 1.2 * 0.1
        assert len(file["actions"]) == min(step + 1, 20)


@pytest.mark.parametrize("when", ["episode", "step"])
@pytest.mark.parametrize(("step", "resumed"), [(8, False), (8, True), (45, False), (45, True)])
@pytest.mark.sweep
def test_a_break_is_repeated_where_the_level_rose_since_the_episode_began(tmp_path, when, step, resumed):
    """What an episode draws at its beginning is of the level then, what it draws in a step of the level there."""

    def made():
        return make("pendulum", 4, seed=5, guard_steps=20, max_angle=1e6, max_position=1e6, decimation=2,
                    randomise={"body_mass": Range(0.2, 3.0, grows=True, when=when)},
                    curriculum=Curriculum(Driver.ITERATION, first=0, last=20))  # fmt: skip

    task = made()
    task.on_iteration(4)
    task.restart()
    generator = torch.Generator().manual_seed(0)
    for index in range(step + 1):
        if index and index % 4 == 0:
            task.on_iteration(4 + index // 4)
        if resumed and index == step - 6:
            saved, task = task.state_dict(), made()
            task.load_state_dict(saved)
        action = torch.rand(4, 1, generator=generator) * 0.2 - 0.1
        if index == step:
            action[2] = torch.nan
        task.step(action)
    guard_of(task).path = tmp_path / "broken.npz"
    task.drain_statistics()
    report = replay(guard_of(task).path)
    assert report.reproduced
    assert report.from_reset is (step == 8 and not resumed)
    assert report.largest_difference == 0.0
    with np.load(guard_of(task).path) as file:
        assert json.loads(str(file["meta"]))["level"] == pytest.approx(0.2)


def test_only_the_first_break_is_kept_and_a_sound_run_writes_nothing(tmp_path):
    task = make("pendulum", 3, guard_steps=10)
    guard_of(task).path = tmp_path / "broken.npz"
    for _ in range(25):
        task.step(torch.zeros(3, 1))
    task.drain_statistics()
    assert guard_of(task).dump is None
    assert not guard_of(task).path.exists()
    with pytest.raises(ValueError, match="no world has broken down"):
        guard_of(task).write(guard_of(task).path)
    break_world(task, 1, 2, 4)
    guard_of(task).look()
    first = guard_of(task).path.read_bytes()
    break_world(task, 0, 2, 4)
    guard_of(task).look()
    assert guard_of(task).path.read_bytes() == first
    assert task.drain_statistics().end_reasons["non_finite"] == 2


def test_nothing_is_kept_where_the_guard_is_off():
    assert make("pendulum", 1, guard_steps=0).guard is None
    assert make("fast", 1).guard is None


def test_the_break_of_an_ant_is_repeated(tmp_path):
    task = make("ant", 3, seed=2, guard_steps=30)
    guard_of(task).path = tmp_path / "broken.npz"
    for index in range(50):
        action = torch.sin(torch.arange(24).view(3, 8) + 0.3 * index) * 0.3
        if index == 44:
            action[1, 3] = torch.nan
        task.step(action)
    guard_of(task).look()
    report = replay(guard_of(task).path)
    assert report.reproduced
    assert report.largest_difference == 0.0


def test_other_files_are_refused(tmp_path):
    with pytest.raises(FileError, match="does not exist"):
        replay(tmp_path / "missing.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(FileError, match=r"is no \.npz file of arrays"):
        replay(tmp_path / "text.npz")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(InputError, match="no dump of a broken world"):
        replay(tmp_path / "other.npz")
    np.savez(tmp_path / "future.npz", meta=np.array(json.dumps({"format": 99})))
    with pytest.raises(InputError, match="format 99, this version of simwarp reads 1"):
        replay(tmp_path / "future.npz")


def spoiling(monkeypatch, method, name):
    """Let a method of the pendulum return NaN in a world whose cart is beyond 0.5 m."""
    plain = getattr(PendulumTask, method)

    def spoilt(self):
        values = plain(self)
        far = self.views.joint_q[:, self.slide] > 0.5
        value = values[name]
        return values | {name: torch.where(far.view(-1, *(1,) * (value.dim() - 1)), torch.nan, value)}

    monkeypatch.setattr(PendulumTask, method, spoilt)


@pytest.mark.parametrize(("method", "name"), [("rewards", "alive"), ("observations", "policy")])
@pytest.mark.parametrize("broken_before", [False, True])
def test_a_value_that_is_not_finite_is_kept_and_repeated(tmp_path, monkeypatch, method, name, broken_before):
    """Fails where only a break of the physics leaves a dump."""
    spoiling(monkeypatch, method, name)
    task = make("pendulum", 3, seed=5, guard_steps=20, max_angle=1e6, max_position=1e6, action_rise_time=0.0,
                first_world=8)  # fmt: skip
    assert isinstance(task, PendulumTask)
    guard_of(task).path = tmp_path / "broken.npz"
    if broken_before:
        task.step(torch.tensor([[-1.0], [torch.nan], [1.0]]))
        task.drain_statistics()
    steps = 0
    while task.views.joint_q[2, task.slide] <= 0.5:
        task.step(torch.tensor([[-1.0], [-1.0], [1.0]]))
        steps += 1
        assert steps < 1000, "the cart does not get there"
    path = tmp_path / ("broken_value.npz" if broken_before else "broken.npz")
    with pytest.raises(TaskStepError) as caught:
        task.drain_statistics()
    kind = method.removesuffix("s")
    first = steps + int(broken_before)
    assert f"{kind} '{name}' was NaN or infinite in 1 world-step of 3 worlds, first in world 10 at" in str(caught.value)
    assert f"at control step {first} (step {first} of its episode 0)" in str(caught.value)
    assert f"`simwarp replay {path}` repeats what led there" in str(caught.value)
    report = replay(path)
    assert report.value == f"{kind} '{name}'"
    assert (report.world, report.episode_step, report.reproduced) == (10, first, True)
    assert report.largest_difference == 0.0
