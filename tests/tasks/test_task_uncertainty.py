"""What a configuration makes uncertain: parameters, sensing, delays, rate limits, and the curriculum's level."""

import dataclasses
import json

import pytest
import torch
from simwarp.tasks import (
    Curriculum,
    Driver,
    InputError,
    Range,
    Sensing,
    TaskConfig,
    config_from_plain,
    config_to_plain,
    make,
    replace_fields,
)

from simwarp.interop import to_torch
from tests.tasks.samples import Counter, SampleConfig, counter


def masses(task):
    return to_torch(task.simulation.model.body_mass).clone()


def idle(task):
    return torch.zeros(task.num_worlds, task.action_size)


def test_parameters_differ_by_world_and_episode_within_their_range_and_return():
    built = masses(make("pendulum", 1))
    spec = {"body_mass": Range(0.8, 1.2), "joint_damping": Range(0.1, 0.3, mode="set", only="hinge")}
    task = make("pendulum", 500, seed=4, randomise=spec)
    first = masses(task)
    ratio = first / built
    assert 0.8 <= float(ratio.min()) < 0.81
    assert 1.19 < float(ratio.max()) <= 1.2
    assert not torch.allclose(ratio[:, 0], ratio[:, 1])
    damping = to_torch(task.simulation.model.joint_damping)
    assert damping[:, 0].abs().max() == 0.0
    assert 0.1 <= float(damping[:, 1].min()) < float(damping[:, 1].max()) <= 0.3
    task.restart()
    assert not torch.equal(masses(task), first)
    task.restart(seed=4)
    assert torch.equal(masses(task), first)


def test_a_world_draws_the_same_parameters_however_many_run():
    spec = {"body_mass": Range(0.5, 2.0)}
    many, part = make("pendulum", 5, randomise=spec), make("pendulum", 2, randomise=spec, first_world=3)
    assert torch.equal(masses(many)[3:], masses(part))


def test_only_worlds_that_end_draw_anew():
    task = make("pendulum", 3, randomise={"body_mass": Range(0.8, 1.2)})
    before = masses(task)
    task.episode_clock[1] = task.config.max_episode_steps
    task.step(idle(task))
    changed = (masses(task) != before).any(dim=1)
    assert changed.tolist() == [False, True, False]


def test_shared_and_named_draws():
    task = make(
        "pendulum",
        8,
        randomise={
            "body_mass": Range(0.5, 1.5, shared=True, draw="size"),
            "body_inertia_b": Range(0.5, 1.5, shared=True, draw="size"),
        },
    )
    built = make("pendulum", 1)
    ratio = masses(task) / masses(built)
    assert torch.allclose(ratio[:, 0], ratio[:, 1])
    inertia = to_torch(task.simulation.model.body_inertia_b) / to_torch(built.simulation.model.body_inertia_b)
    assert torch.allclose(inertia[:, 1, 0, 0], ratio[:, 0])


def test_parameters_drawn_in_every_step_and_gravity():
    task = make("pendulum", 4, randomise={"gravity": Range(0.9, 1.1, when="step")})
    gravity = to_torch(task.simulation.model.gravity)
    seen = []
    for _ in range(3):
        task.step(idle(task))
        seen.append(gravity[:, 2].clone())
    assert not torch.equal(seen[0], seen[1])
    assert torch.stack(seen).min() >= -9.81 * 1.1 - 1e-5
    assert torch.stack(seen).max() <= -9.81 * 0.9 + 1e-5


def test_parameters_change_the_motion():
    task = make("pendulum", 64, start_position=0.0, start_angle=0.0, start_rate=0.0, randomise={
        "body_mass": Range(0.5, 2.0, only="pole")})  # fmt: skip
    task.step(torch.ones(64, 1))
    speed = task.views.joint_qd[:, 0]
    mass = masses(task)[:, 1]
    assert torch.corrcoef(torch.stack([speed, mass]))[0, 1] < -0.9


