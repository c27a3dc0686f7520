"""Soil that is pushed aside: against a slow reference, volume, slopes, bits, and banks that are seen."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.core.types import ModelError
from simwarp.soil import Bulldozing, Soil, SoilBox, SoilShape, SoilWheel
from simwarp.soil.bulldozing import SoilFlow
from simwarp.vehicle.tires.tires import ground
from tests.reference import soil_flow, soil_shapes
from tests.reference.soil_surface import first_hits
from tests.unit.soil.ruts import Eye, Rut
from tests.unit.soil.soil_wheels import RADIUS, WIDTH, rolling

ARRAYS = ("body_x", "body_rot", "body_v", "body_omega")
SPACING = 0.05
RARE = Bulldozing(period=1.0)
"""Not before a thousand steps of a millisecond."""


def nodes_of(soil: Soil, world: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Column and row (n, 2), plastic sinkage and raise (n,) of all nodes in a world's pages."""
    memory = {name: array.numpy()[world] for name, array in soil.memory.items()}
    inside, count = np.arange(64), int(memory["count"])
    column = (8 * memory["place_x"][:count, None] + inside % 8).ravel()
    row = (8 * memory["place_y"][:count, None] + inside // 8).ravel()
    values = memory["node"][: 64 * count, 0].astype(float), memory["raised"][: 64 * count].astype(float)
    return np.stack([column, row], axis=1), *values


def grid_of(soil: Soil, size: int, world: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Plastic sinkage and raise of the nodes from -size to size, (rows, columns)."""
    places, sinkage, raised = nodes_of(soil, world)
    grids = np.zeros((2, 2 * size + 1, 2 * size + 1))
    assert np.abs(places[(sinkage != 0.0) | (raised != 0.0)]).max() <= size
    near = (np.abs(places) <= size).all(axis=1)
    grids[:, places[near, 1] + size, places[near, 0] + size] = np.stack([sinkage, raised])[:, near]
    return grids[0], grids[1]


def unbalanced(soil: Soil, up: float = 1.0, world: int = 0) -> float:
    """What is missing of the volume that was pressed down, as a share of it."""
    _, sinkage, raised = nodes_of(soil, world)
    pending = float(soil.memory["pending"].numpy()[world].sum())
    return (raised.sum() + pending - sinkage.sum() / up) / (sinkage.sum() / up)


def bits(simulation: sw.Simulation, soil: Soil) -> dict[str, np.ndarray]:
    found = {name: getattr(simulation.state, name).numpy().copy() for name in ARRAYS}
    places, sinkage, raised = zip(*(nodes_of(soil, world) for world in range(len(found["body_x"]))), strict=True)
    for world, place in enumerate(places):  # pages may lie in another order
        order = np.lexsort(place.T)
        found[f"nodes {world}"] = np.column_stack([place, sinkage[world], raised[world]])[order]
    return found


def box_and_wheel(lean: float, soil: str = "mid", **options: Any) -> tuple[sw.Simulation, Soil]:
    """A tilted box and a wheel beside it, which have sunk into ground that leans about y [rad]."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    turn = (0.05, 0.0, math.sin(0.2), math.cos(0.2))
    norm = math.sqrt(sum(value * value for value in turn))
    places = ((0.07, -0.02), (0.35, 0.38))
    for k, (x, y) in enumerate(places):
        height = -math.tan(lean) * x + (0.06 if k == 0 else RADIUS - 0.05)
        pose = sw.pose((x, y, height), tuple(value / norm for value in turn) if k == 0 else (0.0, 0.0, 0.0, 1.0))
        builder.add_body(f"b{k}", mass=1e9, inertia=(1e9, 1e9, 1e9), pose=pose)
    model = builder.finalize(1, "cpu")
    under = ground("cpu", rotation=(0.0, math.sin(0.5 * lean), 0.0, math.cos(0.5 * lean)))
    shapes: list[SoilShape] = [SoilBox(body=0, half=(0.31, 0.2, 0.1)), SoilWheel(body=1, radius=RADIUS, width=WIDTH)]
    soil_ = Soil(model, shapes, soil, ground=under, spacing=SPACING, **options)
    simulation = sw.Simulation(model, 1e-3, elements=[soil_], threads=1)
    simulation.step(3)
    return simulation, soil_


def low_points(simulation: sw.Simulation, size: int) -> list[np.ndarray]:
    """Of the box and the wheel, over the nodes from -size to size, in the world."""
    x, rot = (getattr(simulation.state, name).numpy()[0] for name in ("body_x", "body_rot"))
    row, column = np.mgrid[-size : size + 1, -size : size + 1] * SPACING
    found = []
    known: list[soil_shapes.Shape] = [soil_shapes.Box((0.31, 0.2, 0.1)), soil_shapes.Wheel(RADIUS, WIDTH)]
    for k, shape in enumerate(known):
        xy = np.stack([column.ravel() - x[k, 0], row.ravel() - x[k, 1]], axis=1)
        columns = shape.columns(xy, matrix_of(rot[k]), np.full(2, SPACING))
        # shares of nodes whose cells end at an edge are nought but for rounding
        height = np.where(columns.share > 1e-6, columns.height + x[k, 2], np.inf)
        found.append(height.reshape(row.shape))
    return found


@pytest.mark.parametrize("lean", [0.0, 0.3])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_flow_is_that_of_the_reference(lean, seed):
    """Amid rough ground, so that soil slides everywhere and under the shapes too."""
    size = 24
    simulation, soil = box_and_wheel(lean, bulldozing=RARE, pages=64)
    rng = np.random.default_rng(seed)
    raised, count = soil.memory["raised"].numpy(), int(soil.memory["count"].numpy()[0])
    raised[0, : 64 * count] = rng.uniform(0.0, 0.1, 64 * count)
    soil.memory["raised"].assign(raised)
    soil.memory["highest"].fill_(0.1)
    amounts = [0.9, 0.4]
    soil.memory["pending"].assign(np.array([amounts], np.float32))
    sinkage, before = grid_of(soil, size)
    _, column = np.mgrid[-size : size + 1, -size : size + 1] * SPACING
    level = -math.tan(lean) * column - sinkage / math.cos(lean) + before
    low = low_points(simulation, size)
    options = Bulldozing(angle=math.radians(40.0), iterations=7, propagation=4, period=1e-3)
    flow = soil_flow.Flow(SPACING * math.tan(options.angle), options.iterations, options.propagation)
    expected, left = soil_flow.flow_once(level, low, amounts, flow)
    placed = [soil._tables, soil._shapes, simulation.model.assets, simulation.state.arrays]
    SoilFlow(options, soil.shapes, SPACING).record(simulation, 1e-3, placed, soil._nodes).launch()
    after = grid_of(soil, size)[1]
    moved = np.abs(expected) > 1e-6
    assert moved.sum() > 100
    # float32 heights from a centre half a metre away: 3e-8 m, some ten times
    np.testing.assert_allclose(after - before, expected, atol=1e-6)
    np.testing.assert_allclose(soil.memory["pending"].numpy()[0], left, atol=2e-6)
    assert (expected > 1e-3).sum() > 20
    assert (expected < -1e-3).sum() > 20
    assert max(left) > 0.01  # some was in the way
    covered = np.min(low, axis=0)
    free = level < covered
    assert (level + after - before)[free & np.isfinite(covered)].shape[0] > 10
    assert ((level + after - before)[free] <= covered[free] + 1e-6).all()


def plate(bulldozing: Bulldozing | None, worlds: int = 1, load: float = 4000.0) -> tuple[sw.Simulation, Soil]:
    """A plate of 0.5 by 0.4 m that sinks into soft soil along the vertical, and comes to rest."""
    builder = sw.ModelBuilder()
    mass = load / 9.81
    body = builder.add_body("plate", mass=mass, inertia=(mass,) * 3, pose=sw.pose((0.012, -0.007, 0.05)))
    builder.add_joint_prismatic("up", sw.WORLD, body, axis=(0, 0, 1))
    model = builder.finalize(worlds, "cpu")
    soil = Soil(model, [SoilBox(body=body, half=(0.25, 0.2, 0.05))], "soft", spacing=SPACING, bulldozing=bulldozing)
    simulation = sw.Simulation(model, 1e-3, elements=[soil], threads=1)
    simulation.step(1500)
    return simulation, soil


def test_a_plate_raises_as_much_as_it_presses_down_and_its_bank_is_no_steeper_than_it_may():
    simulation, soil = plate(Bulldozing(angle=math.radians(30.0)))
    sinkage, raised = grid_of(soil, 30)
    assert sinkage.max() > 0.1
    assert abs(unbalanced(soil)) < 1e-5
    assert float(soil.memory["pending"].numpy()[0, 0]) < 1e-3 * sinkage.sum()
    free = sinkage == 0.0
    assert not raised[~free].any()  # nothing below the plate
    for axis in (0, 1):
        pair = np.take(free, range(60), axis) & np.take(free, range(1, 61), axis)
        slope = np.abs(np.diff(raised, axis=axis))[pair] / SPACING
        # each Jacobi step takes an eighth of the excess, the last one within a per cent at rest
        assert slope.max() < 1.01 * math.tan(math.radians(30.0))
        assert slope.max() > 0.9 * math.tan(math.radians(30.0))
    # as height queries see it: the whole volume is nought
    row, column = np.mgrid[-30:31, -30:31] * SPACING
    height = soil.height(np.stack([column.ravel(), row.ravel()], axis=1)).numpy()[0]
    assert abs(height.sum()) < 1e-3 * sinkage.sum()
    np.testing.assert_allclose(height.reshape(61, 61), raised - sinkage, atol=1e-6)
    assert simulation.problems() == []


def test_a_plate_sinks_as_it_does_without():
    """Banks lie beside it, and it goes straight down."""
    runs = [plate(each)[0] for each in (None, Bulldozing())]
    for name in ARRAYS:
        np.testing.assert_array_equal(*(getattr(run.state, name).numpy() for run in runs))


@pytest.mark.parametrize("soil", ["soft", "mid", "hard"])
def test_a_rolling_wheel_keeps_the_volume_and_leaves_banks(soil):
    simulation, element = rolling(soil=soil, torque=600.0, bulldozing=Bulldozing(), spacing=0.04)
    simulation.step(1200)
    assert abs(unbalanced(element)) < 1e-5
    end = float(simulation.state.body_x.numpy()[0, 0, 0])
    x = np.linspace(0.4, 0.7, 4) * end
    y = np.arange(-10, 11) * 0.04
    across = element.height(np.stack([np.repeat(x, 21), np.tile(y, 4)], axis=1)).numpy()[0].reshape(4, 21).mean(axis=0)
    rut = across[np.abs(y) < 0.1]
    bank = across[(np.abs(y) > 0.5 * WIDTH + 0.02)]
    assert rut.max() < -0.005
    assert bank.max() > 0.3 * -rut.min()
    np.testing.assert_allclose(across, across[::-1], atol=1e-4)  # mirror image
    # as much beside the rut as came out of it, but for what moves on before the wheel
    assert across.sum() == pytest.approx(0.0, abs=0.15 * -rut.sum())
    reach = float(element.memory["highest"].numpy().max())
    assert reach >= nodes_of(element)[2].max() - 1e-6 - float(element.memory["deepest"].numpy().max())


def test_half_of_it_is_compacted_where_half_flows():
    simulation, element = rolling(bulldozing=Bulldozing(flow=0.5))
    simulation.step(500)
    assert unbalanced(element) == pytest.approx(-0.5, abs=1e-5)


def test_flows_too_small_to_move_change_no_bit():
    """All the rest of bulldozing is on, and steps are those without it."""
    quiet = Bulldozing(flow=1e-9, angle=math.radians(80.0))
    for soil in ("mid", "clay"):
        runs = [rolling(2, soil=soil, torque=500.0, bulldozing=each) for each in (None, quiet)]
        for simulation, _ in runs:
            simulation.step(500)
        for name in ARRAYS:
            np.testing.assert_array_equal(*(getattr(run.state, name).numpy() for run, _ in runs))
        np.testing.assert_array_equal(*(each.memory["node"].numpy() for _, each in runs))
        assert not runs[1][1].memory["raised"].numpy().any()
        assert "raised" not in runs[0][1].memory
        assert runs[0][1]._nodes.raised.size == 0


def test_bits_are_the_same_in_any_number_of_worlds_whatever_another_does():
    runs = {}
    for worlds in (1, 2, 17):
        simulation, element = rolling(worlds, torque=600.0, bulldozing=Bulldozing(), direction=0.3)
        if worlds == 17:
            torque = simulation.control.body_torque.numpy()
            torque[3] = (0.0, -2000.0, 0.0)
            simulation.control.body_torque.assign(torque)
        simulation.step(500)
        runs[worlds] = bits(simulation, element)
    assert runs[1]["nodes 0"][:, 3].max() > 0.02
    for worlds in (2, 17):
        for world in set(range(worlds)) - {3}:
            for name in ARRAYS:
                np.testing.assert_array_equal(runs[worlds][name][world], runs[1][name][0], err_msg=name)
            np.testing.assert_array_equal(runs[worlds][f"nodes {world}"], runs[1]["nodes 0"])
    assert not np.array_equal(runs[17]["nodes 3"], runs[1]["nodes 0"])


def test_threads_do_not_change_bits():
    runs = []
    for threads in (1, 2):
        simulation, element = rolling(9, torque=600.0, bulldozing=Bulldozing(), threads=threads)
        simulation.step(300)
        runs.append(bits(simulation, element))
    for name, values in runs[0].items():
        np.testing.assert_array_equal(values, runs[1][name])


def test_a_snapshot_and_a_reset_repeat_bits():
    """Within a period: the steps since the last flow are kept too."""
    simulation, element = rolling(3, torque=600.0, bulldozing=Bulldozing())
    simulation.step(205)
    middle = bits(simulation, element)
    kept = simulation.snapshot()
    simulation.step(100)
    there = bits(simulation, element)
    simulation.restore(kept)
    simulation.step(100)
    for name, values in bits(simulation, element).items():
        np.testing.assert_array_equal(values, there[name])
    simulation.reset(np.array([False, True, False]))
    fresh = {name: array.numpy()[1] for name, array in element.memory.items()}
    assert not fresh["highest"].any()
    assert not fresh["pending"].any()
    assert not element.height([(0.2, 0.2)]).numpy()[1].any()
    assert element.height([(0.2, 0.2)]).numpy()[0, 0] > 0.02
    simulation.step(205)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(simulation.state, name).numpy()[1], middle[name][1])
    np.testing.assert_array_equal(bits(simulation, element)["nodes 1"], middle["nodes 1"])


def test_imprinted_soil_has_no_banks():
    simulation, element = plate(Bulldozing(), worlds=2)
    assert element.height([(0.32, 0.0)]).numpy().min() > 0.01
    element.keep_forces()
    element.imprint(np.array([True, False]))
    height = element.height([(0.32, 0.0), (0.0, 0.0)]).numpy()
    assert height[0, 0] == 0.0
    assert height[1, 0] > 0.01
    assert height[0, 1] < -0.1
    before = simulation.state.body_x.numpy()[:, 0, 2]
    simulation.step(300)
    np.testing.assert_allclose(simulation.state.body_x.numpy()[:, 0, 2], before, atol=1e-4)


def test_few_pages_let_soil_wait():
    """Where there is no page for a bank, soil is kept for later, and the run goes on."""
    simulation, element = rolling(torque=600.0, bulldozing=Bulldozing(), pages=8)
    simulation.step(1000)
    assert np.isfinite(simulation.state.body_x.numpy()).all()
    assert int(element.recycled.numpy()[0]) > 0
    assert any("pages ran out" in told for told in simulation.problems())


def test_volume_is_kept_on_hills():
    """Of columns between the ground of the first world, which a wheel rolled through, and that of the second."""
    rut = Rut(hilly=True, bulldozing=Bulldozing()).roll()
    places = nodes_of(rut.soil)[0] * SPACING
    height = rut.soil.height(places[np.abs(places).max(axis=1) < 1.8]).numpy()
    change = height[0] - height[1]
    pending = float(rut.soil.memory["pending"].numpy()[0, 0])
    pressed = -change[change < 0.0].sum()
    assert pressed > 1.0
    assert abs(change.sum() + pending) < 1e-5 * pressed
    assert change.max() > 0.02


@pytest.mark.parametrize("hilly", [False, True])
def test_camera_and_height_query_see_the_banks(hilly):
    rut = Rut(hilly=hilly, bulldozing=Bulldozing()).roll()
    for place in ((0.5, -0.4, 1.5), (-0.9, 0.1, 0.45)):
        eye = Eye(rut, place)
        distance = eye.look()["range"][..., 0].astype(np.float64)
        there = distance[0] < 10.0
        points = eye.position + distance[0, there, None] * eye.directions()[there]
        height, level = rut.soil.height(points[:, :2]).numpy()
        inside = np.isfinite(height)
        # on hills cells of nodes and of undeformed ground may lie a crease apart
        assert np.quantile(np.abs(points[:, 2] - height)[inside], 0.999) < (1e-3 if hilly else 1e-5)
        above = (height - level)[inside]
        assert (above > 0.02).sum() > 100
        assert (above < -0.02).sum() > 100


def test_rays_hit_the_banks_where_the_reference_does():
    rut = Rut(bulldozing=Bulldozing()).roll()
    places, sinkage, raised = nodes_of(rut.soil)
    nodes = {
        (int(i), int(j)): float(z - q)
        for (i, j), z, q in zip(places, sinkage, raised, strict=True) if z != 0.0 or q != 0.0
    }  # fmt: skip
    for place in ((0.5, -0.4, 1.5), (-0.9, 0.1, 0.45)):
        eye = Eye(rut, place)
        distance = eye.look()["range"][0, ..., 0].astype(np.float64).ravel()
        some = np.flatnonzero(distance < 10.0)[::31]
        directions = eye.directions().reshape(-1, 3)[some]
        start = np.broadcast_to(eye.position, directions.shape)
        expected, _ = first_hits(nodes, SPACING, rut.undeformed, rut.base(), start, directions)
        # the camera's rays are of float32; one at a crest may pass it
        assert np.quantile(np.abs(distance[some] - expected), 0.98) < 1e-4


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"angle": 55.0}, "angle must be within ±1.396 rad (80°), got 55.0; if these are degrees, they are 0.9599 rad"),
        ({"angle": 0.0}, "angle must be positive, got 0.0; give radians"),
        ({"flow": 0.0}, "flow must be positive, got 0.0; give a share; without any, leave bulldozing out"),
        ({"flow": 1.5}, "flow must be in (0, 1], got 1.5"),
        ({"iterations": 0}, "iterations must be from 1 to 100, got 0; give 5 to 10, as usual"),
        ({"propagation": 2.5}, "propagation must be a whole number, got 2.5"),
        ({"period": 0.0}, "period must be positive, got 0.0; give seconds, 0.01 is usual"),
        ({"period": math.nan}, "period must be a finite number, got nan; give seconds, 0.01 is usual"),
        ({"angle": "steep"}, "angle must be a number, got 'steep'"),
    ],
)
def test_mistakes_are_told_in_a_line(values, message):
    with pytest.raises(ModelError) as told:
        Bulldozing(**values)
    assert message in str(told.value)
    assert "\n" not in str(told.value)


def test_only_a_bulldozing_is_taken_and_printed():
    with pytest.raises(ModelError, match="soil: bulldozing must be a Bulldozing, got True; Bulldozing\\(\\)"):
        rolling(bulldozing=True)
    assert "100 % every 10 ms, heaps up to 55 deg" in repr(rolling(bulldozing=Bulldozing())[1])
