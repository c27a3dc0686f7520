"""Item assignment of control arrays, and the torch views that share their memory."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import warp as wp

from simwarp.core import interop
from simwarp.core.arrays import WritableArray, writable, writable_from


@pytest.fixture
def scalars():
    array = writable((4, 3), wp.float32, "cpu")
    array.assign(np.arange(12, dtype=np.float32).reshape(4, 3))
    return array


def wp_floats(values: list[float]) -> wp.array:
    return wp.array(values, dtype=wp.float32, device="cpu")


COLUMN = {
    "float": lambda: 2.5, "int": lambda: 2, "numpy scalar": lambda: np.float32(3.5), "list": lambda: [1, 2, 3, 4],
    "numpy float64": lambda: np.array([1.0, 2.0, 3.0, 4.0]), "numpy strided": lambda: np.arange(8.0)[::2],
    "torch": lambda: torch.tensor([1.0, 2.0, 3.0, 4.0]), "torch scalar": lambda: torch.tensor(7.0),
    "torch float64": lambda: torch.arange(4.0, dtype=torch.float64), "torch integers": lambda: torch.arange(4),
    "torch strided": lambda: torch.arange(8.0)[::2], "torch one": lambda: torch.tensor([5.0]),
    "torch with gradient": lambda: torch.arange(4.0, requires_grad=True) * 2.0,
    "warp": lambda: wp_floats([4.0, 3.0, 2.0, 1.0]),
}  # fmt: skip


@pytest.mark.parametrize("value", COLUMN.values(), ids=COLUMN)
def test_a_column_is_assigned(scalars, value):
    expected = scalars.numpy().copy()
    given = value()
    if isinstance(given, torch.Tensor):
        given = given.detach()
    expected[:, 1] = given.numpy() if isinstance(given, wp.array) else given
    scalars[:, 1] = value()
    np.testing.assert_array_equal(scalars.numpy(), expected)


KEYS = {
    "row": 1, "last row": -1, "element": (1, 2), "last element": (-1, -1), "all": slice(None),
    "every other": (slice(None, None, 2), 0), "ellipsis": Ellipsis, "block": (slice(1, 3), slice(0, 2)),
    "numpy integer": np.int64(2),
}  # fmt: skip


@pytest.mark.parametrize("key", KEYS.values(), ids=KEYS)
@pytest.mark.parametrize("form", ["scalar", "numpy", "torch"])
def test_every_key(scalars, key, form):
    expected = scalars.numpy().copy()
    shape = expected[key].shape
    values = np.full(shape, 42.0, np.float32) + np.arange(int(np.prod(shape)), dtype=np.float32).reshape(shape)
    given = {"scalar": 42.0, "numpy": values, "torch": torch.from_numpy(np.array(values))}[form]
    expected[key] = 42.0 if form == "scalar" else values
    scalars[key] = given
    np.testing.assert_array_equal(scalars.numpy(), expected)


def test_augmented_assignment(scalars):
    expected = scalars.numpy().copy()
    scalars[:, 0] += 1.0
    scalars[:, 1] *= 2.0
    expected[:, 0] += 1.0
    expected[:, 1] *= 2.0
    np.testing.assert_array_equal(scalars.numpy(), expected)


def test_a_view_is_writable_too(scalars):
    view = scalars[1:3]
    view[0] = [7.0, 8.0, 9.0]
    assert isinstance(view, WritableArray)
    np.testing.assert_array_equal(scalars.numpy()[1], (7.0, 8.0, 9.0))


WRONG_VALUES = {
    "torch too short": torch.arange(3.0), "torch too long": torch.arange(5.0), "torch matrix": torch.ones(4, 2),
    "numpy too short": np.arange(3.0), "list too long": [1.0] * 5, "text": "x",
    "warp too short": wp_floats([1.0, 2.0, 3.0]), "warp of doubles": wp.zeros(4, dtype=wp.float64, device="cpu"),
}  # fmt: skip


@pytest.mark.parametrize("value", WRONG_VALUES.values(), ids=WRONG_VALUES)
def test_values_that_do_not_fit_change_nothing(scalars, value):
    """A short torch tensor or Warp array would otherwise be copied in part, without a word."""
    before = scalars.numpy().copy()
    with pytest.raises(ValueError):
        scalars[:, 0] = value
    np.testing.assert_array_equal(scalars.numpy(), before)


WRONG_KEYS = {
    "mask": np.array([True, False, True, False]), "torch mask": torch.tensor([True, False, True, False]),
    "list": [0, 1], "row out of range": 4, "column out of range": (0, 3), "too many": (0, 0, 0), "text": "a",
    "bool": True,
}  # fmt: skip


@pytest.mark.parametrize("key", WRONG_KEYS.values(), ids=WRONG_KEYS)
def test_keys_that_do_not_exist(scalars, key):
    before = scalars.numpy().copy()
    with pytest.raises(IndexError, match=r"to_torch|outside axis"):
        scalars[key] = 1.0
    np.testing.assert_array_equal(scalars.numpy(), before)


def test_vectors():
    array = writable((4, 2), wp.vec3, "cpu")
    array[:, 0] = (1.0, 2.0, 3.0)
    array[:, 1] = torch.arange(12.0).reshape(4, 3)
    array[3, 0] = wp.vec3(7.0, 8.0, 9.0)
    expected = np.zeros((4, 2, 3))
    expected[:, 0], expected[:, 1], expected[3, 0] = (1, 2, 3), np.arange(12).reshape(4, 3), (7, 8, 9)
    np.testing.assert_array_equal(array.numpy(), expected)
    array[0] = 4.0
    expected[0] = 4.0
    np.testing.assert_array_equal(array.numpy(), expected)
    with pytest.raises(ValueError):
        array[:, 0] = torch.ones(4, 2)


@pytest.mark.parametrize("form", [np.asarray, torch.as_tensor, np.ndarray.tolist])
def test_doubles_keep_their_digits(form):
    """Anchors and offsets of a model are float64: kilometres with micrometres."""
    fine = np.array([[1.0e4 + 1e-7, 2.0, 3.0], [4.0, 5.0, 6.0]])
    anchors = writable((3, 2), wp.vec3d, "cpu")
    anchors[1] = form(fine)
    np.testing.assert_array_equal(anchors.numpy()[1], fine)
    lengths = writable((3, 2), wp.float64, "cpu")
    lengths[:, 1] = form(fine[0])
    np.testing.assert_array_equal(lengths.numpy()[:, 1], fine[0])
    lengths[0, 0] = 1.0e4 + 1e-7
    assert lengths.numpy()[0, 0] == 1.0e4 + 1e-7


def test_matrices():
    inertias = writable_from(np.zeros((2, 1, 3, 3), np.float32), wp.mat33, "cpu")
    inertias[0, 0] = np.diag([1.0, 2.0, 3.0])
    inertias[1] = torch.eye(3)
    expected = np.stack([np.diag([1.0, 2.0, 3.0]), np.eye(3)])
    np.testing.assert_array_equal(inertias.numpy()[:, 0], expected)


def test_it_is_a_warp_array():
    array = writable((2, 2), wp.float32, "cpu")
    copy = wp.clone(array)
    array[:, :] = 1.0
    np.testing.assert_array_equal(copy.numpy(), np.zeros((2, 2)))
    wp.copy(copy, array)
    np.testing.assert_array_equal(copy.numpy(), np.ones((2, 2)))


# ---- torch ----------------------------------------------------------------------------------------------------------


def test_a_view_shares_the_memory_both_ways(scalars):
    view = interop.to_torch(scalars)
    assert view.data_ptr() == scalars.ptr
    view[2, 1] = 99.0
    assert scalars.numpy()[2, 1] == 99.0
    scalars[0] = -1.0
    assert view[0].tolist() == [-1.0, -1.0, -1.0]
    view[torch.tensor([True, False, False, True])] = 5.0  # what item assignment sends people to
    np.testing.assert_array_equal(scalars.numpy()[[0, 3]], np.full((2, 3), 5.0))


def test_views_of_vectors_and_transforms():
    assert interop.to_torch(wp.zeros((4, 2), dtype=wp.vec3, device="cpu")).shape == (4, 2, 3)
    poses: wp.array = wp.array([wp.transform((1, 2, 3), (0, 0, 0, 1))], dtype=wp.transform, device="cpu")
    assert interop.to_torch(poses).tolist() == [[1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]]


def test_a_view_made_in_inference_mode_stays_writable(scalars):
    with torch.inference_mode():
        view = interop.to_torch(scalars)
    view += 1.0  # torch refuses this on an inference tensor
    assert scalars.numpy()[0, 0] == 1.0
    assert not view.requires_grad


def test_from_torch():
    tensor = torch.zeros(3, 3)
    array = interop.from_torch(tensor, dtype=wp.vec3)
    assert array.shape == (3,)
    array.fill_(wp.vec3(1.0, 2.0, 3.0))
    assert tensor[2].tolist() == [1.0, 2.0, 3.0]
    assert interop.from_torch(torch.tensor([True, False])).dtype == wp.bool
    with pytest.raises(ValueError, match=r"contiguous.*call \.contiguous"):
        interop.from_torch(torch.zeros(4, 4)[:, ::2])


@pytest.mark.parametrize(
    ("dtype", "value"), [(wp.int32, 2**31 - 1), (wp.int64, 2**53 + 1), (wp.uint8, 255), (wp.bool, True)]
)
@pytest.mark.parametrize("form", ["scalar", "list", "tensor"])
def test_whole_numbers_and_truths_keep_their_digits(dtype, value, form):
    array = writable((2, 3), dtype, "cpu")
    array[1] = {"scalar": value, "list": [value] * 3, "tensor": torch.tensor([value] * 3)}[form]
    assert array.numpy().tolist() == [[0] * 3, [value] * 3]
