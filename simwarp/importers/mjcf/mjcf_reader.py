"""`load_mjcf`: a file that MuJoCo compiles, rebuilt in our builder with a report about every element."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from simwarp.core.rotation import rotate
from simwarp.core.types import FrictionRule, ModelError, PairRule, Pose, pose as make_pose
from simwarp.importers.coordinates import CoordinateKind, CoordinateMap, JointCoordinates
from simwarp.importers.imported import Imported
from simwarp.importers.links.link_tree import unchanged_on_error
from simwarp.importers.mjcf.mjcf_files import list_tags
from simwarp.importers.mjcf.mjcf_source import Source
from simwarp.importers.report import ImportReport
from simwarp.importers.self_collision import SelfCollision, checked_self_collision, set_self_collision
from simwarp.importers.source_files import needed, source_file
from simwarp.model.builder import ModelBuilder

WHAT: Final = "load_mjcf"
OLDEST_MUJOCO: Final = 4
"""Its models have fields that older ones lack, such as `jnt_springyield`."""


def load_mjcf(
    path: str | os.PathLike[str], builder: ModelBuilder | None = None, *, pose: Pose | None = None, prefix: str = "",
    allow: Collection[str] = (), decompose: bool | Mapping[str, Any] = False, self_collision: SelfCollision = None,
) -> Imported:  # fmt: skip
    """A robot or scene of an MJCF file. MuJoCo itself compiles it: defaults, includes, classes and units are its own.

    Args:
        path: of the file.
        builder: to add it to; a new one when None, which gets the file's gravity, and MuJoCo's rules for pairs and
            friction.
        pose: of the file's world in ours; identity when None.
        prefix: of all names.
        allow: kinds of refused elements to leave out with a warning.
        decompose: take several hulls for a mesh instead of one: True, or options of `coacd.run_coacd`.
        self_collision: whether what hangs on one body of the world touches itself: None as the file says, True for
            all pairs, False for none, "adjacent-off" for all but those of bodies that a joint ties, "overlapping-off"
            for those that the file says and that do not overlap as built.

    Raises:
        ModelError: MuJoCo cannot compile the file, or it has elements that are refused: one line that names them.
    """
    file = source_file(path, WHAT, (".xml", ".mjcf"))
    mujoco = needed("mujoco", WHAT)
    if int(mujoco.__version__.partition(".")[0]) < OLDEST_MUJOCO:
        raise ModelError(
            f"{WHAT} needs mujoco {OLDEST_MUJOCO}.0 or later, got {mujoco.__version__}; "
            "run: pip install -U 'simwarp[import]'"
        )
    # these import MuJoCo
    from simwarp.importers.mjcf.mjcf_shapes import shapes_by_root, visuals_of_geoms
    from simwarp.importers.mjcf.mjcf_unsupported import (
        REFUSABLE,
        apply_flags,
        check_model,
        check_tags,
        is_off,
        shortcut_actuators,
    )

    report = ImportReport(file.name, REFUSABLE, allow)
    choice = checked_self_collision(file.name, self_collision)
    tags = list_tags(file, report)
    check_tags(tags, report)
    report.check()
    model, data, spec = _compiled(mujoco, file, report, visuals=False)
    fresh = builder is None
    target = ModelBuilder() if builder is None else builder
    source = Source(model, data, report, target, prefix, make_pose() if pose is None else pose, decompose)
    source.shortcuts = shortcut_actuators(tags)
    source.flexes = list(spec.flexes)
    apply_flags(model, report)
    check_model(source)
    report.check()
    with unchanged_on_error(target):
        if fresh:
            gravity = np.zeros(3) if is_off(model, "gravity") else np.asarray(model.opt.gravity, np.float64)
            target.gravity = rotate(source.placement.rotation, gravity)
            target.pair_rule, target.friction_rule = PairRule.EITHER, FrictionRule.MAX
        imported = _build(source)
        set_self_collision(target, choice, shapes_by_root(source), report)
        report.finish()
    imported.show = visuals_of_geoms(source, lambda: _compiled(mujoco, file, report, visuals=True)[:2])
    return imported


def _build(source: Source) -> Imported:
    """Adds everything to the builder."""
    from simwarp.importers.mjcf.mjcf_actuators import actuator_specs, add_tendons, joint_drives, servos_of
    from simwarp.importers.mjcf.mjcf_bodies import add_bodies, add_joints
    from simwarp.importers.mjcf.mjcf_equalities import add_equalities
    from simwarp.importers.mjcf.mjcf_flexes import add_flexes, vertex_bodies
    from simwarp.importers.mjcf.mjcf_shapes import add_shapes
    from simwarp.importers.mjcf.mjcf_sites_cameras import cameras_of, keyframes_of, sensors_of, sites_of
    from simwarp.importers.mjcf.mjcf_unsupported import is_off

    powered = not is_off(source.model, "actuation")
    servos = servos_of(source) if powered else {}
    source.vertices = vertex_bodies(source)
    bodies, frames = add_bodies(source)
    joints = add_joints(source, joint_drives(source, servos))
    bodies |= add_flexes(source)
    tendons = add_tendons(source, servos)
    add_equalities(source)
    shapes = add_shapes(source)
    coordinates = _coordinates(source, joints)
    sites = sites_of(source)
    return Imported(
        builder=source.builder, bodies=bodies, dofs={joint.name: joint.dof for joint in joints}, shapes=shapes,
        coordinates=coordinates, report=source.report, frames=frames, sites=sites, cameras=cameras_of(source),
        keyframes=keyframes_of(source, coordinates), sensors=sensors_of(source, sites), tendons=tendons,
        actuators=actuator_specs(source, servos) if powered else (), timestep=float(source.model.opt.timestep),
    )  # fmt: skip


def _coordinates(source: Source, joints: list[JointCoordinates]) -> CoordinateMap:
    """The map of the file's joints; floating bodies start where the placement puts them."""
    initial = np.array(source.model.qpos0, np.float64)
    for joint in joints:
        if joint.kind is CoordinateKind.FREE:
            first = joint.position
            initial[first : first + 3] = source.point(initial[first : first + 3])
            initial[first + 3 : first + 7] = np.roll(source.rotation(initial[first + 3 : first + 7]), 1)
    model = source.model
    return CoordinateMap(tuple(joints), int(model.nq), int(model.nv), source.builder.dof_count, initial)


