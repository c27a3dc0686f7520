"""SolidWorks scripts: an arm in both dialects against its URDF, mates and their joints, and what is refused."""

import re
import warnings
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp.core.types import JointType, ShapeType
from simwarp.importers import load_solidworks, load_urdf
from simwarp.importers.report import ImportedWarning
from simwarp.sensors.scene import Visuals
from tests.reference.imported_robots import (
    ROBOTS,
    energy_norm_error,
    full_mass,
    inverse_mass,
    mujoco_urdf,
    random_arm,
)

OLD = {
    "ChVector3d": "ChVectorD", "ChQuaterniond": "ChQuaternionD", "ChFramed": "ChFrameD", "ChMatrix33d": "ChMatrix33D",
    "SetFrameCOMToRef": "SetFrame_COG_to_REF", "SetFixed": "SetBodyFixed", "ChLinkMateDistanceZ": "ChLinkMateXdistance",
    "(True, True, False, False, False, False)": "(False, True, True, False, False, False)",
}  # fmt: skip
"""The new dialect's words in the old one."""

HEAD = """# PyChrono script generated from SolidWorks using Chrono::SolidWorks add-in
import pychrono as chrono
import builtins
shapes_dir = 'arm_shapes/'
if hasattr(builtins, 'exported_system_relpath'):
    shapes_dir = builtins.exported_system_relpath + shapes_dir
exported_items = []
body_0= chrono.ChBodyAuxRef()
body_0.SetName('ground')
body_0.SetFixed(True)
exported_items.append(body_0)
"""


def in_dialect(text, old):
    for new, word in OLD.items():
        text = text.replace(new, word) if old else text
    return text


def vector(values):
    return f"chrono.ChVector3d({','.join(repr(float(v)) for v in values)})"


def part(number, name, position, rotation, mass, inertia, centre, more=""):
    """A body of the script; `rotation` of its frame, `inertia` about the centre in its axes."""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat().tolist()
    xx, yy, zz = np.diag(inertia)
    xy, xz, yz = inertia[0, 1], inertia[0, 2], inertia[1, 2]
    return f"""
body_{number}= chrono.ChBodyAuxRef()
body_{number}.SetName('{name}')
body_{number}.SetPos({vector(position)})
body_{number}.SetRot(chrono.ChQuaterniond({w!r},{x!r},{y!r},{z!r}))
body_{number}.SetMass({mass!r})
body_{number}.SetInertiaXX({vector((xx, yy, zz))})
body_{number}.SetInertiaXY({vector((xy, xz, yz))})
body_{number}.SetFrameCOMToRef(chrono.ChFramed({vector(centre)},chrono.ChQuaterniond(1,0,0,0)))
{more}
exported_items.append(body_{number})
"""


def link(kind, name, bodies, *vectors, before=""):
    """A mate between two bodies."""
    ends = ",".join(f"body_{number}" for number in bodies)
    values = "".join(f",{vector(value)}" for value in vectors)
    return f"""
link = chrono.{kind}()
{before}
link.Initialize({ends},False{values})
link.SetName('{name}')
exported_items.append(link)
"""


def hinge(name, bodies, point, axis):
    """Concentric and coincident, as the exporter writes them; the second point is somewhere else along the axis."""
    side = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    line = "link.SetConstrainedCoords(True, True, False, False, False, False)"
    return (
        link(
            "ChLinkMateParallel",
            f"Concentric{name}",
            bodies,
            point,
            point + 0.1 * axis,
            axis,
            -axis,
            before="link.SetFlipped(True)",
        )
        + link("ChLinkMateGeneric", f"Concentric{name}", bodies, point, point + 0.1 * axis, axis, -axis, before=line)
        + link("ChLinkMateDistanceZ", f"Coincident{name}", bodies, point + side, point - side, axis)
        + link("ChLinkMateParallel", f"Coincident{name}", bodies, point + side, point - side, axis, axis)
    )


