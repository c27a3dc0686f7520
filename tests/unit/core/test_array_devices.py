"""Every public function that takes arrays, with arrays of another device: moved, or refused in one line.

A second device is a GPU where a case is marked `cuda`. Without one, arrays say that they lie elsewhere, and have other
values in their memory: what refuses them sees the first, and what moves them gets their own values.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import simwarp as sw
from simwarp.core.array_devices import refuse_arguments_elsewhere
from simwarp.core.interop import TensorLaunch
from simwarp.core.types import host_values
from simwarp.soil.pressing_kernels import clear_soil
from tests.unit.core import device_rigs as rigs
from tests.unit.core.device_rigs import CALLS, WORLDS, Call, Give

OTHERS = {"cpu": "cuda:0", "cuda:0": "cpu"}
CUDA = [pytest.param(device, marks=pytest.mark.cuda) for device in OTHERS]


class Elsewhere:
    """A device that is neither the CPU nor any that there is, for Warp and for torch."""

    type, is_cuda, is_cpu, is_capturing, null_stream = "cuda", False, False, False, None

    def __str__(self) -> str:
        return "cuda:7"


NOWHERE: Any = Elsewhere()


class ForeignArray(wp.array):
    """A Warp array whose memory has other values than it says: those of its base, to which a move leads."""

    def to(self, *_: Any, **__: Any) -> Any:
        return self._ref


class Foreign(torch.Tensor):
    """A tensor that lies elsewhere, with other values in its memory than it has; so do those that are made of it."""

    device = NOWHERE
    true: torch.Tensor

    @classmethod
    def __torch_function__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        result = super().__torch_function__(func, types, args, kwargs)
        if isinstance(result, Foreign):
            inner = (each.true if isinstance(each, Foreign) else each for each in args)
            result.true = func(*inner, **(kwargs or {}))
        return result

    def to(self, *_: Any, **__: Any) -> torch.Tensor:
        return self.true

    cpu = to


def elsewhere(kind: str) -> Give:
    """Makes arrays of another device: whoever reads their memory as it is reads other values."""

    def give(values: Any, dtype: Any = None) -> Any:
        values = np.asarray(values)
        other = ~values if values.dtype == np.bool_ else values + 1
        if kind == "torch":
            tensor = torch.as_tensor(other).as_subclass(Foreign)
            tensor.true = torch.as_tensor(values)
            return tensor
        base, decoy = on("cpu", "warp")(values, dtype), on("cpu", "warp")(other, dtype)
        view: Any = wp.array(ptr=decoy.ptr, dtype=decoy.dtype, shape=decoy.shape, device="cpu", copy=False)
        view.__class__ = ForeignArray
        view._ref, view.memory, view.device = base, decoy, NOWHERE
        return view

    return give


def on(device: str, kind: str) -> Give:
    """Makes arrays of a device."""

    def give(values: Any, dtype: Any = None) -> Any:
        values = np.asarray(values)
        if kind == "numpy":
            return values
        if kind == "torch":
            return torch.as_tensor(values, device=device)
        scalar = wp.bool if values.dtype == np.bool_ else wp.dtype_from_numpy(values.dtype)
        return wp.array(values, dtype=dtype or scalar, device=device)

    return give


def outcome(call: Call, device: str, give: Give) -> Any:
    """What a call does to a fresh rig, as NumPy."""
    return call.does(rigs.rig(call.rig, device), give)


@functools.cache
def expected(name: str, device: str) -> Any:
    return outcome(CALLS[name], device, on(device, CALLS[name].kinds[0]))


def check(name: str, device: str, give: Give) -> None:
    """Moved with the results of the device's own arrays, or refused in one line, and all works afterwards."""
    call = CALLS[name]
    if call.moves:
        np.testing.assert_array_equal(outcome(call, device, give), expected(name, device))
        return
    with pytest.raises(sw.ModelError) as caught:
        outcome(call, device, give)
    message = str(caught.value)
    assert message.isprintable()
    assert re.search(rf"must be on {device}, got (an array on )?(cpu|cuda:\d)", message), message
    np.testing.assert_array_equal(outcome(call, device, on(device, call.kinds[0])), expected(name, device))


