"""STEP files: masses of faceted solids in closed form, names, units, and what is refused."""

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import ShapeType
from simwarp.importers import load_step
from simwarp.sensors.scene import Visuals
from tests.reference.imported_robots import ROBOTS

FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
"""Corners of a box's faces, counter-clockwise from outside; corner k has the bits of k along x, y, z."""


class StepText:
    """Writes STEP files of faceted boxes."""

    def __init__(self, unit):
        self.lines = []
        prefix = {"m": "$", "mm": ".MILLI."}[unit]
        length = self.add(f"(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT({prefix},.METRE.))")
        angle = self.add("(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.))")
        solid = self.add("(NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT())")
        self.context = self.add(
            "(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNIT_ASSIGNED_CONTEXT"
            f"(({length},{angle},{solid})) REPRESENTATION_CONTEXT('',''))"
        )
        application = self.add("APPLICATION_CONTEXT('automotive design')")
        self.add(f"APPLICATION_PROTOCOL_DEFINITION('','automotive_design',2000,{application})")
        self.product = self.add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
        self.definition = self.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')")

    def add(self, text):
        self.lines.append(f"#{len(self.lines) + 1} = {text};")
        return f"#{len(self.lines)}"

    def point(self, values):
        return self.add(f"CARTESIAN_POINT('',({','.join(f'{float(v)!r}' for v in values)}))")

    def direction(self, values):
        return self.add(f"DIRECTION('',({','.join(f'{float(v)!r}' for v in values)}))")

    def frame(self, origin, normal, along):
        parts = self.point(origin), self.direction(normal), self.direction(along)
        return self.add(f"AXIS2_PLACEMENT_3D('',{','.join(parts)})")

    def box(self, name, size, low, closed=True):
        corners = [np.array(low) + np.array(size) * [(k >> i) & 1 for i in range(3)] for k in range(8)]
        points = [self.point(corner) for corner in corners]
        vertices = [self.add(f"VERTEX_POINT('',{point})") for point in points]
        edges: dict[tuple[int, int], str] = {}
        faces = [self.face(face, corners, points, vertices, edges) for face in (FACES if closed else FACES[1:])]
        shell = self.add(f"{'CLOSED' if closed else 'OPEN'}_SHELL('',({','.join(faces)}))")
        kind = f"MANIFOLD_SOLID_BREP('{name}',{shell})" if closed else f"SHELL_BASED_SURFACE_MODEL('{name}',({shell}))"
        word = "ADVANCED_BREP_SHAPE" if closed else "MANIFOLD_SURFACE_SHAPE"
        items = f"{self.frame((0, 0, 0), (0, 0, 1), (1, 0, 0))},{self.add(kind)}"
        shape = self.add(f"{word}_REPRESENTATION('',({items}),{self.context})")
        product = self.add(f"PRODUCT('{name}','{name}','',({self.product}))")
        self.add(f"PRODUCT_RELATED_PRODUCT_CATEGORY('part',$,({product}))")
        formation = self.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
        definition = self.add(f"PRODUCT_DEFINITION('design','',{formation},{self.definition})")
        defined = self.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
        self.add(f"SHAPE_DEFINITION_REPRESENTATION({defined},{shape})")
        return self

    def face(self, face, corners, points, vertices, edges):
        sides = []
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            key = min(a, b), max(a, b)
            if key not in edges:
                start, end = key
                along = corners[end] - corners[start]
                length = float(np.linalg.norm(along))
                vector = self.add(f"VECTOR('',{self.direction(along / length)},1.)")
                line = self.add(f"LINE('',{points[start]},{vector})")
                edges[key] = self.add(f"EDGE_CURVE('',{vertices[start]},{vertices[end]},{line},.T.)")
            sides.append(self.add(f"ORIENTED_EDGE('',*,*,{edges[key]},{'.T.' if a == key[0] else '.F.'})"))
        loop = self.add(f"EDGE_LOOP('',({','.join(sides)}))")
        bound = self.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        first, second = corners[face[1]] - corners[face[0]], corners[face[2]] - corners[face[1]]
        normal = np.cross(first, second)
        frame = self.frame(corners[face[0]], normal / np.linalg.norm(normal), first / np.linalg.norm(first))
        plane = self.add(f"PLANE('',{frame})")
        return self.add(f"ADVANCED_FACE('',({bound}),{plane},.T.)")

    def write(self, file):
        head = "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
        head += "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n"
        file.write_text(head + "\n".join(self.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n")
        return file


@pytest.fixture(scope="module")
def boxes(tmp_path_factory):
    """Two boxes, in millimetres."""
    folder = tmp_path_factory.mktemp("step")
    text = StepText("mm").box("plate", (200, 100, 10), (0, 0, 0)).box("block", (20, 30, 40), (50, 50, 10))
    return text.write(folder / "boxes.step")


def test_boxes_have_the_mass_of_boxes(boxes):
    found = load_step(boxes, density={"plate": 7850.0, "block": 2700.0}, fixed=["plate"], prefix="p_")
    plate, block = (found.builder.bodies[found.bodies[f"p_{name}"]] for name in ("plate", "block"))
    for body, density, size, centre in (
        (plate, 7850.0, (0.2, 0.1, 0.01), (0.1, 0.05, 0.005)), (block, 2700.0, (0.02, 0.03, 0.04), (0.06, 0.065, 0.03)),
    ):  # fmt: skip
        mass = density * np.prod(size)
        square = np.square(size)
        # GLB holds float32 numbers
        assert body.mass == pytest.approx(mass, rel=1e-6)
        np.testing.assert_allclose(body.pose.position, centre, atol=1e-7)
        np.testing.assert_allclose(np.diag(body.inertia), mass / 12 * (square.sum() - square), rtol=1e-5)
    assert found.dofs == {}
    assert [shape.type for shape in found.builder.shapes] == [ShapeType.HULL] * 2
    assert all(len(hull.vertices) == 8 for hull in found.builder.hulls)
    visuals = Visuals(found.builder)
    found.add_visuals(visuals)
    assert [instance.name for instance in visuals.instances] == ["p_block_visual", "p_plate_visual"]
    sim = sw.Simulation(found.builder.finalize(1, "cpu"), 1e-3)
    sim.step()
    # the plate is welded to the world, the block falls
    np.testing.assert_allclose(sim.state.body_v.numpy()[0, found.bodies["p_plate"]], 0.0)


def test_metres_and_an_open_surface(tmp_path):
    file = StepText("m").box("cube", (2, 2, 2), (0, 0, 0)).box("shell", (1, 1, 1), (5, 0, 0), closed=False)
    file = file.write(tmp_path / "open.stp")
    with pytest.raises(sw.ModelError, match=r"open\.stp: refused part 'shell': its surface is not closed"):
        load_step(file, density=1000.0)
    with pytest.warns(UserWarning, match="dropped part 'shell'") as told:
        found = load_step(file, density=1000.0, allow=["part"])
    assert len(told) == 1
    assert found.mass == pytest.approx(8000.0, rel=1e-6)


def test_the_published_assembly():
    file = ROBOTS / "step/assembly.stp"
    if not file.is_file():
        pytest.skip("the published model files are not here")
    with pytest.warns(UserWarning, match="convex hulls with 64 corners"):
        found = load_step(file, density=1000.0)
    # of its triangles at 0.01 mm; at 0.1 mm they differ by 1e-3
    assert {body.name: round(body.mass, 3) for body in found.builder.bodies} == {"body1": 0.518, "body2": 0.266}


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({}, "density must be a number > 0 .*got None"),
        ({"density": 0.0}, "density must be a number > 0 .*got 0.0"),
        ({"density": {"plate": -1.0}}, "density must be a number > 0"),
        ({"density": {"plate": 1.0}}, "density must have part 'block'"),
        ({"density": {"plate": 1.0, "block": 1.0, "plat": 1.0}}, "density names 'plat'.*did you mean 'plate'"),
        ({"density": 1.0, "fixed": ["plat"]}, "fixed must name parts, got 'plat'.*did you mean 'plate'"),
        ({"density": 1.0, "fixed": "plate"}, r"write \['plate'\]"),
        ({"density": 1.0, "allow": ["parts"]}, "allow names 'parts'.*did you mean 'part'"),
    ],
)
def test_wrong_arguments(options, told, boxes):
    with pytest.raises(sw.ModelError, match=told) as wrong:
        load_step(boxes, **options)
    assert "\n" not in str(wrong.value)


def test_wrong_files(boxes, tmp_path):
    (tmp_path / "cut.step").write_text(boxes.read_text()[:2000])
    told = r"cut\.step: must be a STEP file of solids, got: Line .*export it again"
    with pytest.raises(sw.ModelError, match=told) as wrong:
        load_step(tmp_path / "cut.step", density=1.0)
    assert "\n" not in str(wrong.value)
    StepText("m").write(tmp_path / "none.step")
    with pytest.raises(sw.ModelError, match=r"none\.step: must"):
        load_step(tmp_path / "none.step", density=1.0)
    with pytest.raises(sw.ModelError, match=r"must end in \.step or \.stp"):
        load_step(__file__, density=1.0)
