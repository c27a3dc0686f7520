"""Meshes of other programs arrive with their nodes, cells and groups; what cannot be read is told in one line."""

import sys

import numpy as np
import pytest
import trimesh

import simwarp as sw
from simwarp.meshes import volume_files
from tests.unit.flex.test_volume_mesh import FLEX, SPHERE, check_closed, enclosed, refused

GMSH_2 = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
3
2 1 "base"
2 3 "far away"
3 2 "body"
$EndPhysicalNames
$Nodes
6
1 0 0 0
2 1 0 0
4 0 1 0
7 0 0 1
8 0 0 -1
9 5 5 5
$EndNodes
$Elements
4
1 2 2 1 1 1 2 4
2 4 2 2 1 1 2 4 7
3 4 2 2 1 1 2 4 8
4 15 2 0 1 9
$EndElements
"""
"""Two tetrahedra, of which the second is a mirror image, a triangle between them, a point of its own."""
GMSH_4 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
2
2 1 "base"
3 2 "body"
$EndPhysicalNames
$Entities
0 0 1 1
1 0 0 0 1 1 0 1 1 0
1 0 0 0 1 1 1 1 2 0
$EndEntities
$Nodes
2 4 1 4
2 1 0 3
1
2
3
0 0 0
1 0 0
0 1 0
3 1 0 1
4
0 0 1
$EndNodes
$Elements
2 2 1 2
2 1 2 1
1 1 2 3
3 1 4 1
2 1 2 3 4
$EndElements
"""
CUBE = "0 0 0  1 0 0  1 1 0  0 1 0  0 0 1  1 0 1  1 1 1  0 1 1"
VTK = f"""# vtk DataFile Version 3.0
a cube
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 9 double
{CUBE}  9 9 9
CELLS 1 9
8 0 1 2 3 4 5 6 7
CELL_TYPES 1
12
"""
ABAQUS = """*HEADING
a cube
*NODE, NSET=ALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
5, 0., 0., 1.
6, 1., 0., 1.
7, 1., 1., 1.
8, 0., 1., 1.
*ELEMENT, TYPE=C3D8, ELSET=BODY
1, 1, 2, 3, 4, 5, 6, 7, 8
*NSET, NSET=BASE
1, 2, 3, 4
"""
NASTRAN = """BEGIN BULK
GRID           1              0.      0.      0.
GRID           2              1.      0.      0.
GRID           3              0.      1.      0.
GRID           4              0.      0.      1.
CTETRA         1       1       1       2       3       4
ENDDATA
"""


@pytest.fixture
def write(tmp_path):
    pytest.importorskip("meshio")

    def made(name, text):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return made


def test_a_file_of_gmsh_has_its_groups_and_no_unused_nodes(write):
    mesh = sw.flex.read(write("pad.msh", GMSH_2))
    assert mesh.name == "pad.msh"
    assert mesh.points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]]
    assert mesh.elements[0].tolist() == [0, 1, 2, 3]
    assert sorted(mesh.elements[1].tolist()) == [0, 1, 2, 4]
    assert mesh.volumes == pytest.approx([1 / 6, 1 / 6])
    assert {name: nodes.tolist() for name, nodes in mesh.sets.items()} == {"base": [0, 1, 2], "body": [0, 1, 2, 3, 4]}
    check_closed(mesh.boundary_triangles)


def test_the_present_format_of_gmsh_is_read_too(write):
    mesh = sw.flex.read(write("pad.msh", GMSH_4))
    assert mesh.points.shape == (4, 3)
    assert mesh.volume == pytest.approx(1 / 6)
    assert {name: nodes.tolist() for name, nodes in mesh.sets.items()} == {"base": [0, 1, 2], "body": [0, 1, 2, 3]}


def test_a_scale_makes_metres(write):
    mesh = sw.flex.read(write("cube.vtk", VTK), scale=0.001)
    assert mesh.kind == "hexahedra"
    assert mesh.points.shape == (8, 3)
    assert mesh.volume == pytest.approx(1e-9)
    for scale in (0.0, -1.0, np.nan, "mm"):
        refused(lambda scale=scale: sw.flex.read("cube.vtk", scale=scale), "scale")


def test_sets_of_abaqus_are_read(write):
    mesh = sw.flex.read(write("cube.inp", ABAQUS))
    assert mesh.volume == pytest.approx(1.0)
    assert mesh.sets["BASE"].tolist() == [0, 1, 2, 3]
    assert mesh.sets["BODY"].tolist() == list(range(8))