def test_a_resumed_task_has_the_same_parameters():
    spec = {"body_mass": Range(0.8, 1.2)}
    task = make("pendulum", 4, seed=3, randomise=spec, action_delay=(0, 3), sensing={"policy": Sensing(delay=(1, 2))})
    actions = torch.rand(30, 4, 1) * 2 - 1
    for action in actions[:10]:
        task.step(action)
    state = task.state_dict()
    expected = [task.step(action).observations["policy"].clone() for action in actions[10:]]
    other = make("pendulum", 4, seed=9, randomise=spec, action_delay=(0, 3), sensing={"policy": Sensing(delay=(1, 2))})
    other.load_state_dict(state)
    got = [other.step(action).observations["policy"].clone() for action in actions[10:]]
    assert all(torch.equal(a, b) for a, b in zip(expected, got, strict=True))


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ({"body_mas": Range(1, 2)}, "no model parameter 'body_mas'; did you mean body_mass"),
        ({"body_mass": Range(1, 2, only="pol")}, "randomise 'body_mass': there is no 'pol'; did you mean pole"),
        ({"body_inertia_b": Range(1, 2, mode="add")}, "'body_inertia_b': vectors and matrices can be scaled only"),
        ({"gravity": Range(1, 2, only="pole")}, "'gravity': it has no parts"),
        ({"body_mass": 3}, "randomise 'body_mass' must be a Range"),
        ({"body_mass": {"low": 1}}, "randomise 'body_mass'"),
    ],
)
def test_a_wrong_range_is_named(spec, message):
    with pytest.raises(InputError, match=message):
        make("pendulum", randomise=spec)


@pytest.mark.parametrize(
    ("make_range", "message"),
    [
        (lambda: Range(2, 1), "low <= high"),
        (lambda: Range(-1, 1), "factor of a Range must be zero or positive"),
        (lambda: Range(1, 2, mode="scael"), "mode of a Range must be one of scale, add, set"),
        (lambda: Sensing(noise=-1.0), "noise of a Sensing"),
        (lambda: Sensing(delay=(2, 1)), "delay of a Sensing"),
        (lambda: Curriculum(first=5, last=5), "iterations of a Curriculum"),
        (lambda: replace_fields(TaskConfig(), {"action_delay": (1.5, 2)}), "action-delay must be two whole numbers"),
        (lambda: TaskConfig(action_rise_time=(1.0, -1.0)), "action-rise-time must be zero or positive"),
    ],
)
def test_wrong_numbers_are_named(make_range, message):
    with pytest.raises(InputError, match=message):
        make_range()


def test_a_physics_free_task_has_nothing_to_randomise():
    with pytest.raises(InputError, match="'fast' has no physics"):
        make("fast", randomise={"body_mass": Range(1, 2)})


def test_configuration_survives_plain_values():
    config = dataclasses.replace(
        make("fast").config,
        sensing={"policy": Sensing(noise=(0.1, 0.2), delay=(0, 2))},
        randomise={"body_mass": Range(0.8, 1.2, only=("torso",))},
        action_rise_time=(0.1, 0.2),
        curriculum=Curriculum(Driver.PROGRESS),
    )
    plain = json.loads(json.dumps(config_to_plain(config)))
    assert config_from_plain(type(config), plain) == config


# ---- actions -----------------------------------------------------------------------------------------------------


def test_rate_limit_moves_the_action_in_every_physics_step():
    task = make("pendulum", 1, dt=0.01, decimation=4, action_rise_time=0.1, start_position=0.0, start_angle=0.0,
                start_rate=0.0, max_angle=1.5)  # fmt: skip
    forces = []
    step = task.simulation.step

    def watched():
        forces.append(float(task.views.joint_force[0, 0]))
        step()

    task.simulation.step = watched
    task.step(torch.ones(1, 1))
    task.step(-torch.ones(1, 1))
    assert forces == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.3, 0.2, 0.1, 0.0], abs=1e-6)


def test_components_have_their_own_rise_time():
    task = counter(dt=0.1, action_rise_time=(0.4, 0.0))
    task.step(torch.ones(3, 2))
    assert task.action[0].tolist() == pytest.approx([0.25, 1.0])
    with pytest.raises(InputError, match="has 3 values, task 'counter' 2 actions"):
        counter(action_rise_time=(1.0, 1.0, 1.0))


