"""USD stages: arms in several units against MuJoCo, chains of D6 joints, masses in closed form, and what is refused."""

import math
import warnings

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp.core.types import JointType, PositionDrive, ShapeType
from simwarp.importers import load_usd
from simwarp.importers.report import ImportedWarning
from simwarp.sensors.scene import Visuals
from tests.reference.imported_robots import (
    ROBOTS,
    energy_norm_error,
    full_mass,
    inverse_mass,
    link_poses,
    mujoco_urdf,
    random_arm,
)

SI = 'metersPerUnit = 1\n    kilogramsPerUnit = 1\n    upAxis = "Z"'


def numbers(values):
    return f"({', '.join(repr(float(value)) for value in values)})"


def wxyz(rotation):
    return numbers(np.roll(rotation.as_quat(), 1))


def stage(*prims, head=SI):
    return f"#usda 1.0\n(\n    {head}\n)\n" + "\n".join(prims)


def body(name, place=(0, 0, 0), turn=None, lines="", inside="", apis=""):
    """A rigid body of given place and attributes."""
    return f"""
def Xform "{name}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"{apis}])
{{
    quatd xformOp:orient = {wxyz(turn or Rotation.identity())}
    double3 xformOp:translate = {numbers(place)}
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
    {lines}
    {inside}
}}"""


def weight(mass, centre, inertia, length=1.0, mass_unit=1.0):
    """Attributes of mass, in units of a stage."""
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 2] *= np.linalg.det(axes)
    return f"""float physics:mass = {mass / mass_unit!r}
    point3f physics:centerOfMass = {numbers(np.asarray(centre) / length)}
    float3 physics:diagonalInertia = {numbers(moments / length**2 / mass_unit)}
    quatf physics:principalAxes = {wxyz(Rotation.from_matrix(axes))}"""


UNIT = "float physics:mass = 2\n    float3 physics:diagonalInertia = (0.1, 0.2, 0.25)"


def joint(kind, name, first, second, lines="", local0=((0, 0, 0), None), local1=((0, 0, 0), None), apis=()):
    """A joint of two paths, "" for the world."""
    listed = ", ".join(f'"{api}"' for api in apis)
    schemas = f"(prepend apiSchemas = [{listed}])" if apis else ""
    ends = "".join(
        f"    rel physics:body{number} = <{path}>\n" for number, path in enumerate((first, second)) if path
    )  # fmt: skip
    return f"""
def Physics{kind}Joint "{name}" {schemas}
{{
{ends}
    point3f physics:localPos0 = {numbers(local0[0])}
    point3f physics:localPos1 = {numbers(local1[0])}
    quatf physics:localRot0 = {wxyz(local0[1] or Rotation.identity())}
    quatf physics:localRot1 = {wxyz(local1[1] or Rotation.identity())}
    {lines}
}}"""


def load(folder, text, **options):
    file = folder / "scene.usda"
    file.write_text(text)
    return load_usd(file, **options)


# ---- arms against MuJoCo ---------------------------------------------------------------------------------------------


def arm(angles, length=1.0, mass_unit=1.0, up="Z"):
    """A random arm that stands at the given angles, and MuJoCo's model of it."""
    links, urdf = random_arm()
    to_stage = Rotation.from_rotvec([-0.5 * math.pi, 0, 0]) if up == "Y" else Rotation.identity()
    prims, before = [], ""
    place, turn = np.zeros(3), to_stage
    for number, each in enumerate(links):
        frame = place + turn.apply(each.offset), turn * each.local
        place, turn = frame[0], frame[1] * Rotation.from_rotvec(angles[number] * each.axis)
        prims.append(
            body(each.name, place / length, turn, weight(each.mass, each.centre, each.inertia, length, mass_unit))
        )
        # the x axis of both frames of the joint is that of the hinge
        align = Rotation.align_vectors([each.axis], [[1.0, 0.0, 0.0]])[0]
        base = (each.offset, each.local) if before else (to_stage.apply(each.offset), to_stage * each.local)
        local0 = base[0] / length, base[1] * align
        prims.append(
            joint(
                "Revolute",
                f"j{number + 1}",
                before,
                f"/{each.name}",
                'uniform token physics:axis = "X"',
                local0,
                ((0, 0, 0), align),
            )
        )
        before = f"/{each.name}"
    head = f'metersPerUnit = {length}\n    kilogramsPerUnit = {mass_unit}\n    upAxis = "{up}"'
    return stage(*prims, head=head), mujoco_urdf(urdf.encode(), "fixed")


