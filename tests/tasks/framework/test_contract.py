"""The contract holds in every step: whatever a method returns or raises, first or later, is one line that names it."""

import signal
from types import SimpleNamespace

import pytest
import torch

from simwarp import cli
from simwarp.tasks import InputError, TaskError, register
from simwarp.tasks.adapters.gym_env import TaskVectorEnv
from simwarp.tasks.framework.errors import TaskStepError
from simwarp.tasks.pendulum import PendulumTask
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import CriticSees, NetworkConfig, TrainConfig
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.policies import zero_policy
from tests.tasks.framework.samples import Counter, SampleConfig

WORLDS, LATER = 3, 4


@register("faulty")
class Faulty(Counter):
    """A task whose method `hook` does something else from its call of number `since` on."""

    hook = ""
    since = 0
    fault = staticmethod(lambda values: values)

    def setup(self):
        super().setup()
        self.calls = SimpleNamespace(count=0)  # a number in an object: no attribute is bound anew

    def pass_on(self, hook, values):
        if hook != type(self).hook:
            return values
        self.calls.count += 1
        return type(self).fault(values) if self.calls.count > type(self).since else values

    def observations(self):
        return self.pass_on("observations", {"policy": self.count.expand(-1, 2).clone()})

    def rewards(self):
        one = torch.ones(self.num_worlds, device=self.device)
        return self.pass_on("rewards", {"one": one, "two": one.clone()})

    def terminations(self):
        return self.pass_on("terminations", {"fell": self.fail.clone(), "won": self.fail.clone()})

    def truncations(self):
        return self.pass_on("truncations", {"late": self.fail.clone()})

    def metrics(self):
        return self.pass_on("metrics", {"success": ~self.fail, "way": self.count[:, 0].clone()})

    def extra_state(self):
        return self.pass_on("extra_state", {"count": self.count})

    def privileged(self):
        return self.pass_on("privileged", self.count.clone())

    def on_iteration(self, iteration):
        super().on_iteration(iteration)
        return self.pass_on("on_iteration", {"hard": self.level})

    def step_limit(self):
        return self.pass_on("step_limit", super().step_limit())

    def begin_step(self):
        self.pass_on("begin_step", None)

    def apply(self, action):
        super().apply(action)
        self.pass_on("apply", None)

    def reset(self, world_mask):
        super().reset(world_mask)
        self.pass_on("reset", None)


def faulty(hook, fault, since, worlds=WORLDS, **config):
    kind = type("Faulty", (Faulty,), {"name": "faulty", "hook": hook, "fault": staticmethod(fault), "since": since})
    return kind(SampleConfig(**config), worlds)


def first(change):
    """Change the first value of a mapping."""
    return lambda values: values | {next(iter(values)): change(next(iter(values.values())))}


def raising(error):
    def fault(values):
        raise error

    return fault


TABLES = {
    "fewer worlds": first(lambda value: value[:1]),
    "more worlds": first(lambda value: torch.cat([value, value])),
    "one more dimension": first(lambda value: value.unsqueeze(-1).expand(*value.shape, 2)),
    "no dimension": first(lambda value: value.flatten()[0]),
    "another dtype": first(lambda value: value.double() if value.dtype != torch.bool else value.long()),
    "another device": first(lambda value: value.to("meta")),
    "a value None": first(lambda value: None),
    "a list": first(lambda value: value.tolist()),
    "a number": first(lambda value: 1.0),
    "None": lambda values: None,
    "a tensor": lambda values: next(iter(values.values())),
    "a name more": lambda values: values | {"more": next(iter(values.values()))},
    "a name less": lambda values: dict(list(values.items())[1:]),
    "another name": lambda values: {f"{name}s": value for name, value in values.items()},
    "a name that is no text": lambda values: dict(enumerate(values.values())),
}
RESULTS = ("observations", "rewards", "terminations", "truncations", "metrics")
"""Methods that return tables in every step."""
ESCAPES = {
    "SystemExit": SystemExit(3), "SystemExit with text": SystemExit("bye"), "StopIteration": StopIteration("end"),
    "GeneratorExit": GeneratorExit(),
}  # fmt: skip
CALLED = (*RESULTS, "begin_step", "apply", "reset")
"""Methods that are called in every step."""


def by_hand(task):
    for _ in range(2 * LATER):
        task.step(torch.zeros(WORLDS, 2))
    task.drain_statistics()


def in_training(task):
    config = TrainConfig(num_envs=WORLDS, steps_per_iteration=4, iterations=3)
    trainer = Trainer(task, config)
    for _ in range(3):
        trainer.iterate()


