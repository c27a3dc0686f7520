"""MJCF element by element: one altered file per row of the table; each near or refused item is named exactly once."""

import re
import warnings

import numpy as np
import pytest

import simwarp as sw
from simwarp.importers import load_mjcf
from simwarp.importers.report import ImportedWarning

pytest.importorskip("mujoco")
pytest.importorskip("lxml")

BASE = """<mujoco model="base"><compiler angle="radian"/>{option}{asset}{default}
<worldbody><light pos="0 0 3"/><geom name="floor" type="plane" size="2 2 .1"/>
<body name="trunk" pos="0 0 1" {trunk}>{top}<geom name="box" type="box" size=".2 .1 .1" {geom}/>
<site name="s0" pos="0 0 .2"/>
<body name="leg" pos="0 0 -.2">{hip}<geom name="rod" type="capsule" fromto="0 0 0 0 0 -.3" size=".03" {rod}/>
<site name="s1" pos="0 0 -.3"/><camera name="eye" mode="{mode}"/>
<body name="foot" pos="0 0 -.3"><joint name="ankle" axis="0 1 0" {ankle}/><geom name="ball" size=".05" {ball}/>
</body></body>
</body>{world}</worldbody>{rest}</mujoco>"""
PARTS = {
    "option": "", "asset": "", "default": "", "trunk": "", "top": '<freejoint name="root"/>', "geom": "", "rod": "",
    "hip": '<joint name="hip" axis="0 1 0"/>', "ankle": "", "ball": "", "mode": "fixed", "world": "", "rest": "",
}  # fmt: skip


def model_file(folder, **parts):
    path = folder / "model.xml"
    path.write_text(BASE.format(**PARTS | parts))
    return path


def load_quietly(path, **options):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        robot = load_mjcf(path, **options)
    return robot, [str(one.message) for one in told if issubclass(one.category, ImportedWarning)]


def test_a_plain_file_is_held_without_a_word(tmp_path):
    robot, told = load_quietly(model_file(tmp_path))
    assert told == []
    assert not robot.report.near
    assert not robot.report.refused
    assert set(robot.bodies) == {"trunk", "leg", "foot"}
    assert robot.dofs == {"root": 0, "hip": 6, "ankle": 7}
    assert set(robot.sites) == {"s0", "s1"}
    assert {line.element for line in robot.report.held} >= {"body", "joint free", "joint hinge", "geom box", "contact"}


def actuator(text):
    return f"<actuator>{text}</actuator>"


def equality(text):
    return f"<equality>{text}</equality>"


TENDON = (
    '<tendon><fixed name="pull" {0}><joint joint="hip" coef="1"/><joint joint="ankle" coef="-.5"/></fixed></tendon>'
)

WRAP = '<site site="s0"/><geom geom="ball"/><site site="s1"/>'

NEAR = {
    "joint solref": ({"ankle": 'range="-1 1" limited="true" solreflimit=".03 1"'}, "ankle"),
    "joint solref of friction": ({"ankle": 'frictionloss=".1" solreffriction=".03 1"'}, "ankle"),
    "joint margin": ({"ankle": 'range="-1 1" limited="true" margin=".1"'}, "ankle"),
    "geom margin": ({"ball": 'margin=".01"'}, "ball"),
    "geom solref": ({"ball": 'solref=".03 1"'}, "ball"),
    "geom contype": ({"ball": 'contype="-2147483648"'}, "ball"),
    "equality connect": ({"rest": equality('<connect name="tie" body1="foot" body2="trunk" anchor="0 0 0"/>')}, "tie"),
    "equality weld": ({"rest": equality('<weld name="tie" body1="foot"/>')}, "tie"),
    "equality joint": ({"rest": equality('<joint name="tie" joint1="hip" joint2="ankle"/>')}, "tie"),
    "equality inactive": ({"rest": equality('<weld name="tie" body1="foot" active="false"/>')}, "tie"),
    "actuator position": ({"rest": actuator('<position name="servo" joint="hip" kp="20"/>')}, "servo"),
    "actuator velocity": ({"rest": actuator('<velocity name="servo" joint="hip" kv="2"/>')}, "servo"),
    "tendon solref": ({"rest": TENDON.format('range="-1 1" limited="true" solreflimit=".03 1"')}, "pull"),
    "tendon margin": ({"rest": TENDON.format('range="-1 1" limited="true" margin=".1"')}, "pull"),
    "camera mode": ({"mode": "track"}, "eye"),
    "sensor clock": ({"rest": '<sensor><clock name="watch"/></sensor>'}, "watch"),
    "option integrator": ({"option": '<option integrator="RK4"/>'}, "rk4"),
    "option impratio": ({"option": '<option impratio="10"/>'}, "option impratio"),
    "option cone": ({"option": '<option cone="pyramidal"/>'}, "pyramidal"),
    "option noslip_iterations": ({"option": '<option noslip_iterations="3"/>'}, "option noslip_iterations"),
    "pair margin": ({"rest": '<contact><pair name="meet" geom1="box" geom2="ball" margin=".1"/></contact>'}, "meet"),
    "pair solref": ({"rest": '<contact><pair name="meet" geom1="box" geom2="ball" solref=".03 1"/></contact>'}, "meet"),
}  # fmt: skip

