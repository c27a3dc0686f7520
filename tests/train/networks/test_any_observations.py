"""Observations of every kind are learnt from, resumed, exported and distilled; so are networks of one's own."""

import json
import math
import re
import sys
from pathlib import Path

import pytest
import torch
from rich.console import Console

from simwarp import cli
from simwarp.cli.evaluation.grids import field_of
from simwarp.tasks import InputError, TaskError, make, replace_fields, task_class
from simwarp.tasks.framework.observation_kinds import ObservationKind, kind_of_shape
from simwarp.train.algorithm.distillation import DistillationConfig
from simwarp.train.algorithm.distiller import Distiller
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import NetworkConfig, NetworkKind, TrainConfig, default_config
from simwarp.train.networks.encoders import NatureEncoder, PointEncoder, SequenceEncoder, convolution_size
from simwarp.train.networks.export import ExportFormat, export_policy
from simwarp.train.networks.policies import network_policy
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.saved_distillation import lesson_by
from simwarp.train.runs.training import train
from tests.train.networks.any_groups import SHAPES

QUIET = Console(quiet=True)
FILE = Path(__file__).with_name("any_groups.py")
TASK = f"{FILE}:AnyGroups"
MULTI_INPUT = {"network.kind": NetworkKind.MULTI_INPUT, "network.features": 8}
WIDE = ("vector", "scan", "mixture")
"""Observations that a network of one's own is tried on."""
CASES = [("multi-input", obs) for obs in SHAPES] + [("own", obs) for obs in WIDE] + [("rsl-rl", "vector")]


def own(name: str) -> dict[str, object]:
    return {"network.class_": f"{FILE}:{name}"}


NETWORKS = {"multi-input": MULTI_INPUT, "own": own("Flat"), "rsl-rl": own("Model")}


def task_config(obs):
    return replace_fields(task_class(TASK).config_type(), {"obs": obs})


def config(obs, **changes):
    small = {"device": "cpu", "threads": 1, "iterations": 2, "save_interval": 1}
    return replace_fields(default_config(task_class(TASK), task_config(obs)), small | changes)


def trainer(obs, **changes):
    return Trainer(make(TASK, 8, config=task_config(obs)), config(obs, **changes))


def state_of(run):
    return load_checkpoint(Path(run.checkpoint))["actor_state_dict"]


@pytest.mark.quick("multi-input-mixture", "own-mixture")
@pytest.mark.parametrize(("network", "obs"), CASES)
def test_all_that_a_policy_goes_through(tmp_path, network, obs):
    """Two iterations, the second one resumed; a file as exact as the network; a student of the policy's."""
    changes = NETWORKS[network]
    whole = train(TASK, config(obs, **changes), task_config(obs), root=tmp_path, console=QUIET)
    part = train(TASK, config(obs, iterations=1, **changes), task_config(obs), root=tmp_path, console=QUIET)
    resumed = train(TASK, config(obs, **changes), task_config(obs), root=tmp_path, resume=Path(part.run), console=QUIET)
    left, right = state_of(whole), state_of(resumed)
    assert all(torch.equal(left[name], right[name]) for name in left)
    assert any(not torch.equal(left[name], value) for name, value in state_of(part).items())
    result = export_policy(Path(whole.run), ExportFormat.ONNX, tmp_path / "policy.onnx")
    assert result.max_difference <= 1e-5
    assert result.inputs == list(SHAPES[obs])

    lesson = lesson_by(Path(whole.run), "any-groups", DistillationConfig(mini_batches=2))
    student = Distiller(make(TASK, 8, config=task_config(obs)), config(obs, **changes), lesson)
    # The student has its teacher's network: the same results where it has its weights, too
    student.algorithm.student.load_state_dict(left)
    student.collect()
    seen = student.storage.observations[-1]
    with torch.no_grad():
        told = student.algorithm.student(seen).clamp(-1.0, 1.0)
    torch.testing.assert_close(told, student.storage.privileged_actions[-1], atol=1e-5, rtol=1e-5)
    assert math.isfinite(student._learn()["behavior"])


