"""A student learns what its teacher does, in the worlds that it leads itself; a run of it is a run like others."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from simwarp.tasks import InputError, config_to_plain, make, replace_fields, task_class
from simwarp.tasks.framework.registry import origin_of
from simwarp.train.algorithm.distillation import DistillationConfig
from simwarp.train.algorithm.distiller import Distiller, Lesson
from simwarp.train.algorithm.vec_env import TEACHER, TaskVecEnv
from simwarp.train.config import NetworkKind, default_config, rsl_rl_config, student_config
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.policies import build_actor, network_policy
from simwarp.train.runs.checkpoint import load_checkpoint, save_checkpoint
from simwarp.train.runs.saved_distillation import lesson_by
from simwarp.train.runs.training import train

QUIET = Console(quiet=True)
SIGHTS = f"{Path(__file__).with_name('two_sights.py')}:TwoSights"
GAIN = -3.0
"""Of the teacher: it asks for GAIN times the place, often more than a task does."""


def sights():
    return task_class(SIGHTS)


def configured(obs):
    kind = sights().config_type
    return replace_fields(kind(), {"obs": type(kind().obs)(obs)})


def teacher_content(gain=GAIN):
    """A policy by place that multiplies it by a gain, as a checkpoint: one linear layer each way, nothing between."""
    config = replace_fields(
        default_config(sights()), {"network.hidden": (2,), "network.normalise": False, "device": "cpu"}
    )
    task = make(SIGHTS, 1, config=configured("place"))
    actor = build_actor(rsl_rl_config(config, ["policy"], 1), task)
    state = actor.state_dict()
    # ELU is the identity above zero: the positive part of x in one unit, of -x in the other
    state["mlp.0.weight"], state["mlp.0.bias"] = torch.tensor([[1.0], [1.0]]), torch.tensor([10.0, 10.0])
    state["mlp.2.weight"], state["mlp.2.bias"] = torch.tensor([[gain / 2, gain / 2]]), torch.tensor([-10.0 * gain])
    return {
        **origin_of(task.name), "format": 1, "iteration": 0, "train_config": config_to_plain(config),
        "task_config": config_to_plain(task.config), "actor_state_dict": state,
    }  # fmt: skip


def lesson(**changes):
    config = replace_fields(DistillationConfig(mini_batches=4), changes)
    return Lesson(teacher_content(), "teacher.pt", config)


def settings(**changes):
    small = {"num_envs": 32, "device": "cpu", "save_interval": 2, "threads": 1, "network.hidden": (16,)}
    return replace_fields(student_config(sights(), configured("readings")), small | changes)


def distiller(taught=None, **changes):
    config = settings(**changes)
    task = make(SIGHTS, config.num_envs, seed=config.seed, config=configured("readings"))
    return Distiller(task, config, taught or lesson())


def run(root, resume=None, taught=None, **changes):
    return train(
        SIGHTS, settings(**changes), configured("readings"), root=root, resume=resume,
        lesson=taught if taught is not None or resume is not None else lesson(), console=QUIET,
    )  # fmt: skip


def test_both_see_the_same_worlds_at_the_same_time():
    taught = distiller()
    taught.iterate()
    stored = taught.storage.observations
    assert set(stored.keys()) == {"readings", f"{TEACHER}policy"}
    place = stored[f"{TEACHER}policy"][..., 0]
    torch.testing.assert_close(stored["readings"][..., 1], 3.0 * place - 0.5)
    # What is told is what the teacher would do there, as the task clips it
    told = (GAIN * place).clamp(-1.0, 1.0)
    torch.testing.assert_close(taught.storage.privileged_actions[..., 0], told, atol=1e-5, rtol=0.0)
    assert float(told.abs().max()) == 1.0, "no action of the teacher was clipped"


@pytest.mark.parametrize("guided", [0, 2, 1000])
def test_the_teacher_leads_at_first_and_in_fewer_worlds_from_iteration_to_iteration(guided):
    taught, shares = distiller(lesson(guided=guided), num_envs=256), []
    for _ in range(3):
        taught.iterate()
        led = (taught.storage.actions == taught.storage.privileged_actions).all(dim=2).all(dim=0)
        shares.append(float(led.float().mean()))
    expected = [max(0.0, 1.0 - iteration / guided) if guided else 0.0 for iteration in range(3)]
    # Five standard deviations of a share of 256 worlds; exactly none or all where nothing is left to chance
    for share, wanted in zip(shares, expected, strict=True):
        assert abs(share - wanted) <= 5.0 * math.sqrt(wanted * (1.0 - wanted) / 256)


@pytest.mark.parametrize("threads", [1, 3])
def test_one_step_is_that_of_adam_on_the_squared_error(threads):
    """The whole rollout as one mini-batch, against one written out: loss, clipped gradient and Adam's first step."""
    taught = distiller(
        lesson(mini_batches=1, epochs=1, guided=0, learning_rate=0.01, max_grad_norm=0.5), threads=threads,
        num_envs=1024, iterations=10**6,
    )  # fmt: skip
    student = taught.algorithm.student
    before = {name: value.detach().double().clone() for name, value in student.named_parameters()}
    with torch.no_grad():
        taught.collect()
    seen = taught.storage.observations["readings"].flatten(0, 1).double().numpy()
    told = taught.storage.privileged_actions.flatten(0, 1).double().numpy()
    losses = taught.algorithm.update()
    weights = [before[name].numpy() for name in ("mlp.0.weight", "mlp.0.bias", "mlp.2.weight", "mlp.2.bias")]
    # The normaliser saw nothing yet: mean 0 and deviation 1, to its epsilon of 1e-2
    inputs = seen / 1.01
    middle = inputs @ weights[0].T + weights[1]
    hidden = np.where(middle > 0.0, middle, np.expm1(np.minimum(middle, 0.0)))
    asked = hidden @ weights[2].T + weights[3]
    error = np.where((np.abs(told) == 1.0) & (asked * told > 1.0), 0.0, asked - told)
    assert losses["behavior"] == pytest.approx(np.mean(error**2), rel=1e-4)
    outer = 2.0 * error / error.size
    inner = (outer @ weights[2]) * np.where(middle > 0.0, 1.0, np.exp(np.minimum(middle, 0.0)))
    gradients = [inner.T @ inputs, inner.sum(0), outer.T @ hidden, outer.sum(0)]
    norm = math.sqrt(sum(float((gradient**2).sum()) for gradient in gradients))
    scale = min(1.0, 0.5 / (norm + 1e-6))
    assert scale < 1.0, "the bound of the gradient was not met"
    for name, old, gradient in zip(
        ("mlp.0.weight", "mlp.0.bias", "mlp.2.weight", "mlp.2.bias"), weights, gradients, strict=True
    ):
        clipped = scale * gradient
        step = 0.01 * clipped / (np.abs(clipped) + 1e-8)  # Adam's first: the moments are g and g squared
        after = dict(student.named_parameters())[name].detach().double().numpy()
        # Steps have the size of the rate whatever the gradient's: only one near zero is unsure in float32
        sure = np.abs(clipped) > 1e-6
        assert sure.mean() > 0.9
        np.testing.assert_allclose((after - old)[sure], -step[sure], atol=2e-5)
    assert torch.equal(
        dict(student.named_parameters())["distribution.std_param"].double(), before["distribution.std_param"]
    )


