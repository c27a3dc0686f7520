"""Device memory and functions of tasks that are written as kernels."""

from typing import Any

import torch
import warp as wp

from simwarp.core.interop import to_torch
from simwarp.tasks.framework.recorded_launches import TensorFunction, filled, launch_over, zeros_of
from tests.tasks.framework.samples import counter

CPU = torch.device("cpu")


@wp.struct
class Parts:
    number: float
    rows: wp.array2d[float]
    flags: wp.array[wp.bool]


@wp.struct
class Rows:
    rows: wp.array2d[float]
    places: wp.array[wp.vec3d]


@wp.kernel(enable_backward=False)
def scaled(values: wp.array2d[float], factor: float, product: wp.array2d[float], corner: wp.array2d[wp.vec2]):
    i, k = wp.tid()  # type: ignore[misc]
    product[i, k] = factor * values[i, k]  # type: ignore[index]
    corner[i, k] = wp.vec2(float(i), float(k))  # type: ignore[index]


@wp.kernel(enable_backward=False)
def count_rows(parts: Parts, total: wp.array[float]):
    i = wp.tid()
    if parts.flags.shape[0] == 0:
        total[i] = parts.number + parts.rows[i, 0]  # type: ignore[index]


def test_a_function_returns_memory_of_its_own():
    times = TensorFunction(scaled, [3.0], [(torch.float32, ()), (torch.float32, (2,))], CPU, dimensions=2)
    first, corner = times(torch.ones(2, 3))
    kept = first.clone()
    second, _ = times(torch.full((2, 3), 2.0))
    assert torch.equal(first, kept)
    assert second.tolist() == [[6.0] * 3] * 2
    assert corner[1, 2].tolist() == [1.0, 2.0]
    assert times(torch.ones(4, 1))[0].shape == (4, 1)  # another shape, another launch
    assert times(torch.ones(2, 3))[0].tolist() == [[3.0] * 3] * 2


def test_structs_take_tensors_and_what_is_left_out_has_no_length():
    rows, total = torch.arange(6.0).view(3, 2), torch.zeros(3)
    launch_over(counter(3), count_rows, filled(Parts, number=10.0, rows=rows), total).launch()
    assert total.tolist() == [10.0, 12.0, 14.0]


def test_zeros_have_a_row_for_each_world():
    made: Any = zeros_of(Rows, counter(4), rows=5)
    assert to_torch(made.rows).shape == (4, 5)
    assert to_torch(made.places).shape == (4, 3)
    assert to_torch(made.places).dtype == torch.float64
