"""What a configuration makes uncertain: parameters, sensing, delays, rate limits, and the curriculum's level."""

import dataclasses
import json
import math

import pytest
import torch

from simwarp.core import memory
from simwarp.core.interop import to_torch
from simwarp.core.types import WORLD, PositionDrive, pose
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
from tests.tasks.framework.samples import Counter, SampleConfig, counter


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


class Rows(Counter):
    """A hinge with friction, a stop and a motor; one with springs of a table; a box on the ground."""

    physics = True
    config_type = SampleConfig

    def build(self, builder):
        for index in range(2):
            builder.add_body(f"b{index}", mass=2.0, inertia=(0.1, 0.2, 0.3), pose=pose((index, 0, 0.1)))
        builder.add_joint_revolute(
            "motor", WORLD, 0, axis=(0, 1, 0), friction=0.1, limit=(-1, 1),
            drive=PositionDrive(stiffness=1.0, effort_limit=2.0),
        )  # fmt: skip
        builder.add_joint_revolute("table", 0, 1, axis=(0, 1, 0), spring_table=((0, 1), (0, 1)), damping=0.1)
        builder.add_shape_box(1, half=(0.1, 0.1, 0.1), name="box")
        builder.add_shape_plane(name="ground")


def rows(**changes):
    return Rows(SampleConfig(**changes), 4)


ACTS = [
    "joint_friction", "joint_limit_lower", "joint_limit_upper", "drive_effort_limit", "drive_stiffness",
    "joint_damping", "gravity", "body_mass", "body_inertia_b", "shape_friction", "shape_size", "joint_anchor0",
]  # fmt: skip


def test_a_spring_by_table_is_scaled():
    """Its stiffness is the factor of the table, 1 as built."""
    task = rows(randomise={"joint_stiffness": Range(0.5, 0.9, only="table")})
    factor = to_torch(task.simulation.model.joint_stiffness)[:, 1]
    assert factor.min() >= 0.5
    assert factor.max() <= 0.9
    assert len(factor.unique()) == len(factor)


