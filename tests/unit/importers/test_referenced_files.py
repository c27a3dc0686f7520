"""Files that a robot's file names: a FIFO is never opened, a link that leads to itself is one line, in every format."""

from __future__ import annotations

import contextlib
import os
import threading
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import simwarp as sw
from simwarp.importers import load_mjcf, load_solidworks, load_step, load_urdf, load_usd
from simwarp.importers.report import ImportedWarning
from simwarp.sensors.scene import Visuals

MESH_GEOM = '<geom type="mesh" mesh="m"/>'
LIGHT_MESH = (
    '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><geom type="mesh" mesh="m" contype="0" conaffinity="0"/>'
)
CUBE = " ".join(f'file{side}="BAD.png"' for side in ("up", "down", "left", "right", "front", "back"))
MJCF = {
    "mesh": ('<mesh name="m" file="BAD.stl"/>', MESH_GEOM),
    "mesh in a folder": ('<mesh name="m" file="BAD.stl"/>', MESH_GEOM, '<compiler meshdir="assets"/>'),
    "mesh without its path": (
        '<mesh name="m" file="x/BAD.stl"/>',
        MESH_GEOM,
        '<compiler meshdir="assets" strippath="true"/>',
    ),
    "mesh that only shows": ('<mesh name="m" file="BAD.stl"/>', LIGHT_MESH),
    "texture": ('<texture name="t" type="2d" file="BAD.png"/>', '<geom size=".1"/>'),
    "faces of a cube": (f'<texture name="t" type="cube" {CUBE}/>', '<geom size=".1"/>'),
    "heights": ('<hfield name="h" file="BAD.png" size="1 1 1 1"/>', '<geom size=".1"/>'),
    "include": ("", '<geom size=".1"/>', '<include file="BAD.xml"/>'),
    "attached model": ('<model name="x" file="BAD.xml"/>', '<geom size=".1"/>'),
    "mesh of an attached model": ('<model name="x" file="sub.xml"/>', '<attach model="x" body="b" prefix="p"/>'),
}
URDF = {
    "collision": '<collision><geometry><mesh filename="BAD.stl"/></geometry></collision>',
    "visual": '<visual><geometry><mesh filename="BAD.stl"/></geometry></visual>',
    "materials": '<visual><geometry><mesh filename="materials.obj"/></geometry></visual>',
    "texture": '<visual><geometry><mesh filename="texture.obj"/></geometry></visual>',
    "buffer": '<visual><geometry><mesh filename="buffer.gltf"/></geometry></visual>',
}
OBJ = "mtllib {}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\nf 1/1 2/1 4/1\nf 2/1 3/1 4/1\n"
GLTF = """{"asset": {"version": "2.0"}, "buffers": [{"uri": "BAD.bin", "byteLength": 36}], "bufferViews": [{"buffer": 0,
"byteLength": 36}], "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}], "meshes":
[{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}"""
LAYER = """#usda 1.0
(
    subLayers = [@BAD.usda@]
)
def Xform "a" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
{
    float physics:mass = 1
}
"""


@contextlib.contextmanager
def nobody_opens(folder: Path, kind: str) -> Iterator[None]:
    """Puts the bad file of every ending there; who waits for a FIFO is set free, and the test fails."""
    places = [folder / f"BAD.{ending}" for ending in ("stl", "png", "xml", "mtl", "bin", "usda", "step", "py")]
    (folder / "assets").mkdir()
    places.append(folder / "assets" / "BAD.stl")
    opened: list[str] = []
    done = threading.Event()
    for place in places:
        os.mkfifo(place) if kind == "fifo" else place.symlink_to(place.name)

    def rescue() -> None:
        while not done.wait(0.05):
            for place in places if kind == "fifo" else ():
                with contextlib.suppress(OSError):  # nobody reads it
                    os.close(os.open(place, os.O_WRONLY | os.O_NONBLOCK))
                    opened.append(place.name)

    thread = threading.Thread(target=rescue, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
    assert opened == []


def shown(load: Callable[[], sw.importers.Imported]) -> None:
    """Everything of a robot, what only shows included."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ImportedWarning)
        robot = load()
        robot.add_visuals(Visuals(robot.builder))


def is_one_line(load: Callable[[], sw.importers.Imported]) -> None:
    with pytest.raises(sw.ModelError) as refused:
        shown(load)
    assert "\n" not in str(refused.value)
    assert any(name in str(refused.value) for name in ("BAD", "texture.obj", "buffer.gltf")), refused.value


@pytest.mark.parametrize("kind", ["fifo", "loop"])
@pytest.mark.parametrize("case", MJCF)
def test_files_of_mjcf(case: str, kind: str, tmp_path: Path) -> None:
    asset, geom, top = (*MJCF[case], "")[:3]
    text = f"<mujoco>{top}<asset>{asset}</asset><worldbody><body><freejoint/>{geom}</body></worldbody></mujoco>"
    if case == "mesh of an attached model":
        text = text.replace("<body><freejoint/>", "<frame>").replace("</body>", "</frame>")
    (tmp_path / "m.xml").write_text(text)
    (tmp_path / "sub.xml").write_text(
        '<mujoco><asset><mesh name="m" file="BAD.stl"/></asset><worldbody><body name="b"><geom type="mesh" mesh="m"/>'
        "</body></worldbody></mujoco>"
    )
    with nobody_opens(tmp_path, kind):
        is_one_line(lambda: load_mjcf(tmp_path / "m.xml"))


@pytest.mark.parametrize("kind", ["fifo", "loop"])
@pytest.mark.parametrize("case", URDF)
def test_files_of_urdf(case: str, kind: str, tmp_path: Path) -> None:
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
    (tmp_path / "r.urdf").write_text(f'<robot name="r"><link name="a">{inertial}{URDF[case]}</link></robot>')
    (tmp_path / "materials.obj").write_text(OBJ.format("BAD.mtl"))
    (tmp_path / "texture.obj").write_text(OBJ.format("good.mtl"))
    (tmp_path / "good.mtl").write_text("newmtl m\nmap_Kd BAD.png\n")
    (tmp_path / "buffer.gltf").write_text(GLTF)
    with nobody_opens(tmp_path, kind):
        is_one_line(lambda: load_urdf(tmp_path / "r.urdf", base="floating"))


@pytest.mark.parametrize("kind", ["fifo", "loop"])
def test_layers_of_usd(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    (tmp_path / "s.usda").write_text(LAYER)
    with nobody_opens(tmp_path, kind):
        is_one_line(lambda: load_usd(tmp_path / "s.usda"))


@pytest.mark.parametrize("kind", ["fifo", "loop"])
def test_the_file_itself(kind: str, tmp_path: Path) -> None:
    with nobody_opens(tmp_path, kind):
        is_one_line(lambda: load_mjcf(tmp_path / "BAD.xml"))
        is_one_line(lambda: load_urdf(tmp_path / "BAD.xml", base="fixed"))
        is_one_line(lambda: load_step(tmp_path / "BAD.step", density=1000.0))
        is_one_line(lambda: load_solidworks(tmp_path / "BAD.py"))
        is_one_line(lambda: load_usd(tmp_path / "BAD.usda"))
