"""GlTF 2.0 with an animation: meshes and nodes by trimesh, samplers of the nodes' poses here."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.files import write_file
from simwarp.exporters.scene_recording import SceneRecording, Track
from simwarp.geometry.mesh_files import GlbMesh, GlbNode, glb_bytes
from simwarp.viewer.live.batches import multiplied

ROOT: Final = "z_up"
"""Node of all others: its axes are ours, x forward, y to the left, z up; those of glTF have y up."""
Y_UP: Final = ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
CAMERA: Final = "camera"
FORWARD: Final = np.array((0.5, -0.5, -0.5, 0.5))
"""Turns a camera of glTF, which looks along -z with y up, into one that looks along x with z up."""
PATHS: Final = {"translation": "places", "rotation": "turns", "scale": "scales"}
Shapes: TypeAlias = npt.NDArray[np.float32]
TYPES: Final = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
FLOAT: Final = 5126


def write_gltf(recording: SceneRecording, path: Path) -> list[Path]:
    """Writes a GLB file; see `save_scene`."""
    nodes = recording.nodes()
    meshes: dict[Any, GlbMesh] = {}
    placed = [GlbNode(ROOT, np.array(Y_UP))]
    shapes: dict[str, tuple[str, Shapes]] = {}
    for node in nodes:
        key: Any = (id(node.mesh), node.color) if node.shapes is None else id(node)
        if key not in meshes:
            mesh, name = node.mesh, f"mesh {len(meshes)}"
            first = mesh.vertices if node.shapes is None else node.shapes[0]
            smooth = mesh.smooth or node.shapes is not None  # vertices of what deforms stay one each
            meshes[key] = GlbMesh(name, first, mesh.faces, mesh.color, node.color, smooth)
            if node.shapes is not None:
                shapes[node.name] = (name, node.shapes)
        placed.append(GlbNode(node.name, node.track.matrix(0), ROOT, meshes[key].name))
    camera = _camera_track(recording)
    placed.append(GlbNode(CAMERA, camera.matrix(0), ROOT))
    tracks = {node.name: node.track for node in nodes} | {CAMERA: camera}

    def finish(buffers: dict[Any, bytes], tree: dict[str, Any]) -> None:
        _add_camera(recording, tree)
        _animate(np.array(recording.times), tracks, shapes, buffers, tree)

    write_file(path, glb_bytes(list(meshes.values()), placed, finish))
    return [path]


def _camera_track(recording: SceneRecording) -> Track:
    """Of the camera as glTF has it."""
    track = recording.camera_track()
    return dataclasses.replace(track, turns=multiplied(track.turns, np.broadcast_to(FORWARD, track.turns.shape)))


def _add_camera(recording: SceneRecording, tree: dict[str, Any]) -> None:
    config, fov = recording.camera.camera.config, recording.camera.fov
    ratio = config.width / config.height
    vertical = 2.0 * math.atan(math.tan(0.5 * fov) / ratio)
    view = {"aspectRatio": ratio, "yfov": vertical, "znear": 0.01, "zfar": config.far}
    tree["cameras"] = [{"type": "perspective", "name": CAMERA, "perspective": view}]
    _node(tree, CAMERA)["camera"] = 0


def _node(tree: dict[str, Any], name: str) -> dict[str, Any]:
    found: dict[str, Any] = next(node for node in tree["nodes"] if node.get("name") == name)
    return found


def _animate(
    times: npt.NDArray[np.float64], tracks: dict[str, Track], shapes: dict[str, tuple[str, Shapes]],
    buffers: dict[Any, bytes], tree: dict[str, Any],
) -> None:  # fmt: skip
    """Gives nodes their translation, rotation and scale of the first frame, and what changes of them a sampler; meshes
    that deform the shapes of all later frames as targets, of which each frame shows its own.
    """
    index = {node.get("name"): number for number, node in enumerate(tree["nodes"])}
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    clock = -1
    for name, track in tracks.items():
        node = _node(tree, name)
        node.pop("matrix", None)
        for path, values in PATHS.items():
            given = getattr(track, values)
            node[path] = given[0].astype(np.float32).tolist()
            if not track.moves(values):
                continue
            if clock < 0:
                clock = _accessor(times[:, None], buffers, tree)
            samplers.append({"input": clock, "output": _accessor(given, buffers, tree), "interpolation": "LINEAR"})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": index[name], "path": path}})
    for name, (mesh, frames) in shapes.items():
        if len(frames) < 2:
            continue
        _add_targets(mesh, frames, buffers, tree)
        if clock < 0:
            clock = _accessor(times[:, None], buffers, tree)
        weights = np.eye(len(frames))[:, 1:].reshape(-1, 1)
        samplers.append({"input": clock, "output": _accessor(weights, buffers, tree), "interpolation": "LINEAR"})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": index[name], "path": "weights"}})
    if channels:
        tree["animations"] = [{"name": "simulation", "samplers": samplers, "channels": channels}]


def _add_targets(mesh: str, frames: Shapes, buffers: dict[Any, bytes], tree: dict[str, Any]) -> None:
    """Targets of a mesh: changes of its vertices from the first frame to each later one.

    Normals are left out: readers then give each triangle its own, as it is at every frame.
    """
    found = next(each for each in tree["meshes"] if each["name"] == mesh)
    primitive = found["primitives"][0]
    primitive["attributes"].pop("NORMAL", None)
    changes = (frames[1:].astype(np.float64) - frames[0]).astype(np.float32)
    primitive["targets"] = [{"POSITION": _accessor(change, buffers, tree)} for change in changes]
    found["weights"] = [0.0] * len(changes)


def _accessor(values: npt.NDArray[np.floating], buffers: dict[Any, bytes], tree: dict[str, Any]) -> int:
    """Puts (F, n) numbers into a buffer of their own; returns the index of their accessor."""
    data = values.astype("<f4")
    buffers[("animation", len(buffers))] = data.tobytes()
    accessors = tree["accessors"]
    accessors[("animation", len(accessors))] = {
        "bufferView": len(buffers) - 1, "componentType": FLOAT, "count": len(data), "type": TYPES[data.shape[1]],
        "min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist(),
    }  # fmt: skip
    return len(accessors) - 1
