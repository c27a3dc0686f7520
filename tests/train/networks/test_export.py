"""An exported policy does what the trained one does, on raw observations, in any batch size."""

import json
from pathlib import Path

import pytest
import torch

from simwarp import cli
from simwarp.tasks import make, replace_fields
from simwarp.train.algorithm.learner import TrainingError
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import Cell, NetworkKind, TrainConfig
from simwarp.train.networks import export
from simwarp.train.networks.export import ExportFormat, export_policy, load_exported
from simwarp.train.runs.checkpoint import save_checkpoint
from tests.tasks.framework.camera_task import CameraConfig, camera_task

__all__ = ["camera_task"]
KINDS = [
    (NetworkKind.MLP, "gru"), (NetworkKind.THESIS_MLP, "gru"), (NetworkKind.NATURE_CNN, "gru"),
    (NetworkKind.EARLY_FUSION, "gru"), (NetworkKind.LATE_FUSION, "gru"), (NetworkKind.RECURRENT, "gru"),
    (NetworkKind.RECURRENT, "lstm"),
]  # fmt: skip
LONG = KINDS[1:2] + KINDS[3:4] + KINDS[5:6]
"""What is made of the same layers as the others; each takes seconds to export."""


def trained(path, name, kind, cell="gru"):
    """A checkpoint after one iteration, so that the normaliser is not the identity."""
    settings = {
        "num_envs": 8, "steps_per_iteration": 8, "device": "cpu", "network.kind": kind, "network.cell": Cell(cell),
        "ppo.epochs": 1, "network.memory": 16, "network.tanh_output": kind is NetworkKind.EARLY_FUSION,
    }  # fmt: skip
    config = CameraConfig(vectors=kind is not NetworkKind.NATURE_CNN) if name == "camera-test" else None
    trainer = Trainer(make(name, 8, config=config), replace_fields(TrainConfig(), settings))
    trainer.iterate()
    save_checkpoint(path, trainer.checkpoint())
    return trainer


@pytest.mark.quick(
    "mlp-gru-onnx",
    "mlp-gru-torchscript",
    "late-fusion-gru-torchscript",
    "nature-cnn-gru-torchscript",
    "recurrent-lstm-torchscript",
)
@pytest.mark.parametrize("form", list(ExportFormat), ids=lambda form: form.value)
@pytest.mark.parametrize(
    ("kind", "cell"),
    [pytest.param(*case, marks=[pytest.mark.slow] * (case in LONG)) for case in KINDS],
    ids=lambda value: getattr(value, "value", value),
)
def test_every_network_exports_and_agrees(tmp_path, camera_task, kind, cell, form):
    images = kind in (NetworkKind.NATURE_CNN, NetworkKind.EARLY_FUSION, NetworkKind.LATE_FUSION)
    trainer = trained(tmp_path / "a.pt", camera_task if images else "fast", kind, cell)
    result = export_policy(tmp_path / "a.pt", form, tmp_path / "policy")
    assert result.max_difference <= 1e-5
    assert result.recurrent == (kind is NetworkKind.RECURRENT)
    # Another batch size than the one that was traced, held to the actor itself
    run = load_exported(tmp_path / "policy", form)
    actor = trainer.algorithm.actor.eval()
    actor.reset()
    for batch in (1, 3):
        observations = trainer.env.get_observations()[:batch]
        memory = [torch.zeros(1, batch, 16)] * (len(result.inputs) - len(trainer.task.observation_shapes))
        got, *rest = run(*(observations[name] for name in trainer.task.observation_shapes), *memory)
        assert got.shape == (batch, 2)
        assert len(rest) == len(memory)
        with torch.inference_mode():
            torch.testing.assert_close(got, actor(observations), atol=1e-5, rtol=1e-5)
        actor.reset()


def test_a_file_that_differs_is_not_written(tmp_path, monkeypatch):
    trained(tmp_path / "a.pt", "fast", NetworkKind.MLP)
    monkeypatch.setattr(export, "_load_torchscript", lambda path: lambda *tensors: (torch.full((8, 2), 0.5),))
    with pytest.raises(TrainingError, match="differs from the trained one"):
        export_policy(tmp_path / "a.pt", ExportFormat.TORCHSCRIPT, tmp_path / "a.ts")
    assert [path.name for path in tmp_path.iterdir()] == ["a.pt"]