def _compiled(mujoco: Any, file: Path, report: ImportReport, *, visuals: bool) -> tuple[Any, Any, Any]:
    """The compiled model, its data at `qpos0`, and the specification that it was compiled of.

    Args:
        mujoco: the library.
        file: of the model.
        report: for messages.
        visuals: with meshes that only show; without them their files are not read.

    Raises:
        ModelError: MuJoCo cannot compile it.
    """
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)  # or MuJoCo writes a log file into the working folder
    try:
        spec = mujoco.MjSpec.from_file(str(file))
        if not visuals:
            _drop_visual_meshes(mujoco, spec)
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
    except (ValueError, mujoco.FatalError, OSError) as error:
        label = " ".join(str(error).split())
        raise ModelError(f"{report.source}: MuJoCo cannot compile it: {label}; repair the file") from None
    finally:
        mujoco.set_mju_user_warning(None)
    for text in warned:
        report.hold("compiler", "", f"MuJoCo warns: {' '.join(text.split())}")
    return model, data, spec


def _drop_visual_meshes(mujoco: Any, spec: Any) -> None:
    """Takes meshes out that only show, where the mass of their bodies is given otherwise."""
    if spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        return
    named = {pair.geomname1 for pair in spec.pairs} | {pair.geomname2 for pair in spec.pairs}
    kept = set()
    for geom in list(spec.geoms):
        is_mesh = geom.type == mujoco.mjtGeom.mjGEOM_MESH
        only_shows = geom.contype == 0 and geom.conaffinity == 0 and geom.name not in named
        has_mass = geom.parent.explicitinertial or geom.parent.name == "world"
        if is_mesh and only_shows and has_mass:
            spec.delete(geom)
        elif geom.meshname:
            kept.add(geom.meshname)
    for site in spec.sites:
        kept.add(getattr(site, "meshname", ""))
    for mesh in list(spec.meshes):
        if mesh.name not in kept:
            spec.delete(mesh)