REFUSED = {
    "mocap": ({"world": '<body name="puppet" mocap="true"><geom name="tip" size=".01"/></body>'}, "puppet"),
    "free joint law": ({"top": '<joint type="free" name="root" frictionloss="1"/>'}, "root"),
    "ball range": ({"hip": '<joint name="hip" type="ball" range="0 1" limited="true"/>'}, "hip"),
    "gravcomp": ({"trunk": 'gravcomp="1"'}, "trunk"),
    "density": ({"option": '<option density="1.2"/>'}, "density"),
    "viscosity": ({"option": '<option viscosity="1e-5"/>'}, "viscosity"),
    "wind": ({"option": '<option wind="1 0 0"/>'}, "wind"),
    "muscle": ({"rest": actuator('<muscle name="biceps" joint="hip" lengthrange="0 1"/>')}, "biceps"),
    "cylinder": ({"rest": actuator('<cylinder name="piston" joint="hip"/>')}, "piston"),
    "damper": ({"rest": actuator('<damper name="brake" joint="hip" kv="1" ctrlrange="0 1"/>')}, "brake"),
    "adhesion": ({"rest": actuator('<adhesion name="glue" body="foot" ctrlrange="0 1"/>')}, "glue"),
    "slidercrank": (
        {"rest": actuator('<motor name="crank" cranksite="s1" slidersite="s0" cranklength=".5"/>')}, "crank"
    ),
    "actuator on ball or free joint": ({"rest": actuator('<motor name="push" joint="root" gear="1 0 0 1"/>')}, "push"),
    "actuator armature": ({"rest": actuator('<motor name="push" joint="hip" armature=".1"/>')}, "push"),
    "delay": ({"rest": actuator('<motor name="push" joint="hip" delay=".01" nsample="3"/>')}, "push"),
    "spatial tendon": (
        {"rest": f'<tendon><spatial name="rope">{WRAP}</spatial></tendon>'},
        "rope",
    ),
    "tendon actuatorfrcrange": ({"rest": TENDON.format('actuatorfrcrange="-1 1"')}, "pull"),
    "equality polycoef": (
        {"rest": equality('<joint name="tie" joint1="hip" joint2="ankle" polycoef="0 1 .5 0 0"/>')}, "tie"
    ),
    "dampingpoly": ({"ankle": 'damping="1 .1"'}, "ankle"),
    "stiffnesspoly": ({"ankle": 'stiffness="1 .1"'}, "ankle"),
}  # fmt: skip


def times_named(name, texts):
    """How often a name stands in texts as a whole."""
    return sum(len(re.findall(rf"(?<![\w-]){re.escape(name)}(?![\w-])", text)) for text in texts)


@pytest.mark.parametrize("row", NEAR)
def test_what_is_near_is_named_once(tmp_path, row):
    parts, name = NEAR[row]
    robot, told = load_quietly(model_file(tmp_path, **parts))
    assert len(told) == 1
    assert times_named(name, told) == 1
    (line,) = robot.report.near
    assert row.startswith(line.element)
    robot.builder.finalize(1, "cpu")


@pytest.mark.parametrize("row", REFUSED)
@pytest.mark.sweep
def test_what_is_refused_is_named_once_and_dropped_on_request(tmp_path, row):
    parts, name = REFUSED[row]
    path = model_file(tmp_path, **parts)
    with pytest.raises(sw.ModelError) as caught:
        load_mjcf(path)
    line = str(caught.value)
    assert "\n" not in line
    before, _, remedy = line.partition("; change the file, or drop them with allow=")
    assert times_named(name, [before]) == 1
    assert remedy == f"[{row!r}]"
    robot, told = load_quietly(path, allow=[row])
    assert len(told) == 1
    assert "dropped " + row in told[0]
    assert [each.element for each in robot.report.refused] == [row]
    robot.builder.finalize(1, "cpu")


def test_a_dropped_tendon_takes_its_actuator_along(tmp_path):
    rope, _ = REFUSED["spatial tendon"]
    path = model_file(tmp_path, rest=rope["rest"] + actuator('<motor name="winch" tendon="rope"/>'))
    robot, told = load_quietly(path, allow=["spatial tendon"])
    assert robot.actuators == ()
    assert times_named("winch", told) == 1