def test_onnx_is_checked_without_onnxruntime_too(tmp_path, monkeypatch):
    trained(tmp_path / "a.pt", "fast", NetworkKind.MLP)
    real = export.importlib.util.find_spec
    monkeypatch.setattr(export.importlib.util, "find_spec", lambda name: None if name == "onnxruntime" else real(name))
    assert export_policy(tmp_path / "a.pt", ExportFormat.ONNX, tmp_path / "a.onnx").max_difference <= 1e-5


def test_the_files_say_what_they_are(tmp_path):
    onnx = pytest.importorskip("onnx")
    trained(tmp_path / "a.pt", "fast", NetworkKind.MLP)
    for form in ExportFormat:
        export_policy(tmp_path / "a.pt", form, tmp_path / form.value)
    extra = {"simwarp.json": ""}
    torch.jit.load(str(tmp_path / "torchscript"), _extra_files=extra)
    model = onnx.load(str(tmp_path / "onnx"))
    stored = {entry.key: entry.value for entry in model.metadata_props}
    expected = {"task": "fast", "iteration": 1, "inputs": ["policy"], "outputs": ["actions"]}
    assert json.loads(stored["simwarp"]) == json.loads(extra["simwarp.json"]) == expected


def test_the_model_beside_the_policy(tmp_path, monkeypatch, capfd):
    mujoco = pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    trained(tmp_path / "a.pt", "pendulum", NetworkKind.MLP)
    arguments = ["export", "a.pt", "--format", "torchscript", "--mjcf", "a.xml", "--json", "out.json"]
    assert cli.main(arguments) == 0
    assert json.loads(Path("out.json").read_text())["mjcf"] == "a.xml"
    assert "wrote a.xml" in capfd.readouterr().out
    theirs = mujoco.MjModel.from_xml_path("a.xml")
    task = make("pendulum", 1)
    assert theirs.nv == task.simulation.model.dof_count
    assert theirs.opt.timestep == pytest.approx(task.config.dt / task.config.substeps)
    trained(tmp_path / "b.pt", "fast", NetworkKind.MLP)
    assert cli.main(["export", "b.pt", "--mjcf", "b.xml"]) == 2
    assert "task 'fast' has no physics" in capfd.readouterr().err


def test_the_command(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    trained(tmp_path / "a.pt", "fast", NetworkKind.MLP)
    assert cli.main(["export", "a.pt", "--format", "torchscript", "--json", "out.json"]) == 0
    result = json.loads(Path("out.json").read_text())
    assert {"output": "fast.ts", "format": "torchscript", "inputs": ["policy"]}.items() <= result.items()
    assert Path("fast.ts").stat().st_size > 1000
    assert "largest difference" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["export"], "usage: simwarp export RUN_OR_CHECKPOINT"),
        (["export", "none.pt"], "checkpoint 'none.pt' does not exist"),
        (["export", "a.pt", "--format", "onx"], "--format"),
        (["export", "a.pt", "--output", "no/such/p.onnx"], "folder no/such does not exist"),
        (["export", "gone.pt"], "unknown task 'gone'"),
        (["export", "odd.pt"], "network does not fit task 'fast'"),
    ],
)
def test_mistakes_get_one_line(tmp_path, monkeypatch, capfd, arguments, message):
    monkeypatch.chdir(tmp_path)
    content = trained(tmp_path / "a.pt", "fast", NetworkKind.MLP).checkpoint()
    save_checkpoint(tmp_path / "gone.pt", content | {"task": "gone"})
    actor = {name: value for name, value in content["actor_state_dict"].items() if "mlp.0" not in name}
    save_checkpoint(tmp_path / "odd.pt", content | {"actor_state_dict": actor})
    capfd.readouterr()
    assert cli.main(arguments) == 2
    err = capfd.readouterr().err
    assert message in err
    assert err.count("\n") == 1
