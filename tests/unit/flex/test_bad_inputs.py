"""Every kind of bad input of flexible bodies is refused in one line with its remedy, or warned of."""

import dataclasses
import warnings

import numpy as np
import pytest

import simwarp as sw
from simwarp.meshes.lattices import rectangle_of_triangles

STEEL = sw.flex.Elastic(young=2.1e11, density=7850.0)
RUBBER = sw.flex.Rubber(young=1e6, density=1000.0)
BOX = sw.flex.box((0.2, 0.1, 0.1), (2, 1, 1))
SQUARE = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
HALVES = [(0, 1, 2), (0, 2, 3)]
NAN = float("nan")


def builder():
    made = sw.ModelBuilder()
    made.add_body("hand", mass=1.0, inertia=(1.0, 1.0, 1.0))
    return made


def material(**values):
    return lambda: sw.flex.Elastic(**{"young": 1e6, "density": 1000.0} | values)


def rod(points=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), **values):
    section = sw.flex.Round(diameter=0.01)
    return lambda: builder().add_rod("new", points, **{"section": section, "material": STEEL} | values)


def solid(mesh=BOX, **values):
    return lambda: builder().add_solid_mesh("new", mesh() if callable(mesh) else mesh, **{"material": RUBBER} | values)


def shell(vertices=SQUARE, triangles=HALVES, **values):
    return lambda: builder().add_shell("new", vertices, triangles, **{"material": RUBBER, "thickness": 0.01} | values)


def box(**fields):
    return solid(lambda: dataclasses.replace(BOX, **fields))


def moved(node, place):
    points = BOX.points.copy()
    points[node] = place
    return points


def parameter(values):
    """Values for Young's modulus of three worlds of a mesh."""

    def write():
        made = builder()
        made.add_shell("sheet", SQUARE, HALVES, material=RUBBER, thickness=0.01)
        made.finalize(3, "cpu", per_world=["flexible_young"]).flexible_young.assign(np.asarray(values, np.float32))

    return write


