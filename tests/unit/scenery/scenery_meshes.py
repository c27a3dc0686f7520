"""What the tests of scenery ask of meshes."""

from __future__ import annotations

import numpy as np


def edge_counts(triangles):
    """(E, 2) directed edges once each after welding, how often they occur, and how often their reverses do."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    there = {tuple(edge): 0 for edge in edges.tolist()}
    for edge in map(tuple, edges.tolist()):
        there[edge] += 1
    return there


def assert_closed(mesh):
    """Every edge of a triangle is met by one of another triangle that runs the other way: a closed surface whose
    triangles all look to the same side, outwards where the volume is positive.
    """
    there = edge_counts(mesh.triangles)
    assert all(there.get((b, a), 0) == count for (a, b), count in there.items())


def solids_of(mesh):
    """The connected solids of a mesh, each as (n,) indices of triangles."""
    label = np.arange(len(mesh.vertices))
    while True:
        least = label[mesh.triangles].min(axis=1)
        new = label.copy()
        for corner in range(3):
            np.minimum.at(new, mesh.triangles[:, corner], least)
        if (new == label).all():
            break
        label = new
    owner = label[mesh.triangles[:, 0]]
    return [np.flatnonzero(owner == value) for value in np.unique(owner)]


def assert_outward(mesh):
    """Each solid of a mesh is closed and encloses a positive volume."""
    assert_closed(mesh)
    for chosen in solids_of(mesh):
        points = mesh.vertices[mesh.triangles[chosen]]
        assert np.linalg.det(points - points[0, 0]).sum() > 0.0


def color_of(mesh):
    """(T, 3, 3) of a mesh that has colours."""
    assert mesh.color is not None
    return mesh.color


def points_of(proxy):
    """(N, 3) of a hull or a mesh."""
    assert proxy.points is not None
    return proxy.points
