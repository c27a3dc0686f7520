"""Control steps from a graph: equal to eager ones, recorded anew when something has changed, and given up by name.

Graphs are emulated on the CPU; the last test uses a GPU where there is one.
"""

import contextlib
import dataclasses
from typing import Any

import pytest
import torch

from simwarp.tasks import Curriculum, Driver, Range, Sensing, check_step, make
from simwarp.tasks.arms.reaching import ReachActions
from simwarp.tasks.framework.capture import recorder_of
from simwarp.train.algorithm.vec_env import TaskVecEnv
from tests.tasks.framework.graph_emulation import Emulator
from tests.tasks.framework.samples import Counter, SampleConfig, counter
from tests.tasks.framework.test_step_check import BUDGETS

WARM = 2
BESIDE = {"fast": (5, 9), "pendulum": (2, 6), "ant": (5, 9)}
"""Launches of a control step beside its graph: called by a program, and by rsl-rl. Copies in and out, nothing more."""


def emulated(task):
    """The task, as if it could capture; and what makes its graphs."""
    emulator = Emulator()
    task._captured._record, task._captured.reason = emulator.record, ""
    return task, emulator


def roll(task, steps, seed=0):
    """All that steps hand out, copied."""
    generator = torch.Generator().manual_seed(seed)
    rows = []
    for _ in range(steps):
        result = task.step(2.0 * torch.rand(task.num_worlds, task.action_size, generator=generator) - 1.0)
        rows.append({name: copied(value) for name, value in vars(result).items()})
    return rows


def copied(value):
    if isinstance(value, dict):
        return {name: copied(part) for name, part in value.items()}
    return value if value is None else value.clone()


def same(first, second):
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(same(first[name], second[name]) for name in first)
    if isinstance(first, list):
        return len(first) == len(second) and all(same(*pair) for pair in zip(first, second, strict=True))
    return torch.equal(first, second) if isinstance(first, torch.Tensor) else first == second


CASES: dict[str, tuple[str, dict[str, Any]]] = {
    **{f"{name} {obs or ''}".strip(): (name, {"obs": obs} if obs else {}) for name, obs in BUDGETS},
    "ant uncertain": (
        "ant", {
            "action_delay": (0, 2), "action_rise_time": 0.1, "randomise": {"body_mass": Range(0.8, 1.2)},
            "sensing": {"policy": Sensing(noise=0.01, bias=0.1, delay=(0, 2))},
            "curriculum": Curriculum(driver=Driver.PROGRESS),
        },
    ),
    "racer3-reach displacements": ("racer3-reach", {"actions": ReachActions.DISPLACEMENT}),
    "tracks of drawn tension": ("tracked-off-road", {"obs": "state", "tension": (0.8, 1.2), "friction": (0.4, 0.8)}),
    "pendulum at random": ("pendulum", {"randomise": {"gravity": Range(0.5, 1.5, when="step")}}),
}  # fmt: skip
LONG = {"barrier-track camera", "hallway camera", "obstacle-avoidance camera", "hallway state"}


@pytest.mark.long(*LONG)
@pytest.mark.parametrize("case", CASES)
def test_replayed_steps_equal_eager_ones(case):
    name, options = CASES[case]
    if options.get("obs") == "camera":
        options = options | {"camera_width": 40, "camera_height": 36}
    tasks = [make(name, 3, seed=4, max_episode_steps=4, guard_steps=6, **options) for _ in range(2)]
    task, emulator = emulated(tasks[1])
    for each in tasks:
        if "curriculum" in options:
            each.on_iteration(0)
    assert same(roll(tasks[0], 13), roll(task, 13))
    assert (emulator.recorded, emulator.replayed) == (1, 13 - WARM)
    assert task.not_captured == ""
    assert int(task.episode_index.min()) >= 3  # resets happened on the way
    assert same(copied(tasks[0].restart(seed=9)), copied(task.restart(seed=9)))
    assert same(roll(tasks[0], 6, seed=1), roll(task, 6, seed=1))  # with other random numbers
    assert emulator.recorded == 1
    assert dataclasses.asdict(tasks[0].drain_statistics()) == dataclasses.asdict(task.drain_statistics())


def test_on_a_cpu_steps_stay_eager():
    assert recorder_of(torch.device("cpu")) is None
    task = counter()
    roll(task, 5)
    assert task.not_captured == "there is no CUDA device"
    assert make("fast", 2, capture=False).not_captured == "it is switched off"


def test_nothing_is_captured_where_it_is_switched_off():
    task, emulator = emulated(counter())
    task.capture = False
    roll(task, 5)
    assert emulator.recorded == 0
    task.capture = True
    roll(task, WARM + 2)
    assert (emulator.recorded, emulator.replayed) == (1, 2)


def test_flags_of_a_step_are_seen_at_once():
    task, emulator = emulated(counter())
    roll(task, 4)
    task.keep_final_observations = False
    assert [row["final_observations"] for row in roll(task, 3)] == [None] * 3
    assert emulator.recorded == 2
    task.on_iteration(7)
    task.level.fill_(0.5)
    roll(task, 2)
    assert emulator.recorded == 2  # neither is read by Python


def test_what_is_called_before_a_reset_is_called_between_two_graphs():
    eager, (task, emulator) = counter(), emulated(counter())
    seen: dict[Any, list[Any]] = {eager: [], task: []}
    for each in (eager, task):
        each.before_reset = lambda each=each: seen[each].append(each.count.flatten().tolist())
    assert same(roll(eager, 12), roll(task, 12))
    assert seen[task] == seen[eager]
    assert max(row[0] for row in seen[task]) == 5.0
    assert (emulator.recorded, emulator.replayed) == (2, 2 * (12 - WARM))
    task.before_reset = None
    roll(task, 4)
    assert emulator.recorded == 3