CASES = [(name, kind) for name, call in CALLS.items() for kind in call.kinds if kind != "numpy"]


@pytest.mark.parametrize(("name", "kind"), [case for case in CASES if case[0] not in rigs.REAL_ONLY])
def test_arrays_that_lie_elsewhere(name, kind):
    check(name, "cpu", elsewhere(kind))


@pytest.mark.parametrize(("name", "kind"), CASES)
@pytest.mark.parametrize("device", CUDA)
def test_arrays_of_the_other_device(name, kind, device):
    check(name, device, on(OTHERS[device], kind))


@pytest.mark.parametrize("name", [name for name, call in CALLS.items() if "numpy" in call.kinds])
@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def test_arrays_of_numpy(name, device):
    np.testing.assert_array_equal(outcome(CALLS[name], device, on(device, "numpy")), expected(name, device))


# ---- what describes a model ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["torch", "warp"])
@pytest.mark.parametrize("name", rigs.HOST)
def test_what_describes_a_model_reads_arrays_of_the_cpu(name, kind):
    make, values = rigs.HOST[name]
    np.testing.assert_array_equal(make(on("cpu", kind)(values)), make(values))


@pytest.mark.cuda
@pytest.mark.parametrize("kind", ["torch", "warp"])
@pytest.mark.parametrize("name", rigs.HOST)
def test_what_describes_a_model_is_read_or_refused(name, kind):
    """Such calls work on the host: they read the array, or say in one line that it has to be copied first."""
    make, values = rigs.HOST[name]
    found, told = None, ""
    try:
        found = make(on("cuda:0", kind)(values))
    except (TypeError, ValueError) as error:
        told = str(error)
    if told:
        assert re.search(r"cpu\(\)|numpy\(\)", told), told
        assert "\n" not in told
    else:
        np.testing.assert_array_equal(found, make(np.asarray(values)))


def test_numbers_of_any_device_are_read():
    for kind in ("torch", "warp"):
        given = elsewhere(kind)([1.0, 2.0])
        assert np.asarray(host_values(given)).tolist() == [1.0, 2.0]


# ---- graphs ----------------------------------------------------------------------------------------------------------


@pytest.mark.cuda
@pytest.mark.parametrize("kind", ["torch", "warp", "numpy"])
@pytest.mark.parametrize("name", [name for name, call in CALLS.items() if call.moves and call.captured])
def test_nothing_is_moved_into_a_graph(name, kind):
    """The copy would be gone when the graph runs: numbers of the host and arrays of the CPU are refused."""
    call, rig = CALLS[name], rigs.rig(CALLS[name].rig, "cuda:0")
    if kind not in call.kinds:
        pytest.skip("it takes none of these")
    call.does(rig, on("cuda:0", call.kinds[0]))  # loads kernels
    given = on("cpu", kind)
    with wp.ScopedCapture(device="cuda:0"), pytest.raises(sw.ModelError, match="while a graph is captured"):
        call.does(rig, given)


# ---- launches --------------------------------------------------------------------------------------------------------


@wp.struct
class Pair:
    """Arrays in a struct."""

    first: wp.array[float]
    second: wp.array[float]


@wp.kernel(enable_backward=False)
def add_pair(pair: Pair, factor: float, total: wp.array[float]):
    i = wp.tid()
    total[i] = pair.first[i] + factor * pair.second[i]  # type: ignore[index]


def test_a_recorded_launch_names_the_argument_that_lies_elsewhere():
    pair: Any = Pair()
    pair.first = wp.zeros(2, dtype=float, device="cpu")
    total: wp.array = wp.zeros(2, dtype=float, device="cpu")
    refuse_arguments_elsewhere(add_pair, [pair, 2.0, total], "cpu")  # an array that nobody set is nowhere
    pair.second = elsewhere("warp")([1.0, 2.0], wp.float32)
    rule = "must be on cpu, got an array on cuda:7; make it there, or move it once"
    with pytest.raises(sw.ModelError, match=f"^add_pair: pair.second {rule}$"):
        refuse_arguments_elsewhere(add_pair, [pair, 2.0, total], "cpu")
    shares = sw.Simulation(rigs.arm_builder().finalize(WORLDS, "cpu"), 0.01, threads=1).shares
    with pytest.raises(sw.ModelError, match=f"^clear_soil: mask {rule}$"):
        shares.record(clear_soil, inputs=[elsewhere("warp")([True] * WORLDS, wp.bool), None])


