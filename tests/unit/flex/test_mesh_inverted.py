"""The number of elements that are inside out, against determinants in NumPy, and what a crushed block comes to."""

import numpy as np
import pytest

import simwarp as sw
from tests.unit.flex.test_meshes_seen import bend

RUBBER = sw.flex.Rubber(young=2e4, poisson=0.4, density=1000.0, damping_time=1e-3)
DROP = 0.2


def inverted_tetrahedra(mesh, x):
    corners = x[mesh.parts[0].elements]
    return int((np.linalg.det(corners[:, 1:] - corners[:, :1]) <= 0.0).sum())


def inverted_hexahedra(mesh, x):
    """By the mean deformation gradient of boxes: halves of the differences between opposite faces."""
    elements = mesh.parts[0].elements
    ends = [((1, 2, 5, 6), (0, 3, 4, 7)), ((2, 3, 6, 7), (0, 1, 4, 5)), ((4, 5, 6, 7), (0, 1, 2, 3))]
    sides = [x[elements[:, list(far)]].mean(axis=1) - x[elements[:, list(near)]].mean(axis=1) for far, near in ends]
    return int((np.linalg.det(np.stack(sides, axis=2)) <= 0.0).sum())


def two_solids():
    builder = sw.ModelBuilder()
    cells = sw.flex.box((1.0, 1.0, 1.0), 3)
    hexahedra = builder.add_solid_mesh("hexahedra", cells, material=RUBBER)
    builder.add_shell("sheet", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], material=RUBBER, thickness=0.01)
    split = sw.flex.box((1.0, 1.0, 1.0), 3, elements="tetrahedra")
    first = builder.add_solid_mesh("first", split, material=RUBBER)
    second = builder.add_solid_mesh("second", split, material=RUBBER)
    more = builder.add_solid_mesh("more", cells, material=RUBBER)
    return builder, (hexahedra, first, second, more)


def test_inverted_elements_are_counted_in_each_world():
    builder, meshes = two_solids()
    sim = sw.Simulation(builder.finalize(3, "cpu"), 1e-3)
    for mesh in (*meshes, builder.flexible_meshes[1]):
        assert sw.flex.mesh_inverted(sim, mesh).numpy().tolist() == [0, 0, 0]
    rng = np.random.default_rng(0)
    for mesh in meshes:
        for world in range(3):  # a third of a cell, in the second world two thirds
            spread = (0.1, 0.2, 0.0)[world]
            moved = mesh.points + spread * rng.standard_normal(mesh.points.shape)
            bend(sim, mesh, lambda _, moved=moved: moved, [world])
    for mesh in meshes:
        count = inverted_hexahedra if mesh.parts[0].kind == "hexahedra" else inverted_tetrahedra
        found = sw.flex.mesh_inverted(sim, mesh)
        expected = [count(mesh, x) for x in sw.flex.mesh_positions(sim, mesh).numpy()]
        assert found.numpy().tolist() == expected
        assert expected[1] > expected[0] >= 0
        assert expected[2] == 0
    # a mirror image is inside out as a whole
    bend(sim, meshes[1], lambda points: points * (1.0, 1.0, -1.0), [2])
    assert sw.flex.mesh_inverted(sim, meshes[1]).numpy()[2] == len(meshes[1].parts[0].elements)


def test_a_mesh_of_another_model_is_refused():
    sim = sw.Simulation(two_solids()[0].finalize(1, "cpu"), 1e-3)
    with pytest.raises(sw.ModelError, match=r"mesh_inverted: mesh must be one of the simulation's model, got .*; pass"):
        sw.flex.mesh_inverted(sim, two_solids()[1][0])


@pytest.mark.slow
def test_a_crushed_block_survives_and_its_elements_turn_back():
    """5 kg that fall by 0.2 m on rubber that they would press by a quarter at rest: elements at its edges go through
    themselves, are counted, and come back when it rebounds, to less than where it came from.
    """
    builder = sw.ModelBuilder()
    builder.add_shape_plane(material=sw.Material(friction=0.6))
    foot = builder.add_solid_mesh(
        "foot", sw.flex.box((0.1, 0.1, 0.1), 4, elements="tetrahedra"), material=RUBBER,
        pose=sw.pose((0.0, 0.0, 0.051)), surface=sw.Material(friction=0.6),
    )  # fmt: skip
    weight = builder.add_solid("weight", "box", (0.1, 0.1, 0.05), mass=5.0, pose=sw.pose((0.0, 0.0, 0.1 + DROP)))
    sim = sw.Simulation(builder.finalize(2, "cpu"), 5e-4)
    worst = np.zeros(2, int)
    heights = []
    for _ in range(1000):
        sim.step()
        worst = np.maximum(worst, sw.flex.mesh_inverted(sim, foot).numpy())
        heights.append(float(sim.body_position(weight)[2]))
    assert worst.tolist() == [worst[0]] * 2
    assert worst[0] > 0
    lowest = int(np.argmin(heights))
    assert 0.05 < heights[lowest] < 0.5 * (0.1 + DROP)
    assert heights[lowest] + 0.05 < max(heights[lowest:]) < 0.1 + DROP
    assert sw.flex.mesh_inverted(sim, foot).numpy().tolist() == [0, 0]
