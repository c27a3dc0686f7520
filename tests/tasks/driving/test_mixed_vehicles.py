"""Several vehicles in one batch, and another vehicle than the task's own."""

from typing import Any

import pytest
import torch

from simwarp.tasks import InputError, make
from simwarp.tasks.driving import DRIVEN_VEHICLES
from tests.tasks.driving.driving_checks import SMALL, random_actions
from tests.tasks.framework.test_task_threads import bits, different

THREE = "hmmwv,gator,sedan"
CASES = {
    "by state": ("obstacle-avoidance", {"obs": "state"}),
    "by camera": ("obstacle-avoidance", SMALL),
    "off-road": ("off-road", {**SMALL, "hills": 0.5, "obstacles": 4, "conditions": "random"}),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_rows_are_those_of_each_vehicle_alone(case):
    name, options = CASES[case]
    options = {**options, "max_episode_steps": 3, "guard_steps": 0}
    task = make(name, 5, seed=3, vehicle=THREE, **options)
    actions = random_actions(task, 4)
    steps = [task.step(action) for action in actions]
    exact = task.observe_privileged()
    for group in task.model_groups:
        single: Any = make(name, group.count, seed=3, vehicle=group.name, first_world=group.rows.start, **options)
        for action, step in zip(actions, steps, strict=True):
            found = bits(vars(single.step(action[group.rows])))
            assert different(found, bits(_rows(vars(step), group.rows))) == []
        alone = single.observe_privileged()
        assert (exact is None) == (alone is None)
        if exact is not None and alone is not None:
            assert torch.equal(exact[group.rows], alone)


def _rows(value, rows):
    if isinstance(value, dict):
        return {name: _rows(part, rows) for name, part in value.items()}
    return value if value is None else value[rows].clone()  # as the pieces of a block are


@pytest.mark.parametrize("vehicle", DRIVEN_VEHICLES)
def test_another_vehicle_has_its_own_measures(vehicle):
    task: Any = make("obstacle-avoidance", 1, obs="state", vehicle=vehicle, guard_steps=0)
    known = DRIVEN_VEHICLES[vehicle]
    assert task.spec.name.startswith(vehicle)
    assert task.chassis_half == known.chassis_half
    assert type(task).vehicle_name == "hmmwv-reduced"  # other tasks of the class keep their own


@pytest.mark.parametrize(
    ("name", "options", "text"),
    [
        ("obstacle-avoidance", {"vehicle": "tank"}, "vehicle must be different ones of hmmwv, gator, sedan"),
        ("obstacle-avoidance", {"vehicle": "gator,gator"}, "vehicle must be different ones"),
        ("obstacle-avoidance", {"vehicle": ""}, "vehicle must be different ones"),
        ("obstacle-avoidance", {"vehicle": THREE, "mix": "full=true,false"}, "mix must be empty where vehicle names"),
        ("tracked-off-road", {"vehicle": "gator"}, "vehicle must be None: the task's own has tracks, got 'gator'"),
        ("obstacle-avoidance", {"vehicle": THREE}, "3 models (hmmwv, gator, sedan) need a world each, got 1"),
    ],
)
def test_vehicles_that_cannot_be_driven_are_refused_in_one_line(name, options, text):
    with pytest.raises(InputError) as error:
        make(name, 1, **options)
    assert text in str(error.value)
    assert "\n" not in str(error.value)
