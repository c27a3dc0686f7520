"""Faces of meshes as built: their tables, their place in files and in what a model is compared by."""

import json
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.kernels.core.face_tables import ACROSS, EDGE, OWNER, TWO_SIDED

RUBBER = sw.flex.Rubber(young=1e5, poisson=0.4, density=1000.0)
NYLON = sw.flex.Elastic(young=1e8, density=1100.0)
ACROSS, EDGE, OWNER, TWO_SIDED = int(ACROSS), int(EDGE), int(OWNER), int(TWO_SIDED)
SQUARE, HALVES = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)], [(0, 1, 2), (0, 2, 3)]


def built(contact="faces", **options):
    """A sheet, and a block on a plate, as builder."""
    builder = sw.ModelBuilder()
    plate = builder.add_body("plate", mass=1.0, inertia=(1.0, 1.0, 1.0))
    builder.add_shell("sheet", SQUARE, HALVES, thickness=1e-3, material=NYLON, contact=contact, **options)
    builder.add_solid_mesh(
        "block", sw.flex.box((0.2, 0.2, 0.2), (2, 2, 2)), material=RUBBER, glue={plate: "z_min"}, contact=contact,
        radius=2e-3,
    )  # fmt: skip
    return builder


def test_only_faces_that_move_are_there_and_each_edge_has_two_of_a_closed_one():
    """Of the 48 triangles of the block the 8 of its lower side are glued."""
    builder = built()
    model = builder.finalize(1, "cpu")
    table = model.topology.face.numpy()
    assert model.topology.face_count == len(table) == 2 + 48 - 8
    sheet = np.flatnonzero(table[:, TWO_SIDED] == 1)
    assert len(sheet) == 2
    assert (table[sheet, ACROSS : ACROSS + 3] >= 0).sum() == 2
    block = np.flatnonzero(table[:, TWO_SIDED] == 0)
    assert (table[block, ACROSS : ACROSS + 3] >= 0).all()
    counts = np.bincount(table[block, EDGE : EDGE + 3].ravel() - table[block, EDGE : EDGE + 3].min())
    # the border of the glued side is one of a moving face alone
    assert sorted(np.unique(counts[counts > 0])) == [1, 2]
    assert (counts == 1).sum() == 8


def test_a_face_comes_with_the_sphere_of_its_deepest_node():
    """The deepest link of its corners, on whose way up the others are."""
    model = built().finalize(1, "cpu")
    topology = model.topology
    table, points = topology.face.numpy(), topology.face_point.numpy()
    links, parents = topology.body_link.numpy(), topology.link_parent.numpy()
    bodies = topology.shape_body.numpy()
    start = topology.face_start.numpy()
    for shape in range(topology.shape_count):
        assert (table[start[shape] : start[shape + 1], OWNER] == shape).all()
    for row in table:
        corner_links = [int(links[body]) for body in points[row[:3], 0]]
        way, link = [], int(links[bodies[row[OWNER]]])
        while link >= 0:
            way.append(link)
            link = int(parents[link])
        assert way[0] == max(corner_links)
        assert set(corner_links) <= set(way)


def test_a_file_keeps_where_meshes_touch(tmp_path):
    builder = built()
    sw.save_model(builder, tmp_path / "model.json")
    again = sw.load_model(tmp_path / "model.json")
    assert [mesh.contact for mesh in again.flexible_meshes] == [sw.flex.MeshContact.FACES] * 2
    one: Any
    other: Any
    one, other = (made.finalize(1, "cpu") for made in (builder, again))
    assert one.identity == other.identity
    assert (one.topology.face.numpy() == other.topology.face.numpy()).all()
    assert (one.topology.face_place.numpy() == other.topology.face_place.numpy()).all()
    assert one.identity != built("nodes", radius=5e-4).finalize(1, "cpu").identity


def test_a_file_whose_faces_have_no_spheres_is_refused(tmp_path):
    sw.save_model(built("nodes", radius=5e-4), tmp_path / "model.json")
    content = json.loads((tmp_path / "model.json").read_text())
    content["flexible_meshes"][0]["contact"] = "faces"
    content["flexible_meshes"][0]["shapes"] = [0, 1, 3]
    (tmp_path / "model.json").write_text(json.dumps(content))
    with pytest.raises(ModelError, match="nodes of faces must have a sphere, got none for node 2; touch by nodes"):
        sw.load_model(tmp_path / "model.json")


def test_by_nodes_there_are_no_faces():
    model = built("nodes").finalize(1, "cpu")
    assert model.topology.face_count == 0
    assert sw.Simulation(model, 1e-3).contacts.contact_face.shape[1] == 0