@pytest.mark.parametrize(
    ("shape", "kind"),
    [
        ((7,), "vector"), ((16, 900, 2), "image"), ((1, 900, 1), "image"), ((2000, 4), "points"), ((5, 3), "points"),
        ((900, 1), "sequence"), ((10, 12), "sequence"), ((2, 3, 4, 5), None), ((), None),
    ],
)  # fmt: skip
def test_a_shape_says_the_kind(shape, kind):
    assert kind_of_shape(shape) == (None if kind is None else ObservationKind(kind))


def test_sizes_of_convolutions_are_those_of_the_thesis_but_where_its_rounding_drops_a_window():
    """Equation 3.17 is ceil((I - K + 2 P) / S); its example is 260 x 125 with 8 x 8 by 4, then 4 x 4 by 2."""
    for side in range(4, 300):
        for kernel, stride, padding in ((8, 4, 0), (4, 2, 0), (3, 1, 0), (5, 3, 2)):
            if kernel > side:
                continue
            span = side - kernel + 2 * padding
            dropped = span % stride == 0
            assert convolution_size(side, kernel, stride, padding) == math.ceil(span / stride) + dropped
            windows = torch.zeros(side + 2 * padding).unfold(0, kernel, stride)
            assert convolution_size(side, kernel, stride, padding) == len(windows)
    assert [convolution_size(side, 8, 4) for side in (125, 260)] == [30, 63 + 1]


@pytest.mark.parametrize("shape", [(16, 900, 2), (1, 900, 1), (3, 5, 4), (36, 36, 3), (1, 1, 1)])
def test_an_image_may_have_any_size(shape):
    encoder = NatureEncoder(shape)
    with torch.no_grad():
        assert encoder(torch.rand(2, *shape)).shape == (2, encoder.size)


@pytest.mark.parametrize("length", [1, 2, 7, 8, 9, 10, 61, 900])
def test_the_newest_entry_of_a_sequence_counts(length):
    encoder = SequenceEncoder((length, 2))
    sequence = torch.rand(1, length, 2, requires_grad=True)
    found = encoder(sequence)
    assert found.shape == (1, encoder.size)
    (slope,) = torch.autograd.grad(found.sum(), sequence)
    assert bool((slope[0, -1] != 0.0).any())
    assert bool((slope[0, 0] != 0.0).any())


def test_the_order_of_points_does_not_count():
    encoder, cloud = PointEncoder(4), torch.rand(3, 40, 4)
    with torch.no_grad():
        found = encoder(cloud)
        torch.testing.assert_close(encoder(cloud[:, torch.randperm(40)]), found)
        torch.testing.assert_close(encoder(cloud.view(3, 5, 8, 4)), found)
        assert not torch.allclose(encoder(cloud + 1.0), found)


def test_the_normalisers_see_each_channel():
    learner = trainer("mixture", **MULTI_INPUT)
    learner.iterate()
    actor, task = learner.algorithm.actor, learner.task
    learner.collect()
    seen = learner.storage.observations.flatten(0, 1)
    before = {name: actor.get_latent(seen)[name] for name in SHAPES["mixture"]}
    assert before["camera"].dtype == torch.uint8
    for name in set(task.observation_shapes) - {"camera"}:
        # One iteration's mean and deviation, of waves of one amplitude everywhere
        flat = before[name].flatten(0, -2)
        assert flat.mean(0).abs().max() < 1.0
        assert flat.std(0) == pytest.approx(torch.ones(flat.shape[1]).numpy(), abs=0.5)


