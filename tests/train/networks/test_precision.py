"""Convolutions in bfloat16: near those in float32, only while a network learns, and a run in them goes on exactly."""

from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from simwarp.tasks import InputError, make, replace_fields
from simwarp.train.algorithm import mini_batch_shares
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import NetworkKind, Precision, TrainConfig
from simwarp.train.networks.encoders import NatureEncoder
from simwarp.train.networks.export import ExportFormat, export_policy
from simwarp.train.networks.policies import network_policy
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.training import train
from tests.tasks.framework.camera_task import CameraConfig, camera_task

__all__ = ["camera_task"]
QUIET = Console(quiet=True)
ROUNDING = 2.0**-9
"""Largest relative error of a number that is rounded to bfloat16, which has eight bits."""


def small(**changes):
    settings = {
        "num_envs": 8, "iterations": 2, "steps_per_iteration": 8, "device": "cpu", "save_interval": 1, "threads": 2,
        "network.kind": NetworkKind.EARLY_FUSION, "network.precision": Precision.BFLOAT16, "ppo.epochs": 1,
        "ppo.mini_batches": 2,
    }  # fmt: skip
    return replace_fields(TrainConfig(), settings | changes)


def encoders(shape=(45, 80, 3)):
    torch.manual_seed(0)
    exact, coarse = NatureEncoder(shape), NatureEncoder(shape, Precision.BFLOAT16)
    coarse.load_state_dict(exact.state_dict())
    return exact, coarse


def apart(found, exact):
    return float((found - exact).norm() / exact.norm())


def reference(encoder, image):
    """The three convolutions in float64, written out: a window at a time."""
    numbers = (image.numpy().astype(np.float64) - 127.0) / 255.0
    for layer in (layer for layer in encoder.layers if isinstance(layer, torch.nn.Conv2d)):
        assert layer.bias is not None
        weight, bias = (part.detach().numpy().astype(np.float64) for part in (layer.weight, layer.bias))
        size, step = layer.kernel_size[0], layer.stride[0]
        rows, columns = ((side - size) // step + 1 for side in numbers.shape[1:3])
        out = np.empty((len(numbers), rows, columns, len(weight)))
        for row in range(rows):
            for column in range(columns):
                window = numbers[:, row * step : row * step + size, column * step : column * step + size]
                out[:, row, column] = np.einsum("nhwc,ochw->no", window, weight) + bias
        numbers = np.maximum(out, 0.0)
    return numbers.transpose(0, 3, 1, 2).reshape(len(numbers), -1)


def test_both_are_near_the_convolutions_written_out():
    exact, coarse = encoders()
    image = torch.randint(0, 256, (3, 45, 80, 3), dtype=torch.uint8)
    expected = torch.from_numpy(reference(exact, image))
    with torch.no_grad():
        # Sums of up to 576 products in float32
        assert apart(exact(image), expected) < 1e-6
        # Weights and features are rounded in each of three layers: six roundings of random signs, doubled
        assert ROUNDING / 10 < apart(coarse(image), expected) < 2.0 * np.sqrt(6.0) * ROUNDING


@pytest.mark.parametrize("dtype", [torch.uint8, torch.float32])
def test_gradients_are_near_those_of_float32_and_are_float32(dtype):
    exact, coarse = encoders()
    image = torch.randint(0, 256, (64, 45, 80, 3), dtype=torch.uint8)
    if dtype == torch.float32:
        image = (image.float() - 127.0) / 255.0
    found, expected = (
        torch.autograd.grad(encoder(image).square().sum(), list(encoder.parameters())) for encoder in (coarse, exact)
    )
    for one, other in zip(found, expected, strict=True):
        assert one.dtype == torch.float32
        # Sums over places where errors of one sign partly add; the first weights' also cancel, pixels being about zero
        assert apart(one, other) < 16.0 * ROUNDING


def test_a_finished_policy_acts_in_float32():
    exact, coarse = (encoder.eval() for encoder in encoders())
    image = torch.randint(0, 256, (3, 45, 80, 3), dtype=torch.uint8)
    with torch.no_grad():
        assert torch.equal(exact(image), coarse(image))


def test_the_weights_stay_float32_and_bfloat16_is_really_used(camera_task):
    updated = {}
    for precision in Precision:
        trainer = Trainer(make(camera_task, 8), small(**{"network.precision": precision}))
        trainer.iterate()
        updated[precision] = torch.cat([part.detach().flatten() for part in trainer.algorithm.actor.parameters()])
        trainer.close()
        assert updated[precision].dtype == torch.float32
        assert torch.isfinite(updated[precision]).all()
    assert not torch.equal(*updated.values())


@pytest.mark.parametrize("form", list(ExportFormat), ids=[form.value for form in ExportFormat])
def test_a_policy_that_learnt_in_bfloat16_is_exported_as_it_acts(camera_task, form, tmp_path):
    result = train(camera_task, small(iterations=1), CameraConfig(), root=tmp_path, console=QUIET)
    # export_policy holds the file to the policy within TOLERANCE, and raises where it differs
    export = export_policy(Path(result.run), form, tmp_path / "policy")
    assert export.max_difference <= 1e-5
    content = load_checkpoint(Path(result.checkpoint))
    assert content["train_config"]["network"]["precision"] == "bfloat16"
    policy = network_policy(content, make(camera_task, 8))
    assert not policy.actor.training


def test_a_run_in_bfloat16_goes_on_exactly(camera_task, tmp_path, monkeypatch):
    monkeypatch.setattr(mini_batch_shares, "LEAST_NUMBERS", 8)  # mini-batches this small are shared among threads too
    whole = train(camera_task, small(iterations=2), CameraConfig(), root=tmp_path / "whole", console=QUIET)
    part = train(camera_task, small(iterations=1), CameraConfig(), root=tmp_path / "part", console=QUIET)
    resumed = train(
        camera_task, small(iterations=2), CameraConfig(), root=tmp_path / "part", resume=Path(part.run), console=QUIET
    )
    left, right = (load_checkpoint(Path(result.checkpoint))["actor_state_dict"] for result in (whole, resumed))
    assert all(torch.equal(left[name], right[name]) for name in left)


def test_it_is_refused_where_there_are_no_convolutions():
    with pytest.raises(InputError, match="precision must be float32 for a network without convolutions"):
        small(**{"network.kind": NetworkKind.MLP})