def test_kinds_that_do_not_exist_are_no_excuse(tmp_path):
    with pytest.raises(sw.ModelError, match=r"allow names 'mussel', which is never refused; did you mean 'muscle'\?"):
        load_mjcf(model_file(tmp_path), allow=["mussel"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<mujoco><worldbody>", "must be well-formed XML"),
        ("<mujoco><include file='model.xml'/></mujoco>", "includes itself"),
        ("<mujoco><include file='gone.xml'/></mujoco>", "gone.xml"),
        ("<!DOCTYPE m [<!ENTITY a 'b'>]><mujoco>&a;</mujoco>", "entities must not be declared"),
        (("<mujoco><asset><mesh name='m' file='gone.stl'/></asset><worldbody><geom type='mesh' mesh='m'/></worldbody>"
         "</mujoco>"),
         "gone.stl"),
        (("<mujoco><worldbody><body><joint/><inertial pos='0 0 0' mass='0' diaginertia='0 0 0'/></body>"
         "</worldbody></mujoco>"),
         "mass and inertia of moving bodies must be larger"),
        ("<mujoco><worldbody><body><joint/><geom size='nan'/></body></worldbody></mujoco>", "cannot compile"),
        ("<mujoco><worldbody><body><joint/><geom size='1e300'/></body></worldbody></mujoco>",
         "mass and inertia must be finite"),
        ("<robot name='r'/>", "the root must be <mujoco>, got <robot>; read URDF with load_urdf"),
        ("", "well-formed"),
    ],
)  # fmt: skip
def test_malformed_files_give_one_line(tmp_path, text, words):
    path = tmp_path / "model.xml"
    path.write_text(text)
    with pytest.raises(sw.ModelError) as caught:
        load_mjcf(path).builder.finalize(1, "cpu")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_old_mujoco_is_one_line(tmp_path, monkeypatch):
    import mujoco

    monkeypatch.setattr(mujoco, "__version__", "3.3.0")
    with pytest.raises(sw.ModelError, match=r"load_mjcf needs mujoco 4\.0 or later, got 3\.3\.0; run: pip install -U"):
        load_mjcf(model_file(tmp_path))


def test_files_outside_the_folder_are_named(tmp_path):
    (tmp_path / "near").mkdir()
    (tmp_path / "floor.xml").write_text(
        '<mujoco><worldbody><geom name="f" type="plane" size="1 1 1"/></worldbody></mujoco>'
    )
    path = tmp_path / "near" / "model.xml"
    path.write_text('<mujoco><include file="../floor.xml"/></mujoco>')
    robot, told = load_quietly(path)
    assert len(told) == 1
    assert "'../floor.xml'" in told[0]
    assert set(robot.shapes) == {"f"}


def test_a_builder_is_left_alone_by_a_file_that_is_refused(tmp_path):
    builder = sw.ModelBuilder()
    builder.add_body("mine", mass=1.0, inertia=(1, 1, 1))
    with pytest.raises(sw.ModelError):
        load_mjcf(model_file(tmp_path, rest=equality('<joint name="tie" joint1="hip" polycoef="0 1 1 0 0"/>')), builder)
    assert [body.name for body in builder.bodies] == ["mine"]
    assert builder.joints == []


def test_two_of_a_kind_stand_beside_each_other_in_one_builder(tmp_path):
    path = model_file(tmp_path)
    first = load_mjcf(path, prefix="a/")
    second = load_mjcf(path, first.builder, prefix="b/", pose=sw.pose((2, 0, 0), (0, 0, np.sin(0.5), np.cos(0.5))))
    assert second.builder is first.builder
    assert second.dofs["b/hip"] == first.coordinates.dof_count + 6
    ours = [first.builder.bodies[robot.bodies[name]].pose for robot, name in ((first, "a/foot"), (second, "b/foot"))]
    assert np.allclose(ours[1].position - ours[0].position, (2, 0, 0))
    model = first.builder.finalize(1, "cpu")
    sim = sw.Simulation(model, 1e-3)
    qpos = np.array([0.5, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.3, -0.2])
    q = np.concatenate([first.q_from(qpos), second.q_from(qpos)[second.coordinates.dof_count - 8 :]])
    sim.set_joint_state(np.array([True]), q[None], np.zeros((1, 16)))
    place = sim.state.body_x.numpy()[0]
    assert np.allclose(place[first.bodies["a/foot"]], place[second.bodies["b/foot"]], atol=1e-6)


def test_a_mesh_becomes_its_convex_parts_on_request(tmp_path):
    """Two cubes apart in one mesh; what stands between them touches the one hull and none of the parts."""
    import trimesh

    pair = trimesh.util.concatenate([
        trimesh.creation.box(extents=(1.0, 1.0, 1.0)).apply_translation((side, 0.0, 0.0)) for side in (-2.0, 2.0)
    ])  # fmt: skip
    pair.export(tmp_path / "pair.stl")
    text = """<mujoco><asset><mesh name="m" file="pair.stl" inertia="exact"/></asset><worldbody>
      <body name="b"><freejoint/><geom name="g" type="mesh" mesh="m"/></body></worldbody></mujoco>"""
    file = tmp_path / "pair.xml"
    file.write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole, parts = load_mjcf(file), load_mjcf(file, decompose={"threshold": 0.05, "max_convex_hull": 4})
    assert len(whole.shapes["g"]) == 1
    assert len(parts.shapes["g"]) >= 2
    builder = parts.builder
    reach = [np.ptp(builder.hulls[builder.shapes[slot].asset].vertices[:, 0]) for slot in parts.shapes["g"]]
    assert max(reach) < 1.1
    assert sum(reach) < 2.5
