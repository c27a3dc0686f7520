"""Worlds of a task that become copies of another one go on like it under the same actions, bit by bit."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from simwarp.tasks import InputError, Range, Sensing, make

WORLDS, SOURCE = 5, 3

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "pendulum": ("pendulum", {}),
    "pendulum, late": (
        "pendulum",
        {
            "action_delay": (0, 3),
            "randomise": {"body_mass": Range(0.5, 1.5)},
            "sensing": {"policy": Sensing(delay=(0, 2))},
            "action_rise_time": 0.3,
        },
    ),
    "ant": ("ant", {}),
    "hexapod": ("hexapod", {}),
    "obstacle-avoidance": ("obstacle-avoidance", {"obs": "state", "conditions": "random"}),
}  # fmt: skip


def made(case: str, worlds: int = WORLDS) -> Any:
    name, options = CASES[case]
    return make(name, worlds, device="cpu", seed=2, **options)


def actions(task: Any, step: int, *, alike: bool) -> torch.Tensor:
    generator = torch.Generator().manual_seed(step)
    drawn = 2.0 * torch.rand(64, task.action_size, generator=generator) - 1.0
    return drawn[:1].expand(task.num_worlds, -1) if alike else drawn[: task.num_worlds]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("apart", [False, True], ids=["in one task", "in another task"])
def test_copies_observe_what_their_source_observes(case, apart):
    real = made(case)
    for step in range(6):
        real.step(actions(real, step, alike=False))
    imagined = made(case, 3) if apart else real
    imagined.copy_worlds(SOURCE, [0, 2], of=real if apart else None)
    for step in range(6, 14):
        request = actions(real, step, alike=True)
        results = [task.step(request[: task.num_worlds]) for task in ((imagined, real) if apart else (real,))]
        mine, theirs = results[0], results[-1]
        for name, group in mine.observations.items():
            for world in (0, 2):
                assert torch.equal(group[world], theirs.observations[name][SOURCE]), (name, step)
        assert torch.equal(mine.rewards[[0, 2]], theirs.rewards[[SOURCE, SOURCE]])
        assert torch.equal(mine.terminated[[0, 2]], theirs.terminated[[SOURCE, SOURCE]])
    assert torch.equal(imagined.episode_index[[0, 2]], real.episode_index[[SOURCE, SOURCE]])


def test_a_saved_task_remembers_as_which_world_each_draws():
    task = made("pendulum, late")
    task.copy_worlds(SOURCE, [0])
    state = task.state_dict()
    other = made("pendulum, late")
    other.load_state_dict(state)
    for step in range(12):
        results = [each.step(actions(each, step, alike=True)) for each in (task, other)]
        assert torch.equal(results[0].observations["policy"], results[1].observations["policy"])
    task.restart(seed=2)
    assert torch.equal(task.observe()["policy"], made("pendulum, late").observe()["policy"])


def test_another_seed_is_refused():
    with pytest.raises(InputError, match="must have one seed, got 2 and 5"):
        make("pendulum", 2, device="cpu", seed=5).copy_worlds(0, of=made("pendulum"))


def test_what_is_copied_leaves_the_source_as_it_was():
    real, imagined = made("ant"), made("ant", 4)
    for step in range(4):
        real.step(actions(real, step, alike=False))
    before = real.state_dict()
    imagined.copy_worlds(SOURCE, of=real)
    for step in range(5):
        imagined.step(actions(imagined, step, alike=False))
    after = real.state_dict()
    for name, array in before["simulation"]["state"].items():
        assert torch.equal(array, after["simulation"]["state"][name]), name


def test_another_task_is_refused():
    with pytest.raises(InputError, match="of must be a task 'pendulum'"):
        made("pendulum").copy_worlds(0, of=made("ant"))
