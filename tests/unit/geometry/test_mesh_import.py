"""Mesh files and convex decomposition: what comes in is what the file says, and errors tell the remedy."""

import importlib.util
import sys
import types

import numpy as np
import pytest
import trimesh

from simwarp import WORLD, ModelBuilder, Simulation, pose
from simwarp.core.types import ModelError, ShapeType
from simwarp.geometry.mesh_files import convex_parts, load_mesh


def box_mesh():
    """A box of 2 x 4 x 6 m."""
    return trimesh.creation.box((2.0, 4.0, 6.0))


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply", "glb"])
def test_formats(tmp_path, suffix):
    path = tmp_path / f"box.{suffix}"
    box_mesh().export(path)
    vertices, triangles = load_mesh(path)
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [2.0, 4.0, 6.0], atol=1e-6)
    assert len(triangles) == 12
    p = vertices[triangles]
    assert np.linalg.det(p).sum() / 6.0 == pytest.approx(48.0, rel=1e-6)  # outer sides are out


def test_parts_of_a_scene_are_put_where_it_has_them(tmp_path):
    scene = trimesh.Scene([box_mesh(), box_mesh().apply_translation((10.0, 0.0, 0.0))])
    scene.export(tmp_path / "two.glb")
    vertices, triangles = load_mesh(tmp_path / "two.glb")
    assert np.ptp(vertices[:, 0]) == pytest.approx(12.0)
    assert len(triangles) == 24


def test_unwelded_triangles_know_their_neighbours(tmp_path):
    box_mesh().export(tmp_path / "box.stl")
    builder = ModelBuilder()
    builder.add_shape_mesh(WORLD, tmp_path / "box.stl")
    assert builder.meshes[0].vertices.shape == (8, 3)


def test_a_ball_rests_on_a_file(tmp_path):
    box_mesh().export(tmp_path / "box.obj")
    builder = ModelBuilder()
    builder.add_shape_mesh(WORLD, str(tmp_path / "box.obj"), scale=(1.0, 1.0, 0.5))
    builder.add_solid("ball", "sphere", 0.2, mass=1.0, pose=pose((0.1, 0.2, 1.75)))
    sim = Simulation(builder.finalize(1, "cpu"), 0.005)
    for _ in range(100):
        sim.step()
    assert sim.state.body_x.numpy()[0, 0, 2] == pytest.approx(1.7, abs=1e-5)


def test_errors_of_files(tmp_path):
    with pytest.raises(ModelError, match="there must be a file"):
        load_mesh(tmp_path / "absent.obj")
    (tmp_path / "a.step").write_text("x")
    with pytest.raises(ModelError, match=r"format must be one of .obj"):
        load_mesh(tmp_path / "a.step")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\n")
    with pytest.raises(ModelError, match=r"must (hold triangles|be readable)"):
        load_mesh(tmp_path / "points.obj")


def fake_modules(monkeypatch, **modules):
    """Lets the named decomposition libraries, and no others, be importable."""
    real = importlib.util.find_spec

    def find_spec(name, *rest):
        if name in ("coacd", "vhacdx"):
            return types.SimpleNamespace() if name in modules else None
        return real(name, *rest)

    monkeypatch.setattr(importlib.util, "find_spec", find_spec)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)


def halves(vertices):
    """The parts of a box on both sides of z = 0."""
    upper = vertices.copy()
    upper[:, 2] = np.maximum(upper[:, 2], 0.0)
    lower = vertices.copy()
    lower[:, 2] = np.minimum(lower[:, 2], 0.0)
    return [upper, lower]


def fake_coacd(monkeypatch):
    """A coacd that halves meshes; returns the list of the options of its calls."""
    calls = []
    module = types.ModuleType("coacd")

    def run(mesh, **options):
        calls.append(options)
        return [(part, mesh[1]) for part in halves(mesh[0])]

    vars(module).update(Mesh=lambda vertices, faces: (vertices, faces), run_coacd=run)
    fake_modules(monkeypatch, coacd=module)
    return calls


def test_decomposition_with_coacd(monkeypatch, tmp_path):
    monkeypatch.setenv("SIMWARP_CACHE", str(tmp_path))
    calls = fake_coacd(monkeypatch)
    box = box_mesh()
    builder = ModelBuilder()
    slots = builder.add_shape_mesh(WORLD, box.vertices, box.faces, decompose={"threshold": 0.1}, name="rock")
    assert calls == [{"threshold": 0.1}]
    assert slots == [0, 1]
    assert [shape.name for shape in builder.shapes] == ["rock_0", "rock_1"]
    assert all(shape.type == ShapeType.HULL for shape in builder.shapes)


def test_decomposition_with_vhacdx(monkeypatch):
    module = types.ModuleType("vhacdx")
    vars(module)["compute_vhacd"] = lambda vertices, faces: [(part, faces) for part in halves(np.asarray(vertices))]
    fake_modules(monkeypatch, vhacdx=module)
    box = box_mesh()
    assert len(convex_parts(box.vertices, box.faces)) == 2


def test_decomposition_without_a_library(monkeypatch):
    fake_modules(monkeypatch)
    with pytest.raises(ModelError, match="pip install coacd"):
        ModelBuilder().add_shape_mesh(WORLD, box_mesh().vertices, box_mesh().faces, decompose=True)


def test_a_decomposition_is_kept_by_content(monkeypatch, tmp_path):
    monkeypatch.setenv("SIMWARP_CACHE", str(tmp_path))
    calls = fake_coacd(monkeypatch)
    box = box_mesh()
    first = convex_parts(box.vertices, box.faces, threshold=0.1)
    again = convex_parts(box.vertices, box.faces, threshold=0.1)
    assert len(calls) == 1
    assert [part.tobytes() for part in first] == [part.tobytes() for part in again]
    convex_parts(box.vertices, box.faces, threshold=0.2)
    convex_parts(np.asarray(box.vertices) * 2.0, box.faces, threshold=0.1)
    assert len(calls) == 3
    files = list((tmp_path / "decompositions").iterdir())
    assert len(files) == 3
    assert {file.suffix for file in files} == {".npz"}
    for file in files:
        file.write_bytes(file.read_bytes()[:100])  # cut off
    assert [part.tobytes() for part in convex_parts(box.vertices, box.faces, threshold=0.1)] == [
        part.tobytes() for part in first
    ]
    assert len(calls) == 4


def test_a_cache_that_cannot_be_written_is_no_hindrance(monkeypatch, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("SIMWARP_CACHE", str(blocked))
    module = types.ModuleType("vhacdx")
    vars(module)["compute_vhacd"] = lambda vertices, faces: [(part, faces) for part in halves(np.asarray(vertices))]
    fake_modules(monkeypatch, vhacdx=module)
    assert len(convex_parts(box_mesh().vertices, box_mesh().faces)) == 2