def in_evaluation(task):
    evaluate(task, zero_policy(task), 2 * WORLDS, 0)


def in_gymnasium(task):
    env = TaskVectorEnv(task)
    env.reset(seed=0)
    for _ in range(2 * LATER):
        env.step(env.action_space.sample())


RUNNERS = {each.__name__: each for each in (by_hand, in_training, in_evaluation, in_gymnasium)}


def message(task, run, kind=TaskStepError):
    """The one line of a task that breaks its contract in a step."""
    with pytest.raises(kind) as caught:
        run(task)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith("task 'faulty': ")
    return text


@pytest.mark.parametrize("fault", TABLES)
@pytest.mark.parametrize("hook", RESULTS)
def test_a_table_that_changes_is_named_with_step_worlds_expected_and_got(hook, fault):
    """Fails where a step writes what it was given into rows of its own without a look at its length."""
    text = message(faulty(hook, TABLES[fault], LATER), by_hand)
    assert f"{hook}() in control step" in text
    assert "of 3 worlds" in text
    assert "must" in text
    assert "got" in text


@pytest.mark.parametrize("run", RUNNERS)
@pytest.mark.parametrize("hook", RESULTS)
@pytest.mark.parametrize("fault", ["fewer worlds", "another dtype", "a value None", "a name less"])
@pytest.mark.sweep
def test_every_runner_says_the_same(hook, fault, run):
    assert f"{hook}() in control step" in message(faulty(hook, TABLES[fault], LATER + 2), RUNNERS[run])


