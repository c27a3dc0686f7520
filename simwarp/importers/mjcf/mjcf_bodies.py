"""Bodies and joints of MJCF: bodies without joints become parts of their parents, several joints a chain."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from simwarp.core.rotation import matrix_of, rotate
from simwarp.core.types import WORLD, Dof, ModelError, PositionDrive, pose as make_pose
from simwarp.importers.coordinates import CoordinateKind, JointCoordinates
from simwarp.importers.imported import NamedFrame
from simwarp.importers.mjcf.mjcf_source import DEFAULT_SOLIMP, DEFAULT_SOLREF, Source

Array = npt.NDArray[np.float64]


def add_bodies(source: Source) -> tuple[dict[str, int], dict[str, NamedFrame]]:
    """Adds every body that joints move; returns these by name, and the frame of every body of the file."""
    model, data = source.model, source.data
    source.bodies = [WORLD] * model.nbody
    for root in range(1, model.nbody):
        if model.body_weldid[root] != root or root in source.vertices:
            continue
        own = [body for body in range(root, model.nbody) if model.body_weldid[body] == root]
        numbers = (model.body_mass[own], model.body_inertia[own], data.xipos[own])
        if not all(np.isfinite(values).all() for values in numbers):
            label = source.label("body", root)
            raise ModelError(
                f"{source.report.source}: body '{label}': mass and inertia must be finite; check its geoms"
            )
        mass, centre, inertia = joined_mass(model, data, own)
        turned = source.rotation(data.xquat[root])
        matrix = matrix_of(np.roll(data.xquat[root], -1))
        if mass <= 0.0:
            index = source.builder.add_massless_body(
                source.name("body", root), pose=make_pose(source.point(data.xpos[root]), turned)
            )
        else:
            index = source.builder.add_body(
                source.name("body", root), mass=mass, inertia=matrix.T @ inertia @ matrix,
                pose=make_pose(source.point(centre), turned), strict=False,
            )  # fmt: skip
        for body in own:
            source.bodies[body] = index
    names, frames = {}, {}
    for body in range(1, model.nbody):
        if body in source.vertices:
            continue
        name = source.name("body", body)
        if model.body_weldid[body] == body:
            names[name] = source.bodies[body]
        frames[name] = source.frame(body, source.pose(data.xpos[body], data.xquat[body]))
        source.report.hold("body", source.label("body", body))
    return names, frames


def joined_mass(model: Any, data: Any, bodies: list[int]) -> tuple[float, Array, Array]:
    """Mass [kg], centre [m] and inertia about it (3, 3) [kg·m²] of welded bodies, in the file's world."""
    masses = model.body_mass[bodies]
    total = float(masses.sum())
    if total <= 0.0:
        return 0.0, np.array(data.xpos[bodies[0]]), np.zeros((3, 3))
    centre = masses @ data.xipos[bodies] / total
    inertia = np.zeros((3, 3))
    for body, mass in zip(bodies, masses, strict=True):
        axes = data.ximat[body].reshape(3, 3)
        arm = data.xipos[body] - centre
        inertia += axes @ np.diag(model.body_inertia[body]) @ axes.T
        inertia += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return total, centre, inertia


def add_joints(source: Source, drives: Mapping[int, PositionDrive]) -> list[JointCoordinates]:
    """Adds the joints of all bodies; `drives` are those of servos, by degree of freedom of the source."""
    model = source.model
    coordinates: list[JointCoordinates] = []
    for body in range(1, model.nbody):
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if body in source.vertices:
            continue
        parent = source.bodies[model.body_parentid[body]]
        for joint in range(first, first + count):
            last = joint == first + count - 1
            child = source.bodies[body] if last else _frame_between(source, body, joint)
            coordinates.append(_add_joint(source, joint, parent, child, body, drives))
            source.ends[joint] = (parent, child)
            parent = child
    return coordinates


def _frame_between(source: Source, body: int, joint: int) -> int:
    """A massless body behind a joint that is not the last one of its body."""
    name = f"{source.name('body', body)}:{source.label('joint', joint)}"
    place = source.point(source.data.xanchor[joint])
    return source.builder.add_massless_body(name, pose=make_pose(place, source.rotation(source.data.xquat[body])))


