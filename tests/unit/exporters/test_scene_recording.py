"""Recorded scenes in files: a GLB read back by trimesh and by its own tables, a scene that POV-Ray renders."""

from __future__ import annotations

import json
import math
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import trimesh

import simwarp as sw
from simwarp import sensors, viewer
from simwarp.core.files import FileError
from simwarp.core.rotation import matrix_of
from simwarp.exporters import SceneRecording, save_scene
from simwarp.geometry.visual_mesh import VisualMesh
from simwarp.motions import JointMotion, Motions, Sine

DT, EVERY, FRAMES = 0.005, 8, 12
Y_UP = np.array([(1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)])
COLORS = np.array([[(1.0, 0.5, 0.0)] * 3, [(0.0, 0.5, 1.0)] * 3] * 2, np.float32)


class Rig:
    """A swinging arm of all primitives, a free coloured tetrahedron and a ground, in two worlds."""

    def __init__(self) -> None:
        builder = sw.ModelBuilder()
        arm = builder.add_body("arm", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.0, 0.0, 1.0)))
        builder.add_joint_revolute(
            "hinge", sw.WORLD, arm, axis=(0, 1, 0), anchor=(0, 0, 1.2), drive=sw.PrescribedPosition()
        )
        top = builder.add_body(
            "top", mass=1.0, inertia=(0.1, 0.2, 0.3), pose=sw.pose((0.5, 0.3, 1.9), (0.2, 0.1, 0.3, 0.9))
        )
        builder.add_shape_plane(name="ground")
        visuals = sensors.Visuals(builder)
        side = sw.pose((0.1, 0.05, -0.1), (0.3, 0.2, 0.1, 0.9))
        visuals.add_box(arm, half=(0.1, 0.2, 0.05), name="box", pose=side, color=(0.9, 0.2, 0.1))
        visuals.add_capsule(arm, radius=0.06, half_length=0.2, name="rod", color=(0.1, 0.2, 0.8))
        visuals.add_cylinder(arm, radius=0.1, half_length=0.03, name="wheel", pose=sw.pose((0.0, 0.0, -0.3)))
        visuals.add_cone(arm, radius=0.1, half_length=0.1, name="tip", pose=sw.pose((0.2, 0.0, -0.3)))
        visuals.add_ellipsoid(arm, half=(0.2, 0.1, 0.15), name="egg", pose=sw.pose((-0.2, 0.1, 0.0)))
        corners = 0.2 * np.array([(1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0)])
        faces = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)])
        visuals.add_mesh(top, VisualMesh(vertices=corners, triangles=faces, color=COLORS), name="stone")
        visuals.add_box(sw.WORLD, half=(0.1, 0.1, 0.1), name="block", pose=sw.pose((-0.6, 0.2, 0.1)))
        visuals.add_sphere(sw.WORLD, radius=0.1, name="lamp", pose=sw.pose((-0.6, 0.2, 0.4)))
        self.model = builder.finalize(2, "cpu")
        self.scene = visuals.finalize(self.model, per_world=["enabled"])
        motions = Motions(self.model, [JointMotion(joint="hinge", function=Sine(amplitude=[0.2, 0.9], frequency=1.0))])
        self.sim = sw.Simulation(self.model, DT, elements=[motions], threads=1)
        self.sim.state.body_omega[1, top] = (3.0, 8.0, 2.0)  # three quarters of a turn in the end
        shot = viewer.Shot(body="arm", target=(0.0, 0.0, 0.0), eye=(-1.6, -2.4, 1.1))
        self.recording = SceneRecording(self.sim, self.scene, world=1, shot=shot, size=(480, 320))
        self.poses: list[dict[str, Any]] = []
        enabled: Any = self.scene.enabled
        for frame in range(FRAMES):
            if frame == 5:
                enabled[1, self.scene.instance("lamp")] = 0
            self.recording.add(frame * EVERY * DT)
            self.poses.append({name: self.pose(index) for index, name in enumerate(self.scene.names)})
            if frame < FRAMES - 1:
                self.sim.step(EVERY)

    def pose(self, instance: int) -> np.ndarray:
        """Rigid motion (4, 4) of an instance in the recorded world, from the state and the scene."""
        body = int(self.scene.body[instance])
        own = frame_of(self.scene.x.numpy()[0, instance], self.scene.rot.numpy()[0, instance])
        if body < 0:
            return own
        state = self.sim.state
        return frame_of(state.body_x.numpy()[1, body], state.body_rot.numpy()[1, body]) @ own


def frame_of(position: Any, rotation: Any) -> np.ndarray:
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = matrix_of(np.asarray(rotation, np.float64)), position
    return frame


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig()


