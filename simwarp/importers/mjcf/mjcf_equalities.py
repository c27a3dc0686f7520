"""Equality constraints of MJCF: loop joints between bodies, couplings of coordinates."""

from __future__ import annotations

import mujoco
import numpy as np

from simwarp.core.rotation import rotate
from simwarp.core.types import JointType, Pose
from simwarp.importers.mjcf.mjcf_source import Source
from simwarp.importers.mjcf.mjcf_unsupported import is_off

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
RIGID = "rigid, without MuJoCo's softness"


def add_equalities(source: Source) -> None:
    """Adds the equality constraints that are active as built; those of rods' edges are told with the rod."""
    model, report = source.model, source.report
    for index in range(0 if is_off(model, "equality") else model.neq):
        label, kind = source.label("equality", index), mujoco.mjtEq(model.eq_type[index])
        element = "equality " + kind.name.removeprefix("mjEQ_").lower()
        if not model.eq_active0[index]:
            report.approximate("equality inactive", label, "left out: it is not active as built")
        elif kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            _add_loop(source, index, element, kind == mujoco.mjtEq.mjEQ_WELD)
        elif kind in (mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtEq.mjEQ_TENDON):
            _add_coupling(source, index, element, kind == mujoco.mjtEq.mjEQ_TENDON)
        elif kind != mujoco.mjtEq.mjEQ_FLEX or model.flex_dim[model.eq_obj1id[index]] > 1:
            report.refuse(element, label)


def _add_loop(source: Source, index: int, element: str, is_weld: bool) -> None:
    """A connect or weld as a joint that closes a loop."""
    label = source.label("equality", index)
    (body0, pose0), (body1, pose1) = _ends(source, index, is_weld)
    if body0 == body1:
        source.report.approximate(element, label, "left out: both of its bodies are one")
        return
    source.report.approximate(element, label, RIGID)
    kind = JointType.FIXED if is_weld else JointType.SPHERICAL
    source.builder.add_loop_joint(source.name("equality", index), body0, body1, kind=kind, frame0=pose0, frame1=pose1)


def _ends(source: Source, index: int, is_weld: bool) -> list[tuple[int, Pose]]:
    """Both frames that the constraint brings together: our body, pose in our world as built."""
    model, data, values = source.model, source.data, source.model.eq_data[index]
    objects = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
    if model.eq_objtype[index] == mujoco.mjtObj.mjOBJ_SITE:
        return [
            (source.bodies[model.site_bodyid[site]], source.pose_of_axes(data.site_xpos[site], data.site_xmat[site]))
            for site in objects
        ]
    first, second = objects
    if not is_weld:
        places = [(first, values[0:3], IDENTITY), (second, values[3:6], IDENTITY)]
    else:  # an anchor on the second body, and the second body's pose relative to the first
        relative = values[6:10] if values[6:10].any() else IDENTITY
        on_first = values[3:6] + rotate(np.roll(relative, -1), values[0:3])
        places = [(first, on_first, relative), (second, values[0:3], IDENTITY)]
    return [(source.bodies[body], source.local_pose(body, place, turned)) for body, place, turned in places]


def _add_coupling(source: Source, index: int, element: str, of_tendons: bool) -> None:
    """Y - y0 = a0 + a1 (x - x0) of two joints or tendons: linear ones only."""
    model, label = source.model, source.label("equality", index)
    constant, slope, *higher = model.eq_data[index][:5]
    if any(higher):
        source.report.refuse("equality polycoef", label)
        return
    ends = [(int(model.eq_obj1id[index]), 1.0)]
    if model.eq_obj2id[index] >= 0 and slope != 0.0:
        ends.append((int(model.eq_obj2id[index]), -float(slope)))
    terms: dict[int, float] = {}
    for end, factor in ends:
        for dof, coefficient in coordinate_terms(source, end) if of_tendons else [(_dof_of(source, end), 1.0)]:
            terms[dof] = terms.get(dof, 0.0) + factor * coefficient
    source.report.approximate(element, label, RIGID)
    listed = [(*_joint_of(source, dof), factor) for dof, factor in terms.items() if factor != 0.0]
    source.builder.add_coupling(source.name("equality", index), listed, offset=float(constant))


def coordinate_terms(source: Source, tendon: int) -> list[tuple[int, float]]:
    """(degree of freedom of the source, coefficient) of a fixed tendon."""
    model = source.model
    first = int(model.tendon_adr[tendon])
    wraps = range(first, first + int(model.tendon_num[tendon]))
    return [(_dof_of(source, int(model.wrap_objid[wrap])), float(model.wrap_prm[wrap])) for wrap in wraps]


def _dof_of(source: Source, joint: int) -> int:
    return int(source.model.jnt_dofadr[joint])


def _joint_of(source: Source, dof: int) -> tuple[int, int]:
    """Our joint and its local coordinate of a degree of freedom of the source."""
    return source.builder.coordinate_of(source.dofs[dof])