@pytest.mark.parametrize("name", ACTS)
def test_ranges_that_act(name):
    task = rows(randomise={name: Range(0.5, 0.9)})
    view = to_torch(getattr(task.simulation.model, name))
    assert not torch.equal(view[0], view[1])


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        ("joint_friction", "built with friction > 0"), ("joint_limit_lower", "built with a limit"),
        ("joint_limit_upper", "built with a limit"), ("drive_effort_limit", "PositionDrive with a finite effort_limit"),
        ("drive_stiffness", "built with a PositionDrive"), ("drive_damping", "built with a PositionDrive"),
        ("joint_rest", "built with a spring"), ("joint_offset", "massless links and elastic joints have a length"),
        ("coupling_damping", "only couplings have it"), ("coupling_offset", "built without damping"),
        ("shape_friction", "the model has no shapes"), ("shape_rolling_friction", "the model has no shapes"),
        ("shape_young_modulus", "the model has no shapes"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("mode", ["scale", "set"])
def test_a_range_that_cannot_act_on_a_cart_with_a_pole(name, rule, mode):
    """It would be drawn, written and read by nobody."""
    with pytest.raises(InputError) as caught:
        make("pendulum", 2, randomise={name: Range(0.5, 1.5, mode=mode)})
    message = str(caught.value)
    assert message.startswith(f"randomise '{name}': it cannot act in task 'pendulum': ")
    assert rule in message
    assert "; build it so, or leave it out" in message
    assert message.isprintable()


@pytest.mark.parametrize(
    ("name", "spec", "message"),
    [
        ("joint_friction", Range(0.5, 1.5, only="table"), "cannot act on 'table' of task"),
        ("joint_friction", Range(0.5, 1.5, only=("motor", "table")), "cannot act on 'table' of task"),
        ("joint_stiffness", Range(0.5, 1.5, only="motor"), "a factor cannot act on 'motor'.*it is 0 as built"),
        ("drive_damping", Range(0.5, 1.5), "a factor cannot act in task.*0 as built; use mode='add' or 'set'"),
        ("shape_size", Range(0.5, 1.5, only="ground"), "planes have no size"),
        ("shape_rolling_friction", Range(0.1, 0.2, mode="set"), "no shape was built with rolling"),
        ("shape_young_modulus", Range(0.5, 1.5), "contact_model='smooth'"),
        ("shape_damping", Range(0.1, 0.2, mode="set"), "no shape was built with compliance"),
        ("shape_cohesion", Range(0.5, 1.5), "a factor cannot act"),
    ],
)
def test_a_range_that_cannot_act_on_a_part(name, spec, message):
    with pytest.raises(InputError, match=f"randomise '{name}': .*{message}"):
        rows(randomise={name: spec})


def test_what_becomes_something_beside_it_may_be_scaled():
    beside = {"drive_damping": Range(0.1, 0.2, mode="set"), "joint_friction": Range(0.1, 0.2, mode="add")}
    assert rows(randomise=beside).num_worlds == 4
    beside = {"shape_damping": Range(0.1, 0.2, mode="set"), "shape_compliance": Range(0.0, 1e-4, mode="set")}
    assert rows(randomise=beside).num_worlds == 4


def inertias(task):
    return to_torch(task.simulation.model.body_inertia_b).clone()


def test_a_scaled_mass_scales_the_inertia():
    plain = rows()
    task = rows(randomise={"body_mass": Range(0.5, 2.0)})
    for _ in range(3):
        factor = masses(task) / masses(plain)
        assert torch.allclose(inertias(task), inertias(plain) * factor[..., None, None])
        task.restart()
    assert not torch.allclose(factor, torch.ones(()))


def test_in_every_step_and_by_the_level_too():
    task = rows(randomise={"body_mass": Range(0.5, 2.0, when="step", grows=True, only="b1")})
    plain = rows()
    for level in (1.0, 0.3):
        task.level.fill_(level)
        task.step(idle(task))
        factor = masses(task) / masses(plain)
        assert torch.allclose(inertias(task), inertias(plain) * factor[..., None, None])
        assert torch.equal(factor[:, 0], torch.ones(4))
        assert not torch.equal(factor[:, 1], torch.ones(4))


@pytest.mark.parametrize(
    "spec",
    [
        {"body_mass": Range(0.5, 2.0, inertia=False)},
        {"body_mass": Range(0.5, 2.0, mode="add")},
        {"body_mass": Range(0.5, 2.0, mode="set")},
    ],
)
def test_a_mass_alone(spec):
    task = rows(randomise=spec)
    assert torch.equal(inertias(task), inertias(rows()).expand(len(inertias(task)), -1, -1, -1))
    assert not torch.equal(masses(task)[0], masses(task)[1])


def test_an_inertia_with_a_range_of_its_own_follows_that():
    task = rows(randomise={"body_mass": Range(0.5, 0.5), "body_inertia_b": Range(3.0, 3.0)})
    assert torch.allclose(inertias(task), 3.0 * inertias(rows()))


def test_an_inertia_that_the_task_writes_itself():
    class Writes(Rows):
        per_world = ("body_inertia_b",)

    with pytest.raises(InputError, match=r"'body_inertia_b': task .* writes it itself; give body_mass inertia=False"):
        Writes(SampleConfig(randomise={"body_mass": Range(0.5, 2.0)}), 2)
    Writes(SampleConfig(randomise={"body_mass": Range(0.5, 2.0, inertia=False)}), 2)


# ---- wrong values ------------------------------------------------------------------------------------------------

ODD = [None, "", "abc", b"1", math.nan, math.inf, 10**400, 1e39, [], [1], {}, object(), 1j, (1, 2, 3), [None], True]


@pytest.mark.parametrize(
    ("kind", "fields", "wrong"),
    [
        (Range, {"low": 0.5, "high": 2.0}, {
            "low": [*ODD, -1.0, 3.0], "high": [*ODD, 0.1], "mode": [None, "", "x", 3, [], {}],
            "when": [None, "", "x", 3, [], {}], "only": [None, 3, {}, [3], [None], [""], b"x"],
            "shared": [None, 1, "yes"], "draw": [None, 3, [], "\ud800", "a\nb"], "grows": [None, 0, "no"],
            "inertia": [None, 0, "no", []],
        }),
        (Sensing, {}, {
            "noise": [*(value for value in ODD if value not in ([], [1], (1, 2, 3))), -1.0, ["x"], [math.nan]],
            "bias": [*(value for value in ODD if value not in ([], [1], (1, 2, 3))), -1.0, ["x"], [10**400]],
            "delay": [None, "", 3, [1], [1, 2, 3], (2, 1), (-1, 2), (0.0, 1.0), (0, True), (0, 2**31), (0, 10**400),
                      "ab"],
        }),
        (Curriculum, {}, {
            "driver": [None, "", "x", 3, [], {}], "first": [None, -1, 1.5, "x", 100, True, math.nan],
            "last": [None, 0, 1.5, "x", 10**400, math.inf], "up": [*ODD[:-1], -0.1, 1.1], "down": [*ODD[:-1], 2.0],
        }),
    ],
)  # fmt: skip
def test_odd_values_of_every_field(kind, fields, wrong):
    assert set(wrong) == {field.name for field in dataclasses.fields(kind)}
    for field, values in wrong.items():
        for value in values:
            with pytest.raises(InputError) as caught:
                kind(**(fields | {field: value}))
            message = str(caught.value)
            assert f"of a {kind.__name__} must be " in message, (field, value)
            assert message.isprintable()
            assert len(message) < 300


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"action_delay": (0, 10**9)}, "delay of actions up to 1000000000 steps: the last values of 3 worlds"),
        ({"sensing": {"policy": Sensing(delay=(0, 10**9))}}, "delay of policy up to 1000000000 steps"),
        ({"sensing": {"camera": Sensing(delay=(0, 2**31 - 1))}}, "delay of camera up to 2147483647 steps"),
    ],
)
def test_delays_that_ask_for_too_much_memory(change, message, monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda device: 10**9)
    with pytest.raises(InputError, match=f"{message}.* need .* GiB, device cpu has .*; shorten the delay"):
        counter(**change)