def arm():
    """The texts of an arm: of a script in the new dialect, and of its URDF."""
    links, urdf = random_arm()
    script, mates = HEAD, []
    for number, each in enumerate(links, start=1):
        script += part(number, each.name, each.place, each.turn, each.mass, each.inertia, each.centre)
        ends = (number - 1, number) if number % 2 else (number, number - 1)
        mates.append(hinge(number, ends, each.place, each.turn @ each.axis))
    # a name behind those of the links: which one is the parent does not go by names
    return script.replace("'ground'", "'the ground'") + "".join(mates), urdf


@pytest.mark.parametrize("old", [False, True], ids=["new", "old"])
def test_the_inverse_mass_of_an_arm_is_that_of_its_urdf(old, tmp_path):
    script, urdf = arm()
    (tmp_path / "arm.py").write_text(in_dialect(script, old))
    (tmp_path / "arm.urdf").write_text(urdf)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ours = load_solidworks(tmp_path / "arm.py")
        other = load_urdf(tmp_path / "arm.urdf", base="fixed")
    assert list(ours.dofs) == [f"Concentric{k}+Coincident{k}" for k in range(1, 6)]
    assert ours.mass == pytest.approx(other.mass, rel=1e-12)
    theirs = mujoco_urdf(urdf.encode(), "fixed")
    # every second mate names its parts the other way round: the hinges turn the same way
    for qpos in np.random.default_rng(0).uniform(-2.0, 2.0, (3, 5)).astype(np.float32).astype(float):
        mass = full_mass(theirs, qpos)
        # float32 rates: the bound of the import is 1e-5
        assert energy_norm_error(inverse_mass(ours, qpos), mass) < 1e-5
        assert energy_norm_error(inverse_mass(other, qpos), mass) < 1e-5


def test_the_vertical_may_be_y(tmp_path):
    script, _ = arm()
    (tmp_path / "arm.py").write_text(script)
    lying, standing = (load_solidworks(tmp_path / "arm.py", up=up) for up in ("z", "y"))
    for before, after in zip(lying.builder.bodies, standing.builder.bodies, strict=True):
        x, y, z = before.pose.position
        np.testing.assert_allclose(after.pose.position, (x, -z, y), atol=1e-12)
    np.testing.assert_allclose(
        inverse_mass(standing, np.zeros(5)), inverse_mass(lying, np.zeros(5)), rtol=1e-4, atol=1e-3
    )


# ---- mates -----------------------------------------------------------------------------------------------------------

BOX = np.diag([0.1, 0.2, 0.25])
AXIS, SIDE, POINT = np.array([0.0, 0.6, 0.8]), np.array([1.0, 0.0, 0.0]), np.array([0.1, 0.2, 0.3])
ACROSS = np.cross(AXIS, SIDE)
BEYOND = POINT + SIDE
PARALLEL = ("ChLinkMateParallel", POINT, POINT, AXIS, AXIS)