@pytest.mark.parametrize(
    ("length", "mass_unit", "up"), [(1.0, 1.0, "Z"), (0.01, 0.001, "Y")], ids=["SI", "cm, g, y up"]
)
def test_an_arm_in_any_units(length, mass_unit, up, tmp_path):
    rng = np.random.default_rng(1)
    text, theirs = arm(rng.uniform(-1.5, 1.5, 5), length, mass_unit, up)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ours = load(tmp_path, text)
    assert list(ours.dofs) == ["j1", "j2", "j3", "j4", "j5"]
    qpos = rng.uniform(-2.0, 2.0, (4, 5))
    found = link_poses(ours, qpos)
    data = mujoco.MjData(theirs)
    for world in range(4):
        data.qpos[:] = qpos[world]
        mujoco.mj_kinematics(theirs, data)
        for name, (place, _) in found.items():
            # localPos and localRot are float32: 1e-7 of each of five links, and angles in degrees of them
            np.testing.assert_allclose(place[world], data.xpos[theirs.body(name).id], atol=3e-6, err_msg=name)
        # float32 masses and inertias in the file, float32 rates of ours
        assert energy_norm_error(inverse_mass(ours, qpos[world]), full_mass(theirs, qpos[world])) < 1e-5


# ---- joints ----------------------------------------------------------------------------------------------------------


def test_limits_and_drives_are_in_radians(tmp_path):
    drive = """float physics:lowerLimit = -90
    float physics:upperLimit = 45
    float drive:angular:physics:stiffness = 2
    float drive:angular:physics:damping = 0.5
    float drive:angular:physics:maxForce = 7
    float drive:angular:physics:targetPosition = 30
    float physxJoint:armature = 0.25"""
    tilt = Rotation.from_rotvec([math.radians(20), 0, 0])
    text = stage(
        body("a", lines=UNIT, turn=tilt),
        joint(
            "Revolute",
            "j",
            "",
            "/a",
            f'uniform token physics:axis = "X"\n    {drive}',
            apis=["PhysicsDriveAPI:angular"],
        ),
    )
    found = load(tmp_path, text)
    dof = found.builder.joints[0].dofs[0]
    # the body stands at 20 degrees, where our coordinate is 0
    assert dof.limit == pytest.approx((math.radians(-110), math.radians(25)))
    assert dof.armature == 0.25
    turn = 180 / math.pi
    assert isinstance(dof.drive, PositionDrive)
    assert (dof.drive.stiffness, dof.drive.damping, dof.drive.effort_limit) == pytest.approx(
        (2 * turn, 0.5 * turn, 7.0)
    )
    np.testing.assert_allclose(found.qpos_from([0.0]), [math.radians(20)], rtol=1e-6)
    assert found.actuators[0].length_offset == pytest.approx(math.radians(20))
    np.testing.assert_allclose(found.keyframes["initial"].ctrl, [math.radians(30)], rtol=1e-6)


LOCK = "float limit:{0}:physics:low = 1\n    float limit:{0}:physics:high = -1"