@pytest.mark.parametrize("fault", TABLES)
@pytest.mark.parametrize("hook", RESULTS)
@pytest.mark.sweep
def test_a_table_that_is_wrong_from_the_start_is_refused_when_the_task_is_built(hook, fault):
    # Names are learnt when the task is built; any number of them will do, but not none of observations and rewards
    if fault in ("a name more", "another name") or (fault == "a name less" and hook != "observations"):
        faulty(hook, TABLES[fault], 0)
        return
    if (hook, fault) in {("metrics", "another dtype"), ("observations", "one more dimension")}:
        return  # a metric may be of any but `success`; observations of any shape
    with pytest.raises(TaskError) as caught:
        faulty(hook, TABLES[fault], 0)
    assert str(caught.value).startswith("task 'faulty': ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("since", [0, LATER])
@pytest.mark.parametrize("escape", ESCAPES)
@pytest.mark.parametrize("hook", CALLED)
@pytest.mark.sweep
def test_what_would_end_a_program_in_silence_is_named(hook, escape, since):
    """Fails where `SystemExit` ends the process, and `StopIteration` the generator of an evaluation."""

    def build_and_run():
        by_hand(faulty(hook, raising(ESCAPES[escape]), since))

    with pytest.raises(TaskStepError) as caught:
        build_and_run()
    text = str(caught.value)
    kind = type(ESCAPES[escape]).__name__
    assert f"task 'faulty': {hook}() " in text
    assert f"of 3 worlds: raised {kind}(" in text
    assert "test_contract.py, line" in text
    assert ("before the first control step" in text) is (since == 0)


@pytest.mark.parametrize("escape", ESCAPES)
@pytest.mark.parametrize("hook", ["extra_state", "on_iteration"])
def test_so_it_is_in_methods_that_are_asked_now_and_then(hook, escape):
    task = faulty(hook, raising(ESCAPES[escape]), LATER)
    assert f"{hook}() before the first control step of 3 worlds: raised" in message(task, OTHERS[hook])


@pytest.mark.parametrize("hook", ["build", "setup", "attach", "solver_options"])
def test_so_it_is_where_a_task_is_built(hook):
    def leave(self, *given):
        raise SystemExit(0)

    kind = type("Faulty", (PendulumTask,), {"name": "faulty", hook: leave})
    with pytest.raises(TaskStepError, match=rf"task 'faulty': {hook}\(\) before the first .* of 2 worlds: raised Sys"):
        kind(PendulumTask.config_type(), 2)


def test_interrupts_and_errors_of_a_method_stay_what_they_are():
    for error in (KeyboardInterrupt(), ZeroDivisionError("mine")):
        with pytest.raises(type(error)):
            by_hand(faulty("rewards", raising(error), LATER))


def test_the_end_that_a_signal_handler_of_the_program_asks_for_is_no_fault_of_the_task():
    def leave(number, frame):
        raise SystemExit(0)

    before = signal.signal(signal.SIGUSR1, leave)
    try:
        with pytest.raises(SystemExit):
            by_hand(faulty("rewards", lambda values: signal.raise_signal(signal.SIGUSR1), LATER))
    finally:
        signal.signal(signal.SIGUSR1, before)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize("run", RUNNERS)
@pytest.mark.parametrize(("hook", "named"), [("rewards", "reward 'one'"), ("observations", "observation 'policy'")])
@pytest.mark.sweep
def test_a_value_that_is_not_finite_is_named_with_world_and_step(hook, named, run, value):
    def spoil(tensor):
        spoilt = tensor.clone()
        spoilt[1] = value
        return spoilt

    # Called once when the task is built, and observations once more when it restarts, each time
    task = faulty(hook, first(spoil), LATER + 2, max_episode_steps=50)
    text = message(task, RUNNERS[run])
    assert f"{named} was NaN or infinite in" in text
    assert "of 3 worlds, first in world 1 at control step" in text


def test_the_first_value_that_is_not_finite_is_told_where_several_are():
    def spoil(values):
        bad = torch.zeros(WORLDS)
        bad[2] = torch.nan
        return values | {"two": bad}

    task = faulty("rewards", spoil, 3)
    with pytest.raises(TaskStepError) as caught:
        by_hand(task)
    assert "first in world 2 at control step 3 (step 3 of its episode 0)" in str(caught.value)
    assert task.drain_statistics().first_bad is None


OTHERS = {
    "extra_state": lambda task: [task.state_dict() for _ in range(2 * LATER)],
    "on_iteration": lambda task: [task.contract.on_iteration(index) for index in range(2 * LATER)],
}


@pytest.mark.parametrize("fault", [fault for fault in TABLES if fault not in ("a name less", "a name more")])
@pytest.mark.parametrize("hook", OTHERS)
def test_tables_that_are_asked_for_now_and_then_are_held_too(hook, fault):
    assert f"{hook}() before the first control step" in message(faulty(hook, TABLES[fault], LATER), OTHERS[hook])


@pytest.mark.parametrize(
    "fault", [lambda value: None, lambda value: value[:1], lambda value: value.double(), lambda value: [1.0]]
)
@pytest.mark.parametrize("since", [1, LATER])
def test_what_the_critic_alone_sees_is_held_too(fault, since):
    network = NetworkConfig(critic=CriticSees.PRIVILEGED)
    config = TrainConfig(num_envs=WORLDS, steps_per_iteration=4, iterations=3, network=network)

    def run(task):
        trainer = Trainer(task, config)
        for _ in range(3):
            trainer.iterate()

    assert "privileged()" in message(faulty("privileged", fault, since), run)


@pytest.mark.parametrize("fault", [lambda value: None, lambda value: value[:1], lambda value: 5])
def test_a_step_limit_of_other_lengths_is_refused(fault):
    assert "step_limit() must be (3,) numbers" in message(faulty("step_limit", fault, 0), in_training, TaskError)


@pytest.mark.parametrize("command", ["train", "eval"])
@pytest.mark.parametrize(
    ("hook", "fault", "words"),
    [
        ("rewards", TABLES["fewer worlds"], "reward 'one' must stay float32 (4,) on cpu, got float32 (1,) on cpu"),
        ("terminations", TABLES["another dtype"], "termination 'fell' must stay bool (4,) on cpu, got int64 (4,)"),
        ("observations", TABLES["a value None"], "observation 'policy' must stay float32 (4, 2) on cpu, got None"),
        ("rewards", raising(SystemExit(0)), "raised SystemExit(0)"),
        ("rewards", first(lambda value: value * torch.nan), "reward 'one' was NaN or infinite"),
    ],
)
def test_a_command_ends_in_one_line_and_code_1(tmp_path, monkeypatch, capsys, command, hook, fault, words):
    """Fails where such a run is told as done, with exit code 0."""
    monkeypatch.chdir(tmp_path)
    for name, value in {"hook": hook, "fault": staticmethod(fault), "since": LATER + 3}.items():
        monkeypatch.setattr(Faulty, name, value)
    options = {
        "train": ["--num-envs", "4", "--iterations", "2", "--steps-per-iteration", "6", "--logger", "csv"],
        "eval": ["--checkpoint", "zero", "--episodes", "8", "--num-envs", "4", "--no-baselines"],
    }  # fmt: skip
    assert cli.main([command, "faulty", "--device", "cpu", *options[command]]) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert err.startswith("simwarp: task 'faulty': ")
    assert words in err


def test_actions_of_another_shape_are_refused_without_a_step():
    task = faulty("", None, 0)
    with pytest.raises(TaskError, match="action must be"):
        task.step(torch.zeros(2, 2))
    assert task.contract.step == 0
    with pytest.raises(InputError, match="num_worlds"):
        faulty("", None, 0, worlds=0)