SUMS: dict[str, tuple[list[Any], JointType | None]] = {
    "fixed": ([("ChLinkMateFix",)], JointType.FIXED),
    "coaxial": ([("ChLinkMateCoaxial", POINT, POINT, AXIS, AXIS)], JointType.CYLINDRICAL),
    "hinge": (
        [("ChLinkMateCoaxial", POINT, POINT, AXIS, AXIS), ("ChLinkMateDistanceZ", BEYOND, POINT, AXIS)],
        JointType.REVOLUTE,
    ),
    "ball and parallel": ([("ChLinkMateSpherical", POINT, POINT), PARALLEL], JointType.REVOLUTE),
    "two balls": (
        [("ChLinkMateSpherical", POINT, POINT), ("ChLinkMateSpherical", POINT + AXIS, POINT)],
        JointType.REVOLUTE,
    ),
    "ball": ([("ChLinkMateSpherical", POINT, POINT)], JointType.SPHERICAL),
    "plane": ([("ChLinkMatePlane", POINT, POINT, AXIS, AXIS)], JointType.PLANAR),
    "distance and parallel": ([("ChLinkMateDistanceZ", POINT, POINT, AXIS), PARALLEL], JointType.PLANAR),
    "three planes": (
        [("ChLinkMatePlane", POINT, POINT, direction, direction) for direction in np.eye(3)],
        JointType.FIXED,
    ),
    "slide": (
        [("ChLinkMatePlane", POINT, POINT, SIDE, SIDE), ("ChLinkMatePlane", POINT, POINT, ACROSS, ACROSS)],
        JointType.PRISMATIC,
    ),
    "hinge twice": ([("ChLinkMateRevolute", POINT, POINT, AXIS, AXIS)] * 2, JointType.REVOLUTE),
    "two hinges apart": (
        [("ChLinkMateRevolute", POINT, POINT, AXIS, AXIS), ("ChLinkMateRevolute", BEYOND, POINT, AXIS, AXIS)],
        JointType.FIXED,
    ),
    "parallel alone": ([PARALLEL], None),
    "orthogonal": ([("ChLinkMateOrthogonal", POINT, POINT, AXIS, SIDE)], None),
    "point on plane": ([("ChLinkMateDistanceZ", POINT, POINT, AXIS)], None),
    "ball and orthogonal": (
        [("ChLinkMateSpherical", POINT, POINT), ("ChLinkMateOrthogonal", POINT, POINT, AXIS, SIDE)],
        None,
    ),
}


def two_parts(mates, more=""):
    body = part(1, "first", (0, 0, 0), np.eye(3), 1.0, BOX, (0, 0, 0), "body_1.SetFixed(True)")
    return HEAD + body + part(2, "second", (0.3, 0, 0), np.eye(3), 2.0, BOX, (0, 0, 0.1), more) + "".join(mates)


@pytest.mark.parametrize("case", SUMS)
def test_mates_leave_a_joint(case, tmp_path):
    listed, kind = SUMS[case]
    mates = [link(first, f"M{number}", (1, 2), *vectors) for number, (first, *vectors) in enumerate(listed)]
    (tmp_path / "parts.py").write_text(two_parts(mates))
    title = "+".join(f"M{number}" for number in range(len(mates)))
    if kind is None:
        with pytest.raises(
            sw.ModelError, match=f"refused mates '{re.escape(title)}': between 'first' and 'second'"
        ) as wrong:
            load_solidworks(tmp_path / "parts.py")
        assert str(wrong.value).count("M0") == 1
        with pytest.warns(ImportedWarning, match="dropped mates"):
            assert list(load_solidworks(tmp_path / "parts.py", allow=["mates"]).dofs) == ["second_floating"]
        return
    found = load_solidworks(tmp_path / "parts.py")
    if kind == JointType.FIXED:
        assert found.dofs == {}
        assert found.frame("second").body == found.frame("first").body
        return
    (joint,) = (joint for joint in found.builder.joints if joint.type != JointType.FIXED)
    assert (joint.name, joint.type, joint.parent, joint.child) == (title, kind, 0, 1)
    turn = Rotation(joint.frame0.rotation).as_matrix()
    if kind != JointType.SPHERICAL:
        np.testing.assert_allclose(turn[:, 2], AXIS, atol=1e-9)  # positive about the first direction
    if kind in (JointType.REVOLUTE, JointType.CYLINDRICAL, JointType.SPHERICAL):
        np.testing.assert_allclose(joint.frame0.position, POINT, atol=1e-9)