@pytest.mark.parametrize("free", ["transX", "rotY", "transX transZ", "rotX rotZ", "transY rotX rotY", "rotX rotY rotZ"])
def test_a_d6_joint_is_its_free_axes_in_a_row(free, tmp_path):
    axes = ["transX", "transY", "transZ", "rotX", "rotY", "rotZ"]
    locked = [axis for axis in axes if axis not in free.split()]
    rng = np.random.default_rng(5)
    local0 = rng.uniform(-1, 1, 3), Rotation.from_rotvec(rng.normal(size=3))
    local1 = rng.uniform(-1, 1, 3), Rotation.from_rotvec(rng.normal(size=3))

    def placed(values):
        """Pose of the second body, whose joint stands at the values of all six axes."""
        turn = local0[1] * Rotation.from_euler("XYZ", values[3:])
        point = local0[0] + local0[1].apply(values[:3])
        turned = turn * local1[1].inv()
        return point - turned.apply(local1[0]), turned

    start, asked = ({axis: rng.uniform(-0.6, 0.6) for axis in free.split()} for _ in range(2))
    place, turn = placed([start.get(axis, 0.0) for axis in axes])
    lines = "\n    ".join(LOCK.format(axis) for axis in locked)
    text = stage(
        body("a", lines=UNIT), body("b", place, turn, UNIT), joint("Fixed", "ground", "", "/a"),
        joint("", "d", "/a", "/b", lines, local0, local1, [f"PhysicsLimitAPI:{axis}" for axis in locked]),
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if free == "rotX rotY rotZ" else "error")
        found = load(tmp_path, text)
    assert list(found.dofs) == (["d"] if " " not in free else [f"d:{axis}" for axis in free.split()])
    np.testing.assert_allclose(found.coordinates.initial, list(start.values()), atol=1e-6)
    (point,), (matrix,) = link_poses(found, np.array([list(asked.values())]))["b"]
    wanted = placed([asked.get(axis, 0.0) for axis in axes])
    np.testing.assert_allclose(point, wanted[0], atol=2e-6)
    np.testing.assert_allclose(matrix, wanted[1].as_matrix(), atol=2e-6)


def test_joints_to_the_world_and_floating_bodies(tmp_path):
    text = stage(
        body("a", lines=UNIT), body("b", (1, 0, 0), lines=UNIT), body("c", (2, 0, 0), lines=UNIT),
        joint("Prismatic", "slide", "/a", "", 'uniform token physics:axis = "Z"'),
        joint("Spherical", "ball", "/b", "/c", local0=((1, 0, 0), None)),
    )  # fmt: skip
    found = load(tmp_path, text)
    assert list(found.dofs) == ["b_floating", "slide", "ball"]
    # the world is the second body of the slide: a rising body is a negative distance
    (place,), _ = link_poses(found, np.array([[5, 0, 0, 1, 0, 0, 0, -0.3, 1, 0, 0, 0]]))["a"]
    np.testing.assert_allclose(place, (0, 0, 0.3), atol=1e-6)


# ---- masses and colliders --------------------------------------------------------------------------------------------

CUBE = """def Cube "cube" (prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMassAPI"]) {{
        double size = 2
        double3 xformOp:translate = (0, 0, 3)
        float3 xformOp:scale = (1, 2, 3)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
        {}
    }}"""


def test_mass_comes_from_colliders_and_densities(tmp_path):
    for lines, density, given in (
        ("", 1000.0, None),
        ("float physics:density = 7", 7.0, None),
        ("float physics:mass = 4", 4.0 / 48.0, 4.0),
    ):
        found = load(tmp_path, stage(body("a", inside=CUBE.format(lines))))
        made = found.builder.bodies[0]
        mass = given or density * 48.0
        # float32 in the file
        assert made.mass == pytest.approx(mass, rel=1e-6)
        np.testing.assert_allclose(made.pose.position, (0, 0, 3), atol=1e-6)
        np.testing.assert_allclose(np.diag(made.inertia), mass / 3 * np.array([13, 10, 5]), rtol=1e-6)
        (shape,) = found.builder.shapes
        np.testing.assert_allclose(shape.size, (1, 2, 3), atol=1e-6)
        np.testing.assert_allclose(shape.pose.position, 0.0, atol=1e-6)


