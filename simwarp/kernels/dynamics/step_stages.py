"""The stages of a step, in order: one table for the kernels of a CPU and of a GPU (docs/theory.md)."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Final

import warp as wp

from simwarp.kernels.core.cpu_flags import array_flags
from simwarp.kernels.core.face_tables import WITHOUT_FACES
from simwarp.kernels.core.fields import ContactArrays, ControlArrays, Parameters, Reports, StateArrays
from simwarp.kernels.core.stages import Stage, StageKernel, StageLocal, StageRoom, fused_kernel, separate_kernel
from simwarp.kernels.core.tables import StepConfig, StepProgress, Topology
from simwarp.kernels.dynamics.contact_rows import collect_contacts, reduce_contacts, respond_to_contacts
from simwarp.kernels.dynamics.elastic import has_elastic, load_elastic_joints
from simwarp.kernels.dynamics.elastic_links import WITHOUT_ELASTIC
from simwarp.kernels.dynamics.solve_stages import cone_solve, stages_for_cuda_check
from simwarp.kernels.dynamics.step import (
    apply_impulses,
    bias_rotations,
    bias_rows,
    build_islands,
    collect_bounds,
    compute_accelerations,
    compute_reactions,
    factor_constraints,
    form_rows,
    has_accelerations,
    has_cones,
    has_contacts,
    has_islands,
    has_loop_rotations,
    has_projection,
    has_reactions,
    has_rows,
    keep_rate_changes,
    load_state,
    move_freely,
    project_onto_joints,
    publish_bodies,
    publish_joints,
    solve_bilateral,
)
from simwarp.kernels.dynamics.world import (
    CPU_FLAGS,
    MODULE_OPTIONS,
    Scratch,
    kept_rows,
    pack,
    pack_cone,
    pack_loads,
    part_of_cone,
    part_of_work,
)
from simwarp.kernels.meshes.mesh_links import WITHOUT_MESHES
from simwarp.kernels.meshes.mesh_loads import LANES, MeshTables, has_meshes, load_flexible_meshes

ROOM = StageRoom(
    module=__name__, options=MODULE_OPTIONS,
    arguments={
        "config": StepConfig, "topology": Topology, "parameters": Parameters, "control": ControlArrays,
        "scratch": Scratch, "state": StateArrays, "contacts": ContactArrays, "progress": StepProgress,
        "reports": Reports, "flexible": MeshTables,
    },
    locals={
        "work": StageLocal(pack, "scratch", part_of_work), "cone": StageLocal(pack_cone, "scratch", part_of_cone),
        "kept": StageLocal(kept_rows, "scratch"), "loads": StageLocal(pack_loads, "scratch"),
    },
)  # fmt: skip


def step_stages(solve: Sequence[Stage]) -> tuple[Stage, ...]:
    """The stages of a step, of which the cone problem is solved by `solve`."""
    return (
        Stage(name="load_state", function=load_state,
              reads="poses, velocities, controls, element forces",
              writes="momenta, efforts, axes and shifts of the tree's joints"),
        Stage(name="load_elastic_joints", function=load_elastic_joints, when=has_elastic,
              reads="poses, velocities, controls", writes="axes, shifts, rates, efforts and gains of elastic joints"),
        Stage(name="load_flexible_meshes", function=load_flexible_meshes, when=has_meshes, lanes=int(LANES),
              reads="poses, velocities", writes="impulses of elements, the factor of the meshes' matrix"),
        Stage(name="move_freely", function=move_freely,
              reads="momenta, efforts, axes", writes="the tree's factor, velocities of the free motion"),
        Stage(name="form_rows", function=form_rows, when=has_rows,
              reads="poses", writes="wrenches of the rows of closed loops, position errors"),
        Stage(name="bias_rows", function=bias_rows, when=has_rows,
              reads="position errors, velocities, controls", writes="right-hand sides of bilateral rows"),
        Stage(name="bias_rotations", function=bias_rotations, when=has_loop_rotations,
              reads="poses, velocities, controls", writes="right-hand sides of efforts on rotations"),
        Stage(name="factor_constraints", function=factor_constraints, when=has_rows,
              reads="the tree's factor, wrenches", writes="responses of bilateral rows, their factor"),
        Stage(name="solve_bilateral", function=solve_bilateral, when=has_rows,
              reads="responses, factor, right-hand sides", writes="velocities that obey the bilateral rows"),
        Stage(name="collect_bounds", function=collect_bounds, when=has_cones,
              reads="velocities, limits, drives, friction", writes="blocks of bounded impulses on coordinates"),
        Stage(name="collect_contacts", function=collect_contacts, when=has_contacts,
              reads="contacts, velocities", writes="blocks of contacts, their right-hand sides and warm starts"),
        Stage(name="respond_to_contacts", function=respond_to_contacts, when=has_contacts,
              reads="contacts, the tree's factor", writes="responses of the contacts' rows"),
        Stage(name="reduce_contacts", function=reduce_contacts, when=has_contacts,
              reads="responses, the factor of bilateral rows", writes="their shares, blocks that can move"),
        Stage(name="build_islands", function=build_islands, when=has_islands,
              reads="blocks", writes="blocks sorted by islands"),
        *solve,
        Stage(name="apply_impulses", function=apply_impulses, when=has_cones,
              reads="impulses", writes="velocities after the impulses, forces of contacts, a recovery"),
        Stage(name="keep_rate_changes", function=keep_rate_changes, when=has_accelerations,
              reads="velocities", writes="changes of the rates"),
        Stage(name="project_onto_joints", function=project_onto_joints, when=has_projection,
              reads="poses, velocities", writes="poses on the joints"),
        Stage(name="compute_accelerations", function=compute_accelerations, when=has_accelerations,
              reads="changes of the rates", writes="accelerations of coordinates"),
        Stage(name="compute_reactions", function=compute_reactions, when=has_reactions,
              reads="impulses, momenta", writes="reactions of joints"),
        Stage(name="publish_bodies", function=publish_bodies,
              reads="velocities, poses, a recovery", writes="state of bodies, diagnostics"),
        Stage(name="publish_joints", function=publish_joints,
              reads="poses", writes="coordinates of joints, time"),
    )  # fmt: skip


NOT_OF_TREES: Final = (has_elastic, has_meshes, has_rows, has_loop_rotations, has_contacts, has_islands)
"""What no stage of `fused_tree_step` is for. A model has it or not, whatever it reports: with accelerations, the motion
is that without them bit by bit.
"""


@functools.cache
def fused_step(all_solvers: bool, elastic: bool, meshes: bool, faces: bool) -> StageKernel:
    """The step in one kernel, with accelerated gradient descent as its only solver, or with all (twice the code); for
    models with elastic joints, meshes, and faces of these that touch others, or without.
    """
    parts = ((WITHOUT_ELASTIC, elastic), (WITHOUT_MESHES, meshes), (WITHOUT_FACES, faces))
    stages = [stage for stage in step_stages([cone_solve(all_solvers)]) if meshes or stage.when is not has_meshes]
    return _fused("step_worlds", stages, [macro for macro, has in parts if not has])


@functools.cache
def fused_tree_step() -> StageKernel:
    """The step of trees that meet nothing: without loops, contacts, islands, elastic joints and meshes, by accelerated
    gradient descent. Half the code of `fused_step`.
    """
    stages = [stage for stage in step_stages([cone_solve(False)]) if stage.when not in NOT_OF_TREES]
    return _fused("step_trees", stages, [WITHOUT_ELASTIC, WITHOUT_MESHES, WITHOUT_FACES])


def _fused(name: str, stages: Sequence[Stage], without: Sequence[str]) -> StageKernel:
    flags = " ".join([CPU_FLAGS, array_flags(), *(f"-D{macro}" for macro in without)])
    return fused_kernel(name, stages, dataclasses.replace(ROOM, options=MODULE_OPTIONS | {"cpu_compiler_flags": flags}))


@functools.cache
def stage_kernel(stage: Stage) -> StageKernel:
    """The kernel of one stage."""
    return separate_kernel(stage, ROOM)


def kernels_for_cuda_check() -> list[wp.Kernel]:
    """All stages, with all solvers."""
    return [stage_kernel(stage).kernel for stage in step_stages(stages_for_cuda_check())]
