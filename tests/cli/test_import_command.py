"""`simwarp import`: which reader a file gets, what is told, saved and drawn, and one line for whatever is wrong."""

import json
import shlex

import numpy as np
import pytest
from PIL import Image

from simwarp import cli
from simwarp.importers import load_robot

MJCF = """<mujoco><option timestep="0.004"/><worldbody><body name="cart">
<joint name="slide" type="slide" axis="1 0 0" range="-1 2"/><geom name="box" type="box" size=".2 .1 .1" mass="3"/>
<body name="pole"><joint name="hinge" axis="0 1 0" damping=".1"/>
<geom name="rod" type="capsule" fromto="0 0 0 0 0 1" size=".02" mass=".5"/></body></body></worldbody>
<actuator><motor name="push" joint="slide" ctrlrange="-5 5"/></actuator>
<sensor><clock name="now"/></sensor><keyframe><key name="home" qpos="0.5 1"/></keyframe></mujoco>"""

URDF = """<robot name="two"><link name="base"><inertial><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><mass value="1.5"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><box size="1 .1 .1"/></geometry></visual></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="2" effort="7" velocity="3"/></joint></robot>"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a robot of both formats, in which the command runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cart.xml").write_text(MJCF)
    (tmp_path / "two.urdf").write_text(URDF)
    (tmp_path / "two.xml").write_text(URDF)
    return tmp_path


def run(capfd, *arguments):
    """Exit code, standard output, standard error."""
    code = cli.main(["import", *arguments])
    out, err = capfd.readouterr()
    return code, out, err


def test_results_for_scripts(folder, capfd):
    code, out, err = run(capfd, "cart.xml", "--json", "-")
    assert code == 0
    found = json.loads(out)
    assert found["bodies"] == {"cart": 0, "pole": 1}
    assert found["dofs"] == {"slide": 0, "hinge": 1}
    assert found["mass"] == 3.5
    assert found["joints"][0] == {"name": "slide", "type": "prismatic", "dof": 0, "limits": [[-1.0, 2.0]]}
    assert found["joints"][1]["limits"] == [None]
    assert found["actuators"] == ["push"]
    assert found["timestep"] == 0.004
    assert {"element": "joint hinge", "name": "hinge", "reason": ""} in found["held"]
    assert [(line["element"], line["name"]) for line in found["near"]] == [("sensor clock", "now")]
    assert found["refused"] == []
    assert 0.0 < found["wall_s"] < 600.0
    assert "ImportedWarning" not in err  # what is near stands in the table


def test_tables_for_people(folder, capfd):
    code, out, _ = run(capfd, "cart.xml")
    assert code == 0
    assert "3.5 kg in 2 bodies" in out
    assert "2 coordinates of 2 joints, 1 actuators" in out
    assert "-1 to 2 m" in out
    assert "-5 to 5" in out
    rows = [line.split()[:2] for line in out.splitlines() if line[:5] in ("held ", "near ")]
    assert [row[0] for row in rows] == ["held"] * (len(rows) - 1) + ["near"]
    assert "simwarp import cart.xml --save cart.json" in out
    assert "simwarp new-task my-cart --robot cart.xml" in out


def test_the_content_tells_the_reader_of_an_xml_file(folder, capfd):
    assert json.loads(run(capfd, "two.xml", "--base", "fixed", "--json", "-")[1])["format"] == "URDF"
    assert json.loads(run(capfd, "cart.xml", "--json", "-")[1])["format"] == "MJCF"
    found = json.loads(run(capfd, "two.urdf", "--base", "floating", "--json", "-")[1])
    assert found["dof_count"] == 7
    assert found["masses"] == {"base": 2.0, "arm": 1.5}


def test_a_saved_robot_is_imported_again(folder, capfd):
    code, out, _ = run(capfd, "cart.xml", "--save", "cart.json")
    assert code == 0
    assert 'sw.importers.load_robot("cart.json")' in out
    assert list(load_robot("cart.json").keyframes) == ["home"]
    first = json.loads(run(capfd, "cart.xml", "--json", "-")[1])
    again = json.loads(run(capfd, "cart.json", "--json", "-")[1])
    for key in ("bodies", "dofs", "mass", "held", "near", "refused", "joints"):
        assert again[key] == first[key]
    assert again["format"] == "saved robot"


def test_a_picture_shows_the_robot(folder, capfd, monkeypatch):
    asked = []

    def portrait(visuals, q):
        asked.append(([instance.name for instance in visuals.instances], q))
        return np.zeros((3, 4, 3), np.uint8)

    monkeypatch.setattr("simwarp.viewer.portrait", portrait)
    code, out, _ = run(capfd, "cart.xml", "--picture", "cart.png")
    assert code == 0
    assert "wrote cart.png" in out
    assert Image.open("cart.png").size == (4, 3)
    run(capfd, "two.urdf", "--base", "fixed", "--picture", "two.png")
    assert asked[0][1].tolist() == [0.5, 1.0]  # the keyframe
    assert asked[1][1] is None
    assert any("arm" in name for name in asked[1][0])  # its visual


def test_what_is_refused_is_dropped_on_request(folder, capfd):
    text = MJCF.replace("<actuator>", '<actuator><muscle name="flex" joint="slide"/>')
    (folder / "cart.xml").write_text(text)
    code, out, err = run(capfd, "cart.xml")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert "'flex'" in err
    kinds: list[str] = []
    while code == 2 and len(kinds) < 4:  # as the errors ask for it
        kinds += shlex.split(err.rpartition("--allow ")[2])
        code, out, err = run(capfd, "cart.xml", "--json", "-", "--allow", *kinds)
    assert code == 0
    assert {line["name"] for line in json.loads(out)["refused"]} <= {"", "flex"}
    assert {line["element"] for line in json.loads(out)["refused"]} == set(kinds)


def test_a_density_gives_the_mass_that_the_file_does_not_tell(folder, capfd):
    """The error of the command names the option, and with it the robot loads; the next command repeats it."""
    inertial = URDF[URDF.index('<link name="arm">') + len('<link name="arm">') : URDF.index("<visual>")]
    (folder / "two.urdf").write_text(URDF.replace(inertial, "", 1))
    code, out, err = run(capfd, "two.urdf", "--base", "fixed")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert "massless link 'arm'" in err
    assert "add --density 1000 (kg/m³) for mass by its geometry" in err
    code, out, _ = run(capfd, "two.urdf", "--base", "fixed", "--density", "1000", "--json", "-")
    assert code == 0
    assert json.loads(out)["masses"] == {"base": 2.0, "arm": pytest.approx(10.0, rel=1e-12)}
    code, out, _ = run(capfd, "two.urdf", "--base", "fixed", "--density", "1000")
    assert "simwarp new-task my-two --robot two.urdf --base fixed --density 1000" in out
    assert 'load_urdf("two.urdf", base="fixed", density=1000)' in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "usage: simwarp import FILE"),
        (("none.xml",), "there must be a file, got 'none.xml'"),
        (("two.urdf",), "does not tell whether its root is welded to the world; add --base fixed or --base floating"),
        (("two.urdf", "--base", "loose"), "--base must be fixed or floating, got 'loose'"),
        (("cart.xml", "--base", "fixed"), "--base is for URDF, 'cart.xml' is MJCF; leave it away"),
        (("cart.xml", "--density", "3"), "--density is for URDF, STEP, 'cart.xml' is MJCF"),
        (("two.urdf", "--base", "fixed", "--packages", "here"), "--packages must be NAME=FOLDER, got 'here'"),
        (("two.urdf", "--base", "fixed", "--packages", "a=none"), "packages['a'] must be a folder"),
        (("robot.obj",), "no reader is for 'robot.obj'; files end in .xml, .mjcf, .urdf"),
        (("robot.xacro",), "pip install xacrodoc, then: xacrodoc robot.xacro -o robot.urdf"),
        (("page.xml",), "first element must be <mujoco> (MJCF) or <robot> (URDF), got <html>"),
        (("broken.xml",), "must be well-formed XML"),
        (("cart.xml", "--allow", "muscel"), "did you mean 'muscle'"),
        (("cart.xml", "--save", "cart.txt"), "the name must end in .json"),
        (("cart.xml", "--picture", "cart.jpg"), "the name must end in .png"),
        (("cart.xml", "--picture", "gone/cart.png"), "folder gone does not exist"),
        (("cart.xml", "--save", "cart.xml"), "--save would overwrite 'cart.xml'"),
        (("model.json",), "format: must be 'simwarp model'"),
        (("cart.xml", "--pictures", "a.png"), "did you mean --picture?"),
    ],
)
def test_mistakes_get_one_line(folder, capfd, arguments, message):
    (folder / "page.xml").write_text("<html/>")
    (folder / "broken.xml").write_text("<mujoco>")
    (folder / "model.json").write_text("{}")
    for name in ("robot.obj", "robot.xacro"):
        (folder / name).write_text("")
    before = sorted(folder.iterdir())
    code, out, err = run(capfd, *arguments)
    assert code == 2
    assert message in err
    assert err.count("\n") == 1
    assert out == ""
    assert sorted(folder.iterdir()) == before


def with_meshes(folder, references):
    """A URDF whose arm has collision meshes."""
    parts = "".join(f'<collision><geometry><mesh filename="{one}"/></geometry></collision>' for one in references)
    (folder / "two.urdf").write_text(URDF.replace("<visual>", f"{parts}<visual>"))


def test_a_package_that_is_not_there_is_asked_for_once(folder, capfd):
    with_meshes(folder, [f"package://arms/meshes/part_{number}.stl" for number in range(7)])
    code, _, err = run(capfd, "two.urdf", "--base", "fixed")
    assert (code, err.count("\n")) == (2, 1)
    assert "--packages arms=FOLDER" in err
    assert "packages=" not in err
    assert (err.count("part_"), err.count("and 5 more")) == (2, 1)
    assert len(err) < 450


def test_a_mesh_that_is_not_there_is_named_once(folder, capfd):
    with_meshes(folder, ["meshes/gone.stl"])
    code, _, err = run(capfd, "two.urdf", "--base", "fixed")
    assert (code, err.count("gone.stl")) == (2, 1)
    assert f"there must be a file of this name in '{folder / 'meshes'}'" in err


def test_xml_that_is_cut_off_is_placed_once(folder, capfd):
    (folder / "two.urdf").write_text("<robot>\n<link name=x>")
    err = run(capfd, "two.urdf", "--base", "fixed")[2]
    assert err.count("line 2") == 1
    assert "<string>" not in err


def test_joints_without_limits_get_a_line(folder, capfd):
    (folder / "two.urdf").write_text(URDF.replace('lower="-1" upper="2" ', ""))
    assert "warning    1 joint has no limits: turn" in run(capfd, "two.urdf", "--base", "fixed")[1]
    assert "warning" not in run(capfd, "two.xml", "--base", "fixed")[1]


def test_a_reader_that_is_not_there_is_named(folder, capfd, monkeypatch):
    monkeypatch.delattr("simwarp.importers.load_mjcf")
    code, _, err = run(capfd, "cart.xml")
    assert code == 2
    assert "reading MJCF is not part of this installation" in err


def test_help(capfd):
    code, out, _ = run(capfd, "--help")
    assert code == 0
    assert "--picture" in out


def test_overlaps_and_passed_limits_are_named(folder, capfd):
    """Three boxes of 0.3 m every 0.1 m: the outer two are 0.1 m in each other, and one starts outside its limits."""
    box = '<collision><geometry><box size=".3 .2 .2"/></geometry></collision>'
    inertial = '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = "".join(f'<link name="l{index}">{inertial}{box}</link>' for index in range(3))
    joints = "".join(
        f'<joint name="j{index}" type="revolute"><parent link="l{index - 1}"/><child link="l{index}"/>'
        f'<origin xyz=".1 0 0"/><axis xyz="0 1 0"/><limit lower="{low}" upper="2" effort="1" velocity="1"/></joint>'
        for index, low in ((1, -1), (2, 0.5))
    )
    (folder / "wrong.urdf").write_text(f'<robot name="wrong">{links}{joints}</robot>')
    found = json.loads(run(capfd, "wrong.urdf", "--base", "floating", "--json", "-")[1])
    (overlap,) = found["overlaps"]
    assert overlap["bodies"] == ["l0", "l2"]
    assert overlap["depth"] == pytest.approx(0.1, abs=1e-6)
    assert found["outside_limits"] == [{"joint": "j2", "dof": 7, "value": 0.0, "lower": 0.5, "upper": 2.0}]
    out = " ".join(run(capfd, "wrong.urdf", "--base", "floating")[1].split())
    assert "overlaps 'l0' and 'l2' by 100 mm; --self-collision overlapping-off" in out
    assert "outside joint 'j2' is at 0 rad, outside 0.5 to 2" in out
    for choice, count in (("off", 0), ("overlapping-off", 0), ("adjacent-off", 1), ("on", 3)):
        words = ("wrong.urdf", "--base", "floating", "--self-collision", choice, "--json", "-")
        assert len(json.loads(run(capfd, *words)[1])["overlaps"]) == count


def test_self_collision_is_one_of_four_words(folder, capfd):
    code, _, err = run(capfd, "two.urdf", "--base", "fixed", "--self-collision", "maybe")
    assert code == 2
    assert len(err.splitlines()) == 1
    assert "overlapping-off" in err