class Glb:
    """A GLB file by the tables of its format (glTF 2.0, sections 4.4 and 5.2)."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        magic, version, length = struct.unpack("<4sII", data[:12])
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack("<I4s", data[12:20])
        assert kind == b"JSON"
        self.tree = json.loads(data[20 : 20 + size])
        size_of_binary, kind = struct.unpack("<I4s", data[20 + size : 28 + size])
        assert kind == b"BIN\0"
        self.binary = data[28 + size : 28 + size + size_of_binary]
        self.names = [node.get("name") for node in self.tree["nodes"]]

    def numbers(self, index: int) -> np.ndarray:
        """Of an accessor of floats."""
        accessor = self.tree["accessors"][index]
        view = self.tree["bufferViews"][accessor["bufferView"]]
        assert accessor["componentType"] == 5126
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        values = np.frombuffer(self.binary, "<f4", accessor["count"] * width, view.get("byteOffset", 0))
        return values.reshape(-1, width)

    def channels(self, name: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Times and values of what moves of a node."""
        (animation,) = self.tree["animations"]
        found = {}
        for channel in animation["channels"]:
            if channel["target"]["node"] == self.names.index(name):
                sampler = animation["samplers"][channel["sampler"]]
                found[channel["target"]["path"]] = self.numbers(sampler["input"])[:, 0], self.numbers(sampler["output"])
        return found

    def transform(self, name: str, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Rigid motion in the file's root, and the scale, at a time between two frames."""
        node, moves = self.tree["nodes"][self.names.index(name)], self.channels(name)
        parts = {}
        for path in ("translation", "rotation", "scale"):
            parts[path] = np.array(node[path])
            if path in moves:
                times, values = moves[path]
                parts[path] = np.array([np.interp(time, times, column) for column in values.T])
        rotation = parts["rotation"] / np.linalg.norm(parts["rotation"])
        return frame_of(parts["translation"], rotation), parts["scale"]


@pytest.fixture(scope="module")
def glb(rig, tmp_path_factory) -> Glb:
    path = tmp_path_factory.mktemp("scene") / "arm.glb"
    assert save_scene(rig.recording, path) == [path]
    return Glb(path)


def test_nodes_of_a_glb_are_where_the_bodies_are_at_every_frame(rig, glb):
    for frame in range(FRAMES):
        for name, pose in rig.poses[frame].items():
            if name != "ground":
                found, _ = glb.transform(name, frame * EVERY * DT)
                # float32 of a metre, and of a quaternion
                assert np.abs(found - pose).max() < 1e-5, (frame, name)


def test_the_animation_is_as_long_as_the_recording_and_holds_only_what_moves(rig, glb):
    for name in ("box", "rod", "wheel", "tip", "egg", "stone", "camera"):
        assert "scale" not in glb.channels(name)
        assert name == "camera" or "rotation" in glb.channels(name)
        times, _ = glb.channels(name)["translation"]
        assert np.allclose(times, EVERY * DT * np.arange(FRAMES), atol=1e-6)
    assert times[-1] == pytest.approx((FRAMES - 1) * EVERY * DT)
    assert glb.channels("block") == glb.channels("ground 0") == {}
    assert list(glb.channels("lamp")) == ["scale"]
    times, scale = glb.channels("lamp")["scale"]
    assert np.allclose(scale[:5], 0.1)
    assert (scale[5:] <= 1e-6).all()
    (animation,) = glb.tree["animations"]
    for sampler in animation["samplers"]:
        assert {"min", "max"} <= glb.tree["accessors"][sampler["input"]].keys()


def test_a_rotation_never_goes_the_long_way_round(glb):
    for name in ("box", "stone"):
        _, turns = glb.channels(name)["rotation"]
        assert ((turns[1:] * turns[:-1]).sum(axis=1) > 0.0).all()
        assert np.allclose(np.linalg.norm(turns, axis=1), 1.0, atol=1e-6)


def test_trimesh_reads_the_first_frame_with_sizes_and_colours(rig, tmp_path):
    path = tmp_path / "arm.glb"
    save_scene(rig.recording, path)
    scene: Any = trimesh.load(path)
    sizes = {
        "box": (0.1, 0.2, 0.05), "wheel": (0.1, 0.1, 0.03), "egg": (0.2, 0.1, 0.15), "tip": (0.1, 0.1, 0.1),
        "rod": (0.06, 0.06, 0.26), "block": (0.1, 0.1, 0.1),
    }  # fmt: skip
    for name, half in sizes.items():
        matrix, geometry = scene.graph[name]
        placed = Y_UP @ rig.poses[0][name]
        points = trimesh.transformations.transform_points(scene.geometry[geometry].vertices, matrix)
        local = trimesh.transformations.transform_points(points, np.linalg.inv(placed))
        # circles of 20 sides: cos(pi / 20) = 0.988 across corners, the slenderness of a capsule to 0.01
        assert np.allclose(np.abs(local).max(axis=0), half, rtol=0.02), name
    box = scene.geometry[scene.graph["box"][1]].visual.material
    assert np.allclose(np.array(box.baseColorFactor)[:3] / 255.0, (0.9, 0.2, 0.1), atol=0.005)
    stone = scene.geometry[scene.graph["stone"][1]]
    assert {tuple(color) for color in np.unique(stone.visual.vertex_attributes["color"][:, :3], axis=0)} == {
        (255, 128, 0), (0, 128, 255)
    }  # fmt: skip


def test_the_camera_of_the_file_sees_what_that_of_the_recording_sees(rig, glb):
    """Along -z with y up, as glTF has it."""
    track = rig.recording.camera_track()
    for frame in (0, FRAMES - 1):
        found, _ = glb.transform("camera", frame * EVERY * DT)
        axes = matrix_of(track.turns[frame])
        assert np.allclose(-found[:3, 2], axes[:, 0], atol=1e-5)
        assert np.allclose(found[:3, 1], axes[:, 2], atol=1e-5)
        assert np.allclose(found[:3, 3], track.places[frame], atol=1e-5)
    (camera,) = glb.tree["cameras"]
    assert camera["perspective"]["aspectRatio"] == pytest.approx(1.5)
    assert 2.0 * math.atan(1.5 * math.tan(0.5 * camera["perspective"]["yfov"])) == pytest.approx(0.7)


def rendered_by_povray(files: list[Path], frame: int, *declared: str) -> np.ndarray:
    """(height, width, 4) of a frame."""
    out = files[0].with_suffix(".png")
    done = subprocess.run(
        ["povray", files[0].name, "+W480", "+H320", "+UA", "-A", "-D", f"+O{out}", f"Declare=Frame={frame}", *declared],
        cwd=files[0].parent, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return np.asarray(PIL.Image.open(out).convert("RGBA"))


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("povray") is None, reason="povray is not installed: apt-get install povray")
def test_povray_draws_the_silhouettes_of_our_own_picture(rig, tmp_path):
    files = save_scene(rig.recording, tmp_path / "arm.pov")
    picture = rendered_by_povray(files, FRAMES - 1, "Declare=Fixed=0")
    track, camera = rig.recording.camera_track(), rig.recording.camera.camera
    camera.render(rig.sim.state, [sw.pose(track.places[-1], track.turns[-1])])
    instances = camera.outputs["instance"].numpy()[0, ..., 0]
    ours = (instances >= 0) & (rig.scene.body[instances] >= 0)
    theirs = picture[..., 3] > 127
    assert ours.mean() > 0.03
    # circles of 20 sides cover 0.984 of theirs; most of what is seen has none
    assert (ours & theirs).sum() / (ours | theirs).sum() >= 0.98
    whole = rendered_by_povray(files, 0)
    assert (whole[..., 3] == 255).all()  # ground and sky are everywhere
    assert not np.array_equal(whole, rendered_by_povray(files, FRAMES - 1))
    subprocess.run(
        ["povray", "arm.ini", "+W48", "+H32", "-D", "-A"], cwd=tmp_path, capture_output=True, timeout=300, check=True
    )
    assert len(list(tmp_path.glob("arm[0-9]*.png"))) == FRAMES


def test_a_povray_scene_has_a_camera_lights_meshes_and_the_frames(rig, tmp_path):
    files = save_scene(rig.recording, tmp_path / "arm.pov")
    assert [path.name for path in files] == ["arm.pov", "arm-frames.inc", "arm.ini"]
    scene, frames, settings = (path.read_text() for path in files)
    for word in ("camera {", "light_source {", "mesh2 {", '#include "arm-frames.inc"', "texture_list { 2,"):
        assert word in scene
    assert frames.count("#case (") == frames.count("#declare Eye") == FRAMES
    assert frames.count("#declare Pose[0] =") == FRAMES
    assert f"Final_Frame={FRAMES - 1}\n" in settings
    assert "Final_Clock=0.44\n" in settings
    assert scene.count("{") == scene.count("}")


def test_a_file_that_cannot_be_written_is_one_line(rig, tmp_path):
    with pytest.raises(sw.ModelError, match=r"^save_scene: the name must end in .glb or .pov, got 'arm.obj'; give"):
        save_scene(rig.recording, "arm.obj")
    with pytest.raises(FileError, match=r"folder .* does not exist"):
        save_scene(rig.recording, tmp_path / "none" / "arm.glb")
    empty = SceneRecording(rig.sim, rig.scene)
    with pytest.raises(sw.ModelError, match="save_scene: there must be a frame, got none"):
        save_scene(empty, tmp_path / "arm.glb")
