"""Tires on a shape of the model: another height field in each world, and in each episode."""

import numpy as np
import pytest

import simwarp as sw
from simwarp.vehicle import SpecError, Tires, ground_of
from simwarp.vehicle.tires.tires import Mount
from tests.unit.vehicle.tires.tire_bench import DT, States, row_of

SIDE, SLOPES, LIFTS = 8.0, (0.0, 0.1, -0.2), (0.02, 0.0, -0.03)
"""Of the fields: planes z = slope x + lift [m]."""
PLACES = np.array([[-1.3, 0.4], [0.2, -0.7], [1.1, 0.9], [0.6, 0.0]])
"""Of the wheels of four worlds [m]."""
ABOVE = 0.45
"""Of the wheel's centre over the point below it, less than its radius [m]."""


def model_with_fields(per_world=("shape_asset", "shape_size", "shape_x")):
    """A wheel and a ground that may show one of three leaning planes."""
    builder = sw.ModelBuilder()
    builder.add_body("wheel", mass=20.0, inertia=(1.0, 1.0, 1.0))
    x = np.linspace(-0.5 * SIDE, 0.5 * SIDE, 17)
    fields = [np.tile(slope * x + lift, (17, 1)) for slope, lift in zip(SLOPES, LIFTS, strict=True)]
    assets = [builder.add_height_field_asset(field, size=(SIDE, SIDE)) for field in fields]
    builder.add_shape_height_field(sw.WORLD, fields[0], size=(SIDE, SIDE), name="ground")
    return builder.finalize(len(PLACES), "cpu", per_world=per_world), np.array(assets)


def deflections(tires, model, heights):
    """Of the wheels, standing upright at their places over ground of these heights [m]."""
    still = np.zeros((len(PLACES), 3))
    upright = np.tile([0.0, 0.0, 0.0, 1.0], (len(PLACES), 1))
    states = States(np.column_stack([PLACES, heights + ABOVE]), upright, still, still)
    tires.apply(DT, states.arrays(), model.assets)
    return tires.deflection.numpy()[:, 0]


def test_every_world_and_episode_has_a_field_of_its_own():
    model, assets = model_with_fields()
    row = row_of("tmeasy")
    tires = Tires([Mount(row, 0)], len(PLACES), 1, "cpu", terrain=ground_of(model, "ground"))
    shape = model.shape_names.index("ground")
    rng = np.random.default_rng(4)
    radius = float(row.values[0])
    for _ in range(4):  # episodes, that begin with another field, factor of the heights and place of the origin
        chosen = rng.integers(0, len(SLOPES), len(PLACES))
        factor, shift = rng.uniform(0.5, 1.5, len(PLACES)), rng.uniform(-0.5, 0.5, (len(PLACES), 3))
        for name, values in (
            ("shape_asset", assets[chosen]),
            ("shape_size", np.column_stack([np.ones((len(PLACES), 2)), factor])),
            ("shape_x", shift),
        ):
            array = getattr(model, name).numpy()
            array[:, shape] = values
            getattr(model, name).assign(array)
        slope, lift = factor * np.take(SLOPES, chosen), factor * np.take(LIFTS, chosen)
        heights = slope * (PLACES[:, 0] - shift[:, 0]) + lift + shift[:, 2]
        # a disc over a plane: the centre's height above it, across
        expected = radius - ABOVE / np.sqrt(1.0 + slope**2)
        # float32 of lengths near 0.5 m, a few times
        np.testing.assert_allclose(deflections(tires, model, heights), expected, rtol=0.0, atol=2e-6)


def test_shared_ground_is_the_same_in_all_worlds():
    model, _ = model_with_fields(per_world=())
    tires = Tires([Mount(row_of("tmeasy"), 0)], len(PLACES), 1, "cpu", terrain=ground_of(model, 0))
    assert tires.terrain.asset.shape == (1,)
    flat = deflections(tires, model, np.full(len(PLACES), LIFTS[0]))
    assert np.ptp(flat) < 2e-6  # float32 of lengths near 0.5 m
    assert flat.min() > 0.0


def test_a_plane_may_lean():
    lean = 0.1
    builder = sw.ModelBuilder()
    builder.add_body("wheel", mass=20.0, inertia=(1.0, 1.0, 1.0))
    turn = (0.0, np.sin(-0.5 * lean), 0.0, np.cos(-0.5 * lean))  # rises along x
    builder.add_shape_plane(pose=sw.pose((0.0, 0.0, 0.2), turn), name="road")
    model = builder.finalize(len(PLACES), "cpu")
    row = row_of("tmeasy")
    tires = Tires([Mount(row, 0)], len(PLACES), 1, "cpu", terrain=ground_of(model, "road"))
    expected = float(row.values[0]) - ABOVE * np.cos(lean)
    found = deflections(tires, model, 0.2 + np.tan(lean) * PLACES[:, 0])
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-6)  # as above


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ("grund", "no shape is called 'grund'; there are ground"),
        (3, "shape must be below 3, got 3"),
        ("box", "shape 'box' must be on WORLD, it is on 'wheel'"),
        ("ball", "must be a plane, a height field or a mesh"),
    ],
)
def test_wrong_shapes_are_named(shape, message):
    builder = sw.ModelBuilder()
    body = builder.add_body("wheel", mass=20.0, inertia=(1.0, 1.0, 1.0))
    builder.add_shape_plane(name="ground")
    builder.add_shape_box(body, half=(0.1, 0.1, 0.1), name="box")
    builder.add_shape_sphere(sw.WORLD, radius=0.1, name="ball")
    with pytest.raises(SpecError, match=message):
        ground_of(builder.finalize(1, "cpu"), shape)
