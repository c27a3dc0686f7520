"""Pages that run out: named by problems(), and bit by bit the same whatever other worlds do; ground that ends."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.soil import PRESETS, Soil, SoilWheel
from simwarp.vehicle.tires.tires import ground
from tests.unit.soil.soil_wheels import RADIUS, WIDTH, rolling

ARRAYS = ("body_x", "body_rot", "body_v", "body_omega")
FEW = 8
"""Pages that a wheel fills within some two metres."""


def there_and_back(worlds: int, steps: int = 2500) -> tuple[sw.Simulation, Soil]:
    """A wheel that drives 2.5 m and returns over what is left of its rut, on few pages."""
    simulation, element = rolling(worlds, torque=900.0, pages=FEW, speed=1.5)
    simulation.step(steps // 2)
    simulation.control.body_torque.fill_(wp.vec3(0.0, -1800.0, 0.0))
    simulation.step(steps - steps // 2)
    return simulation, element


def bits(simulation: sw.Simulation) -> dict[str, np.ndarray]:
    return {name: getattr(simulation.state, name).numpy().copy() for name in ARRAYS}


def test_recycled_pages_give_the_same_bits_in_any_number_of_worlds_and_twice():
    runs = {}
    for worlds in (1, 2, 17):
        simulation, element = there_and_back(worlds)
        assert element.recycled.numpy().min() > 4
        runs[worlds] = bits(simulation)
    again = bits(there_and_back(1)[0])
    for name in ARRAYS:
        np.testing.assert_array_equal(again[name], runs[1][name])
        for worlds in (2, 17):
            for world in range(worlds):
                np.testing.assert_array_equal(runs[worlds][name][world], runs[1][name][0], err_msg=name)


def test_a_snapshot_and_a_reset_amid_recycling_repeat_bits():
    simulation, element = rolling(3, torque=900.0, pages=FEW, speed=1.5)
    first = bits(simulation)
    simulation.step(1500)
    middle = bits(simulation)
    assert element.recycled.numpy().min() > 0
    kept = simulation.snapshot()
    simulation.step(400)
    there, counted = bits(simulation), element.recycled.numpy().copy()
    simulation.restore(kept)
    simulation.step(400)
    np.testing.assert_array_equal(element.recycled.numpy(), counted)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(simulation.state, name).numpy(), there[name])
    simulation.reset(np.array([False, True, False]))
    assert element.recycled.numpy()[1] == 0
    np.testing.assert_array_equal(simulation.state.body_x.numpy()[1], first["body_x"][1])
    simulation.step(1500)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(simulation.state, name).numpy()[1], middle[name][1], err_msg=name)


def test_problems_names_the_world_whose_pages_ran_out_and_how_many_hold_its_ruts():
    """World 2 drives away, the others stand: they keep every bit, and the number that is named is enough."""
    runs = {}
    for pages in (FEW, 64):
        simulation, element = rolling(4, pages=pages, speed=0.0)
        v, omega = simulation.state.body_v.numpy(), simulation.state.body_omega.numpy()
        v[2], omega[2] = (2.0, 0.0, 0.0), (0.0, 2.0 / RADIUS, 0.0)
        simulation.state.body_v.assign(v)
        simulation.state.body_omega.assign(omega)
        simulation.measure()
        torque = np.zeros((4, 1, 3), np.float32)
        torque[2, 0, 1] = 900.0
        simulation.control.body_torque.assign(torque)
        assert simulation.problems() == []
        simulation.step(2000)
        runs[pages] = bits(simulation), simulation.problems(), element.recycled.numpy().copy()
    few, many = runs[FEW], runs[64]
    assert many[1] == []
    again = int(few[2][2])
    assert (few[2] > 0).tolist() == [False, False, True, False]
    told = f"its {FEW} pages ran out, {again} were taken again and the ruts in them are gone"
    assert few[1] == [f"world 2: soil: {told}; Soil(pages={FEW + again}) keeps them"]
    for name in ARRAYS:
        np.testing.assert_array_equal(few[0][name], many[0][name], err_msg=name)  # it never meets its rut again


def test_another_soil_in_world_3_leaves_the_others_amid_recycling():
    runs = []
    for soft in (False, True):
        simulation, element = rolling(5, torque=900.0, pages=FEW, speed=1.5, per_world=True)
        values = element.parameter.numpy()
        if soft:
            values[3] = PRESETS["soft"].values()
        element.parameter.assign(values)
        simulation.step(1500)
        assert np.delete(element.recycled.numpy(), 3).min() > 0
        runs.append(bits(simulation))
    plain, other = runs
    for name in ARRAYS:
        np.testing.assert_array_equal(np.delete(plain[name], 3, axis=0), np.delete(other[name], 3, axis=0))
    assert other["body_x"][3, 0, 2] < plain["body_x"][3, 0, 2] - 0.02


@pytest.mark.parametrize("beyond", [False, True])
def test_a_wheel_drives_beyond_the_border_of_a_height_field(beyond):
    """It falls where there is no ground; until then, and in other worlds, nothing is the matter."""
    builder = sw.ModelBuilder()
    body = builder.add_body("w", mass=300.0, inertia=(10.0, 15.0, 10.0), pose=sw.pose((0.0, 0.0, RADIUS)))
    builder.add_height_field_asset(np.zeros((9, 17)), size=(4.0, 2.0))
    model = builder.finalize(2, "cpu")
    terrain = ground("cpu", kind=sw.ShapeType.HEIGHT_FIELD)
    element = Soil(model, [SoilWheel(body=body, radius=RADIUS, width=WIDTH)], "mid", ground=terrain)
    simulation = sw.Simulation(model, 2e-3, elements=[element], threads=1)
    speed = np.array([[[3.0 if beyond else 0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]]], np.float32)
    simulation.state.body_v.assign(speed)
    simulation.state.body_omega.assign(speed[:, :, [1, 0, 2]] / RADIUS)
    simulation.measure()
    simulation.step(1000)
    x = simulation.state.body_x.numpy()[:, 0]
    assert np.isfinite(x).all()
    assert simulation.problems() == []
    assert RADIUS - 0.1 < x[1, 2] < RADIUS
    assert (x[0, 2] < -1.0) == beyond
    assert (x[0, 0] > 2.0) == beyond
