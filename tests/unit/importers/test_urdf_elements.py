"""URDF element by element: one altered file for each, which names what is near, refused or wrong exactly once."""

import warnings

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import ShapeType
from simwarp.geometry.assets import hull_mass
from simwarp.importers import load_urdf
from simwarp.importers.report import ImportedWarning
from simwarp.sensors.scene import Visuals

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <link name="upper">
    <inertial><origin xyz="0 0 0.2" rpy="0.3 0 0"/><mass value="2"/>
      <inertia ixx="0.03" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial>
    <visual><geometry><sphere radius="0.1"/></geometry><material name="red"/></visual>
    <collision><geometry><cylinder radius="0.05" length="0.4"/></geometry></collision>
  </link>
  <link name="fore">
    <inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>
  </link>
  <link name="tool"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><origin xyz="0 0 0.1"/><axis xyz="0 2 0"/>
    <limit lower="-1" upper="2" effort="30" velocity="4"/><dynamics damping="0.5" friction="0.1"/>
  </joint>
  <joint name="elbow" type="prismatic">
    <parent link="upper"/><child link="fore"/><origin xyz="0 0 0.4"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.3" effort="20" velocity="1"/>
  </joint>
  <joint name="flange" type="fixed"><parent link="fore"/><child link="tool"/><origin xyz="0 0 0.1"/></joint>
