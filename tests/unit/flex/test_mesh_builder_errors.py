"""What add_solid_mesh and add_shell refuse: one line that names thing, rule, value and remedy, and nothing is added."""

import copy

import numpy as np
import pytest

import simwarp as sw

RUBBER = sw.flex.Rubber(young=1e6, density=1000.0)
BOX = sw.flex.box((0.2, 0.1, 0.1), (2, 1, 1))
SQUARE = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
HALVES = [(0, 1, 2), (0, 2, 3)]


def builder():
    """Two bodies and a mesh."""
    made = sw.ModelBuilder()
    made.add_body("hand", mass=1.0, inertia=(1.0, 1.0, 1.0))
    made.add_body("foot", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((1.0, 0.0, 0.0)))
    made.add_solid_mesh("first", BOX, material=RUBBER, radius=0.01, pose=sw.pose((0.0, 3.0, 0.0)))
    return made


def changed(**fields):
    """A mesh of solid elements like the box, with other fields."""
    made = copy.copy(BOX)
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made


def moved(node, place):
    points = BOX.points.copy()
    points[node] = place
    return changed(points=points)


def counts(made):
    return len(made.bodies), len(made.shapes), len(made.joints), len(made.flexible_meshes), len(made.excluded_bodies)


INSIDE_OUT = BOX.elements[:, [4, 5, 6, 7, 0, 1, 2, 3]]
SOLIDS = [
    ({"mesh": "box"}, "mesh must be a VolumeMesh, got 'box'; make one by sw.flex.box, lattice or read"),
    ({"mesh": changed(elements=INSIDE_OUT)}, "hexahedra must have a positive volume, got element 0 of nodes "),
    ({"mesh": moved(3, (np.nan, 0.0, 0.0))}, "points must be finite, got [nan, 0.0, 0.0] for node 3; "),
    ({"mesh": changed(elements=BOX.elements[:1])}, "fill must be one share, or 1, got [1.0, 1.0]; "),
    ({"mesh": changed(elements=BOX.elements + 1)}, "nodes of an element must be 0 to 11, got "),
    ({"material": 1e6}, "material must be an Elastic or Rubber, got 1000000.0; write sw.flex.Rubber("),
    ({"material": sw.Material()}, "material must be an Elastic or Rubber, got a Material; "),
    ({"pose": (0.0, 0.0, 1.0)}, "pose must be a Pose, got (0.0, 0.0, 1.0); "),
    ({"radius": -1.0}, "radius must be finite and > 0 m, got -1.0; None takes the usual one"),
    ({"surface": 0.5}, "surface must be a Material, got 0.5; write sw.Material(...)"),
    ({"velocity": (0.0, np.inf, 0.0)}, "velocity must be 3 finite numbers, got "),
    ({"omega": 3.0}, "omega must be 3 finite numbers of at most 3.4e38, got 3.0; "),
    ({"double": 1}, "double must be True or False, got 1; choose one"),
    ({"contact": "face"}, "contact must be one of nodes, faces, got 'face'; did you mean 'faces'"),
    ({"contact": None}, "contact must be one of nodes, faces, got None; write MeshContact.NODES"),
    ({"glue": "hand"}, "glue must be {body: nodes}, got 'hand'; leave it out for none"),
    ({"glue": {"hnad": "x_min"}}, "glue must name bodies that were added, got 'hnad'; did you mean 'hand'"),
    ({"glue": {77: "x_min"}}, "glue must name bodies that were added, got 77; `fixed` holds nodes in the"),
    ({"glue": {sw.WORLD: "x_min"}}, "glue must name bodies that were added, got -1; `fixed` holds nodes in"),
    ({"glue": {"first_0": "x_min"}}, "glue must name a body that turns, got 'first_0', a node of 'first'; join"),
    ({"glue": {0: "x_min", 1: [0, 1]}}, "a node must be held once, got node 0 twice; leave it out of one set"),
    ({"glue": {0: "x_mni"}}, "glue must be nodes or a set of the mesh, got 'x_mni'; did you mean 'x_min'"),
    ({"glue": {0: [0, 12]}}, "glue must be nodes from 0 to 11, got 12; count from 0"),
    ({"glue": {0: [0.5]}}, "glue must be numbers of nodes or the name of a set, got [0.5]; "),
    ({"glue": {0: [1]}, "fixed": [0, 1]}, "a node must be held once, got node 1 twice; leave it out of one"),
    ({"fixed": [-1]}, "fixed must be nodes from 0 to 11, got -1; count from 0"),
    ({"fixed": list(range(12))}, "some node must move by itself, got all 12 glued or fixed; use a shape"),
    ({"mesh": sw.flex.box((1.0, 1.0, 1.0), (15, 10, 10))}, "nodes that move must be at most 1500, got 1936: "),
    (
        {"mesh": sw.flex.box((1.0, 1.0, 1.0), 2, elements="tetrahedra"),
         "material": sw.flex.Rubber(young=1e6, poisson=0.46, density=1000.0)},
        "poisson of tetrahedra must be at most 0.45, got 0.46: they would be far too stiff; use hexahedra",
    ),
]  # fmt: skip
SHEETS = [
    ({"vertices": [(0.0, 0.0)]}, "points must be of shape (n, 3), got (1, 2); "),
    ({"vertices": [*SQUARE[:3], (0.0, np.inf, 0.0)]}, "points must be finite, got [0.0, inf, 0.0] for node 3; "),
    ({"vertices": [*SQUARE, (2.0, 2.0, 0.0)]}, "every node must be one of an element, got 1 that are not, the"),
    ({"triangles": [(0, 1, 2, 3)]}, "triangles must be integers of shape (e, 3), got int64 (1, 4); "),
    ({"triangles": [(0, 1, 2), (0, 2)]}, "triangles must be integers of shape (e, 3), got "),
    ({"triangles": [(0, 1, 2), (0, 2, 4)]}, "nodes of an element must be 0 to 3, got [0, 2, 4] for element 1; "),
    ({"triangles": [(0, 1, 2), (0, 2, 2)]}, "triangles must have a positive area, got element 1 of nodes "),
    ({"triangles": [(0, 1, 2), (0, 3, 2)]}, "triangles at a side must be two, which pass it in opposite"),
    ({"triangles": [*HALVES, HALVES[0]]}, "triangles at a side must be two, which pass it in opposite"),
    ({"thickness": 0.0}, "thickness must be positive, got 0.0; give metres"),
    ({"thickness": "thin"}, "thickness must be positive, got 'thin'; give metres"),
    ({"pressure": np.nan}, "pressure must be finite, got nan; give pascals"),
    ({"fixed": "x_min"}, "fixed must be nodes or a set of the mesh, got 'x_min'; it has no sets: give numbers"),
    ({"fixed": [0, 1, 2, 3]}, "some node must move by itself, got all 4 glued or fixed; use a shape"),
    ({"material": None}, "material must be an Elastic or Rubber, got None; "),
]  # fmt: skip
MATERIALS = [
    ({"young": 0.0}, "young"), ({"young": -1.0}, "young"), ({"young": np.nan}, "young"), ({"poisson": 0.5}, "poisson"),
    ({"poisson": -0.1}, "poisson"), ({"density": 0.0}, "density"), ({"density": "heavy"}, "density"),
    ({"damping_time": -1e-3}, "damping_time"),
]  # fmt: skip