def test_worlds_and_guards_that_ask_for_too_much_memory(monkeypatch):
    with pytest.raises(InputError, match=r"task 'fast': 2147483647 worlds need .* free; take fewer worlds"):
        make("fast", 2**31 - 1)
    monkeypatch.setattr(memory, "free_memory", lambda device: 10**6)
    with pytest.raises(InputError, match="guard-steps: the last 10000 steps of 40 worlds need"):
        make("pendulum", 40, guard_steps=10000)


@pytest.mark.parametrize("value", [0, -1, 1.5, "3", None, True, 2**31, 10**400, [3]])
def test_numbers_of_worlds_that_are_none(value):
    with pytest.raises(InputError, match="num_worlds must be"):
        make("fast", value)


@pytest.mark.parametrize("value", [1.5, "3", None, True, 10**400, [3]])
def test_seeds_that_are_none(value):
    with pytest.raises(InputError, match="seed must be"):
        make("fast", 2, seed=value)


@pytest.mark.parametrize(
    ("make_range", "message"),
    [
        (lambda: Range(2, 1), "low <= high"),
        (lambda: Range(-1, 1), "factor of a Range must be zero or positive"),
        (lambda: Range(1, 2, mode="scael"), "mode of a Range must be one of scale, add, set"),
        (lambda: Sensing(noise=-1.0), "noise of a Sensing"),
        (lambda: Sensing(delay=(2, 1)), "delay of a Sensing"),
        (lambda: Curriculum(first=5, last=5), "iterations of a Curriculum"),
        (
            lambda: replace_fields(TaskConfig(), {"action_delay": (1.5, 2)}),
            r"action-delay\[0\] must be a whole number, got 1.5",
        ),
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


@pytest.mark.parametrize("driver", [Driver.ITERATION, Driver.NONE])
def test_a_resumed_task_has_the_parameters_its_episodes_began_with(driver):
    """The level rises within an episode, and with it what later ones draw; what runs stays as it was drawn."""

    def made():
        return make(
            "pendulum", 4, seed=1, randomise={"body_mass": Range(0.2, 3.0, grows=True)},
            curriculum=Curriculum(driver, first=0, last=4),
        )  # fmt: skip

    task, resumed = made(), made()
    task.on_iteration(0)
    task.restart()
    rest = torch.zeros(4, 1)
    for iteration in range(3):
        task.on_iteration(iteration)
        for _ in range(3):
            task.step(rest)
    resumed.load_state_dict(task.state_dict())
    assert torch.equal(masses(task), masses(resumed))
    for _ in range(3):
        found = [one.step(torch.full((4, 1), 0.3)).observations["policy"] for one in (task, resumed)]
        assert torch.equal(*found)