</robot>
"""


def load(folder, *changes, base="fixed", **options):
    """The arm with texts replaced."""
    text = ARM
    for old, new in changes:
        assert text.count(old) >= 1, old
        text = text.replace(old, new, 1)
    file = folder / "arm.urdf"
    file.write_text(text)
    return load_urdf(file, base=base, **options)


def test_the_arm_is_held(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm = load(tmp_path, prefix="a_")
    assert arm.report.near == arm.report.refused == []
    assert list(arm.bodies) == ["a_upper", "a_fore"]  # the base has no mass, the tool no joint of its own
    assert arm.dofs == {"a_shoulder": 0, "a_elbow": 1}
    assert arm.effort_limits == {"a_shoulder": 30.0, "a_elbow": 20.0}
    assert arm.velocity_limits == {"a_shoulder": 4.0, "a_elbow": 1.0}
    shoulder, elbow = (joint.dofs[0] for joint in arm.builder.joints)
    assert (shoulder.limit, shoulder.damping, shoulder.friction) == ((-1.0, 2.0), 0.5, 0.1)
    assert elbow.limit == (0.0, 0.3)
    # rpy of the inertial turns the inertia: that about x stays, those of y and z mix
    c, s = np.cos(0.3), np.sin(0.3)
    wanted = np.array([0.03, c * c * 0.02 + s * s * 0.01, s * s * 0.02 + c * c * 0.01])
    np.testing.assert_allclose(np.diag(arm.builder.bodies[0].inertia), wanted, rtol=1e-12)
    np.testing.assert_allclose(arm.builder.bodies[0].pose.position, (0.0, 0.0, 0.3), atol=1e-15)
    np.testing.assert_allclose(arm.frame("a_tool").pose.position, (0.0, 0.0, 0.1), atol=1e-15)
    assert arm.frame("a_base").body == sw.WORLD


def test_an_arm_stands_at_its_pose(tmp_path):
    quarter = sw.pose((1.0, 2.0, 3.0), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))  # about x: z becomes -y
    arm = load(tmp_path, pose=quarter)
    np.testing.assert_allclose(arm.builder.bodies[0].pose.position, (1.0, 2.0 - 0.3, 3.0), atol=1e-12)


def test_two_arms_in_one_builder(tmp_path):
    first = load(tmp_path, prefix="left_")
    second = load(tmp_path, prefix="right_", builder=first.builder, pose=sw.pose((1, 0, 0)))
    assert second.dofs == {"right_shoulder": 2, "right_elbow": 3}
    np.testing.assert_allclose(second.q_from([0.5, 0.2]), [0.0, 0.0, 0.5, 0.2])
    with pytest.raises(sw.ModelError, match=r"arm\.urdf: body 'left_upper': the name is taken"):
        load(tmp_path, prefix="left_", builder=first.builder)
    assert len(first.builder.bodies) == 4  # what failed has left nothing


INERTIAL = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>'
SIMPLE = '<transmission name="t"><joint name="NAME"/>MORE</transmission></robot>'
GEAR = '<actuator name="m"><mechanicalReduction>0</mechanicalReduction></actuator>'

NEAR = {
    "gazebo": (
        ('<link name="tool"/>', '<link name="tool"/><gazebo reference="tool"><mu1>1</mu1></gazebo>'),
        "gazebo",
        "tool",
    ),
    "safety": (("<dynamics", '<safety_controller k_velocity="1"/><dynamics'), "safety_controller", "shoulder"),
    "calibration": (("<dynamics", '<calibration rising="1"/><dynamics'), "calibration", "shoulder"),
    "texture": (('<color rgba="1 0 0 1"/>', '<texture filename="a.png"/>'), "texture", "red"),
    "unknown tag": (("<dynamics", "<dynamic/><dynamics"), "tag dynamic", "shoulder"),
    "unknown attribute": (('damping="0.5"', 'dampening="0.5"'), "attribute dynamics dampening", "shoulder"),
    "effort 0": (('effort="20"', 'effort="0"'), "effort", "elbow"),
    "velocity 0": (('velocity="1"', 'velocity="0"'), "velocity", "elbow"),
    "no limit": (('<limit lower="0" upper="0.3" effort="20" velocity="1"/>', ""), "limit", "elbow"),
    "equal limits": (('lower="0" upper="0.3"', 'lower="0" upper="0"'), "limit", "elbow"),
    "thin inertia": (('ixx="0.01" iyy="0.01" izz="0.01"', 'ixx="0.01" iyy="0.01" izz="0.03"'), "inertia", "fore"),
    "nothing to see": (('<sphere radius="0.1"/>', '<sphere radius="0"/>'), "visual size", "upper_visual_0"),
    "limit of a plane": (
        ('name="elbow" type="prismatic"', 'name="elbow" type="planar"'),
        "limit of a planar joint",
        "elbow",
    ),
}


@pytest.mark.parametrize("case", NEAR)
def test_what_is_near_is_told_once(case, tmp_path):
    change, element, name = NEAR[case]
    with pytest.warns(ImportedWarning) as told:
        arm = load(tmp_path, change)
    assert [(line.element, line.name) for line in arm.report.near] == [(element, name)]
    assert len(told) == 1
    assert str(told[0].message).startswith(f"arm.urdf: {element} '{name}': ")
    assert told[0].filename == __file__


REFUSED = {
    "geometry": (('<sphere radius="0.1"/>', "<cone/>"), "geometry", "upper"),
    "origin": (('<origin xyz="0 0 0.4"/>', '<origin xyz="0 0 0.4" quat_xyzw="0 0 0 1"/>'), "origin", "elbow"),
    "massless link": ((INERTIAL, ""), "massless link", "fore"),
    "mesh": (('<cylinder radius="0.05" length="0.4"/>', '<mesh filename="gone.stl"/>'), "mesh", "upper: gone.stl"),
    "transmission": (
        ("</robot>", SIMPLE.replace("NAME", "elbow").replace("MORE", '<joint name="shoulder"/>')),
        "transmission",
        "t",
    ),
    "unknown transmission": (("</robot>", SIMPLE.replace("NAME", "elbo").replace("MORE", "")), "transmission", "t"),
    "reduction": (("</robot>", SIMPLE.replace("NAME", "elbow").replace("MORE", GEAR)), "transmission", "t"),
    "flat box": (('box size="0.2 0.2 0.1"', 'box size="0.2 0.2 0"'), "size", "base"),
    "no radius": (('<cylinder radius="0.05"', '<cylinder radius="0"'), "size", "upper"),
    "zero scale": (
        ('<cylinder radius="0.05" length="0.4"/>', '<mesh filename="a.stl" scale="1 0 1"/>'),
        "size",
        "upper",
    ),
    "mimic nobody": (("<dynamics", '<mimic joint="elbo"/><dynamics'), "mimic", "shoulder"),
    "two inertials": (('<link name="fore">', f'<link name="fore">{INERTIAL}'), "repeated element", "fore"),
    "two materials": (
        ('<material name="red"/></visual>', '<material name="red"/><material name="blue"/></visual>'),
        "repeated element",
        "upper",
    ),
    "two shapes": (
        ('<sphere radius="0.1"/>', '<sphere radius="0.1"/><box size="1 1 1"/>'),
        "repeated element",
        "upper",
    ),
    "fixed transmission": (("</robot>", SIMPLE.replace("NAME", "flange").replace("MORE", "")), "transmission", "t"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused_is_told_once(case, tmp_path):
    change, element, name = REFUSED[case]
    with pytest.raises(sw.ModelError) as refused:
        load(tmp_path, change)
    assert str(refused.value).startswith(f"arm.urdf: refused {element} '{name}': ")
    assert str(refused.value).count(f"{element} '{name}'") == 1
    assert "\n" not in str(refused.value)
    with pytest.warns(ImportedWarning) as told:
        arm = load(tmp_path, change, allow=[element])
    assert [(line.element, line.name) for line in arm.report.refused] == [(element, name)]
    assert len(told) == 1
    assert str(told[0].message).startswith(f"arm.urdf: dropped {element} '{name}': ")
    arm.builder.finalize(1, "cpu")


def test_a_massless_link_is_welded_where_allowed(tmp_path):
    with pytest.warns(ImportedWarning):
        arm = load(tmp_path, (INERTIAL, ""), allow=["massless link"])
    assert list(arm.dofs) == ["shoulder"]
    np.testing.assert_allclose(arm.frame("fore").pose.position, (0.0, 0.0, 0.2), atol=1e-15)


def test_what_is_dropped_is_that_part_alone(tmp_path):
    """One kind, several of it: those that are usable stay."""
    more = """<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
      <collision><geometry><box size="0.1 0 0.1"/></geometry></collision></link>
      <transmission name="good"><joint name="elbow"/></transmission>
      <transmission name="bad"><joint name="elbo"/></transmission>"""
    with pytest.warns(ImportedWarning) as told:
        arm = load(tmp_path, ('<link name="tool"/>', f'<link name="tool">{more}'), allow=["size", "transmission"])
    assert [len(arm.shapes[name]) for name in ("base", "upper", "tool_0")] == [1, 1, 1]
    assert "tool_1" not in arm.shapes
    assert [spec.name for spec in arm.actuators] == ["good"]
    assert [(line.element, line.name) for line in arm.report.refused] == [("size", "tool_1"), ("transmission", "bad")]
    assert "did you mean 'elbow'" in str(told[1].message)
    with pytest.warns(ImportedWarning, match="dropped repeated element 'upper'"):
        first = load(tmp_path, *(change for change, _, _ in [REFUSED["two materials"]]), allow=["repeated element"])
    visuals = Visuals(first.builder)
    first.add_visuals(visuals)
    np.testing.assert_allclose(visuals.instances[1].appearance.color, (1.0, 0.0, 0.0))


def test_a_visual_mesh_that_is_not_there_is_dropped_where_allowed(tmp_path):
    gone = ('<sphere radius="0.1"/>', '<mesh filename="gone.obj"/>')
    arm = load(tmp_path, gone)
    visuals = Visuals(arm.builder)
    with pytest.raises(sw.ModelError, match=r"file 'gone\.obj': there must be a file"):
        arm.add_visuals(visuals)
    arm = load(tmp_path, gone, allow=["mesh"])
    with pytest.warns(ImportedWarning, match="dropped visual mesh 'upper_visual_0': file"):
        arm.add_visuals(Visuals(arm.builder))


WRONG = {
    "cut off": ("</robot>\n", "", "well-formed XML"),
    "not a URDF": ("<robot name", "<robots name", "well-formed XML"),
    "another root": (ARM[ARM.index("<robot") :], "<mujoco/>", "root element must be <robot>, got <mujoco>"),
    "entities": ("<robot name", '<!DOCTYPE r [<!ENTITY a "b">]>\n<robot name', "document type or entities"),
    "xacro": ('mass value="2"', 'mass value="$(optenv M)"', "unexpanded xacro.*xacrodoc"),
    "xacro tag": ("<robot name", '<robot xmlns:xacro="http://ros.org/wiki/xacro" name', None),
    "circle": ('<parent link="base"/>', '<parent link="fore"/>', "'shoulder' is part of a circle of 3|root 'base'"),
    "two parents": (
        '<parent link="fore"/><child link="tool"/>',
        '<parent link="base"/><child link="fore"/>',
        "'elbow' holds it too",
    ),
    "two roots": (
        '<link name="tool"/>',
        '<link name="tool"/><link name="other"/>',
        "one link must be the root.*base, other",
    ),
    "unknown parent": (
        '<parent link="fore"/>',
        '<parent link="for"/>',
        "parent must be a link, got 'for'.*did you mean 'fore'",
    ),
    "link twice": (
        '<link name="tool"/>',
        '<link name="tool"/><link name="tool"/>',
        "link 'tool': the name must be unique",
    ),
    "joint twice": ('joint name="flange"', 'joint name="elbow"', "joint 'elbow': the name must be unique"),
    "joint type": ('type="prismatic"', 'type="prismatc"', "type must be one of .*did you mean 'prismatic'"),
    "no child": ('<child link="tool"/>', "", "<joint> of 'flange': must have a <child>"),
    "negative mass": ('mass value="2"', 'mass value="-2"', "<mass> of 'upper': value must not be negative"),
    "no number": ('mass value="2"', 'mass value="two"', "<mass> of 'upper': value must be 1 finite number, got 'two'"),
    "infinite": ('mass value="2"', 'mass value="inf"', "<mass> of 'upper': value must be 1 finite number"),
    "absurd": ('mass value="2"', 'mass value="1e300"', "<mass> of 'upper': value must be 1 finite number"),
    "two numbers": ('xyz="0 0 0.4"', 'xyz="0 0.4"', "<origin> of 'elbow': xyz must be 3 finite numbers"),
    "no moment": (
        ' izz="0.01"/></inertial>\n    <vis',
        "/></inertial>\n    <vis",
        "<inertia> of 'upper': must have the attribute izz",
    ),
    "negative moment": (
        'izz="0.01"/></inertial>\n  </link',
        'izz="-1"/></inertial>\n  </link',
        "link 'fore': principal moments",
    ),
    "zero axis": ('<axis xyz="0 2 0"/>', '<axis xyz="0 0 0"/>', "joint 'shoulder': axis must have a length"),
    "limits exchanged": (
        'lower="-1" upper="2"',
        'lower="2" upper="-1"',
        "joint 'shoulder': limit must have lower < upper",
    ),
    "negative effort": ('effort="30"', 'effort="-30"', "joint 'shoulder': effort must be > 0"),
    "negative radius": (
        'sphere radius="0.1"',
        'sphere radius="-0.1"',
        "<sphere> of 'upper': radius must not be negative",
    ),
    "no geometry": (
        '<geometry><sphere radius="0.1"/></geometry>',
        "<geometry/>",
        "<geometry> of 'upper': must have one of",
    ),
    "mimic itself": (
        "<dynamics",
        '<mimic joint="shoulder"/><dynamics',
        "mimic: must lead to a joint that moves by itself",
    ),
    "mimic a weld": ("<dynamics", '<mimic joint="flange"/><dynamics', "mimic: needs two joints of one coordinate"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_told_in_one_line(case, tmp_path):
    old, new, told = WRONG[case]
    if told is None:
        load(tmp_path, (old, new))  # a name space alone is no xacro
        return
    with pytest.raises(sw.ModelError, match=told) as wrong:
        load(tmp_path, (old, new))
    assert str(wrong.value).startswith("arm.urdf: ")
    assert "\n" not in str(wrong.value)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"base": None}, "base must be 'fixed' or 'floating', got None"),
        ({"base": "free"}, "base must be 'fixed' or 'floating', got 'free'"),
        ({"base": "floating"}, "link 'base' floats, but it has no mass"),
        ({"allow": ["meshs"]}, "allow names 'meshs'.*did you mean 'mesh'"),
        ({"packages": {"a": "/nowhere/at/all"}}, "packages\\['a'\\] must be a folder"),
        ({"packages": "folder"}, "packages must map names to folders"),
        ({"pose": (0, 0, 0)}, "pose"),
    ],
)
def test_wrong_arguments(options, told, tmp_path):
    with pytest.raises(sw.ModelError, match=told):
        load(tmp_path, **options)


def test_wrong_paths(tmp_path):
    with pytest.raises(sw.ModelError, match="there must be a file"):
        load_urdf(tmp_path / "none.urdf", base="fixed")
    (tmp_path / "arm.txt").write_text(ARM)
    with pytest.raises(sw.ModelError, match=r"must end in .urdf or .xml, got 'arm.txt'"):
        load_urdf(tmp_path / "arm.txt", base="fixed")
    (tmp_path / "arm.urdf.xacro").write_text(ARM)
    told = rf"run: pip install xacrodoc, then: xacrodoc {tmp_path}/arm\.urdf\.xacro -o {tmp_path}/arm\.urdf$"
    with pytest.raises(sw.ModelError, match=told):
        load_urdf(tmp_path / "arm.urdf.xacro", base="fixed")


# ---- meshes ----------------------------------------------------------------------------------------------------------

WEDGE = "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
MESH = '<cylinder radius="0.05" length="0.4"/>'


def write_wedge(folder):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "wedge.obj").write_text(WEDGE)


@pytest.mark.parametrize("reference", ["wedge.obj", "package://wedges/wedge.obj", "file://{folder}/wedge.obj"])
def test_meshes_become_hulls(reference, tmp_path):
    write_wedge(tmp_path)
    reference = reference.format(folder=tmp_path)
    arm = load(tmp_path, (MESH, f'<mesh filename="{reference}" scale="1 1 -0.5"/>'), packages={"wedges": tmp_path})
    shape = arm.builder.shapes[arm.shapes["upper"][0]]
    hull = arm.builder.hulls[shape.asset]
    assert shape.type == ShapeType.HULL
    np.testing.assert_allclose(hull.vertices.min(axis=0), (0.0, 0.0, -1.5), atol=1e-12)
    np.testing.assert_allclose(hull.vertices.max(axis=0), (1.0, 2.0, 0.0), atol=1e-12)


def test_a_package_above_the_file_is_found(tmp_path):
    package = tmp_path / "wedges"
    write_wedge(package / "meshes")
    (package / "package.xml").write_text("<package/>")
    (package / "urdf").mkdir()
    for reference in ("package://wedges/meshes/wedge.obj", "../meshes/wedge.obj"):
        load(package / "urdf", (MESH, f'<mesh filename="{reference}"/>'))


@pytest.mark.parametrize(
    ("reference", "told"),
    [
        ("../wedge.obj", "leads out of the folders of the description to .*packages="),
        ("file:///etc/passwd", "leads out of the folders"),
        ("/etc/passwd", "leads out of the folders"),
        ("package://wedges/wedge.obj", "package 'wedges' must be known.*package.xml.*packages="),
        ("package://known/../../wedge.obj", "leads out of the folders"),
        ("http://example.org/wedge.obj", "got http://"),
        ("gone.obj", "there must be a file"),
        ("broken.stl", "broken.stl"),
        ("bomb.dae", "must not declare a document type or entities"),
    ],
)  # fmt: skip
def test_meshes_that_cannot_be_used(reference, told, tmp_path):
    write_wedge(tmp_path)
    folder = tmp_path / "robot"
    folder.mkdir()
    (folder / "broken.stl").write_bytes(b"solid\x00\xff")
    (folder / "bomb.dae").write_text('<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><COLLADA/>')
    with pytest.raises(sw.ModelError, match=told) as wrong:
        load(folder, (MESH, f'<mesh filename="{reference}"/>'), packages={"known": folder})
    assert "\n" not in str(wrong.value)


def test_large_meshes_lose_corners(tmp_path):
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(400, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    lines = [*(f"v {x} {y} {z}" for x, y, z in ball), *(f"f {i} {i + 1} {i + 2}" for i in range(1, 399))]
    (tmp_path / "ball.obj").write_text("\n".join(lines))
    with pytest.warns(ImportedWarning, match="collision mesh 'upper': its convex hull with 64 corners, up to"):
        arm = load(tmp_path, (MESH, '<mesh filename="ball.obj"/>'))
    vertices = arm.builder.hulls[0].vertices
    assert len(vertices) == 64
    # a cap of each corner: the sphere's area over 64 gives a height of 2/64; the farthest-first choice is near that
    depth = 1.0 - (arm.builder.hulls[0].normals * vertices[[f[0] for f in arm.builder.hulls[0].faces]]).sum(axis=1)
    assert depth.max() < 4.0 / 64.0 * 2.0


def test_visuals_are_read_when_shown(tmp_path):
    arm = load(tmp_path, ('<sphere radius="0.1"/>', '<mesh filename="wedge.obj"/>'))
    visuals = Visuals(arm.builder)
    with pytest.raises(sw.ModelError, match="there must be a file"):
        arm.add_visuals(visuals)
    write_wedge(tmp_path)
    visuals = Visuals(arm.builder)
    arm.add_visuals(visuals)
    assert [instance.name for instance in visuals.instances] == ["base", "upper_visual_0"]  # fore and tool show nothing
    np.testing.assert_allclose(visuals.instances[1].appearance.color, (1.0, 0.0, 0.0))


def test_a_mirrored_mesh_keeps_its_outside(tmp_path):
    write_wedge(tmp_path)
    for scale, sign in (("1 1 1", 1.0), ("1 1 -1", 1.0), ("-1 -1 2", 1.0)):
        mesh = f'<mesh filename="wedge.obj" scale="{scale}"/>'
        arm = load(tmp_path, ('<sphere radius="0.1"/>', mesh))
        visuals = Visuals(arm.builder)
        arm.add_visuals(visuals)
        corners = visuals.meshes[0].vertices[visuals.meshes[0].triangles].astype(np.float64)
        volume = np.linalg.det(corners).sum() / 6.0
        assert np.sign(volume) == sign


COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified>
    <unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
  <library_geometries><geometry id="g" name="g"><mesh>
    <source id="p"><float_array id="pa" count="12">0 0 0 100 0 0 0 200 0 0 0 300</float_array>
      <technique_common><accessor source="#pa" count="4" stride="3">
        <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
      </accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene>
  </library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""


def test_collada_tells_its_unit_and_keeps_its_axes(tmp_path):
    (tmp_path / "wedge.dae").write_text(COLLADA)
    arm = load(tmp_path, (MESH, '<mesh filename="wedge.dae"/>'))
    vertices = arm.builder.hulls[0].vertices
    np.testing.assert_allclose(vertices.max(axis=0), (1.0, 2.0, 3.0), rtol=1e-6)


def test_a_mesh_may_become_several_hulls(tmp_path):
    """A prism over an L: its hull fills the notch half, its two parts leave it."""
    outline = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    lines = [f"v {x} {y} {z}" for z in (0, 1) for x, y in outline]
    fan = [(1, k + 1, k + 2) for k in range(1, 5)]
    faces = [*((c, b, a) for a, b, c in fan), *((a + 6, b + 6, c + 6) for a, b, c in fan)]
    for k in range(6):
        a, b = k + 1, (k + 1) % 6 + 1
        faces += [(a, b, b + 6), (a, b + 6, a + 6)]
    (tmp_path / "corner.obj").write_text("\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in faces)]))
    change = (MESH, '<mesh filename="corner.obj"/>')
    whole = load(tmp_path, change)
    quick = {"threshold": 0.05, "seed": 1, "mcts_iterations": 10, "preprocess_mode": "off"}
    parts = load(tmp_path, change, decompose=quick)
    volume = [sum(hull_mass(hull, 1.0).mass for hull in arm.builder.hulls) for arm in (whole, parts)]
    assert len(parts.shapes["upper"]) == len(parts.builder.hulls) > 1
    assert volume[0] == pytest.approx(3.5)
    assert volume[1] == pytest.approx(3.0, rel=0.02)  # coacd cuts to some per cent
    with pytest.raises(sw.ModelError, match="decompose has options that there are not"):
        load(tmp_path, change, decompose={"thresh": 0.05})


# ---- couplings, actuators, other joints ------------------------------------------------------------------------------


def test_a_bare_link_between_joints_is_a_frame(tmp_path):
    """Two crossing hinges: the inertia about both is that of what hangs below."""
    cross = """<link name="cross"/><joint name="roll" type="continuous"><parent link="upper"/><child link="cross"/>
      <axis xyz="1 0 0"/></joint></robot>"""
    elbow = ('type="prismatic">\n    <parent link="upper"/>', 'type="continuous">\n    <parent link="cross"/>')
    arm = load(tmp_path, ("</robot>", cross), elbow)
    assert list(arm.dofs) == ["shoulder", "elbow", "roll"]
    arm.builder.gravity = np.zeros(3)
    sim = sw.Simulation(arm.builder.finalize(2, "cpu"), 1e-3)
    sim.control.joint_force.assign([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    sim.step()
    qd = sim.state.joint_qd.numpy() / 1e-3
    # about its own axis z the forearm has 0.01 kg m² and its centre on the axis, which crosses the shoulder's
    np.testing.assert_allclose(qd[0], [0.0, 100.0, 0.0], rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(qd[1], 0.0)


def test_a_mimicking_joint_is_coupled(tmp_path):
    """elbow = 0.1 shoulder + 0.05: the elbow's inertia is felt by the shoulder, and the file's positions are kept."""
    mimic = (
        'effort="20" velocity="1"/>',
        'effort="20" velocity="1"/><mimic joint="shoulder" multiplier="0.1" offset="0.05"/>',
    )
    upright = ('<origin xyz="0 0 0.2" rpy="0.3 0 0"/>', "")
    arm = load(tmp_path, mimic, upright, ('damping="0.5" friction="0.1"', 'damping="0"'))
    np.testing.assert_allclose(arm.q_from([0.0, 0.05]), [0.0, 0.0])
    np.testing.assert_allclose(arm.qpos_from([0.4, 0.04]), [0.4, 0.09])
    assert arm.builder.joints[1].dofs[0].limit == pytest.approx((-0.05, 0.25))
    arm.builder.gravity = np.zeros(3)
    sim = sw.Simulation(arm.builder.finalize(1, "cpu"), 1e-3)
    sim.control.joint_force.assign([[1.0, 0.0]])
    sim.step()
    # about y: upper arm 0.02, forearm 0.01 + 1 kg at 0.45 m (its place as built), and 1 kg along the arm at 0.1 m/rad
    inertia = 0.02 + 0.01 + 0.45**2 + 0.1**2
    np.testing.assert_allclose(sim.state.joint_qd.numpy()[0] / 1e-3, [1.0 / inertia, 0.1 / inertia], rtol=1e-5)


def test_transmissions_are_actuators(tmp_path):
    text = """<transmission name="drive"><type>transmission_interface/SimpleTransmission</type>
      <joint name="shoulder"><hardwareInterface>hardware_interface/EffortJointInterface</hardwareInterface></joint>
      <actuator name="motor"><mechanicalReduction>50</mechanicalReduction></actuator></transmission></robot>"""
    arm = load(tmp_path, ("</robot>", text))
    (motor,) = arm.actuators
    assert (motor.name, motor.terms, motor.force_range) == ("motor", ((0, 50.0),), (-0.6, 0.6))
    with pytest.warns(ImportedWarning, match="transmission 'drive': its control is an effort, in place of PositionJ"):
        load(tmp_path, ("</robot>", text.replace("Effort", "Position")))


def test_a_capsule_is_held(tmp_path):
    arm = load(tmp_path, (MESH, '<capsule radius="0.05" length="0.4"/>'))
    shape = arm.builder.shapes[arm.shapes["upper"][0]]
    assert (shape.type, *shape.size[:2]) == (ShapeType.CAPSULE, 0.05, 0.2)


def test_planar_and_floating_joints(tmp_path):
    limit = ('<limit lower="0" upper="0.3" effort="20" velocity="1"/>', "")
    planar = load(tmp_path, ('type="prismatic"', 'type="planar"'), limit)
    assert planar.dofs == {"shoulder": 0, "elbow": 1}
    assert planar.builder.dof_count == 4
    floating = load(tmp_path, ('type="prismatic"', 'type="floating"'), limit)
    np.testing.assert_allclose(floating.qpos_from(np.zeros(7))[1:], [0, 0, 0, 1, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(floating.coordinates.initial, [0, 0, 0, 0.5, 1, 0, 0, 0], atol=1e-12)


def test_a_base_with_mass_is_a_body_that_its_neighbours_do_not_meet(tmp_path):
    heavy = ('<link name="base">', f'<link name="base">{INERTIAL}')
    found = []
    for changes, bodies in (((), 2), ((heavy,), 3)):
        counts = []
        for height in (-1.0, 0.0):
            arm = load(tmp_path, *changes)
            arm.builder.add_shape_plane(pose=sw.pose((0.0, 0.0, height)))
            sim = sw.Simulation(arm.builder.finalize(1, "cpu"), 1e-3)
            sim.step()
            counts.append(int(sim.contacts.contact_count.numpy()[0]))
        assert len(arm.bodies) == bodies
        assert arm.mass == 3.0 + len(changes)
        # the base and the upper arm overlap as built, but only the arm and the higher ground meet
        assert counts[0] == 0
        assert counts[1] > 0
        found.append(counts)
    assert found[0] == found[1]
