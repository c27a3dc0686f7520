"""Scenes for POV-Ray: meshes, lights and a camera, poses of every frame, and the settings of the animation.

`povray NAME.ini` renders all frames, `povray NAME.pov Declare=Frame=7` one of them. `Declare=Fixed=0` leaves out the
sky and what no body carries.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np

from simwarp.core.files import check_output, write_file
from simwarp.core.rotation import matrix_of
from simwarp.exporters.scene_recording import SceneNode, SceneRecording, Track
from simwarp.viewer.live.page_meshes import Triangles

SUN_DISTANCE: Final = 1.0e5
"""Of a parallel light from the origin [m]."""


def write_povray(recording: SceneRecording, path: Path) -> list[Path]:
    """Writes a scene, its frames and its settings; see `save_scene`."""
    files = [path, path.with_name(f"{path.stem}-frames.inc"), path.with_suffix(".ini")]
    for file in files[1:]:
        check_output(file, "save_scene")
    nodes = recording.nodes()
    moving = [node for node in nodes if any(node.track.moves(name) for name in ("places", "turns", "scales"))]
    write_file(files[1], _frames(recording, moving, [node for node in nodes if node.shapes is not None]))
    write_file(files[2], _settings(recording, path))
    write_file(files[0], _scene(recording, nodes, moving, files[1].name))
    return files


def _settings(recording: SceneRecording, path: Path) -> str:
    """Settings of the animation."""
    config, last = recording.camera.camera.config, len(recording.times) - 1
    lines = {
        "Input_File_Name": path.name, "Width": config.width, "Height": config.height, "Antialias": "On",
        "Initial_Frame": 0, "Final_Frame": last, "Initial_Clock": f"{recording.times[0]:.9g}",
        "Final_Clock": f"{recording.times[-1]:.9g}",
    }  # fmt: skip
    return "".join(f"{key}={value}\n" for key, value in lines.items())


def _scene(recording: SceneRecording, nodes: list[SceneNode], moving: list[SceneNode], frames: str) -> str:
    """Lights, camera, meshes and objects; what moves has its pose from the file of the frames."""
    config = recording.camera.camera.config
    width = 2.0 * math.tan(0.5 * recording.camera.fov)
    height = width * config.height / config.width
    parts = [
        "#version 3.7;",
        "#ifndef (Frame) #declare Frame = frame_number; #end",
        "#ifndef (Fixed) #declare Fixed = 1; #end",
        f'#include "{frames}"',
        *_lights(recording),
        # the axes of the image are given one by one: world axes are right-handed, those of POV-Ray's own camera are not
        f"camera {{ location Eye direction Forward right {width:.9g} * Right up {height:.9g} * Up }}",
    ]  # fmt: skip
    deforming = [node for node in nodes if node.shapes is not None]
    shapes = {id(node): f"Shape[{number}]" for number, node in enumerate(deforming)}
    meshes: dict[int, str] = {}
    for node in nodes:
        if id(node.mesh) not in meshes and id(node) not in shapes:
            meshes[id(node.mesh)] = f"Mesh{len(meshes)}"
            parts.append(f"#declare {meshes[id(node.mesh)]} = {_mesh(node.mesh)}")
    places = {id(node): number for number, node in enumerate(moving)}
    for node in nodes:
        number = places.get(id(node))
        pose = _pose(node.track, 0) if number is None else f"transform {{ Pose[{number}] }}"
        paint = "" if node.mesh.color is not None else f" pigment {{ color rgb {_vector(node.color)} }}"
        shape = shapes.get(id(node)) or meshes[id(node.mesh)]
        text = f"object {{ {shape} {pose}{paint} }} // {node.name}"
        parts.append(f"#if (Fixed)\n{text}\n#end" if node.fixed else text)
    return "\n".join(parts) + "\n"


def _lights(recording: SceneRecording) -> list[str]:
    """Suns, lamps, light of the sky on all surfaces, and the sky; colours are linear."""
    lighting: Any = recording.lighting
    ambient = 0.5 * (np.array(lighting.ambient) + np.array(lighting.ambient_below))
    shadowless = "" if lighting.shadows else " shadowless"
    below = lighting.horizon if lighting.below is None else lighting.below
    sky = f"[0.5 color rgb {_vector(below)}] [0.5 color rgb {_vector(lighting.horizon)}]"
    sky += f" [1 color rgb {_vector(lighting.sky)}]"
    lines = [
        f"global_settings {{ assumed_gamma 1.0 ambient_light rgb {_vector(ambient)} }}",
        "#default { finish { ambient 1 diffuse 1 } }",
        "#if (Fixed)",
        f"sky_sphere {{ pigment {{ gradient z color_map {{ {sky} }} scale 2.001 translate -1.0005 * z }} }}",
        "#end",
    ]
    for sun in lighting.suns:
        place = SUN_DISTANCE * np.array(sun.direction) / np.linalg.norm(sun.direction)
        light = f"{_vector(place)} color rgb {_vector(sun.color)} parallel point_at <0, 0, 0>"
        lines.append(f"light_source {{ {light}{shadowless} }}")
    for lamp in lighting.lamps:
        fade = "fade_distance 1 fade_power 2"
        color = 0.5 * np.array(lamp.color)  # POV-Ray halves the light at the fade distance
        lines.append(f"light_source {{ {_vector(lamp.position)} color rgb {_vector(color)} {fade}{shadowless} }}")
    return lines


def _frames(recording: SceneRecording, moving: list[SceneNode], deforming: list[SceneNode]) -> str:
    """The camera, the poses of what moves and the triangles of what deforms, by the number of the frame."""
    camera = recording.camera_track()
    lines = [f"#declare Pose = array[{max(len(moving), 1)}]"]
    if deforming:
        lines.append(f"#declare Shape = array[{len(deforming)}]")
    lines.append("#switch (Frame)")
    for frame in range(len(recording.times)):
        forward, left, up = matrix_of(camera.turns[frame]).T
        lines += [
            f"#case ({frame})",
            f"#declare Eye = {_vector(camera.places[frame])}; #declare Forward = {_vector(forward)};",
            f"#declare Right = {_vector(-left)}; #declare Up = {_vector(up)};",
            *(
                f"#declare Pose[{number}] = transform {{ {_pose(node.track, frame)} }}"
                for number, node in enumerate(moving)
            ),
            *(
                f"#declare Shape[{number}] = {_mesh(dataclasses.replace(node.mesh, vertices=node.shapes[frame]))}"
                for number, node in enumerate(deforming)
                if node.shapes is not None
            ),
            "#break",
        ]
    last = len(recording.times) - 1
    lines += ["#else", f'#error "Frame must be from 0 to {last}"', "#end"]
    return "\n".join(lines) + "\n"


def _pose(track: Track, frame: int) -> str:
    """Scale and motion; scaled by itself, since POV-Ray inverts no matrix of a determinant below 1e-10."""
    rows = [*matrix_of(track.turns[frame]).T, track.places[frame]]
    numbers = ", ".join(f"{value:.9g}" for row in rows for value in row)
    return f"scale {_vector(track.scales[frame])} matrix <{numbers}>"


def _mesh(mesh: Triangles) -> str:
    """Triangles, with normals where they are rounded; colours of vertices as a list of textures."""
    parts = [_list("vertex_vectors", map(_vector, mesh.vertices))]
    if mesh.smooth:
        parts.append(_list("normal_vectors", map(_vector, _normals(mesh))))
    faces = [f"<{a}, {b}, {c}>" for a, b, c in mesh.faces.tolist()]
    if mesh.color is not None:
        colors, numbers = np.unique(mesh.color, axis=0, return_inverse=True)
        parts.append(
            _list("texture_list", (f"texture {{ pigment {{ color rgb {_vector(color)} }} }}" for color in colors))
        )
        corners = numbers.reshape(-1)[mesh.faces]
        faces = [f"{face}, {a}, {b}, {c}" for face, (a, b, c) in zip(faces, corners.tolist(), strict=True)]
    return f"mesh2 {{ {' '.join([*parts, _list('face_indices', faces)])} }}"


def _normals(mesh: Triangles) -> Any:
    """(V, 3) of the vertices: means of those of their triangles, by area."""
    a, b, c = np.asarray(mesh.vertices, np.float64)[mesh.faces].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    found = np.zeros((len(mesh.vertices), 3))
    for corner in range(3):
        np.add.at(found, mesh.faces[:, corner], across)
    return found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-30)


def _list(kind: str, items: Iterable[str]) -> str:
    texts = list(items)
    separator = " " if kind == "texture_list" else ", "
    return f"{kind} {{ {len(texts)}, {separator.join(texts)} }}"


def _vector(values: Any) -> str:
    # twelve digits: POV-Ray wants axes of an image perpendicular to 1e-10
    return f"<{', '.join(f'{float(value):.12g}' for value in np.broadcast_to(values, 3))}>"
