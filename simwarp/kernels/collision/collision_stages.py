"""The stages of collision, in order: one table for the kernels of a CPU and of a GPU (docs/theory.md)."""

from __future__ import annotations

import dataclasses
import functools

import warp as wp

from simwarp.kernels.collision.collide import (
    clip_pairs,
    collide_simple_pairs,
    has_formula_pairs,
    has_ground_pairs,
    has_searched_pairs,
    keep_contacts,
    list_pairs,
    place_world,
    search_pairs,
)
from simwarp.kernels.collision.contact_lists import (
    ContactLists,
    pack_clipped,
    pack_found,
    pack_pairs,
    pack_triangles,
    pack_valid,
)
from simwarp.kernels.collision.face_contacts import clip_faces, list_faces
from simwarp.kernels.collision.ground import (
    clip_triangles,
    drop_invalid,
    join_triangles,
    list_triangles,
    search_triangles,
)
from simwarp.kernels.collision.placement import CollisionScratch, pack_grid, pack_manifold, pack_raw
from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.cpu_flags import INLINE, array_flags
from simwarp.kernels.core.face_tables import WITHOUT_FACES, has_faces
from simwarp.kernels.core.fields import ContactArrays, Parameters, StateArrays
from simwarp.kernels.core.stages import Stage, StageKernel, StageLocal, StageRoom, fused_kernel, separate_kernel
from simwarp.kernels.core.tables import StepConfig, Topology

ROOM = StageRoom(
    module=__name__, options={"enable_backward": False, "max_unroll": 0},
    arguments={
        "config": StepConfig, "topology": Topology, "parameters": Parameters, "assets": Assets, "state": StateArrays,
        "scratch": CollisionScratch, "lists": ContactLists, "contacts": ContactArrays,
    },
    locals={
        "grid": StageLocal(pack_grid, "scratch"), "manifold": StageLocal(pack_manifold, "scratch"),
        "raw": StageLocal(pack_raw, "scratch"), "pairs": StageLocal(pack_pairs, "lists"),
        "triangles": StageLocal(pack_triangles, "lists"), "clipped": StageLocal(pack_clipped, "lists"),
        "valid": StageLocal(pack_valid, "lists"), "found": StageLocal(pack_found, "lists"),
    },
)  # fmt: skip

STAGES = (
    Stage(name="place_shapes", function=place_world,
          reads="poses, velocities", writes="shapes in the world, their bounds, the grid"),
    Stage(name="collide_simple_pairs", function=collide_simple_pairs, when=has_formula_pairs,
          reads="shapes, bounds", writes="contacts of pairs with a formula"),
    Stage(name="list_pairs", function=list_pairs, when=has_searched_pairs,
          reads="shapes, bounds", writes="convex pairs that may touch"),
    Stage(name="search_pairs", function=search_pairs, when=has_searched_pairs,
          reads="convex pairs", writes="their normals"),
    Stage(name="clip_pairs", function=clip_pairs, when=has_searched_pairs,
          reads="convex pairs, normals", writes="contacts of convex pairs"),
    Stage(name="list_triangles", function=list_triangles, when=has_ground_pairs,
          reads="shapes, bounds", writes="triangles that shapes may touch"),
    Stage(name="search_triangles", function=search_triangles, when=has_ground_pairs,
          reads="triangles", writes="their normals"),
    Stage(name="clip_triangles", function=clip_triangles, when=has_ground_pairs,
          reads="triangles, normals", writes="contacts with single triangles"),
    Stage(name="drop_invalid", function=drop_invalid, when=has_ground_pairs,
          reads="contacts with single triangles", writes="those that the surface as a whole has"),
    Stage(name="join_triangles", function=join_triangles, when=has_ground_pairs,
          reads="contacts of the surface", writes="contacts with surfaces"),
    Stage(name="list_faces", function=list_faces, when=has_faces,
          reads="shapes, bounds, poses of nodes", writes="faces of meshes that shapes may touch"),
    Stage(name="search_faces", function=search_triangles, when=has_faces,
          reads="faces", writes="their normals"),
    Stage(name="clip_faces", function=clip_faces, when=has_faces,
          reads="faces, normals, poses of nodes", writes="contacts with faces"),
    Stage(name="keep_contacts", function=keep_contacts,
          reads="contacts of all pairs, those of the last step", writes="contacts with warm starts"),
)  # fmt: skip


@functools.cache
def fused_collision(faces: bool) -> StageKernel:
    """All stages in one kernel, for models with faces of meshes, or without."""
    flags = f"{INLINE} -fno-slp-vectorize {array_flags()}"
    if not faces:
        flags += f" -D{WITHOUT_FACES}"
    room = dataclasses.replace(ROOM, options={**ROOM.options, "cpu_compiler_flags": flags})
    stages = [stage for stage in STAGES if faces or stage.when is not has_faces]
    return fused_kernel("collide_worlds", stages, room)


@functools.cache
def stage_kernel(stage: Stage) -> StageKernel:
    """The kernel of one stage."""
    return separate_kernel(stage, ROOM)


def kernels_for_cuda_check() -> list[wp.Kernel]:
    """All stages."""
    return [stage_kernel(stage).kernel for stage in STAGES]
