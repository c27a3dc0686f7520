"""`--export-scene` of `simwarp play` and `simwarp drive`: files with the motion that the command records."""

import json
import struct
from typing import Any

import numpy as np
import pytest
import trimesh

from simwarp.vehicle.results.channels import Run


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def translation(path, name):
    """Times and places of a node (glTF 2.0)."""
    data = path.read_bytes()
    size = struct.unpack("<I", data[12:16])[0]
    tree, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    number = next(k for k, node in enumerate(tree["nodes"]) if node.get("name") == name)
    (animation,) = tree["animations"]
    target = {"node": number, "path": "translation"}
    channel = next(each for each in animation["channels"] if each["target"] == target)
    sampler = animation["samplers"][channel["sampler"]]

    def floats(index):
        accessor = tree["accessors"][index]
        offset = tree["bufferViews"][accessor["bufferView"]]["byteOffset"]
        width = 1 if accessor["type"] == "SCALAR" else 3
        return np.frombuffer(binary, "<f4", accessor["count"] * width, offset).reshape(-1, width)

    return floats(sampler["input"])[:, 0], floats(sampler["output"])


def test_play_writes_a_scene(folder, command):
    code, out, err = command("play", "ant", "--seconds", "0.4", "--export-scene", "ant.glb", "--json", "ant.json")
    assert code == 0, err
    assert "wrote ant.glb" in out
    content = json.loads((folder / "ant.json").read_text())
    assert (content["file"], "video" in content) == ("ant.glb", False)
    times, places = translation(folder / "ant.glb", "torso")
    assert np.allclose(times, 0.04 * np.arange(11), atol=1e-6)  # 25 frames per second
    assert 0.01 < np.linalg.norm(places[-1] - places[0]) < 4.0
    scene: Any = trimesh.load(folder / "ant.glb")
    assert "torso" in scene.graph.nodes_geometry
    code, _, err = command(
        "play", "ant", "--seconds", "0.1", "--export-scene", "ant.pov", "--worlds", "1", "--num-envs", "2"
    )
    assert code == 0, err
    assert {path.name for path in folder.glob("*.pov")} | {path.name for path in folder.glob("*.i*")} == {
        "ant.pov", "ant-frames.inc", "ant.ini"
    }  # fmt: skip


def test_drive_writes_a_scene_that_goes_where_its_record_says(folder, command):
    (folder / "go.csv").write_text("t_s,throttle\n0,0.7\n1,0.7\n")
    code, out, err = command(
        "drive", "artcar", "--maneuver", "go.csv", "--csv", "run.csv", "--export-scene", "car.glb", "--json", "car.json"
    )
    assert code == 0, err
    assert "wrote car.glb" in out
    assert json.loads((folder / "car.json").read_text())["file"] == "car.glb"
    run = Run.read(folder / "run.csv")
    times, places = translation(folder / "car.glb", "body")
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(1.0, abs=0.041)
    way = np.interp(times, run["t_s"], run["x_m"]) - run["x_m"][0]
    # the body pitches by a degree or two about the point that the record is about, a few centimetres from its middle
    assert np.abs(places[:, 0] - places[0, 0] - way).max() < 0.005
    assert way[-1] > 0.3
