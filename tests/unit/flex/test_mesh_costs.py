"""What a mesh costs is told before it is made: operations counted, memory as the scratch has it, times as measured."""

import re
from pathlib import Path

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.core import memory
from simwarp.core.memory import layout_bytes
from simwarp.kernels.dynamics.world import ScratchSizes, scratch_layouts
from simwarp.meshes.lattices import rectangle_of_triangles
from simwarp.meshes.mesh_columns import mesh_columns, mesh_sizes
from simwarp.meshes.mesh_costs import MOST_NODES, SCRATCH_BYTES, check_cost, estimated_factor
from simwarp.meshes.mesh_parts import MeshPart

PAGE = Path(__file__).resolve().parents[3] / "docs" / "flexible.md"
RUBBER = sw.flex.Rubber(young=1e6, density=1000.0)


def mesh_of(name):
    """The mesh of a scene, or a wheel's of fewer cells."""
    if name == "small tire":
        return scenes.add_toroidal_tire(sw.ModelBuilder(), "tire", around=12, across=4, pressure=1e5, height=1.0)
    return getattr(scenes, name)().flexible_meshes[0]


def box_part(cells):
    mesh = sw.flex.box((1.0, 1.0, 1.0), cells)
    return mesh, MeshPart(elements=mesh.elements, material=RUBBER)


def eliminated(mesh):
    """Numbers of the factor and its multiplications, found by eliminating a dense pattern in the mesh's own order."""
    columns = mesh_columns([mesh])
    assert columns is not None
    count = columns.structure.node_count
    place = np.empty(count, dtype=int)
    place[columns.structure.order] = np.arange(count)
    moving = {node: index for index, node in enumerate(mesh.nodes)}
    pattern = np.eye(count, dtype=bool)
    for element in columns.elements:
        inside = [place[moving[node]] for node in element if node in moving]
        if any(node >= 0 and mesh.glued[node] for node in element):
            inside += [place[count - 2], place[count - 1]]
        pattern[np.ix_(inside, inside)] = True
    numbers = work = 0
    for column in range(count):
        below = np.flatnonzero(pattern[column + 1 :, column]) + column + 1
        pattern[np.ix_(below, below)] = True
        numbers += 6 + 9 * len(below)
        work += 10 + 18 * len(below) + 27 * len(below) * (len(below) + 1) // 2
    return numbers, work


@pytest.mark.parametrize("name", ["tetra", "hexa", "shell", "small tire"])
def test_operations_are_those_of_the_elimination(name):
    mesh = mesh_of(name)
    cost = sw.flex.mesh_cost(mesh)
    assert (cost.factor_numbers, cost.multiplications) == eliminated(mesh)
    assert cost.nodes == len(mesh.nodes)
    assert dict(cost.elements) == {mesh.parts[0].kind: len(mesh.parts[0].elements)}


@pytest.mark.parametrize("name", ["tetra", "hexa", "shell", pytest.param("tire", marks=pytest.mark.slow)])
def test_a_step_takes_what_was_measured_within_a_factor_of_two(name):
    """Against the page's table: the model counts operations, and nothing is timed here."""
    row = re.search(rf"^\| `{name}`.*$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert row is not None
    speed = float(row[0].split("|")[3].replace(" ", ""))
    assert 0.5 < sw.flex.mesh_cost(mesh_of(name)).milliseconds * speed / 1e3 < 2.0


@pytest.mark.parametrize("double", [False, True])
def test_memory_is_that_of_the_scratch(double):
    builder = sw.ModelBuilder()
    mesh = builder.add_solid_mesh("pad", sw.flex.box((1.0, 1.0, 1.0), 3), material=RUBBER, double=double)
    own = {field: 1 for field in ScratchSizes.__dataclass_fields__ if not field.startswith("mesh_")}
    sizes = mesh_sizes([mesh], mesh_columns([mesh]))
    assert set(sizes) == set(SCRATCH_BYTES)
    added = [layout_bytes(scratch_layouts(1, ScratchSizes(**own, **more)).values()) for more in (sizes, {})]
    # arrays without a length have one entry
    assert 0 <= sw.flex.mesh_cost(mesh).scratch_bytes - (added[0] - added[1]) <= sum(SCRATCH_BYTES.values())


@pytest.mark.slow
def test_what_a_refusal_estimates_is_what_is_counted_of_the_largest_meshes():
    """The refusal does not count, which takes long: its law is held against counts just below the limit."""
    builder = sw.ModelBuilder()
    points, triangles = rectangle_of_triangles((36, 36), (1.0, 1.0))
    for mesh in (
        builder.add_solid_mesh("pad", box_part(10)[0], material=RUBBER),
        builder.add_shell("tarp", points, triangles, thickness=1e-3, material=RUBBER),
    ):
        cost = sw.flex.mesh_cost(mesh)
        multiplications, blocks = estimated_factor(cost.nodes, mesh.name == "pad")
        assert multiplications == pytest.approx(cost.multiplications, rel=0.05)
        assert 9.0 * blocks == pytest.approx(cost.factor_numbers, rel=0.05)


def test_too_many_nodes_are_refused_with_the_time_of_their_elements_too():
    part = box_part(11)[1]
    with pytest.raises(sw.ModelError, match=r"got 1728: a step of a world would take some (\d+) ms") as raised:
        check_cost("mesh 'pad'", 1728, [part])
    told = re.findall(r"some (\d+) ms", str(raised.value))
    assert float(told[0]) > 1e3 * 175.0 * 1728**2 / 1e10 + 3.0
    check_cost("mesh 'pad'", MOST_NODES, [part])


def test_worlds_that_do_not_fit_are_refused_by_finalize(monkeypatch):
    builder = scenes.hexa()
    enough = 2**20  # for the state of four worlds, 0.5 MiB with what passes, and not for a factor of a megabyte
    monkeypatch.setattr(memory, "free_memory", lambda device: enough)
    monkeypatch.setattr("simwarp.model.model.check_fits", lambda *_: None)
    builder.finalize(4, "cpu")
    monkeypatch.setattr("simwarp.meshes.mesh_costs.SCRATCH_BYTES", {**SCRATCH_BYTES, "mesh_factor": 40})
    with pytest.raises(sw.ModelError, match=r"finalize: 4 worlds need .*; "):
        builder.finalize(4, "cpu")


def test_costs_and_models_print_them():
    builder = scenes.hexa()
    cost = sw.flex.mesh_cost(builder.flexible_meshes[0])
    assert repr(cost).splitlines() == [
        "MeshCost: some 0.37 ms of a core for a step of a world",
        "  nodes     125 that move",
        "  elements  64 hexahedra",
        "  factor    25,914 numbers, 1.2 million multiplications",
        "  memory    235 KiB for a world",
    ]
    model = builder.finalize(1, "cpu")
    assert model.mesh_cost == cost
    assert "  meshes       125 nodes, some 0.37 ms of a core for a step of a world" in repr(model).splitlines()
    plain = sw.ModelBuilder()
    plain.add_body("ball", mass=1.0, inertia=(1.0, 1.0, 1.0))
    assert "meshes" not in repr(plain.finalize(1, "cpu"))


@pytest.mark.parametrize("thing", ["pad", None, 3])
def test_what_is_no_mesh_has_no_cost(thing):
    with pytest.raises(sw.ModelError, match=r"mesh_cost: mesh must be a FlexibleMesh, got .*; pass what add_shell"):
        sw.flex.mesh_cost(thing)