MESH = """def Mesh "wedge" (prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"]) {{
        int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
        int[] faceVertexIndices = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]
        point3f[] points = [(0,0,0), (1,0,0), (0,1,0), (1,1,0), (0,0,1), (1,0,1), (0,1,1), (1,1,1)]
        double3 xformOp:translate = (0, 0, 5)
        float3 xformOp:scale = (2, 2, 4)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
        uniform token physics:approximation = "{}"
    }}"""


def test_meshes_are_hulls(tmp_path):
    found = load(tmp_path, stage(body("a", inside=MESH.format("convexHull"))))
    (shape,) = found.builder.shapes
    hull = found.builder.hulls[shape.asset].vertices
    assert shape.type == ShapeType.HULL
    np.testing.assert_allclose(hull.max(axis=0), (2, 2, 4))
    assert found.mass == pytest.approx(16000.0, rel=1e-6)
    # the frame of the mesh is 2 below the centre, which is at (1, 1, 7)
    np.testing.assert_allclose(found.builder.bodies[0].pose.position, (1, 1, 7), atol=1e-6)
    np.testing.assert_allclose(shape.pose.position, (-1, -1, -2), atol=1e-6)
    with pytest.warns(ImportedWarning, match="collider mesh 'wedge': its convex hull, in place of none"):
        load(tmp_path, stage(body("a", inside=MESH.format("none"))))


@pytest.mark.parametrize(
    ("word", "axis", "kind", "size"),
    [
        ("Sphere", "", ShapeType.SPHERE, (0.5, 0.5, 0.5)),
        ("Capsule", "X", ShapeType.CAPSULE, (0.5, 1.5, 0.5)),
        ("Cylinder", "Y", ShapeType.CYLINDER, (0.5, 1.5, 0.5)),
        ("Cone", "Z", ShapeType.CONE, (0.5, 1.5, 0.5)),
    ],
)
def test_colliders(word, axis, kind, size, tmp_path):
    more = f'uniform token axis = "{axis}"\n    double height = 3' if axis else ""
    api = 'prepend apiSchemas = ["PhysicsCollisionAPI"]'
    shape = f'def {word} "s" ({api}) {{\n    double radius = 0.5\n    {more}\n    }}'
    found = load(tmp_path, stage(body("a", inside=shape, lines=UNIT)))
    (shape,) = found.builder.shapes
    assert shape.type == kind
    np.testing.assert_allclose(shape.size, size)
    if axis:
        along = Rotation(shape.pose.rotation).apply((0, 0, 1))
        np.testing.assert_allclose(along, np.eye(3)["XYZ".index(axis)], atol=1e-12)
    visuals = Visuals(found.builder)
    found.add_visuals(visuals)
    assert [instance.name for instance in visuals.instances] == ["s"]


def test_what_is_seen_hides_what_collides(tmp_path):
    guide = CUBE.format('uniform token purpose = "guide"')
    seen = 'def Sphere "ball" {\n double radius = 0.5\n color3f[] primvars:displayColor = [(1, 0, 0)]\n }'
    found = load(tmp_path, stage(body("a", inside=guide + "\n    " + seen)))
    visuals = Visuals(found.builder)
    found.add_visuals(visuals)
    (ball,) = visuals.instances
    assert ball.name == "a/ball_visual"
    np.testing.assert_allclose(ball.appearance.color, (1, 0, 0))
    points = visuals.meshes[ball.asset].vertices
    # the body's centre is that of the cube, 3 above the ball's
    np.testing.assert_allclose(points.mean(axis=0) + ball.pose.position, (0, 0, -3), atol=1e-5)


# ---- what is seen ----------------------------------------------------------------------------------------------------

