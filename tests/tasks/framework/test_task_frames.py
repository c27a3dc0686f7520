"""Rotations of tasks against SciPy's."""

import math

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from simwarp.tasks.framework.frames_kernels import (
    euler_123,
    heading_of,
    heading_quaternion,
    quat_product,
    rotate,
    rotate_back,
    tilt_to,
    to_heading,
)

COUNT = 200


@wp.kernel(enable_backward=False)
def measure_body(q: wp.array[wp.quat], v: wp.array[wp.vec3], back: wp.array[wp.vec3], angles: wp.array[wp.vec3]):
    i = wp.tid()
    back[i] = rotate_back(q[i], v[i])  # type: ignore[index]
    angles[i] = euler_123(q[i])  # type: ignore[index]


@wp.kernel(enable_backward=False)
def turn_body(
    a: wp.array[wp.quatd], b: wp.array[wp.quatd], v: wp.array[wp.vec3d], moved: wp.array[wp.vec3d],
    product: wp.array[wp.quatd], heading: wp.array[wp.float64],
):  # fmt: skip
    i = wp.tid()
    moved[i] = rotate(a[i], v[i])  # type: ignore[index]
    product[i] = quat_product(a[i], b[i])  # type: ignore[index]
    heading[i] = heading_of(a[i])  # type: ignore[index]


@wp.kernel(enable_backward=False)
def stand_on(normal: wp.array[wp.vec3d], heading: wp.array[wp.float64], q: wp.array[wp.quatd]):
    i = wp.tid()
    q[i] = quat_product(tilt_to(normal[i]), heading_quaternion(heading[i]))  # type: ignore[index]


@wp.kernel(enable_backward=False)
def look_ahead(away: wp.array[wp.vec2], heading: wp.array[float], seen: wp.array[wp.vec2]):
    i = wp.tid()
    seen[i] = to_heading(away[i], heading[i])  # type: ignore[index]


def launched(kernel, inputs, outputs):
    """Results of a kernel over rows of NumPy arrays; the results' types are Warp's."""
    types = [arg.type.dtype for arg in kernel.adj.args]
    given: list[wp.array] = [
        wp.array(value, dtype=kind, device="cpu") for value, kind in zip(inputs, types[: len(inputs)], strict=True)
    ]
    made = [wp.zeros(COUNT, dtype=kind, device="cpu") for kind in types[len(inputs) :]]
    assert len(made) == outputs
    wp.launch(kernel, dim=COUNT, inputs=given, outputs=made, device="cpu")
    return [array.numpy() for array in made]


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_what_a_body_measures(rng):
    rotation = Rotation.random(COUNT, rng=rng)
    vector = rng.normal(size=(COUNT, 3))
    back, angles = launched(measure_body, [rotation.as_quat(), vector], 2)
    # float32
    assert np.abs(back - rotation.inv().apply(vector)).max() < 3e-6
    away = np.abs(np.exp(1j * angles) - np.exp(1j * rotation.as_euler("XYZ")))
    near_the_pole = np.abs(rotation.as_euler("XYZ")[:, 1]) > 1.5
    assert away[~near_the_pole].max() < 3e-5
    assert near_the_pole.mean() < 0.05


def test_turns(rng):
    first, second = Rotation.random(COUNT, rng=rng), Rotation.random(COUNT, rng=rng)
    vector = rng.normal(size=(COUNT, 3))
    moved, product, heading = launched(turn_body, [first.as_quat(), second.as_quat(), vector], 3)
    assert np.abs(moved - first.apply(vector)).max() < 1e-14
    assert (Rotation.from_quat(product).inv() * (first * second)).magnitude().max() < 1e-7
    ahead = first.apply([1.0, 0.0, 0.0])
    assert np.abs(heading - np.arctan2(ahead[:, 1], ahead[:, 0])).max() < 1e-12


def test_turns_to_a_normal_keep_the_heading_but_for_a_degree(rng):
    heading = np.linspace(-3.1, 3.1, COUNT)
    for slope in (0.1, 0.3):
        way = rng.uniform(-math.pi, math.pi, COUNT)
        normal = np.stack([np.sin(slope) * np.cos(way), np.sin(slope) * np.sin(way), np.full(COUNT, np.cos(slope))], 1)
        (q,) = launched(stand_on, [normal, heading], 1)
        rotation = Rotation.from_quat(q)
        assert np.abs(rotation.apply([0.0, 0.0, 1.0]) - normal).max() < 1e-12
        ahead = rotation.apply([1.0, 0.0, 0.0])
        error = np.exp(1j * (np.arctan2(ahead[:, 1], ahead[:, 0]) - heading))
        assert np.abs(np.angle(error)).max() < 0.25 * slope**2 * 1.1


def test_places_in_axes_of_a_heading(rng):
    away, heading = rng.normal(size=(COUNT, 2)), rng.uniform(-4.0, 4.0, COUNT)
    (seen,) = launched(look_ahead, [away, heading], 1)
    turned = (away[:, 0] + 1j * away[:, 1]) * np.exp(-1j * heading)
    assert np.abs(seen[:, 0] + 1j * seen[:, 1] - turned).max() < 1e-6
