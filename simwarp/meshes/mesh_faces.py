"""Faces of a model's meshes: triangles of their surfaces that touch other shapes, and the tables of kernels."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.types import ModelError
from simwarp.kernels.core.face_tables import ACROSS, EDGE, OWNER, TWO_SIDED
from simwarp.meshes.mesh_specification import FlexibleMesh, MeshContact
from simwarp.meshes.mesh_surfaces import outer_triangles

COLUMNS = int(OWNER) + 1


@dataclasses.dataclass(frozen=True)
class MeshFaces:
    """Faces of all meshes of a model, in the order of the shapes that they come with (kernels/core/face_tables.py).

    Attributes:
        face: (f, 11) points of the corners and across the edges, edges, whether both sides touch, the owner's shape.
        point: (p, 2) body and shape of each point.
        place: (p, 3) of those that are no bodies of their own, on their body [m].
    """

    face: npt.NDArray[np.int32]
    point: npt.NDArray[np.int32]
    place: npt.NDArray[np.float64]

    @property
    def bodies(self) -> npt.NDArray[np.int32]:
        """(f, 3) bodies of the corners."""
        return np.asarray(self.point[self.face[:, :3], 0])


def face_count(meshes: Sequence[FlexibleMesh]) -> int:
    """How many there are."""
    return sum(len(_moving(mesh)) for mesh in meshes)


def mesh_faces(
    meshes: Sequence[FlexibleMesh], links: Mapping[int, int], shape_bodies: Sequence[int]
) -> MeshFaces:  # fmt: skip
    """The faces of a model.

    Args:
        meshes: of it.
        links: number of each body's link.
        shape_bodies: body of each shape.
    """
    faces, places = [np.zeros((0, COLUMNS), np.int32)], [np.zeros((0, 3))]
    bodies: list[int] = []
    shapes: list[int] = []
    edges = points = 0
    for mesh in meshes:
        if mesh.contact is not MeshContact.FACES:
            continue
        sphere = {shape_bodies[shape]: shape for shape in mesh.shapes}
        own = set(mesh.nodes)
        triangles = _moving(mesh)
        across, numbers, count = _edges(outer_triangles(mesh.parts), triangles)
        table = np.full((len(triangles), COLUMNS), -1, np.int32)
        table[:, :3] = triangles + points
        table[:, int(ACROSS) : int(EDGE)] = np.where(across >= 0, across + points, -1)
        table[:, int(EDGE) : int(TWO_SIDED)] = numbers + edges
        table[:, int(TWO_SIDED)] = mesh.parts[0].kind == "triangles"
        for row, corners in enumerate(triangles.tolist()):
            deepest = max((mesh.bodies[node] for node in corners if node in own), key=lambda body: links[body])
            table[row, int(OWNER)] = sphere[deepest]
        faces.append(table)
        bodies += mesh.bodies
        shapes += [sphere.get(body, -1) if node in own else -1 for node, body in enumerate(mesh.bodies)]
        still = np.array([node not in own for node in range(len(mesh.points))])
        places.append(np.where(still[:, None], mesh.places, 0.0))
        edges, points = edges + count, points + len(mesh.points)
    face = np.concatenate(faces)
    return MeshFaces(
        face[np.argsort(face[:, int(OWNER)], kind="stable")],
        np.array([bodies, shapes], np.int32).T.reshape(-1, 2), np.concatenate(places),
    )  # fmt: skip


class ModelParts(Protocol):
    """What faces need of a builder."""

    flexible_meshes: list[FlexibleMesh]
    shapes: list[Any]


def face_topology(
    topology: Any, builder: ModelParts, link_bodies: Sequence[int], device: Any
) -> npt.NDArray[np.int32]:  # fmt: skip
    """The faces as kernels read them; returns the bodies of their corners.

    Args:
        topology: whose shapes are there; is filled in.
        builder: of the model.
        link_bodies: body of each link.
        device: where they lie.
    """
    links = {body: index for index, body in enumerate(link_bodies)}
    faces = mesh_faces(builder.flexible_meshes, links, [shape.body for shape in builder.shapes])
    t = topology
    t.face_count = len(faces.face)
    owners = faces.face[:, int(OWNER)]
    starts = np.searchsorted(owners, np.arange(t.shape_count + 1))
    t.face_start = wp.array(starts.astype(np.int32), dtype=int, device=device)
    # one row at least, so that there is something to point at
    t.face = wp.array2d(faces.face if t.face_count else np.full((1, COLUMNS), -1), dtype=int, device=device)
    t.face_point = wp.array2d(faces.point if t.face_count else np.full((1, 2), -1), dtype=int, device=device)
    t.face_place = wp.array(faces.place if t.face_count else np.zeros((1, 3)), dtype=wp.vec3d, device=device)
    return faces.bodies


def _moving(mesh: FlexibleMesh) -> npt.NDArray[np.int32]:
    """(f, 3) triangles of a mesh that touch: those with a node that moves by itself."""
    if mesh.contact is not MeshContact.FACES:
        return np.zeros((0, 3), np.int32)
    triangles = outer_triangles(mesh.parts)
    return np.asarray(triangles[np.isin(triangles, mesh.nodes).any(axis=1)])


def _edges(
    every: npt.NDArray[np.int32], triangles: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], int]:
    """(f, 3) node across each edge of the triangles, -1 where not just one other triangle is there, number of the edge,
    and how many edges there are; `every` triangle of the surface may be across.
    """
    owned: dict[tuple[int, int], list[int]] = {}
    for corners in every.tolist():
        for k in range(3):
            low, high = sorted((corners[k], corners[(k + 1) % 3]))
            owned.setdefault((low, high), []).append(corners[(k + 2) % 3])
    number = {edge: index for index, edge in enumerate(owned)}
    across, numbers = np.full(triangles.shape, -1, np.int64), np.zeros(triangles.shape, np.int64)
    for row, corners in enumerate(triangles.tolist()):
        for k in range(3):
            low, high = sorted((corners[k], corners[(k + 1) % 3]))
            apexes = list(owned[low, high])
            apexes.remove(corners[(k + 2) % 3])
            across[row, k] = apexes[0] if len(apexes) == 1 else -1
            numbers[row, k] = number[low, high]
    return across, numbers, len(number)


def check_faces(thing: str, mesh: FlexibleMesh, shape_bodies: Sequence[int]) -> None:
    """Every node of a face that moves by itself has a sphere.

    Raises:
        ModelError: one has none.
    """
    spheres = {shape_bodies[shape] for shape in mesh.shapes}
    touching = set(_moving(mesh).ravel().tolist())
    for node in mesh.nodes:
        if node in touching and mesh.bodies[node] not in spheres:
            raise ModelError(f"{thing}: nodes of faces must have a sphere, got none for node {node}; touch by nodes")