@pytest.mark.parametrize(
    ("obs", "changes"),
    [
        ("mixture", MULTI_INPUT), ("mixture", own("Flat")), ("vector", {"network.hidden": (64,)}),
        ("vector", own("Model")),
        ("vector", {"network.kind": NetworkKind.RECURRENT}),
    ],
)  # fmt: skip
def test_normal_weights_are_those_of_the_thesis(obs, changes):
    learner = trainer(obs, **changes, **{"network.init_weights": "normal", "network.init_mean": (0.2,)})
    for network, given in ((learner.algorithm.actor, 1), (learner.algorithm.critic, 0)):
        learnt = [(name, one.detach()) for name, one in network.named_parameters() if "distribution" not in name]
        named = dict(sorted(learnt, key=lambda pair: pair[0].startswith("mlp")))  # memories come before
        weights = [one for name, one in named.items() if "weight" in name]
        biases = [one for name, one in named.items() if "bias" in name]
        # The actor's last layer begins with the mean action
        assert all(torch.equal(one, torch.full_like(one, 0.1)) for one in biases[: len(biases) - given])
        if given:
            assert biases[-1].tolist() == pytest.approx([0.2, 0.2])
        drawn = torch.cat([one.flatten() for one in weights[: len(weights) - given]] or [torch.zeros(0)])
        if len(drawn):
            # Of n weights: mean and deviation within five standard errors
            assert abs(float(drawn.mean())) < 5.0 * 0.1 / math.sqrt(len(drawn))
            assert abs(float(drawn.std()) - 0.1) < 5.0 * 0.1 / math.sqrt(2.0 * len(drawn))


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("Flat", "must be module:Class or path/to/file.py:Class, got 'Flat'"),
        ("no_such_module:Flat", "there is no module 'no_such_module'; start in its folder, add that to PYTHONPATH"),
        ("no_such_package.nets:Flat", "there is no module 'no_such_package'"),
        (".nets:Flat", "module '.nets' cannot be imported: "),
        ("any_groups_broken.nets:Flat", "module 'any_groups_broken.nets' cannot be imported: NameError"),
        ("any_groups_broken:Flat", "module .* cannot be imported: NameError: name 'nothing' is not defined"),
        ("none/nets.py:Flat", "file .*none/nets.py' does not exist"),
        (f"{FILE}:Flut", "has no class 'Flut'.*Flat"),
        (f"{FILE}:NoNetwork", "must be a class that is derived from torch.nn.Module, got class 'NoNetwork'"),
        (f"{FILE}:build", "must be a class that is derived from torch.nn.Module, got 'build', a function"),
        (f"{FILE}:Wide", r"must return \(2, 2\) torch.float32 for 2 rows of observations, got \(2, 3\) torch.float32"),
        (f"{FILE}:Odd", r"must return \(2, 2\) torch.float32 for 2 rows of observations, got list"),
        (f"{FILE}:Lost", "fails on observations of zeros: KeyError: 'radar'"),
        (f"{FILE}:Idle", "its parameter 'mlp.0.spare.weight' has no part in what it returns; remove it"),
        (f"{FILE}:Lonely", "cannot be built: TypeError"),
        ("rsl_rl.models:RNNModel", "is recurrent; memories are those of --network.kind recurrent"),
    ],
)
def test_a_network_that_will_not_do_is_refused_in_one_line(tmp_path, monkeypatch, capfd, word, message):
    (tmp_path / "any_groups_broken.py").write_text("nothing\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert cli.main(["train", TASK, "--network.class", word, "--device", "cpu", "--iterations", "1"]) == 2
    error = capfd.readouterr().err.splitlines()[-1]
    assert re.search(f"--network.class.*{message}", error), error
    assert not (tmp_path / "runs" / "any-groups").exists()


def test_commands_find_the_class_again(tmp_path, monkeypatch, capfd):
    """`train` in the folder of a module keeps its name; `eval` and `export` take it from there."""
    (tmp_path / "own_nets.py").write_text(FILE.read_text().replace("@register", "# "))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    small = ["--device", "cpu", "--num-envs", "4", "--iterations", "1", "--logger", "csv"]
    task = ["train", TASK, "--task.obs", "mixture"]
    assert cli.main([*task, *small, "--network.class", "own_nets:Flat"]) == 0
    (run,) = Path("runs/any-groups").iterdir()
    assert json.loads((run / "config.json").read_text())["train_config"]["network"]["class_"] == "own_nets:Flat"
    assert cli.main(["eval", str(run), "--episodes", "4", "--no-baselines", "--json", "eval.json"]) == 0
    assert cli.main(["export", str(run), "--format", "torchscript", "--output", "policy.ts"]) == 0
    assert cli.main(["train", TASK, "--resume", str(run), "--iterations", "2"]) == 0
    capfd.readouterr()
    other = ["train", TASK, "--resume", str(run), "--iterations", "3", "--network.class", f"{FILE}:Model"]
    assert cli.main([*other, "--task.obs", "vector"]) == 2
    assert f"--network.class was 'own_nets:Flat', is '{FILE}:Model'" in capfd.readouterr().err
    # Elsewhere, without the module, one line says what is missing
    content = load_checkpoint(next((run / "checkpoints").glob("*.pt")))
    content["train_config"]["network"]["class_"] = "gone_nets:Flat"
    with pytest.raises(InputError, match=r"--network.class 'gone_nets:Flat': there is no module 'gone_nets'"):
        network_policy(content, make(TASK, 4, config=task_config("mixture")))


def test_a_file_is_found_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(FILE.parent)
    assert NetworkConfig(class_=f"{FILE.name}:Flat").class_ == f"{FILE}:Flat"
    assert NetworkConfig(class_="nets:Flat").class_ == "nets:Flat"


@pytest.mark.parametrize(
    ("obs", "changes", "message"),
    [
        ("points", {}, r"observation 'cloud' .*\(50, 4\).*'mlp' takes \(N,\) float32 groups; try .*multi-input"),
        ("scan", {"network.kind": NetworkKind.EARLY_FUSION}, "takes images .* and .*; try --network.kind multi-input"),
        ("image", {}, "try --network.kind nature-cnn"),
        ("vector", own("Flat") | {"network.precision": "bfloat16"}, "precision must be float32"),
    ],
)
def test_a_network_that_cannot_see_the_groups_is_refused(obs, changes, message):
    with pytest.raises(InputError, match=message):
        trainer(obs, **changes)


@pytest.mark.parametrize(
    ("shape", "dtype"), [((2, 3, 4, 5), torch.float32), ((7, 2), torch.uint8), ((16, 9, 1), torch.int32)]
)
def test_a_shape_that_no_encoder_fits_is_refused(monkeypatch, shape, dtype):
    kind = task_class(TASK)
    seen = lambda task: {"odd": torch.zeros(task.num_worlds, *shape, dtype=dtype)}  # noqa: E731
    monkeypatch.setattr(kind, "observations", seen)
    words = rf"observation 'odd' of task 'any-groups' is {re.escape(str(shape))} {dtype}; network 'multi-input' takes "
    with pytest.raises(InputError, match=words):
        trainer("vector", **MULTI_INPUT)


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ({"cloud": "mesh"}, "observation_kinds of 'cloud' must be one of vector, image, points, sequence, got 'mesh'"),
        ({"clod": "points"}, r"observation_kinds must be of groups that there are \(cloud\), got 'clod'"),
        ({"cloud": "image"}, r"observation_kinds of 'cloud' must be one that fits its shape \(50, 4\), got 'image'"),
        (["cloud"], "observation_kinds must be a dict of groups to kinds"),
    ],
)
def test_a_kind_that_is_unknown_or_does_not_fit_is_refused(monkeypatch, named, message):
    monkeypatch.setattr(task_class(TASK), "observation_kinds", named)
    with pytest.raises(TaskError, match=message):
        make(TASK, 2, config=task_config("points"))


def test_unknown_network_kinds_are_refused(capfd):
    assert cli.main(["train", "pendulum", "--network.kind", "pointnet"]) == 2
    assert "--network.kind must be one of mlp, " in capfd.readouterr().err


def test_a_sweep_varies_the_class():
    assert field_of(TrainConfig(), "network.class") is None
    chosen = replace_fields(TrainConfig(), own("Flat"))
    assert field_of(chosen, "network.class") == f"{FILE}:Flat"