TETRAHEDRA = sw.flex.box((1.0, 1.0, 1.0), 2, elements="tetrahedra")
REFUSED = {
    "a Poisson's ratio below 0": (material(poisson=-0.1), "poisson must be "),
    "a Poisson's ratio of a half": (material(poisson=0.5), "poisson must be "),
    "Young's modulus of 0": (material(young=0.0), "young must be "),
    "Young's modulus below 0": (material(young=-1.0), "young must be "),
    "no density": (material(density=0.0), "density must be "),
    "damping that drives": (material(damping_time=-1.0), "damping_time must be "),
    "a material of NaN": (material(young=NAN), "young must be "),
    "no thickness": (shell(thickness=0.0), "thickness must be positive"),
    "a section without a size": (lambda: sw.flex.Round(diameter=0.0), "diameter must be "),
    "a tube without a wall": (lambda: sw.flex.Tube(outer=0.1, inner=0.1), "inner must be below outer"),
    "elements that cross": (
        solid(sw.flex.VolumeMesh(points=BOX.points, elements=np.concatenate([BOX.elements, BOX.elements[:1]]))),
        "must not cross",
    ),
    "elements on one side of a face": (
        solid(sw.flex.VolumeMesh(points=np.vstack([np.eye(3), [(0, 0, 0), (-0.2, -0.2, -0.2)]]),
                                 elements=np.array([(0, 2, 1, 3), (0, 2, 1, 4)], np.int32))),
        "must not cross",
    ),
    "a flat element": (box(points=BOX.points * (1.0, 1.0, 0.0)), "which is flat"),
    "an element inside out": (box(elements=BOX.elements[:, [4, 5, 6, 7, 0, 1, 2, 3]]), "which is inside out"),
    "an element that crosses itself": (box(points=moved(0, (0.3, 0.3, 0.3))), "which is inside out"),
    "a flat triangle": (shell(triangles=[(0, 1, 2), (0, 2, 2)]), "which is flat"),
    "unused nodes of a solid": (box(points=np.vstack([BOX.points, [(9.0, 9.0, 9.0)]])), "every node must be in a cell"),
    "unused nodes of a sheet": (shell(vertices=[*SQUARE, (2.0, 2.0, 0.0)]), "every node must be one of an element"),
    "three triangles at a side": (
        shell(vertices=[*SQUARE, (0.5, 0.5, 1.0)], triangles=[*HALVES, (0, 2, 4)]), "at a side must be two"
    ),
    "triangles that face apart": (shell(triangles=[(0, 1, 2), (0, 3, 2)]), "at a side must be two"),
    "a node glued and fixed": (solid(glue={0: [1]}, fixed=[0, 1]), "a node must be held once"),
    "a node glued twice": (solid(glue={0: [1, 2], "hand": [2]}), "a node must be held once"),
    "glue to an unknown body": (solid(glue={"hnad": [1]}), "did you mean 'hand'"),
    "an end at an unknown body": (rod(end=sw.flex.Clamp("hnad")), "did you mean 'hand'"),
    "points of a rod at one place": (rod([(0, 0, 0), (0, 0, 0), (1, 0, 0)]), "must be apart"),
    "a kink of a rod": (rod([(0, 0, 0), (1, 0, 0), (0.5, 0.1, 0)]), "less than 90 degrees"),
    "a rod of one point": (rod([(0, 0, 0)]), "got [(0, 0, 0)]; give x, y, z of each"),
    "a rod through NaN": (rod([(0, 0, 0), (1, 0, NAN)]), "points must be two or more"),
    "section axes along the rod": (rod(up=(1.0, 0.0, 0.0)), "up must not be along the rod"),
    "section axes of NaN": (rod(up=(0.0, NAN, 0.0)), "up must be 3 finite numbers"),
    "a twist of NaN": (rod(twist=NAN), "twist must be"),
    "too many nodes of a solid": (solid(sw.flex.box((1.0, 1.0, 1.0), 11)), "at most 1500, got 1728: a step of a world"),
    "too many nodes of a sheet": (shell(*rectangle_of_triangles((39, 39), (1.0, 1.0))), "at most 1500, got 1600: a st"),
    "tetrahedra that keep their volume": (
        solid(TETRAHEDRA, material=sw.flex.Rubber(young=1e6, poisson=0.46, density=1000.0)), "use hexahedra, or lower"
    ),
    "a solid with NaN": (box(points=moved(3, (NAN, 0.0, 0.0))), "points must be finite"),
    "a sheet with NaN": (shell(vertices=[*SQUARE[:3], (0.0, NAN, 0.0)]), "points must be finite"),
    "a pressure of NaN": (shell(pressure=NAN), "pressure must be finite"),
    "a parameter of two worlds for three": (parameter([[1e6], [1e6]]), "cannot assign values of shape (2, 1)"),
    "a parameter of two parts for one": (parameter([[1e6, 1e6]] * 3), "cannot assign values of shape (3, 2)"),
    "a parameter of NaN": (parameter([[1e6], [NAN], [1e6]]), "values must be finite and > 0"),
    "a parameter below 0": (parameter([[1e6], [-1.0], [1e6]]), "values must be finite and > 0"),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_bad_inputs_are_refused_in_one_line_with_a_remedy(kind):
    make, rule = REFUSED[kind]
    with pytest.raises(sw.ModelError) as raised:
        make()
    text = str(raised.value)
    assert rule in text
    assert "\n" not in text
    assert "; " in text


def crossed(cells, *, centres):
    """A square whose cells have diagonals that alternate, or a node in the middle of each."""
    points, triangles = rectangle_of_triangles((cells, cells), (1.0, 1.0))
    a, b, c, d = triangles[::2, 0], triangles[::2, 1], triangles[::2, 2], triangles[1::2, 2]
    if centres:
        middle = np.arange(len(a)) + len(points)
        points = np.vstack([points, points[np.stack([a, b, c, d])].mean(axis=0)])
        return points, np.concatenate([np.stack(each, axis=1) for each in
                                       ((a, b, middle), (b, c, middle), (c, d, middle), (d, a, middle))])  # fmt: skip
    cell = np.arange(len(a))
    odd = ((cell // cells + cell % cells) % 2 == 1)[:, None]
    first = np.where(odd, np.stack([a, b, d], axis=1), np.stack([a, b, c], axis=1))
    second = np.where(odd, np.stack([b, c, d], axis=1), np.stack([a, c, d], axis=1))
    return points, np.concatenate([first, second])


def warned(make):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        make()
    assert all(each.filename == __file__ for each in caught)
    return [str(each.message) for each in caught]


@pytest.mark.parametrize("cells", [4, 7])
@pytest.mark.parametrize("centres", [False, True])
def test_diagonals_that_cross_or_alternate_are_warned_of(cells, centres):
    (text,) = warned(shell(*crossed(cells, centres=centres)))
    assert text.startswith("mesh 'new': triangles should meet six at a node, got four at ")
    assert text.endswith("; let all run the same way")


def test_other_patterns_are_not_warned_of():
    assert warned(shell(*rectangle_of_triangles((7, 5), (1.0, 1.0)))) == []
    assert warned(shell(*crossed(1, centres=True))) == []  # one node of four is no pattern
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(size=(80, 2)), np.zeros(80)])
    spatial = pytest.importorskip("scipy.spatial")
    triangles = spatial.Delaunay(points[:, :2]).simplices
    assert warned(shell(points, triangles)) == []


def hung(load, *, far=0.0):
    """A wire of 4 mm, 20 elements, that carries a load, or with the load at its upper end only."""

    def make():
        made = builder()
        wire = made.add_rod(
            "wire", [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)], elements=20, section=sw.flex.Round(diameter=0.004),
            material=STEEL, start=sw.flex.Hinge() if not far else None,
        )  # fmt: skip
        body = made.add_body("load", mass=load, inertia=(load,) * 3, pose=sw.pose((2.0 - far, 0.0, 0.0)))
        made.add_joint_spherical("hook", body, wire.bodies[0 if far else -1], anchor=(2.0 - far, 0.0, 0.0))
        made.finalize(1, "cpu")

    return make


def test_a_rod_that_carries_far_too_much_is_warned_of():
    (text,) = warned(hung(5000.0))
    assert text.startswith("finalize: rod node 'wire_20' has 0.00493 kg and has to carry body 'load' of 5e+03 kg, ")
    assert text.endswith("; rods hold up to 300000: take fewer elements, or a thicker rod")


def test_a_rod_that_carries_what_it_holds_or_nothing_is_not_warned_of():
    assert warned(hung(1000.0)) == []
    assert warned(hung(5000.0, far=2.0)) == []
