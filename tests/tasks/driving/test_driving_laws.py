"""Laws that all tasks obey, for driving: what decides an episode, what does not, and going on after a stop."""

from typing import Any

import pytest
import torch

from simwarp.core.interop import to_torch
from simwarp.tasks.framework.replay import replay
from simwarp.tasks.randomisation.randomisation_config import Curriculum, Driver
from tests.tasks.driving.driving_checks import NAMES, SMALL, copied, driving, random_actions

STEPS = 8
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (name, {}) for name in NAMES},
    "seen hills": (
        "off-road",
        {**SMALL, "hills": 1.0, "obstacles": 6, "curriculum": Curriculum(driver=Driver.PROGRESS)},
    ),
    "soil": ("off-road", {"soil": "random", "obstacles": 6}),
    "seen convoy": ("convoy", {**SMALL, "generated": True}),
    "seen hallway": ("hallway", {**SMALL, "tracks": 2, "start": "anywhere"}),
    "drawn": ("obstacle-avoidance", {**SMALL, "conditions": "random"}),
}
SLOW: dict[str, tuple[str, dict[str, Any]]] = {
    "pedals": ("hallway", {"pedals": True, "tracks": 2}),
    "seen road": ("obstacle-avoidance", SMALL),
    "seen track": ("barrier-track", SMALL),
    "seen hills 50": ("off-road", {**SMALL, "hills": 1.0, "obstacles": 50}),
    "drawn hallway": ("hallway", {**SMALL, "tracks": 2, "conditions": "random"}),
    "drawn convoy": ("convoy", {"conditions": "random"}),
}


def build(case, worlds=3, **options):
    name, own = {**CASES, **SLOW}[case]
    task = driving(name, worlds, **{"max_episode_steps": 3, **own, **options})
    if task.config.curriculum.driver is Driver.PROGRESS:
        task.on_iteration(0)
    return task


@pytest.fixture(scope="module", params=[*CASES, *(pytest.param(case, marks=pytest.mark.slow) for case in SLOW)])
def case(request):
    return request.param, build(request.param)


def roll(task, actions, seed=3):
    """All that a run shows, from a restart on; or from where the task is, with no seed."""
    seen = []
    if seed is not None:
        task.level.fill_(0.75 if task.config.curriculum.driver is Driver.PROGRESS else 1.0)
        seen.append(copied(task.restart(seed=seed)))
    for action in actions:
        result = task.step(action)
        seen.append({
            **copied(result.observations), "rewards": result.rewards.clone(), "reason": result.end_reason.clone(),
            **{f"final {name}": group.clone() for name, group in result.final_observations.items()},
        })  # fmt: skip
    return seen


def assert_equal(first, second, pick=slice(None), other=slice(None)):
    for step, (left, right) in enumerate(zip(first, second, strict=True)):
        for name, value in left.items():
            assert torch.equal(value[pick], right[name][other]), f"{name} in step {step}"


@pytest.mark.quick("obstacle-avoidance", "hallway", "seen hallway", "drawn")
def test_the_seed_alone_decides_not_the_past(case):
    name, task = case
    actions = random_actions(task, STEPS)
    first = roll(task, actions)
    ends = torch.stack([step["reason"] for step in first[1:]])
    assert (ends >= 0).sum() >= 2 * task.num_worlds
    assert_equal(first, roll(task, actions))
    assert_equal(first, roll(build(name, seed=8), actions))
    other = roll(task, actions, seed=4)[-1]
    assert any(not torch.equal(first[-1][group], other[group]) for group in task.observation_shapes)


@pytest.mark.sweep
def test_a_disturbed_world_disturbs_no_other(case):
    _, task = case
    actions = random_actions(task, STEPS)
    first = roll(task, actions)
    actions[2:, 1] = -actions[2:, 1]
    second = roll(task, actions)
    assert_equal(first, second, [0, 2], [0, 2])
    assert not torch.equal(first[-1]["policy"][1], second[-1]["policy"][1])