@wp.kernel(enable_backward=False)
def double(values: wp.array[float], total: wp.array[float]):
    i = wp.tid()
    total[i] = 2.0 * values[i]  # type: ignore[index]


@pytest.mark.parametrize(
    ("device", "give"),
    [
        ("cpu", elsewhere("torch")),
        *(pytest.param(d, on(o, "torch"), marks=pytest.mark.cuda) for d, o in OTHERS.items()),
    ],
)
def test_a_launch_over_tensors_refuses_those_of_another_device(device, give):
    total = torch.zeros(2, device=device)
    far = give(np.zeros(2, np.float32))
    with pytest.raises(sw.ModelError, match=f"^double: values must be on {device}, got an array on "):
        TensorLaunch(double, 2, [far, total], device)
    launch = TensorLaunch(double, 2, [torch.zeros(2, device=device), total], device)
    with pytest.raises(sw.ModelError, match=f"^double: values must be on {device}, got an array on "):
        launch.on(far)
    launch.on(torch.ones(2, device=device))
    assert total.tolist() == [2.0, 2.0]


# ---- none is left out ------------------------------------------------------------------------------------------------

PACKAGES = (
    "simwarp", "simwarp.actuators", "simwarp.kinematics", "simwarp.vehicle", "simwarp.sensors", "simwarp.soil",
    "simwarp.scenery", "simwarp.scenes", "simwarp.viewer", "simwarp.importers", "simwarp.exporters", "simwarp.mcap",
    "simwarp.tasks", "simwarp.train", "simwarp.planning", "simwarp.core.interop",
)  # fmt: skip
ARRAYS = re.compile(r"wp\.array|Tensor|ArrayLike|NDArray")
OF_ANY_KIND = {
    "world_mask", "worlds", "mask", "q", "qd", "action", "actions", "points", "position", "heading", "start", "N", "r",
    "mu", "jacobian", "inverse_mass", "free_velocity", "bias", "warm_start", "inertia", "state", "targets",
}  # fmt: skip
"""Parameters that take arrays and are annotated with `Any`."""


def takers() -> Iterator[str]:
    """Public functions and methods with parameters for arrays, as `Class.method`."""
    for package in PACKAGES:
        module = importlib.import_module(package)
        for public in getattr(module, "__all__", vars(module)):
            thing = None if public.startswith("_") else getattr(module, public)
            if inspect.isfunction(thing) and _takes_arrays(thing):
                yield public
            if not inspect.isclass(thing):
                continue
            for base in thing.__mro__:
                if not base.__module__.startswith("simwarp"):
                    continue
                for name, member in vars(base).items():
                    function = getattr(member, "__func__", member)
                    function = inspect.unwrap(function) if callable(function) else None
                    if inspect.isfunction(function) and not name.startswith("_") and _takes_arrays(function):
                        yield f"{base.__name__}.{name}"


def _takes_arrays(function: Callable[..., Any]) -> bool:
    return any(
        ARRAYS.search(str(each.annotation)) or (each.name in OF_ANY_KIND and "Any" in str(each.annotation))
        for each in inspect.signature(function).parameters.values()
    )


def test_every_public_function_that_takes_arrays_is_called_here():
    pytest.importorskip("viser", reason="names of the viewer need the extra viewer")
    known = {name.partition(" ")[0] for name in (*CALLS, *rigs.HOST, *rigs.APART)}
    found = set(takers())
    assert found - known == set(), "give it a call, or a reason in APART"
    assert known - found - rigs.NOT_FOUND == set(), "there is no such function any more"


def test_calls_are_of_both_kinds():
    assert {call.moves for call in CALLS.values()} == {True, False}
    assert all(dataclasses.is_dataclass(call) for call in CALLS.values())