PROTOTYPE = """class Xform "Shell" {
    def Cube "side" {
        double size = 0.2
        double3 xformOp:translate = (0, 0, 2)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}"""
INSTANCE = 'def Xform "NAME" (instanceable = true\n    prepend references = </Shell>) {}'


def shown(found):
    """Name -> mean of the corners in the world as built, of all that is drawn."""
    visuals = Visuals(found.builder)
    found.add_visuals(visuals)
    centres = {}
    for instance in visuals.instances:
        turn, place = Rotation.identity(), np.zeros(3)
        if instance.body >= 0:
            turn = Rotation(found.builder.bodies[instance.body].pose.rotation)
            place = found.builder.bodies[instance.body].pose.position
        asset = visuals.meshes[instance.asset] if instance.asset >= 0 else None
        local = instance.pose.position + (0.0 if asset is None else asset.vertices.mean(axis=0))
        centres[instance.name] = place + turn.apply(local)
    return centres


@pytest.mark.parametrize("instanceable", [True, False])
def test_what_an_instance_shows_is_seen(instanceable, tmp_path):
    """An instance shows what a plain reference shows: on a turned body, and beside the bodies."""
    turn = Rotation.from_rotvec([0.5, 0.0, 0.0])
    instance = INSTANCE if instanceable else INSTANCE.replace("instanceable = true", "")
    prims = body("a", (1, 0, 0), turn, lines=UNIT, inside=instance.replace("NAME", "shell"))
    found = load(tmp_path, stage(PROTOTYPE, prims, instance.replace("NAME", "beside")))
    centres = shown(found)
    assert set(centres) == {"a/shell/side_visual", "beside/side_visual"}
    # corners are float32
    np.testing.assert_allclose(centres["a/shell/side_visual"], np.array([1, 0, 0]) + turn.apply([0, 0, 2]), atol=1e-6)
    np.testing.assert_allclose(centres["beside/side_visual"], (0, 0, 2), atol=1e-6)


def test_nothing_that_is_seen_vanishes_without_a_word(tmp_path):
    """Every prim of geometry is drawn, collides, is invisible in the file, or is named."""
    inside = """def Cube "off" {
        token visibility = "invisible"
    }
    def BasisCurves "rope" {}
    def Mesh "empty" {}
    def PointInstancer "heap" {
        def Sphere "grain" {}
    }
    def Sphere "seen" {}"""
    scenery = 'def Sphere "stone" {\n    double radius = 0.3\n}'
    with pytest.warns(ImportedWarning) as told:
        found = load(tmp_path, stage(body("a", lines=UNIT, inside=inside), scenery))
    assert set(shown(found)) == {"a/seen_visual", "stone_visual"}
    text = "\n".join(str(one.message) for one in told)
    for words in ("a/rope", "a BasisCurves is not shown", "a/empty", "a mesh without faces", "/a/heap"):
        assert text.count(words) == 1, words
    assert [line.name for line in found.report.held if line.element == "invisible"] == ["/a/off"]


def test_warnings_of_the_library_are_told_once_and_not_printed(tmp_path, capfd):
    lost = 'def Xform "lost" (prepend references = </nowhere>) {}'
    with pytest.warns(ImportedWarning, match="composition .*Unresolved reference prim path") as told:
        load(tmp_path, stage(body("a", lines=UNIT), lost))
    assert len(told) == 1
    assert "\n" not in str(told[0].message)
    assert capfd.readouterr() == ("", "")


