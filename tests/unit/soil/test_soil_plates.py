"""Plates on soil: the law of a node in the kernel, pressed, let go of, dragged, reversed, held on a slope."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import warp as wp

from simwarp.soil import PRESETS, ShearMemory
from simwarp.soil.bekker_janosi_kernels import law_of, press
from simwarp.verify.soil_rigs import DT, PLATE_AREA, PLATE_RADIUS, dragged_plate, plate_on_slope, pressed_plate
from tests.unit.soil.soil_wheels import pressed, sinkage

QUIET = {name: dataclasses.replace(spec, damping=0.0) for name, spec in PRESETS.items()}
DISC = math.sqrt(0.1 / math.pi)


@wp.kernel(enable_backward=False)
def press_in_turn(
    # inputs
    depth: wp.array[float], inverse_b: float, parameter: wp.array3d[float],
    # outputs
    found: wp.array2d[float],
):  # fmt: skip
    """Pressure, plastic sinkage and limit of one node at depths in turn; dim 1."""
    law = law_of(0, 0, inverse_b, parameter)
    plastic = float(0.0)  # noqa: UP018 - a literal would be a constant to Warp
    limit = float(0.0)  # noqa: UP018
    for k in range(depth.shape[0]):
        p = press(depth[k], plastic, limit, law)
        plastic = p.plastic
        limit = p.limit
        found[k, 0] = p.pressure  # type: ignore[index]
        found[k, 1] = p.plastic  # type: ignore[index]
        found[k, 2] = p.limit  # type: ignore[index]


def node(soil: str, depths: np.ndarray, inverse_b: float = 0.0) -> np.ndarray:
    """(n, 3) of the kernel's law, node by node."""
    parameter: wp.array = wp.array(np.array([[PRESETS[soil].values()]]), dtype=float, device="cpu")
    found = wp.zeros((len(depths), 3), dtype=float, device="cpu")
    inputs = [wp.array(depths, dtype=float, device="cpu"), inverse_b, parameter]
    wp.launch(press_in_turn, 1, inputs=inputs, outputs=[found], device="cpu")
    return found.numpy().astype(float)


def test_a_plate_of_02_by_05_m_on_hard_soil_sinks_57_mm_under_100_kpa():
    inverse_b = (0.2 + 0.5) / (0.2 * 0.5)
    assert 1.0 / inverse_b == pytest.approx(0.143, abs=5e-4)
    depth = np.linspace(0.0, 0.008, 8001)
    pressure = node("hard", depth, inverse_b)[:, 0]
    assert np.interp(1.0e5, pressure, depth) == pytest.approx(0.0057, abs=5e-5)
    # and without the cohesive modulus it would sink deeper
    assert np.interp(1.0e5, node("hard", depth)[:, 0], depth) > 0.0065


@pytest.mark.parametrize("soil", ["soft", "mid", "hard", "clay", "snow"])
def test_a_node_is_let_go_of_along_a_line_and_meets_its_curve_again(soil):
    spec = PRESETS[soil]
    down = np.linspace(0.0, 0.06, 601)
    top = float(node(soil, down)[-1, 0])
    assert top == pytest.approx(spec.k_phi * 0.06**spec.exponent, rel=1e-5)
    residual = 0.06 - top / spec.elastic
    up = np.linspace(0.06, residual - 1e-4, 50)
    again = np.concatenate([up[::-1], np.linspace(0.0601, 0.08, 40)])
    found = node(soil, np.concatenate([down, up, again]))
    line, back, further = found[601:651], found[651:701], found[701:]
    # a float32 sinkage of 6 cm is known to 4e-9 m: that much of the elastic line
    rounding = 1e-8 * spec.elastic + 1e-5 * top
    np.testing.assert_allclose(line[:, 0], np.maximum(spec.elastic * (up - residual), 0.0), atol=rounding)
    np.testing.assert_allclose(back[:, 0], line[::-1, 0], atol=rounding)
    np.testing.assert_allclose(found[601:701, 1], residual, atol=1e-8)
    np.testing.assert_allclose(found[601:701, 2], top, rtol=1e-6)
    np.testing.assert_allclose(further[:, 0], spec.k_phi * again[50:] ** spec.exponent, rtol=1e-5)


@pytest.mark.parametrize("soil", ["mid", "hard"])
def test_a_plate_in_the_simulation_follows_curve_and_line(soil):
    """Hard soil is cohesive: 1 / b of the square around a disc is 1 / its radius."""
    spec = QUIET[soil]
    sinkage, pressure = pressed_plate(spec, (0.02, 0.03), "cpu")
    k = spec.k_c / PLATE_RADIUS + spec.k_phi
    first, second = int(np.argmax(sinkage >= 0.02)), int(np.argmax(sinkage >= 0.03))
    curve = k * sinkage**spec.exponent
    np.testing.assert_allclose(pressure[1 : first + 1], curve[1 : first + 1], rtol=1e-4)
    origin = sinkage[first] - curve[first] / spec.elastic
    line = spec.elastic * (sinkage - origin)
    elastic = (np.arange(len(sinkage)) > first) & (sinkage < sinkage[first] - 1e-6)
    assert elastic.sum() > 30
    np.testing.assert_allclose(pressure[elastic], np.maximum(line[elastic], 0.0), atol=1e-3 * curve[first])
    assert pressure[elastic].min() == 0.0  # it was let go of altogether, and came back
    np.testing.assert_allclose(pressure[second - 10 : second + 1], curve[second - 10 : second + 1], rtol=1e-4)