@pytest.mark.parametrize("ending", ["bdf", "nas", "fem"])
def test_a_file_of_nastran_is_read(write, ending):
    assert sw.flex.read(write(f"cell.{ending}", NASTRAN)).volume == pytest.approx(1 / 6)


@pytest.mark.parametrize("ending", ["msh", "vtk", "vtu", "inp", "bdf"])
@pytest.mark.parametrize("elements", ["hexahedra", "tetrahedra"])
def test_what_is_written_comes_back(tmp_path, ending, elements):
    meshio = pytest.importorskip("meshio")
    mesh = sw.flex.box((1.0, 2.0, 0.5), (2, 4, 1), elements=elements)
    path = tmp_path / f"box.{ending}"
    kind = {"hexahedra": "hexahedron", "tetrahedra": "tetra"}[elements]
    meshio.Mesh(mesh.points, [(kind, mesh.elements)]).write(path, file_format={"msh": "gmsh"}.get(ending))
    found = sw.flex.read(path)
    assert np.allclose(found.points, mesh.points, atol=1e-6)
    assert np.array_equal(found.elements, mesh.elements)


@pytest.mark.parametrize(
    ("blocks", "got", "remedy"),
    [
        ([("tetra10", [list(range(10))])], "1 of kind tetra10", "export a mesh of first order"),
        ([("hexahedron20", [[*range(10)] * 2])], "1 of kind hexahedron20", "export a mesh of first order"),
        ([("wedge", [[0, 1, 2, 3, 4, 5]])], "1 of kind wedge", "mesh with tetrahedra or hexahedra alone"),
        (
            [("tetra", [[0, 1, 2, 3]]), ("pyramid", [[0, 1, 2, 3, 4]])], "1 of kind pyramid",
            "mesh with tetrahedra or hexahedra alone",
        ),
        (
            [("triangle", [[0, 1, 2]])], "triangle",
            "fill a closed surface with sw.flex.lattice or sw.flex.tetrahedra",
        ),
        (
            [("tetra", [[0, 1, 2, 4]]), ("hexahedron", [[*range(8)]])], "hexahedron and tetra",
            "mesh with one of them, or split it",
        ),
        (
            [("tetra", [[0, 1, 2, 3]])], "element 0 of nodes [0, 1, 2, 3], which is flat",
            "reorder its nodes or repair the mesh",
        ),
    ],
)  # fmt: skip
def test_other_cells_are_refused_by_name(tmp_path, blocks, got, remedy):
    meshio = pytest.importorskip("meshio")
    points = np.array(CUBE.split(), float).reshape(8, 3)
    path = tmp_path / "cells.vtu"
    meshio.Mesh(np.vstack([points, points + 1.0]), [(kind, np.array(cells)) for kind, cells in blocks]).write(path)
    text = refused(lambda: sw.flex.read(path))
    assert text.partition(":")[0].endswith(" 'cells.vtu'")
    assert text.endswith(f", got {got}; {remedy}")


def test_what_cannot_be_read_is_told_in_one_line(write, tmp_path, capfd):
    refused(lambda: sw.flex.read(tmp_path / "none.msh"), "none.msh", "check the path")
    refused(lambda: sw.flex.read(tmp_path / "part.step"), ".msh, .vtk")
    refused(lambda: FLEX.read(7), "path")
    (tmp_path / "folder.msh").mkdir()
    refused(lambda: sw.flex.read(tmp_path / "folder.msh"), "folder")
    for ending in volume_files.READERS:
        refused(lambda ending=ending: sw.flex.read(write(f"empty{ending}", "")), f"empty{ending}")
        refused(lambda ending=ending: sw.flex.read(write(f"words{ending}", "no mesh\n\nat all\n")), f"words{ending}")
    refused(lambda: sw.flex.read(write("cut.msh", GMSH_2[:190])), "cut.msh")
    refused(lambda: sw.flex.read(write("beyond.vtk", VTK.replace("6 7\nCELL", "6 99\nCELL"))), "beyond.vtk")
    said = capfd.readouterr()
    assert said.out == said.err == ""


@pytest.mark.parametrize(
    ("library", "call"),
    [
        ("meshio", lambda path: sw.flex.read(path)),
        ("pytetwild", lambda _: sw.flex.tetrahedra(SPHERE, edge=0.5)),
    ],
)
def test_without_the_extra_an_error_says_what_to_install(library, call, tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == library]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)
    path = tmp_path / "cube.vtk"
    path.write_text(VTK, encoding="utf-8")
    text = refused(lambda: call(path), f"library {library}")
    assert text.endswith("; run: pip install 'simwarp[flex]'")


def mean_edge(mesh):
    corners = mesh.points[mesh.elements]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean()