def test_groups_and_filtered_pairs(tmp_path):
    def cube(name, **options):
        return body(name, inside=CUBE.format("").replace('"cube"', f'"{name}_cube"'), **options)

    group = """def PhysicsCollisionGroup "g" (prepend apiSchemas = ["CollectionAPI:colliders"])
{
    rel collection:colliders:includes = [</a>, </b>]
    rel physics:filteredGroups = </g>
}"""
    pair = body(
        "d",
        inside=CUBE.format("").replace('"cube"', '"d_cube"'),
        apis=', "PhysicsFilteredPairsAPI"',
        lines="rel physics:filteredPairs = </c>",
    )
    found = load(tmp_path, stage(cube("a"), cube("b"), cube("c"), pair, group))
    names = [{found.builder.shapes[i].name for i in pair} for pair in found.builder.excluded_shapes]
    assert sorted(names, key=str) == sorted([{"a_cube", "b_cube"}, {"c_cube", "d_cube"}], key=str)


@pytest.mark.parametrize(
    ("line", "apart"),
    [
        ("", {("a", "b")}),
        ("bool physics:invertFilteredGroups = false", {("a", "b")}),
        ("bool physics:invertFilteredGroups = true", {("a", "c"), ("b", "c")}),
    ],
)
def test_a_group_means_the_same_however_often_it_is_read(tmp_path, line, apart):
    """Memory that a parser has not set holds either value, now and then."""
    cubes = [body(name, inside=CUBE.format("").replace('"cube"', f'"{name}_cube"')) for name in "abc"]
    groups = """def PhysicsCollisionGroup "NAME" (prepend apiSchemas = ["CollectionAPI:colliders"])
{
    rel collection:colliders:includes = [PATHS]
    rel physics:filteredGroups = </g>
    LINE
}"""
    first = groups.replace("NAME", "g").replace("PATHS", "</a>, </b>").replace("LINE", line)
    second = groups.replace("NAME", "h").replace("PATHS", "</c>").replace("rel physics:filteredGroups = </g>", "")
    text = stage(*cubes, first, second.replace("LINE", ""))
    for _ in range(20):
        builder = load(tmp_path, text).builder
        found = {tuple(sorted(builder.shapes[i].name[0] for i in pair)) for pair in builder.excluded_shapes}
        assert found == apart


# ---- what is near, refused or wrong ----------------------------------------------------------------------------------

DRIVEN = ["PhysicsDriveAPI:angular"]
HINGE = joint("Revolute", "j", "", "/a", 'uniform token physics:axis = "X"\n    MORE', apis=DRIVEN)
DRIVE = "float drive:angular:physics:damping = 1\n    float drive:angular:physics:targetVelocity = 1"
PULL = 'uniform token drive:angular:physics:type = "acceleration"\n    float drive:angular:physics:stiffness = 1'
CROSSED = "float physics:lowerLimit = 5\n    float physics:upperLimit = -5"
NEAR = {
    "foreign attribute": ("MORE", "float physxLimit:angular:damping = 1", "attribute 'physxLimit:angular:damping'"),
    "break force": ("MORE", "float physics:breakForce = 5", "break force 'j'"),
    "collisions": ("MORE", "bool physics:collisionEnabled = 1", "collisionEnabled 'j'"),
    "disabled": ("MORE", "bool physics:jointEnabled = 0", "disabled joint 'j'"),
    "apart": (
        "point3f physics:localPos0 = (0.0, 0.0, 0.0)",
        "point3f physics:localPos0 = (0.0, 0.1, 0.0)",
        "joint frames 'j'",
    ),
    "kinematic": (UNIT, UNIT + "\n    bool physics:kinematicEnabled = 1", "kinematic body 'a'"),
    "speed": ("MORE", DRIVE, "target velocity 'j'"),
}


@pytest.mark.parametrize("case", NEAR)
def test_what_is_near_is_told_once(case, tmp_path):
    old, new, told = NEAR[case]
    text = stage(body("a", lines=UNIT), HINGE)
    assert text.count(old) >= 1
    with pytest.warns(ImportedWarning) as warned:
        load(tmp_path, text.replace(old, new, 1).replace("MORE", ""))
    assert len(warned) == 1
    assert str(warned[0].message).startswith(f"scene.usda: {told}: ")