def test_the_step_size_falls_along_half_a_cosine():
    taught, rates = distiller(iterations=4), []
    for _ in range(4):
        taught.iterate()
        rates.append(taught.algorithm.optimizer.param_groups[0]["lr"])
    assert rates == pytest.approx([1e-3 * 0.5 * (1.0 + math.cos(math.pi * done / 4)) for done in range(4)])


def test_a_student_comes_to_do_what_its_teacher_does(tmp_path):
    taught = run(tmp_path, iterations=80, taught=lesson(learning_rate=1e-2))
    content = load_checkpoint(Path(taught.checkpoint))
    task = make(SIGHTS, 64, config=configured("readings"))
    student = network_policy(content, task)
    seen = task.restart()
    told = (GAIN * task.observe_as("place")["policy"][:, 0]).clamp(-1.0, 1.0)
    assert float((student(seen)[:, 0].clamp(-1.0, 1.0) - told).abs().mean()) < 0.1
    good = evaluate(task, student, 64, seed=1)
    assert good.success_rate == 1.0


@pytest.mark.parametrize("kind", [NetworkKind.MLP, NetworkKind.RECURRENT])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_run_goes_on_bit_by_bit_and_needs_its_teacher_no_more(tmp_path, kind, threads):
    options = {"network.kind": kind, "threads": threads, "iterations": 4, "num_envs": 64}
    whole = run(tmp_path / "whole", **options)
    source = tmp_path / "teacher.pt"
    save_checkpoint(source, teacher_content())
    taught = lesson_by(source, sights().name, DistillationConfig(mini_batches=4))
    # Four iterations are asked for, as the step size follows them, and two are done
    part = _stopped(tmp_path / "part", taught, 2, **options)
    source.unlink()
    resumed = run(tmp_path / "part", resume=part, **options)
    left, right = (load_checkpoint(Path(result.checkpoint)) for result in (whole, resumed))
    assert left["iteration"] == right["iteration"] == 4
    for name, value in left["actor_state_dict"].items():
        assert torch.equal(value, right["actor_state_dict"][name]), name
    assert torch.equal(left["worlds"]["extra"]["x"], right["worlds"]["extra"]["x"])


def _stopped(root, taught, after, **options):
    """Make a run that was stopped after some iterations; return its folder."""
    import simwarp.train.runs.training as training

    class Enough(Distiller):
        def iterate(self):
            if self.iteration == after:
                raise KeyboardInterrupt
            return super().iterate()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "Distiller", Enough)
        with pytest.raises(KeyboardInterrupt):
            run(root, taught=taught, save_interval=after, **options)
    (folder,) = (root / sights().name).iterdir()
    return folder