@pytest.mark.parametrize(("soil", "share"), [("hard", 0.02), ("clay", 0.05)])
def test_a_disc_on_cohesive_soil_has_the_square_around_it(soil, share):
    """Its axis points up and has no direction in the ground: a stiffness without end threw it a kilometre up."""
    spec = PRESETS[soil]
    simulation, _ = pressed(soil, load=1.0e4, spacing=0.01, radius=DISC, width=0.2, disc=True, seconds=3.0)
    expected = (1.0e5 / (spec.k_c / DISC + spec.k_phi)) ** (1.0 / spec.exponent)
    # 1 % of its area is on no node; clay's exponent of 0.5 doubles that, as it does the swing past the balance
    assert sinkage(simulation, 0.1) == pytest.approx(expected, rel=share)


def test_less_load_on_pressed_ground_adds_nothing():
    simulation, element = pressed("mid", load=6300.0, disc=True, radius=DISC, width=0.2, spacing=0.02)
    names = ("node", "place_x", "place_y", "count")
    before = {name: element.memory[name].numpy().copy() for name in names}
    deep = float(simulation.state.body_x.numpy()[0, 0, 2])
    # lifted off by a millimetre, more than the elastic third of one, and set down again with nine tenths of the load
    simulation.set_joint_state(None, np.array([[deep - 0.1 + 1e-3]]), None)
    simulation.control.body_force.fill_(wp.vec3(0.0, 0.0, 6300.0))
    simulation.step(10)
    assert float(element.load.numpy()[0, 0]) == 0.0
    for rest in np.linspace(1.0, 0.1, 300):
        simulation.control.body_force.fill_(wp.vec3(0.0, 0.0, float(rest) * 6300.0))
        simulation.step(20)
    simulation.step(1000)
    assert float(element.load.numpy()[0, 0]) == pytest.approx(0.9 * 6300.0, rel=1e-3)
    np.testing.assert_array_equal(element.memory["node"].numpy()[..., :2], before["node"][..., :2])
    assert float(simulation.state.body_x.numpy()[0, 0, 2]) > deep


def janosi(soil: str, way: np.ndarray, load: np.ndarray) -> np.ndarray:
    spec = PRESETS[soil]
    full = PLATE_AREA * spec.cohesion + load * math.tan(spec.friction_angle)
    return full * -np.expm1(-way / spec.shear_length)


@pytest.mark.parametrize("memory", list(ShearMemory))
@pytest.mark.parametrize("heading", [0.0, 0.7, math.pi, -1.1])
@pytest.mark.parametrize("soil", ["mid", "hard"])
@pytest.mark.sweep
def test_a_dragged_plate_feels_janosis_curve_in_any_direction(soil, heading, memory):
    drag = dragged_plate(QUIET[soil], heading, "cpu", memory)
    wanted = janosi(soil, drag.way, drag.load)
    # the last step's way counts in full: 0.2 % of 6 mm
    np.testing.assert_allclose(drag.force[drag.way > 0.006], wanted[drag.way > 0.006], rtol=0.01)
    assert np.abs(drag.across).max() < 1e-5 * drag.load[0]
    if memory is ShearMemory.DIRECTION:  # its price: a direction that grows over a millimetre, damped by the speed
        assert float(drag.force[3]) < float(wanted[3])


@pytest.mark.parametrize("memory", list(ShearMemory))
def test_shear_reversed_holds_the_other_way_at_once_or_within_a_millimetre(memory):
    there, back = 0.015, 0.008
    drag = dragged_plate(QUIET["mid"], 0.4, "cpu", memory, ways=(there, back))
    turn = int(np.argmax(drag.way))
    # the memory moves on at the start of a step, by the speed that it finds there: a step later
    returned = drag.way[turn] - drag.way[turn + 1 :] - 0.02 * DT
    force = drag.force[turn + 1 :]  # against the motion
    full = janosi("mid", drag.way[turn] + returned, drag.load[turn + 1 :])
    if memory is ShearMemory.SCALAR:
        np.testing.assert_allclose(force[returned > 2e-4], full[returned > 2e-4], rtol=0.02)
    else:
        # direction from 1 to -1, plus the push of 10 ms x 20 mm/s / 1 mm x e^-1 that holds at rest, together at most 1
        shape = np.minimum(1.0, 1.0 - 2.0 * np.exp(-returned / 1e-3) + 0.2 * math.exp(-1.0))
        np.testing.assert_allclose(force, full * shape, atol=0.02 * full.max())
    assert force[-1] == pytest.approx(full[-1], rel=0.01)


@pytest.mark.parametrize("memory", list(ShearMemory))
def test_a_plate_stays_on_a_slope_of_20_percent_for_a_minute(memory):
    """Chrono's memory creeps a little: it holds by a speed."""
    assert plate_on_slope(PRESETS["mid"], 0.2, 60.0, "cpu", memory) < 1e-3