def test_the_published_escapement(tmp_path):
    file = ROBOTS / "solidworks/swiss_escapement.py"
    if not file.is_file():
        pytest.skip("the published model files are not here")
    found = load_solidworks(file)
    assert list(found.dofs) == ["Concentrico1+Coincident1", "Concentrico2+Coincident2", "Concentrico3+Coincident5"]
    assert found.mass == pytest.approx(0.27555084 + 1.02644191 + 1.81117045 + 0.38448770, abs=1e-7)
    boxes = [shape for shape in found.builder.shapes if shape.type == ShapeType.BOX]
    # the wheel's teeth are 5 mm thick, from its face at z = 0 on
    assert {round(float(box.size[0]), 9) for box in boxes if box.body == found.bodies["escape_wheel-1"]} == {0.0025}
    visuals = Visuals(found.builder)
    found.add_visuals(visuals)
    assert sum(instance.kind == ShapeType.MESH for instance in visuals.instances) == 5


# ---- shapes, dialects, markers ---------------------------------------------------------------------------------------

FRAME = "chrono.ChFramed(chrono.ChVector3d(1,2,3),chrono.ChQuaterniond(1,0,0,0))"
OLD_PLACE = "chrono.ChVectorD(1,2,3),chrono.ChMatrix33D(1)"
SHAPES = {
    "box": (
        f"body_2.AddCollisionShape(chrono.ChCollisionShapeBox(mat, 0.2, 0.4, 0.6), {FRAME})",
        ShapeType.BOX,
        (0.1, 0.2, 0.3),
    ),
    "sphere": (
        f"body_2.AddCollisionShape(chrono.ChCollisionShapeSphere(mat, 0.2), {FRAME})",
        ShapeType.SPHERE,
        (0.2, 0.2, 0.2),
    ),
    "cylinder": (
        f"body_2.GetCollisionModel().AddShape(chrono.ChCollisionShapeCylinder(mat, 0.1, 0.4), {FRAME})",
        ShapeType.CYLINDER,
        (0.1, 0.2, 0.1),
    ),
    "old box": (f"body_2.GetCollisionModel().AddBox(0.2, 0.4, 0.6, {OLD_PLACE})", ShapeType.BOX, (0.2, 0.4, 0.6)),
    "old box of a material": (
        f"body_2.GetCollisionModel().AddBox(mat, 0.2, 0.4, 0.6, {OLD_PLACE})",
        ShapeType.BOX,
        (0.1, 0.2, 0.3),
    ),
    "old sphere": (
        "body_2.GetCollisionModel().AddSphere(0.2, chrono.ChVectorD(1,2,3))",
        ShapeType.SPHERE,
        (0.2, 0.2, 0.2),
    ),
    "old cylinder": (
        f"body_2.GetCollisionModel().AddCylinder(0.1, 0.1, 0.4, {OLD_PLACE})",
        ShapeType.CYLINDER,
        (0.1, 0.4, 0.1),
    ),
    "cylinder of a length": (
        f"body_2.GetCollisionModel().AddCylinder(mat, 0.1, 0.4, {OLD_PLACE})",
        ShapeType.CYLINDER,
        (0.1, 0.2, 0.1),
    ),
    "cylinder of two ends": (
        "body_2.GetCollisionModel().AddCylinder(mat, 0.1, chrono.ChVectorD(1,2,1), chrono.ChVectorD(1,2,5))",
        ShapeType.CYLINDER,
        (0.1, 2.0, 0.1),
    ),
}
BALL = link("ChLinkMateSpherical", "M0", (1, 2), POINT, POINT)


@pytest.mark.parametrize("case", SHAPES)
def test_shapes_of_all_dialects(case, tmp_path):
    line, kind, size = SHAPES[case]
    mat = "mat = chrono.ChContactMaterialNSC()\nmat.SetFriction(0.35)\nmat.SetRestitution(0.1)\n"
    (tmp_path / "parts.py").write_text(two_parts([BALL], mat + line))
    found = load_solidworks(tmp_path / "parts.py")
    (shape,) = found.builder.shapes
    assert shape.type == kind
    np.testing.assert_allclose(shape.size, size, atol=1e-12)
    np.testing.assert_allclose(shape.pose.position, (1.0, 2.0, 2.9), atol=1e-12)  # the centre of mass is 0.1 higher
    axis = Rotation(shape.pose.rotation).apply((0.0, 0.0, 1.0))
    np.testing.assert_allclose(axis, (0, 1, 0) if case == "old cylinder" else (0, 0, 1), atol=1e-12)
    if "mat," in line:
        assert (shape.material.friction, shape.material.restitution) == (0.35, 0.1)