class Scheduled(Counter):
    """The reward hangs on the iteration, or on a number that an iteration sets."""

    name = "scheduled"
    weight = 1.0

    def on_iteration(self, iteration):
        super().on_iteration(iteration)
        self.weight = float(iteration // 2)

    def rewards(self):
        return {"one": self.count[:, 0] * self.weight, "two": self.count[:, 0] * self.iteration}


def test_what_changes_with_the_iteration_is_recorded_anew():
    eager, (task, _) = Scheduled(SampleConfig(), 2), emulated(Scheduled(SampleConfig(), 2))
    for iteration in range(5):
        for each in (eager, task):
            each.on_iteration(iteration)
        assert same(roll(eager, 7), roll(task, 7))
    assert task.not_captured == ""


class Rebinding(Counter):
    """Keeps its count in a new tensor after every step."""

    name = "rebinding"

    def apply(self, action):
        self.count = self.count + 1.0


def test_a_task_that_binds_its_state_anew_steps_eagerly_and_is_told_why():
    eager, (task, emulator) = Rebinding(SampleConfig(), 2), emulated(Rebinding(SampleConfig(), 2))
    with pytest.warns(RuntimeWarning, match="task 'rebinding'.*not captured.*: count is another object") as told:
        rows = roll(task, 9)
    assert len(told) == 1
    assert same(roll(eager, 9), rows)
    assert emulator.recorded == 0
    assert task.not_captured.startswith("count is another object")


class Paid(Counter):
    """The reward hangs on a number that a program may change between steps."""

    name = "paid"
    bonus = 0.0

    def rewards(self):
        return {"one": self.count[:, 0] + self.bonus}


def test_a_step_that_was_recorded_with_sensors_in_step_is_not_replayed_else():
    options: dict[str, Any] = {"obs": "camera", "camera_width": 40, "camera_height": 36}
    tasks = [make("obstacle-avoidance", 2, seed=4, max_episode_steps=4, **options) for _ in range(2)]
    task, emulator = emulated(tasks[1])
    assert same(roll(tasks[0], 5), roll(task, 5))
    for each in tasks:
        each.simulation.step()  # between two control steps: clocks of worlds that are reset later are others
    assert same(roll(tasks[0], 6, seed=1), roll(task, 6, seed=1))
    assert emulator.recorded == 2
    assert same(copied(tasks[0].restart()), copied(task.restart()))
    assert same(roll(tasks[0], 3, seed=2), roll(task, 3, seed=2))
    assert (emulator.recorded, task.not_captured) == (3, "")
    state = tasks[0].state_dict()
    for each in tasks:
        each.load_state_dict(state)
    assert same(roll(tasks[0], 3, seed=3), roll(task, 3, seed=3))
    assert emulator.recorded == 3
    assert same(copied(tasks[0].state_dict()["simulation"]), copied(task.state_dict()["simulation"]))


@pytest.mark.parametrize(("every", "reason"), [(8, ""), (1, "bonus changes too often")])
def test_a_number_that_changes_is_seen_and_one_that_always_does_ends_it(every, reason):
    eager, (task, _) = Paid(SampleConfig(), 2), emulated(Paid(SampleConfig(), 2))
    rows: dict[Any, list[Any]] = {eager: [], task: []}
    with pytest.warns(RuntimeWarning, match=reason) if reason else contextlib.nullcontext():
        for step in range(24):
            for each in (eager, task):
                if step % every == 0:
                    each.bonus = float(step)
                rows[each] += roll(each, 1, seed=step)
    assert same(rows[eager], rows[task])
    assert task.not_captured == reason


def test_what_a_device_refuses_is_told_and_done_eagerly():
    eager, (task, _) = counter(), emulated(counter())

    def refuse(body):
        raise RuntimeError("CUDA error: operation not permitted when stream is capturing\nmore words")

    task._captured._record = refuse
    with pytest.warns(RuntimeWarning, match="task 'counter': .*: CUDA error: operation not permitted") as told:
        rows = roll(task, 8)
    assert len(told) == 1
    assert "more words" not in str(told[0].message)
    assert same(roll(eager, 8), rows)


@pytest.mark.cuda
@pytest.mark.parametrize("name", ["fast", "pendulum", "ant", "off-road", "convoy"])
def test_steps_of_a_gpu_are_captured(name):
    seeing = {"obs": "camera", "camera_width": 40, "camera_height": 36}
    options: dict[str, Any] = seeing if name in ("off-road", "convoy") else {}
    tasks = [
        make(name, 3, seed=4, max_episode_steps=4, device="cuda", capture=capture, **options)
        for capture in (False, True)
    ]
    eager, captured = ([{key: cpu(value) for key, value in row.items()} for row in roll(task, 9)] for task in tasks)
    assert tasks[1].not_captured == ""
    assert same(eager, captured)


@pytest.mark.cuda
@pytest.mark.parametrize("name", BESIDE)
def test_a_captured_step_launches_little_beside_its_graph(name):
    task = make(name, 2, device="cuda")
    own, of_rsl_rl = BESIDE[name]
    report = check_step(task)
    assert task.not_captured == ""
    assert report.problems() == []
    assert report.total <= own
    assert check_step(task, step=TaskVecEnv(task).step).total <= of_rsl_rl


def cpu(value):
    if isinstance(value, dict):
        return {name: part.cpu() for name, part in value.items()}
    return value if value is None else value.cpu()