def _add_joint(
    source: Source, joint: int, parent: int, child: int, body: int, drives: Mapping[int, PositionDrive]
) -> JointCoordinates:
    model, builder, name = source.model, source.builder, source.name("joint", joint)
    kind = mujoco.mjtJoint(model.jnt_type[joint])
    position, rate = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    anchor = source.point(source.data.xanchor[joint])
    _check_joint(source, joint, kind)
    label, held = source.label("joint", joint), f"joint {kind.name.removeprefix('mjJNT_').lower()}"
    source.report.hold(held, label)
    if kind == mujoco.mjtJoint.mjJNT_FREE:
        dofs = _free_dofs(source, joint)
        index = builder.add_joint_free(name, child, anchor=source.point(source.data.xpos[body]), dofs=dofs)
        form = JointCoordinates(name, CoordinateKind.FREE, position, rate, builder.dof_start(index))
    elif kind == mujoco.mjtJoint.mjJNT_BALL:
        turned = source.rotation(source.data.xquat[body])
        rest = rotate(turned, Rotation(np.roll(model.qpos_spring[position : position + 4], -1)).as_rotvec())
        dofs = _at_rest([_dof(source, joint, rate + axis, 0.0, None) for axis in range(3)], rest)
        index = builder.add_joint_spherical(name, parent, child, anchor=anchor, dofs=dofs)
        form = JointCoordinates(
            name, CoordinateKind.BALL, position, rate, builder.dof_start(index),
            rotation=(turned[0], turned[1], turned[2], turned[3]),
        )  # fmt: skip
    else:
        dof = _dof(source, joint, rate, float(model.qpos0[position]), drives.get(rate))
        options = {field.name: getattr(dof, field.name) for field in dataclasses.fields(dof)}
        axis = source.direction(source.data.xaxis[joint])
        slides = kind == mujoco.mjtJoint.mjJNT_SLIDE
        add = builder.add_joint_prismatic if slides else builder.add_joint_revolute
        index = add(name, parent, child, axis=axis, anchor=anchor, **options)
        form = JointCoordinates(
            name, CoordinateKind.SCALAR, position, rate, builder.dof_start(index), offset=float(model.qpos0[position])
        )
    for column in range(form.kind.rates):
        source.dofs[rate + column] = form.dof + column
    return form


def _dof(source: Source, joint: int, dof: int, reference: float, drive: PositionDrive | None) -> Dof:
    """Laws of a coordinate; `reference` is the source's position where ours is 0."""
    model = source.model
    limit = None
    if model.jnt_limited[joint] and is_scalar(model, joint):
        lower, upper = (float(value) - reference for value in model.jnt_range[joint])
        limit = (lower, upper)
    stiffness = float(model.jnt_stiffness[joint])
    rest = (
        float(model.qpos_spring[model.jnt_qposadr[joint]]) - reference if stiffness and is_scalar(model, joint) else 0.0
    )
    return Dof(
        limit=limit, stiffness=stiffness, rest=rest, armature=float(model.dof_armature[dof]),
        damping=float(model.dof_damping[dof]), friction=float(model.dof_frictionloss[dof]), drive=drive,
    )  # fmt: skip


def _free_dofs(source: Source, joint: int) -> list[Dof]:
    """Laws of a floating body: its spring rests where the file has it, in our world."""
    model, place = source.model, int(source.model.jnt_qposadr[joint])
    spring = model.qpos_spring[place : place + 7]
    rest = [*source.point(spring[:3]), *Rotation(source.rotation(spring[3:])).as_rotvec()]
    laws = [_dof(source, joint, int(model.jnt_dofadr[joint]) + axis, 0.0, None) for axis in range(6)]
    return _at_rest([dataclasses.replace(law, friction=0.0) for law in laws], rest)


def _at_rest(laws: Iterable[Dof], rest: Iterable[float]) -> list[Dof]:
    """Laws with their springs at rest there."""
    return [dataclasses.replace(law, rest=float(value) if law.stiffness else 0.0)
            for law, value in zip(laws, rest, strict=True)]  # fmt: skip


def is_scalar(model: Any, joint: int) -> bool:
    """True of joints whose position is one number: hinges and slides."""
    return mujoco.mjtJoint(model.jnt_type[joint]) in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


def _check_joint(source: Source, joint: int, kind: Any) -> None:
    """What joints may carry that has no counterpart."""
    model, report, label = source.model, source.report, source.label("joint", joint)
    dofs = slice(model.jnt_dofadr[joint], model.jnt_dofadr[joint] + (6 if kind == mujoco.mjtJoint.mjJNT_FREE else 1))
    free = kind == mujoco.mjtJoint.mjJNT_FREE
    if free and np.any(model.dof_frictionloss[dofs]):
        report.refuse("free joint law", label)
    if kind == mujoco.mjtJoint.mjJNT_BALL and model.jnt_limited[joint]:
        report.refuse("ball range", label)
    if np.any(model.dof_dampingpoly[dofs]):
        report.refuse("dampingpoly", label)
    if np.any(model.jnt_stiffnesspoly[joint]):
        report.refuse("stiffnesspoly", label)
    if np.any(model.jnt_springyield[joint]):
        report.refuse("springyield", label)
    if model.jnt_actgravcomp[joint]:
        report.refuse("gravcomp", label)
    first = int(dofs.start)
    soft = [(model.jnt_solref[joint], model.jnt_solimp[joint])] if model.jnt_limited[joint] else []
    if model.dof_frictionloss[first] and not free:
        soft.append((model.dof_solref[first], model.dof_solimp[first]))
    if any(np.any(solref != DEFAULT_SOLREF) or np.any(solimp != DEFAULT_SOLIMP) for solref, solimp in soft):
        report.approximate("joint solref", label, "stops and dry friction are rigid, without MuJoCo's softness")
    if model.jnt_limited[joint] and model.jnt_margin[joint]:
        report.approximate("joint margin", label, "stops act where they are: margin is 0")
