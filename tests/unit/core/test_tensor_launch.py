"""Recorded launches over torch tensors, and streams that Warp and torch share."""

import pytest
import torch
import warp as wp

from simwarp.core.interop import TensorLaunch, shared_stream


@wp.kernel(enable_backward=False)
def add_scaled(values: wp.array2d[float], factor: float, flags: wp.array[wp.bool], total: wp.array[float]):
    i = wp.tid()
    if flags[i]:
        for k in range(values.shape[1]):  # type: ignore[attr-defined]
            total[i] = total[i] + factor * values[i, k]  # type: ignore[index]


@wp.kernel(enable_backward=False)
def lengths(v: wp.array[wp.vec3], length: wp.array[float]):
    i = wp.tid()
    length[i] = wp.length(v[i])  # type: ignore[index]


def made(values, flags):
    total = torch.zeros(3)
    return TensorLaunch(add_scaled, 3, [values, 2.0, flags, total], torch.device("cpu")), total


def test_a_launch_reads_and_writes_the_memory_of_its_tensors():
    values, flags = torch.arange(6.0).view(3, 2), torch.tensor([True, False, True])
    launch, total = made(values, flags)
    launch.launch()
    values += 1.0
    launch.launch()
    assert total.tolist() == [8.0, 0.0, 40.0]


def test_a_launch_takes_other_tensors_and_keeps_them():
    launch, total = made(torch.zeros(3, 2), torch.ones(3, dtype=torch.bool))
    launch.on(torch.ones(3, 2))
    assert total.tolist() == [4.0] * 3
    launch.on(torch.ones(3, 2), torch.tensor([False, True, False]))
    assert total.tolist() == [4.0, 8.0, 4.0]
    launch.launch()
    assert total.tolist() == [4.0, 12.0, 4.0]


def test_strides_are_those_of_the_tensor():
    launch, total = made(torch.zeros(3, 2), torch.ones(3, dtype=torch.bool))
    launch.on(torch.arange(24.0).view(6, 4)[::2, 1:3])
    assert total.tolist() == [6.0, 38.0, 70.0]
    launch.on(torch.ones(3, 1).expand(3, 2))
    assert total.tolist() == [10.0, 42.0, 74.0]


def test_a_tensor_of_vectors_has_their_components_last():
    length = torch.zeros(2)
    vectors = torch.tensor([[3.0, 4.0, 0.0], [0.0, 0.0, 2.0]])
    TensorLaunch(lengths, 2, [vectors, length], torch.device("cpu")).launch()
    assert length.tolist() == [5.0, 2.0]


def test_a_launch_works_in_inference_mode():
    launch, total = made(torch.zeros(3, 2), torch.ones(3, dtype=torch.bool))
    with torch.inference_mode():
        launch.on(torch.ones(3, 2))
    assert total.tolist() == [4.0] * 3


def test_a_cpu_has_no_stream():
    with shared_stream("cpu") as stream:
        assert stream is None


@pytest.mark.cuda
def test_a_stream_of_torch_is_wrapped_once():
    with shared_stream("cuda:0") as first, shared_stream("cuda:0") as second:
        assert first is second
    with torch.cuda.stream(torch.cuda.Stream("cuda:0")), shared_stream("cuda:0") as other:
        assert other is not first