def test_markers_are_sites(tmp_path):
    marker = """marker = chrono.ChMarker()
marker.SetName('tip')
body_2.AddMarker(marker)
marker.ImposeAbsoluteTransform(chrono.ChFramed(chrono.ChVector3d(0.3,0.5,0),chrono.ChQuaterniond(1,0,0,0)))"""
    (tmp_path / "parts.py").write_text(two_parts([BALL], marker))
    found = load_solidworks(tmp_path / "parts.py", prefix="p_", pose=sw.pose((5, 0, 0)))
    assert found.frame("p_tip").body == found.bodies["p_second"]
    np.testing.assert_allclose(found.frame("p_tip").pose.position, (0.0, 0.5, -0.1), atol=1e-12)
    np.testing.assert_allclose(found.builder.bodies[1].pose.position, (5.3, 0.0, 0.1), atol=1e-12)


def test_a_part_without_ground_floats_unless_it_is_the_base(tmp_path):
    (tmp_path / "parts.py").write_text(two_parts([BALL]).replace("body_1.SetFixed(True)", ""))
    found = load_solidworks(tmp_path / "parts.py")
    assert list(found.dofs) == ["first_floating", "M0"]
    np.testing.assert_allclose(found.coordinates.initial, [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0], atol=1e-12)
    assert list(load_solidworks(tmp_path / "parts.py", base="first").dofs) == ["M0"]
    with pytest.raises(sw.ModelError, match=r"base must be the name of a part, got 'frist'.*did you mean 'first'"):
        load_solidworks(tmp_path / "parts.py", base="frist")
    bad: Any = "x"
    with pytest.raises(sw.ModelError, match="up must be 'z' or 'y'"):
        load_solidworks(tmp_path / "parts.py", up=bad)


# ---- what is refused or wrong ----------------------------------------------------------------------------------------