def refused(method, arguments):
    """The line with which a builder refuses a call, after which it is as before."""
    made = builder()
    before = counts(made)
    with pytest.raises(sw.ModelError) as raised:
        getattr(made, method)(**arguments)
    assert counts(made) == before
    made.finalize(1, "cpu")
    text = str(raised.value)
    assert "\n" not in text
    assert "; " in text
    return text


@pytest.mark.parametrize(("wrong", "line"), SOLIDS, ids=str)
def test_what_a_solid_must_not_be(wrong, line):
    text = refused("add_solid_mesh", {"name": "new", "mesh": BOX, "material": RUBBER, "radius": 0.01} | wrong)
    assert text.startswith("mesh 'new': " + line)


@pytest.mark.parametrize(("wrong", "line"), SHEETS, ids=str)
def test_what_a_sheet_must_not_be(wrong, line):
    good = {"name": "new", "vertices": SQUARE, "triangles": HALVES, "material": RUBBER, "thickness": 0.01}
    assert refused("add_shell", good | wrong).startswith("mesh 'new': " + line)


@pytest.mark.parametrize("kind", [sw.flex.Elastic, sw.flex.Rubber])
@pytest.mark.parametrize(("wrong", "field"), MATERIALS, ids=lambda value: str(value))
def test_what_a_material_must_not_be(kind, wrong, field):
    with pytest.raises(sw.ModelError) as raised:
        kind(**({"young": 1e6, "density": 1000.0} | wrong))
    text = str(raised.value)
    assert text.startswith(f"{kind.__name__}: {field} must be ")
    assert ", got " in text
    assert "; " in text


@pytest.mark.parametrize("name", ["flexible_young", "flexible_thickness", "flexible_pressure", "flexible_damping_time"])
def test_parameters_of_worlds_have_their_shape(name):
    made = builder()
    made.add_shell("sheet", SQUARE, HALVES, material=RUBBER, thickness=0.01)
    model = made.finalize(3, "cpu", per_world=[name])
    assert getattr(model, name).numpy().shape == (3, 2)
    with pytest.raises((sw.ModelError, ValueError, RuntimeError)):
        getattr(model, name).assign(np.ones((2, 2), np.float32))