REFUSED = {
    "distance": (joint("Distance", "rope", "/a", "/b"), "joint", "rope"),
    "no body": (joint("Fixed", "nothing", "", ""), "joint", "nothing"),
    "acceleration": (
        joint("Revolute", "j", "", "/a", PULL, apis=DRIVEN),
        "acceleration drive",
        "j",
    ),
    "massless": (
        body("m", (0, 0, 1)) + joint("Revolute", "jm", "/a", "/m", local0=((0, 0, 1), None)),
        "massless body",
        "m",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused_is_told_once(case, tmp_path):
    prim, kind, name = REFUSED[case]
    text = stage(body("a", lines=UNIT), body("b", (1, 0, 0), lines=UNIT), prim)
    with pytest.raises(sw.ModelError, match=f"refused {kind} '{name}': ") as refused:
        load(tmp_path, text)
    assert str(refused.value).count(f"'{name}'") == 1
    with pytest.warns(ImportedWarning, match=f"dropped {kind} '{name}'") as warned:
        load(tmp_path, text, allow=[kind]).builder.finalize(1, "cpu")
    assert len(warned) == 1


WRONG = {
    "cut off": (stage(body("a", lines=UNIT))[:-5], "must be a USD file"),
    "syntax": ('#usda 1.0\ndef Xform "a" {\n  foo\n}\n', "must be a USD file, got: line 3:3: Expected }"),
    "no usd": ("hello", "must be a USD file"),
    "empty": (stage(), "must have a rigid body or a collider"),
    "no unit": (stage(body("a", lines=UNIT), head="metersPerUnit = 0"), "metersPerUnit must be > 0"),
    "limits": (
        stage(body("a", lines=UNIT), HINGE.replace("MORE", CROSSED)),
        "joint 'j': limit must have lower < upper",
    ),
    "absurd": (stage(body("a", lines="float physics:mass = 1e39")), "mass"),
    "outside": (stage('def "x" (prepend references = @/etc/hostname.usda@) {}'), "leads out of the folders"),
    "missing layer": (stage('def "x" (prepend references = @other.usda@) {}'), "there must be a file"),
    "internet": (stage('def "x" (prepend references = @https://example.org/a.usda@) {}'), "got https://"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_told_in_one_line(case, tmp_path):
    text, told = WRONG[case]
    with pytest.raises(sw.ModelError, match=told) as wrong:
        load(tmp_path, text)
    assert str(wrong.value).startswith("scene.usda: ")
    assert "\n" not in str(wrong.value)


# ---- published files -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "bodies", "dofs", "drives"),
    [("ant", 9, 14, 8), ("cartpole", 4, 3, 0), ("boxes_fourbar", 4, 10, 0), ("humanoid", 22, 27, 16)],
)
def test_published_stages(name, bodies, dofs, drives):
    file = ROBOTS / f"usd/{name}.usda"
    if not file.is_file():
        pytest.skip("the published model files are not here")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = load_usd(file)
    assert (len(found.bodies), found.builder.dof_count, len(found.actuators)) == (bodies, dofs, drives)
    sim = sw.Simulation(found.builder.finalize(1, "cpu"), 1e-3)
    sim.control.joint_force.zero_()
    for _ in range(20):
        sim.step()
    assert sim.state.world_status.numpy()[0] == 0
    if name == "ant":
        # a ball of 0.25 m, four capsules of 0.08 m and 0.2828 m, at density 1
        ball, tube = 4 / 3 * math.pi * 0.25**3, math.pi * 0.08**2 * 0.28284271 + 4 / 3 * math.pi * 0.08**3
        assert found.builder.bodies[found.bodies["torso"]].mass == pytest.approx(ball + 4 * tube, rel=1e-5)
    if name == "boxes_fourbar":
        joints = [joint for joint in found.builder.joints if joint.type == JointType.REVOLUTE]
        assert len(joints) == 4  # the loop is closed