REFUSED = {
    "import": ("import os", "statement", "import os"),
    "code": ("for i in range(3): pass", "statement", "for i in range"),
    "call": ("open('/etc/passwd')", "statement", "open"),
    "attack": ("__import__('os').system('true')", "statement", "__import__"),
    "sum": ("x = 1 + 2", "statement", "a sum of 1 and 2"),
    "unknown class": ("x = chrono.ChSystemNSC()", "statement", "the class ChSystemNSC"),
    "unknown method": ("body_2.SetInertia(1)", "statement", "SetInertia of part 'second'"),
    "unknown name": ("body_9.SetMass(1)", "statement", "the name 'body_9'"),
    "motor": (
        "m = chrono.ChLinkMotorRotationSpeed()\nm.SetName('motor')\nexported_items.append(m)",
        "link",
        "ChLinkMotorRotationSpeed is no mate",
    ),
    "shape": ("body_2.GetCollisionModel().AddBarrel(1, 2, 3)", "collision shape", "no shape of ours"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused_is_told_once(case, tmp_path):
    line, kind, told = REFUSED[case]
    (tmp_path / "parts.py").write_text(two_parts([BALL], line))
    with pytest.raises(sw.ModelError, match=re.escape(told)) as wrong:
        load_solidworks(tmp_path / "parts.py")
    assert str(wrong.value).startswith(f"parts.py: refused {kind} '")
    assert str(wrong.value).count(told) == 1
    with pytest.warns(ImportedWarning) as warned:
        load_solidworks(tmp_path / "parts.py", allow=[kind])
    assert len(warned) == 1


NEAR = {
    "envelope": ("body_2.GetCollisionModel().SetEnvelope(0.1)", "SetEnvelope 'second'"),
    "family": ("body_2.GetCollisionModel().SetFamily(2)", "SetFamily 'second'"),
    "young": (
        (
            "mat = chrono.ChContactMaterialSMC()\nmat.SetYoungModulus(2e5)\n"
            "body_2.AddCollisionShape(chrono.ChCollisionShapeSphere(mat, 0.2))"
        ),
        "material SetYoungModulus",
    ),
    "visual box": ("v = chrono.ChVisualShapeModelFile()\nbody_2.AddVisualShape(v)", "visual shape"),
}


@pytest.mark.parametrize("case", NEAR)
def test_what_is_near_is_told_once(case, tmp_path):
    line, told = NEAR[case]
    (tmp_path / "parts.py").write_text(two_parts([BALL], line))
    with pytest.warns(ImportedWarning, match=f"parts\\.py: {told}") as warned:
        load_solidworks(tmp_path / "parts.py")
    assert len(warned) == 1


WRONG = {
    "cut off": ("body_2.SetMass(2.0)", "body_2.SetMass(2.", "line .*must be Python"),
    "no items": ("exported_items = []", "items = []", "exported_items"),
    "no mass": ("body_2.SetMass(2.0)", "", r"part 'second' \(line \d+\): must have a mass"),
    "negative mass": ("body_2.SetMass(2.0)", "body_2.SetMass(-2.0)", "part 'second'.*SetMass must be a number > 0"),
    "absurd": ("body_2.SetMass(2.0)", "body_2.SetMass(1e39)", "mass must be"),
    "no inertia": (
        "body_2.SetInertiaXX(chrono.ChVector3d(0.1,0.2,0.25))",
        "body_2.SetInertiaXX(chrono.ChVector3d(0,0,0))",
        "part 'second'.*principal moments",
    ),
    "same name": ("SetName('second')", "SetName('first')", "part 'first'.*must be unique"),
    "one part": ("Initialize(body_1,body_2", "Initialize(body_1,3", "mate 'M0'.*Initialize must name two parts"),
    "no points": (
        "False,chrono.ChVector3d(0.1,0.2,0.3),chrono.ChVector3d(0.1,0.2,0.3)",
        "False",
        "mate 'M0'.*must have 2 vectors",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_told_in_one_line(case, tmp_path):
    old, new, told = WRONG[case]
    script = two_parts([BALL])
    assert script.count(old) == 1
    (tmp_path / "parts.py").write_text(script.replace(old, new))
    with pytest.raises(sw.ModelError, match=told) as wrong:
        load_solidworks(tmp_path / "parts.py", allow=["statement"] if case == "no items" else [])
    assert str(wrong.value).startswith("parts.py: ")
    assert "\n" not in str(wrong.value)


def test_meshes_stay_in_their_folders(tmp_path):
    mesh = """m = chrono.ChTriangleMeshConnected()
m.LoadWavefrontMesh(shapes_dir + '{}')
body_2.AddCollisionShape(chrono.ChCollisionShapeTriangleMesh(0, m, False, False))"""
    folder = tmp_path / "script"
    (folder / "arm_shapes").mkdir(parents=True)
    wedge = "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    for place in (folder / "arm_shapes", tmp_path):
        (place / "wedge.obj").write_text(wedge)
    (folder / "parts.py").write_text(two_parts([BALL], mesh.format("wedge.obj")))
    with pytest.warns(ImportedWarning, match="its convex hull"):
        assert load_solidworks(folder / "parts.py").builder.shapes[0].type == ShapeType.HULL
    (folder / "parts.py").write_text(two_parts([BALL], mesh.format("../../wedge.obj")))
    with pytest.raises(sw.ModelError, match="leads out of the folders"):
        load_solidworks(folder / "parts.py")
    with pytest.warns(ImportedWarning, match="its convex hull"):
        load_solidworks(folder / "parts.py", folders=[tmp_path])