def test_actions_come_late_by_a_delay_that_each_episode_draws():
    task = counter(worlds=200, max_episode_steps=50, action_delay=(1, 3))
    seen = []
    for step in range(8):
        task.step(torch.full((200, 2), 0.1 * (step + 1)))
        seen.append(task.action[:, 0].clone())
    history = torch.stack(seen)
    delays = (history == 0.0).sum(dim=0)
    assert set(delays.tolist()) == {1, 2, 3}
    for delay in (1, 2, 3):
        world = int((delays == delay).nonzero()[0])
        assert history[delay:, world].tolist() == pytest.approx([0.1 * (i + 1) for i in range(8 - delay)])


# ---- observations ------------------------------------------------------------------------------------------------


def test_observations_come_late_and_their_history_begins_with_the_episode():
    task = counter(sensing={"policy": Sensing(delay=(2, 2))})
    seen = [task.observe()["policy"][0, 0].item()]
    finals = []
    for _ in range(7):
        result = task.step(idle(task))
        seen.append(result.observations["policy"][0, 0].item())
        finals.append(result.final_observations["policy"][0, 0].item())
    assert seen == [0.0, 0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0]  # the episode ends after five steps
    assert finals[4] == 3.0
    assert task.observations()["policy"][0, 0] == 2.0


def test_noise_is_new_in_each_step_and_bias_stays_for_an_episode():
    task = counter(worlds=4000, sensing={"policy": Sensing(noise=0.5)})
    truth = [task.step(idle(task)).observations["policy"] - task.count for _ in range(2)]
    assert not torch.equal(*truth)
    assert truth[0].std() == pytest.approx(0.5, rel=0.05)
    assert torch.equal(task.observe()["policy"], task.observe()["policy"])
    task = counter(worlds=4000, sensing={"policy": Sensing(bias=(0.5,))})
    offsets = [task.step(idle(task)).observations["policy"] - task.count for _ in range(5)]
    assert torch.allclose(offsets[0], offsets[3], atol=1e-5)
    assert not torch.allclose(offsets[3], offsets[4], atol=1e-5)
    assert offsets[0].std() == pytest.approx(0.5, rel=0.05)


def test_images_keep_their_dtype_and_can_come_late():
    task = counter(sensing={"camera": Sensing(delay=(1, 1))})
    result = task.step(idle(task))
    assert result.observations["camera"].dtype == torch.uint8
    assert result.observations["camera"].max() == 0
    assert task.step(idle(task)).observations["camera"].max() == 1


@pytest.mark.parametrize(
    ("sensing", "message"),
    [
        ({"polcy": Sensing(noise=1.0)}, "no observation 'polcy'; did you mean policy"),
        ({"camera": Sensing(noise=1.0)}, "sensing 'camera': noise needs a floating-point observation"),
        ({"policy": Sensing(noise=(1.0, 2.0))}, "sensing 'policy': noise has 2 values"),
    ],
)
def test_wrong_sensing_is_named(sensing, message):
    with pytest.raises(InputError, match=message):
        counter(sensing=sensing)


# ---- curriculum --------------------------------------------------------------------------------------------------


def test_level_follows_the_iteration_and_is_one_outside_training():
    task = make("pendulum", 3, curriculum=Curriculum(Driver.ITERATION, first=10, last=20),
                randomise={"body_mass": Range(2.0, 2.0, grows=True)})  # fmt: skip
    built = masses(make("pendulum", 1))
    assert task.level.tolist() == [1.0] * 3
    for iteration, level in ((0, 0.0), (10, 0.0), (15, 0.5), (30, 1.0)):
        task.on_iteration(iteration)
        task.restart()
        assert task.level.tolist() == [level] * 3
        assert torch.allclose(masses(task), built * (1.0 + level))


def test_level_rises_with_success_and_falls_with_failure():
    task = Counter(SampleConfig(max_episode_steps=2, curriculum=Curriculum(Driver.PROGRESS, up=0.4, down=0.1)), 2)
    task.on_iteration(0)
    assert task.level.tolist() == [0.0, 0.0]
    for step in range(8):
        task.fail[1] = step == 5
        task.step(idle(task))
        task.on_iteration(step)
    assert task.level.tolist() == pytest.approx([1.0, 1.0])
    task.fail[1] = True
    task.step(idle(task))
    assert task.level.tolist() == pytest.approx([1.0, 0.9])
    assert torch.equal(task.state_dict()["level"], task.level)
