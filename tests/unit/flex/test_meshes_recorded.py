"""Flexible meshes in recordings: shapes at every frame, in GLB files and scenes of POV-Ray."""

import json
import re
import struct

import numpy as np
import pytest

import simwarp as sw
from simwarp.exporters import SceneRecording, save_scene
from simwarp.sensors import Visuals
from tests.unit.flex.test_meshes_seen import RUBBER, bend, sheet

FRAMES = 4


class Recorded:
    """A sheet and a cube that are bent from frame to frame, the second world's recorded."""

    def __init__(self) -> None:
        builder = sw.ModelBuilder()
        self.sheet = sheet(builder, cells=3)
        box = sw.flex.box((0.2, 0.2, 0.2), (1, 1, 1))
        self.cube = builder.add_solid_mesh("cube", box, material=RUBBER, pose=sw.pose((0.0, 0.0, 2.0)), radius=0.01)
        visuals = Visuals(builder)
        visuals.show(self.sheet, color=(0.2, 0.6, 0.9))
        model = builder.finalize(world_count=2, device="cpu")
        self.sim = sw.Simulation(model, dt=1e-3)
        self.recording = SceneRecording(self.sim, visuals.finalize(model), world=1)
        self.shapes: dict[str, list[np.ndarray]] = {"sheet": [], "cube": []}
        for frame in range(FRAMES):
            bend(self.sim, self.sheet, lambda p, k=frame: p + np.outer(p[:, 0] ** 2, (0.1 * k, 0.0, 0.3 * k)), [1])
            bend(self.sim, self.cube, lambda p, k=frame: p * (1.0, 1.0 + 0.2 * k, 1.0) + (0.0, 0.3 * k, 2.0), [1])
            self.recording.add(0.1 * frame)
            for mesh in (self.sheet, self.cube):
                places = self.sim.state.body_x.numpy()[1, list(mesh.bodies)]
                self.shapes[mesh.name].append(mesh.surface.vertices(places))

    def placed(self, node, frame):
        """World places of a recorded node's vertices."""
        corners = np.c_[node.shapes[frame], np.ones(len(node.shapes[frame]))]
        return (corners @ node.track.matrix(frame).T)[:, :3]


@pytest.fixture(scope="module")
def recorded():
    return Recorded()


def test_shapes_are_those_of_the_nodes_at_every_frame(recorded):
    nodes = {node.name: node for node in recorded.recording.nodes()}
    assert {"sheet", "cube"} <= set(nodes)
    assert not [name for name in nodes if "sphere" in name]
    for name, shapes in recorded.shapes.items():
        for frame, shape in enumerate(shapes):
            assert np.abs(recorded.placed(nodes[name], frame) - shape).max() < 1e-6


def test_a_glb_has_the_shapes_as_targets(recorded, tmp_path):
    save_scene(recorded.recording, tmp_path / "scene.glb")
    content = (tmp_path / "scene.glb").read_bytes()
    length = struct.unpack("<I", content[12:16])[0]
    tree = json.loads(content[20 : 20 + length])
    data = content[28 + length :]

    def values(index):
        accessor = tree["accessors"][index]
        view = tree["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(data, "<f4", accessor["count"] * width, start).reshape(-1, width)

    animation = tree["animations"][0]
    for name, shapes in recorded.shapes.items():
        index, node = next((k, node) for k, node in enumerate(tree["nodes"]) if node.get("name") == name)
        primitive = tree["meshes"][node["mesh"]]["primitives"][0]
        assert "NORMAL" not in primitive["attributes"]
        base = values(primitive["attributes"]["POSITION"])
        assert len(primitive["targets"]) == FRAMES - 1
        samplers = {
            channel["target"]["path"]: animation["samplers"][channel["sampler"]]
            for channel in animation["channels"] if channel["target"]["node"] == index
        }  # fmt: skip
        weights = values(samplers["weights"]["output"]).reshape(FRAMES, FRAMES - 1)
        assert np.allclose(values(samplers["weights"]["input"])[:, 0], [0.0, 0.1, 0.2, 0.3])
        for frame, shape in enumerate(shapes):
            found = base + sum(
                weight * values(target["POSITION"])
                for weight, target in zip(weights[frame], primitive["targets"], strict=True)
            )
            place = values(samplers["translation"]["output"])[frame] if "translation" in samplers else 0.0
            if "translation" not in samplers:
                place = np.array(node["translation"])
            assert np.abs(found + place - shape).max() < 1e-6


def test_a_scene_for_pov_ray_has_the_triangles_of_every_frame(recorded, tmp_path):
    save_scene(recorded.recording, tmp_path / "scene.pov")
    frames = (tmp_path / "scene-frames.inc").read_text()
    assert frames.count("#declare Shape[0] = mesh2") == frames.count("#declare Shape[1] = mesh2") == FRAMES
    scene = (tmp_path / "scene.pov").read_text()
    assert "object { Shape[0] " in scene
    assert "object { Shape[1] " in scene
    # the last frame's first shape, vertex by vertex
    text = frames.split("#declare Shape[0] = mesh2 { vertex_vectors { ")[-1].split("}")[0]
    found = np.array([[float(n) for n in part.split(",")] for part in re.findall(r"<([^>]*)>", text)])
    node = recorded.recording.nodes()[0]
    assert np.abs(found - node.shapes[-1]).max() < 1e-6
