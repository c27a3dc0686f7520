"""Where a model goes that names no device: to a GPU only where torch can look at its arrays there."""

import re
import warnings

import pytest
import torch
import warp as wp

import simwarp as sw
from simwarp.core.interop import to_torch
from simwarp.model.model import resolve_device


class Gpu:
    """What Warp would say of its first GPU."""

    is_cuda, ordinal = True, 0

    def __str__(self) -> str:
        return "cuda:0"


@pytest.fixture
def gpu(monkeypatch):
    """Warp prefers a GPU, as where there is one."""
    there, devices = Gpu(), wp.get_device
    monkeypatch.setattr(wp, "get_device", lambda name=None: there if name in (None, "cuda:0") else devices(name))
    return there


def hanging() -> sw.ModelBuilder:
    builder = sw.ModelBuilder()
    builder.add_body("bob", mass=1.0, inertia=(1, 1, 1))
    return builder


def test_a_gpu_that_torch_does_not_see_is_not_the_default(gpu, monkeypatch):
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    monkeypatch.setattr(torch.version, "cuda", None)
    rule = f"device: cpu, not cuda:0, which torch {torch.__version__}, a CPU build, does not see; name one"
    with pytest.warns(UserWarning, match=f"^{re.escape(rule)}") as told:
        model = hanging().finalize(2)
    assert len(told) == 1
    assert told[0].filename == __file__
    assert str(model.device) == "cpu"
    assert to_torch(model.body_mass).shape == (1, 1)


def test_a_gpu_that_torch_sees_is_the_default_and_one_that_is_named_is_taken(gpu, monkeypatch):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
        assert resolve_device(None) is gpu
        monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
        assert resolve_device("cuda:0") is gpu
        assert str(resolve_device("cpu")) == "cpu"


@pytest.mark.cuda
@pytest.mark.parametrize(("seen", "chosen"), [(0, "cpu"), (1, "cuda:0")])
@pytest.mark.filterwarnings("ignore:device. cpu:UserWarning")
def test_a_model_of_the_default_device_gives_tensors(seen, chosen, monkeypatch):
    monkeypatch.setattr(torch.cuda, "device_count", lambda: seen)
    with wp.ScopedDevice("cuda:0"):  # as Warp begins where there is a GPU
        model = hanging().finalize(2)
    assert str(model.device) == chosen
    assert str(to_torch(model.body_mass).device) == chosen
