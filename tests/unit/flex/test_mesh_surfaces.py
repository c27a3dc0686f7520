"""Surfaces of flexible meshes: which triangles are seen, and how their vertices go with nodes."""

import numpy as np
import pytest
import trimesh

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.meshes.materials import Elastic, Rubber

RUBBER = Rubber(young=1e5, poisson=0.4, density=1000.0)
NYLON = Elastic(young=1e8, density=1100.0)


def closed(mesh, places):
    """The surface as trimesh has it."""
    return trimesh.Trimesh(mesh.surface.vertices(places), mesh.surface.triangles, process=False)


@pytest.mark.parametrize("elements", ["tetrahedra", "hexahedra"])
def test_the_surface_of_a_box_is_closed_and_looks_outwards(elements):
    builder = sw.ModelBuilder()
    mesh = builder.add_solid_mesh("block", sw.flex.box((0.3, 0.2, 0.1), (3, 2, 2), elements=elements), material=RUBBER)
    seen = closed(mesh, mesh.points)
    assert seen.is_watertight
    assert seen.volume == pytest.approx(0.3 * 0.2 * 0.1, rel=1e-12)
    assert seen.area == pytest.approx(2.0 * (0.06 + 0.03 + 0.02), rel=1e-12)
    # two of the middle plane's twelve nodes are inside
    assert len(seen.vertices) == len(mesh.points) - 2


def test_a_sheet_is_seen_as_its_triangles():
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    mesh = sw.ModelBuilder().add_shell("sheet", points, [[0, 1, 2], [0, 2, 3]], thickness=1e-3, material=NYLON)
    assert mesh.surface.vertices(points)[mesh.surface.triangles].tolist() == points[[[0, 1, 2], [0, 2, 3]]].tolist()


def test_an_embedded_surface_goes_with_its_cells():
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    solid = sw.flex.lattice((ball.vertices, ball.faces), spacing=0.02)
    mesh = sw.ModelBuilder().add_solid_mesh("ball", solid, material=RUBBER)
    # a linear map of the nodes is that of the vertices: weights are trilinear
    stretch = np.array([[1.2, 0.1, 0.0], [0.0, 0.9, 0.2], [0.0, 0.0, 1.1]])
    moved = closed(mesh, mesh.points @ stretch.T + [0.0, 0.0, 3.0])
    expected = np.asarray(ball.vertices) @ stretch.T + [0.0, 0.0, 3.0]
    distance = np.linalg.norm(expected[:, None] - moved.vertices[None], axis=-1).min(axis=1)
    assert distance.max() < 1e-9
    assert moved.volume == pytest.approx(ball.volume * np.linalg.det(stretch), rel=1e-6)
    many = mesh.surface.vertices(np.stack([mesh.points, 2.0 * mesh.points]))
    assert (many[1] == 2.0 * many[0]).all()


def test_a_saved_model_keeps_its_embedded_surface(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.05)
    builder = sw.ModelBuilder()
    builder.add_solid_mesh("ball", sw.flex.lattice((ball.vertices, ball.faces), spacing=0.03), material=RUBBER)
    builder.add_solid_mesh("block", sw.flex.box((0.1, 0.1, 0.1), (1, 1, 1)), material=RUBBER)
    sw.save_model(builder, tmp_path / "model.json")
    again = sw.load_model(tmp_path / "model.json")
    for one, other in zip(builder.flexible_meshes, again.flexible_meshes, strict=True):
        for name in ("nodes", "weights", "triangles"):
            assert (getattr(one.surface, name) == getattr(other.surface, name)).all()


def test_a_file_whose_surface_is_of_other_nodes_is_refused(tmp_path):
    import base64
    import json

    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.05)
    builder = sw.ModelBuilder()
    builder.add_solid_mesh("ball", sw.flex.lattice((ball.vertices, ball.faces), spacing=0.03), material=RUBBER)
    sw.save_model(builder, tmp_path / "model.json")
    content = json.loads((tmp_path / "model.json").read_text())
    nodes = content["flexible_meshes"][0]["surface"]["nodes"]
    wrong = np.full(nodes["shape"], 10_000, "<i4")
    nodes["base64"] = base64.b64encode(wrong.tobytes()).decode()
    (tmp_path / "model.json").write_text(json.dumps(content))
    with pytest.raises(ModelError, match="vertices of the surface must be carried by nodes 0 to"):
        sw.load_model(tmp_path / "model.json")