def test_tetrahedra_fill_a_surface(tmp_path, monkeypatch):
    pytest.importorskip("pytetwild")
    surface = trimesh.creation.box((2.0, 1.0, 1.0))
    monkeypatch.chdir(tmp_path)
    for edge in (0.4, 0.2):
        mesh = sw.flex.tetrahedra(surface, edge=edge)
        assert mesh.kind == "tetrahedra"
        assert mesh.volume == pytest.approx(2.0, rel=5e-3)
        assert np.abs(mesh.bounds - surface.bounds).max() < 1e-3 * np.sqrt(6.0)
        assert 0.6 * edge < mean_edge(mesh) < 2.0 * edge
        check_closed(mesh.boundary_triangles)
        assert enclosed(mesh.points, mesh.boundary_triangles) == pytest.approx(mesh.volume, rel=1e-12)
    assert list(tmp_path.iterdir()) == []
    rough = sw.flex.tetrahedra(SPHERE, edge=0.4, deviation=0.01)
    assert len(rough.points) < 0.7 * len(sw.flex.tetrahedra(SPHERE, edge=0.4).points)


STAND_IN = """
import os
import numpy as np

def tetrahedralize(vertices, faces, **options):
    np.savez(os.environ["ASKED"], vertices=vertices, faces=faces, **options)
    points = np.array([(0, 0, 0), (9, 9, 9), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1)], float)
    return points, np.array([[0, 3, 2, 4], [0, 3, 2, 5]], np.int32)
"""
"""A library in place of pytetwild: it has a node in no cell, and a cell inside out as fTetWild writes them."""


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    def made(text):
        (tmp_path / "pytetwild.py").write_text(text, encoding="utf-8")
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        monkeypatch.setenv("ASKED", str(tmp_path / "asked.npz"))
        monkeypatch.syspath_prepend(str(tmp_path))
        return tmp_path / "asked.npz"

    return made


def test_tetrahedra_turn_what_the_library_mirrors(stand_in, tmp_path, monkeypatch):
    asked = stand_in(STAND_IN)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    mesh = sw.flex.tetrahedra((SPHERE.vertices * 1000.0, SPHERE.faces), edge=0.3, scale=0.001)
    assert mesh.points.shape == (5, 3)
    assert mesh.volumes == pytest.approx([1 / 6, 1 / 6])
    with np.load(asked) as options:
        assert np.abs(options["vertices"] - SPHERE.vertices).max() < 1e-14
        assert np.array_equal(options["faces"], SPHERE.faces)
        assert options["faces"].dtype == np.int32
        assert (options["edge_length_abs"], options["epsilon"], options["coarsen"]) == (0.3, 1e-3, True)
    assert list((tmp_path / "here").iterdir()) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("import no_such_library", ("no_such_library", "simwarp[flex]")),
        ("def tetrahedralize(*_, **__): raise RuntimeError('open')", ("RuntimeError: open", "another edge")),
        ("import os; os._exit(3)", ("code 3",)),
        (
            "import numpy\ndef tetrahedralize(*_, **__): return numpy.zeros((0, 3)), numpy.zeros((0, 4), int)",
            ("no tetrahedra",),
        ),
    ],
)
def test_a_library_that_fails_is_told_in_one_line(stand_in, text, words):
    asked = stand_in(text)
    assert refused(lambda: sw.flex.tetrahedra(SPHERE, edge=0.3), *words).startswith("tetrahedra: ")
    assert sorted(each.name for each in asked.parent.iterdir() if each.is_file()) == ["pytetwild.py"]


def test_tetrahedra_keep_their_rules():
    # The sphere's radius is 1 m: its box has a diagonal of 2 sqrt(3) m
    rule = "edge must be positive and at most the surface's diagonal of 3.464 m"
    for edge in (0.0, -1.0, 10.0, np.nan, "fine"):
        text = refused(lambda edge=edge: FLEX.tetrahedra(SPHERE, edge=edge))
        assert text == f"tetrahedra: {rule}, got {edge!r}; give metres"
    rule = "deviation must be above 0 and at most 0.1"
    for deviation in (0.0, -1.0, 0.2, np.nan, "near"):
        text = refused(lambda share=deviation: FLEX.tetrahedra(SPHERE, edge=0.3, deviation=share))
        assert text.startswith(f"tetrahedra: {rule}, got {deviation!r}; ")
    text = refused(lambda: sw.flex.tetrahedra((SPHERE.vertices, SPHERE.faces[1:]), edge=0.3), "enclose a volume")
    assert f", got {len(SPHERE.faces) - 1} triangles that do not; " in text