@pytest.mark.quick("obstacle-avoidance", "hallway", "off-road", "seen hallway", "drawn")
def test_worlds_depend_neither_on_how_many_there_are_nor_on_which_process_has_them(case):
    name, task = case
    actions = random_actions(task, STEPS)
    first = roll(task, actions)
    assert_equal(first, roll(build(name, worlds=2, first_world=1), actions[:, 1:]), [1, 2])


@pytest.mark.quick("obstacle-avoidance", "hallway", "convoy", "seen hallway", "drawn")
def test_a_saved_state_goes_on_exactly(case):
    """In a task that was made with another seed and has driven elsewhere, in the middle of an episode."""
    name, task = case
    actions = random_actions(task, STEPS)
    roll(task, actions[:5])
    state = task.state_dict()
    assert task.episode_steps.max() > 0
    seen = copied(task.observe())
    expected = roll(task, actions[5:], seed=None)
    other = build(name, seed=9)
    roll(other, actions[:3], seed=11)
    other.load_state_dict(state)
    assert_equal([seen], [copied(other.observe())])
    assert_equal(expected, roll(other, actions[5:], seed=None))


@pytest.mark.quick("none-2", "drawn-11")
@pytest.mark.parametrize("stop", [2, 11])
@pytest.mark.parametrize("soil", ["none", "random", "drawn"])
def test_what_the_guard_keeps_repeats_a_drive(stop, soil, tmp_path):
    """One world alone, from its reset or from a snapshot: the world around it is drawn again."""
    curriculum = Curriculum(driver=Driver.PROGRESS)
    drawn = {"conditions": "random"} if soil == "drawn" else {"soil": soil}
    task = driving("off-road", 3, seed=5, guard_steps=6, hills=1.0, curriculum=curriculum, **drawn)
    task.on_iteration(0)
    task.level.fill_(0.8)
    task.restart(seed=6)
    for action in random_actions(task, stop):
        task.step(action)
    guard = task.guard
    guard._drawn_level.copy_(task.level)  # as it does when a world breaks down
    guard.dump = guard._cut_out(1, stop - 1, int(task.episode_index[1]), int(task.episode_steps[1]))
    report = replay(guard.write(tmp_path / "kept.npz"))
    assert report.from_reset == (stop == 2)
    assert report.largest_difference == 0.0


@pytest.mark.quick("obstacle-avoidance")
@pytest.mark.parametrize("name", NAMES)
def test_a_look_at_the_scene_changes_nothing(name):
    """Pictures of a task without a camera are taken from time to time; the drive goes on as if they were not."""
    task, other = (driving(name, 2, seed=1) for _ in range(2))
    actions = random_actions(task, 6)
    first, second = (roll(each, actions[:3], seed=None) for each in (task, other))
    assert_equal(first, second)
    scene = task.scene()
    assert scene is task.scene()
    assert_equal(roll(task, actions[3:], seed=None), roll(other, actions[3:], seed=None))


def test_mirrored_pillars_and_steering_make_a_mirrored_drive():
    task = driving("obstacle-avoidance", 2)
    pillars = to_torch(task.simulation.model.shape_x)[:, task.pillars, 1]
    pillars[1] = -pillars[0]
    to_torch(task.simulation.model.shape_x)[:, task.pillars, 1] = pillars
    # speed, yaw rate, steering, sideways, pedal, place, heading (sine, cosine), way to go,
    # two pillars (x, y); then ranges
    sign = torch.tensor([1, -1, -1, -1, 1, -1, -1, 1, 1, 1, -1, 1, -1.0])
    actions = random_actions(task, 30)
    actions[..., 1] = actions[..., 1].abs()
    actions[:, 1] = actions[:, 0] * torch.tensor([-1.0, 1.0])
    for action in actions:
        result = task.step(action)
        left, right = result.observations["policy"]
        # of entries around 1: the engine's torque rolls the body to one side, whichever way the truck steers, and
        # where it breaks away from standing that shows most
        assert (left[:13] - sign * right[:13]).abs().max() < 0.04
        # ranges from right to left; a ray that grazes a pillar may pass its mirror image
        assert ((left[13:] - right[13:].flip(0)).abs() > 0.04).sum() <= 2
        assert float((result.rewards[0] - result.rewards[1]).abs()) < 1e-3
    assert left[0] > 0.3
    assert left[7] < 0.9995
