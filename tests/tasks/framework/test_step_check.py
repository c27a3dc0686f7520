"""A control step does nothing that a CUDA graph cannot hold, and launches no more than its budget: of every task."""

import pytest
import torch
import warp as wp

from simwarp.core.interop import from_torch
from simwarp.tasks import check_step, make, task_class, task_names
from tests.tasks.framework.samples import Counter, SampleConfig

BUDGETS = {
    ("fast", None): (102, 25),
    ("pendulum", None): (128, 32),
    ("ant", None): (362, 80),
    ("hexapod", None): (379, 94),
    ("racer3-reach", None): (83, 83),
    ("irb120-reach", None): (83, 83),
    ("crane", None): (96, 96),
    ("barrier-track", "state"): (2173, 543),
    ("barrier-track", "camera"): (2157, 539),
    ("hallway", "state"): (3557, 889),
    ("hallway", "camera"): (3579, 894),
    ("obstacle-avoidance", "state"): (1267, 316),
    ("obstacle-avoidance", "camera"): (1209, 302),
    ("off-road", "state"): (1667, 400),
    ("off-road", "camera"): (2134, 400),
    ("tracked-off-road", "state"): (320, 336),
    ("tracked-off-road", "camera"): (416, 432),
    ("convoy", "state"): (3206, 800),
    ("convoy", "camera"): (4134, 800),
    ("quadruped-velocity", "state"): (365, 380),
    ("quadruped-velocity", "scan"): (397, 412),
    ("quadruped-velocity", "history"): (353, 368),
    ("hexapod-velocity", "state"): (365, 380),
}
"""Torch operations and Warp launches of a control step: when they were first counted, and the most that is allowed."""
OWN = 40
"""Those of a task and the loop that all tasks share, beside one launch before each physics step."""
COMPOSED = {"quadruped-velocity": 400, "hexapod-velocity": 400}
"""The same of tasks that are composed of plain torch functions rather than written as kernels: what authors pay."""


def task_of(name, obs, **options):
    if obs is not None:
        options["obs"] = obs
    if obs == "camera":
        options |= {"camera_width": 40, "camera_height": 36}
    return make(name, 2, **options)


def test_every_task_has_a_budget():
    own = {
        name for name in task_names() if task_class(name).__module__.startswith("simwarp.")
    }  # not those of test files
    assert {name for name, _ in BUDGETS} == own


@pytest.mark.parametrize(("name", "obs"), BUDGETS, ids=lambda part: part or "")
@pytest.mark.sweep
def test_a_control_step_fits_into_one_graph(name, obs):
    task = task_of(name, obs)
    report = check_step(task)
    assert report.problems() == []
    assert report.total <= BUDGETS[name, obs][1]
    own = sum(report.operations.values())
    own += sum(count for place, count in report.launches.items() if place.startswith("tasks/"))
    assert own <= COMPOSED.get(name, OWN) + task.config.decimation


@pytest.mark.parametrize("soil", ["random", "mid"])
def test_neither_do_draws_of_soil(soil):
    assert check_step(make("off-road", 2, obs="state", soil=soil, obstacles=1)).problems() == []


def test_the_recording_of_the_last_steps_does_not_wait_either():
    assert check_step(task_of("pendulum", None, guard_steps=2)).problems() == []  # a snapshot in every step


class Sinner(Counter):
    """A task that does one thing in every step that it must not."""

    name = "sinner"
    deed = staticmethod(lambda task: None)

    def apply(self, action):
        super().apply(action)
        self.deed(self)


@wp.kernel(enable_backward=False)
def nothing(values: wp.array[float]):
    values[wp.tid()] = 0.0  # type: ignore[index]


def rebind(task):
    task.kept = task.count + 1.0


def count_in_python(task):
    task.steps_so_far = getattr(task, "steps_so_far", 0) + 1


@pytest.mark.parametrize(
    ("deed", "what"),
    [
        (lambda task: task.count.max().item(), "_local_scalar_dense reads the device"),
        (lambda task: bool((task.count > 0.0).any()), "_local_scalar_dense reads the device"),
        (lambda task: task.count.nonzero(), "nonzero reads the device"),
        (lambda task: task.count[task.fail], "index reads the device"),
        (lambda task: task.count + torch.tensor([1.0]), "lift_fresh reads the device"),
        (lambda task: task.count.tolist(), "tolist reads the device"),
        (lambda task: task.count.numpy(), "numpy reads the device"),
        (lambda task: task.count.cpu(), "cpu reads the device"),
        (lambda task: task.count.to("cpu"), "to reads the device"),
        (lambda task: task.count.to(device="cpu", dtype=torch.float64), "to reads the device"),
        (lambda task: torch.allclose(task.count, task.count), "allclose reads the device"),
        (lambda task: torch.bincount(task.episode_index), "bincount reads the device"),
        (lambda task: task.count.repeat_interleave(task.episode_index, dim=0), "repeat_interleave reads the device"),
        (lambda task: from_torch(task.count).numpy(), "numpy reads the device"),
        (lambda task: wp.synchronize(), "synchronize reads the device"),
        (lambda task: wp.zeros(3, dtype=float, device="cpu"), "zeros allocates"),
        (lambda task: wp.clone(from_torch(task.count)), "clone allocates"),
        (lambda task: wp.launch(nothing, 1, [from_torch(task.count).flatten()], device="cpu"), "launches without"),
        (rebind, "kept is another object"),
        (count_in_python, "steps_so_far is another object"),
    ],
)  # fmt: skip
def test_what_a_step_must_not_do_is_found(deed, what):
    task = type("Sinner", (Sinner,), {"deed": staticmethod(deed)})(SampleConfig(), 3)
    problems = check_step(task).problems()
    assert len(problems) == 1
    assert what in problems[0]
    assert "test_step_check.py:" in problems[0] or "another object" in problems[0]


def test_a_move_to_the_tasks_own_device_is_none():
    move = staticmethod(lambda task: task.count.to(task.device).to(torch.float64).repeat_interleave(2, dim=0))
    task = type("Sinner", (Sinner,), {"deed": move})(SampleConfig(), 3)
    assert check_step(task).problems() == []


def test_a_task_in_torch_may_do_what_it_likes_else():
    report = check_step(Counter(SampleConfig(), 3))
    assert report.problems() == []
    own = {place: count for place, count in report.operations.items() if place.startswith("samples.py")}
    # count += 1, image += 1; ones_like, clone; clone of fail; three masked_fill_
    assert sum(own.values()) == 8.0


def test_rounds_are_counted_by_step():
    report = check_step(task_of("pendulum", None, decimation=3), steps=4)
    places = [count for place, count in report.launches.items() if place.endswith(" step_trees")]
    assert max(places) == 3.0  # one launch for each physics step