def test_a_run_without_a_checkpoint_begins_with_the_teacher_it_was_to_have(tmp_path):
    source = tmp_path / "teacher.pt"
    save_checkpoint(source, teacher_content())
    taught = lesson_by(source, sights().name, DistillationConfig(epochs=1, mini_batches=4))
    result = run(tmp_path / "some", taught=taught, iterations=1)
    folder = Path(result.run)
    for path in (folder / "checkpoints").iterdir():
        path.unlink()
    again = run(tmp_path / "some", resume=folder, iterations=1)
    assert load_checkpoint(Path(again.checkpoint))["distillation"]["config"]["epochs"] == 1
    source.unlink()
    for path in (folder / "checkpoints").iterdir():
        path.unlink()
    with pytest.raises(InputError, match=r"teacher.pt"):
        run(tmp_path / "some", resume=folder, iterations=1)


def test_a_training_starts_from_a_student(tmp_path):
    taught = run(tmp_path, iterations=2)
    config = replace_fields(
        default_config(sights(), configured("readings")),
        {"network": settings().network, "iterations": 1, "critic_warmup": 1, "num_envs": 8, "device": "cpu"},
    )
    begun = train(
        SIGHTS, config, configured("readings"), root=tmp_path, warm_start=Path(taught.run), console=QUIET
    )  # fmt: skip
    old, new = (load_checkpoint(Path(result.checkpoint)) for result in (taught, begun))
    for name, value in old["actor_state_dict"].items():
        assert torch.equal(value, new["actor_state_dict"][name])
    assert float(new["actor_state_dict"]["distribution.std_param"][0]) == pytest.approx(0.2)
    assert "teacher" not in new


def test_worlds_that_others_disturb_are_told_the_same():
    """Batch independence: the lesson of a world hangs on that world alone."""
    told = []
    for disturbed in (False, True):
        taught = distiller(lesson(guided=1000), num_envs=8, spread_start=False)
        if disturbed:
            taught.task.x[3] += 0.5
            taught.env.refresh()
        with torch.no_grad():
            taught.collect()
        told.append(taught.storage.privileged_actions.clone())
    others = [0, 1, 2, 4, 5, 6, 7]
    assert torch.equal(told[0][:, others], told[1][:, others])
    assert not torch.equal(told[0][:, 3], told[1][:, 3])


def test_what_does_not_fit_is_refused_in_one_line(tmp_path):
    with pytest.raises(InputError, match=r"does not offer 'sonar' ones"):
        TaskVecEnv(make(SIGHTS, 2), teacher="sonar").get_observations()
    content = teacher_content()
    content["actor_state_dict"] = {**content["actor_state_dict"], "mlp.0.weight": torch.zeros(2, 5)}
    with pytest.raises(InputError, match=r"the teacher's network does not fit what task 'two-sights' shows it"):
        distiller(Lesson(content, "other.pt", DistillationConfig()))
    with pytest.raises(InputError, match=r"--distillation.mini-batches must be at most .* = 512, got 513"):
        distiller(lesson(mini_batches=513), steps_per_iteration=16)
    other = tmp_path / "other.pt"
    save_checkpoint(other, {**teacher_content(), "task": "fast"})
    with pytest.raises(InputError, match=r"other.pt is of task 'fast', not 'two-sights'"):
        lesson_by(other, "two-sights", DistillationConfig())
    with pytest.raises(InputError, match=r"--resume goes on with one"):
        run(tmp_path, resume=tmp_path, taught=lesson())
    finished = run(tmp_path, iterations=1)
    content = load_checkpoint(Path(finished.checkpoint))
    for damage, message in (
        ({"teacher": 3}, "teacher"), ({"distillation": {"teacher": "x", "config": {"epochs": 0}}}, "epochs"),
    ):  # fmt: skip
        save_checkpoint(Path(finished.checkpoint), {**content, **damage})
        with pytest.raises(InputError, match=message):
            run(tmp_path, resume=Path(finished.run), iterations=2)


def test_a_policy_by_state_teaches_one_by_camera():
    from simwarp.train.networks.policies import find_policy

    task = make("obstacle-avoidance", 3, seed=1, obs="camera")
    taught = find_policy("obstacle-avoidance", Path("shipped"), obs="state").content
    config = replace_fields(
        student_config(type(task), task.config), {"num_envs": 3, "steps_per_iteration": 2, "device": "cpu"}
    )
    student = Distiller(task, config, Lesson(taught, "shipped", DistillationConfig(mini_batches=2)))
    student.iterate()
    by_state = make("obstacle-avoidance", 3, seed=1, obs="state")
    expected = network_policy(taught, by_state)(by_state.restart()).clamp(-1.0, 1.0)
    # Float32 networks on rows of different strides
    torch.testing.assert_close(student.storage.privileged_actions[0], expected, atol=1e-5, rtol=0.0)
